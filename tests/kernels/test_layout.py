"""Hand-laid memory: no part over another, nothing left over, and every view on the array it is named after."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

import kinseek
from inlined import inlined
from kinseek import Goal
from kinseek.kernels.atlas import far, one_goal, seeds, task
from kinseek.kernels.atlas import memory as scratch
from kinseek.kernels.atlas.lanes import LANES
from kinseek.kernels.atlas.tree import BESIDE, LEAF_SIZE, MOST_LEVELS
from kinseek.kernels.layout import DOF, JOINTS, Layout, Rows, floats
from kinseek.kernels.pointers import ROW
from kinseek.kinds import POSE
from kinseek.solvers.atlas.index import PLAIN, AtlasIndex, tolerances_of

Array = NDArray[np.float64]

ARMS = [(1, 1), (2, 2), (3, 5), (6, 6), (7, 7), (7, 9), (20, 20)]
"""Variables and joints; more joints where some mimic others."""

scratch_size, make_scratch, task_of = (
    inlined(each) for each in (scratch.scratch_size, scratch.make_scratch, task.task_of)
)


def arrays_of(bundle: Any) -> Iterator[tuple[str, NDArray[Any]]]:
    for name, value in zip(bundle._fields, bundle, strict=True):
        if isinstance(value, tuple):
            yield from ((f"{name}.{each}", array) for each, array in arrays_of(value))
        elif isinstance(value, np.ndarray):
            yield name, value


def owners(memory: Array, bundle: Any) -> NDArray[np.int64]:
    """How many parts hold each number of a memory, by what writing to the parts does."""
    count = np.zeros(len(memory), dtype=np.int64)
    for name, part in arrays_of(bundle):
        begin = part.ctypes.data - memory.ctypes.data
        assert begin % 8 == 0, name
        assert 0 <= begin <= memory.nbytes - part.nbytes, name
        assert part.itemsize == 8, name
        assert part.flags.c_contiguous, name
        count[begin // 8 : begin // 8 + part.size] += 1
    return count


@pytest.mark.parametrize(("dof", "joints"), ARMS)
def test_a_desk_fills_its_memory_and_no_part_lies_over_another(dof: int, joints: int) -> None:
    memory = np.zeros(scratch_size(dof, joints))
    laid = make_scratch(memory, dof, joints)
    np.testing.assert_array_equal(owners(memory, laid), 1)
    assert {name: array.shape for name, array in arrays_of(laid)} == {
        "lanes.q": (dof, LANES),
        "lanes.target": (3, 4, LANES),
        "lanes.pose": (3, 4, LANES),
        "lanes.axes": (joints, 6, LANES),
        "lanes.jacobian": (dof, 6, LANES),
        "lanes.gram": (21, LANES),
        "lanes.residual": (6, LANES),
        "lanes.step": (dof, LANES),
        "lanes.share": (LANES,),
        "lanes.before": (LANES,),
        "lanes.stubborn": (LANES,),
        "lanes.error": (4, LANES),
        "lanes.weight": (2, LANES),
        "seen": (3, 4),
        "pose": (3, 4),
        "between": (3, 4),
        "displacement": (3, 4),
        "rest": (3, 4),
        "point": (9,),
        "distance": (scratch.DEEP,),
        "neighbour": (scratch.DEEP,),
        "stack": (MOST_LEVELS,),
        "bound": (MOST_LEVELS,),
        "leaf": (LEAF_SIZE,),
        "beside": (BESIDE, LEAF_SIZE),
        "least": (LEAF_SIZE,),
        "report": (task.REPORT,),
        "candidates": (scratch.CANDIDATE_ROWS, LANES),
        "seed": (dof,),
        "found": (LANES, dof),
        "state": (LANES,),
        "paused": (LANES,),
        "best": (LANES, dof),
        "best_error": (LANES,),
        "floor": (LANES,),
        "columns": (3,),
        "damping": (1,),
    }
    whole_numbers = {name for name, array in arrays_of(laid) if array.dtype == np.int64}
    assert whole_numbers == {"neighbour", "stack", "state", "paused"}


def test_every_look_up_fits_into_the_memory() -> None:
    assert max(seeds.MORE, far.BESIDE, scratch.DEEP) == scratch.DEEP


@pytest.mark.parametrize(("dof", "joints"), ARMS)
def test_what_is_written_to_one_part_stands_in_no_other(dof: int, joints: int) -> None:
    memory = np.zeros(scratch_size(dof, joints))
    parts = list(arrays_of(make_scratch(memory, dof, joints)))
    for number, (_, part) in enumerate(parts, start=1):
        part[...] = number
    for number, (name, part) in enumerate(parts, start=1):
        assert (part == number).all(), name


class Inner(NamedTuple):
    number: Annotated[NDArray[np.int64], 3]
    rows: Annotated[Array, "dof", 4]


class Outer(NamedTuple):
    first: Annotated[Array, 5]
    inner: Inner
    last: Annotated[Array, 2, "joints"]


class Bare(NamedTuple):
    rows: Array


class Number(NamedTuple):
    many: int


OUTER = Layout(Outer)


def test_a_layout_says_where_a_bundle_within_a_bundle_stands() -> None:
    size, make = inlined(OUTER.size), inlined(OUTER.make)
    for dof, joints in ARMS:
        memory = np.zeros(size(dof, joints))
        assert len(memory) == 5 + 3 + 4 * dof + 2 * joints
        laid = make(memory.ctypes.data, dof, joints)
        np.testing.assert_array_equal(owners(memory, laid), 1)
        assert laid.inner.number.ctypes.data == memory[5:].ctypes.data
        assert laid.inner.rows.shape == (dof, 4)
        assert laid.last.shape == (2, joints)


def test_a_declaration_that_does_not_fit_its_bundle() -> None:
    with pytest.raises(TypeError, match=r"Inner has the fields \('number', 'rows'\), declared are .*'row'"):
        Layout(Inner, row=floats(3))
    with pytest.raises(TypeError, match=r"Bare.rows needs a number, a named tuple or Annotated"):
        Rows(Bare)
    with pytest.raises(TypeError, match=r"Number.many is a number, and a layout has arrays only"):
        Layout(Number)
    with pytest.raises(TypeError, match="grows no faster than the arm"):
        floats(DOF, JOINTS)


@pytest.fixture(name="index", scope="module")
def _index() -> AtlasIndex:
    arm = kinseek.load("ur10e_rail")
    return AtlasIndex(arm.chain, POSE, arm.chain.arrays, 64)


def test_a_task_views_the_arrays_it_is_made_of(index: AtlasIndex) -> None:
    chain, atlas = kinseek.load("ur10e_rail").chain.arrays, index.sorted
    tolerances = np.arange(8.0)
    task = task_of(index.handle, tolerances)
    for bundle, made_of in ((task.chain, chain), (task.atlas.tree, atlas.tree), (task.atlas, atlas)):
        for name, array in zip(bundle._fields, bundle, strict=True):
            if isinstance(array, np.ndarray):
                np.testing.assert_array_equal(array, getattr(made_of, name), err_msg=name)
    given = (
        task.position_tolerance,
        task.orientation_tolerance,
        task.position_weight,
        task.budget,
        task.nearest,
    )
    assert given == (0, 1, 2, 3, 4)
    np.testing.assert_array_equal(task.axis_weights, [5, 6, 7])
    assert task.poses == 0
    np.testing.assert_array_equal(task.columns, [0.5, 0.5, 0.5])
    np.testing.assert_array_equal(task.lower <= chain.lower, True)
    np.testing.assert_array_equal(task.upper >= chain.upper, True)
    assert task.links.shape == (len(chain.leader) + 2, 12)
    assert task.division.length == task.length > 0
    assert tuple(task.division)[:3] == (2, 1, 1)


def test_numbers_of_a_handle_that_stand_alone(index: AtlasIndex) -> None:
    handle = index.handle
    assert len(handle) == task.ARRAYS * ROW
    assert inlined(task.lanes_of)(handle) == LANES
    np.testing.assert_array_equal(inlined(task.plain_tolerances)(handle), PLAIN)
    np.testing.assert_array_equal(PLAIN, tolerances_of(Goal.pose(np.eye(4))))
    routines = inlined(task.routines_of)(handle)
    assert routines == one_goal.routines()._replace(closed=routines.closed)
    assert inlined(task.lengths_of)(handle) == index.lengths
    np.testing.assert_array_equal(inlined(task.handle_at)(handle.ctypes.data), handle)


def test_an_array_of_other_elements_or_dimensions_is_refused() -> None:
    rows = Rows(Inner)
    assert len(rows.arrays(Inner(np.zeros(4, dtype=np.int64), np.zeros((2, 3))))) == 2
    with pytest.raises(TypeError, match="rows is read by floats2, got 1 dimensions of float64, expected 2"):
        rows.arrays(Inner(np.zeros(4, dtype=np.int64), np.zeros(3)))
    with pytest.raises(TypeError, match="number is read by integers, got 1 dimensions of float32"):
        rows.arrays(Inner(np.zeros(4, dtype=np.float32), np.zeros((2, 3))))
