"""What a search keeps for a goal that may be out of reach: the eight best, no two alike, of poses and boxes by one rule."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
import pytest
from numpy.typing import NDArray

import kinseek
from kinseek import Goal
from kinseek.kernels.atlas.descent import ALIKE, keep_best
from kinseek.kernels.atlas.lanes import LANES
from kinseek.kernels.atlas.memory import make_scratch, scratch_size
from kinseek.kernels.atlas.task import Job, task_of
from kinseek.kernels.ranges.steps import make_range_scratch, range_scratch_size
from kinseek.solvers.atlas.index import atlas_of, tolerances_of

pytestmark = pytest.mark.slow

Array = NDArray[np.float64]


def _kept(handle: Any, tolerances: Array, target: Array, question: Array, rounds: Array) -> Any:
    """The eight best of some rounds of eight, (r, LANES, n): their joint values and errors, (LANES, n + 1)."""
    task = task_of(handle, tolerances)
    dof, joints = len(task.lower), len(task.chain.leader)
    memory = np.zeros(scratch_size(dof, joints) + range_scratch_size(dof, joints))
    scratch, result = make_scratch(memory, dof, joints), np.empty((LANES, dof + 1))
    ranges = make_range_scratch(memory, dof, joints)
    for k in range(len(question)):
        ranges.question[k] = question[k]
    for l in range(LANES):
        scratch.best_error[l] = np.inf
    for k in range(len(rounds)):
        for l in range(LANES):
            scratch.state[l] = 0
            for i in range(dof):
                scratch.lanes.q[i, l] = rounds[k, l, i]
        keep_best(Job(handle, tolerances, memory, LANES), task, scratch, target)
    for l in range(LANES):
        result[l, dof] = scratch.best_error[l]
        for i in range(dof):
            result[l, i] = scratch.best[l, i]
    memory[0] = 0.0  # Views do not keep it alive.
    return result


kept: Any = numba.njit(_kept)


@pytest.mark.parametrize("boxed", [False, True])
@pytest.mark.jit
def test_no_two_of_the_best_are_alike_and_the_best_of_all_is_among_them(boxed: bool) -> None:
    arm, rng = kinseek.load("ur5e"), np.random.default_rng(1)
    centres = rng.uniform(-2, 2, (3, 6))
    rounds = centres[rng.integers(3, size=(5, LANES))] + rng.uniform(-0.05, 0.05, (5, LANES, 6))
    target = arm.fk(np.ones(6))
    pose, box = Goal.pose(target), Goal.pose(target, box={"x": (-0.01, 0.01)}, free="rz")
    goal = box if boxed else pose
    index = atlas_of(arm.chain, goal)
    handle = index.range_handle if boxed else index.handle
    best = kept(handle, tolerances_of(goal), target[:3], box.questions[0], rounds)
    filled = best[np.isfinite(best[:, -1])]
    assert len(filled) == 3  # One of each of the three places, though eight would fit.
    for i in range(3):
        for j in range(i):
            assert np.abs(filled[i, :6] - filled[j, :6]).max() >= ALIKE
    least = min(_error(arm, goal, q) for q in rounds.reshape(-1, 6))
    assert filled[:, -1].min() == pytest.approx(least, rel=1e-12)


def _error(arm: kinseek.Arm, goal: Goal, q: Array) -> float:
    from kinseek.solution import conclude

    return float(
        conclude(kinseek.Problem(arm.chain, goal), q[None], np.zeros((1, 3), np.int64)).weighted_error
    )
