"""A path in time: limits hold everywhere, every pose is passed, and no slower motion is taken than necessary."""

from __future__ import annotations

import itertools
import pickle
from dataclasses import replace
from functools import cache
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import kinseek
from benchmarks.trajectories import arc, corner
from kinseek import Goal
from kinseek.timing.limits import Limits
from kinseek.timing.shares import _with_root
from kinseek.timing.timed import Way, timed
from motions import FEW, worst

ARMS = ("ur5e", "panda", "iiwa14", "so101", "puma560")


def accelerations(arm: kinseek.Arm) -> Any:
    return np.linspace(4.0, 12.0, arm.dof)


def speeds(arm: kinseek.Arm) -> Any:
    return np.where(np.isnan(arm.velocity), 2.0, arm.velocity)


@cache
def both(name: str) -> tuple[kinseek.Path, kinseek.Path]:
    """An arc and a corner of an arm."""
    arm, rng = kinseek.load(name), np.random.default_rng(5)
    return arc(arm, rng), corner(arm, rng)


@cache
def without_jerk(name: str) -> list[kinseek.Trajectory]:
    """Both in time, with limits of speed and acceleration alone."""
    arm = kinseek.load(name)
    return [path.timed(speeds(arm), accelerations(arm)) for path in both(name)]


@pytest.mark.slow
@pytest.mark.parametrize("name", ARMS)
@pytest.mark.parametrize("tool_speed", [None, 0.15])
def test_limits_hold_between_samples(name: str, tool_speed: float | None) -> None:
    arm = kinseek.load(name)
    for path in both(name):
        trajectory = path.timed(speeds(arm), accelerations(arm), tool_speed=tool_speed)
        found = worst(trajectory)
        shares = [found["velocity"], found["acceleration"], found.get("tool_speed", 0.0)]
        assert max(shares) <= 1.0
        # Some limit is used in full somewhere, otherwise the motion could be faster.
        assert max(shares) > 0.999
        assert found["outside"] <= 1e-12
        assert found["integral of velocity"] < 1e-5
        assert found["integral of acceleration"] < 0.02
        kept = trajectory.limits_kept
        bounds = [kept.velocity.max(), kept.acceleration.max(), kept.tool_speed or 0.0]
        assert all(share <= bound <= 1.0 for share, bound in zip(shares, bounds, strict=True))
        np.testing.assert_allclose(trajectory.q(trajectory.pose_times), path.q, rtol=0.0, atol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("name", ARMS)
@pytest.mark.parametrize("jerk", [1000.0, 100.0])
def test_jerks_hold_between_samples(name: str, jerk: float) -> None:
    arm = kinseek.load(name)
    for path, free in zip(both(name), without_jerk(name), strict=True):
        trajectory = path.timed(speeds(arm), accelerations(arm), jerk)
        found = worst(trajectory)
        shares = [found["velocity"], found["acceleration"], found["jerk"]]
        assert max(shares) <= 1.0
        assert max(shares) > 0.99
        kept = trajectory.limits_kept
        assert kept.jerk is not None
        bounds = [kept.velocity.max(), kept.acceleration.max(), kept.jerk.max()]
        assert all(share <= bound <= 1.0 for share, bound in zip(shares, bounds, strict=True))
        assert free.duration < trajectory.duration < 2.5 * free.duration
        # Accelerations are continuous: they change by at most the jerk times the time.
        t = np.linspace(0.0, trajectory.duration, 10_000)
        steps = np.abs(np.diff(trajectory.acceleration(t), axis=0)) / np.diff(t)[:, None]
        assert steps.max() <= jerk * (1.0 + 1e-6)
        np.testing.assert_allclose(trajectory.acceleration([0.0, trajectory.duration]), 0.0, atol=1e-6)
        np.testing.assert_allclose(trajectory.q(trajectory.pose_times), path.q, rtol=0.0, atol=1e-6)


def test_a_straight_motion_with_jerk_is_nearly_the_best() -> None:
    # From rest to rest, so short that neither speed nor acceleration is reached: four parts with the full jerk, each of the
    # duration (L / 2 j)^(1/3).
    arm = kinseek.load("ur5e")
    q = np.array([0.1, -1.0, 1.2, -0.4, 0.5, 0.0]) + np.linspace(0.0, 0.02, 30)[:, None] * np.eye(6)[0]
    path = arm.follow(arm.fk(q), start=q[0], end=q[-1])
    trajectory = path.timed(velocity=3.0, acceleration=100.0, jerk=50.0)
    assert trajectory.duration == pytest.approx(4.0 * (0.02 / 100.0) ** (1 / 3), rel=0.03)
    assert trajectory.duration > 4.0 * (0.02 / 100.0) ** (1 / 3) * (1.0 - 1e-6)


@pytest.mark.parametrize(("jerk", "best"), [(1e12, 0.8), (100.0, 0.85)])
def test_few_poses_with_jerk_are_nearly_the_best(jerk: float, best: float) -> None:
    # Along a line of length L: L / v + v / a + a / j.
    arm = kinseek.load("planar2")
    for count in (2, 3, 30):
        q = np.linspace([0.3, 0.5], [0.9, 0.2], count)
        path = arm.follow(arm.fk(q), start=q[0], max_step=1.0)
        trajectory = path.timed(velocity=1.0, acceleration=5.0, jerk=jerk)
        assert best * (1.0 - 1e-6) < trajectory.duration < 1.015 * best
        # What caps the speed is known nearly everywhere.
        assert sum(cap.end - cap.begin for cap in trajectory.bottleneck) > 0.9 * trajectory.duration


def test_with_jerk_a_motion_begins_at_rest() -> None:
    path = arc(kinseek.load("ur5e"), np.random.default_rng(3), 20)
    with pytest.raises(kinseek.InvalidProblem, match="with limits of jerk a motion begins and ends at rest"):
        path.timed(acceleration=10.0, jerk=100.0, start_velocity=0.1)


def test_a_straight_motion_has_the_known_duration() -> None:
    # From rest to rest over a length L with speed v and acceleration a: L / v + v / a.
    arm = kinseek.load("ur5e")
    q = np.array([0.1, -1.0, 1.2, -0.4, 0.5, 0.0]) + np.linspace(0.0, 1.0, 30)[:, None] * np.eye(6)[0]
    path = arm.follow(arm.fk(q), start=q[0], end=q[-1])
    trajectory = path.timed(velocity=0.8, acceleration=2.0)
    assert trajectory.duration == pytest.approx(1.0 / 0.8 + 0.8 / 2.0, rel=1e-5)
    assert [cap.limit for cap in trajectory.bottleneck] == ["acceleration", "velocity", "acceleration"]
    assert {cap.joint for cap in trajectory.bottleneck} == {arm.joint_names[0]}


def test_the_tool_keeps_its_speed() -> None:
    arm = kinseek.load("ur5e")
    path = arm.follow(
        kinseek.interpolate(
            [kinseek.pose([0.4, y, 0.3], rpy=[np.pi, 0, 0]) for y in (-0.2, 0.2)], step=0.005, turn=0.02
        )
    )
    trajectory = path.timed(acceleration=10.0, tool_speed=0.1)
    speed = trajectory.tip_speed(np.linspace(0.1, trajectory.duration - 0.1, 1000))
    np.testing.assert_allclose(speed, 0.1, rtol=2e-3)
    assert trajectory.duration == pytest.approx(4.0, abs=0.05)


def test_the_greatest_constant_speed() -> None:
    arm = kinseek.load("ur5e")
    angle = np.linspace(0.0, 6.0 * np.pi, 600)
    T = np.repeat(kinseek.pose([0.4, 0.1, 0.3], rpy=[np.pi, 0, 0])[None], 600, axis=0)
    T[:, :2, 3] += 0.1 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    path = arm.follow(T)
    constant = path.timed(acceleration=8.0).constant_tool_speed
    assert constant.joint in arm.joint_names
    just, beyond = (path.timed(acceleration=8.0, tool_speed=share * constant.speed) for share in (0.99, 1.1))
    inner = [
        trajectory.tip_speed(np.linspace(0.1, 0.9, 5000) * trajectory.duration)
        for trajectory in (just, beyond)
    ]
    np.testing.assert_allclose(inner[0], 0.99 * constant.speed, rtol=2e-3)
    # Faster than that, the speed is not constant.
    assert inner[1].min() < 1.05 * constant.speed < inner[1].max()


def test_the_arm_stops_at_breaks() -> None:
    arm = kinseek.load("ur5e")
    rng = np.random.default_rng(0)
    one, other = arc(arm, rng, 40), arc(arm, rng, 30)
    path = arm.follow(np.concatenate([arm.fk(one.q), arm.fk(other.q)]), max_step=0.1)
    assert path.breaks.tolist() == [39]
    trajectory = path.timed(acceleration=8.0)
    assert trajectory.stops.tolist() == [39, 40]
    np.testing.assert_allclose(trajectory.velocity(trajectory.pose_times[[39, 40]]), 0.0, atol=1e-9)
    assert max(worst(trajectory)[limit] for limit in ("velocity", "acceleration")) <= 1.0


def test_a_closed_path_returns() -> None:
    arm = kinseek.load("ur5e")
    angle = np.linspace(0.0, 2.0 * np.pi, 100, endpoint=False)
    T = np.repeat(kinseek.pose([0.4, 0.1, 0.3], rpy=[np.pi, 0, 0])[None], 100, axis=0)
    T[:, :2, 3] += 0.1 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    path = arm.follow(T, closed=True)
    trajectory = path.timed(acceleration=8.0)
    assert len(trajectory.pose_times) == 100
    assert trajectory.duration > trajectory.pose_times[-1]
    np.testing.assert_allclose(trajectory.q(trajectory.duration), path.q[0], atol=1e-12)
    t = np.linspace(0.0, trajectory.duration, 10_000)
    ends = T[[*range(100), 0], :3, 3]
    points = trajectory.tip(t)[:, None, :3, 3] - ends[:-1]
    along = np.diff(ends, axis=0)
    share = np.clip((points * along).sum(axis=2) / (along**2).sum(axis=1), 0.0, 1.0)
    true = np.linalg.norm(points - share[..., None] * along, axis=2).min(axis=1).max()
    assert true <= trajectory.deviation <= 2.0 * true + 1e-12


def test_free_axes_and_tools() -> None:
    arm, tool = kinseek.load("panda"), kinseek.pose([0.0, 0.05, 0.2], rpy=[0.3, 0, 0])
    T = kinseek.interpolate(
        [kinseek.pose([0.4, y, 0.4], rpy=[np.pi, 0, 0]) for y in (-0.2, 0.2)], step=0.005, turn=0.02
    )
    path = arm.follow(Goal.pose(T, free="rz", tool=tool))
    trajectory = path.timed(acceleration=10.0, tool_speed=0.05)
    found = worst(trajectory)
    assert max(found["velocity"], found["acceleration"], found["tool_speed"]) <= 1.0
    np.testing.assert_allclose(trajectory.tip(trajectory.pose_times)[:, :3, 3], T[:, :3, 3], atol=1e-6)


def test_joints_stay_inside_their_limits() -> None:
    # The joint moves along its limit and leaves it: a plain spline would overshoot.
    arm = kinseek.load("ur5e").with_limits({"elbow_joint": (0.2, 1.5)})
    q = np.tile([0.1, -1.0, 1.5, -0.4, 0.5, 0.0], (40, 1))
    q[:, 0] += np.linspace(0.0, 0.6, 40)
    q[20:, 2] -= np.linspace(0.0, 0.9, 20)
    path = arm.follow(arm.fk(q), start=q[0], end=q[-1])
    for jerk in (None, 500.0):
        trajectory = path.timed(acceleration=10.0, jerk=jerk)
        found = worst(trajectory)
        assert found["outside"] <= 1e-12
        assert max(found["acceleration"], found.get("jerk", 0.0)) <= 1.0


def test_the_deviation_is_bounded() -> None:
    arm, rng = kinseek.load("panda"), np.random.default_rng(7)
    for make in (arc, corner):
        path = make(arm, rng)
        trajectory = path.timed(acceleration=10.0)
        t = np.linspace(0.0, trajectory.duration, 10_000)
        points, ends = trajectory.tip(t)[:, :3, 3], arm.fk(path.q)[:, :3, 3]
        i = np.clip(np.searchsorted(trajectory.pose_times, t, side="right") - 1, 0, len(path) - 2)
        a, along = ends[i], ends[i + 1] - ends[i]
        share = np.clip(((points - a) * along).sum(axis=1) / (along**2).sum(axis=1), 0.0, 1.0)
        true = np.linalg.norm(points - a - share[:, None] * along, axis=1).max()
        assert true <= trajectory.deviation <= 2.0 * true + 1e-12


def test_speeds_at_the_ends() -> None:
    arm = kinseek.load("ur5e")
    path = arc(arm, np.random.default_rng(3))
    trajectory = path.timed(acceleration=10.0, start_velocity=0.2, end_velocity=0.1)
    np.testing.assert_allclose(trajectory.tip_speed([0.0, trajectory.duration]), [0.2, 0.1], rtol=1e-6)
    with pytest.raises(
        kinseek.InvalidProblem,
        match="start_velocity: the tip has 50 m/s there, but inside the limits at most",
    ):
        path.timed(acceleration=10.0, start_velocity=50.0)
    with pytest.raises(kinseek.InvalidProblem, match="end_velocity: the tip has 50 m/s"):
        path.timed(acceleration=10.0, end_velocity=50.0)


def test_samples() -> None:
    trajectory = arc(kinseek.load("ur5e"), np.random.default_rng(3)).timed(acceleration=10.0)
    samples = trajectory.sample(0.008)
    assert samples.times[-1] == trajectory.duration
    np.testing.assert_allclose(np.diff(samples.times)[:-1], 0.008)
    np.testing.assert_array_equal(samples.q, trajectory.q(samples.times))
    np.testing.assert_array_equal(samples.acceleration, trajectory.acceleration(samples.times))
    assert trajectory.q(0.1).shape == (6,)
    assert trajectory.q([[0.1, 0.2]]).shape == (1, 2, 6)
    assert trajectory.q([]).shape == (0, 6)
    again = pickle.loads(pickle.dumps(trajectory))
    np.testing.assert_array_equal(again.q(samples.times), samples.q)


def test_one_pose_and_equal_poses() -> None:
    arm = kinseek.load("ur5e")
    T = kinseek.pose([0.4, 0.1, 0.3], rpy=[np.pi, 0, 0])
    for count in (1, 3):
        path = arm.follow(np.repeat(T[None], count, axis=0))
        trajectory = path.timed(acceleration=10.0)
        assert trajectory.duration == 0.0
        np.testing.assert_array_equal(trajectory.q(0.0), path.q[0])
        assert trajectory.pose_times.tolist() == [0.0] * count
        assert trajectory.bottleneck == ()
        assert trajectory.deviation == 0.0
        assert len(trajectory.sample(0.01).times) == 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"acceleration": 0.0}, "acceleration must be above 0 and finite"),
        ({"acceleration": np.nan}, "acceleration must be above 0 and finite"),
        ({"acceleration": [1.0, 2.0]}, "acceleration must be a number or 6 of them"),
        ({}, r"no acceleration limit for shoulder_pan_joint, .* for example acceleration=10"),
        ({"acceleration": 1.0, "jerk": -1.0}, "jerk must be above 0 and finite"),
        ({"acceleration": 1.0, "tool_speed": 0.0}, "tool_speed must be a number from 1e-09 to 1e\\+12"),
        ({"acceleration": 1e300}, "acceleration must be from 1e-09 to 1e\\+12"),
        ({"acceleration": 1.0, "velocity": 1e-300}, "velocity must be from 1e-09 to 1e\\+12"),
        ({"acceleration": 1.0, "tolerance": -1.0}, "tolerance must be a number from 0"),
        ({"acceleration": 1.0, "tool_speed": "fast"}, "tool_speed must be a number"),
        ({"acceleration": 1.0, "start_velocity": -1.0}, "start_velocity must be a number from 0"),
    ],
)
def test_bad_limits(arguments: dict[str, Any], message: str) -> None:
    path = arc(kinseek.load("ur5e"), np.random.default_rng(3), 20)
    with pytest.raises(kinseek.InvalidProblem, match=message):
        path.timed(**arguments)


def test_in_a_scene_the_whole_motion_is_free() -> None:
    pytest.importorskip("pinocchio")
    arm = kinseek.load("ur5e")
    scene = kinseek.Scene.of(arm, capsules=0.05)
    scene.add_box("table", (1.0, 1.6, 0.04), kinseek.pose([0.55, 0.0, -0.06]))
    scene.add_capsule("pole", 0.03, 0.8, kinseek.pose([0.3, -0.2, 0.4]))
    T = [kinseek.pose([0.5, y, 0.3], rpy=[np.pi, 0, 0]) for y in np.linspace(-0.3, 0.3, 60)]
    path = arm.follow(T, scene=scene, clearance=0.01).require()
    trajectory = path.timed(acceleration=10.0)
    assert not len(trajectory.stops)
    assert scene.free(trajectory.q(np.linspace(0.0, trajectory.duration, 2000)), 0.01).all()


def test_a_path_is_not_timed_through_a_body_that_was_added_later() -> None:
    pytest.importorskip("pinocchio")
    arm = kinseek.load("ur5e")
    scene = kinseek.Scene.of(arm, capsules=0.05)
    T = [kinseek.pose([0.5, y, 0.3], rpy=[np.pi, 0, 0]) for y in np.linspace(-0.3, 0.3, 60)]
    path = arm.follow(T, scene=scene).require()
    rest = arm.follow([T[30]] * 3, scene=scene).require()
    scene.add_box("later", (0.1, 0.1, 0.1), kinseek.pose([0.5, 0.0, 0.3]))
    for one, said in ((path, r"the step from pose \d+ .*"), (rest, "the path does not move.*")):
        with pytest.raises(kinseek.InvalidProblem, match=f"{said}changed since.*plan it again"):
            one.timed(acceleration=10.0)
    scene.remove("later")
    path.timed(acceleration=10.0)
    assert rest.timed(acceleration=10.0).duration == 0.0


def test_reversals_of_all_joints() -> None:
    # Where all joints turn round at once, the curve has a cusp. Exact symmetry makes many limits equal up to rounding.
    arm, rng = kinseek.load("planar2"), np.random.default_rng(7)
    for count in (3, 3, 3, 5, 40):
        for _ in range(20):
            begin, way = np.array([0.3, 0.6]), rng.uniform(-0.5, 0.5, 2)
            q = begin + way * (np.arange(count) % 2)[:, None]
            path = arm.follow(arm.fk(q), start=q[0], max_step=9.0)
            if not path.success or np.abs(path.q - q).max() > 1e-3:
                continue
            trajectory = path.timed(velocity=2.0, acceleration=10.0)
            found = worst(trajectory, FEW)
            assert max(found["velocity"], found["acceleration"]) <= 1.0 + 1e-9
            # From rest to rest and back is possible in this time.
            step = np.abs(way).max()
            assert trajectory.duration < 1.5 * (count - 1) * (step / 2.0 + 2.0 * np.sqrt(step / 10.0))


@pytest.mark.parametrize("jerk", [None, 50.0])
def test_repeated_poses_change_nothing(jerk: float | None) -> None:
    arm, rng = kinseek.load("ur5e"), np.random.default_rng(8)
    path = arc(arm, rng, 30)
    plain = path.timed(velocity=1.0, acceleration=5.0, jerk=jerk)
    for noise in (0.0, 1e-16, 1e-12, 1e-9, 1e-7):
        q = np.repeat(path.q, rng.integers(1, 3, 30), axis=0)
        q = np.clip(q + noise * rng.uniform(-1.0, 1.0, q.shape), arm.lower, arm.upper)
        again = replace(path, q=q, reached=np.ones(len(q), dtype=bool))
        trajectory = again.timed(velocity=1.0, acceleration=5.0, jerk=jerk)
        found = worst(trajectory)
        assert max(found["velocity"], found["acceleration"], found.get("jerk", 0.0)) <= 1.0 + 1e-9
        assert trajectory.duration == pytest.approx(plain.duration, rel=0.03)
        np.testing.assert_allclose(trajectory.q(trajectory.pose_times), q, rtol=0.0, atol=1e-6)


def test_rounding_errors_of_poses_are_not_followed() -> None:
    arm = kinseek.load("ur5e")
    T = kinseek.interpolate(
        [kinseek.pose([0.4, y, 0.3], rpy=[np.pi, 0, 0]) for y in (-0.2, 0.2)], step=0.0004, turn=0.02
    )
    plain = arm.follow(T).timed(velocity=1.0, acceleration=5.0, jerk=50.0)
    for decimals, tolerance in ((7, None), (6, None), (4, 2e-4)):
        rounded = T.copy()
        rounded[:, :3, 3] = rounded[:, :3, 3].round(decimals)
        path = arm.follow(rounded)
        trajectory = path.timed(velocity=1.0, acceleration=5.0, jerk=50.0, tolerance=tolerance)
        assert trajectory.duration == pytest.approx(plain.duration, rel=0.05)
        apart = np.linalg.norm(trajectory.tip(trajectory.pose_times)[:, :3, 3] - T[:, :3, 3], axis=1)
        assert apart.max() < 2.0 * (tolerance or 1e-6) + 10.0**-decimals


def test_with_no_tolerance_every_pose_is_passed_exactly() -> None:
    path = corner(kinseek.load("panda"), np.random.default_rng(3))
    trajectory = path.timed(acceleration=10.0, tolerance=0.0)
    np.testing.assert_allclose(trajectory.q(trajectory.pose_times), path.q, rtol=0.0, atol=1e-12)


@pytest.mark.slow
@settings(max_examples=150)
@given(
    seed=st.integers(0, 2**32 - 1),
    count=st.integers(2, 60),
    style=st.sampled_from(["walk", "reversals", "repeats", "tiny", "line"]),
    jerk=st.booleans(),
    stop=st.booleans(),
)
def test_any_joint_values_and_limits(seed: int, count: int, style: str, jerk: bool, stop: bool) -> None:
    arm, rng = kinseek.load("ur5e").mechanism, np.random.default_rng(seed)
    scale = 10.0 ** rng.uniform(-4.0, 0.0)
    q = scale * np.cumsum(rng.normal(size=(count, 6)), axis=0) / count
    if style == "reversals":
        q = scale * rng.normal(size=6) * (np.arange(count) % 2)[:, None]
    elif style == "repeats":
        q = np.repeat(q, rng.integers(1, 4, count), axis=0)
    elif style == "tiny":
        q *= 1e-8
    elif style == "line":
        q = scale * rng.normal(size=6) * np.linspace(0.0, 1.0, count)[:, None]
    velocity, acceleration = 10.0 ** rng.uniform(-2.0, 2.0, (2, 6))
    limits = Limits(velocity, acceleration, 10.0 ** rng.uniform(-1.0, 4.0, 6) if jerk else None)
    breaks = np.array([len(q) // 2] if stop and len(q) > 3 else [], dtype=np.int64)
    trajectory = timed(Way(arm, None, q, breaks, None, 0.0, (1e-6, 1e-6)), limits, (0.0, 0.0))
    assert np.isfinite(trajectory.duration)
    found = worst(trajectory, FEW)
    assert max(found["velocity"], found["acceleration"], found.get("jerk", 0.0)) <= 1.0 + 1e-9
    kept = trajectory.limits_kept
    assert max(np.max(share) for share in kept if share is not None) <= 1.0 + 1e-9
    np.testing.assert_allclose(trajectory.q(trajectory.pose_times), q, rtol=0.0, atol=2e-6)


def test_where_the_spline_is_not_free_the_arm_moves_linearly() -> None:
    class Narrow:
        """A scene in which the third step has to be linear."""

        state = None

        def free_motion(self, q0: Any, q1: Any, clearance: float = 0.0, around: Any = None) -> Any:
            third = (q0 == path.q[2]).all(axis=1)
            return ~third if around is not None else np.ones(len(q0), dtype=bool)

    path = arc(kinseek.load("ur5e"), np.random.default_rng(3), 8)
    trajectory = replace(path, scene=cast(Any, Narrow())).timed(acceleration=10.0)
    assert trajectory.stops.tolist() == [2, 3]
    q = trajectory.q(np.linspace(trajectory.pose_times[2], trajectory.pose_times[3], 20)[1:-1])
    share = (q - path.q[2]) / (path.q[3] - path.q[2])
    np.testing.assert_allclose(share, share[:, :1] + np.zeros(6), atol=1e-9)
    assert max(worst(trajectory)[limit] for limit in ("velocity", "acceleration")) <= 1.0


SLIDES = """<robot name="slides"><link name="base"/><link name="x"/>
<link name="hand"><collision><geometry><sphere radius="0.001"/></geometry></collision></link>
<joint name="jx" type="prismatic"><parent link="base"/><child link="x"/><axis xyz="1 0 0"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
<joint name="jy" type="prismatic"><parent link="x"/><child link="hand"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""
"""A ball that slides in a plane."""


@pytest.mark.parametrize("tolerance", [0.001, 0.015, 0.02, 0.03])
def test_the_arm_does_not_pass_by_poses_through_a_body(tolerance: float) -> None:
    """Where poses nearer than the tolerance were left out, a linear motion between the others went through a wire."""
    arm = kinseek.load(SLIDES)
    scene = kinseek.Scene.of(arm)
    scene.add_capsule("wire", 0.001, 0.5)
    x = np.linspace(-0.05, 0.05, 201)
    poses = arm.fk(np.stack([x, 0.004 * np.exp(-((x / 0.004) ** 2))], axis=1))
    path = arm.follow(Goal.pose(poses, free=("z", "rx", "ry", "rz")), scene=scene)
    trajectory = path.timed(acceleration=10.0, tolerance=tolerance)
    q = trajectory.q(np.linspace(0, trajectory.duration, 5001))
    assert scene.free(q).all()
    assert np.hypot(*q.T).min() > 0.002
    off = np.linalg.norm(trajectory.q(trajectory.pose_times) - path.q, axis=1)
    assert off.max() <= tolerance


def test_the_arm_moves_linearly_between_two_poses_also_at_a_limit() -> None:
    """The slope at an end was reduced there, as if the curve went on beyond it."""
    arm = kinseek.load(SLIDES)
    scene = kinseek.Scene.of(arm)
    for k, side in itertools.product(range(30), (-0.0025, 0.0025)):
        along = np.array([-1.0, -0.5]) + (k + 0.5) / 30 * np.array([2.0, 1.0])
        scene.add_sphere(
            f"{k} {side}", 0.001, kinseek.pose([*(along + side * np.array([-0.5, 1.0]) / np.sqrt(1.25)), 0])
        )
    path = scene.plan([-1.0, -0.5], [1.0, 0.5])
    for rows in (path, replace(path, q=path.q[[0, -1]])):
        trajectory = rows.timed(acceleration=2.0)
        q = trajectory.q(np.linspace(0, trajectory.duration, 5001))
        np.testing.assert_allclose(q[:, 1], 0.5 * q[:, 0], atol=1e-9)
        assert scene.free(q).all()


def test_equal_poses_in_a_scene_have_a_motion() -> None:
    """Steps of 1e-16 had no direction: NaN."""
    arm, rng, moved = kinseek.load(SLIDES), np.random.default_rng(0), 0
    for _ in range(30):
        scene = kinseek.Scene.of(arm)
        for k in range(6):
            scene.add_sphere(f"ball {k}", 0.02, kinseek.pose([*rng.uniform(-0.5, 0.5, 2), 0]))
        q = rng.uniform(-0.5, 0.5, (4, 2))[[0, 1, 1, 2, 3, 3]]
        if not np.all(scene.free_motion(q[:-1], q[1:])):
            continue
        goal = Goal.pose(arm.fk(q), free=("z", "rx", "ry", "rz"))
        trajectory = arm.follow(goal, scene=scene, max_step=2.0).timed(acceleration=10.0)
        times = np.append(np.linspace(0, trajectory.duration, 501), trajectory.duration)
        assert scene.free(trajectory.q(times)).all()
        np.testing.assert_allclose(trajectory.q(trajectory.pose_times), q, atol=1e-3)
        moved += 1
    assert moved > 10


@pytest.mark.parametrize("closed", [False, True])
@pytest.mark.parametrize("far", [0.0002, 0.0014, 0.003, 0.01])
def test_a_way_there_and_back_has_a_motion(far: float, closed: bool) -> None:
    """Both ends were kept, as the way is longer than the tolerance, but the motion between them had no direction: NaN."""
    arm = kinseek.load("ur5e")
    q = np.array([0.0, -1.2, 1.5, -1.9, -1.57, 0.0])
    there = arm.fk(q) @ kinseek.pose([0.0, 0.0, far])
    poses = np.array([arm.fk(q), there] + [arm.fk(q)] * (not closed))
    path = arm.follow(poses, start=q, closed=closed)
    for tolerance, jerk in itertools.product((0.02, 0.005, 0.001, 0.0), (None, 50.0)):
        trajectory = path.timed(acceleration=8.0, jerk=jerk, tolerance=tolerance)
        assert np.isfinite(trajectory.q(np.linspace(0.0, trajectory.duration, 50))).all()
        off = arm.fk(trajectory.q(trajectory.pose_times[: len(poses)]))[:, :3, 3] - poses[:, :3, 3]
        assert np.linalg.norm(off, axis=1).max() <= max(2 * tolerance, 1e-9)
        assert max(limit for limit in worst(trajectory).values() if limit < np.inf) <= 1.0


@pytest.mark.parametrize("near", [0.01, 0.001, 0.0001])
@pytest.mark.parametrize("back", [False, True])
def test_poses_of_uneven_distances_do_not_swing_the_tip_out(near: float, back: bool) -> None:
    """From poses 1 mm apart the slope 100 mm away was extrapolated: the tip went 0.7 m off a way of 0.1 m."""
    arm = kinseek.load("ur5e")
    begin = arm.fk([0.0, -1.2, 1.5, -1.9, -1.57, 0.0])
    places = np.array([[0, 0, 0], [near, 0, 0], [near, near, 0], [near, near, -0.1]])
    poses = np.tile(begin, (4, 1, 1))
    poses[:, :3, 3] += places[::-1] if back else places
    path = arm.follow(poses)
    assert path.success
    assert path.timed(acceleration=8.0).deviation < 0.03


@pytest.mark.parametrize("jerk", [None, 100.0])
def test_the_speed_of_the_tip_before_a_stop_is_that_of_the_motion_before_it(jerk: float | None) -> None:
    """Its bound was taken in the direction of the motion after it: up to three times too large, or too small."""
    arm = kinseek.load("ur5e")
    for seed in range(6):
        path = arm.follow(arm.fk(arm.sample(4, seed=seed)), max_step=0.01)
        assert len(path.breaks) == 3
        trajectory = path.timed(acceleration=8.0, jerk=jerk, tool_speed=0.25)
        kept = trajectory.limits_kept.tool_speed
        assert kept is not None
        q = trajectory.tip(np.linspace(0.0, trajectory.duration, 20_001))[:, :3, 3]
        speed = np.linalg.norm(np.diff(q, axis=0), axis=1).max() / (trajectory.duration / 20_000)
        assert speed / 0.25 * (1.0 - 1e-4) <= kept <= 1.0


def test_a_rate_of_zero_has_no_share_of_a_limit() -> None:
    """It was multiplied by an infinite bound of the speed: NaN."""
    rates, squares = np.array([[[0.0, 0.0, 0.0], [1.0, 2.0, 3.0]]]), np.array([[[1e-9, 1.0, 5.0]]])
    np.testing.assert_array_equal(_with_root(rates, squares) > 0.0, [[False, True]])
    assert np.isfinite(_with_root(rates, squares)).all()


@pytest.mark.parametrize("again", [1, 2, 4])
def test_a_break_before_equal_poses_is_crossed_linearly(again: int) -> None:
    """With the last pose twice, the arm ran through the break; and near a limit it did not move linearly."""
    arm = kinseek.load("ur5e")
    near = np.array([kinseek.pose([0.45, -0.3 + 0.01 * k, 0.3], rpy=[np.pi, 0, 0]) for k in range(20)])
    path = arm.follow(
        np.concatenate([near, [kinseek.pose([-0.45, 0.3, 0.5], rpy=[np.pi / 2, 0.5, 0])] * again])
    )
    assert path.breaks.tolist() == [19]
    trajectory = path.timed(2.0, 8.0)
    assert trajectory.stops.tolist() == [19]
    begin, end = trajectory.pose_times[[19, 20]]
    q, step = trajectory.q(np.linspace(begin, end, 1001)), path.q[20] - path.q[19]
    share = (q - path.q[19]) @ step / (step @ step)
    np.testing.assert_allclose(q, path.q[19] + share[:, None] * step, atol=1e-8)


def test_a_break_is_crossed_only_if_it_is_free() -> None:
    class Wall:
        """A scene in which nothing is free."""

        state = None

        def free_motion(self, q0: Any, q1: Any, clearance: float = 0.0, around: Any = None) -> Any:
            return np.zeros(len(q0), dtype=bool)

    arm, rng = kinseek.load("ur5e"), np.random.default_rng(0)
    one, other = arc(arm, rng, 10), arc(arm, rng, 10)
    path = arm.follow(np.concatenate([arm.fk(one.q), arm.fk(other.q)]), max_step=0.5)
    assert path.breaks.tolist() == [9]
    with pytest.raises(
        kinseek.InvalidProblem, match="at the break after pose 9 the linear motion of the joints is not"
    ):
        replace(path, scene=cast(Any, Wall())).timed(acceleration=10.0)


def test_bad_times() -> None:
    trajectory = arc(kinseek.load("ur5e"), np.random.default_rng(3), 20).timed(acceleration=10.0)
    for t in (-0.1, trajectory.duration + 0.1, np.nan):
        with pytest.raises(kinseek.InvalidProblem, match="t must be from 0 to the duration"):
            trajectory.q(t)
    with pytest.raises(kinseek.InvalidProblem, match="period"):
        trajectory.sample(0.0)


def test_missed_poses_have_no_motion() -> None:
    arm = kinseek.load("ur5e")
    path = arm.follow(
        kinseek.interpolate([kinseek.pose([x, 0.1, 0.3]) for x in (0.4, 3.0)], step=0.05, turn=0.1)
    )
    with pytest.raises(kinseek.NotReached, match="a path with missed poses has no motion in time"):
        path.timed(acceleration=10.0)


def test_a_turn_in_place_has_no_tool_speed_at_its_ends() -> None:
    arm = kinseek.load("ur5e")
    T = kinseek.interpolate(
        [kinseek.pose([0.4, 0.1, 0.3], rpy=[np.pi, 0, yaw]) for yaw in (0.0, 1.0)], step=0.01, turn=0.02
    )
    path = arm.follow(T)
    assert path.timed(acceleration=10.0, tool_speed=0.1).duration > 0.1
    assert path.timed(acceleration=10.0).constant_tool_speed.speed < 1e-3
