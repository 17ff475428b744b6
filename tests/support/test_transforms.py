"""Rigid transforms and turns, against SciPy and against plain words; base and tool of a DH table as users hold them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import kinseek
from kinseek.maps.last_joint import LastJoint
from kinseek.robots.geometry import open_limits
from kinseek.support.transforms import (
    from_quaternion,
    from_rpy,
    inverse,
    quaternion,
    rotation,
    rotation_onto,
    rotations,
    square,
    transform,
)
from kinseek.support.turns import TURN, ends_meet, holds_a_turn, nearest_turns, one_turn, shortest

Array = NDArray[np.float64]
RNG = np.random.default_rng(7)
VECTORS = RNG.normal(size=(50, 3))


def test_rotations_are_those_of_scipy() -> None:
    expected = Rotation.from_rotvec(VECTORS).as_matrix()
    np.testing.assert_allclose(rotations(VECTORS), expected, rtol=0, atol=1e-15)
    np.testing.assert_array_equal(rotations(np.zeros((1, 3)))[0], np.eye(3))
    for vector, matrix in zip(VECTORS, expected, strict=True):
        angle = float(np.linalg.norm(vector))
        np.testing.assert_allclose(rotation(vector / angle, angle), matrix, rtol=0, atol=1e-15)


ANGLES = st.one_of(
    st.floats(-7.0, 7.0),
    st.sampled_from([0.0, np.pi / 2, -np.pi / 2, np.pi, -np.pi, 2 * np.pi]),
    st.floats(-1e-7, 1e-7),
)
AXES = st.tuples(*[st.one_of(st.floats(-1.0, 1.0), st.sampled_from([0.0, 1.0, -1.0]))] * 3)


def around(axis: tuple[float, float, float], angle: float) -> Array:
    length = float(np.linalg.norm(axis))
    return np.array(axis) / length * angle if length > 1e-3 else np.array([angle, 0.0, 0.0])


@given(st.tuples(ANGLES, ANGLES, ANGLES))
def test_roll_pitch_and_yaw_are_those_of_scipy(angles: tuple[float, float, float]) -> None:
    expected = Rotation.from_euler("xyz", angles).as_matrix()
    np.testing.assert_allclose(from_rpy(np.array(angles)), expected, rtol=0, atol=2e-15)


@given(AXES, ANGLES)
def test_rotation_vectors_are_those_of_scipy_near_0_and_half_a_turn(
    axis: tuple[float, float, float], angle: float
) -> None:
    vector = around(axis, angle)
    np.testing.assert_allclose(
        rotations(vector), Rotation.from_rotvec(vector).as_matrix(), rtol=0, atol=2e-15
    )


@given(AXES, ANGLES)
def test_quaternions_are_those_of_scipy_near_0_and_half_a_turn(
    axis: tuple[float, float, float], angle: float
) -> None:
    turn = Rotation.from_rotvec(around(axis, angle)).as_matrix()
    found, expected = quaternion(turn), np.roll(Rotation.from_matrix(turn).as_quat(canonical=True), 1)
    # Of half a turn either sign is right, and rounding chooses.
    off = min(np.abs(found - expected).max(), np.abs(found + expected).max() if found[0] < 1e-8 else np.inf)
    assert off <= 4e-16 * 4
    assert found[0] >= 0.0
    assert next(value for value in found if value != 0.0) > 0.0
    # Small angles keep all their digits: there the vector is half the angle.
    np.testing.assert_allclose(2 * np.abs(found[1:]), 2 * np.abs(expected[1:]), rtol=1e-9, atol=1e-16)


@given(st.tuples(*[st.floats(-1.0, 1.0)] * 4), st.sampled_from([1e-8, 0.3, 1.0, 7.0, 1e150, 1e300]))
def test_quaternions_of_any_length_give_the_rotations_of_scipy(
    numbers: tuple[float, float, float, float], length: float
) -> None:
    wxyz = np.array(numbers)
    if np.linalg.norm(wxyz) < 0.2:
        wxyz = np.array([0.1, 0.2, 0.3, -0.9])
    expected = Rotation.from_quat(np.roll(wxyz, -1)).as_matrix()
    turn = from_quaternion(wxyz * length)
    # A unit quaternion is off by half a unit in the last place in each of four numbers, and RᵀR is of fourth order in them.
    few = 8 * np.finfo(np.float64).eps
    np.testing.assert_allclose(turn, expected, rtol=0, atol=few)
    np.testing.assert_allclose(turn.T @ turn, np.eye(3), rtol=0, atol=few)
    unit = wxyz / np.linalg.norm(wxyz)
    np.testing.assert_allclose(np.abs(quaternion(turn) @ unit), 1.0, rtol=0, atol=1e-15)


def test_a_stack_of_rotations_is_turned_as_each_of_them() -> None:
    stack = RNG.normal(size=(2, 5, 3))
    for of in (from_rpy, rotations):
        np.testing.assert_array_equal(of(stack), [[of(one) for one in row] for row in stack])
    turns = rotations(stack)
    wxyz = quaternion(turns)
    assert wxyz.shape == (2, 5, 4)
    np.testing.assert_array_equal(wxyz, [[quaternion(one) for one in row] for row in turns])
    np.testing.assert_allclose(from_quaternion(wxyz), turns, rtol=0, atol=2e-15)
    assert quaternion(np.zeros((0, 3, 3))).shape == (0, 4)
    assert from_quaternion(np.zeros((0, 4))).shape == from_rpy(np.zeros((0, 3))).shape == (0, 3, 3)


def test_half_turns_have_one_quaternion_each() -> None:
    for axis in np.eye(3):
        turn = 2 * np.outer(axis, axis) - np.eye(3)
        np.testing.assert_array_equal(quaternion(turn), [0.0, *axis])


def test_a_rotation_takes_one_axis_onto_another() -> None:
    axes = VECTORS / np.linalg.norm(VECTORS, axis=1, keepdims=True)
    for start, end in [*zip(axes, axes[::-1], strict=True), (axes[0], axes[0]), (axes[0], -axes[0])]:
        turn = rotation_onto(start, end)
        np.testing.assert_allclose(turn @ start, end, rtol=0, atol=1e-15)
        np.testing.assert_allclose(turn @ turn.T, np.eye(3), rtol=0, atol=1e-15)
        assert np.linalg.det(turn) > 0


def test_an_inverse_undoes_a_transform_with_its_last_row_and_without() -> None:
    for vector, place in zip(VECTORS, RNG.normal(size=(50, 3)), strict=True):
        T = transform(rotations(vector[None])[0], place)
        np.testing.assert_array_equal(inverse(T), inverse(T[:3]))
        np.testing.assert_array_equal(square(T[:3]), T)
        np.testing.assert_allclose(inverse(T) @ T, np.eye(4)[:3], rtol=0, atol=1e-14)


def test_the_short_way_round() -> None:
    gap = np.array([0.0, 3.0, 3.5, -3.5, 2 * TURN + 0.25, -5 * TURN - 0.25])
    np.testing.assert_allclose(
        shortest(gap), [0.0, 3.0, 3.5 - TURN, TURN - 3.5, 0.25, -0.25], rtol=0, atol=1e-14
    )
    np.testing.assert_array_equal(nearest_turns(gap), [0.0, 0.0, TURN, -TURN, 2 * TURN, -5 * TURN])
    # What is within half a turn already is not touched by any rounding.
    inside = RNG.uniform(-np.pi, np.pi, 1000)
    np.testing.assert_array_equal(shortest(inside), inside)


def test_ranges_that_hold_a_turn() -> None:
    lower, upper = np.array([-3.14159, -np.pi, -TURN, -4.0]), np.array([3.14159, np.pi, TURN, 4.0])
    np.testing.assert_array_equal(holds_a_turn(lower, upper), [False, True, True, True])
    np.testing.assert_array_equal(ends_meet(lower, upper), [True, True, True, False])
    # What is lacking is a gap, however small, unless it is in the sixteenth digit.
    gaps = np.array([1e-3, 1e-6, 1e-9, 1e-10, 1e-12, 1e-13, 1e-15, 0.0])
    np.testing.assert_array_equal(holds_a_turn(np.zeros(8), TURN - gaps), [False] * 6 + [True] * 2)
    np.testing.assert_array_equal(holds_a_turn(-np.pi + gaps / 2, np.pi - gaps / 2), [False] * 6 + [True] * 2)
    begins = RNG.uniform(-100, 100, 10_000)
    assert holds_a_turn(begins, begins + TURN).all()
    assert not holds_a_turn(begins, begins + TURN - 1e-12).any()
    np.testing.assert_array_equal(holds_a_turn(np.array([-np.inf]), np.array([np.inf])), [True])


@pytest.mark.parametrize(("digits", "turn"), [(6, False), (9, False), (12, True), (15, True), (16, True)])
def test_a_turn_that_is_written_with_so_many_digits(digits: int, turn: bool) -> None:
    """Of 6 and 9 digits a gap is left; of 12 they are rounded up; of 15 on what is left is rounding."""
    half = float(f"{np.pi:.{digits}g}")
    assert holds_a_turn(np.array([-half]), np.array([half]))[0] == turn


@pytest.mark.parametrize("gap", [5.3e-6, 1e-9, 1e-10])
def test_a_joint_short_of_a_turn_is_nowhere_taken_as_one_that_turns_fully(gap: float) -> None:
    chain = kinseek.load("planar2").chain
    for limit, full in ((np.pi, True), (np.pi - gap / 2, False)):
        narrow = chain.limited(np.full(2, -limit), np.full(2, limit), ("revolute", "revolute"))
        np.testing.assert_array_equal(narrow.full, [full, full])
        np.testing.assert_array_equal(open_limits(narrow)[1] > 10.0, [full, full])
    ur5e = kinseek.load("ur5e").chain
    limits = np.append(ur5e.upper[:-1], np.pi - gap / 2)
    last = LastJoint.of(ur5e.limited(-limits, limits, ur5e.kinds))
    assert last is not None
    assert not last.free
    np.testing.assert_array_equal(ends_meet(np.zeros(2), np.array([1e-9, TURN + 1e-7])), [False, True])


def test_a_wide_range_is_cut_to_one_turn_in_its_middle() -> None:
    lower, upper = np.array([-7.0, -7.0, -1.0]), np.array([9.0, 9.0, 1.0])
    low, high = one_turn(lower, upper, np.array([True, False, True]))
    np.testing.assert_allclose(low, [1.0 - np.pi, -7.0, -1.0])
    np.testing.assert_allclose(high, [1.0 + np.pi, 9.0, 1.0])
    assert lower[0] == -7.0, "the limits that were given are left alone"


class Carrier:
    """What users of other libraries hold."""

    def __init__(self, matrix: Array) -> None:
        self.homogeneous = matrix


def test_base_and_tool_of_a_table_are_read_as_every_pose_is() -> None:
    rows, limits = [(0.5, 0.0, 0.2, 0.0), (0.3, 0.4, 0.0, 0.1)], ([-2.0, -2.0], [2.0, 2.0])
    base, tool = (
        kinseek.pose([0.1, 0.2, 0.3], rpy=[0.1, 0.2, 0.3]),
        kinseek.pose([0, 0, 0.1], rpy=[0.3, 0, 0]),
    )
    q = np.array([0.3, -0.4])
    plain = kinseek.Arm.from_dh(rows, *limits, base=base, tool=tool).fk(q)
    carried = kinseek.Arm.from_dh(rows, *limits, base=Carrier(base), tool=Carrier(tool)).fk(q)
    np.testing.assert_array_equal(carried, plain)
    # Rounded to single precision a base is no rotation any more; the arm's poses are ones all the same.
    rounded = base.astype(np.float32).astype(float)
    assert np.abs(rounded[:3, :3].T @ rounded[:3, :3] - np.eye(3)).max() > 1e-9
    turn = kinseek.Arm.from_dh(rows, *limits, base=rounded).fk(q)[:3, :3]
    np.testing.assert_allclose(turn.T @ turn, np.eye(3), rtol=0, atol=1e-14)


@pytest.mark.parametrize(
    ("base", "message"),
    [
        (np.diag([1.0, 1.0, 1.0, 2.0]), "base pose: not a rigid transform: its last row"),
        (
            np.diag([1.1, 1.0, 1.0, 1.0]),
            "base pose: not a rigid transform: RᵀR differs from the identity by 0.21",
        ),
        (np.tile(np.eye(4), (2, 1, 1)), r"base pose must be one pose, \(4, 4\)"),
        ("here", "base pose: a pose must be a"),
    ],
)
def test_a_base_that_is_no_pose_is_told_what_it_is(base: object, message: str) -> None:
    with pytest.raises(kinseek.InvalidRobot, match=message):
        kinseek.Arm.from_dh([(0.5, 0.0, 0.2, 0.0)], [-1.0], [1.0], base=base)
