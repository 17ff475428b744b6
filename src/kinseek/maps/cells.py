"""Classification of whole cells: reached somewhere, proved empty, or undecided.

A ball of poses that contains a cell is one goal, with the half diagonal and the half angle as tolerances. If no joint values
meet these, the whole cell is empty. Otherwise joint values are moved into the cell, starting where the proof found them, and
poses spread over the cell are tried. If both fail, the cell is halved, down to some depth.

If the last joint rotates about the tip's z axis, all rotations of a pose about that axis are reached together, within the
limits of that joint. So all cells of one position and direction are classified together.
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
from kinseek.kernels.proof.progress import ENDED, FOUND, STOPPED
from kinseek.problem import Problem
from kinseek.proof.boxes import Search, excluded
from kinseek.robots import SerialChain
from kinseek.robots.geometry import open_limits

from .cell import LEVER, Cell, whole_cell
from .grid import Grid, Rings
from .last_joint import LastJoint, opened, wide_ball
from .search import beyond, reached
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
"""Maximum number of boxes of a first proof, enough for most empty cells. If it does not end, a solution is searched. Not
examined further."""

BETWEEN = 3000
"""Maximum number of boxes of a proof about a part that may be halved again; its halves continue with the remaining boxes.
Not examined further."""

SAMPLES = 64
"""Number of poses of a cell that are tried. Not examined further."""

OFTEN = 4
"""Number of values of the last joint tried per cell that it could move the tip into. Not examined further."""

STEPS, LONGEST, DAMPING = 30, 0.3, 1e-6
"""Maximum number of steps that move joint values into a cell, longest step of one joint [rad] or [m], and damping. Near a
singularity, beside a cell at the edge of the workspace, the steps are many and short. Not examined further."""


def cells_of_block(
    judge: Judge, part: Sequence[slice], found: Flags, wholly: bool = True
) -> dict[str, Array]:
    """Classify the cells of a block.

    Args:
        judge: Judge of the grid.
        part: Range of cells along each dimension.
        found: Cells whose centre is reached, of the block's shape.
        wholly: Also prove how much of each cell is reached? Otherwise nothing about that is proved.

    Returns:
        An array of the block's shape for each name in `ATTRIBUTES`.
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
            report = judge.row(place, [int(i) for i in numbers[some]], found[at][some])
            known[at][some], empty[at][some] = (
                [each.known for each in report],
                [each.empty for each in report],
            )
            if wholly:
                whole[at][some] = judge.whole(place, numbers[some], known[at][some] == REACHED)
    return {"cell": known, "empty_share": empty, "whole_share": whole}


NOTHING = Search(ENDED, 0, 0.0, np.zeros(0), np.inf, np.inf, np.zeros((0, 0)), 0.0, np.inf)
"""A proof that examined no boxes."""


class Part(NamedTuple):
    """A part of a cell that is not proved empty."""

    cell: Cell
    level: int
    """Number of times it was halved."""
    boxes: Array | None = None
    """Boxes that contain all joint values whose pose lies in it, left by a proof about a larger part, (k, 2 dof)."""


class Verdict(NamedTuple):
    """The result for a cell."""

    known: int
    """REACHED, EMPTY or UNDECIDED."""
    empty: float
    """Fraction of its volume that is proved empty."""
    left: list[Part]
    """Parts that are not proved empty; none for an empty cell."""
    q: Array | None = None
    """Joint values whose pose lies in the cell, (n,), if known."""


class Judge:
    """Classifies cells of a grid."""

    def __init__(
        self, arm: Arm, grid: Grid | Rings, depth: int, budget: int, goal: Goal | None = None
    ) -> None:
        """Prepare the classification.

        Args:
            arm: The arm of the grid.
            grid: Grid of the cells.
            depth: Number of times a cell is halved.
            budget: Maximum number of boxes of joint values per proof.
            goal: Any pose, with the tolerances within which a pose counts as reached; by default those of `Goal.pose`.
        """
        self.arm, self.grid, self.depth, self.budget = arm, grid, depth, budget
        self.goal = Goal.pose(np.eye(4)) if goal is None else goal
        self.last = LastJoint.of(arm.chain)
        self.free = self.last is not None and self.last.free
        """Can the last joint make a full turn? Then all cells of one position and direction have the same result."""

    def row(self, place: Index, numbers: Sequence[int], found: Flags) -> list[Verdict]:
        """Classify cells of one position and direction.

        Args:
            place: Index of the position.
            numbers: Indices of the orientations.
            found: Is the centre of each reached?
        """
        known, stack = Verdict(REACHED, 0.0, []), None
        # If the last joint turns freely, one reached orientation of a stack stands for all.
        if found.all() or (self.free and found.any()):
            return [known] * len(numbers)
        if self.last is not None:
            stack = self.stack(place, numbers[0] // self.grid.orientations.arcs)
            if self.free or stack.known != REACHED:
                return [known if there else stack for there in found]
            found = found | self._passed_by_last_joint(stack.q, place, numbers)
        return [
            known if there else self.cell((*place, number), stack)
            for there, number in zip(found, numbers, strict=True)
        ]

    def whole(self, place: Index, numbers: NDArray[np.int64], touched: Flags) -> Array:
        """Return the proved reached fraction of each cell of one position and direction; 0 for cells not `touched`."""
        share = np.zeros(len(numbers))
        some = np.flatnonzero(touched)
        for i in some[:1] if self.free else some:
            cell = whole_cell(self.grid, (*place, int(numbers[i])), rolls=self.free)
            share[some if self.free else i] = whole_share(self.arm, cell, self.depth)
        return share

    def stack(self, place: Index, region: int) -> Verdict:
        """Classify all cells of one position and direction together, as if the last joint could make a full turn."""
        cell = whole_cell(self.grid, (*place, region * self.grid.orientations.arcs), rolls=True)
        return self._judged(opened(self.arm.chain), cell, [Part(cell, 0)], (*place, region))

    def cell(self, index: Index, stack: Verdict | None = None) -> Verdict:
        """Classify one cell, or the parts that its stack leaves of it, if known."""
        cell = whole_cell(self.grid, index)
        parts = [Part(cell, 0)]
        if stack is not None and stack.left:
            parts = [each._replace(cell=replace(each.cell, arc=cell.arc)) for each in stack.left]
        return self._judged(self.arm.chain, cell, parts, index)

    def _judged(self, chain: SerialChain, cell: Cell, left: list[Part], index: Index) -> Verdict:
        """Classify a cell of which some parts are left; the last index of a stack is that of the direction."""
        empty, open_ = 1.0 - sum(0.5**part.level for part in left), list[Part]()
        # A small budget first: it decides most empty cells, and its boxes are the starts for the parts.
        whole = self._excluded(chain, Part(cell, 0), min(FIRST, self.budget))
        if whole.outcome == ENDED:
            return Verdict(EMPTY, 1.0, [])
        q = self._entered(chain, cell, whole.q, index)
        # The proof's best pose is near the cell, so a few steps from it are tried before sampling.
        q = self._sampled(cell) if q is None else q
        if q is not None:
            return Verdict(REACHED, empty, left, q)
        left = [part if part.boxes is not None else part._replace(boxes=_inherited(whole)) for part in left]
        while left:
            part = left.pop()
            # Its halves continue with the remaining boxes, so a large budget for the whole part would be wasted.
            between = 0 < part.level < self.depth
            search = self._excluded(chain, part, min(BETWEEN, self.budget) if between else self.budget)
            if search.outcome == ENDED:
                empty += 0.5**part.level
                continue
            # The proof searches a ball around the part: what it finds may lie outside the cell, and is moved inside.
            if search.outcome == FOUND:
                q = self._entered(chain, cell, search.q, index)
                if q is not None:
                    return Verdict(REACHED, empty, [*open_, *left, part], q)
            boxes = _inherited(search)
            part = part if boxes is None else part._replace(boxes=boxes)
            if part.level < self.depth:
                halves = part.cell.halves(LEVER * chain.reach)
                left += [Part(half, part.level + 1, part.boxes) for half in halves]
            else:
                open_.append(part)
        return Verdict(UNDECIDED, empty, open_) if open_ else Verdict(EMPTY, 1.0, [])

    def _excluded(self, chain: SerialChain, part: Part, budget: int) -> Search:
        """Search joint values whose pose is in a ball around a part of a cell, or prove that there are none."""
        T, position, angle = wide_ball(part.cell, self.last)
        position, angle = position + self.goal.position_tolerance, angle + self.goal.orientation_tolerance
        goal = Goal.pose(T, position_tolerance=position, orientation_tolerance=min(angle, np.pi))
        if beyond(self.arm, goal.targets, goal)[0]:
            return NOTHING
        return excluded(Problem(chain, goal), budget, threads=1, begin=part.boxes)

    def _sampled(self, cell: Cell) -> Array | None:
        """Return joint values, (n,), for one of some poses spread over a cell; None if no solution is found."""
        T = cell.sample(SAMPLES)
        found = reached(self.arm, Goal.pose(T))
        return self.arm.ik(T[int(np.argmax(found))], threads=1).q if found.any() else None

    def _passed_by_last_joint(self, q: Array | None, place: Index, numbers: Sequence[int]) -> Flags:
        """Return which cells of one position and direction the tip passes when the last joint moves through its range."""
        if q is None:
            return np.zeros(len(numbers), dtype=bool)
        rows = np.tile(q, (OFTEN * self.grid.orientations.arcs, 1))
        rows[:, -1] = np.linspace(self.arm.lower[-1], self.arm.upper[-1], len(rows))
        *places, number = self.grid.cells_of(self.arm.fk(rows))
        return np.isin(
            numbers, number[np.all([at == i for at, i in zip(places, place, strict=True)], axis=0)]
        )

    def _entered(self, chain: SerialChain, cell: Cell, q: Array, index: Index) -> Array | None:
        """Return joint values, (n,), whose pose lies in a cell, by steps from `q`, (n,); None if the steps fail."""
        weights = np.repeat([1.0, LEVER * chain.reach], 3)
        low, high = open_limits(chain)
        for _ in range(STEPS):
            T = chain.forward(q[None])[0]
            if self._lies_in(cell, T, index):
                return q
            near = cell.nearest(T)
            miss = weights * np.append(near[:3, 3] - T[:3, 3], turn_vector(near[:3, :3] @ T[:3, :3].T))
            J = weights[:, None] * jacobian_many(chain.arrays, q[None])[0]
            # Damped least squares, since cells at the boundary of the workspace are near singularities.
            step = J.T @ np.linalg.solve(J @ J.T + DAMPING * np.eye(6), miss)
            q = np.clip(q + step * min(1.0, LONGEST / max(np.abs(step).max(), LONGEST)), low, high)
        return None

    def _lies_in(self, cell: Cell, T: Array, index: Index) -> bool:
        """Return whether a pose, (4, 4), lies in a cell, or in a stack."""
        *place, number = (int(i) for i in self.grid.cells_of(T))
        return (*place, number if cell.arc is not None else number // self.grid.orientations.arcs) == index


def _inherited(search: Search) -> Array | None:
    """Return the boxes that a proof about a part leaves for its halves; None if these are incomplete."""
    # Boxes that rounding keeps are not listed, so the list would miss solutions.
    return search.left if search.outcome == STOPPED and search.stuck == 0.0 else None


def turn_vector(R: Array) -> Array:
    """Return axis times sine of the angle of a rotation, (3, 3) -> (3,)."""
    return np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / 2
