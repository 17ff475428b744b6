"""Planned motions are free by an outside judge, the same every time, and not found where there are none."""

from __future__ import annotations

import threading
import time
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

import kinseek
from kinseek import Goal, InvalidGoal, InvalidProblem, InvalidScene, NotReached, Scene, Status
from kinseek.collision import Box, ends
from kinseek.paths.path import PathStatus
from kinseek.planning.shorten import lengths
from kinseek.planning.space import Space
from kinseek.planning.trees import Tree

pytest.importorskip("pinocchio")

DOWN = [np.pi, 0.0, 0.0]
POSES = kinseek.pose([[0.45, -0.3, 0.25], [0.45, 0.3, 0.25]], rpy=DOWN)
"""On both sides of the wall."""


def walled(name: str, radius: float = 0.05) -> tuple[kinseek.Arm, Scene]:
    """An arm with a table, and a wall between its left and its right."""
    arm = kinseek.load(name)
    scene = Scene.of(arm, capsules=radius)
    scene.add_box("table", (1.0, 1.6, 0.04), kinseek.pose([0.65, 0.0, -0.06]))
    if name != "ur10e_rail":  # The rail ends at the wall.
        scene.add_box("wall", (0.6, 0.03, 0.7), kinseek.pose([0.6, 0.0, 0.3]))
    return arm, scene


def begin_and_end(arm: kinseek.Arm, scene: Scene) -> tuple[Any, Any]:
    """Free joint values, of which the straight motion between is not free."""
    q = arm.sample(400, seed=3)
    q = q[scene.free(q)]
    for a, b in pairwise(q):
        b[4:] = a[4:]  # Capsules of a wrist may divide its turns into parts without a way between them.
        if scene.free(b) and not scene.free_motion(a, b):
            return a, b
    raise AssertionError("no such joint values")


def require_free(path: Any, arm: kinseek.Arm, scene: Scene) -> None:
    """Check a path by MuJoCo, at ten thousand points along it, and by its own proof."""
    from benchmarks.outside import Outside

    assert path.status is PathStatus.CONTINUOUS
    assert np.all(scene.free_motion(path.q[:-1], path.q[1:], path.clearance))
    places = np.concatenate([[0.0], np.cumsum(lengths(path.q))])
    at = np.linspace(0.0, places[-1], 10_000)
    q = np.stack([np.interp(at, places, row) for row in path.q.T], axis=1)
    assert Outside(scene, arm).depths(q).max() == 0.0
    lower, upper = (
        np.where(arm.mechanism.endless, -np.inf, arm.lower),
        np.where(arm.mechanism.endless, np.inf, arm.upper),
    )
    assert ((path.q >= lower) & (path.q <= upper)).all()


def test_a_planned_motion_leaves_space_for_the_spline_of_timed() -> None:
    """The straight motion goes through the wall; the shortest way around it touches its edge."""
    arm = kinseek.load("ur5e")
    scene = Scene.of(arm, capsules=0.05)
    scene.add_box("wall", (0.7, 0.04, 0.6), kinseek.pose([0.62, 0.0, 0.1]))
    scene.add_box("beam", (1.0, 0.08, 0.08), kinseek.pose([0.45, 0.0, 0.7]))
    right, left = (kinseek.pose([0.5, y, 0.15], rpy=DOWN) for y in (-0.35, 0.35))
    q0 = arm.ik(right, scene=scene, near=[-0.5, -2.1, 2.4, -1.9, -1.6, -2.1]).require().q
    path = scene.plan(q0, arm.ik(left, scene=scene, near=q0).require().q)
    assert not scene.free_motion(path.q[0], path.q[-1])
    assert len(path.timed(velocity=2.0, acceleration=8.0).stops) == 0


@pytest.mark.slow
@pytest.mark.parametrize("smooth", [True, False])
@pytest.mark.parametrize("name", ["ur5e", "panda", "iiwa14", "jaco2_6", "scara4", "ur10e_rail"])
def test_planned_motions_are_free_by_an_outside_check(name: str, smooth: bool) -> None:
    pytest.importorskip("mujoco")
    arm, scene = walled(name, 0.03)
    q0, q1 = begin_and_end(arm, scene)
    path = scene.plan(q0, q1, smooth=smooth)
    require_free(path, arm, scene)
    turns = (path.q[-1] - q1) / (2.0 * np.pi) * arm.mechanism.endless
    np.testing.assert_allclose(turns, np.round(turns), atol=1e-12)
    np.testing.assert_array_equal(path.q[0], q0)
    np.testing.assert_allclose(path.q[-1] - 2.0 * np.pi * turns, q1, atol=1e-12)
    trajectory = path.timed(velocity=1.5, acceleration=6.0)
    times = np.linspace(0.0, trajectory.duration, 3000)
    assert scene.free(trajectory.q(times)).all()


@pytest.mark.slow
def test_poses_branches_and_several_goals() -> None:
    pytest.importorskip("mujoco")
    for name in ("ur5e", "panda"):
        arm, scene = walled(name)
        q0 = arm.ik(POSES[0], scene=scene).require().q
        for goal in (
            POSES[1],
            Goal.position([0.45, 0.3, 0.25]),
            [POSES[1], Goal.pose(POSES[1], free="rz")],
            POSES[1:],
        ):
            path = scene.plan(q0, goal)
            require_free(path, arm, scene)
            reached = arm.fk(path.q[-1])
            np.testing.assert_allclose(reached[:3, 3], [0.45, 0.3, 0.25], atol=1e-5)
        # Of several goals a near one is reached, whatever the others are.
        q1 = arm.ik(POSES[1], scene=scene).require().q
        near = q0 + 0.02
        assert scene.free_motion(q0, near)
        np.testing.assert_allclose(scene.plan(q0, [q1, near]).q[-1], near, atol=1e-12)
        np.testing.assert_allclose(scene.plan(q0, np.stack([q1, near])).q[-1], near, atol=1e-12)


def test_smooth_ways_are_shorter_and_have_clearance() -> None:
    arm, scene = walled("ur5e")
    q0, q1 = (arm.ik(T, scene=scene, clearance=0.02).require().q for T in POSES)
    first, path = scene.plan(q0, q1, smooth=False, clearance=0.02), scene.plan(q0, q1, clearance=0.02)
    assert first.success
    assert path.success
    assert path.length < 0.9 * first.length
    assert np.all(scene.free_motion(path.q[:-1], path.q[1:], 0.02))
    assert scene.distance(path.q).min() > 0.02
    assert path.scene is scene
    assert path.clearance == 0.02


def test_a_straight_motion_is_taken_if_it_is_free() -> None:
    arm, scene = walled("ur5e")
    q0 = arm.ik(POSES[0], scene=scene).require().q
    path = scene.plan(q0, q0 - 0.1)
    np.testing.assert_allclose(path.length, 0.1 * np.sqrt(6.0), rtol=1e-9)
    assert len(scene.plan(q0, q0).q) == 2


def test_continuous_joints_turn_the_shorter_way() -> None:
    arm = kinseek.load("jaco2_6")
    endless = np.flatnonzero(arm.mechanism.endless)
    assert len(endless)
    scene = Scene.of(arm, capsules=0.01)
    q0 = next(q for q in arm.sample(50, seed=1) if scene.free(q))
    q1 = q0.copy()
    q1[endless] += 2.0 * np.pi - 0.01
    path = scene.plan(q0, q1)
    np.testing.assert_allclose(path.q[-1][endless] - q0[endless], -0.01, atol=1e-9)


def test_the_same_bits_from_any_thread() -> None:
    _, scene = walled("panda")
    arm = kinseek.load("panda")
    q0 = arm.ik(POSES[0], scene=scene).require().q
    found: list[Any] = [scene.plan(q0, POSES[1]).q for _ in range(2)]
    threads = [threading.Thread(target=lambda: found.append(scene.plan(q0, POSES[1]).q)) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(found) == 4
    assert len({q.tobytes() for q in found}) == 1


def test_no_way_through_a_closed_wall() -> None:
    # A ring around the first joint of a planar arm: neither side can be left.
    arm = kinseek.Arm.from_dh([[0.5, 0, 0, 0], [0.5, 0, 0, 0]], [-3, -3], [3, 3])
    scene = Scene.of(arm, capsules=0.01)
    scene.add_box("wall", (0.8, 0.02, 0.5), kinseek.pose([0.5, 0.0, 0.0]))
    q0, q1 = np.array([-1.0, 0.0]), np.array([1.0, 0.0])
    began = time.monotonic()
    path = scene.plan(q0, q1, time_limit=0.5)
    assert time.monotonic() - began < 1.5
    assert path.status is PathStatus.OUT_OF_TIME
    assert not path.success
    assert "no way was found within the time limit" in path.why[0]
    np.testing.assert_array_equal(path.q, [q0, q1])
    with pytest.raises(NotReached, match="no way was found"):
        path.require()
    with pytest.raises(InvalidProblem, match="not free of collision"):
        path.timed(velocity=1.0, acceleration=1.0)
    assert scene.plan(q0, [-0.5, 0.5]).success


@pytest.mark.slow
@pytest.mark.parametrize("joints", [2, 3, 5])
def test_planted_walls_are_never_passed(joints: int) -> None:
    # The first joint cannot turn past a wall that crosses the way of its link.
    arm = kinseek.Arm.from_dh([[0.4, 0, 0, 0]] * joints, [-3] * joints, [3] * joints)
    rng = np.random.default_rng(joints)
    for thick in 10.0 ** rng.uniform(-4.0, -1.5, 34):
        angle = rng.uniform(-1.5, 1.5)
        scene = Scene.of(arm, capsules=0.005)
        place = kinseek.pose([0.3 * np.cos(angle), 0.3 * np.sin(angle), 0.0], rpy=[0.0, 0.0, angle])
        scene.add_box("wall", (0.2, thick, 0.1), place)
        q = arm.sample(200, seed=int(rng.integers(1000)))
        q = q[scene.free(q)]
        sides = q[:, 0] > angle
        began = time.monotonic()
        path = scene.plan(q[sides][0], q[~sides][:5], time_limit=0.04)
        assert path.status is PathStatus.OUT_OF_TIME
        assert time.monotonic() - began < 2.0


@pytest.mark.slow
def test_attached_objects_are_carried_around() -> None:
    pytest.importorskip("mujoco")
    arm, scene = walled("ur5e")
    scene.attach("plank", Box((0.3, 0.05, 0.02)), to="tool0", pose=kinseek.pose([0.0, 0.0, 0.05]))
    higher = kinseek.pose([0.0, 0.0, -0.1])
    q0, q1 = (arm.ik(T @ higher, scene=scene).require().q for T in POSES)
    path = scene.plan(q0, q1)
    require_free(path, arm, scene)


def test_a_begin_in_collision_is_an_error_with_a_free_one() -> None:
    arm, scene = walled("ur5e")
    q = arm.ik(kinseek.pose([0.45, 0.0, 0.3], rpy=DOWN)).q
    with pytest.raises(
        InvalidProblem, match=r"q0 is in collision.* wall.*nearest free joint values found are \["
    ) as raised:
        scene.plan(q, POSES[1])
    offered = str(raised.value).rsplit("[", 1)[1].rstrip("]")
    assert scene.free([float(value) for value in offered.split(",")])


def test_goals_in_collision_are_errors_with_what_is_hit() -> None:
    arm, scene = walled("ur5e")
    q0 = arm.ik(POSES[0], scene=scene).require().q
    middle = kinseek.pose([0.45, 0.0, 0.3], rpy=DOWN)
    blocked = arm.ik(middle).q
    with pytest.raises(InvalidProblem, match=r"goal is in collision.* wall"):
        scene.plan(q0, blocked)
    with pytest.raises(InvalidProblem, match="none of 2 goals"):
        scene.plan(q0, [blocked, blocked])
    with pytest.raises(NotReached, match="wall") as raised:
        scene.plan(q0, middle)
    assert raised.value.solution.status is Status.PROVED_BLOCKED
    assert {contact.b for contact in raised.value.solution.contacts} >= {"wall"}
    with pytest.raises(NotReached, match=r"off by 2\.\d+ m and ") as far:
        scene.plan(q0, kinseek.pose([3.0, 0.0, 0.3], rpy=DOWN))
    assert far.value.solution.status is Status.PROVED_UNREACHABLE or not far.value.solution.success
    # One that is free is enough.
    assert scene.plan(q0, [blocked, middle, q0 - 0.1]).success


def test_a_motion_to_limits_ends_at_them_and_stays_inside() -> None:
    arm = kinseek.load("panda")
    scene = Scene.of(arm, capsules=0.02)
    lower, upper = arm.chain.lower, arm.chain.upper
    rng = np.random.default_rng(0)
    begins, goals = arm.sample(60, seed=0), arm.sample(60, seed=1)
    side = rng.random(goals.shape)
    goals = np.where(side < 0.3, lower, np.where(side < 0.6, upper, goals))
    free = np.asarray(scene.free(begins)) & np.asarray(scene.free(goals))
    assert free.sum() >= 10
    for q0, q1 in zip(begins[free], goals[free], strict=True):
        path = scene.plan(q0, q1)
        assert path.success
        np.testing.assert_array_equal(path.q[[0, -1]], [q0, q1])
        assert np.all((path.q >= lower) & (path.q <= upper))


def test_free_ends_that_are_too_near_are_not_called_in_collision() -> None:
    arm, scene = walled("ur5e")
    q0, q1 = (arm.ik(T, scene=scene).require().q for T in POSES)
    with pytest.raises(InvalidProblem, match=r"q0 is nearer to a body than the clearance, 0\.5 m, so"):
        scene.plan(q0, q1, clearance=0.5)
    clearance = (scene.distance(q0) + scene.distance(q1)) / 2.0
    begin, goal = (q0, q1) if scene.distance(q0) > scene.distance(q1) else (q1, q0)
    with pytest.raises(InvalidProblem, match="goal is nearer to a body than the clearance"):
        scene.plan(begin, goal, clearance=clearance)


def test_invalid_arguments() -> None:
    arm, scene = walled("ur5e")
    q0 = arm.ik(POSES[0], scene=scene).require().q
    for wrong in (np.full(6, np.nan), np.full(6, 99.0), np.zeros(5)):
        with pytest.raises(InvalidProblem, match="q0"):
            scene.plan(wrong, q0)
        with pytest.raises(InvalidProblem, match="goal"):
            scene.plan(q0, wrong)
    with pytest.raises(InvalidGoal):
        scene.plan(q0, np.full((4, 4), np.nan))
    with pytest.raises(InvalidProblem, match="at least one goal"):
        scene.plan(q0, [])
    with pytest.raises(InvalidProblem, match="time_limit"):
        scene.plan(q0, q0, time_limit=0.0)
    with pytest.raises(InvalidScene, match="clearance"):
        scene.plan(q0, q0, clearance=-1.0)
    with pytest.raises(kinseek.InvalidUse, match="timeout"):
        scene.plan(q0, q0, timeout=1.0)  # type: ignore[arg-type]
    assert scene.plan(dict(zip(arm.joint_names, q0, strict=True)), q0).success


def test_a_removed_node_takes_what_grew_from_it() -> None:
    arm, scene = walled("ur5e")
    tree = Tree(Space(arm.chain, scene, 0.0, np.zeros(6), np.zeros((1, 6))), np.zeros((1, 6)))
    for parent in (0, 0, 1, 3, 2):  # 1 and 2 grow from the root, 3 from 1, 4 from 3, 5 from 2.
        tree.add(np.full((1, 6), float(len(tree))), np.array([parent]))
    tree.remove([1])
    assert tree.q[:, 0].tolist() == [0.0, 2.0, 5.0]
    assert tree.parents.tolist() == [-1, 0, 1]
    assert tree.branch(2) == [0, 1, 2]


def test_of_many_goals_those_are_solved_for_which_there_is_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each goal took a millisecond after the time was up: 20,000 took 17 s."""
    arm, scene = walled("ur5e")
    q0, _ = begin_and_end(arm, scene)
    calls, of_one = list[int](), ends._of_one

    def slow(*args: Any) -> Any:
        calls.append(1)
        time.sleep(0.01)
        return of_one(*args)

    monkeypatch.setattr(ends, "_of_one", slow)
    scene.plan(q0, arm.fk(arm.sample(300, seed=5)), time_limit=0.1)
    assert 1 <= len(calls) < 50
