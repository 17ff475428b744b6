"""The k-d tree against brute force."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from kinseek.kernels.atlas import tree as neighbours
from kinseek.kernels.atlas.lanes import LANES
from kinseek.kernels.atlas.tree import BESIDE, LEAF_SIZE, MOST_LEVELS, SLACK, Tree, make_tree, sort_tree
from kinseek.kernels.jit import exposed

pytestmark = pytest.mark.jit

Array = NDArray[np.float64]

nearest, scan_beside = exposed(neighbours.nearest), exposed(neighbours.scan_beside)
take_nearest = exposed(neighbours.take_nearest)


def look_up(tree: Tree, point: Array, wanted: int) -> tuple[Array, NDArray[np.int64]]:
    """Squared distances and places in the leaves."""
    distance, index = np.empty(wanted), np.empty(wanted, dtype=np.int64)
    stack, bound, leaf = np.empty(MOST_LEVELS, dtype=np.int64), np.empty(MOST_LEVELS), np.empty(LEAF_SIZE)
    found = nearest(tree, point, wanted, neighbours.Neighbours(distance, index, stack, bound, leaf))
    return distance[:found], index[:found]


def build_tree(points: Array, order: NDArray[np.int64]) -> Tree:
    """A tree of points, (k, dimensions); which of them stands at each place goes into `order`, (k,)."""
    tree = make_tree(*points.shape)
    sort_tree(points, order, tree)
    return tree


def clouds(dimensions: int) -> dict[str, Array]:
    rng = np.random.default_rng(dimensions)
    size = (LEAF_SIZE * 2**7, dimensions)
    return {
        "uniform": rng.uniform(-1, 1, size),
        "clustered": rng.normal(size=size) ** 3,
        "flat": np.hstack([rng.uniform(-1, 1, (size[0], 1)), np.zeros((size[0], dimensions - 1))]),
        "equal": np.ones(size),
        "few values": rng.integers(0, 3, size).astype(float),
    }


@pytest.mark.slow
@pytest.mark.parametrize("dimensions", [1, 2, 5, 9])
@pytest.mark.parametrize("wanted", [1, 8, 40])
def test_neighbours_against_brute_force(dimensions: int, wanted: int) -> None:
    rng = np.random.default_rng(7)
    for name, points in clouds(dimensions).items():
        order = np.empty(len(points), dtype=np.int64)
        tree = build_tree(points, order)
        assert sorted(order) == list(range(len(points))), name
        exact = []
        for point in rng.uniform(-1.5, 1.5, (50, dimensions)):
            distance, index = look_up(tree, point, wanted)
            true = np.sort(((points - point) ** 2).sum(axis=1))[:wanted]
            assert len(set(index)) == wanted, name
            assert (np.diff(distance) >= 0).all(), name
            np.testing.assert_allclose(
                distance, ((points[order[index]] - point) ** 2).sum(axis=1), atol=1e-12
            )
            assert (distance >= true - 1e-12).all(), name
            assert (distance <= SLACK * true + 1e-12).all(), name
            exact.append(distance[0] <= true[0] + 1e-12)
        if name == "uniform":
            assert np.mean(exact) >= 0.3  # SLACK trades some of the very nearest for speed.


@pytest.mark.parametrize("leaves", [1, 2, 64])
def test_a_point_of_the_tree_is_its_own_neighbour(leaves: int) -> None:
    points = np.random.default_rng(leaves).uniform(-1, 1, (LEAF_SIZE * leaves, 4))
    order = np.empty(len(points), dtype=np.int64)
    tree = build_tree(points, order)
    for i in range(0, len(points), 5):
        distance, index = look_up(tree, points[i], 3)
        assert (order[index[0]], distance[0]) == (i, 0.0)


def test_fewer_points_than_wanted() -> None:
    points = np.random.default_rng(0).uniform(-1, 1, (LEAF_SIZE, 3))
    tree = build_tree(points, np.empty(LEAF_SIZE, dtype=np.int64))
    distance, index = look_up(tree, np.zeros(3), 40)
    assert sorted(index) == list(range(LEAF_SIZE))
    np.testing.assert_allclose(distance, np.sort((points**2).sum(axis=1)), atol=1e-15)


def scan(tree: Tree, point: Array, wanted: int) -> list[int]:
    """Places in the leaves, from the quick scan."""
    distance, least = np.empty((BESIDE, LEAF_SIZE)), np.empty(LEAF_SIZE)
    leaf = scan_beside(tree, point, distance, least, LANES)
    return [take_nearest(tree, leaf, distance, least) for _ in range(wanted)]


@pytest.mark.parametrize("dimensions", [1, 2, 5, 9])
def test_the_quick_scan_against_brute_force(dimensions: int) -> None:
    rng = np.random.default_rng(8)
    for name, points in clouds(dimensions).items():
        order = np.empty(len(points), dtype=np.int64)
        tree = build_tree(points, order)
        exact = []
        for point in rng.uniform(-1.5, 1.5, (50, dimensions)):
            index = scan(tree, point, 8)
            true = np.sort(((points - point) ** 2).sum(axis=1))[:8]
            distance = ((points[order[index]] - point) ** 2).sum(axis=1)
            assert len(set(index)) == 8, name
            assert (np.diff(distance) >= 0).all(), name
            assert (distance >= true - 1e-12).all(), name
            exact.append(distance[0] <= true[0] + 1e-12)
        if name == "uniform":
            assert np.mean(exact) >= 0.3


@pytest.mark.parametrize("leaves", [1, 2, 4])
def test_the_quick_scan_of_a_small_tree_finds_every_point_once(leaves: int) -> None:
    points = np.random.default_rng(leaves).uniform(-1, 1, (LEAF_SIZE * leaves, 3))
    order = np.empty(len(points), dtype=np.int64)
    tree = build_tree(points, order)
    index = scan(tree, np.zeros(3), len(points) + 2)
    assert index[-2:] == [-1, -1]
    assert sorted(index[:-2]) == list(range(len(points)))
    distance = (points[order[index[:-2]]] ** 2).sum(axis=1)
    assert (np.diff(distance) >= 0).all()
