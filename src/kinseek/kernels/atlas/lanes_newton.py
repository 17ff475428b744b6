"""Newton's method with the full Hessian for eight configurations at once, towards a goal that is out of reach.

It minimises the weighted error from all lanes together. The derivatives are those of `newton`, and the loops over the lanes
are written as in `lanes`. The Hessian is factorised as L D Lᵀ, with the absolute values of D: the step then leads downhill
also where the Hessian is not positive definite (Gill, Murray and Wright 1981, Sec. 4.4.2). A lane that a step does not
bring nearer returns to where it was and is damped, while the others go on.

The error has a kink where the position is right. It is not treated here, see `newton.bring_back`: a far goal is never there.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np

from kinseek.kernels.arm.links import read_link
from kinseek.kernels.arm.vectors import (
    Twist,
    Vector,
    column,
    cross,
    dot,
    minus,
    plus,
    scaled,
)
from kinseek.kernels.arrays import Array, GoalArrays, Indices, Limits
from kinseek.kernels.jit import inlined, noinline
from kinseek.kernels.layout import Layout

from .descent import goal_of
from .lanes import LANES, Lanes, lanes_forward, pose_column, set_twist, twist_at
from .memory import ACTIVE, CONVERGED, scratch_of
from .newton import ENOUGH, LONGEST
from .seeds import load_seed_row
from .task import Job, Target, task_at

STEPS = 40
"""Largest number of steps."""

MOST = 2 * STEPS + 1
"""Largest number of FK evaluations per lane: if a lane returns, the kinematics of all lanes are computed again."""

FIRST_DAMPING, EASIER, HARDER = 1e-3, 0.1, 8.0
"""Damping after the first step that does not help, relative to the largest entry of the Hessian; its factors after a step
that helps, and after one that does not. With a first damping of 1e-4 an irb120 needed a tenth more steps."""

FORGET, MOST_DAMPING = 1e-4, 1e6
"""Damping up to which a step that helps ends it, and beyond which only rounding is left."""

FLATTEST = 1e-9
"""Smallest pivot of the factorisation, relative to the largest diagonal entry."""

ZERO = 1e-100
"""A Hessian whose diagonal entries are all smaller counts as zero; the inverse of a smaller pivot could overflow."""

OUTLOOK, EARLY = 10.0, 8
"""A lane ends if so many times the predicted decrease would not bring it below the best lane. In the first steps this counts
only where the prediction is good: where the Hessian is positive definite and not damped. With an outlook of 5, twice as many
goals of a rizon4, 8 in 100, got a pose that is up to 2 per cent worse than the best known; 20 did not help."""


class Model(NamedTuple):
    """The second-order model of the error of every lane; arrays of fixed size first, so that LLVM knows where they are."""

    direction: Annotated[Array, 3, LANES]
    """From the target to the tip, a unit vector, (3, LANES)."""
    torque: Annotated[Array, 3, LANES]
    """Σ K_c c × c_g over the columns c of a rotation and c_g of its target, (3, LANES)."""
    cosine: Annotated[Array, LANES]
    """Σ K_c c·c_g, (LANES,)."""
    spread: Annotated[Array, 3, 3, LANES]
    """Σ K_c c c_gᵀ, (3, 3, LANES)."""
    curve: Annotated[Array, 3, LANES]
    """Derivative of the gradient of a more proximal joint by the joint at hand: its product with that joint's axis is the
    curvature, (3, LANES)."""
    pull: Annotated[Array, LANES]
    """K_P divided by the distance [1/m], (LANES,)."""
    error: Annotated[Array, LANES]
    """Smallest weighted error so far, (LANES,)."""
    now: Annotated[Array, LANES]
    """Weighted error of the last step, (LANES,)."""
    damping: Annotated[Array, LANES]
    """Relative to the largest diagonal entry of the Hessian, (LANES,)."""
    largest: Annotated[Array, LANES]
    """That entry; where all are zero, the largest entry of the gradient, (LANES,)."""
    steepest: Annotated[Array, LANES]
    """Largest entry of the gradient of a free joint, (LANES,)."""
    predicted: Annotated[Array, LANES]
    """Decrease of the error that the model predicts for the step, (LANES,)."""
    convex: Annotated[Array, LANES]
    """1 if the Hessian is positive definite, else 0, (LANES,)."""
    share: Annotated[Array, LANES]
    """Fraction of the step that is taken, (LANES,)."""
    best: Annotated[Array, "dof", LANES]
    """Joint values of the smallest error so far, (n, LANES)."""
    gradient: Annotated[Array, "dof", LANES]
    """(n, LANES)"""
    free: Annotated[Array, "dof", LANES]
    """0 for a joint that is at a limit and would move outward, else 1, (n, LANES)."""
    pivot: Annotated[Array, "dof", LANES]
    """1/|D|, (n, LANES)."""
    moves: Annotated[Array, "joints", 6, LANES]
    """Velocity of the tip by each joint, and its angular velocity, (m, 6, LANES)."""
    along: Annotated[Array, "joints", LANES]
    """Component of that velocity along `direction`, (m, LANES)."""
    hessian: Annotated[Array, "pairs", LANES]
    """Its lower triangle row by row, see `pair`, (n (n + 1) / 2, LANES)."""
    factor: Annotated[Array, "pairs", LANES]
    """L, likewise."""
    product: Annotated[Array, "pairs", LANES]
    """L |D|, likewise."""


LAYOUT = Layout(Model, ("dof", "joints", "pairs"))

model_size, lay_model = LAYOUT.size, LAYOUT.make


@inlined
def pair(i: int, j: int) -> int:
    """Place of row i and column j ≤ i in a lower triangle."""
    return i * (i + 1) // 2 + j


@inlined
def vector_of(rows: Array, l: int) -> Vector:
    """Three rows of a lane, (3, LANES)."""
    return Vector(rows[0, l], rows[1, l], rows[2, l])


@inlined
def set_vector(rows: Array, l: int, value: Vector) -> None:
    """Set three rows of a lane, (3, LANES)."""
    rows[0, l], rows[1, l], rows[2, l] = value


@inlined
def lanes_errors(goal: GoalArrays, lanes: Lanes, now: Array, w: int) -> None:
    """Write the weighted error of every lane, (LANES,), see `pose_error.weighted_error`."""
    place = column(goal.target, 3)
    for l in range(w):
        gap = minus(pose_column(lanes.pose, 3, l), place)
        now[l] = goal.position_weight * math.sqrt(dot(gap, gap))
    for c in range(3):
        weight, axis = goal.axis_weights[c], column(goal.target, c)
        for l in range(w):
            change = minus(pose_column(lanes.pose, c, l), axis)
            now[l] += 0.5 * weight * dot(change, change)


@inlined
def lanes_sums(goal: GoalArrays, lanes: Lanes, model: Model, w: int) -> None:
    """Compute what the derivatives by all joints share: where the tip is from the target, and how it is turned."""
    T, spread, place = lanes.pose, model.spread, column(goal.target, 3)
    for l in range(w):
        gap = minus(pose_column(T, 3, l), place)
        near = 1.0 / math.sqrt(dot(gap, gap))
        set_vector(model.direction, l, scaled(near, gap))
        set_vector(model.torque, l, Vector(0.0, 0.0, 0.0))
        model.pull[l], model.cosine[l] = goal.position_weight * near, 0.0
        for r in range(3):
            set_vector(spread[r], l, Vector(0.0, 0.0, 0.0))
    for c in range(3):
        weight, wanted = goal.axis_weights[c], column(goal.target, c)
        if weight == 0.0:
            continue
        for l in range(w):
            axis = scaled(weight, pose_column(T, c, l))
            set_vector(model.torque, l, plus(vector_of(model.torque, l), cross(axis, wanted)))
            model.cosine[l] += dot(axis, wanted)
            set_vector(spread[0], l, plus(vector_of(spread[0], l), scaled(axis.x, wanted)))
            set_vector(spread[1], l, plus(vector_of(spread[1], l), scaled(axis.y, wanted)))
            set_vector(spread[2], l, plus(vector_of(spread[2], l), scaled(axis.z, wanted)))


@inlined
def lanes_derivatives(
    leader: Indices, links: Array, goal: GoalArrays, lanes: Lanes, model: Model, w: int
) -> None:
    """Compute gradient and Hessian of every lane from its pose and axes, see `newton.derivatives`.

    With the velocity v and the angular velocity ω of the tip by a joint, 0 for the motion that the joint does not have, the
    formulas there hold for joints that turn and that slide: ``ω`` takes the place of the axis.
    """
    T, axes, moves, along, H = lanes.pose, lanes.axes, model.moves, model.along, model.hessian
    lanes_sums(goal, lanes, model, w)
    for i in range(len(model.gradient)):
        for l in range(w):
            model.gradient[i, l] = 0.0
    for r in range(len(H)):
        for l in range(w):
            H[r, l] = 0.0
    for b in range(len(leader)):
        j, link = leader[b], read_link(links[b])
        for l in range(w):
            joint, toward = twist_at(axes[b], l), vector_of(model.direction, l)
            turn = scaled(link.turn_rate, joint.linear)
            lever = minus(pose_column(T, 3, l), joint.angular)
            move = plus(cross(turn, lever), scaled(link.slide_rate, joint.linear))
            set_twist(moves[b], l, Twist(move, turn))
            along[b, l] = dot(toward, move)
            slope = goal.position_weight * along[b, l] - dot(turn, vector_of(model.torque, l))
            model.gradient[j, l] += slope
        for l in range(w):
            motion, toward = twist_at(moves[b], l), vector_of(model.direction, l)
            turn, spread = motion.angular, model.spread
            projected = Vector(
                dot(vector_of(spread[0], l), turn),
                dot(vector_of(spread[1], l), turn),
                dot(vector_of(spread[2], l), turn),
            )
            bend = scaled(goal.position_weight, cross(motion.linear, toward))
            set_vector(model.curve, l, minus(plus(bend, scaled(model.cosine[l], turn)), projected))
        for a in range(b + 1):
            i = leader[a]
            row = pair(max(i, j), min(i, j))
            # Two joints that the same variable moves: the sum over all pairs has (a, b) and (b, a).
            count = 2.0 if a != b and i == j else 1.0
            for l in range(w):
                before, motion = twist_at(moves[a], l), twist_at(moves[b], l)
                level = dot(before.linear, motion.linear) - along[a, l] * along[b, l]
                curvature = dot(before.angular, vector_of(model.curve, l))
                H[row, l] += count * (model.pull[l] * level + curvature)


@inlined
def lanes_factorise(model: Model, w: int) -> None:
    """Factorise the damped Hessian of the free joints of every lane into L |D| Lᵀ."""
    H, L, product, pivot, free = model.hessian, model.factor, model.product, model.pivot, model.free
    for l in range(w):
        model.convex[l] = 1.0
    for i in range(len(pivot)):
        for j in range(i):
            row = pair(i, j)
            for l in range(w):
                product[row, l] = free[i, l] * free[j, l] * H[row, l]
            for k in range(j):
                left, right = pair(i, k), pair(j, k)
                for l in range(w):
                    product[row, l] -= L[right, l] * product[left, l]
            for l in range(w):
                L[row, l] = product[row, l] * pivot[j, l]
        row = pair(i, i)
        for l in range(w):
            pivot[i, l] = H[row, l] + model.damping[l] * model.largest[l]
        for k in range(i):
            left = pair(i, k)
            for l in range(w):
                pivot[i, l] -= L[left, l] * product[left, l]
        for l in range(w):
            value, least = pivot[i, l], FLATTEST * model.largest[l]
            model.convex[l] = model.convex[l] if value >= least or free[i, l] == 0.0 else 0.0
            pivot[i, l] = 1.0 / max(abs(value), least)


@inlined
def lanes_newton(limits: Limits, lanes: Lanes, model: Model, w: int) -> None:
    """Compute the damped step of every lane, and the decrease that it promises."""
    g, L, free, pivot, step, n = (
        model.gradient,
        model.factor,
        model.free,
        model.pivot,
        lanes.step,
        len(lanes.q),
    )
    for l in range(w):
        model.largest[l], model.steepest[l], model.predicted[l], model.share[l] = 0.0, 0.0, 0.0, LONGEST
    for i in range(n):
        low, high, row = limits.lower[i], limits.upper[i], pair(i, i)
        for l in range(w):
            q, slope = lanes.q[i, l], g[i, l]
            free[i, l] = 0.0 if (q <= low and slope > 0.0) or (q >= high and slope < 0.0) else 1.0
            model.largest[l] = max(model.largest[l], abs(model.hessian[row, l]))
            model.steepest[l] = max(model.steepest[l], free[i, l] * abs(slope))
    for l in range(w):
        # Steepest descent, for example a slide towards a distant goal: the Hessian gives no scale.
        zero = model.largest[l] < ZERO
        model.largest[l] = max(model.steepest[l], ZERO) if zero else model.largest[l]
    lanes_factorise(model, w)
    for i in range(n):
        for l in range(w):
            step[i, l] = -free[i, l] * g[i, l]
        for k in range(i):
            row = pair(i, k)
            for l in range(w):
                step[i, l] -= L[row, l] * step[k, l]
        for l in range(w):
            model.predicted[l] += 0.5 * step[i, l] * step[i, l] * pivot[i, l]
    for back in range(n):
        i = n - 1 - back
        for l in range(w):
            step[i, l] *= pivot[i, l]
        for k in range(i + 1, n):
            row = pair(k, i)
            for l in range(w):
                step[i, l] -= L[row, l] * step[k, l]
        for l in range(w):
            model.share[l] = max(model.share[l], abs(step[i, l]))
    for l in range(w):
        model.share[l] = LONGEST / model.share[l]


@inlined
def keep_or_return(lanes: Lanes, state: Indices, model: Model) -> tuple[int, bool]:
    """Keep the step of each active lane that came nearer; let the others return to where they were.

    Returns:
        The number of active lanes that were moved, and whether one of them returned.
    """
    moved, returned, error, now, damping = 0, False, model.error, model.now, model.damping
    for l in range(LANES):
        if state[l] != ACTIVE:
            continue
        moved += 1
        if now[l] < error[l]:
            gain, error[l] = error[l] - now[l], now[l]
            for i in range(len(lanes.q)):
                model.best[i, l] = lanes.q[i, l]
            damping[l] = EASIER * damping[l] if damping[l] > FORGET else 0.0
            state[l] = CONVERGED if gain <= ENOUGH * error[l] else ACTIVE
        else:
            for i in range(len(lanes.q)):
                lanes.q[i, l] = model.best[i, l]
            damping[l] = max(HARDER * damping[l], FIRST_DAMPING)
            state[l] = CONVERGED if damping[l] > MOST_DAMPING else ACTIVE
            returned = True
    return moved, returned


@inlined
def drop_hopeless(state: Indices, model: Model, made: int) -> int:
    """End the lanes that are at a minimum, or will not come nearer than the best one; return the number of the others."""
    active, least = 0, model.error[0]
    for l in range(LANES):
        least = min(least, model.error[l])
    for l in range(LANES):
        error, decrease = model.error[l], model.predicted[l]
        reliable = made >= EARLY or (model.convex[l] > 0.0 and model.damping[l] == 0.0)
        if decrease <= ENOUGH * error or (reliable and error - OUTLOOK * decrease > least):
            state[l] = CONVERGED
        active += 1 if state[l] == ACTIVE else 0
    return active


@noinline
def minimise_lanes(job: Job, target: Target) -> int:
    """Walk from the eight best to minima of the weighted error to a target, (3, 4); return FK evaluations."""
    task, w = task_at(job), job.width
    scratch, goal = scratch_of(job, task), goal_of(task, target)
    lanes, state, leader, dof = scratch.lanes, scratch.state, task.chain.leader, len(task.lower)
    limits, pairs, spent = Limits(task.lower, task.upper), pair(dof, 0), 0
    memory = np.empty(model_size(dof, len(leader), pairs))
    model: Model = lay_model(memory.ctypes.data, dof, len(leader), pairs)
    for l in range(LANES):
        load_seed_row(lanes, l, scratch.best)
        state[l], model.error[l], model.damping[l] = ACTIVE, np.inf, 0.0
    for made in range(STEPS + 1):
        lanes_forward(leader, task.links, lanes, w)
        lanes_errors(goal, lanes, model.now, w)
        moved, returned = keep_or_return(lanes, state, model)
        spent += moved
        if made == STEPS:
            break
        if returned:
            lanes_forward(leader, task.links, lanes, w)
            spent += moved
        lanes_derivatives(leader, task.links, goal, lanes, model, w)
        lanes_newton(limits, lanes, model, w)
        if drop_hopeless(state, model, made) == 0:
            break
        for i in range(dof):
            low, high = limits.lower[i], limits.upper[i]
            for l in range(w):
                lanes.q[i, l] = min(max(lanes.q[i, l] + model.share[l] * lanes.step[i, l], low), high)
    for l in range(LANES):
        scratch.best_error[l] = model.error[l]
        for i in range(dof):
            scratch.best[l, i] = model.best[i, l]
    memory[0] = 0.0  # Its last use, see `one_goal.solve_pose`.
    return spent
