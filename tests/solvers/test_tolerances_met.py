"""A pose a little beyond the limits, by less than the tolerances, has answers: they are found.

What is nearest to such a pose by the weights may miss one tolerance for the sake of the other.
"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import kinseek


@pytest.mark.parametrize(("name", "joint"), [("wx250s", 1), ("piper", 4), ("ur5e", 2)])
@pytest.mark.parametrize("tolerance", [1e-6, 1e-3])
def test_poses_off_by_almost_both_tolerances_are_reached(name: str, joint: int, tolerance: float) -> None:
    arm, rng = kinseek.load(name), np.random.default_rng(0)
    for _ in range(20):
        q = rng.uniform(arm.lower, arm.upper)
        q[joint] = arm.upper[joint]
        target, off = np.array(arm.fk(q)), rng.normal(size=(2, 3))
        off *= 0.95 * tolerance / np.linalg.norm(off, axis=1, keepdims=True)
        target[:3, 3] += off[0]
        target[:3, :3] = target[:3, :3] @ Rotation.from_rotvec(off[1]).as_matrix()
        goal = kinseek.Goal(target, position_tolerance=tolerance, orientation_tolerance=tolerance)
        assert arm.ik(goal).success


@pytest.mark.parametrize(
    ("name", "tolerance"), [("panda", (0.1, 1e-4)), ("ur5e", (0.1, 1e-4)), ("panda", (1e-5, 0.5))]
)
def test_weights_do_not_hide_what_a_wide_tolerance_allows(name: str, tolerance: tuple[float, float]) -> None:
    arm, rng = kinseek.load(name), np.random.default_rng(1)
    place, turn = tolerance
    target = arm.fk(arm.sample(40, seed=1))
    away = target[:, :3, 3] / np.linalg.norm(target[:, :3, 3], axis=1, keepdims=True)
    target[:, :3, 3] += 0.5 * place * away
    axes = rng.normal(size=(40, 3))
    axes *= 0.5 * turn / np.linalg.norm(axes, axis=1, keepdims=True)
    target[:, :3, :3] = target[:, :3, :3] @ Rotation.from_rotvec(axes).as_matrix()

    def goal(T: NDArray[np.float64]) -> kinseek.Goal:
        return kinseek.Goal(T, position_tolerance=place, orientation_tolerance=turn)

    found = arm.ik(goal(target))
    assert found.success.all()
    alone = [arm.ik(goal(T)) for T in target]
    assert np.array_equal([one.q for one in alone], found.q)
    assert [one.weighted_error for one in alone] == found.weighted_error.tolist()
    beside = arm.ik(goal(target), near=arm.sample(40, seed=2))
    assert beside.success.all()
