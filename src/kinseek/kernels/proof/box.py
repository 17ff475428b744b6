"""A box of joint values: what it is about, its memory, and where the arm stands at its centre.

A box is a centre c and half widths h of the joint variables. `place` writes down where every axis and the hand are at the
centre; `motion` and `turning` how far each joint carries a point, and turns a direction, within the box.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from kinseek.kernels.arm.division import SLIDE, TURN
from kinseek.kernels.arm.forward import advance, identity
from kinseek.kernels.arrays import Array, Flags, Indices
from kinseek.kernels.entry import F64, FLAG, I64, Bundle
from kinseek.kernels.jit import array_view, inlined

TINY = 1e-300
"""Keeps what may be zero out of a denominator; nothing that is measured is as small, so any value near it would do."""
LEAST = 1e-15
"""No half width is ever smaller [rad] or [m]. Relative to a number, nine times the unit roundoff."""
NARROW = 1e-10
"""A box whose widest half width is smaller, relative to one plus its centre, is not split again [rad] or [m].

It moves the hand by less than the tightest tolerances that people ask for, and by no less than some ten times the margins
for rounding: narrower boxes would be judged by those alone. Twice as much gives a box up one halving earlier.
"""
NEAR = 1.5
"""Boxes that turn the hand by less [rad] are near enough to an answer in them for steps from their middle to find it.

An axis that is off by a quarter turn or more, which this all but is, no longer says which way to go. By trial.
"""
HEAD = 0.3
"""How much less urgent it is to split a first joint that turns: its range is cut as the others' ranges shrink. By trial."""

# Of `BoxScratch.found`.
MISS_POINT = 0
"""How far the hand at the centre of the box misses the goal's point [m]."""
MISS_COLUMNS = 1
"""And the goal's columns, as a Frobenius norm."""
BEST_ROLL = 2
"""Where the last joint, divided out, brings the other columns nearest to the goal's [rad]."""
MIDDLE_ERROR = 3
"""Weighted error at the centre of the box."""
BELOW = 4
"""A lower bound of the weighted error in the box."""
FOUND = 5
"""So many."""


class Form(NamedTuple):
    """The part of the arm that the boxes are about."""

    fixed: Array
    """``A_1 … A_m, A_tip``, (m+1, 3, 4); where the first joint is divided out A_1 is the identity."""
    prismatic: Flags
    """(m,)"""
    leader: Indices
    """(m,)"""
    multiplier: Array
    """(m,)"""
    offset: Array
    """(m,)"""
    head: int
    """The first joint: NONE, TURN or SLIDE are divided out by comparing azimuths or heights."""
    columns: int
    """How many columns of the hand count: 0 none, 1 the x axis, 2 x and y (the paper's error), 3 all."""
    tail: int
    """1 where the last joint, a turn, is part of the chain and can be divided out of first-order tests."""
    foot: float
    """Point on the last axis that these compare, as a distance along it from the joint's origin [m]."""


class ProofGoal(NamedTuple):
    """What is asked of the hand."""

    target: Array
    """(3, 4), seen from the first joint's frame where that is divided out."""
    last: Array
    """Pose of the last joint's frame at zero that the target asks for, (3, 4), if `Form.tail`."""
    position: float
    """Tolerance of the point [m]."""
    chord: float
    """Tolerance of the columns together, as a Frobenius norm."""
    angle: float
    """Tolerance of the hand's whole turn [rad]."""
    weight_p: float
    """K_P, per [m]."""
    weight_a: float
    """K_A; 0 where no column counts."""
    margin: float
    """For rounding [m]."""
    margin_a: float
    """For rounding of directions."""
    trust: float
    """1; tests shrink all bounds by it, and must notice."""
    length: float
    """What an angle of one radian counts as, where angles count, when splitting and stepping [m]."""
    offset: float
    """Distance of the tip from the last axis' point [m]."""
    back: float
    """Distance of another point from the hand's, back along its first column, that moves less [m]; 0: there is none."""
    side_y: float
    """Where a second column of the hand counts too: its part along the goal's second column, else 0."""
    side_z: float
    """And along its third."""


FORM = Bundle(
    Form,
    fixed=F64["part+1", 3, 4],
    prismatic=FLAG["part"],
    leader=I64["part"],
    multiplier=F64["part"],
    offset=F64["part"],
    head=I64,
    columns=I64,
    tail=I64,
    foot=F64,
)

PROOF_GOAL = Bundle(
    ProofGoal,
    target=F64[3, 4],
    last=F64[3, 4],
    position=F64,
    chord=F64,
    angle=F64,
    weight_p=F64,
    weight_a=F64,
    margin=F64,
    margin_a=F64,
    trust=F64,
    length=F64,
    offset=F64,
    back=F64,
    side_y=F64,
    side_z=F64,
)


class BoxScratch(NamedTuple):
    """Memory of one search."""

    T: Array
    """(3, 4)"""
    z: Array
    """Axes at the centre, (m, 3)."""
    p: Array
    """Points on them, (m, 3)."""
    velocity: Array
    """Of the point, by each joint, (m, 3)."""
    slopes: Array
    """Of the columns, by each joint, (m, 3, 3)."""
    half: Array
    """Half width of each physical joint, (m,)."""
    chord: Array
    """2 sin(h/2) of each physical joint; of a slide h, (m,)."""
    r: Array
    """(m,)"""
    s: Array
    """(m,)"""
    lever: Array
    """Radii of the point that first-order tests compare, (m,)."""
    back: Array
    """Radii of the point that lies back along the first column, (m,)."""
    goal: Array
    """The target turned back by the first joint, (3, 4)."""
    c: Array
    """Centre of the box, (n,)."""
    h: Array
    """Its half widths, (n,)."""
    N: Array
    """Normal matrix, (n, n)."""
    H: Array
    """Second derivatives of the form, (n, n)."""
    g: Array
    """First derivatives, (n,)."""
    delta: Array
    """(n,)"""
    D: Array
    """Weights of the box in the normal matrix, (n,)."""
    v: Array
    """(n,)"""
    y: Array
    """The form: columns x, y, z, p as in a pose, (3, 4)."""
    found: Array
    """What is known of the box, by the module's constants `MISS_POINT` and following, (FOUND,)."""


@array_view
def make_box_scratch(joints: int, dof: int) -> BoxScratch:
    """Allocate the memory of one search."""
    return BoxScratch(
        np.zeros((3, 4)),
        np.zeros((joints, 3)),
        np.zeros((joints, 3)),
        np.zeros((joints, 3)),
        np.zeros((joints, 3, 3)),
        np.zeros(joints),
        np.zeros(joints),
        np.zeros(joints),
        np.zeros(joints),
        np.zeros(joints),
        np.zeros(joints),
        np.zeros((3, 4)),
        np.zeros(dof),
        np.zeros(dof),
        np.zeros((dof, dof)),
        np.zeros((dof, dof)),
        np.zeros(dof),
        np.zeros(dof),
        np.zeros(dof),
        np.zeros(dof),
        np.zeros((3, 4)),
        np.zeros(FOUND),
    )


@inlined
def place(form: Form, scratch: BoxScratch) -> None:
    """Axes and hand at the centre of the box, seen from the frame that the first joint moves where it is divided out."""
    T, m = scratch.T, len(form.leader)
    identity(T)
    begin = 0
    if form.head != 0:
        for i in range(3):
            scratch.z[0, i], scratch.p[0, i] = 0.0, 0.0
        scratch.z[0, 2] = 1.0
        begin = 1
    for k in range(begin, m):
        advance(form.fixed[k], True, 0.0, T)
        for i in range(3):
            scratch.z[k, i], scratch.p[k, i] = T[i, 2], T[i, 3]
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
    """An upper bound of 2 sin(angle/2) for angle ≥ 0, and 2 beyond π: its Taylor polynomial ends on a positive term.

    At 3 that polynomial, ``a - a³/24 + a⁵/1920``, has reached 2, the longest chord that there is; later it falls below
    again.
    """
    if angle > 3.0:
        return 2.0
    square = angle * angle
    return min(angle * (1.0 - square * (1.0 / 24.0 - square / 1920.0)), 2.0)


@inlined
def widths(form: Form, scratch: BoxScratch) -> None:
    """Half widths and chords of the physical joints."""
    for k in range(len(form.leader)):
        scratch.half[k] = abs(form.multiplier[k]) * scratch.h[form.leader[k]]
        scratch.chord[k] = scratch.half[k] if form.prismatic[k] else chord_of(scratch.half[k])


@inlined
def short_way(angle: float) -> float:
    """The same turn without whole ones, from -π to π [rad]."""
    turn = 2.0 * math.pi
    left: float = angle - turn * np.floor(angle / turn + 0.5)
    return left


@inlined
def turned(form: Form, scratch: BoxScratch, count: int) -> float:
    """How far the first `count` joints turn what they carry, at most, each from the centre of the box [rad]."""
    total = 0.0
    for k in range(count):
        total += 0.0 if form.prismatic[k] else scratch.half[k]
    return total


@inlined
def turn_goal(form: Form, proof_goal: ProofGoal, scratch: BoxScratch) -> None:
    """The target as the frame after the first joint sees it, with that joint at the centre of its range."""
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
def motion(form: Form, scratch: BoxScratch, begin: int, end: int, wx: float, wy: float, wz: float) -> float:
    """Largest motion of the point w by joints begin … end-1 within the box [m]; leaves their radii in the scratch memory."""
    total = 0.0
    for k in range(begin, end):
        z0, z1, z2 = scratch.z[k, 0], scratch.z[k, 1], scratch.z[k, 2]
        if form.prismatic[k]:
            scratch.velocity[k, 0], scratch.velocity[k, 1], scratch.velocity[k, 2] = z0, z1, z2
            scratch.r[k] = 1.0
            scratch.lever[k] = 1.0
        else:
            v0, v1, v2 = wx - scratch.p[k, 0], wy - scratch.p[k, 1], wz - scratch.p[k, 2]
            x0, x1, x2 = z1 * v2 - z2 * v1, z2 * v0 - z0 * v2, z0 * v1 - z1 * v0
            scratch.velocity[k, 0], scratch.velocity[k, 1], scratch.velocity[k, 2] = x0, x1, x2
            scratch.r[k] = math.sqrt(x0 * x0 + x1 * x1 + x2 * x2)
            scratch.lever[k] = scratch.r[k]
        total += scratch.r[k] * scratch.chord[k]
    return total


@inlined
def turning(form: Form, scratch: BoxScratch, begin: int, end: int, ax: float, ay: float, az: float) -> float:
    """Largest motion of the unit vector a by joints begin … end-1 within the box; leaves the sines in the scratch memory."""
    total = 0.0
    for k in range(begin, end):
        if form.prismatic[k]:
            scratch.s[k] = 0.0
            continue
        z0, z1, z2 = scratch.z[k, 0], scratch.z[k, 1], scratch.z[k, 2]
        x0, x1, x2 = z1 * az - z2 * ay, z2 * ax - z0 * az, z0 * ay - z1 * ax
        scratch.s[k] = math.sqrt(x0 * x0 + x1 * x1 + x2 * x2)
        total += scratch.s[k] * scratch.chord[k]
    return total


@inlined
def widest(form: Form, proof_goal: ProofGoal, scratch: BoxScratch, head: float) -> int:
    """The variable whose range moves the hand most; a first joint that turns counts for `head`."""
    best, index = -1.0, 0
    for i in range(len(scratch.c)):
        scratch.delta[i] = 0.0
    for k in range(len(form.leader)):
        turn = 0.0 if form.prismatic[k] else proof_goal.length * (scratch.s[k] if form.columns == 1 else 1.0)
        if form.columns == 0:
            turn = 0.0
        i = form.leader[k]
        share = head if k == 0 and form.head == TURN else 1.0
        scratch.delta[i] += abs(form.multiplier[k]) * scratch.h[i] * (scratch.lever[k] + turn) * share
    for i in range(len(scratch.c)):
        if scratch.delta[i] > best:
            best, index = scratch.delta[i], i
    return index


@inlined
def load_box(boxes: Array, row: int, scratch: BoxScratch) -> None:
    """Take a box from row `row` of the list."""
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
    """By how much a half width grows where its box is moved or cut, so that rounding of either end loses nothing.

    Relative to the numbers: a slide that stands at 1e6 m is rounded to 1e-10 m. A new centre and a new half width take three
    operations each on numbers no larger than these; nine times the unit roundoff covers six.
    """
    return LEAST * (1.0 + abs(centre) + half)


@inlined
def halve(scratch: BoxScratch, i: int, boxes: Array, first: int, second: int) -> None:
    """Cut the box in half along variable i, and write the halves to two rows; the scratch memory keeps the middle."""
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
