"""A solution for every pose of a ball: a tube that exists wherever its goal is moved, see `tube`.

Let g be the displacement of the goal's point and columns to first order. Let e be the remainder, in the columns alone:
``|e| ≤ θ²/√2`` for a rotation by θ. Around a solution c for the centre of the ball write x = c + t + δ with t = M g. Then
N(δ) = δ - M f(x) satisfies, with v ≥ |t|,

    |N(0)| ≤ a = |M f(c)| + |1 - MJ| v + ½ |M H| v v + |M| (rest(v) + |e|),

and its derivative is bounded as in `tube`. If κ = a + C ρ < ρ, there is exactly one solution in |δ| ≤ ρ for every g.
"""

from __future__ import annotations

import math
from typing import Annotated

from kinseek.kernels.arm.vectors import Vector
from kinseek.kernels.arrays import Array, ChainArrays, Flags
from kinseek.kernels.entry import OUT
from kinseek.kernels.jit import entry, inlined

from .motion import Margins, Motion, lead, make_motion
from .tube import TURNED, aim_at_solution, expand, inflate, remainders

GOAL = 2
"""The hand and its goal are compared distal to the two joints at rest, so no joint moves the goal, and neither does t."""


@inlined
def begin_around(motion: Motion, middle: int, position: float, angle: float) -> None:
    """Write v and a for goals that are moved by at most `position` [m] and rotated by at most `angle` [rad]."""
    tube, n = motion.tube, len(motion.tube.half)
    for i in range(n):
        tube.wide[i] = tube.point[i] * position + tube.column[i] * math.sqrt(2.0) * angle
    tube.wide[n] = 0.0
    three_p, three_c = remainders(motion, middle)
    three_c += math.sqrt(0.5) * angle * angle
    for row in range(n):
        total = abs(tube.value[row]) + tube.point[row] * three_p + tube.column[row] * three_c
        for i in range(n):
            part = abs(tube.slope[row, i] - (1.0 if i == row else 0.0))
            for j in range(n):
                part += 0.5 * abs(tube.bend[row, i, j]) * tube.wide[j]
            total += part * tube.wide[i]
        for a in range(motion.hold.shape[0]):
            total += abs(tube.across[row, a]) * motion.margins.point
        tube.start[row] = total


@entry
def answers_around(
    chain: ChainArrays,
    targets: Annotated[Array, "k", 3, 4],
    q: Annotated[Array, "k", "n"],
    hold: Annotated[Array, "k", "*", "n"],
    position: Annotated[Array, "k"],
    orientation: Annotated[Array, "k"],
    margins: Margins,
    held: Annotated[Flags, "k", OUT],
) -> None:
    """Check whether every pose of a ball has a solution within the limits, near a solution for the ball's centre.

    Args:
        chain: The arm; infinite limits for unlimited joints.
        targets: Centres of the balls, (k, 3, 4), lengths in [m].
        q: A solution for each centre, (k, n), [rad] or [m].
        hold: For redundant arms, orthonormal directions in which the joints are held, (k, redundant, n).
        position: Radii of the balls, (k,), [m].
        orientation: Largest rotation of poses in each ball, (k,), [rad].
        margins: Allowances for rounding.
        held: Receives True if all poses of a ball have solutions, (k,).
    """
    if len(q) == 0:
        return
    n, still = len(chain.lower), Vector(0.0, 0.0, 0.0)
    motion = make_motion(chain, 3, q[0], hold[0], margins)
    tube, middle = motion.tube, GOAL
    for i in range(len(q)):
        for j in range(n):
            motion.begin[j] = motion.end[j] = motion.scratch.c[j] = q[i, j]
            for a in range(hold.shape[1]):
                motion.hold[a, j] = hold[i, a, j]
        motion.scratch.c[n] = 0.0
        lead(motion, chain, targets[i], still, still)
        # A goal that is rotated farther may be half a turn from the hand.
        good = orientation[i] < TURNED and aim_at_solution(motion)
        if good:
            expand(motion, middle)
            begin_around(motion, middle, position[i], orientation[i])
            good = inflate(motion, middle, 0.0)
        for j in range(n):
            away = tube.wide[j] + tube.away[j]
            good = good and chain.lower[j] < tube.c[j] - away and tube.c[j] + away < chain.upper[j]
        held[i] = good
