"""The exhaustive search of a window against a plain one: same leaf, same error, same counts, same order."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import kinseek
from chains import serial_chains
from inlined import inlined
from kinseek.kernels.grid.memory import (
    LAYOUT,
    MADE_FOR,
    MOST_LANES,
    Beam,
    Window,
    lay_grid_scratch,
    make_beam,
    make_grid_scratch,
    make_node_scratch,
    memory_size,
)
from kinseek.kernels.grid.window import nodes_until, offer, search_window, split_depth, window_nodes
from kinseek.kernels.layout import Layout, floats, named
from kinseek.problem import Problem
from kinseek.robots.chain import SerialChain
from kinseek.solvers.brute_force import equation_1
from reference import exhaustive, node_values

EVERYTHING = 1 << 62


def window_of(chain: SerialChain, size: int, nodes: list[list[int]]) -> Window:
    most = max(len(row) for row in nodes)
    values = node_values(chain, size, nodes)
    padded = np.full((chain.dof, most), np.nan)
    numbers = np.full((chain.dof, most), -1, dtype=np.int64)
    for d, row in enumerate(nodes):
        padded[d, : len(row)], numbers[d, : len(row)] = values[d], row
    return Window(padded, numbers, np.array([len(row) for row in nodes], dtype=np.int64))


def search(
    chain: SerialChain,
    goal: kinseek.Goal,
    window: Window,
    *,
    keep: int = 1,
    stop: float = -1.0,
    budget: int = EVERYTHING,
) -> tuple[Beam, int, bool]:
    beam = make_beam(keep, chain.dof)
    arrays = Problem(chain, goal).arrays
    return beam, *search_window(arrays, goal.arrays, window, stop, budget, beam, make_node_scratch(chain.dof))


def best_first(beam: Beam) -> np.ndarray:
    """Order of the filled places of a beam, best first, ties by node."""
    filled = np.flatnonzero(np.isfinite(beam.errors))
    return np.asarray(filled[np.lexsort((*beam.nodes[filled].T[::-1], beam.errors[filled]))])


@pytest.mark.slow
@given(serial_chains(), st.integers(0, 2**32 - 1), st.data())
@settings(max_examples=60)
def test_random_chains_agree_with_the_twin(chain: SerialChain, seed: int, data: st.DataObject) -> None:
    rng = np.random.default_rng(seed)
    counts = [data.draw(st.integers(1, 3)) for _ in range(chain.dof)]
    nodes = [sorted(int(i) for i in rng.choice(50, count, replace=False)) for count in counts]
    goal = kinseek.Goal.pose(
        kinseek.pose(rng.normal(size=3), rotvec=rng.normal(size=3)), orientation_weight=0.3
    )
    plain = exhaustive(chain, goal, 50, nodes)
    window = window_of(chain, 50, nodes)
    beam, leaves, early = search(chain, goal, window)
    assert beam.errors[0] == pytest.approx(plain.error, rel=1e-9, abs=1e-11)
    if tuple(beam.nodes[0]) != plain.nodes:  # Then the two are as good as each other.
        again = exhaustive(chain, goal, 50, [[int(node)] for node in beam.nodes[0]])
        assert again.error == pytest.approx(plain.error, rel=1e-9, abs=1e-11)
    assert (leaves, window_nodes(window.counts), early) == (plain.leaves, plain.expanded, False)


@pytest.mark.parametrize("name", ["planar2", "scara4", "irb5400"])
def test_the_beam_holds_the_best_leaves(name: str) -> None:
    arm = kinseek.load(name)
    goal = kinseek.Goal.pose(arm.fk(arm.lower + 0.4 * (arm.upper - arm.lower)))
    nodes = [[1, 4, 7]] * arm.dof
    window = window_of(arm.chain, 9, nodes)
    everything, leaves, _ = search(arm.chain, goal, window, keep=3**arm.dof)
    assert leaves == 3**arm.dof == len(best_first(everything))
    few, _, _ = search(arm.chain, goal, window, keep=5)
    np.testing.assert_array_equal(np.sort(few.errors), np.sort(everything.errors)[:5])


def test_order_is_the_papers_and_a_stop_ends_it() -> None:
    arm = kinseek.load("scara4")
    goal = kinseek.Goal.pose(arm.fk(arm.lower + 0.4 * (arm.upper - arm.lower)))
    nodes = [[0, 2, 5], [1, 3], [0, 6, 7], [2, 4, 6]]
    window = window_of(arm.chain, 9, nodes)
    everything, _, _ = search(arm.chain, goal, window, keep=54)
    ranks = best_first(everything)
    threshold = float(everything.errors[ranks[10]])
    below = {tuple(everything.nodes[k]) for k in ranks if everything.errors[k] < threshold}
    order = [(a, b, c, d) for a in nodes[0] for b in nodes[1] for c in nodes[2] for d in nodes[3]]
    first = next(i for i, leaf in enumerate(order) if leaf in below)
    beam, leaves, early = search(arm.chain, goal, window, stop=threshold)
    assert (leaves, early) == (first + 1, True)
    assert beam.errors[0] < threshold


@pytest.mark.parametrize("budget", [1, 7, 53, 54])
def test_a_budget_is_kept_to_the_leaf(budget: int) -> None:
    arm = kinseek.load("scara4")
    goal = kinseek.Goal.pose(arm.fk(arm.lower + 0.1))
    window = window_of(arm.chain, 9, [[0, 2, 5], [1, 3], [0, 6, 7], [2, 4, 6]])
    _, leaves, early = search(arm.chain, goal, window, budget=budget)
    assert (leaves, early) == (budget, budget < 54)


def test_a_joint_with_more_values_than_the_table_holds() -> None:
    arm = kinseek.load("planar2")
    size = MOST_LANES + 5
    goal = kinseek.Goal.pose(arm.fk([2 * np.pi * (size // 3) / size, 6.2825]))
    window = window_of(arm.chain, size, [[0, size // 3], list(range(size))])
    assert split_depth(arm.chain.arrays, window.counts) == 2
    beam, leaves, _ = search(arm.chain, goal, window)
    assert leaves == 2 * size
    assert beam.nodes[0, 1] == size - 1


@given(st.lists(st.integers(1, 4), min_size=1, max_size=5), st.data())
def test_nodes_until_counts_a_depth_first_search(counts: list[int], data: st.DataObject) -> None:
    leaves = int(np.prod(counts))
    leaf = data.draw(st.integers(0, leaves - 1))
    expanded = set()
    for number in range(leaf + 1):
        path = np.unravel_index(number, counts)
        expanded |= {tuple(map(int, path[: d + 1])) for d in range(len(counts))}
    assert nodes_until(np.array(counts), leaf) == len(expanded)
    assert nodes_until(np.array(counts), leaves - 1) == window_nodes(np.array(counts))


def test_equation_1() -> None:
    assert equation_1(60, 4) == 13_179_660
    assert equation_1(1, 6) == 6
    assert window_nodes(np.full(4, 60)) == 13_179_660


def test_beams_refuse_twins() -> None:
    beam = make_beam(2, 1)
    assert offer(beam, 0.5, np.array([1]), np.array([0.1])) == np.inf
    assert offer(beam, 0.5, np.array([1]), np.array([0.1])) == np.inf
    assert offer(beam, 0.7, np.array([2]), np.array([0.2])) == 0.7
    assert offer(beam, 0.9, np.array([3]), np.array([0.3])) == 0.7
    assert sorted(beam.errors) == [0.5, 0.7]
    assert beam.nodes[best_first(beam)].ravel().tolist() == [1, 2]


@pytest.mark.parametrize(
    ("dof", "most", "cells", "children"), [(1, 1, 1, 1), (2, 7, 1, 1), (6, 3, 64, 2), (7, 9, 5, 5)]
)
def test_a_bench_fills_its_memory_and_no_part_lies_over_another(
    dof: int, most: int, cells: int, children: int
) -> None:
    memory = np.zeros(LAYOUT.count.of(dof=dof, most=most, cells=cells, children=children))
    grid_scratch = inlined(lay_grid_scratch)(memory.ctypes.data, dof, most, cells, children)
    parts = [array for bundle in grid_scratch for array in bundle]
    for part in parts:
        begin = (part.ctypes.data - memory.ctypes.data) // 8
        memory[begin : begin + part.size] += 1
    np.testing.assert_array_equal(memory, 1)
    assert inlined(LAYOUT.size)(dof, most, cells, children) == len(memory)
    beam = (cells,), (cells, dof), (cells, dof)
    assert [part.shape for part in parts] == [
        *((9, MOST_LANES), (MOST_LANES,), (dof + 1, 3, 4), (dof,), (dof,)),
        *((dof, most), (dof, most), (dof,)),
        *beam,
        *beam,
        *((children,), (children, dof), (children, dof)),
    ]
    given = dof, most, cells, children
    larger = np.zeros(memory_size(*given))
    lanes = inlined(make_grid_scratch)(larger, *given).scratch.lanes
    assert lanes.ctypes.data % 64 == 0
    assert larger.ctypes.data <= lanes.ctypes.data <= larger.ctypes.data + larger.nbytes - memory.nbytes


def test_a_layout_for_other_numbers_than_an_arms() -> None:
    cells = named("cells")
    square = Layout(
        Beam, MADE_FOR, "square", errors=floats(cells, cells), nodes=floats(2), q=floats(cells, 3)
    )
    assert square.count.of(cells=5) == 25 + 2 + 15
    assert str(square.count) == "(1 * cells * cells + 3 * cells + 2)"
