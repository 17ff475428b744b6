"""Errors of a pose for a goal with ranges: the deviation along six axes, and its part outside the ranges."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np

from kinseek.kernels.arrays import Array, ChainArrays
from kinseek.kernels.entry import OUT
from kinseek.kernels.jit import entry, inlined, noinline

from .forward import forward
from .vectors import (
    Matrix,
    Vector,
    column,
    columns,
    cross,
    dot,
    matrix_of,
    matrix_product,
    minus,
    norm,
    scaled,
    times,
    transposed_product,
    transposed_times,
    vector_at,
)

FRAME, LOW, HIGH, SWING, SWINGS, CONE = 12, 21, 27, 33, 36, 37
"""Indices into a question, an array that is passed by its address. After the target, (3, 4): the frame, (3, 3), lower and
upper ends, (6,) each, the swing axis, (3,), whether there is one, and the largest accepted angle of the swing [rad]."""

QUESTION = CONE + 1
"""Length of a question."""

OPPOSITE = 1e-12
"""Sine of the angle between two axes below which the axis of the rotation between them is mostly rounding; the error of
the sine itself is 1e-16."""

ALONG = 0.6
"""If the x component of a unit axis is smaller than this, the axis and x define a normal well. Of any three axes one has
a component below 0.58."""


@inlined
def rotation_vector(D: Matrix) -> Vector:
    """The rotation vector of D, accurate at 0 and at π alike.

    Of the quaternion that D determines up to a factor, the largest component is computed by a sum without cancellation
    (Shepperd 1978).
    """
    trace = D.x.x + D.y.y + D.z.z
    if trace > 0.0:
        w, v = 1.0 + trace, Vector(D.y.z - D.z.y, D.z.x - D.x.z, D.x.y - D.y.x)
    elif D.x.x >= D.y.y and D.x.x >= D.z.z:
        w, v = D.y.z - D.z.y, Vector(1.0 + D.x.x - D.y.y - D.z.z, D.y.x + D.x.y, D.z.x + D.x.z)
    elif D.y.y >= D.z.z:
        w, v = D.z.x - D.x.z, Vector(D.y.x + D.x.y, 1.0 + D.y.y - D.x.x - D.z.z, D.z.y + D.y.z)
    else:
        w, v = D.x.y - D.y.x, Vector(D.z.x + D.x.z, D.z.y + D.y.z, 1.0 + D.z.z - D.x.x - D.y.y)
    # The quaternions (w, v) and (-w, -v) are the same rotation. That with w ≥ 0 has an angle of at most π.
    sine = norm(v)
    scale = 2.0 * math.atan2(sine, abs(w)) / sine if sine > 0.0 else 0.0
    return scaled(-scale if w < 0.0 else scale, v)


@inlined
def swing_vector(a: Vector, u: Vector) -> Vector:
    """The rotation vector of the shortest rotation from one unit axis to another."""
    normal = cross(a, u)
    sine, cosine = norm(normal), dot(a, u)
    if sine < OPPOSITE and cosine < 0.0:  # Any axis normal to it will do.
        normal = Vector(0.0, a.z, -a.y) if abs(a.x) < ALONG else Vector(-a.z, 0.0, a.x)
        return scaled(math.pi / norm(normal), normal)
    # If the sine is 0 here, the axes are equal, and the normal is 0 too.
    return scaled(math.atan2(sine, cosine) / sine if sine > 0.0 else 1.0, normal)


@noinline
def deviation(T: Array, question: Array, out: Array) -> Vector:
    """Write the six components of the deviation of T, (3, 4), into out, (6,).

    With the frame F, the pose (R, p) and its target (R_g, p_g), they are ``Fᵀ (p - p_g)`` and the rotation vector of
    ``D = (Fᵀ R) (R_gᵀ F)``, or of the swing by D of the axis a alone.

    Returns:
        D a; without a swing axis it has no meaning.
    """
    F, goal, axis = matrix_of(question, FRAME, 3), matrix_of(question, 0, 4), vector_at(question, SWING)
    # The last column of the target, which is stored row by row.
    place = Vector(question[3], question[7], question[11])
    D = matrix_product(transposed_product(F, columns(T)), transposed_product(goal, F))
    swung = times(D, axis)
    linear = transposed_times(F, minus(column(T, 3), place))
    angular = rotation_vector(D) if question[SWINGS] == 0.0 else swing_vector(axis, swung)
    out[0], out[1], out[2] = linear.x, linear.y, linear.z
    out[3], out[4], out[5] = angular.x, angular.y, angular.z
    return swung


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
        # The components of a swing have no ranges: its angle counts as far as it exceeds the cone.
        if question[SWINGS] == 0.0:
            angle = beyond(angle, question[LOW + 3 + i], question[HIGH + 3 + i])
        turn += angle * angle
    return math.sqrt(place), max(math.sqrt(turn) - question[CONE], 0.0)


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
    T, out = np.empty((3, 4)), np.empty(6)
    for k in range(len(q)):
        forward(chain, q[k], T)
        deviation(T, questions[k], out)
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
