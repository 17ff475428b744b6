"""A tracker in a scene: nothing is touched, whatever the target does, and it goes on when the way is free."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import kinseek
from kinseek import InvalidProblem, InvalidScene, Scene, TrackStatus
from kinseek.paths import limited

Array = NDArray[np.float64]

HOMES = {"ur5e": [0, -1.57, 1.57, -1.57, -1.57, 0], "panda": [0, -0.5, 0, -2, 0, 1.6, 0.7]}
LIMITS: dict[str, Any] = {"velocity": 1.5, "acceleration": 20.0}


def cell(arm: Any, q: Array, count: int, seed: int, clearance: float) -> Scene:
    """Boxes around an arm, none of them near q."""
    pytest.importorskip("coal")
    scene, rng, placed = Scene.of(arm, capsules=0.05), np.random.default_rng(seed), 0
    while placed < count:
        place = rng.uniform(-1, 1, 3)
        place *= rng.uniform(0.4, 0.9) / np.linalg.norm(place)
        scene.add_box(f"box {placed}", [0.1, 0.1, 0.1], kinseek.pose([*place[:2], abs(place[2])]))
        if scene.free(q, clearance):
            placed += 1
        else:
            scene.remove(f"box {placed}")
    return scene


@pytest.mark.parametrize("jerk", [None, 1000.0])
@pytest.mark.parametrize("name", HOMES)
def test_twenty_boxes_are_never_touched(name: str, jerk: float | None) -> None:
    """Targets beyond boxes, jumps, twists and velocities; coal measures the distances exactly."""
    arm, home, h, clearance = kinseek.load(name), np.array(HOMES[name]), 0.004, 0.01
    scene, rng = cell(arm, home, 20, 1, 0.05), np.random.default_rng(2)
    tracker = arm.track(home, h, **LIMITS, jerk=jerk, scene=scene, clearance=clearance)
    T, begin, rows, seen = arm.fk(home), arm.fk(home)[:3, 3].copy(), [home], set()
    for k in range(4000):
        if k % 400 == 0:
            aim, twist, velocity = (
                begin + rng.uniform(-0.5, 0.5, 3),
                rng.normal(size=6) * 0.3,
                rng.normal(size=arm.dof),
            )
        if k % 1200 < 800:
            gap = aim - T[:3, 3]
            T = T.copy()
            T[:3, 3] += gap * min(1.0, 0.002 / max(float(np.linalg.norm(gap)), 1e-9))
            step = tracker.step(T)
        else:
            step = tracker.step(twist=twist) if k % 800 < 400 else tracker.step(velocity=velocity)
            T = arm.fk(step.q)
        seen.add(step.status)
        if step.status is TrackStatus.BRAKING:
            assert step.obstacle is not None
            assert {step.obstacle[0], step.obstacle[1]} <= set(scene.bodies)
            assert step.obstacle[2] <= scene.distance(rows[-1]) + 0.2
        rows.append(step.q)
    q = np.array(rows)
    assert TrackStatus.BRAKING in seen
    assert scene.distance(q).min() >= clearance
    a = np.diff(q, 2, axis=0) / h**2
    assert np.abs(a).max() <= 20.0 * (1 + 1e-9) + 1e-8
    if jerk is not None:
        assert np.abs(np.diff(q, 3, axis=0) / h**3).max() <= jerk * (1 + 1e-9) + 1e-6
    assert ((q >= arm.lower) & (q <= arm.upper)).all()


def wall(arm: Any) -> Scene:
    pytest.importorskip("coal")
    scene = Scene.of(arm, capsules=0.05)
    scene.add_box("wall", [0.02, 2.0, 2.0], kinseek.pose([0.75, 0.0, 0.5]))
    return scene


@pytest.mark.parametrize("jerk", [None, 1000.0])
def test_it_rests_before_a_wall_and_comes_back(jerk: float | None) -> None:
    arm, home = kinseek.load("ur5e"), np.array(HOMES["ur5e"])
    scene = wall(arm)
    tracker, T = arm.track(home, 0.004, **LIMITS, jerk=jerk, scene=scene), arm.fk(home)
    begin, rows = T.copy(), []
    for _ in range(600):
        T[0, 3] += 0.001
        step = tracker.step(T)
    for _ in range(2000):
        step = tracker.step(T)
        rows.append(step.q)
    assert step.status is TrackStatus.BRAKING
    assert step.obstacle is not None
    assert "wall" in step.obstacle[:2]
    assert 0.0 < scene.distance(step.q) < 2e-3, "it comes as near as it may"
    velocity = np.diff(rows, axis=0) / 0.004
    assert np.abs(velocity[-500:]).max() < 1e-3
    back = (velocity[:-1] * velocity[1:] < 0) & (
        np.minimum(np.abs(velocity[:-1]), np.abs(velocity[1:])) > 1e-3
    )
    assert not back.any(), "a joint goes back and forth"
    for _ in range(1500):
        step = tracker.step(begin)
    assert step.status is TrackStatus.TRACKING
    assert step.position_error < 1e-6


@pytest.mark.parametrize("acceleration", [20.0, None])
def test_errors_near_a_body_are_those_of_the_joints(acceleration: float | None) -> None:
    """A step said TRACKING with the error of the reference, 1e-13 m, while the hand was 49 mm away."""
    arm, home = kinseek.load("ur5e"), np.array(HOMES["ur5e"])
    scene, begin = wall(arm), arm.fk(home)
    tracker = arm.track(home, 0.002, velocity=1.5, acceleration=acceleration, scene=scene, clearance=0.01)
    seen = set()
    for k in range(1500):
        T = begin @ kinseek.pose([0.1 * np.sin(k / 150), 0.1 * np.sin(k / 93), 0.05 * np.sin(k / 77)])
        step = tracker.step(T @ kinseek.pose([0.03, 0, 0]) if k % 400 < 200 else T)
        away = np.linalg.norm(
            arm.fk(step.q)[:3, 3] - (T @ kinseek.pose([0.03 * (k % 400 < 200), 0, 0]))[:3, 3]
        )
        assert step.position_error == pytest.approx(away, abs=1e-9)
        assert (step.status is not TrackStatus.TRACKING) or away < 1e-6
        seen.add(step.status)
    assert {TrackStatus.TRACKING, TrackStatus.LAGGING} <= seen


@pytest.mark.parametrize("gap", [1e-4, 3e-4, 5e-4])
@pytest.mark.parametrize("how", ["pose", "twist", "velocity"])
def test_it_leaves_a_body_that_it_nearly_touches(gap: float, how: str) -> None:
    """Three links at a wall kept each other where they were, and one link could not use what was granted to it."""
    arm, home = kinseek.load("ur5e"), np.array(HOMES["ur5e"])
    pytest.importorskip("coal")
    scene = Scene.of(arm, capsules=0.05)
    size, y = [2.0, 0.02, 2.0], 1.0
    scene.add_box("plate", size, kinseek.pose([0.0, y, 0.5]))

    def away(q: Array) -> float:
        return min(-hit.depth for hit in scene.hits(q, 1.5) if "plate" in (hit.a, hit.b))

    y -= away(home) - gap
    scene.remove("plate")
    scene.add_box("plate", size, kinseek.pose([0.0, y, 0.5]))
    assert away(home) == pytest.approx(gap, abs=2e-6)
    tracker, T = arm.track(home, 0.004, **LIMITS, scene=scene), arm.fk(home)
    T[1, 3] -= 0.1
    given: dict[str, dict[str, Any]] = {
        "pose": {"T": T},
        "twist": {"twist": [0, -0.05, 0, 0, 0, 0]},
        "velocity": {"velocity": [-0.2, 0, 0, 0, 0, 0]},
    }
    for _ in range(400):
        tracker.step(**given[how])
    assert away(tracker.q) > 0.01


def test_a_slow_jog_leaves_enough_room_to_leave() -> None:
    """At 0.05 mm/s each step used 1e-7 m of the reserve up, until no motion was possible any more."""
    arm, home = kinseek.load("ur5e"), np.array(HOMES["ur5e"])
    scene = wall(arm)
    tracker = arm.track(home, 0.002, **LIMITS, scene=scene)
    T = arm.fk(home)
    T[0, 3] += 0.2
    for _ in range(1500):
        tracker.step(T)
    for _ in range(12_000):
        step = tracker.step(twist=[4e-5, 0, 0, 0, 0, 0])
    assert step.status is TrackStatus.BRAKING
    assert scene.distance(step.q) > 8e-4
    for _ in range(400):
        tracker.step(twist=[-0.05, 0, 0, 0, 0, 0])
    assert scene.distance(tracker.q) > 0.01


def test_the_arm_comes_near_the_body_that_holds_it() -> None:
    """The old bound of another pair left it 2e-6 m of room in every step, so that it stood 8.5 mm away for ever."""
    pytest.importorskip("coal")
    arm, rng = kinseek.load("ur5e"), np.random.default_rng(12)
    home, goal = arm.sample(1, seed=12)[0], arm.fk(arm.sample(1, seed=7789)[0])
    scene = Scene.of(arm, capsules=0.03)
    for k in range(6):
        radius = rng.uniform(0.03, 0.12)
        scene.add_sphere(f"ball {k}", radius, kinseek.pose(rng.normal(0, 0.45, 3)))
    tracker = arm.track(home, 0.004, velocity=1.5, scene=scene, recover=False)
    for _ in range(1500):
        step = tracker.step(goal)
    assert step.status is TrackStatus.BRAKING
    assert scene.distance(step.q) < 1.5e-3


def test_no_matrix_is_followed_beside_a_body() -> None:
    """While the hand goes straight after a body held it, any matrix was made a pose near the hand."""
    arm, home = kinseek.load("ur5e"), np.array(HOMES["ur5e"])
    tracker, T = arm.track(home, 0.004, **LIMITS, scene=wall(arm)), arm.fk(home)
    T[0, 3] += 0.2
    for _ in range(1500):
        step = tracker.step(T)
    assert step.status is TrackStatus.BRAKING
    for wrong in (np.zeros((4, 4)), np.diag([1.0, 1.0, -1.0, 1.0]), 2.0 * np.eye(4)):
        with pytest.raises(kinseek.InvalidGoal):
            tracker.step(wrong)
    assert (tracker.q == step.q).all()


def test_a_body_that_is_removed_or_added_is_noticed() -> None:
    arm, home = kinseek.load("ur5e"), np.array(HOMES["ur5e"])
    scene = wall(arm)
    tracker, T = arm.track(home, 0.004, **LIMITS, scene=scene), arm.fk(home)
    T[0, 3] += 0.2
    for _ in range(1500):
        step = tracker.step(T)
    assert step.status is TrackStatus.BRAKING
    scene.remove("wall")
    for _ in range(1500):
        step = tracker.step(T)
    assert step.status is TrackStatus.TRACKING
    scene.add_box("shelf", [0.02, 2.0, 2.0], kinseek.pose([0.35, 0.0, 0.5]))
    hand = scene.distance(step.q)
    for _ in range(300):
        step = tracker.step(T)
    assert hand > 0 or step.status is TrackStatus.BRAKING


def test_a_body_is_noticed_by_the_step_after_an_interrupted_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a handler of a signal raised in the step after the change made the tracker forget the new body for good."""
    arm, home = kinseek.load("ur5e"), np.array(HOMES["ur5e"])
    scene = Scene.of(arm, capsules=0.05)
    tracker, T = arm.track(home, 0.004, **LIMITS, scene=scene), arm.fk(home)
    T[0, 3] += 0.2
    tracker.step(arm.fk(home))
    scene.add_box("wall", [0.02, 2.0, 2.0], kinseek.pose([arm.fk(home)[0, 3] + 0.1, 0.0, 0.5]))
    assert scene.free(home)

    def interrupted(*given: Any) -> Any:
        monkeypatch.undo()
        raise TimeoutError

    monkeypatch.setattr(limited, "Room", interrupted)
    with pytest.raises(TimeoutError):
        tracker.step(T)
    assert all(scene.free(tracker.step(T).q) for _ in range(300))


@pytest.mark.parametrize("narrow", [False, True])
@pytest.mark.parametrize("slide", [1.0, 1.05, 1.3, 2.0])
def test_a_slide_outside_the_range_of_the_scene_is_as_long_as_it_is(slide: float, narrow: bool) -> None:
    """The hand moves faster than within the range, and went through the ball, even if only the scene has that range."""
    arm = kinseek.load(
        """<robot name="telescope"><link name="base"/><link name="turning"/>
        <link name="hand"><collision><geometry><sphere radius="0.01"/></geometry></collision></link>
        <joint name="turn" type="revolute"><parent link="base"/><child link="turning"/><axis xyz="0 0 1"/>
        <limit lower="-3" upper="3" effort="1" velocity="2"/></joint>
        <joint name="slide" type="prismatic"><parent link="turning"/><child link="hand"/><axis xyz="1 0 0"/>
        <limit lower="0" upper="3" effort="1" velocity="0.05"/></joint></robot>"""
    )
    pytest.importorskip("coal")
    short = arm.with_limits({"slide": (0.0, 1.0)})
    arm, scene = arm if narrow else short, Scene.of(short)
    ball = slide * np.array([np.cos(0.8), np.sin(0.8)])
    scene.add_sphere("ball", 0.01, kinseek.pose([*ball, 0.0]))
    tracker = arm.track([0.0, slide], 0.002, acceleration=5.0, scene=scene, recover=False)
    for _ in range(1000):
        turn, length = tracker.step(velocity=[2.0, 0.0]).q
        hand = length * np.array([np.cos(turn), np.sin(turn)])
        assert np.linalg.norm(hand - ball) > 0.02
    assert np.linalg.norm(hand - ball) < 0.03


def test_misuse_is_refused() -> None:
    arm, home = kinseek.load("ur5e"), np.array(HOMES["ur5e"])
    scene = wall(arm)
    scene.add_sphere("ball", 0.1, kinseek.pose(arm.fk(home)[:3, 3]))
    with pytest.raises(InvalidProblem, match="q0 is in collision"):
        arm.track(home, scene=scene)
    with pytest.raises(InvalidProblem, match="clearance= needs a scene"):
        arm.track(home, clearance=0.1)
    with pytest.raises(InvalidScene):
        kinseek.load("irb120").track(np.zeros(6), scene=scene)


@pytest.mark.slow
def test_a_target_that_rests_is_reached_beside_a_body() -> None:
    """The straight way of the hand begins closer to a body; the straight way of the joints is free."""
    pytest.importorskip("coal")
    arm, reached = kinseek.load("irb120"), 0
    for seed in range(5):
        scene = cell(arm, np.zeros(6), 20, seed, 0.05)
        ways = arm.sample(200, seed=seed)
        q0, q1 = ways[scene.free(ways)][:2]
        kept = arm.track(q0, 0.004, **LIMITS, scene=scene, recover=False)
        back = arm.track(q0, 0.004, **LIMITS, scene=scene)
        for tracker in (kept, back):
            for T in [arm.fk(q1)] * 600 + [arm.fk(q0)] * 800:
                step = tracker.step(T)
            assert scene.free(step.q)
        if kept.step(arm.fk(q0)).status is not TrackStatus.TRACKING:
            reached += step.status is TrackStatus.TRACKING
    assert reached > 0
