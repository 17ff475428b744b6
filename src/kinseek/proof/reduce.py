"""Transform a goal into the question that boxes are tested for: divide out what the last or first joint compensates."""

from __future__ import annotations

import math

import numpy as np

from kinseek.errors import InvalidProblem
from kinseek.kernels.arm.division import NONE, TURN
from kinseek.kernels.arm.forward import forward_many
from kinseek.kernels.arrays import Array, ChainArrays
from kinseek.kernels.proof.box import LEAST, TINY, Form, ProofGoal
from kinseek.kernels.proof.gate import CROSSED
from kinseek.kernels.proof.last_joint import LastJoint
from kinseek.problem import Problem
from kinseek.robots.chain import SerialChain
from kinseek.robots.geometry import divide
from kinseek.support.caching import WeakCache
from kinseek.support.transforms import inverse, square

from . import rounding
from .rounding import Sizes, defect_of

ALONG = 1e-12
"""A last axis that deviates from one of the tip's axes by less than this counts as parallel to it; the deviation is added to
the margin."""

LARGEST = 1e12
"""Largest sum of lengths for a proof [m]: with longer ones the margin for rounding is a metre and more."""

_AXIS_COUNTS = 0.1
"""Weight of a direction, relative to the arm's length, when a box is split: about the length of a hand. Not examined
further."""

ON_AXIS = 1e-6
"""A tip no farther from the last joint's axis [m] counts as on it, since robot files round to a micrometre. Twice that
distance is added to the margin, so the bound holds for any value. With twice the value the bound of the error is lower by
another 2e-6 K_P."""

AT_LIMIT = 1e-6
"""A last joint no farther from a limit [rad] counts as being at it. This decides which of two questions is used, not what is
proved."""


def question(problem: Problem, trust: float = 1.0) -> tuple[Form, ProofGoal, LastJoint]:
    """Formulate the question for the tolerances in the kernels' form.

    A revolute last joint is divided out: its axis must lie along the goal's axis, and one point of it must be where the goal
    wants it. This is the point that the axis before moves least. Its error may be the tolerance of the tip plus the motion
    that the tolerated rotation causes.
    """
    goal, chain = problem.goal, problem.chain
    fixed, target, head, tail = _divided(problem)
    angle = min(goal.orientation_tolerance, math.pi)
    chord = 2.0 * math.sin(angle / 2)
    slack, columns, foot = goal.position_tolerance, goal.columns, 0.0
    if tail:
        foot = _foot(fixed, chain)
        slack += chord * float(np.linalg.norm(fixed[-1, :, 3] - [0.0, 0.0, foot]))
        fixed, target = _cut(fixed, target, foot)
        columns = 1
    if columns == 3:
        # Two columns are compared, and each may be off by the chord.
        chord *= math.sqrt(2.0)
    proof_goal = _tolerances(problem, target, columns, trust, foot)._replace(position=slack)
    if columns:
        proof_goal = proof_goal._replace(chord=chord, angle=angle)
    return _form(chain, fixed, head, columns, 0, 0.0), proof_goal, _last_joint(chain, tail)


def error_question(
    problem: Problem, q: Array, gap: float, trust: float = 1.0, whole: bool = False
) -> tuple[Form, ProofGoal, LastJoint]:
    """Formulate the question for the least weighted error in the kernels' form.

    If the tip lies on the axis of the last joint, this joint only changes the rotation about that axis. Omitting it gives a
    lower bound. The bound is the error itself if the axis is the tip's z and its limits allow the best twist (`twist_cost`
    adds what they cost). It is nearly the error if the axis is the tip's x or y (`count_side`). For any other axis the joint
    is omitted if the loss at q is less than half the gap. The joint is kept if a limit holds it at q, since the bound then
    has to weigh the twist against the other errors; or if the `whole` arm is requested.
    """
    chain, goal = problem.chain, problem.goal
    fixed, target, head, tail = _divided(problem)
    off_axis = float(np.hypot(*fixed[-1, :2, 3]))
    if tail and off_axis < ON_AXIS and not (whole or _last_at_limit(chain, q)):
        cut, proof_goal = _without_last(problem, fixed, target, trust)
        astray = [float(np.hypot(*np.delete(fixed[-1, 2, :3], i))) for i in range(3)]
        along = [each < ALONG for each in astray]
        aligned, sideways = along[2], along[0] or along[1]
        if aligned or sideways:
            # The axis is treated as one of the tip's axes; what it deviates widens the margin instead.
            proof_goal = proof_goal._replace(margin_a=proof_goal.margin_a + 4.0 * min(astray))
        # The other column that counts is at right angles to the axis; these are its components in the plane of x and y.
        if sideways:
            y, z = (float(each) for each in fixed[-1, :2, 1 if along[0] else 0])
            proof_goal = proof_goal._replace(side_y=y, side_z=z)
        if aligned or sideways or _loss_of_last(problem, q) < 0.5 * gap:
            last_joint = _last_joint(chain, True, goal.orientation_weight if aligned else 0.0)
            return _form(chain, cut, head, 1, 0, 0.0), proof_goal, last_joint
    columns = goal.paper_columns
    tail = tail and len(fixed) > 2
    foot = _foot(fixed, chain) if tail else 0.0
    proof_goal = _tolerances(problem, target, columns, trust, foot)
    if tail:
        place_of_foot = np.eye(4)
        place_of_foot[2, 3] = foot
        proof_goal = proof_goal._replace(
            last=np.ascontiguousarray((square(target) @ square(inverse(fixed[-1])) @ place_of_foot)[:3]),
            offset=float(np.linalg.norm(fixed[-1, :, 3] - [0.0, 0.0, foot])),
        )
    return _form(chain, fixed, head, columns, int(tail), foot), proof_goal, LastJoint(False, 0.0, 0.0, 0.0)


def question_without_last(problem: Problem, trust: float = 1.0) -> tuple[Form, ProofGoal]:
    """Formulate a question with at most one direction whose least weighted error is no larger: the last joint is free.

    This requires a last joint with the tip on its axis. If there is none, or at most one direction counts, the original
    question is returned.
    """
    fixed, target, head, tail = _divided(problem)
    columns = problem.goal.paper_columns
    if tail and float(np.hypot(*fixed[-1, :2, 3])) < ON_AXIS:
        fixed, proof_goal = _without_last(problem, fixed, target, trust)
        columns = 1
    else:
        proof_goal = _tolerances(problem, target, columns, trust)
    return _form(problem.chain, fixed, head, columns, 0, 0.0), proof_goal


def _without_last(problem: Problem, fixed: Array, target: Array, trust: float) -> tuple[Array, ProofGoal]:
    """Omit a last joint with the tip on its axis; return the transforms and the goal for the axis."""
    tip, chain = fixed[-1], problem.chain
    cut, axis = _cut(fixed, target, float(tip[2, 3]))
    proof_goal = _tolerances(problem, axis, 1, trust)
    proof_goal = proof_goal._replace(margin=proof_goal.margin + 2.0 * float(np.hypot(*tip[:2, 3])))
    back = float(tip[2, 3]) - _foot(fixed, chain)
    return cut, proof_goal._replace(back=back) if abs(back) < chain.length else proof_goal


def _last_at_limit(chain: SerialChain, q: Array) -> bool:
    """Return whether the last joint is at a limit, with a range of less than a turn."""
    lower, upper = float(chain.lower[-1]), float(chain.upper[-1])
    return upper - lower < 2 * np.pi and min(float(q[-1]) - lower, upper - float(q[-1])) < AT_LIMIT


def _loss_of_last(problem: Problem, q: Array) -> float:
    """Return the fraction of the weighted error at q, (n,), lost if columns are compared along the last axis alone."""
    goal, target = problem.goal, problem.goal.targets[0]
    T = forward_pose(problem.arrays, q)
    axis = inverse(problem.arrays.fixed[-1])[:, 2]
    miss = goal.position_weight * float(np.linalg.norm(T[:, 3] - target[:, 3]))
    half = 0.5 * goal.orientation_weight
    tilt_cost = half * float(np.sum(((T - target)[:, :3] @ axis) ** 2))
    column_cost = half * float(np.sum((T - target)[:, :2] ** 2))
    return 1.0 - (miss + tilt_cost) / max(miss + column_cost, TINY)


def start_boxes(chain: SerialChain, without_last: bool) -> Array:
    """Return the whole range of the joints as one box, (1, 2 dof), with at most one turn for each joint."""
    lower, upper = chain.lower.copy(), chain.upper.copy()
    for i in range(chain.dof):
        if chain.periodic[i] and upper[i] - lower[i] > 2 * np.pi:
            # More than one turn repeats poses: one turn contains all of them and is a smaller box.
            middle = (lower[i] + upper[i]) / 2
            lower[i], upper[i] = middle - np.pi, middle + np.pi
    count = chain.dof - int(without_last)
    half = (upper - lower) / 2
    # Rounded outward, so that joint values at a limit lie inside the box.
    half += LEAST + LEAST * np.abs(lower + upper)
    return np.concatenate([(lower + upper)[:count] / 2, half[:count]])[None]


def forward_pose(chain: ChainArrays, q: Array) -> Array:
    """Return the pose of the tip, (3, 4)."""
    return forward_many(chain, np.ascontiguousarray(q)[None])[0, :3]


def _divided(problem: Problem) -> tuple[Array, Array, int, bool]:
    """Divide out the position of the first joint.

    Returns:
        Fixed transforms, target, kind of the first joint, and whether the last joint is revolute.
    """
    division = divide(problem.chain, problem.goal.form)
    fixed, target = problem.arrays.fixed.copy(), problem.goal.targets[0].copy()
    if division.head != NONE:
        # In the frame of the first joint its motion is a rotation about z, or a slide along it, which the kernels divide
        # out.
        target = (square(inverse(fixed[0])) @ square(target))[:3]
        fixed[0] = np.eye(4)[:3]
    return fixed, np.ascontiguousarray(target), division.head, division.tail == TURN


def _foot(fixed: Array, chain: SerialChain) -> float:
    """Return the position on the last axis nearest to the axis before [m]; that of the tip if they are parallel."""
    tip = float(fixed[-1, 2, 3])
    if len(fixed) < 3 or chain.prismatic[-2]:
        return tip
    back = inverse(fixed[-2])
    axis, point = back[:, 2], back[:, 3]
    apart = 1.0 - axis[2] ** 2
    # Parallel axes have no nearest point.
    return float((point[2] - axis[2] * (axis @ point)) / apart) if apart > CROSSED else tip


def _cut(fixed: Array, target: Array, along: float) -> tuple[Array, Array]:
    """Omit the last joint: the tip becomes the point `along` its axis, with the columns axis, x and y."""
    axis_first = np.array(
        [[0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [1.0, 0.0, 0.0, along], [0.0, 0.0, 0.0, 1.0]]
    )
    short = fixed[:-1].copy()
    # The columns are permuted so that the axis of the omitted joint comes first: the kernels compare the first columns.
    short[-1] = (square(short[-1]) @ axis_first)[:3]
    proof_goal = square(target) @ square(inverse(fixed[-1])) @ axis_first
    return short, np.ascontiguousarray(proof_goal[:3])


def _form(chain: SerialChain, fixed: Array, head: int, columns: int, tail: int, foot: float) -> Form:
    joints = len(fixed) - 1
    return Form(
        np.ascontiguousarray(fixed),
        np.ascontiguousarray(chain.prismatic[:joints]),
        np.ascontiguousarray(chain.leader[:joints]),
        np.ascontiguousarray(chain.multiplier[:joints]),
        np.ascontiguousarray(chain.offset[:joints]),
        head,
        columns,
        tail,
        foot,
    )


def _last_joint(chain: SerialChain, present: bool, weight: float = 0.0) -> LastJoint:
    return LastJoint(present, float(chain.lower[-1]), float(chain.upper[-1]), weight)


def _tolerances(problem: Problem, target: Array, columns: int, trust: float, foot: float = 0.0) -> ProofGoal:
    """Return a target with its weights and with margins for rounding, but without tolerances.

    Raises:
        InvalidProblem: The lengths are too large for a proof.
    """
    chain, goal = problem.chain, problem.goal
    margin, margin_a = margins(problem, target, foot)
    return ProofGoal(
        target=target,
        last=np.zeros((3, 4)),
        position=0.0,
        chord=0.0,
        angle=0.0,
        weight_p=float(goal.position_weight),
        weight_a=float(goal.orientation_weight) if columns else 0.0,
        margin=margin,
        margin_a=margin_a,
        trust=float(trust),
        length=_AXIS_COUNTS * chain.length,
        offset=0.0,
        back=0.0,
        side_y=0.0,
        side_z=0.0,
    )


def slack_of_error(problem: Problem) -> float:
    """Return the largest difference that rounding causes between the measured and the true weighted error of a pose.

    Each column that counts may differ by the margin for directions. Half the square of a chord of at most 2 changes by twice
    that.

    Raises:
        InvalidProblem: As `margins`.
    """
    goal = problem.goal
    margin, margin_a = margins(problem)
    return float(
        goal.position_weight * margin + 2.0 * goal.paper_columns * goal.orientation_weight * margin_a
    )


def margins(
    problem: Problem, target: Array | None = None, foot: float = 0.0, angles: float = 0.0
) -> tuple[float, float]:
    """Return the rounding margins of a point [m] and of all columns of a pose: `rounding.margins` of `sizes_of`."""
    return rounding.margins(sizes_of(problem, target, foot, angles))


def sizes_of(problem: Problem, target: Array | None = None, foot: float = 0.0, angles: float = 0.0) -> Sizes:
    """Return the quantities that rounding errors of a proof depend on.

    Args:
        problem: The arm and the goal.
        target: The goal's pose as the kernels take it, (3, 4); the default is the original goal.
        foot: Distance along the last axis of a point that is compared too [m].
        angles: Sum of the joint angles [rad], if they exceed the limits.

    Raises:
        InvalidProblem: The lengths are too large for a proof.
    """
    chain, goal = problem.chain, problem.goal
    arm: Sizes = _arms.of(chain).get(None, lambda: _sizes_of_arm(chain))
    original, tip = goal.targets[0], goal.tip
    reach = arm.reach + abs(foot) + goal.position_tolerance
    defect = arm.defect + defect_of(original[:, :3])
    for pose in (original, original if target is None else target):
        reach += math.hypot(*pose[:, 3])
    if tip is not None:
        reach, defect = reach + math.hypot(*tip[:3, 3]), defect + defect_of(tip[:3, :3])
    if not reach <= LARGEST:
        raise InvalidProblem(
            f"the lengths of the arm and the goal add up to {reach:.3g} m: beyond {LARGEST:g} m rounding errors are "
            "too large for a proof; expected metres"
        )
    return arm._replace(angles=max(arm.angles, angles), reach=reach, defect=defect)


def _sizes_of_arm(chain: SerialChain) -> Sizes:
    """Return the quantities that depend on the arm alone."""
    values = np.maximum(np.abs(chain.lower), np.abs(chain.upper))[chain.leader] * np.abs(chain.multiplier)
    values += np.abs(chain.offset)
    turning = ~chain.prismatic
    return Sizes(
        joints=len(chain.leader),
        angles=float(values[turning].sum()),
        rate=float(np.abs(chain.multiplier[turning]).sum()),
        reach=float(np.linalg.norm(chain.fixed[:, :, 3], axis=1).sum() + values[chain.prismatic].sum()),
        defect=float(sum(defect_of(A[:, :3]) for A in chain.fixed)),
    )


_arms: WeakCache[SerialChain, None, Sizes] = WeakCache()
