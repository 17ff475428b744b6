"""Proof that one unbroken branch leads from pose to pose within the limits, by consecutive tubes along each step."""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np

from kinseek.kernels.arm.vectors import row
from kinseek.kernels.arrays import Array, ChainArrays, Flags, Indices, Limits
from kinseek.kernels.entry import OUT
from kinseek.kernels.jit import entry, inlined
from kinseek.kernels.proof.box import LEAST
from kinseek.kernels.proof.box import place as place_arm

from .motion import Margins, Motion, across_by, lead, make_motion
from .tube import find_tube, middle_at

UNPROVED, INSIDE, SOMEWHERE, OUTSIDE, LEAVES = 0, 1, 2, 3, 4
"""What is proved of a step: nothing; an unbroken branch within the limits; an unbroken branch that may leave them; an
unbroken branch that leaves the limits somewhere; or that the branch from the start leaves the limits, and nothing
about the rest."""

TUBES = 128
"""Largest number of tubes tried on one step."""

SHORTEST = 1.0 / 256.0
"""Fraction of a step below which the proof is given up. A power of two, so that parts of steps begin and end at exactly
the same s."""

FINEST = 1.0 / 32.0
"""Fraction of a step below which a tube near a limit is not split again."""

WITHIN = 1e-12
"""Safety margin of containment in a tube: this fraction of its width, plus `LEAST` times the numbers, covers a thousand
roundings."""


class Miss(NamedTuple):
    """Deviation of the hand from its path, with rounding."""

    point: float
    """Of the point [m]."""
    columns: float
    """Of all columns together."""


class Moves(NamedTuple):
    """Steps of a path."""

    targets: Annotated[Array, "steps", 3, 4]
    """Poses of the hand at the start of each step, (steps, 3, 4), lengths in [m]."""
    slides: Annotated[Array, "steps", 3]
    """Translation of the hand, (steps, 3), [m]."""
    turns: Annotated[Array, "steps", 3]
    """Rotation vector of the hand in the base, (steps, 3), [rad]."""
    begins: Annotated[Array, "steps", "n"]
    """Joint values that reach the targets, (steps, n), [rad] or [m]."""
    ends: Annotated[Array, "steps", "n"]
    """Joint values that reach the pose at the end, (steps, n)."""
    hold: Annotated[Array, "steps", "*", "n"]
    """For redundant arms, orthonormal directions that are held to linear interpolation, (steps, k, n)."""
    rims: Annotated[Array, "steps", 2]
    """Largest distance of the branch from start and end, (steps, 2), [rad] or [m]."""
    asked: Annotated[Flags, "steps"]
    """True for the steps to prove, (steps,)."""


@inlined
def clearly_inside(off: float, half: float, value: float) -> bool:
    """Return True if `off` is within half the width of a tube, despite rounding of joint values as large as `value`."""
    return off <= half * (1.0 - WITHIN) - 4.0 * LEAST * (1.0 + abs(value))


@inlined
def miss_of(motion: Motion, q: Array, s: float) -> Miss:
    """Deviation of the hand from its path at joint values q: of the point [m] and of the columns, with rounding."""
    scratch, form, n = motion.scratch, motion.form, len(q)
    for i in range(n):
        scratch.c[i] = q[i]
    scratch.c[n] = s
    place_arm(form, scratch)
    point = column = 0.0
    for r in range(3):
        off = scratch.T[r, 3] - scratch.goal[r, 3]
        point += off * off
        for c in range(form.columns):
            off = scratch.T[r, c] - scratch.goal[r, c]
            column += off * off
    return Miss(math.sqrt(point) + motion.margins.point, math.sqrt(column) + motion.margins.columns)


@inlined
def correct(motion: Motion, q: Array, s: float) -> None:
    """Move joint values in the tube nearer to its branch by a Newton step with the tube's M."""
    scratch, tube, hold = motion.scratch, motion.tube, motion.hold
    n = len(q)
    miss_of(motion, q, s)
    for i in range(n):
        off = 0.0
        for r in range(3):
            for c in range(4):
                off += tube.rows[i, r, c] * (scratch.T[r, c] - scratch.goal[r, c])
        for a in range(hold.shape[0]):
            off += tube.across[i, a] * across_by(motion, a, scratch.c, s)
        q[i] = scratch.c[i] - off


@inlined
def distance(motion: Motion, q: Array, s: float, miss: Miss, rim: float) -> tuple[float, float]:
    """Bound the distance of the branch in a tube from joint values q at s; infinite if q is not in the tube.

    The second result is the distance that `rim` requires, in half widths of the tube.

    N moves q by M f and contracts the tube by the factor `drawn`, in half widths of the tube. A positive `rim` requires
    that all points within it of q are in the tube. For a redundant arm it also requires this of every solution that
    results if the hold is shifted by `rim`, because the next step may use another hold at the same pose.
    """
    tube, hold = motion.tube, motion.hold
    n = len(q)
    drawn = off = shifted = 0.0
    for i in range(n):
        drawn = max(drawn, (tube.reach[i] - tube.start[i]) / tube.half[i])
        moved = tube.point[i] * miss.point + tube.column[i] * miss.columns
        for a in range(hold.shape[0]):
            moved += abs(tube.across[i, a]) * (abs(across_by(motion, a, q, s)) + motion.margins.point)
        off = max(off, moved / tube.half[i])
        for a in range(hold.shape[0]):
            length = 0.0
            for j in range(n):
                length += abs(hold[a, j])
            moved += abs(tube.across[i, a]) * length * rim
        shifted = max(shifted, moved / tube.half[i])
    off, shifted = off / (1.0 - drawn), shifted / (1.0 - drawn)
    farthest = 0.0
    for i in range(n):
        away = abs(q[i] - middle_at(tube, i, s - tube.c[n]))
        if not clearly_inside(away + max(rim, shifted * tube.half[i]), tube.half[i], q[i]):
            return np.inf, shifted
        farthest = max(farthest, off * tube.half[i])
    return farthest, shifted


@inlined
def is_held(hold: Array, j: int) -> bool:
    """Return True if joint j by itself is one of the held directions."""
    for a in range(hold.shape[0]):
        others = 0.0
        for i in range(hold.shape[1]):
            others += abs(hold[a, i]) if i != j else 0.0
        if others == 0.0 and hold[a, j] != 0.0:
            return True
    return False


@inlined
def room_at(motion: Motion, limits: Limits, q: Array, shifted: float) -> tuple[bool, float]:
    """Return True if all points within `shifted` half widths of q are within the limits, and the largest of these widths.

    Of a redundant arm; else True and 0. At rest at a pose, it may have to move from the end of one step to the start of the
    next. A held joint moves between two values that are both within the limits.
    """
    inside, widest = True, 0.0
    for i in range(len(q) if motion.hold.shape[0] > 0 else 0):
        half = motion.tube.half[i]
        room = shifted * half
        fits = q[i] - room >= limits.lower[i] and q[i] + room <= limits.upper[i]
        inside, widest = inside and (fits or is_held(motion.hold, i)), max(widest, half)
    return inside, shifted * widest if widest > 0.0 else 0.0


@inlined
def place_of(motion: Motion, limits: Limits, h: float) -> int:
    """Classify the branch in a tube over |s - centre| ≤ h: INSIDE the limits, OUTSIDE at one end, or SOMEWHERE.

    A joint that is held to linear interpolation is exactly on it, and so within the limits if both ends are.
    """
    tube, place, lower, upper = motion.tube, INSIDE, limits.lower, limits.upper
    for i in range(len(lower)):
        if is_held(motion.hold, i):
            low, high = min(motion.begin[i], motion.end[i]), max(motion.begin[i], motion.end[i])
            place = place if low >= lower[i] and high <= upper[i] else SOMEWHERE
            continue
        slack = tube.away[i] + 4.0 * LEAST * (1.0 + abs(tube.c[i]))
        low, high = tube.c[i] - tube.wide[i] - slack, tube.c[i] + tube.wide[i] + slack
        if not (low >= lower[i] and high <= upper[i]):
            place = SOMEWHERE
    for i in range(len(lower)):
        slack = tube.away[i] + 4.0 * LEAST * (1.0 + abs(tube.c[i]))
        one, other = middle_at(tube, i, -h), middle_at(tube, i, h)
        if max(one, other) - slack > upper[i] or min(one, other) + slack < lower[i]:
            place = OUTSIDE
    return place


@inlined
def prove_step(motion: Motion, limits: Limits, rims: Array, keep: bool, within: Array) -> int:
    """Prove one step, tube after tube, and return the result; see `prove_steps` and, for a row of it, `Moves.rims`."""
    scratch, tube, n = motion.scratch, motion.tube, len(limits.lower)
    known, following = tube.known, tube.following
    middle = 2 + (len(motion.form.leader) - 2) // 2
    least = 4.0 * max(rims[0], rims[1])
    at_begin, at_end = miss_of(motion, motion.begin, 0.0), miss_of(motion, motion.end, 1.0)
    for i in range(n):
        known[i] = motion.begin[i]
    # At s the branch is within `radius` of the known joint values.
    s, part, radius, inside, outside = 0.0, 1.0, 0.0, True, False
    for _ in range(TUBES):
        part = min(part, 1.0 - s)
        if part < SHORTEST:
            break
        h = 0.5 * part
        for i in range(n):
            scratch.c[i] = known[i] + h / (1.0 - s) * (motion.end[i] - known[i])
        scratch.c[n] = s + h
        good, last = find_tube(motion, middle, h, least), s + part == 1.0
        if good and s == 0.0:
            within[0], shifted = distance(motion, known, 0.0, at_begin, rims[0])
            good = within[0] <= rims[0]
            fits, room = room_at(motion, limits, known, shifted)
            inside, within[0] = inside and fits, max(within[0], room)
        elif good:
            for i in range(n):
                off = abs(known[i] - middle_at(tube, i, -h)) + radius
                good = good and clearly_inside(off, tube.half[i], known[i])
        if good and last:
            within[1], shifted = distance(motion, motion.end, 1.0, at_end, rims[1])
            good = within[1] <= rims[1]
            fits, room = room_at(motion, limits, motion.end, shifted)
            inside, within[1] = inside and fits, max(within[1], room)
        elif good:
            for i in range(n):
                following[i] = middle_at(tube, i, h)
            correct(motion, following, s + part)
            miss = miss_of(motion, following, s + part)
            radius_there, _ = distance(motion, following, s + part, miss, 0.0)
            good = radius_there < np.inf
        if good:
            place = place_of(motion, limits, h)
            outside = outside or place == OUTSIDE
            if keep and outside:
                break
            if keep and place == SOMEWHERE:
                if part <= FINEST:
                    break
                good = False
            inside = inside and place == INSIDE
        if not good:
            part *= 0.5
            continue
        if last:
            if outside:
                return OUTSIDE
            return INSIDE if inside else SOMEWHERE
        for i in range(n):
            known[i] = following[i]
        radius = radius_there
        s += part
        part *= 2.0
    return LEAVES if outside else UNPROVED


@entry
def prove_steps(
    chain: ChainArrays,
    columns: int,
    moves: Moves,
    keep: bool,
    margins: Margins,
    state: Annotated[Indices, "steps", OUT],
    within: Annotated[Array, "steps", 2, OUT],
) -> None:
    """Prove for steps of a path that one branch leads from start to end while the hand moves straight.

    Args:
        chain: The arm; infinite limits for unlimited joints.
        columns: Number of columns of the hand that count: 3 for a pose, 1 for a direction, 0 for a position.
        moves: The steps.
        keep: True to stop as soon as the branch does not stay within the limits.
        margins: Allowances for rounding.
        state: Receives what is proved, see `UNPROVED`, (steps,).
        within: Receives upper bounds of the distances of the branch from start and end, (steps, 2).
    """
    begins, ends, hold = moves.begins, moves.ends, moves.hold
    if len(begins) == 0:
        return
    motion, limits = (
        make_motion(chain, columns, begins[0], hold[0], margins),
        Limits(chain.lower, chain.upper),
    )
    for i in range(len(begins)):
        state[i] = UNPROVED
        if not moves.asked[i]:
            continue
        for j in range(begins.shape[1]):
            motion.begin[j], motion.end[j] = begins[i, j], ends[i, j]
            for a in range(hold.shape[1]):
                motion.hold[a, j] = hold[i, a, j]
        lead(motion, chain, moves.targets[i], row(moves.slides, i), row(moves.turns, i))
        state[i] = prove_step(motion, limits, moves.rims[i], keep, within[i])
