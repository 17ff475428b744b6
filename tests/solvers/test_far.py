"""Goals farther away than the arm is long: nobody looks for an answer, and the nearest pose is found at once."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import minimize

import kinseek
from kinseek import Goal
from kinseek.kernels.atlas.far import BEYOND, MOST
from kinseek.problem import Problem
from kinseek.robots.geometry import span_of
from kinseek.solution import judge

TOOL = kinseek.pose([0.05, -0.1, 0.2], rpy=[0.3, 1.0, -0.4])


def ends(arm: kinseek.Arm) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    return np.where(np.isfinite(arm.lower), arm.lower, -np.pi), np.where(
        np.isfinite(arm.upper), arm.upper, np.pi
    )


def far_poses(arm: kinseek.Arm, count: int, seed: int = 0) -> NDArray[np.float64]:
    """One and a half times as far off as all links in a row."""
    rng = np.random.default_rng(seed)
    poses = arm.fk(rng.uniform(*ends(arm), (count, arm.dof)))
    ways = rng.normal(size=(count, 3))
    poses[:, :3, 3] = 1.5 * arm.chain.reach * ways / np.linalg.norm(ways, axis=1)[:, None]
    return poses


@pytest.mark.parametrize("tool", [None, TOOL], ids=["tip", "tool"])
@pytest.mark.parametrize(
    "name", ["planar2", "cylindrical3", "ur5e", "panda", "ur10e_rail", "m430ia2f", "gen3"]
)
def test_no_pose_spans_more_than_the_span(name: str, tool: Any) -> None:
    arm, rng = kinseek.load(name), np.random.default_rng(1)
    arm = arm if tool is None else arm.with_tool(tool)
    low, high = ends(arm)
    q = rng.uniform(low, high, (4000, arm.dof))
    which = rng.random(q.shape)
    q = np.where(
        which < 0.2, low, np.where(which > 0.8, high, np.where(which > 0.6, np.clip(0, low, high), q))
    )
    T = arm.fk(q)
    for whole in (True, False):
        span, shoulder, hand = np.split(span_of(arm.chain.arrays, whole), [1, 4])
        gaps = np.linalg.norm(T[:, :3, :3] @ hand + T[:, :3, 3] - shoulder, axis=1)
        assert gaps.max() <= span[0] * (1 + 1e-12) + 1e-12
        # The bound is one that is nearly met, but where limits forbid it.
        assert gaps.max() >= 0.65 * span[0]
        if not whole:
            assert not hand.any()


def test_the_span_of_two_links_is_their_length() -> None:
    span = span_of(kinseek.load("planar2").chain.arrays, False)
    np.testing.assert_allclose(span, [0.75, 0, 0, 0, 0, 0, 0], atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ur5e", "panda", "kr6r900", "scara4"])
def test_nothing_found_by_other_means_is_nearer(name: str) -> None:
    arm, rng = kinseek.load(name), np.random.default_rng(2)
    low, high = ends(arm)
    for T in far_poses(arm, 2):
        for goal in (Goal.pose(T), Goal.position(T[:3, 3]), Goal.pointing(T[:3, 3], T[:3, 2])):
            # A row for joint values, and one for each of their neighbours.
            rows = Problem(arm.chain, goal.at(np.repeat(goal.target[None], arm.dof + 1, axis=0)))
            solution = arm.ik(goal)
            assert not solution.success
            assert ((arm.lower <= solution.q) & (solution.q <= arm.upper)).all()

            def error(q: NDArray[np.float64], rows: Problem = rows) -> tuple[float, NDArray[np.float64]]:
                """The error, and its difference quotients."""
                beside = q + 1e-8 * np.vstack([np.zeros(len(q)), np.eye(len(q))])
                found = judge(rows, beside)[:, 2]
                return found[0], (found[1:] - found[0]) / 1e-8

            starts = [solution.q, *rng.uniform(low, high, (2, arm.dof))]
            bounds = list(zip(low, high, strict=True))
            others = [
                minimize(error, start, method="L-BFGS-B", jac=True, bounds=bounds).fun for start in starts
            ]
            assert solution.weighted_error <= min(others) * (1 + 1e-6)


@pytest.mark.parametrize("name", ["ur5e", "panda", "scara4"])
def test_every_way_gives_the_same_bits_with_little_work(name: str) -> None:
    arm = kinseek.load(name)
    poses = far_poses(arm, 6)
    first = [arm.ik(T).q for T in poses]  # The very first goes another way: kernels are lacking yet.
    for threads in (1, 2):
        batch = arm.ik(poses, threads=threads)
        assert np.array_equal(batch.q, first)
        assert (batch.evaluations <= MOST).all()
    near = np.clip(0.3, *ends(arm))
    for T, q in zip(poses, first, strict=True):
        assert np.array_equal(arm.ik(T).q, q)
        assert np.array_equal(arm.ik(Goal.pose(T)).q, q)
        traced = arm.ik(T, trace=True)
        assert np.array_equal(traced.q, q)
        assert [each.name for each in traced.trace] == ["nearest pose"]
        assert "farther away than the arm is long" in " ".join(traced.trace.notes)
        beside = arm.ik(T, near=near)
        assert beside.weighted_error == pytest.approx(arm.ik(T).weighted_error, rel=1e-9)


def test_wide_tolerances_reach_beyond_the_span() -> None:
    arm = kinseek.load("ur5e")
    span, *rest = span_of(arm.chain.arrays, True)
    place = np.array([rest[0] + 1.3 * BEYOND * span, rest[1], rest[2]])
    wide = Goal.pose(kinseek.pose(place), position_tolerance=span, orientation_tolerance=1.0)
    assert arm.ik(wide).success
    assert not arm.ik(kinseek.pose(place)).success


@pytest.mark.parametrize("name", ["ur5e", "panda", "so101"])
def test_goals_are_reached_alike_without_a_search_for_the_nearest_pose(name: str) -> None:
    arm, rng = kinseek.load(name), np.random.default_rng(5)
    poses = arm.fk(rng.uniform(*ends(arm), (60, arm.dof)))
    poses[:30, :3, 3] *= rng.uniform(0.9, 1.3, (30, 1))
    reached = 0
    for goal in (poses, Goal.position(poses[:, :3, 3]), Goal.pose(poses, free="rz")):
        usual, brief = arm.ik(goal), arm.ik(goal, nearest=False)
        assert np.array_equal(brief.success, usual.success)
        assert np.array_equal(brief.q[brief.success], usual.q[usual.success])
        assert ((arm.lower <= brief.q) & (brief.q <= arm.upper)).all()
        assert (usual.weighted_error <= brief.weighted_error * (1 + 1e-9)).all()
        assert (brief.evaluations <= usual.evaluations).all()
        reached += int(usual.success.sum())
    assert 0 < reached < 3 * len(poses)


@pytest.mark.parametrize("name", ["ur5e", "panda", "scara4"])
def test_a_far_goal_takes_no_evaluations_without_a_search_for_the_nearest_pose(name: str) -> None:
    arm = kinseek.load(name)
    poses, near = far_poses(arm, 3), np.clip(0.3, *ends(arm))
    batch = arm.ik(poses, nearest=False)
    for T, q in zip(poses, batch.q, strict=True):
        for one in (arm.ik(T, nearest=False), arm.ik(T, near=near, nearest=False)):
            assert not one.success
            assert one.evaluations == 0
            assert np.array_equal(one.q, q)
            assert not one.problem.nearest
            np.testing.assert_allclose(one.position_error, np.linalg.norm(arm.fk(q)[:3, 3] - T[:3, 3]))
    traced = arm.ik(poses[0], nearest=False, trace=True)
    assert traced.evaluations == 0
    assert [each.name for each in traced.trace] == ["no search"]
    assert traced.trace.notes[-1].endswith("nothing was searched.")
    with pytest.raises(kinseek.NotReached, match=r"^the pose found is .* m and .* rad away"):
        traced.require()


def test_joint_values_as_nearest_are_refused() -> None:
    arm = kinseek.load("planar2")
    for wrong in (np.zeros(2), "no", 1):
        with pytest.raises(kinseek.errors.InvalidProblem, match=r"nearest must be True or False.*near="):
            arm.ik(np.eye(4), nearest=wrong)  # type: ignore[call-overload]
