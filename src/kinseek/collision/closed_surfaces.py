"""The closed surfaces of triangles, from how they are connected.

Triangles are joined across edges that belong to exactly two of them, and oriented alike. A surface is closed if each of its
edges is then passed as often in one direction as in the other. The order of the file separates bodies that share edges or
triangles: the triangles of each follow each other. What encloses something without belonging to such a body is closed, too.
"""

from __future__ import annotations

from collections.abc import Callable
from operator import add, xor
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .geometry import library

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Bools = NDArray[np.bool_]

SAME = 9
"""Vertices whose coordinates agree to this many decimals are one."""

OPEN = -1
"""In place of the number of a closed surface: the triangle belongs to none."""

_MOST_PATCHES, _MOST_REPEATED = 1000, 2**18
"""Most patches of connected triangles for which `_cycles` takes its time, and most triangles that are repeated."""

_PEELINGS = 50
"""Rounds in which triangles that enclose nothing are left out."""


def closed_surfaces(vertices: Array, faces: Indices) -> tuple[Indices, Indices, Bools, bool]:
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


def _shares_edges(corners: Indices) -> bool:
    """Return whether one edge belongs to more than two triangles."""
    ends = np.sort(corners[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    edges = np.sort(ends[:, 0] * (corners.max(initial=0) + 1) + ends[:, 1])
    return bool((edges[2:] == edges[:-2]).any())


class _Triangles(NamedTuple):
    """Triangles, and what shows which of them are closed."""

    corners: Indices
    """Three different corners of each, (f, 3)."""
    edges: Indices
    """Numbers of the edges of each, (f, 3)."""
    same: Indices
    """A number that only triangles with the same corners share, (f,)."""
    oriented: Indices
    """A number that only those share which are oriented alike, too, (f,)."""
    directed: tuple[list[int], list[int]]
    """Marks of what bounds each triangle, and of itself; they add up to 0 if they cancel."""
    even: tuple[list[int], list[int]]
    """The same whichever way they are oriented; they add up to 0 modulo 2, in each bit, if each is there an even number of
    times."""


def _triangles(corners: Indices) -> _Triangles:
    """Mark triangles with three different corners, (f, 3)."""
    edges, forward = _edges(corners)
    same, sign = _distinct(corners)
    # Who makes a file must not know the marks, or other sets could add up to 0.
    random = np.random.default_rng()
    of_edge, own = (random.integers(1, 2**60, int(k.max()) + 1)[k] for k in (edges, same))
    around = (of_edge * np.where(forward, 1, -1)).reshape(-1, 3).sum(axis=1)
    return _Triangles(
        corners,
        edges.reshape(-1, 3),
        same,
        2 * same + (sign > 0),
        (around.tolist(), (own * sign).tolist()),
        (np.bitwise_xor.reduce(of_edge.reshape(-1, 3), axis=1).tolist(), own.tolist()),
    )


def _parts(corners: Indices) -> tuple[Indices, Indices, Bools]:
    """Divide connected triangles into parts: bodies in the order of the file, what others enclose, and what is left.

    Args:
        corners: Triangles with three different corners, (f, 3).

    Returns:
        The triangles in parts, (g,), the number of the part of each, (g,), and which are in the order of the file, (g,). A
        triangle may be in several parts; a repeated one may be in none.
    """
    all_of = _triangles(corners)
    may = np.flatnonzero(_may_enclose(all_of.edges, all_of.same))
    edges = all_of.edges[may].ravel()
    component = _components(len(may), *_chained(edges))
    shared = np.zeros(int(component.max(initial=-1)) + 1, dtype=np.bool_)
    shared[component[(np.bincount(edges)[edges] > 2).reshape(-1, 3).any(axis=1)]] = True
    order = np.argsort(component, kind="stable")
    groups = np.split(may[order], np.flatnonzero(np.diff(component[order])) + 1) if len(may) else []
    bodies, enclosed, repeated = list[Indices](), list[Indices](), 0
    left = [np.setdiff1d(np.arange(len(corners)), may)]
    for members, divided in zip(groups, shared.tolist(), strict=True):
        if not divided:
            bodies.append(members)
            continue
        found, rest = _bodies(all_of, members)
        bodies += found
        if not len(rest):
            continue
        once = _once(members, all_of.same)
        cycles = [
            once[each] for each in _cycles(corners[once], np.isin(all_of.same[once], all_of.same[rest]))
        ]
        repeated += sum(map(len, cycles))
        if cycles and repeated <= _MOST_REPEATED:
            enclosed += cycles
            rest = np.setdiff1d(rest, np.concatenate(cycles))
        left.append(rest)
    parts = [*bodies, np.concatenate(left), *enclosed]
    number = np.repeat(np.arange(len(parts)), [len(each) for each in parts])
    return np.concatenate(parts), number, number <= len(bodies)


def _bodies(all_of: _Triangles, members: Indices) -> tuple[list[Indices], Indices]:
    """Find bodies in the order of the file: triangles that follow each other and are closed.

    These pass each edge as often in one direction as in the other. If some are no part of them, they are looked for without
    triangles that are repeated, then with them, then without opposite ones. Then those follow that pass each edge an even
    number of times, and need to be turned over. A body that is there several times counts once.

    Args:
        all_of: All triangles.
        members: Those that are connected, in the order of the file.

    Returns:
        The triangles of each body, and those that are left, unless they only repeat triangles of bodies.
    """
    corners, edges, same, oriented, directed, even = all_of
    plain = [np.array(run) for run in _runs(members.tolist(), *directed, add)]
    bodies, left, opposite = dict[bytes, Indices](), members, members[:0]
    if sum(map(len, plain)) == len(members) and all(len(np.unique(same[run])) == len(run) for run in plain):
        for run in plain:
            bodies.setdefault(np.unique(same[run]).tobytes(), run)
        return [*bodies.values()], members[:0]
    for kinds, marks, sum_of in (
        (oriented, directed, add),
        (None, directed, add),
        (same, directed, add),
        (same, even, xor),
    ):
        pool = np.union1d(left, opposite)
        once = pool if kinds is None else _once(pool, kinds)
        taken, kept = [once[:0]], [once[:0]]
        for run in map(np.array, _runs(once.tolist(), *marks, sum_of)):
            body, key = run, np.unique(same[run])
            if len(key) < len(run):
                body = run[_without_opposites(corners[run])]
                key = np.unique(same[body])
            bodies.setdefault(key.tobytes(), body)
            taken.append(run)
            kept.append(body)
        left = np.setdiff1d(left, np.concatenate(taken))
        # What is there in both orientations may be another body, which comes among the triangles of this one.
        opposite = np.setdiff1d(np.union1d(opposite, np.concatenate(taken)), np.concatenate(kept))
    found = [*bodies.values()]
    pool = np.union1d(left, opposite)
    rest = pool[np.isin(pool, left) | _may_enclose(edges[pool], same[pool])]
    return found, rest[~np.isin(oriented[rest], oriented[np.concatenate([members[:0], *found])])]


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
    return np.isin(same, same[alive])


def _once(triangles: Indices, number: Indices) -> Indices:
    """Return the first one of the triangles that have the same number."""
    _, first = np.unique(number[triangles], return_index=True)
    return np.asarray(triangles[np.sort(first)])


def _cycles(corners: Indices, wanted: Bools) -> list[Indices]:
    """Return sets of triangles that pass each edge an even number of times, if a wanted triangle is in any.

    All other such sets are sums of these. So where one of them winds around a point, one that is returned does. This is
    Gaussian elimination modulo 2, of patches that end only where other than two triangles meet.

    Args:
        corners: Different triangles, (f, 3).
        wanted: Which of them are wanted, (f,).

    Returns:
        The triangles of each; none if no wanted triangle is in any, or if there are too many patches or triangles.
    """
    edges, _ = _edges(corners)
    counts = np.bincount(edges)
    one, other = _across(edges, counts)
    patch = _components(len(corners), one // 3, other // 3)
    if (number := int(patch.max()) + 1) > _MOST_PATCHES:
        return []
    ends = np.flatnonzero(counts[edges] != 2)
    _, rim = np.unique(edges[ends], return_inverse=True)
    passed = [0] * number  # A bit for each edge that a patch passes an odd number of times.
    for k, edge in zip(patch[ends // 3].tolist(), rim.tolist(), strict=True):
        passed[k] ^= 1 << edge
    is_wanted = np.bincount(patch[wanted], minlength=number) > 0
    pivots, found, total, any_wanted = dict[int, tuple[int, int]](), list[Indices](), 0, False
    for k in np.argsort(is_wanted, kind="stable").tolist():
        rest, sum_of = passed[k], 1 << k
        while rest and (pivot := pivots.get(rest & -rest)):
            rest, sum_of = rest ^ pivot[0], sum_of ^ pivot[1]
        if rest:
            pivots[rest & -rest] = rest, sum_of
        else:
            any_wanted |= bool(is_wanted[k])
            found.append(np.flatnonzero(np.array([sum_of >> j & 1 for j in range(number)])[patch]))
            total += len(found[-1])
            if total > _MOST_REPEATED:
                return []
    return found if any_wanted else []


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
    counts = np.bincount(edges)
    one, other = _across(edges, counts)
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


def _across(edges: Indices, counts: Indices) -> tuple[Indices, Indices]:
    """Return where each edge that belongs to exactly two triangles is passed by one and by the other, (k,) each."""
    order, starts = np.argsort(edges, kind="stable"), np.cumsum(counts) - counts
    return order[starts[counts == 2]], order[starts[counts == 2] + 1]


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
