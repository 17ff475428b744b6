"""What the geometry of an arm gives: closed forms, told and used, and no answer lost or false where they end."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import kinseek
from benchmarks.branches import apart
from benchmarks.targets import plain_fk, random_joints, strict
from kinseek.kernels.jit import exposed
from kinseek.kernels.structure.candidates import ROUNDING
from kinseek.kernels.structure.subproblems import angle, solve_trig
from kinseek.robots import catalog_names
from kinseek.structure.axes import Axes, axes_of, meeting
from kinseek.structure.structure import NEARLY
from places import ROOT

Array = NDArray[np.float64]

HALF = np.pi / 2
FULL = np.full(6, np.pi)

# a, alpha, d, theta of each joint.
SHOULDER = [
    (0, HALF, 0.3, 0),
    (0, -HALF, 0, 0),
    (0.05, HALF, 0.4, 0),
    (0.35, 0, 0.02, 0),
    (0.08, HALF, 0.1, 0),
    (0, 0, 0.1, 0),
]
LATE_THREE = [
    (0, HALF, 0.3, 0),
    (0.1, HALF, 0.05, 0),
    (0.4, 0, 0.02, 0),
    (0.3, 0, 0.1, 0),
    (0.1, HALF, 0.03, 0),
    (0, 0.3, 0.1, 0),
]
LEANING = [
    (0, HALF, 0.3, 0),
    (0.4, 0, 0, 0),
    (0.02, -HALF, 0.1, 0),
    (0, 0.9, 0.4, 0),
    (0, -0.8, 0, 0),
    (0, 0, 0.1, 0),
]
UR = [
    (0, HALF, 0.1625, 0),
    (-0.425, 0, 0, 0),
    (-0.3922, 0, 0, 0),
    (0, HALF, 0.1333, 0),
    (0, -HALF, 0.0997, 0),
    (0, 0, 0.0996, 0),
]


def dh(rows: Any, limit: Array = FULL, **options: Any) -> kinseek.Arm:
    return kinseek.Arm.from_dh(np.array(rows, dtype=float), -limit, limit, **options)


def changed(rows: Any, joint: int, column: int, by: float) -> Array:
    table = np.array(rows, dtype=float)
    table[joint, column] += by
    return table


def assert_answers(arm: kinseek.Arm, q: Array, within: float = 1e-3) -> kinseek.BranchesBatch:
    """What the targets were made of is among the answers, every answer is true, and no two are one."""
    targets = plain_fk(arm.chain, q)
    found = arm.branches(targets)
    assert isinstance(found, kinseek.BranchesBatch)
    for one, target, made_of in zip(found, targets, q, strict=True):
        assert strict(arm.chain, one.q, np.broadcast_to(target, (len(one), 4, 4))).all()
        assert len(one)
        assert apart(made_of[None], one.q).min() < within
        assert (apart(one.q, one.q) + 10 * np.eye(len(one)) > 1e-5).all()
    return found


WORDS = {
    "puma560": "spherical wrist",
    "irb120": "spherical wrist",
    "kr6r900": "spherical wrist",
    "elbow6": "spherical wrist",
    "ur5e": "three parallel axes",
    "ur10e": "three parallel axes",
    "jaco2_6": "none",
    "scara4": "none",
    "irb5400": "none",
}


@pytest.mark.parametrize(("name", "word"), WORDS.items())
def test_an_arm_says_its_structure(name: str, word: str) -> None:
    structure = kinseek.load(name).structure
    assert structure.word == word
    assert structure.exact == (word != "none")
    assert (structure.deviation <= ROUNDING) == structure.exact
    assert word in repr(structure)
    assert ("every solution is computed in closed form" in structure.sentence) == (word != "none")
    assert ("searched numerically" in structure.sentence) == (word == "none")


def test_a_function_has_none() -> None:
    arm = kinseek.Arm.from_fk(kinseek.load("ur5e").fk, -FULL, FULL)
    assert arm.structure.word == "none"
    assert "black-box kinematics" in arm.structure.sentence


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name, word in WORDS.items() if word != "none"])
def test_no_answer_is_lost_where_there_is_a_closed_form(name: str) -> None:
    arm = kinseek.load(name)
    found = assert_answers(arm, random_joints(arm.chain, 300, 8))
    assert np.median([one.evaluations for one in found]) <= 16  # It is not searched.


@pytest.mark.parametrize(
    ("rows", "word"),
    [(SHOULDER, "spherical shoulder"), (LATE_THREE, "three parallel axes")],
    ids=["shoulder", "three"],
)
def test_an_arm_is_taken_backwards_where_its_structure_is_at_the_other_end(rows: Any, word: str) -> None:
    tool = kinseek.pose([0.1, -0.05, 0.2], rpy=[0.3, 0.4, 0.5])
    arm = dh(rows, base=kinseek.pose([0.2, 0.1, 0.5], rpy=[0.1, -0.2, 0.3]), tool=tool)
    assert arm.structure.word == word
    assert arm.structure.exact
    q = random_joints(arm.chain, 200, 3)
    found = assert_answers(arm, q)
    assert np.median([one.evaluations for one in found]) <= 16
    starts = arm.ik(
        np.broadcast_to(found[0].problem.goal.target, (200, 4, 4)), near=random_joints(arm.chain, 200, 4)
    )
    assert (apart(starts.q[starts.success], found[0].q).min(axis=1) < 1e-3).all()


def test_backwards_is_the_inverse() -> None:
    axes = axes_of(dh(SHOULDER).chain.arrays)
    assert isinstance(axes, Axes)
    duplicate = axes.backwards().backwards()
    np.testing.assert_array_equal(duplicate.direction, axes.direction)
    np.testing.assert_array_equal(duplicate.point, axes.point)


def test_lines_meet_where_they_do() -> None:
    direction = np.eye(3)
    x, apart_by = meeting(direction, np.array([[5.0, 2, 3], [1, 7, 3], [1, 2, -4]]))
    np.testing.assert_allclose(x, [1, 2, 3], atol=1e-12)
    assert apart_by < 1e-12
    assert meeting(np.array([[0.0, 0, 1], [0, 0, -1]]), np.zeros((2, 3)))[1] == np.inf


# Beside two singularities at once


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ur5e", "kr6r900"])
@pytest.mark.parametrize("size", [1e-3, 1e-4, 1e-5, 1e-7, 1e-9, 0.0])
def test_beside_a_straight_wrist_no_answer_is_lost(name: str, size: float) -> None:
    arm = kinseek.load(name)
    q = random_joints(arm.chain, 20, 12)
    q[:, 4] = np.where(np.arange(20) % 2, size, -size)
    targets = plain_fk(arm.chain, q)
    for target, made_of in zip(targets, q, strict=True):
        found = arm.branches(target)
        assert isinstance(found, kinseek.Branches)
        assert strict(arm.chain, found.q, np.broadcast_to(target, (len(found), 4, 4))).all()
        assert len(found)
        if size >= 1e-3:
            assert apart(made_of[None], found.q).min() < 1e-3
        if size == 0.0:
            assert found.sampled


# Nearly


@pytest.mark.slow
@pytest.mark.parametrize("by", [3e-7, 1e-5, 1e-3])
def test_an_arm_that_nearly_has_a_structure_is_told_how_nearly_and_loses_no_answer(by: float) -> None:
    arm = dh(changed(UR, 2, 1, by))
    structure = arm.structure
    assert structure.word == "three parallel axes"
    assert not structure.exact
    assert 0.5 * by < structure.deviation < 2 * by
    assert "nearly" in structure.sentence
    assert f"{structure.deviation:.2g}" in structure.sentence
    assert f"{NEARLY:g}" in structure.sentence
    assert_answers(arm, random_joints(arm.chain, 200, 5))


def test_farther_off_it_has_none_and_its_answers_are_searched() -> None:
    arm = dh(changed(UR, 2, 1, 0.02))
    assert arm.structure.word == "none"
    assert "off by" in arm.structure.sentence
    assert_answers(arm, random_joints(arm.chain, 30, 5))


def test_calibrated_arms_lose_no_answer() -> None:
    arm = kinseek.load("ur10e_calibrated")
    assert arm.structure.word == "three parallel axes"
    assert not arm.structure.exact
    assert_answers(arm, random_joints(arm.chain, 200, 6))


def test_a_wrist_that_leans_and_is_nearly_spherical_loses_no_answer() -> None:
    arm = dh(changed(LEANING, 4, 0, 1e-3))
    assert arm.structure.word == "spherical wrist"
    assert not arm.structure.exact
    q = random_joints(arm.chain, 3000, 5)
    q = q[np.linalg.svd(arm.jacobian(q), compute_uv=False)[:, -1] > 0.003]
    every = arm.branches(arm.fk(q))
    assert isinstance(every, kinseek.BranchesBatch)
    lost = sum(
        not (len(found) and apart(x[None], found.q).min() < 1e-3)
        for x, found in zip(q, every.each, strict=True)
    )
    assert lost <= 4  # Where the nearby arm has lost a pair of answers that it still has.


# Bad input


def test_a_link_of_no_length_leaves_a_joint_to_choose() -> None:
    arm = dh(changed(UR, 2, 0, 0.3922))  # Axes 3 and 4 are one.
    assert arm.structure.word == "none"
    target = arm.fk([0.3, -1.2, 1.4, -0.8, 1.1, 0.2])
    found = arm.branches(target)
    assert isinstance(found, kinseek.Branches)
    assert len(found)
    assert strict(arm.chain, found.q, np.broadcast_to(target, (len(found), 4, 4))).all()


def test_axes_that_coincide_are_no_structure() -> None:
    rows = [
        (0, HALF, 0.3, 0),
        (0.4, 0, 0, 0),
        (0.05, HALF, 0, 0),
        (0, 0, 0.4, 0),
        (0, 0, 0, 0),
        (0, 0, 0.1, 0),
    ]
    arm = dh(rows)
    assert arm.structure.word == "none"
    assert len(np.atleast_2d(arm.branches(arm.fk([0.1, 0.2, 0.3, 0.4, 0.5, 0.6])).q))


def test_limits_that_hold_no_branch_leave_none() -> None:
    arm = kinseek.load("ur5e")
    target = arm.fk([0.3, -1.2, 1.4, -0.8, 1.1, 0.2])
    narrow = arm.with_limits(dict.fromkeys(arm.joint_names, (2.0, 2.1)))
    found = narrow.branches(target)
    assert isinstance(found, kinseek.Branches)
    assert len(found) == 0
    assert not found.complete
    assert not found.sampled


def test_limits_that_an_answer_touches_keep_it() -> None:
    arm = kinseek.load("ur5e")
    q = np.array([0.3, -1.2, 1.4, -0.8, 1.1, 0.2])
    target = arm.fk(q)
    for side in range(2):
        pinned = arm.with_limits({"elbow_joint": [(1.4, 1.5), (1.3, 1.4)][side]})
        found = pinned.branches(target)
        assert isinstance(found, kinseek.Branches)
        assert apart(q[None], found.q).min() < 1e-6
        assert (found.q >= pinned.lower).all()
        assert (found.q <= pinned.upper).all()


def test_wide_tolerances_are_searched() -> None:
    arm = kinseek.load("ur5e")
    target = arm.fk([0.3, -1.2, 1.4, -0.8, 1.1, 0.2])
    found = arm.branches(kinseek.Goal.pose(target, position_tolerance=1e-3, orientation_tolerance=1e-3))
    assert isinstance(found, kinseek.Branches)
    assert found.evaluations > 100
    assert apart(arm.branches(target).q, found.q).min(axis=1).max() < 0.1


def test_a_tool_of_the_goal_moves_the_tip() -> None:
    arm = kinseek.load("irb120")
    tool, q = kinseek.pose([0.1, 0.0, 0.2], rpy=[0.2, 0.1, -0.4]), random_joints(arm.chain, 20, 9)
    found = arm.branches(kinseek.Goal.pose(arm.fk(q) @ tool, tool=tool))
    assert isinstance(found, kinseek.BranchesBatch)
    for one, made_of in zip(found, q, strict=True):
        assert apart(made_of[None], one.q).min() < 1e-6


# A batch


def test_a_batch_is_what_single_calls_are() -> None:
    arm = kinseek.load("kr6r900")
    targets = arm.fk(random_joints(arm.chain, 12, 2))
    batch = arm.branches(targets)
    alone = [arm.branches(target) for target in targets]
    assert isinstance(batch, kinseek.BranchesBatch)
    np.testing.assert_array_equal(batch.counts, [len(one) for one in alone])
    np.testing.assert_array_equal(batch.q, np.concatenate([one.q for one in alone]))
    assert batch[3] is batch[3]
    assert batch[-1] is batch[11]
    assert [len(one) for one in batch[2:5]] == [len(one) for one in alone[2:5]]
    np.testing.assert_array_equal(batch[5].problem.goal.target, targets[5])
    with pytest.raises(IndexError):
        batch[12]
    few = arm.branches(targets, count=1, near=np.zeros(6))
    assert isinstance(few, kinseek.BranchesBatch)
    assert few.counts.max() == 1
    np.testing.assert_array_equal(few[4].problem.near, np.zeros(6))
    for one, first in zip(
        few, (arm.branches(target, near=np.zeros(6), count=1) for target in targets), strict=True
    ):
        np.testing.assert_array_equal(one.q, first.q)


# What closed forms are made of


@pytest.mark.jit
def test_the_angle_is_that_of_the_library() -> None:
    measure: Any = exposed(angle)
    rng = np.random.default_rng(1)
    points = [
        *rng.normal(size=(500, 2)),
        *np.eye(2),
        (0.0, -1.0),
        (-1.0, 0.0),
        (1.0, 1.0),
        (-1.0, 1e-9),
        (1e-9, -1.0),
        (0.0, 0.0),
    ]
    for y, x in points:
        assert abs(measure(y, x) - np.arctan2(y, x)) <= 1e-15


@pytest.mark.jit
def test_both_answers_of_an_equation_are_found_and_what_comes_closest_where_there_is_none() -> None:
    solve: Any = exposed(solve_trig)
    for a, b, c in np.random.default_rng(2).uniform(-1.0, 1.0, (200, 3)):
        turns = [solve(a, b, c, sign) for sign in (1.0, -1.0)]
        for cosine, sine, rest, length in turns:
            assert abs(cosine * cosine + sine * sine - 1.0) < 1e-13
            assert length == pytest.approx(np.hypot(a, b))
            assert (rest >= 0.0) == (abs(c) <= length)
            best = c if rest >= 0.0 else np.copysign(length, c)
            assert a * cosine + b * sine == pytest.approx(best, abs=1e-13)
        assert (turns[0][2] > 0.0) == (abs(turns[0][1] - turns[1][1]) + abs(turns[0][0] - turns[1][0]) > 0.0)


def test_the_ideas_say_what_each_bundled_arm_gets() -> None:
    docs = ROOT / "docs"
    rows = [line for line in (docs / "ideas.md").read_text().splitlines() if line.startswith("| ")][2:-1]
    exact, nearly, spare, other = (
        [part.strip().split(", ") for part in row.split("|")[-2].split(";")] for row in rows
    )
    told = dict.fromkeys(exact[0], ("six", True)) | dict.fromkeys(nearly[0], ("six", False))
    told |= {name: ("seven", i == 0) for i, names in enumerate(spare) for name in names}
    told |= dict.fromkeys(other[0], ("none", False))
    sizes = {"none": "none", "one joint given": "seven"}
    known = {name: kinseek.load(name).structure for name in catalog_names()}
    assert told == {name: (sizes.get(each.word, "six"), each.exact) for name, each in known.items()}
