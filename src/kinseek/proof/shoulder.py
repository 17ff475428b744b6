"""Lower bound of the error from an arm on a ball joint: it needs boxes of fewer joints."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import product
from typing import NamedTuple

import numpy as np

from kinseek.kernels.arm.division import TURN
from kinseek.kernels.arrays import Array
from kinseek.kernels.proof.box import Form, ProofGoal
from kinseek.kernels.proof.gate import CROSSED
from kinseek.kernels.proof.memory import Heap
from kinseek.kernels.proof.multipliers import Shoulder
from kinseek.kernels.proof.progress import (
    CEILING,
    COUNT,
    COUNTS,
    ENDED,
    FIGURES,
    FLOOR,
    FULL,
    SEEN,
    STOPPED,
    UPPER,
    USED,
)
from kinseek.kernels.proof.shoulder import enclose_ball
from kinseek.problem import Problem
from kinseek.support.transforms import rotation
from kinseek.support.validation import arrays_equal

from .reduce import ON_AXIS, question_without_last, start_boxes
from .rounding import Sizes, defect_of, gamma, of_points

FEWEST = 7
"""Fewest joints of an arm: with fewer it is not redundant, and the ball joint allows what the arm cannot do."""

MOST = 5
"""Most joints distal to the ball joint: with more the sums of products are too long. Not examined further."""

WORK = 5_000_000
"""Boxes times products in each of their sums: some tenths of a second. Most decided goals take a tenth of that."""

PIECE = 500_000
"""The same number after which the kernel returns and is called again: some hundredths of a second."""


class Bounded(NamedTuple):
    """Result for an arm on a ball joint."""

    lower: float
    """Lower bound of the weighted error."""
    boxes: int


def bounded_by_ball(
    problem: Problem,
    ceiling: float,
    budget: int,
    trust: float = 1.0,
    over: Callable[[], bool] = lambda: False,
) -> Bounded:
    """Bound the least weighted error from below by that of the arm on a ball joint, until the bound reaches `ceiling`.

    The bound is 0 for arms that are not redundant, or whose first joints are not plain revolute joints.

    Args:
        problem: One target.
        ceiling: Bound at which the search ends.
        budget: Largest number of boxes.
        trust: 1; tests shrink all bounds by it.
        over: Returns True when the search has to stop.
    """
    if problem.chain.dof < FEWEST:
        return Bounded(0.0, 0)
    reduction = question_without_last(problem, trust)
    best = Bounded(0.0, 0)
    # A ball joint that replaces two joints takes fewer boxes, but ignores their limits.
    for alone in (False, True):
        found = shoulder_of(problem, *reduction, alone)
        if found is None:
            break
        more = _bounded(problem, *found, ceiling, budget - best.boxes, over)
        best = Bounded(max(best.lower, more.lower), best.boxes + more.boxes)
        if best.lower >= ceiling or found[1] == 1:
            break
    return best


def _bounded(
    problem: Problem, shoulder: Shoulder, first: int, ceiling: float, budget: int, over: Callable[[], bool]
) -> Bounded:
    """Bound the least error of one arm on a ball joint; joint `first` is the first one distal to the ball."""
    terms = shoulder.invariants.shape[1]
    start = start_boxes(problem.chain, False)[0].reshape(2, -1)
    count = round(math.log(terms, 3))
    boxes = np.zeros((1024, 2 * count + 6))
    boxes[0, : 2 * count] = start[:, first : first + count].ravel()
    heap = Heap(np.zeros(len(boxes)), np.zeros(len(boxes), dtype=np.int64))
    counts, figures = np.zeros(COUNTS, dtype=np.int64), np.zeros(FIGURES)
    counts[COUNT] = counts[USED] = 1
    figures[UPPER], figures[CEILING] = np.inf, ceiling
    outcome, most = STOPPED, min(budget, WORK // terms) // 2 * 2  # Both halves of a box are tested.
    while outcome != ENDED and counts[SEEN] < most and not over():
        until = min(int(counts[SEEN]) + PIECE // terms, most)
        outcome = enclose_ball(shoulder, boxes, heap, counts, figures, until)
        if outcome == FULL:
            boxes = np.concatenate([boxes, np.zeros_like(boxes)])
            heap = Heap(*(np.concatenate([each, np.zeros_like(each)]) for each in heap))
    return Bounded(min(float(figures[FLOOR]), ceiling), int(counts[SEEN]))


def shoulder_of(
    problem: Problem, form: Form, proof_goal: ProofGoal, alone: bool = False
) -> tuple[Shoulder, int] | None:
    """Replace the first joints of an arm by a ball joint on its first axis; None if this gives no bound.

    If the second axis intersects the first, the ball is at the intersection and replaces both joints. Otherwise, or if
    `alone` is set, it replaces only the first joint.

    Returns:
        The arm on its ball joint; the first joint distal to it.
    """
    joints = len(form.leader)
    plain = arrays_equal(form.leader, np.arange(joints)) and not form.prismatic.any()
    plain = plain and bool((form.multiplier == 1.0).all() and (form.offset == 0.0).all())
    if not plain or form.head != TURN or form.columns > 1 or problem.chain.dof < FEWEST:
        return None
    axis, point = form.fixed[1, :, 2], form.fixed[1, :, 3]
    across = float(axis[:2] @ axis[:2])
    along = -float(axis[:2] @ point[:2]) / across if across > CROSSED else 0.0
    nearest = point + along * axis
    apart = math.hypot(nearest[0], nearest[1])
    intersecting = apart < ON_AXIS and not alone
    first = 2 if intersecting else 1
    if joints - first > MOST:
        return None
    ball = np.array([0.0, 0.0, along if intersecting else nearest[2]])
    g, b = proof_goal.target[:, 3] - [0.0, 0.0, nearest[2]], proof_goal.target[:, 0]
    far = float(np.linalg.norm(g))
    # Only the length of g and the angle between g and b matter for a ball joint, so both lie in one plane.
    cosine = float(b @ g) / far if far > 0.0 else 1.0
    sine = float(np.linalg.norm(np.cross(g, b))) / far if far > 0.0 else 0.0
    plane = np.array([[far, 0.0, 0.0], [cosine, sine, 0.0]])
    size = 1.0 + float(np.linalg.norm(form.fixed[1:, :, 3], axis=1).sum()) + far + abs(float(ball[2]))
    shoulder = Shoulder(
        invariants=_invariants(form.fixed[first:], ball, upright=not intersecting),
        goal=plane if intersecting else _in_plane(g, b),
        plane=plane,
        weight_p=proof_goal.weight_p,
        weight_a=proof_goal.weight_a,
        size=size,
        margin=proof_goal.margin + proof_goal.margin_a * size + 2.0 * apart * intersecting,
        margin_a=proof_goal.margin_a,
        trust=proof_goal.trust,
        rounding=_of_products(joints - first, sum(defect_of(A[:, :3]) for A in form.fixed[first:])),
    )
    return shoulder, first


def _in_plane(g: Array, b: Array) -> Array:
    """Rotate g and b about the third axis and mirror them: g gets no second component, b's is not negative, (2, 3)."""
    azimuth = math.atan2(g[1], g[0])
    turn = math.cos(azimuth), math.sin(azimuth)
    x, y = turn[0] * b[0] + turn[1] * b[1], abs(turn[0] * b[1] - turn[1] * b[0])
    return np.array([[math.hypot(g[0], g[1]), 0.0, g[2]], [x, y, b[2]]])


def _of_products(n: int, defect: float) -> float:
    """Return the error of a factor in the invariants' sums, about any centre, relative to the largest value of the sum.

    A value at one of three angles per joint has twice the error of a point. About a centre every factor is a mean of values
    between these angles. This magnifies the error by at most 5/3 per joint, the norm of the interpolation. The rounding
    errors of the two changes of basis, joint after joint, are magnified by no more.
    """
    values = 2.0 * of_points(Sizes(n, math.pi * n, n, 1.0, defect)) + gamma(8)
    return float((5.0 / 3.0) ** n * (values + 2 * n * gamma(8)))


def _invariants(fixed: Array, ball: Array, upright: bool) -> Array:
    """Return ``|p|²`` and ``p·a`` as sums of products of ``1, cos q, sin q``, from values at three angles a joint, (2, 3ⁿ).

    Args:
        fixed: Transforms of the joints distal to the ball joint, and of the tip, (n+1, 3, 4).
        ball: Position of the ball joint, (3,) [m].
        upright: Whether the ball is on the axis of the first joint: the components of p and a along it follow, (4, 3ⁿ).
    """
    n = len(fixed) - 1
    turns = [
        rotation(np.array([0.0, 0.0, 1.0]), angle)
        for angle in (0.0, 2.0 * math.pi / 3.0, -2.0 * math.pi / 3.0)
    ]
    values = np.empty((4 if upright else 2, 3**n))
    for index, rotations in enumerate(product(turns, repeat=n)):
        p, a = fixed[-1, :, 3], fixed[-1, :, 0]
        for k in range(n - 1, -1, -1):
            R = fixed[k, :, :3] @ rotations[k]
            p, a = R @ p + fixed[k, :, 3], R @ a
        p = p - ball
        values[:, index] = [p @ p, p @ a, p[2], a[2]][: len(values)]
    root = math.sqrt(3.0)
    # From values at 0, 2π/3 and -2π/3 to the coefficients of 1, cos and sin.
    to_terms = np.array([[1.0, 1.0, 1.0], [2.0, -1.0, -1.0], [0.0, root, -root]]) / 3.0
    grid = values.reshape(-1, *[3] * n)
    for i in range(n):
        grid = np.moveaxis(np.tensordot(to_terms, grid, axes=(1, i + 1)), 0, i + 1)
    return np.ascontiguousarray(grid.reshape(len(values), -1))
