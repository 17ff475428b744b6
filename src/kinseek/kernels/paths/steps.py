"""Proof that one unbroken branch leads from pose to pose within the limits, by consecutive tubes along each step."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np

from kinseek.kernels.arrays import Array, ChainArrays, Flags, Indices
from kinseek.kernels.entry import OUT
from kinseek.kernels.jit import entry, inlined
from kinseek.kernels.proof.box import LEAST
from kinseek.kernels.proof.box import place as place_arm

from .motion import COUNT, MARGIN, MARGIN_A, Motion, across_by, lead, make_motion
from .tube import find_tube, middle_at

UNPROVED, INSIDE, SOMEWHERE, OUTSIDE, LEAVES = range(5)
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


@inlined
def clearly_inside(off: float, half: float, value: float) -> bool:
    """Return True if `off` is within half the width of a tube, despite rounding of joint values as large as `value`."""
    return off <= half * (1.0 - WITHIN) - 4.0 * LEAST * (1.0 + abs(value))


@inlined
def misses(motion: Motion, q: Array, s: float) -> tuple[float, float]:
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
    return math.sqrt(point) + motion.numbers[MARGIN], math.sqrt(column) + motion.numbers[MARGIN_A]


@inlined
def correct(motion: Motion, q: Array, s: float) -> None:
    """Move joint values in the tube nearer to its branch by a Newton step with the tube's M."""
    scratch, tube, hold = motion.scratch, motion.tube, motion.hold
    n = len(q)
    misses(motion, q, s)
    for i in range(n):
        off = 0.0
        for r in range(3):
            for c in range(4):
                off += tube.rows[i, r, c] * (scratch.T[r, c] - scratch.goal[r, c])
        for a in range(hold.shape[0]):
            off += tube.across[i, a] * across_by(motion, a, scratch.c, s)
        q[i] = scratch.c[i] - off


@inlined
def distance(
    motion: Motion, q: Array, s: float, miss_point: float, miss_column: float, rim: float
) -> tuple[float, float]:
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
        moved = tube.point[i] * miss_point + tube.column[i] * miss_column
        for a in range(hold.shape[0]):
            moved += abs(tube.across[i, a]) * (abs(across_by(motion, a, q, s)) + motion.numbers[MARGIN])
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
def room_at(motion: Motion, q: Array, shifted: float, lower: Array, upper: Array) -> bool:
    """Return True if all points within `shifted` half widths of q are within the limits, for a redundant arm.

    At rest at a pose, the arm may have to move from the end of one step to the start of the next. A held joint moves
    between two values that are both within the limits.
    """
    if motion.hold.shape[0] == 0:
        return True
    for i in range(len(q)):
        room = shifted * motion.tube.half[i]
        if not is_held(motion.hold, i) and not (q[i] - room >= lower[i] and q[i] + room <= upper[i]):
            return False
    return True


@inlined
def room_between(motion: Motion, shifted: float) -> float:
    """Largest extent of `shifted` half widths of the tube for a redundant arm, else 0."""
    widest = 0.0
    for i in range(len(motion.tube.half)):
        widest = max(widest, motion.tube.half[i])
    return shifted * widest if motion.hold.shape[0] > 0 else 0.0


@inlined
def place_of(motion: Motion, h: float, lower: Array, upper: Array) -> int:
    """Classify the branch in a tube over |s - centre| ≤ h: INSIDE the limits, OUTSIDE at one end, or SOMEWHERE.

    A joint that is held to linear interpolation is exactly on it, and so within the limits if both ends are.
    """
    tube, place = motion.tube, INSIDE
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
def prove_step(
    motion: Motion,
    lower: Array,
    upper: Array,
    rim_begin: float,
    rim_end: float,
    keep: bool,
    known: Array,
    reached: Array,
    within: Array,
) -> int:
    """Prove one step, tube after tube, and return the result; see `prove_steps`."""
    scratch, tube, n = motion.scratch, motion.tube, len(lower)
    middle = 2 + (len(motion.form.leader) - 2) // 2
    least = 4.0 * max(rim_begin, rim_end)
    begin_point, begin_column = misses(motion, motion.begin, 0.0)
    end_point, end_column = misses(motion, motion.end, 1.0)
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
            within[0], shifted = distance(motion, known, 0.0, begin_point, begin_column, rim_begin)
            good = within[0] <= rim_begin
            inside = inside and room_at(motion, known, shifted, lower, upper)
            within[0] = max(within[0], room_between(motion, shifted))
        elif good:
            for i in range(n):
                off = abs(known[i] - middle_at(tube, i, -h)) + radius
                good = good and clearly_inside(off, tube.half[i], known[i])
        if good and last:
            within[1], shifted = distance(motion, motion.end, 1.0, end_point, end_column, rim_end)
            good = within[1] <= rim_end
            inside = inside and room_at(motion, motion.end, shifted, lower, upper)
            within[1] = max(within[1], room_between(motion, shifted))
        elif good:
            for i in range(n):
                reached[i] = middle_at(tube, i, h)
            correct(motion, reached, s + part)
            point, column = misses(motion, reached, s + part)
            radius_there, _ = distance(motion, reached, s + part, point, column, 0.0)
            good = radius_there < np.inf
        if good:
            place = place_of(motion, h, lower, upper)
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
            known[i] = reached[i]
        radius = radius_there
        s += part
        part *= 2.0
    return LEAVES if outside else UNPROVED


@entry
def prove_steps(
    chain: ChainArrays,
    columns: int,
    targets: Annotated[Array, "steps", 3, 4],
    slides: Annotated[Array, "steps", 3],
    turns: Annotated[Array, "steps", 3],
    begins: Annotated[Array, "steps", "n"],
    ends: Annotated[Array, "steps", "n"],
    hold: Annotated[Array, "steps", "*", "n"],
    rims: Annotated[Array, "steps", 2],
    asked: Annotated[Flags, "steps"],
    keep: bool,
    numbers: Annotated[Array, COUNT],
    state: Annotated[Indices, "steps", OUT],
    within: Annotated[Array, "steps", 2, OUT],
) -> None:
    """Prove for steps of a path that one branch leads from start to end while the hand moves straight.

    Args:
        chain: The arm; infinite limits for unlimited joints.
        columns: Number of columns of the hand that count: 3 for a pose, 1 for a direction, 0 for a position.
        targets: Poses of the hand at the start of each step, (steps, 3, 4), lengths in [m].
        slides: Translation of the hand, (steps, 3), [m].
        turns: Rotation vector of the hand in the base, (steps, 3), [rad].
        begins: Joint values that reach the targets, (steps, n), [rad] or [m].
        ends: Joint values that reach the pose at the end, (steps, n).
        hold: For redundant arms, orthonormal directions that are held to linear interpolation, (steps, k, n).
        rims: Largest distance of the branch from start and end, (steps, 2), [rad] or [m].
        asked: True for the steps to prove, (steps,).
        keep: True to stop as soon as the branch does not stay within the limits.
        numbers: See `motion.LENGTH`.
        state: Receives what is proved, see `UNPROVED`, (steps,).
        within: Receives upper bounds of the distances of the branch from start and end, (steps, 2).
    """
    if len(begins) == 0:
        return
    n = len(chain.lower)
    motion = make_motion(chain, columns, begins[0], hold[0], numbers)
    known, reached = np.empty(n), np.empty(n)
    for i in range(len(begins)):
        state[i] = UNPROVED
        if not asked[i]:
            continue
        for j in range(n):
            motion.begin[j], motion.end[j] = begins[i, j], ends[i, j]
            for a in range(hold.shape[1]):
                motion.hold[a, j] = hold[i, a, j]
        lead(motion, chain, targets[i], slides[i], turns[i])
        state[i] = prove_step(
            motion, chain.lower, chain.upper, rims[i, 0], rims[i, 1], keep, known, reached, within[i]
        )
