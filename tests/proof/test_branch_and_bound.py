"""Proofs: checked by grids, sound where a goal is in reach, valid however early they stop."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from importlib.metadata import version

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import kinseek
from fuzz import proofs
from kinseek import Goal, Problem
from kinseek.errors import InternalError, InvalidGoal, InvalidProblem
from kinseek.kernels.proof.progress import ENDED
from kinseek.proof import branch_and_bound
from kinseek.proof.boxes import excluded
from kinseek.proof.branch_and_bound import prove
from kinseek.proof.certificate import Certificate, Verdict
from kinseek.solution import Status, conclude
from kinseek.solvers.atlas.solver import Atlas
from reference import errors, fk, weighted_error

Array = NDArray[np.float64]

FLEET = (
    "panda",
    "iiwa14",
    "ur5e",
    "puma560",
    "jaco2_6",
    "ur10e_rail",
    "so101",
    "scara4",
    "planar2",
    "cylindrical3",
)


def certificate(arm: kinseek.Arm, goal: Goal, **options: float) -> Certificate:
    return prove(Problem(arm.chain, goal), **options)  # type: ignore[arg-type]


ELBOW = kinseek.Arm.from_dh(
    [(0, np.pi / 2, 0.4, 0), (0.5, 0, 0, 0), (0.3, 0, 0, 0)], [-3, -1, -2], [3, 2, 2.5]
)
"""Three turns: a shoulder, and an elbow that moves in its plane."""

SKEW = kinseek.Arm.from_dh(
    [(0.2, 1.0, 0.1, 0), (0.4, -0.7, 0.2, 0), (0.3, 0.5, 0, 0)], [-2, -2, -2], [2, 1.5, 2.5]
)
"""Three turns about axes in no special place."""

TWO = kinseek.Arm.from_dh([(0.3, 1.2, 0.2, 0), (0.5, 0, 0.1, 0)], [-2.5, -2], [2.5, 3])
"""Two turns about skew axes."""


@cache
def on_a_grid(arm: kinseek.Arm, steps: int) -> Array:
    """Poses at all nodes of a grid of joint values, (k, 4, 4)."""
    axes = [np.linspace(low, high, steps) for low, high in zip(arm.lower, arm.upper, strict=True)]
    return np.asarray(arm.fk(np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, arm.dof)))


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["pose", "position", "pointing"])
@pytest.mark.parametrize(
    ("arm", "steps"),
    [(kinseek.load("planar2"), 250), (kinseek.load("cylindrical3"), 40), (TWO, 250), (ELBOW, 40), (SKEW, 40)],
    ids=["planar", "cylindrical", "two", "elbow", "skew"],
)
def test_certificates_hold_against_a_grid(arm: kinseek.Arm, steps: int, kind: str) -> None:
    """Every verdict on every kind of goal, with wide and narrow tolerances, against all nodes of a fine grid."""
    rng = np.random.default_rng(5)
    poses, verdicts = on_a_grid(arm, steps), set()
    for trial in range(12):
        T = arm.fk(rng.uniform(arm.lower, arm.upper))
        T[:3, 3] += rng.normal(size=3) * (0.0, 0.01, 0.1, 0.4)[trial % 4]
        T[:3, :3] = (
            T[:3, :3] @ Rotation.from_rotvec(rng.normal(size=3) * (0, 0.01, 0.1, 0.5)[trial % 4]).as_matrix()
        )
        loose = float(rng.choice([0.003, 0.03, 0.2]))
        axis = (0.0, 0.6, 0.8) if kind == "pointing" else (0.0, 0.0, 1.0)
        goal = Goal(T, kind, axis, position_tolerance=loose, orientation_tolerance=loose)
        found = certificate(arm, goal, gap=0.01)
        verdicts.add(found.verdict)
        place = np.linalg.norm(poses[:, :3, 3] - T[:3, 3], axis=1)
        off = poses[:, :3, :3] - T[:3, :3]
        count = {"pose": 2, "pointing": 0, "position": 0}[kind]
        chord = 0.5 * (off[:, :, :count] ** 2).sum(axis=(1, 2))
        if kind == "pointing":
            chord = 0.5 * ((off @ np.array(axis)) ** 2).sum(axis=1)
        assert found.lower_bound <= (place + chord).min() + 1e-12
        assert found.upper_bound == pytest.approx(weighted_error(fk(arm.chain, found.q), goal), abs=1e-12)
        assert ((arm.lower <= found.q) & (found.q <= arm.upper)).all()
        assert found.verdict is Verdict.REACHABLE or found.gap <= 0.01 + 1e-9
        near = place <= loose
        if near.any() and kind == "pose":
            turns = Rotation.from_matrix(np.swapaxes(poses[near, :3, :3], 1, 2) @ T[:3, :3]).magnitude()
        else:
            turns = 2 * np.arcsin(np.sqrt(chord[near] / 2).clip(0, 1))  # No chord where the turn is free.
        if (turns <= loose).any():
            assert found.verdict is Verdict.REACHABLE
        if found.verdict is Verdict.REACHABLE:
            assert max(errors(fk(arm.chain, found.q), goal)) <= loose + 1e-9
    assert verdicts == {Verdict.REACHABLE, Verdict.UNREACHABLE}


@pytest.mark.slow
@pytest.mark.parametrize("name", FLEET)
def test_what_is_in_reach_is_never_called_unreachable(name: str) -> None:
    arm, rng = kinseek.load(name), np.random.default_rng(1)
    for trial in range(25):
        q = rng.uniform(arm.lower, arm.upper)
        choice = rng.random(arm.dof)
        q = np.where(choice < 0.15, arm.lower, np.where(choice < 0.3, arm.upper, q))
        if trial % 3 == 0:
            q = np.clip(np.round(q / (np.pi / 2)) * np.pi / 2, arm.lower, arm.upper)
        place, angle = 10.0 ** rng.uniform(-6, -2, 2)
        goal = Goal.pose(arm.fk(q), position_tolerance=place, orientation_tolerance=angle)
        search = excluded(Problem(arm.chain, goal), 3000)
        assert search.outcome != ENDED, q


@pytest.mark.parametrize("name", FLEET)
def test_the_verdict_in_reach_comes_with_a_witness(name: str) -> None:
    arm, rng = kinseek.load(name), np.random.default_rng(2)
    for _ in range(5):
        goal = Goal.pose(arm.fk(rng.uniform(arm.lower, arm.upper)))
        found = certificate(arm, goal)
        assert found.verdict is Verdict.REACHABLE
        place, angle = errors(fk(arm.chain, found.q), goal)
        assert place <= 1e-6 + 1e-12
        assert angle <= 1e-6 + 1e-9
        assert (found.q >= arm.lower).all()
        assert (found.q <= arm.upper).all()
        assert found.lower_bound <= found.upper_bound


@pytest.mark.slow
@pytest.mark.parametrize("name", FLEET)
def test_far_goals_are_proved_unreachable(name: str) -> None:
    arm, rng = kinseek.load(name), np.random.default_rng(3)
    for _ in range(3):
        T = arm.fk(rng.uniform(arm.lower, arm.upper))
        T[:3, 3] += 5.0 * T[:3, 0]
        for goal in (Goal.pose(T), Goal.position(T[:3, 3]), Goal.pointing(T[:3, 3], [1, 2, 3])):
            found = certificate(arm, goal)
            assert found.verdict is Verdict.UNREACHABLE
            assert 0.0 < found.lower_bound <= found.upper_bound
            assert found.largest_box == 0.0
            assert "Unreachable" in str(found)


def test_goals_beyond_the_limits_of_the_last_joint() -> None:
    arm = kinseek.load("puma560")
    narrow = arm.chain.upper.copy()
    narrow[-1] = 0.5
    chain = replace(arm.chain, upper=narrow)
    q = np.array([0.4, -0.7, 0.6, 0.8, 0.9, 0.8])
    assert prove(Problem(arm.chain, Goal.pose(arm.fk(q)))).verdict is Verdict.REACHABLE
    answers = prove(Problem(chain, Goal.pose(arm.fk(q))))
    assert answers.q[-1] <= 0.5
    if answers.verdict is Verdict.REACHABLE:
        assert answers.position_error <= 1e-6
    q[-1] = 0.5
    assert prove(Problem(chain, Goal.pose(arm.fk(q)))).verdict is Verdict.REACHABLE


@pytest.mark.parametrize("budget", [0, 1, 10, 100, 1000, 10000])
def test_any_budget_gives_valid_bounds(budget: int) -> None:
    arm = kinseek.load("puma560")
    T = arm.fk(np.full(6, 0.3))
    T[:3, 3] *= 1.3
    goal = Goal.pose(T)
    full = certificate(arm, goal, gap=0.02)
    early = certificate(arm, goal, gap=0.02, budget=budget)
    assert early.boxes <= budget
    assert early.lower_bound <= full.upper_bound
    assert full.lower_bound <= early.upper_bound
    assert early.verdict is not Verdict.REACHABLE
    assert (early.verdict is Verdict.UNDECIDED) == (early.lower_bound == 0.0)
    if budget == 0:
        assert early.verdict is Verdict.UNDECIDED
        assert early.largest_box > 1.0


def test_ik_proves_what_it_misses(monkeypatch: pytest.MonkeyPatch) -> None:
    arm = kinseek.load("puma560")
    near, far = arm.fk(np.full(6, 0.3)), arm.fk(np.full(6, 0.3))
    far[:3, 3] *= 5
    arm.ik(far)

    class Asked:
        def __init__(self) -> None:
            raise AssertionError("the solution is at hand: the atlas need not be asked again")

    monkeypatch.setattr("kinseek.proof.branch_and_bound.Atlas", Asked)
    assert arm.ik(near, prove=True).status is Status.SOLVED
    assert arm.ik(far, prove=True).status is Status.PROVED_UNREACHABLE
    batch = arm.ik(np.array([[near, far], [far, near]]), prove=True)
    assert batch.status.tolist() == [
        [Status.SOLVED, Status.PROVED_UNREACHABLE],
        [Status.PROVED_UNREACHABLE, Status.SOLVED],
    ]
    rows = list(batch.each())
    assert [row.success for row in rows] == [True, False, False, True]
    np.testing.assert_array_equal(rows[1].problem.goal.target, far)
    none = np.zeros((0, 4, 4))
    assert arm.ik(none, prove=True).status.shape == (0,)


def stretched(name: str, seed: int) -> tuple[kinseek.Arm, NDArray[np.float64]]:
    """An arm, and joint values among which many are as far out, or in, as the arm reaches."""
    arm, rng = kinseek.load(name), np.random.default_rng(seed)
    q = rng.uniform(arm.lower, arm.upper, (150, arm.dof))
    quarter = np.clip(np.round(q / (np.pi / 2)) * np.pi / 2, arm.lower, arm.upper)
    return arm, np.where(rng.random(q.shape) < 0.6, quarter, q)


@pytest.mark.slow
@pytest.mark.parametrize("name", FLEET)
def test_the_gate_lets_through_whatever_is_in_reach(name: str) -> None:
    arm, joints = stretched(name, 4)
    for q, T in zip(joints, arm.fk(joints), strict=True):
        for goal in (
            Goal.pose(T, position_tolerance=0.0, orientation_tolerance=0.0),
            Goal.position(T[:3, 3], position_tolerance=0.0),
            Goal.pointing(T[:3, 3], T[:3, :3] @ [0.6, 0.0, 0.8], (0.6, 0.0, 0.8), orientation_tolerance=0.0),
        ):
            assert excluded(Problem(arm.chain, goal), 0).outcome != ENDED, q


@pytest.mark.parametrize("name", ["planar2", "cylindrical3"])
def test_a_gate_one_percent_too_narrow_is_caught(name: str) -> None:
    arm, joints = stretched(name, 4)
    problems = [Problem(arm.chain, Goal.position(T[:3, 3])) for T in arm.fk(joints)]
    assert any(excluded(problem, 0, trust=0.99).outcome == ENDED for problem in problems)


@pytest.mark.parametrize("name", FLEET)
def test_the_gate_shuts_before_any_box(name: str) -> None:
    """Beyond the sphere that the arm reaches; and what it says of the least error is close to what the search says."""
    arm = kinseek.load(name)
    T = arm.fk((arm.lower + arm.upper) / 2)
    T[:3, 3] += 10.0 * T[:3, 0]
    found = certificate(arm, Goal.pose(T), budget=0, gap=0.01)
    assert found.verdict is Verdict.UNREACHABLE
    assert found.boxes == 0
    assert 5.0 < found.lower_bound <= found.upper_bound
    assert certificate(arm, Goal.pose(T)).lower_bound == pytest.approx(found.lower_bound)


def test_the_gate_knows_the_hole_in_the_middle_and_the_tilt() -> None:
    planar, scara = kinseek.load("planar2"), kinseek.load("scara4")
    two = kinseek.Arm.from_dh([(0.5, 0, 0, 0), (0.2, 0, 0, 0)], [-3, -3], [3, 3])
    assert certificate(two, Goal.position([0.1, 0.2, 0.0]), budget=0).verdict is Verdict.UNREACHABLE
    assert certificate(two, Goal.position([0.2, 0.23, 0.0]), budget=0).verdict is not Verdict.UNREACHABLE
    for arm in (planar, scara):
        T = arm.fk((arm.lower + arm.upper) / 2)
        T[:3, :3] = Rotation.from_euler("x", 0.01).as_matrix() @ T[:3, :3]
        found = certificate(arm, Goal.pose(T), budget=0)
        assert (found.verdict, found.boxes) == (Verdict.UNREACHABLE, 0)


def test_sharing_the_boxes_keeps_the_bounds(monkeypatch: pytest.MonkeyPatch) -> None:
    """Small stretches, so that boxes are dealt out many times: the bounds still hold, and meet at the gap."""
    arm, rng = kinseek.load("ur5e"), np.random.default_rng(23)
    for T in arm.fk(rng.uniform(arm.lower, arm.upper, (4, 6))):
        T[:3, 3] *= 1.4
        alone = certificate(arm, Goal.pose(T), gap=0.02)
        with monkeypatch.context() as patch:
            patch.setattr("kinseek.proof.boxes.PIECE", 40)
            shared = certificate(arm, Goal.pose(T), gap=0.02)
            early = certificate(arm, Goal.pose(T), gap=0.02, budget=2000)
        assert alone.verdict is shared.verdict
        assert shared.lower_bound <= alone.upper_bound
        assert alone.lower_bound <= shared.upper_bound
        assert early.lower_bound <= shared.upper_bound
        assert early.boxes <= 2000
        if shared.verdict is Verdict.UNREACHABLE:
            assert shared.gap <= 0.02 + 1e-9


def test_what_is_no_question_is_an_error() -> None:
    arm = kinseek.load("planar2")
    goal = Goal.pose(arm.fk([0.1, 0.2]))
    with pytest.raises(InvalidProblem, match="one target"):
        certificate(arm, Goal.pose(np.zeros((0, 4, 4))))
    with pytest.raises(InvalidProblem, match="one target"):
        certificate(arm, Goal.pose(goal.target[None]))
    with pytest.raises(InvalidProblem, match="gap"):
        certificate(arm, goal, gap=0.0)
    with pytest.raises(InvalidProblem, match="gap"):
        certificate(arm, goal, gap=np.nan)
    with pytest.raises(InvalidProblem, match="budget"):
        certificate(arm, goal, budget=-1)
    with pytest.raises(InvalidGoal, match="tolerance"):
        Goal.pose(goal.target, position_tolerance=-1.0)


@pytest.mark.slow
@pytest.mark.parametrize("gap", [None, 0.02])
@pytest.mark.parametrize("name", ["ur5e", "panda", "so101"])
def test_threads_change_nothing(name: str, gap: float | None) -> None:
    arm, rng = kinseek.load(name), np.random.default_rng(17)
    targets = arm.fk(rng.uniform(arm.lower, arm.upper, (4, arm.dof)))
    targets[:, :3, 3] *= 1.35
    for target in targets:
        one, two, eight = (
            arm.prove(target, gap=gap, threads=threads, budget=300_000) for threads in (1, 2, 8)
        )
        for other in (two, eight):
            assert (other.verdict, other.boxes, other.lower_bound) == (
                one.verdict,
                one.boxes,
                one.lower_bound,
            )
            assert other.largest_box == one.largest_box
            np.testing.assert_array_equal(other.q, one.q)


def test_sharing_the_boxes_counts_them_as_one_search_does(monkeypatch: pytest.MonkeyPatch) -> None:
    arm = kinseek.load("ur5e")
    far = kinseek.pose([0.7, 0.3, 0.75], rpy=[0.3, 1.2, -2.0])
    shared = arm.prove(far, budget=200_000)
    assert shared.verdict is kinseek.Verdict.UNREACHABLE
    monkeypatch.setattr("kinseek.proof.boxes.PIECE", 10**9)
    alone = arm.prove(far, budget=200_000)
    monkeypatch.setattr("kinseek.proof.boxes.PIECE", 16)
    pieces = arm.prove(far, budget=200_000, threads=2)
    assert pieces.boxes == alone.boxes == shared.boxes
    assert pieces.verdict is alone.verdict
    assert arm.prove(far, budget=40).verdict is kinseek.Verdict.UNDECIDED
    assert arm.prove(far, budget=40).boxes <= 40


def out_of_reach(arm: kinseek.Arm) -> Goal:
    T = arm.fk(np.full(arm.dof, 0.5))
    T[:3, 3] *= 4
    return Goal.pose(T)


def test_a_lower_bound_above_a_known_error_is_an_internal_error(monkeypatch: pytest.MonkeyPatch) -> None:
    arm = kinseek.load("ur5e")
    goal = out_of_reach(arm)
    upper = certificate(arm, goal).upper_bound
    monkeypatch.setattr(branch_and_bound, "least_by_gate", lambda *_: upper * (1 + 1e-9))
    with pytest.raises(InternalError, match="fault of kinseek") as caught:
        certificate(arm, goal)
    for part in (version("kinseek"), "'ur5e'", repr(upper), repr(upper * (1 + 1e-9)), "q: ["):
        assert part in str(caught.value)


@pytest.mark.parametrize("above", [1e-14, np.nan])
def test_rounding_and_nan_make_no_lower_bound_above_the_upper_one(
    monkeypatch: pytest.MonkeyPatch, above: float
) -> None:
    arm = kinseek.load("ur5e")
    goal = out_of_reach(arm)
    upper = certificate(arm, goal).upper_bound
    monkeypatch.setattr(branch_and_bound, "least_by_gate", lambda *_: upper * (1 + above))
    found = certificate(arm, goal)
    assert 0.0 < found.lower_bound <= found.upper_bound


def test_an_exclusion_of_a_pose_that_is_reached_is_an_internal_error(monkeypatch: pytest.MonkeyPatch) -> None:
    """The answer given is poor, all boxes are said to be gone, and the search for the nearest pose finds a fit."""
    arm, rng = kinseek.load("ur5e"), np.random.default_rng(0)
    problem = Problem(arm.chain, Goal.pose(arm.fk(rng.uniform(arm.lower, arm.upper))))
    fit = Atlas().solve(problem)
    poor = conclude(problem, np.zeros((1, 6)), np.zeros((1, 3), dtype=np.int64))
    near = excluded(problem, 0)
    monkeypatch.setattr(branch_and_bound, "excluded", lambda *_, **__: near._replace(outcome=ENDED, boxes=1))
    monkeypatch.setattr(branch_and_bound, "enclosed", lambda *_, **__: near._replace(q=fit.q))
    with pytest.raises(InternalError, match="meets both tolerances"):
        prove(problem, gap=0.1, solution=poor)


@pytest.mark.slow
def test_the_fuzzer_counts_an_internal_error(monkeypatch: pytest.MonkeyPatch) -> None:
    """Boxes are left out: they are tested by a kernel that is no entry of the library."""
    monkeypatch.setattr(proofs, "wrong_boxes", lambda *_: [])
    assert not list(proofs.wrong_cases(200, 0))
    monkeypatch.setattr(branch_and_bound, "least_outside", lambda _: 1e9)
    found = [wrong for _, _, wrong in proofs.wrong_cases(200, 0)]
    assert found
    assert all("InternalError" in line for wrong in found for line in wrong)
