"""A tube around a branch: for every s of an interval one answer in it, and no second one (Krawczyk 1969, Neumaier 1990).

The hand is to be at p + s d, turned by s w from R. So the arm on two more joints, which undo that, a slide by -s d on a turn
by -s w about p, has the same pose [R p] to reach for every s; s is one more variable, and the Taylor polynomial of
`kernels.proof` serves as it is. Around a centre (q, σ) = c write x = q + τ t + ½ τ² u + δ, τ = s - σ, for joint values, f
for what the hand misses (with joints to spare also for how far x is, across, from where it is held), M for about the inverse
of its derivative J by the joints, and H for its second derivatives, s among the variables. Of N(δ) = δ - M f(x, s) in a tube
|δ| ≤ ρ, |τ| ≤ h is known, with v = |t| h + ½ |u| h²,

    |N(0)| ≤ a = |M f(c)| + h |M J t| + ½ h² |M (J u + H t t)| + ½ h³ |M H t u| + ⅛ h⁴ |M H u u| + |M| rest(v),
    |∂N/∂δ| ≤ C = |1 - MJ| + |M H| (v + ρ) + |M| ∂rest/∂δ (v + ρ).

Where κ = a + C ρ < ρ in every joint, N maps the tube into itself and draws all points of it together, for every s. So
(Banach 1922) it has one fixed point, which moves continuously with s; and it is the only answer in the tube, no farther
from the middle of it than any ε ≥ a + C ε.

A fixed point is an answer: M = D [Jᵀ W, A], with A across and J the geometric Jacobian of the hand at c. C ρ < ρ leaves D
and the square matrix [Jᵀ, A], which acts on a force and a torque at the hand, regular. So at a fixed point no force is left,
which is the place, and no torque ``Σ R_c x (H_c - G_c)``: R_c are the hand's columns at the centre, H_c and G_c those of the
hand and of the goal as seen from halfway. Turned by less than 90° from R_c, they are equal where that sum is zero.

∂rest/∂δ: `rests` bounds what a Taylor polynomial of the hand leaves out, as a polynomial of the widths; its derivative by a
width bounds what the derivative by that joint leaves out. (Both come term by term from ``E_1 … E_{k-1} v_k``, where turns
have derivatives no longer than 1, and v_k none longer than r_k.)
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from kinseek.kernels.arrays import Array, ChainArrays
from kinseek.kernels.jit import hidden, view
from kinseek.kernels.proof.box import LEAST, Desk, Form, make_desk, place
from kinseek.kernels.proof.taylor import derivatives, differentiate, normal_matrix, rests

FIRST, GROWTH, ROUNDS = 4.0, 1.2, 12
"""The first tube is so many times as wide as N moves its middle; one that is too narrow becomes what κ makes of it, times
GROWTH, so often (Rump 1983: ε-inflation)."""

LARGEST = 0.3
"""Half width at which it is given up [rad] or [m]; those that hold are mostly far narrower."""

HOLDS = 0.999
"""κ(ρ) < ρ counts where it holds by a thousandth: far more than rounding of κ, as long as M is no larger than `STEEP`."""

STEEP = 1e7
"""M may move a joint by so much for a metre or a radian of the hand: beyond, rounding would count. Margins stand beside what
rounding does to the hand's pose."""

REGULAR = 1e-13
"""Added to the diagonal of the normal matrix, as a part of its trace, so that its inverse stays finite where the arm is
singular. Whatever M is, the inequality is true."""

TURNED = 1.4
"""By so much may joints turn the hand, and the goal, within a tube [rad]; 90° are allowed."""

NARROWING = 3
"""How often the enclosure of the branch is made narrower. By trial more gain nothing."""


class Tube(NamedTuple):
    """Memory of one tube around the desk's centre, and what is known of it; rows are joints."""

    c: Array
    """Centre, (n+1,)."""
    t: Array
    """Tangent of the branch by s, its last number 1, (n+1,)."""
    u: Array
    """Second derivative, its last number 0, (n+1,)."""
    rows: Array
    """M of the columns and of the point, as in a pose, (n, 3, 4)."""
    across: Array
    """M of how far the joints are across, (n, k)."""
    point: Array
    """Length of M's part for the point, (n,)."""
    column: Array
    """Length of M's part for the columns, (n,)."""
    value: Array
    """M f(c), (n,)."""
    slope: Array
    """M f', (n, n+1)."""
    bend: Array
    """M H, (n, n+1, n+1)."""
    D: Array
    """Inverse of the normal matrix, (n, n)."""
    start: Array
    """a, (n,)."""
    wide: Array
    """v, (n+1,)."""
    half: Array
    """ρ, (n,)."""
    reach: Array
    """κ(ρ), (n,)."""
    away: Array
    """ε, (n,)."""
    gain_point: Array
    """Of each physical joint, ∂rest/∂δ of the point, (m+2,)."""
    gain_column: Array
    """And of the columns."""
    spread: Array
    """How far all joints from the middle of the arm up to each turn, (m+2,)."""


class Motion(NamedTuple):
    """The hand's way from a pose to the next, seen by the arm on two more joints."""

    form: Form
    """The arm on them."""
    desk: Desk
    """Its centre has s as the last number."""
    tube: Tube
    hold: Array
    """Directions in which the joints are held to their straight way, (k, n); none where answers are isolated."""
    begin: Array
    """Joint values at s = 0, (n,)."""
    end: Array
    """At s = 1."""
    numbers: Array
    """See `LENGTH`."""


LENGTH, MARGIN, MARGIN_A, COUNT = range(4)
"""Numbers of a motion: what a radian counts as [m]; margins for rounding, of the point [m] and of the columns; how many."""


@view
def make_motion(chain: ChainArrays, columns: int, begin: Array, hold: Array, numbers: Array) -> Motion:
    """Allocate the memory for the steps of one path; the first two joints are set by `lead`."""
    m, n = len(chain.leader), len(chain.lower)
    fixed, prismatic = np.zeros((m + 3, 3, 4)), np.zeros(m + 2, dtype=np.bool_)
    leader, multiplier, offset = np.full(m + 2, n), np.zeros(m + 2), np.zeros(m + 2)
    prismatic[1] = True
    for k in range(m):
        prismatic[k + 2], leader[k + 2] = chain.prismatic[k], chain.leader[k]
        multiplier[k + 2], offset[k + 2] = chain.multiplier[k], chain.offset[k]
    for k in range(m + 1):
        for r in range(3):
            for c in range(4):
                fixed[k + 2, r, c] = chain.fixed[k, r, c]
    tube = Tube(
        np.zeros(n + 1),
        np.ones(n + 1),
        np.zeros(n + 1),
        np.zeros((n, 3, 4)),
        np.zeros((n, hold.shape[0])),
        np.zeros(n),
        np.zeros(n),
        np.zeros(n),
        np.zeros((n, n + 1)),
        np.zeros((n, n + 1, n + 1)),
        np.zeros((n, n)),
        np.zeros(n),
        np.zeros(n + 1),
        np.zeros(n),
        np.zeros(n),
        np.zeros(n),
        np.zeros(m + 2),
        np.zeros(m + 2),
        np.zeros(m + 2),
    )
    form = Form(fixed, prismatic, leader, multiplier, offset, 0, columns, 0, 0.0)
    return Motion(
        form, make_desk(m + 2, n + 1), tube, hold.copy(), begin.copy(), begin.copy(), numbers.copy()
    )


@hidden
def frame_along(x: float, y: float, z: float, size: float, frame: Array) -> None:
    """Write axes whose third has the direction of a vector of length `size` into the rotation of `frame`, (3, 4)."""
    if size > 0.0:
        x, y, z = x / size, y / size, z / size
    else:
        x, y, z = 0.0, 0.0, 1.0
    # Across from the vector and from the axis of the base that is farthest from it.
    if abs(x) <= abs(y) and abs(x) <= abs(z):
        a, b, c = 0.0, z, -y
    elif abs(y) <= abs(z):
        a, b, c = -z, 0.0, x
    else:
        a, b, c = y, -x, 0.0
    length = math.sqrt(a * a + b * b + c * c)
    a, b, c = a / length, b / length, c / length
    frame[0, 0], frame[1, 0], frame[2, 0] = a, b, c
    frame[0, 1], frame[1, 1], frame[2, 1] = y * c - z * b, z * a - x * c, x * b - y * a
    frame[0, 2], frame[1, 2], frame[2, 2] = x, y, z


@hidden
def lead(motion: Motion, chain: ChainArrays, target: Array, slide: Array, turn: Array) -> None:
    """Set the two joints that undo the hand's way from a target, (3, 4), by d [m] and w [rad], (3,) each, in the base."""
    form, goal = motion.form, motion.desk.goal
    fixed = form.fixed
    way = math.sqrt(slide[0] * slide[0] + slide[1] * slide[1] + slide[2] * slide[2])
    angle = math.sqrt(turn[0] * turn[0] + turn[1] * turn[1] + turn[2] * turn[2])
    form.multiplier[0], form.multiplier[1] = -angle, -way
    frame_along(turn[0], turn[1], turn[2], angle, fixed[0])
    along = motion.desk.T  # Free until the arm is placed.
    frame_along(slide[0], slide[1], slide[2], way, along)
    for r in range(3):
        fixed[0, r, 3] = target[r, 3]
        for c in range(4):
            goal[r, c] = target[r, c]
    for r in range(3):
        for c in range(3):
            fixed[1, r, c] = (
                fixed[0, 0, r] * along[0, c] + fixed[0, 1, r] * along[1, c] + fixed[0, 2, r] * along[2, c]
            )
        fixed[1, r, 3] = -(
            fixed[0, 0, r] * target[0, 3] + fixed[0, 1, r] * target[1, 3] + fixed[0, 2, r] * target[2, 3]
        )
        for c in range(4):
            first = chain.fixed[0]
            fixed[2, r, c] = along[0, r] * first[0, c] + along[1, r] * first[1, c] + along[2, r] * first[2, c]


@hidden
def invert(A: Array) -> None:
    """Invert a symmetric positive definite matrix in place; where it is singular, what comes is finite and useless."""
    n = A.shape[0]
    least = 0.0
    for k in range(n):
        least += A[k, k]
    least = REGULAR * least + LEAST
    for k in range(n):
        A[k, k] += least
    for k in range(n):
        pivot = 1.0 / max(A[k, k], least)
        A[k, k] = 1.0
        for j in range(n):
            A[k, j] *= pivot
        for i in range(n):
            if i == k:
                continue
            factor = A[i, k]
            A[i, k] = 0.0
            for j in range(n):
                A[i, j] -= factor * A[k, j]


@hidden
def across_by(motion: Motion, a: int, q: Array, s: float) -> float:
    """How far joint values are from where they are held at s, in one of the directions."""
    off = 0.0
    for j in range(motion.hold.shape[1]):
        off += motion.hold[a, j] * (q[j] - motion.begin[j] - s * (motion.end[j] - motion.begin[j]))
    return off


@hidden
def aim(motion: Motion) -> None:
    """Place the arm at the desk's centre, and write down M there and M f(c)."""
    form, desk, tube, hold = motion.form, motion.desk, motion.tube, motion.hold
    n, columns, held = len(tube.half), form.columns, motion.hold.shape[0]
    T, goal = desk.T, desk.goal
    weight = 1.0 / (motion.numbers[LENGTH] * motion.numbers[LENGTH])
    place(form, desk)
    differentiate(form, desk, 0, columns)
    normal_matrix(form, desk, weight, 1.0, columns)
    for i in range(n):
        for j in range(i + 1):
            total = desk.N[i, j]
            for a in range(held):
                total += hold[a, i] * hold[a, j]
            tube.D[i, j] = tube.D[j, i] = total
    invert(tube.D)
    for row in range(n):
        value = point = column = 0.0
        for a in range(held):
            gain = 0.0
            for j in range(n):
                gain += tube.D[row, j] * hold[a, j]
            tube.across[row, a] = gain
            value += gain * across_by(motion, a, desk.c, desk.c[n])
        for r in range(3):
            for c in range(4):
                if columns <= c < 3:
                    tube.rows[row, r, c] = 0.0
                    continue
                part = 0.0
                for k in range(2, len(form.leader)):
                    moved = desk.velocity[k, r] if c == 3 else desk.slopes[k, c, r]
                    part += form.multiplier[k] * tube.D[row, form.leader[k]] * moved
                if c == 3:
                    part *= weight
                    point += part * part
                else:
                    column += part * part
                tube.rows[row, r, c] = part
                value += part * (T[r, c] - goal[r, c])
        tube.value[row] = value
        tube.point[row], tube.column[row] = math.sqrt(point), math.sqrt(column)


@hidden
def expand(motion: Motion, middle: int) -> None:
    """Write down what M makes of the derivatives at the centre where `aim` was, and the tangent."""
    form, desk, tube, hold = motion.form, motion.desk, motion.tube, motion.hold
    n, held = len(tube.half), motion.hold.shape[0]
    differentiate(form, desk, middle, form.columns)
    for row in range(n):
        for r in range(3):
            for c in range(4):
                desk.y[r, c] = tube.rows[row, r, c]
        derivatives(form, desk, middle, form.columns)
        for i in range(n + 1):
            tube.slope[row, i] = desk.g[i]
            for j in range(n + 1):
                tube.bend[row, i, j] = desk.H[i, j]
        for a in range(held):
            gain = tube.across[row, a]
            for j in range(n):
                tube.slope[row, j] += gain * hold[a, j]
                tube.slope[row, n] -= gain * hold[a, j] * (motion.end[j] - motion.begin[j])
        tube.t[row] = -tube.slope[row, n]
    for row in range(n):
        tube.u[row] = -bent(tube, row, tube.t, tube.t)


@hidden
def bent(tube: Tube, row: int, x: Array, y: Array) -> float:
    """A row of M H x y."""
    total = 0.0
    for i in range(len(x)):
        part = 0.0
        for j in range(len(y)):
            part += tube.bend[row, i, j] * y[j]
        total += part * x[i]
    return total


@hidden
def begin_tube(motion: Motion, middle: int, h: float) -> None:
    """Write a, how far N moves the middle of a tube over s within h of the centre."""
    form, desk, tube = motion.form, motion.desk, motion.tube
    n = len(tube.half)
    for i in range(n + 1):
        tube.wide[i] = h * abs(tube.t[i]) + 0.5 * h * h * abs(tube.u[i])
    for k in range(len(form.leader)):
        desk.half[k] = abs(form.multiplier[k]) * tube.wide[form.leader[k]]
    _, _, three_p, three_c = rests(form, desk, desk.r, middle)
    three_p += motion.numbers[MARGIN]
    three_c += motion.numbers[MARGIN_A]
    for row in range(n):
        first = second = 0.0
        for i in range(n + 1):
            first += tube.slope[row, i] * tube.t[i]
            second += tube.slope[row, i] * tube.u[i]
        second += bent(tube, row, tube.t, tube.t)
        third, fourth = bent(tube, row, tube.t, tube.u), bent(tube, row, tube.u, tube.u)
        curved = abs(second) + h * (abs(third) + 0.25 * h * abs(fourth))
        tube.start[row] = (
            abs(tube.value[row])
            + h * (abs(first) + 0.5 * h * curved)
            + tube.point[row] * three_p
            + tube.column[row] * three_c
        )
        for a in range(motion.hold.shape[0]):
            tube.start[row] += abs(tube.across[row, a]) * motion.numbers[MARGIN]


@hidden
def gains(form: Form, desk: Desk, tube: Tube, middle: int) -> float:
    """Write ∂rest/∂δ of every physical joint within ``desk.half``; return how far hand or goal turn, at most [rad]."""
    m, most = len(form.leader), 0.0
    for side in range(2):
        count = m - middle if side == 0 else middle
        spread = 0.0
        for index in range(count):
            k = middle + index if side == 0 else middle - 1 - index
            spread += 0.0 if form.prismatic[k] else desk.half[k]
            tube.spread[k] = spread
        most = max(most, spread)
        tail_point = tail_column = 0.0
        for back in range(count):
            index = count - 1 - back
            k = middle + index if side == 0 else middle - 1 - index
            upto = tube.spread[k]
            if form.prismatic[k]:
                tube.gain_point[k], tube.gain_column[k] = 0.5 * upto * upto, 0.0
                tail_point += desk.half[k] * upto
                continue
            before = upto - desk.half[k]
            tube.gain_point[k] = tail_point + 0.5 * desk.r[k] * upto * upto
            tube.gain_column[k] = tail_column + 0.5 * desk.s[k] * upto * upto
            square = 0.5 * (upto + before) * desk.half[k]
            tail_point += desk.r[k] * square
            tail_column += desk.s[k] * square
    return most


@hidden
def contract(motion: Motion, middle: int, half: Array, out: Array) -> float:
    """Write a + C ``half`` of a tube as wide as that into `out`; return how far hand or goal turn in it, at most [rad]."""
    form, desk, tube = motion.form, motion.desk, motion.tube
    n = len(half)
    for i in range(n):
        desk.h[i] = tube.wide[i] + half[i]
    desk.h[n] = tube.wide[n]
    for k in range(len(form.leader)):
        desk.half[k] = abs(form.multiplier[k]) * desk.h[form.leader[k]]
    turned = gains(form, desk, tube, middle)
    more_point = more_column = 0.0
    for k in range(2, len(form.leader)):
        width = abs(form.multiplier[k]) * half[form.leader[k]]
        more_point += tube.gain_point[k] * width
        more_column += tube.gain_column[k] * width
    for row in range(n):
        total = tube.start[row] + tube.point[row] * more_point + tube.column[row] * more_column
        for j in range(n):
            part = abs(tube.slope[row, j] - (1.0 if j == row else 0.0))
            for l in range(n + 1):
                part += abs(tube.bend[row, j, l]) * desk.h[l]
            total += part * half[j]
        out[row] = total
    return turned


@hidden
def middle_at(tube: Tube, i: int, tau: float) -> float:
    """Where the middle of the tube is, of joint i at s = σ + τ."""
    value: float = tube.c[i] + tau * (tube.t[i] + 0.5 * tau * tube.u[i])
    return value


@hidden
def find_tube(motion: Motion, middle: int, h: float, least: float) -> bool:
    """Look for a tube around the desk's centre over s within h of it, no joint narrower than `least`; is there one?

    It is in ``tube.half``, and ``tube.away`` is how far from its middle the branch is, at most.
    """
    desk, tube = motion.desk, motion.tube
    n = len(tube.half)
    aim(motion)
    for i in range(n):
        if abs(tube.value[i]) > LARGEST:
            return False
        desk.c[i] -= tube.value[i]
    aim(motion)
    for i in range(n):
        if tube.point[i] > STEEP or tube.column[i] > STEEP:
            return False
    for i in range(n + 1):
        tube.c[i] = desk.c[i]
    expand(motion, middle)
    begin_tube(motion, middle, h)
    for i in range(n):
        tube.half[i] = FIRST * tube.start[i] + least
    for _ in range(ROUNDS):
        turned = contract(motion, middle, tube.half, tube.reach)
        holds, widest = turned < TURNED, 0.0
        for i in range(n):
            holds = holds and tube.reach[i] < HOLDS * tube.half[i]
            widest = max(widest, tube.reach[i])
        if holds:
            break
        if widest > LARGEST or turned >= TURNED:
            return False
        for i in range(n):
            tube.half[i] = max(tube.half[i], GROWTH * tube.reach[i] + least)
    if not holds:
        return False
    for i in range(n):
        tube.away[i] = tube.reach[i]
    for _ in range(NARROWING):
        contract(motion, middle, tube.away, tube.away)  # What is narrower by then serves already.
    return True
