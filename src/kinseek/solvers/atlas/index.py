"""The atlas of an arm for a kind of goal: built once, and kept as long as the arm."""

from __future__ import annotations

import time
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinseek.goal import Goal
from kinseek.kernels.arm.division import NONE
from kinseek.kernels.arm.links import links_of
from kinseek.kernels.arm.vectors import Vector
from kinseek.kernels.arrays import Array, ChainArrays, Indices
from kinseek.kernels.atlas.far import BEYOND, MOST, ROUNDED
from kinseek.kernels.atlas.lanes import LANES
from kinseek.kernels.atlas.memory import LAYOUT
from kinseek.kernels.atlas.one_goal import routines
from kinseek.kernels.atlas.samples import build_atlas
from kinseek.kernels.atlas.task import (
    LENGTH,
    ROUTINE,
    ROWS,
    TOLERANCE,
    Job,
    Lengths,
    TaskRows,
    Tolerances,
    task_numbers,
    with_ranges,
)
from kinseek.kernels.pointers import handle_of
from kinseek.kernels.structure.one_answer import closed_routine
from kinseek.kinds import POSE, Kind
from kinseek.problem import Problem
from kinseek.robots.chain import SerialChain
from kinseek.robots.geometry import RADIAN_PART, divide, open_limits, span_of
from kinseek.robots.sampling import middle_samples
from kinseek.structure.structure import NO_STRUCTURE, Structure, structure_of, with_tip
from kinseek.structure.swept_values import choose_swept_values
from kinseek.support.caching import WeakCache
from kinseek.support.lazy import Lazy, lazy
from kinseek.support.transforms import inverse
from kinseek.tolerances import DEFAULT_TOLERANCE

SAMPLES = 16_384


class AtlasIndex(Lazy):
    """The atlas of one arm for one kind of goal: immutable, shared by threads."""

    def __init__(
        self,
        chain: SerialChain,
        kind: Kind,
        arrays: ChainArrays,
        samples: int,
        of_tip: AtlasIndex | None = None,
        tool: Array | None = None,
        structure: Structure | None = None,
        gap: float = 0.0,
    ) -> None:
        """Sample the middle joints and sort the samples, or share those of the tip's own atlas.

        If the goal is the whole pose of a tool, the pose of the tip is known, so both share the samples. The structure is
        computed unless it is given. Joints with ranges at most `gap` [rad] less than a full turn have no limits in the
        refinement.
        """
        began = time.perf_counter()
        division = divide(chain, kind)
        self.arrays = arrays
        """The arm, with its tip at the goal's tool."""
        if of_tip is None or tool is None:
            points, first = middle_samples(chain, division, samples)
            head = inverse(chain.fixed[0]) if division.head != NONE else np.eye(4)[:3]
            tip = inverse(arrays.fixed[-1]) if division.tail != NONE else np.eye(4)[:3]
            self.sorted = build_atlas(arrays, division, points, first, head.copy(), tip.copy())
        else:
            tip = inverse(arrays.fixed[-1] if division.tail != NONE else tool[:3])
            self.sorted = of_tip.sorted._replace(inverse_tip=tip)
        lower, upper = open_limits(chain, gap)
        columns = (np.arange(3) < kind.columns).astype(float) * kind.column_weight
        calls, size = routines(), chain.length
        known = structure is not None or of_tip is not None
        if structure is None and of_tip is not None:
            structure = with_tip(of_tip.structure, arrays)
        elif structure is None:
            structure = structure_of(arrays, size) if kind is POSE else NO_STRUCTURE
        self.structure: Structure = structure
        """Structure of the arm's geometry; `NO_STRUCTURE` if the goal is less than a pose."""
        if self.structure.word != "none":
            calls = calls._replace(closed=closed_routine.address)
        span, *ends = span_of(arrays, kind is POSE).tolist()
        lengths = Lengths(division.length, size / RADIAN_PART, span, Vector(*ends[:3]), Vector(*ends[3:]))
        task = TaskRows(
            chain=arrays,
            atlas=self.sorted,
            lower=lower,
            upper=upper,
            columns=columns,
            numbers=task_numbers(division, self.structure.exact),
            lengths=LENGTH.numbers(lengths),
            links=links_of(arrays),
            routines=ROUTINE.numbers(calls, np.int64),
            plain=PLAIN,
            structure=self.structure.numbers,
        )
        self.lengths, self._task = lengths, task
        self._arrays = ROWS.arrays(task)
        self.handle = handle_of(self._arrays)
        """Addresses of the arrays, for kernels, and of the routines that they call."""
        # The values are found by solving poses of the samples, which needs the finished task.
        if not known:
            choose_swept_values(self.structure, self.handle, size, samples)
        self.address: int = self.handle.ctypes.data
        """Address of `handle`, for kernels that are called often."""
        self.plain = PLAIN
        """Tolerances of a goal that is just a pose."""
        self.division = division
        """The joints that are divided out."""
        self._scratch = LAYOUT.count.of(dof=len(lower), joints=len(arrays.leader))
        self.samples = len(self.sorted.middle)
        """Number of samples."""
        self.memory = sum(array.nbytes for array in self._arrays)
        """Size of all arrays [bytes]."""
        self.build_time = time.perf_counter() - began
        """Time for building [s]; for the first atlas in a process it includes loading or compiling the kernels."""

    def job(self, tolerances: Array) -> Job:
        """The task with memory of its own, for one call of a kernel."""
        return Job(self.handle, tolerances, np.zeros(self._scratch), LANES)

    @lazy
    def range_handle(self) -> Indices:
        """Like `handle`, for goals with ranges."""
        return handle_of(self._range_arrays)

    @lazy
    def _range_arrays(self) -> list[NDArray[Any]]:
        from kinseek.kernels.ranges.search import range_routines
        from kinseek.kernels.ranges.steps import POSES

        routines = ROUTINE.numbers(range_routines(), np.int64)
        return ROWS.arrays(with_ranges(self._task, POSES, routines))

    def is_far(self, tolerances: Array, target: Array) -> bool:
        """Return whether a target, (3, 4), is so far that the nearest pose is computed directly; see `kernels.atlas.far`."""
        hand, given = np.array(self.lengths.hand), TOLERANCE.value(tolerances)
        gap = target[:, :3] @ hand + target[:, 3] - self.lengths.shoulder
        slack = given.position + ROUNDED + given.orientation * np.abs(hand).sum()
        return bool(given.budget >= MOST and np.linalg.norm(gap) > BEYOND * self.lengths.span + slack)

    def __repr__(self) -> str:
        """Return size and cost."""
        return (
            f"AtlasIndex({self.samples} samples, {self.memory / 2**20:.1f} MiB, "
            f"built in {self.build_time * 1e3:.0f} ms)"
        )


MOST_CACHED = 16
"""Number of atlases of other tools and tool axes that an arm keeps, the last ones used."""


_Key = tuple[Kind, int, bytes | None]
"""Kind of goal, number of samples, and the transform of the tip; None if there is none."""


_indices: WeakCache[SerialChain, _Key, AtlasIndex] = WeakCache(MOST_CACHED, lambda key: key[2] is not None)


def atlas_of(chain: SerialChain, goal: Goal | None = None, samples: int = SAMPLES) -> AtlasIndex:
    """Return the atlas of an arm for a kind of goal: built at the first call, dropped with the arm.

    Another tool shares the samples if the goal is a whole pose; if the tip's pose is not determined, the tool has its own.
    The atlases of the last `MOST_CACHED` tools and tool axes are kept.
    """
    kind = POSE if goal is None else goal.seeded_as
    tip = None if goal is None else goal.tip

    def build() -> AtlasIndex:
        arrays = chain.arrays if goal is None else Problem(chain, goal).arrays
        of_tip = atlas_of(chain, None, samples) if kind is POSE and tip is not None else None
        return AtlasIndex(chain, kind, arrays, samples, of_tip, tip)

    return _indices.of(chain).get((kind, samples, None if tip is None else tip.tobytes()), build)


def tolerances_of(goal: Goal, budget: int | None = None, nearest: bool = True) -> Array:
    """Return a goal's tolerances and weights as kernels take them, see `kernels.atlas.task.Tolerances`, (TOLERANCES,)."""
    position, orientation = goal.position_tolerance, goal.orientation_tolerance
    most = np.inf if budget is None else float(budget)
    return tolerance_numbers(
        position, orientation, goal.position_weight, goal.axis_weights, budget=most, nearest=nearest
    )


def tolerance_numbers(
    position: float,
    orientation: float,
    weight: float,
    axis_weights: Iterable[float],
    *,
    budget: float = np.inf,
    nearest: bool = True,
) -> Array:
    """See `kernels.atlas.task.Tolerances`, (TOLERANCES,)."""
    weights = Vector(*map(float, axis_weights))
    return TOLERANCE.numbers(Tolerances(position, orientation, weight, budget, float(nearest), weights))


PLAIN = tolerance_numbers(DEFAULT_TOLERANCE, DEFAULT_TOLERANCE, 1.0, (1.0, 1.0, 0.0))
"""`tolerances_of` a goal that is just a pose. It is written out, since creating a goal runs a kernel, which an import must
not do."""

BRIEF = tolerance_numbers(DEFAULT_TOLERANCE, DEFAULT_TOLERANCE, 1.0, (1.0, 1.0, 0.0), nearest=False)
"""The same without a search for the nearest pose."""
