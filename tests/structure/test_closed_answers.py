"""`arm.ik` where geometry gives the answers: which one comes, that it is true, and what happens where geometry ends."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import kinseek
from benchmarks.branches import eaik
from benchmarks.targets import plain_fk, random_joints, singular_joints, strict
from kinseek.branches.find import full_turn_copies
from test_structure import LATE_THREE, SHOULDER, UR, changed, dh

Array = NDArray[np.float64]

CLOSED = ("ur5e", "ur10e", "puma560", "irb120", "kr6r900")


def steps(arm: kinseek.Arm, q: Array, near: Array) -> Array:
    """Distances of joint values, (k, n), from others, the short way round where a joint has no limits."""
    gap = q - near
    gap = np.where(arm.chain.endless, (gap + np.pi) % (2 * np.pi) - np.pi, gap)
    return np.asarray(np.linalg.norm(gap, axis=-1))


def assert_inside(arm: kinseek.Arm, solution: kinseek.Solution) -> None:
    assert (solution.q >= arm.lower).all()
    assert (solution.q <= arm.upper).all()


@pytest.mark.parametrize("name", [*CLOSED, "elbow6"])
def test_the_answer_is_the_first_of_all_branches_and_no_search_is_made(name: str) -> None:
    arm = kinseek.load(name)
    q = random_joints(arm.chain, 300, 1)
    targets = plain_fk(arm.chain, q)
    batch, found = arm.ik(targets), arm.branches(targets)
    assert isinstance(found, kinseek.BranchesBatch)
    first = [each.q[0] for each in found]
    assert strict(arm.chain, batch.q, targets).all()
    assert_inside(arm, batch)
    assert np.median(batch.evaluations) == 1
    apart = np.abs(batch.q - first).max(axis=1)
    assert np.mean(apart < 1e-6) > 0.98  # Beside a singularity two answers may be as near.
    for target, row in zip(targets[:100], batch.q, strict=False):
        np.testing.assert_array_equal(arm.ik(target).q, row)


@pytest.mark.slow
@pytest.mark.parametrize("name", CLOSED)
def test_near_is_the_nearest_of_all_that_another_closed_form_has(name: str) -> None:
    pytest.importorskip("eaik")
    arm = kinseek.load(name)
    q = random_joints(arm.chain, 200, 2)
    near = random_joints(arm.chain, 200, 3)
    targets, solve = plain_fk(arm.chain, q), eaik(arm)
    found = arm.ik(targets, near=near)
    assert strict(arm.chain, found.q, targets).all()
    assert_inside(arm, found)
    theirs = [full_turn_copies(arm.chain, solve(target)) for target in targets]
    least = [
        steps(arm, all_of_one, start).min()
        for all_of_one, start in zip(theirs, near, strict=True)
        if len(all_of_one)
    ]
    ours = steps(arm, found.q, near)[[len(each) > 0 for each in theirs]]
    assert (ours <= np.array(least) + 1e-4).all()
    for target, start, row in zip(targets[:50], near, found.q, strict=False):
        np.testing.assert_array_equal(arm.ik(target, near=start).q, row)


@pytest.mark.parametrize("name", [*CLOSED, "ur10e_calibrated"])
def test_a_small_step_away_near_stays_on_its_branch(name: str) -> None:
    arm = kinseek.load(name)
    q = random_joints(arm.chain, 300, 4)
    room = np.minimum(q - arm.lower, arm.upper - q).min(axis=1) > 0.01
    near = q + np.random.default_rng(1).uniform(-5e-3, 5e-3, q.shape)
    found = arm.ik(plain_fk(arm.chain, q), near=near)
    assert found.success.all()
    assert_inside(arm, found)
    assert (steps(arm, found.q, near) <= steps(arm, q, near) + 1e-4)[room].all()


def test_where_the_arm_is_is_the_nearest_at_a_straight_wrist_too() -> None:
    arm = kinseek.load("puma560")
    q = np.array([0.4, -0.6, 0.3, 1.1, 0.0, -0.7])  # Only the sum of joints 4 and 6 is decided.
    found = arm.ik(arm.fk(q), near=q)
    assert found.success
    np.testing.assert_allclose(found.q, q, atol=1e-6)


@pytest.mark.parametrize("rows", [SHOULDER, LATE_THREE], ids=["shoulder", "three"])
def test_an_arm_that_is_taken_backwards_is_answered_as_well(rows: Any) -> None:
    arm = dh(rows, base=kinseek.pose([0.2, 0.1, 0.5], rpy=[0.1, -0.2, 0.3]))
    q = random_joints(arm.chain, 200, 6)
    targets = plain_fk(arm.chain, q)
    found = arm.ik(targets)
    assert strict(arm.chain, found.q, targets).all()
    assert np.median(found.evaluations) == 1
    back = arm.ik(targets, near=q)
    assert (steps(arm, back.q, q) < 1e-3).mean() > 0.98


def test_a_tool_of_the_goal_moves_the_tip() -> None:
    for name in ("irb120", "ur5e"):
        arm = kinseek.load(name)
        tool, q = kinseek.pose([0.1, 0.0, 0.2], rpy=[0.2, 0.1, -0.4]), random_joints(arm.chain, 50, 9)
        goal = kinseek.Goal.pose(arm.fk(q) @ tool, tool=tool)
        found = arm.ik(goal)
        assert found.success.all()
        assert np.median(found.evaluations) == 1
        np.testing.assert_allclose(arm.fk(found.q) @ tool, goal.target, atol=3e-6)
        same = arm.with_tool(tool).ik(goal.target)
        np.testing.assert_allclose(same.q, found.q, atol=1e-6)


@pytest.mark.parametrize("by", [0.0, 3e-7, 1e-5, 1e-3, 0.02])
def test_off_its_structure_an_arm_is_answered_as_truly(by: float) -> None:
    arm = dh(changed(UR, 2, 1, by))
    targets = plain_fk(arm.chain, random_joints(arm.chain, 200, 7))
    batch = arm.ik(targets)
    assert strict(arm.chain, batch.q, targets).all()
    for target, row in zip(targets[:50], batch.q, strict=False):
        np.testing.assert_array_equal(arm.ik(target).q, row)


def test_limits_that_hold_no_branch_are_kept() -> None:
    arm = kinseek.load("ur5e")
    target = arm.fk([0.3, -1.2, 1.4, -0.8, 1.1, 0.2])
    narrow = arm.with_limits(dict.fromkeys(arm.joint_names, (2.0, 2.1)))
    for near in (None, np.zeros(6)):
        found = narrow.ik(target, near=near)
        assert found.status is kinseek.Status.BEST_EFFORT
        assert_inside(narrow, found)


def test_an_answer_at_a_limit_is_kept_and_not_passed() -> None:
    arm, q = kinseek.load("ur5e"), np.array([0.3, -1.2, 1.4, -0.8, 1.1, 0.2])
    for side in ((1.4, 1.5), (1.3, 1.4)):
        pinned = arm.with_limits({"elbow_joint": side})
        found = pinned.ik(arm.fk(q), near=q)
        assert found.success
        assert_inside(pinned, found)
        np.testing.assert_allclose(found.q, q, atol=1e-5)


@pytest.mark.parametrize(
    "rows",
    [
        changed(UR, 2, 0, 0.3922),  # Axes 3 and 4 are one.
        changed(UR, 1, 0, 0.425),  # Axes 2 and 3 are one.
        [(0, HALF, 0.3, 0) for HALF in (np.pi / 2, -np.pi / 2) * 3],  # Of no length at all.
    ],
    ids=["axes 3 and 4", "axes 2 and 3", "no length"],
)
def test_links_of_no_length_and_axes_that_coincide_are_searched(rows: Any) -> None:
    arm = dh(rows)
    targets = arm.fk(random_joints(arm.chain, 20, 8))
    found = arm.ik(targets)
    assert found.success.all()
    assert_inside(arm, found)


def test_wide_tolerances_do_not_lead_farther_from_where_the_arm_is() -> None:
    arm, q = kinseek.load("ur5e"), np.array([0.3, -1.2, 1.4, -0.8, 1.1, 0.2])
    goal = kinseek.Goal.pose(arm.fk(q), position_tolerance=0.02, orientation_tolerance=0.05)
    near = q + 0.01
    found = arm.ik(goal, near=near)
    assert found.success
    assert steps(arm, found.q, near) <= steps(arm, q, near) + 1e-9


def test_a_trace_says_that_geometry_gave_the_answer() -> None:
    for name in ("puma560", "ur10e_calibrated"):
        arm = kinseek.load(name)
        target = arm.fk([0.3, -0.6, 0.4, -0.8, 0.7, 0.2])
        plain, traced = arm.ik(target), arm.ik(target, trace=True)
        np.testing.assert_array_equal(plain.q, traced.q)
        assert [each.name for each in traced.trace] == ["closed form"]
        assert plain.evaluations == traced.evaluations == traced.trace[0].evaluations
    far = kinseek.load("ur5e").ik(kinseek.pose([0.95, 0.0, 0.2]), trace=True)
    assert far.status is kinseek.Status.BEST_EFFORT
    assert "look-up" in [each.name for each in far.trace]


def test_joints_without_end_come_within_half_a_turn_of_where_the_arm_is() -> None:
    arm = dh(UR, np.full(6, np.inf))
    q = random_joints(arm.chain, 200, 10)
    targets = plain_fk(arm.chain, q)
    around = q + 2 * np.pi * np.random.default_rng(2).integers(-3, 4, q.shape)
    found = arm.ik(targets, near=around)
    assert strict(arm.chain, found.q, targets, slack=np.inf).all()
    assert (np.abs(found.q - around) <= np.pi + 1e-9).all()
    assert np.mean(np.abs(found.q - around).max(axis=1) < 1e-3) > 0.98
    alone = arm.ik(targets)
    assert strict(arm.chain, alone.q, targets).all()
    assert (np.abs(alone.q) <= np.pi + 1e-9).all()


@pytest.mark.slow
@pytest.mark.parametrize("name", [*CLOSED, "piper", "lite6", "ur10e_calibrated"])
def test_where_the_arm_is_is_the_nearest_at_singularities_and_limits_too(name: str) -> None:
    arm = kinseek.load(name)
    q = singular_joints(arm.chain, 300, 1)
    found = arm.ik(plain_fk(arm.chain, q), near=q)
    assert found.success.all()
    np.testing.assert_allclose(found.q, q, atol=1e-3)


@pytest.mark.parametrize("name", ["piper", "ur10e_calibrated", "gen3"])
def test_candidates_of_a_nearby_arm_are_refined_to_the_same_bits_alone_and_in_a_batch(name: str) -> None:
    arm = kinseek.load(name)
    targets = plain_fk(
        arm.chain, np.vstack([random_joints(arm.chain, 300, 12), singular_joints(arm.chain, 200, 13)])
    )
    found = arm.ik(targets)
    assert found.success.all()
    assert np.median(found.evaluations) <= 3
    for target, q in zip(targets, found.q, strict=True):
        np.testing.assert_array_equal(arm.ik(target).q, q)
