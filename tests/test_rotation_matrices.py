"""Rotations as matrices and as what SciPy calls a rotation; rounded ones only where that is said."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import kinseek
from kinseek import InvalidGoal, RepairWarning

ANGLES = [0.1, 0.2, 0.3]
TURN = Rotation.from_euler("xyz", ANGLES)
POSE = kinseek.pose([0.4, 0.2, 0.3], rpy=ANGLES)


class Turn:
    """Carries a 3x3 under another name, as spatialmath does."""

    A = TURN.as_matrix()


@pytest.mark.parametrize("held", [TURN, TURN.as_matrix(), TURN.as_matrix().tolist(), Turn()])
def test_a_rotation_is_taken_as_it_is_held(held: object) -> None:
    pose = kinseek.pose([0.4, 0.2, 0.3], rotation=held)
    np.testing.assert_allclose(pose, POSE, rtol=0, atol=1e-15)


def test_many_rotations_broadcast_with_positions() -> None:
    turns = Rotation.random(5, random_state=1)
    poses = kinseek.pose([0.4, 0.2, 0.3], rotation=turns)
    np.testing.assert_array_equal(poses[:, :3, :3], turns.as_matrix())
    assert kinseek.pose(np.zeros((3, 1, 3)), rotation=turns).shape == (3, 5, 4, 4)
    assert kinseek.pose(np.zeros((0, 3)), rotation=np.zeros((0, 3, 3)), repair=True).shape == (0, 4, 4)


@pytest.mark.parametrize("digits", [5, 4, 3, 2])
def test_a_rounded_matrix_is_repaired_where_that_is_said(digits: int) -> None:
    rounded: NDArray[np.float64] = np.round(POSE, digits)
    off = np.abs(rounded[:3, :3].T @ rounded[:3, :3] - np.eye(3)).max()
    with pytest.raises(InvalidGoal, match=r"more is rejected\); for one that was rounded .*repair=True"):
        kinseek.load("ur5e").ik(rounded)
    with pytest.raises(InvalidGoal, match=r"^rotation: .*repair=True"):
        kinseek.pose([0.4, 0.2, 0.3], rotation=rounded[:3, :3])
    told = f"1 of 1 matrices were not rotations.* by up to {off:.3g}"
    with pytest.warns(RepairWarning, match=told) as warned:
        pose = kinseek.pose(rounded, repair=True)
    assert warned[0].filename == __file__
    with pytest.warns(RepairWarning, match=told) as warned:
        same = kinseek.pose([0.4, 0.2, 0.3], rotation=rounded[:3, :3], repair=True)
    assert warned[0].filename == __file__
    np.testing.assert_array_equal(pose, same)
    np.testing.assert_allclose(pose[:3, :3].T @ pose[:3, :3], np.eye(3), rtol=0, atol=4e-15)
    np.testing.assert_allclose(pose, POSE, rtol=0, atol=10.0**-digits)
    # It is the nearest rotation: none beside it is nearer to what was given.
    near = (
        Rotation.from_rotvec(np.random.default_rng(0).normal(scale=1e-3, size=(200, 3))).as_matrix()
        @ pose[:3, :3]
    )
    assert (
        np.linalg.norm(near - rounded[:3, :3], axis=(1, 2)) > np.linalg.norm((pose - rounded)[:3, :3])
    ).all()


def test_what_needs_no_repair_is_left_alone_and_nothing_said() -> None:
    np.testing.assert_array_equal(kinseek.pose(POSE, repair=True), POSE)
    np.testing.assert_array_equal(kinseek.pose(POSE), POSE)


@pytest.mark.parametrize(
    ("rotation", "message"),
    [
        (-TURN.as_matrix(), "rotation: .* a reflection"),
        (2 * TURN.as_matrix(), "rotation: .* differs from the identity by 3 "),
        (np.eye(4), r"rotation: expected a matrix of shape \(3, 3\) or \(..., 3, 3\), got \(4, 4\)"),
        (np.full((3, 3), np.nan), "rotation: .* NaN or infinity"),
        ("up", "rotation: .* got str"),
        (ANGLES, r"rotation: expected a matrix of shape .* got \(3,\)"),
    ],
)
@pytest.mark.parametrize("repair", [False, True])
def test_what_is_no_rounded_rotation_is_refused(rotation: object, message: str, repair: bool) -> None:
    with pytest.raises(InvalidGoal, match=message):
        kinseek.pose([0.4, 0.2, 0.3], rotation=rotation, repair=repair)


def test_words_that_do_not_fit_together_are_refused() -> None:
    with pytest.raises(InvalidGoal, match="repair=True is for matrices"):
        kinseek.pose([0.4, 0.2, 0.3], rpy=ANGLES, repair=True)
    with pytest.raises(InvalidGoal, match="give one rotation, got rpy and rotation"):
        kinseek.pose([0.4, 0.2, 0.3], rpy=ANGLES, rotation=TURN)
    with pytest.raises(InvalidGoal, match=r"a whole pose, \(4, 4\), cannot be combined with rpy"):
        kinseek.pose(POSE, rpy=ANGLES)
    with pytest.raises(InvalidGoal, match="degrees=True is for rpy and rotvec: rotation has no unit"):
        kinseek.pose([0.4, 0.2, 0.3], rotation=TURN, degrees=True)
    with pytest.raises(InvalidGoal, match="the position is missing"):
        kinseek.pose(TURN)
    told = "rpy must have angles of at most 1e\\+07 rad, got 1e\\+200"
    with pytest.warns(kinseek.UnitWarning), pytest.raises(InvalidGoal, match=told):
        kinseek.pose([0.4, 0.2, 0.3], rpy=[1e200, 0, 0])
