"""The pose on the way to another one, judged by SciPy's rotations."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import kinseek
from kinseek.kernels.paths.towards import move_towards


@pytest.mark.parametrize("share", [1.0, 0.1])
@pytest.mark.parametrize("most", [(1e-3, 1e-2), (10.0, 4.0)])
def test_a_part_of_the_way_and_a_twist(most: tuple[float, float], share: float) -> None:
    rng = np.random.default_rng(4)
    for _ in range(50):
        hand, target = kinseek.pose(
            rng.normal(size=(2, 3)), rotvec=Rotation.random(2, random_state=rng).as_rotvec()
        )
        twist, moved = rng.normal(size=6), np.empty((4, 4))
        move_towards(hand, target, np.array(most), share, twist, moved)
        R, to = Rotation.from_matrix(hand[:3, :3]), Rotation.from_matrix(target[:3, :3])
        turn, shift = (to * R.inv()).as_rotvec(), target[:3, 3] - hand[:3, 3]
        turn *= min(1.0, most[1] / np.linalg.norm(turn))
        shift *= min(1.0, most[0] / np.linalg.norm(shift))
        expected = Rotation.from_rotvec(twist[3:]) * Rotation.from_rotvec(share * turn) * R
        assert np.allclose(moved[:3, :3], expected.as_matrix(), atol=1e-12)
        assert np.allclose(moved[:3, 3], hand[:3, 3] + share * shift + twist[:3], atol=1e-14)
        assert np.array_equal(moved[3], [0.0, 0.0, 0.0, 1.0])


def test_equal_poses_stay() -> None:
    hand, moved = kinseek.pose([0.1, 0.2, 0.3], rpy=[0.4, 0.5, 0.6]), np.empty((4, 4))
    move_towards(hand, hand, np.array([1e-3, 1e-2]), 1.0, np.zeros(6), moved)
    assert np.allclose(moved, hand, atol=1e-15)
