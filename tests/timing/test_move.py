"""The fastest motion from point to point: limits hold, the duration is the known one, and every end is considered."""

from __future__ import annotations

import builtins
from typing import Any

import numpy as np
import pytest

import kinseek
from kinseek import Goal, InvalidProblem, NotReached
from kinseek.timing.limits import Limits
from kinseek.timing.move import Move, least_durations, point_to_point
from motions import worst

ruckig = pytest.importorskip("ruckig")

ARMS = ("ur5e", "panda", "scara4", "jaco2_6", "ur10e_rail")
GRID = (1.0, 2.0, 4.0, 8.0)
"""Limits of which many are where one kind of profile ends and another one begins."""


def speeds(arm: kinseek.Arm) -> Any:
    return np.where(np.isnan(arm.velocity), 2.0, arm.velocity)


def by_ruckig(distances: Any, limits: Limits) -> float:
    """The duration of a motion, which Ruckig synchronises by itself."""
    count = len(distances)
    request, found = ruckig.InputParameter(count), ruckig.Trajectory(count)
    request.current_position, request.target_position = [0.0] * count, list(distances)
    request.max_velocity, request.max_acceleration = list(limits.velocity), list(limits.acceleration)
    if limits.jerk is not None:
        request.max_jerk = list(limits.jerk)
    ruckig.Ruckig(count).calculate(request, found)
    return float(found.duration)


@pytest.mark.parametrize("jerk", [None, 60.0])
@pytest.mark.parametrize("name", ARMS)
def test_limits_hold_between_samples(name: str, jerk: float | None) -> None:
    arm = kinseek.load(name)
    for q0, q1 in arm.sample(6, seed=1).reshape(3, 2, arm.dof):
        trajectory = arm.move(q0, q1, speeds(arm), np.linspace(4.0, 12.0, arm.dof), jerk)
        found, kept = worst(trajectory), trajectory.limits_kept
        shares = {"velocity": kept.velocity.max(), "acceleration": kept.acceleration.max()}
        if kept.jerk is not None:
            shares["jerk"] = kept.jerk.max()
        assert all(found[limit] <= share + 1e-9 and share <= 1.0 for limit, share in shares.items())
        assert max(found[limit] for limit in shares) > 0.999
        assert found["integral of velocity"] < 1e-6
        assert found["integral of acceleration"] < 0.02
        # From rest to rest, and each joint between its two values.
        ends = [0.0, trajectory.duration]
        np.testing.assert_allclose(trajectory.q(ends), [q0, q1], atol=1e-13)
        np.testing.assert_allclose(trajectory.velocity(ends), 0.0, atol=1e-12)
        q = trajectory.q(np.linspace(0.0, trajectory.duration, 5000))
        assert (q >= np.minimum(q0, q1) - 1e-13).all()
        assert (q <= np.maximum(q0, q1) + 1e-13).all()
        assert trajectory.pose_times.tolist() == ends
        assert trajectory.duration == pytest.approx(by_ruckig(q1 - q0, trajectory.limits), rel=2e-6)


@pytest.mark.parametrize("jerk", [False, True])
def test_durations_are_those_of_ruckig(jerk: bool) -> None:
    rng, count = np.random.default_rng(3), 7
    for _ in range(300):
        v, a, j = (10.0 ** rng.uniform(low, 2.0, count) for low in (-1, 0, 0))
        limits = Limits(v, a, j if jerk else None)
        distances = rng.choice([-1.0, 1.0], count) * 10.0 ** rng.uniform(-5, 1, count)
        durations = least_durations(distances, limits)
        assert durations.max() == pytest.approx(by_ruckig(distances, limits), rel=1e-7)


@pytest.mark.parametrize("jerk", [False, True])
def test_phases_that_vanish(jerk: bool) -> None:
    # Ruckig by itself finds nothing for some of these, where a phase has the duration 0.
    arm, rng = kinseek.load("ur5e"), np.random.default_rng(0)
    for i in range(60):
        v, a, j = rng.choice(GRID, (3, arm.dof))
        vanishing = [2.0 * a**3 / j**2, v * (v / a + a / j), 2.0 * np.sqrt(v**3 / j), v**2 / a]
        limits = Limits(v, a, j if jerk else None)
        trajectory = point_to_point(Move(arm.mechanism, np.zeros(arm.dof), limits), vanishing[i % 4])
        kept = trajectory.limits_kept
        assert max(kept.velocity.max(), kept.acceleration.max()) <= 1.0
        assert kept.jerk is None or kept.jerk.max() <= 1.0
        least = least_durations(vanishing[i % 4], limits).max()
        assert least <= trajectory.duration <= least * (1.0 + 2e-6)
        # The pieces fit together.
        inner = trajectory._curve.knots[1:-1]
        before, after = inner * (1.0 - 1e-12), inner
        np.testing.assert_allclose(trajectory.q(before), trajectory.q(after), atol=1e-9)
        np.testing.assert_allclose(trajectory.velocity(before), trajectory.velocity(after), atol=1e-8)


def test_tiny_and_huge_motions() -> None:
    arm = kinseek.load("ur5e")
    for size in (1e-15, 1e-9, 1e-3, 6.0):
        way = size * np.array([1.0, -1.0, 0.5, 0.0, 1e-3, 0.3])
        trajectory = arm.move(np.zeros(6), way, 1.0, 2.0, 10.0)
        np.testing.assert_allclose(trajectory.q(trajectory.duration), way, rtol=1e-9, atol=1e-30)
        assert max(np.max(share) for share in trajectory.limits_kept[:3] if share is not None) <= 1.0


@pytest.mark.parametrize(
    ("distance", "jerk", "duration"),
    [
        (1.0, None, 1.0 / 0.8 + 0.8 / 2.0),  # Trapezoid: d / v + v / a.
        (0.1, None, 2.0 * np.sqrt(0.1 / 2.0)),  # Triangle: 2 sqrt(d / a).
        (1.0, 10.0, 1.0 / 0.8 + 0.8 / 2.0 + 2.0 / 10.0),  # Double S: d / v + v / a + a / j.
        (0.01, 10.0, 4.0 * np.cbrt(0.01 / 2.0 / 10.0)),  # Without constant acceleration: 4 cbrt(d / 2 j).
    ],
)
def test_one_joint_has_the_duration_of_the_textbook(
    distance: float, jerk: float | None, duration: float
) -> None:
    arm = kinseek.load("ur5e")
    q0 = np.array([0.1, -1.0, 1.2, -0.4, 0.5, 0.0])
    trajectory = arm.move(q0, q0 - distance * np.eye(6)[1], velocity=0.8, acceleration=2.0, jerk=jerk)
    assert trajectory.duration == pytest.approx(duration, rel=1e-6)
    assert {cap.joint for cap in trajectory.bottleneck} == {arm.joint_names[1]}
    if distance == 1.0 and jerk is None:
        assert [cap.limit for cap in trajectory.bottleneck] == ["acceleration", "velocity", "acceleration"]
    assert trajectory.constant_tool_speed.speed == 0.0  # It begins at rest.
    # The tip moves on a circle about the joint.
    line = np.linalg.norm(np.diff(trajectory.tip(trajectory.pose_times)[:, :3, 3], axis=0))
    sagitta = 0.5 * line * np.tan(distance / 4.0)
    assert sagitta * (1.0 - 1e-6) <= trajectory.deviation <= 2.0 * sagitta


@pytest.mark.parametrize("name", ["ur5e", "scara4", "jaco2_6"])
def test_the_shortest_motion_to_all_solutions(name: str) -> None:
    arm = kinseek.load(name)
    for q0, q1 in arm.sample(8, seed=2).reshape(4, 2, arm.dof):
        T = arm.fk(q1)
        trajectory = arm.move(q0, T, speeds(arm), 6.0, 80.0)

        np.testing.assert_allclose(arm.fk(trajectory.q(trajectory.duration)), T, atol=1e-5)
        ends = arm.branches(T, copies=True).q
        turned = ends + np.where(
            trajectory.mechanism.endless, 2.0 * np.pi * np.round((q0 - ends) / (2.0 * np.pi)), 0.0
        )
        durations = [by_ruckig(end - q0, trajectory.limits) for end in turned]
        assert trajectory.duration == pytest.approx(min(durations), rel=3e-6)


def test_a_pose_beside_the_begin_is_near_for_a_redundant_arm() -> None:
    # Joint values from which the search for the least cost alone found a solution far away.
    arm = kinseek.load("yumi_left")
    q0 = np.clip([-1.5401, 0.5647, -1.9305, -0.2775, -4.7284, 1.1435, -1.0111], arm.lower, arm.upper)
    q1 = np.clip(q0 + 0.001 * np.array([1.0, 0, 0, 0.6, 0, 0, 0]), arm.lower, arm.upper)
    joints, pose = (arm.move(q0, goal, velocity=4.0, acceleration=50.0) for goal in (q1, arm.fk(q1)))
    assert pose.duration <= 1.01 * joints.duration


def test_of_equal_durations_the_joints_that_do_not_matter_move_least() -> None:
    # The wrist can turn by a full turn while the slow base moves.
    arm = kinseek.load("ur5e")
    q0 = np.array([0.0, -1.2, 1.5, -0.4, 0.8, 0.1])
    q1 = q0 + np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.2])
    trajectory = arm.move(q0, arm.fk(q1), velocity=[0.1, 9, 9, 9, 9, 9], acceleration=50.0)
    np.testing.assert_allclose(trajectory.q(trajectory.duration), q1, atol=1e-6)


@pytest.mark.slow
def test_a_redundant_arm_moves_along_its_self_motion_to_the_best_end() -> None:
    arm = kinseek.load("panda")
    gains = []
    for q0, q1 in arm.sample(20, seed=4).reshape(10, 2, 7):
        T = arm.fk(q1)
        trajectory = arm.move(q0, T, acceleration=10.0)
        near = arm.move(q0, arm.ik(T, near=q0).require().q, acceleration=10.0)
        gains.append(near.duration / trajectory.duration)
        sample = least_durations(arm.branches(T).q - q0, trajectory.limits).max(axis=1).min()
        assert trajectory.duration <= sample * (1.0 + 3e-6)
    assert np.median(gains) > 1.0
    assert min(gains) > 0.9


def test_goals_of_every_form() -> None:
    arm = kinseek.load("ur5e")
    q0, q1 = arm.sample(2, seed=0)
    limits: dict[str, Any] = {"acceleration": 8.0, "jerk": 100.0}
    plain = arm.move(q0, q1, **limits)
    for goal in (q1.tolist(), dict(zip(arm.joint_names, q1, strict=True))):
        assert arm.move(q0, goal, **limits).duration == plain.duration
    named = dict(zip(arm.joint_names, q0, strict=True))
    assert arm.move(named, q1, **limits).duration == plain.duration
    tool = kinseek.pose([0.0, 0.02, 0.1], rpy=[0.2, 0.0, 0.0])
    trajectory = arm.move(q0, Goal.position(arm.fk(q1)[:3, 3], tool=tool), **limits)
    end = trajectory.tip(trajectory.duration)
    np.testing.assert_allclose(end[:3, 3], arm.fk(q1)[:3, 3], atol=1e-5)
    # Fewer constraints, never a longer motion.
    whole = arm.move(q0, arm.fk(q1), **limits)
    assert arm.move(q0, Goal.pose(arm.fk(q1), free="rz"), **limits).duration <= whole.duration * 1.001
    assert arm.move(q0, arm.fk(q1), **limits).q(0.3).tolist() == whole.q(0.3).tolist()


def test_a_motion_to_where_the_arm_is() -> None:
    arm = kinseek.load("ur5e")
    q0 = np.array([0.1, -1.0, 1.2, -0.4, 0.5, 0.0])
    trajectory = arm.move(q0, q0, acceleration=8.0)
    assert trajectory.duration == 0.0
    assert trajectory.q(0.0).tolist() == q0.tolist()
    assert trajectory.pose_times.tolist() == [0.0, 0.0]
    assert trajectory.deviation == 0.0
    assert len(trajectory.bottleneck) == 0
    np.testing.assert_allclose(arm.move(q0, arm.fk(q0), acceleration=8.0).duration, 0.0, atol=1e-2)


def test_black_box_kinematics() -> None:
    arm = kinseek.load("planar2")
    box = kinseek.Arm.from_fk(arm.fk, arm.lower, arm.upper)
    q0, q1 = np.array([0.1, 0.4]), np.array([0.5, 0.9])
    assert box.move(q0, q1, 1.0, 2.0).duration == pytest.approx(arm.move(q0, q1, 1.0, 2.0).duration)
    trajectory = box.move(q0, Goal.position(arm.fk(q1)[:3, 3]), 1.0, 2.0)
    np.testing.assert_allclose(arm.fk(trajectory.q(trajectory.duration))[:3, 3], arm.fk(q1)[:3, 3], atol=1e-4)


def _scene(arm: kinseek.Arm) -> Any:
    pytest.importorskip("coal")
    scene = kinseek.Scene.of(arm, capsules=0.04)
    scene.add_box("post", size=(0.1, 0.1, 1.2), pose=kinseek.pose([0.45, 0.0, 0.3]))
    return scene


@pytest.mark.slow
@pytest.mark.parametrize("clearance", [0.0, 0.01])
def test_motions_in_a_scene_are_free(clearance: float) -> None:
    arm = kinseek.load("ur5e")
    scene, longer, moved = _scene(arm), 0, 0
    for q0, q1 in arm.sample(60, seed=5).reshape(30, 2, 6):
        if not scene.free(np.array([q0, q1]), clearance).all():
            continue
        T = arm.fk(q1)
        try:
            trajectory = arm.move(q0, T, acceleration=8.0, jerk=80.0, scene=scene, clearance=clearance)
        except InvalidProblem:
            continue
        moved += 1
        q = trajectory.q(np.linspace(0.0, trajectory.duration, 3000))
        assert scene.free(q, clearance).all()
        np.testing.assert_allclose(arm.fk(q[-1]), T, atol=1e-5)
        without = arm.move(q0, T, acceleration=8.0, jerk=80.0)
        assert trajectory.duration >= without.duration * (1.0 - 1e-9)
        longer += trajectory.duration > without.duration * 1.001
    assert moved >= 5
    assert longer >= 1


def test_no_free_motion() -> None:
    arm = kinseek.load("ur5e")
    scene = _scene(arm)
    q0 = np.array([-0.6, -0.6, 0.8, -1.8, -1.57, 0.0])
    q1 = q0 + np.array([1.2, 0.0, 0.0, 0.0, 0.0, 0.0])
    assert scene.free(np.array([q0, q1])).all()
    assert arm.move(q0, q1, acceleration=8.0).duration > 0.0
    with pytest.raises(InvalidProblem, match=r"none of 1 motions .* is proved free"):
        arm.move(q0, q1, acceleration=8.0, scene=scene)
    inside = q0 + np.array([0.6, 0.0, 0.0, 0.0, 0.0, 0.0])
    with pytest.raises(InvalidProblem, match=r"begins in collision.*post"):
        arm.move(inside, q1, acceleration=8.0, scene=scene)
    with pytest.raises(InvalidProblem, match="proved free"):
        arm.move(q0, inside, acceleration=8.0, scene=scene)
    with pytest.raises(InvalidProblem, match="clearance= needs a scene"):
        arm.move(q0, q1, acceleration=8.0, clearance=0.1)
    with pytest.raises(kinseek.InvalidScene, match="this scene is of"):
        kinseek.load("panda").move(np.zeros(7), np.zeros(7), 1.0, 1.0, scene=scene)


def test_errors_say_what_is_wrong() -> None:
    arm = kinseek.load("ur5e")
    q0, far = np.zeros(6), kinseek.pose([3.0, 0.0, 0.0])
    cases: list[tuple[tuple[Any, ...], dict[str, Any], type[Exception], str]] = [
        (
            (q0, [7.0, 0, 0, 0, 0, 0]),
            {},
            InvalidProblem,
            "goal must be inside the limits.*got 7 .*shoulder_pan",
        ),
        ((q0 - 7.0, q0), {}, InvalidProblem, "q0 must be inside the limits.*got -7 "),
        ((q0, [np.nan] * 6), {}, InvalidProblem, "goal contains NaN"),
        ((q0, q0[:5]), {}, InvalidProblem, "goal must have shape"),
        ((np.zeros((2, 6)), q0), {}, InvalidProblem, "q0 must have shape"),
        ((q0, {"elbow_joint": 1.0}), {}, InvalidProblem, "goal: no value for joint"),
        ((q0, far), {}, NotReached, "nearest pose found"),
        ((q0, np.array([far, far])), {}, InvalidProblem, "one goal"),
        ((q0, np.eye(3)), {}, kinseek.InvalidGoal, r"\(3, 3\)"),
        ((q0, q0 + 1.0), {"velocity": 0.0}, InvalidProblem, "velocity must be above 0"),
        ((q0, q0 + 1.0), {"jerk": np.nan}, InvalidProblem, "jerk must be above 0"),
        ((q0, q0 + 1.0), {"acceleration": None}, InvalidProblem, "no acceleration limit"),
        ((q0, q0 + 1.0), {"time_limit": 0.0}, InvalidProblem, "time_limit"),
        ((q0, q0 + 1.0), {"jerks": 3.0}, kinseek.InvalidUse, "jerks"),
    ]
    for arguments, options, error, text in cases:
        with pytest.raises(error, match=text):
            arm.move(*arguments, **({"acceleration": 8.0} | options))


def test_without_ruckig_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    real = builtins.__import__

    def without(name: str, *args: Any, **options: Any) -> Any:
        if name == "ruckig":
            raise ImportError(name)
        return real(name, *args, **options)

    monkeypatch.setattr(builtins, "__import__", without)
    arm = kinseek.load("ur5e")
    with pytest.raises(kinseek.MissingExtra, match=r"pip install 'kinseek\[motion\]'"):
        arm.move(np.zeros(6), np.ones(6), acceleration=8.0)
