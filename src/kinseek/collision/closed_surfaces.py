"""The closed surfaces of triangles, from how they are connected.

Triangles are joined across edges that belong to exactly two of them, and oriented alike. A surface is closed if each of its
edges then belongs to two triangles. The order of the file separates bodies that share edges or triangles: the triangles of
each follow each other. Where connected triangles do not consist of such bodies, all that they enclose is solid.
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

_MOST_COMBINED = 2**22
"""Most numbers that elimination combines: some seconds."""

_PER_SUM = 16
"""Numbers that are combined in the time that each sum takes in addition."""

_MOST_TIMES = 64
"""A closed surface to which a triangle belongs more often is left out; this prevents overflow."""

_LARGEST = 2**24
"""Largest random factor in a sum of closed surfaces: the windings of several cancel at one point in so many."""

_PEELINGS = 50
"""Rounds in which patches that enclose nothing are left out."""


class ClosedSurfaces(NamedTuple):
    """Triangles and their closed surfaces."""

    faces: Indices
    """The triangles as indices of vertices, such that those of a surface are oriented alike, (f, 3)."""
    surface: Indices
    """The number of the closed surface of each, `OPEN` if there is none, (f,)."""
    times: Indices
    """How often each counts in its surface, negative if it is to be turned over, (f,)."""
    oriented: Bools
    """Which surfaces the file orients without contradiction, (s,)."""
    whole: bool
    """Were all surfaces found, and do all triangles belong to them or repeat those that do?"""
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
    edges, forward = _edges(corners)
    found = _divided(corners, edges, forward)
    in_body = np.flatnonzero(found.body != OPEN)
    apart = _apart(edges[in_body], found.body[in_body])
    flipped, part, closed, oriented = _surfaces(apart, forward[in_body])
    oriented[part[found.both_ways[in_body]]] = False
    faces, turned = faces.copy(), extended[in_body[flipped]]
    faces[turned] = faces[turned, ::-1]
    surface, times = np.full(len(faces), OPEN), np.ones(len(faces), dtype=np.int64)
    surface[extended[in_body]] = np.where(closed, np.cumsum(closed) - 1, OPEN)[part]
    in_sum = np.flatnonzero(found.times != 0)
    groups, number = np.unique(found.group[in_sum], return_inverse=True)
    surface[extended[in_sum]] = number + closed.sum()
    times[extended[in_sum]] = found.times[in_sum]
    return ClosedSurfaces(
        faces,
        surface,
        times,
        np.concatenate([oriented[closed], np.zeros(len(groups), dtype=np.bool_)]),
        found.whole and bool(closed.all()),
        found.combined,
    )


class _Divided(NamedTuple):
    """Triangles that may belong to closed surfaces."""

    body: Indices
    """The number of the body to which each belongs, `OPEN` if to none, (f,)."""
    both_ways: Bools
    """Which are there in the other orientation, too, and belong to no other body, (f,)."""
    group: Indices
    """The number of the group of connected triangles of each, (f,)."""
    times: Indices
    """How often each counts in the sum of closed surfaces of a group that does not consist of bodies, (f,)."""
    whole: bool
    """Do all triangles belong to these, or repeat those that do?"""
    combined: int
    """How many numbers elimination combined."""


def _divided(corners: Indices, edges: Indices, forward: Bools) -> _Divided:
    """Divide triangles into bodies, and groups that do not consist of bodies.

    Args:
        corners: Three different corners of each, (f, 3).
        edges: Its edges, (f, 3), see `_edges`.
        forward: In which direction it passes them, (f, 3).
    """
    number = len(corners)
    body, times = np.zeros(number, dtype=np.int64), np.zeros(number, dtype=np.int64)
    if (np.bincount(edges.ravel()) <= 2).all():
        return _Divided(body, np.zeros(number, dtype=np.bool_), body, times, True, 0)
    all_of = _triangles(corners, edges, forward)
    once = _once(np.arange(number), all_of.same)
    members = np.flatnonzero(np.isin(all_of.same, all_of.same[once[_may_enclose(all_of.edges[once])]]))
    group = np.full(number, OPEN)
    group[members] = _components(len(members), *_chained(all_of.edges[members].ravel()))
    members = members[np.argsort(group[members], kind="stable")]
    shared = _share_edges(all_of.edges, group, members)
    clean, closed, others = _bodies(all_of, group, members[shared])
    once = _once(others, all_of.same)
    mixed = _share_edges(all_of.edges, group, once)
    # Of the others, only repeated triangles hid that each edge belongs to two.
    body[:] = OPEN
    for k, rows in enumerate([members[~shared], once[~mixed], *clean]):
        body[rows] = k
    groups = set(group[once[mixed]].tolist())
    closed = [run for run in closed if int(group[run[0]]) in groups]
    times, complete, combined = _sums(all_of, group, once[mixed], closed)
    used = (body != OPEN) | (times != 0)
    both_ways = np.isin(2 * all_of.same + (all_of.sign < 0), (2 * all_of.same + (all_of.sign > 0))[~used])
    whole = complete and bool(np.isin(all_of.same, all_of.same[used]).all())
    return _Divided(body, both_ways, group, times, whole, combined)


class _Triangles(NamedTuple):
    """Triangles, and what shows which of them are closed."""

    edges: Indices
    """Numbers of the edges of each, (f, 3)."""
    forward: Bools
    """In which direction each passes them, (f, 3)."""
    same: Indices
    """A number that only triangles with the same corners share, (f,)."""
    sign: Indices
    """Of those, 1 or -1 by their orientation, (f,)."""
    marks: tuple[list[int], list[int]]
    """Numbers for what bounds each triangle, and for itself; they add up to 0 if they cancel."""


def _triangles(corners: Indices, edges: Indices, forward: Bools) -> _Triangles:
    """Mark triangles with three different corners, (f, 3)."""
    same, sign = _distinct(corners)
    # Who makes a file must not know the marks, or other sets could add up to 0.
    random = np.random.default_rng()
    of_edge, own = (random.integers(1, 2**60, int(k.max()) + 1)[k] for k in (edges, same))
    around = (of_edge * np.where(forward, 1, -1)).sum(axis=1)
    return _Triangles(edges, forward, same, sign, (around.tolist(), (own * sign).tolist()))


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
        ends = (np.bincount(around.ravel())[around] == 1).any(axis=1)
        if not ends.any():
            break
        patch = _patches(around)
        left = left[~np.isin(patch, patch[ends])]
    found = np.zeros(len(edges), dtype=np.bool_)
    found[left] = True
    return found


def _share_edges(edges: Indices, group: Indices, members: Indices) -> Bools:
    """Return which of the members, (m,), are in a group in which an edge belongs to more than two of them, (m,)."""
    around = edges[members]
    shared = (np.bincount(around.ravel())[around] > 2).any(axis=1)
    return np.isin(group[members], group[members[shared]])


def _once(triangles: Indices, number: Indices) -> Indices:
    """Return the first one of the triangles that have the same number."""
    _, first = np.unique(number[triangles], return_index=True)
    return np.asarray(triangles[np.sort(first)])


def _bodies(
    all_of: _Triangles, group: Indices, members: Indices
) -> tuple[list[Indices], list[Indices], Indices]:
    """Find the bodies of groups that consist of them: triangles that follow each other and are closed.

    Each edge of a body belongs to two of its triangles, which pass it in opposite directions, or to more where it touches
    itself. A body that is there several times counts once.

    Args:
        all_of: All triangles.
        group: The group of each triangle, (f,).
        members: Those of groups, one group after the other, in the order of the file, (m,).

    Returns:
        The triangles of each body, those of closed surfaces of groups that do not consist of them, and all members of such
        groups, (k,).
    """
    found, doubtful = _runs(members.tolist(), *all_of.marks)
    runs, used = dict[bytes, Indices](), [members[:0]]
    for run in map(np.array, found):
        key = np.unique(all_of.same[run])
        if len(key) == len(run):
            used.append(run)
            runs.setdefault(key.tobytes(), run)
    rows = np.concatenate([members[:0], *runs.values()])
    run = np.repeat(np.arange(len(runs)), [len(each) for each in runs.values()])
    crossing = rows[_end_in_sums(_apart(all_of.edges[rows], run), all_of.forward[rows])]
    missed = np.setdiff1d(members, np.concatenate(used))
    mixed = np.unique(group[np.concatenate([missed, crossing, np.array(doubtful, dtype=np.int64)])])
    others = set(mixed.tolist())
    clean = [each for each in runs.values() if int(group[each[0]]) not in others]
    closed = [each for each in runs.values() if int(group[each[0]]) in others]
    return clean, closed, members[np.isin(group[members], mixed)]


def _end_in_sums(edges: Indices, forward: Bools) -> Bools:
    """Return which triangles belong to patches that are not closed by themselves, though their sums are, (f, 3) -> (f,)."""
    if not len(edges):
        return np.zeros(0, dtype=np.bool_)
    patch = _patches(edges)
    ending, _, _ = _ends(edges, np.where(forward, 1, -1), patch)
    return np.isin(patch, ending)


def _runs(members: list[int], bounds: list[int], own: list[int]) -> tuple[list[list[int]], list[int]]:
    """Find triangles that follow each other and are closed: the marks of what bounds them add up to 0.

    Args:
        members: Triangles in the order of the file.
        bounds: The sum of the marks of its edges, of each triangle.
        own: A mark of its own, of each triangle: those that add up to 0 too are left out, as they enclose nothing.

    Returns:
        The triangles of each, and triangles where others end that begin in one of these and end in another.
    """
    runs, waiting, doubtful = list[list[int]](), list[int](), list[int]()
    edges, areas, at = [0], [0], {0: 0}  # The sums after each that waits; and where each sum of `bounds` is.
    inside = dict[int, int]()  # The sums inside those that were found.
    for triangle in members:
        waiting.append(triangle)
        edge, area = edges[-1] + bounds[triangle], areas[-1] + own[triangle]
        if inside.get(edge, area) != area:
            doubtful.append(triangle)
        since = at.setdefault(edge, len(waiting))
        if since == len(waiting):
            edges.append(edge)
            areas.append(area)
            continue
        if areas[since] != area:
            runs.append(waiting[since:])
        for each, its_area in zip(edges[since + 1 :], areas[since + 1 :], strict=True):
            del at[each]
            inside[each] = its_area
        del waiting[since:], edges[since + 1 :], areas[since + 1 :]
    return runs, doubtful


def _sums(
    all_of: _Triangles, group: Indices, once: Indices, closed: list[Indices]
) -> tuple[Indices, bool, int]:
    """Find a closed surface of each group that winds around all that its triangles enclose.

    It is the sum of surfaces of which all others are sums, with random factors: it winds around a point if one of them does.

    Args:
        all_of: All triangles.
        group: The group of each triangle, (f,).
        once: The different triangles of the groups, (m,).
        closed: The triangles of surfaces that are known to be closed.

    Returns:
        How often each triangle counts in the sum of its group, (f,); whether all surfaces were found; and how many numbers
        elimination combined.
    """
    same, sign = all_of.same, all_of.sign
    used = np.concatenate([once[:0], *closed])
    private = np.bincount(same[used], minlength=len(same))[same] == 1
    # The others can do without one triangle of each.
    opened = np.concatenate([once[:0], *(run[private[run]][:1] for run in closed)])
    left = once[~np.isin(same[once], same[opened])]
    left = left[_may_enclose(all_of.edges[left])]
    times, complete, combined = _basis_sum(all_of.edges[left], all_of.forward[left], group[left])
    total = np.zeros(len(same), dtype=np.int64)
    total[same[left]] = sign[left] * times
    factors = np.random.default_rng().integers(1, _LARGEST, len(closed))
    np.add.at(total, same[used], sign[used] * np.repeat(factors, [len(run) for run in closed]))
    found = np.zeros(len(same), dtype=np.int64)
    found[once] = sign[once] * total[same[once]]
    return found, complete, combined


def _basis_sum(edges: Indices, forward: Bools, group: Indices) -> tuple[Indices, bool, int]:
    """Return the sum of a basis of the closed surfaces that triangles form with those of their group, with random factors.

    This is Gaussian elimination with whole numbers, of patches that end only where other than two triangles meet.

    Args:
        edges: Edges of different triangles, (f, 3).
        forward: In which direction they pass them, (f, 3).
        group: The group of each, (f,).

    Returns:
        How often each triangle counts, negative if it is turned over, (f,); whether that is the whole basis, which takes at
        most `_MOST_COMBINED` numbers; and how many numbers were combined.
    """
    if not len(edges):
        return np.zeros(0, dtype=np.int64), True, 0
    flipped, patch, sound = _oriented(edges, forward)
    patches, ends, times = _ends(edges, np.where(forward != flipped[:, None], 1, -1), patch)
    since = np.searchsorted(patches, np.arange(len(sound) + 1))
    _, first = np.unique(patch, return_index=True)
    in_group = np.bincount(group[first])
    factors = np.random.default_rng().integers(1, _LARGEST, len(sound)).tolist()
    total, complete, combined = [0] * len(sound), True, 0
    pivots = dict[int, _Sum]()
    # Groups with few patches first: those with many may exhaust what is allowed.
    for k in np.lexsort((group[first], in_group[group[first]])).tolist():
        if not sound[k]:
            continue
        own = slice(since[k], since[k + 1])
        rest, sum_of = dict(zip(ends[own].tolist(), times[own].tolist(), strict=True)), {k: 1}
        while rest and combined <= _MOST_COMBINED and (pivot := pivots.get(edge := min(rest))):
            combined += _PER_SUM + sum(map(len, (rest, sum_of, *pivot)))
            rest, sum_of = _without(edge, (rest, sum_of), pivot)
        if combined > _MOST_COMBINED:
            complete = False
            break
        if rest:
            pivots[min(rest)] = rest, sum_of
        elif max(map(abs, sum_of.values())) > _MOST_TIMES:
            complete = False
        else:
            for j, n in sum_of.items():
                total[j] += factors[k] * n
    return np.array(total)[patch] * np.where(flipped, -1, 1), complete, combined


def _ends(edges: Indices, ways: Indices, patch: Indices) -> tuple[Indices, Indices, Indices]:
    """Return how often each patch passes the edges at which it ends, in their directions.

    Args:
        edges: The edges of triangles, (f, 3).
        ways: In which direction, 1 or -1, (f, 3).
        patch: The patch of each triangle, (f,).

    Returns:
        Patches in ascending order, edges, and how often the patch passes the edge, (k,) each. Of edges at which the same
        patches end in the same way, only one.
    """
    number = int(edges.max()) + 1
    keys, at = np.unique((patch[:, None] * number + edges).ravel(), return_inverse=True)
    times = np.zeros(len(keys), dtype=np.int64)
    np.add.at(times, at, ways.ravel())
    patches, ends = np.divmod(keys[times != 0], number)
    times = times[times != 0]
    # Edges are equal if the marks of their patches add up to the same, modulo 2**64.
    marks, sums = (
        np.random.default_rng().integers(1, 2**60, int(patch.max()) + 1),
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


def _apart(edges: Indices, part: Indices) -> Indices:
    """Return other numbers of edges, (f, 3), in each part, so that parts have none in common."""
    if not part.any():
        return edges
    _, renamed = np.unique(part[:, None] * (edges.max() + 1) + edges, return_inverse=True)
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


def _surfaces(edges: Indices, forward: Bools) -> tuple[Bools, Indices, Bools, Bools]:
    """Divide triangles into surfaces, each with triangles that are oriented alike.

    Args:
        edges: Edges of triangles, (f, 3). Where more than two meet, surfaces touch themselves.
        forward: In which direction they pass them, (f, 3).

    Returns:
        Which triangles are turned over, (f,); the surface of each, (f,); which surfaces are closed, (s,); and of which no
        triangle was turned over, (s,).
    """
    if not len(edges):
        return np.zeros(0, bool), np.zeros(0, dtype=np.int64), np.zeros(0, bool), np.zeros(0, bool)
    flipped, surface, closed = _oriented(edges, forward)
    closed[surface[(np.bincount(edges.ravel())[edges] == 1).any(axis=1)]] = False
    alike = np.ones(len(closed), dtype=bool)
    alike[surface[flipped]] = False
    return flipped, surface, closed, alike


def _oriented(edges: Indices, forward: Bools) -> tuple[Bools, Indices, Bools]:
    """Orient triangles like their neighbours across edges of exactly two of them.

    Args:
        edges: Edges of triangles, (f, 3).
        forward: In which direction they pass them, (f, 3).

    Returns:
        Which triangles are turned over, (f,); the patch of connected triangles of each, (f,); and which patches can be
        oriented, (p,): a Klein bottle cannot.
    """
    number, (one, other) = len(edges), _across(edges)
    contradict = forward.ravel()[one] == forward.ravel()[other]
    one, other = one // 3, other // 3
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
    """Return numbers of the edges of triangles, (f, 3), and in which direction each passes its edge, (f, 3)."""
    begin, end = corners, corners[:, [1, 2, 0]]
    keys = np.minimum(begin, end) * (int(corners.max(initial=0)) + 1) + np.maximum(begin, end)
    _, edges = np.unique(keys.ravel(), return_inverse=True)
    return edges.reshape(-1, 3), begin < end


def _across(edges: Indices) -> tuple[Indices, Indices]:
    """Return where each edge, (f, 3), of exactly two triangles is passed by one and by the other, (k,) each, of 3 f."""
    counts = np.bincount(edges.ravel())
    order, starts = np.argsort(edges.ravel(), kind="stable"), np.cumsum(counts) - counts
    return order[starts[counts == 2]], order[starts[counts == 2] + 1]


def _patches(edges: Indices) -> Indices:
    """Return the patch of triangles, with edges (f, 3), that are connected across edges of exactly two of them, (f,)."""
    one, other = _across(edges)
    return _components(len(edges), one // 3, other // 3)


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
