"""The inside of a mesh: which of its surfaces are closed, and whether they are solid or cavities.

`closed_surfaces` finds the surfaces. Each is solid by itself, whichever way it is oriented, so surfaces that overlap do not
cancel each other, even if one is inside out. The only exception is a cavity: a surface wholly inside a solid one, where the
file orients both without contradiction and one opposite to the other.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinseek.errors import InvalidScene

from .closed_surfaces import OPEN, closed_surfaces
from .geometry import library, triangles

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Bools = NDArray[np.bool_]

_FLAT = 1e-9
"""A surface encloses nothing if the volumes below its triangles cancel up to this share of their sum, which is more than
rounding."""

_ROUNDING = 2e-15
"""Relative error of the products of which the angle of a triangle is computed, and some more."""

_MOST_SURFACES = 10_000
"""In a mesh with more closed surfaces none is a cavity: the bounds of each are compared with those of all others."""

MOST_COMPARED = 2**25
"""Largest number of triangles that surfaces are compared with, added up, to find what surrounds each: some seconds. If a
mesh needs more, none is a cavity."""
_COMPARISON = 500
"""Triangles that a comparison with a surface counts in addition to its own, for the calls of NumPy."""


_COMPARED_FOR_EACH_NUMBER = 8
"""Triangles that are compared in the time in which elimination combines one number."""

_COMPARED_IN_A_SECOND = 2**23
"""What a second of processor time counts, in which coal looks whether two surfaces touch. In surfaces that lie close to each
other without contact it may compare each triangle with each."""
_AT_ONCE, _PAIRS_AT_ONCE = 128, 2**24
"""Least number of triangles that coal compares with a surface in one call, and most pairs of triangles otherwise: nothing
interrupts a call, which takes up to some seconds."""

NOTHING = -2
"""See `Interior.bounds`."""

_BOUNDS = 4
"""Surfaces whose bounds are compared in the time of a comparison with one triangle."""


class Interior:
    """The closed surfaces of a mesh."""

    def __init__(self, vertices: Array, faces: Indices, known: tuple[Indices, Indices] | None = None) -> None:
        """Find the closed surfaces of triangles and their cavities, unless they are known.

        Args:
            vertices: Vertices, (k, 3) [m].
            faces: Triangles as indices of vertices, (f, 3).
            known: What each of the triangles is known to bound, (f, 2), and how often it counts, (f,); see `bounds` and
                `times`.

        Raises:
            InvalidScene: To find its cavities takes too long.
        """
        self.compared = 0
        """Triangles that surfaces were compared with to find cavities, added up, see `MOST_COMPARED`; and what elimination
        counts."""
        self.times: Indices
        """How often each triangle counts in its surface, with random factors if it belongs to several, (f,)."""
        if known is None:
            faces, surface, self.times, oriented, whole, combined = closed_surfaces(vertices, faces)
            self.compared = _COMPARED_FOR_EACH_NUMBER * combined
        else:
            bounds, self.times = known
            surface = bounds[:, 0]
        self.faces = faces
        """Triangles as indices of vertices, (f, 3). Those of closed surfaces have their inside behind them, unless they
        belong to several."""
        order = np.argsort(surface, kind="stable")
        self._used = order[surface[order] >= 0]
        self._corners, self._times = vertices[self.faces[self._used]], self.times[self._used]
        self._starts = np.flatnonzero(np.diff(surface[self._used], prepend=-1))
        self._ends = np.append(self._starts[1:], len(self._used))
        if len(self._used):
            self._least = np.minimum.reduceat(self._corners.min(axis=1), self._starts)
            self._most = np.maximum.reduceat(self._corners.max(axis=1), self._starts)
        else:
            self._least = self._most = np.zeros((0, 3))
        self.closed: bool
        """Is every surface closed, and does one enclose something?"""
        self._cavities: dict[int, list[int]] = {}
        if known is None:
            self._volumes, sums = self._signed_volumes()
            self._solid = np.abs(self._volumes) > _FLAT * sums
            self.closed = bool(whole and self._solid.any())
            self._find_cavities(self._solid & oriented)
            self._turn_outward()
        else:
            self.closed = bool((bounds[:, 1] != OPEN).all())
            self._take_cavities(bounds[self._used[self._starts]])

    @property
    def any_solid(self) -> bool:
        """Is one of the surfaces solid?"""
        return bool(self._solid.any())

    @property
    def bounds(self) -> Indices:
        """The closed surface to which each triangle belongs, and the solid that it bounds, (f, 2).

        The solid has the number of its outer surface. In place of these numbers, `OPEN` says that there is none, and
        `NOTHING` that the triangle changes nothing.
        """
        none = NOTHING if self.closed else OPEN
        solid = np.where(self._solid, np.arange(len(self._starts)), none)
        for outer, inner in self._cavities.items():
            solid[inner] = outer
        found = np.full((len(self.faces), 2), none)
        surface = np.repeat(np.arange(len(self._starts)), self._ends - self._starts)
        found[self._used] = np.stack([surface, solid[surface]], axis=1)
        return found

    def holds(self, point: Array) -> bool:
        """Return whether a point (3,) lies in a solid surface and in no cavity of it."""
        # A surface that encloses nothing winds around no point, unless the volumes of parts that touch each other cancel.
        in_bounds = (point >= self._least).all(axis=1) & (point <= self._most).all(axis=1)
        near = np.flatnonzero(in_bounds & ~self._is_cavity())
        for solid, turns in zip(near.tolist(), self._windings(near, point).tolist(), strict=True):
            if not turns:
                continue
            inner = self._windings(np.array(self._cavities.get(solid, ()), dtype=np.int64), point)
            # A cavity may cross itself, and be solid where it winds around the point as the solid does.
            along = np.sign(turns) * inner
            if (along > 0).any() or not (-along >= abs(turns)).any():
                return True
        return False

    def _windings(self, surfaces: Indices, point: Array) -> Indices:
        """Return how often surfaces, (k,), wind around a point (3,), (k,); after Van Oosterom and Strackee (1983)."""
        if not len(surfaces):
            return np.zeros(0, dtype=np.int64)
        sizes = self._ends[surfaces] - self._starts[surfaces]
        begins = np.cumsum(sizes) - sizes
        rows = np.arange(sizes.sum()) + np.repeat(self._starts[surfaces] - begins, sizes)
        corners = self._corners[rows] - point
        a, b, c = (corners[:, i] for i in range(3))
        la, lb, lc = (np.linalg.norm(side, axis=1) for side in (a, b, c))
        top = np.einsum("ij,ij->i", a, np.cross(b, c))
        dot = [np.einsum("ij,ij->i", u, v) for u, v in ((a, b), (b, c), (c, a))]
        bottom = la * lb * lc + dot[0] * lc + dot[1] * la + dot[2] * lb
        times = self._times[rows]
        turns = np.rint(np.add.reduceat(times * np.arctan2(top, bottom), begins) / (2 * np.pi))
        if (times == 1).all():
            return turns.astype(np.int64)
        error = _ROUNDING * np.abs(times) * la * lb * lc / np.maximum(np.hypot(top, bottom), 1e-100)
        # The errors are independent, so their squares add up.
        return np.where(turns**2 > np.add.reduceat(error**2, begins), turns, 0).astype(np.int64)

    def _signed_volumes(self) -> tuple[Array, Array]:
        """Volume of each closed surface, (s,) [m³], negative if it is inside out; and the sum of its parts without signs."""
        if not len(self._starts):
            return np.zeros(0), np.zeros(0)
        origins = np.repeat(self._least, self._ends - self._starts, axis=0)
        a, b, c = (self._corners[:, i] - origins for i in range(3))
        parts = self._times * np.einsum("ij,ij->i", a, np.cross(b, c)) / 6
        return np.add.reduceat(parts, self._starts), np.add.reduceat(np.abs(parts), self._starts)

    def _find_cavities(self, trusted: Bools) -> None:
        """Find the surfaces that are cavities of others, from the largest to the smallest.

        Args:
            trusted: Which surfaces enclose something and are oriented in the file, (s,).
        """
        # What surrounds a surface has larger bounds, while the volume of one that crosses itself may be small.
        inward, bounds = self._volumes < 0, (self._most - self._least).prod(axis=1)
        sizes = self._ends - self._starts
        both_ways = (inward & trusted).any() and (~inward & trusted).any()
        if not both_ways or len(trusted) > _MOST_SURFACES:
            return
        larger, compared = dict[int, Indices](), 0
        for surface in np.argsort(-bounds, kind="stable").tolist():
            if not trusted[surface]:
                continue
            compared += len(trusted) // _BOUNDS
            outer = (self._least < self._least[surface]).all(axis=1)
            outer &= (self._most > self._most[surface]).all(axis=1)
            if not (outer & trusted & (inward != inward[surface])).any():
                continue
            around = np.flatnonzero(outer)
            larger[surface] = around[np.argsort(bounds[around], kind="stable")]
            compared += int((sizes[around] + _COMPARISON).sum())
            if compared > MOST_COMPARED:
                larger.clear()
                break
        self.compared += compared
        models = dict[int, Any]()
        for surface, around in larger.items():
            # The smallest first: what surrounds it, too, does not matter then.
            nearest = next((each for each in around.tolist() if self._encloses(each, surface, models)), None)
            if nearest is None or not (self._solid[nearest] and trusted[nearest]):
                continue
            if inward[nearest] != inward[surface]:
                self._solid[surface] = False
                self._cavities.setdefault(nearest, []).append(surface)

    def _take_cavities(self, bounds: Indices) -> None:
        """Take the cavities from what each surface bounds, (s, 2)."""
        self._solid = bounds[:, 0] == bounds[:, 1]
        number = {surface: k for k, surface in enumerate(bounds[:, 0].tolist())}
        for k in np.flatnonzero(~self._solid).tolist():
            if (solid := int(bounds[k, 1])) >= 0:
                self._cavities.setdefault(number.get(solid, -1), []).append(k)

    def _is_cavity(self) -> Bools:
        """Return which of the closed surfaces are cavities, (s,)."""
        found = np.zeros(len(self._starts), dtype=np.bool_)
        found[[each for inner in self._cavities.values() for each in inner]] = True
        return found

    def _encloses(self, outer: int, inner: int, models: dict[int, Any]) -> bool:
        """Return whether a surface lies wholly inside another, without contact.

        Args:
            outer: The other surface.
            inner: The surface.
            models: What coal needs of outer surfaces.

        Raises:
            InvalidScene: It takes too long.
        """
        if not self._windings(np.array([outer]), self._corners[self._starts[inner], 0])[0]:
            return False
        coal, began = library("coal"), time.thread_time()
        begin, end = self._starts[outer], self._ends[outer]
        if outer not in models:
            models[outer] = _model(self._corners[begin:end])
        still, step = coal.Transform3s(), max(_AT_ONCE, _PAIRS_AT_ONCE // int(end - begin))
        for first in range(int(self._starts[inner]), int(self._ends[inner]), step):
            result = coal.CollisionResult()
            part = _model(self._corners[first : min(first + step, self._ends[inner])])
            touches = coal.collide(models[outer], still, part, still, coal.CollisionRequest(), result)
            began, before = time.thread_time(), began
            self.compared += int((began - before) * _COMPARED_IN_A_SECOND)
            if self.compared > 2 * MOST_COMPARED:
                raise InvalidScene(
                    "to find its cavities takes too long, as its surfaces lie close to each other: use its convex hull, or "
                    "make meshes of its own of these surfaces"
                )
            if touches:
                return False
        return True

    def _turn_outward(self) -> None:
        """Orient the faces such that solid surfaces have positive volumes, and cavities negative ones.

        Sums of surfaces stay as they are, since the sign of their volume is random.
        """
        if not len(self._used):
            return
        cavities = self._is_cavity()
        wrong = self._solid & (self._volumes < 0)
        wrong &= np.maximum.reduceat(np.abs(self._times), self._starts) == 1
        wrong[cavities] = self._volumes[cavities] > 0
        turned = self._used[np.repeat(wrong, self._ends - self._starts)]
        self.faces[turned] = self.faces[turned, ::-1]


def _model(corners: Array) -> Any:
    """Return triangles, (f, 3, 3), as coal needs them."""
    return triangles(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))
