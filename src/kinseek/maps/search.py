"""Reached or not, of many poses, and a cheap no.

Who asks `arm.ik` for a pose that is out of reach gets the nearest one, which takes a hundred times as long as an answer.
A map wants no nearest pose. So lengths and angles are asked first, the gate of a proof; then the closed form, where the arm
has one; then where the hand wants the wrist; then the first samples of the atlas for each pose, eight poses at a time, as in
any batch; what is left gets a limited number of FK evaluations.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from kinseek.arm import Arm
from kinseek.goal import Goal
from kinseek.kernels.arm.division import NONE
from kinseek.kernels.atlas.batch import solve_many, solve_some
from kinseek.kernels.atlas.lanes import LANES
from kinseek.kernels.maps.many_closed import LEFT, YES, many_closed
from kinseek.kernels.maps.many_gates import many_gates
from kinseek.problem import Problem
from kinseek.proof.reduce import LARGEST, question
from kinseek.robots.geometry import divide
from kinseek.solvers.atlas.index import atlas_of, tolerances_of
from kinseek.transforms import inverse, square

from .last_joint import LastJoint
from .wrist import circles

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

PATIENCE = 1000
"""FK evaluations for a pose that its first samples do not lead to."""

TURNED = 1e-12
"""By so much tolerances are tighter [m] and [rad] where a pose stands for others that are turned about the tip's z axis:
rounding of the hand's pose when the last joint makes that turn."""


def reached(arm: Arm, goal: Goal, patience: int | None = PATIENCE) -> Flags:
    """Say of many poses whether an answer is found; one thread.

    Args:
        arm: With axes.
        goal: Poses, (k, 4, 4), and tolerances.
        patience: FK evaluations for a pose that resists; None: as many as `Arm.ik` takes.

    Returns:
        (k,): is there an answer inside the limits and within the tolerances, by plain forward kinematics? A no is no proof.
    """
    last, targets = LastJoint.of(arm.chain), goal.targets
    if last is None or not last.free:
        return _reached(arm, goal, patience)
    # Where the last joint turns all around, poses that differ by such a turn are one question; grids have them in a row.
    firsts = np.append(True, (targets[1:, :, 2:] != targets[:-1, :, 2:]).any(axis=(1, 2)))[: len(targets)]
    position = goal.position_tolerance - last.position - TURNED
    orientation = goal.orientation_tolerance - last.orientation - TURNED
    if firsts.all() or min(position, orientation) <= 0.0:
        return _reached(arm, goal, patience)
    tighter = replace(goal, position_tolerance=position, orientation_tolerance=orientation)
    found = _reached(arm, tighter.at(goal.target[firsts]), patience)
    return np.asarray(found[np.cumsum(firsts) - 1])


def _reached(arm: Arm, goal: Goal, patience: int | None) -> Flags:
    """See `reached`."""
    targets, index, tolerances = goal.targets, atlas_of(arm.chain, goal), tolerances_of(goal)
    found, open_ = np.zeros(len(targets), dtype=bool), np.flatnonzero(~ruled_out(arm, goal))
    report = np.empty(len(open_), dtype=np.int64)
    many_closed(
        index.handle, tolerances, arm.structure.numbers, np.ascontiguousarray(targets[open_]), report, LANES
    )
    found[open_[report == YES]] = True
    open_ = open_[report == LEFT]
    open_ = open_[~beyond(arm, targets[open_], goal)]
    some, left = np.ascontiguousarray(targets[open_]), np.empty(len(open_), dtype=np.int64)
    results = np.full((len(open_), arm.dof + 4), np.inf)
    count = solve_many(index.handle, tolerances, some, results, left, 0, len(open_), LANES)
    solve_some(
        index.handle, tolerances_of(goal, patience), some, results, left[:count].copy(), 0, count, LANES
    )
    found[open_] = goal.met(results[:, arm.dof :])
    return found


def beyond(arm: Arm, targets: Array, goal: Goal) -> Flags:
    """Say of poses, (k, 3, 4), which of them the circle of `wrist` proves out of reach, (k,)."""
    out = np.zeros(len(targets), dtype=bool)
    if len(targets):
        for circle in circles(arm.chain):
            out |= circle.beyond(targets, goal.position_tolerance, goal.orientation_tolerance)
    return out


def ruled_out(arm: Arm, goal: Goal) -> Flags:
    """Say of poses, (k, 4, 4), which of them lengths and angles prove out of reach, (k,)."""
    targets = goal.targets
    closed = np.zeros(len(targets))
    far = float(np.linalg.norm(targets[:, :, 3], axis=1).max(initial=0.0))
    form, tolerances, _ = question(Problem(arm.mechanism, goal.at(np.eye(4))))
    # What the question does to a pose: A T B, and of the identity it made A B.
    before = inverse(arm.chain.fixed[0]) if divide(arm.chain, goal.form).head != NONE else np.eye(4)[:3]
    after = (square(inverse(before)) @ square(tolerances.target))[:3]
    lengths = far + float(np.linalg.norm(before[:, 3])) + float(np.linalg.norm(after[:, 3]))
    if not lengths <= LARGEST:
        return closed.astype(bool)
    target = np.empty((3, 4))
    tolerances = tolerances._replace(target=target, margin=tolerances.margin + tolerances.margin_a * lengths)
    many_gates(
        form,
        tolerances,
        Problem(arm.mechanism, goal.at(np.eye(4))).arrays,
        np.ascontiguousarray(before),
        np.ascontiguousarray(after),
        targets,
        target,
        closed,
    )
    return closed > 0.0
