"""A cell of a grid, or a part of one: its halves, a ball of poses that contains it, and poses inside it.

A cell is a box of positions, a region of the sphere of directions of the tip's z axis, and an arc of rotations about that
axis. The arc is omitted if any rotation is included.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from kinseek.support.turns import shortest

from .grid import Grid, Rings, azimuths
from .orientations import about_z, ball, direction, farthest, shortest_turn, twist

Array = NDArray[np.float64]

MARGIN = 4e-6
"""Relative enlargement of a ball. A position may lie outside the grid by a millionth of a cell and still belong to the
nearest cell; the rounding error of the ball's size is far smaller.
"""

INSIDE = 1e-3
"""Distance from a cell's sides, as a fraction of its width, of a pose that must lie inside; tolerances are smaller."""

STRIDES = 1.1127756842787055 ** -np.arange(1.0, 7.0)
"""Steps of an additive sequence that fills six dimensions evenly: powers of the root of x⁷ = x + 1 (Roberts 2018)."""


LEVER = 0.2
"""Lever arm by which rotations are compared with lengths when a cell is halved, as a fraction of the arm's reach. Not
examined further."""


@dataclass(frozen=True)
class Cell:
    """A cell, or a part of one."""

    box: Array
    """Lower and upper end along each dimension of positions [m], (d, 2)."""
    region: Array
    """Lower and upper polar angle, lower and upper azimuth [rad], (4,)."""
    frame: Array
    """Rotation from which the rotation about z is measured, (3, 3): that of the whole cell."""
    arc: tuple[float, float] | None
    """Lower and upper rotation about z [rad]; None: any rotation."""
    ring: bool
    """Are the positions given as distances from an axis, and heights along it?"""

    def halves(self, lever: float) -> tuple[Cell, Cell]:
        """Halve the cell along its longest side, into equal volumes. Rotations are measured at a lever arm `lever` [m]."""
        sides = self.box[:, 1] - self.box[:, 0]
        polar, azimuth = self.region[1] - self.region[0], self.region[3] - self.region[2]
        across = azimuth * np.sin(np.clip(np.pi / 2, self.region[0], self.region[1]))
        arc = 0.0 if self.arc is None else self.arc[1] - self.arc[0]
        lengths = np.array([*sides, lever * polar, lever * across, lever * arc])
        longest, places = int(np.argmax(lengths)), len(sides)
        if longest < places:
            low, high = self.box[longest]
            ring = self.ring and longest == 0  # A ring's volume grows with the squared radius.
            middle = np.sqrt((low**2 + high**2) / 2) if ring else (low + high) / 2
            below, above = self.box.copy(), self.box.copy()
            below[longest, 1] = above[longest, 0] = middle
            return replace(self, box=below), replace(self, box=above)
        if longest == places + 2 and self.arc is not None:
            middle = (self.arc[0] + self.arc[1]) / 2
            return replace(self, arc=(self.arc[0], middle)), replace(self, arc=(middle, self.arc[1]))
        below, above = self.region.copy(), self.region.copy()
        if longest == places:
            middle = np.arccos((np.cos(self.region[0]) + np.cos(self.region[1])) / 2)
            below[1] = above[0] = middle
        else:
            below[3] = above[2] = (self.region[2] + self.region[3]) / 2
        return replace(self, region=below), replace(self, region=above)

    def ball(self) -> tuple[Array, float, float]:
        """Return a pose, (4, 4), and the largest deviation of any pose of the cell from it, [m] and [rad].

        A part of a cell has its own centre c' on the sphere. The path from c to d by way of c' rotates differently from the
        direct path, by the area of the triangle c, c', d about d. This is at most 2 asin(tan(a/2) tan(b/2)), with a and b
        its sides at c'. If any rotation is included, the shortest path from c' is used instead.
        """
        c, region = self.frame[:, 2], self.region[None]
        centre = np.array([[self.region[:2].mean(), self.region[2:].mean()]])
        if self.region[3] - self.region[2] > np.pi:  # A cap, or a whole collar.
            centre[0, 0] = 0.0 if self.region[0] == 0.0 else np.pi
        own = direction(*centre[0])
        reach = angle = float(farthest(region, centre)[0])
        if self.arc is not None:
            tilt = 2.0 * np.arcsin(min(1.0, float(np.linalg.norm(own - c)) / 2))
            area = 2.0 * np.arcsin(min(1.0, np.tan(tilt / 2) * np.tan(min(reach, 3.14) / 2)))
            angle = float(ball(reach, min(np.pi, (self.arc[1] - self.arc[0]) / 2 + area)))
        T = self.pose(self.box.mean(axis=1), own, 0.0 if self.arc is None else sum(self.arc) / 2)
        half = float(np.linalg.norm(self.box[:, 1] - self.box[:, 0])) / 2
        return T, half * (1.0 + MARGIN), min(angle * (1.0 + MARGIN), np.pi)

    def pose(self, place: Array, d: Array, turn: float) -> Array:
        """Return the pose at a position, (d,), with the z axis along d, (3,), rotated about it by `turn` [rad]; (4, 4)."""
        T = np.eye(4)
        T[:3, :3] = shortest_turn(self.frame[:, 2], d) @ self.frame @ about_z(turn)
        T[:3, 3] = (place[0], 0.0, place[1]) if self.ring else place
        return T

    def nearest(self, T: Array) -> Array:
        """Return the pose inside the cell that is nearest to a pose in each of its coordinates, both (4, 4).

        In a ring it has the same angle about the axis as that pose.
        """
        back = about_z(-azimuths(T)) if self.ring else np.eye(3)
        place, R = T[:3, 3], back @ T[:3, :3]
        if self.ring:
            place = np.array([np.hypot(place[0], place[1]), place[2]])
        d = R[:, 2]
        middle = self.region[2:].mean()
        azimuth = middle + shortest(np.arctan2(d[1], d[0]) - middle)
        swing = _within(
            np.array([np.arctan2(np.hypot(d[0], d[1]), d[2]), azimuth]), self.region.reshape(2, 2)
        )
        turn = twist(self.frame[:, 2], self.frame, R)
        if self.arc is not None:
            turn = _within(turn, np.array(self.arc))
        near = self.pose(_within(place, self.box), direction(*swing), float(turn))
        near[:3] = back.T @ near[:3]
        return near

    def sample(self, count: int) -> Array:
        """Return poses spread over the cell, the same in every call, (count, 4, 4)."""
        share = np.mod(0.5 + np.arange(1, count + 1)[:, None] * STRIDES, 1.0)
        places = self.box[:, 0] + share[:, : len(self.box)] * (self.box[:, 1] - self.box[:, 0])
        polar, azimuth, turn = share[:, 3:].T
        (low, high), cosines = (-np.pi, np.pi) if self.arc is None else self.arc, np.cos(self.region[:2])
        d = direction(
            # Directions with evenly distributed cosines are evenly distributed on the sphere.
            np.arccos(cosines[0] + polar * (cosines[1] - cosines[0])),
            self.region[2] + azimuth * (self.region[3] - self.region[2]),
        )
        return np.array([self.pose(*each) for each in zip(places, d, low + turn * (high - low), strict=True)])


def _within(value: Array, ends: Array) -> Array:
    """Return the nearest value slightly inside an interval."""
    low, high = ends[..., 0], ends[..., 1]
    inset = INSIDE * (high - low)
    return np.clip(value, low + inset, high - inset)


def whole_cell(grid: Grid | Rings, index: tuple[int, ...], rolls: bool = False) -> Cell:
    """Return a cell of a grid; with `rolls` the union of all cells that differ in the rotation about the tip's z axis."""
    middles = np.array([each[i] for each, i in zip(grid.places, index, strict=False)])
    half = np.array(grid.widths) / 2
    turns = grid.orientations
    region, arc = divmod(index[-1], turns.arcs)
    start = 2 * arc * turns.half_arc - np.pi
    return Cell(
        np.stack([middles - half, middles + half], axis=1),
        turns.regions[region],
        turns.frames[region],
        None if rolls else (start, start + 2 * turns.half_arc),
        isinstance(grid, Rings),
    )
