"""Closed-form solutions of arms with intersecting or parallel axes, one candidate in each SIMD lane.

The arm is a product of rotations about the axes as they stand at q = 0, ``T = E₁(q₁) … E₆(q₆) T₀`` (Brockett 1984). The
displacement ``D = T T₀⁻¹`` is the product of these rotations. A joint that a quadratic equation determines has two
solutions. There are three such equations, and the three signs of a lane choose one solution of each. An arm that has the
structure at its distal end is solved backwards: ``D⁻¹ = E₆(-q₆) … E₁(-q₁)``.

Axes 2 and 3 are parallel to h, and the last axes do not move a point x. Let ``c = D x``. Rotations about h keep the
component along h, so E₁⁻¹ c and x have the same component along h. This equation determines q₁. The rest is a triangle in
the plane normal to h.

- A wrist whose three axes intersect in x (Pieper 1968): the triangle determines q₂ and q₃, and the remaining orientation
  determines the wrist.
- Axis 4 is parallel as well, and axes 5 and 6 intersect in x: the orientation of h determines q₅ and q₆, and the triangle
  determines the other joints.

If such a wrist is distal to axes 1 and 2 that intersect, its distance from their intersection determines q₃, and its
direction determines q₂ and q₁. An arm with a seventh, swept joint has these solutions for each value of that joint, see
`swept_joint`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from kinseek.kernels.arm.record import Record
from kinseek.kernels.arm.vectors import (
    Matrix,
    Transform,
    Vector,
    cross,
    dot,
    matrix_product,
    minus,
    plus,
    rotate,
    rotated,
    rotated_back,
    row,
    scaled,
    times,
    transform_at,
    transformed,
    write_transform,
)
from kinseek.kernels.arrays import Array
from kinseek.kernels.atlas.lanes import LANES
from kinseek.kernels.atlas.memory import CANDIDATE_ROWS
from kinseek.kernels.jit import inlined

from .subproblems import angle, solve_trig, unit_angle

NONE, WRIST, PARALLEL, MEETING = 0, 1, 2, 3
"""Kinds: no closed form; a spherical wrist distal to two parallel axes; three parallel axes proximal to two that
intersect; and a spherical wrist distal to one axis that follows two intersecting axes."""

ZERO = Vector(0.0, 0.0, 0.0)


class Structure(NamedTuple):
    """An arm with a closed form, seen backwards if it is solved so; points and directions at q = 0, lengths in [m]."""

    kind: float = NONE
    backward: float = 0.0
    """1 for an arm that is solved backwards, else 0."""
    deviation: float = 0.0
    """Deviation of the arm from the structure [rad], with lengths divided by its size."""
    size: float = 0.0
    """[m]"""
    sense2: float = 0.0
    """1 if axis 2 has the direction of `parallel`, -1 if it has the opposite direction."""
    sense3: float = 0.0
    sense4: float = 0.0
    home: Transform = Transform(Matrix(ZERO, ZERO, ZERO), ZERO)
    """T₀⁻¹, or T₀ for an arm that is solved backwards."""
    axis1: Vector = ZERO
    """Directions of the axes."""
    axis2: Vector = ZERO
    axis3: Vector = ZERO
    axis4: Vector = ZERO
    axis5: Vector = ZERO
    axis6: Vector = ZERO
    parallel: Vector = ZERO
    """h, the common direction of parallel axes."""
    across: Vector = ZERO
    """A direction normal to h."""
    across6: Vector = ZERO
    """A direction normal to axis 6."""
    centre: Vector = ZERO
    """The point x."""
    point1: Vector = ZERO
    """A point on axis 1; for `MEETING` its intersection with axis 2."""
    point2: Vector = ZERO
    point3: Vector = ZERO
    point4: Vector = ZERO
    swept: float = 0.0
    """The number of values that are tried of the swept joint, 0 if there is no such joint."""
    slides: float = 0.0
    """1 if that joint is prismatic, else 0."""
    swept_axis: Vector = ZERO
    swept_point: Vector = ZERO
    """A point on its axis."""
    swept_across: Vector = ZERO
    """A direction normal to it."""


STRUCTURE = Record(Structure)
"""The array of a structure; after its entries come the offsets that are tried, see `SWEPT_VALUES`."""

read_structure = STRUCTURE.read

SWEPT_VALUES = STRUCTURE.size
"""First entry of the offsets that are tried, relative to the direction of the target [rad] or [m], see `swept_joint`."""

VALUES = 8
"""Largest number of offsets."""

NUMBERS = SWEPT_VALUES + VALUES
"""Length of a structure."""

ROUNDING = 1e-9
"""Deviation up to which an arm has its structure exactly: it covers the rounding of doubles in its description only."""

LOOSE = 1e-5
"""Tolerances [m] and [rad] up to which the closed form is complete. With looser ones the solutions form regions, which
the closed form does not describe."""

INFEASIBLE, BESIDE = 0.02, 1e-3
"""A candidate is tried if its infeasibility is at most the first value, and if it lies at most the second beyond a limit
[rad]. Both grow with the deviation of the arm from its structure, and with the tolerances."""

CLEAR = 1e-6
"""The two solutions of the equations are distinct if every discriminant is larger than this, see `ROOTS`."""

FREE = 2e-4
"""Conditioning below which an angle is undetermined. The solutions are then continua, within the tolerances."""

ERROR_PER_DEVIATION = 10.0
"""Factor from the deviation of the arm from its structure to the error of its equations."""

GIVEN = 6
"""Row of the value of the swept joint, after those of the other six joints."""

INFEASIBILITY = 7
"""Row of the largest infeasibility of the equations of a lane, 0 where all have a solution."""

CONDITIONING = 8
"""Row of the smallest conditioning of its angles, 0 where one is undetermined."""

DISCRIMINANT = 9
"""Row of the smallest absolute discriminant of its equations, reduced where an equation is poorly conditioned."""

DUPLICATE = 10
"""Row that is 1 for a duplicate: a lane whose solution coincides with that of another lane."""

ROOTS = 11
"""First of three rows: the discriminants of the quadratic equations. A discriminant is negative where its equation has no
solution. Unlike `INFEASIBILITY` it varies smoothly with the target."""

COST = 14
"""Row of the squared distance of a candidate from the reference, infinite if it is rejected, see `choice.place`."""

SIGNS = 15
"""First of three rows of signs: which solution of each quadratic equation the lane takes."""

WORK = (CANDIDATE_ROWS, LANES)
"""Shape of the array that the functions below fill: these rows."""


if SIGNS + 3 != CANDIDATE_ROWS:
    raise TypeError(f"candidates have {SIGNS + 3} rows, the scratch memory has {CANDIDATE_ROWS}")
if LANES != 2**3:
    raise TypeError(
        f"the three signs of a closed form give eight candidates, one in each lane, got {LANES} lanes"
    )


class Triangle(NamedTuple):
    """Two links of given lengths in the plane normal to parallel axes, whose end is at a given point of the plane.

    Coordinates are along `Structure.across` and `normal`.
    """

    normal: Vector
    l0: float
    l1: float
    m0: float
    m1: float
    a: float
    b: float
    squares: float


class Equation(NamedTuple):
    """``a cos θ + b sin θ = c - rest``, where only c depends on the target."""

    a: float
    b: float
    rest: float


class Proximal(NamedTuple):
    """The first three joints of one lane, what remains for the wrist, and diagnostics, see `INFEASIBILITY`."""

    q1: float
    q2: float
    q3: float
    axis6: Vector
    across6: Vector
    infeasibility: float
    conditioning: float
    discriminant: float
    root1: float
    root2: float
    duplicate: bool


class Bend(NamedTuple):
    """Angles of the two joints of a triangle: cosine and sine of both, and diagnostics."""

    c2: float
    s2: float
    c3: float
    s3: float
    root: float
    length2: float


@inlined
def displacement(structure: Array, target: Array, D: Array) -> None:
    """Write the displacement ``T T₀⁻¹``, (3, 4), or its inverse ``T₀ T⁻¹`` for an arm that is solved backwards."""
    s = read_structure(structure)
    R, p = s.home
    if s.backward > 0.0:
        x, y, z = times(R, row(target, 0)), times(R, row(target, 1)), times(R, row(target, 2))
        p = minus(minus(p, scaled(target[0, 3], x)), scaled(target[1, 3], y))
        write_transform(Transform(Matrix(x, y, z), minus(p, scaled(target[2, 3], z))), D)
    else:
        T = transform_at(target)
        moved = plus(plus(T.p, scaled(p.x, T.R.x)), scaled(p.y, T.R.y))
        write_transform(Transform(matrix_product(T.R, R), plus(moved, scaled(p.z, T.R.z))), D)


@inlined
def row_of(structure: Array, i: int, dof: int) -> int:
    """Row of joint i among the candidates of an arm with `dof` joints."""
    s = read_structure(structure)
    place = dof - 1 - i if s.backward > 0.0 else i
    if s.swept > 0.0:
        place = place - 1 if place > 0 else GIVEN
    return place


@inlined
def joint_of(structure: Array, row: int, dof: int) -> int:
    """Joint whose angles are in a row, see `row_of`."""
    s = read_structure(structure)
    place = row + 1 if s.swept > 0.0 else row
    return dof - 1 - place if s.backward > 0.0 else place


@inlined
def candidates(structure: Array, D: Array, far: float, work: Array, w: int) -> None:
    """Write the angles of eight candidates and their diagnostics into work.

    The angles of an arm that is solved backwards are in order from its last joint to its first.

    Args:
        structure: See `STRUCTURE`, (NUMBERS,).
        D: See `displacement`, (3, 4).
        far: Infeasibility beyond which the equations that depend on the infeasible one are ignored in the diagnostics.
        work: See `GIVEN` to `SIGNS`, `WORK`.
        w: LANES.
    """
    s = read_structure(structure)
    for l in range(LANES):
        for k in range(3):
            work[SIGNS + k, l] = 1.0 - 2.0 * ((l >> k) & 1)
    if s.kind == WRIST:
        parallel_pair(s, D, far, work, w)
    elif s.kind == MEETING:
        meeting_pair(s, D, far, work, w)
    else:
        parallel_three(s, D, far, work, w)


@inlined
def shoulder_equation(s: Structure, u: Vector) -> tuple[Equation, float]:
    """Equation of joint 1, ``h · E₁⁻¹ u = h · (x - p₁)`` for parallel axes 2 and 3; and its right-hand side."""
    along, height = dot(s.axis1, s.parallel), dot(s.axis1, u)
    a = dot(s.parallel, u) - along * height
    b = dot(cross(s.axis1, s.parallel), u)
    c = dot(s.parallel, minus(s.centre, s.point1)) - along * height
    return Equation(a, b, 0.0), c


@inlined
def turn_equation(axis_before: Vector, axis: Vector, moved: Vector) -> Equation:
    """Left-hand side ``axis_before · E moved`` of an equation for the rotation E about `axis`."""
    along = dot(axis_before, axis) * dot(moved, axis)
    return Equation(dot(axis_before, moved) - along, dot(axis_before, cross(axis, moved)), along)


@inlined
def triangle(s: Structure, end: Vector) -> Triangle:
    """Triangle of the links from axis 2 to axis 3 and from there to `end`."""
    normal = cross(s.parallel, s.across)
    upper, fore = minus(s.point3, s.point2), minus(end, s.point3)
    l0, l1, m0, m1 = dot(s.across, upper), dot(normal, upper), dot(s.across, fore), dot(normal, fore)
    squares = l0 * l0 + l1 * l1 + m0 * m0 + m1 * m1
    # |l + E₃ m|² = |l|² + |m|² + 2 (a cos q₃ + b sin q₃).
    return Triangle(normal, l0, l1, m0, m1, l0 * m0 + l1 * m1, l1 * m0 - l0 * m1, squares)


@inlined
def bend(s: Structure, t: Triangle, end: Vector, sign: float) -> Bend:
    """Solve the triangle: joint 3 from the distance of its end from axis 2, joint 2 from the direction of the end."""
    g0, g1 = dot(s.across, end), dot(t.normal, end)
    c3, s3, root, _ = solve_trig(t.a, t.b, 0.5 * (g0 * g0 + g1 * g1 - t.squares), sign)
    v0, v1 = t.l0 + c3 * t.m0 - s3 * t.m1, t.l1 + c3 * t.m1 + s3 * t.m0
    c2, s2, length2 = unit_angle(v0 * g0 + v1 * g1, v0 * g1 - v1 * g0)
    return Bend(c2, s2, c3, s3, root, length2)


@inlined
def parallel_pair(s: Structure, D: Array, far: float, work: Array, w: int) -> None:
    """Solve an arm with a wrist whose axes 2 and 3 are parallel."""
    size = 1.0 / s.size
    u = minus(transformed(D, s.centre), s.point1)
    shoulder, c = shoulder_equation(s, u)
    links, hand, offset = triangle(s, s.centre), wrist_of(s), minus(s.point1, s.point2)
    axis6, across6 = rotated(D, s.axis6), rotated(D, s.across6)
    for l in range(w):
        one, two = work[SIGNS, l], work[SIGNS + 1, l]
        c1, s1, root1, length1 = solve_trig(shoulder.a, shoulder.b, c, one)
        arm = bend(s, links, plus(rotate(s.axis1, c1, -s1, u), offset), two)
        cosine, sine = arm.c2 * arm.c3 - arm.s2 * arm.s3, arm.s2 * arm.c3 + arm.c2 * arm.s3
        weak1, weak2 = length1 * size, math.sqrt(arm.length2) * size
        seen_weak2 = weak2 if min(root1, arm.root) > -far else 1.0
        fold3 = abs(arm.root) if root1 > -far else 1.0
        proximal = Proximal(
            angle(s1, c1),
            s.sense2 * angle(arm.s2, arm.c2),
            s.sense3 * angle(arm.s3, arm.c3),
            rotate(s.parallel, cosine, -sine, rotate(s.axis1, c1, -s1, axis6)),
            rotate(s.parallel, cosine, -sine, rotate(s.axis1, c1, -s1, across6)),
            max(-root1, -arm.root, 0.0),
            min(weak1, seen_weak2),
            min(abs(root1) * min(weak1, 1.0), fold3),
            # `solve_trig` divides by the squared length of (a, b), which depends on the target. This product varies
            # smoothly also where the length is 0.
            root1 * weak1 * weak1,
            arm.root,
            # Without two solutions both signs give the same angle.
            (root1 <= 0.0 and one < 0.0) or (arm.root <= 0.0 and two < 0.0),
        )
        wrist(s, hand, proximal, far, work, l)


@inlined
def meeting_pair(s: Structure, D: Array, far: float, work: Array, w: int) -> None:
    """Solve an arm with a wrist whose axes 1 and 2 intersect.

    Joint 3 follows from ``|m + E₃ r| = |u|``, where m leads from the intersection to axis 3 and r from there to x; joint 2
    from ``axis 1 · E₂ (m + E₃ r) = axis 1 · u``.
    """
    size, axis2, axis3 = 1.0 / s.size, s.axis2, s.axis3
    u = minus(transformed(D, s.centre), s.point1)
    m, r = minus(s.point3, s.point1), minus(s.centre, s.point3)
    elbow = turn_equation(m, axis3, r)
    c = 0.5 * (dot(u, u) - dot(m, m) - dot(r, r)) - elbow.rest
    between, normal, height = dot(s.axis1, axis2), cross(s.axis1, axis2), dot(s.axis1, u)
    hand, axis6, across6 = wrist_of(s), rotated(D, s.axis6), rotated(D, s.across6)
    for l in range(w):
        one, two = work[SIGNS, l], work[SIGNS + 1, l]
        c3, s3, root3, _ = solve_trig(elbow.a, elbow.b, c, two)
        v = plus(rotate(axis3, c3, s3, r), m)
        level = dot(axis2, v) * between
        c2, s2, root2, length2 = solve_trig(dot(s.axis1, v) - level, dot(normal, v), height - level, one)
        v = rotate(axis2, c2, s2, v)
        flat = dot(v, u) - dot(s.axis1, v) * height
        c1, s1, length1 = unit_angle(flat, dot(s.axis1, cross(v, u)))
        last = rotate(axis2, c2, -s2, rotate(s.axis1, c1, -s1, axis6))
        across = rotate(axis2, c2, -s2, rotate(s.axis1, c1, -s1, across6))
        weak1, weak2 = math.sqrt(length1) * size, length2 * size
        seen_weak2 = weak2 if root3 > -far else 1.0
        seen_weak1 = weak1 if min(root2, root3) > -far else 1.0
        fold2 = abs(root2) if root3 > -far else 1.0
        proximal = Proximal(
            angle(s1, c1),
            angle(s2, c2),
            angle(s3, c3),
            rotate(axis3, c3, -s3, last),
            rotate(axis3, c3, -s3, across),
            max(-root2, -root3, 0.0),
            min(seen_weak1, seen_weak2),
            min(fold2 * min(seen_weak2, 1.0), abs(root3)),
            root2 * weak2 * weak2,
            root3,
            (root2 <= 0.0 and one < 0.0) or (root3 <= 0.0 and two < 0.0),
        )
        wrist(s, hand, proximal, far, work, l)


class Wrist(NamedTuple):
    """What all lanes have in common of the last three joints."""

    bend: Equation
    normal6: Vector


@inlined
def wrist_of(s: Structure) -> Wrist:
    """Equation ``axis 4 · E₅ axis 6`` of joint 5, and the vector normal to axis 6 and A6."""
    return Wrist(turn_equation(s.axis4, s.axis5, s.axis6), cross(s.axis6, s.across6))


@inlined
def wrist(s: Structure, hand: Wrist, arm: Proximal, far: float, work: Array, l: int) -> None:
    """Solve the last three joints of lane l from the remaining orientation, and write the lane."""
    three = work[SIGNS + 2, l]
    height = dot(s.axis4, arm.axis6)
    c5, s5, root5, _ = solve_trig(hand.bend.a, hand.bend.b, height - hand.bend.rest, three)
    r = rotate(s.axis5, c5, s5, s.axis6)
    # E₄ takes r to axis 6: both have the same component along axis 4.
    flat = dot(r, arm.axis6) - dot(s.axis4, r) * height
    c4, s4, length4 = unit_angle(flat, dot(s.axis4, cross(r, arm.axis6)))
    v = rotate(s.axis5, c5, -s5, rotate(s.axis4, c4, -s4, arm.across6))
    weak4, fold5, infeasibility = math.sqrt(length4), abs(root5), max(arm.infeasibility, -root5)
    work[0, l], work[1, l], work[2, l] = arm.q1, arm.q2, arm.q3
    work[3, l], work[4, l] = angle(s4, c4), angle(s5, c5)
    work[5, l] = angle(dot(hand.normal6, v), dot(s.across6, v))
    work[ROOTS, l], work[ROOTS + 1, l], work[ROOTS + 2, l] = arm.root1, arm.root2, root5
    work[INFEASIBILITY, l] = infeasibility
    work[CONDITIONING, l] = min(arm.conditioning, weak4) if infeasibility < far else arm.conditioning
    work[DISCRIMINANT, l] = min(arm.discriminant, fold5) if arm.infeasibility < far else arm.discriminant
    work[DUPLICATE, l] = 1.0 if arm.duplicate or (root5 <= 0.0 and three < 0.0) else 0.0


@inlined
def parallel_three(s: Structure, D: Array, far: float, work: Array, w: int) -> None:
    """Solve all joints of an arm whose axes 2, 3 and 4 are parallel and whose axes 5 and 6 intersect.

    E₁ h = D E₆⁻¹ E₅⁻¹ h: joint 1 follows from the position of x, joint 5 from the component along axis 6, joint 6 from the
    components across it, and joints 2, 3 and 4 from the triangle.
    """
    size = 1.0 / s.size
    u = minus(transformed(D, s.centre), s.point1)
    shoulder, c = shoulder_equation(s, u)
    twist, axis6 = turn_equation(s.parallel, s.axis5, s.axis6), rotated(D, s.axis6)
    links, offset, from_x = triangle(s, s.point4), minus(s.point1, s.point2), minus(s.point4, s.centre)
    for l in range(w):
        one, two, three = work[SIGNS, l], work[SIGNS + 1, l], work[SIGNS + 2, l]
        c1, s1, root1, length1 = solve_trig(shoulder.a, shoulder.b, c, one)
        r = rotate(s.axis1, c1, s1, s.parallel)
        c5, s5, root5, _ = solve_trig(twist.a, twist.b, dot(r, axis6) - twist.rest, three)
        g, v = rotated_back(D, r), rotate(s.axis5, c5, -s5, s.parallel)
        flat = dot(g, v) - dot(s.axis6, g) * dot(s.axis6, v)
        c6, s6, length6 = unit_angle(flat, dot(s.axis6, cross(g, v)))
        # The vector `across` rotated by E₂ E₃ E₄.
        v = rotate(s.axis6, c6, -s6, rotate(s.axis5, c5, -s5, s.across))
        v = rotate(s.axis1, c1, -s1, rotated(D, v))
        all0, all1 = dot(s.across, v), dot(links.normal, v)
        # The point on axis 4, as E₂ E₃ move it.
        v = rotate(s.axis6, c6, -s6, rotate(s.axis5, c5, -s5, from_x))
        arm = bend(s, links, plus(rotate(s.axis1, c1, -s1, plus(rotated(D, v), u)), offset), two)
        cosine, sine = arm.c2 * arm.c3 - arm.s2 * arm.s3, arm.s2 * arm.c3 + arm.c2 * arm.s3
        work[0, l], work[4, l], work[5, l] = angle(s1, c1), angle(s5, c5), angle(s6, c6)
        work[1, l], work[2, l] = s.sense2 * angle(arm.s2, arm.c2), s.sense3 * angle(arm.s3, arm.c3)
        work[3, l] = s.sense4 * angle(all1 * cosine - all0 * sine, all0 * cosine + all1 * sine)
        weak1, weak2, weak6 = length1 * size, math.sqrt(arm.length2) * size, math.sqrt(length6)
        root3, fold1, fold3, fold5 = arm.root, abs(root1), abs(arm.root), abs(root5)
        fold5 = fold5 if root1 > -far else 1.0
        weak6 = weak6 if min(root1, root5) > -far else 1.0
        fold3 = fold3 if min(root1, root5) > -far else 1.0
        weak2 = weak2 if min(root1, root3, root5) > -far else 1.0
        work[INFEASIBILITY, l] = max(-root1, -root3, -root5, 0.0)
        work[ROOTS, l], work[ROOTS + 1, l], work[ROOTS + 2, l] = root1 * weak1 * weak1, root3, root5
        work[CONDITIONING, l] = min(weak1, weak2, weak6)
        work[DISCRIMINANT, l] = min(fold1 * min(weak1, 1.0), fold3, fold5)
        again1, again3 = root1 <= 0.0 and one < 0.0, root3 <= 0.0 and two < 0.0
        work[DUPLICATE, l] = 1.0 if again1 or again3 or (root5 <= 0.0 and three < 0.0) else 0.0
