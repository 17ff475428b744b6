"""Free axes and ranges as virtual joints: a goal with freedom is a goal without any for an arm with more joints.

Let T be the pose of the hand, and d and D the translation and the rotation by which it deviates from the target. Then
T · D⁻¹ · Trans(-d) is the target itself. So an arm with additional joints at its tip that turn by D⁻¹ and slide by -d,
within limits that are the ranges, reaches the target exactly where the arm itself reaches the goal. Slides along the axes
of the base are placed at the base instead. What cannot deal with ranges, such as the search for branches, the planners of
paths and the proofs, works on this arm.

How D is made of joints depends on the ranges:

- One axis with a range: a joint about it.
- A free axis of which the direction counts: nothing, since the goal becomes one of a direction. A cone about that direction
  is a free turn about the axis followed by a tilt of at most its angle.
- Two or three axes with ranges: R_i(A) R_j(B) R_k(c) R_j(B) R_i(A), where a pair of joints turns by the same angle. If only
  two axes have ranges, the middle part is one joint R_j(b). With the unit quaternion (w, v) of D the angles are in closed
  form sin(c/2) = v_k, sin B = v_j / cos(c/2), tan A = v_i / w. So the component of the rotation vector along the third axis
  is exactly zero where two axes have ranges, and the angles differ from the components in third order only. Limits of the
  angles are therefore slightly more than the ranges, and `Extended.accepts` says which angles lie in them; or slightly less.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .errors import InvalidProblem
from .kernels.arm.forward import forward_many
from .kinds import POINTING, POSE, POSITION, Kind
from .problem import Problem
from .ranges import AXES, FREE_TURN, PINNED, Ranges
from .robots.chain import SerialChain, with_tool
from .robots.mechanism import CONTINUOUS, PRISMATIC, REVOLUTE
from .support.caching import WeakCache
from .support.transforms import quaternion, rotation_onto, rotations, square

Array = NDArray[np.float64]

LEAST_SHARE = 0.25
"""Least fraction that remains of ranges about several axes on a path. Not examined further."""

_MOST = 16
"""Number of extended arms that an arm keeps, the last ones used."""

_SPIN, _TILT, _BACK = "spin", "tilt", "back"
"""Names of the joints of a cone: the free turn about the tool axis, the tilt of that axis, and the direction of the tilt."""


class Extended(NamedTuple):
    """An arm with a virtual joint for each range of a goal, and the goal without ranges."""

    problem: Problem
    own: slice
    """The arm's own joints among all."""
    original: Problem
    turns: _Turns

    @property
    def exact(self) -> bool:
        """Return whether the joints allow exactly the deviations that the ranges accept, and no others."""
        return not self.turns.several

    @property
    def inside(self) -> bool:
        """Return whether the ranges accept every motion of the virtual joints."""
        return not self.turns.several or self.turns.narrowed

    @property
    def leverage(self) -> float:
        """Return the longest slide along axes of the tool [m], by which an error of the orientation moves the hand."""
        chain, first = self.problem.chain, self.own.stop + len(self.turns.variables)
        return float(np.hypot.reduce(np.maximum(-chain.lower[first:], chain.upper[first:]), initial=0.0))

    @property
    def loosened(self) -> Problem:
        """Return the problem with tolerances such that it is solved wherever the arm reaches the goal.

        Slides along axes of the tool turn with it, so an error of the orientation moves the place they lead to.
        """
        goal = self.problem.goal
        place = goal.position_tolerance + self.leverage * min(goal.orientation_tolerance, math.pi)
        return (
            replace(self.problem, goal=replace(goal, position_tolerance=place))
            if self.leverage
            else self.problem
        )

    def accepts(self, q: Array) -> NDArray[np.bool_]:
        """Return for all joint values, (k, more), whether the deviation lies in the ranges of several rotations, (k,)."""
        if self.inside:
            return np.ones(len(q), dtype=np.bool_)
        first = self.own.stop
        w = self.turns.vectors(q[:, first : first + len(self.turns.variables)])
        ends = np.array(self.original.goal.ranges)[3:]
        slack = self.original.goal.orientation_tolerance
        return np.asarray(((w >= ends[:, 0] - slack) & (w <= ends[:, 1] + slack)).all(axis=1))

    def with_virtual(self, q: Array) -> Array:
        """Add the values of the virtual joints to joint values of the arm, one row per target, (k, n) -> (k, more).

        Where the arm misses the ranges, they are the nearest inside the limits.
        """
        goal, chain = self.original.goal, self.problem.chain
        T = forward_many(self.original.arrays, np.ascontiguousarray(q))[:, :3]
        targets, F = goal.targets, goal.frames
        back = np.swapaxes(F, 1, 2)
        d = (back @ (T[:, :, 3] - targets[:, :, 3])[..., None])[..., 0]
        D = back @ T[:, :, :3] @ np.swapaxes(targets[:, :, :3], 1, 2) @ F
        whole = np.empty((len(q), chain.dof))
        slides = [d[:, i] for i in range(3) if goal.ranges is not None and goal.ranges[i] != PINNED]
        turns = list(self.turns.values(D).T)
        at_base = self.own.start
        before, after = slides[:at_base][::-1], [*turns, *slides[at_base:]]
        whole[:, self.own] = q
        for j, column in [*enumerate(before), *enumerate(after, self.own.stop)]:
            whole[:, j] = np.clip(column, chain.lower[j], chain.upper[j])
        return whole


class _Joint(NamedTuple):
    """A virtual variable and its joints."""

    name: str
    axis: Array
    """(3,), in the frame in which the ranges are given, as long as 1."""
    lower: float
    upper: float
    kind: str


class _Turns(NamedTuple):
    """The virtual joints that make the rotation of a deviation."""

    variables: tuple[_Joint, ...]
    several: bool
    """Whether they are those of ranges about several axes; every variable but the last one drives a pair of joints."""
    kind: Kind
    """Kind of the goal that remains."""
    axis: Array
    """For a cone, and for a goal of a direction: the axis, (3,)."""
    narrowed: bool = False
    """Whether the limits of several axes are such that the ranges accept every motion."""

    @property
    def order(self) -> list[int]:
        """Return the variables of the physical joints, from the tip of the arm on."""
        forward = list(range(len(self.variables)))
        return forward + forward[-2::-1] if self.several else forward

    def values(self, D: Array) -> Array:
        """Return the variables for rotations in the frame, (k, 3, 3) -> (k, variables)."""
        if not self.variables:
            return np.zeros((len(D), 0))
        if self.axis.any():
            return self._cone_values(D)
        q = quaternion(D)
        v = [(q[:, 1:] * joint.axis).sum(axis=1) for joint in self.variables]
        if not self.several:
            return np.asarray(2.0 * np.arctan2(v[0], q[:, 0])[:, None])
        last = 2.0 * np.arcsin(np.clip(v[-1], -1.0, 1.0))
        columns = [np.arctan2(v[0], q[:, 0])]
        if len(v) == 3:
            columns.append(np.arcsin(np.clip(v[1] / np.maximum(np.cos(0.5 * last), 1e-300), -1.0, 1.0)))
        return np.stack([*columns, last], axis=1)

    def _cone_values(self, D: Array) -> Array:
        """Return spin, tilt and direction of the tilt: D = R_z(direction) R_x(tilt) R_z(spin), with z along the axis."""
        turn = rotation_onto(np.array([0.0, 0.0, 1.0]), self.axis)
        D = turn.T @ D @ turn
        sine = np.hypot(D[:, 2, 0], D[:, 2, 1])
        tilted = sine > 1e-9  # Below, the direction of the tilt is mostly rounding.
        spin = np.where(tilted, np.arctan2(D[:, 2, 0], D[:, 2, 1]), np.arctan2(D[:, 1, 0], D[:, 0, 0]))
        about = np.where(tilted, np.arctan2(D[:, 0, 2], -D[:, 1, 2]), 0.0)
        if len(self.variables) == 1:
            return (spin + about)[:, None]
        values = np.stack([spin, np.arctan2(sine, D[:, 2, 2]), about], axis=1)
        return np.asarray(values[:, : len(self.variables)])

    def vectors(self, values: Array) -> Array:
        """Return the rotation vectors of the deviations that values of several axes make, (k, variables) -> (k, 3)."""
        last = 0.5 * values[:, -1]
        w, v = np.cos(last), np.sin(last)[:, None] * self.variables[-1].axis
        for joint, angle in zip(self.variables[-2::-1], values.T[-2::-1], strict=True):
            # R(A) (w, v) R(A): the parts across the axis stay as they are.
            w, v = w * np.cos(angle), v + (w * np.sin(angle))[:, None] * joint.axis
        sine = np.linalg.norm(v, axis=1)
        angle = 2.0 * np.arctan2(sine, np.abs(w)) * np.where(w < 0.0, -1.0, 1.0)
        return np.asarray(v * (angle / np.maximum(sine, 1e-300))[:, None])


def extended(problem: Problem, inside: bool = False) -> Extended:
    """Return the arm with virtual joints for the ranges of a goal; a goal without ranges gets none.

    Args:
        problem: The problem; its starts are not used.
        inside: Of ranges about several axes the virtual joints shall reach a part, such that every motion of them is
            accepted, instead of slightly more than the ranges; `Extended.inside` is False if too little is left of these.

    Raises:
        InvalidProblem: Ranges about axes that change from target to target.
    """
    goal, chain = problem.goal, problem.chain
    if goal.ranges is None:
        return Extended(problem, slice(0, chain.dof), problem, _Turns((), False, goal.form, np.zeros(3)))
    targets, base = goal.targets, np.eye(3) if goal.base is None else goal.base[:3, :3].T
    slides = [i for i in range(3) if goal.ranges[i] != PINNED]
    rotations_of = goal.ranges[3:], goal.swing, goal.cone, goal.orientation_tolerance
    turns = _turns_of(*rotations_of, bool(slides) and goal.frame == "tool", inside)
    at_tip = goal.frame == "tool" and turns.kind is POSE
    own, along = np.eye(3), base
    if goal.frame == "base":
        used = [*(joint.axis for joint in turns.variables), turns.axis]
        in_tool = np.swapaxes(targets[:, :, :3], 1, 2) @ base
        own = _constant(in_tool, used, "about axes of the base", "in the tool", "tool")
    elif not at_tip:
        used = [np.eye(3)[i] for i in slides]
        along = _constant(targets[:, :, :3], used, "along axes of the tool", "in the base", "base")
    far = float(slide_limits(problem).max(initial=0.0))
    tool = None if goal.tool is None else goal.tool.tobytes()
    key = (rotations_of, goal.ranges[:3], goal.frame, inside, tool, far, own.tobytes(), along.tobytes())

    def make() -> SerialChain:
        more = replace(chain) if goal.tool is None else with_tool(chain, square(goal.tool[:3]))
        more = _with_turns(more, turns, own)
        for i in slides:
            low, high = (float(np.clip(end, -far, far)) for end in (goal.ranges or ())[i])
            slide = _Joint(AXES[i], np.eye(3)[i] if at_tip else along[:, i], low, high, PRISMATIC)
            more = _at_tip(more, slide, more.dof) if at_tip else _at_base(more, slide)
        return more

    more = _chains.of(chain).get(key, make)
    axis = own @ turns.axis
    plain = replace(
        goal,
        target=np.array([square(row) for row in targets]).reshape(*goal.shape, 4, 4),
        kind=turns.kind.name,
        tool_axis=(float(axis[0]), float(axis[1]), float(axis[2]))
        if turns.kind is POINTING
        else (0.0, 0.0, 1.0),
        ranges=None,
        swing=None,
        cone=0.0,
        tool=None,
        base=None,
        frame="tool",
    )
    first = 0 if at_tip else len(slides)
    others = Problem(more, plain, budget=problem.budget, time_limit=problem.time_limit)
    return Extended(others, slice(first, first + chain.dof), problem, turns)


_chains: WeakCache[SerialChain, object, SerialChain] = WeakCache(_MOST)


def slide_limits(problem: Problem) -> Array:
    """Return for each target how far the virtual slides need to go to either side, (k,), [m].

    That of a free axis is rounded up to a power of 2, the same for all targets within the arm's reach, so that they share an
    extended arm and its atlas, and one target alone has the same as in a batch.
    """
    goal = problem.goal
    longest = np.abs((goal.ranges or (PINNED,))[:3]).max()
    reach = problem.chain.reach + (0.0 if goal.tool is None else float(np.linalg.norm(goal.tool[:3, 3])))
    distances = np.maximum(np.linalg.norm(goal.targets[:, :, 3], axis=1), reach)
    powers = np.ceil(np.log2(np.maximum(2.0 * reach + distances, 1e-300)))
    return np.asarray(np.minimum(longest, np.exp2(powers)))


@lru_cache(maxsize=64)
def _turns_of(
    ranges: Ranges,
    swing: tuple[float, float, float] | None,
    cone: float,
    tolerance: float,
    slides_at_tip: bool,
    inside: bool,
) -> _Turns:
    """Return the joints for the rotation of a goal's deviation.

    Args:
        ranges: Of rx, ry and rz.
        swing: See `Goal`.
        cone: See `Goal`.
        tolerance: That of the orientation [rad].
        slides_at_tip: Whether there are slides along axes of the tool: they come after every turn of the hand, so that
            turns have to be joints as well, instead of being left out of the goal.
        inside: See `extended`.
    """
    if ranges == (FREE_TURN,) * 3:
        return _Turns((), False, POSITION, np.zeros(3))
    if swing is not None:
        axis = np.array(swing)
        spin = _Joint(_SPIN, axis, -math.pi, math.pi, CONTINUOUS)
        across = rotation_onto(np.array([0.0, 0.0, 1.0]), axis)[:, 0]
        tilt = _Joint(_TILT, across, -cone, cone, REVOLUTE)
        joints = [spin, tilt, spin._replace(name=_BACK)] if cone else [spin]
        if not slides_at_tip:  # The goal of a direction leaves the last turn about it free.
            joints.pop()
        return _Turns(tuple(joints), False, POSE if slides_at_tip else POINTING, axis)
    open_axes = [i for i in range(3) if ranges[i] != PINNED]
    if len(open_axes) < 2:
        single = tuple(_Joint(AXES[3 + i], np.eye(3)[i], *ranges[i], REVOLUTE) for i in open_axes)
        return _Turns(single, False, POSE, np.zeros(3))
    turns = _Turns(_several(open_axes, ranges, tolerance), True, POSE, np.zeros(3))
    return _narrowed(turns, ranges) if inside else turns


def _several(axes: list[int], ranges: Ranges, tolerance: float) -> tuple[_Joint, ...]:
    """Return joints for ranges of two or three components of a rotation vector, the widest range outermost.

    Their limits contain every rotation whose vector is within the tolerance of the ranges.
    """
    order = sorted(axes, key=lambda i: ranges[i][0] - ranges[i][1])
    ends = {i: (ranges[i][0] - tolerance, ranges[i][1] + tolerance) for i in order}
    longest = min(math.pi, math.sqrt(sum(max(-low, high, 0.0) ** 2 for low, high in ends.values())))
    inner = order[-1]
    # |v_k| = |w_k| sin(θ/2) / θ is at most sin(|w_k| / 2), since θ ≥ |w_k|.
    cosine = math.cos(0.5 * min(math.pi, max(map(abs, ends[inner]))))
    slope = math.tan(0.5 * longest) / longest if longest < math.pi else math.inf

    def farthest(i: int, end: float) -> float:
        """Bound an angle by the end of its range that is farther from 0."""
        if i == order[0]:  # tan A = w_i tan(θ/2) / θ, and |w_i| ≤ θ ≤ `longest`.
            return math.atan(end * slope) if end else 0.0
        end = max(-math.pi, min(math.pi, end))
        if i == inner:
            return end
        return math.asin(max(-1.0, min(1.0, math.sin(0.5 * end) / max(cosine, 1e-300))))

    def nearest(i: int, end: float) -> float:
        """Bound an angle by the end of its range that is nearer to 0, of a range on one side of 0."""
        if i == order[0]:  # tan(θ/2) / θ grows with θ ≥ |w_i|.
            return 0.5 * end
        # sin(θ/2) / θ falls with θ, and the cosine in sin B = v_j / cos(c/2) is at most 1.
        sine = end * math.sin(0.5 * longest) / longest
        return 2.0 * math.asin(sine) if i == inner else math.asin(sine)

    def joint(i: int) -> _Joint:
        low, high = ends[i]
        lower = nearest(i, low) if low > 0.0 else farthest(i, low)
        upper = nearest(i, high) if high < 0.0 else farthest(i, high)
        return _Joint(AXES[3 + i], np.eye(3)[i], lower, upper, REVOLUTE)

    outer, *others = map(joint, order)
    if ranges[order[0]] == FREE_TURN and all(ranges[i][0] == -ranges[i][1] for i in order[1:]):
        # Half a turn of the outermost pair turns the others round, so it is endless where their ranges are symmetric.
        outer = outer._replace(lower=-math.pi, upper=math.pi, kind=CONTINUOUS)
    return (outer, *others)


def _narrowed(turns: _Turns, ranges: Ranges) -> _Turns:
    """Return the joints of ranges about several axes with limits such that no values of them leave the ranges.

    The limits move towards the values of the middle of the ranges, until no point of a grid leaves them. If too little is
    left, they stay as they are.
    """
    low, high = np.array(ranges).T
    (middle,) = turns.values(rotations(0.5 * (low + high))[None])
    ends = np.array([[joint.lower, joint.upper] for joint in turns.variables])
    endless = np.array([joint.kind == CONTINUOUS for joint in turns.variables])
    grid = np.stack(np.meshgrid(*[np.linspace(0, 1, 17)] * len(ends)), axis=-1).reshape(-1, len(ends))
    for share in np.linspace(1, LEAST_SHARE, 76):
        part = np.where(endless, 1.0, share)[:, None]
        first, last = (middle[:, None] + part * (ends - middle[:, None])).T
        first, last = np.where(endless, ends[:, 0], first), np.where(endless, ends[:, 1], last)
        vectors = turns.vectors(first + grid * (last - first))
        if ((vectors >= low - 1e-9) & (vectors <= high + 1e-9)).all():
            narrow = zip(turns.variables, first.tolist(), last.tolist(), strict=True)
            variables = tuple(joint._replace(lower=a, upper=b) for joint, a, b in narrow)
            return turns._replace(variables=variables, narrowed=True)
    return turns


def _with_turns(chain: SerialChain, turns: _Turns, own: Array) -> SerialChain:
    """Return the chain with the joints of a deviation's rotation at its tip."""
    first = chain.dof
    for k in turns.order:
        joint = turns.variables[k]
        chain = _at_tip(chain, joint._replace(axis=own @ joint.axis), first + k)
    return chain


def _constant(frames: Array, used: list[Array], which: str, where: str, other: str) -> Array:
    """Return a frame, (k, 3, 3) -> (3, 3), of which all targets share the axes that are used.

    Raises:
        InvalidProblem: One of these changes.
    """
    if used and np.abs((frames - frames[0]) @ np.array(used).T).max() > 1e-9:
        raise InvalidProblem(
            f"ranges {which} need axes {where} that are the same at all poses, but they change. Give the ranges with "
            f"frame={other!r}"
        )
    return np.asarray(frames[0])


def _at_tip(chain: SerialChain, joint: _Joint, variable: int) -> SerialChain:
    """Return the chain with one more joint about or along an axis of its tip, of a new variable or of the given one."""
    turn, back = _onto(joint.axis)
    fixed = np.concatenate([chain.fixed[:-1], _product(chain.fixed[-1], turn)[None], back[None]])
    return _more(chain, fixed, joint, variable, len(chain.leader))


def _at_base(chain: SerialChain, joint: _Joint) -> SerialChain:
    """Return the chain on a slide along an axis of its base."""
    turn, back = _onto(joint.axis)
    fixed = np.concatenate([turn[None], _product(back, chain.fixed[0])[None], chain.fixed[1:]])
    return _more(chain, fixed, joint, 0, 0)


def _onto(axis: Array) -> tuple[Array, Array]:
    """Return the rotation from z, the axis of every joint, onto an axis, and the one back, (3, 4) each."""
    turn, back = np.zeros((2, 3, 4))
    turn[:, :3] = rotation_onto(np.array([0.0, 0.0, 1.0]), axis)
    back[:, :3] = turn[:, :3].T
    return turn, back


def _product(A: Array, B: Array) -> Array:
    return (square(A) @ square(B))[:3]


def _more(chain: SerialChain, fixed: Array, joint: _Joint, at: int, place: int) -> SerialChain:
    """Insert a physical joint before joint `place`; it moves against variable `at`, which is new unless it is the last.

    It moves against its variable, so that the variable is the deviation itself.
    """
    known = place > 0 and at < chain.dof
    leader = chain.leader if known else np.where(chain.leader >= at, chain.leader + 1, chain.leader)
    chain = replace(
        chain,
        fixed=np.ascontiguousarray(fixed),
        prismatic=np.insert(chain.prismatic, place, joint.kind == PRISMATIC),
        leader=np.insert(leader, place, at),
        multiplier=np.insert(chain.multiplier, place, -1.0),
        offset=np.insert(chain.offset, place, 0.0),
        frames={},
    )
    if known:
        return chain
    kind, lower, upper = joint.kind, joint.lower, joint.upper
    if kind == REVOLUTE and upper - lower >= 2 * np.pi - 1e-9:
        kind, lower, upper = CONTINUOUS, -np.pi, np.pi
    return replace(
        chain,
        joint_names=(*chain.joint_names[:at], f"goal {joint.name}", *chain.joint_names[at:]),
        kinds=(*chain.kinds[:at], kind, *chain.kinds[at:]),
        lower=np.insert(chain.lower, at, lower),
        upper=np.insert(chain.upper, at, upper),
        rates=np.insert(chain.rates, at, np.nan, axis=1),
    )
