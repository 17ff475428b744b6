"""Levenberg-Marquardt with finite differences, with many seeds in one call of the function.

The residuals are differences of positions and of rotation columns, scaled by the mechanism's size. Joint values are scaled
by their ranges, so that nothing depends on their units. A joint that a step would push through a limit stops there, and the
step of the others is computed again. Forward differences are accurate enough: a relative error ε of the slopes leaves ε of
the distance after each step, so a residual that can vanish still falls by a factor of a million.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinseek.robots.mechanism import Mechanism
from kinseek.support.turns import TURN

from .evaluator import Evaluator

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

DIFFERENCE = 1e-6
"""Step of the differences, as a fraction of a joint's span: the slopes tolerate noise of 1e-10 in the function."""
COARSE = 3e-4
"""The same for a function in single precision."""
LONGEST = 0.2
"""Largest motion of a joint in one step, as a fraction of its range. Not examined further."""
LOST = 1e-14
"""Lower bound of the damping, per joint. A smaller one is lost in rounding beside the slopes, and the system is then
singular if a joint has no effect."""
DAMPING = 1e-2
"""First damping, relative to the mean diagonal of the squared slopes. Not examined further."""


class Ends(NamedTuple):
    """End points of the lanes of a walk, in the order of their seeds."""

    q: Array
    """Best joint values of each, (k, n)."""
    away: Array
    """Features minus the target's there, (k, m); NaN if the mechanism cannot be assembled at the seed itself."""
    solved: Flags
    """Whether both tolerances are met, (k,)."""


def walk(
    evaluator: Evaluator,
    length: float,
    seeds: Array,
    steps: int,
    *,
    first_only: bool = True,
    polish: bool = False,
) -> Ends:
    """Minimise from every seed, (k, n).

    Args:
        evaluator: The function and the target.
        length: Length of the mechanism [m].
        seeds: Joint values inside the limits.
        steps: Most steps of each lane.
        first_only: Stop as soon as one lane meets both tolerances.
        polish: Minimise the goal's own weighted error, not the squared error: for a goal that may be out of reach.
    """
    box = evaluator.box
    dof, rows = box.dof, 1 + box.dof
    # Every seed needs one pose and one more for each joint. Seeds that the budget does not cover are dropped.
    seeds = seeds[: max(evaluator.left // rows, 0)]
    ends = Ends(
        seeds.copy(), np.full((len(seeds), len(evaluator.target)), np.nan), np.zeros(len(seeds), dtype=bool)
    )
    if not len(seeds):
        return ends
    scale = np.array(
        [1.0 / length] * 3 + [np.sqrt(evaluator.goal.form.column_weight)] * (len(evaluator.target) - 3)
    )
    span = box.span
    lanes = np.arange(len(seeds))
    trial, q = seeds.copy(), seeds.copy()
    away = np.full((len(seeds), len(evaluator.target)), np.nan)
    slopes = np.zeros((len(seeds), len(evaluator.target), dof))
    cost = np.full(len(seeds), np.inf)
    promised = np.ones(len(seeds))
    damping, growth = np.full(len(seeds), DAMPING), np.full(len(seeds), 2.0)

    for step in range(steps + 1):
        got, new_slopes = differences_and_slopes(evaluator, trial)
        value = evaluator.weighted(got) if polish else squared(got * scale)
        better = value < cost
        with np.errstate(invalid="ignore"):
            drop = cost - value
        # Nielsen 1999: update the damping by the ratio of the actual to the predicted decrease.
        gain = np.where(better, drop / promised, 0.0) if step else np.ones(len(lanes))
        q[better], away[better], slopes[better] = trial[better], got[better], new_slopes[better]
        if step:
            shrink = np.maximum(1.0 / 5.0, 1.0 - (2.0 * np.minimum(gain, 1.0) - 1.0) ** 3)
            damping = np.where(better, damping * shrink, damping * growth)
            growth = np.where(better, 2.0, 2.0 * growth)
        stalled = better & (drop <= 1e-12 * value) & (step > 0)
        cost = np.where(better, value, cost)
        ends.q[lanes], ends.away[lanes] = q, away
        solved = evaluator.within(away)
        ends.solved[lanes] = solved
        if step == steps or (first_only and solved.any()):
            break
        alive = ~solved & ~stalled & np.isfinite(cost) & (damping < 1e10)
        alive[max(evaluator.left // rows, 0) :] = False
        if not alive.any():
            break
        lanes, q, away, slopes, cost, damping, growth = (
            each[alive] for each in (lanes, q, away, slopes, cost, damping, growth)
        )
        weights = np.broadcast_to(scale, away.shape)
        if polish:
            weights = polish_weights(evaluator, away, length)
        move, promised = bounded_step(away * weights, slopes * weights[:, :, None] * span, damping, q, box)
        trial = into_range(box, q + move * span)
    return ends


def squared(residual: Array) -> Array:
    """Return half of the squared residuals of each lane, infinite without a pose, (k, m) -> (k,)."""
    value = (residual**2).sum(axis=1) / 2
    return np.where(np.isnan(value), np.inf, value)


def polish_weights(evaluator: Evaluator, away: Array, length: float) -> Array:
    """Return the square roots of the weights that turn the weighted error into squares, (k, m).

    ``K_P |Δp|`` has a kink at 0. Everywhere else it equals the square ``(K_P / 2|Δp|) |Δp|²`` with fixed weight, with half
    of its slope (Weiszfeld 1937).
    """
    weights = np.empty_like(away)
    far = np.maximum(np.sqrt((away[:, :3] ** 2).sum(axis=1)), 1e-9 * length)
    weights[:, :3] = np.sqrt(evaluator.goal.position_weight / far)[:, None]
    for i, column in enumerate(evaluator.columns):
        weights[:, 3 + 3 * i : 6 + 3 * i] = np.sqrt(evaluator.goal.arrays.axis_weights[column])
    return weights


def differences_and_slopes(evaluator: Evaluator, q: Array) -> tuple[Array, Array]:
    """Return differences from the target, (k, n) -> (k, m), and their slopes, (k, m, n), from one call of the function."""
    box, count = evaluator.box, len(q)
    step = (COARSE if box.single else DIFFERENCE) * box.span
    # The function is called inside the limits only.
    step = np.where(q + step > box.upper, -step, step)
    rows = np.repeat(q[:, None], 1 + box.dof, axis=1)
    joint = np.arange(box.dof)
    rows[:, 1 + joint, joint] += step
    got = evaluator.differences(rows.reshape(-1, box.dof)).reshape(count, 1 + box.dof, -1)
    if box.partial:
        step = _other_side(evaluator, q, step, got)
    # The step after rounding, which is the one that the function has seen.
    taken = rows[:, 1 + joint, joint] - q if not box.partial else (q + step) - q
    with np.errstate(invalid="ignore", divide="ignore"):
        slopes = (got[:, 1:] - got[:, :1]) / taken[:, :, None]
    slopes[~np.isfinite(slopes)] = 0.0  # The joint has no range, or no pose is known here.
    return got[:, 0], np.swapaxes(slopes, 1, 2)


def _other_side(evaluator: Evaluator, q: Array, step: Array, got: Array) -> Array:
    """Evaluate a step backward if the mechanism cannot be assembled a step forward; update `got` and return the steps."""
    box = evaluator.box
    backward = q - step
    retry = (
        np.isnan(got[:, 1:, 0]) & ~np.isnan(got[:, :1, 0]) & (backward >= box.lower) & (backward <= box.upper)
    )
    lane, joint = np.nonzero(retry)
    left = max(evaluator.left, 0)
    lane, joint = lane[:left], joint[:left]
    if len(lane):
        rows = q[lane].copy()
        rows[np.arange(len(lane)), joint] = backward[lane, joint]
        got[lane, 1 + joint] = evaluator.differences(rows)
        step = step.copy()
        step[lane, joint] *= -1.0
    return step


def bounded_step(
    residual: Array, slopes: Array, damping: Array, q: Array, box: Mechanism
) -> tuple[Array, Array]:
    """Return damped least-squares steps within the limits, relative to the ranges, (k, n), and the predicted decrease, (k,).

    A joint that the step would push through a limit stops there, and the step of the others is computed again.
    """
    dof = box.dof
    span = box.span
    H = np.swapaxes(slopes, 1, 2) @ slopes
    g = -(np.swapaxes(slopes, 1, 2) @ residual[:, :, None])[:, :, 0]
    mean = np.maximum(np.trace(H, axis1=1, axis2=2) / dof, 1e-30)
    shift = np.maximum(damping, LOST * dof) * mean
    A = H + shift[:, None, None] * np.eye(dof)
    with np.errstate(invalid="ignore", divide="ignore"):
        down = np.where(span > 0, (box.lower - q) / span, 0.0)
        up = np.where(span > 0, (box.upper - q) / span, 0.0)
    down[:, box.full], up[:, box.full] = -np.inf, np.inf
    at_limit = np.zeros(q.shape, dtype=bool)
    move = np.zeros(q.shape)
    for _ in range(dof + 1):
        fixed = np.where(at_limit, move, 0.0)
        loose = ~at_limit[:, :, None] & ~at_limit[:, None, :]
        M = np.where(loose, A, np.eye(dof))
        # The motion of a joint that stops at its limit is known, so its products go to the right side.
        right = np.where(at_limit, fixed, g - (A @ fixed[:, :, None])[:, :, 0])
        move = np.linalg.solve(M, right[:, :, None])[:, :, 0]
        through = ~at_limit & ((move < down) | (move > up))
        if not through.any():
            break
        move = np.clip(move, down, up)
        at_limit |= through
    longest = np.abs(move).max(axis=1)
    move *= (LONGEST / np.maximum(longest, LONGEST))[:, None]
    # The decrease of the quadratic model itself, without the damping.
    promised = (move * (g - (H @ move[:, :, None])[:, :, 0] / 2)).sum(axis=1)
    return move, np.maximum(promised, 1e-300)


def into_range(box: Mechanism, q: Array) -> Array:
    """Move joint values inside the limits, (k, n); periodic joints by whole turns."""
    outside = box.full & ((q < box.lower) | (q > box.upper))
    wrapped = np.where(outside, box.lower + np.mod(q - box.lower, TURN), q)
    return np.clip(wrapped, box.lower, box.upper)
