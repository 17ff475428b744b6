"""Where the search for every answer starts: samples in order, and the table of their first steps."""

from __future__ import annotations

import numpy as np
import pytest

import kinseek
from kinseek import Goal, Problem
from kinseek.branches.index import index_of
from kinseek.kernels.arm.division import NONE
from kinseek.kernels.branches import seeding
from kinseek.kernels.branches.distance import MOST_JOINTS
from kinseek.kernels.jit import exposed
from kinseek.robots.geometry import RADIAN_PART

radius, sort_samples = exposed(seeding.radius), exposed(seeding.sort_samples)
is_alike, keep_start = exposed(seeding.is_alike), exposed(seeding.keep_start)


@pytest.mark.parametrize("name", ["jaco2_6", "ur10e_calibrated", "so101", "cylindrical3"])
def test_the_table_of_first_steps_is_a_damped_inverse(name: str) -> None:
    """Moved from the tip to the last axis, and seen from the first, a small motion is answered as by least squares."""
    arm = kinseek.load(name)
    index = index_of(Problem(arm.chain, Goal.pose(np.eye(4))))
    atlas, first = index.coarse.sorted, int(index.coarse.division.head != NONE)
    length = arm.chain.length / RADIAN_PART
    for k in (0, 17, len(atlas.middle) - 1):
        q = np.zeros(arm.dof)
        q[first : first + atlas.middle.shape[1]] = atlas.middle[k]
        J, head = np.array(arm.jacobian(q)), atlas.inverse_head[:, :3]
        lever = arm.fk(q)[:3, :3] @ atlas.inverse_tip[:, 3]
        J[:3] += np.cross(J[3:].T, lever).T
        J = np.concatenate([head @ J[:3] / length, head @ J[3:]])
        expected = J.T @ np.linalg.inv(J @ J.T + seeding.DAMPED * np.eye(6))
        np.testing.assert_allclose(index.tables.steps[k, :, : arm.dof].T, expected, atol=1e-9)
        assert (index.tables.steps[k, :, arm.dof :] == 0.0).all()


@pytest.mark.jit
def test_samples_come_nearest_first_and_none_twice() -> None:
    rng = np.random.default_rng(0)
    for count in (64, 1024):
        distance = rng.uniform(0.01, 4.0, count) ** 2
        room = np.empty(count + 1, dtype=np.int64)
        near, far = radius(distance, 100), radius(distance, 400)
        if count <= 100:
            assert near == far == np.inf
            continue
        assert 90 <= (distance < near).sum() <= 110
        assert 360 <= (distance < far).sum() <= 440
        taken = []
        for low, high in ((0.0, near), (near, far)):
            order = np.empty(count, dtype=np.int64)
            bucket_ends = np.empty(seeding.BUCKETS + 1, dtype=np.int64)
            found = sort_samples(seeding.Sorting(distance, room, order, bucket_ends), low, high, count)
            assert sorted(order[:found]) == list(np.flatnonzero((low <= distance) & (distance < high)))
            bucket = (distance[order[:found]].max() - distance[order[:found]].min()) / (seeding.BUCKETS - 1)
            assert (np.diff(distance[order[:found]]) >= -bucket).all()
            taken += list(order[:found])
        assert len(set(taken)) == len(taken)
    alike = np.full(1024, 0.3)
    assert radius(alike, 100) >= 0.0  # No radius parts them; it ends all the same.


@pytest.mark.jit
def test_starts_are_alike_modulo_full_turns_only_where_a_joint_turns() -> None:
    known, q = np.empty((MOST_JOINTS, 8)), np.zeros(6)
    q[0] = 3.0
    keep_start(known, 0, q)
    q[0] = 3.0 - 2 * np.pi + 0.5 * seeding.APART
    turning, limited = np.full(6, 0.5 / np.pi), np.zeros(6)
    assert is_alike(known, 1, turning, q)
    assert not is_alike(known, 1, limited, q)
    assert not is_alike(known, 0, turning, q)
