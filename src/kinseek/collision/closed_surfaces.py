"""The closed surfaces of triangles, from how they are connected.

Triangles are joined across edges that belong to exactly two of them, and oriented alike. A surface is closed if each of its
edges is then passed as often in one direction as in the other. The order of the file separates bodies that share edges or
triangles: the triangles of each follow each other. Where connected triangles do not consist of such bodies, all that they
enclose is solid.
"""

from __future__ import annotations

from math import gcd
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

_MOST_REPEATED = 2**18
"""Most triangles that are repeated because they belong to several closed surfaces."""

MOST_COMBINED = 2**22
"""Most numbers that elimination combines: some seconds."""

_PEELINGS = 50
"""Rounds in which patches that enclose nothing are left out."""


class ClosedSurfaces(NamedTuple):
    """Triangles and their closed surfaces."""

    faces: Indices
    """The triangles as indices of vertices, and again those that belong to several surfaces; those of a surface are oriented
    alike, (g, 3)."""
    surface: Indices
    """The number of the closed surface of each, `OPEN` if there is none, (g,)."""
    oriented: Bools
    """Which surfaces the file orients without contradiction, (s,)."""
    whole: bool
    """Do all triangles belong to closed surfaces?"""
    combined: int
    """How many numbers elimination combined."""


def closed_surfaces(vertices: Array, faces: Indices) -> ClosedSurfaces:
    """Find the closed surfaces of triangles.

    Args:
        vertices: Vertices, (k, 3) [m].
        faces: Triangles as indices of vertices, (f, 3).
    """
    _, places = np.unique(vertices.round(SAME), axis=0, return_inverse=True)
    corners = places.ravel()[faces]
    extended = np.flatnonzero((corners != np.roll(corners, 1, axis=1)).all(axis=1))
    corners = corners[extended]
    from_file, turned = (np.full(len(corners), each, dtype=np.bool_) for each in (True, False))
    combined = 0
    if _shares_edges(corners):
        parts, combined = _parts(corners)
        sizes = [len(part.rows) for part in parts]
        rows, turned = (np.concatenate([part[k] for part in parts]) for k in (0, 1))
        from_file = np.repeat([part.from_file for part in parts], sizes)
        extended, corners = extended[rows], _apart(corners[rows], np.repeat(np.arange(len(parts)), sizes))
        corners[turned] = corners[turned, ::-1]
        _, first = np.unique(extended, return_index=True)
        again = np.delete(np.arange(len(extended)), first)
        faces = np.concatenate([faces, faces[extended[again]]])
        extended[again] = np.arange(len(faces) - len(again), len(faces))
    flipped, surface, closed, trusted = _surfaces(corners)
    trusted[surface[~from_file]] = False
    faces, turned = faces.copy(), extended[flipped != turned]
    faces[turned] = faces[turned, ::-1]
    found = np.full(len(faces), OPEN)
    found[extended] = np.where(closed, np.cumsum(closed) - 1, OPEN)[surface]
    return ClosedSurfaces(faces, found, trusted[closed], bool(closed.all()), combined)


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
    marks: tuple[list[int], list[int]]
    """Numbers for what bounds each triangle, and for itself; they add up to 0 if they cancel."""


def _triangles(corners: Indices) -> _Triangles:
    """Mark triangles with three different corners, (f, 3)."""
    edges, forward = _edges(corners)
    same, sign = _distinct(corners)
    # Who makes a file must not know the marks, or other sets could add up to 0.
    random = np.random.default_rng()
    of_edge, own = (random.integers(1, 2**60, int(k.max()) + 1)[k] for k in (edges, same))
    around = (of_edge * np.where(forward, 1, -1)).reshape(-1, 3).sum(axis=1)
    return _Triangles(corners, edges.reshape(-1, 3), same, (around.tolist(), (own * sign).tolist()))


class _Part(NamedTuple):
    """Triangles that are examined for closed surfaces by themselves."""

    rows: Indices
    """The triangles, (k,); they may be in other parts, too."""
    turned: Bools
    """Which of them are turned over, (k,)."""
    from_file: bool
    """Are they oriented as in the file?"""


def _parts(corners: Indices) -> tuple[list[_Part], int]:
    """Divide triangles into bodies, what encloses nothing, and what other groups enclose.

    Args:
        corners: Triangles with three different corners, (f, 3).

    Returns:
        The parts, and how many numbers elimination combined. A repeated triangle may be in no part.
    """
    all_of = _triangles(corners)
    edges, same = all_of.edges, all_of.same
    once = _once(np.arange(len(corners)), same)
    members = np.flatnonzero(np.isin(same, same[once[_may_enclose(edges[once])]]))
    group = np.full(len(corners), OPEN)
    group[members] = _components(len(members), *_chained(edges[members].ravel()))
    members = members[np.argsort(group[members], kind="stable")]
    shared = _share_edges(edges, group, members)
    clean, closed, others = _bodies(all_of, group, members[shared])
    once = _once(others, same)
    mixed = _share_edges(edges, group, once)
    # Of the others, only repeated triangles hid that each edge belongs to two.
    bodies = [*_divided(members[~shared], group), *clean, *_divided(once[~mixed], group)]
    groups = set(group[once[mixed]].tolist())
    closed = [run for run in closed if int(group[run[0]]) in groups]
    solids, combined = _solids(all_of, group, once[mixed], closed)
    used = np.concatenate([members[:0], *bodies, *(rows for rows, _ in solids)])
    bodies.append(np.flatnonzero(~np.isin(same, same[used])))
    parts = [_Part(rows, np.zeros(len(rows), dtype=np.bool_), True) for rows in bodies]
    return parts + [_Part(rows, turned, False) for rows, turned in solids], combined


def _may_enclose(edges: Indices) -> Bools:
    """Leave out patches of triangles that end at an edge of one triangle alone, then those that do so without them.

    Args:
        edges: The edges of each triangle, none of which is repeated, (f, 3).

    Returns:
        Which triangles are left, (f,). After `_PEELINGS` rounds some may be left that enclose nothing.
    """
    left = np.arange(len(edges))
    for _ in range(_PEELINGS):
        around = edges[left]
        counts = np.bincount(around.ravel())
        ends = (counts[around] == 1).any(axis=1)
        if not ends.any():
            break
        patch = _patches(around, counts)
        left = left[~np.isin(patch, patch[ends])]
    found = np.zeros(len(edges), dtype=np.bool_)
    found[left] = True
    return found


def _share_edges(edges: Indices, group: Indices, members: Indices) -> Bools:
    """Return which of the members, (m,), are in a group in which an edge belongs to more than two of them, (m,)."""
    around = edges[members]
    shared = (np.bincount(around.ravel())[around] > 2).any(axis=1)
    return np.isin(group[members], group[members[shared]])


def _divided(members: Indices, group: Indices) -> list[Indices]:
    """Return the members of each group."""
    members = members[np.argsort(group[members], kind="stable")]
    return np.split(members, np.flatnonzero(np.diff(group[members])) + 1) if len(members) else []


def _once(triangles: Indices, number: Indices) -> Indices:
    """Return the first one of the triangles that have the same number."""
    _, first = np.unique(number[triangles], return_index=True)
    return np.asarray(triangles[np.sort(first)])


def _bodies(
    all_of: _Triangles, group: Indices, members: Indices
) -> tuple[list[Indices], list[Indices], Indices]:
    """Find the bodies of groups that consist of them: triangles that follow each other and are closed.

    These pass each edge as often in one direction as in the other, and none of them is repeated. A body that is there
    several times counts once.

    Args:
        all_of: All triangles.
        group: The group of each triangle, (f,).
        members: Those of groups, one group after the other, in the order of the file, (m,).

    Returns:
        The triangles of each body, those of closed surfaces of groups that do not consist of them, and all members of such
        groups, (k,).
    """
    runs = dict[bytes, Indices]()
    used = [members[:0]]
    for run in map(np.array, _runs(members.tolist(), *all_of.marks)):
        key = np.unique(all_of.same[run])
        if len(key) == len(run):
            used.append(run)
            runs.setdefault(key.tobytes(), run)
    mixed = np.unique(group[np.setdiff1d(members, np.concatenate(used))])
    others = set(mixed.tolist())
    clean = [run for run in runs.values() if int(group[run[0]]) not in others]
    closed = [run for run in runs.values() if int(group[run[0]]) in others]
    return clean, closed, members[np.isin(group[members], mixed)]


def _solids(
    all_of: _Triangles, group: Indices, once: Indices, closed: list[Indices]
) -> tuple[list[tuple[Indices, Bools]], int]:
    """Find closed surfaces that enclose all that groups of triangles enclose.

    All others are sums and differences of these. So where one of them winds around a point, one that is returned does.

    Args:
        all_of: All triangles.
        group: The group of each triangle, (f,).
        once: The different triangles of the groups, (m,).
        closed: The triangles of surfaces that are known to be closed.

    Returns:
        The triangles of each, and which are turned over, (k,) each; and how many numbers elimination combined.
    """
    same = all_of.same
    used = np.concatenate([once[:0], *closed])
    private = np.bincount(same[used], minlength=len(same))[same] == 1
    # The others can do without one triangle of each.
    opened = np.concatenate([once[:0], *(run[private[run]][:1] for run in closed)])
    once = once[~np.isin(same[once], same[opened])]
    once = once[_may_enclose(all_of.edges[once])]
    found = [(run, np.zeros(len(run), dtype=np.bool_)) for run in closed]
    cycles, combined = _cycles(all_of.corners[once], group[once])
    return found + [(once[rows], turned) for rows, turned in cycles], combined


def _cycles(corners: Indices, group: Indices) -> tuple[list[tuple[Indices, Bools]], int]:
    """Return a basis of the closed surfaces that triangles form with those of their group.

    This is Gaussian elimination with whole numbers, of patches that end only where other than two triangles meet.

    Args:
        corners: Different triangles, (f, 3).
        group: The group of each, (f,).

    Returns:
        The triangles of each, as often as they belong to it, and which are turned over; and how many numbers were combined.
        Not all surfaces if these are more than `MOST_COMBINED`, or if more than `_MOST_REPEATED` triangles are repeated.
    """
    if not len(corners):
        return [], 0
    edges, forward = _edges(corners)
    one, other = _across(edges, np.bincount(edges))
    flipped, patch, sound = _oriented(len(corners), one // 3, other // 3, forward[one] == forward[other])
    by_patch, sizes = np.argsort(patch, kind="stable"), np.bincount(patch)
    starts = np.cumsum(sizes) - sizes
    ended, ends, times = _ends(edges, np.where(forward != np.repeat(flipped, 3), 1, -1), patch)
    since = np.searchsorted(ended, np.arange(len(sound) + 1))
    found = list[tuple[Indices, Bools]]()
    combined, repeated = 0, -len(corners)
    pivots = dict[int, tuple[dict[int, int], dict[int, int]]]()
    _, first = np.unique(patch, return_index=True)
    patches = np.bincount(group[first])
    # Groups with few patches first: those with many may exhaust what is allowed.
    for k in np.lexsort((group[first], patches[group[first]])).tolist():
        if not sound[k]:
            continue
        own = slice(since[k], since[k + 1])
        rest, sum_of = dict(zip(ends[own].tolist(), times[own].tolist(), strict=True)), {k: 1}
        while rest and (pivot := pivots.get(edge := min(rest))):
            combined += sum(map(len, (rest, sum_of, *pivot)))
            if combined > MOST_COMBINED:
                return found, combined
            rest, sum_of = _without(edge, (rest, sum_of), pivot)
        if rest:
            pivots[min(rest)] = rest, sum_of
            continue
        repeated += sum(abs(n) * int(sizes[j]) for j, n in sum_of.items())
        if repeated > _MOST_REPEATED:
            return found, combined
        parts = [
            (np.repeat(by_patch[starts[j] : starts[j] + sizes[j]], abs(n)), n < 0) for j, n in sum_of.items()
        ]
        rows = np.concatenate([each for each, _ in parts])
        turned = np.concatenate([flipped[each] != turned for each, turned in parts])
        found.append((rows, turned))
    return found, combined


def _ends(edges: Indices, ways: Indices, patch: Indices) -> tuple[Indices, Indices, Indices]:
    """Return how often each patch passes the edges at which it ends, in their directions.

    Args:
        edges: The edges of triangles, (3 f,).
        ways: In which direction, 1 or -1, (3 f,).
        patch: The patch of each triangle, (f,).

    Returns:
        Patches in ascending order, edges, and how often the patch passes the edge, (k,) each. Of edges at which the same
        patches end in the same way, only one.
    """
    number = int(edges.max()) + 1
    keys, at = np.unique(np.repeat(patch, 3) * number + edges, return_inverse=True)
    times = np.zeros(len(keys), dtype=np.int64)
    np.add.at(times, at, ways)
    patches, ends = np.divmod(keys[times != 0], number)
    times = times[times != 0]
    # Edges are equal if the marks of their patches add up to the same.
    marks, sums = (
        np.random.default_rng().integers(1, 2**40, int(patch.max()) + 1),
        np.zeros(number, dtype=np.int64),
    )
    np.add.at(sums, ends, times * marks[patches])
    _, first = np.unique(np.abs(sums), return_index=True)
    kept = np.isin(ends, first)
    return patches[kept], ends[kept], times[kept]


_Sum = tuple[dict[int, int], dict[int, int]]
"""How often a sum of patches passes edges at which it ends, and how often each patch belongs to it."""


def _without(edge: int, one: _Sum, other: _Sum) -> _Sum:
    """Return a multiple of one sum plus one of another, such that an edge is not passed."""
    times, less = other[0][edge], one[0][edge]
    found = list[dict[int, int]]()
    for a, b in zip(one, other, strict=True):
        both = {k: times * n for k, n in a.items()}
        for k, n in b.items():
            both[k] = both.get(k, 0) - less * n
        found.append({k: n for k, n in both.items() if n})
    most = gcd(*(n for each in found for n in each.values()))
    rest, sum_of = ({k: n // most for k, n in each.items()} for each in found)
    return rest, sum_of


def _runs(members: list[int], bounds: list[int], own: list[int]) -> list[list[int]]:
    """Find triangles that follow each other and are closed: the marks of what bounds them add up to 0.

    Args:
        members: Triangles in the order of the file.
        bounds: The sum of the marks of its edges, of each triangle.
        own: A mark of its own, of each triangle: those that add up to 0 too are left out, as they enclose nothing.
    """
    runs, waiting = list[list[int]](), list[int]()
    edges, areas, at = [0], [0], {0: 0}  # The sums after each that waits; and where each sum of `bounds` is.
    for triangle in members:
        waiting.append(triangle)
        edge, area = edges[-1] + bounds[triangle], areas[-1] + own[triangle]
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


def _patches(edges: Indices, counts: Indices) -> Indices:
    """Return the patch of triangles, with edges (f, 3), that are connected across edges of exactly two of them, (f,)."""
    one, other = _across(edges.ravel(), counts)
    return _components(len(edges), one // 3, other // 3)


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
