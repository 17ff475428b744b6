"""Every bundled arm: a sample of reachable targets, all of them solved, none of them wrongly claimed.

`python -m benchmarks.fleet` does the same with 105,000 targets an arm.
"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

import kinseek
from benchmarks.targets import plain_fk, pose_errors, random_joints, singular_joints
from kinseek.robots import catalog_names
from reference import fk

Array = NDArray[np.float64]

ROUNDING = 1e-13
"""Two ways of computing the same pose may differ by this, [m] and [rad]."""


def check(arm: kinseek.Arm, made_from: Array) -> None:
    """Every answer (k, n) reaches the target that `made_from` makes, inside the limits, by plain NumPy FK."""
    targets = plain_fk(arm.chain, made_from)
    solution = arm.ik(targets)
    away, angle = pose_errors(plain_fk(arm.chain, solution.q), targets)
    np.testing.assert_allclose(solution.position_error, away, atol=ROUNDING)
    np.testing.assert_allclose(solution.orientation_error, angle, atol=ROUNDING)
    assert ((solution.q >= arm.lower) & (solution.q <= arm.upper)).all()
    missed = np.flatnonzero((away > 1e-6 + ROUNDING) | (angle > 1e-6 + ROUNDING) | ~solution.success)
    assert not len(missed), [
        f"{arm.name} {i}: {away[i]:.1e} m, {angle[i]:.1e} rad, from {made_from[i].tolist()}" for i in missed
    ]


@pytest.mark.slow
@pytest.mark.parametrize("name", catalog_names())
def test_targets_anywhere_and_near_singularities_and_limits_are_solved(name: str) -> None:
    arm = kinseek.load(name)
    check(arm, random_joints(arm.chain, 2000, seed=11))
    check(arm, singular_joints(arm.chain, 500, seed=12))


@pytest.mark.parametrize(("seed", "number"), [(0, 291), (3, 2734), (4, 1115)])
def test_the_end_of_a_curved_valley_is_reached(seed: int, number: int) -> None:
    """Six of ten joints at limits at a singularity: of 750,000 targets like it these three were missed."""
    arm = kinseek.load("atlas_torso_arm")
    check(arm, singular_joints(arm.chain, 5000, seed)[number : number + 1])


@pytest.mark.parametrize("name", ["panda", "ur10e_rail", "irb5400", "scara_synth"])
def test_the_judge_agrees_with_the_twin(name: str) -> None:
    arm = kinseek.load(name)
    q = random_joints(arm.chain, 20, seed=13)
    np.testing.assert_allclose(plain_fk(arm.chain, q), [fk(arm.chain, each) for each in q], atol=1e-13)
