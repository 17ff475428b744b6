"""Targets of a tracker other than whole poses: twists, velocities of joints, none; and what a redundant arm prefers."""

from __future__ import annotations

import time
from typing import Any, cast

import numpy as np
import pytest
from numpy.typing import NDArray

import kinseek
from kinseek import Goal, InvalidProblem, TrackStatus
from kinseek.branches.order import ORDERS, Order
from ros_messages import Point, Pose, Quaternion

Array = NDArray[np.float64]

HOME = np.array([0, -1.57, 1.57, -1.57, -1.57, 0])
PANDA = np.array([0, -0.5, 0, -2, 0, 1.6, 0.7])
LIMITS: dict[str, Any] = {"velocity": 1.5, "acceleration": 20.0}


@pytest.mark.parametrize("jerk", [None, 1000.0])
@pytest.mark.parametrize("axes", ["base", "tool"])
def test_a_twist_moves_the_hand_and_lets_it_rest(axes: Any, jerk: float | None) -> None:
    arm, h = kinseek.load("ur5e"), 0.002
    tracker, T0 = arm.track(HOME, h, **LIMITS, jerk=jerk), arm.fk(HOME)
    twist = np.array([0.1, -0.05, 0.02, 0.0, 0.0, 0.4])
    for _ in range(500):
        step = tracker.step(twist=twist, axes=axes)
    assert step.status is TrackStatus.TRACKING
    # At full speed the hand moves by the twist, by central differences of forward kinematics.
    before, after = arm.fk(tracker.q), arm.fk(tracker.step(twist=twist, axes=axes).q)
    R = np.eye(3) if axes == "base" else before[:3, :3]
    np.testing.assert_allclose((after - before)[:3, 3] / h, R @ twist[:3], atol=1e-3)
    turn = (after[:3, :3] @ before[:3, :3].T - np.eye(3)) / h
    np.testing.assert_allclose([turn[2, 1], turn[0, 2], turn[1, 0]], R @ twist[3:], atol=1e-3)
    released, q = arm.fk(tracker.q), [tracker.q]
    for _ in range(400):
        step = tracker.step(twist=np.zeros(6))
        q.append(step.q)
    assert step.status is TrackStatus.TRACKING
    assert not step.velocity.any()
    moved = arm.fk(np.array(q))[:, :3, 3] - released[:3, 3]
    along = moved @ (R @ twist[:3]) / np.linalg.norm(twist[:3])
    assert along.max() - along[-1] < 2e-4, "the hand goes back after the twist has ended"
    assert np.linalg.norm(released - T0) > 0.05


def test_a_straight_twist_keeps_the_orientation() -> None:
    arm = kinseek.load("ur5e")
    tracker, T0 = arm.track(HOME, 0.002, **LIMITS, jerk=1000.0), arm.fk(HOME)
    for k in range(1500):
        tracker.step(twist=[0.1 * np.cos(k / 200), 0.1 * np.sin(k / 200), 0, 0, 0, 0])
    T = arm.fk(tracker.q)
    assert np.abs(T[:3, :3] - T0[:3, :3]).max() < 1e-3


def test_at_the_edge_a_twist_slides_and_comes_back_at_once() -> None:
    arm = kinseek.load("ur5e")
    tracker = arm.track(HOME, 0.002, **LIMITS)
    for _ in range(4000):
        step = tracker.step(twist=[0.2, 0.05, 0, 0, 0, 0])
    assert step.status in (TrackStatus.SINGULAR, TrackStatus.LAGGING, TrackStatus.LIMIT)
    lost = tracker.singular_direction()
    assert lost is not None
    assert abs(np.linalg.norm(lost) - 1) < 1e-12
    edge = arm.fk(tracker.q)[0, 3]
    for _ in range(250):
        step = tracker.step(twist=[-0.2, 0, 0, 0, 0, 0])
    assert edge - arm.fk(tracker.q)[0, 3] > 0.03


@pytest.mark.parametrize("jerk", [None, 1000.0])
def test_velocities_of_joints_end_at_limits(jerk: float | None) -> None:
    arm = kinseek.load("panda")
    tracker, wanted = arm.track(PANDA, 0.002, **LIMITS, jerk=jerk), np.array([0.5, 0, 0, 0, -0.3, 0, 0])
    for _ in range(300):
        step = tracker.step(velocity=wanted)
    assert step.status is TrackStatus.TRACKING
    np.testing.assert_allclose(step.velocity, wanted, atol=1e-9)
    assert np.isnan(step.position_error)
    for _ in range(6000):
        step = tracker.step(velocity=wanted)
    assert step.status is TrackStatus.LIMIT
    assert step.limited == (arm.joint_names[0], "position") or step.limited == (
        arm.joint_names[4],
        "position",
    )
    assert abs(step.q[0] - arm.upper[0]) < 1e-6
    assert not np.abs(step.velocity).max() > 1e-6


def test_without_a_target_the_arm_stops_and_goes_on() -> None:
    arm, bad = kinseek.load("ur5e"), np.eye(4)
    bad[0, 3] = np.nan
    for nothing in ((), (bad,), (bad.tolist(),)):
        tracker, T = arm.track(HOME, 0.002, **LIMITS, jerk=1000.0), arm.fk(HOME)
        for _ in range(300):
            T[0, 3] -= 0.0002
            tracker.step(T)
        assert np.abs(tracker.step(T).velocity).max() > 0.05
        for _ in range(100):
            step = tracker.step(*nothing)
            assert step.status is TrackStatus.STOPPING
        assert not step.velocity.any()
        for _ in range(300):
            step = tracker.step(T)
        assert step.status is TrackStatus.TRACKING
    tracker.step(twist=[np.nan, 0, 0, 0, 0, 0])
    for huge in (
        np.inf,
        1.7e308,
        1.1e7,
    ):  # The second one overflowed, and all joint values were NaN from then on.
        step = tracker.step(velocity=np.full(6, huge))
        assert step.status is TrackStatus.STOPPING
        assert np.isfinite(step.q).all()
    assert tracker.step(velocity=np.full(6, 0.9e7)).status is TrackStatus.LAGGING


def test_a_position_may_be_three_numbers() -> None:
    arm = kinseek.load("so101")
    q = 0.5 * (arm.lower + arm.upper) + 0.1
    p = arm.fk(q)[:3, 3]
    tracker = arm.track(q, 0.01, velocity=1.5, acceleration=10.0, goal=Goal.position(p))
    for k in range(200):
        target = p + np.array([0.0, 0.02 * np.sin(k / 40), 0.01])
        step = tracker.step(target)
    assert step.status is TrackStatus.TRACKING
    assert np.linalg.norm(arm.fk(step.q)[:3, 3] - target) < 1e-6


@pytest.mark.parametrize(
    "goal", [Goal.pointing([0, 0, 0], [0, 0, 1]), Goal.pose(np.eye(4), free="rz", cone=0.2)]
)
def test_free_axes_within_limits(goal: Goal) -> None:
    arm, rows = kinseek.load("so101"), []
    q = 0.5 * (arm.lower + arm.upper) + 0.1
    tracker, T = arm.track(q, 0.004, **LIMITS, goal=goal), arm.fk(q)
    for k in range(1000):
        T[1, 3] += 1e-4 * np.sin(k / 60)
        step = tracker.step(T)
        rows.append(step.q)
    assert step.status in (TrackStatus.TRACKING, TrackStatus.LAGGING)
    assert np.abs(np.diff(rows, 2, axis=0) / 0.004**2).max() < 20.0 * (1 + 1e-9) + 1e-8


def test_wrong_targets_are_refused() -> None:
    tracker = kinseek.load("ur5e").track(HOME)
    for options, message in (
        ({"twist": [1, 2]}, "twist must be 6 numbers"),
        ({"velocity": [1, 2]}, "velocity must be 6 numbers"),
        ({"twist": np.zeros(6), "velocity": np.zeros(6)}, "takes one target"),
        ({"twist": np.zeros(6), "axes": "tol"}, "'tool'"),
    ):
        with pytest.raises(InvalidProblem, match=message):
            tracker.step(**options)


@pytest.mark.parametrize(
    "prefer",
    [
        *ORDERS,
        {"arm_angle": 0.6},
        list(PANDA + np.array([0.5, 0, -0.5, 0, 0.3, 0, 0])),
    ],
)
def test_a_redundant_arm_drifts_to_what_it_prefers(prefer: Any) -> None:
    arm, h = kinseek.load("panda"), 0.004
    start = PANDA + np.array([0.4, 0.2, -0.5, 0.1, 0.4, 0.1, -0.3])
    tracker, T, rows = arm.track(start, h, **LIMITS, prefer=prefer, prefer_speed=0.3), arm.fk(start), [start]
    for _ in range(2000):
        step = tracker.step(T)
        assert step.position_error < 1e-6
        rows.append(step.q)
    assert step.status is TrackStatus.TRACKING
    moved, q = np.abs(np.diff(rows, axis=0)).max() / h, np.array([start, step.q])
    assert 1e-3 < moved <= 0.3 * 1.02, "the drift is no faster than allowed, up to its curvature"
    away = (q - (arm.lower + arm.upper) / 2) / (arm.upper - arm.lower)
    J = arm.jacobian(q)
    costs = {
        "mid-range": np.linalg.norm(away, axis=1),
        "limits": (away**4).sum(axis=1),
        "dexterity": -np.linalg.det(J @ np.swapaxes(J, 1, 2)),
    }
    if isinstance(prefer, str):
        before, after = costs[prefer]
        assert after < before
    elif isinstance(prefer, list):
        assert np.abs(step.q - prefer).sum() < np.abs(start - prefer).sum()
    else:
        solution = arm.ik(arm.fk(step.q), near=step.q)
        assert abs(solution.configuration["arm_angle"] - 0.6) < 1e-2


def test_an_order_that_no_drift_follows_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    """Not the drift to the middle of the ranges under another name."""
    monkeypatch.setattr("kinseek.paths.drift.ORDERS", (*ORDERS, "new"))
    arm, new = kinseek.load("panda"), cast("Order", "new")
    tracker = arm.track(PANDA, **LIMITS, prefer=new)
    with pytest.raises(AssertionError, match="unreachable"):
        tracker.step(arm.fk(PANDA))


def test_refused_and_repaired_poses_change_no_drift() -> None:
    """The preference moved on in each of them, though the tracker did not."""
    arm, q = kinseek.load("panda"), np.array([0.1, -0.5, 0.2, -2.0, 0.1, 1.6, 0.4])
    plain, other, third = (arm.track(q, 0.004, velocity=1.0, prefer="mid-range") for _ in range(3))
    T = arm.fk(q)
    rounded = T.copy()
    rounded[:3, :3] += 1e-8
    for _ in range(80):
        with pytest.raises(kinseek.InvalidGoal):
            other.step(np.zeros((4, 4)))
        assert (plain.step(T).q == other.step(T).q).all()
        assert np.abs(third.step(rounded).q - other.q).max() < 1e-6


def test_preferences_change_on_the_way_and_wrong_ones_are_refused() -> None:
    panda, ur5e = kinseek.load("panda"), kinseek.load("ur5e")
    tracker = panda.track(PANDA, 0.004, velocity=1.5)
    for angle in (0.2, -0.2):
        tracker.prefer({"arm_angle": angle})
        for _ in range(1500):
            q = tracker.step(panda.fk(PANDA)).q
        assert abs(panda.ik(panda.fk(q), near=q).configuration["arm_angle"] - angle) < 1e-2
    for wrong in ("midrange", {"elbow": "up"}, np.zeros(6), {"arm_angle": np.nan}):
        with pytest.raises(InvalidProblem):
            panda.track(PANDA, prefer=wrong)
    with pytest.raises(InvalidProblem, match="finite number of solutions"):
        ur5e.track(HOME, prefer="limits")
    for goal in (Goal.pose(np.eye(4), free="rz", cone=0.17), Goal.pose(np.eye(4), box={"z": (-0.02, 0.02)})):
        with pytest.raises(InvalidProblem, match="takes goals of a whole pose, a direction, a position, got"):
            panda.track(PANDA, goal=goal, prefer="limits")


def test_a_very_long_period_is_one_step() -> None:
    arm = kinseek.load("ur5e")
    q = np.array([0.0, -1.2, 1.5, -1.8, -1.5, 0.0])
    tracker = arm.track(q, 0.002, velocity=1.0)
    tracker.step(arm.fk(q))
    begun = time.perf_counter()
    assert tracker.step(arm.fk(q), dt=1e8).status is TrackStatus.TRACKING
    assert time.perf_counter() - begun < 1.0


def test_nan_in_a_message_brakes() -> None:
    arm = kinseek.load("ur5e")
    q = np.array([0.0, -1.2, 1.5, -1.8, -1.5, 0.0])
    tracker = arm.track(q, 0.002, velocity=1.0)
    for x in (np.nan, 0.3):
        message = Pose(position=Point(x=x, y=0.1, z=0.2), orientation=Quaternion(x=1.0, y=0.0, z=0.0, w=0.0))
        assert (tracker.step(message).status is TrackStatus.STOPPING) == np.isnan(x)


def test_axes_of_a_pose_are_refused() -> None:
    arm = kinseek.load("ur5e")
    q = np.array([0.0, -1.2, 1.5, -1.8, -1.5, 0.0])
    tracker = arm.track(q, 0.002, velocity=1.0)
    with pytest.raises(InvalidProblem, match="axes of a twist"):
        tracker.step(arm.fk(q), axes="tol")  # type: ignore[arg-type]
    with pytest.raises(InvalidProblem, match="axes='tool' is for twist=, got a pose"):
        tracker.step(arm.fk(q), axes="tool")


def test_the_way_to_another_branch_ends_with_nan() -> None:
    """It would go on from where the joints are not any more."""
    arm = kinseek.load("ur5e")
    q = np.array([0.0, -1.2, 1.5, -1.8, -1.5, 0.0])
    tracker = arm.track(q, 0.002, velocity=1.0, acceleration=10.0)
    T = arm.fk(q)
    tracker.step(T)
    tracker.switch()
    for _ in range(100):
        assert tracker.step(T).status is TrackStatus.SWITCHED
    assert tracker.step(np.full((4, 4), np.nan)).status is TrackStatus.STOPPING
    assert tracker.step(T).status is not TrackStatus.SWITCHED
