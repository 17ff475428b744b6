"""A pose a little beyond the limits, by less than the tolerances, has answers: they are found.

What is nearest to such a pose by the weights may miss one tolerance for the sake of the other.
"""

from __future__ import annotations

import numpy as np
import pytest
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
