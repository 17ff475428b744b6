"""The bound of an arm on a ball joint: never above an error that the arm has, and good enough to close gaps."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import kinseek
from chains import awkward_joints
from kinseek import Goal, Problem
from kinseek.kernels.arm.pose_error import judge
from kinseek.kernels.proof.memory import Heap
from kinseek.kernels.proof.multipliers import Shoulder
from kinseek.kernels.proof.progress import CEILING, COUNT, COUNTS, FIGURES, SEEN, UPPER, USED
from kinseek.kernels.proof.shoulder import enclose_ball
from kinseek.proof.branch_and_bound import prove
from kinseek.proof.certificate import Verdict
from kinseek.proof.reduce import question_without_last
from kinseek.proof.shoulder import bounded_by_ball, shoulder_of
from kinseek.robots.chain import SerialChain
from kinseek.solvers.atlas.solver import Atlas
from kinseek.tolerances import GoalOptions
from reference import fk, weighted_error

Array = NDArray[np.float64]

SPARE = ("panda", "iiwa14", "iiwa14_srs", "gen3", "xarm7", "rizon4", "baxter_left", "pr2_left", "yumi_left")
"""Arms of seven turns, whose first axes meet, nearly meet, or do not; with the last axis along z, x or -z of the tip."""


def kinds_of_goal(T: Array, rng: np.random.Generator) -> Goal:
    weights: GoalOptions = {
        "position_weight": 10 ** rng.uniform(-1, 1),
        "orientation_weight": 10 ** rng.uniform(-1, 1),
    }
    kind = rng.integers(0, 4)
    if kind == 0:
        return Goal.position(T[:3, 3])
    if kind == 1:
        axis = rng.normal(size=3)
        return Goal.pointing(T[:3, 3], T[:3, :3] @ axis, tuple(axis), **weights)
    return Goal.pose(T, **weights)


def shifted(T: Array, rng: np.random.Generator) -> Array:
    """A pose that is a little or much away: turned, moved, or pushed straight away from the base."""
    result = T.copy()
    result[:3, 3] += rng.normal(size=3) * 10 ** rng.uniform(-3, 0) * rng.integers(0, 2)
    result[:3, 3] *= 1 + rng.uniform(0, 0.5) * rng.integers(0, 2)
    turn = Rotation.from_rotvec(rng.normal(size=3) * 10 ** rng.uniform(-3, 0.3))
    result[:3, :3] = turn.as_matrix() @ result[:3, :3]
    return result


def lost(chain: SerialChain, rng: np.random.Generator, trust: float = 1.0) -> int:
    """Boxes around a joint vector whose bound is above its error."""
    q, count = awkward_joints(chain, rng), 0
    goal = kinds_of_goal(shifted(fk(chain, q), rng), rng)
    problem, error = Problem(chain, goal), weighted_error(fk(chain, q), goal)
    found = shoulder_of(problem, *question_without_last(problem, trust))
    if found is None:
        return 0
    shoulder, first = found
    n = round(math.log(shoulder.invariants.shape[1], 3))
    inner = q[first : first + n]
    half = (chain.upper - chain.lower)[first : first + n] / 2
    slack = 1e-11 * (1 + goal.position_weight + goal.orientation_weight)
    for _ in range(20):
        h = half * 10.0 ** (-rng.uniform(0, 5) * (rng.random(n) < 0.9))
        if rng.random() < 0.5:  # One joint alone, of which the bound knows all.
            h[rng.permutation(n)[1:]] = 1e-12
        off = rng.uniform(-1, 1, n)
        off = np.where(rng.random(n) < 0.5, np.sign(off), off)
        ceiling = error * (1 + 10 ** rng.uniform(-9, 0)) + slack
        above = rng.normal(size=5) * rng.integers(0, 2)
        above[4] = abs(above[4])
        bound = ball_bound(shoulder, ceiling, inner - off * h, h + 1e-15, above)
        count += bound > error + slack
    return count


def ball_bound(shoulder: Shoulder, ceiling: float, c: Array, h: Array, above: Array) -> float:
    """Bound of the box c ± h, (n,), as the search has it: as one half of a box that it cuts along its widest joint."""
    n, cut, wide, middle = len(c), int(np.argmax(h)), h.copy(), c.copy()
    wide[cut], middle[cut] = 2 * h[cut], c[cut] + h[cut]
    boxes = np.zeros((4, 2 * n + 6))
    boxes[0] = [*middle, *wide, cut, *above]
    heap = Heap(np.full(4, -np.inf), np.zeros(4, dtype=np.int64))  # A bound that is NaN leaves -inf.
    counts, figures = np.zeros(COUNTS, dtype=np.int64), np.zeros(FIGURES)
    counts[COUNT] = counts[USED] = 1
    figures[CEILING] = ceiling  # UPPER is 0: no error seen lowers the ceiling.
    enclose_ball(shoulder, boxes, heap, counts, figures, 1)
    assert counts[SEEN] == 2
    assert figures[UPPER] == 0.0, "an error below zero"
    rows = [row for row in heap.order[: counts[COUNT]] if boxes[row, cut] < middle[cut]]
    bounds = heap.bound[rows]
    assert np.isfinite(bounds).all()
    return float(bounds[0]) if rows else np.inf


@pytest.mark.slow
@pytest.mark.parametrize("name", SPARE)
def test_no_box_is_bounded_above_an_error_in_it(name: str) -> None:
    chain, rng = kinseek.load(name).chain, np.random.default_rng(0)
    assert sum(lost(chain, rng) for _ in range(30)) == 0


@pytest.mark.slow
@pytest.mark.parametrize("name", SPARE)
def test_ranges_one_percent_too_small_are_caught(name: str) -> None:
    chain, rng = kinseek.load(name).chain, np.random.default_rng(0)
    assert any(lost(chain, rng, trust=0.99) for _ in range(30))


def poses_of(arm: kinseek.Arm, count: int, rng: np.random.Generator) -> list[Array]:
    return [shifted(arm.fk(rng.uniform(arm.lower, arm.upper)), rng) for _ in range(count)]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["panda", "gen3", "baxter_left"])
def test_no_sample_is_nearer_than_the_bound(name: str) -> None:
    arm, rng = kinseek.load(name), np.random.default_rng(1)
    q = np.ascontiguousarray(rng.uniform(arm.lower, arm.upper, (20_000, arm.dof)))
    for T in poses_of(arm, 3, rng):
        problem = Problem(arm.chain, Goal.pose(T))
        targets = np.repeat(problem.goal.targets, len(q), axis=0)
        least = judge(problem.arrays, q, targets, problem.goal.arrays)[:, 2].min()
        bounded = bounded_by_ball(problem, 2.0 * least, 20_000)
        assert 0.0 <= bounded.lower <= least
        assert 0 < bounded.boxes <= 20_000


@pytest.mark.slow
@pytest.mark.parametrize(("name", "least"), [("panda", 11), ("iiwa14", 11), ("gen3", 11), ("xarm7", 11)])
def test_the_gap_closes_where_the_arm_is_too_short(name: str, least: int) -> None:
    arm, rng, closed = kinseek.load(name), np.random.default_rng(2), 0
    for _ in range(12):
        T = arm.fk(rng.uniform(arm.lower, arm.upper))
        T[:3, 3] *= 1.2 * np.linalg.norm(arm.fk(np.zeros(arm.dof))[:3, 3]) / np.linalg.norm(T[:3, 3])
        found = prove(Problem(arm.chain, Goal.pose(T)), gap=0.01, budget=60_000)
        closed += found.verdict is not Verdict.UNREACHABLE or found.gap <= 0.01001
    assert closed >= least


def test_the_gap_closes_where_a_limit_of_the_second_joint_holds_the_arm_back() -> None:
    """An arm on a ball joint reaches such a goal: what is known of the first axis has to rule it out."""
    arm = kinseek.load("iiwa14")
    q = np.array([1.48, arm.upper[1] + 0.1, 0.0, -0.3, 0.3, -0.25, 0.0])
    problem = Problem(arm.chain, Goal.pose(arm.fk(q)))
    best = Atlas().solve(problem)
    assert best.weighted_error > 0.01
    bounded = bounded_by_ball(problem, 0.99 * best.weighted_error, 12_000)
    assert bounded.lower == 0.99 * best.weighted_error


def test_axes_that_miss_each_other_widen_the_margin() -> None:
    """The ball is on the second axis. Its distance from the first one counts twice: for the arm and for the goal."""
    arm, apart = kinseek.load("panda"), 9e-7
    problem = Problem(arm.chain, Goal.pose(arm.fk(np.full(7, 0.5))))
    fixed = arm.chain.fixed.copy()
    across = np.cross([0.0, 0.0, 1.0], fixed[1, :, 2])
    fixed[1, :, 3] += apart * across / np.linalg.norm(across)
    other = Problem(replace(arm.chain, fixed=fixed), problem.goal)
    exact, first = ball_of(problem)
    askew, same = ball_of(other)
    assert first == same == 2
    assert askew.margin > exact.margin + 1.99 * apart


def ball_of(problem: Problem) -> tuple[Shoulder, int]:
    found = shoulder_of(problem, *question_without_last(problem))
    assert found is not None
    return found


def test_arms_without_a_joint_to_spare_have_no_ball() -> None:
    for name in ("ur5e", "puma560", "scara4", "ur10e_rail", "atlas_torso_arm"):
        arm = kinseek.load(name)
        problem = Problem(arm.chain, Goal.pose(arm.fk((arm.lower + arm.upper) / 2)))
        assert bounded_by_ball(problem, 1.0, 1000) == (0.0, 0)


def test_it_stops_when_told_and_what_it_says_holds() -> None:
    arm = kinseek.load("panda")
    T = arm.fk((arm.lower + arm.upper) / 2)
    T[:3, 3] *= 4
    problem = Problem(arm.chain, Goal.pose(T))
    assert bounded_by_ball(problem, 1.0, 1000, over=lambda: True) == (0.0, 0)
    some, more = (bounded_by_ball(problem, 100.0, budget) for budget in (60, 4000))
    assert 0.0 <= some.lower <= more.lower
    assert some.boxes <= 60
