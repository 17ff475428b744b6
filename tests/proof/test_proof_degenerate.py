"""Bounds where geometry is degenerate: half turns, quarter turns, joints at ±π, wide tolerances, rounding, giants."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import kinseek
from kinseek import Goal, Problem, Verdict
from kinseek.kernels.jit import exposed
from kinseek.kernels.proof.box import NARROW, ProofGoal, make_box_scratch
from kinseek.kernels.proof.last_joint import best_twist, twist_noise, twist_slack
from kinseek.kernels.proof.progress import FOUND, STOPPED
from kinseek.kernels.proof.taylor import solve
from kinseek.proof.boxes import excluded
from kinseek.proof.branch_and_bound import prove
from kinseek.proof.reduce import error_question, question, start_boxes
from kinseek.proof.root_isolation import isolate
from kinseek.proof.single_boxes import examine, holds
from kinseek.robots.chain import SerialChain
from kinseek.robots.joints import Joint, serial_chain
from kinseek.solution import Solution, conclude
from kinseek.support.transforms import rotation, transform
from reference import fk, weighted_error

pytestmark = pytest.mark.slow

Array = NDArray[np.float64]

MARGIN = 1e-12
"""A margin for directions, about that of an arm of six joints."""
AXES = {"x": np.eye(3)[0], "y": np.eye(3)[1], "z": np.eye(3)[2]}
QUARTERS = (-np.pi, -np.pi / 2, 0.0, np.pi / 2, np.pi)


def chain_of(
    *joints: tuple[str, Any, float, float], tip: Any = (0.0, 0.0, 0.0), size: float = 1.0
) -> SerialChain:
    """An arm whose joints lie 0.5 m apart along x."""
    made = []
    for i, (kind, axis, lower, upper) in enumerate(joints):
        origin = transform(np.eye(3), [0.5 * size if i else 0.0, 0.0, 0.0])
        made.append(Joint(f"j{i}", kind, origin, np.asarray(axis), lower, upper))
    return serial_chain(made, transform(np.eye(3), tip), name="made", base="base", tip="tip")


def poor(problem: Problem, q: Any) -> Solution:
    """A solution that somebody hands in."""
    return conclude(problem, np.array([q], dtype=np.float64), np.zeros((1, 3), dtype=np.int64))


def turned(T: Array, axis: Array, angle: float, shift: Any = (0.0, 0.0, 0.0)) -> Array:
    """The pose turned about its own axis, and shifted [m]."""
    G = T.copy()
    G[:3, :3] = G[:3, :3] @ rotation(axis, angle)
    G[:3, 3] += shift
    return G


def error_of(T: Array, goal: Goal) -> float:
    """The weighted error of a pose goal without cancellation: ``1 - x·x_g = |x - x_g|²/2``."""
    apart = (T[:3] - goal.targets[0]) ** 2
    return float(np.sqrt(apart[:, 3].sum()) + 0.5 * apart[:, :2].sum())


@pytest.mark.parametrize("at", [-np.pi, np.pi, -np.pi / 2, 0.0])
@pytest.mark.parametrize("tip", [(0.0, 0.0, 0.3), (0.2, 0.1, 0.4)])
def test_a_goal_half_a_turn_from_the_middle_of_the_box(at: float, tip: tuple[float, ...]) -> None:
    """Slide, then a joint of exactly one turn: the best twist is half a turn from where the box has its middle.

    The axes lie anywhere: where they are those of the frame, sines and cosines of π round to the right side by luck.
    """
    rng, known = np.random.default_rng(2), np.array([0.4, at])
    for _ in range(60):
        slide, turn = rng.normal(size=(2, 3)) / 3
        chain = chain_of(
            ("prismatic", slide / np.linalg.norm(slide), 0.0, 1.0),
            ("revolute", turn / np.linalg.norm(turn), -np.pi, np.pi),
            tip=tip,
        )
        T = fk(chain, known)
        for shift, lean in [(0.0, 0.0), (0.0087, 0.0), (0.0087, 0.003)]:
            problem = Problem(chain, Goal.pose(turned(T, AXES["x"], lean, [0.0, shift, 0.0])))
            error = error_of(T, problem.goal)
            for answer in [(1.0, 0.0), (0.0, 1.0)]:
                proof = prove(problem, gap=0.1, budget=300, solution=poor(problem, answer), threads=1)
                assert proof.lower_bound <= error + 1e-12, (shift, lean, answer)
                assert shift or lean or proof.verdict is not Verdict.UNREACHABLE


@settings(max_examples=400)
@given(
    axes=st.lists(st.sampled_from(["x", "y", "z"]), min_size=2, max_size=3),
    seed=st.integers(0, 1000),
    slides=st.booleans(),
    q=st.lists(st.sampled_from(QUARTERS), min_size=3, max_size=3),
    middle=st.lists(st.sampled_from(QUARTERS), min_size=3, max_size=3),
    half=st.lists(st.sampled_from([0.0, 1e-9, 1e-3, 0.5]), min_size=3, max_size=3),
    about=st.sampled_from(["x", "y", "z"]),
    angle=st.sampled_from([0.0, 1e-8, 0.01, np.pi / 2, np.pi]),
    tip=st.sampled_from([(0.0, 0.0, 0.0), (0.0, 0.0, 0.3), (0.3, 0.0, 0.0)]),
    spare=st.sampled_from([1.0, 1.5, 100.0]),
    passes=st.integers(0, 2),
)
def test_boxes_at_quarter_turns_keep_goals_at_quarter_turns(
    axes: list[str],
    seed: int,
    slides: bool,
    q: list[float],
    middle: list[float],
    half: list[float],
    about: str,
    angle: float,
    tip: tuple[float, ...],
    spare: float,
    passes: int,
) -> None:
    """A box between its middle and a known pose, every angle a multiple of π/2; the ceiling is that pose's error."""
    aside = Rotation.random(random_state=seed).as_matrix() if seed else np.eye(3)
    joints = [("revolute", aside @ AXES[each], -np.pi, np.pi) for each in axes]
    if slides:
        joints[0] = ("prismatic", aside @ AXES[axes[0]], -np.pi, np.pi)
    chain = chain_of(*joints, tip=tip)
    known = np.array(q[: chain.dof])
    goal = Goal.pose(turned(fk(chain, known), AXES[about], angle))
    error = error_of(fk(chain, known), goal)
    ceiling = error * spare + 1e-14
    for whole in (False, True):
        problem = Problem(chain, goal)
        asked = error_question(problem, known * 0.0, 0.5, whole=whole)
        count = start_boxes(chain, asked[2].present).shape[1] // 2
        centre = np.array(middle[:count])
        h = np.abs(known[:count] - centre) + half[:count] + 2e-15
        examined = examine(problem, asked, np.concatenate([centre, h])[None], ceiling, passes)
        assert not np.isnan(examined.left).any(), "given up"
        assert examined.lower[0] <= error + 1e-12
        assert holds(asked[0], examined.left, known[:count], 1e-13).all(), "cut"


@pytest.mark.parametrize("angle", [1.8, 2.4, 3.0, np.pi])
@pytest.mark.parametrize("axis", ["x", "z"])
def test_wide_tolerances_of_the_turn_lose_nothing(angle: float, axis: str) -> None:
    """Of a wide turn the chord is short: 2.4 rad, 1.86 of chord. A last joint that hardly turns is within the tolerance."""
    chain = chain_of(("prismatic", AXES["x"], 0.0, 1.0), ("revolute", AXES[axis], -0.1, 0.1))
    G = turned(fk(chain, np.array([0.5, 0.0])), AXES[axis], angle)
    problem = Problem(chain, Goal.pose(G, orientation_tolerance=min(angle + 0.05, np.pi)))
    assert excluded(problem, 1000).outcome == FOUND
    assert prove(problem, solution=poor(problem, [0.0, 0.0])).verdict is Verdict.REACHABLE


def question_of(margin: float = MARGIN) -> ProofGoal:
    nothing: dict[str, Any] = dict.fromkeys(ProofGoal._fields, 0.0) | dict.fromkeys(
        ("target", "last"), np.zeros((3, 4))
    )
    return ProofGoal(**nothing | {"trust": 1.0, "margin_a": margin})


@pytest.mark.jit
def test_the_slack_of_a_twist_holds_where_the_axis_points_backwards() -> None:
    """A cosine that is off by the margin must not make the slack too small, nor a turn of the others escape it."""
    slack, rng, proof_goal = exposed(twist_slack), np.random.default_rng(4), question_of()
    for _ in range(4000):
        lean = np.pi - 10.0 ** rng.uniform(-7, 0.4)
        omega = 10.0 ** rng.uniform(-9, 0.4)
        axis = rotation(AXES["z"], rng.uniform(-np.pi, np.pi))[:, 0]
        turn = rng.uniform(-np.pi, np.pi)
        M = rotation(axis, lean) @ rotation(AXES["z"], turn)
        square = np.cos(lean / 2) ** 2
        away = rng.normal(size=3)
        other = rotation(away / np.linalg.norm(away), omega * rng.uniform(0, 1)) @ M
        twist = np.arctan2(other[1, 0] - other[0, 1], other[0, 0] + other[1, 1])
        off = abs((twist - turn + np.pi) % (2 * np.pi) - np.pi)
        cosine = 2 * square - 1 + rng.choice([-1, 0, 1]) * 1.9 * MARGIN
        bound = slack(proof_goal, float(omega), float(cosine))
        assert off <= bound + 1e-3 * (1e-15 / square), (lean, omega)
        moved = 2 * np.sin(omega / 4)
        assert bound >= min(2 * np.arcsin(min(moved / np.sqrt(square), 1.0)), np.pi) - 1e-15, (lean, omega)


@pytest.mark.jit
def test_the_best_twist_and_what_rounding_makes_of_it() -> None:
    """Entries that are off by half the margin turn the best twist by no more than is said."""
    scratch = exposed(make_box_scratch)(2, 2)
    twist, noise, rng = exposed(best_twist), exposed(twist_noise), np.random.default_rng(5)
    proof_goal = question_of(1e-9)
    said = 0
    for _ in range(4000):
        lean = rng.choice([0.0, np.pi / 2, np.pi]) + rng.choice([0.0, 10.0 ** rng.uniform(-6, 0)])
        turn = float(rng.choice([-np.pi, -np.pi / 2, 0.0, np.pi / 2, np.pi, rng.uniform(-np.pi, np.pi)]))
        axis = rotation(AXES["x"], rng.uniform(-np.pi, np.pi))[:, 1]
        G = Rotation.random(random_state=int(rng.integers(2**31))).as_matrix()
        # The hand's columns are axis, x and y: it lies on the axis x here.
        hand = G @ (rotation(axis, lean) @ rotation(AXES["x"], turn)).T
        scratch.T[:, :3], scratch.goal[:, :3] = hand + rng.uniform(-0.5e-9, 0.5e-9, (3, 3)) / 3, G
        best, dot = twist(scratch)
        bound = noise(proof_goal, float(dot))
        off = abs((best - turn + np.pi) % (2 * np.pi) - np.pi)
        off = min(off, abs((best + turn + np.pi) % (2 * np.pi) - np.pi))  # Signs are tested elsewhere.
        assert off <= bound + 1e-12, (lean, turn, off, bound)
        said += bound < np.pi
    assert said > 2000


@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
def test_halves_of_a_box_hold_all_of_it(kind: str) -> None:
    """In exact arithmetic, for slides that stand as far away as a moon as for angles."""
    rng, tried = np.random.default_rng(6), 0
    chain = chain_of((kind, AXES["z"], -1.0, 1.0), ("prismatic", AXES["x"], 0.0, 1.0), tip=(0.5, 0.0, 0.0))
    problem = Problem(chain, Goal.position([0.0, 0.0, 0.0]))
    form, proof_goal, roll = question(problem)
    asked = form, proof_goal._replace(position=1e11), roll  # So wide that nothing is cut off.
    for _ in range(2500):
        centre = float(rng.choice([0.0, np.pi, 10.0 ** rng.uniform(-3, 8)]))
        half = float(10.0 ** rng.uniform(-10, 1))
        left = examine(problem, asked, np.array([[centre, 0.0, half, 0.0]])).left[0]
        if (left[0] == left[1]).all():
            assert half < NARROW * (1.0 + centre)
            continue
        tried += 1
        ends = [(Fraction(c) - Fraction(h), Fraction(c) + Fraction(h)) for c, h in left[:, ::2].tolist()]
        assert ends[0][0] <= Fraction(centre) - Fraction(half)
        assert ends[0][1] >= ends[1][0]
        assert ends[1][1] >= Fraction(centre) + Fraction(half)
    assert tried > 1000


def test_isolation_splits_boxes_as_far_as_exclusion_does() -> None:
    """Without any tolerance boxes around an answer are split until they are too narrow: by the same measure in both."""
    chain = chain_of(
        ("revolute", AXES["z"], -1.0, 1.0), ("revolute", AXES["z"], 0.1, 1.0), tip=(0.5, 0.0, 0.0)
    )
    aside = transform(Rotation.random(random_state=1).as_matrix(), [0.1, 0.2, 0.3])
    chain = replace(
        chain,
        fixed=np.concatenate(
            [(aside @ np.vstack([chain.fixed[0], [0, 0, 0, 1]]))[None, :3], chain.fixed[1:]]
        ),
    )
    goal = Goal.pose(fk(chain, np.array([0.3, 0.7])), position_tolerance=0.0, orientation_tolerance=0.0)
    alone, nothing = excluded(Problem(chain, goal), 10_000), isolate(Problem(chain, goal), budget=10_000)
    assert alone.outcome == STOPPED
    assert 0.0 < alone.stuck < 2 * NARROW
    assert len(nothing.q) == 0
    assert not nothing.complete
    assert nothing.boxes == alone.boxes


def test_a_box_too_narrow_to_split_is_never_forgotten(monkeypatch: pytest.MonkeyPatch) -> None:
    """One round gives it up, and the last of many rounds ends without any box: still nothing is excluded."""
    turns = [("revolute", AXES[axis], -2.5, 2.4) for axis in "zzy"]
    chain = chain_of(*turns, tip=(0.4, 0.1, 0.0))
    goal = Goal.position(fk(chain, np.array([0.3, 0.9, 0.4]))[:3, 3], position_tolerance=0.0)
    problem = Problem(chain, goal)
    alone = excluded(problem, 20_000)
    for name in ("FIRST", "PIECE"):
        monkeypatch.setattr(f"kinseek.proof.boxes.{name}", 4)
    rounds = excluded(problem, 20_000, threads=1)
    assert rounds.boxes == alone.boxes > 40
    assert len(rounds.left) == 0
    assert rounds.stuck == alone.stuck > 0.0
    assert rounds.outcome == alone.outcome == STOPPED


@pytest.mark.parametrize("name", ["so101", "piper", "irb5400", "ur10e_rail", "panda"])
def test_the_first_box_holds_both_limits(name: str) -> None:
    """In exact arithmetic, and also for limits whose middle and half width have to be rounded."""
    chain, rng = kinseek.load(name).chain, np.random.default_rng(4)
    for _ in range(50):
        shift = rng.normal(size=chain.dof)
        chain = replace(
            chain, lower=chain.lower - abs(shift), upper=chain.lower + rng.uniform(0.1, 3.0, chain.dof)
        )
        middle, half = start_boxes(chain, False)[0].reshape(2, -1).tolist()
        for c, h, lower, upper in zip(middle, half, chain.lower.tolist(), chain.upper.tolist(), strict=True):
            assert Fraction(c) - Fraction(h) <= Fraction(lower)
            assert Fraction(upper) <= Fraction(c) + Fraction(h)


@pytest.mark.parametrize("scale", [1e-12, 1.0, 1e15, 1e30])
@pytest.mark.jit
def test_equations_without_a_single_answer_are_solved_by_something_finite(scale: float) -> None:
    run, rng = exposed(solve), np.random.default_rng(7)
    for _ in range(500):
        dof = int(rng.integers(2, 8))
        J = rng.normal(size=(int(rng.integers(1, dof)), dof))
        N, x = scale * J.T @ J, scale * J.T @ rng.normal(size=len(J))
        J[:, 0] = J[:, -1]
        run(N, np.full(dof, 1e-9), x)
        assert np.isfinite(x).all()


def random_arm(rng: np.random.Generator, dof: int, size: float) -> SerialChain:
    joints = []
    for i in range(dof):
        kind = str(rng.choice(["revolute", "revolute", "prismatic"]))
        origin = transform(
            Rotation.random(random_state=int(rng.integers(2**31))).as_matrix(), size * rng.normal(size=3)
        )
        span = size if kind == "prismatic" else np.pi
        joints.append(Joint(f"j{i}", kind, origin, AXES["z"], -span, span))
    return serial_chain(joints, transform(np.eye(3), size * rng.normal(size=3)), name="r", base="b", tip="t")


@pytest.mark.parametrize("size", [1e-5, 1.0, 1e4, 1e5, 1e6])
@pytest.mark.parametrize("kind", ["pose", "position", "pointing"])
def test_certificates_of_dwarfs_and_giants_are_finite(size: float, kind: str) -> None:
    """Joint values inside the limits, 0 ≤ lower ≤ upper, and no bound above a known error: in reach, and out of it."""
    rng = np.random.default_rng(8)
    for number in range(6):
        chain = random_arm(rng, 3 + number % 4, size)
        q = rng.uniform(chain.lower, chain.upper)
        T = fk(chain, q)
        T[:3, 3] *= 1.0 if number < 3 else 1.7
        goal = {
            "pose": lambda T=T: Goal.pose(T),
            "position": lambda T=T: Goal.position(T[:3, 3]),
            "pointing": lambda T=T: Goal.pointing(T[:3, 3], T[:3, 0], (0.0, 0.0, 1.0)),
        }[kind]()
        problem = Problem(chain, goal)
        known = weighted_error(fk(chain, q), goal)
        for answer in (None, poor(problem, chain.lower)):
            proof = prove(problem, gap=0.1, budget=3000, solution=answer, threads=1)
            figures = (proof.lower_bound, proof.upper_bound, proof.position_error, proof.orientation_error)
            assert np.isfinite(proof.q).all()
            assert (proof.q >= chain.lower).all()
            assert (proof.q <= chain.upper).all()
            assert np.isfinite(figures).all()
            assert 0.0 <= proof.lower_bound <= proof.upper_bound
            assert proof.lower_bound <= known + 1e-12 * size + 1e-14


def test_sizes_beyond_all_numbers_are_refused() -> None:
    """Readers refuse such arms; a chain made by hand comes as far as the proof."""
    chain = chain_of(("prismatic", AXES["x"], 0.0, 1.0), ("revolute", AXES["z"], -1.0, 1.0))
    problem = Problem(replace(chain, upper=np.array([1e13, 1.0])), Goal.position([0.0, 1.0, 0.0]))
    with pytest.raises(kinseek.errors.InvalidProblem, match="1e\\+12 m"):
        prove(problem, solution=poor(problem, [0.0, 0.0]))


def test_position_goals_of_arms_with_joints_to_spare_come_with_finite_joint_values() -> None:
    arm, rng = kinseek.load("panda"), np.random.default_rng(9)
    for _ in range(10):
        q = rng.uniform(arm.lower, arm.upper)
        problem = Problem(arm.chain, Goal.position(arm.fk(q)[:3, 3]))
        proof = prove(
            problem, gap=0.02, budget=100, solution=poor(problem, rng.uniform(arm.lower, arm.upper))
        )
        assert np.isfinite(proof.q).all()
        assert (arm.lower <= proof.q).all()
        assert (proof.q <= arm.upper).all()
        assert np.isfinite([proof.lower_bound, proof.upper_bound]).all()
