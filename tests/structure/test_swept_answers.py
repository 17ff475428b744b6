"""`arm.ik` where geometry gives the answers once one joint is given: told, true, inside the limits, and none lost."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import kinseek
from benchmarks.targets import plain_fk, random_joints, singular_joints, strict
from kinseek.kernels.structure.candidates import STRUCTURE, SWEPT_VALUES
from kinseek.structure.axes import axes_of
from test_structure import HALF, SHOULDER, UR, assert_answers, changed, dh

Array = NDArray[np.float64]

SWEPT_ARMS = ("panda", "iiwa14", "pr2_left", "ur10e_rail", "xarm7", "gen3")

# a, alpha, d, theta of each joint.
MEETING = [
    (0, 1.1, 0.3, 0),
    (0.3, 0.5, 0.1, 0),
    (0.1, HALF, 0.1, 0),
    (0, -HALF, 0.3, 0),
    (0, HALF, 0, 0),
    (0, 0.2, 0.1, 0),
]
MEETING_LATE = [
    (0, HALF, 0.3, 0),
    (0, -HALF, 0, 0),
    (0.1, 0.7, 0.4, 0),
    (0.3, 0.5, 0.1, 0),
    (0, 1.1, 0.2, 0),
    (0, 0.2, 0.1, 0),
]
ROUND = [(0.05, HALF, 0.2, 0), *MEETING]
"""Something to turn the arm before it."""


def assert_true_and_inside(arm: kinseek.Arm, targets: Array) -> kinseek.Solution:
    found = arm.ik(targets)
    assert strict(arm.chain, found.q, targets).all()
    assert (found.q >= arm.lower).all()
    assert (found.q <= arm.upper).all()
    for target, row in zip(targets[:40], found.q, strict=False):
        np.testing.assert_array_equal(arm.ik(target).q, row)
    return found


@pytest.mark.parametrize(
    ("name", "words"),
    {
        "panda": "joint 7 given, axes 1, 2 and 3 meet in a point and axes 5 and 6 meet",
        "iiwa14": "joint 1 given, axes 5, 6 and 7 meet in a point and axes 2 and 3 meet",
        "pr2_left": "joint 1 given, axes 5, 6 and 7 meet in a point and axes 2 and 3 meet",
        "ur10e_rail": "joint 1 given, axes 3, 4 and 5 are parallel and axes 6 and 7 meet",
        "gen3": "joint 1 given, axes 5, 6 and 7 meet in a point and axes 2 and 3 meet, nearly",
    }.items(),
)
def test_an_arm_says_which_joint_is_given_and_what_the_others_have(name: str, words: str) -> None:
    structure = kinseek.load(name).structure
    assert structure.word == "one joint given"
    assert structure.sentence.startswith(words)


@pytest.mark.parametrize("name", ["rizon4", "yumi_left", "atlas_arm", "planar5"])
def test_other_arms_with_joints_to_spare_or_too_few_have_none(name: str) -> None:
    assert kinseek.load(name).structure.word == "none"


@pytest.mark.parametrize("name", SWEPT_ARMS)
def test_answers_are_true_and_seldom_searched(name: str) -> None:
    arm = kinseek.load(name)
    found = assert_true_and_inside(arm, plain_fk(arm.chain, random_joints(arm.chain, 500, 1)))
    assert np.mean(found.evaluations <= 24) > 0.9


@pytest.mark.parametrize("name", SWEPT_ARMS)
def test_at_singularities_and_limits_every_target_is_reached(name: str) -> None:
    arm = kinseek.load(name)
    targets = plain_fk(arm.chain, singular_joints(arm.chain, 300, 5))
    assert_true_and_inside(arm, targets)


@pytest.mark.parametrize("rows", [MEETING, MEETING_LATE], ids=["wrist", "shoulder"])
def test_six_joints_whose_first_two_axes_meet_have_a_closed_form(rows: Any) -> None:
    tool = kinseek.pose([0.1, -0.05, 0.2], rpy=[0.3, 0.4, 0.5])
    arm = dh(rows, base=kinseek.pose([0.2, 0.1, 0.5], rpy=[0.1, -0.2, 0.3]), tool=tool)
    assert arm.structure.word == ("spherical wrist" if rows is MEETING else "spherical shoulder")
    assert arm.structure.exact
    q = random_joints(arm.chain, 200, 3)
    found = assert_answers(arm, q)
    assert np.median([one.evaluations for one in found]) <= 16
    assert np.median(assert_true_and_inside(arm, plain_fk(arm.chain, q)).evaluations) == 1


@pytest.mark.parametrize("by", [1e-7, 1e-5, 1e-3, 0.02])
@pytest.mark.parametrize(("rows", "joint"), [(MEETING, 4), (SHOULDER, 1)], ids=["meeting", "parallel"])
def test_nearly_of_a_structure_an_arm_is_answered_as_truly(rows: Any, joint: int, by: float) -> None:
    arm = dh(changed(rows, joint, 0, by))
    assert not arm.structure.exact
    targets = plain_fk(arm.chain, random_joints(arm.chain, 300, 4))
    found = assert_true_and_inside(arm, targets)
    if by <= 1e-3:
        assert np.median(found.evaluations) <= 4  # A candidate and its corrections.


def test_a_joint_in_front_may_slide_however_far() -> None:
    limit = np.array([20.0, *[np.pi] * 6])
    arm = kinseek.Arm.from_dh(np.array([(0, HALF, 0, 0), *UR], dtype=float), -limit, limit, kinds="PRRRRRR")
    assert arm.structure.word == "one joint given"
    q = random_joints(arm.chain, 200, 2)
    found = assert_true_and_inside(arm, plain_fk(arm.chain, q))
    assert np.ptp(found.q[:, 0]) > 30.0
    assert np.mean(found.evaluations <= 8) > 0.9


def test_endless_joints_come_within_half_a_turn() -> None:
    arm = dh(ROUND, np.full(7, np.inf))
    targets = plain_fk(arm.chain, random_joints(dh(ROUND, np.full(7, np.pi)).chain, 200, 6))
    found = arm.ik(targets)
    assert strict(arm.chain, found.q, targets).all()
    assert (np.abs(found.q) <= np.pi + 1e-9).all()


def test_a_tool_of_the_goal_moves_the_tip() -> None:
    arm = kinseek.load("panda")
    tool, q = kinseek.pose([0.1, 0.0, 0.2], rpy=[0.2, 0.1, -0.4]), random_joints(arm.chain, 50, 9)
    found = arm.ik(kinseek.Goal.pose(arm.fk(q) @ tool, tool=tool))
    assert found.success.all()
    np.testing.assert_allclose(arm.fk(found.q) @ tool, arm.fk(q) @ tool, atol=3e-6)


def test_what_is_tried_first_serves_most() -> None:
    arm = kinseek.load("panda")
    numbers = arm.atlas.structure.numbers  # type: ignore[union-attr]
    tried = numbers[SWEPT_VALUES : SWEPT_VALUES + int(STRUCTURE.value(numbers).swept)]
    assert len(set(tried)) == len(tried) > 2
    targets = plain_fk(arm.chain, random_joints(arm.chain, 500, 8))
    assert np.mean(arm.ik(targets).evaluations == 1) > 0.7


def test_a_narrow_joint_in_front_is_no_obstacle() -> None:
    arm = kinseek.load("iiwa14").with_limits({kinseek.load("iiwa14").joint_names[0]: (0.3, 0.31)})
    assert_true_and_inside(arm, plain_fk(arm.chain, random_joints(arm.chain, 200, 3)))


def test_limits_that_hold_no_answer_are_kept() -> None:
    arm = kinseek.load("iiwa14")
    narrow = arm.with_limits(dict.fromkeys(arm.joint_names, (1.0, 1.1)))
    found = narrow.ik(arm.fk(np.zeros(7)))
    assert found.status is kinseek.Status.BEST_EFFORT
    assert (found.q >= narrow.lower).all()
    assert (found.q <= narrow.upper).all()


@pytest.mark.parametrize("name", SWEPT_ARMS)
def test_where_the_arm_is_is_still_the_nearest(name: str) -> None:
    arm = kinseek.load(name)
    q = random_joints(arm.chain, 100, 2)
    found = arm.ik(plain_fk(arm.chain, q), near=q)
    assert found.success.all()
    np.testing.assert_allclose(found.q, q, atol=1e-4)


def test_a_trace_says_that_geometry_gave_the_answer() -> None:
    arm = kinseek.load("panda")
    target = arm.fk([0.3, -0.6, 0.4, -1.8, 0.7, 1.2, 0.1])
    plain, traced = arm.ik(target), arm.ik(target, trace=True)
    np.testing.assert_array_equal(plain.q, traced.q)
    assert [each.name for each in traced.trace] == ["closed form"]


def test_axes_of_a_joint_that_slides_are_told() -> None:
    axes = axes_of(kinseek.load("ur10e_rail").chain.arrays)
    assert axes is not None
    assert axes.slides.tolist() == [True, *[False] * 6]
    assert axes.backwards().distal_to(1).slides.tolist() == [*[False] * 5, True]


def test_the_ends_of_the_given_range_are_tried_last() -> None:
    """Four joints at limits and two straight: its one answer was missed, alone of 750,000."""
    arm = kinseek.load("iiwa14")
    q = singular_joints(arm.chain, 5000, 2)[3608:3609]
    assert q[0, 0] == arm.upper[0]
    assert_true_and_inside(arm, plain_fk(arm.chain, q))
