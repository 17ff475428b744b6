"""Paths in a scene: free at every pose and on every step by a check of their own, and honest about what is in the way."""

from __future__ import annotations

import numpy as np
import pytest

import kinseek
from kinseek import Goal, InvalidProblem, InvalidScene, PathStatus, Scene

pytest.importorskip("pinocchio")


def line(count: int = 60, x: float = 0.5, z: float = 0.3) -> np.ndarray:
    return np.array([kinseek.pose([x, y, z], rpy=[np.pi, 0, 0]) for y in np.linspace(-0.3, 0.3, count)])


def dense(q: np.ndarray, parts: int = 20) -> np.ndarray:
    """Points all along a path."""
    share = np.linspace(0.0, 1.0, parts, endpoint=False)[None, :, None]
    return np.asarray((q[:-1, None] + share * np.diff(q, axis=0)[:, None]).reshape(-1, q.shape[1]))


@pytest.fixture(scope="module")
def ur5e() -> kinseek.Arm:
    return kinseek.load("ur5e")


@pytest.fixture
def table(ur5e: kinseek.Arm) -> Scene:
    scene = Scene.of(ur5e, capsules=0.05)
    scene.add_box("table", (1.0, 1.6, 0.04), kinseek.pose([0.55, 0.0, -0.06]))
    scene.add_capsule("pole", 0.03, 0.8, kinseek.pose([0.3, -0.2, 0.4]))
    return scene


def test_poses_and_steps_are_free(ur5e: kinseek.Arm, table: Scene) -> None:
    T = line()
    plain = ur5e.follow(T).require()
    assert not table.free(plain.q, 0.01).all()  # Without a scene the elbow goes through the pole.
    path = ur5e.follow(T, scene=table, clearance=0.01).require()
    assert path.reached.all()
    assert table.free(dense(path.q), 0.01).all()
    assert table.free_motion(path.q[:-1], path.q[1:], 0.01).all()
    refused: list[np.ndarray] = []

    def valid(q: np.ndarray) -> bool:
        refused.append(q)
        return bool(abs(q[0] - path.q[0, 0]) > 0.5)

    other = ur5e.follow(T, scene=table, clearance=0.01, valid=valid)
    assert all(valid(q) for q in other.q[other.reached])
    assert table.free(dense(other.q), 0.01)[np.repeat(other.reached[:-1] & other.reached[1:], 20)].all()


def test_what_is_in_the_way_is_named(ur5e: kinseek.Arm, table: Scene) -> None:
    table.remove("pole")
    table.add_box("crate", (0.1, 0.1, 0.3), kinseek.pose([0.5, 0.1, 0.3]))
    T = line()
    path = ur5e.follow(T, scene=table)
    free = np.array([table.free(ur5e.branches(pose).q).any() for pose in T])
    assert 5 < (~free).sum() < 40
    assert path.status is PathStatus.BLOCKED
    assert np.array_equal(path.reached, free)
    assert table.free(path.q[path.reached]).all()
    missed = np.flatnonzero(~free)
    middle = (missed[0] + missed[-1]) // 2
    least = table.distance(ur5e.branches(T[middle]).q).max()
    (why,) = path.why
    assert why.startswith(f"poses {missed[0]} to {missed[-1]} are blocked")
    assert f"at pose {middle}" in why
    assert "and crate" in why
    assert f"{-least * 1e3:.1f} mm deep" in why
    with pytest.raises(
        kinseek.NotReached, match="are blocked: in every solution found the arm hits something"
    ):
        path.require()
    near = ur5e.follow(T[:3], scene=table, clearance=0.5)
    assert "or comes nearer than 0.5 m; at pose 1, in the one that collides least: " in near.why[0]
    assert "mm apart" in near.why[0]


def test_a_break_tells_which_bodies_end_the_branches() -> None:
    """A ball is in the way of each of two branches, at different poses: every pose has an answer, and no branch all."""
    arm = kinseek.Arm.from_dh([[0.5, 0, 0, 0], [0.5, 0, 0, 0]], [-3, -3], [3, 3])
    T = Goal.position(np.column_stack([np.full(41, 0.7), np.linspace(-0.2, 0.2, 41), np.zeros(41)]))
    scene = Scene.of(arm, capsules=0.01)
    up, down = (arm.follow(T.at(T.target), start=q).q for q in arm.branches(T.at(T.target[0])).q)
    for name, q in (("early", up[10]), ("late", down[30])):
        elbow = [0.45 * np.cos(q[0]), 0.45 * np.sin(q[0]), 0.0]
        scene.add_sphere(name, 0.005, kinseek.pose(elbow))
    path = arm.follow(T, scene=scene)
    assert path.status is PathStatus.BROKEN
    assert len(path.breaks) == 1
    assert 10 <= path.breaks[0] <= 30
    assert scene.free(path.q).all()
    assert "late" in path.why[0]
    assert "early" in path.why[0]


def test_a_step_over_a_thin_wall_is_refused() -> None:
    """Both poses are free, and so are a few points between them; only the sweep sees the wall."""
    arm = kinseek.Arm.from_dh([[0.5, 0, 0, 0], [0.5, 0, 0, 0]], [-3, -3], [3, 3])
    scene = Scene.of(arm, capsules=0.001)
    scene.add_box("wall", (0.3, 1e-4, 0.3), kinseek.pose([0.9, 0.0, 0.0]))
    ends = np.array([[-0.4, 0.1], [0.5, 0.1]])
    goal = Goal.position(arm.fk(ends)[:, :3, 3])
    assert arm.follow(goal, max_step=2.0).success
    path = arm.follow(goal, scene=scene, max_step=2.0)
    assert path.status is PathStatus.BROKEN
    assert path.breaks.tolist() == [0]
    assert "wall" in path.why[0]
    assert arm.follow(goal, scene=scene, start=ends[0], max_step=2.0).status is PathStatus.BROKEN
    scene.remove("wall")
    assert arm.follow(goal, scene=scene, max_step=2.0).success


def test_full_turns_are_refused_together(ur5e: kinseek.Arm, table: Scene) -> None:
    """Joints of ±2π have 64 copies of an answer, and what hits in one hits in all."""
    from kinseek.paths.arguments import goals_of, read
    from kinseek.paths.graph import LayerGraph
    from kinseek.paths.layers import fill_missed, inside_limits, isolated_layers
    from kinseek.support.deadline import Deadline

    goal, _ = goals_of(line(5))
    wishes = dict.fromkeys(("start", "end", "times", "velocity", "weights", "cost", "valid"))
    asked = read(ur5e.mechanism, goal, closed=False, max_step=0.3, scene=table, clearance=0.0, **wishes)
    layers = isolated_layers(asked.problem, asked.longest[0], None, lambda done: None)
    filled, missed = fill_missed(asked.problem, inside_limits(asked.problem, layers), None, Deadline())
    graph = LayerGraph(asked, filled, missed)
    graph.refuse_blocked()
    for i in range(len(graph.count)):
        nodes, q = graph._inside(i)
        assert np.array_equal(~graph._refused[i, nodes], table.free(q))
    edge = (0, 5, 5 + graph.turning.total)
    alike = graph._turned_alike(edge)
    assert edge in alike
    step = np.diff(
        [graph.values(np.array([k]), np.array([n]))[0] for k, n in ((0, edge[1]), (1, edge[2]))], axis=0
    )
    for _, a, b in alike:
        other = graph.values(np.array([1]), np.array([b])) - graph.values(np.array([0]), np.array([a]))
        assert np.allclose(other, step)


def test_closed_paths_come_back_free(ur5e: kinseek.Arm, table: Scene) -> None:
    angles = np.linspace(0, 2 * np.pi, 40, endpoint=False)
    T = np.array(
        [kinseek.pose([0.5 + 0.1 * np.cos(a), 0.1 * np.sin(a), 0.3], rpy=[np.pi, 0, 0]) for a in angles]
    )
    path = ur5e.follow(T, scene=table, clearance=0.01, closed=True).require()
    around = np.concatenate([path.q, path.q[:1]])
    assert table.free_motion(around[:-1], around[1:], 0.01).all()


def test_scenes_are_checked(ur5e: kinseek.Arm, table: Scene) -> None:
    T = line()[20:23]
    with pytest.raises(InvalidScene, match="this scene is of 'ur5e'"):
        kinseek.load("panda").follow(T, scene=table)
    with pytest.raises(InvalidScene, match=r"must be a kinseek\.Scene, got int"):
        ur5e.follow(T, scene=3)  # type: ignore[arg-type]
    with pytest.raises(InvalidProblem, match="give scene="):
        ur5e.follow(T, clearance=0.1)
    with pytest.raises(InvalidScene, match="clearance must be a length"):
        ur5e.follow(T, scene=table, clearance=-0.1)
    start = ur5e.branches(T[0]).q
    start = start[~table.free(start)][0]
    begun = ur5e.follow(T, scene=table, start=start)
    assert begun.reached.tolist() == [False, True, True]
    assert "pose 0 is blocked" in begun.why[0]


@pytest.mark.slow
def test_spare_joints_go_around_what_the_plain_path_hits() -> None:
    arm = kinseek.load("panda")
    scene = Scene.of(arm, capsules=0.05)
    T = line(80, z=0.4)
    plain = arm.follow(T).require()
    elbow = arm.fk(plain.q[40], link=arm.joint_names[3])[:3, 3]
    scene.add_sphere("ball", 0.06, kinseek.pose(elbow))
    assert not scene.free(plain.q).all()
    path = arm.follow(T, scene=scene, clearance=0.005).require()
    assert scene.free(dense(path.q), 0.005).all()
    assert np.allclose(arm.fk(path.q), T, atol=1e-5)
    assert path.largest_step.max() < 0.1
    scene.add_box("crate", (0.1, 0.1, 0.3), kinseek.pose([0.5, 0.1, 0.4]))
    blocked = arm.follow(T, scene=scene)
    assert blocked.status is PathStatus.BLOCKED
    assert "crate" in blocked.why[0]
    assert scene.free(blocked.q[blocked.reached]).all()


@pytest.mark.slow
def test_free_axes_and_a_scene(ur5e: kinseek.Arm, table: Scene) -> None:
    """The tool may turn about its axis: the joint that stands for that is none of the scene's."""
    goal = Goal.pose(line(60), free="rz")
    path = ur5e.follow(goal, scene=table, clearance=0.005)
    assert path.q.shape == (60, 6)
    assert path.success
    assert table.free(dense(path.q), 0.005).all()
    seen = set()

    def valid(q: np.ndarray) -> bool:
        seen.add(q.shape)
        return True

    ur5e.follow(goal, valid=valid)
    assert seen == {(6,)}


def test_a_scene_without_a_pair_to_check_is_tracked_and_followed() -> None:
    arm = kinseek.load("planar2")
    scene = Scene.of(arm, capsules=0.01)
    assert not scene.checks
    q = arm.sample(1, seed=1)[0]
    tracker = arm.track(q, 0.002, 1.0, acceleration=10.0, scene=scene)
    assert tracker.step(arm.fk(q)).status is kinseek.TrackStatus.TRACKING
    assert arm.follow(arm.fk(np.linspace(q, q + 0.1, 10)), scene=scene, start=q).success
