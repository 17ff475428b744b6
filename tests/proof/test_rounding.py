"""Rounding in proofs: its derived bounds; certificates checked anew by interval arithmetic that shares no code."""

from __future__ import annotations

import importlib
import math
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import kinseek
from kinseek import Goal, Problem, Verdict
from kinseek.kernels.arm.forward import forward_many
from kinseek.proof.branch_and_bound import prove
from kinseek.proof.reduce import margins, sizes_of
from kinseek.proof.root_isolation import isolate
from kinseek.proof.rounding import UNIT, Sizes, gamma, of_axes, of_points
from kinseek.robots.chain import SerialChain

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


def solution_near(arm: kinseek.Arm, goal: Goal, q: Array) -> Array:
    """Newton's steps from an answer, in doubles."""
    target = goal.targets[0]
    for _ in range(6):
        T = arm.fk(q)
        turn = 0.5 * np.cross(T[:3, :3], target[:, :3], axis=0).sum(axis=1)
        q = q + np.linalg.solve(arm.jacobian(q), np.concatenate([target[:, 3] - T[:3, 3], turn]))
    return np.asarray(q)


def krawczyk(chain: SerialChain, goal: Goal, q: Array, half: Array) -> bool:
    """Is exactly one solution within `half` of q? Krawczyk 1969, on six equations: the point, and what is skew of GᵀR."""
    G = arb_mat(goal.targets[0][:, :3].tolist())

    def missed(T: Any) -> list[Any]:
        M = G.transpose() * arb_mat([[T[r, c] for c in range(3)] for r in range(3)])
        point = [T[r, 3] - arb(float(goal.targets[0][r, 3])) for r in range(3)]
        return [*point, M[2, 1] - M[1, 2], M[0, 2] - M[2, 0], M[1, 0] - M[0, 1]]

    def slopes(balls: list[Any]) -> Any:
        T, frames = poses_of(chain, balls)
        J = [[arb(0)] * chain.dof for _ in range(6)]
        for k, frame in enumerate(frames):
            z = [frame[r, 2] for r in range(3)]
            turn = arb_mat([[0, -z[2], z[1]], [z[2], 0, -z[0]], [-z[1], z[0], 0]])
            if chain.prismatic[k]:
                column = [*z, arb(0), arb(0), arb(0)]
            else:
                way = turn * arb_mat([[T[r, 3] - frame[r, 3]] for r in range(3)])
                M = G.transpose() * turn * arb_mat([[T[r, c] for c in range(3)] for r in range(3)])
                skew = [M[2, 1] - M[1, 2], M[0, 2] - M[2, 0], M[1, 0] - M[0, 1]]
                column = [*(way[r, 0] for r in range(3)), *skew]
            for r in range(6):
                J[r][chain.leader[k]] += arb(float(chain.multiplier[k])) * column[r]
        return arb_mat(J)

    nothing = np.zeros(chain.dof)
    at, whole = joint_balls(q, nothing), joint_balls(q, half)
    J = slopes(at)
    Y = np.linalg.inv(np.array([[float(J[r, c].mid()) for c in range(6)] for r in range(6)]))
    y = arb_mat(Y.tolist())
    f = arb_mat([[each] for each in missed(poses_of(chain, at)[0])])
    rest = arb_mat(np.eye(6).tolist()) - y * slopes(whole)
    moved = rest * arb_mat([[ball(0.0, float(h))] for h in half]) - y * f
    # What is skew of GᵀR is zero at half turns too: none is within reach of so small a box.
    near = poses_of(chain, whole)[0]
    trace = sum(
        (near[r, c] * arb(float(goal.targets[0][r, c])) for r, c in product(range(3), repeat=2)), arb(0)
    )
    return bool(least(trace) > 0.0) and all(float(moved[i, 0].abs_upper()) < h for i, h in enumerate(half))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ur5e", "puma560", "jaco2_6"])
def test_exactly_one_solution_near_each_answer_in_interval_arithmetic(name: str) -> None:
    """Every answer of which it is said has exactly one solution within its distance; the list tells how many."""
    arm, rng = kinseek.load(name), np.random.default_rng(7)
    counted = checked = whole = 0
    for _ in range(5):
        goal = Goal.pose(arm.fk(rng.uniform(arm.lower, arm.upper)))
        isolation = isolate(Problem(arm.chain, goal))
        if isolation.solutions is not None:
            counted += 1
            assert isolation.solutions == len(isolation.q)
            assert f"exactly {len(isolation.q)} solutions" in repr(isolation)
        for i in np.flatnonzero(isolation.exact):
            checked += 1
            q, distance = isolation.q[i], isolation.distance[i]
            exact = solution_near(arm, goal, q)
            assert (np.abs(exact - q) <= distance).all()
            assert krawczyk(arm.chain, goal, exact, np.full(6, 1e-9))
            assert not krawczyk(arm.chain, goal, exact + 1e-6, np.full(6, 1e-9))
            # With derivatives over the whole box the test is weaker than κ: it does not bear wide ones.
            if distance.max() < 1e-4:
                whole += 1
                assert krawczyk(arm.chain, goal, q, distance + 1e-12)
    assert counted >= 3
    assert checked >= 5
    assert whole > checked / 2


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


@pytest.mark.parametrize("joints", [1, 6, 10])
def test_the_bounds_are_those_that_the_page_derives(joints: int) -> None:
    """The formulas of docs/proof_explained.md: errors that are met are far smaller, so only this notices a lost term."""
    sizes, u = Sizes(joints=joints, angles=20.0, rate=6.0, reach=2.0, defect=1e-16), 2.0**-53
    g = [k * u / (1 - k * u) for k in range(9)]
    each = 3 * g[3] + 2 * g[2] + 8 * u
    a = 1.01 * ((joints + 4) * each + math.sqrt(2) * g[2] * sizes.angles + sizes.defect)
    e = sizes.reach * (a + math.sqrt(3) * g[4] + (joints + 4) * g[6] + g[8])
    assert of_axes(sizes) == pytest.approx(a, rel=1e-12, abs=0.0)
    assert of_points(sizes) == pytest.approx(e, rel=1e-12, abs=0.0)


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
