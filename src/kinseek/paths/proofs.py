"""What is proved of a path: which steps are unbroken, which poses are out of reach, and where no motion leads on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from kinseek.kernels.arm.forward import forward_many
from kinseek.kernels.arm.jacobian import jacobian_many
from kinseek.problem import Problem
from kinseek.proof.branch_and_bound import prove
from kinseek.proof.certificate import Verdict

from .asked import Asked
from .certify import prove_rows, rims_of, turns_between
from .impossible import impossible_stretches
from .joints import Turning
from .path import Path, PathProof
from .relaxed import relaxed

Array = NDArray[np.float64]

BUDGET = 200_000
"""Boxes examined at most of one pose that is missed: on six joints thousands are enough."""

ROUNDS = 4
"""Newton steps to where the joints stand that a goal's ranges are: a turn about one axis and slides take two."""


def with_proofs(asked: Asked, path: Path, threads: int | None) -> Path:
    """The path with what can be proved of it; see `Arm.follow`."""
    part, own = relaxed(asked)
    steps, within = _unbroken(part.problem, own, path, threads)
    missed = path.position_error > path.problem.goal.position_tolerance
    missed |= path.orientation_error > path.problem.goal.orientation_tolerance
    out_of_reach = _out_of_reach(path, missed, threads)
    stretches = impossible_stretches(part.problem, path) if part is asked else ()
    proof = PathProof(steps, within, out_of_reach, stretches)
    return replace(path, proof=proof, why=(*path.why, *_words(proof)))


def _words(proof: PathProof) -> list[str]:
    edges = np.flatnonzero(np.diff(np.concatenate([[0], proof.out_of_reach.astype(int), [0]])))
    said = []
    for first, end in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        which = f"pose {first} is" if end == first + 1 else f"poses {first} to {end - 1} are"
        said.append(f"{which} proved out of reach: no joint values inside the limits meet the tolerances")
    return said + [
        f"proved: no continuous motion inside the limits leads from pose {i} to pose {j}"
        for i, j in proof.impossible
    ]


def _unbroken(
    problem: Problem, own: slice, path: Path, threads: int | None
) -> tuple[NDArray[np.bool_], Array]:
    """Which steps are unbroken, (N - 1,) or (N,), and how near the branches pass by each pose, (N,)."""
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
    proved = prove_rows(problem, q, whole, keep=True, threads=threads, rims=rims)
    steps, within = np.zeros(last, dtype=np.bool_), np.full((2, count), np.inf)
    steps[whole] = proved.inside
    within[0, whole[proved.inside]] = proved.within[proved.inside, 0]
    within[1, (whole[proved.inside] + 1) % count] = proved.within[proved.inside, 1]
    known = np.where(np.isinf(within), 0.0, within).max(axis=0)
    return steps, np.where(np.isinf(within).all(axis=0), np.inf, known)


def _out_of_reach(path: Path, missed: NDArray[np.bool_], threads: int | None) -> NDArray[np.bool_]:
    """Which of the missed poses are proved out of reach, (N,); of ranges nothing is proved."""
    proved, goal = np.zeros(len(path), dtype=np.bool_), path.problem.goal
    if goal.ranges is not None:
        return proved
    for i in np.flatnonzero(missed):
        one = Problem(path.problem.mechanism, goal.at(goal.target[i]))
        proved[i] = prove(one, budget=BUDGET, threads=threads).verdict is Verdict.UNREACHABLE
    return proved


def _with_goal_joints(problem: Problem, own: slice, q: Array) -> Array:
    """Joint values of the arm with a joint for each range of the goal, from those of the arm, (N, n) -> (N, more)."""
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
