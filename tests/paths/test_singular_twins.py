"""Answers beyond a singularity at which two axes fall together."""

from __future__ import annotations

import numpy as np
import pytest

import kinseek
from benchmarks.paths.curves import WITHIN, curve, holds
from kinseek.paths.singular_twins import NEAR, Fold, folds_of, mirrored
from kinseek.robots.catalog import catalog_names


@pytest.mark.parametrize("name", catalog_names())
def test_at_a_fold_two_joints_turn_about_one_line(name: str) -> None:
    """With the joint there, one of its neighbours undoes what the other does: the Jacobian of the two has rank one."""
    arm = kinseek.load(name)
    rng = np.random.default_rng(0)
    for fold in folds_of(arm.chain):
        q = rng.uniform(arm.lower, arm.upper)
        q[fold.joint] = fold.value
        one, other = q.copy(), q.copy()
        one[fold.joint - 1] += 1e-3
        other[fold.joint + 1] += 1e-3
        T, moved = arm.fk(q), [arm.fk(one), arm.fk(other)]
        apart = min(np.abs(moved[0] - moved[1]).max(), np.abs(moved[0] + moved[1] - 2 * T).max())
        assert apart < 5e-6


def test_the_wrist_of_a_torso_folds_and_arms_without_such_axes_do_not() -> None:
    assert [fold.joint for fold in folds_of(kinseek.load("atlas_torso_arm").chain)] == [8]
    assert folds_of(kinseek.load("ur5e").chain) == []


def test_twins_stand_as_far_on_the_other_side() -> None:
    q = np.array([[0.3, 3.0], [0.1, -3.0], [0.2, 1.0]])
    twins = mirrored(q, [Fold(1, np.pi)])
    np.testing.assert_allclose(twins, [[0.3, 2 * np.pi - 3.0], [0.1, -2 * np.pi + 3.0]])
    assert len(mirrored(q, [Fold(0, 0.3 + 2 * NEAR)])) == 0


@pytest.mark.slow
def test_a_path_through_the_singularity_of_a_wrist_is_followed() -> None:
    """Its maker passes straight through it, twice; no way around it stays inside the limits."""
    arm = kinseek.load("atlas_torso_arm")
    q = curve(arm, 1000, 3)
    T = arm.fk(q)
    path = arm.follow(T, max_step=WITHIN * float(np.abs(np.diff(q, axis=0)).max()), threads=1)
    assert path.success
    assert holds(arm, path, T)
