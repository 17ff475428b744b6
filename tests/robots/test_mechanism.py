"""What an arm can is said by its mechanism, and asked of it: nobody looks at what class it is."""

from __future__ import annotations

import ast
import pickle
from pathlib import Path

import numpy as np
import pytest

import kinseek
from kinseek import Goal, InvalidProblem, Problem
from kinseek.robots import Mechanism, SerialChain, black_box
from kinseek.solvers.black_box.atlas import solve_target
from kinseek.support.deadline import Deadline

SOURCE = Path(kinseek.__file__).parent
MEMBERS = {name for name in vars(Mechanism) if not name.startswith("_")}


def both(name: str) -> tuple[SerialChain, Mechanism]:
    """A bundled arm, and the function that gives its poses."""
    chain = kinseek.load(name).chain
    kinds = chain.kinds
    return chain, black_box(
        chain.forward, chain.lower, chain.upper, names=chain.joint_names, kinds=kinds, name=name
    )


@pytest.mark.parametrize("name", ["scara4", "jaco2_6", "irb5400"])
def test_both_mechanisms_tell_the_same_of_the_same_arm(name: str) -> None:
    chain, box = both(name)
    assert {"axes", "forward", "endless", "lower"} <= MEMBERS
    assert chain.axes is chain
    assert box.axes is None
    for member in MEMBERS - {"axes", "base", "tip", "rates", "velocity"}:
        if not callable(mine := getattr(chain, member)):
            np.testing.assert_array_equal(mine, getattr(box, member), member)
    q = np.random.default_rng(0).uniform(chain.lower, chain.upper, (5, chain.dof))
    np.testing.assert_array_equal(chain.forward(q), box.forward(q))


@pytest.mark.slow
def test_nobody_outside_the_readers_asks_for_the_class_of_a_mechanism() -> None:
    classes = {"BlackBox", "SerialChain"}
    for path in SOURCE.rglob("*.py"):
        if path.is_relative_to(SOURCE / "robots"):
            continue
        text = path.read_text()
        for node in ast.walk(ast.parse(text)) if any(name in text for name in classes) else ():
            called = node.func.id if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) else ""
            if called in ("isinstance", "issubclass", "cast") or isinstance(node, ast.Compare):
                names = {each.id for each in ast.walk(node) if isinstance(each, ast.Name)}
                words = {each.value for each in ast.walk(node) if isinstance(each, ast.Constant)}
                assert not (names | words) & classes, f"{path}: {ast.unparse(node)}"


def test_a_search_that_needs_poses_alone_runs_on_any_mechanism() -> None:
    chain, box = both("scara4")
    target = chain.forward(np.array([[0.4, 0.9, 0.05, -0.3]]))[0]
    for mechanism in (chain, box):
        found = solve_target(mechanism, Problem(mechanism, Goal.pose(target)), 256, Deadline())
        np.testing.assert_allclose(chain.forward(found.q[None])[0], target, atol=1e-6)


def test_a_function_keeps_its_ways_when_its_limits_are_narrowed() -> None:
    _, box = both("scara4")
    arm = kinseek.Arm(box).with_limits({"elbow": (0.1, 0.2)})
    assert type(arm.mechanism) is type(box)
    assert (arm.lower[1], arm.upper[1]) == (0.1, 0.2)
    again = pickle.loads(pickle.dumps(kinseek.Arm.from_fk(np_turn, [-1.0], [1.0])))
    assert again.axes is None
    assert again.mechanism.name == "black_box"


def np_turn(
    q: np.ndarray[tuple[int, int], np.dtype[np.float64]],
) -> np.ndarray[tuple[int, int, int], np.dtype[np.float64]]:
    T = np.tile(np.eye(4), (len(q), 1, 1))
    T[:, 0, 3] = q[:, 0]
    return T


def test_what_cannot_do_without_axes_is_told_that_there_are_none() -> None:
    chain, box = both("scara4")
    goal = Goal.pose(np.eye(4))
    assert Problem(chain, goal).chain is chain
    assert Problem(box, goal).axes is None
    for thing in (kinseek.Arm(box), Problem(box, goal)):
        with pytest.raises(InvalidProblem, match=r"axes and links.*'scara4' has black-box kinematics"):
            thing.chain  # noqa: B018
