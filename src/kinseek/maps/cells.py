"""Whole cells judged: somewhere reached, proved empty, or undecided.

A ball of poses that holds a cell is asked for as one goal, with the half diagonal and the half angle as tolerances: if no
joint values meet these, the cell is empty, every pose of it. Else joint values are led into the cell, from where the proof
saw them, and poses all over the cell are asked. Neither: the cell is cut in half, and its halves, down to some depth.

Where the last joint turns about the tip's z axis, a pose is reached if it is reached turned otherwise about that axis, as
far as that joint's limits go. So all cells of one place and direction are judged as one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinseek.arm import Arm
from kinseek.goal import Goal
from kinseek.kernels.arm.jacobian import jacobian_many
from kinseek.kernels.proof.progress import ENDED, FOUND
from kinseek.problem import Problem
from kinseek.proof.boxes import Search, excluded
from kinseek.robots import SerialChain
from kinseek.robots.geometry import open_limits

from .cell import LEVER, Cell, whole_cell
from .grid import Grid, Rings
from .last_joint import LastJoint, opened, wide_ball
from .search import reached
from .whole import whole_share

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Index = tuple[int, ...]

UNDECIDED, REACHED, EMPTY = 0, 1, 2

ATTRIBUTES: dict[str, dict[str, Any]] = {
    "cell": {
        "long_name": "what is known of the whole cell",
        "flag_values": [UNDECIDED, REACHED, EMPTY],
        "flag_meanings": "undecided reached_somewhere proved_empty",
        "units": "1",
    },
    "empty_share": {"long_name": "share of the cell's volume that is proved empty", "units": "1"},
    "whole_share": {
        "long_name": "share of the cell's volume that is proved to be reached, all of it",
        "units": "1",
    },
}

SHARES = ("empty_share", "whole_share")

FIRST = 1000
"""Boxes of a first proof: what most empty cells take. What it does not end is looked for an answer."""

SAMPLES = 64
"""Poses of a cell that are asked."""

STEPS, LONGEST, DAMPING = 30, 0.3, 1e-6
"""Steps that lead joint values into a cell, the longest of one joint [rad] or [m], and their damping: where the arm is
singular, beside a cell at the edge of reach, they are many and short."""


def cells_of_block(
    judge: Judge, part: Sequence[slice], found: Flags, wholly: bool = True
) -> dict[str, Array]:
    """Judge the cells of a block.

    Args:
        judge: Of the grid.
        part: Which cells, of each dimension.
        found: Where the middle of a cell is reached, of the block's shape.
        wholly: Also prove how much of each cell is reached? Else nothing is proved of that.

    Returns:
        Of what `ATTRIBUTES` names an array of the block's shape.
    """
    grid = judge.grid
    known = np.empty(found.shape, dtype="int8")
    empty, whole = np.empty(found.shape, dtype="float32"), np.zeros(found.shape, dtype="float32")
    *firsts, first = [some.indices(n)[0] for some, n in zip(part, grid.shape, strict=True)]
    numbers = first + np.arange(found.shape[-1])
    regions = numbers // grid.orientations.arcs
    for at in np.ndindex(found.shape[:-1]):
        place = tuple(int(i + first) for i, first in zip(at, firsts, strict=True))
        for region in np.unique(regions):
            some = regions == region
            told = judge.row(place, [int(i) for i in numbers[some]], found[at][some])
            known[at][some], empty[at][some] = [each.known for each in told], [each.empty for each in told]
            if wholly:
                whole[at][some] = judge.whole(place, numbers[some], known[at][some] == REACHED)
    return {"cell": known, "empty_share": empty, "whole_share": whole}


class Verdict(NamedTuple):
    """What is known of a cell."""

    known: int
    """REACHED, EMPTY or UNDECIDED."""
    empty: float
    """Share of its volume that is proved empty."""
    left: list[tuple[Cell, int]]
    """Parts that are not proved empty, and how often they were cut in half; none of an empty cell."""


class Judge:
    """Judges cells of a grid."""

    def __init__(
        self, arm: Arm, grid: Grid | Rings, depth: int, budget: int, goal: Goal | None = None
    ) -> None:
        """Take what judges.

        Args:
            arm: Of which the grid speaks.
            grid: Whose cells they are.
            depth: How often a cell is cut in half.
            budget: Boxes of joint values that one proof may look at.
            goal: Any pose, with the tolerances within which a pose counts as reached; those of `Goal.pose` unless given.
        """
        self.arm, self.grid, self.depth, self.budget = arm, grid, depth, budget
        self.goal = Goal.pose(np.eye(4)) if goal is None else goal
        self.last = LastJoint.of(arm.chain)
        self.free = self.last is not None and self.last.free
        """Does the last joint turn all around? Then all cells of one place and direction are one question."""

    def row(self, place: Index, numbers: Sequence[int], found: Flags) -> list[Verdict]:
        """Judge cells of one place and direction.

        Args:
            place: Numbers of the place.
            numbers: Of the orientations.
            found: Of each, is its middle reached?
        """
        known, stack = Verdict(REACHED, 0.0, []), None
        if found.all() or (self.free and found.any()):
            return [known] * len(numbers)
        if self.last is not None:
            stack = self.stack(place, numbers[0] // self.grid.orientations.arcs)
            if self.free or stack.known != REACHED:
                return [known if there else stack for there in found]
        return [
            known if there else self.cell((*place, number), stack)
            for there, number in zip(found, numbers, strict=True)
        ]

    def whole(self, place: Index, numbers: NDArray[np.int64], touched: Flags) -> Array:
        """Share of cells of one place and direction that is proved to be reached, all of it; 0 where none is touched."""
        share = np.zeros(len(numbers))
        some = np.flatnonzero(touched)
        for i in some[:1] if self.free else some:
            cell = whole_cell(self.grid, (*place, int(numbers[i])), rolls=self.free)
            share[some if self.free else i] = whole_share(self.arm, cell, self.depth)
        return share

    def stack(self, place: Index, region: int) -> Verdict:
        """Judge all cells of one place and direction together, as if the last joint turned all around."""
        cell = whole_cell(self.grid, (*place, region * self.grid.orientations.arcs), rolls=True)
        return self._judged(opened(self.arm.chain), cell, [(cell, 0)], (*place, region))

    def cell(self, index: Index, stack: Verdict | None = None) -> Verdict:
        """Judge one cell, or what its stack leaves of it, if that is known."""
        cell = whole_cell(self.grid, index)
        parts = [(cell, 0)]
        if stack is not None and stack.left:
            parts = [(replace(part, arc=cell.arc), level) for part, level in stack.left]
        return self._judged(self.arm.chain, cell, parts, index)

    def _judged(self, chain: SerialChain, cell: Cell, left: list[tuple[Cell, int]], index: Index) -> Verdict:
        """Judge a cell of which some parts are left; of a stack the last number is that of the direction."""
        empty, open_ = 1.0 - sum(0.5**level for _, level in left), list[tuple[Cell, int]]()
        budget = min(FIRST, self.budget)
        search = self._excluded(chain, cell, budget)
        if search.outcome == ENDED:
            return Verdict(EMPTY, 1.0, [])
        if (
            self._entered(chain, cell, search.q, index)
            or reached(self.arm, Goal.pose(cell.spread(SAMPLES))).any()
        ):
            return Verdict(REACHED, empty, left)
        while left:
            part, level = left.pop()
            search = self._excluded(chain, part, self.budget)
            if search.outcome == ENDED:
                empty += 0.5**level
            elif search.outcome == FOUND and self._entered(chain, cell, search.q, index):
                return Verdict(REACHED, empty, [*open_, *left, (part, level)])
            elif level < self.depth:
                left += [(half, level + 1) for half in part.halves(LEVER * chain.reach)]
            else:
                open_.append((part, level))
        return Verdict(UNDECIDED, empty, open_) if open_ else Verdict(EMPTY, 1.0, [])

    def _excluded(self, chain: SerialChain, part: Cell, budget: int) -> Search:
        """Look for joint values whose pose is in a ball around a part of a cell, or prove that there are none."""
        T, position, angle = wide_ball(part, self.last)
        position, angle = position + self.goal.position_tolerance, angle + self.goal.orientation_tolerance
        goal = Goal.pose(T, position_tolerance=position, orientation_tolerance=min(angle, np.pi))
        return excluded(Problem(chain, goal), budget, threads=1)

    def _entered(self, chain: SerialChain, cell: Cell, q: Array, index: Index) -> bool:
        """Do steps from joint values, (n,), lead to some whose pose lies in a cell?"""
        weights = np.repeat([1.0, LEVER * chain.reach], 3)
        low, high = open_limits(chain)
        for _ in range(STEPS):
            T = chain.forward(q[None])[0]
            if self._lies_in(cell, T, index):
                return True
            near = cell.nearest(T)
            miss = weights * np.append(near[:3, 3] - T[:3, 3], turn_vector(near[:3, :3] @ T[:3, :3].T))
            J = weights[:, None] * jacobian_many(chain.arrays, q[None])[0]
            step = J.T @ np.linalg.solve(J @ J.T + DAMPING * np.eye(6), miss)
            q = np.clip(q + step * min(1.0, LONGEST / max(np.abs(step).max(), LONGEST)), low, high)
        return False

    def _lies_in(self, cell: Cell, T: Array, index: Index) -> bool:
        """Does a pose, (4, 4), lie in a cell, or in a stack?"""
        *place, number = (int(i) for i in self.grid.cells_of(T))
        return (*place, number if cell.arc is not None else number // self.grid.orientations.arcs) == index


def turn_vector(R: Array) -> Array:
    """Axis times sine of the angle of a rotation, (3, 3) -> (3,)."""
    return np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / 2
