"""The kinds of goal, and what a search needs to know of each.

A search reads these numbers and never the name. A new kind therefore needs one line here, a constructor in `kinseek.goal`,
and an error function if those of `kernels.arm` do not fit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Kind:
    """The part of the pose that a kind of goal constrains."""

    name: str
    noun: str
    """Its name in messages."""
    columns: int
    """Number of compared columns of the rotation: 3 for a pose, 1 (the tool axis, mapped to x) for a direction, else 0."""
    constraints: int
    """Number of the six degrees of freedom of the tip that the goal constrains."""
    turned: bool = False
    """Is the tip rotated so that its tool axis becomes x, the one column that is compared?"""
    ranges: bool = False
    """Are deviations measured against ranges? Then `columns` has no meaning."""

    @property
    def column_weight(self) -> float:
        """Weight of each column's squared chord, |c - c_g|², with which their sum is the square of a small rotation angle.

        A rotation about one column moves the other two. A column that is compared alone moves by the angle itself.
        """
        return 0.5 if self.columns == 3 else 1.0

    @property
    def longest_chord(self) -> float:
        """Norm of all columns' chords at half a turn: |R - R_g| = 2√2 sin φ/2, |x - x_g| = 2 sin φ/2."""
        return 2.0 * math.sqrt(2.0) if self.columns == 3 else 2.0


POSE = Kind("pose", "a whole pose", columns=3, constraints=6)
POINTING = Kind("pointing", "a direction", columns=1, constraints=5, turned=True)
POSITION = Kind("position", "a position", columns=0, constraints=3)
BOX = Kind("box", "a goal with free axes or ranges", columns=3, constraints=6, ranges=True)

KINDS: dict[str, Kind] = {kind.name: kind for kind in (POSE, POINTING, POSITION, BOX)}
PLAIN_KINDS = tuple(kind for kind in KINDS.values() if not kind.ranges)
"""Kinds that every search supports."""
