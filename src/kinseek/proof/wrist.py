"""An arm without its wrist: where three last axes meet, what is before them has to bring that point to the goal.

The joints of the wrist leave the point where their axes meet where it is, and the middle one of them alone decides how far
the first axis leans from the last. So whoever reaches a goal has that point where the goal has it, and the first axis of the
wrist within a cone about the goal's last axis. That is a question with three joints fewer and no further answers: no answer
to it, none to the goal. It says less than the goal does, since it forgets the limits of the first and the last joint of the
wrist, so a `yes` says nothing.

Axes that all but meet do as well: the point may then be off by what they miss each other by.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from kinseek.goal import Goal
from kinseek.kernels.arrays import Array
from kinseek.problem import Problem
from kinseek.robots.geometry import arm_length
from kinseek.structure.axes import lean, meeting, nearest_on
from kinseek.transforms import inverse, square

from .reduce import margins

WRIST = 3
"""Joints of a wrist."""

ASTRAY = 1e-2
"""Axes that miss each other by more than this part of the arm's length make no wrist: what the point may be off by is then
more than most goals are out of reach by. It decides whether the question is asked, not what is proved."""


def without_wrist(problem: Problem) -> Problem | None:
    """The question that is left of a whole pose when the wrist is taken off; None where the arm has none.

    Whatever meets both tolerances of the goal meets those of this question, less the values of the last three joints.
    """
    chain, goal, fixed = problem.chain, problem.goal, problem.arrays.fixed
    kept = len(chain.leader) - WRIST
    if goal.form.columns != 3 or kept < 2 or chain.prismatic[-WRIST:].any():
        return None
    alone = np.bincount(chain.leader, minlength=chain.dof)[-WRIST:] == 1
    own = chain.leader[-WRIST:] == np.arange(chain.dof - WRIST, chain.dof)
    if not (alone & own).all():
        return None
    centre, off = _centre(fixed[kept:])
    if off > ASTRAY * arm_length(chain):
        return None
    angle = min(goal.orientation_tolerance, math.pi)
    last = inverse(fixed[-1])  # The frame of the last joint, in the hand.
    at = last[:, :3] @ centre[2] + last[:, 3]
    target = goal.targets[0]
    turned = 2.0 * math.sin(angle / 2) * float(np.linalg.norm(at))
    margin, margin_a = margins(problem, foot=float(np.linalg.norm(at)))
    leans, side = _lean(problem, kept, margin_a)
    tip = square(fixed[kept]).copy()
    tip[:3, 3] += tip[:3, :3] @ centre[0]
    rest = replace(
        chain,
        joint_names=chain.joint_names[:-WRIST],
        kinds=chain.kinds[:-WRIST],
        lower=chain.lower[:-WRIST],
        upper=chain.upper[:-WRIST],
        fixed=np.concatenate([fixed[:kept], tip[None, :3]]),
        prismatic=chain.prismatic[:kept],
        leader=chain.leader[:kept],
        multiplier=chain.multiplier[:kept],
        offset=chain.offset[:kept],
        velocity=chain.velocity[:-WRIST],
        frames={},
    )
    return Problem(
        rest,
        Goal.pointing(
            target[:, :3] @ at + target[:, 3],
            side * (target[:, :3] @ last[:, 2]),
            position_tolerance=goal.position_tolerance + turned + off + margin,
            orientation_tolerance=min(angle + leans, math.pi),
        ),
    )


def _centre(fixed: Array) -> tuple[Array, float]:
    """Where the axes of a wrist meet, a point on each in its own frame, (3, 3); how far these may come apart [m].

    The first point and the second lie in one link, the second and the third in the next: however the joints stand, the
    first and the third are no farther apart than these two distances together.
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


def _lean(problem: Problem, kept: int, margin: float) -> tuple[float, float]:
    """How far the first axis of a wrist leans from the last at most [rad], and from which end of it, 1 or -1.

    The cosine of the angle between them is ``a cos v + b sin v + c``, v the middle joint's angle.
    """
    chain = problem.chain
    a, b, c = lean(problem.arrays.fixed[kept + 1], problem.arrays.fixed[kept + 2])
    ends = chain.multiplier[-2] * np.array([chain.lower[-2], chain.upper[-2]]) + chain.offset[-2]
    low, high = float(ends.min()), float(ends.max())
    turn, top = 2.0 * math.pi, math.atan2(b, a)
    values = [a * math.cos(v) + b * math.sin(v) + c for v in (low, high)]
    for extreme, value in ((top, c + math.hypot(a, b)), (top + math.pi, c - math.hypot(a, b))):
        if extreme + turn * math.ceil((low - extreme) / turn) <= high:
            values.append(value)
    leans = [math.acos(max(cosine - margin, -1.0)) for cosine in (min(values), -max(values))]
    return (leans[0], 1.0) if leans[0] <= leans[1] else (leans[1], -1.0)
