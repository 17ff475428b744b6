"""`Arm.track`: bounded steps, exact limits, the same bits, and a switch only when asked for."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import minimize

import kinseek
from kinseek import Goal, InvalidGoal, InvalidProblem, TrackStatus
from kinseek.problem import Problem

Array = NDArray[np.float64]


def circle(count: int, shift: float = 0.0) -> Array:
    """Poses on a circle of 10 cm in front of the arm."""
    angles = np.linspace(0, 2 * np.pi, count)
    return np.array(
        [
            kinseek.pose([0.45 + shift, 0.1 + 0.1 * np.cos(a), 0.35 + 0.1 * np.sin(a)], rpy=[np.pi, 0, 0])
            for a in angles
        ]
    )


@pytest.mark.parametrize("name", ["ur5e", "panda", "irb120"])
def test_a_circle_is_tracked(name: str) -> None:
    arm, T = kinseek.load(name), circle(400)
    tracker = arm.track(arm.ik(T[0]).q, period=0.01, velocity=2.0)
    before = tracker.q
    for row in T:
        answer = tracker.step(row)
        assert answer.status is TrackStatus.TRACKING
        assert (np.abs(answer.q - before) <= 2.0 * 0.01).all()
        assert ((answer.q >= arm.lower) & (answer.q <= arm.upper)).all()
        assert np.abs(arm.fk(answer.q) - row).max() < 2e-6
        before = answer.q


def test_a_tracker_shows_where_its_joints_are() -> None:
    tracker = kinseek.load("planar2").track([0.25, -1], velocity=2.0)
    assert repr(tracker) == "Tracker('planar2', period=0.002 s, q=[0.25, -1])"


def test_a_jump_is_caught_up_with_and_no_joint_is_too_fast() -> None:
    arm = kinseek.load("ur5e")
    T = np.concatenate([circle(50), circle(400, 0.1), np.repeat(circle(1, 0.1), 300, axis=0)])
    tracker = arm.track(arm.ik(T[0]).q, period=0.002, velocity=[1.0, 0.5, 1.0, 1.0, 1.0, 1.0])
    tracker.step(T[0])
    before, statuses = tracker.q, []
    for row in T:
        answer = tracker.step(row)
        assert (np.abs(answer.q - before) <= tracker.velocity * tracker.period).all()
        statuses.append(answer.status)
        before = answer.q
    assert TrackStatus.LAGGING in statuses
    assert statuses[-1] is TrackStatus.TRACKING


def test_a_limit_is_kept_and_said() -> None:
    arm = kinseek.Arm.from_dh([(0.3, 0, 0, 0), (0.2, 0, 0, 0)], [-1, -3], [1, 3], name="two links")
    tracker = arm.track([0.9, 0.5], period=0.01, velocity=1.0)
    with_limit = [tracker.step(arm.fk([q, 0.5])) for q in np.linspace(0.9, 1.3, 300)]
    assert with_limit[0].status is TrackStatus.TRACKING
    assert with_limit[-1].status is TrackStatus.LIMIT
    assert all(answer.q[0] <= 1.0 for answer in with_limit)


def test_out_of_reach_the_nearest_is_held_and_caught_up_with() -> None:
    arm = kinseek.load("ur5e")
    near, far = (
        kinseek.pose([0.6, 0.1, 0.4], rpy=[np.pi, 0, 0]),
        kinseek.pose([1.2, 0.1, 0.4], rpy=[np.pi, 0, 0]),
    )
    tracker = arm.track(arm.ik(near).q, period=0.01, velocity=1.0)
    for _ in range(400):
        away = tracker.step(far)
    assert away.status in (TrackStatus.SINGULAR, TrackStatus.LAGGING)
    for _ in range(600):
        back = tracker.step(near)
    assert back.status is TrackStatus.TRACKING


POSTURES = {
    "ur5e": [0, -1.57, 1.57, -1.57, -1.57, 0],
    "panda": [0, -0.5, 0, -2, 0, 1.6, 0.7],
    "iiwa14": [0, 0.5, 0, -1.2, 0, 0.8, 0],
    "xarm7": [0, -0.35, 0, 0.75, 0, 1.1, 0],
    "irb120": [0, 0.3, 0.2, 0, 0.6, 0],
}
"""Postures from which the hand can be led forward until it is out of reach."""


@pytest.mark.slow
@pytest.mark.parametrize("name", POSTURES)
def test_out_of_reach_the_arm_comes_to_rest(name: str) -> None:
    """The pose moves forward until it is out of reach, and stays there: no joint reverses, and the error is least there."""
    arm, q = kinseek.load(name), np.array(POSTURES[name], float)
    tracker, T = arm.track(q, period=0.002, velocity=1.5), arm.fk(q)
    while True:
        T[0, 3] += 0.00035
        tracker.step(T)
        if tracker.step(T).position_error > 0.033:
            break
    moving = np.array([tracker.step(T).q for _ in range(1500)])
    steps = np.diff(moving, axis=0)
    reversals = np.minimum(np.abs(steps[:-1]), np.abs(steps[1:]))[steps[:-1] * steps[1:] < 0]
    assert reversals.max(initial=0.0) < 1e-9, "a joint goes back and forth"
    assert np.abs(steps[-100:]).max() == 0.0, "the arm is not at rest"
    goal = kinseek.Goal.pose(T)

    def error(q: Array) -> float:
        return float(goal.measure(arm.chain.arrays, q[None])[0, 2])

    theirs = minimize(error, moving[-1], bounds=list(zip(arm.lower, arm.upper, strict=True)))
    assert error(moving[-1]) <= theirs.fun + 1e-6


@pytest.mark.slow
@pytest.mark.parametrize("name", POSTURES)
def test_along_the_edge_of_the_workspace_no_joint_chatters(name: str) -> None:
    arm, q = kinseek.load(name), np.array(POSTURES[name], float)
    tracker, T = arm.track(q, period=0.002, velocity=1.5), arm.fk(q)
    rows = []
    for k in range(3000):
        T[0, 3] += 0.00035 if k < 2000 else 0.0
        T[1, 3] += 0.0 if k < 2000 else 0.0003
        rows.append(tracker.step(T).q)
    speeds = np.diff(rows, axis=0) / 0.002
    reversals = np.minimum(np.abs(speeds[:-1]), np.abs(speeds[1:]))
    reversals[speeds[:-1] * speeds[1:] >= 0] = 0.0
    assert ((reversals > 0.02).sum(axis=0) <= 2).all(), "a joint turns back more often than it has to"


@pytest.mark.slow
@pytest.mark.parametrize("name", POSTURES)
def test_a_pose_that_comes_back_into_reach_is_reached_again(name: str) -> None:
    """By the same way, or to another place; the speeds and the limits are kept on the way back."""
    arm, q = kinseek.load(name), np.array(POSTURES[name], float)
    for aside in (0.0, 0.15):
        tracker, T, before = arm.track(q, velocity=1.5), arm.fk(q), q
        for step in [0.0005] * 2000 + [-0.0005] * 2000 + [0.0] * 1500:
            T[0, 3] += step
            T[1, 3] += aside * (step < 0) / 2000
            answer = tracker.step(T)
            assert (np.abs(answer.q - before) <= 1.5 * 0.002).all()
            assert ((answer.q >= arm.lower) & (answer.q <= arm.upper)).all()
            before = answer.q
        assert answer.status is TrackStatus.TRACKING
        assert np.linalg.norm(arm.fk(answer.q)[:3, 3] - T[:3, 3]) < 1e-6


def trembling(T: Array, k: int) -> Array:
    """A pose that moves up and down by two millimetres, so that it never rests."""
    moved = T.copy()
    moved[2, 3] += 0.002 * np.sin(0.3 * k)
    return moved


@pytest.mark.slow
def test_another_branch_is_taken_when_the_target_rests_or_was_out_of_reach_of_all() -> None:
    """While it moves on, a pose that only another branch reaches is not worth an unexpected motion."""
    arm, rng, stuck = kinseek.load("irb120"), np.random.default_rng(0), 0
    for _ in range(9):
        start, there = rng.uniform(arm.lower, arm.upper, (2, arm.dof))
        T = arm.fk(there)
        stays, recovers = (arm.track(start, period=0.01, velocity=2.0, recover=r) for r in (False, True))
        lost = []
        for k in range(400):
            one, other = stays.step(trembling(T, k)), recovers.step(trembling(T, k))
            assert other.status is not TrackStatus.RECOVERING
            lost.append(one.position_error > 0.01 or one.orientation_error > 0.01)
        assert np.array_equal(one.q, other.q)
        if not all(lost[-50:]):
            continue
        stuck += 1
        far, before = T.copy(), recovers.q
        far[:3, 3] *= 5.0
        rests = arm.track(before, period=0.01, velocity=2.0)
        # Away and back, moving all the time; and a target that only comes to rest.
        for tracker, targets in (
            (recovers, [far] * 20 + [trembling(T, k) for k in range(400)] + [T] * 20),
            (rests, [trembling(T, k) for k in range(100)] + [T] * 500),
        ):
            seen, before = set(), tracker.q
            for pose in targets:
                answer = tracker.step(pose)
                seen.add(answer.status)
                assert (np.abs(answer.q - before) <= 2.0 * 0.01 + 1e-15).all()
                assert ((answer.q >= arm.lower) & (answer.q <= arm.upper)).all()
                before = answer.q
            assert answer.status is TrackStatus.TRACKING
            assert TrackStatus.RECOVERING in seen
        for _ in range(300):
            assert stays.step(T).status is not TrackStatus.RECOVERING
    assert stuck > 2


def recovering() -> tuple[Any, Array]:
    """A tracker that is on its way back to a pose after a time out of reach, and that pose."""
    arm, rng = kinseek.load("ur5e"), np.random.default_rng(13)
    q = rng.uniform(arm.lower, arm.upper)
    home, away = arm.fk(q), arm.fk(q)
    away[:3, 3] = rng.normal(size=3) * 5
    tracker = arm.track(q, period=0.01, velocity=1.5)
    for pose in [away] * 250 + [home] * 1000:
        if tracker.step(pose).status is TrackStatus.RECOVERING:
            return tracker, home
    raise AssertionError("this tracker does not recover")


def test_an_arm_that_recovers_can_be_stopped() -> None:
    """The pose of the hand as it is ends the way back."""
    tracker, home = recovering()
    for _ in range(20):
        tracker.step(home)
    here = tracker.q
    hold = kinseek.load("ur5e").fk(here)
    for _ in range(50):
        answer = tracker.step(hold)
        assert answer.status is TrackStatus.TRACKING
        assert np.abs(answer.q - here).max() < 1e-6


def test_a_switch_ends_the_recovery() -> None:
    tracker, home = recovering()
    way = tracker.switch()
    for _ in way:
        assert tracker.step(home).status is TrackStatus.SWITCHED
    for _ in range(50):
        assert tracker.step(home).status is TrackStatus.TRACKING
    assert np.abs(tracker.q - way[-1]).max() < 1e-3


def test_what_was_lost_is_not_left_a_little_off() -> None:
    """The nearest pose of this branch is 0.6 mm off, and the pose can be reached."""
    arm, rng = kinseek.load("scara4"), np.random.default_rng(60)
    q = rng.uniform(np.maximum(arm.lower, -3.2), np.minimum(arm.upper, 3.2))
    home, away = arm.fk(q), arm.fk(q)
    away[:3, 3] = rng.normal(size=3) * 20
    tracker = arm.track(q, period=0.02, velocity=2.0)
    for pose in [away] * 150 + [home] * 1000:
        answer = tracker.step(pose)
    assert answer.status is TrackStatus.TRACKING


@pytest.mark.parametrize("name", ["ur5e", "panda", "irb120"])
def test_from_outside_the_limits_every_joint_comes_back_at_its_speed(name: str) -> None:
    arm, rng = kinseek.load(name), np.random.default_rng(0)
    for k in range(2 * arm.dof):
        joint, sign = k % arm.dof, 1 if k < arm.dof else -1
        inside = rng.uniform(arm.lower, arm.upper)
        start, limit = inside.copy(), (arm.upper if sign > 0 else arm.lower)[joint]
        start[joint] = limit + 0.1 * sign
        tracker, beyond = arm.track(start, period=0.01, velocity=1.0), 0.1
        while beyond > 0.0:
            q = tracker.step(arm.fk(inside)).q
            left = sign * (q[joint] - limit)
            assert left <= max(0.0, beyond - 0.01 * (1 - 1e-9))
            assert (np.abs(q - start) <= 0.01).all()
            start, beyond = q, left
        for _ in range(5):
            q = tracker.step(arm.fk(inside)).q
            assert ((q >= arm.lower) & (q <= arm.upper)).all()


@pytest.mark.parametrize("joint", [2, 4])
def test_a_singularity_on_the_way_is_passed(joint: int) -> None:
    """The elbow stretched, and two axes of the wrist in line: the way of the hand leads straight through."""
    arm = kinseek.load("ur5e")
    q = np.repeat([[0.2, -1.2, 1.6, -0.4, 1.2, 0.3]], 121, axis=0)
    q[:, joint] = np.linspace(0.3, -0.3, 121)
    tracker = arm.track(q[0], period=0.01, velocity=1.0)
    for T in arm.fk(q):
        assert tracker.step(T).status is TrackStatus.TRACKING
    assert np.abs(tracker.q - q[-1]).max() < 1e-4


def test_a_hand_that_stands_at_a_singularity_is_not_held_there() -> None:
    arm = kinseek.load("ur5e")
    start = np.array([0.2, -1.2, 1.6, -0.4, 0.0, 0.3])
    there = np.concatenate([np.linspace(0, 1, 100), np.linspace(1, 0, 100), np.zeros(150)])[:, None]
    for axis in np.eye(6):
        T = arm.fk(start) @ kinseek.pose(0.05 * there * axis[:3], rotvec=0.3 * there * axis[3:])
        tracker, before = arm.track(start, period=0.01, velocity=1.5), start
        for row in T:
            answer = tracker.step(row)
            assert (np.abs(answer.q - before) <= 0.015).all()
            before = answer.q
        assert answer.status is TrackStatus.TRACKING


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ur5e", "panda", "irb120"])
def test_what_is_stuck_is_freed_by_a_switch(name: str) -> None:
    arm, rng, stuck = kinseek.load(name), np.random.default_rng(0), 0
    for _ in range(25):
        start, there = rng.uniform(arm.lower, arm.upper, (2, arm.dof))
        T, tracker = arm.fk(there), arm.track(start, period=0.01, velocity=2.0, recover=False)
        for _ in range(700):
            answer = tracker.step(T)
        if answer.status is TrackStatus.TRACKING:
            continue
        stuck += 1
        for _ in tracker.switch():
            tracker.step(T)
        assert tracker.step(T).status is TrackStatus.TRACKING
    assert stuck > 3


def test_a_switch_is_made_only_when_asked_for() -> None:
    arm = kinseek.load("ur5e")
    T = circle(1)[0]
    tracker = arm.track(arm.ik(T).q, period=0.01, velocity=1.0)
    with pytest.raises(InvalidProblem, match="needs a pose"):
        tracker.switch()
    tracker.step(T)
    start = tracker.q
    way = tracker.switch()
    assert (np.abs(np.diff(np.concatenate([start[None], way]), axis=0)) <= 0.01 * (1 + 1e-9)).all()
    answers = [tracker.step(T) for _ in way]
    assert {answer.status for answer in answers} == {TrackStatus.SWITCHED}
    after = tracker.step(T)
    assert after.status is TrackStatus.TRACKING
    assert np.abs(after.q - start).max() > 0.5
    own = arm.track(start, period=0.01)
    assert (own.velocity == arm.velocity).all()
    own.step(T)
    assert len(own.switch()) < len(way)
    two = kinseek.Arm.from_dh([(0.3, 0, 0, 0), (0.2, 0, 0, 0)], [-1, -3], [1, 3], name="two links")
    free = two.track([0.0, 1.0])
    assert np.isinf(free.velocity).all()
    free.step(two.fk([0.0, 1.0]))
    with pytest.raises(InvalidProblem, match="velocity="):
        free.switch()


def test_a_switch_that_takes_too_many_periods_is_refused() -> None:
    arm, T = kinseek.load("ur5e"), circle(1)[0]
    for velocity in (1e-7, 1e-300):
        tracker = arm.track(arm.ik(T).q, velocity=velocity)
        tracker.step(T)
        with pytest.raises(InvalidProblem, match="a higher velocity= or a longer period="):
            tracker.switch()


def test_any_kind_of_number_is_a_period() -> None:
    arm = kinseek.load("ur5e")
    periods: list[Any] = [np.float32(0.5), np.int64(1), 1, np.float64(0.25)]
    assert [arm.track(np.zeros(6), period=period).period for period in periods] == [0.5, 1.0, 1.0, 0.25]


def test_what_comes_is_foreseen() -> None:
    arm = kinseek.Arm.from_dh([(0.3, 0, 0, 0), (0.2, 0, 0, 0)], [-1, -3], [1, 3], name="two links")
    tracker = arm.track([0.5, 0.5], period=0.01, velocity=1.0)
    with pytest.raises(InvalidProblem, match="two poses"):
        tracker.foresee()
    for q in np.arange(0.5, 0.8, 0.005):
        tracker.step(arm.fk([q, 0.5]))
    ahead = tracker.foresee(0.5)
    assert ahead.status is TrackStatus.LIMIT
    assert 0.2 < ahead.seconds <= 0.5
    assert ahead.joint == arm.joint_names[0]
    assert tracker.foresee(0.1).status is TrackStatus.TRACKING


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"period": 0.0}, "period, in seconds, must be"),
        ({"period": 1e-320}, "period, in seconds, must be"),
        ({"period": True}, "period, in seconds, must be"),
        ({"period": "1"}, "period, in seconds, must be"),
        ({"recover": np.ones(2)}, "recover must be True or False"),
        ({"velocity": 0.0}, "velocity must be above 0"),
        ({"velocity": [1, 2]}, "velocity must be a number or 6"),
        ({"q0": np.zeros(5)}, "q0 must have shape"),
        ({"q0": np.full(6, np.nan)}, "NaN"),
    ],
)
def test_misuse_is_refused(options: dict[str, Any], message: str) -> None:
    arm = kinseek.load("ur5e")
    with pytest.raises(InvalidProblem, match=message):
        arm.track(**{"q0": np.zeros(6), **options})
    tracker = arm.track(np.zeros(6))
    for wrong in (np.eye(3), 2 * np.eye(4)):
        with pytest.raises(InvalidGoal):
            tracker.step(wrong)


@pytest.mark.parametrize(
    "options",
    [
        {"free": "rz", "cone": 0.3},
        {"free": "rz"},
        {"free": ("rx", "ry", "rz")},
        {"box": {"rx": (-0.2, 0.2), "ry": (-0.2, 0.2), "z": (-0.02, 0.02)}},
        {"free": "rz", "cone": 0.3, "box": {"z": (-0.02, 0.02)}},
    ],
)
@pytest.mark.parametrize("name", ["ur5e", "panda"])
def test_a_goal_leaves_free_what_it_does_not_constrain(name: str, options: dict[str, Any]) -> None:
    arm = kinseek.load(name)
    tool = kinseek.pose([0.02, 0.0, 0.12], rotvec=[0.0, 0.4, 0.0])
    base = kinseek.pose([0.3, -0.2, 0.5], rotvec=[0.0, 0.0, 0.7])
    goal = Goal.pose(np.eye(4), **options, tool=tool, base=base if name == "ur5e" else None)
    base = base if name == "ur5e" else np.eye(4)
    q0 = arm.ik(kinseek.pose([0.45, 0.1, 0.35], rotvec=[np.pi, 0.0, 0.2])).require().q
    begin = base @ arm.fk(q0) @ tool
    tracker, most = arm.track(q0, period=0.01, goal=goal), 0.0
    assert arm.track(q0, period=0.01).step(arm.fk(q0)).status is TrackStatus.TRACKING
    for k in range(150):
        wiggle = kinseek.pose(
            [0.1 * np.sin(k / 40), 0.08 * np.sin(k / 30), 0.0], rotvec=[0.5 * np.sin(k / 25), 0.0, 0.0]
        )
        T = begin @ wiggle
        before, given = tracker.q, T.copy()
        step = tracker.step(T)
        np.testing.assert_array_equal(T, given)
        assert step.status in (TrackStatus.TRACKING, TrackStatus.LAGGING)
        assert (np.abs(step.q - before) <= tracker.velocity * 0.01 * (1 + 1e-12)).all()
        one = goal.at(T)
        position, orientation, _ = one.measure(Problem(arm.chain, one).arrays, step.q[None])[0]
        assert abs(position - step.position_error) < 1e-6
        if step.status is TrackStatus.TRACKING:
            assert position <= 1e-6
            assert orientation <= 1.2e-6
        most = max(most, float(np.abs(step.q - q0).max()))
    assert most > 0.05


def test_the_errors_of_a_step_are_those_of_its_goal() -> None:
    """They used to be the distances from one point of the ranges, so a hand inside the cone seemed to lag."""
    arm = kinseek.load("ur5e")
    goal = Goal.pose(np.eye(4), free="rz", cone=0.3, box={"z": (-0.02, 0.02)})
    q0 = arm.ik(kinseek.pose([0.45, 0.1, 0.35], rotvec=[np.pi, 0.0, 0.2])).require().q
    begin = arm.fk(q0)
    tracker, seen = arm.track(q0, period=0.01, velocity=1.0, goal=goal), set()
    for k in range(200):
        T = begin @ kinseek.pose([0.12 * np.sin(k / 8), 0.0, 0.0], rotvec=[0.6 * np.sin(k / 9), 0.3, 0.0])
        if k == 100:
            tracker.switch()
        step = tracker.step(T)
        hand = arm.fk(step.q)
        away = T[:3, :3].T @ (hand[:3, 3] - T[:3, 3])
        away[2] -= np.clip(away[2], -0.02, 0.02)
        tilt = np.arctan2(np.linalg.norm(np.cross(hand[:3, 2], T[:3, 2])), hand[:3, 2] @ T[:3, 2])
        position, orientation = float(np.linalg.norm(away)), max(float(tilt) - 0.3, 0.0)
        assert abs(step.position_error - position) <= 1.1e-6
        assert abs(step.orientation_error - orientation) <= 1.1e-6
        if step.status is not TrackStatus.SWITCHED:
            assert (step.status is TrackStatus.TRACKING) == (max(position, orientation) <= 1e-6)
        seen.add(step.status)
    assert seen >= {TrackStatus.TRACKING, TrackStatus.LAGGING, TrackStatus.SWITCHED}


def test_a_cone_lags_less_than_a_pose() -> None:
    arm = kinseek.load("ur5e")
    q0 = arm.ik(kinseek.pose([0.45, 0.1, 0.35], rotvec=[np.pi, 0.0, 0.2])).require().q
    begin, turned = arm.fk(q0), []
    for goal in (None, Goal.pose(np.eye(4), free="rz", cone=0.3)):
        tracker = arm.track(q0, period=0.01, goal=goal)
        for k in range(100):
            T = begin @ kinseek.pose(np.zeros(3), rotvec=[0.25 * np.sin(k / 8), 0.0, k / 60])
            tracker.step(T)
        turned.append(float(np.abs(tracker.q - q0).max()))
    assert turned[1] < 0.2 * turned[0]


@pytest.mark.parametrize(
    ("goal", "words"),
    [
        (np.eye(4), "goal must be a Goal with one target"),
        (Goal.pose(np.zeros((2, 4, 4)) + np.eye(4)), "goal must be a Goal with one target"),
        (Goal.pose(np.eye(4), free="rz", cone=0.1, frame="base"), "ranges and cones with axes of the tool"),
    ],
)
def test_what_a_tracker_cannot_track_is_refused(goal: Any, words: str) -> None:
    arm = kinseek.load("ur5e")
    with pytest.raises(InvalidProblem, match=words):
        arm.track(np.zeros(6), goal=goal)


def test_a_rate_as_the_period_is_warned_of() -> None:
    arm = kinseek.load("ur5e")
    with pytest.warns(kinseek.UnitWarning, match=r"period is 500 s .* write period=1/500$") as seen:
        arm.track(np.zeros(6), period=500)
    assert seen[0].filename == __file__
    arm.track(np.zeros(6), period=1.0)
