"""Add proofs to a path: continuous steps, poses out of reach, and intervals that no continuous motion passes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from kinseek.kernels.arm.forward import forward_many
from kinseek.kernels.arm.jacobian import jacobian_many
from kinseek.problem import Problem

from .certify import prove_rows, rims_of, turns_between
from .impossible import impossible_pairs
from .joints import Turning
from .missed import Missed, judge_missed
from .path import Path, PathProof, intervals, met
from .request import PathRequest
from .virtual_joints import with_virtual_joints
from .why import these

Array = NDArray[np.float64]

ROUNDS = 4
"""Newton steps for the virtual joints of a goal's ranges; a rotation about one axis and slides take two."""


def with_proofs(request: PathRequest, path: Path, threads: int | None) -> Path:
    """Return the path with what can be proved about it; see `Arm.follow`."""
    part, own = with_virtual_joints(request)
    steps, within = _unbroken(part, own, path, threads)
    missed = ~(met(path) & path.planned)
    report = judge_missed(path, missed, threads, request.deadline)
    impossible = impossible_pairs(part.problem, path, request.deadline) if part is request else ()
    undecided = missed & ~report.out_of_reach
    late = request.deadline.passed
    proof = PathProof(steps, within, report.out_of_reach, undecided, impossible, late)
    return replace(path, proof=proof, why=(*path.why, *_words(path, proof, report)))


def _words(path: Path, proof: PathProof, report: Missed) -> list[str]:
    ranges = path.problem.goal.ranges is not None
    short = (
        "goals with ranges are not proved"
        if ranges
        else "the work that a path may spend on proofs did not suffice"
    )
    short = "the time limit was reached" if proof.out_of_time and not ranges else short
    said = [
        (proof.out_of_reach, "proved out of reach: no joint values inside the limits meet the tolerances"),
        (
            report.in_reach,
            "in reach, although the path misses them: some joint values meet the tolerances",
        ),
        (proof.undecided & ~report.in_reach, f"not proved out of reach: {short}"),
    ]
    words = [f"{these(*rows)} {what}" for flags, what in said for rows in intervals(flags)]
    return words + [
        f"proved: no continuous motion inside the limits leads from pose {i} to pose {j}"
        for i, j in proof.impossible
    ]


def _unbroken(
    request: PathRequest, own: slice, path: Path, threads: int | None
) -> tuple[NDArray[np.bool_], Array]:
    """Return flags of the continuous steps, (N - 1,) or (N,), and how close the branches pass to each pose, (N,)."""
    problem = request.problem
    count, goal, q = len(path), problem.goal, _with_goal_joints(problem, own, path.q)
    last = count if path.closed and count > 1 else count - 1
    if last == count:
        back = q[-1] + Turning(problem.chain).way(q[0] - q[-1])
        q = np.concatenate([q, back[None]])
        problem = Problem(problem.mechanism, goal.at(np.concatenate([goal.target, goal.target[:1]])))
    whole = np.setdiff1d(np.arange(last), path.breaks)
    whole = whole[path.reached[whole] & path.reached[(whole + 1) % count]]
    rims = rims_of(problem, q)
    if last == count:
        rims[0] = rims[-1] = max(rims[0], rims[-1])
    proved = prove_rows(problem, q, whole, keep=True, threads=threads, rims=rims, deadline=request.deadline)
    steps, within = np.zeros(last, dtype=np.bool_), np.full((2, count), np.inf)
    steps[whole] = proved.inside
    within[0, whole[proved.inside]] = proved.within[proved.inside, 0]
    within[1, (whole[proved.inside] + 1) % count] = proved.within[proved.inside, 1]
    known = np.where(np.isinf(within), 0.0, within).max(axis=0)
    return steps, np.where(np.isinf(within).all(axis=0), np.inf, known)


def _with_goal_joints(problem: Problem, own: slice, q: Array) -> Array:
    """Extend joint values of the arm by the virtual joints for the goal's ranges, (N, n) -> (N, more)."""
    dof = problem.chain.dof
    if q.shape[1] == dof:
        return q
    whole = np.zeros((len(q), dof))
    whole[:, own] = q
    others, targets = np.setdiff1d(np.arange(dof), np.arange(dof)[own]), problem.goal.targets
    for _ in range(ROUNDS):
        T = forward_many(problem.arrays, whole)[:, :3]
        turn = turns_between(T, targets, problem.goal.columns)
        off = np.concatenate([targets[:, :, 3] - T[:, :, 3], turn], axis=1)
        step = np.linalg.pinv(jacobian_many(problem.arrays, whole)[:, :, others]) @ off[:, :, None]
        whole[:, others] += step[:, :, 0]
    turning = Turning(problem.chain)
    inside = np.clip(whole, turning.open_lower, turning.open_upper)
    whole[:, others] = turning.unwrapped(inside)[:, others]
    return whole
