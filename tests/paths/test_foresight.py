"""What a tracker says of what comes: the poses that it guesses, why and when it stops, and which branch goes on."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import kinseek
from kinseek import InvalidProblem, TrackStatus
from kinseek.paths.past import extrapolated
from kinseek.paths.tracker import Tracker

Array = NDArray[np.float64]


def arc(angles: Array, turning: bool) -> Array:
    """Poses on a circle of 20 cm about an oblique axis, the hand turning with it or not."""
    axis = np.array([1.0, 2.0, 2.0]) / 3.0
    spins = kinseek.pose(np.zeros((len(angles), 3)), rotvec=angles[:, None] * axis)
    centre = kinseek.pose([0.4, 0.1, 0.3], rpy=[0.3, 0.2, 0.1])
    arm = kinseek.pose(np.cross(axis, [1.0, 0.0, 0.0]) * 0.2)
    poses = centre @ spins @ arm
    if not turning:
        poses[:, :3, :3] = poses[0, :3, :3]
    return np.asarray(poses)


@pytest.mark.parametrize("count", [3, 4, 7, 12, 41])
@pytest.mark.parametrize("turning", [False, True])
def test_an_arc_goes_on_as_that_arc(turning: bool, count: int) -> None:
    times = np.array([0.05, 0.5, 1.0, 20.0])
    poses = arc(np.linspace(0.0, 0.02 * (count - 1), count), turning)
    expected = arc(np.concatenate([[0.0], 0.02 * (count - 1 + times)]), turning)[1:]
    assert np.abs(extrapolated(poses, times) - expected).max() < 1e-8


def test_a_line_goes_on_as_a_line_and_a_corner_straight() -> None:
    first, second, third = kinseek.pose([[x, 0.0, 0.5] for x in (0.0, 0.1, 0.2)])
    assert np.allclose(
        extrapolated(np.array([first, second, third]), np.array([3.0]))[0, :3, 3], [0.5, 0, 0.5]
    )
    assert np.allclose(extrapolated(np.array([second, third]), np.array([1.0]))[0, :3, 3], [0.3, 0.0, 0.5])
    corner = np.array([first, second, kinseek.pose([0.1, 0.1, 0.5])])
    assert np.allclose(extrapolated(corner, np.array([1.0]))[0, :3, 3], [0.1, 0.2, 0.5])
    assert np.array_equal(extrapolated(np.array([third] * 3), np.array([1.0, 9.0])), [third, third])


def test_noise_moves_the_extrapolation_little() -> None:
    """From 0.4 s of a line and of an arc, half a second ahead: at most 15 times the noise, where three poses give 21."""
    rng, times = np.random.default_rng(0), np.array([50.0])
    for poses, then in (
        (arc(np.linspace(0.0, 0.4, 41), True), arc(np.linspace(0.0, 0.9, 2), True)[1]),
        (kinseek.pose(np.linspace([0, 0, 0.5], [0.04, 0, 0.5], 41)), kinseek.pose([0.09, 0, 0.5])),
    ):
        off = []
        for _ in range(200):
            shaken = poses.copy()
            shaken[:, :3, 3] += rng.normal(scale=1e-4, size=(41, 3))
            off.append(np.linalg.norm(extrapolated(shaken, times)[0, :3, 3] - then[:3, 3]))
        assert np.sqrt(np.mean(np.square(off))) < 15e-4


def two_links() -> kinseek.Arm:
    """Two links in a plane."""
    return kinseek.Arm.from_dh([(0.3, 0, 0, 0), (0.2, 0, 0, 0)], [-1, -3], [1, 3], name="two links")


def tracked(arm: kinseek.Arm, poses: Array, q0: Array, velocity: float = 1.0) -> Tracker:
    """A tracker that has gone along poses at 100 Hz."""
    tracker = arm.track(q0, period=0.01, velocity=velocity)
    for T in poses:
        assert tracker.step(T).status is TrackStatus.TRACKING
    return tracker


def test_a_limit_on_an_arc_is_foreseen_to_the_period() -> None:
    arm = two_links()
    joints = np.array([[q, 0.5] for q in np.arange(0.5, 1.2, 0.005)])
    tracker = tracked(arm, arm.fk(joints[:60]), joints[0])
    foresight = tracker.foresee(1.0, looks=100)
    assert foresight.status is TrackStatus.LIMIT
    assert foresight.joint == arm.joint_names[0]
    # The 101st pose is the first beyond the limit of 1 rad, and the last that was given was the 60th.
    assert foresight.seconds == pytest.approx(0.42, abs=0.011)
    assert tracker.foresee(0.3).status is TrackStatus.TRACKING
    known = tracker.foresee(poses=arm.fk(joints[60:]))
    assert known[:3] == pytest.approx((TrackStatus.LIMIT, 0.42, arm.joint_names[0]), abs=0.011)
    assert tracker.foresee(poses=arm.fk(joints[60:80])).status is TrackStatus.TRACKING


@pytest.mark.parametrize("dt", [0.001, 0.016])
@pytest.mark.parametrize("refused", [False, True])
def test_the_time_of_the_last_step_changes_no_prediction(dt: float, refused: bool) -> None:
    """The speeds of all steps to come were those of a step of that time; a refused one also changed a twist."""
    arm = kinseek.load("ur5e")
    q = np.deg2rad([0.0, -90, 90, -90, -90, 0])
    trackers = [arm.track(q, period=0.004, velocity=1.5) for _ in range(2)]
    T = arm.fk(q)
    for k in range(60):
        T[0, 3] += 0.0012
        for tracker, each in zip(trackers, (None, dt), strict=True):
            tracker.step(T, dt=each if k == 59 and not refused else None)
    if refused:
        with pytest.raises(kinseek.InvalidGoal):
            trackers[1].step(np.zeros((4, 4)), dt=dt)
    coming = np.repeat(T[None], 100, axis=0)
    coming[:, 0, 3] += 0.0012 * np.arange(1, 101)
    one, other = (tracker.foresee(poses=coming) for tracker in trackers)
    assert one.status is other.status is TrackStatus.TRACKING
    for tracker in trackers:
        tracker.step(twist=[0.1, 0, 0, 0, 0, 0])
    with pytest.raises(kinseek.InvalidGoal):
        trackers[1].step(np.zeros((4, 4)))
    if refused:
        assert (trackers[0].step(twist=np.zeros(6)).q == trackers[1].step(twist=np.zeros(6)).q).all()


def test_asking_changes_nothing() -> None:
    arm = kinseek.load("panda")
    q = np.array([0.1, -0.5, 0.2, -2.0, 0.1, 1.6, 0.4])
    poses = arm.fk(q + np.linspace(0, 1, 120)[:, None] * 0.3)
    quiet, asked = arm.track(q, period=0.01, velocity=2.0), arm.track(q, period=0.01, velocity=2.0)
    for k, T in enumerate(poses):
        assert (quiet.step(T).q == asked.step(T).q).all()
        if k:
            asked.foresee()
    asked.continuing()
    assert (quiet.step(poses[0]).q == asked.step(poses[0]).q).all()


def test_a_singularity_is_told_from_a_joint_that_is_too_slow() -> None:
    arm = kinseek.load("ur5e")
    # Straight out: where the elbow is stretched the branch ends, however fast the joints are.
    q0 = np.array([0.0, -0.6, 0.9, -1.8, -1.5, 0.0])
    T = arm.fk(q0)
    out = np.repeat(T[None], 400, axis=0)
    out[:, :3, 3] += np.arange(400)[:, None] * 0.001 * T[:3, 3] / np.linalg.norm(T[:3, 3])
    tracker = arm.track(q0, period=0.01, velocity=1.5)
    foreseen = None
    for k, row in enumerate(out):
        if tracker.step(row).status is not TrackStatus.TRACKING:
            break
        if k and foreseen is None and tracker.foresee().status is not TrackStatus.TRACKING:
            foreseen = (k, tracker.foresee())
    assert foreseen is not None
    begun, foresight = foreseen
    assert foresight.status is TrackStatus.SINGULAR
    assert k - begun > 50
    assert (begun + 100 * foresight.seconds) == pytest.approx(k, abs=10)
    # A hand that is only too fast.
    quick = np.repeat(T[None], 60, axis=0)
    quick[:, :3, 3] += (np.arange(60)[:, None] / 100.0) ** 2 * [0.0, 0.5, 0.0]
    tracker = arm.track(q0, period=0.01, velocity=0.3)
    for row in quick[:25]:
        tracker.step(row)
    foresight = tracker.foresee(poses=quick[25:])
    assert foresight.status is TrackStatus.LAGGING
    assert foresight.joint in arm.joint_names


def three_links(least: float) -> kinseek.Arm:
    """Three links in a plane, whose last joint goes from `least` to 1 rad: elbow up and elbow down."""
    rows = [(0.3, 0, 0, 0), (0.3, 0, 0, 0), (0.1, 0, 0, 0)]
    return kinseek.Arm.from_dh(rows, [-3, -3, least], [3, 3, 1], name="three links")


def test_the_branch_that_goes_on_goes_on() -> None:
    joints = np.array([[0.3, -1.0, q] for q in np.arange(0.5, 1.4, 0.005)])
    arm = three_links(-1.0)
    poses = arm.fk(joints)
    tracker = tracked(arm, poses[:60], joints[0])
    foresight = tracker.foresee()
    assert (foresight.status, foresight.joint) == (TrackStatus.LIMIT, arm.joint_names[2])
    # With the elbow the other way: q1 + q2, -q2, q3 + q2.
    branch = tracker.continuing()
    assert branch is not None
    assert branch == pytest.approx(joints[59] + [-1.0, 2.0, -1.0], abs=1e-5)
    way = tracker.switch(branch)
    assert np.allclose(way[-1], branch)
    assert (np.abs(np.diff(way, axis=0)) <= 0.01 * (1 + 1e-9)).all()
    for _ in way:
        assert tracker.step(poses[59]).status is TrackStatus.SWITCHED
    for T in poses[60:]:
        assert tracker.step(T).status is TrackStatus.TRACKING


def test_where_no_branch_goes_on_none_is_named() -> None:
    joints = np.array([[0.3, -1.0, q] for q in np.arange(0.5, 1.4, 0.005)])
    arm = three_links(0.0)  # The other branch is inside the limits from 1 rad on: where this one ends.
    tracker = tracked(arm, arm.fk(joints[:60]), joints[0])
    assert tracker.foresee().status is TrackStatus.LIMIT
    assert tracker.continuing() is None


def test_misuse_is_refused() -> None:
    arm = kinseek.load("ur5e")
    T = arm.fk([0.2, -1.2, 1.6, -0.4, 0.5, 0.3])
    tracker = arm.track([0.2, -1.2, 1.6, -0.4, 0.5, 0.3], velocity=1.0)
    for ask in (tracker.foresee, tracker.continuing):
        with pytest.raises(InvalidProblem, match="needs two poses"):
            ask()
    tracker.step(T)
    tracker.step(T)
    wrong: list[Any] = [0.0, np.inf, np.nan, True, "1", None, [], np.array([1.0]), 10**400, np.float16(1e-8)]
    for seconds in wrong:
        with pytest.raises(InvalidProblem, match="seconds must be a number from 1e-09 to 1e"):
            tracker.foresee(seconds)
    with pytest.raises(InvalidProblem, match="looks must be a whole number of at least 1, got 0"):
        tracker.foresee(looks=0)
    with pytest.raises(InvalidProblem, match="must reach the last pose"):
        tracker.switch(np.zeros(6))
    with pytest.raises(InvalidProblem, match="to must have shape"):
        tracker.switch(np.zeros(5))
    with pytest.raises(kinseek.InvalidGoal):
        tracker.foresee(poses=np.zeros((3, 4, 4)))
