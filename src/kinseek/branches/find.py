"""Every branch: what `Arm.branches` does around `kernels.branches`, which holds the search itself."""

from __future__ import annotations

import itertools
import math
import threading
import weakref
from collections import OrderedDict
from collections.abc import Callable
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from kinseek.deadline import Deadline
from kinseek.errors import InvalidProblem, suggest
from kinseek.goal import Goal
from kinseek.kernels.arm.forward import forward_many
from kinseek.kernels.arm.jacobian import jacobian_many
from kinseek.kernels.arm.pose_error import judge
from kinseek.kernels.arrays import Array
from kinseek.kernels.atlas.lanes import LANES
from kinseek.kernels.branches.search import ROWS, find_branches, many_branches, sample_branches
from kinseek.problem import Problem
from kinseek.robots.blackbox import BlackBox
from kinseek.robots.chain import SerialChain
from kinseek.solvers.atlas.solver import KEPT, AtlasIndex, atlas_of, open_limits, wanted_of
from kinseek.solvers.threads import GoOn, spread

from .result import Branches, BranchesBatch

Cost = Callable[[Array], Any]
"""Joint values, (k, n), to numbers, (k,); the least is best."""
Valid = Callable[[Array], Any]
"""Joint values, (n,), to a bool."""

SAMPLES = 1024
"""Samples of the coarse atlas; see `kernels.branches` for why so few."""

SPREAD = 50
"""Answers in a sample, unless told otherwise."""

Order = Literal["mid-range", "limits", "dexterity"]
"""What comes first of several answers; see `Arm.branches`."""

ORDERS: tuple[Order, ...] = get_args(Order)

MOST_COPIES = 100_000
"""Answers at most, turned by full turns: two joints of ±4,000 rad have more than a million copies of each answer."""

_CHUNK = 64
"""Targets that a thread takes at a time."""

_PIECE = 4
"""Targets that are done at a stretch: some ten milliseconds if they are hard."""

_MOST_MIRRORED = 8
"""Joints up to which mirror images are looked for: there are 2ⁿ patterns of signs."""


class BranchIndex:
    """What an arm needs once, for one kind of goal, before its branches can be found: immutable, shared by threads."""

    def __init__(self, problem: Problem) -> None:
        """Sort coarse samples, count the freedom that the goal leaves, and look for mirror images."""
        chain, kind = problem.chain, problem.goal.kind
        self.freedom = freedom(problem)
        """Joints that the goal leaves to choose: 0 for isolated answers, 1 for curves, and so on."""
        self.coarse = AtlasIndex(chain, kind, problem.arrays, SAMPLES)
        self.fine = atlas_of(chain, problem.goal)
        middle, half = (chain.lower + chain.upper) / 2, (chain.upper - chain.lower) / 2
        turning = np.where(chain.periodic, 0.5 / np.pi, 0.0)
        self.view: Array = np.array([middle, 1 / np.maximum(half, 1e-12), turning])
        """How `kernels.branches` shall see the answers: from the middle of every range, in halves of it, (3, n)."""
        self.mirrors: Array = np.zeros((0, 3, chain.dof))
        """Signs, shifts and whether the joint turns, of every mirror image of the arm, (k, 3, n)."""
        if not self.freedom and chain.dof <= _MOST_MIRRORED:
            self.mirrors = self._mirrors(problem)

    def search(self, wanted: Array, target: Array, view: Array, count: int) -> Array:
        """Rows of answers to one target, (4, 4), as `kernels.branches.find_branches` returns them."""
        if self.freedom:
            return sample_branches(self.fine.handle, wanted, target, view, count, LANES)
        return find_branches(self.coarse.handle, self.fine.handle, wanted, self.mirrors, target, view, LANES)

    def _mirrors(self, problem: Problem) -> Array:
        """Look for images q → signs · q + shifts that leave every pose as it is.

        Any image takes a configuration to another branch of its own pose. So the branches of one pose tell all the shifts
        there can be, and a second configuration tells which of them hold.
        """
        chain, dof = problem.chain, problem.chain.dof
        turns = chain.periodic
        signs = np.array(list(itertools.product((1.0, -1.0), repeat=dof)))
        wanted, width = wanted_of(Goal.pose(np.eye(4))), chain.upper - chain.lower
        probe = chain.lower + 0.381966 * width
        pose = forward_many(problem.arrays, probe[None])[0]
        found: list[Array] = []
        for share in (0.45, 0.6, 0.7):  # Where an image of a configuration lies inside the limits differs.
            q = chain.lower + share * np.linspace(0.9, 1.1, dof) * width
            target = forward_many(problem.arrays, q[None])[0]
            rows = self.search(wanted, target, self.view, 0)
            if not len(rows):
                continue
            for other in rows[: int(rows[-1, 0]), :dof]:
                shifts = other - signs * q
                whole = np.round(shifts / np.pi) * np.pi
                shifts = np.where(turns & (np.abs(shifts - whole) < 1e-6), whole, shifts)
                reached = forward_many(problem.arrays, np.ascontiguousarray(signs * probe + shifts))
                for k in np.flatnonzero(np.abs(reached - pose).max(axis=(1, 2)) < 1e-9):
                    image = np.array([signs[k], shifts[k], turns])
                    turned = np.where(turns, (shifts[k] + np.pi) % (2 * np.pi) - np.pi, shifts[k])
                    itself = (signs[k] > 0).all() and np.abs(turned).max() < 1e-6
                    if not itself and not any(_same_image(image, known, turns) for known in found):
                        found.append(image)
        return np.array(found).reshape(-1, 3, dof)


def _same_image(one: Array, other: Array, turns: NDArray[np.bool_]) -> bool:
    apart = one[1] - other[1]
    apart = np.where(turns, (apart + np.pi) % (2 * np.pi) - np.pi, apart)
    return bool((one[0] == other[0]).all() and np.abs(apart).max() < 1e-6)


_Shelf = OrderedDict[tuple[str, bytes | None], BranchIndex]
_indices: weakref.WeakKeyDictionary[SerialChain, _Shelf] = weakref.WeakKeyDictionary()
_building = threading.Lock()


def index_of(problem: Problem) -> BranchIndex:
    """The index of an arm for a kind of goal: built at the first call, dropped with the arm.

    Those of the last `KEPT` tools and tool axes are kept.

    Raises:
        InvalidProblem: An arm or a goal whose branches are not known here.
    """
    goal = problem.goal
    if isinstance(problem.chain, BlackBox):
        raise InvalidProblem(
            f"{problem.chain.name!r} is a function: branches are looked for along axes, and it has none"
        )
    if goal.kind == "box":
        raise InvalidProblem(
            "a goal with free axes or ranges has endless answers; ask ik for one, or branches of a pose, a position or a "
            "direction"
        )
    key = (goal.kind, None if goal.tip is None else goal.tip.tobytes())
    with _building:
        mine = _indices.setdefault(problem.chain, OrderedDict())
        if key not in mine:
            mine[key] = BranchIndex(problem)
        mine.move_to_end(key)
        of_tools = [other for other in mine if other[1] is not None]
        for oldest in of_tools[:-KEPT]:
            del mine[oldest]
        return mine[key]


def constraint_jacobian(problem: Problem, q: Array) -> Array:
    """Derivatives of what the goal fixes of the pose, (k, n) -> (k, rows, n); rows are [m] or [rad] a joint unit."""
    J = jacobian_many(problem.arrays, np.ascontiguousarray(q))
    if problem.goal.kind == "position":
        return J[:, :3]
    if problem.goal.kind == "pointing":
        tool = forward_many(problem.arrays, np.ascontiguousarray(q))[:, :3, 0]
        across = J[:, 3:] - tool[:, :, None] * np.einsum("kr,krn->kn", tool, J[:, 3:])[:, None, :]
        return np.concatenate([J[:, :3], across], axis=1)
    return J


def freedom(problem: Problem) -> int:
    """Joints less the constraints of a goal, as they are anywhere but at singularities."""
    chain = problem.chain
    shares = (0.5 + np.arange(1, 8)[:, None] * np.sqrt([2.0, 3, 5, 7, 11, 13, 17, 19])[None]) % 1.0
    shares = np.tile(shares, -(-chain.dof // shares.shape[1]))[:, : chain.dof]
    q = chain.lower + (0.1 + 0.8 * shares) * (chain.upper - chain.lower)
    values = np.linalg.svd(constraint_jacobian(problem, q), compute_uv=False)
    rank = int((values > 1e-6 * values.max()).sum(axis=1).max())
    return chain.dof - rank


def branches_of(
    problem: Problem,
    *,
    order: str = "mid-range",
    cost: Cost | None = None,
    valid: Valid | None = None,
    copies: bool = False,
    count: int | None = None,
    threads: int | None = None,
    prove: bool = False,
) -> Branches | BranchesBatch:
    """Find every branch of every target of a problem; see `Arm.branches`."""
    _check(problem, order, cost, count)
    deadline = Deadline(problem.time_limit)
    index, goal = index_of(problem), problem.goal
    number = (count or SPREAD) if index.freedom else 0
    wanted = wanted_of(goal)
    targets = np.zeros((len(goal.targets), 4, 4))
    targets[:, :3], targets[:, 3, 3] = goal.targets, 1.0
    views = index.view[None]
    # A proof takes answers inside [-π, π]; they are turned and sorted afterwards.
    if problem.near is not None and not prove:
        near = np.broadcast_to(problem.near, (*goal.shape, problem.chain.dof)).reshape(-1, problem.chain.dof)
        views = np.stack([near, np.ones_like(near), np.broadcast_to(index.view[2], near.shape)], axis=1)
    found = _search(index, wanted, targets, np.ascontiguousarray(views), number, threads, deadline)
    each = tuple(
        _none(one, index)
        if rows is None
        else _finish(one, rows, index, order, cost, valid, copies, count, prove, deadline)
        for one, rows in zip(problem.each(), found, strict=True)
    )
    return BranchesBatch(each, goal.shape) if goal.shape else each[0]


def _check(problem: Problem, order: str, cost: Cost | None, count: int | None) -> None:
    if order not in ORDERS:
        raise InvalidProblem(suggest(str(order), ORDERS, "order"))
    if count is not None and (isinstance(count, bool) or not isinstance(count, int) or count < 1):
        raise InvalidProblem(f"count must be a whole number of at least 1, got {count!r}")
    chosen = [name for name, given in _given(problem, order, cost) if given]
    if len(chosen) > 1:
        raise InvalidProblem(f"{' and '.join(chosen)} both say what comes first; give one of them")


def _given(problem: Problem, order: str, cost: Cost | None) -> list[tuple[str, bool]]:
    return [
        ("near", problem.near is not None),
        ("cost", cost is not None),
        (f"order={order!r}", order != "mid-range"),
    ]


def _search(
    index: BranchIndex,
    wanted: Array,
    targets: Array,
    views: Array,
    number: int,
    threads: int | None,
    deadline: Deadline,
) -> list[Array | None]:
    """Rows of answers to each target, (k, 4, 4); None for those that the time was too short for."""
    found: list[Array | None] = [None] * len(targets)
    if len(targets) == 1:
        if not deadline.passed:
            found[0] = index.search(wanted, targets[0], views[0], number)
        return found
    most, width = number or ROWS, views.shape[-1] + 3

    def work(begin: int, end: int, go_on: GoOn) -> None:
        results, counts = np.empty((_PIECE, most + 1, width)), np.empty(_PIECE, dtype=np.int64)
        for first in range(begin, end, _PIECE):
            if not go_on():
                return
            last = min(first + _PIECE, end)
            many_branches(
                index.coarse.handle,
                index.fine.handle,
                wanted,
                index.mirrors,
                targets,
                views,
                number,
                first,
                last,
                results,
                counts,
                LANES,
            )
            for i in range(first, last):
                found[i] = results[i - first, : counts[i - first]].copy()

    spread(work, len(targets), _CHUNK, threads, deadline)
    return found


def _none(problem: Problem, index: BranchIndex) -> Branches:
    """What is told of a target that the time was too short for."""
    nothing = np.empty(0)
    return Branches(
        q=np.empty((0, problem.chain.dof)),
        position_error=nothing,
        orientation_error=nothing,
        complete=False,
        sampled=bool(index.freedom),
        evaluations=0,
        rejected=0,
        problem=problem,
        out_of_time=True,
    )


def _finish(
    problem: Problem,
    rows: Array,
    index: BranchIndex,
    order: str,
    cost: Cost | None,
    valid: Valid | None,
    copies: bool,
    count: int | None,
    prove: bool,
    deadline: Deadline,
) -> Branches:
    """Prove, sort, filter and judge the answers to one target."""
    number, dof, complete, late = int(rows[-1, 0]), problem.chain.dof, False, False
    q, errors = rows[:number, :dof].copy(), rows[:number, dof : dof + 2]
    if prove:
        from kinseek.proof.isolation import prove_complete

        q, complete = prove_complete(problem, q, deadline=deadline)
        late = not complete and deadline.passed
        q = problem.placed(q)
    if copies:
        q = turned_copies(problem.chain, q)
    if copies or prove:
        targets = np.repeat(problem.goal.targets, len(q), axis=0)
        errors = judge(problem.arrays, np.ascontiguousarray(q), targets, problem.goal.arrays)
    place = np.arange(len(q))
    if cost is not None or order != "mid-range" or copies or prove:
        place = np.argsort(scores(problem, q, order, cost), kind="stable")
    rejected = 0
    if valid is not None:
        passed = [i for i in place if is_valid(valid, q[i])]
        rejected, place = len(place) - len(passed), np.array(passed, dtype=np.int64)
    place = place[:count]
    return Branches(
        q=q[place],
        position_error=errors[place, 0].copy(),
        orientation_error=errors[place, 1].copy(),
        complete=complete and len(place) + rejected == len(q),
        sampled=bool(index.freedom) or (rows[-1, 2] > 0.0 and not complete),
        evaluations=int(rows[-1, 1]),
        rejected=rejected,
        problem=problem,
        out_of_time=late,
    )


def turned_copies(chain: SerialChain, q: Array) -> Array:
    """Every answer, and it turned by every number of full turns that the limits allow, (k, n) -> (K, n).

    A continuous joint has no copies: its values are angles.

    Raises:
        InvalidProblem: There are more than `MOST_COPIES`.
    """
    rows: list[tuple[float, ...]] = []
    open_lower, _ = open_limits(chain)
    for answer in q:
        choices = []
        for i, value in enumerate(answer):
            if not np.isfinite(open_lower[i]) or open_lower[i] == chain.lower[i]:
                choices.append(np.array([value]))
                continue
            least = np.ceil((chain.lower[i] - value) / (2 * np.pi) - 1e-12)
            most = np.floor((chain.upper[i] - value) / (2 * np.pi) + 1e-12)
            turned = value + 2 * np.pi * np.arange(least, most + 1)
            choices.append(np.clip(turned, chain.lower[i], chain.upper[i]))
        count = len(rows) + math.prod(len(values) for values in choices)
        if count > MOST_COPIES:
            raise InvalidProblem(
                f"turned by all full turns that the limits of {chain.name!r} allow, the answers to this goal are "
                f"more than {MOST_COPIES:,}, too many for copies=True and for a cost, which judges each of them; "
                f"narrow the limits by with_limits, or choose among the answers of branches() yourself"
            )
        rows += list(itertools.product(*choices))
    return np.array(rows).reshape(-1, chain.dof)


def scores(problem: Problem, q: Array, order: str, cost: Cost | None) -> Array:
    """What each answer costs, (k,); the least is best."""
    chain = problem.chain
    if not len(q):
        return np.zeros(0)
    if cost is not None:
        return cost_of(cost, q)
    if problem.near is not None:
        gap = q - problem.near
        turning = np.array(chain.kinds) == "continuous"
        gap = np.where(turning, (gap + np.pi) % (2 * np.pi) - np.pi, gap)
        return np.asarray(np.linalg.norm(gap, axis=-1))
    if order == "dexterity":
        return -manipulability(problem, q)
    half = np.maximum((chain.upper - chain.lower) / 2, 1e-12)
    away = (q - (chain.lower + chain.upper) / 2) / half
    if order == "limits":
        limited = np.array(chain.kinds) != "continuous"
        return np.asarray(np.abs(away[..., limited]).max(axis=-1, initial=0.0))
    return np.asarray(np.linalg.norm(away, axis=-1))


def manipulability(problem: Problem, q: Array) -> Array:
    """Product of the singular values of what the goal fixes, (k, n) -> (k,) (Yoshikawa 1985, eq. 4).

    Only as many of them as the arm can have anywhere: a planar arm moves in three directions of six.
    """
    values = np.linalg.svd(constraint_jacobian(problem, q), compute_uv=False)
    return np.asarray(values[:, : problem.chain.dof - index_of(problem).freedom].prod(axis=1))


def cost_of(cost: Cost, q: Array) -> Array:
    """Ask the user's cost.

    Raises:
        InvalidProblem: It raised, or what it returned is not one number for each answer.
    """
    try:
        raw = cost(q.copy())
        values = np.asarray(raw, dtype=np.float64)
    except Exception as error:
        raise InvalidProblem(
            f"cost raised {type(error).__name__}: {error}, for {len(q)} answers, the first q = {_written(q[0])}"
        ) from error
    if values.shape != (len(q),):
        raise InvalidProblem(
            f"cost must take (k, n) and return (k,): for {q.shape} it returned {values.shape}, "
            f"the first q = {_written(q[0])}"
        )
    if np.isnan(values).any():
        raise InvalidProblem(f"cost returned NaN for q = {_written(q[np.isnan(values)][0])}")
    return values


def is_valid(valid: Valid, q: Array) -> bool:
    """Ask the user's predicate about one answer, (n,).

    Raises:
        InvalidProblem: It raised, or returned no bool.
    """
    try:
        answer = valid(q.copy())
    except Exception as error:
        raise InvalidProblem(
            f"valid raised {type(error).__name__}: {error}, for q = {_written(q)}"
        ) from error
    if isinstance(answer, bool | np.bool_) or (
        isinstance(answer, np.ndarray) and answer.shape == () and answer.dtype == bool
    ):
        return bool(answer)
    raise InvalidProblem(f"valid must return a bool, got {answer!r} for q = {_written(q)}")


def _written(q: Array) -> str:
    return np.array2string(q, precision=6, separator=", ", max_line_width=1000)
