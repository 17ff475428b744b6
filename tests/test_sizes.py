"""Numbers at the ends of what is taken: rounding decides where they lie, and beyond them there is a clear error."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import kinseek
from kinseek import Goal
from kinseek.errors import InvalidGoal, InvalidProblem, InvalidRobot
from kinseek.kernels.arm.pose_error import LARGEST, ROUNDING, judge_poses
from kinseek.kernels.arm.range_error import judge_ranges
from kinseek.poses import as_pose
from kinseek.robots.joints import Joint, serial_chain
from kinseek.support.transforms import transform
from reference import weighted_error as plain_weighted_error

Array = NDArray[np.float64]


def off_by(amount: float) -> Array:
    """A pose whose rotation misses RᵀR = 1 by this much in one entry."""
    target = kinseek.pose([0.4, 0.1, 0.5], rpy=[0.3, -0.2, 0.9])
    target[:3, 0] *= 1.0 + 0.5 * amount
    return target


# Rotations


@pytest.mark.parametrize("amount", [0.9e-14, 1.2e-14, 1.6e-14, 1.9e-14, 2.5e-14, 1e-12])
def test_a_rotation_that_is_slightly_off_is_read_the_same_alone_and_in_a_batch(amount: float) -> None:
    target, rough = off_by(amount), off_by(1e-9)
    alone = as_pose(target)
    for others in ([], [np.eye(4)], [rough], [rough, np.eye(4)]):
        np.testing.assert_array_equal(as_pose(np.array([target, *others]))[0], alone)
    assert (alone == target).all() == (amount < ROUNDING)


def test_a_rotation_that_is_slightly_off_has_the_same_bits_alone_and_in_a_batch() -> None:
    arm = kinseek.load("panda")
    targets = np.array([off_by(1.6e-14), off_by(1e-9), np.eye(4)])
    batch = arm.ik(targets)
    np.testing.assert_array_equal(batch.q[:1], arm.ik(targets[:1]).q)
    np.testing.assert_array_equal(batch.problem.goal.target[0], arm.ik(targets[0]).problem.goal.target)


# Sizes


def long_chain(links: int, length: float, turns: float = np.pi) -> Any:
    """Links of one length, each joint's axis across the one before it."""
    joints = [
        Joint(f"j{i}", "revolute", transform(np.eye(3), [length, 0, 0]), np.eye(3)[i % 3], -turns, turns)
        for i in range(links)
    ]
    return serial_chain(joints, transform(np.eye(3), [length, 0, 0]), name="long", base="b", tip="t")


def exact_tip(links: int, length: float, quarters: NDArray[np.int64]) -> list[Fraction]:
    """Position of the tip of `long_chain` where every joint stands at a rational rotation, without rounding.

    A joint stands at 2 atan(k/7): sine and cosine are rational.
    """
    rotation = [[Fraction(int(r == c)) for c in range(3)] for r in range(3)]
    place = [Fraction(0)] * 3
    for i in [*range(links), -1]:
        place = [p + Fraction(length) * row[0] for p, row in zip(place, rotation, strict=True)]
        if i < 0:
            return place
        t = Fraction(int(quarters[i]), 7)
        sine, cosine = 2 * t / (1 + t * t), (1 - t * t) / (1 + t * t)
        a, b = (i % 3 + 1) % 3, (i % 3 + 2) % 3
        for row in rotation:
            row[a], row[b] = row[a] * cosine + row[b] * sine, row[b] * cosine - row[a] * sine
    return place


def test_the_largest_lengths_are_computed_to_a_tenth_of_the_default_tolerance() -> None:
    def worst(length: float) -> float:
        fixed = long_chain(20, 1.0).fixed.copy()
        fixed[:, :, 3] *= length
        # Past the check, so that both sides are seen.
        arm = kinseek.Arm(replace(long_chain(20, 1.0), fixed=fixed))
        rng, apart = np.random.default_rng(1), 0.0
        for _ in range(50):
            quarters = rng.integers(-20, 21, 20)
            tip = arm.fk(2.0 * np.arctan(quarters / 7.0))[:3, 3]
            true = exact_tip(20, length, quarters)
            apart = max(apart, *(abs(float(Fraction(float(x)) - y)) for x, y in zip(tip, true, strict=True)))
        return apart

    assert worst(LARGEST) < 1e-7 < worst(10.0 * LARGEST)


def test_an_arm_of_the_largest_size_is_solved() -> None:
    arm = kinseek.Arm(long_chain(6, LARGEST / 10))
    q = np.random.default_rng(2).uniform(arm.lower, arm.upper, (100, 6))
    targets = arm.fk(q)
    targets = targets[np.abs(targets[:, :3, 3]).max(axis=1) < LARGEST]
    solution = arm.ik(Goal.pose(targets, position_tolerance=1e-4))
    assert np.isfinite(solution.q).all()
    assert ((solution.q >= arm.lower) & (solution.q <= arm.upper)).all()
    assert solution.success.mean() > 0.9


TOO_LARGE = 1.01 * LARGEST


@pytest.mark.parametrize(
    "build",
    [
        lambda: long_chain(2, TOO_LARGE),
        lambda: long_chain(2, 1e300),
        lambda: long_chain(2, 1.0, turns=TOO_LARGE),
        lambda: kinseek.Arm.from_dh([[TOO_LARGE, 0, 0, 0]], [-1], [1]),
        lambda: kinseek.Arm.from_dh([[0, 0, 0, 0]], [0], [TOO_LARGE], kinds="P"),
        lambda: kinseek.Arm.from_dh([[1, 0, 0, 0]], [-1], [1], tool=transform(np.eye(3), [TOO_LARGE, 0, 0])),
    ],
)
def test_arms_beyond_what_arithmetic_bears_are_refused(build: Any) -> None:
    with pytest.raises(InvalidRobot, match="1e\\+07"):
        build()


@pytest.mark.parametrize(
    "options",
    [
        {"position_tolerance": TOO_LARGE},
        {"position_tolerance": 1e300},
        {"orientation_tolerance": 1e300},
        {"position_weight": 1e16},
        {"position_weight": 1e-300},
        {"orientation_weight": 1e300},
        {"tool": transform(np.eye(3), [0, TOO_LARGE, 0])},
        {"box": {"x": (0.0, 1e300)}},
        {"box": {"x": (-1e300, np.inf)}},
    ],
)
def test_goals_beyond_what_arithmetic_bears_are_refused(options: Any) -> None:
    with pytest.raises(InvalidGoal, match=r"1e\+07|1e\+15"):
        Goal.pose(np.eye(4), **options)


def test_positions_and_joint_values_beyond_what_arithmetic_bears_are_refused() -> None:
    arm = kinseek.load("panda")
    far = np.eye(4)
    far[0, 3] = TOO_LARGE
    with pytest.raises(InvalidGoal, match="1e\\+07 m of the origin"):
        arm.ik(far)
    with pytest.raises(InvalidGoal, match="index 1 of the batch"):
        arm.ik(np.array([np.eye(4), far]))
    with pytest.raises(InvalidGoal, match="1e\\+07 m of the origin"):
        Goal.position([0, 0, -TOO_LARGE])
    for near in (np.full(7, TOO_LARGE), np.full(7, 1e200)):
        with pytest.raises(InvalidProblem, match="near must lie within 1e\\+07"):
            arm.ik(np.eye(4), near=near)


# Box goals


@pytest.mark.parametrize("tolerance", [1e-3, 1.0, 1e3, LARGEST])
def test_box_goals_with_a_wide_tolerance_are_answered_with_numbers(tolerance: float) -> None:
    arm = kinseek.load("ur5e")
    pose = arm.fk(np.linspace(-1, 1, 6))
    pose[0, 3] += 0.2
    for box in ({"x": (0.0, np.inf)}, {"x": (0.3, np.inf), "ry": (0.1, 0.2)}, {"z": (-0.1, 0.1)}):
        goal = Goal.pose(pose, box=box, position_tolerance=tolerance, orientation_tolerance=tolerance)
        solution = arm.ik(goal)
        assert np.isfinite(solution.q).all()
        assert ((solution.q >= arm.lower) & (solution.q <= arm.upper)).all()
        assert np.isfinite(
            [solution.position_error, solution.orientation_error, solution.weighted_error]
        ).all()


# Errors


@pytest.mark.parametrize("weight", [1e-15, 1e-6, 1.0, 1e12, 1e15])
def test_errors_are_never_negative_and_exact_close_to_the_goal(weight: float) -> None:
    arm = kinseek.load("panda")
    targets = arm.fk(np.random.default_rng(3).uniform(arm.lower, arm.upper, (300, 7)))
    goal = Goal.pose(targets, position_weight=1e-15, orientation_weight=weight)
    solution = arm.ik(goal)
    assert (solution.weighted_error >= 0.0).all()
    assert (solution.position_error >= 0.0).all()
    assert (solution.orientation_error >= 0.0).all()
    reached = arm.fk(solution.q)
    plain = [plain_weighted_error(T, goal, target) for T, target in zip(reached, targets, strict=True)]
    np.testing.assert_allclose(solution.weighted_error, plain, rtol=1e-6, atol=1e-29 * weight)
    # 1 - x·x_g + 1 - y·y_g lies between (1 - cos φ) and 2 (1 - cos φ), and 1 - cos φ is φ²/2 here.
    half = 0.5 * solution.orientation_error**2
    rest = solution.weighted_error - 1e-15 * solution.position_error
    # What is left of two nearly equal numbers is only as exact as these numbers are.
    rounding = np.spacing(solution.weighted_error)
    assert (rest <= 2.0 * half * weight * (1 + 1e-6) + 1e-29 * weight + rounding).all()
    assert (rest >= half * weight * (1 - 1e-6) - 1e-29 * weight - rounding).all()


def test_weighted_errors_of_boxes_do_not_cancel() -> None:
    arm = kinseek.load("panda")
    q = np.random.default_rng(4).uniform(arm.lower, arm.upper)
    pose = arm.fk(q)
    turn = 1e-9
    goal = Goal.pose(
        pose @ kinseek.pose([0.0, 0.0, 0.0], rotvec=[turn, 0.0, 0.0]), box=dict.fromkeys("xyz", (-0.1, 0.1))
    )
    place, found, weighted = judge_ranges(arm.chain.arrays, q[None], goal.questions, 1.0, 1e12)[0]
    assert place == 0.0
    assert found == pytest.approx(turn, rel=1e-6)
    assert weighted == pytest.approx(1e12 * found**2 / 2, rel=1e-9)
    solution = arm.ik(Goal.pose(pose, free="rz", orientation_weight=1e12))
    assert solution.weighted_error >= 0.0


def test_the_compiled_weighted_error_is_the_plain_one() -> None:
    rng = np.random.default_rng(5)
    arm = kinseek.load("ur5e")
    for _ in range(50):
        q = rng.uniform(arm.lower, arm.upper)
        T, target = arm.fk(q), arm.fk(q + rng.normal(size=6) * 10.0 ** rng.uniform(-9, 0))
        goal = Goal.pose(target)
        weighted = judge_poses(T[None], goal.targets, goal.arrays)[0, 2]
        assert weighted == pytest.approx(plain_weighted_error(T, goal), rel=1e-12, abs=0.0)
