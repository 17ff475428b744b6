"""Rounding in proofs: its derived bounds; certificates checked anew by interval arithmetic that shares no code."""

from __future__ import annotations

import importlib
import math
from dataclasses import replace
from typing import Any

import kinseek
import numpy as np
import pytest
from kinseek import Goal, Problem, Verdict
from kinseek.kernels.arm.forward import forward_many
from kinseek.proof.branch_and_bound import prove
from kinseek.proof.reduce import margins, sizes_of
from kinseek.proof.rounding import UNIT, Sizes, gamma, of_axes, of_points
from kinseek.robots.chain import SerialChain
from numpy.typing import NDArray

Array = NDArray[np.float64]

pytest.importorskip("flint")
flint: Any = importlib.import_module("flint")
arb, arb_mat = flint.arb, flint.arb_mat

MOST_BOXES = 60_000


def ball(middle: float, half: float = 0.0) -> Any:
    """All numbers within `half` of a middle, and no fewer."""
    return arb(middle, half)


def joint_balls(q: Array, half: Array) -> list[Any]:
    return [ball(float(c), float(h)) for c, h in zip(q, half, strict=True)]


def poses_of(chain: SerialChain, q: list[Any]) -> tuple[Any, list[Any]]:
    """Rigorous pose of the tip for all joint values of some balls, (4, 4); and the frames of the joints."""
    T, frames = arb_mat(np.eye(4).tolist()), []
    for k, A in enumerate(chain.fixed):
        T = T * arb_mat([*A.tolist(), [0.0, 0.0, 0.0, 1.0]])
        if k == len(chain.leader):
            break
        frames.append(T)
        value = arb(float(chain.multiplier[k])) * q[chain.leader[k]] + arb(float(chain.offset[k]))
        if chain.prismatic[k]:
            J = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, value], [0, 0, 0, 1]]
        else:
            c, s = value.cos(), value.sin()
            J = [[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
        T = T * arb_mat(J)
    return T, frames


def least(value: Any) -> float:
    """No number of a ball is smaller."""
    return float(value.lower())


def errors_below(T: Any, goal: Goal) -> tuple[float, float, float]:
    """No pose of a ball is nearer to the goal: position [m], turn [rad], weighted error."""
    G = goal.targets[0]
    far = arb(0)
    for r in range(3):
        far += (T[r, 3] - arb(float(G[r, 3]))).abs_lower() ** 2
    apart = []
    for c in range(3):
        chord = arb(0)
        for r in range(3):
            chord += (T[r, c] - arb(float(G[r, c]))).abs_lower() ** 2
        apart.append(chord / 2)
    distance = far.sqrt()
    turn = 0.0
    if goal.kind == "pose":  # 1 - cos of the turn is half of what the columns are apart, together.
        turn = 2.0 * math.asin(min(math.sqrt(max(least(sum(apart) / 4), 0.0)), 1.0)) * (1 - 1e-12)
    weighted = arb(float(goal.position_weight)) * distance
    for c in range(goal.paper_columns):
        weighted += arb(float(goal.orientation_weight)) * apart[c]
    return least(distance), turn, least(weighted)


def all_boxes_keep_away(chain: SerialChain, goal: Goal, lower_bound: float | None) -> bool:
    """Does every box of an independent subdivision miss a tolerance, or keep a weighted error above a bound?"""
    left = [((chain.lower + chain.upper) / 2, (chain.upper - chain.lower) / 2 * (1 + 1e-15))]
    for _ in range(MOST_BOXES):
        if not left:
            return True
        c, h = left.pop()
        far, turn, weighted = errors_below(poses_of(chain, joint_balls(c, h))[0], goal)
        if lower_bound is None:
            gone = far > goal.position_tolerance or turn > goal.orientation_tolerance
        else:
            gone = weighted >= lower_bound
        if not gone:
            i = int(np.argmax(h))
            half = h.copy()
            half[i] /= 2
            wide = half * (1 + 1e-15)
            for sign in (-1, 1):
                middle = c.copy()
                middle[i] += sign * half[i]
                left.append((middle, wide))
    return False


TWO = kinseek.load("planar2")
THREE = kinseek.Arm.from_dh([(1, 0, 0, 0), (0.7, 0, 0, 0), (0.4, 0, 0, 0)], [-2, -1.5, -1], [2, 1.5, 1])
ROUND = kinseek.load("cylindrical3")
SKEW = kinseek.Arm.from_dh(
    [(0.3, 1.2, 0.2, 0), (0.5, 0.4, 0.1, 0), (0.2, 0, 0.1, 0)], [-2.5, -2, -1], [2.5, 2, 1]
)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arm", "kind"),
    [(TWO, "position"), (THREE, "position"), (THREE, "pose"), (SKEW, "position"), (SKEW, "pose")],
)
def test_verdicts_hold_in_interval_arithmetic(arm: kinseek.Arm, kind: str) -> None:
    """Goals that miss what is reached by a few centimetres or tenths of a radian; box after box, with other bounds."""
    rng, checked = np.random.default_rng(0), 0
    for _ in range(12):
        T = arm.fk(rng.uniform(arm.lower, arm.upper))
        T[:3, 3] += rng.normal(size=3) * 0.4
        goal = Goal(T, kind, position_tolerance=0.02, orientation_tolerance=0.05)
        problem = Problem(arm.chain, goal)
        found = prove(problem, gap=0.5)
        if found.verdict is Verdict.REACHABLE or found.upper_bound < 0.1:
            continue
        checked += 1
        assert found.verdict is Verdict.UNREACHABLE
        assert all_boxes_keep_away(arm.chain, goal, None)
        assert found.lower_bound > 0.0
        assert all_boxes_keep_away(arm.chain, goal, found.lower_bound)
        if checked == 3:
            break
    assert checked >= 2


def test_the_check_by_intervals_can_fail() -> None:
    """A goal in reach is not said to be out of it, and a bound above the least error is noticed."""
    T = TWO.fk([0.4, 0.8])
    goal = Goal(T, "position", position_tolerance=1e-3)
    T[2, 3] += 0.3
    out = Goal(T, "position", position_tolerance=1e-3)
    found = prove(Problem(TWO.chain, out))
    global_most = globals()["MOST_BOXES"]
    try:
        globals()["MOST_BOXES"] = 800
        assert not all_boxes_keep_away(TWO.chain, goal, None)
        assert all_boxes_keep_away(TWO.chain, out, None)
        assert not all_boxes_keep_away(TWO.chain, out, found.upper_bound * 1.01)
    finally:
        globals()["MOST_BOXES"] = global_most


@pytest.mark.parametrize("name", ["planar2", "scara4", "ur5e", "panda", "ur10e_rail", "atlas_torso_arm"])
def test_rounding_of_a_pose_stays_below_its_bound(name: str) -> None:
    """Poses of the kernels against 200 bits, and against a bound a thousand times smaller, which is too small."""
    chain, rng = kinseek.load(name).chain, np.random.default_rng(1)
    q = rng.uniform(chain.lower, chain.upper, (20, chain.dof))
    T, sizes = forward_many(chain.arrays, q), sizes_of(Problem(chain, Goal.pose(np.eye(4))))
    turned = moved = 0.0
    flint.ctx.prec, before = 200, flint.ctx.prec
    try:
        for k in range(len(q)):
            exact = poses_of(chain, joint_balls(q[k], np.zeros(chain.dof)))[0]
            off = np.array(
                [[float(exact[r, c] - arb(float(T[k, r, c]))) for c in range(4)] for r in range(3)]
            )
            turned, moved = (
                max(turned, float(np.linalg.norm(off[:, :3]))),
                max(moved, float(np.linalg.norm(off[:, 3]))),
            )
    finally:
        flint.ctx.prec = before
    assert of_axes(sizes) / 1000 < turned < of_axes(sizes)
    assert of_points(sizes) / 1000 < moved < of_points(sizes)


def test_margins_grow_with_joints_angles_lengths_and_defects() -> None:
    base = Sizes(joints=6, angles=20.0, rate=6.0, reach=2.0, defect=0.0)
    here = margins_of(base)
    for more in (
        base._replace(joints=7),
        base._replace(angles=1e5),
        base._replace(reach=3.0),
        base._replace(defect=1e-9),
        base._replace(rate=60.0),
    ):
        assert margins_of(more) > here
    # Angles and defects of rotations count in full; for an arm of six joints a margin is some 1e-12.
    assert margins_of(base._replace(defect=1e-9))[1] > 1e-9
    assert 1e-13 < here[0] < 1e-11
    assert 1e-13 < here[1] < 1e-11
    assert gamma(1) > UNIT


def margins_of(sizes: Sizes) -> tuple[float, float]:
    from kinseek.proof.rounding import margins as of_sizes

    return of_sizes(sizes)


def test_a_matrix_that_is_nearly_a_rotation_widens_the_margin() -> None:
    chain = kinseek.load("ur5e").chain
    problem = Problem(chain, Goal.pose(np.eye(4)))
    askew = chain.fixed.copy()
    askew[2, :, :3] *= 1 + 1e-10

    other = Problem(replace(chain, fixed=askew), Goal.pose(np.eye(4)))
    assert margins(other)[1] > margins(problem)[1] + 1e-10
