"""`Arm.follow` over poses that are missed: no breaks of their own, no joint wound up, and no long search for them."""

from __future__ import annotations

import itertools
import time
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import kinseek
from kinseek import Goal, PathStatus
from kinseek.paths.bridge import SHARE
from kinseek.robots.joints import Joint, serial_chain
from kinseek.support.transforms import transform

Array = NDArray[np.float64]


def line(begin: list[float], end: list[float], count: int) -> Array:
    """Poses of one orientation on a straight line."""
    return np.array([kinseek.pose(row, rpy=[np.pi, 0, 0]) for row in np.linspace(begin, end, count)])


def snake() -> kinseek.Arm:
    """Eleven joints by turns about z and y; four of them turn without end."""
    z, y, joints = np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0]), []
    for i in range(11):
        place = transform(np.eye(3), np.array([0.0, 0.0, 0.12 if i else 0.0]))
        kind = "continuous" if i % 3 == 0 else "revolute"
        joints.append(Joint(f"j{i}", kind, place, y if i % 2 else z, -2.5, 2.5))
    end = transform(np.eye(3), np.array([0.0, 0.0, 0.1]))
    return kinseek.Arm(serial_chain(joints, end, name="snake", base="base", tip="tip"))


def outward(count: int) -> Array:
    """Poses of which a UR10e does not reach the last 28 of 100."""
    return line([0.6, 0.2, 0.4], [1.5, 0.2, 0.4], count)


def seconds(arm: kinseek.Arm, goal: Any, **options: Any) -> tuple[Any, float]:
    """A path, and the processor time that it took; what the arm needs once is made before."""
    first = goal.at(goal.target[:3]) if isinstance(goal, Goal) else goal[:3]
    arm.follow(first, threads=1, **options)
    begun = time.process_time()
    return arm.follow(goal, threads=1, **options), time.process_time() - begun


@pytest.mark.slow
def test_poses_out_of_reach_take_no_longer_with_a_free_axis_than_without() -> None:
    arm, T = kinseek.load("ur10e"), outward(400)
    plain, base = seconds(arm, T)
    free, took = seconds(arm, Goal.pose(T, free="rz"))
    assert (free.reached == plain.reached).all()
    assert (~free.reached).sum() == 111
    # A hundred times as long before; what both take varies with what else the machine does.
    assert took < 8 * base + 0.5


@pytest.mark.slow
def test_poses_that_are_blocked_are_not_planned_again_and_again() -> None:
    pytest.importorskip("pinocchio")
    arm, T = kinseek.load("ur10e"), outward(300)
    scene = kinseek.Scene.of(arm, capsules=0.05)
    scene.add_box("crate", (0.1, 0.3, 0.5), kinseek.pose([0.95, 0.2, 0.3]))
    goal = Goal.pose(T, free="rz")
    path, took = seconds(arm, goal, scene=scene)
    assert took < 4.0
    assert path.status is PathStatus.UNREACHABLE
    assert not len(path.breaks)
    assert scene.free(path.q[path.reached]).all()
    blocked, far = path.why
    assert "are blocked" in blocked
    assert "crate" in blocked
    assert "out of reach" in far
    # A missed pose has no answer that is free among those that a search finds.
    for i in np.flatnonzero(~path.reached)[::40]:
        found: Any = arm.branches(goal.at(T[i]), count=50)
        assert not scene.free(found.q).any() if len(found) else True


@pytest.mark.slow
@pytest.mark.parametrize("name", ["snake", "panda", "ur10e", "ur10e, rz"])
def test_no_joint_winds_up_over_missed_poses(name: str) -> None:
    arm = snake() if name == "snake" else kinseek.load(name.split(",")[0])
    T = line([0.4, 0.1, 0.4], [1.6, 0.1, 0.4], 200)
    goal: Any = Goal.pose(T, free="rz") if name.endswith("rz") else T
    path, took = seconds(arm, goal)
    assert took < 4.0
    assert path.status is PathStatus.UNREACHABLE
    assert not len(path.breaks)
    assert len(path.missed) == 1
    # It goes on from where it stands: no jump to another branch, and no turn of a joint.
    steps = np.abs(np.diff(path.q, axis=0))
    assert steps.max() < 0.4
    assert np.ptp(path.q, axis=0).max() < np.pi
    # With the hand at the nearest pose by itself, up to a part of what that misses, a radian counting as a metre.
    nearest = arm.ik(goal)
    far = ~path.reached
    weighted = path.problem.goal.measure(path.problem.arrays, path.q)[:, 2]
    missed = np.asarray(nearest.position_error) + np.asarray(nearest.orientation_error)
    assert (weighted <= 1.05 * np.asarray(nearest.weighted_error) + SHARE * missed + 1e-6)[far].all()


def test_breaks_stand_between_reached_poses_alone() -> None:
    arm = kinseek.load("ur5e")
    there, back = line([0.4, -0.3, 0.3], [0.4, 0.3, 0.3], 40), line([-0.4, 0.3, 0.5], [-0.4, -0.3, 0.5], 40)
    T = np.concatenate([there, back])
    T[60:65, 0, 3] -= 5.0
    path = arm.follow(T)
    assert path.breaks.tolist() == [39]
    assert path.missed == ((60, 64),)
    assert path.reached[:60].all()
    assert path.reached[65:].all()
    assert [why.split()[0] for why in path.why] == ["between", "poses"]
    assert np.isnan(path.steps[[39, *range(59, 65)]]).all()
    assert not np.isnan(np.delete(path.steps, [39, *range(59, 65)], axis=0)).any()
    assert path.largest_step.max() <= 0.3
    assert "1 break, 5 missed," in repr(path)
    T[70, 2, 3] += 5.0
    assert "6 missed in 2 runs" in repr(arm.follow(T))


@pytest.mark.parametrize("name", ["ur5e", "panda"])
def test_a_run_of_missed_poses_in_the_middle_is_passed_on_one_branch(name: str) -> None:
    arm = kinseek.load(name)
    T = line([0.4, -0.3, 0.4], [0.4, 0.3, 0.4], 60)
    T[25:30, 2, 3] += 2.0
    start = arm.ik(T[0]).require().q
    path = arm.follow(T, start=start)
    assert path.missed == ((25, 29),)
    assert not len(path.breaks)
    assert (path.q[0] == start).all()
    assert ((path.q >= arm.lower) & (path.q <= arm.upper)).all()
    end = path.q[-1]
    again = arm.follow(T, end=end)
    assert (again.q[-1] == end).all()
    assert again.missed == path.missed


@pytest.mark.parametrize("name", ["ur5e", "panda"])
def test_missed_poses_at_the_beginning_and_all_poses_missed(name: str) -> None:
    arm = kinseek.load(name)
    T = line([0.4, -0.3, 0.4], [0.4, 0.3, 0.4], 30)
    T[:6, 0, 3] += 3.0
    path = arm.follow(T)
    assert path.missed == ((0, 5),)
    assert not len(path.breaks)
    T[:, 0, 3] += 3.0
    path = arm.follow(T)
    assert path.missed == ((0, 29),)
    assert not len(path.breaks)
    assert np.isnan(path.steps).all()
    assert path.length == 0.0
    assert ((path.q >= arm.lower) & (path.q <= arm.upper)).all()


@pytest.mark.parametrize("name", ["ur5e", "panda"])
def test_a_stream_goes_on_over_missed_poses_from_piece_to_piece(name: str) -> None:
    arm = kinseek.load(name)
    T = line([0.4, -0.3, 0.4], [0.4, 0.3, 0.4], 90)
    T[25:40, 2, 3] += 2.0
    pieces = list(arm.follow_stream(iter(T), window=30, look_ahead=10))
    assert [piece.missed for piece in pieces] == [((25, 30),), ((0, 9),), ()]
    q = np.concatenate([pieces[0].q, *[piece.q[1:] for piece in pieces[1:]]])
    for one, other in itertools.pairwise(pieces):
        assert (one.q[-1] == other.q[0]).all()
    away = np.abs(np.diff(q, axis=0)).max(axis=1)
    assert np.delete(away, [24, 39]).max() < 0.3


@pytest.mark.parametrize("name", ["ur5e", "panda"])
def test_a_closed_path_with_missed_poses_comes_back(name: str) -> None:
    arm, s = kinseek.load(name), np.linspace(0, 2 * np.pi, 80, endpoint=False)
    T = np.array([kinseek.pose([0.4, 0.1 * np.cos(a), 0.4 + 0.1 * np.sin(a)], rpy=[np.pi, 0, 0]) for a in s])
    T[30:35, 0, 3] += 3.0
    path = arm.follow(T, closed=True)
    assert path.missed == ((30, 34),)
    assert not len(path.breaks)
    assert np.abs(path.q[-1] - path.q[0]).max() < 0.3


@pytest.mark.slow
@pytest.mark.parametrize("approximately", [False, True])
@pytest.mark.parametrize("free", [False, True])
@pytest.mark.parametrize("name", ["ur5e", "panda", "gen3"])
def test_a_closed_path_with_its_first_pose_again_comes_back_to_the_bit(
    name: str, free: bool, approximately: bool
) -> None:
    arm, s = kinseek.load(name), np.linspace(0, 2 * np.pi, 61)
    T = np.array([kinseek.pose([0.4, 0.1 * np.cos(a), 0.4 + 0.1 * np.sin(a)], rpy=[np.pi, 0, 0]) for a in s])
    goal = Goal.pose(T, free="rz") if free else Goal.pose(T)
    endless = np.array(arm.kinds) == "continuous"
    start = arm.ik(goal.at(T[0])).require().q
    if approximately:
        start = np.clip(
            start + 3e-7, np.where(endless, -np.inf, arm.lower), np.where(endless, np.inf, arm.upper)
        )
        off = kinseek.Problem(arm.mechanism, goal.at(T[0]))
        position, orientation = off.goal.measure(off.arrays, start[None])[0, :2]
        assert 1e-9 < max(position, orientation) < 1e-6
    given = start.copy()
    wishes: tuple[dict[str, Any], ...] = ({"start": start}, {})
    for options in wishes:
        path: Any = arm.follow(goal, closed=True, **options).require()
        turns = np.where(endless, 2 * np.pi * np.round((path.q[-1] - path.q[0]) / (2 * np.pi)), 0.0)
        assert (path.q[-1] == path.q[0] + turns).all()
        assert np.nanmax(np.abs(path.steps[-1])) < 1e-12
        if options:
            assert (path.q[0] == given).all()
            assert (start == given).all()


def test_a_closed_path_that_cannot_come_back_says_so() -> None:
    """The elbow has to be up at the beginning and down at the end."""
    two = kinseek.Arm.from_dh([(0.3, 0, 0, 0), (0.2, 0, 0, 0)], [-1, -2], [1, 2], name="two links")
    angles = np.concatenate([np.linspace(-1.3, 1.3, 60), np.linspace(1.3, -1.3, 60)])
    places = Goal.position(0.4 * np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1))
    path = two.follow(places, closed=True, max_step=0.2)
    assert path.status is PathStatus.BROKEN
    turned = places.at(places.target[:60])
    path = two.follow(
        turned.at(np.concatenate([turned.target, turned.target[:1]])), closed=True, max_step=0.1
    )
    assert path.status is PathStatus.BROKEN
    closes = (path.q[-1] == path.q[0]).all()
    assert closes or path.breaks[-1] == len(path) - 1
