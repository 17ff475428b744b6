"""Arms with joints for the ranges of a goal reach its target where the arm itself reaches the goal, and nowhere else."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import kinseek
from kinseek import Goal
from kinseek.errors import InvalidGoal, InvalidProblem
from kinseek.goal import Frame
from kinseek.kernels.arm.forward import forward_many
from kinseek.problem import Problem
from kinseek.ranges import FREE_TURN
from kinseek.robots import SerialChain
from kinseek.virtual_joints import extended

Array = NDArray[np.float64]

TURNS: dict[str, dict[str, Any]] = {
    "none": {},
    "direction": {"free": "rz"},
    "cone": {"free": "rx", "cone": 0.4},
    "wide cone": {"free": "rz", "cone": 2.0},
    "one": {"box": {"rx": (-0.2, 0.3)}},
    "two": {"box": {"rx": (-0.2, 0.3), "ry": (-0.4, 0.1)}},
    "three": {"box": {"rx": (-0.2, 0.2), "ry": (-0.3, 0.1), "rz": (0.1, 0.9)}},
    "three wide": {"box": {"rx": (-2.0, 2.0), "ry": (-1.0, 3.0), "rz": (0.1, 0.9)}},
    "two and a free one": {"free": "rz", "box": {"rx": (-0.2, 0.2), "ry": (-0.3, 0.1)}},
    "two free": {"free": ("rx", "rz")},
    "two free and one": {"free": ("rx", "rz"), "box": {"ry": (-0.5, 0.2)}},
    "any": {"free": ("rx", "ry", "rz")},
}
PLACES: list[dict[str, tuple[float, float]]] = [
    {},
    {"x": (-0.1, 0.2)},
    {"x": (-math.inf, math.inf), "y": (-0.1, 0.1), "z": (0.0, 0.3)},
]


def accepted(goal: Goal, rng: np.random.Generator) -> tuple[Array, Array]:
    """A translation, (3,), and a rotation, (3, 3), that the ranges of a goal accept."""
    assert goal.ranges is not None
    low, high = np.clip(np.array(goal.ranges).T, -1.0, 1.0)
    d = rng.uniform(low[:3], high[:3])
    if goal.swing is not None:
        axis = np.array(goal.swing)
        across = np.cross(axis, rng.normal(size=3))
        tilt = across / np.linalg.norm(across) * goal.cone * rng.random()
        turn = Rotation.from_rotvec(tilt) * Rotation.from_rotvec(axis * rng.uniform(-np.pi, np.pi))
        return d, turn.as_matrix()
    low, high = np.array(goal.ranges)[3:].T
    if goal.ranges[3:] == (FREE_TURN,) * 3:
        return d, Rotation.random(random_state=rng).as_matrix()
    while True:
        w = rng.uniform(low, high)
        if np.linalg.norm(w) < np.pi:
            return d, Rotation.from_rotvec(w).as_matrix()


def target_from(T: Array, d: Array, D: Array, frame: str) -> Array:
    """The target from which a pose T, (4, 4), deviates by d and D."""
    G = np.eye(4)
    if frame == "tool":
        G[:3, :3] = T[:3, :3] @ D.T
        G[:3, 3] = T[:3, 3] - G[:3, :3] @ d
    else:
        G[:3, :3] = D.T @ T[:3, :3]
        G[:3, 3] = T[:3, 3] - d
    return G


def chain_of(name: str) -> SerialChain:
    """The axes of a bundled arm."""
    chain = kinseek.load(name).axes
    assert chain is not None
    return chain


def somewhere(seed: int) -> Array:
    """A pose, (4, 4)."""
    rng = np.random.default_rng(seed)
    return np.asarray(
        kinseek.pose(rng.normal(size=3), rotation=Rotation.random(random_state=rng).as_matrix())
    )


@pytest.mark.parametrize("frame", ["tool", "base"])
@pytest.mark.parametrize("turns", TURNS.values(), ids=TURNS)
def test_what_a_goal_accepts_the_longer_arm_reaches(turns: dict[str, Any], frame: Frame) -> None:
    arm, rng = kinseek.load("ur5e"), np.random.default_rng(1)
    chain = chain_of("ur5e")
    tool = somewhere(2)
    for place, base in itertools.product(PLACES, (None, somewhere(3))):
        options = turns | {"box": turns.get("box", {}) | place, "frame": frame}
        try:
            goal = Goal.pose(np.eye(4), **options, tool=tool, base=base)
        except InvalidGoal:  # Nothing is constrained.
            continue
        if goal.ranges is None:
            continue
        for _ in range(5):
            q = rng.uniform(arm.lower, arm.upper)
            T = arm.fk(q) @ tool
            one = goal.at(target_from(T if base is None else base @ T, *accepted(goal, rng), frame))
            more = extended(Problem(chain, one))
            whole = more.with_virtual(q[None])
            np.testing.assert_array_equal(whole[:, more.own], q[None])
            errors = more.problem.goal.measure(more.problem.arrays, whole)[0]
            assert errors[:2].max() < 1e-7
            assert more.accepts(whole).all()


@pytest.mark.parametrize("turns", TURNS.values(), ids=TURNS)
def test_no_motion_of_the_inner_joints_leaves_the_ranges(turns: dict[str, Any]) -> None:
    """The target of each pose is where the longer arm stands, so the arm's own pose deviates by the virtual joints."""
    goal = Goal.pose(np.eye(4), **turns, frame="tool")
    if goal.ranges is None:
        return
    rng = np.random.default_rng(4)
    try:
        more = extended(Problem(chain_of("ur5e"), goal), inside=True)
    except InvalidProblem:  # Too little would be left of the ranges.
        return
    chain = more.problem.chain
    for q in rng.uniform(chain.lower, chain.upper, (200, chain.dof)):
        T = np.vstack([forward_many(more.problem.arrays, q[None])[0, :3], np.eye(4)[3:]])
        T[:3, :3] = T[:3, :3] @ more.problem.goal.tip_rotation.T
        errors = goal.at(T).measure(more.original.arrays, q[more.own][None])[0]
        assert errors[:2].max() < 1e-7
