"""Reachability of many poses, with a fast rejection of unreachable ones.

For a pose out of reach `arm.ik` returns the nearest one, which takes a hundred times as long as a solution and is not needed
for a map. So the tests come in order of cost: first lengths and angles, as at the start of a proof; then the closed form, if
the arm has one; then the required position of the wrist; then the first samples of the atlas for each pose, eight poses at a
time, as in any batch. The remaining poses get a limited number of FK evaluations.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from kinseek.arm import Arm
from kinseek.errors import InvalidMap
from kinseek.goal import Goal
from kinseek.kernels.arm.division import NONE
from kinseek.kernels.atlas.batch import solve_many, solve_some
from kinseek.kernels.atlas.lanes import LANES
from kinseek.kernels.maps.many_closed import LEFT, YES, many_closed
from kinseek.kernels.maps.many_gates import many_gates
from kinseek.kinds import POSE
from kinseek.problem import Problem
from kinseek.proof.reduce import LARGEST, question
from kinseek.robots.chain import SerialChain
from kinseek.robots.geometry import divide
from kinseek.solvers.atlas.index import atlas_of, tolerances_of
from kinseek.support.transforms import inverse, square

from .last_joint import LastJoint
from .wrist import circles

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

PATIENCE = 1000
"""Maximum number of FK evaluations for a pose that is not solved from its first samples. Not examined further."""

LOOSE = 1e-3
"""Tolerance, [m] or [rad], above which there is no such maximum. Of 600 poses of the Panda, the UR5e and the iiwa14, some of
them beyond reach, it loses up to 24 with 0.01 m and 0.2 rad, and none with 1e-3 m and 1e-3 rad."""

ROUNDED = 1e-12
"""Reduction of tolerances, [m] and [rad], if one pose represents others that are rotated about the tip's z axis: the
rounding error of the tip's pose after that rotation of the last joint.
"""


def patience_of(position_tolerance: float, orientation_tolerance: float) -> int | None:
    """Return the maximum number of FK evaluations for a pose, None for as many as `Arm.ik` uses."""
    return PATIENCE if max(position_tolerance, orientation_tolerance) <= LOOSE else None


def axes_of(arm: object, what: str) -> SerialChain:
    """Return the axes of an arm.

    Args:
        arm: The arm.
        what: What needs them, for the message.

    Raises:
        InvalidMap: It is no arm, or has none.
    """
    if not isinstance(arm, Arm):
        raise InvalidMap(f"{what} needs an Arm, as kinseek.load gives it, got {type(arm).__name__}")
    if arm.axes is None:
        raise InvalidMap(
            f"{what} needs the axes and links of an arm, but {arm.name!r} has black-box kinematics"
        )
    return arm.axes


def reached(arm: Arm, goal: Goal, patience: int | None = PATIENCE) -> Flags:
    """Return whether a solution is found for each of many poses; one thread.

    Args:
        arm: An arm with axes.
        goal: Poses, (k, 4, 4), and tolerances; or another goal.
        patience: Maximum number of FK evaluations per pose; None: as many as `Arm.ik` uses, as for any goal but the tip's
            whole pose.

    Returns:
        Is there a solution inside the limits and within the tolerances, by plain forward kinematics, (k,)? False proves
        nothing.
    """
    if goal.form is not POSE or goal.tool is not None:
        return np.asarray(arm.ik(goal, threads=1).success)
    last, targets = LastJoint.of(arm.chain), goal.targets
    if last is None or not last.free:
        return _reached(arm, goal, patience)
    # If the last joint can make a full turn, poses that differ by its rotation have the same result; grids list them
    # together.
    firsts = np.append(True, (targets[1:, :, 2:] != targets[:-1, :, 2:]).any(axis=(1, 2)))[: len(targets)]
    position = goal.position_tolerance - last.position - ROUNDED
    orientation = goal.orientation_tolerance - last.orientation - ROUNDED
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
    # Closed forms decide most poses of arms that have one; only the rest is searched.
    open_ = open_[report == LEFT]
    open_ = open_[~beyond(arm, targets[open_], goal)]
    if patience is None:
        found[open_] = arm.ik(goal.at(goal.target[open_]), threads=1).success
        return found
    some, left = np.ascontiguousarray(targets[open_]), np.empty(len(open_), dtype=np.int64)
    results = np.full((len(open_), arm.dof + 4), np.inf)
    # First with little work for each pose, then patiently for those that are left.
    count = solve_many(index.handle, tolerances, some, results, left, 0, len(open_), LANES)
    patient = tolerances_of(goal, patience)
    solve_some(index.handle, patient, some, np.empty((0, arm.dof)), results, left[:count], LANES)
    found[open_] = goal.met(results[:, arm.dof :])
    return found


def beyond(arm: Arm, targets: Array, goal: Goal) -> Flags:
    """Return which poses, (k, 3, 4), the circle of `wrist` proves out of reach, (k,)."""
    out = np.zeros(len(targets), dtype=bool)
    if len(targets):
        for circle in circles(arm.chain):
            out |= circle.beyond(targets, goal.position_tolerance, goal.orientation_tolerance)
    return out


def ruled_out(arm: Arm, goal: Goal) -> Flags:
    """Return which poses, (k, 4, 4), lengths and angles prove out of reach, (k,)."""
    targets = goal.targets
    closed = np.zeros(len(targets))
    far = float(np.linalg.norm(targets[:, :, 3], axis=1).max(initial=0.0))
    form, tolerances, _ = question(Problem(arm.mechanism, goal.at(np.eye(4))))
    # The goal maps a pose T to A T B, and the identity to A B.
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
