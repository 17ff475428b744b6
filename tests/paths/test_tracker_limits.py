"""Limits of velocity, acceleration and jerk: kept in every step, whatever comes, and the arm can always stop."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import kinseek
from kinseek import InvalidProblem, TrackStatus
from kinseek.kernels.paths.limited import FOLLOW, GO, Motion, Room, limited_step

Array = NDArray[np.float64]

HOMES = {
    "ur5e": [0, -1.57, 1.57, -1.57, -1.57, 0],
    "panda": [0, -0.5, 0, -2, 0, 1.6, 0.7],
    "irb120": [0, 0.3, 0.2, 0, 0.6, 0],
    "so101": [0.1, 0.1, 0.1, 0.1, 0.1],
}
LIMITS: dict[str, Any] = {"velocity": 1.5, "acceleration": 20.0, "jerk": 1000.0}


def differences(q: Array, times: Array) -> list[Array]:
    """Velocities, accelerations and jerks of joint values, (k, n) each, of which the first row is at rest."""
    h, found = np.asarray(times)[:, None], [np.asarray(q)]
    for _ in range(3):
        rows = found[-1] if len(found) == 1 else np.vstack([np.zeros(q.shape[1]), found[-1]])
        found.append(np.diff(rows, axis=0) / h)
    return found[1:]


def require_kept(q: Array, times: Array, limits: dict[str, Any]) -> None:
    """Differences divided by the duration exceed no limit by more than rounding of the joint values explains."""
    ulp, h = np.spacing(np.abs(q).max()), np.asarray(times).min()
    for order, (name, found) in enumerate(zip(LIMITS, differences(q, times), strict=True), 1):
        if limits.get(name) is not None:
            assert np.abs(found).max() <= limits[name] * (1 + 1e-9) + 8 * ulp / h**order, name


def motion(n: int, limits: Array, lower: float, upper: float) -> Motion:
    rows = (lower, upper, *limits, *np.zeros(11))
    return Motion(*(np.full(n, row, dtype=np.float64) for row in rows))


rate = st.sampled_from([1e-2, 0.3, 1.5, 40.0, np.inf])


@settings(max_examples=150)
@given(
    limits=st.tuples(rate, st.sampled_from([0.5, 20.0, np.inf]), st.sampled_from([5.0, 1000.0, np.inf])),
    width=st.floats(1e-3, 6.0),
    changes=st.sampled_from([1, 7, 40]),
    what=st.sampled_from([FOLLOW, GO]),
    even=st.booleans(),
    seed=st.integers(0, 2**32 - 1),
)
def test_any_targets_and_any_durations(
    limits: tuple[float, float, float], width: float, changes: int, what: int, even: bool, seed: int
) -> None:
    """Also periods that are missed or shorter: what braking passes does not grow with other durations."""
    rng, n, lower, upper = np.random.default_rng(seed), 3, -0.3 * width, 0.7 * width
    joints, room = motion(n, np.array(limits), lower, upper), Room(np.zeros((0, n)), np.zeros(0))
    rows, times = [np.zeros(n)], []
    for k in range(200):
        h = 0.01 * (1.0 if even else float(rng.choice([0.3, 1.0, 1.0, 2.6, 9.0])))
        if k % changes == 0:
            wanted = rng.uniform(1.3 * lower, 1.3 * upper, n)
        joints.target[:], joints.wanted[:] = wanted, 10.0 * wanted
        limited_step(joints, room, h, what, True)
        rows.append(joints.q.copy())
        times.append(h)
    q = np.array(rows)
    assert (q >= lower).all()
    assert (q <= upper).all()
    require_kept(q, np.array(times), {name: x for name, x in zip(LIMITS, limits, strict=True) if x < np.inf})


@settings(max_examples=100)
@given(
    distance=st.floats(1e-6, 3.0),
    jerk=st.sampled_from([50.0, 1000.0, np.inf]),
    ratio=st.sampled_from([1e-3, 1.0, 1e3]),
)
def test_a_step_is_made_as_fast_as_possible_and_without_overshooting(
    distance: float, jerk: float, ratio: float
) -> None:
    """The judge is Ruckig in continuous time."""
    ruckig = pytest.importorskip("ruckig")
    h, limits = 0.002, np.array([1.5 * ratio, 20.0 * ratio, jerk * ratio])
    distance *= ratio
    joint, room = (
        motion(1, limits, -10.0 * ratio, 10.0 * ratio),
        Room(np.zeros((0, 1)), np.zeros(0)),
    )
    joint.target[:] = joint.before[:] = distance
    steps, close = 0, 1e-6 * distance
    while abs(joint.q[0] - distance) > close:
        limited_step(joint, room, h, FOLLOW, True)
        steps += 1
        assert joint.q[0] <= distance * (1 + 1e-12)
        assert steps < 20_000
    request, found = ruckig.InputParameter(1), ruckig.Trajectory(1)
    request.current_position, request.target_position = [0.0], [distance]
    request.max_velocity, request.max_acceleration, request.max_jerk = ([x] for x in limits)
    ruckig.Ruckig(1).calculate(request, found)
    # The last stretch to a millionth takes some periods more in steps.
    assert steps * h <= 1.05 * found.duration + 12 * h


def stream(arm: Any, home: Array, count: int, seed: int, period: float) -> Array:
    """Poses that a hand-held device leads about, with jumps and times at rest."""
    rng, T, poses = np.random.default_rng(seed), arm.fk(home), []
    velocity, begin = np.zeros(6), T.copy()
    for k in range(count):
        velocity += rng.normal(size=6) * [0.02, 0.02, 0.02, 0.1, 0.1, 0.1] - 0.02 * velocity
        if k % 600 == 400:
            T = begin.copy()
        if k % 600 < 400:
            turn = kinseek.pose([0, 0, 0], rotvec=period * velocity[3:])
            T = T.copy()
            T[:3, 3] += period * velocity[:3]
            T[:3, :3] = turn[:3, :3] @ T[:3, :3]
        poses.append(T)
    return np.array(poses)


@pytest.mark.parametrize("jerk", [None, 1000.0])
@pytest.mark.parametrize("name", HOMES)
def test_a_stream_exceeds_no_limit_and_is_reached_at_rest(name: str, jerk: float | None) -> None:
    arm, period = kinseek.load(name), 0.004
    home = np.array(HOMES[name], float)
    limits = LIMITS | {"jerk": jerk}
    tracker, rows = arm.track(home, period, **limits), [home]
    for T in stream(arm, home, 1800, 0, period):
        step = tracker.step(T)
        rows.append(step.q)
    for _ in range(800):
        step = tracker.step(arm.fk(home))
        rows.append(step.q)
    q = np.array(rows)
    require_kept(q, np.full(len(q) - 1, period), limits)
    assert ((q >= arm.lower) & (q <= arm.upper)).all()
    assert step.status is TrackStatus.TRACKING
    assert step.position_error < 1e-6
    assert not step.velocity.any()
    velocity, acceleration, _ = differences(q, np.full(len(q) - 1, period))
    np.testing.assert_allclose(step.velocity, velocity[-1], atol=1e-9)
    np.testing.assert_allclose(step.acceleration, acceleration[-1], atol=1e-6)


@pytest.mark.parametrize("jerk", [None, 1000.0])
def test_the_lag_is_far_below_that_of_ruckig_behind_the_tracker(jerk: float | None) -> None:
    """Ruckig takes the joint values of a tracker without these limits as its target, at rest."""
    ruckig = pytest.importorskip("ruckig")
    arm, period, home = kinseek.load("ur5e"), 0.002, np.array(HOMES["ur5e"])
    t = period * np.arange(3000.0)
    poses = np.repeat(arm.fk(home)[None], len(t), axis=0)
    poses[:, 0, 3] += 0.05 * np.sin(1.7 * t) ** 2
    poses[:, 1, 3] += 0.06 * np.sin(2.3 * t) ** 3
    ours, plain = arm.track(home, period, **LIMITS | {"jerk": jerk}), arm.track(home, period, velocity=1.5)
    follower, request = ruckig.Ruckig(6, period), ruckig.InputParameter(6)
    request.current_position = list(home)
    request.max_velocity, request.max_acceleration = [1.5] * 6, [20.0] * 6
    request.max_jerk, answer, lags = [jerk or np.inf] * 6, ruckig.OutputParameter(6), []
    for T in poses:
        request.target_position = list(plain.step(T).q)
        follower.update(request, answer)
        answer.pass_to_input(request)
        tips = arm.fk(np.array([ours.step(T).q, answer.new_position]))[:, :3, 3]
        lags.append(np.linalg.norm(tips - T[:3, 3], axis=1))
    mine, theirs = np.median(lags, axis=0)
    assert mine < 0.02 * theirs
    assert mine < 1e-4


def test_a_missed_period_is_made_up_for() -> None:
    arm, home, rng = kinseek.load("ur5e"), np.array(HOMES["ur5e"]), np.random.default_rng(0)
    tracker, T, rows, times = arm.track(home, 0.002, **LIMITS), arm.fk(home), [home], []
    for k in range(1500):
        h = 0.002 * float(rng.choice([1, 1, 1, 1, 2, 3.7, 0.4]))
        T[0, 3] += 0.1 * h * np.sin(k / 100)
        rows.append(tracker.step(T, dt=h).q)
        times.append(h)
    require_kept(np.array(rows), np.array(times), LIMITS)
    wrong: Any
    for wrong in (0.0, -0.002, np.nan, "1"):
        with pytest.raises(InvalidProblem, match="dt must be"):
            tracker.step(T, dt=wrong)


def test_the_joint_and_its_limit_are_named() -> None:
    arm, home = kinseek.load("ur5e"), np.array(HOMES["ur5e"])
    tracker, name = arm.track(home, 0.002, **LIMITS), arm.joint_names[5]
    seen = [tracker.step(velocity=[0, 0, 0, 0, 0, 3.0]).limited for _ in range(100)]
    assert [seen[0], seen[30], seen[-1]] == [(name, "jerk"), (name, "acceleration"), (name, "velocity")]
    arm = kinseek.Arm.from_dh([(0.3, 0, 0, 0), (0.2, 0, 0, 0)], [-1, -3], [1, 3], name="two links")
    tracker = arm.track([0.9, 0.5], 0.01, velocity=1.0, acceleration=5.0)
    for q in np.linspace(0.9, 1.3, 300):
        step = tracker.step(arm.fk([q, 0.5]))
    assert step.status is TrackStatus.LIMIT
    assert step.limited == (arm.joint_names[0], "position")


@pytest.mark.parametrize("jerk", [None, 200.0])
def test_a_switch_returns_the_joint_values_of_its_steps(jerk: float | None) -> None:
    """Joints that moved, or were behind their reference, were up to 0.27 rad away from them."""
    arm, q = kinseek.load("ur5e"), np.array(HOMES["ur5e"])
    tracker, T = arm.track(q, 0.004, velocity=1.5, acceleration=10.0, jerk=jerk), arm.fk(q)
    for _ in range(60):
        T[:2, 3] += 0.0008, 0.0004
        tracker.step(T)
    assert np.abs(tracker.step(T).velocity).max() > 0.1
    rows = tracker.switch()
    for row in rows:
        step = tracker.step(T)
        assert (step.q == row).all()
        assert step.status is TrackStatus.SWITCHED
    assert tracker.step(T).status is TrackStatus.TRACKING


def test_a_joint_that_brakes_before_its_limit_is_not_at_it() -> None:
    """The status was LIMIT from half a radian before it, on the way to a pose inside."""
    arm = kinseek.load("ur5e").with_limits({"shoulder_pan_joint": (-1.0, 1.0)})
    q = np.deg2rad([0.0, -90, 90, -90, -90, 0])
    tracker = arm.track(q, period=0.005, velocity=2.0, acceleration=4.0)
    braked = 0
    for k in range(300):
        step = tracker.step(arm.fk([min(1.0, 0.009 * (k + 1)), *q[1:]]))
        braked += step.limited == ("shoulder_pan_joint", "position")
        assert step.status is not TrackStatus.LIMIT or step.q[0] > 0.999
    assert braked > 20
    assert step.status is TrackStatus.TRACKING


def test_limits_of_the_arm_are_taken() -> None:
    arm = kinseek.load("ur5e").with_limits(velocity=1.0, acceleration=3.0)
    tracker = arm.track(HOMES["ur5e"])
    assert (tracker.acceleration == 3.0).all()
    assert np.isinf(tracker.jerk).all()


@pytest.mark.parametrize("limits", [{}, {"acceleration": 8.0}, {"acceleration": 8.0, "jerk": 300.0}])
def test_a_switch_keeps_the_limits_and_its_straight_way(limits: dict[str, Any]) -> None:
    arm, home = kinseek.load("ur5e"), np.array(HOMES["ur5e"])
    tracker = arm.track(home, 0.004, velocity=1.5, **limits)
    tracker.step(arm.fk(home))
    way, rows = tracker.switch(), [tracker.q]
    for _ in way:
        step = tracker.step(arm.fk(home))
        assert step.status is TrackStatus.SWITCHED
        rows.append(step.q)
    np.testing.assert_allclose(rows[1:], way, atol=1e-9)
    assert tracker.step(arm.fk(home)).status is TrackStatus.TRACKING
    direction = (way[-1] - home) / np.linalg.norm(way[-1] - home)
    off = (way - home) - ((way - home) @ direction)[:, None] * direction
    assert np.abs(off).max() < 1e-9
    require_kept(np.array(rows), np.full(len(way), 0.004), {"velocity": 1.5, **limits})


@pytest.mark.parametrize("name", ["ur5e", "irb120"])
def test_from_outside_the_limits_a_joint_comes_back_within_its_rates(name: str) -> None:
    arm = kinseek.load(name)
    inside = np.array(HOMES[name], float)
    start = inside.copy()
    start[0] = arm.upper[0] + 0.2
    tracker, rows = arm.track(start, 0.004, **LIMITS), [start]
    for _ in range(1500):
        step = tracker.step(arm.fk(inside))
        rows.append(step.q)
    q = np.array(rows)
    require_kept(q, np.full(len(q) - 1, 0.004), LIMITS)
    assert (np.diff(np.maximum(q[:, 0] - arm.upper[0], 0.0)) <= 0.0).all()
    assert (step.q <= arm.upper).all()


@pytest.mark.parametrize("option", ["acceleration", "jerk"])
def test_limits_that_are_none_are_refused(option: str) -> None:
    arm = kinseek.load("ur5e")
    wrong: Any
    for wrong in (0.0, -1.0, np.nan, [1, 2], "fast"):
        with pytest.raises(InvalidProblem, match=option):
            arm.track(np.zeros(6), **{option: wrong})
