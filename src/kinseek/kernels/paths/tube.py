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

from kinseek.kernels.arrays import Array
from kinseek.kernels.jit import inlined
from kinseek.kernels.proof.box import LEAST, BoxScratch, Form, place
from kinseek.kernels.proof.taylor import derivatives, differentiate, normal_matrix, rests

from .motion import LENGTH, MARGIN, MARGIN_A, Motion, Tube, across_by

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

TURNED, ASKEW = 1.4, 0.1
"""By so much may joints turn the hand, and the goal, within a tube [rad]; and so far may the columns of the two be apart at
its centre, together: that leaves less than 90°."""

NARROWING = 3
"""How often the enclosure of the branch is made narrower. By trial more gain nothing."""


@inlined
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


@inlined
def aim(motion: Motion) -> None:
    """Place the arm at the scratch memory's centre, and write down M there and M f(c)."""
    form, scratch, tube, hold = motion.form, motion.scratch, motion.tube, motion.hold
    n, columns, held = len(tube.half), form.columns, motion.hold.shape[0]
    T, goal = scratch.T, scratch.goal
    weight = 1.0 / (motion.numbers[LENGTH] * motion.numbers[LENGTH])
    place(form, scratch)
    differentiate(form, scratch, 0, columns)
    normal_matrix(form, scratch, weight, 1.0, columns)
    for i in range(n):
        for j in range(i + 1):
            total = scratch.N[i, j]
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
            value += gain * across_by(motion, a, scratch.c, scratch.c[n])
        for r in range(3):
            for c in range(4):
                if columns <= c < 3:
                    tube.rows[row, r, c] = 0.0
                    continue
                part = 0.0
                for k in range(2, len(form.leader)):
                    moved = scratch.velocity[k, r] if c == 3 else scratch.slopes[k, c, r]
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


@inlined
def expand(motion: Motion, middle: int) -> None:
    """Write down what M makes of the derivatives at the centre where `aim` was, and the tangent."""
    form, scratch, tube, hold = motion.form, motion.scratch, motion.tube, motion.hold
    n, held = len(tube.half), motion.hold.shape[0]
    differentiate(form, scratch, middle, form.columns)
    for row in range(n):
        for r in range(3):
            for c in range(4):
                scratch.y[r, c] = tube.rows[row, r, c]
        derivatives(form, scratch, middle, form.columns)
        for i in range(n + 1):
            tube.slope[row, i] = scratch.g[i]
            for j in range(n + 1):
                tube.bend[row, i, j] = scratch.H[i, j]
        for a in range(held):
            gain = tube.across[row, a]
            for j in range(n):
                tube.slope[row, j] += gain * hold[a, j]
                tube.slope[row, n] -= gain * hold[a, j] * (motion.end[j] - motion.begin[j])
        tube.t[row] = -tube.slope[row, n]
    for row in range(n):
        tube.u[row] = -bent(tube, row, tube.t, tube.t)


@inlined
def bent(tube: Tube, row: int, x: Array, y: Array) -> float:
    """A row of M H x y."""
    total = 0.0
    for i in range(len(x)):
        part = 0.0
        for j in range(len(y)):
            part += tube.bend[row, i, j] * y[j]
        total += part * x[i]
    return total


@inlined
def begin_tube(motion: Motion, middle: int, h: float) -> None:
    """Write a, how far N moves the middle of a tube over s within h of the centre."""
    form, scratch, tube = motion.form, motion.scratch, motion.tube
    n = len(tube.half)
    for i in range(n + 1):
        tube.wide[i] = h * abs(tube.t[i]) + 0.5 * h * h * abs(tube.u[i])
    for k in range(len(form.leader)):
        scratch.half[k] = abs(form.multiplier[k]) * tube.wide[form.leader[k]]
    _, _, three_p, three_c = rests(form, scratch, scratch.r, middle)
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


@inlined
def gains(form: Form, scratch: BoxScratch, tube: Tube, middle: int) -> float:
    """Write ∂rest/∂δ of every physical joint within ``scratch.half``; return how far hand or goal turn, at most [rad]."""
    m, most = len(form.leader), 0.0
    for side in range(2):
        count = m - middle if side == 0 else middle
        spread = 0.0
        for index in range(count):
            k = middle + index if side == 0 else middle - 1 - index
            spread += 0.0 if form.prismatic[k] else scratch.half[k]
            tube.spread[k] = spread
        most = max(most, spread)
        tail_point = tail_column = 0.0
        for back in range(count):
            index = count - 1 - back
            k = middle + index if side == 0 else middle - 1 - index
            upto = tube.spread[k]
            if form.prismatic[k]:
                tube.gain_point[k], tube.gain_column[k] = 0.5 * upto * upto, 0.0
                tail_point += scratch.half[k] * upto
                continue
            before = upto - scratch.half[k]
            tube.gain_point[k] = tail_point + 0.5 * scratch.r[k] * upto * upto
            tube.gain_column[k] = tail_column + 0.5 * scratch.s[k] * upto * upto
            square = 0.5 * (upto + before) * scratch.half[k]
            tail_point += scratch.r[k] * square
            tail_column += scratch.s[k] * square
    return most


@inlined
def contract(motion: Motion, middle: int, half: Array, out: Array) -> float:
    """Write a + C ``half`` of a tube as wide as that into `out`; return how far hand or goal turn in it, at most [rad]."""
    form, scratch, tube = motion.form, motion.scratch, motion.tube
    n = len(half)
    for i in range(n):
        scratch.h[i] = tube.wide[i] + half[i]
    scratch.h[n] = tube.wide[n]
    for k in range(len(form.leader)):
        scratch.half[k] = abs(form.multiplier[k]) * scratch.h[form.leader[k]]
    turned = gains(form, scratch, tube, middle)
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
                part += abs(tube.bend[row, j, l]) * scratch.h[l]
            total += part * half[j]
        out[row] = total
    return turned


@inlined
def middle_at(tube: Tube, i: int, tau: float) -> float:
    """Where the middle of the tube is, of joint i at s = σ + τ."""
    value: float = tube.c[i] + tau * (tube.t[i] + 0.5 * tau * tube.u[i])
    return value


@inlined
def aim_at_answer(motion: Motion) -> bool:
    """Aim from the scratch memory's centre, moved by one step to the answer beside it; is M good for a proof there?"""
    scratch, tube = motion.scratch, motion.tube
    n = len(tube.half)
    aim(motion)
    for i in range(n):
        if not abs(tube.value[i]) <= LARGEST:
            return False
        scratch.c[i] -= tube.value[i]
    aim(motion)
    askew = 0.0
    for r in range(3):
        for c in range(motion.form.columns):
            askew += (scratch.T[r, c] - scratch.goal[r, c]) * (scratch.T[r, c] - scratch.goal[r, c])
    if not askew <= ASKEW * ASKEW:
        return False
    for i in range(n):
        if not (tube.point[i] <= STEEP and tube.column[i] <= STEEP):
            return False
    for i in range(n + 1):
        tube.c[i] = scratch.c[i]
    return True


@inlined
def inflate(motion: Motion, middle: int, least: float) -> bool:
    """Look for a tube, no joint narrower than `least`, from what was written of its middle; is there one?

    It is in ``tube.half``, and ``tube.away`` is how far from its middle the branch is, at most.
    """
    tube = motion.tube
    n = len(tube.half)
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


@inlined
def find_tube(motion: Motion, middle: int, h: float, least: float) -> bool:
    """Look for a tube around the scratch memory's centre over s within h of it, no joint narrower than `least`.

    It is in ``tube.half``, and ``tube.away`` is how far from its middle the branch is, at most.
    """
    if not aim_at_answer(motion):
        return False
    expand(motion, middle)
    begin_tube(motion, middle, h)
    return inflate(motion, middle, least)
