"""The inside of a mesh: which of its surfaces are closed, and whether they are solid or cavities.

Triangles are joined across edges that belong to exactly two of them, and oriented alike. A surface is closed if each of its
edges is then passed as often in one direction as in the other. Every closed surface is solid by itself, whichever way it is
oriented. So surfaces that overlap do not cancel each other, even if one is inside out. If they share edges or triangles, the
order in the file separates them: the triangles of each follow each other. The only exception is a cavity: a surface wholly
inside a solid one, where the file orients both without contradiction and one opposite to the other.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from operator import add, xor
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinseek.errors import InvalidScene

from .geometry import library, triangles

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Bools = NDArray[np.bool_]

SAME = 9
"""Vertices whose coordinates agree to this many decimals are one."""
_FLAT = 1e-9
"""A surface encloses nothing if the volumes below its triangles cancel up to this share of their sum, which is more than
rounding."""

_MOST_SURFACES = 10_000
"""In a mesh with more closed surfaces none is a cavity: the bounds of each are compared with those of all others."""

MOST_COMPARED = 2**25
"""Largest number of triangles that surfaces are compared with, added up, to find what surrounds each: some seconds. If a
mesh needs more, none is a cavity."""
_COMPARISON = 500
"""Triangles that a comparison with a surface counts in addition to its own, for the calls of NumPy."""


_COMPARED_IN_A_SECOND = 2**23
"""What a second of processor time counts, in which coal looks whether two surfaces touch. In surfaces that lie close to each
other without contact it may compare each triangle with each."""
_AT_ONCE, _PAIRS_AT_ONCE = 128, 2**24
"""Least number of triangles that coal compares with a surface in one call, and most pairs of triangles otherwise: nothing
interrupts a call, which takes up to some seconds."""

OPEN, NOTHING = -1, -2
"""See `Interior.bounds`."""

_MOST_PATCHES, _MOST_REPEATED = 1000, 2**18
"""Most patches of connected triangles for which `_cycles` takes its time, and most triangles that are repeated."""

_PEELINGS = 50
"""Rounds in which triangles that enclose nothing are left out."""

_BOUNDS = 4
"""Surfaces whose bounds are compared in the time of a comparison with one triangle."""


class Interior:
    """The closed surfaces of a mesh."""

    def __init__(self, vertices: Array, faces: Indices, bounds: Indices | None = None) -> None:
        """Find the closed surfaces of triangles and their cavities, unless they are known.

        Args:
            vertices: Vertices, (k, 3) [m].
            faces: Triangles as indices of vertices, (f, 3).
            bounds: What each of the triangles is known to bound, (f, 2), see `Interior.bounds`.

        Raises:
            InvalidScene: To find its cavities takes too long.
        """
        if bounds is None:
            faces, surface, trusted, whole = _closed_surfaces(vertices, faces)
        else:
            surface = bounds[:, 0]
        self.faces = faces
        """Triangles as indices of vertices, (g, 3), and again those that belong to several closed surfaces. Those of closed
        surfaces have their inside behind them."""
        order = np.argsort(surface, kind="stable")
        self._used = order[surface[order] >= 0]
        self._corners = vertices[self.faces[self._used]]
        self._starts = np.flatnonzero(np.diff(surface[self._used], prepend=-1))
        self._ends = np.append(self._starts[1:], len(self._used))
        if len(self._used):
            self._least = np.minimum.reduceat(self._corners.min(axis=1), self._starts)
            self._most = np.maximum.reduceat(self._corners.max(axis=1), self._starts)
        else:
            self._least = self._most = np.zeros((0, 3))
        self.closed: bool
        """Is every surface closed, and does it enclose something?"""
        self._cavities: dict[int, list[int]] = {}
        self.compared = 0
        """Triangles that surfaces were compared with to find cavities, added up; see `MOST_COMPARED`."""
        if bounds is None:
            self._volumes, sums = self._signed_volumes()
            self._solid = np.abs(self._volumes) > _FLAT * sums
            self.closed = bool(whole and len(self._used) and self._solid.all())
            self._find_cavities(self._solid & trusted)
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
        """The closed surface to which each triangle belongs, and the solid that it bounds, (g, 2).

        The solid has the number of its outer surface. In place of these numbers, `OPEN` says that there is none, and
        `NOTHING` that the triangle changes nothing.
        """
        solid = np.where(self._solid, np.arange(len(self._starts)), OPEN)
        for outer, inner in self._cavities.items():
            solid[inner] = outer
        found = np.full((len(self.faces), 2), NOTHING if self.closed else OPEN)
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
            if not (-np.sign(turns) * inner >= abs(turns)).any():
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
        turns = np.add.reduceat(np.arctan2(top, bottom), begins) / (2 * np.pi)
        return np.rint(turns).astype(np.int64)

    def _signed_volumes(self) -> tuple[Array, Array]:
        """Volume of each closed surface, (s,) [m³], negative if it is inside out; and the sum of its parts without signs."""
        if not len(self._starts):
            return np.zeros(0), np.zeros(0)
        origins = np.repeat(self._least, self._ends - self._starts, axis=0)
        a, b, c = (self._corners[:, i] - origins for i in range(3))
        parts = np.einsum("ij,ij->i", a, np.cross(b, c)) / 6
        return np.add.reduceat(parts, self._starts), np.add.reduceat(np.abs(parts), self._starts)

    def _find_cavities(self, trusted: Bools) -> None:
        """Find the surfaces that are cavities of others, from the largest to the smallest.

        Args:
            trusted: Which surfaces enclose something and are oriented in the file, (s,).
        """
        inward, volumes, sizes = self._volumes < 0, np.abs(self._volumes), self._ends - self._starts
        both_ways = (inward & trusted).any() and (~inward & trusted).any()
        if not both_ways or len(trusted) > _MOST_SURFACES:
            return
        larger, compared = dict[int, Indices](), 0
        for surface in np.argsort(-volumes, kind="stable").tolist():
            if not trusted[surface]:
                continue
            compared += len(trusted) // _BOUNDS
            outer = (self._least < self._least[surface]).all(axis=1)
            outer &= (self._most > self._most[surface]).all(axis=1)
            if not (outer & trusted & (inward != inward[surface])).any():
                continue
            around = np.flatnonzero(outer)
            larger[surface] = around[np.argsort(volumes[around], kind="stable")]
            compared += int((sizes[around] + _COMPARISON).sum())
            if compared > MOST_COMPARED:
                larger.clear()
                break
        self.compared = compared
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
        """Orient the faces such that solid surfaces have positive volumes, and cavities negative ones."""
        cavities = self._is_cavity()
        wrong = self._solid & (self._volumes < 0)
        wrong[cavities] = self._volumes[cavities] > 0
        turned = self._used[np.repeat(wrong, self._ends - self._starts)]
        self.faces[turned] = self.faces[turned, ::-1]


def _closed_surfaces(vertices: Array, faces: Indices) -> tuple[Indices, Indices, Bools, bool]:
    """Find the closed surfaces of triangles.

    Args:
        vertices: Vertices, (k, 3) [m].
        faces: Triangles as indices of vertices, (f, 3).

    Returns:
        The triangles, and again those that belong to several surfaces, such that those of a surface are oriented alike,
        (g, 3); the number of the closed surface of each, negative if there is none, (g,); of which surfaces no triangle is
        turned over, (s,); and whether all triangles belong to one.
    """
    _, places = np.unique(vertices.round(SAME), axis=0, return_inverse=True)
    corners = places.ravel()[faces]
    extended = np.flatnonzero((corners != np.roll(corners, 1, axis=1)).all(axis=1))
    corners = corners[extended]
    ordered = np.ones(len(corners), dtype=np.bool_)
    if _shares_edges(corners):
        rows, part, ordered = _parts(corners)
        extended, corners = extended[rows], _apart(corners[rows], part)
        _, first = np.unique(extended, return_index=True)
        again = np.delete(np.arange(len(extended)), first)
        faces = np.concatenate([faces, faces[extended[again]]])
        extended[again] = np.arange(len(faces) - len(again), len(faces))
    left = _without_opposites(corners)
    used = extended[left]
    flipped, surface, closed, trusted = _surfaces(corners[left])
    trusted[surface[~ordered[left]]] = False
    faces = faces.copy()
    faces[used[flipped]] = faces[used[flipped], ::-1]
    found = np.full(len(faces), OPEN)
    found[used] = np.where(closed, np.cumsum(closed) - 1, OPEN)[surface]
    return faces, found, trusted[closed], bool(closed.all())


def _model(corners: Array) -> Any:
    """Return triangles, (f, 3, 3), as coal needs them."""
    return triangles(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))


def _shares_edges(corners: Indices) -> bool:
    """Return whether one edge belongs to more than two triangles."""
    ends = np.sort(corners[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    edges = np.sort(ends[:, 0] * (corners.max(initial=0) + 1) + ends[:, 1])
    return bool((edges[2:] == edges[:-2]).any())


def _parts(corners: Indices) -> tuple[Indices, Indices, Bools]:
    """Divide connected triangles into parts, in the order of the file: triangles that follow each other and are closed.

    These pass each edge as often in one direction as in the other. They are looked for without triangles that are repeated,
    then with them, then without opposite ones. Then those follow that pass each edge an even number of times, and need to be
    turned over. What others enclose are parts, too.

    Args:
        corners: Triangles with three different corners, (f, 3).

    Returns:
        The triangles in parts, (g,), the number of the part of each, (g,), and which are in the order of the file, (g,). A
        triangle may be in several parts; a repeated one may be in none.
    """
    edges, forward = _edges(corners)
    same, sign = _distinct(corners)
    random = np.random.default_rng(0)
    of_edge, own = (random.integers(1, 2**60, int(k.max()) + 1)[k] for k in (edges, same))
    way = np.where(forward, 1, -1)
    directed = (of_edge * way).reshape(-1, 3).sum(axis=1).tolist(), (own * sign).tolist()
    even = np.bitwise_xor.reduce(of_edge.reshape(-1, 3), axis=1).tolist(), own.tolist()

    inner = np.flatnonzero(_may_enclose(edges.reshape(-1, 3), same))
    between = edges.reshape(-1, 3)[inner].ravel()
    component = _components(len(inner), *_chained(between))
    shared = np.zeros(int(component.max(initial=-1)) + 1, dtype=np.bool_)
    shared[component[(np.bincount(between)[between] > 2).reshape(-1, 3).any(axis=1)]] = True
    order = np.argsort(component, kind="stable")
    groups = np.split(inner[order], np.flatnonzero(np.diff(component[order])) + 1) if len(inner) else []
    parts, cycles, total = list[Indices](), list[Indices](), 0
    open_ones = [np.setdiff1d(np.arange(len(corners)), inner)]
    for members, divided in zip(groups, shared.tolist(), strict=True):
        if not divided:
            parts.append(members)
            continue
        runs, left, spare = dict[bytes, Indices](), members, members[:0]
        for kinds, sums in (
            (2 * same + (sign > 0), directed),
            (None, directed),
            (same, directed),
            (same, even),
        ):
            pool = np.union1d(left, spare)
            once = pool if kinds is None else _once(pool, kinds)
            taken, kept = [once[:0]], [once[:0]]
            for found in map(np.array, _runs(once.tolist(), *sums, xor if sums is even else add)):
                run, key = found, np.unique(same[found])
                if len(key) < len(run):
                    run = found[_without_opposites(corners[found])]
                    key = np.unique(same[run])
                runs.setdefault(key.tobytes(), run)  # A body that is there several times counts once.
                taken.append(found)
                kept.append(run)
            left = np.setdiff1d(left, np.concatenate(taken))
            # What is there in both orientations may be another body, which comes among them.
            spare = np.setdiff1d(np.union1d(spare, np.concatenate(taken)), np.concatenate(kept))
        parts += runs.values()
        known = np.unique(same[np.concatenate([*runs.values()])]) if runs else same[:0]
        pool = np.union1d(left, spare)
        rest = pool[np.isin(pool, left) | _may_enclose(edges.reshape(-1, 3)[pool], same[pool])]
        if len(rest := rest[~np.isin(same[rest], known)]):
            once = _once(members, same)
            some = [once[each] for each in _cycles(corners[once], np.isin(same[once], same[rest]))]
            total += sum(len(each) for each in some)
            cycles += some if total <= _MOST_REPEATED else []
            open_ones.append(
                rest if total > _MOST_REPEATED or not some else np.setdiff1d(rest, np.concatenate(some))
            )
    ends = np.cumsum([len(each) for each in (*parts, *open_ones, *cycles)])
    rows = np.concatenate([*parts, *open_ones, *cycles])
    number = np.searchsorted(ends, np.arange(len(rows)), side="right")
    number[(number >= len(parts)) & (number < len(parts) + len(open_ones))] = len(parts)
    return rows, number, number <= len(parts)


def _may_enclose(edges: Indices, same: Indices) -> Bools:
    """Leave out triangles that are the only one at an edge, then those that are so without them, and so on.

    Args:
        edges: The edges of each triangle, (f, 3).
        same: A number that only triangles with the same corners share, (f,).

    Returns:
        Which triangles are left, (f,). After `_PEELINGS` rounds some may be left that enclose nothing.
    """
    if not len(same):
        return np.zeros(0, dtype=np.bool_)
    _, alive = np.unique(same, return_index=True)
    for _ in range(_PEELINGS):
        around = edges[alive]
        kept = (np.bincount(around.ravel())[around] > 1).all(axis=1)
        if kept.all():
            break
        alive = alive[kept]
    found = np.zeros(int(same.max()) + 1, dtype=np.bool_)
    found[same[alive]] = True
    return np.asarray(found[same])


def _once(triangles: Indices, number: Indices) -> Indices:
    """Return the first one of the triangles that have the same number."""
    _, first = np.unique(number[triangles], return_index=True)
    return np.asarray(triangles[np.sort(first)])


def _cycles(corners: Indices, wanted: Bools) -> list[Indices]:
    """Return sets of triangles that pass each edge an even number of times, for all wanted triangles that are in any.

    All other such sets with wanted triangles are sums of these and of sets without one. So where one of them winds around a
    point, one that is returned does, or one without a wanted triangle. It is Gaussian elimination modulo 2, of patches that
    end only where other than two triangles meet.

    Args:
        corners: Different triangles, (f, 3).
        wanted: Which of them are wanted, (f,).

    Returns:
        The triangles of each; none if there are too many patches or triangles.
    """
    edges, _ = _edges(corners)
    order = np.argsort(edges, kind="stable")
    counts = np.bincount(edges)
    first = order[(np.cumsum(counts) - counts)[counts == 2]]
    second = order[(np.cumsum(counts) - counts)[counts == 2] + 1]
    patch = _components(len(corners), first // 3, second // 3)
    if (number := int(patch.max()) + 1) > _MOST_PATCHES:
        return []
    ends = np.flatnonzero(counts[edges] != 2)
    _, rim = np.unique(edges[ends], return_inverse=True)
    passed = [0] * number  # A bit for each edge that a patch passes an odd number of times.
    for k, edge in zip(patch[ends // 3].tolist(), rim.tolist(), strict=True):
        passed[k] ^= 1 << edge
    is_wanted = np.bincount(patch[wanted], minlength=number) > 0
    pivots, found, total = dict[int, tuple[int, int]](), list[Indices](), 0
    for k in np.argsort(is_wanted, kind="stable").tolist():
        rest, sum_of = passed[k], 1 << k
        while rest and (pivot := pivots.get(rest & -rest)):
            rest, sum_of = rest ^ pivot[0], sum_of ^ pivot[1]
        if rest:
            pivots[rest & -rest] = rest, sum_of
        elif is_wanted[k]:
            found.append(np.flatnonzero(np.array([sum_of >> j & 1 for j in range(number)])[patch]))
            total += len(found[-1])
            if total > _MOST_REPEATED:
                return []
    return found


def _runs(
    members: list[int], bounds: list[int], own: list[int], sum_of: Callable[[int, int], int]
) -> list[list[int]]:
    """Find triangles that follow each other and are closed: the marks of what bounds them add up to 0.

    Args:
        members: Triangles in the order of the file.
        bounds: The sum of the marks of its edges, of each triangle.
        own: A mark of its own, of each triangle: those that add up to 0 too are left out, as they enclose nothing.
        sum_of: How to add marks.
    """
    runs, waiting = list[list[int]](), list[int]()
    edges, areas, at = [0], [0], {0: 0}  # The sums after each that waits; and where each sum of `bounds` is.
    for triangle in members:
        waiting.append(triangle)
        edge, area = sum_of(edges[-1], bounds[triangle]), sum_of(areas[-1], own[triangle])
        since = at.setdefault(edge, len(waiting))
        if since == len(waiting):
            edges.append(edge)
            areas.append(area)
            continue
        if areas[since] != area:
            runs.append(waiting[since:])
        for each in edges[since + 1 :]:
            del at[each]
        del waiting[since:], edges[since + 1 :], areas[since + 1 :]
    return runs


def _apart(corners: Indices, part: Indices) -> Indices:
    """Return triangles, (f, 3), with other corners in each part, so that parts have none in common."""
    _, renamed = np.unique(part[:, None] * (corners.max() + 1) + corners, return_inverse=True)
    return renamed.reshape(-1, 3)


def _without_opposites(corners: Indices) -> Indices:
    """Leave out pairs of triangles with the same corners and opposite orientations, which enclose nothing.

    Args:
        corners: Triangles with three different corners, (f, 3).

    Returns:
        The triangles that are left, (g,).
    """
    if not len(corners):
        return np.zeros(0, dtype=np.int64)
    same, sign = _distinct(corners)
    net = np.bincount(same, weights=sign).astype(np.int64)
    # Of those with the orientation that is left over, keep as many as are left over.
    leading = np.flatnonzero(sign == np.sign(net)[same])
    leading = leading[np.argsort(same[leading], kind="stable")]
    starts = np.flatnonzero(np.diff(same[leading], prepend=-1))
    rank = np.arange(len(leading)) - np.repeat(starts, np.diff(np.append(starts, len(leading))))
    return np.sort(leading[rank < np.abs(net)[same[leading]]])


def _distinct(corners: Indices) -> tuple[Indices, Indices]:
    """Number triangles by their corners, whichever way they are oriented.

    Args:
        corners: Triangles with three different corners, (f, 3).

    Returns:
        The number of each triangle, (f,), and its orientation, 1 or -1, (f,).
    """
    low, middle, high = np.sort(corners, axis=1).T
    count = int(high.max()) + 1
    _, pairs = np.unique(low * count + middle, return_inverse=True)
    _, same = np.unique(pairs * count + high, return_inverse=True)
    return same, np.where(((corners[:, [1, 2, 0]] > corners).sum(axis=1)) == 2, 1, -1)


def _surfaces(corners: Indices) -> tuple[Bools, Indices, Bools, Bools]:
    """Divide triangles into surfaces, each with triangles that are oriented alike.

    Args:
        corners: Triangles, (f, 3).

    Returns:
        Which triangles are turned over, (f,); the surface of each, (f,); which surfaces are closed, (s,); and of which no
        triangle was turned over, (s,).
    """
    number = len(corners)
    if not number:
        return np.zeros(0, bool), np.zeros(0, dtype=np.int64), np.zeros(0, bool), np.zeros(0, bool)
    edges, forward = _edges(corners)
    order = np.argsort(edges, kind="stable")
    counts = np.bincount(edges)
    starts = np.cumsum(counts) - counts
    one, other = order[starts[counts == 2]], order[starts[counts == 2] + 1]
    flipped, patch, sound = _oriented(number, one // 3, other // 3, forward[one] == forward[other])
    turned_over = np.zeros(len(sound), dtype=bool)
    turned_over[patch[flipped]] = True

    # Patches are closed by themselves unless they end at an edge of one triangle, or of more than two.
    ends = np.flatnonzero(counts[edges] != 2)
    sign = np.where(forward[ends] != flipped[ends // 3], 1, -1)
    places, at = np.unique(patch[ends // 3] * (int(edges.max()) + 1) + edges[ends], return_inverse=True)
    net = np.bincount(at, weights=sign, minlength=len(places))
    loose_patch, loose_edge = np.divmod(places[net != 0], int(edges.max()) + 1)
    net = net[net != 0]

    # Those that end at the same edges are one surface.
    by_edge = np.argsort(loose_edge, kind="stable")
    same = loose_edge[by_edge][1:] == loose_edge[by_edge][:-1]
    joined = _components(len(sound), loose_patch[by_edge][1:][same], loose_patch[by_edge][:-1][same])
    closed = np.ones(joined.max() + 1, dtype=bool)
    trusted = closed.copy()
    closed[joined[~sound]] = False
    trusted[joined[turned_over]] = False
    edge_net = np.zeros(int(edges.max()) + 1)
    np.add.at(edge_net, loose_edge, net)
    closed[joined[loose_patch[edge_net[loose_edge] != 0]]] = False
    return flipped, joined[patch], closed, trusted


def _oriented(number: int, one: Indices, other: Indices, contradict: Bools) -> tuple[Bools, Indices, Bools]:
    """Orient triangles like their neighbours.

    Args:
        number: Number of triangles.
        one: Pairs of neighbours, (k,).
        other: Their partners, (k,).
        contradict: Which pairs are oriented differently, (k,).

    Returns:
        Which triangles are turned over, (f,); the patch of connected triangles of each, (f,); and which patches can be
        oriented, (p,): a Klein bottle cannot.
    """
    patch = _components(number, one, other)
    sound = np.ones(patch.max() + 1, dtype=bool)
    if not contradict.any():
        return np.zeros(number, dtype=bool), patch, sound
    # Each triangle occurs twice: as it is, and turned over.
    sides = _components(
        2 * number,
        np.concatenate([one, one + number]),
        np.concatenate([other + number * contradict, other + number * ~contradict]),
    )
    sound[patch[sides[:number] == sides[number:]]] = False
    _, first = np.unique(patch, return_index=True)
    return sides[:number] != sides[first[patch]], patch, sound


def _edges(corners: Indices) -> tuple[Indices, Bools]:
    """Return numbers of the edges of triangles, (3 f,), and in which direction each passes its edge, (3 f,)."""
    ends = corners[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    low, high = ends.min(axis=1), ends.max(axis=1)
    _, edges = np.unique(low * (int(corners.max()) + 1) + high, return_inverse=True)
    return edges.ravel(), ends[:, 0] < ends[:, 1]


def _chained(edges: Indices) -> tuple[Indices, Indices]:
    """Return pairs of triangles that connect all triangles of each edge."""
    order = np.argsort(edges, kind="stable")
    same = edges[order][1:] == edges[order][:-1]
    return order[1:][same] // 3, order[:-1][same] // 3


def _components(number: int, one: Indices, other: Indices) -> Indices:
    """Return the connected component of each of `number` nodes that have edges from `one` to `other`."""
    graphs, sparse = library("scipy.sparse.csgraph"), library("scipy.sparse")
    graph = sparse.coo_matrix((np.ones(len(one), dtype=bool), (one, other)), shape=(number, number))
    _, labels = graphs.connected_components(graph, directed=False)
    return np.asarray(labels, dtype=np.int64)
