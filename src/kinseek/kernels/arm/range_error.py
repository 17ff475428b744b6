"""Errors of a pose for a goal with ranges: the deviation along six axes, and its part outside the ranges."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np

from kinseek.kernels.arrays import Array, ChainArrays
from kinseek.kernels.entry import OUT
from kinseek.kernels.jit import entry, inlined, noinline

from .forward import forward

FRAME, LOW, HIGH, SWING, SWINGS = 12, 21, 27, 33, 36
"""Indices into a question, an array that is passed by its address. After the target, (3, 4): the frame, (3, 3), lower and
upper ends, (6,) each, the swing axis, (3,), and whether there is one."""

QUESTION = SWINGS + 1
"""Length of a question."""

OPPOSITE = 1e-12
"""Sine of the angle between two axes below which the axis of the rotation between them is mostly rounding; the error of
the sine itself is 1e-16."""

ALONG = 0.6
"""If the x component of a unit axis is smaller than this, the axis and x define a normal well. Of any three axes one has
a component below 0.58."""


@inlined
def rotation_vector(D: Array, out: Array) -> None:
    """Write the rotation vector of D, nine numbers row by row, into out[3:6], accurate at 0 and at π alike."""
    trace = D[0] + D[4] + D[8]
    if trace > 0.0:
        w, x, y, z = 1.0 + trace, D[7] - D[5], D[2] - D[6], D[3] - D[1]
    elif D[0] >= D[4] and D[0] >= D[8]:
        w, x, y, z = D[7] - D[5], 1.0 + D[0] - D[4] - D[8], D[1] + D[3], D[2] + D[6]
    elif D[4] >= D[8]:
        w, x, y, z = D[2] - D[6], D[1] + D[3], 1.0 + D[4] - D[0] - D[8], D[5] + D[7]
    else:
        w, x, y, z = D[3] - D[1], D[2] + D[6], D[5] + D[7], 1.0 + D[8] - D[0] - D[4]
    sine = math.sqrt(x * x + y * y + z * z)
    scale = 2.0 * math.atan2(sine, abs(w)) / sine if sine > 0.0 else 0.0
    if w < 0.0:
        scale = -scale
    out[3], out[4], out[5] = scale * x, scale * y, scale * z


@noinline
def deviation(T: Array, question: Array, out: Array, work: Array) -> None:
    """Write the six components of the deviation of T, (3, 4), into out, (6,), and data for `rows_of` into work, (27,)."""
    F, target = question[FRAME:LOW], question[:FRAME]
    for c in range(3):
        out[c] = 0.0
        for r in range(3):
            out[c] += F[3 * r + c] * (T[r, 3] - target[4 * r + 3])
    # D = (Fᵀ R) (R_gᵀ F), or D a alone.
    for r in range(3):
        for c in range(3):
            left, right = 0.0, 0.0
            for k in range(3):
                left += F[3 * k + r] * T[k, c]
                right += target[4 * k + r] * F[3 * k + c]
            work[9 + 3 * r + c], work[18 + 3 * r + c] = left, right
    for r in range(3):
        for c in range(3):
            work[3 * r + c] = (
                work[9 + 3 * r] * work[18 + c]
                + work[10 + 3 * r] * work[21 + c]
                + work[11 + 3 * r] * work[24 + c]
            )
    if question[SWINGS] == 0.0:
        rotation_vector(work, out)
        return
    ax, ay, az = question[SWING], question[SWING + 1], question[SWING + 2]
    ux = work[0] * ax + work[1] * ay + work[2] * az
    uy = work[3] * ax + work[4] * ay + work[5] * az
    uz = work[6] * ax + work[7] * ay + work[8] * az
    x, y, z = ay * uz - az * uy, az * ux - ax * uz, ax * uy - ay * ux
    sine, cosine = math.sqrt(x * x + y * y + z * z), ax * ux + ay * uy + az * uz
    if sine < OPPOSITE and cosine < 0.0:  # Any axis normal to it will do.
        x, y, z = (0.0, az, -ay) if abs(ax) < ALONG else (-az, 0.0, ax)
        sine = math.sqrt(x * x + y * y + z * z)
        scale = math.pi / sine
    else:
        scale = math.atan2(sine, cosine) / sine if sine > 0.0 else 1.0
    out[3], out[4], out[5] = scale * x, scale * y, scale * z
    work[9], work[10], work[11] = ux, uy, uz


@inlined
def beyond(value: float, low: float, high: float) -> float:
    """Distance of a value outside a range."""
    return max(low - value, value - high, 0.0)


@inlined
def range_errors(out: Array, question: Array) -> tuple[float, float]:
    """Norms of the parts of a deviation, (6,), outside the ranges: position error [m] and orientation error [rad]."""
    place, turn = 0.0, 0.0
    for i in range(3):
        gap = beyond(out[i], question[LOW + i], question[HIGH + i])
        place += gap * gap
        angle = out[3 + i]
        if question[SWINGS] == 0.0:
            angle = beyond(angle, question[LOW + 3 + i], question[HIGH + 3 + i])
        turn += angle * angle
    return math.sqrt(place), math.sqrt(turn)


@inlined
def range_weighted(weight_p: float, weight_o: float, place: float, turn: float) -> float:
    """``K_P e_p + K_A (1 - cos e_o)``, by the half angle, because the difference would cancel near 0."""
    half = math.sin(0.5 * turn)
    return weight_p * place + 2.0 * weight_o * half * half


@entry
def write_range_errors(
    chain: ChainArrays,
    q: Annotated[Array, "k", "n"],
    questions: Annotated[Array, "k", QUESTION],
    weight_p: float,
    weight_o: float,
    result: Annotated[Array, "k", 3, OUT],
) -> None:
    """Write the result of `judge_ranges` into `result`, (k, 3)."""
    T, out, work = np.empty((3, 4)), np.empty(6), np.empty(27)
    for k in range(len(q)):
        forward(chain, q[k], T)
        deviation(T, questions[k], out, work)
        result[k, 0], result[k, 1] = range_errors(out, questions[k])
        result[k, 2] = range_weighted(weight_p, weight_o, result[k, 0], result[k, 1])


def judge_ranges(chain: ChainArrays, q: Array, questions: Array, weight_p: float, weight_o: float) -> Array:
    """Compute the errors of joint values by plain FK.

    Args:
        chain: The arm.
        q: Joint values, (k, n).
        questions: The goals, see `FRAME`, (k, QUESTION).
        weight_p: K_P, per [m].
        weight_o: K_A.

    Returns:
        Position error [m], orientation error [rad] and weighted error of each, (k, 3).
    """
    result = np.empty((len(q), 3))
    write_range_errors(
        chain, np.ascontiguousarray(q), np.ascontiguousarray(questions), weight_p, weight_o, result
    )
    return result
