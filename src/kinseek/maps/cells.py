"""Whole cells judged: somewhere reached, proved empty, or undecided.

A ball of poses that holds a cell is asked for as one goal, with the half diagonal and the half angle as tolerances: if no
joint values meet these, the cell is empty, every pose of it. Else joint values are found that do, and where their pose lies
in the cell, it is reached. Neither: the cell is cut in half and its halves are asked, down to some depth.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinseek.arm import Arm
from kinseek.goal import Goal
from kinseek.kernels.proof.progress import ENDED, FOUND
from kinseek.problem import Problem
from kinseek.proof.boxes import excluded

from .grid import Grid, Rings, azimuths
from .orientations import about_z, ball, direction, farthest, shortest_turn, twist
from .search import reached

Array = NDArray[np.float64]

UNDECIDED, REACHED, EMPTY = 0, 1, 2

ATTRIBUTES: dict[str, dict[str, Any]] = {
    "cell": {
        "long_name": "what is known of the whole cell",
        "flag_values": [UNDECIDED, REACHED, EMPTY],
        "flag_meanings": "undecided reached_somewhere proved_empty",
        "units": "1",
    },
    "empty_share": {"long_name": "share of the cell's volume that is proved empty", "units": "1"},
}

LEVER = 0.2
"""A turn counts, when a cell is cut, as the way of a point so far off, as a part of the arm's reach."""

MARGIN = 1e-9
"""By which a ball is wider than it need be, relative to it: rounding of its size stays far below."""


INSIDE = 1e-3
"""How far inside a cell a pose is asked for that shall lie in it, as a part of its width: tolerances are smaller."""


@dataclass(frozen=True)
class Cell:
    """A cell, or a part of one."""

    box: Array
    """From and to along each dimension of places [m], (d, 2)."""
    region: Array
    """Polar angle from and to, azimuth from and to [rad], (4,)."""
    arc: tuple[float, float]
    """Turns from and to [rad], counted from the frame of the whole cell."""

    def halves(self, rings: bool, lever: float) -> tuple[Cell, Cell]:
        """Cut where it is longest; both halves have the same volume."""
        sides = self.box[:, 1] - self.box[:, 0]
        polar, azimuth = self.region[1] - self.region[0], self.region[3] - self.region[2]
        across = azimuth * np.sin(np.clip(np.pi / 2, self.region[0], self.region[1]))
        lengths = np.array([*sides, lever * polar, lever * across, lever * (self.arc[1] - self.arc[0])])
        longest, places = int(np.argmax(lengths)), len(sides)
        if longest < places:
            low, high = self.box[longest]
            ring = rings and longest == 0  # The volume of a ring grows with the square of its radius.
            middle = np.sqrt((low**2 + high**2) / 2) if ring else (low + high) / 2
            below, above = self.box.copy(), self.box.copy()
            below[longest, 1] = above[longest, 0] = middle
            return Cell(below, self.region, self.arc), Cell(above, self.region, self.arc)
        if longest == places + 2:
            middle = (self.arc[0] + self.arc[1]) / 2
            return (
                Cell(self.box, self.region, (self.arc[0], middle)),
                Cell(self.box, self.region, (middle, self.arc[1])),
            )
        below, above = self.region.copy(), self.region.copy()
        if longest == places:
            middle = np.arccos((np.cos(self.region[0]) + np.cos(self.region[1])) / 2)
            below[1] = above[0] = middle
        else:
            below[3] = above[2] = (self.region[2] + self.region[3]) / 2
        return Cell(self.box, below, self.arc), Cell(self.box, above, self.arc)

    def ball(self, frame: Array, rings: bool) -> tuple[Array, float, float]:
        """A pose, (4, 4), and how far off it any pose of the cell is at most, [m] and [rad].

        A part of a cell has its own centre c' on the sphere. From c to d by way of c' is another turn than straight there,
        by the area of the triangle c, c', d about d: 2 asin(tan(a/2) tan(b/2)) at most, a and b its sides at c'.
        """
        c, region = frame[:, 2], self.region[None]
        centre = np.array([[self.region[:2].mean(), self.region[2:].mean()]])
        if self.region[3] - self.region[2] > np.pi:  # A cap, or a whole collar.
            centre[0, 0] = 0.0 if self.region[0] == 0.0 else np.pi
        own = direction(*centre[0])
        aside = 2.0 * np.arcsin(min(1.0, float(np.linalg.norm(own - c)) / 2))
        reach = float(farthest(region, centre)[0])
        area = 2.0 * np.arcsin(min(1.0, np.tan(aside / 2) * np.tan(min(reach, 3.14) / 2)))
        T = np.eye(4)
        T[:3, :3] = shortest_turn(c, own) @ frame @ about_z(sum(self.arc) / 2)
        middles = self.box.mean(axis=1)
        T[:3, 3] = (middles[0], 0.0, middles[1]) if rings else middles
        angle = float(ball(reach, min(np.pi, (self.arc[1] - self.arc[0]) / 2 + area)))
        half = float(np.linalg.norm(self.box[:, 1] - self.box[:, 0])) / 2
        return T, half * (1.0 + MARGIN), min(angle * (1.0 + MARGIN), np.pi)


def cells_of_block(
    arm: Arm, grid: Grid | Rings, part: Sequence[slice], found: NDArray[np.bool_], depth: int, budget: int
) -> dict[str, Array]:
    """Judge the cells of a block.

    Args:
        arm: Of which the grid speaks.
        grid: Whose cells they are.
        part: Which cells, of each dimension.
        found: Where the middle of a cell is reached, of the block's shape.
        depth: How often a cell is cut in half.
        budget: Boxes of joint values that one proof may look at.

    Returns:
        What is known of each cell, and the share of it that is proved empty, both of the block's shape.
    """
    known = np.where(found, REACHED, UNDECIDED).astype("int8")
    empty = np.zeros(found.shape, dtype="float32")
    firsts = [some.indices(n)[0] for some, n in zip(part, grid.shape, strict=True)]
    for place in np.argwhere(~found):
        index = tuple(int(i + first) for i, first in zip(place, firsts, strict=True))
        known[tuple(place)], empty[tuple(place)] = judged(arm, grid, index, depth, budget)
    return {"cell": known, "empty_share": empty}


def judged(
    arm: Arm, grid: Grid | Rings, index: tuple[int, ...], depth: int, budget: int
) -> tuple[int, float]:
    """Judge one cell whose middle is not reached: what is known of it, and the share that is proved empty."""
    cell, frame = whole_cell(grid, index)
    rings, lever = isinstance(grid, Rings), LEVER * arm.chain.reach
    left, empty, open_ = [(cell, 0)], 0.0, False
    while left:
        part, level = left.pop()
        T, position, angle = part.ball(frame, rings)
        goal = Goal.pose(T, position_tolerance=position, orientation_tolerance=angle)
        search = excluded(Problem(arm.mechanism, goal), budget, threads=1)
        if search.outcome == ENDED:
            empty += 0.5**level
        elif search.outcome == FOUND and (
            holds(arm, grid, index, search.q) or reached_inside(arm, grid, cell, frame, search.q)
        ):
            return REACHED, empty
        elif level < depth:
            left += [(half, level + 1) for half in part.halves(rings, lever)]
        else:
            open_ = True
    return (UNDECIDED if open_ else EMPTY), empty


def holds(arm: Arm, grid: Grid | Rings, index: tuple[int, ...], q: Array) -> bool:
    """Does the pose of joint values, (n,), lie in a cell?"""
    return tuple(int(i) for i in grid.cells_of(arm.fk(q))) == index


def reached_inside(arm: Arm, grid: Grid | Rings, cell: Cell, frame: Array, q: Array) -> bool:
    """Is the pose of the cell reached that is nearest to that of joint values, (n,), in each of its coordinates?"""
    T = arm.fk(q)
    place, R = T[:3, 3], T[:3, :3]
    if isinstance(grid, Rings):
        back = about_z(-azimuths(T))
        place, R = np.array([np.hypot(place[0], place[1]), place[2]]), back @ R
    (low, high), sides = cell.box.T, cell.box[:, 1] - cell.box[:, 0]
    place = np.clip(place, low + INSIDE * sides, high - INSIDE * sides)
    d, region = R[:, 2], cell.region
    polar, azimuth = np.arctan2(np.hypot(d[0], d[1]), d[2]), np.arctan2(d[1], d[0])
    middle = region[2:].mean()
    azimuth = middle + np.mod(azimuth - middle + np.pi, 2 * np.pi) - np.pi
    polar, azimuth = (_within(value, *ends) for value, ends in ((polar, region[:2]), (azimuth, region[2:])))
    turn = _within(float(twist(frame[:, 2], frame, R)), *cell.arc)
    T = np.eye(4)
    T[:3, :3] = shortest_turn(frame[:, 2], direction(polar, azimuth)) @ frame @ about_z(turn)
    T[:3, 3] = (place[0], 0.0, place[1]) if isinstance(grid, Rings) else place
    return bool(reached(arm, Goal.pose(T[None]))[0])


def _within(value: float, low: float, high: float) -> float:
    """The nearest value of an interval, a little inside."""
    return float(np.clip(value, low + INSIDE * (high - low), high - INSIDE * (high - low)))


def whole_cell(grid: Grid | Rings, index: tuple[int, ...]) -> tuple[Cell, Array]:
    """A cell, and the frame from which its turns are counted, (3, 3)."""
    middles = np.array([each[i] for each, i in zip(grid.places, index, strict=False)])
    half = np.array(grid.widths) / 2
    turns = grid.orientations
    region, arc = divmod(index[-1], turns.arcs)
    start = 2 * arc * turns.half_arc - np.pi
    cell = Cell(
        np.stack([middles - half, middles + half], axis=1),
        turns.regions[region],
        (start, start + 2 * turns.half_arc),
    )
    return cell, turns.frames[region]
