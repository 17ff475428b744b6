"""The bounds of branch and bound: no joint vector of a box may escape them, and a bound too small must be noticed."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import kinseek
from chains import awkward_joints, serial_chains
from kinseek import Goal, Problem
from kinseek.kernels.jit import exposed
from kinseek.kernels.proof.box import chord_of
from kinseek.proof.reduce import error_question, question, start_boxes
from kinseek.proof.single_boxes import examine, holds
from kinseek.robots.catalog import catalog_names
from kinseek.robots.chain import SerialChain
from reference import fk, weighted_error

Array = NDArray[np.float64]

ARMS = ("planar2", "scara4", "cylindrical3", "panda", "ur5e", "jaco2_6", "ur10e_rail", "pr2_left", "wx250s")
BOXES = 60
TURN = 2 * np.pi


def boxes_around(chain: SerialChain, q: Array, start: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """Boxes of all sizes that hold q, some at a face or a corner: boxes, (k, 2 dof), and q as they see it."""
    count = len(start) // 2
    middle, half = start[:count], start[count:]
    away = q[:count] - middle
    away -= np.where(np.abs(away) > half, np.round(away / TURN) * TURN, 0.0)
    inside = middle + away
    narrow = 10.0 ** (-rng.uniform(0, 7, (BOXES, 1)) * (rng.random((BOXES, count)) < 0.8))
    h = half * narrow
    off = rng.uniform(-1, 1, (BOXES, count))
    off = np.where(rng.random((BOXES, count)) < 0.3, np.sign(off), off)
    c = inside - off * h
    return np.ascontiguousarray(np.hstack([c, h + 2e-15 * (1 + np.abs(c))])), inside


def moved(T: Array, rng: np.random.Generator, place: float, angle: float) -> Array:
    """A pose `place` [m] and `angle` [rad] away."""
    result = T.copy()
    shift, axis = rng.normal(size=(2, 3))
    result[:3, 3] += place * shift / np.linalg.norm(shift)
    result[:3, :3] = Rotation.from_rotvec(angle * axis / np.linalg.norm(axis)).as_matrix() @ result[:3, :3]
    return result


def goal_near(T: Array, rng: np.random.Generator, place: float, angle: float, **tolerances: Any) -> Goal:
    """A goal of a random kind that a hand at T misses by no more than `place` and `angle`."""
    G = moved(T, rng, place, angle)
    kind = str(rng.choice(["pose", "pose", "pointing", "position"]))
    if kind == "pose":
        return Goal.pose(G, **tolerances)
    if kind == "position":
        return Goal.position(G[:3, 3], **tolerances)
    axis = rng.normal(size=3)
    return Goal.pointing(G[:3, 3], G[:3, :3] @ axis, tuple(axis), **tolerances)


def reachable_lost(chain: SerialChain, rng: np.random.Generator, trust: float = 1.0) -> int:
    """Ask for what a joint vector reaches, at the edge of the tolerances; count boxes that lose it."""
    q = awkward_joints(chain, rng)
    place, angle = 10.0 ** rng.uniform(-6, -2, 2)
    edge = 0.999999 * rng.integers(0, 2)
    goal = goal_near(
        fk(chain, q), rng, edge * place, edge * angle, position_tolerance=place, orientation_tolerance=angle
    )
    return boxes_that_lose(chain, goal, q, rng, trust)


def cone_lost(chain: SerialChain, rng: np.random.Generator, trust: float = 1.0) -> int:
    """Ask for a point and a wide cone of directions, with a joint vector at the edge of both; count boxes that lose it."""
    q = awkward_joints(chain, rng)
    T, (axis, shift, other) = fk(chain, q), rng.normal(size=(3, 3))
    place, angle = 10.0 ** rng.uniform(-6, -2), rng.uniform(0.31, np.pi)
    edge = 0.999999 * rng.integers(0, 2)
    across = np.cross(T[:3, :3] @ axis, other)
    direction = Rotation.from_rotvec(edge * angle * across / np.linalg.norm(across)).apply(T[:3, :3] @ axis)
    point = T[:3, 3] + edge * place * shift / np.linalg.norm(shift)
    tolerances: Any = {"position_tolerance": place, "orientation_tolerance": angle}
    return boxes_that_lose(chain, Goal.pointing(point, direction, tuple(axis), **tolerances), q, rng, trust)


def boxes_that_lose(chain: SerialChain, goal: Goal, q: Array, rng: np.random.Generator, trust: float) -> int:
    problem = Problem(chain, goal)
    asked = question(problem, trust)
    boxes, inside = boxes_around(chain, q, start_boxes(chain, asked[2].present)[0], rng)
    return int((~holds(asked[0], examine(problem, asked, boxes).left, inside, 1e-13)).sum())


def nearest_lost(chain: SerialChain, rng: np.random.Generator, trust: float = 1.0) -> int:
    """Ask for any pose, with any weights and the error of a joint vector as the ceiling; count boxes that lose it."""
    q = awkward_joints(chain, rng)
    T = fk(chain, q)
    weights: Any = dict(
        zip(("position_weight", "orientation_weight"), 10.0 ** rng.uniform(-1, 1, 2), strict=True)
    )
    goal = goal_near(T, rng, 10.0 ** rng.uniform(-3, 0), 10.0 ** rng.uniform(-3, 0.3), **weights)
    error = weighted_error(T, goal)
    problem = Problem(chain, goal)
    asked = error_question(problem, q, rng.choice([0.01, 0.99]), trust)
    boxes, inside = boxes_around(chain, q, start_boxes(chain, asked[2].present)[0], rng)
    ceiling, passes = error * (1 + 1e-12) + 1e-12, int(rng.integers(0, 3))
    examined = examine(problem, asked, boxes, ceiling, passes)
    gone = ~holds(asked[0], examined.left, inside, 1e-13)
    return int((gone | (examined.lower > error + 1e-11)).sum())


@pytest.mark.slow
@pytest.mark.parametrize("name", catalog_names())
def test_no_box_loses_what_it_holds(name: str) -> None:
    """A hundred thousand joint vectors over all arms, each in a box; `tests.fuzz.proofs` tries more."""
    chain, rng = kinseek.load(name).chain, np.random.default_rng(0)
    assert sum(reachable_lost(chain, rng) for _ in range(20)) == 0
    assert sum(cone_lost(chain, rng) for _ in range(15)) == 0
    assert sum(nearest_lost(chain, rng) for _ in range(20)) == 0


@pytest.mark.slow
@settings(max_examples=60)
@given(chain=serial_chains(), seed=st.integers(0, 2**32 - 1))
def test_no_box_loses_what_it_holds_on_any_chain(chain: SerialChain, seed: int) -> None:
    rng = np.random.default_rng(seed)
    assert sum(reachable_lost(chain, rng) for _ in range(3)) == 0
    assert sum(cone_lost(chain, rng) for _ in range(3)) == 0
    assert sum(nearest_lost(chain, rng) for _ in range(3)) == 0


@pytest.mark.slow
@pytest.mark.parametrize("name", ARMS)
def test_bounds_one_percent_too_small_are_caught(name: str) -> None:
    chain, rng = kinseek.load(name).chain, np.random.default_rng(0)
    assert any(reachable_lost(chain, rng, trust=0.99) for _ in range(40))
    assert any(cone_lost(chain, rng, trust=0.99) for _ in range(30))
    assert any(nearest_lost(chain, rng, trust=0.99) for _ in range(40))


@pytest.mark.jit
def test_the_chord_is_an_upper_bound_and_tight() -> None:
    bound = exposed(chord_of)
    for angle in np.linspace(0, 4, 4001):
        chord = 2 * np.sin(min(angle, np.pi) / 2)
        assert chord - 1e-15 <= bound(float(angle)) <= chord * 1.01 + 1e-15
