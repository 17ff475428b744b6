"""The inside of a mesh: which of its surfaces are closed, and whether they are solid or cavities.

Triangles are joined across edges that belong to exactly two of them, and oriented alike. A surface is closed if each of its
edges is then passed as often in one direction as in the other. Every closed surface is solid by itself, whichever way it is
oriented. So surfaces that overlap do not cancel each other, even if one is inside out. If they share edges or triangles, the
order in the file separates them: the triangles of each follow each other. The only exception is a cavity: a surface wholly
inside a solid one, where the file orients both without contradiction and one opposite to the other.
"""

from __future__ import annotations

import time
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

_BOUNDS = 4
"""Surfaces whose bounds are compared in the time of a comparison with one triangle."""


class Interior:
    """The closed surfaces of a mesh."""

    def __init__(self, vertices: Array, faces: Indices, solid: Indices | None = None) -> None:
        """Find the closed surfaces of triangles.

        Args:
            vertices: Vertices, (k, 3) [m].
            faces: Triangles as indices of vertices, (f, 3).
            solid: Triangles that are in no cavity; None: any may be in one.

        Raises:
            InvalidScene: To find its cavities takes too long.
        """
        _, places = np.unique(vertices.round(SAME), axis=0, return_inverse=True)
        corners = places.ravel()[faces]
        extended = np.flatnonzero((corners != np.roll(corners, 1, axis=1)).all(axis=1))
        corners = corners[extended]
        left, double = _without_opposites(corners)
        if (both_sides := bool(double.any())) or _shares_edges(corners):
            # What is there in both orientations encloses nothing, and would connect parts that share edges with it.
            extended, corners = extended[~double], corners[~double]
            if _shares_edges(corners):
                corners = _apart(corners, _parts(corners))
            left, _ = _without_opposites(corners)
        used = extended[left]
        flipped, surface, closed, self._trusted = _surfaces(corners[left])
        self.faces = faces.copy()
        """Triangles as indices of vertices, (f, 3); those of closed surfaces have their inside behind them."""
        self.faces[used[flipped]] = self.faces[used[flipped], ::-1]

        order = np.argsort(surface, kind="stable")
        order = order[closed[surface[order]]]
        self._used = used[order]
        self._corners = vertices[self.faces[self._used]]
        self._starts = np.flatnonzero(np.diff(surface[order], prepend=-1))
        self._ends = np.append(self._starts[1:], len(order))
        self._trusted = self._trusted[closed]
        may_be = np.ones(len(faces), dtype=np.bool_)
        may_be[[] if solid is None else solid] = False
        self._hollow = np.logical_and.reduceat(may_be[self._used], self._starts) if len(order) else may_be[:0]
        """Which of the surfaces may be cavities."""
        if len(order):
            self._least = np.minimum.reduceat(self._corners.min(axis=1), self._starts)
            self._most = np.maximum.reduceat(self._corners.max(axis=1), self._starts)
        else:
            self._least = self._most = np.zeros((0, 3))
        self._volumes, sums = self._signed_volumes()
        encloses = np.abs(self._volumes) > _FLAT * sums
        # Nothing is left of a mesh of which each triangle is there in both orientations.
        self.closed = bool(len(left) and closed.all() and encloses.all() and not both_sides)
        """Is every surface closed, and does it enclose something?"""
        self._solid = encloses
        self._cavities: dict[int, list[int]] = {}
        self.compared = 0
        """Triangles that surfaces were compared with to find cavities, added up; see `MOST_COMPARED`."""
        self._find_cavities()
        self._turn_outward()

    @property
    def any_solid(self) -> bool:
        """Is one of the surfaces solid?"""
        return bool(self._solid.any())

    @property
    def in_cavities(self) -> Bools:
        """Which of the triangles belong to cavities, (f,)."""
        found = np.zeros(len(self.faces), dtype=np.bool_)
        found[self._used] = np.repeat(self._is_cavity(), self._ends - self._starts)
        return found

    def holds(self, point: Array) -> bool:
        """Return whether a point (3,) lies in a solid surface and in no cavity of it."""
        # A surface that encloses nothing winds around no point, unless the volumes of parts that touch each other cancel.
        in_bounds = (point >= self._least).all(axis=1) & (point <= self._most).all(axis=1)
        near = np.flatnonzero(in_bounds & ~self._is_cavity())
        return not all(
            self._are_around(np.array(self._cavities.get(solid, ()), dtype=np.int64), point).any()
            for solid in near[self._are_around(near, point)].tolist()
        )

    def _are_around(self, surfaces: Indices, point: Array) -> Bools:
        """Return which surfaces, (k,), wind around a point (3,), (k,); after Van Oosterom and Strackee (1983)."""
        if not len(surfaces):
            return np.zeros(0, dtype=np.bool_)
        sizes = self._ends[surfaces] - self._starts[surfaces]
        begins = np.cumsum(sizes) - sizes
        rows = np.arange(sizes.sum()) + np.repeat(self._starts[surfaces] - begins, sizes)
        corners = self._corners[rows] - point
        a, b, c = (corners[:, i] for i in range(3))
        la, lb, lc = (np.linalg.norm(side, axis=1) for side in (a, b, c))
        top = np.einsum("ij,ij->i", a, np.cross(b, c))
        dot = [np.einsum("ij,ij->i", u, v) for u, v in ((a, b), (b, c), (c, a))]
        bottom = la * lb * lc + dot[0] * lc + dot[1] * la + dot[2] * lb
        return np.asarray(np.abs(np.add.reduceat(np.arctan2(top, bottom), begins)) > np.pi)

    def _signed_volumes(self) -> tuple[Array, Array]:
        """Volume of each closed surface, (s,) [m³], negative if it is inside out; and the sum of its parts without signs."""
        if not len(self._starts):
            return np.zeros(0), np.zeros(0)
        origins = np.repeat(self._least, self._ends - self._starts, axis=0)
        a, b, c = (self._corners[:, i] - origins for i in range(3))
        parts = np.einsum("ij,ij->i", a, np.cross(b, c)) / 6
        return np.add.reduceat(parts, self._starts), np.add.reduceat(np.abs(parts), self._starts)

    def _find_cavities(self) -> None:
        """Find the surfaces that are cavities of others, from the largest to the smallest."""
        trusted = self._solid & self._trusted
        inward, volumes, sizes = self._volumes < 0, np.abs(self._volumes), self._ends - self._starts
        both_ways = (inward & trusted).any() and (~inward & trusted).any()
        if not both_ways or len(trusted) > _MOST_SURFACES:
            return
        larger, compared = dict[int, Indices](), 0
        for surface in np.argsort(-volumes, kind="stable").tolist():
            if not (trusted[surface] and self._hollow[surface]):
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
        if not self._are_around(np.array([outer]), self._corners[self._starts[inner], 0])[0]:
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


def _model(corners: Array) -> Any:
    """Return triangles, (f, 3, 3), as coal needs them."""
    return triangles(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))


def _shares_edges(corners: Indices) -> bool:
    """Return whether one edge belongs to more than two triangles."""
    ends = np.sort(corners[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    edges = np.sort(ends[:, 0] * (corners.max(initial=0) + 1) + ends[:, 1])
    return bool((edges[2:] == edges[:-2]).any())


def _parts(corners: Indices) -> Indices:
    """Divide connected triangles into parts, in the order of the file: a part ends as soon as it is closed.

    Args:
        corners: Triangles with three different corners, (f, 3).

    Returns:
        The number of the part of each, (f,). What is not closed at the end is a part, too.
    """
    edges, _ = _edges(corners)
    order = np.argsort(edges, kind="stable")
    counts = np.bincount(edges)
    starts = np.cumsum(counts) - counts
    earlier = np.empty(len(edges), dtype=np.int64)  # Triangles before this one that pass the edge.
    earlier[order] = np.arange(len(edges)) - starts[edges[order]]
    opened = np.where(earlier % 2 == 0, 1, -1).reshape(-1, 3).sum(axis=1)

    component = _components(len(corners), *_chained(edges))
    order = np.argsort(component, kind="stable")
    first = np.diff(component[order], prepend=-1) > 0
    still_open = np.cumsum(opened[order])
    still_open -= (still_open - opened[order])[first][component[order]]
    begins = first | np.append(True, still_open[:-1] == 0)
    part = np.empty(len(corners), dtype=np.int64)
    part[order] = np.cumsum(begins) - 1
    return part


def _apart(corners: Indices, part: Indices) -> Indices:
    """Return triangles, (f, 3), with other corners in each part, so that parts have none in common."""
    _, renamed = np.unique(part[:, None] * (corners.max() + 1) + corners, return_inverse=True)
    return renamed.reshape(-1, 3)


def _without_opposites(corners: Indices) -> tuple[Indices, Bools]:
    """Leave out pairs of triangles with the same corners and opposite orientations, which enclose nothing.

    Args:
        corners: Triangles with three different corners, (f, 3).

    Returns:
        The triangles that are left, (g,), and which of those that are left out make surfaces that are closed, (f,).
    """
    if not len(corners):
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.bool_)
    low, middle, high = np.sort(corners, axis=1).T
    count = int(high.max()) + 1
    _, pairs = np.unique(low * count + middle, return_inverse=True)
    _, first, same = np.unique(pairs * count + high, return_index=True, return_inverse=True)
    sign = np.where(((corners[:, [1, 2, 0]] > corners).sum(axis=1)) == 2, 1, -1)
    net = np.bincount(same, weights=sign).astype(np.int64)
    # Of those with the orientation that is left over, keep as many as are left over.
    leading = np.flatnonzero(sign == np.sign(net)[same])
    leading = leading[np.argsort(same[leading], kind="stable")]
    starts = np.flatnonzero(np.diff(same[leading], prepend=-1))
    rank = np.arange(len(leading)) - np.repeat(starts, np.diff(np.append(starts, len(leading))))
    left = np.sort(leading[rank < np.abs(net)[same[leading]]])
    zero = np.flatnonzero(net == 0)
    return left, np.isin(same, zero[_in_closed_parts(corners[first[zero]])])


def _in_closed_parts(corners: Indices) -> Bools:
    """Return which triangles, (f, 3), are in a connected part with an even number of them at each edge, (f,)."""
    if not len(corners):
        return np.zeros(0, dtype=np.bool_)
    edges, _ = _edges(corners)
    part = _components(len(corners), *_chained(edges))
    odd = np.bincount(edges) % 2 == 1
    is_open = np.zeros(part.max() + 1, dtype=bool)
    is_open[part[np.flatnonzero(odd[edges]) // 3]] = True
    return ~is_open[part]


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
