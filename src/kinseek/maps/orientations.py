"""An even grid of orientations with a proved covering radius.

A rotation is determined by the image of the z axis, a point of the sphere, and a turn about this image. So SO(3) is locally
the sphere times a circle (the Hopf fibration, with which Yershova, Jain, LaValle and Mitchell 2010 build grids on SO(3)).
The sphere is divided into regions of equal area, collars of rectangles between two caps (Leopardi 2006, "A partition of the
unit sphere into regions of equal area and small diameter"), and the circle into equal arcs. So all cells have the same
volume, and their number is arbitrary.

The cell of region i, with centre c, and arc j is { S(c, d) R Rz(t) : d in the region, |t| <= half an arc }. Here R is the
cell's own rotation, R z = c, and S(c, d) is the shortest rotation of c onto d. For each d the arcs tile the circle, so the
cells tile SO(3). The axis of S(c, d) is perpendicular to c, the axis of the rotation R Rz(t) R^-1. So the angle Ω
between a member and R satisfies cos(Ω/2) = cos(σ/2) cos(t/2), with σ the angle of c and d. It is largest in a corner of the
region at the end of the arc.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinseek.errors import InvalidMap
from kinseek.support.lazy import Lazy, lazy
from kinseek.support.validation import as_integer

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

MOST = 10_000_000
"""Maximum number of orientations of a grid."""


@dataclass(frozen=True, eq=False)
class Orientations(Lazy):
    """A grid of orientations whose cells have equal volume and tile SO(3). Make one with `orientations`."""

    regions: Array
    """Lower and upper polar angle, lower and upper azimuth of each region of the sphere [rad], (n, 4)."""
    arcs: int
    """Number of rotations about the z axis of the tip for each region."""
    _collars: tuple[Array, Indices] = field(repr=False)
    """Polar angles where collars begin [rad], (c + 1,), and the index of the first region of each, (c + 1,)."""

    def __len__(self) -> int:
        """Return the number of orientations."""
        return len(self.regions) * self.arcs

    def __repr__(self) -> str:
        """Number and spacing."""
        return (
            f"Orientations({len(self)}: {len(self.regions)} directions x {self.arcs} turns, every orientation within "
            f"{self.covering_radius:.4f} rad of one)"
        )

    @lazy
    def directions(self) -> Array:
        """Centre of each region, the direction of the tip's z axis, (n, 3)."""
        return direction(*self.centres.T)

    @lazy
    def centres(self) -> Array:
        """Polar angle and azimuth of each region's centre [rad], (n, 2); the centre of a cap is its pole."""
        polar = self.regions[:, :2].mean(axis=1)
        polar[0], polar[-1] = (0.0, np.pi) if len(self.regions) > 1 else (0.0, 0.0)
        return np.stack([polar, self.regions[:, 2:].mean(axis=1)], axis=1)

    @property
    def half_arc(self) -> float:
        """Half an arc [rad]."""
        return np.pi / self.arcs

    @lazy
    def radii(self) -> Array:
        """Largest angle of a point of each region from its centre [rad], (n,)."""
        return farthest(self.regions, self.centres)

    @lazy
    def half_angles(self) -> Array:
        """Largest angle between each orientation and a member of its cell [rad], (k,)."""
        return np.repeat(ball(self.radii, self.half_arc), self.arcs)

    @property
    def covering_radius(self) -> float:
        """Upper bound on the angle of any orientation to the nearest one of the grid [rad]; proved, not sampled."""
        return float(self.half_angles.max())

    @lazy
    def matrices(self) -> Array:
        """All rotations, (k, 3, 3), grouped by direction."""
        turns = (2 * np.arange(self.arcs) + 1) * self.half_arc - np.pi
        return (self.frames[:, None] @ about_z(turns)[None]).reshape(-1, 3, 3)

    @lazy
    def frames(self) -> Array:
        """Rotation of each region from which rotations about z are measured: z onto its centre, (n, 3, 3)."""
        polar, azimuth = self.centres.T
        c, s = np.cos(polar), np.sin(polar)
        tilts = np.zeros((len(polar), 3, 3))
        tilts[:, 0, 0], tilts[:, 0, 2], tilts[:, 1, 1], tilts[:, 2, 0], tilts[:, 2, 2] = c, s, 1.0, -s, c
        return np.asarray(about_z(azimuth) @ tilts)

    def nearest(self, R: ArrayLike) -> Indices:
        """Return the index of the cell that contains each rotation.

        Args:
            R: Rotations, (..., 3, 3).

        Returns:
            Indices from 0, (...).
        """
        rotations = np.asarray(R, dtype=float)
        d = rotations[..., :, 2]
        begins, firsts = self._collars
        polar = np.arctan2(np.hypot(d[..., 0], d[..., 1]), d[..., 2])
        collar = np.clip(np.searchsorted(begins, polar, side="right") - 1, 0, len(begins) - 2)
        count = firsts[collar + 1] - firsts[collar]
        share = np.mod(np.arctan2(d[..., 1], d[..., 0]), 2 * np.pi) / (2 * np.pi)
        region = firsts[collar] + np.minimum((share * count).astype(np.int64), count - 1)
        number: Indices = region * self.arcs + self._arc(rotations, region)
        return number

    def _arc(self, rotations: Array, region: Indices) -> Indices:
        turn = twist(self.directions[region], self.frames[region], rotations)
        return np.clip(((turn + np.pi) / (2 * self.half_arc)).astype(np.int64), 0, self.arcs - 1)


def orientations(count: int) -> Orientations:
    """Return an even grid on SO(3).

    It combines directions of the tip's z axis with rotations about it, in the proportion with the least covering radius. All
    orientations represent the same volume of SO(3), so a fraction of the grid is a fraction of all orientations.

    Args:
        count: Number of orientations, 1 to 10,000,000; the grid has as many, or a few more if that is more even.

    Returns:
        The grid; ``covering_radius`` is its resolution [rad].

    Raises:
        InvalidMap: `count` is not an integer in that range.
    """
    count = as_integer("count", count, 1, MOST, InvalidMap)
    middle = round(float(np.cbrt(np.pi * count)))  # Arcs as wide as regions: (2π/m)² = 4π/n, n m = count.
    fits = [m for m in range(max(1, middle // 2), 2 * middle + 1) if count % m == 0]
    tried = {
        m: _grid(-(-int(count) // m), m)
        for m in {*range(max(1, middle - 2), middle + 3), *fits}
        if m <= count
    }
    best = min(grid.covering_radius for grid in tried.values())
    even = [grid for grid in tried.values() if grid.covering_radius <= 1.08 * best]
    return min(even, key=lambda grid: (len(grid), grid.covering_radius))


def orientations_of(count: int, directions: int) -> Orientations:
    """Return the grid with these numbers of orientations and directions, as `orientations` makes it.

    Raises:
        InvalidMap: `orientations` makes no grid with these numbers.
    """
    count = as_integer("the number of orientations", count, 1, 2 * MOST, InvalidMap)
    directions = as_integer("the number of directions", directions, 1, count, InvalidMap)
    arcs = count // directions
    if directions * arcs != count or 4 * arcs + 8 < np.cbrt(np.pi * count):
        raise InvalidMap(f"there is no grid of {count:,} orientations with {directions:,} directions")
    return _grid(directions, arcs)


def _grid(directions: int, arcs: int) -> Orientations:
    begins, counts = _collars(directions)
    regions = [
        (begins[i], begins[i + 1], 2 * np.pi * k / n, 2 * np.pi * (k + 1) / n)
        for i, n in enumerate(counts)
        for k in range(n)
    ]
    firsts = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    return Orientations(np.array(regions), arcs, (begins, firsts))


def _collars(count: int) -> tuple[Array, list[int]]:
    """Return where collars begin [rad], (c + 1,), and the number of regions of each; Leopardi 2006, Section 3."""
    if count <= 2:
        return np.linspace(0.0, np.pi, count + 1), [1] * count
    cap = 2.0 * np.arcsin(np.sqrt(1.0 / count))
    number = max(1, round((np.pi - 2.0 * cap) / np.sqrt(4.0 * np.pi / count)))
    ends = cap + (np.pi - 2.0 * cap) * np.arange(number + 1) / number
    ideal = np.diff(np.sin(ends / 2) ** 2) * count
    counts, over = [], 0.0
    for share in ideal:
        counts.append(max(1, round(share + over)))
        over += share - counts[-1]
    counts = [1, *counts, 1]
    counts[len(counts) // 2] += count - sum(counts)
    area = np.concatenate([[0.0], np.cumsum(counts)]) / count
    return 2.0 * np.arcsin(np.sqrt(np.minimum(area, 1.0))), counts


def direction(polar: ArrayLike, azimuth: ArrayLike) -> Array:
    """Return points of the sphere, (..., 3)."""
    p, a = np.asarray(polar), np.asarray(azimuth)
    return np.stack([np.sin(p) * np.cos(a), np.sin(p) * np.sin(a), np.cos(p)], axis=-1)


def about_z(angle: ArrayLike) -> Array:
    """Return rotations about z, (..., 3, 3)."""
    t = np.asarray(angle, dtype=float)
    R = np.zeros((*t.shape, 3, 3))
    R[..., 0, 0] = R[..., 1, 1] = np.cos(t)
    R[..., 1, 0], R[..., 0, 1], R[..., 2, 2] = np.sin(t), -np.sin(t), 1.0
    return R


def farthest(regions: Array, centres: Array) -> Array:
    """Return the largest angle of a point of each rectangle, (n, 4), from a point inside, (n, 2), [rad].

    Along a parallel the angle grows with the difference of azimuths, so the farthest point lies on the meridians at the
    sides. There cos σ = A cos θ + B sin θ, which is least at an end, or at atan2(B, A) + π if that lies between them.
    """
    low, high = regions[:, 0], regions[:, 1]
    wide = np.minimum(np.maximum(centres[:, 1] - regions[:, 2], regions[:, 3] - centres[:, 1]), np.pi)
    A, B = np.cos(centres[:, 0]), np.sin(centres[:, 0]) * np.cos(wide)
    inside = np.clip(np.arctan2(B, A) + np.pi, low, high)
    cosines = [A * np.cos(theta) + B * np.sin(theta) for theta in (low, high, inside)]
    return np.asarray(np.arccos(np.clip(np.min(cosines, axis=0), -1.0, 1.0)))


def ball(swing: ArrayLike, half_turn: ArrayLike) -> Array:
    """Return the largest angle of a rotation by at most `half_turn` and one by `swing` about a perpendicular axis [rad]."""
    cosine = np.cos(np.asarray(swing) / 2) * np.cos(np.asarray(half_turn) / 2)
    return np.asarray(2.0 * np.arccos(np.clip(cosine, -1.0, 1.0)))


def twist(c: Array, frames: Array, rotations: Array) -> Array:
    """Return the angle t of R = S(c, d) F Rz(t) [rad] for cells' c and F, (..., 3) and (..., 3, 3), and R, (..., 3, 3)."""
    d = rotations[..., :, 2]
    # The shortest rotation of c onto d maps x to x - (c+d)·x / (1+c·d) (c+d) + 2 (c·x) d. Its inverse is that of d onto c.
    x, total = rotations[..., :, 0], c + d
    scale = np.maximum(1.0 + np.sum(c * d, axis=-1, keepdims=True), 1e-300)
    back = x - np.sum(total * x, axis=-1, keepdims=True) / scale * total
    back = back + 2.0 * np.sum(d * x, axis=-1, keepdims=True) * c
    cos = np.sum(back * frames[..., :, 0], axis=-1)
    sin = np.sum(back * frames[..., :, 1], axis=-1)
    return np.asarray(np.arctan2(sin, cos))


def shortest_turn(c: Array, d: Array) -> Array:
    """Return the rotation by the least angle from one unit vector, (3,), to another that is not opposite, (3, 3)."""
    v = np.cross(c, d)
    K = np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
    return np.asarray(np.eye(3) + K + K @ K / (1.0 + c @ d))
