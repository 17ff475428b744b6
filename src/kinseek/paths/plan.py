"""Plan the best path of a redundant arm: layers of solutions, branches between them, and one dynamic program."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinseek.branches.index import BranchIndex, index_of
from kinseek.branches.order import cost_of
from kinseek.derivatives import freedom
from kinseek.kernels.atlas.lanes import LANES
from kinseek.kernels.paths.propagation import Given, propagate_layer, spread_solutions
from kinseek.kernels.paths.trace import Leg, trace
from kinseek.kernels.paths.viterbi import BranchEnds, Layer, Sideways, viterbi_step
from kinseek.problem import Problem
from kinseek.solvers.atlas.index import tolerances_of
from kinseek.solvers.atlas.solver import Atlas
from kinseek.solvers.threads import GoOn, parallel_for
from kinseek.support.deadline import TimeUp

from .between import apart
from .joints import Turning
from .request import PathRequest
from .singular_twins import folds_of, mirrored
from .smooth import Smoother

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Flags = NDArray[np.bool_]
Advance = Callable[[int], object]


class Effort(NamedTuple):
    """Resolution of a plan."""

    way: float
    """Motion of the hand from row to row: its rotation [rad], plus its translation in thirds of the arm's length."""
    rows: int
    """Rows from one layer to the next."""
    samples: int
    """Solutions sampled at the first pose."""
    fresh: int
    """Fresh solutions sampled at each other layer."""
    most: int
    """Largest number of solutions at a layer."""
    apart: float
    """Solutions closer than this [rad or m] in every joint are merged."""
    skips: bool = True
    """If `way` is 0: whether poses are left out so that some joint may move by `apart` from one row to the next. With all
    poses no step would lead from one sampled solution to another. Of 64 made paths of 4,000 poses of eight arms, 62 are
    followed with it, and 55 without."""


SIDEWAYS = 0.4
"""Largest motion of any joint [rad or m] in a step along the self-motion; a solution farther off is on another branch."""

BESIDE = 2.0
"""Offset along the self-motion at which more solutions are tried beside each, relative to the distance between solutions."""

LEAPS = 0.6
"""A branch ends where a joint moves farther than this from row to row [rad or m]."""

CROWD = 1.2
"""Factor on the distance between solutions for the next layer if a layer has no room for all of them."""

CLEAR = 0.3
"""Solutions closer than this in every joint [rad or m] to a forbidden one are excluded as well."""

LAYERS_AT_ONCE = 64
"""Layers whose fresh solutions are sampled together if there is a deadline."""

GRAZED = 4
"""Poses before and after a step that was not proved free although points of it are, between which all edges are proved."""

FORGET = 64
"""Layers after which nodes that no best path leads through are dropped."""

UNBOUND = 1e6
"""Value that represents a step without a bound."""


class ForbiddenEdges(NamedTuple):
    """A pose and solution at which an earlier plan broke: no branch is followed from solutions close to it."""

    pose: int
    """Index of the pose."""
    q: Array
    """The solution, (n,)."""


@dataclass
class Lessons:
    """What earlier plans of a path found out."""

    forbidden_edges: list[ForbiddenEdges] = field(default_factory=list)
    hard: list[tuple[int, int]] = field(default_factory=list)
    """First and last pose of parts in which every pose is a layer, if all poses are rows."""
    grazed: list[int] = field(default_factory=list)
    """Poses at which a step was not proved free although points of it are."""

    def of_part(self, first: int, last: int) -> Lessons:
        """Return what is known of the edges of some poses of the path, for a plan of these alone."""
        return Lessons(grazed=[pose - first for pose in self.grazed if first <= pose <= last])


class Place(NamedTuple):
    """One layer's part of a path."""

    q: Array
    """The solution, in the first turn, (n,)."""
    turns: int
    """Turns of its joints, encoded as one number."""
    joined: bool
    """Whether it is reached from the layer before without a break."""


class PrunedLayer(NamedTuple):
    """Nodes of a layer that the best paths lead through."""

    q: Array
    """All solutions of the layer, in the first turn, (k, n)."""
    nodes: Indices
    """Numbers of the nodes in the layer, (m,): each encodes a solution and the turns of its joints."""
    came: Indices
    """Predecessors, see `viterbi_step`; they refer to the nodes kept of the layer before, (m,)."""


class Ways:
    """The best paths to all solutions of the last layer. Nodes that none of them leads through are dropped regularly."""

    def __init__(self, total: int) -> None:
        """Start without layers; `total` is the largest number of copies of a solution."""
        self.total, self.layers = total, list[PrunedLayer]()
        self._looked_at = 0

    def add(self, layer: Layer) -> None:
        """Append a layer."""
        self.layers.append(PrunedLayer(layer.q, np.arange(len(layer.came)), layer.came))
        nodes = np.flatnonzero(layer.fault >= 0)
        if len(self.layers) % FORGET == 0 and len(nodes):
            self._forget(nodes)

    def _forget(self, nodes: Indices) -> None:
        """Keep only what leads to some nodes of the last layer; these keep their numbers."""
        for k in range(len(self.layers) - 1, 0, -1):
            here, before = self.layers[k], self.layers[k - 1]
            came = _before(here.came)
            leads = np.zeros(len(before.came), dtype=np.bool_)
            leads[came[nodes]] = True
            if leads.all() and k < self._looked_at:
                break
            place = (np.cumsum(leads) - 1)[came]
            self.layers[k] = here._replace(came=np.where(here.came >= 0, place, -2 - place))
            self.layers[k - 1] = PrunedLayer(before.q, before.nodes[leads], before.came[leads])
            nodes = np.arange(len(self.layers[k - 1].came))
        self._looked_at = len(self.layers)

    def to(self, node: int) -> list[Place]:
        """Return the best path to a node of the last layer, one place for each layer."""
        places = []
        for layer in reversed(self.layers):
            solution, turns = divmod(int(layer.nodes[node]), self.total)
            places.append(Place(layer.q[solution], turns, bool(layer.came[node] >= 0)))
            node = int(_before(layer.came[node]))
        return places[::-1]


def branch_ends(q: Array) -> BranchEnds:
    """Memory for the ends of the branches from some solutions, (k, n)."""
    return BranchEnds(
        np.empty_like(q), np.empty_like(q), np.empty(len(q)), np.empty_like(q), np.empty_like(q)
    )


def _before(came: Indices) -> Indices:
    """Return the nodes from which others were reached, see `viterbi_step`."""
    return np.asarray(np.where(came >= 0, came, -2 - came))


class Planner:
    """Find the best path through given poses for one redundant arm."""

    def __init__(self, request: PathRequest, effort: Effort, lessons: Lessons | None = None) -> None:
        """Choose rows and layers.

        Args:
            request: The path.
            effort: Resolution of the plan.
            lessons: What earlier plans of this path found out.
        """
        self.lessons = Lessons() if lessons is None else lessons
        self.breaks = 0
        """Breaks of the best plan; a finished plan has set it."""
        problem = request.problem
        self.request, self.effort, self.problem, self.dof = request, effort, problem, problem.chain.dof
        self.smoother, self.turning = Smoother(request), Turning(problem.chain)
        self.index: BranchIndex = index_of(problem)
        self.tolerances, self.targets = (
            tolerances_of(problem.goal),
            np.ascontiguousarray(problem.goal.targets),
        )
        self.parameter = path_parameter(problem)
        """Accumulated motion of the hand at each pose, see `Effort.way`, (N,)."""
        self.longest = longest_steps(request)
        self.rows = rows_of(self.parameter, effort.way, stride_of(request, effort) if effort.skips else 1)
        """Indices of the poses on which the path is planned."""
        self.row_targets = np.ascontiguousarray(self.targets[self.rows])
        last = len(self.rows) - 1
        self.keys = np.unique(np.round(np.linspace(0, last, -(-last // effort.rows) + 1)).astype(np.int64))
        """Indices of the rows that are layers."""
        if effort.way <= 0.0:
            hard = [np.searchsorted(self.rows, np.arange(first, end + 1)) for first, end in self.lessons.hard]
            self.keys = np.unique(np.concatenate([self.keys, *hard]))
        self.sideways = np.where(np.isinf(request.longest.max(axis=0, initial=0.0)), UNBOUND, SIDEWAYS)
        self.apart = effort.apart
        self.folds = folds_of(problem.chain) if freedom(problem) > 1 else []
        """Folds at which solutions lie on two sheets. With one redundant joint both sheets lie on curves, which are followed
        through the fold."""

    def sample(self, i: int, count: int) -> Array:
        """Sample solutions of pose i, well spread, (k, n)."""
        return self.index.solutions(self.tolerances, self.targets[i], count)

    def layer(self, k: int, arrived: Array, fresh: Array, alone: bool = False) -> tuple[Array, Array]:
        """Return the solutions at a layer, (k, n), and the directions of the self-motion there."""
        given, turning = np.concatenate([arrived, fresh]), self.turning
        q, along = np.empty((2, self.effort.most, self.dof))
        beside = 0.0 if alone else BESIDE * self.apart
        target = self.row_targets[self.keys[k]]
        known = Given(given, len(arrived), self.apart, beside)
        count = spread_solutions(self.index.fine.job(self.tolerances), target, known, turning.turns, q, along)
        # The array is full: a larger distance thins the next layers out. Otherwise the distance returns to its normal
        # value.
        self.apart = self.apart * CROWD if count == len(q) else max(self.effort.apart, self.apart / CROWD)
        q, along = q[:count], along[:count]
        if self.request.valid is not None:
            good = self.request.valid.each(self.clipped(q))
            q, along = q[good], along[good]
        if len(q):
            return q, along
        # No solution is left: use the nearest one that the atlas finds.
        goal = self.problem.goal.at(self.problem.goal.target[self.rows[self.keys[k]]])
        nearest = Atlas(threads=1).solve(Problem(self.problem.mechanism, goal)).q
        return turning.first_turn(nearest[None]), np.zeros((1, self.dof))

    def twins(self, k: int, arrived: Array) -> Array:
        """Return solutions at a layer on the other side of a fold from those that arrive there, (k, n)."""
        q = mirrored(arrived, self.folds)
        targets = np.repeat(self.row_targets[self.keys[k]][None], len(q), axis=0)
        return q[self.smoother.project(q, targets)] if len(q) else q

    def clipped(self, q: Array) -> Array:
        """Clip solutions in the first turn to the limits."""
        return np.clip(q, self.turning.open_lower, self.turning.open_upper)

    def plan(self, advance: Advance, threads: int | None) -> Array:
        """Return joint values for all rows, (rows, n); if the time is up, for the first rows, at least one.

        Raises:
            TimeUp: The time was up before the first layer.
        """
        fixed = [
            None if q is None else self.turning.off_ends(q) for q in (self.request.start, self.request.end)
        ]
        last = len(self.keys) - 1
        deadline = self.request.deadline
        fresh: list[Array] = []
        size = LAYERS_AT_ONCE if deadline.limited else last + 1
        ways, before, none = Ways(self.turning.total), None, np.zeros((0, self.dof))
        count = last + 1
        for k in range(last + 1):
            if k % size == 0:
                fresh += self.samples(range(k, min(k + size, last + 1)), threads)
            begin, end = int(self.keys[max(k - 1, 0)]), int(self.keys[k])
            only = fixed[0] if k == 0 else fixed[1] if k == last else None
            try:
                deadline.check()
                propagated = None if before is None else self.propagate_layer(before.q, begin, end)
                if only is not None:
                    q, along = self.layer(k, self.turning.first_turn(only[None]), none, alone=True)
                elif propagated is None:
                    q, along = self.layer(k, fresh[k], none)
                else:
                    arrived = propagated.q[np.isfinite(propagated.cost)]
                    q, along = self.layer(k, np.concatenate([self.twins(k, arrived), arrived]), fresh[k])
            except TimeUp:
                count = k
                break
            poses = int(self.rows[end] - self.rows[begin])
            before = self.linked(before, q, along, propagated, poses, only)
            ways.add(before)
            advance(poses)
        if before is None:
            raise TimeUp
        # A node without a way from the beginning must not win.
        fault = np.where(before.fault < 0, np.iinfo(np.int64).max, before.fault)
        best = int(np.lexsort((before.sums, fault))[0])
        self.breaks = int(fault[best])
        return self.filled(ways.to(best), self.keys[:count])

    def samples(self, layers: range, threads: int | None) -> list[Array]:
        """Sample fresh solutions at some layers, (k, n) each; empty arrays where the time was up."""
        found = [np.zeros((0, self.dof))] * len(layers)

        def find(first: int, end: int, go_on: GoOn) -> None:
            for place in range(first, end):
                if not go_on():
                    return
                k = layers[place]
                count = self.effort.fresh if k else self.effort.samples
                found[place] = self.sample(int(self.rows[self.keys[k]]), count)

        parallel_for(find, len(layers), 16, threads, self.request.deadline)
        return found

    def propagate_layer(self, q: Array, begin: int, end: int) -> BranchEnds:
        """Follow solutions of one row to another row, see `kernels.paths.propagation.propagate_layer`."""
        ends, job = branch_ends(q), self.index.fine.job(self.tolerances)
        moments, leaps = self.rows[begin : end + 1].astype(np.float64), np.full(self.dof, LEAPS)
        targets = self.row_targets[begin : end + 1]
        propagate_layer(job, targets, moments, leaps, self.smoother.weights, q, ends)
        for pose, near in self.lessons.forbidden_edges:
            if self.rows[begin] <= pose < self.rows[end]:
                ends.cost[(np.abs(self.turning.step(q - near)) < CLEAR).all(axis=1)] = np.inf
        valid = self.request.valid
        if valid is not None and valid.scene is not None:
            # Layers are close, so the straight step from one to the next stands for the branch. Of all branches one is
            # chosen, and that path is proved later: points of the others suffice, except where they did not.
            first, last = self.rows[begin] - GRAZED, self.rows[end] + GRAZED
            some = any(first <= pose <= last for pose in self.lessons.grazed)
            open_way = np.isfinite(ends.cost)
            check = valid.free_ways if some else valid.probably_free
            open_way[open_way] = check(self.clipped(q[open_way]), self.clipped(ends.q[open_way]))
            ends.cost[~open_way] = np.inf
        return ends

    def linked(
        self,
        before: Layer | None,
        q: Array,
        along: Array,
        ends: BranchEnds | None,
        poses: int,
        only: Array | None,
    ) -> Layer:
        """Build a layer of solutions, linked to the layer before; with `only`, (n,), no other turn of it is a node."""
        turning, nodes = self.turning, len(q) * self.turning.total
        made = Layer(q, along, np.empty(nodes, np.int64), np.empty(nodes), np.empty(nodes, np.int64))
        if before is None or ends is None:
            none, no_node = np.zeros((0, self.dof)), np.zeros(0, dtype=np.int64)
            before, ends = Layer(none, none, no_node, np.zeros(0), no_node), branch_ends(none)
        steps = Sideways(self.longest, self.sideways, self.smoother.weights, float(poses))
        viterbi_step(before, ends, made, turning.turns, steps, self.own(q, poses))
        if only is not None:
            made.fault[np.arange(nodes) != turning.turns_of(only)] = -1
        return made

    def own(self, q: Array, poses: int) -> Array:
        """Return the user's cost of nodes above the least one, times the number of poses, (nodes,); (0,) without a cost."""
        turning = self.turning
        if self.request.cost is None:
            return np.zeros(0)
        each, turns = np.repeat(q, turning.total, axis=0), np.tile(np.arange(turning.total), len(q))
        values = np.clip(turning.node_values(each, turns), turning.open_lower, turning.open_upper)
        costs = cost_of(self.request.cost, values)
        return np.asarray((costs - costs.min()) * max(poses, 1))

    def filled(self, places: list[Place], keys: Indices) -> Array:
        """Return joint values of all rows up to the last of some layers, (rows, n).

        They follow each branch. The sideways motion to the next branch is distributed evenly over all poses in between.
        """
        turning, parts = self.turning, []
        values = [turning.node_values(place.q[None], np.array([place.turns]))[0] for place in places]
        for k, (begin, end) in enumerate(itertools.pairwise(keys.tolist())):
            way = self.followed(places[k].q, begin, end) + (values[k] - places[k].q)
            if places[k + 1].joined:
                moments = self.rows[begin : end + 1]
                share = (moments - moments[0]) / (moments[-1] - moments[0])
                way = way + share[:, None] * turning.step(values[k + 1] - way[-1])
            parts.append(way[:-1])
        return turning.unwrapped(np.concatenate([*parts, values[-1][None]]))

    def followed(self, q: Array, begin: int, end: int) -> Array:
        """Follow one branch from row to row, (rows, n)."""
        ways, ends = np.zeros((end - begin + 1, LANES, self.dof)), np.zeros(LANES, dtype=np.int64)
        ways[0] = q
        targets, leaps = self.row_targets[begin : end + 1], np.full(self.dof, LEAPS)
        job = self.index.fine.job(self.tolerances)
        trace(job, targets, Leg(0, end - begin, 1), leaps, ways, ends)
        ways[ends[0] + 1 :, 0] = ways[ends[0], 0]
        return ways[:, 0]


def path_parameter(problem: Problem) -> Array:
    """Accumulated motion of the hand at each pose: rotation [rad] plus translation in thirds of the arm's length, (N,)."""
    poses = np.zeros((len(problem.goal.targets), 4, 4))
    poses[:, :3], poses[:, 3, 3] = problem.goal.targets, 1.0
    distance, turn = apart(poses[:-1], poses[1:])
    return np.asarray(np.concatenate([[0.0], np.cumsum(distance / problem.chain.length * 3 + turn)]))


def longest_steps(request: PathRequest) -> Array:
    """Largest motion of each joint that is allowed at every step, (n,), [rad] or [m]."""
    longest = request.longest.min(axis=0, initial=np.inf)
    return np.where(np.isinf(longest), UNBOUND, longest)


def stride_of(request: PathRequest, effort: Effort) -> int:
    """In how many steps some joint may move by `Effort.apart`, at least 1."""
    return max(int(effort.apart / longest_steps(request).max()), 1)


def rows_of(parameter: Array, way: float, step: int) -> Indices:
    """Indices of poses between which the hand moves by `way`, or if it is 0 of every `step`-th pose; with both ends."""
    last = len(parameter) - 1
    if way <= 0.0:
        return np.append(np.arange(0, last, step), last)
    parts = max(int(np.ceil(parameter[-1] / way)), min(last, 2))
    rows = np.searchsorted(parameter, np.linspace(0, parameter[-1], parts + 1))
    return np.unique(np.concatenate([[0], rows, [last]]).clip(0, last)).astype(np.int64)


def between_rows(rows: Indices, q: Array) -> Array:
    """Interpolate joint values of some poses to all by cubic Hermite polynomials, (rows, n) -> (N, n)."""
    if len(rows) < 3:
        share = np.arange(rows[-1] + 1) / max(rows[-1], 1)
        return np.asarray(q[0] + share[:, None] * (q[-1] - q[0]))
    spans = np.diff(rows).astype(np.float64)[:, None]
    slopes = np.diff(q, axis=0) / spans
    middle = (slopes[:-1] * spans[1:] + slopes[1:] * spans[:-1]) / (spans[1:] + spans[:-1])
    tangents = np.concatenate([slopes[:1], middle, slopes[-1:]])
    poses = np.arange(rows[-1] + 1)
    i = np.clip(np.searchsorted(rows, poses, side="right") - 1, 0, len(rows) - 2)
    span = spans[i]
    t = (poses - rows[i])[:, None] / span
    one = t * t * (3 - 2 * t)
    return np.asarray(
        q[i] + one * (q[i + 1] - q[i]) + span * t * (1 - t) * ((1 - t) * tangents[i] - t * tangents[i + 1])
    )
