"""Add proofs to a path: continuous steps, poses out of reach, and intervals that no continuous motion passes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from kinseek.problem import Problem
from kinseek.virtual_joints import extended

from .certify import prove_rows, rims_of
from .impossible import impossible_pairs
from .joints import Turning
from .missed import Missed, judge_missed
from .path import Path, PathProof, intervals, met
from .request import PathRequest
from .why import these

Array = NDArray[np.float64]


def with_proofs(request: PathRequest, path: Path, threads: int | None) -> Path:
    """Return the path with what can be proved about it; see `Arm.follow`."""
    part, _ = request.without_ranges()
    steps, within = _unbroken(part, _with_virtual_joints(request, path.q), path, threads)
    missed = ~(met(path) & path.planned)
    report = judge_missed(path, missed, threads, request.deadline)
    impossible = impossible_pairs(part.problem, path, request.deadline) if part is request else ()
    undecided = missed & ~report.out_of_reach
    late = request.deadline.passed
    proof = PathProof(steps, within, report.out_of_reach, undecided, impossible, late)
    return replace(path, proof=proof, why=(*path.why, *_words(path, proof, report)))


def _words(path: Path, proof: PathProof, report: Missed) -> list[str]:
    short = "the work that a path may spend on proofs did not suffice; arm.prove does more for one pose"
    short = "the time limit was reached" if proof.out_of_time else short
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
    request: PathRequest, q: Array, path: Path, threads: int | None
) -> tuple[NDArray[np.bool_], Array]:
    """Examine the path for an arm with joints for ranges, and its joint values, (N, more).

    Returns:
        Flags of the continuous steps, (N - 1,) or (N,), and how close the branches pass to each pose, (N,).
    """
    problem = request.problem
    count, goal = len(path), problem.goal
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


def _with_virtual_joints(request: PathRequest, q: Array) -> Array:
    """Extend joint values of the arm by those of the goal's ranges, which turn without jumps, (N, n) -> (N, more)."""
    if request.problem.goal.ranges is None:
        return q
    more = extended(request.problem, inside=True)
    whole = more.with_virtual(q)
    unwrapped = Turning(more.problem.chain).unwrapped(whole)
    unwrapped[:, more.own] = q
    return unwrapped
