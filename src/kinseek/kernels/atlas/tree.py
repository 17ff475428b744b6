"""Nearest neighbours in a balanced k-d tree whose leaves are scanned eight points at a time.

There are two searches. `nearest` walks the tree for any number of points. `scan_beside` and `take_nearest` serve the
first few: every leaf stores its neighbouring leaves, and only these are scanned, without unpredictable branches. The list
of a leaf serves a point in its corner less well, so a nearer point is sometimes missed.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from kinseek.kernels.arrays import Array, Indices
from kinseek.kernels.entry import OUT
from kinseek.kernels.jit import inlined, kernel, noinline
from kinseek.kernels.pointers import part1

from .lanes import LANES

LEAF_SIZE = 8
"""Points in a leaf, which are measured in parallel; a multiple of LANES."""

if LEAF_SIZE < LANES or LEAF_SIZE % LANES != 0:
    raise TypeError(
        f"LEAF_SIZE, the number of points in a leaf of the atlas, must be a positive multiple of {LANES}, got {LEAF_SIZE}"
    )

MOST_LEVELS = 64
"""Nodes that wait in a search, at most one for each level of the tree: more levels than any memory holds."""

SLACK = 4.0
"""A branch is skipped unless it may hold a point closer than the worst one kept by this factor of squared distances."""

MOST_LEAVES = 256
"""Largest number of leaves scanned in one search: a point far from all others has about the same distance from each of
them."""

BESIDE = 12
"""Leaves that `scan_beside` scans, the point's own leaf first; an even number."""

BLOCK = 64
"""Leaves that are passed over at once when the neighbours of a leaf are listed; a power of two. Not examined further."""

if BESIDE % 2 != 0:
    raise TypeError(f"the leaves that are scanned come in pairs, got {BESIDE}, expected an even number")

POSE_DIMENSIONS = 5
"""Coordinates of a pose without a revolute first and last joint, see `samples`; nearly all arms have these."""


class Tree(NamedTuple):
    """A complete binary tree over ``LEAF_SIZE · 2^depth`` points: node i has the children 2i+1 and 2i+2."""

    points: Annotated[Array, "leaves", "used", LEAF_SIZE, OUT]
    """Points leaf by leaf, (leaves, dimensions, LEAF_SIZE)."""
    axis: Annotated[Indices, "inner", OUT]
    """Dimension that each inner node splits, (leaves - 1,); at least one entry."""
    split: Annotated[Array, "inner", OUT]
    """Coordinate of the split, same shape."""
    beside: Annotated[Indices, "leaves", BESIDE, OUT]
    """Leaves whose centres are nearest to that of each leaf, nearest first, padded with -1, (leaves, BESIDE)."""


def make_tree(count: int, dimensions: int) -> Tree:
    """Allocate a tree of k = LEAF_SIZE · 2^depth points."""
    leaves = count // LEAF_SIZE
    inner = max(leaves - 1, 1)
    return Tree(
        np.empty((leaves, dimensions, LEAF_SIZE)),
        np.zeros(inner, dtype=np.int64),
        np.zeros(inner),
        np.full((leaves, BESIDE), -1, dtype=np.int64),
    )


@kernel
def sort_tree(points: Array, order: Indices, tree: Tree) -> None:
    """Build a tree.

    Args:
        points: (k, dimensions), k = LEAF_SIZE · 2^depth.
        order: Receives the index of the point at each place of the leaves, (k,).
        tree: From `make_tree`; allocated by the caller, see `kernels.grid` for the reason.
    """
    count, dimensions = points.shape
    axis, split, packed = tree.axis, tree.split, tree.points
    for i in range(count):
        order[i] = i
    size, level, node = count, 1, 0
    while size > LEAF_SIZE:
        for j in range(level):
            first = j * size
            widest, width = 0, -1.0
            for d in range(dimensions):
                low, high = np.inf, -np.inf
                for i in range(first, first + size):
                    value = points[order[i], d]
                    low, high = min(low, value), max(high, value)
                if high - low > width:
                    widest, width = d, high - low
            middle = first + size // 2
            _select(points, widest, order, first, first + size - 1, middle)
            axis[node], split[node] = widest, points[order[middle], widest]
            node += 1
        size //= 2
        level *= 2
    for i in range(count):
        for d in range(dimensions):
            packed[i // LEAF_SIZE, d, i % LEAF_SIZE] = points[order[i], d]
    _list_leaves_beside(packed, tree.beside)


@noinline
def _list_leaves_beside(points: Array, beside: Indices) -> None:
    """List the neighbours of each leaf in an array that is filled with -1, see `Tree`."""
    leaves, dimensions = points.shape[0], points.shape[1]
    block = min(BLOCK, leaves)  # Both are powers of two.
    centres = np.zeros((dimensions, leaves))
    for leaf in range(leaves):
        for d in range(dimensions):
            for j in range(LEAF_SIZE):
                centres[d, leaf] += points[leaf, d, j] / LEAF_SIZE
    gaps, far = np.empty(BESIDE), np.empty(leaves)
    for leaf in range(leaves):
        for other in range(leaves):
            far[other] = 0.0
        for d in range(dimensions):
            x = centres[d, leaf]
            for other in range(leaves):
                gap = centres[d, other] - x
                far[other] += gap * gap
        far[leaf] = -1.0  # A leaf comes first in its own list, also where leaves coincide.
        # No neighbour is farther away than the farthest one of those in the leaf's own block.
        for b in range(BESIDE):
            gaps[b] = np.inf
        home = leaf - leaf % block
        for other in range(home, home + block):
            _list_if_nearer(far[other], other, gaps, beside[leaf])
        most = gaps[BESIDE - 1]
        for b in range(BESIDE):
            gaps[b], beside[leaf, b] = np.inf, -1
        for first in range(0, leaves, block):
            near = 0
            for i in range(block):
                near += 1 if far[first + i] <= most else 0
            if near > 0:
                for other in range(first, first + block):
                    if far[other] <= most:
                        _list_if_nearer(far[other], other, gaps, beside[leaf])


@inlined
def _list_if_nearer(value: float, other: int, gaps: Array, beside: Indices) -> None:
    """Insert a leaf at a distance into a sorted list, (BESIDE,), behind those that are as near."""
    if value < gaps[BESIDE - 1]:
        at = BESIDE - 1
        while at > 0 and gaps[at - 1] > value:
            gaps[at], beside[at] = gaps[at - 1], beside[at - 1]
            at -= 1
        gaps[at], beside[at] = value, other


@noinline
def _select(points: Array, d: int, order: Indices, first: int, last: int, middle: int) -> None:
    """Partition order[first … last] so that place `middle` holds the element that sorting by dimension d would put there."""
    begin, end = first, last
    for _ in range(end - begin + 1):  # Each pass excludes at least one place.
        if first >= last:
            return
        # Quickselect (Hoare 1961).
        pivot = points[order[(first + last) // 2], d]
        i, j = first, last
        while i <= j:  # i and j come closer in every pass.
            while i < end and points[order[i], d] < pivot:
                i += 1
            while j > begin and points[order[j], d] > pivot:
                j -= 1
            if i <= j:
                order[i], order[j] = order[j], order[i]
                i += 1
                j -= 1
        if middle <= j:
            last = j
        elif middle >= i:
            first = i
        else:
            return


class Neighbours(NamedTuple):
    """The points that a search finds, nearest first, and its scratch memory."""

    distance: Array
    """Squared distances, at least (most,)."""
    place: Indices
    """Places in the leaves, at least (most,)."""
    stack: Indices
    """Scratch memory: nodes that are left, (MOST_LEVELS,)."""
    bound: Array
    """Scratch memory: lower bounds of their squared distances, (MOST_LEVELS,)."""
    leaf: Array
    """Scratch memory: squared distances of the points of a leaf, (LEAF_SIZE,)."""


@inlined
def nearest(tree: Tree, point: Array, most: int, neighbours: Neighbours) -> int:
    """Find the nearest points, nearest first.

    Args:
        tree: The tree to search.
        point: (dimensions,)
        most: Number of points.
        neighbours: Receives the points.

    Returns:
        The number of points found.
    """
    distance, index = neighbours.distance, neighbours.place
    stack, bound, gaps = neighbours.stack, neighbours.bound, neighbours.leaf
    leaves, dimensions = tree.points.shape[0], tree.points.shape[1]
    found, top, scanned = 0, 1, 0
    stack[0], bound[0] = 0, 0.0
    # Branches on the stack have no leaf in common, and each pass removes one.
    for _ in range(leaves):
        if top == 0:
            break
        top -= 1
        node, low = stack[top], bound[top]
        if found == most and (SLACK * low >= distance[found - 1] or scanned >= MOST_LEAVES):
            continue
        while node < leaves - 1:
            gap = point[tree.axis[node]] - tree.split[node]
            near = 2 * node + 1 if gap < 0.0 else 2 * node + 2
            # The children 2i + 1 and 2i + 2 add up to 4i + 3. Distances to planes are not added up, because two of the
            # planes may divide the same dimension.
            stack[top], bound[top] = 4 * node + 3 - near, max(low, gap * gap)
            top += 1
            node = near
        leaf = node - (leaves - 1)
        scanned += 1
        for j in range(LEAF_SIZE):
            gaps[j] = 0.0
        for d in range(dimensions):
            x = point[d]
            for j in range(LEAF_SIZE):
                gap = tree.points[leaf, d, j] - x
                gaps[j] += gap * gap
        for j in range(LEAF_SIZE):
            value = gaps[j]
            if found == most and value >= distance[found - 1]:
                continue
            at = found if found < most else found - 1
            found = min(found + 1, most)
            while at > 0 and distance[at - 1] > value:
                distance[at], index[at] = distance[at - 1], index[at - 1]
                at -= 1
            distance[at], index[at] = value, leaf * LEAF_SIZE + j
    return found


@inlined
def scan_beside(tree: Tree, point: Array, beside: Array, least: Array, w: int) -> int:
    """Compute the distances of the points in the leaves near a point.

    Args:
        tree: The tree to search.
        point: (dimensions,)
        beside: Receives squared distances, (BESIDE, LEAF_SIZE).
        least: Receives the smallest distance at each place of the leaves, (LEAF_SIZE,).
        w: LANES, as a number that is unknown to the compiler, see `lanes`.

    Returns:
        The leaf of the point, for `take_nearest`.
    """
    leaves, dimensions, w = tree.points.shape[0], tree.points.shape[1], w * (LEAF_SIZE // LANES)
    node = 0
    while node < leaves - 1:
        node = 2 * node + (1 if point[tree.axis[node]] < tree.split[node] else 2)
    own: int = node - (leaves - 1)
    # The lists of a tree with fewer than BESIDE leaves are padded, and -1 is no leaf.
    if dimensions == POSE_DIMENSIONS and tree.beside[own, BESIDE - 1] >= 0:
        x0, x1, x2, x3, x4 = point[0], point[1], point[2], point[3], point[4]
        at, size = tree.points.ctypes.data, LEAF_SIZE * POSE_DIMENSIONS
        # Two leaves per iteration, because the overhead of a short loop dominates.
        for b in range(0, BESIDE, 2):
            p, r = (
                part1(at, tree.beside[own, b] * size, size),
                part1(at, tree.beside[own, b + 1] * size, size),
            )
            for j in range(w):
                g0, g1, g2 = p[j] - x0, p[LEAF_SIZE + j] - x1, p[2 * LEAF_SIZE + j] - x2
                g3, g4 = p[3 * LEAF_SIZE + j] - x3, p[4 * LEAF_SIZE + j] - x4
                beside[b, j] = g0 * g0 + g1 * g1 + g2 * g2 + g3 * g3 + g4 * g4
                g0, g1, g2 = r[j] - x0, r[LEAF_SIZE + j] - x1, r[2 * LEAF_SIZE + j] - x2
                g3, g4 = r[3 * LEAF_SIZE + j] - x3, r[4 * LEAF_SIZE + j] - x4
                beside[b + 1, j] = g0 * g0 + g1 * g1 + g2 * g2 + g3 * g3 + g4 * g4
    else:
        for b in range(BESIDE):
            leaf = tree.beside[own, b]
            for j in range(LEAF_SIZE):
                beside[b, j] = 0.0 if leaf >= 0 else np.inf
            for d in range(dimensions if leaf >= 0 else 0):
                x = point[d]
                for j in range(LEAF_SIZE):
                    gap = tree.points[leaf, d, j] - x
                    beside[b, j] += gap * gap
    for j in range(w):
        low = beside[0, j]
        for b in range(1, BESIDE):
            low = min(low, beside[b, j])
        least[j] = low
    return own


@inlined
def take_nearest(tree: Tree, own: int, beside: Array, least: Array) -> int:
    """Remove and return the nearest remaining point after `scan_beside`: its place in the leaves, or -1 if none is left."""
    low, which, place = least[0], 0, 0
    for j in range(1, LEAF_SIZE):
        low = min(low, least[j])
    if low == np.inf:
        return -1
    for j in range(LEAF_SIZE):
        # No early exit from these loops: where they would end is unpredictable.
        place = j if least[j] == low else place
    for b in range(BESIDE):
        which = b if beside[b, place] == low else which
    beside[which, place] = np.inf
    low = np.inf
    for b in range(BESIDE):
        low = min(low, beside[b, place])
    least[place] = low
    found: int = tree.beside[own, which] * LEAF_SIZE + place
    return found
