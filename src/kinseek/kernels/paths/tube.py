"""A tube around a branch: exactly one solution in it for every s of an interval (Krawczyk 1969, Neumaier 1990).

The goal of the hand is p + s d, rotated by s w from R. The arm gets two additional joints that undo this motion: a slide
by -s d on a rotation by -s w about p. It then has the same goal [R p] for every s, s is one more variable, and the Taylor
polynomial of `kernels.proof` applies. Around a centre (q, σ) = c write x = q + τ t + ½ τ² u + δ, τ = s - σ, for joint
values. f is the error of the hand; for a redundant arm it includes the deviation of x in the held directions. M
approximates the inverse of its derivative J with respect to the joints. H are its second derivatives, with s among the
variables. In a tube |δ| ≤ ρ, |τ| ≤ h, N(δ) = δ - M f(x, s) satisfies, with v = |t| h + ½ |u| h²,

    |N(0)| ≤ a = |M f(c)| + h |M J t| + ½ h² |M (J u + H t t)| + ½ h³ |M H t u| + ⅛ h⁴ |M H u u| + |M| rest(v),
    |∂N/∂δ| ≤ C = |1 - MJ| + |M H| (v + ρ) + |M| ∂rest/∂δ (v + ρ).

If κ = a + C ρ < ρ in every joint, N maps the tube into itself and is a contraction, for every s. It then has one fixed
point (Banach 1922), which moves continuously with s. It is the only solution in the tube, and its distance from the
middle of the tube is at most any ε ≥ a + C ε.

A fixed point is a solution: M = D [Jᵀ W, A], where A belongs to the held directions and J is the geometric Jacobian of
the hand at c. C ρ < ρ implies that D and the square matrix [Jᵀ, A], which acts on a force and a torque at the hand, are
regular. At a fixed point the force, which is the position error, and the torque ``Σ R_c x (H_c - G_c)`` are therefore
zero. R_c are the hand's columns at the centre, and H_c and G_c are those of the hand and of the goal as seen from
halfway. If both are rotated by less than 90° from R_c, they are equal where that sum is zero.

∂rest/∂δ: `rests` bounds the remainder of a Taylor polynomial of the hand, as a polynomial of the widths. Its derivative
with respect to a width bounds the remainder of the derivative with respect to that joint. (Both follow term by term from
``E_1 … E_{k-1} v_k``, where rotations have derivatives with norms of at most 1, and the norm of v_k is at most r_k.)
"""

from __future__ import annotations

import math

from kinseek.kernels.arm.forward import copy_pose
from kinseek.kernels.arrays import Array
from kinseek.kernels.jit import inlined
from kinseek.kernels.proof.box import LEAST, BoxScratch, Form, place
from kinseek.kernels.proof.taylor import derivatives, differentiate, normal_matrix, rests

from .motion import Motion, Tube, across_by

FIRST, GROWTH, ROUNDS = 4.0, 1.2, 12
"""The first tube is FIRST times as wide as the distance that N moves its middle. A tube that is too narrow is replaced by
its κ times GROWTH, up to ROUNDS times (Rump 1983: ε-inflation)."""

LARGEST = 0.3
"""Half width above which the proof is given up [rad] or [m]; most tubes that exist are far narrower."""

HOLDS = 0.999
"""κ(ρ) < ρ must hold with a margin of a thousandth, which is far more than the rounding of κ if the norms of M are at
most `STEEP`."""

STEEP = 1e7
"""Largest norm of M, the motion of a joint for a metre or a radian of the hand; beyond it rounding would matter. Margins
allow for the rounding of the hand's pose."""

REGULAR = 1e-13
"""Added to the diagonal of the normal matrix, as a fraction of its trace, so that its inverse stays finite at
singularities. The inequality holds for any M."""

TURNED, ASKEW = 1.4, 0.1
"""Largest rotation of the hand, and of the goal, by the joints within a tube [rad]; and the largest difference of their
columns at its centre. Together they stay below 90°."""

NARROWING = 3
"""Number of times that the enclosure of the branch is narrowed. More gain nothing. Not examined further."""


@inlined
def invert(A: Array, least: float) -> None:
    """Invert a symmetric positive definite matrix, (n, n), in place (Gauss-Jordan without pivoting).

    Pivots are raised to `least`: if the matrix is singular, the result is finite but useless.
    """
    n = A.shape[0]
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
    """Place the arm at the centre of the scratch memory, and write M and M f(c) there."""
    form, scratch, tube, hold = motion.form, motion.scratch, motion.tube, motion.hold
    n, columns, held = len(tube.half), form.columns, motion.hold.shape[0]
    T, goal = scratch.T, scratch.goal
    weight, trace = 1.0 / (motion.margins.length * motion.margins.length), 0.0
    place(form, scratch)
    differentiate(form, scratch, 0, columns)
    normal_matrix(form, scratch, weight, 1.0, columns)
    for i in range(n):
        for j in range(i + 1):
            total = scratch.N[i, j]
            for a in range(held):
                total += hold[a, i] * hold[a, j]
            tube.D[i, j] = tube.D[j, i] = total
        trace += tube.D[i, i]
    least = REGULAR * trace + LEAST
    for i in range(n):
        tube.D[i, i] += least
    invert(tube.D, least)
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
                    part += form.multiplier[k] * tube.D[row, form.leader[k]] * scratch.J[k, r, c]
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
    """Write the products of M with the derivatives at the centre used by `aim`, and the tangent."""
    form, scratch, tube, hold = motion.form, motion.scratch, motion.tube, motion.hold
    n, held = len(tube.half), motion.hold.shape[0]
    differentiate(form, scratch, middle, form.columns)
    for row in range(n):
        copy_pose(tube.rows[row], scratch.y)
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
    """One row of M H x y."""
    total = 0.0
    for i in range(len(x)):
        part = 0.0
        for j in range(len(y)):
            part += tube.bend[row, i, j] * y[j]
        total += part * x[i]
    return total


@inlined
def spread_widths(form: Form, widths: Array, half: Array) -> None:
    """Write the half widths of the physical joints, (m+2,), for those of the variables, (n+1,)."""
    for k in range(len(form.leader)):
        half[k] = abs(form.multiplier[k]) * widths[form.leader[k]]


@inlined
def remainders(motion: Motion, middle: int) -> tuple[float, float]:
    """Bound the remainder of the second-order Taylor polynomial within v, with rounding: of the point and the columns."""
    scratch = motion.scratch
    spread_widths(motion.form, motion.tube.wide, scratch.half)
    _, _, point, columns = rests(motion.form, scratch, scratch.r, middle)
    return point + motion.margins.point, columns + motion.margins.columns


@inlined
def begin_tube(motion: Motion, middle: int, h: float) -> None:
    """Write a, a bound of the distance that N moves the middle of a tube over |s - σ| ≤ h."""
    tube, n = motion.tube, len(motion.tube.half)
    for i in range(n + 1):
        tube.wide[i] = h * abs(tube.t[i]) + 0.5 * h * h * abs(tube.u[i])
    three_p, three_c = remainders(motion, middle)
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
            tube.start[row] += abs(tube.across[row, a]) * motion.margins.point


@inlined
def gains(form: Form, scratch: BoxScratch, tube: Tube, middle: int) -> float:
    """Write ∂rest/∂δ of every physical joint within ``scratch.half``; return the largest rotation of hand or goal [rad]."""
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
    """Write a + C ``half`` for a tube of these half widths into `out`; return the largest rotation of hand or goal [rad]."""
    form, scratch, tube = motion.form, motion.scratch, motion.tube
    n = len(half)
    for i in range(n):
        scratch.h[i] = tube.wide[i] + half[i]
    scratch.h[n] = tube.wide[n]
    spread_widths(form, scratch.h, scratch.half)
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
    """Value of joint i in the middle of the tube at s = σ + τ."""
    value: float = tube.c[i] + tau * (tube.t[i] + 0.5 * tau * tube.u[i])
    return value


@inlined
def aim_at_solution(motion: Motion) -> bool:
    """Call `aim` at the centre, corrected by one step to the solution next to it; return True if M allows a proof."""
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
    """Look for a tube, with half widths of at least `least`, from the bounds of its middle; return True if there is one.

    ``tube.half`` receives its half widths, and ``tube.away`` upper bounds of the distance of the branch from its middle.
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
        # Entries that are narrowed already are used for the next ones.
        contract(motion, middle, tube.away, tube.away)
    return True


@inlined
def find_tube(motion: Motion, middle: int, h: float, least: float) -> bool:
    """Look for a tube around the centre over |s - σ| ≤ h, with half widths of at least `least`; return True if found.

    ``tube.half`` receives its half widths, and ``tube.away`` upper bounds of the distance of the branch from its middle.
    """
    if not aim_at_solution(motion):
        return False
    expand(motion, middle)
    begin_tube(motion, middle, h)
    return inflate(motion, middle, least)
