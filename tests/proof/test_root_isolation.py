"""Complete lists of answers: against closed forms, restarts and grids; what is missing, singular or too tight must show."""

from __future__ import annotations

import importlib
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import kinseek
from chains import awkward_joints, serial_chains
from kinseek import Goal, Problem
from kinseek.errors import InvalidProblem
from kinseek.kernels.proof.neighbourhood import contractions
from kinseek.proof.reduce import question
from kinseek.proof.root_isolation import Isolation, isolate, prove_complete
from kinseek.robots.chain import SerialChain
from reference import errors, fk
from test_bounds import goal_near

Array = NDArray[np.float64]

TURN = 2 * np.pi


def least_singular(chain: SerialChain, q: Array) -> float:
    """The least singular value of the Jacobian, lengths in units of the arm's reach."""
    step, T = 1e-6, fk(chain, q)
    length = np.linalg.norm(chain.fixed[1:, :, 3], axis=1).sum()
    J = np.empty((6, chain.dof))
    for i in range(chain.dof):
        ends = [fk(chain, q + sign * step * np.eye(chain.dof)[i]) for sign in (1, -1)]
        slope = (ends[0] - ends[1]) / (2 * step)
        turn = slope[:3, :3] @ T[:3, :3].T
        J[:, i] = [*slope[:3, 3] / length, turn[2, 1], turn[0, 2], turn[1, 0]]
    return float(np.linalg.svd(J)[1][-1])


def regular_joints(chain: SerialChain, rng: np.random.Generator, least: float = 0.02) -> Array:
    """Random joint values away from singularities."""
    while True:
        q = rng.uniform(chain.lower, chain.upper)
        if least_singular(chain, q) > least:
            return np.asarray(q)


def apart(chain: SerialChain, a: Array, b: Array) -> Array:
    """Difference of joint values, whole turns of revolute joints left out, (n,)."""
    off = np.abs(a - b)
    turns = np.array([kind != "prismatic" for kind in chain.kinds])
    return np.where(turns, np.minimum(off % TURN, TURN - off % TURN), off)


def holds(isolation: Isolation, chain: SerialChain, q: Array) -> bool:
    """Is q near one of the answers, as near as is claimed?"""
    near = [
        (apart(chain, q, a) <= d + 1e-12).all() for a, d in zip(isolation.q, isolation.distance, strict=True)
    ]
    return bool(np.any(near))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ur5e", "puma560", "irb120", "kr6r900", "elbow6"])
def test_the_same_answers_as_a_closed_form(name: str) -> None:
    pytest.importorskip("eaik")
    robot_of: Any = importlib.import_module("eaik.IK_HP").HPRobot
    arm, rng = kinseek.load(name), np.random.default_rng(4)
    chain = arm.chain
    frames = [np.eye(4)]
    for A in chain.fixed:
        frames.append(frames[-1] @ np.vstack([A, [0, 0, 0, 1]]))
    robot = robot_of(
        np.array([frame[:3, 2] for frame in frames[1:7]]), np.diff([frame[:3, 3] for frame in frames], axis=0)
    )
    if not robot.hasKnownDecomposition():
        pytest.skip("the arm has no known closed form")
    complete = 0
    for _ in range(12):
        T = arm.fk(regular_joints(chain, rng))
        turned = T.copy()
        turned[:3, :3] = T[:3, :3] @ frames[-1][:3, :3].T
        found, middle = np.asarray(robot.IK(turned).Q), (chain.lower + chain.upper) / 2
        found = middle + (found - middle + np.pi) % TURN - np.pi
        goal = Goal.pose(T)
        theirs = [
            q
            for q in found
            if (q >= chain.lower).all() and (q <= chain.upper).all() and errors(fk(chain, q), goal)[0] < 1e-7
        ]
        isolation = isolate(Problem(chain, goal))
        complete += isolation.complete
        if isolation.complete:
            assert all(holds(isolation, chain, q) for q in theirs)
            distinct = [
                q for i, q in enumerate(theirs) if all(apart(chain, q, p).max() > 1e-4 for p in theirs[:i])
            ]
            assert len(distinct) == len(isolation.q)
    assert complete >= 11


@pytest.mark.parametrize("name", ["ur5e", "puma560", "jaco2_6"])
def test_a_dropped_branch_is_found_again(name: str) -> None:
    arm, rng = kinseek.load(name), np.random.default_rng(0)
    for _ in range(4):
        problem = Problem(arm.chain, Goal.pose(arm.fk(regular_joints(arm.chain, rng))))
        every = isolate(problem)
        again = isolate(problem, every.q)
        assert again.complete == every.complete
        np.testing.assert_array_equal(again.given, np.arange(len(every.q)))
        for i in range(len(every.q)):
            fewer = isolate(problem, np.delete(every.q, i, axis=0))
            assert (fewer.given < 0).any() or not fewer.complete
            if every.complete:
                assert fewer.complete
                assert holds(fewer, arm.chain, every.q[i])
                assert len(fewer.q) == len(every.q)


@pytest.mark.parametrize("name", ["jaco2_6", "irb5400", "so101", "scara4"])
def test_restarts_find_nothing_more(name: str) -> None:
    arm, rng = kinseek.load(name), np.random.default_rng(1)
    proved = 0
    for _ in range(3):
        goal = Goal.pose(arm.fk(rng.uniform(arm.lower, arm.upper)))
        isolation = isolate(Problem(arm.chain, goal))
        assert len(isolation.q) > 0
        if not isolation.complete:
            continue
        proved += 1
        for _ in range(40):
            solution = arm.ik(goal, near=rng.uniform(arm.lower, arm.upper))
            if solution.success:
                assert holds(isolation, arm.chain, solution.q)
    assert proved > 0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "kind", "steps", "loose"),
    [
        ("planar2", "position", 700, 0.01),
        ("planar2", "pose", 400, 0.05),
        ("cylindrical3", "position", 60, 0.05),
        ("planar3", "pose", 90, 0.05),
    ],
)
def test_a_grid_finds_nothing_more(name: str, kind: str, steps: int, loose: float) -> None:
    """With wide tolerances many nodes of a grid are answers, and each must lie where the proof says."""
    if name == "planar3":
        arm = kinseek.Arm.from_dh([(1, 0, 0, 0), (0.7, 0, 0, 0), (0.4, 0, 0, 0)], [-3, -2.5, -2], [3, 2.5, 2])
    else:
        arm = kinseek.load(name)
    chain, rng, hits, proved = arm.chain, np.random.default_rng(3), 0, 0
    axes = [np.linspace(low, high, steps) for low, high in zip(chain.lower, chain.upper, strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, arm.dof)
    poses = arm.fk(grid)
    for _ in range(8):
        T = arm.fk(rng.uniform(chain.lower, chain.upper))
        ask = Goal(T, kind, position_tolerance=loose, orientation_tolerance=loose)
        isolation = isolate(Problem(chain, ask))
        if not isolation.complete:
            continue
        proved += 1
        near = np.flatnonzero(np.linalg.norm(poses[:, :3, 3] - T[:3, 3], axis=1) <= loose)
        for row in near:
            if errors(poses[row], ask)[1] <= loose:
                hits += 1
                assert holds(isolation, chain, grid[row])
    assert proved >= 3
    assert hits > 10


@pytest.mark.parametrize("name", ["ur5e", "so101", "planar2"])
def test_answers_at_limits_count(name: str) -> None:
    arm, rng = kinseek.load(name), np.random.default_rng(2)
    chain, complete = arm.chain, 0
    for _ in range(6):
        q = regular_joints(chain, rng, 0.05) if chain.dof == 6 else rng.uniform(chain.lower, chain.upper)
        joint = int(rng.integers(chain.dof))
        narrow = chain.upper.copy()
        narrow[joint] = q[joint]
        bounded = replace(chain, upper=narrow)
        isolation = isolate(Problem(bounded, Goal.pose(fk(bounded, q))), q[None])
        complete += isolation.complete
        assert (isolation.q <= bounded.upper).all()
        if isolation.complete:
            assert holds(isolation, bounded, q)
    assert complete >= 3


@pytest.mark.parametrize(
    ("name", "q"), [("ur5e", [0.3, -1.0, 0.0, 0.4, 0.8, 0.1]), ("puma560", [0.3, 0.4, 0.5, 0.6, 0.0, 0.2])]
)
def test_a_singular_answer_is_not_called_isolated(name: str, q: list[float]) -> None:
    arm = kinseek.load(name)
    isolation = isolate(Problem(arm.chain, Goal.pose(arm.fk(q))), [q])
    assert not isolation.complete
    assert isolation.undecided > 0
    assert np.isinf(isolation.distance[0]).any()


def test_whole_turns_and_neighbours_are_one_branch() -> None:
    arm = kinseek.load("ur5e")
    q = np.array([0.3, -1.0, 1.2, 0.4, 0.8, 0.1])
    down, up = -np.eye(6)[0], np.eye(6)[3] + np.eye(6)[5]
    copies = q + np.vstack([np.zeros(6), TURN * down, TURN * (down - up), np.full(6, 1e-9)])
    isolation = isolate(Problem(arm.chain, Goal.pose(arm.fk(q))), copies)
    assert isolation.complete
    assert (isolation.given == 0).sum() == 1
    assert not np.isin(isolation.given, [1, 2, 3]).any()


def test_arms_with_joints_to_spare_are_never_complete() -> None:
    arm = kinseek.load("panda")
    q = np.clip(np.full(7, 0.4), arm.lower, arm.upper)
    isolation = isolate(Problem(arm.chain, Goal.pose(arm.fk(q))), q[None])
    assert not isolation.complete
    np.testing.assert_array_equal(isolation.q, q[None])


@pytest.mark.parametrize("budget", [0, 1, 100])
def test_a_small_budget_claims_nothing(budget: int) -> None:
    arm = kinseek.load("ur5e")
    q = np.array([0.3, -1.0, 1.2, 0.4, 0.8, 0.1])
    isolation = isolate(Problem(arm.chain, Goal.pose(arm.fk(q))), q[None], budget=budget)
    assert not isolation.complete
    assert isolation.boxes <= budget
    assert isolation.undecided > 0
    np.testing.assert_array_equal(isolation.q[0], q)


def test_a_goal_out_of_reach_has_no_answers() -> None:
    arm = kinseek.load("ur5e")
    T = arm.fk(np.full(6, 0.5))
    T[:3, 3] *= 4
    q, complete = prove_complete(Problem(arm.chain, Goal.pose(T)), np.empty((0, 6)))
    assert complete
    assert q.shape == (0, 6)


def contraction_fails(chain: SerialChain, rng: np.random.Generator, trust: float = 1.0) -> int:
    """Ask for what a joint vector reaches from centres nearby; count those whose κ is too small to have it."""
    q = awkward_joints(chain, rng)
    place, angle = (0.0, 0.0) if rng.random() < 0.5 else 10.0 ** rng.uniform(-6, -2, 2)
    goal = goal_near(
        fk(chain, q),
        rng,
        0.999999 * place,
        0.999999 * angle,
        position_tolerance=place,
        orientation_tolerance=angle,
    )
    form, proof_goal, roll = question(Problem(chain, goal), trust)
    count = chain.dof - int(roll.present)
    if count == 0:
        return 0
    sizes = 10.0 ** rng.uniform(-3, -0.3, (40, 1))
    delta = rng.uniform(-1, 1, (40, count)) * sizes * (rng.random((40, count)) < rng.uniform(0.2, 1))
    half = np.abs(delta) + 1e-15
    reach = contractions(form, proof_goal, np.ascontiguousarray(np.hstack([q[:count] - delta, half])))
    return int((reach < np.abs(delta) - 1e-13).any(axis=1).sum())


@pytest.mark.slow
@pytest.mark.parametrize("name", ["planar2", "scara4", "cylindrical3", "ur5e", "jaco2_6", "so101"])
@pytest.mark.jit
def test_contractions_hold_and_one_percent_less_is_caught(name: str) -> None:
    chain, rng = kinseek.load(name).chain, np.random.default_rng(0)
    assert sum(contraction_fails(chain, rng) for _ in range(150)) == 0
    assert sum(contraction_fails(chain, rng, trust=0.99) for _ in range(150)) > 0


@settings(max_examples=40)
@given(chain=serial_chains(), seed=st.integers(0, 2**32 - 1))
@pytest.mark.jit
def test_contractions_hold_on_any_chain(chain: SerialChain, seed: int) -> None:
    rng = np.random.default_rng(seed)
    assert sum(contraction_fails(chain, rng) for _ in range(3)) == 0


def test_what_is_no_question_is_an_error() -> None:
    arm = kinseek.load("ur5e")
    q = np.array([0.3, -1.0, 1.2, 0.4, 0.8, 0.1])
    problem = Problem(arm.chain, Goal.pose(arm.fk(q)))
    with pytest.raises(InvalidProblem, match="one target"):
        isolate(Problem(arm.chain, Goal.pose(arm.fk(q)[None])))
    with pytest.raises(InvalidProblem, match="budget"):
        isolate(problem, budget=-1)
    with pytest.raises(InvalidProblem, match=r"shape \(k, 6\)"):
        isolate(problem, q)
    with pytest.raises(InvalidProblem, match="shape"):
        isolate(problem, q[None, :5])
    with pytest.raises(InvalidProblem, match="limits"):
        isolate(problem, q[None] + 8.0)
    with pytest.raises(InvalidProblem, match="row 1 misses"):
        isolate(problem, [q, q + 0.1])


def test_exactly_as_many_solutions_as_regular_answers() -> None:
    arm, rng, counted = kinseek.load("ur5e"), np.random.default_rng(3), 0
    for _ in range(4):
        isolation = isolate(Problem(arm.chain, Goal.pose(arm.fk(regular_joints(arm.chain, rng, 0.05)))))
        if isolation.solutions is not None:
            counted += 1
            assert isolation.complete
            assert "complete" in repr(isolation)
            assert isolation.exact.all()
            assert isolation.solutions == len(isolation.q) > 0
    assert counted >= 2
    T = arm.fk(np.full(6, 0.5))
    T[:3, 3] *= 4
    assert isolate(Problem(arm.chain, Goal.pose(T))).solutions == 0


def test_a_solution_beyond_a_limit_does_not_count() -> None:
    """The goal is beyond a slide's end by half the tolerance: there is an answer, and no solution."""
    arm = kinseek.load("cylindrical3")
    q = np.array([1.0, 0.5 * (arm.lower[1] + arm.upper[1]), 0.5 * (arm.lower[2] + arm.upper[2])])
    whole = isolate(Problem(arm.chain, Goal.position(arm.fk(q)[:3, 3])))
    assert whole.solutions == 1
    narrow = arm.upper.copy()
    narrow[1] = q[1] - 0.5e-6
    cut = isolate(Problem(replace(arm.chain, upper=narrow), Goal.position(arm.fk(q)[:3, 3])))
    assert len(cut.q) == 1
    assert not cut.exact.any()
    assert cut.solutions is None


@pytest.mark.parametrize("name", ["planar2", "cylindrical3"])
def test_the_distance_reaches_from_edge_to_edge(name: str) -> None:
    """Answers fill a region. One at its edge is given, and one at the opposite edge is as near as is claimed."""
    arm, rng, place = kinseek.load(name), np.random.default_rng(5), 1e-6
    for _ in range(5):
        q = arm.lower + rng.uniform(0.1, 0.4, arm.dof) * (arm.upper - arm.lower)
        goal = Goal.position(arm.fk(q)[:3, 3], position_tolerance=place)
        inverse = np.linalg.pinv(arm.jacobian(q)[:3])
        for row in inverse:  # The motion of the tip that moves this joint most.
            step = inverse @ (0.99 * place * row / np.linalg.norm(row))
            isolation = isolate(Problem(arm.chain, goal), (q + step)[None])
            assert isolation.complete
            assert errors(fk(arm.chain, q - step), goal)[0] <= place
            assert holds(isolation, arm.chain, q - step)


def test_the_distance_of_a_last_joint_counts_the_tolerance_at_both_ends() -> None:
    arm, turn = kinseek.load("scara4"), 1e-3
    q = np.array([0.3, 0.9, 0.5 * (arm.lower[2] + arm.upper[2]), 0.2])
    goal = Goal.pose(arm.fk(q), position_tolerance=1e-9, orientation_tolerance=turn)
    last = 0.99 * turn * np.eye(4)[3]
    isolation = isolate(Problem(arm.chain, goal), (q + last)[None])
    assert isolation.complete
    assert holds(isolation, arm.chain, q - last)


@pytest.mark.parametrize(("apart", "count"), [(0.5e-6, None), (TURN, None), (TURN + 0.5e-6, None), (3e-6, 2)])
def test_two_answers_that_may_be_one_solution_are_not_counted_as_two(apart: float, count: int | None) -> None:
    q = np.array([[0.1], [0.1 + apart]])
    isolation = Isolation(
        complete=True,
        q=q,
        distance=np.full((2, 1), 1e-6),
        given=np.arange(2),
        exact=np.ones(2, dtype=np.bool_),
        boxes=0,
        undecided=0,
        periodic=np.ones(1, dtype=np.bool_),
    )
    assert isolation.solutions == count


@pytest.mark.parametrize(
    ("name", "q"),
    [
        ("so101", np.full(5, 0.3)),  # Fewer joints than constraints: a solution is an accident.
        ("ur5e", np.array([0.3, -1.0, 0.0, 0.4, 0.8, 0.1])),  # Singular.
        ("panda", np.array([0.1, 0.2, 0.3, -1.0, 0.2, 1.0, 0.3])),  # A joint to spare.
    ],
)
def test_no_solution_is_claimed_where_none_can_be_counted(name: str, q: Array) -> None:
    arm = kinseek.load(name)
    isolation = isolate(Problem(arm.chain, Goal.pose(arm.fk(q))), q[None], budget=20_000)
    assert not isolation.exact[0]
    assert isolation.solutions is None
