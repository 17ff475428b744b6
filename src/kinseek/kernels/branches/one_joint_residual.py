"""Residual of an arm with one searched joint, and its other joints for a given value of that joint.

The arm is a product of rotations about its axes as they stand at q = 0, see `structure.candidates`. The searched joint
determines a point y and the position ``u = D y`` to which joints 1, 2 and 3 have to move it. Rotations about the parallel
axes keep its height along their direction h: ``h · E₁⁻¹ u`` is given, subproblem 4 of Elias & Wen (2022), and has two
solutions q₁. The rest is a triangle in the plane normal to h, subproblem 3, with two solutions q₃. Each of these four
ways gives the required direction of the last axis in the frame of the wrist. The residual is the cosine of its angle to
the other axis of the wrist, minus the cosine that the wrist has.

For a direction n fixed in the base, ``n · E₁⁻¹ u = still + cosine · cos q₁ + sine · sin q₁``, with three numbers that are
linear in y (Rodrigues 1840).
"""

from __future__ import annotations

import math
from typing import NamedTuple

from kinseek.kernels.arm.vectors import (
    Vector,
    column,
    cross,
    dot,
    minus,
    plus,
    rotate,
    rotated,
    rotated_back,
    scaled,
)
from kinseek.kernels.arrays import Array
from kinseek.kernels.atlas.lanes import LANES
from kinseek.kernels.jit import inlined
from kinseek.kernels.structure import candidates
from kinseek.kernels.structure.candidates import read_structure
from kinseek.kernels.structure.subproblems import angle, solve_trig, unit_angle

SAMPLES = 128
"""Number of samples of the joint. Not examined further."""

BEGIN, APART, SEARCHED, OTHER = range(candidates.NUMBERS, candidates.NUMBERS + 4)
"""Indices after those of a structure, of which vectors, home and size are used: the first sample and the distance of
samples [rad]; the index of the searched joint; and the index of the other joint of the wrist beside the last."""

NUMBERS = OTHER + 1
"""Length of these numbers."""

HEIGHT, SIDE, COSINE, FIRST, NEAR, AXIS, SECOND = 0, 1, 3, 4, 7, 10, 13
"""First rows of parts of the table, which has a column for each sample. For the point that joints 1 to 3 move: its height
along the parallel axes, and its position normal to them, relative to axis 3. The cosine of the angle between the other
axis of the wrist and the last one. The other axis, along the parallel axes and normal to them. And in the frame of the
base: the point as the last axis has it at q = 0; the last axis after the searched joint; and the direction onto which
the last joint has to rotate the other axis."""

PLACES = SECOND + 3
"""Number of rows of the table."""

WAYS = 4
"""Number of ways: first those with one solution of joint 1, each with two solutions of joint 3, then the others."""


class Flat(NamedTuple):
    """A vector normal to the parallel axes, along e and f."""

    e: float
    f: float


class Basis(NamedTuple):
    """Axis 1, the direction of the parallel axes, and two directions normal to it."""

    axis1: Vector
    h: Vector
    e: Vector
    f: Vector


class Linear(NamedTuple):
    """The number ``factor · y + constant``, linear in a point y."""

    factor: Vector
    constant: float


class Turning(NamedTuple):
    """The number ``still + cosine · cos q₁ + sine · sin q₁``."""

    still: float
    cosine: float
    sine: float


class Component(NamedTuple):
    """``n · E₁⁻¹ u`` and ``n · E₁⁻¹ R z`` for a direction n; z is the last axis, R the rotation of D."""

    along: float
    """``n · axis 1``: the still part is this times ``axis 1 · u``."""
    cosine: Linear
    sine: Linear
    axis: Turning


class Equations(NamedTuple):
    """What all columns have in common."""

    on_axis1: Linear
    """``axis 1 · u``"""
    h: Component
    e: Component
    f: Component
    offset: Flat
    """From axis 2 to axis 1, normal to the parallel axes."""
    square: float
    """Squared length of the first side of the triangle."""
    least: float
    """Lower bound of the squared lengths that are divided by [m²]."""


class Place(NamedTuple):
    """What both solutions of joint 1 have in common, for a column."""

    other: Vector
    """The other axis of the wrist, see `FIRST`."""
    cosine: float
    """See `COSINE`."""
    second: Flat
    """Second side of the triangle."""
    e: Turning
    """Components of the third side."""
    f: Turning


class Residuals(NamedTuple):
    """The residual at samples of the searched joint."""

    value: Array
    """Residual of each way, without meaning where an equation has no solution, (WAYS, many)."""
    room: Array
    """Distance from a double root of the equation of joint 1, and of that of joint 3 for both solutions of joint 1;
    negative if no solution exists, (3, many)."""
    reach: Array
    """Squared distance of the point from axis 1, relative to the arm's size, (many,)."""


class Roots(NamedTuple):
    """Zeros of the residual."""

    value: Array
    """Values of the searched joint."""
    sign1: Array
    """Signs of the solutions of joint 1."""
    sign3: Array
    """Signs of the solutions of joint 3."""


class ColumnLanes(NamedTuple):
    """Memory for eight columns."""

    table: Array
    """See `HEIGHT`, (PLACES, LANES)."""
    root: Roots
    """(LANES,) each."""
    value: Array
    """(WAYS, LANES)"""
    room: Array
    """(3, LANES)"""
    reach: Array
    """(LANES,)"""
    joints: Array
    """Values of the joints 1, 2, 3, searched, other, last, (6, LANES)."""


@inlined
def basis_of(S: Array) -> Basis:
    """Read the axes of an arm, see `BEGIN`."""
    s = read_structure(S)
    return Basis(s.axis1, s.parallel, s.across, cross(s.parallel, s.across))


@inlined
def flat(basis: Basis, v: Vector) -> Flat:
    """Components of a vector normal to the parallel axes."""
    return Flat(dot(basis.e, v), dot(basis.f, v))


@inlined
def column_vector(table: Array, row: int, l: int) -> Vector:
    """Read a vector of the column in lane l."""
    return Vector(table[row, l], table[row + 1, l], table[row + 2, l])


@inlined
def linear(D: Array, v: Vector, t: Vector) -> Linear:
    """Scalar product of v with D y + t as a function of y."""
    return Linear(rotated_back(D, v), dot(v, t))


@inlined
def at(function: Linear, y: Vector) -> float:
    """Value of a linear function at a point."""
    return dot(function.factor, y) + function.constant


@inlined
def component(basis: Basis, D: Array, n: Vector, t: Vector, axis: Vector) -> Component:
    """See `Component`; u is D y + t, `axis` is the last axis."""
    a = basis.axis1
    along = dot(a, n)
    cosine, sine = linear(D, minus(n, scaled(along, a)), t), linear(D, cross(a, n), t)
    still = dot(rotated_back(D, a), axis) * along
    return Component(along, cosine, sine, Turning(still, dot(cosine.factor, axis), dot(sine.factor, axis)))


@inlined
def turning(on: Component, y: Vector, still: float, offset: float) -> Turning:
    """``n · E₁⁻¹ u`` plus an offset for a point y; `still` is ``axis 1 · u``."""
    return Turning(on.along * still + offset, at(on.cosine, y), at(on.sine, y))


@inlined
def value_at(number: Turning, c: float, s: float) -> float:
    """The number for the cosine and sine of q₁."""
    return number.still + c * number.cosine + s * number.sine


@inlined
def triangle(
    third: Flat, second: Flat, weight: Flat, square: float, least: float
) -> tuple[float, float, float]:
    """``weight · (cos, sin)`` of the angle by which a triangle rotates its second side, for both triangles.

    Args:
        third: Third side.
        second: Second side before the rotation.
        weight: Weights of the cosine and of the sine.
        square: Squared length of the first side.
        least: Lower bound of the squared lengths of the second and the third side.

    Returns:
        Mean of both values, half their difference, and the square of the sine of the angle between the first sides, which
        is negative if there is no triangle.
    """
    squared_second = second.e * second.e + second.f * second.f
    per = 1.0 / max(squared_second, least)
    squared_third = max(third.e * third.e + third.f * third.f, least)
    part = squared_third + square - second.e * second.e - second.f * second.f
    # The first number is 16 times the squared area of the triangle (Heron).
    rest, half = 4.0 * squared_third * square - part * part, 0.5 / squared_third
    # Components of the second side along the third and normal to it.
    part, across = (1.0 - part * half) * per, math.sqrt(max(rest, 0.0)) * half * per
    along, beside = second.e * third.e + second.f * third.f, second.e * third.f - second.f * third.e
    mean = part * (weight.e * along + weight.f * beside)
    return mean, across * (weight.f * along - weight.e * beside), 0.25 * rest * per / square


@inlined
def write_residuals(
    S: Array, D: Array, table: Array, residuals: Residuals, lanes: ColumnLanes, w: int
) -> None:
    """Write the residual, and the room of its equations, for every column of a table.

    Args:
        S: Numbers of the arm, see `BEGIN`.
        D: See `candidates.displacement`, (3, 4).
        table: See `HEIGHT`, (PLACES, many); many is a multiple of LANES.
        residuals: Receives them.
        lanes: Scratch memory.
        w: LANES.
    """
    scale, equations = 1.0 / (read_structure(S).size * read_structure(S).size), equations_of(S, D)
    for begin in range(0, table.shape[1], LANES):
        for r in range(AXIS):
            for l in range(w):
                lanes.table[r, l] = table[r, begin + l]
        for l in range(w):
            y = column_vector(lanes.table, NEAR, l)
            still = at(equations.on_axis1, y)
            # p cos + q sin = r, in the order of `subproblems.solve_trig`.
            on_h = turning(equations.h, y, still, 0.0)
            p, q, r = on_h.cosine, on_h.sine, lanes.table[HEIGHT, l] - on_h.still
            length = p * p + q * q
            rest = length - r * r
            root, share = math.sqrt(max(rest, 0.0)), 1.0 / max(length, equations.least)
            lanes.room[0, l], lanes.reach[l] = rest * scale, length * scale
            place = Place(
                column_vector(lanes.table, FIRST, l),
                lanes.table[COSINE, l],
                Flat(lanes.table[SIDE, l], lanes.table[SIDE + 1, l]),
                turning(equations.e, y, still, equations.offset.e),
                turning(equations.f, y, still, equations.offset.f),
            )
            mean, swing, room = two_ways(
                equations, place, (p * r - q * root) * share, (q * r + p * root) * share
            )
            lanes.value[0, l], lanes.value[1, l], lanes.room[1, l] = mean + swing, mean - swing, room
            mean, swing, room = two_ways(
                equations, place, (p * r + q * root) * share, (q * r - p * root) * share
            )
            lanes.value[2, l], lanes.value[3, l], lanes.room[2, l] = mean + swing, mean - swing, room
        for l in range(w):
            residuals.reach[begin + l] = lanes.reach[l]
        for r in range(WAYS):
            for l in range(w):
                residuals.value[r, begin + l] = lanes.value[r, l]
        for r in range(3):
            for l in range(w):
                residuals.room[r, begin + l] = lanes.room[r, l]


@inlined
def equations_of(S: Array, D: Array) -> Equations:
    """Prepare the equations of an arm for a target."""
    s, basis = read_structure(S), basis_of(S)
    point, axis = s.point1, s.axis6
    t, side = minus(column(D, 3), point), first_side_of(S, basis)
    return Equations(
        linear(D, basis.axis1, t),
        component(basis, D, basis.h, t, axis),
        component(basis, D, basis.e, t, axis),
        component(basis, D, basis.f, t, axis),
        flat(basis, minus(point, s.point2)),
        side.e * side.e + side.f * side.f,
        1e-12 * s.size * s.size,
    )


@inlined
def two_ways(equations: Equations, place: Place, c: float, s: float) -> tuple[float, float, float]:
    """Residuals of both solutions of joint 3, for the cosine and sine of q₁.

    Returns:
        Mean of both residuals, half their difference, and the room of the equation of joint 3.
    """
    other = place.other
    height, third = (
        value_at(equations.h.axis, c, s),
        Flat(value_at(place.e, c, s), value_at(place.f, c, s)),
    )
    last_e, last_f = value_at(equations.e.axis, c, s), value_at(equations.f.axis, c, s)
    weight = Flat(other.y * last_e + other.z * last_f, other.y * last_f - other.z * last_e)
    mean, swing, room = triangle(third, place.second, weight, equations.square, equations.least)
    return other.x * height - place.cosine + mean, swing, room


@inlined
def first_side_of(S: Array, basis: Basis) -> Flat:
    """Vector from axis 2 to axis 3, normal to them: the first side of the triangle."""
    return flat(basis, minus(read_structure(S).point3, read_structure(S).point2))


@inlined
def angle_about(axis: Vector, begin: Vector, end: Vector) -> float:
    """Angle by which a rotation about an axis takes one direction onto another (subproblem 1 of Paden and Kahan)."""
    flat_cosine = dot(begin, end) - dot(axis, begin) * dot(axis, end)
    return angle(dot(axis, cross(begin, end)), flat_cosine)


@inlined
def complete(S: Array, D: Array, lanes: ColumnLanes, w: int) -> None:
    """Write six joint values of every lane into `lanes.joints`.

    Args:
        S: Numbers of the arm, see `BEGIN`.
        D: See `candidates.displacement`, (3, 4).
        lanes: Roots, and the table there; receives joint values.
        w: LANES.
    """
    s, basis, table = read_structure(S), basis_of(S), lanes.table
    point, axis = s.point1, s.axis6
    t, along = minus(column(D, 3), point), dot(basis.axis1, basis.h)
    across, offset = cross(basis.axis1, basis.h), minus(point, s.point2)
    side, last_axis = first_side_of(S, basis), rotated(D, axis)
    square = side.e * side.e + side.f * side.f
    sense2, sense3 = s.sense2, s.sense3
    for l in range(w):
        u = plus(rotated(D, column_vector(table, NEAR, l)), t)
        height = dot(basis.axis1, u)
        p, q = dot(basis.h, u) - along * height, dot(across, u)
        c1, s1, _, _ = solve_trig(p, q, table[HEIGHT, l] - along * height, lanes.root.sign1[l])
        g = flat(basis, plus(rotate(basis.axis1, c1, -s1, u), offset))
        m = Flat(table[SIDE, l], table[SIDE + 1, l])
        a, b = side.e * m.e + side.f * m.f, side.f * m.e - side.e * m.f
        sides = square + m.e * m.e + m.f * m.f
        c3, s3, _, _ = solve_trig(a, b, 0.5 * (g.e * g.e + g.f * g.f - sides), lanes.root.sign3[l])
        v = Flat(side.e + c3 * m.e - s3 * m.f, side.f + c3 * m.f + s3 * m.e)
        c2, s2, _ = unit_angle(v.e * g.e + v.f * g.f, v.e * g.f - v.f * g.e)
        cosine, sine = c2 * c3 - s2 * s3, s2 * c3 + c2 * s3
        # The other axis rotates the last axis, as it stands after the searched joint, onto its required direction.
        required = rotate(basis.h, cosine, -sine, rotate(basis.axis1, c1, -s1, last_axis))
        first = column_vector(table, FIRST, l)
        other = plus(plus(scaled(first.x, basis.h), scaled(first.y, basis.e)), scaled(first.z, basis.f))
        other_angle = angle_about(other, column_vector(table, AXIS, l), required)
        # The other axis in the frame of the tip; the last joint has to rotate it onto SECOND.
        other = rotate(basis.axis1, c1, s1, rotate(basis.h, cosine, sine, other))
        last_angle = angle_about(axis, rotated_back(D, other), column_vector(table, SECOND, l))
        lanes.joints[0, l], lanes.joints[1, l] = angle(s1, c1), sense2 * angle(s2, c2)
        lanes.joints[2, l], lanes.joints[3, l] = sense3 * angle(s3, c3), lanes.root.value[l]
        lanes.joints[4, l], lanes.joints[5, l] = other_angle, last_angle


class Cubic(NamedTuple):
    """Weights of values at 0, 1, 2 and 3 in the cubic through them (Lagrange)."""

    w0: float
    w1: float
    w2: float
    w3: float


@inlined
def cubic(x: float) -> Cubic:
    """Weights of the cubic's value at x."""
    a, b, c, d = x, x - 1.0, x - 2.0, x - 3.0
    return Cubic(-b * c * d / 6.0, 0.5 * a * c * d, -0.5 * a * b * d, a * b * c / 6.0)


@inlined
def interpolate(S: Array, table: Array, value: float, rows: int, into: Array, place: int) -> None:
    """Interpolate rows of the table at a value of the joint by cubics through four samples; write a column of another."""
    x = (value - S[BEGIN]) / S[APART]
    k = min(max(int(x) - 1, 0), table.shape[1] - 4)
    w = cubic(x - k)
    for r in range(rows):
        y0, y1, y2, y3 = table[r, k], table[r, k + 1], table[r, k + 2], table[r, k + 3]
        into[r, place] = w.w0 * y0 + w.w1 * y1 + w.w2 * y2 + w.w3 * y3
