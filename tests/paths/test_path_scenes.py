"""Redundant paths around obstacles: MuJoCo finds no contact, walls are not passed, and what blocks poses is named."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import pytest

import kinseek
from kinseek import Goal, Path, PathStatus, Scene
from kinseek.paths.allowed import Allowed

pytest.importorskip("pinocchio")

FINER, WALL = 20, 0.003
"""Points of a step that are checked, and the place of a wall between two poses [m]."""


def line(count: int = 120, half: float = 0.3) -> np.ndarray:
    return kinseek.pose([[0.5, y, 0.3] for y in np.linspace(-half, half, count)], rpy=[np.pi, 0.0, 0.0])


def goal_of(arm: kinseek.Arm, poses: np.ndarray) -> Any:
    """Poses, with a free turn for six joints."""
    return Goal.pose(poses, free="rz") if arm.dof == 6 else Goal.pose(poses)


def require_free(path: Path, arm: kinseek.Arm, scene: Scene) -> None:
    """Check the reached poses and the steps between them by MuJoCo, by points of the scene, and by a proof."""
    from benchmarks.outside import Outside

    steps = np.setdiff1d(np.flatnonzero(path.reached[:-1] & path.reached[1:]), path.breaks)
    begin, end = path.q[steps], path.q[steps + 1]
    assert scene.free_motion(begin, end, path.clearance).all()
    points = (begin + np.linspace(0.0, 1.0, FINER)[:, None, None] * (end - begin)).reshape(-1, arm.dof)
    points = np.concatenate([points, path.q[path.reached]])
    assert scene.free(points, path.clearance).all()
    assert not Outside(scene, arm).depths(points).any()


def posts(arm: kinseek.Arm, q: np.ndarray, links: int, seed: int, radius: float = 0.03) -> Scene:
    """Thin posts through links of a path that is followed without a scene, but not at its hand."""
    scene, rng = Scene.of(arm, capsules=radius), np.random.default_rng(seed)
    for k in range(links):
        row = q[rng.integers(len(q))]
        link = arm.fk(row, link=arm.joint_names[rng.integers(2, arm.dof - 2)])[:3, 3]
        scene.add_cylinder(f"post {k}", radius / 10, 0.1, kinseek.pose(link, rpy=rng.uniform(-3, 3, 3)))
    return scene


@pytest.mark.slow
@pytest.mark.parametrize("name", ["panda", "iiwa14", "gen3", "ur5e", "ur10e_rail"])
def test_paths_around_posts_are_free_by_outside_checks(name: str) -> None:
    pytest.importorskip("mujoco")
    arm = kinseek.load(name)
    goal, continuous = goal_of(arm, line()), 0
    plain = arm.follow(goal)
    for seed in range(4):
        scene = posts(arm, plain.q, 2, seed)
        path = arm.follow(goal, scene=scene)
        require_free(path, arm, scene)
        continuous += path.success and not scene.free(plain.q).all()
        again = arm.follow(goal, scene=scene, threads=1)
        assert again.q.tobytes() == path.q.tobytes()
        assert again.breaks.tolist() == path.breaks.tolist()
    assert continuous, "there is a way around some posts"


def between(seed: int) -> tuple[kinseek.Arm, Any, Scene]:
    """A path of a thin arm, in steps that are longer than it is thick, and posts through it between poses."""
    arm = kinseek.load("ur5e")
    goal = goal_of(arm, line(40))
    q = arm.follow(goal).q
    scene = posts(arm, 0.75 * q[:-1] + 0.25 * q[1:], 2, seed, 0.0005)
    assert scene.free(np.concatenate([q, (q[:-1] + q[1:]) / 2])).all(), (
        "poses and middles of steps see no post"
    )
    assert not scene.free_motion(q[:-1], q[1:]).all()
    return arm, goal, scene


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 9])
def test_steps_that_samples_took_for_free_are_planned_again(seed: int) -> None:
    pytest.importorskip("mujoco")
    arm, goal, scene = between(seed)
    path = arm.follow(goal, scene=scene).require()
    require_free(path, arm, scene)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 9])
def test_what_is_returned_is_free_whatever_samples_say(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("mujoco")
    arm, goal, scene = between(seed)
    monkeypatch.setattr(Allowed, "probably_free", lambda self, a, b, margin=0.0: np.ones(len(a), np.bool_))
    path = arm.follow(goal, scene=scene)
    assert path.reached.all()
    require_free(path, arm, scene)


@pytest.mark.slow
@pytest.mark.parametrize("radius", [0.03, 0.001])
@pytest.mark.parametrize("name", ["panda", "ur5e"])
def test_a_wall_across_all_ways_is_not_passed(name: str, radius: float) -> None:
    pytest.importorskip("mujoco")
    arm = kinseek.load(name)
    scene = Scene.of(arm, capsules=radius)
    # A step of 15 mm leads over it, no sample meets it, and the arm cannot reach around it.
    scene.add_box("wall", (3.0, 1e-4, 3.0), kinseek.pose([1.7, WALL, 0.0]))
    poses = line(40)
    began = time.process_time()
    path = arm.follow(goal_of(arm, poses), scene=scene)
    assert time.process_time() - began < 20.0
    assert not path.success
    assert (path.reached == (np.abs(poses[:, 1, 3] - WALL) > radius)).mean() > 0.9
    left, right = path.reached[:20], path.reached[20:]
    assert left.any()
    assert right.any()
    require_free(path, arm, scene)
    # Wherever the hand changes sides, the path is interrupted.
    here = arm.fk(path.q)[:, 1, 3]
    crossing = np.flatnonzero((here[:-1] < WALL) & (here[1:] >= WALL))
    interrupted = ~path.reached[crossing] | ~path.reached[crossing + 1] | np.isin(crossing, path.breaks)
    assert interrupted.all()
    assert path.reached.all() or any("wall" in why for why in path.why)


def test_where_all_poses_are_blocked_all_are_missed() -> None:
    arm = kinseek.load("panda")
    scene = Scene.of(arm, capsules=0.03)
    scene.add_box("block", (0.4, 1.0, 0.4), kinseek.pose([0.5, 0.0, 0.35]))
    path = arm.follow(line(30), scene=scene)
    assert path.status is PathStatus.BLOCKED
    assert not path.reached.any()
    assert not len(path.breaks)
    (why,) = path.why
    assert why.startswith("poses 0 to 29 are blocked")
    assert "block" in why


def test_what_blocks_some_poses_is_named_and_the_others_are_followed() -> None:
    pytest.importorskip("mujoco")
    arm = kinseek.load("panda")
    scene = Scene.of(arm, capsules=0.03)
    for name, y in (("crate", -0.1), ("ball", 0.2)):
        scene.add_sphere(name, 0.03, kinseek.pose([0.5, y, 0.3]))
    poses = line(100)
    path = arm.follow(poses, scene=scene)
    assert path.status is PathStatus.BLOCKED
    assert len(path.missed) == 2
    require_free(path, arm, scene)
    for (first, last), name, why in zip(path.missed, ("crate", "ball"), path.why, strict=False):
        assert why.startswith(f"poses {first} to {last} are blocked")
        assert name in why
        for i in range(first, last + 1, 4):
            assert not scene.free(arm.branches(poses[i], count=60).q).any()
