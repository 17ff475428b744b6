"""`Arm.follow` with the duration as its cost: never longer than the shortest path, and everything else as promised."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import kinseek
from kinseek import Goal
from kinseek.errors import InvalidProblem
from kinseek.paths.quicken import aligned_null_spaces, b_splines, shares_of, stretch
from kinseek.timing.limits import Limits

Array = NDArray[np.float64]

TORCH = kinseek.pose([0.1, 0.0, 0.2], rpy=[0.0, np.pi / 4, 0.0])
Q0 = {"panda": [0.3, 0.2, 0.2, -1.9, 0.1, 2.0, 0.5], "ur5e": [0.3, -1.2, 1.5, -1.0, -1.4, 0.2]}


def circle(name: str, count: int = 40, tool: Array | None = None) -> Array:
    """A closed circle of poses in reach; the last is the first."""
    first = kinseek.load(name).fk(np.array(Q0[name])) @ (np.eye(4) if tool is None else tool)
    turns = np.linspace(0.0, 2 * np.pi, count)
    poses = np.repeat(first[None], count, axis=0)
    poses[:, 0, 3] += 0.12 * (np.cos(turns) - 1)
    poses[:, 1, 3] += 0.15 * np.sin(turns)
    poses[-1] = poses[0]
    return poses


def both(name: str, goal: Any, **options: Any) -> tuple[kinseek.Path, kinseek.Path, float]:
    """The fastest and the shortest path, and the ratio of their durations."""
    arm = kinseek.load(name)
    limit = 5.0 * arm.velocity
    fastest = arm.follow(goal, cost="time", acceleration=limit, **options).require()
    shortest = arm.follow(goal, **options).require()
    durations = [path.timed(acceleration=limit).duration for path in (fastest, shortest)]
    return fastest, shortest, durations[0] / durations[1]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "goal", "ratio"),
    [
        ("ur5e", Goal.pose(circle("ur5e")), 1.0),
        ("panda", Goal.pose(circle("panda")), 0.99),
        ("panda", Goal.position(circle("panda")[:, :3, 3]), 0.95),
        ("ur5e", Goal.position(circle("ur5e")[:, :3, 3]), 0.95),
        ("ur5e", Goal.pose(circle("ur5e", tool=TORCH), free="rz", tool=TORCH), 0.97),
        ("panda", Goal.pose(circle("panda", tool=TORCH), free="rz", cone=0.25, tool=TORCH), 0.95),
    ],
)
def test_the_fastest_motion_is_faster_and_reaches_all_poses(name: str, goal: Goal, ratio: float) -> None:
    path, _, found = both(name, goal)
    assert found <= ratio
    arm = kinseek.load(name)
    assert ((path.q >= arm.lower) & (path.q <= arm.upper)).all()
    assert (np.abs(np.diff(path.q, axis=0)) <= 0.3).all()
    # By forward kinematics alone: the point, and how far the tool axis tilts.
    poses = arm.fk(path.q) @ (np.eye(4) if goal.tool is None else goal.tool)
    assert np.abs(poses[:, :3, 3] - goal.target[:, :3, 3]).max() < 1e-6
    tilt = np.linalg.norm(np.cross(poses[:, :3, 2], goal.target[:, :3, 2]), axis=1)
    if goal.kind == "pose":
        assert tilt.max() < 1e-6 + np.sin(goal.cone)
    if goal.ranges is None and goal.kind == "pose":
        assert np.abs(poses - goal.target).max() < 1e-6


@pytest.mark.slow
def test_given_ends_and_a_closed_motion_are_kept() -> None:
    poses, q0 = circle("panda"), np.array(Q0["panda"])
    path, _, ratio = both("panda", poses, start=q0)
    assert ratio <= 1.0
    assert (path.q[0] == q0).all()
    path, _, ratio = both("panda", poses, end=q0)
    assert ratio <= 1.0
    assert (path.q[-1] == q0).all()
    path, _, ratio = both("panda", poses, closed=True)
    assert ratio <= 1.0
    assert (path.q[-1] == path.q[0]).all()
    path, _, ratio = both("panda", poses[:-1], closed=True)
    assert ratio <= 1.0
    assert (np.abs(path.q[-1] - path.q[0]) <= 0.3).all()


@pytest.mark.slow
def test_a_scene_stays_free() -> None:
    arm, poses = kinseek.load("panda"), circle("panda")
    scene = kinseek.Scene.of(arm, capsules=0.05)
    elbow = arm.fk(arm.follow(poses).q, link="panda_link4")[:, :3, 3].mean(axis=0)
    scene.add_box("wall", size=(0.02, 0.5, 0.5), pose=kinseek.pose(elbow + np.array([0.0, 0.0, 0.6])))
    path, _, ratio = both("panda", poses, scene=scene)
    assert ratio <= 1.0
    assert scene.free_motion(path.q[:-1], path.q[1:]).all()


@pytest.mark.slow
def test_the_result_does_not_depend_on_threads_or_runs() -> None:
    arm, poses = kinseek.load("panda"), circle("panda", 20)
    runs = [arm.follow(poses, cost="time", acceleration=10.0, threads=threads).q for threads in (1, 2, 1)]
    assert (runs[0] == runs[1]).all()
    assert (runs[0] == runs[2]).all()


@pytest.mark.slow
def test_equal_poses_and_short_paths() -> None:
    arm, poses = kinseek.load("panda"), circle("panda", 12)
    path = arm.follow(np.repeat(poses, 2, axis=0), cost="time", acceleration=10.0).require()
    assert np.abs(arm.fk(path.q) - np.repeat(poses, 2, axis=0)).max() < 1e-6
    for count in (1, 2, 3):
        assert arm.follow(poses[:count], cost="time", acceleration=10.0).success
    assert arm.follow(poses, cost="time", acceleration=10.0, closed=True).success


def test_missed_poses_and_breaks_give_the_shortest_path() -> None:
    arm, poses = kinseek.load("panda"), circle("panda", 12)
    poses[6, 2, 3] += 3.0
    path, shortest = arm.follow(poses, cost="time", acceleration=10.0), arm.follow(poses)
    assert not path.success
    assert (path.q == shortest.q).all()


def test_a_time_limit_ends_the_search() -> None:
    arm, poses = kinseek.load("panda"), circle("panda", 200)
    arm.follow(poses)
    path = arm.follow(poses, cost="time", acceleration=10.0, time_limit=0.1)
    assert path.out_of_time


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"cost": "fast"}, "\"time\" or a function .* got 'fast'"),
        ({"cost": "time", "acceleration": 0.0}, "acceleration must be above 0"),
        ({"cost": "time", "acceleration": 5.0, "velocity": -1.0}, "velocity must be above 0"),
        ({"cost": "time", "acceleration": 5.0, "times": np.arange(12.0)}, "give one of them"),
        ({"acceleration": 5.0}, 'give cost="time"'),
        ({"cost": "time"}, "no acceleration limit .* give acceleration="),
    ],
)
def test_wrong_arguments_are_named(options: dict[str, Any], words: str) -> None:
    with pytest.raises(InvalidProblem, match=words):
        kinseek.load("ur5e").follow(circle("ur5e", 12), **options)


def test_a_stream_has_no_duration() -> None:
    cost: Any = "time"
    with pytest.raises(InvalidProblem, match="needs all poses at once"):
        next(kinseek.load("ur5e").follow_stream(circle("ur5e", 12), cost=cost))


def test_the_shares_of_the_limits_have_the_derivatives_of_difference_quotients() -> None:
    rng = np.random.default_rng(1)
    moves, y, limits = (
        rng.normal(size=(6, 3)),
        rng.normal(size=6) / 3,
        Limits(np.full(3, 2.0), np.full(3, 7.0)),
    )

    def at(y: Array) -> Any:
        return shares_of(moves, np.exp(y), limits)

    here, h = at(y), 1e-6
    for i in range(6):
        up, down = (at(y + sign * h * np.eye(6)[i]) for sign in (1, -1))
        by = (up.acceleration - down.acceleration) / (2 * h)
        expected = np.zeros_like(by)
        expected[i], expected[i + 1] = here.by_after[i], here.by_before[i + 1]
        np.testing.assert_allclose(by, expected, atol=1e-7)
        np.testing.assert_allclose(
            (up.velocity - down.velocity)[i] / (2 * h), -here.velocity[i], rtol=1e-6, atol=1e-8
        )
    factor = stretch(moves, np.exp(y), limits)
    slower = shares_of(moves, factor * np.exp(y), limits)
    assert max(np.abs(slower.velocity).max(), np.abs(slower.acceleration).max()) == pytest.approx(1.0)


def test_splines_add_up_and_null_spaces_turn_little() -> None:
    s = np.linspace(0.0, 1.0, 50)
    np.testing.assert_allclose(b_splines(s, 5).sum(axis=1), 1.0)
    A, B = np.random.default_rng(2).normal(size=(2, 3, 6))
    J = A + s[:, None, None] * 0.3 * B
    bases = aligned_null_spaces(J, 3)
    assert np.abs(J @ bases).max() < 1e-12
    assert np.abs(np.swapaxes(bases, 1, 2) @ bases - np.eye(3)).max() < 1e-12
    assert np.abs(np.diff(bases, axis=0)).max() < 0.05
