"""Goals with a cone: the tool axis within an angle of its direction, judged by the angle of two vectors."""

from __future__ import annotations

import math
from typing import Any, Literal

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import kinseek
from benchmarks.targets import plain_fk, random_joints
from kinseek import Goal
from kinseek.errors import InvalidGoal
from kinseek.kernels.ranges.search import solve_ranged
from kinseek.solvers.atlas import ranges

Array = NDArray[np.float64]

TOLERANCE, ROUNDING = 1e-6, 1e-12


def between(a: Array, b: Array) -> Array:
    """Angles between rows of unit vectors, (k, 3), [rad]."""
    return np.asarray(np.arctan2(np.linalg.norm(np.cross(a, b), axis=-1), (a * b).sum(axis=-1)))


def tilted(T: Array, cone: float, seed: int) -> Array:
    """Poses whose z axis is at most the angle of the cone away from that of given poses, and any turn about it."""
    rng = np.random.default_rng(seed)
    angle, about, spin = cone * np.sqrt(rng.random(len(T))), *rng.uniform(-np.pi, np.pi, (2, len(T)))
    tilt = np.stack([angle * np.cos(about), angle * np.sin(about), np.zeros(len(T))], axis=1)
    turn = Rotation.from_rotvec(tilt) * Rotation.from_rotvec(spin[:, None] * np.eye(3)[2])
    moved = T.copy()
    moved[:, :3, :3] = T[:, :3, :3] @ turn.as_matrix()
    return moved


@pytest.mark.parametrize("cone", [0.01, 0.17, 1.2, math.pi])
@pytest.mark.parametrize("name", ["ur5e", "panda", "so101", "puma560"])
def test_a_cone_around_a_reachable_pose_is_reached(name: str, cone: float) -> None:
    arm = kinseek.load(name)
    wanted = tilted(plain_fk(arm.chain, random_joints(arm.chain, 200, seed=1)), cone, seed=2)
    solution = arm.ik(Goal.pose(wanted, free="rz", cone=cone))
    reached = plain_fk(arm.chain, solution.q)
    excess = np.maximum(between(reached[:, :3, 2], wanted[:, :3, 2]) - cone, 0.0)
    np.testing.assert_allclose(solution.orientation_error, excess, atol=ROUNDING)
    assert solution.success.all()
    assert excess.max() <= TOLERANCE + ROUNDING


def test_directions_with_a_cone_are_poses_with_a_cone() -> None:
    arm = kinseek.load("ur5e")
    T = plain_fk(arm.chain, random_joints(arm.chain, 1, seed=3))[0]
    q = random_joints(arm.chain, 50, seed=4)
    pose = Goal.pose(T, free="rz", cone=0.3)
    for other in (
        Goal.pointing(T[:3, 3], T[:3, 2], cone=0.3),
        Goal.pose(T, box={"rz": (-math.pi, math.pi)}, cone=0.3),
    ):
        for one in q:
            mine, its = (goal.measure(arm.chain.arrays, one[None])[0] for goal in (pose, other))
            np.testing.assert_allclose(mine, its, atol=1e-9)


def test_a_cone_may_be_about_an_axis_of_the_base() -> None:
    arm = kinseek.load("ur5e")
    T = plain_fk(arm.chain, random_joints(arm.chain, 100, seed=5))
    solution = arm.ik(Goal.pose(T, free="rz", cone=0.2, frame="base"))
    reached = plain_fk(arm.chain, solution.q)
    up = reached[:, :3, :3] @ np.swapaxes(T[:, :3, :3], 1, 2) @ np.array([0.0, 0.0, 1.0])
    excess = np.maximum(between(up, np.broadcast_to([0.0, 0.0, 1.0], up.shape)) - 0.2, 0.0)
    np.testing.assert_allclose(solution.orientation_error, excess, atol=ROUNDING)
    assert solution.success.all()


def test_out_of_the_cone_the_tilt_beyond_it_is_reported() -> None:
    arm = kinseek.load("planar2")  # Its tool always points along z.
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.from_rotvec([0.5, 0.0, 0.0]).as_matrix(), [0.3, 0.2, 0.0]
    solution = arm.ik(Goal.pose(T, free="rz", cone=0.2))
    assert not solution.success
    assert solution.orientation_error == pytest.approx(0.3, abs=1e-6)
    assert arm.ik(Goal.pose(T, free="rz", cone=0.5 + 1e-6)).success


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"free": "rz", "cone": -0.1}, "cone, an angle in rad, must be a number from 0 to 3.14159, got -0.1"),
        ({"free": "rz", "cone": math.nan}, "got nan"),
        ({"free": "rz", "cone": 10}, "from 0 to 3.14159, got 10"),
        ({"free": "rz", "cone": "wide"}, "got 'wide'"),
        ({"cone": 0.1}, "a cone of 0.1 rad is about one axis of the tool"),
        ({"free": ("rx", "rz"), "cone": 0.1}, "leave exactly that rotation free"),
        ({"free": "rz", "box": {"rx": (-0.1, 0.1)}, "cone": 0.1}, "no range about the other two"),
        ({"free": "yaw", "cone": 0.1}, "unknown axis 'yaw': kinseek calls it 'rz'"),
        ({"free": "z", "cone": 0.1}, "leave exactly that rotation free, as in free='rz' or --free rz"),
    ],
)
def test_what_is_no_cone_is_refused(options: dict[str, Any], words: str) -> None:
    with pytest.raises(InvalidGoal) as caught:
        Goal.pose(np.eye(4), **options)
    assert words in str(caught.value)


TOOL = kinseek.pose([0.02, -0.01, 0.1], rpy=[0.3, -0.2, 1.0])


@pytest.mark.parametrize("tool", [None, TOOL], ids=["tip", "tool"])
@pytest.mark.parametrize("frame", ["tool", "base"])
@pytest.mark.parametrize("name", ["iiwa14", "puma560", "so101", "gen3"])
def test_one_goal_and_a_batch_give_the_same_bits(
    name: str, frame: Literal["tool", "base"], tool: Array | None
) -> None:
    arm = kinseek.load(name)
    wanted = tilted(plain_fk(arm.chain, random_joints(arm.chain, 64, seed=6)), 0.5, 7)
    wanted = wanted if tool is None else wanted @ tool
    goal = Goal.pose(wanted, free="rz", cone=0.5, frame=frame, tool=tool)
    together = arm.ik(goal, threads=2)
    for i in range(64):
        one = arm.ik(goal.at(goal.target[i]))
        np.testing.assert_array_equal(one.q, together.q[i])
        for name in ("position_error", "orientation_error", "weighted_error", "evaluations"):
            assert getattr(one, name) == getattr(together, name)[i]


@pytest.mark.parametrize("cone", [0.17, 1.0])
@pytest.mark.parametrize("name", ["so101", "m430ia2f", "scara4", "puma560", "ur5e", "panda"])
def test_few_goals_need_the_search_over_the_ranges(
    name: str, cone: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    searched = []

    def count(*given: Any) -> None:
        searched.append(len(given[2]))
        solve_ranged(*given)

    monkeypatch.setattr(ranges, "solve_ranged", count)
    arm = kinseek.load(name)
    wanted = tilted(plain_fk(arm.chain, random_joints(arm.chain, 300, seed=8)), cone, seed=9)
    assert arm.ik(Goal.pose(wanted, free="rz", cone=cone)).success.all()
    assert sum(searched) <= 30
    searched.clear()
    for T in wanted[:50]:
        assert arm.ik(Goal.pose(T, free="rz", cone=cone)).success
        assert arm.ik(Goal.pointing(T[:3, 3], T[:3, 2], cone=cone)).success
    assert sum(searched) <= 10


@pytest.mark.parametrize("along", [0.0, 0.1])
def test_a_last_joint_about_the_axis_does_not_limit_the_closed_form(along: float) -> None:
    arm, tool = (
        kinseek.load("puma560"),
        kinseek.pose([0.0, 0.0, along]),
    )  # Its last joint turns by 180 degrees.
    wanted = tilted(plain_fk(arm.chain, random_joints(arm.chain, 300, seed=14)) @ tool, 0.1, seed=15)
    goal = Goal.pose(wanted, free="rz", cone=0.2, tool=tool)
    solution = arm.ik(goal)
    assert ((solution.q >= arm.lower) & (solution.q <= arm.upper)).all()
    assert solution.success.all()
    assert (solution.evaluations == 1).mean() >= 0.9
    aside = arm.ik(Goal.pose(wanted, free="rx", cone=0.2, tool=tool))
    assert (aside.evaluations == 1).mean() <= 0.1
    for i in range(20):
        np.testing.assert_array_equal(arm.ik(goal.at(wanted[i])).q, solution.q[i])


@pytest.mark.parametrize("name", ["so101", "puma560", "ur5e"])
def test_a_direction_in_reach_is_met_itself(name: str) -> None:
    arm = kinseek.load(name)
    T = plain_fk(arm.chain, random_joints(arm.chain, 200, seed=10))
    reached = plain_fk(arm.chain, arm.ik(Goal.pose(T, free="rz", cone=0.5)).q)
    away = between(reached[:, :3, 2], T[:, :3, 2])
    assert (away <= TOLERANCE + ROUNDING).mean() >= 0.9


@pytest.mark.parametrize("name", ["gen3", "ur5e", "irb120"])
def test_joints_are_not_turned_more_than_they_need(name: str) -> None:
    arm = kinseek.load(name)
    wanted = tilted(plain_fk(arm.chain, random_joints(arm.chain, 2000, seed=11)), 2.0, seed=12)
    solution = arm.ik(Goal.pose(wanted, free="rz", cone=2.0))
    whole = arm.upper - arm.lower >= 2.0 * math.pi - 1e-9
    away = np.abs(solution.q - (arm.lower + arm.upper) / 2)[:, whole]
    assert solution.success.all()
    assert away.max() <= math.pi + ROUNDING


@pytest.mark.parametrize("axis", [(0.0, 1.0, 0.0), (1.0, 2.0, -0.5)])
@pytest.mark.parametrize("name", ["ur5e", "so101"])
def test_any_axis_of_the_tool_may_point_within_a_cone(name: str, axis: tuple[float, float, float]) -> None:
    arm, own = kinseek.load(name), np.array(axis) / np.linalg.norm(axis)
    for T in plain_fk(arm.chain, random_joints(arm.chain, 40, seed=13)):
        solution = arm.ik(Goal.pointing(T[:3, 3], T[:3, :3] @ own, axis, cone=0.3))
        reached = plain_fk(arm.chain, solution.q[None])[0]
        assert solution.success
        assert np.linalg.norm(reached[:3, 3] - T[:3, 3]) <= TOLERANCE + ROUNDING
        assert between(reached[:3, :3] @ own, T[:3, :3] @ own) <= 0.3 + TOLERANCE + ROUNDING


def test_the_goal_shows_its_cone() -> None:
    assert "within 0.17 rad" in repr(Goal.pose(np.eye(4), free="rz", cone=0.17))
