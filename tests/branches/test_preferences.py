"""What to prefer: choosing among branches, sliding along the self-motion, and predicates that refuse."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import kinseek
from benchmarks.targets import plain_fk, random_joints, strict
from kinseek import Goal, InvalidProblem, NotReached, Status
from kinseek.branches.order import ORDERS, Order, scores
from kinseek.derivatives import constraint_jacobian, freedom
from kinseek.problem import Problem

Array = NDArray[np.float64]


def score(arm: kinseek.Arm, target: Array, q: Array, order: str) -> float:
    return float(scores(Problem(arm.chain, Goal.pose(target)), q[None], order, None)[0])


def test_an_order_without_a_measure_is_an_error() -> None:
    """Not the order by the middle of the ranges under another name."""
    arm = kinseek.load("ur5e")
    with pytest.raises(KeyError):
        score(arm, arm.fk(np.zeros(6)), np.zeros(6), "new")


@pytest.mark.parametrize("order", ORDERS)
def test_the_place_of_an_order_in_the_list_means_nothing(
    order: Order, monkeypatch: pytest.MonkeyPatch
) -> None:
    arm = kinseek.load("ur5e")
    targets = plain_fk(arm.chain, random_joints(arm.chain, 20, 43))
    before = arm.branches(targets, order=order).q
    for module in ("find", "prefer"):
        monkeypatch.setattr(f"kinseek.branches.{module}.ORDERS", (order, *ORDERS))
    np.testing.assert_array_equal(arm.branches(targets, order=order).q, before)


@pytest.mark.parametrize("order", ORDERS)
def test_six_joints_take_the_best_branch(order: Order) -> None:
    arm = kinseek.load("ur5e")
    for target in plain_fk(arm.chain, random_joints(arm.chain, 20, 41)):
        solution = arm.ik(target, prefer=order)
        branches = arm.branches(target, order=order)
        assert isinstance(branches, kinseek.Branches)
        assert solution.success
        assert solution.rejected == 0
        np.testing.assert_array_equal(solution.q, branches.q[0])


@pytest.mark.slow
@pytest.mark.parametrize("name", ["panda", "gen3"])
@pytest.mark.parametrize("order", ORDERS)
def test_joints_to_spare_slide_to_what_is_better_than_any_sample(name: str, order: Order) -> None:
    arm = kinseek.load(name)
    better = 0
    for target in plain_fk(arm.chain, random_joints(arm.chain, 5, 42)):
        solution = arm.ik(target, prefer=order)
        assert solution.success
        assert strict(arm.chain, solution.q[None], target[None]).all()
        sample = arm.branches(target)
        assert isinstance(sample, kinseek.Branches)
        best = min(score(arm, target, q, order) for q in sample)
        mine = score(arm, target, solution.q, order)
        assert mine <= best + 1e-12
        better += mine < best - 1e-9
    assert better >= 4


def test_a_slide_ends_where_the_cost_is_stationary() -> None:
    arm = kinseek.load("panda")
    target = arm.fk([0.1, 0.2, 0.3, -1.5, 0.2, 1.5, 0.3])
    wanted = np.array([0.3, 0.3, 0.3, -1.5, 0.2, 1.5, 0.3])

    def cost(q: Array) -> Array:
        return np.asarray(((q - wanted) ** 2).sum(axis=1))

    solution = arm.ik(target, cost=cost)
    assert solution.success
    J = constraint_jacobian(Problem(arm.chain, Goal.pose(target)), solution.q[None])[0]
    null = np.linalg.svd(J)[2][6]
    assert abs(2 * (solution.q - wanted) @ null) < 1e-2
    dense = arm.branches(target, count=1000, cost=cost)
    assert isinstance(dense, kinseek.Branches)
    assert cost(solution.q[None])[0] <= cost(dense.q[:1])[0] + 1e-9


def test_a_position_leaves_room_to_choose() -> None:
    arm = kinseek.load("ur5e")
    goal = Goal.position([0.3, 0.3, 0.4])
    solution = arm.ik(goal, prefer="limits")
    assert solution.success
    assert np.abs(solution.q / np.pi).max() < 1.0


def test_a_cost_may_choose_a_full_turn() -> None:
    arm = kinseek.load("ur5e")
    q = np.array([0.3, -1.2, 1.4, -0.8, 1.1, 0.2])
    solution = arm.ik(arm.fk(q), cost=lambda q: q[:, 0])
    assert solution.success
    assert solution.q[0] < -np.pi


def test_valid_is_asked_in_order_until_it_agrees() -> None:
    arm = kinseek.load("ur5e")
    target = arm.fk([0.3, -1.2, 1.4, -0.8, 1.1, 0.2])
    asked: list[Array] = []

    def valid(q: Array) -> bool:
        asked.append(q)
        return len(asked) == 3

    solution = arm.ik(target, valid=valid)
    branches = arm.branches(target)
    assert isinstance(branches, kinseek.Branches)
    assert solution.success
    assert solution.rejected == 2
    assert solution.status is Status.SOLVED
    np.testing.assert_array_equal(asked, branches.q[:3])
    np.testing.assert_array_equal(solution.q, branches.q[2])
    near = arm.ik(target, near=branches.q[5], valid=lambda q: True)
    np.testing.assert_allclose(near.q, branches.q[5], atol=1e-9)


def test_where_valid_never_agrees_there_is_no_success() -> None:
    for name in ("ur5e", "panda"):
        arm = kinseek.load(name)
        target = plain_fk(arm.chain, random_joints(arm.chain, 1, 43))[0]
        solution = arm.ik(target, valid=lambda q: False)
        branches = arm.branches(target)
        assert isinstance(branches, kinseek.Branches)
        assert not solution.success
        assert solution.status is Status.REJECTED
        assert solution.rejected == len(branches)
        assert solution.position_error <= 1e-6  # What it holds is an answer, only a refused one.
        with pytest.raises(NotReached, match=f"`valid` rejected {len(branches)} solutions"):
            solution.require()


def test_a_slide_asks_valid_too() -> None:
    arm = kinseek.load("panda")
    target = arm.fk([0.1, 0.2, 0.3, -1.5, 0.2, 1.5, 0.3])
    free = arm.ik(target, prefer="mid-range")
    bound = free.q[0] + 0.3

    def valid(q: Array) -> bool:
        return bool(q[0] > bound)

    solution = arm.ik(target, prefer="mid-range", valid=valid)
    assert solution.success
    assert valid(solution.q)
    assert solution.rejected > 0


def test_what_is_out_of_reach_is_best_effort_and_nobody_is_asked() -> None:
    arm = kinseek.load("ur5e")
    target = np.eye(4)
    target[:3, 3] = 5.0, 0.0, 0.0

    def valid(q: Array) -> bool:
        raise AssertionError

    solution = arm.ik(target, prefer="limits", valid=valid)
    assert not solution.success
    assert solution.status is Status.BEST_EFFORT
    assert solution.rejected == 0
    np.testing.assert_array_equal(solution.q, arm.ik(Goal.pose(target)).q)


def test_a_batch_is_each_of_its_goals() -> None:
    arm = kinseek.load("ur5e")
    targets = plain_fk(arm.chain, random_joints(arm.chain, 12, 44)).reshape(3, 4, 4, 4)
    targets[1, 1, :3, 3] = 9.0

    def valid(q: Array) -> bool:
        return bool(q[2] > 0.5)

    batch = arm.ik(targets, prefer="dexterity", valid=valid)
    assert batch.success.shape == batch.rejected.shape == batch.status.shape == (3, 4)
    seen = set()
    for index in np.ndindex(3, 4):
        single = arm.ik(targets[index], prefer="dexterity", valid=valid)
        np.testing.assert_array_equal(batch.q[index], single.q)
        assert batch.status[index] is single.status
        assert batch.rejected[index] == single.rejected
        seen.add(single.status)
    assert batch.status[1, 1] is Status.BEST_EFFORT
    assert Status.SOLVED in seen
    assert arm.ik(np.zeros((0, 4, 4)), prefer="limits").q.shape == (0, 6)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"prefer": "speed"}, "unknown preference 'speed'.*dexterity"),
        ({"prefer": "near"}, "unknown preference 'near'.*give near=$"),
        ({"prefer": [0.0] * 6}, "unknown preference.*give near=$"),
        ({"prefer": "limits", "cost": lambda q: q[:, 0]}, "prefer and cost"),
        ({"prefer": "limits", "near": np.zeros(7)}, "near and prefer"),
        ({"prefer": "limits", "solver": kinseek.Atlas()}, "solver= cannot be combined"),
        ({"cost": lambda q: np.full(len(q), np.nan)}, r"cost returned NaN for q = \["),
        ({"cost": lambda q: q}, r"cost must take \(k, n\)"),
        ({"valid": lambda q: None}, r"valid must return a bool, got None for q = \["),
        ({"valid": lambda q: 1 / 0}, r"valid raised ZeroDivisionError.*q = \["),
    ],
)
def test_misuse_is_named(options: dict[str, Any], words: str) -> None:
    arm = kinseek.load("panda")
    with pytest.raises(InvalidProblem, match=words):
        arm.ik(arm.fk([0.1, 0.2, 0.3, -1.5, 0.2, 1.5, 0.3]), **options)


def test_freedom_counts_joints_to_spare() -> None:
    pose, place = Goal.pose(np.eye(4)), Goal.position([0.0, 0.0, 0.0])
    ahead = Goal.pointing([0.0, 0.0, 0.0], [0.0, 0.0, 1.0])
    for name, expected in (
        ("ur5e", (0, 3, 1)),
        ("panda", (1, 4, 2)),
        ("planar2", (0, 0, 0)),
        ("planar5", (2, 3, 3)),
    ):
        chain = kinseek.load(name).chain
        assert tuple(freedom(Problem(chain, goal)) for goal in (pose, place, ahead)) == expected
