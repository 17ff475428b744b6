"""An arm without its wrist: if the last three axes intersect, the joints before them must bring that point to the goal.

The joints of the wrist do not move the point where their axes intersect, and only the middle one changes the angle between
the first axis and the last. So joint values that reach a goal bring this point to its place at the goal. They also keep the
first axis of the wrist within a cone about the goal's last axis. This is a question with three joints fewer that has at
least the same solutions: if it has none, the goal has none. It is weaker than the goal, since it ignores the limits of the
first and the last joint of the wrist. So a solution of it proves nothing.

Axes that almost intersect are allowed as well: the distance between them is added to the tolerance of the point.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from kinseek.goal import Goal
from kinseek.kernels.arrays import Array
from kinseek.problem import Problem
from kinseek.structure.axes import lean, meeting, nearest_on
from kinseek.support.transforms import inverse, square

from .reduce import margins

WRIST = 3
"""Number of joints of a wrist."""

ASTRAY = 1e-2
"""Largest distance between the axes of a wrist, relative to the arm's length. A larger distance would widen the tolerance by
more than most goals are out of reach. The value decides whether the question is used, not what is proved."""


def without_wrist(problem: Problem) -> Problem | None:
    """Return the question for a whole pose without the wrist; None if the arm has no wrist.

    Joint values that meet both tolerances of the goal meet those of this question, without the last three joints.
    """
    chain, goal, fixed = problem.chain, problem.goal, problem.arrays.fixed
    remaining = len(chain.leader) - WRIST
    if goal.form.columns != 3 or remaining < 2 or chain.prismatic[-WRIST:].any():
        return None
    # A wrist joint that drives other joints, or follows one, cannot be left out.
    alone = np.bincount(chain.leader, minlength=chain.dof)[-WRIST:] == 1
    own = chain.leader[-WRIST:] == np.arange(chain.dof - WRIST, chain.dof)
    if not (alone & own).all():
        return None
    centre, off = _centre(fixed[remaining:])
    if off > ASTRAY * chain.length:
        return None
    angle = min(goal.orientation_tolerance, math.pi)
    last = inverse(fixed[-1])  # The frame of the last joint, in the hand's frame.
    at = last[:, :3] @ centre[2] + last[:, 3]
    target = goal.targets[0]
    # A rotation within the tolerance moves the wrist's centre by at most this chord.
    chord = 2.0 * math.sin(angle / 2) * float(np.linalg.norm(at))
    margin, margin_a = margins(problem, foot=float(np.linalg.norm(at)))
    leans, side = _lean(problem, remaining, margin_a)
    tip = square(fixed[remaining]).copy()
    tip[:3, 3] += tip[:3, :3] @ centre[0]
    rest = replace(
        chain,
        joint_names=chain.joint_names[:-WRIST],
        kinds=chain.kinds[:-WRIST],
        lower=chain.lower[:-WRIST],
        upper=chain.upper[:-WRIST],
        fixed=np.concatenate([fixed[:remaining], tip[None, :3]]),
        prismatic=chain.prismatic[:remaining],
        leader=chain.leader[:remaining],
        multiplier=chain.multiplier[:remaining],
        offset=chain.offset[:remaining],
        rates=chain.rates[:, :-WRIST],
        frames={},
    )
    return Problem(
        rest,
        Goal.pointing(
            target[:, :3] @ at + target[:, 3],
            side * (target[:, :3] @ last[:, 2]),
            position_tolerance=goal.position_tolerance + chord + off + margin,
            orientation_tolerance=min(angle + leans, math.pi),
        ),
    )


def _centre(fixed: Array) -> tuple[Array, float]:
    """Return where the axes of a wrist intersect, a point on each in its own frame, (3, 3), and their distance [m].

    The first and the second point are fixed in one link, the second and the third in the next. So for all joint values the
    first and the third are no farther apart than the sum of these two distances.
    """
    frames = [np.eye(4)]
    for each in fixed[1:-1]:
        frames.append(frames[-1] @ square(each))
    direction = np.array([frame[:3, 2] for frame in frames])
    point = np.array([frame[:3, 3] for frame in frames])
    middle, _ = meeting(direction[:2], point[:2])
    ends = nearest_on(direction, point, middle)
    along = np.array([frame[:3, 2] @ (end - frame[:3, 3]) for frame, end in zip(frames, ends, strict=True)])
    off = float(np.linalg.norm(np.diff(ends, axis=0), axis=1).sum())
    return along[:, None] * [0.0, 0.0, 1.0], off


def _lean(problem: Problem, remaining: int, margin: float) -> tuple[float, float]:
    """Return the largest angle between the first and last axis of a wrist [rad], and the sign of the last axis, 1 or -1.

    The cosine of the angle is ``a cos v + b sin v + c`` with the middle joint's angle v.
    """
    chain = problem.chain
    a, b, c = lean(problem.arrays.fixed[remaining + 1], problem.arrays.fixed[remaining + 2])
    ends = chain.multiplier[-2] * np.array([chain.lower[-2], chain.upper[-2]]) + chain.offset[-2]
    low, high = float(ends.min()), float(ends.max())
    turn, top = 2.0 * math.pi, math.atan2(b, a)
    values = [a * math.cos(v) + b * math.sin(v) + c for v in (low, high)]
    for extreme, value in ((top, c + math.hypot(a, b)), (top + math.pi, c - math.hypot(a, b))):
        if extreme + turn * math.ceil((low - extreme) / turn) <= high:
            values.append(value)
    leans = [math.acos(max(cosine - margin, -1.0)) for cosine in (min(values), -max(values))]
    return (leans[0], 1.0) if leans[0] <= leans[1] else (leans[1], -1.0)
