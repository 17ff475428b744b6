"""Proofs of random goals on random arms, with poor answers handed in: no bound may be above the error of a known pose.

    python -m tests.fuzz.proofs --count 300000 --seed 0

Arms, joint values and goals are drawn where geometry is degenerate: axes that meet, are parallel or point along each other,
joints at their limits and at quarter turns, ranges of exactly a turn, goals turned by exactly π and π/2. A poor answer
matters: a good one leaves the bounds little to do.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinseek import Goal, Problem, Verdict
from kinseek.errors import InternalError, KinseekError
from kinseek.kernels.arm.forward import forward_many
from kinseek.proof.branch_and_bound import prove
from kinseek.proof.reduce import error_question, question, start_boxes
from kinseek.proof.single_boxes import examine, holds
from kinseek.robots.chain import SerialChain
from kinseek.robots.joints import Joint, serial_chain
from kinseek.solution import conclude
from kinseek.support.transforms import rotation, transform

Array = NDArray[np.float64]

TURN = 2 * np.pi
PER_CHAIN = 20
"""Goals asked of each arm."""

KNOWN = 6
"""Joint values of each goal whose errors no bound may exceed, beside the certificate's own."""

BOXES = 8
"""Boxes around the joint values that nearly reach the goal, tested one by one."""

PROGRESS = 10_000
"""How often the long command says how far it is."""

SLACK = 1e-13
"""What rounding may take of a measured error, relative to all lengths; the bounds themselves stay 1e-12 below."""


@dataclass
class Case:
    """One goal, joint values that are known, and how hard to try."""

    chain: SerialChain
    goal: Goal
    q: Array
    """(k, n), the first reaches the goal nearly or exactly, the second is the poor answer."""
    gap: float | None
    budget: int


def angle(rng: np.random.Generator) -> float:
    """Often a quarter turn, or a hair off one [rad]."""
    value = (
        float(rng.integers(-2, 3)) * np.pi / 2 if rng.random() < 0.6 else float(rng.uniform(-np.pi, np.pi))
    )
    return value + (float(rng.normal()) * 10.0 ** rng.uniform(-17, -3) if rng.random() < 0.3 else 0.0)


def axis(rng: np.random.Generator) -> Array:
    """Often one of the frame's own."""
    if rng.random() < 0.7:
        return np.asarray(np.eye(3)[rng.integers(3)] * (1.0 if rng.random() < 0.7 else -1.0))
    vector = rng.normal(size=3)
    return np.asarray(vector / np.linalg.norm(vector))


def limits(rng: np.random.Generator, prismatic: bool, size: float) -> tuple[float, float]:
    """Lower and upper limit: exactly a turn, half of one, many, next to nothing, or anything."""
    if prismatic:
        low = size * float(rng.choice([-1.0, 0.0, rng.uniform(-1, 1)]))
        return low, low + size * float(rng.choice([0.0, 0.3, 1.0, 2.0, rng.uniform(0, 2)]))
    choice = rng.integers(6)
    if choice == 0:
        return -np.pi, np.pi
    if choice == 1:
        return -np.pi / 2, np.pi / 2
    if choice == 2:
        turns = float(rng.choice([2.0, 7.0, 100.0, 4000.0]))
        return -turns, turns
    low = angle(rng)
    return low, low + float(rng.choice([0.0, 1e-9, np.pi / 2, np.pi, rng.uniform(0, 7)]))


def arm(rng: np.random.Generator) -> SerialChain:
    """One to seven joints, sometimes as small as a hair or as large as a country."""
    size = 10.0 ** rng.uniform(-6, 6) if rng.random() < 0.15 else 1.0
    joints = []

    def pose() -> Array:
        place = size * rng.choice([0.0, 0.0, 0.5, 1.0, rng.uniform(-1, 1)], 3)
        return transform(rotation(axis(rng), angle(rng)), place)

    for i in range(int(rng.integers(1, 8))):
        kind = str(rng.choice(["revolute", "revolute", "continuous", "prismatic"]))
        joints.append(Joint(f"j{i}", kind, pose(), axis(rng), *limits(rng, kind == "prismatic", size)))
    tip = pose() if rng.random() < 0.6 else np.eye(4)
    return serial_chain(joints, tip, name="random", base="base", tip="tip")


def joint_values(chain: SerialChain, rng: np.random.Generator) -> Array:
    """Inside the limits, often at one or at a quarter turn, (n,)."""
    q, choice = rng.uniform(chain.lower, chain.upper), rng.random(chain.dof)
    quarter = np.clip(np.round(q / (np.pi / 2)) * np.pi / 2, chain.lower, chain.upper)
    q = np.where(choice < 0.5, quarter, q)
    return np.asarray(np.where(choice < 0.15, chain.lower, np.where(choice < 0.3, chain.upper, q)))


def goal_near(T: Array, size: float, rng: np.random.Generator) -> Goal:
    """A goal that a hand at T, (4, 4), meets, or misses by a little, a quarter turn or half a turn."""
    G = T.copy()
    turn = float(rng.choice([0.0, 0.0, np.pi / 2, np.pi, 10.0 ** rng.uniform(-12, 0.4)]))
    about = rotation(axis(rng), turn)
    G[:3, :3] = about @ G[:3, :3] if rng.random() < 0.5 else G[:3, :3] @ about
    G[:3, 3] += size * axis(rng) * float(rng.choice([0.0, 0.0, 10.0 ** rng.uniform(-12, 0)]))
    kind = str(rng.choice(["pose", "pose", "pose", "pointing", "position"]))
    options: dict[str, Any] = {}
    if rng.random() < 0.5:
        options["position_tolerance"] = size * 10.0 ** rng.uniform(-9, 0)
        options["orientation_tolerance"] = float(
            rng.choice([10.0 ** rng.uniform(-9, 0.5), np.pi / 2, np.pi, 9.0])
        )
    if rng.random() < 0.3:
        options["position_weight"] = 10.0 ** rng.uniform(-3, 3)
        options["orientation_weight"] = 10.0 ** rng.uniform(-3, 3)
    if kind == "pose":
        return Goal.pose(G, **options)
    if kind == "position":
        return Goal.position(G[:3, 3], **options)
    tool = axis(rng)
    return Goal.pointing(G[:3, 3], G[:3, :3] @ tool, tuple(tool), **options)


def cases(count: int, seed: int) -> Iterator[Case]:
    """So many questions, the same ones for the same seed."""
    rng = np.random.default_rng(seed)
    for number in range(count):
        if number % PER_CHAIN == 0:
            chain = arm(rng)
            size = float(np.abs(chain.fixed[:, :, 3]).max()) or 1.0
        q = np.array([joint_values(chain, rng) for _ in range(KNOWN)])
        T = forward_many(chain.arrays, q[:1])[0]
        gap = rng.choice([0.0, 0.9, 0.5, 0.1, 0.02])
        budget = int(rng.choice([0, 1, 10, 40, 100]))
        yield Case(chain, goal_near(T, size, rng), q, float(gap) or None, budget)


def measured(problem: Problem, q: Array) -> Array:
    """Position errors [m], orientation errors [rad] and weighted errors of joint values (k, n), by plain sums, (k, 3)."""
    goal, T = problem.goal, forward_many(problem.arrays, q)
    G = goal.targets[0]
    far = np.linalg.norm(T[:, :3, 3] - G[:, 3], axis=1)
    apart = 0.5 * ((T[:, :3, :3] - G[:, :3]) ** 2).sum(1)  # 1 - cos of the angle between each two columns.
    turn = np.zeros(len(q))
    if goal.kind == "pose":
        turn = 2 * np.arcsin(np.minimum(np.sqrt(apart.sum(1)) / 2, 1.0))
    elif goal.kind == "pointing":
        turn = 2 * np.arcsin(np.minimum(np.sqrt(apart[:, 0] / 2), 1.0))
    weighted = goal.position_weight * far + goal.orientation_weight * apart[:, : goal.paper_columns].sum(1)
    return np.column_stack([far, turn, weighted])


def reach(problem: Problem) -> float:
    """Sum of all lengths [m]."""
    chain = problem.chain
    slides = sum(
        max(abs(chain.lower[i]), abs(chain.upper[i])) * chain.prismatic[k] for k, i in enumerate(chain.leader)
    )
    lengths = float(np.abs(problem.arrays.fixed[:, :, 3]).sum() + np.abs(problem.goal.targets[0][:, 3]).sum())
    return 1.0 + lengths + float(slides)


def wrong_certificate(case: Case) -> list[str]:
    """Prove with the poor answer handed in; what is wrong with what comes back."""
    chain, goal, problem = case.chain, case.goal, Problem(case.chain, case.goal)
    poor = conclude(problem, case.q[1:2], np.zeros((1, 3), dtype=np.int64))
    proof = prove(problem, gap=case.gap, budget=case.budget, solution=poor, threads=1)
    wrong = []
    if not (np.isfinite(proof.q).all() and (proof.q >= chain.lower).all() and (proof.q <= chain.upper).all()):
        return [f"q {proof.q} outside of {chain.lower} to {chain.upper}"]
    figures = (
        proof.lower_bound,
        proof.upper_bound,
        proof.position_error,
        proof.orientation_error,
        proof.largest_box,
    )
    if not (np.isfinite(figures).all() and min(figures) >= 0.0 and proof.lower_bound <= proof.upper_bound):
        wrong.append(f"figures {figures}")
    errors = measured(problem, np.vstack([case.q, proof.q]))
    slack = SLACK * (goal.position_weight * reach(problem) + goal.orientation_weight)
    if proof.lower_bound > errors[:, 2].min() * (1 + 1e-12) + slack:
        wrong.append(f"lower bound {proof.lower_bound:.6g} above a known error {errors[:, 2].min():.6g}")
    inside = (errors[:, 0] <= goal.position_tolerance * (1 - 1e-9) - SLACK * reach(problem)) & (
        errors[:, 1] <= goal.orientation_tolerance * (1 - 1e-9) - 1e-9
    )
    if goal.kind == "position":
        inside = errors[:, 0] <= goal.position_tolerance * (1 - 1e-9) - SLACK * reach(problem)
    if proof.verdict is Verdict.UNREACHABLE and inside.any():
        wrong.append(f"called unreachable, reached by {errors[inside][0]}")
    if proof.verdict is Verdict.REACHABLE and (
        proof.position_error > goal.position_tolerance or proof.orientation_error > goal.orientation_tolerance
    ):
        wrong.append("a witness that misses a tolerance")
    return wrong


def wrong_boxes(case: Case, rng: np.random.Generator) -> list[str]:
    """Test boxes around the first joint values, by the tolerances and by the weighted error; which of them lose them."""
    problem, wrong, q = Problem(case.chain, case.goal), [], case.q[0]
    place, turn, error = measured(problem, q[None])[0]
    slack = SLACK * (case.goal.position_weight * reach(problem) + case.goal.orientation_weight)
    by_error = bool(rng.random() < 0.6)
    if not by_error:
        met = place <= case.goal.position_tolerance * (1 - 1e-9) - SLACK * reach(problem)
        if not met or (
            case.goal.kind != "position" and turn > case.goal.orientation_tolerance * (1 - 1e-9) - 1e-9
        ):
            by_error = True
    asked, ceiling = question(problem), None
    if by_error:
        whole = bool(rng.random() < 0.3)
        asked = error_question(problem, case.q[1], case.gap or 0.5, whole=whole)
        ceiling = (error + slack) * (1.0 + 10.0 ** rng.uniform(-12, 1))
    form, _, roll = asked
    start = start_boxes(case.chain, roll.present)[0]
    count = len(start) // 2
    h = start[count:] * 10.0 ** (-rng.uniform(0, 12, (BOXES, 1)) * (rng.random((BOXES, count)) < 0.7))
    off = rng.uniform(-1, 1, (BOXES, count))
    off = np.where(rng.random((BOXES, count)) < 0.3, np.sign(off), off)
    seen = q[:count] - start[:count]
    seen -= np.where(np.abs(seen) > start[count:], np.round(seen / TURN) * TURN, 0.0)
    seen += start[:count]
    centre = seen - off * h
    quarter = np.round(centre / (np.pi / 2)) * np.pi / 2
    centre = np.where((rng.random(centre.shape) < 0.3) & (np.abs(quarter - seen) <= h), quarter, centre)
    h = h + 1e-15 * (1 + np.abs(centre) + h)
    examined = examine(problem, asked, np.hstack([centre, h]), ceiling, int(rng.integers(0, 3)))
    given_up = int(np.isnan(examined.left).all(axis=(1, 2)).sum())
    mode = f"by {'the error' if by_error else 'the tolerances'}, form {form.head, form.columns, form.tail, roll.present}"
    if given_up:
        wrong.append(f"{given_up} boxes given up that hold a pose, {mode}")
    elif not (np.isfinite(examined.left).all() and np.isfinite(examined.lower).all()):
        wrong.append(f"a box that is not finite, {mode}")
    elif not holds(form, examined.left, seen, 1e-13 * (1 + np.abs(seen))).all():
        wrong.append(f"a box cut so that it loses a pose, {mode}")
    elif ceiling is not None and (examined.lower > min(error, ceiling) * (1 + 1e-12) + slack).any():
        wrong.append(f"a box bounded by {examined.lower.max():.6g} that holds an error {error:.6g}, {mode}")
    return wrong


def wrong_cases(count: int, seed: int) -> Iterator[tuple[int, Case, list[str]]]:
    """Every case in which something is wrong, with its number."""
    rng = np.random.default_rng((seed, 1))
    for number, case in enumerate(cases(count, seed)):
        if number and number % PROGRESS == 0:
            print(f"{number} proofs", file=sys.stderr, flush=True)
        try:
            wrong = wrong_certificate(case) + wrong_boxes(case, rng)
        except InternalError as error:  # A proof has found a wrong bound itself.
            wrong = [f"InternalError: {error}"]
        except KinseekError:
            wrong = []
        except Exception as error:  # Anything else is what this looks for.
            wrong = [f"{type(error).__name__}: {error}"]
        if wrong:
            yield number, case, wrong


def main() -> int:
    """Print what is wrong, and how many cases ran; the exit status is 1 if anything is."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--count", type=int, default=300_000, help="proofs")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--most", type=int, default=20, help="stop after so many wrong ones")
    given = parser.parse_args()
    begin, bad = time.perf_counter(), 0
    for number, case, wrong in wrong_cases(given.count, given.seed):
        bad += 1
        what = f"{case.chain.dof} joints, {case.goal.kind}, gap {case.gap}, budget {case.budget}"
        print(f"case {number}: {what}", *wrong, sep="\n    ", flush=True)
        if bad == given.most:
            print(f"stopped in case {number}")
            return 1
    took = time.perf_counter() - begin
    print(f"{given.count} proofs and {given.count * BOXES} boxes in {took:.0f} s, {bad} wrong")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
