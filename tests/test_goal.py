"""Goals: every way to write a pose, every way to get it wrong, and what kernels are given."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import transform
from scipy.spatial.transform import Rotation

import kinseek
from kinseek import Goal, pose
from kinseek.errors import InvalidGoal

TURN = Rotation.from_rotvec([0.3, -0.8, 1.1])
PLACE = np.array([0.1, -0.2, 0.3])


def reference_pose() -> np.ndarray:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = TURN.as_matrix(), PLACE
    return T


@pytest.mark.parametrize(
    "named",
    [
        {"quat_xyzw": TURN.as_quat()},
        {"quat_xyzw": -3 * TURN.as_quat()},
        {"quat_wxyz": np.roll(TURN.as_quat(), 1)},
        {"rpy": TURN.as_euler("xyz")},
        {"rotvec": TURN.as_rotvec()},
    ],
    ids=lambda named: next(iter(named)),
)
def test_every_notation_gives_the_same_pose(named: dict[str, Any]) -> None:
    np.testing.assert_allclose(pose(PLACE, **named), reference_pose(), atol=1e-15)


def test_rpy_is_that_of_urdf() -> None:
    pinocchio = pytest.importorskip("pinocchio")
    turned = pinocchio.rpy.rpyToMatrix(0.4, -0.7, 2.0)
    np.testing.assert_allclose(pose([0, 0, 0], rpy=[0.4, -0.7, 2.0])[:3, :3], turned, atol=1e-15)


def test_no_rotation_is_no_turn_and_batches_broadcast() -> None:
    np.testing.assert_array_equal(pose([1, 2, 3])[:3], np.c_[np.eye(3), [1, 2, 3]])
    assert pose(np.zeros((5, 1, 3)), rotvec=np.zeros((2, 3))).shape == (5, 2, 4, 4)
    assert pose(np.zeros((0, 3))).shape == (0, 4, 4)
    with pytest.raises(InvalidGoal, match="do not broadcast"):
        pose(np.zeros((5, 3)), rotvec=np.zeros((2, 3)))


def deep(levels: int) -> Any:
    """Return a number inside of that many lists."""
    return [deep(levels - 1)] if levels else 0.0


@pytest.mark.parametrize(
    ("position", "named", "words"),
    [
        ([0, 0], {}, r"position must have shape \(3,\) or \(..., 3\), got \(2,\)"),
        ([0, 0, np.nan], {}, "position contains NaN or infinity"),
        ("here", {}, "position must be numbers"),
        ([[1, [2, 3]], 0.4, 0.3], {}, "a pose must be .* got list"),
        ([deep(70), 0.4, 0.3], {}, "a pose must be .* got list"),
        ([0, 0, 0], {"rpy": [0, 0, 0], "degrees": np.ones(3)}, "degrees must be True or False, got array"),
        ([0, 0, 0], {"rotation": np.eye(3), "repair": np.ones(3)}, "repair must be True or False, got array"),
        ([0, 0, 0], {"quat_wxyz": [0, 0, 0, 0]}, "zero quaternion is not a rotation"),
        ([0, 0, 0], {"quat_xyzw": [0, 0, 1]}, r"quat_xyzw must have shape \(4,\)"),
        ([0, 0, 0], {"rpy": [0, np.inf, 0]}, "rpy contains NaN or infinity"),
        ([0, 0, 0], {"rpy": [0, 0, 0], "rotvec": [0, 0, 0]}, "give one rotation, got rpy and rotvec"),
    ],
)
def test_a_pose_written_wrong(position: Any, named: dict[str, Any], words: str) -> None:
    with pytest.raises(InvalidGoal, match=words):
        pose(position, **named)


class Carrier:
    """Like spatialmath's SE3: the matrix is in `.A`."""

    A = reference_pose()


class Method:
    """Like SciPy's RigidTransform."""

    def as_matrix(self) -> np.ndarray:
        return reference_pose()


def foreign() -> list[Any]:
    pinocchio = pytest.importorskip("pinocchio")
    objects = [pinocchio.SE3(TURN.as_matrix(), PLACE), Carrier(), Method(), reference_pose().tolist()]
    if hasattr(transform, "RigidTransform"):
        objects.append(transform.RigidTransform.from_components(PLACE, TURN))
    return objects


@pytest.mark.parametrize("carrier", foreign(), ids=lambda carrier: type(carrier).__name__)
def test_foreign_objects(carrier: Any) -> None:
    np.testing.assert_allclose(Goal.pose(carrier).target, reference_pose(), atol=1e-15)
    arm = kinseek.load("planar2")
    assert arm.ik(carrier, solver=kinseek.DivideAndConquer()).q.shape == (2,)
    if not isinstance(carrier, list):
        assert Goal.pose([carrier, carrier]).shape == (2,)


@pytest.mark.parametrize(
    ("target", "words"),
    [
        (np.zeros(7), r"got \(7,\); write kinseek.pose\(position, quat_wxyz"),
        (np.eye(3), r"got \(3, 3\); this is a rotation alone"),
        (TURN, r"got \(3, 3\); this is a rotation alone"),
        (np.zeros(3), "Goal.position"),
        (np.zeros((2, 3, 4)), r"must have shape \(4, 4\) or \(..., 4, 4\), got \(2, 3, 4\)"),
        ("there", "got str"),
        (None, "a pose must"),
        (object(), "got object"),
    ],
)
def test_not_a_pose(target: Any, words: str) -> None:
    with pytest.raises(InvalidGoal, match=words):
        Goal.pose(target)


def test_not_a_rotation_says_how_far_off() -> None:
    off = reference_pose()
    off[:3, 0] *= 1.01
    with pytest.raises(InvalidGoal, match=r"RᵀR differs from the identity by 0\.0201 .*more is rejected"):
        Goal.pose(off)
    with pytest.raises(InvalidGoal, match="its determinant is -1, a reflection"):
        Goal.pose(np.diag([1.0, 1.0, -1.0, 1.0]))
    row = np.eye(4)
    row[3, 3] = 2.0
    with pytest.raises(InvalidGoal, match=r"its last row differs from \[0, 0, 0, 1\] by 1"):
        Goal.pose(row)
    batch = np.stack([np.eye(4)] * 6).reshape(2, 3, 4, 4)
    batch[1, 2, 0, 0] = 3.0
    with pytest.raises(
        InvalidGoal, match=r"at index \(1, 2\) of the batch: RᵀR differs from the identity by 8"
    ):
        Goal.pose(batch)


def test_a_nearly_rigid_transform_is_repaired() -> None:
    rough = np.round(reference_pose(), 7)
    target = Goal.pose(rough).target
    np.testing.assert_allclose(target[:3, :3].T @ target[:3, :3], np.eye(3), atol=1e-15)
    np.testing.assert_allclose(target, rough, atol=1e-6)
    assert np.abs(rough[:3, :3].T @ rough[:3, :3] - np.eye(3)).max() > 1e-9


def test_nan_names_its_place_in_the_batch() -> None:
    batch = np.stack([np.eye(4)] * 5)
    batch[3, 0, 3] = np.nan
    batch[4, 1, 1] = np.inf
    with pytest.raises(InvalidGoal, match=r"NaN or infinity at index 3 of the batch \(2 such poses\)"):
        Goal.pose(batch)


@pytest.mark.parametrize(
    "name", ["position_tolerance", "orientation_tolerance", "position_weight", "orientation_weight"]
)
@pytest.mark.parametrize("value", [-1.0, np.nan, np.inf, "small", None, [1.0]])
def test_options_out_of_range(name: str, value: Any) -> None:
    with pytest.raises(InvalidGoal, match=f"{name} must be a finite number"):
        Goal.pose(np.eye(4), **{name: value})


def test_zero_tolerance_is_fine_and_zero_weight_is_not() -> None:
    assert Goal.pose(np.eye(4), position_tolerance=0).position_tolerance == 0
    with pytest.raises(InvalidGoal, match="position_weight must be a finite number > 0"):
        Goal.pose(np.eye(4), position_weight=0.0)
    with pytest.raises(InvalidGoal, match="kind must be one of 'pose', 'pointing', 'position', got 'place'"):
        Goal(np.eye(4), kind="place")


VECTOR = st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda v: np.linalg.norm(v) > 1e-3)


@given(VECTOR, VECTOR)
def test_pointing_aligns_the_tool_axis(direction: tuple[float, ...], tool_axis: tuple[float, ...]) -> None:
    goal = Goal.pointing([1, 2, 3], direction, tool_axis)
    before = goal.target.copy()
    wanted = np.array(direction) / np.linalg.norm(direction)
    np.testing.assert_allclose(goal.target[:3, :3] @ goal.tool_axis, wanted, atol=1e-12)
    np.testing.assert_allclose(goal.targets[0, :, 0], wanted, atol=1e-12)
    np.testing.assert_array_equal(goal.target, before)


@pytest.mark.parametrize(
    ("direction", "axis"), [([0, 0, 0], [0, 0, 1]), ([0, 0, 1], [0, 0, 0]), ([0, 0], [0, 0, 1])]
)
def test_pointing_refuses_zero_vectors(direction: list[float], axis: list[float]) -> None:
    with pytest.raises(InvalidGoal):
        Goal.pointing([0, 0, 0], direction, axis)


@pytest.mark.parametrize(
    ("axis", "words"),
    [("abc", "must be numbers"), ((0, 0), r"must have shape \(3,\)"), ((0, 0, 0), "must be one vector")],
)
def test_axes_of_goals_made_directly_are_checked(axis: Any, words: str) -> None:
    ranges = Goal.pose(np.eye(4), box={"x": (-0.1, 0.1)}, free="rx").ranges
    with pytest.raises(InvalidGoal, match=f"tool_axis {words}"):
        Goal(np.eye(4), kind="pointing", tool_axis=axis)
    with pytest.raises(InvalidGoal, match=f"swing {words}"):
        Goal(np.eye(4), kind="box", ranges=ranges, swing=axis)


@given(VECTOR)
def test_axes_of_goals_have_length_one(axis: tuple[float, float, float]) -> None:
    goal = Goal(np.eye(4), kind="pointing", tool_axis=axis)
    # An axis whose length is 1 up to rounding stays as it is.
    assert goal.tool_axis == pytest.approx(Goal.pointing([0, 0, 0], [0, 0, 1], axis).tool_axis, abs=1e-15)
    assert Goal(np.eye(4), kind="pointing", tool_axis=goal.tool_axis).tool_axis == goal.tool_axis


def test_pointing_and_position_leave_the_rest_free() -> None:
    arm = kinseek.load("elbow6")
    q = np.random.default_rng(0).uniform(arm.lower, arm.upper)
    T = arm.fk(q)
    spun = T @ pose([0, 0, 0], rotvec=[0, 0, 1.0])
    near = np.clip(q + 0.01, arm.lower, arm.upper)
    for goal in (Goal.pointing(T[:3, 3], T[:3, 2]), Goal.position(T[:3, 3])):
        solution = arm.ik(goal, near=near, solver=kinseek.CoordinateDescent(most_sweeps=1000, stall=0.0))
        assert solution.success
        np.testing.assert_allclose(arm.fk(solution.q)[:3, 3], T[:3, 3], atol=2e-6)
    pointing = arm.ik(Goal.pointing(spun[:3, 3], spun[:3, 2]), near=q, solver=kinseek.CoordinateDescent())
    np.testing.assert_array_equal(pointing.q, q)


def test_batches_of_positions() -> None:
    goal = Goal.position(np.zeros((4, 2, 3)))
    assert goal.shape == (4, 2)
    assert goal.targets.shape == (8, 3, 4)
    assert goal.at(np.eye(4)).kind == "position"
