"""The exhaustive search of a window against a plain one: same leaf, same error, same counts, same order."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import kinseek
from chains import serial_chains
from experiments.arms import equation_1
from inlined import inlined
from kinseek.kernels.grid.memory import (
    LAYOUT,
    LINE,
    MOST_LANES,
    SIZES,
    Beam,
    grid_memory,
    memory_size,
    view_memory,
)
from kinseek.kernels.grid.window import EVERYTHING, FINISHED, STOPPED, nodes_expanded, offer, split_depth
from kinseek.kernels.layout import Layout, floats, named
from kinseek.problem import Problem
from kinseek.robots.chain import SerialChain
from kinseek.solvers.grid_search import GridSearch, Plan, passes_of
from kinseek.solvers.nodes import joint_grid
from kinseek.support.deadline import Deadline
from reference import exhaustive


class Result(NamedTuple):
    beam: Beam
    leaves: int
    expanded: int
    ended: int


def search(
    chain: SerialChain,
    goal: kinseek.Goal,
    size: int,
    nodes: list[list[int]],
    *,
    keep: int = 1,
    stop: float = 0.0,
    budget: int = EVERYTHING,
) -> Result:
    """Search some nodes of each joint of a grid, in one pass."""
    order = [np.array(row, dtype=np.int64) for row in nodes]
    later = np.empty((0, chain.dof), dtype=np.int64)
    passes, leaves, expanded = passes_of(order, later, [1], stop_below=stop, beam=keep)
    assert leaves == math.prod(map(len, nodes))
    plan = Plan(joint_grid(chain, size), passes, 0, leaves, expanded)
    problem, memory = Problem(chain, goal, budget=budget), plan.memory
    whole = GridSearch(problem, plan, "rounding", memory, Deadline(), lambda work: None)
    found = whole.until(1)
    if budget == EVERYTHING and not stop:
        assert found.nodes_expanded == expanded
    sizes = dict(zip(SIZES, plan.sizes, strict=True))
    aligned = memory[(-memory.ctypes.data % LINE) // 8 :]
    beam = Beam(*(LAYOUT.view(f"odd.{field}", aligned, **sizes) for field in Beam._fields))
    return Result(beam, found.evaluations, found.nodes_expanded, whole.ended)


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
    beam, leaves, expanded, ended = search(chain, goal, 50, nodes)
    assert beam.errors[0] == pytest.approx(plain.error, rel=1e-9, abs=1e-11)
    if tuple(beam.nodes[0]) != plain.nodes:  # Then the two are as good as each other.
        again = exhaustive(chain, goal, 50, [[int(node)] for node in beam.nodes[0]])
        assert again.error == pytest.approx(plain.error, rel=1e-9, abs=1e-11)
    assert (leaves, expanded, ended) == (plain.leaves, plain.expanded, FINISHED)


@pytest.mark.parametrize("name", ["planar2", "scara4", "irb5400"])
def test_the_beam_holds_the_best_leaves(name: str) -> None:
    arm = kinseek.load(name)
    goal = kinseek.Goal.pose(arm.fk(arm.lower + 0.4 * (arm.upper - arm.lower)))
    nodes = [[1, 4, 7]] * arm.dof
    everything, leaves, _, _ = search(arm.chain, goal, 9, nodes, keep=3**arm.dof)
    assert leaves == 3**arm.dof == len(best_first(everything))
    few = search(arm.chain, goal, 9, nodes, keep=5).beam
    np.testing.assert_array_equal(np.sort(few.errors), np.sort(everything.errors)[:5])


def test_order_is_the_papers_and_a_stop_ends_it() -> None:
    arm = kinseek.load("scara4")
    goal = kinseek.Goal.pose(arm.fk(arm.lower + 0.4 * (arm.upper - arm.lower)))
    nodes = [[0, 2, 5], [1, 3], [0, 6, 7], [2, 4, 6]]
    everything = search(arm.chain, goal, 9, nodes, keep=54).beam
    ranks = best_first(everything)
    threshold = float(everything.errors[ranks[10]])
    below = {tuple(everything.nodes[k]) for k in ranks if everything.errors[k] < threshold}
    order = [(a, b, c, d) for a in nodes[0] for b in nodes[1] for c in nodes[2] for d in nodes[3]]
    first = next(i for i, leaf in enumerate(order) if leaf in below)
    beam, leaves, _, ended = search(arm.chain, goal, 9, nodes, stop=threshold)
    assert (leaves, ended) == (first + 1, STOPPED)
    assert beam.errors[0] < threshold


def test_a_joint_with_more_values_than_the_table_holds() -> None:
    arm = kinseek.load("planar2")
    size = MOST_LANES + 5
    goal = kinseek.Goal.pose(arm.fk([2 * np.pi * (size // 3) / size, 6.2825]))
    nodes = [[0, size // 3], list(range(size))]
    assert split_depth(arm.chain.arrays, np.array([2, size])) == 2
    beam, leaves, _, _ = search(arm.chain, goal, size, nodes)
    assert leaves == 2 * size
    assert beam.nodes[0, 1] == size - 1


@given(st.lists(st.integers(1, 4), min_size=1, max_size=5), st.data())
def test_nodes_expanded_are_those_of_a_depth_first_search(counts: list[int], data: st.DataObject) -> None:
    leaves = int(np.prod(counts))
    leaf = data.draw(st.integers(0, leaves - 1))
    expanded = set()
    for number in range(leaf + 1):
        path = np.unravel_index(number, counts)
        expanded |= {tuple(map(int, path[: d + 1])) for d in range(len(counts))}
    assert nodes_expanded(np.array(counts), leaf + 1) == len(expanded)
    assert nodes_expanded(np.array(counts), 0) == 0


def test_equation_1() -> None:
    assert equation_1(60, 4) == 13_179_660
    assert equation_1(1, 6) == 6
    assert nodes_expanded(np.full(4, 60), 60**4) == 13_179_660
    assert nodes_expanded(np.full(40, 60), 1) == 40


def test_beams_refuse_twins() -> None:
    beam = Beam(np.full(2, np.inf), np.empty((2, 1), dtype=np.int64), np.empty((2, 1)))
    assert offer(beam, 0.5, np.array([1]), np.array([0.1])) == np.inf
    assert offer(beam, 0.5, np.array([1]), np.array([0.1])) == np.inf
    assert offer(beam, 0.7, np.array([2]), np.array([0.2])) == 0.7
    assert offer(beam, 0.9, np.array([3]), np.array([0.3])) == 0.7
    assert sorted(beam.errors) == [0.5, 0.7]
    assert beam.nodes[best_first(beam)].ravel().tolist() == [1, 2]


@pytest.mark.parametrize(
    ("dof", "most", "cells", "children"), [(1, 1, 1, 1), (2, 7, 1, 1), (6, 3, 64, 2), (7, 9, 5, 5)]
)
def test_a_descent_fills_its_memory_and_no_part_lies_over_another(
    dof: int, most: int, cells: int, children: int
) -> None:
    memory = np.zeros(LAYOUT.count.of(dof=dof, most=most, cells=cells, children=children))
    views = inlined(view_memory)(memory.ctypes.data, dof, most, cells, children)
    (*scratch, window), *beams = views
    parts = [*scratch, *window, *(array for beam in beams for array in beam)]
    for part in parts:
        begin = (part.ctypes.data - memory.ctypes.data) // 8
        memory[begin : begin + part.size] += 1
    np.testing.assert_array_equal(memory, 1)
    assert inlined(LAYOUT.size)(dof, most, cells, children) == len(memory)
    beam = (cells,), (cells, dof), (cells, dof)
    assert [part.shape for part in parts] == [
        *((3, 3, MOST_LANES), (MOST_LANES,), (dof + 1, 3, 4), (dof,), (dof,), (dof,), (dof,)),
        *((dof, most), (dof, most), (dof,)),
        *beam,
        *beam,
        *((children,), (children, dof), (children, dof)),
    ]
    given = dof, most, cells, children
    larger = np.zeros(memory_size(*given))
    lanes = inlined(grid_memory)(larger, *given).scratch.lanes
    assert lanes.ctypes.data % 64 == 0
    assert larger.ctypes.data <= lanes.ctypes.data <= larger.ctypes.data + larger.nbytes - memory.nbytes


def test_a_layout_for_other_numbers_than_an_arms() -> None:
    cells = named("cells")
    square = Layout(Beam, SIZES, "square", errors=floats(cells, cells), nodes=floats(2), q=floats(cells, 3))
    assert square.count.of(cells=5) == 25 + 2 + 15
    assert str(square.count) == "(1 * cells * cells + 3 * cells + 2)"
