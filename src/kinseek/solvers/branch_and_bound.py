"""Branch and bound: prove that a goal is out of reach, or say how near any pose could come.

Boxes of joint values are cut in half, again and again. Each is tested by the bounds of `kernels.bounds`: first what the
whole box can do, then one linear form of the hand's pose to second order, which also cuts the box from its sides. All
boxes gone: nothing inside the limits reaches the goal. Best box first, the same search encloses the least error.
(Land & Doig 1960; in robotics Rao, Asaithambi & Agrawal 1998, who solve inverse kinematics by interval analysis.)
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from kinseek.certificate import Certificate, Verdict
from kinseek.errors import InvalidProblem
from kinseek.goal import Goal
from kinseek.kernels.arrays import Array, ChainArrays, GoalArrays, Indices
from kinseek.kernels.atlas import NONE, TURN, nearest_copy
from kinseek.kernels.bounds import (
    CHORD,
    LEAST,
    LENGTH,
    MARGIN,
    MARGIN_A,
    OFFSET,
    POSITION,
    SCALARS,
    TRUST,
    WEIGHT_A,
    WEIGHT_P,
    Desk,
    Form,
    Wanted,
    first_order,
    make_desk,
    motion,
    normal_matrix,
    place,
    second_order,
    solve,
    turn_goal,
    widths,
)
from kinseek.kernels.forward import forward, forward_many
from kinseek.kernels.jit import inner, kernel
from kinseek.kernels.pose_error import errors, weighted_error
from kinseek.problem import Problem
from kinseek.robots.chain import SerialChain
from kinseek.solution import Solution, conclude

from .atlas import Atlas, arm_length, divide, inverse

ENDED, FOUND, STOPPED = 0, 1, 2


class Roll(NamedTuple):
    """The last joint, where it is divided out."""

    present: bool
    lower: float
    upper: float
    """Limits [rad]; at least a full turn apart where they do not matter."""
    weight: float
    """K_A where the joint's axis is the z axis of the tip, so that a twist costs ``K_A (1 + cos τ)(1 - cos β)``, else 0."""


class Search(NamedTuple):
    """How a search went."""

    outcome: int
    """ENDED: no box left; FOUND: `q` is within the tolerances; STOPPED: by the budget or by rounding."""
    boxes: int
    largest: float
    """Widest box that is left, the half width of its widest variable [rad] or [m]; 0 if none."""
    q: Array
    """(n,), the best joint values seen."""
    lower: float
    """Lower bound on the weighted error."""
    upper: float
    """Weighted error of `q`."""


BUDGET = 2_000_000
"""Boxes, unless told otherwise: some seconds."""

_SPREAD, _SHRINK = 2.5, 0.5
_ROUNDING = 1e-12
_TRIAL = 16
"""Every so many boxes that are kept, steps from the middle of one look for an answer."""
_AXIS_COUNTS = 0.2
"""A direction counts, when a box is split, as this part of the arm's length."""


def prove(
    problem: Problem, *, gap: float | None = None, budget: int = BUDGET, answer: Solution | None = None
) -> Certificate:
    """Prove that a goal is out of reach, or find joint values that reach it.

    Args:
        problem: One target.
        gap: If the goal is not reached: go on until the bounds on the least weighted error are this close, relative to the
            upper one, > 0; None leaves out this second search.
        budget: Boxes to examine at most, over both searches, >= 0; the bounds hold whenever the search stops.
        answer: A solution of the same problem, if there is one already; else the atlas is asked.

    Raises:
        InvalidProblem: A batch, an empty one included; a gap or budget out of its range.
    """
    if problem.goal.shape:
        raise InvalidProblem(f"a proof is about one target, got a batch of shape {problem.goal.shape}")
    if gap is not None and not 0.0 < gap < 1.0:
        raise InvalidProblem(f"gap must be in (0, 1), got {gap}")
    refuse_ranges(problem.goal)
    if budget < 0:
        raise InvalidProblem(f"budget must be at least 0 boxes, got {budget}")
    best = answer or Atlas().solve(replace(problem, budget=None))
    if best.success:
        return _certificate(problem, Verdict.REACHABLE, best.q, 0.0, 0, 0.0)
    search = excluded(problem, budget)
    if search.outcome == FOUND:
        return _certificate(problem, Verdict.REACHABLE, search.q, 0.0, search.boxes, 0.0)
    q = search.q if search.upper < best.weighted_error else best.q
    verdict, boxes, lower, largest = Verdict.UNDECIDED, search.boxes, 0.0, search.largest
    if search.outcome == ENDED:
        verdict, lower = Verdict.UNREACHABLE, least_outside(problem.goal)
    if gap is not None:
        nearest = enclosed(problem, q, gap, budget - boxes)
        q, boxes, largest = nearest.q, boxes + nearest.boxes, nearest.largest
        lower = max(lower, nearest.lower)
    certificate = _certificate(problem, verdict, q, lower, boxes, largest)
    goal = problem.goal
    met = certificate.position_error <= goal.position_tolerance
    if met and certificate.orientation_error <= goal.orientation_tolerance:
        return replace(certificate, verdict=Verdict.REACHABLE, lower_bound=0.0)
    if lower > _ROUNDING and lower > most_inside(goal):
        return replace(certificate, verdict=Verdict.UNREACHABLE)
    return certificate


def refuse_ranges(goal: Goal) -> None:
    """Refuse a goal with free axes or ranges.

    Raises:
        InvalidProblem: It has them.
    """
    if goal.kind == "box":
        raise InvalidProblem("nothing can be proved yet of a goal with free axes or ranges")


def least_outside(goal: Goal) -> float:
    """The least weighted error that misses a tolerance."""
    position = goal.position_weight * goal.position_tolerance
    angle = min(goal.orientation_tolerance, math.pi)
    turn = goal.orientation_weight * 2.0 * math.sin(angle / 2) ** 2
    return (position if goal.kind == "position" else min(position, turn)) * (1.0 - _ROUNDING)


def most_inside(goal: Goal) -> float:
    """The largest weighted error within both tolerances."""
    position = goal.position_weight * goal.position_tolerance
    axes = goal.paper_columns
    angle = min(goal.orientation_tolerance, math.pi)
    return (position + axes * goal.orientation_weight * 2.0 * math.sin(angle / 2) ** 2) * (1.0 + _ROUNDING)


def excluded(problem: Problem, budget: int, trust: float = 1.0) -> Search:
    """Look in every box for joint values within both tolerances; see `exclude`."""
    goal = problem.goal
    form, wanted, roll = question(problem, trust)
    tuning = np.array([_SPREAD, 2, _SHRINK, goal.position_tolerance, goal.orientation_tolerance])
    boxes = start_boxes(problem.chain, roll.present)
    return exclude(form, wanted, roll, problem.arrays, goal.arrays, boxes, tuning, budget)


def enclosed(problem: Problem, q: Array, gap: float, budget: int, trust: float = 1.0) -> Search:
    """Enclose the least weighted error, starting from joint values q, (n,); see `enclose`."""
    form, wanted, roll = error_question(problem, q, gap, trust)
    boxes = start_boxes(problem.chain, roll.present)
    tuning = np.array([_SPREAD, 1, _SHRINK, gap])
    q = np.ascontiguousarray(q)
    return enclose(form, wanted, roll, problem.arrays, problem.goal.arrays, boxes, q, tuning, budget)


def question(problem: Problem, trust: float = 1.0) -> tuple[Form, Wanted, Roll]:
    """Put the question of the tolerances into the kernels' form.

    A last joint that turns is divided out: its axis shall lie along the goal's, and the point of it that the axis before
    moves least shall be where the goal wants it. That point may miss by the tolerance of the tip and by what the tolerated
    turn moves it.
    """
    goal, chain = problem.goal, problem.chain
    fixed, target, head, tail = _divided(problem)
    angle = min(goal.orientation_tolerance, math.pi)
    chord = 2.0 * math.sin(angle / 2)
    slack, columns = goal.position_tolerance, goal.columns
    if tail:
        foot = _foot(fixed, chain)
        slack += chord * float(np.linalg.norm(fixed[-1, :, 3] - [0.0, 0.0, foot]))
        fixed, target = _cut(fixed, target, foot)
        columns = 1
    if columns == 3:
        chord *= math.sqrt(2.0)
    scalars = _scalars(problem, target, columns, trust)
    scalars[POSITION], scalars[CHORD] = slack, chord if columns else 0.0
    return (
        _form(chain, fixed, head, columns, 0, 0.0),
        Wanted(target, np.zeros((3, 4)), scalars),
        _roll(chain, tail),
    )


def error_question(problem: Problem, q: Array, gap: float, trust: float = 1.0) -> tuple[Form, Wanted, Roll]:
    """Put the question of the least weighted error into the kernels' form.

    Where the tip lies on the axis of the last joint, that joint changes nothing but the turn about it. Leaving it out
    gives a lower bound: the error itself where its axis is the tip's z and its limits allow the best twist (what they cost
    is added by `twist_cost`). Elsewhere it is left out if at q that loses less than half the gap.
    """
    chain, goal = problem.chain, problem.goal
    fixed, target, head, tail = _divided(problem)
    off_axis = float(np.hypot(*fixed[-1, :2, 3]))
    if tail and off_axis < 1e-6:
        cut, axis = _cut(fixed, target, float(fixed[-1, 2, 3]))
        wanted = Wanted(axis, np.zeros((3, 4)), _scalars(problem, axis, 1, trust))
        wanted.scalars[MARGIN] += 2.0 * off_axis
        aligned = np.hypot(*fixed[-1, :2, 2]) < _ROUNDING
        if aligned or _loss_of_last(problem, q) < 0.5 * gap:
            roll = _roll(chain, True, goal.orientation_weight if aligned else 0.0)
            return _form(chain, cut, head, 1, 0, 0.0), wanted, roll
    columns = goal.paper_columns
    scalars, last, foot = _scalars(problem, target, columns, trust), np.zeros((3, 4)), 0.0
    if tail and len(fixed) > 2:
        foot = _foot(fixed, chain)
        place_of_foot = np.eye(4)
        place_of_foot[2, 3] = foot
        last = np.ascontiguousarray((_square(target) @ _square(inverse(fixed[-1])) @ place_of_foot)[:3])
        scalars[OFFSET] = np.linalg.norm(fixed[-1, :, 3] - [0.0, 0.0, foot])
    else:
        tail = False
    return (
        _form(chain, fixed, head, columns, int(tail), foot),
        Wanted(target, last, scalars),
        Roll(False, 0.0, 0.0, 0.0),
    )


def _loss_of_last(problem: Problem, q: Array) -> float:
    """Part of the weighted error at q, (n,), that is lost when the columns are compared by the last joint's axis alone."""
    goal, target = problem.goal, problem.goal.targets[0]
    T = forward_pose(problem.arrays, q)
    axis = inverse(problem.arrays.fixed[-1])[:, 2]
    miss = goal.position_weight * float(np.linalg.norm(T[:, 3] - target[:, 3]))
    half = 0.5 * goal.orientation_weight
    tilted = half * float(np.sum(((T - target)[:, :3] @ axis) ** 2))
    turned = half * float(np.sum((T - target)[:, :2] ** 2))
    return 1.0 - (miss + tilted) / max(miss + turned, 1e-300)


def start_boxes(chain: SerialChain, without_last: bool) -> Array:
    """The whole range of the joints as one box, (1, 2 dof); a joint that turns more than once turns once."""
    lower, upper = chain.lower.copy(), chain.upper.copy()
    for i in range(chain.dof):
        followers = np.flatnonzero(chain.leader == i)
        repeats = not chain.prismatic[followers].any() and (chain.multiplier[followers] % 1 == 0).all()
        if repeats and upper[i] - lower[i] > 2 * np.pi:
            middle = (lower[i] + upper[i]) / 2
            lower[i], upper[i] = middle - np.pi, middle + np.pi
    count = chain.dof - int(without_last)
    half = (upper - lower) / 2
    half += LEAST + 1e-15 * np.abs(lower + upper)
    return np.concatenate([(lower + upper)[:count] / 2, half[:count]])[None]


def forward_pose(chain: ChainArrays, q: Array) -> Array:
    """Pose of the tip, (3, 4)."""
    return forward_many(chain, np.ascontiguousarray(q)[None])[0, :3]


def _divided(problem: Problem) -> tuple[Array, Array, int, bool]:
    """Fixed transforms and target with the first joint's place divided out; first joint's kind; is the last one a turn?"""
    division = divide(problem.chain, problem.goal.kind)
    fixed, target = problem.arrays.fixed.copy(), problem.goal.targets[0].copy()
    if division.head != NONE:
        target = (_square(inverse(fixed[0])) @ _square(target))[:3]
        fixed[0] = np.eye(4)[:3]
    return fixed, np.ascontiguousarray(target), division.head, division.tail == TURN


def _foot(fixed: Array, chain: SerialChain) -> float:
    """Where along the last axis the axis before it is nearest [m]; where they are parallel, the tip."""
    tip = float(fixed[-1, 2, 3])
    if len(fixed) < 3 or chain.prismatic[-2]:
        return tip
    back = inverse(fixed[-2])
    axis, point = back[:, 2], back[:, 3]
    apart = 1.0 - axis[2] ** 2
    return float((point[2] - axis[2] * (axis @ point)) / apart) if apart > 1e-6 else tip


def _cut(fixed: Array, target: Array, along: float) -> tuple[Array, Array]:
    """Leave the last joint out: the tip becomes the point `along` its axis, its columns axis, x and y."""
    turned = np.array(
        [[0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [1.0, 0.0, 0.0, along], [0.0, 0.0, 0.0, 1.0]]
    )
    short = fixed[:-1].copy()
    short[-1] = (_square(short[-1]) @ turned)[:3]
    wanted = _square(target) @ _square(inverse(fixed[-1])) @ turned
    return short, np.ascontiguousarray(wanted[:3])


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


def _roll(chain: SerialChain, present: bool, weight: float = 0.0) -> Roll:
    return Roll(present, float(chain.lower[-1]), float(chain.upper[-1]), weight)


def _scalars(problem: Problem, target: Array, columns: int, trust: float) -> Array:
    """Weights and margins: 1e-12 of all lengths involved, a thousand times what rounding takes."""
    chain, goal, scalars = problem.chain, problem.goal, np.zeros(SCALARS)
    length = arm_length(chain)
    slides = sum(
        max(abs(chain.lower[i]), abs(chain.upper[i])) * abs(chain.multiplier[k]) + abs(chain.offset[k])
        for k, i in enumerate(chain.leader)
        if chain.prismatic[k]
    )
    reach = (
        length + slides + float(np.linalg.norm(target[:, 3])) + float(np.linalg.norm(chain.fixed[0, :, 3]))
    )
    if goal.tool is not None:
        reach += float(np.linalg.norm(goal.tool[:3, 3]))
    scalars[MARGIN], scalars[MARGIN_A] = _ROUNDING * (1.0 + reach), _ROUNDING
    scalars[TRUST], scalars[WEIGHT_P] = trust, goal.position_weight
    scalars[WEIGHT_A] = goal.orientation_weight if columns else 0.0
    scalars[LENGTH] = _AXIS_COUNTS * length if columns else 0.0
    return scalars


def _square(A: Array) -> Array:
    return np.vstack([A, [0.0, 0.0, 0.0, 1.0]])


def _certificate(
    problem: Problem, verdict: Verdict, q: Array, lower: float, boxes: int, largest: float
) -> Certificate:
    judged = conclude(problem, q[None], np.zeros((1, 3), dtype=np.int64))
    return Certificate(
        verdict=verdict,
        q=judged.q,
        lower_bound=float(min(lower, judged.weighted_error)),
        upper_bound=float(judged.weighted_error),
        position_error=float(judged.position_error),
        orientation_error=float(judged.orientation_error),
        boxes=int(boxes),
        largest_box=float(largest),
        problem=problem,
    )


@inner
def roll_fits(form: Form, wanted: Wanted, roll: Roll, desk: Desk) -> bool:
    """Can the last joint, within its limits, make up for what is left of the rotation? Its best value goes to ``u[2]``.

    The hand without its last turn is off by a rotation of at most Ω. Write the turn that is asked for as a quaternion: its
    part about the last axis is cos(τ/2) long, τ the tilt. So the last joint is within ``2 acos(cos(Ω/2)/cos(τ/2))``.
    """
    T, goal = desk.T, desk.goal
    m00 = m01 = m10 = m11 = dot = 0.0
    for r in range(3):
        m00 += T[r, 1] * goal[r, 1]
        m01 += T[r, 1] * goal[r, 2]
        m10 += T[r, 2] * goal[r, 1]
        m11 += T[r, 2] * goal[r, 2]
        dot += T[r, 0] * goal[r, 0]
    best = math.atan2(m10 - m01, m00 + m11)
    middle, half = 0.5 * (roll.lower + roll.upper), 0.5 * (roll.upper - roll.lower)
    desk.u[2] = nearest_copy(best, roll.lower, roll.upper, middle)
    if half >= math.pi:
        return True
    omega = wanted.scalars[CHORD] * 1.1 + wanted.scalars[MARGIN_A]
    for k in range(len(form.leader)):
        if not form.prismatic[k]:
            omega += desk.half[k]
    if omega >= math.pi:
        return True
    ratio = math.cos(0.5 * omega) / math.sqrt(max(0.5 * (1.0 + dot), 1e-30))
    # The slack of sqrt(1e-12) covers rounding where the ratio is close to one.
    miss = 2.0 * math.acos(min(ratio, 1.0)) + 2e-6
    off = best - middle
    off -= 2.0 * math.pi * math.floor(off / (2.0 * math.pi) + 0.5)
    return abs(off) <= half + miss


@inner
def twist_cost(form: Form, wanted: Wanted, roll: Roll, desk: Desk, ceiling: float) -> float:
    """What the limits of the last joint add to the weighted error at least, where nothing above `ceiling` matters.

    With tilt τ and a twist β short of the best one the columns cost ``K_A [(1 - cos τ) + (1 + cos τ)(1 - cos β)]``. The
    twist part of a unit quaternion is cos(τ/2) long and moves by no more than the quaternion does, 2 sin(Ω/4).
    """
    middle, half = 0.5 * (roll.lower + roll.upper), 0.5 * (roll.upper - roll.lower)
    if half >= math.pi or roll.weight == 0.0:
        return 0.0
    T, goal = desk.T, desk.goal
    m00 = m01 = m10 = m11 = dot = omega = 0.0
    for r in range(3):
        m00 += T[r, 1] * goal[r, 1]
        m01 += T[r, 1] * goal[r, 2]
        m10 += T[r, 2] * goal[r, 1]
        m11 += T[r, 2] * goal[r, 2]
        dot += T[r, 0] * goal[r, 0]
    for k in range(len(form.leader)):
        omega += 0.0 if form.prismatic[k] else desk.half[k]
    moved = 2.0 * math.sin(0.25 * min(omega, math.pi)) * wanted.scalars[TRUST]
    length = math.sqrt(max(0.5 * (1.0 + dot), 0.0)) - wanted.scalars[MARGIN_A]
    if omega >= math.pi or moved >= length:
        return 0.0
    off = math.atan2(m10 - m01, m00 + m11) - middle
    off -= 2.0 * math.pi * math.floor(off / (2.0 * math.pi) + 0.5)
    beta = abs(off) - half - 2.0 * math.asin(moved / length) - 1e-9
    if beta <= 0.0:
        return 0.0
    return max(2.0 * roll.weight - ceiling, 0.0) * 2.0 * math.sin(0.5 * beta) ** 2


@inner
def widest(form: Form, wanted: Wanted, desk: Desk) -> int:
    """The variable whose range moves the hand most."""
    best, index = -1.0, 0
    for i in range(len(desk.c)):
        desk.delta[i] = 0.0
    for k in range(len(form.leader)):
        turn = (
            0.0 if form.prismatic[k] else wanted.scalars[LENGTH] * (desk.s[k] if form.columns == 1 else 1.0)
        )
        if form.columns == 0:
            turn = 0.0
        i = form.leader[k]
        desk.delta[i] += abs(form.multiplier[k]) * desk.h[i] * (desk.r[k] + turn)
    for i in range(len(desk.c)):
        if desk.delta[i] > best:
            best, index = desk.delta[i], i
    return index


@inner
def load_box(boxes: Array, row: int, desk: Desk) -> None:
    """Take a box from row `row` of the list."""
    dof = len(desk.c)
    for i in range(dof):
        desk.c[i] = boxes[row, i]
        desk.h[i] = boxes[row, dof + i]


@inner
def store_box(boxes: Array, row: int, desk: Desk) -> None:
    """Write the box of the desk to row `row`."""
    dof = len(desk.c)
    for i in range(dof):
        boxes[row, i] = desk.c[i]
        boxes[row, dof + i] = desk.h[i]


@inner
def volume(desk: Desk) -> float:
    """Volume of the box."""
    product = 1.0
    for i in range(len(desk.h)):
        product *= desk.h[i]
    return product


@inner
def complete(form: Form, roll: Roll, chain: ChainArrays, desk: Desk, q: Array) -> None:
    """Joint values of the box' centre, (n,), inside the limits."""
    for i in range(len(q)):
        value = desk.u[2] if roll.present and i == len(q) - 1 else desk.c[i]
        if i == 0 and form.head == TURN:
            value = nearest_copy(
                value, chain.lower[0], chain.upper[0], 0.5 * (chain.lower[0] + chain.upper[0])
            )
        q[i] = min(max(value, chain.lower[i]), chain.upper[i])


@inner
def approach(form: Form, wanted: Wanted, roll: Roll, chain: ChainArrays, desk: Desk, q: Array) -> None:
    """Gauss-Newton steps from the middle of the box; the joint values they lead to, (n,), inside the limits."""
    scale = 1.0 / (wanted.scalars[LENGTH] * wanted.scalars[LENGTH] + LEAST)
    weight = 1.0 if form.columns > 0 else 0.0
    T, goal = desk.T, desk.goal
    for _ in range(8):
        place(form, desk)
        turn_goal(form, wanted, desk)
        motion(form, desk, 0, len(form.leader), T[0, 3], T[1, 3], T[2, 3])
        normal_matrix(form, desk, scale, weight, form.columns)
        t0 = t1 = t2 = 0.0
        for i in range(form.columns):
            t0 += T[1, i] * goal[2, i] - T[2, i] * goal[1, i]
            t1 += T[2, i] * goal[0, i] - T[0, i] * goal[2, i]
            t2 += T[0, i] * goal[1, i] - T[1, i] * goal[0, i]
        for i in range(len(desk.c)):
            desk.delta[i], desk.D[i] = 0.0, 1e-9
        for k in range(len(form.leader)):
            rhs = 0.0
            for r in range(3):
                rhs += scale * desk.velocity[k, r] * (T[r, 3] - goal[r, 3])
            if not form.prismatic[k]:
                rhs -= weight * (desk.z[k, 0] * t0 + desk.z[k, 1] * t1 + desk.z[k, 2] * t2)
            desk.delta[form.leader[k]] -= form.multiplier[k] * rhs
        solve(desk.N, desk.D, desk.delta)
        for i in range(len(desk.c)):
            desk.c[i] += desk.delta[i]
            if i > 0 or form.head != TURN:
                desk.c[i] = min(max(desk.c[i], chain.lower[i]), chain.upper[i])
    place(form, desk)
    turn_goal(form, wanted, desk)
    if roll.present:
        roll_fits(form, wanted, roll, desk)
    complete(form, roll, chain, desk, q)


@kernel
def exclude(
    form: Form,
    wanted: Wanted,
    roll: Roll,
    chain: ChainArrays,
    goal: GoalArrays,
    boxes: Array,
    tuning: Array,
    budget: int,
) -> Search:
    """Look for any q within both tolerances, box after box, the last one first.

    Args:
        form: The part of the arm that the boxes are about.
        wanted: What is asked of it.
        roll: The last joint, where it is divided out.
        chain: The whole arm, for the witness.
        goal: The goal as it was asked.
        boxes: Boxes to start with, (k, 2 dof): centres and half widths.
        tuning: Largest spread for the second order [rad], passes, shrink that earns another look.
        budget: Boxes to examine.
    """
    dof, count, seen = boxes.shape[1] // 2, len(boxes), 0
    desk = make_desk(len(form.leader), dof)
    stack = np.empty((count + 64 * dof + 64, 2 * dof))
    for i in range(count):
        for j in range(2 * dof):
            stack[i, j] = boxes[i, j]
    q, T, best = np.zeros(len(chain.lower)), np.empty((3, 4)), np.inf
    trial = np.zeros(len(chain.lower))
    stuck, kept = 0.0, 0
    while count > 0 and seen < budget:
        count -= 1
        load_box(stack, count, desk)
        seen += 1
        place(form, desk)
        widths(form, desk)
        if not first_order(form, wanted, desk, -1.0):
            continue
        spread = 0.0
        for k in range(len(form.leader)):
            spread += 0.0 if form.prismatic[k] else desk.half[k]
        before = volume(desk)
        if spread < tuning[0]:
            if not second_order(form, wanted, desk, -1.0, int(tuning[1])):
                continue
            desk.u[2] = 0.0
            if roll.present and not roll_fits(form, wanted, roll, desk):
                continue
            if volume(desk) < tuning[2] * before:
                store_box(stack, count, desk)
                count += 1
                continue
        i = widest(form, wanted, desk)
        if desk.h[i] < 1e-10 * (1.0 + abs(desk.c[i])):
            stuck = max(stuck, desk.h[i])
            continue
        half = 0.5 * desk.h[i]
        centre = desk.c[i]
        desk.h[i] = half + 1e-15
        desk.c[i] = centre - half
        store_box(stack, count, desk)
        desk.c[i] = centre + half
        store_box(stack, count + 1, desk)
        count += 2
        kept += 1
        if spread < 1.5 and kept % _TRIAL == 0:
            approach(form, wanted, roll, chain, desk, trial)
            forward(chain, trial, T)
            position, orientation = errors(T, goal)
            error = weighted_error(T, goal)
            if error < best:
                best = error
                for j in range(len(q)):
                    q[j] = trial[j]
            if position <= tuning[3] and orientation <= tuning[4]:
                return Search(FOUND, seen, 0.0, trial, 0.0, error)
    largest = stuck
    for k in range(count):
        for i in range(dof):
            largest = max(largest, stack[k, dof + i])
    ended = count == 0 and stuck == 0.0
    return Search(ENDED if ended else STOPPED, seen, largest, q, 0.0, best)


@kernel
def examine(form: Form, wanted: Wanted, roll: Roll, boxes: Array, ceiling: float, passes: int) -> Array:
    """Test boxes one by one, without cutting them in half; for tests and pictures.

    Args:
        form: The part of the arm that the boxes are about.
        wanted: What is asked of it.
        roll: The last joint, where it is divided out.
        boxes: (k, 2 dof): centres and half widths.
        ceiling: Weighted error to stay below, or negative: the tolerances decide.
        passes: Forms tried to second order; 0 leaves it at first order.

    Returns:
        Of each: 1 if anything may be left, else 0; lower bound of the weighted error; the box that is left, (k, 2 + 2 dof).
    """
    dof = boxes.shape[1] // 2
    desk = make_desk(len(form.leader), dof)
    result = np.empty((len(boxes), 2 + 2 * dof))
    for row in range(len(boxes)):
        load_box(boxes, row, desk)
        desk.out[1] = 0.0
        place(form, desk)
        widths(form, desk)
        kept = first_order(form, wanted, desk, ceiling)
        if kept and passes > 0:
            extra = 0.0
            if roll.present and ceiling >= 0.0:
                turn_goal(form, wanted, desk)
                widths(form, desk)
                extra = twist_cost(form, wanted, roll, desk, ceiling)
            kept = extra <= max(ceiling, 0.0) and second_order(form, wanted, desk, ceiling - extra, passes)
            desk.out[1] += extra
            if kept and roll.present and ceiling < 0.0:
                kept = roll_fits(form, wanted, roll, desk)
        result[row, 0] = 1.0 if kept else 0.0
        result[row, 1] = desk.out[1]
        for i in range(dof):
            result[row, 2 + i] = desk.c[i]
            result[row, 2 + dof + i] = desk.h[i]
    return result


@inner
def sift_up(heap: Array, order: Indices, at: int) -> None:
    """Bring the entry at `at` up to its place; `heap` holds the bound of each row, `order` the rows."""
    while at > 0:
        parent = (at - 1) // 2
        if heap[order[parent]] <= heap[order[at]]:
            return
        order[parent], order[at] = order[at], order[parent]
        at = parent


@inner
def sift_down(heap: Array, order: Indices, size: int) -> None:
    """Bring the entry at the top down to its place."""
    at = 0
    while True:
        child = 2 * at + 1
        if child >= size:
            return
        if child + 1 < size and heap[order[child + 1]] < heap[order[child]]:
            child += 1
        if heap[order[at]] <= heap[order[child]]:
            return
        order[child], order[at] = order[at], order[child]
        at = child


@kernel
def enclose(
    form: Form,
    wanted: Wanted,
    roll: Roll,
    chain: ChainArrays,
    goal: GoalArrays,
    boxes: Array,
    q: Array,
    tuning: Array,
    budget: int,
) -> Search:
    """Enclose the least weighted error inside the limits, best box first.

    Args:
        form: The part of the arm that the boxes are about.
        wanted: What is asked of it.
        roll: The last joint, where it is divided out.
        chain: The arm again, to judge joint values by plain forward kinematics.
        goal: The goal as it was asked.
        boxes: Boxes to start with, (k, 2 dof): centres and half widths.
        q: The best joint values known, (n,).
        tuning: Largest spread for the second order [rad], passes, shrink that earns another look, relative gap.
        budget: Boxes to examine.
    """
    dof, count, seen = boxes.shape[1] // 2, len(boxes), 0
    desk = make_desk(len(form.leader), dof)
    capacity = 1024 + count
    rows, bound, order = np.empty((capacity, 2 * dof)), np.zeros(capacity), np.empty(capacity, dtype=np.int64)
    rows[:count] = boxes
    for i in range(count):
        order[i] = i
    used = count
    best, trial, T = q.copy(), q.copy(), np.empty((3, 4))
    forward(chain, q, T)
    upper = weighted_error(T, goal)
    ceiling = (1.0 - tuning[3]) * upper
    stuck_bound, stuck_width = np.inf, 0.0
    while count > 0 and seen < budget:
        row = order[0]
        if bound[row] >= ceiling:
            break
        load_box(rows, row, desk)
        below = bound[row]
        while True:
            desk.out[1] = 0.0
            seen += 1
            place(form, desk)
            widths(form, desk)
            kept = first_order(form, wanted, desk, ceiling)
            below = max(below, desk.out[1])
            spread = 0.0
            for k in range(len(form.leader)):
                spread += 0.0 if form.prismatic[k] else desk.half[k]
            if not kept or spread >= tuning[0]:
                break
            extra = 0.0
            before = volume(desk)
            if roll.present:
                turn_goal(form, wanted, desk)
                roll_fits(form, wanted, roll, desk)
                widths(form, desk)
                extra = twist_cost(form, wanted, roll, desk, ceiling)
            if extra >= ceiling:
                kept, below = False, max(below, extra)
                break
            complete(form, roll, chain, desk, trial)
            kept = second_order(form, wanted, desk, ceiling - extra, int(tuning[1]))
            below = max(below, desk.out[1] + extra)
            if desk.out[0] < upper:
                forward(chain, trial, T)
                error = weighted_error(T, goal)
                if error < upper:
                    upper = error
                    ceiling = (1.0 - tuning[3]) * upper
                    for i in range(len(q)):
                        best[i] = trial[i]
            if not kept or volume(desk) > tuning[2] * before or seen >= budget:
                break
        if kept and below < ceiling:
            i = widest(form, wanted, desk)
            if desk.h[i] < 1e-10 * (1.0 + abs(desk.c[i])):
                stuck_bound, stuck_width = min(stuck_bound, below), max(stuck_width, desk.h[i])
                kept = False
        if not kept or below >= ceiling:
            count -= 1
            order[0], order[count] = order[count], order[0]
            sift_down(bound, order, count)
            continue
        if count + 1 > used and used == capacity:
            rows, bound, order = grown(rows, bound, order)
            capacity = len(bound)
        centre, half = desk.c[i], 0.5 * desk.h[i]
        desk.h[i] = half + LEAST
        desk.c[i] = centre - half
        store_box(rows, row, desk)
        bound[row] = below
        sift_down(bound, order, count)
        if count == used:
            order[count] = used
            used += 1
        desk.c[i] = centre + half
        store_box(rows, order[count], desk)
        bound[order[count]] = below
        sift_up(bound, order, count)
        count += 1
    lower, largest, outcome = ceiling, stuck_width, ENDED
    for k in range(count):
        if bound[order[k]] < ceiling:
            outcome = STOPPED
            lower = min(lower, bound[order[k]])
            for i in range(dof):
                largest = max(largest, rows[order[k], dof + i])
    if stuck_bound < ceiling:
        lower, outcome = min(lower, stuck_bound), STOPPED
    return Search(outcome, seen, largest, best, lower, upper)


@kernel
def grown(rows: Array, bound: Array, order: Indices) -> tuple[Array, Array, Indices]:
    """Twice the room for boxes."""
    more = 2 * len(bound)
    new_rows, new_bound, new_order = (
        np.empty((more, rows.shape[1])),
        np.zeros(more),
        np.empty(more, dtype=np.int64),
    )
    new_rows[: len(bound)] = rows
    new_bound[: len(bound)] = bound
    new_order[: len(bound)] = order
    return new_rows, new_bound, new_order
