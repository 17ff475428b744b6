"""What there is to ask of a hand: the kinds of goal, and all that a search has to know of each.

A search reads these numbers and never the name, so that a new kind is one line here, a way to make such goals in
`kinseek.goal`, and a judge where the ones of `kernels.arm` do not do.
"""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Kind:
    """What a kind of goal fixes of the pose."""

    name: str
    noun: str
    """For messages."""
    columns: int
    """Columns of the rotation that are compared: 3 of a pose, 1 (the tool axis, turned to x) of a direction, else 0."""
    constraints: int
    """Of the six ways in which a hand can move, those that the goal fixes."""
    turned: bool = False
    """Is the tip turned so that its tool axis becomes x, the one column that counts?"""
    ranges: bool = False
    """Are deviations measured against ranges? Then the columns say nothing."""

    @property
    def column_weight(self) -> float:
        """Weight of the square of each column's chord, |c - c_g|², that makes their sum the square of a small angle.

        A turn moves two of three columns, and one that is compared alone as far as the angle itself.
        """
        return 0.5 if self.columns == 3 else 1.0

    @property
    def longest_chord(self) -> float:
        """Length of all columns' chords together at half a turn: |R - R_g| = 2√2 sin φ/2, |x - x_g| = 2 sin φ/2."""
        return 2.0 * math.sqrt(2.0) if self.columns == 3 else 2.0


POSE = Kind("pose", "a whole pose", columns=3, constraints=6)
POINTING = Kind("pointing", "a direction", columns=1, constraints=5, turned=True)
POSITION = Kind("position", "a position", columns=0, constraints=3)
BOX = Kind("box", "a goal with free axes or ranges", columns=3, constraints=6, ranges=True)

KINDS: dict[str, Kind] = {kind.name: kind for kind in (POSE, POINTING, POSITION, BOX)}
PLAIN_KINDS = tuple(kind for kind in KINDS.values() if not kind.ranges)
"""Kinds that every search takes."""
