"""Goals with ranges go through the search of whole poses: what differs is called by address, and stands behind the desk."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

import kinseek
from inlined import inlined
from kinseek import Goal
from kinseek.kernels.arm.range_error import QUESTION
from kinseek.kernels.atlas import memory
from kinseek.kernels.atlas import task as tasks
from kinseek.kernels.pointers import ROW
from kinseek.kernels.ranges import steps
from kinseek.solvers.atlas.index import atlas_of, tolerances_of

Array = NDArray[np.float64]

task_of, routines_of = inlined(tasks.task_of), inlined(tasks.routines_of)
scratch_size, range_scratch_size = inlined(memory.scratch_size), inlined(steps.range_scratch_size)
make_range_scratch = inlined(steps.make_range_scratch)


def test_only_the_search_itself_is_shared_of_the_routines() -> None:
    index = atlas_of(kinseek.load("ur5e").chain)
    plain, ranged = index.handle.reshape(-1, ROW), index.range_handle.reshape(-1, ROW)
    others = {k for k in range(len(plain)) if (plain[k] != ranged[k]).any()}
    assert others == {tasks.ROWS.first[name] for name in ("numbers", "routines", "columns")}
    routines, mine = routines_of(index.handle), routines_of(index.range_handle)
    assert mine.search == routines.search
    for name in ("iterate", "ending", "starts", "judge"):
        assert 0 != getattr(mine, name) != getattr(routines, name)
    assert routines.starts == routines.judge == 0


def test_a_task_with_ranges_says_so() -> None:
    index, tolerances = (
        atlas_of(kinseek.load("scara4").chain, Goal.position((0.2, 0.2, 0.1))),
        np.arange(float(tasks.TOLERANCES)),
    )
    plain, ranged = task_of(index.handle, tolerances), task_of(index.range_handle, tolerances)
    assert (plain.poses, ranged.poses) == (0, steps.POSES)
    assert (ranged.columns > 0.0).all()
    assert ranged.length == plain.length
    assert tuple(ranged.division) == tuple(plain.division)


def test_what_is_wanted_stands_where_tasks_look_for_it() -> None:
    goal = Goal.pose(
        np.eye(4),
        position_tolerance=0.1,
        orientation_tolerance=0.2,
        position_weight=3.0,
        orientation_weight=4.0,
    )
    task = task_of(atlas_of(kinseek.load("planar2").chain).handle, tolerances_of(goal, 500))
    assert (task.position_tolerance, task.orientation_tolerance) == (0.1, 0.2)
    assert (task.position_weight, task.budget) == (3.0, 500.0)
    np.testing.assert_array_equal(task.axis_weights, [4.0, 4.0, 0.0])


@pytest.mark.parametrize(("dof", "joints"), [(2, 2), (7, 9)])
def test_memory_of_ranges_begins_where_the_desk_ends(dof: int, joints: int) -> None:
    first, count = scratch_size(dof, joints), range_scratch_size(dof, joints)
    room = np.zeros(first + count)
    ranges = make_range_scratch(room, dof, joints)
    for part in ranges:
        view = part.view(np.float64)
        view += 1.0
    np.testing.assert_array_equal(room[:first], 0.0)
    np.testing.assert_array_equal(room[first:], 1.0)
    assert ranges.question.shape == (QUESTION,)
    assert ranges.poses.shape == (steps.POSES, 3, 4)
