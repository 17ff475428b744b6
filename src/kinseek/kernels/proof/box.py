"""A box of joint values: what it describes, its memory, and the arm at its centre.

A box is a centre c and half widths h of the joint variables. `place` computes all axes and the hand at the centre.
`motion` and `turning` bound how far each joint moves a point, and rotates a direction, within the box.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np

from kinseek.kernels.arm.division import SLIDE, TURN
from kinseek.kernels.arm.forward import advance, identity
from kinseek.kernels.arm.vectors import Vector, column, cross, minus, norm, row, write_row
from kinseek.kernels.arrays import Array, Flags, Indices
from kinseek.kernels.jit import counted, inlined

TINY = 1e-300
"""Prevents division by zero. Any value much smaller than all measured quantities would do."""
LEAST = 1e-15
"""Smallest half width [rad] or [m]. Relative to a number, nine times the unit roundoff."""
NARROW = 1e-10
"""A box is not split further if its largest half width, relative to one plus its centre, is smaller than this [rad] or [m].

Such a box moves the hand by less than the tightest usual tolerances, and by at least about ten times the margins for
rounding, which would decide about narrower boxes. Twice the value gives up a box one halving earlier.
"""
NEAR = 1.5
"""Boxes that rotate the hand by less than this [rad] are small enough for steps from their middle to find a solution.

An axis that is off by a quarter turn or more, which is little more than this, no longer shows the right direction. Not
examined further.
"""
HEAD = 0.3
"""Factor for the priority of splitting a revolute first joint, whose range is cut when the others shrink. Not examined
further."""


class Form(NamedTuple):
    """The part of the arm that the boxes describe."""

    fixed: Annotated[Array, "part+1", 3, 4]
    """``A_1 … A_m, A_tip``, (m+1, 3, 4); A_1 is the identity if the first joint is divided out."""
    prismatic: Annotated[Flags, "part"]
    """(m,)"""
    leader: Annotated[Indices, "part"]
    """(m,)"""
    multiplier: Annotated[Array, "part"]
    """(m,)"""
    offset: Annotated[Array, "part"]
    """(m,)"""
    head: int
    """Type of the first joint: NONE, TURN or SLIDE; the latter two are divided out by comparing azimuths or heights."""
    columns: int
    """Number of columns of the hand that count: 0 none, 1 the x axis, 2 x and y (the paper's error), 3 all."""
    tail: int
    """1 if the last joint is revolute, part of the chain, and can be divided out of first-order tests."""
    foot: float
    """Point on the last axis that these tests compare, as a distance along it from the joint's origin [m]."""


class ProofGoal(NamedTuple):
    """The goal of the hand, with tolerances, weights and margins."""

    target: Annotated[Array, 3, 4]
    """(3, 4), in the frame of the first joint if that is divided out."""
    last: Annotated[Array, 3, 4]
    """Required pose of the last joint's frame at zero, (3, 4), if `Form.tail`."""
    position: float
    """Position tolerance [m]."""
    chord: float
    """Tolerance of all columns together, as a Frobenius norm."""
    angle: float
    """Tolerance of the hand's total rotation [rad]."""
    weight_p: float
    """K_P, per [m]."""
    weight_a: float
    """K_A; 0 if no column counts."""
    margin: float
    """Margin for rounding [m]."""
    margin_a: float
    """Margin for rounding of directions."""
    trust: float
    """1; the tests of this package reduce it, which shrinks all bounds, and must detect that."""
    length: float
    """Length of one radian when splitting boxes and stepping, if angles count [m]."""
    offset: float
    """Distance of the tip from the point on the last axis [m]."""
    back: float
    """Distance of another point from the tip, back along its first column, that moves less [m]; 0 if there is none."""
    side_y: float
    """Component of the hand's second column along the goal's second column, if that counts too, else 0."""
    side_z: float
    """The same along the goal's third column."""


class BoxScratch(NamedTuple):
    """Scratch memory for one box: m physical joints, n variables."""

    c: Array
    """Centre of the box, (n,)."""
    h: Array
    """Its half widths, (n,)."""
    half: Array
    """Half width of each physical joint, (m,)."""
    T: Array
    """Pose of the hand at the centre, columns x, y, z and p, (3, 4)."""
    goal: Array
    """The target without the rotation of the first joint, (3, 4)."""
    z: Array
    """Axes at the centre, (m, 3)."""
    p: Array
    """Points on them, (m, 3)."""
    lever: Array
    """Speed of the point that first-order tests compare, by each joint, (m,)."""
    radii: Array
    """Radii of the hand and of the goal about the axes, in which `taylor.halfway` counts rotations too, (2, m)."""
    J: Array
    """Derivative of the hand's pose by each joint, or of the goal's for proximal joints, (m, 3, 4)."""
    r: Array
    """Its norm for the point, (m,)."""
    s: Array
    """Its norm for the columns, (m,)."""
    back: Array
    """The same as r for the point that lies back along the first column, (m,)."""
    y: Array
    """The linear form, laid out as a pose, (3, 4)."""
    g: Array
    """Its first derivatives, (n,)."""
    H: Array
    """Its second derivatives, (n, n)."""
    S: Array
    """The second-order terms without the squares that are completed, for `form.curvature`, (n, n)."""
    completed: Flags
    """True if the square of a variable is completed, (n,)."""
    N: Array
    """Normal matrix, (n, n)."""
    D: Array
    """Weights of the box in the normal matrix, (n,)."""
    delta: Array
    """A step from the centre, (n,)."""
    slope: Array
    """Slope of the error after the step, (n,)."""
    correction: Array
    """Change of the step by Newton's method, (n,)."""


@counted
def make_box_scratch(joints: int, dof: int) -> BoxScratch:
    """Allocate the memory of one search."""
    return BoxScratch(
        c=np.zeros(dof),
        h=np.zeros(dof),
        half=np.zeros(joints),
        T=np.zeros((3, 4)),
        goal=np.zeros((3, 4)),
        z=np.zeros((joints, 3)),
        p=np.zeros((joints, 3)),
        lever=np.zeros(joints),
        radii=np.zeros((2, joints)),
        J=np.zeros((joints, 3, 4)),
        r=np.zeros(joints),
        s=np.zeros(joints),
        back=np.zeros(joints),
        y=np.zeros((3, 4)),
        g=np.zeros(dof),
        H=np.zeros((dof, dof)),
        S=np.zeros((dof, dof)),
        completed=np.zeros(dof, dtype=np.bool_),
        N=np.zeros((dof, dof)),
        D=np.zeros(dof),
        delta=np.zeros(dof),
        slope=np.zeros(dof),
        correction=np.zeros(dof),
    )


@inlined
def place(form: Form, scratch: BoxScratch) -> None:
    """Compute axes and hand at the centre of the box, in the frame after the first joint if that is divided out."""
    T, m = scratch.T, len(form.leader)
    identity(T)
    begin = 0
    if form.head != 0:
        write_row(Vector(0.0, 0.0, 1.0), scratch.z, 0)
        write_row(Vector(0.0, 0.0, 0.0), scratch.p, 0)
        begin = 1
    for k in range(begin, m):
        advance(form.fixed[k], True, 0.0, T)
        write_row(column(T, 2), scratch.z, k)
        write_row(column(T, 3), scratch.p, k)
        value = form.multiplier[k] * scratch.c[form.leader[k]] + form.offset[k]
        if form.prismatic[k]:
            for i in range(3):
                T[i, 3] += value * T[i, 2]
        else:
            cosine, sine = math.cos(value), math.sin(value)
            for i in range(3):
                x, y = T[i, 0], T[i, 1]
                T[i, 0] = x * cosine + y * sine
                T[i, 1] = y * cosine - x * sine
    advance(form.fixed[m], True, 0.0, T)


@inlined
def chord_of(angle: float) -> float:
    """An upper bound of 2 sin(angle/2) for angle ≥ 0, and 2 beyond π: its Taylor polynomial with a positive last term.

    At 3 the polynomial ``a - a³/24 + a⁵/1920`` exceeds 2, the longest possible chord; for larger angles it would fall
    below 2 again.
    """
    if angle > 3.0:
        return 2.0
    square = angle * angle
    return min(angle * (1.0 - square * (1.0 / 24.0 - square / 1920.0)), 2.0)


@inlined
def widths(form: Form, scratch: BoxScratch) -> None:
    """Compute half widths of the physical joints."""
    for k in range(len(form.leader)):
        scratch.half[k] = abs(form.multiplier[k]) * scratch.h[form.leader[k]]


@inlined
def short_way(angle: float) -> float:
    """The same angle without full turns, from -π to π [rad]."""
    turn = 2.0 * math.pi
    left: float = angle - turn * np.floor(angle / turn + 0.5)
    return left


@inlined
def largest_rotation(form: Form, scratch: BoxScratch, count: int) -> float:
    """Largest rotation by the first `count` joints from the centre of the box [rad]."""
    total = 0.0
    for k in range(count):
        total += 0.0 if form.prismatic[k] else scratch.half[k]
    return total


@inlined
def turn_goal(form: Form, proof_goal: ProofGoal, scratch: BoxScratch) -> None:
    """Write the target in the frame after the first joint, with that joint at the centre of its range."""
    goal, target = scratch.goal, proof_goal.target
    if form.head == TURN:
        cosine, sine = math.cos(scratch.c[0]), math.sin(scratch.c[0])
        for i in range(4):
            x, y = target[0, i], target[1, i]
            goal[0, i] = cosine * x + sine * y
            goal[1, i] = cosine * y - sine * x
            goal[2, i] = target[2, i]
        return
    for r in range(3):
        for i in range(4):
            goal[r, i] = target[r, i]
    if form.head == SLIDE:
        goal[2, 3] -= scratch.c[0]


@inlined
def radius(scratch: BoxScratch, k: int, point: Vector) -> float:
    """Distance of a point from the axis of joint k at the centre of the box [m]."""
    return norm(cross(row(scratch.z, k), minus(point, row(scratch.p, k))))


@inlined
def motion(form: Form, scratch: BoxScratch, begin: int, end: int, point: Vector) -> float:
    """Largest motion of a point by joints begin … end-1 within the box [m]; writes their levers."""
    total = 0.0
    for k in range(begin, end):
        if form.prismatic[k]:
            scratch.lever[k] = 1.0
            total += scratch.half[k]
        else:
            scratch.lever[k] = radius(scratch, k, point)
            total += scratch.lever[k] * chord_of(scratch.half[k])
    return total


@inlined
def turning(form: Form, scratch: BoxScratch, begin: int, end: int, axis: Vector) -> float:
    """Largest motion of a unit vector by joints begin … end-1 within the box; writes the sines."""
    total = 0.0
    for k in range(begin, end):
        if form.prismatic[k]:
            scratch.s[k] = 0.0
        else:
            scratch.s[k] = norm(cross(row(scratch.z, k), axis))
            total += scratch.s[k] * chord_of(scratch.half[k])
    return total


@inlined
def widest(form: Form, proof_goal: ProofGoal, scratch: BoxScratch, head: float) -> int:
    """Variable whose range moves the hand most; a revolute first joint is weighted by `head`."""
    best, index = -1.0, 0
    for i in range(len(scratch.c)):
        moved = 0.0
        for k in range(len(form.leader)):
            if form.leader[k] != i:
                continue
            turn = 0.0
            if form.columns > 0 and not form.prismatic[k]:
                turn = proof_goal.length * (scratch.s[k] if form.columns == 1 else 1.0)
            share = head if k == 0 and form.head == TURN else 1.0
            moved += abs(form.multiplier[k]) * scratch.h[i] * (scratch.lever[k] + turn) * share
        if moved > best:
            best, index = moved, i
    return index


@inlined
def load_box(boxes: Array, row: int, scratch: BoxScratch) -> None:
    """Load a box from row `row` of the list."""
    dof = len(scratch.c)
    for i in range(dof):
        scratch.c[i] = boxes[row, i]
        scratch.h[i] = boxes[row, dof + i]


@inlined
def store_box(boxes: Array, row: int, scratch: BoxScratch) -> None:
    """Write the box of the scratch memory to row `row`."""
    dof = len(scratch.c)
    for i in range(dof):
        boxes[row, i] = scratch.c[i]
        boxes[row, dof + i] = scratch.h[i]


@inlined
def rounding(centre: float, half: float) -> float:
    """Increase of a half width when its box is moved or cut, which covers the rounding of both ends.

    It is relative to the numbers: a prismatic joint at 1e6 m is rounded to 1e-10 m. A new centre and a new half width
    take three operations each on numbers no larger than these; nine times the unit roundoff covers six.
    """
    return LEAST * (1.0 + abs(centre) + half)


@inlined
def halve(scratch: BoxScratch, i: int, boxes: Array, first: int, second: int) -> None:
    """Cut the box in half along variable i and write the halves to two rows; the scratch memory keeps the middle."""
    centre, half = scratch.c[i], 0.5 * scratch.h[i]
    scratch.h[i] = half + rounding(centre, half)
    scratch.c[i] = centre - half
    store_box(boxes, first, scratch)
    scratch.c[i] = centre + half
    store_box(boxes, second, scratch)
    scratch.c[i] = centre


@inlined
def volume(scratch: BoxScratch) -> float:
    """Volume of the box."""
    product = 1.0
    for i in range(len(scratch.h)):
        product *= scratch.h[i]
    return product
