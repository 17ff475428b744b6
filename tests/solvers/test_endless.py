"""Every search ends: questions that once never did, asked in another process that is ended after a while."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import kinseek
from kinseek import Goal
from kinseek.errors import InvalidProblem
from kinseek.kernels.arrays import GoalArrays, Limits
from kinseek.kernels.atlas import lanes as eight
from kinseek.kernels.atlas import newton as newton
from kinseek.kernels.atlas.lanes import LANES
from kinseek.kernels.jit import exposed
from kinseek.robots.joints import Joint, serial_chain
from kinseek.solvers.black_box.refine import bounded_step
from kinseek.support.transforms import rotation, transform

pytestmark = pytest.mark.slow

Array = NDArray[np.float64]

PATIENCE = 30
"""What questions of some milliseconds may take together, in seconds of the processor: the machine may be busy."""


def check(arm: kinseek.Arm, goal: Goal) -> None:
    solution = arm.ik(goal)
    assert np.isfinite(solution.q).all()
    assert ((solution.q >= arm.lower) & (solution.q <= arm.upper)).all()
    assert np.isfinite([solution.position_error, solution.weighted_error]).all()
    assert solution.weighted_error >= 0.0


def slide_towards_a_far_goal() -> None:
    """The goal lies straight ahead of a slide: the error falls, and its Hessian is nothing but zeros."""
    arm = kinseek.Arm.from_dh([[0, 0, 0, 0]] * 2, [0, -100], [1000, 100], kinds="PR")
    check(arm, Goal.position([0.0, 0.0, 5000.0]))


def tip_on_both_axes() -> None:
    """Two joints that turn many times, about one line that the tip is on."""
    for turns in (100.0, 700.0, 4000.0):
        for off in (0.0, 1e-14, 1e-9):
            arm = kinseek.Arm.from_dh([[off, 0, 100, 0], [off, 0, 100, 0]], [-turns] * 2, [turns] * 2)
            for goal in ([0, 0, 200], [0, 0, 300], [1, 0, 200], [1e-7, 1e-5, 200], [50, 0, 100]):
                check(arm, Goal.position(np.array(goal, dtype=float)))


def long_tools() -> None:
    """A tool far longer than the arm: what keeps the steps finite must not be lost beside it in rounding."""
    rng = np.random.default_rng(1)
    for number in range(300):
        arm, _ = two_joints(rng)
        tool = transform(np.eye(3), 10.0 ** rng.uniform(0, 6.5) * direction(rng))
        reached = (arm.fk(rng.uniform(arm.lower, arm.upper)) @ tool)[:3, 3]
        check(arm, Goal.position(reached * (1.0 + number % 2 * 1e-4 * rng.normal(size=3)), tool=tool))


def many_turns() -> None:
    """Arms of two joints that turn many times, the tip on the last axis or all but on it, found by hypothesis."""

    @settings(max_examples=150, suppress_health_check=list(HealthCheck))
    @given(st.integers(0, 2**32 - 1), st.floats(-8, 2.5), st.booleans())
    def ends(seed: int, away: float, reached: bool) -> None:
        rng = np.random.default_rng(seed)
        arm, size = two_joints(rng)
        place = arm.fk(rng.uniform(arm.lower, arm.upper))[:3, 3]
        goal = place if reached else place + 10.0**away * direction(rng)
        check(arm, Goal.position(goal))
        check(arm, Goal.position(size * direction(rng)))
        check(arm, Goal.position(size * arm.chain.fixed[0, :, 2]))

    ends()


def two_joints(rng: np.random.Generator) -> tuple[kinseek.Arm, float]:
    """Two joints with limits of ±100 to ±4,000 rad, links of about 100 m, and a tip on the last axis or near it."""
    size, joints = 10.0 ** rng.uniform(1, 3), []
    for i, turns in enumerate(10.0 ** rng.uniform(2, 3.6, 2)):
        turn = rotation(direction(rng), rng.choice([0.0, np.pi / 2, np.pi, rng.uniform(-3, 3)]))
        link = size * rng.choice([0.0, 1e-14, 1.0]) * direction(rng)
        joints.append(Joint(f"j{i}", "revolute", transform(turn, link), np.eye(3)[2], -turns, turns))
    off = size * rng.choice([0.0, 1e-17, 1e-15, 1e-12, 1e-9])
    tip = transform(np.eye(3), size * np.eye(3)[2] * rng.choice([0.0, 1.0]) + off * direction(rng))
    return kinseek.Arm(serial_chain(joints, tip, name="two", base="b", tip="t")), size


def direction(rng: np.random.Generator) -> Array:
    vector = np.eye(3)[rng.integers(3)] if rng.random() < 0.5 else rng.normal(size=3)
    return np.asarray(vector / np.linalg.norm(vector))


QUESTIONS: dict[str, Callable[[], None]] = {
    each.__name__: each for each in (slide_towards_a_far_goal, tip_on_both_axes, long_tools, many_turns)
}


@pytest.mark.parametrize("name", QUESTIONS)
def test_a_question_that_never_ended_does(name: str) -> None:
    done = subprocess.run(
        [sys.executable, __file__, name], check=False, capture_output=True, text=True, timeout=900
    )
    assert done.returncode != -signal.SIGPROF, f"{name} still runs after {PATIENCE} s"
    assert done.returncode == 0, done.stderr


@pytest.mark.jit
def test_a_slide_without_curvature_is_walked_downhill() -> None:
    arm = kinseek.Arm.from_dh([[0, 0, 0, 0]], [0], [1000], kinds="P")
    goal = GoalArrays(transform(np.eye(3), [0.0, 0.0, 5.0])[:3].copy(), 1.0, np.zeros(3))
    q = np.zeros(1)
    minimise: Any = exposed(newton.minimise)
    spent = minimise(arm.chain.arrays, goal, Limits(arm.lower, arm.upper), newton.DOWNHILL, q)
    assert spent <= newton.WALK
    assert q[0] == pytest.approx(5.0, abs=1e-6)


@pytest.mark.parametrize("length", [1.0, 1e5, 1e7, 1e10])
@pytest.mark.jit
def test_a_step_is_finite_however_far_one_joint_moves_the_tip(length: float) -> None:
    """A Jacobian of rank one, (1, 2, 4) times a length: in rounding 4 - 2·2 and 16 - 4·4 leave nothing to divide by."""
    lanes = eight.Lanes(
        q=np.zeros((1, LANES)),
        target=np.zeros((3, 4, LANES)),
        pose=np.zeros((3, 4, LANES)),
        axes=np.zeros((1, 6, LANES)),
        jacobian=length * np.repeat([1.0, 2.0, 4.0, 0.0, 0.0, 0.0], LANES).reshape(1, 6, LANES),
        gram=np.zeros((21, LANES)),
        residual=np.ones((6, LANES)),
        step=np.zeros((1, LANES)),
        share=np.zeros(LANES),
        before=np.zeros(LANES),
        stubborn=np.zeros(LANES),
        error=np.zeros((4, LANES)),
        weight=np.ones((2, LANES)),
    )
    exposed(eight.lanes_gram)(0.0, np.full(LANES, 1e-11), lanes, LANES)
    exposed(eight.lanes_solve)(lanes, LANES)
    assert np.isfinite(lanes.residual).all()
    exposed(eight.lanes_move)(np.array([-10.0]), np.array([10.0]), 0.8, lanes, LANES)
    assert np.isfinite(lanes.q).all()
    # Where 1 + 2 + 4 = 7 is asked of a row of squared length 21, the step is a third of one over the length. What no joint
    # can do is divided by little more than rounding, which leaves the step some percent off.
    np.testing.assert_allclose(lanes.q, min(7.0 / (21.0 * length), 0.8), rtol=0.1)


def test_copies_without_number_are_refused() -> None:
    arm = kinseek.Arm.from_dh([[1.0, 0, 0, 0]] * 3, [-4000.0] * 3, [4000.0] * 3)
    target = arm.fk([0.3, 0.7, -0.4])
    with pytest.raises(InvalidProblem, match="more than 100,000 solutions, too many for copies=True"):
        arm.branches(target, copies=True)
    with pytest.raises(InvalidProblem, match="narrow the limits with with_limits"):
        arm.ik(target, cost=lambda q: np.abs(q).sum(axis=1))
    few = kinseek.Arm.from_dh([[1.0, 0, 0, 0]] * 3, [-10.0] * 3, [10.0] * 3)
    # Two answers, each joint at three turns or more.
    assert len(few.branches(target, copies=True)) >= 2 * 3**3
    assert few.ik(target, cost=lambda q: np.abs(q).sum(axis=1)).success


def test_a_function_whose_joints_move_nothing_gets_a_step_however_small_its_damping() -> None:
    """Three joints do the same, one twice and one four times as fast, and the last does nothing."""
    box: Any = kinseek.Arm.from_fk(
        lambda q: np.tile(np.eye(4), (len(q), 1, 1)), [-1.0] * 4, [1.0] * 4, kinds="prismatic"
    ).mechanism
    slopes = np.zeros((1, 3, 4))
    slopes[0, 0] = [1.0, 2.0, 4.0, 0.0]
    for damping in (1e-2, 1e-12, 1e-20, 1e-200):
        move, promised = bounded_step(
            np.array([[0.7, 0.0, 0.0]]), slopes, np.array([damping]), np.zeros((1, 4)), box
        )
        assert np.isfinite(move).all()
        assert promised[0] > 0.0


if __name__ == "__main__":
    slow = kinseek.Arm.from_dh([[1, 0, 0, 0]] * 2, [-9] * 2, [9] * 2)
    for place in ([1.0, 0.5, 0.0], [5.0, 0.0, 0.0]):  # Compiles what the question needs.
        slow.ik(Goal.position(place, tool=np.eye(4)))
    signal.setitimer(signal.ITIMER_PROF, PATIENCE)  # Nobody handles it: it ends the process wherever that is.
    QUESTIONS[sys.argv[1]]()
