"""Poses from two directions: one axis is exact, the other one is orthogonalised against it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import kinseek
from kinseek import InvalidGoal

Array = NDArray[np.float64]

PAIRS = [("z_axis", "x_axis"), ("z_axis", "y_axis"), ("x_axis", "y_axis")]
P = [0.4, 0.2, 0.3]


def column(T: Array, name: str) -> Array:
    return T[..., :3, "xyz".index(name[0])]


@pytest.mark.parametrize(("exact", "other"), PAIRS)
@given(
    seed=st.integers(0, 2**32 - 1),
    off=st.floats(-1.55, 1.55),
    lengths=st.tuples(*[st.floats(1e-6, 1e200)] * 2),
)
def test_the_first_axis_is_exact_and_the_second_is_the_nearest_direction(
    exact: str, other: str, seed: int, off: float, lengths: tuple[float, float]
) -> None:
    turn = Rotation.random(random_state=seed).as_matrix()
    a, b = turn[:, "xyz".index(exact[0])], turn[:, "xyz".index(other[0])]
    oblique = math.cos(off) * b + math.sin(off) * a
    axes: dict[str, Any] = {other: lengths[1] * oblique, exact: lengths[0] * a}
    T = kinseek.pose(P, **axes, skew=math.pi / 2)
    # The nearest direction to `oblique` at right angles to a is b, since it lies in the plane of both.
    # Rounding of `oblique` counts the more, the nearer it is to a.
    np.testing.assert_allclose(T[:3, :3], turn, rtol=0, atol=3e-15 / math.cos(off))
    np.testing.assert_allclose(column(T, exact), a, rtol=0, atol=1e-15)
    np.testing.assert_allclose(T[:3, :3].T @ T[:3, :3], np.eye(3), rtol=0, atol=2e-15)
    assert np.linalg.det(T[:3, :3]) > 0
    np.testing.assert_array_equal(T[:3, 3], P)


def test_the_order_of_the_arguments_does_not_matter() -> None:
    n, t = np.array([0.1, 0.0, -1.0]), np.array([1.0, 0.05, 0.0])
    T = kinseek.pose(P, z_axis=n, x_axis=t)
    np.testing.assert_array_equal(T, kinseek.pose(P, x_axis=t, z_axis=n))
    np.testing.assert_allclose(column(T, "z"), n / np.linalg.norm(n), rtol=0, atol=2e-16)


@pytest.mark.parametrize(("exact", "other"), PAIRS)
def test_a_batch_equals_its_rows(exact: str, other: str) -> None:
    rng = np.random.default_rng(3)
    turns = Rotation.random(12, random_state=3).as_matrix().reshape(3, 4, 3, 3)
    a, b = column(turns, exact), column(turns, other) + 0.05 * rng.normal(size=(3, 4, 3))
    places = rng.normal(size=(4, 3))
    axes: dict[str, Any] = {exact: a, other: b}
    poses = kinseek.pose(places, **axes)
    for i, k in np.ndindex(3, 4):
        one: dict[str, Any] = {exact: a[i, k], other: b[i, k]}
        np.testing.assert_array_equal(poses[i, k], kinseek.pose(places[k], **one))
    shared = kinseek.pose(places, z_axis=[0, 0, -2], x_axis=[1, 0, 0])
    np.testing.assert_array_equal(shared, kinseek.pose(places, rotation=np.diag([1.0, -1.0, -1.0])))
    none = np.zeros((0, 3))
    assert kinseek.pose(none, z_axis=none, x_axis=[1, 0, 0]).shape == (0, 4, 4)
    assert kinseek.pose(P, z_axis=[0, 0, 1], y_axis=np.tile([0, 1, 0], (5, 1))).shape == (5, 4, 4)


def leaning(angle: float) -> list[float]:
    """A direction at `angle` [degrees] from the z axis."""
    return [math.sin(math.radians(angle)), 0.0, math.cos(math.radians(angle))]


@pytest.mark.parametrize(
    ("axes", "said"),
    [
        ({"z_axis": [0, 0, 1]}, "exactly two of z_axis, x_axis and y_axis, got z_axis"),
        ({"z_axis": [0, 0, 1], "x_axis": [1, 0, 0], "y_axis": [0, 1, 0]}, "got z_axis and x_axis and y_axis"),
        ({"z_axis": [0, 0, 1], "x_axis": leaning(70)}, r"within 10° of 90°, got 70°; .*skew="),
        ({"z_axis": [0, 0, 1], "x_axis": leaning(101)}, r"within 10° of 90°, got 101°; .*skew="),
        ({"z_axis": [0, 0, 1], "x_axis": leaning(80), "skew": 0.1}, r"within 5.73° of 90°, got 80°"),
        (
            {"z_axis": [0, 0, 2], "y_axis": [0, 0, 3], "skew": math.pi / 2},
            "z_axis and y_axis are parallel.*got 0°",
        ),
        ({"x_axis": [0, 0, 2], "y_axis": [0, 0, -3]}, "parallel: expected an angle of about 90°.*got 180°"),
        ({"z_axis": [0, 0, 0], "x_axis": [1, 0, 0]}, r"z_axis must be longer than 1e-09, got \[0, 0, 0\]"),
        ({"z_axis": [0, 0, 1], "x_axis": [math.nan, 0, 0]}, "x_axis contains NaN or infinity"),
        ({"z_axis": [0, 0, math.inf], "x_axis": [1, 0, 0]}, "z_axis contains NaN or infinity"),
        (
            {"z_axis": [0, 1], "x_axis": [1, 0, 0]},
            r"z_axis must have shape \(3,\) or \(\.\.\., 3\), got \(2,\)",
        ),
        ({"z_axis": "up", "x_axis": [1, 0, 0]}, "z_axis must be numbers"),
        (
            {"z_axis": np.ones((2, 3)), "x_axis": np.ones((3, 3))},
            r"shapes \(2, 3\) and \(3, 3\) do not broadcast",
        ),
        (
            {"z_axis": [0, 0, 1], "x_axis": [1, 0, 0], "rpy": [0, 0, 0]},
            "one rotation, got rpy and z_axis and x_axis",
        ),
        ({"z_axis": [0, 0, 1], "x_axis": [1, 0, 0], "degrees": True}, "z_axis has no unit"),
        ({"z_axis": [0, 0, 1], "x_axis": [1, 0, 0], "repair": True}, "repair=True is for matrices"),
        (
            {"z_axis": [0, 0, 1], "x_axis": [1, 0, 0], "skew": 10},
            "skew must be a number from 0 to 1.5708, got 10",
        ),
        ({"z_axis": [0, 0, 1], "x_axis": [1, 0, 0], "skew": math.nan}, "skew must be a number"),
        ({"rpy": [0, 0, 0], "skew": 0.1}, "skew= is for directions"),
    ],
)
def test_directions_that_make_no_rotation_are_refused(axes: dict[str, Any], said: str) -> None:
    with pytest.raises(InvalidGoal, match=said):
        kinseek.pose(P, **axes)


def test_the_row_of_a_batch_is_named() -> None:
    tangents = np.tile([1.0, 0.0, 0.0], (2, 5, 1))
    tangents[1, 3] = leaning(45)
    with pytest.raises(InvalidGoal, match=r"10° of 90° at index \(1, 3\) of the batch, got 45°"):
        kinseek.pose(P, z_axis=[0, 0, 1], x_axis=tangents)
    tangents[1, 2] = 0.0
    with pytest.raises(InvalidGoal, match=r"x_axis must be longer than 1e-09 at index \(1, 2\) of the batch"):
        kinseek.pose(P, z_axis=[0, 0, 1], x_axis=tangents)


def test_a_whole_pose_has_its_axes_already() -> None:
    with pytest.raises(InvalidGoal, match=r"a whole pose, .* cannot be combined with z_axis and x_axis"):
        kinseek.pose(np.eye(4), z_axis=[0, 0, 1], x_axis=[1, 0, 0])
