"""Requests, results and counts of a search by boxes."""

from __future__ import annotations

from typing import NamedTuple

from kinseek.kernels.arrays import ChainArrays, GoalArrays

from .box import Form, ProofGoal
from .last_joint import LastJoint

EXCLUDE, ENCLOSE, ISOLATE = 0, 1, 2
"""Kinds of search: for one solution or a proof that there is none; for the smallest weighted error; for all solutions."""

ENDED, FOUND, STOPPED, FULL = 0, 1, 2, 3
"""Results: no box is left; a solution was found; the requested number of boxes has been examined; there is no room for
more."""

TRIAL = 4
"""Inside the loop: joint values are ready to be judged."""

GONE, AGAIN, OPEN = 0, 1, 2
"""Verdicts on a box: nothing in it counts; it shrank so much that it has to be examined again; it has to be cut."""

# Indices into the counts of a search.
COUNT = 0
"""Boxes that are left."""
SEEN = 1
"""Boxes examined."""
KEPT = 2
"""Boxes cut in half."""
USED = 3
"""Rows that have held a box, if the best box comes first; rows of finished boxes are reused."""
LEFT = 4
"""Boxes given up: too narrow to be cut, or skipped near a solution without a neighbourhood."""
GIVEN = 5
"""Given solutions that have been examined."""
KNOWN = 6
"""Solutions that are not in the neighbourhood of another."""
COUNTS = 7
"""Number of counts."""

# Indices into the figures of a search.
UPPER = 0
"""Weighted error of the best joint values found."""
CEILING = 1
"""Upper limit of the bound of relevant boxes, if the best box comes first."""
STUCK = 2
"""Widest box that was given up as too narrow, [rad] or [m]."""
FLOOR = 3
"""Smallest bound of the boxes given up as too narrow."""
FIGURES = 4
"""Number of figures."""


class Question(NamedTuple):
    """The goal and the arm of a search."""

    form: Form
    """The part of the arm that the boxes describe."""
    proof_goal: ProofGoal
    """The goal of the hand."""
    roll: LastJoint
    """The last joint, if it is divided out."""
    chain: ChainArrays
    """The whole arm, to judge joint values by plain forward kinematics."""
    goal: GoalArrays
    """The goal as the user gave it."""


class Tuning(NamedTuple):
    """Effort and precision of a search."""

    second_order: float
    """Boxes that rotate the hand by less than this [rad] are tested to second order."""
    shrink: float
    """A box is examined again if less than this fraction of its volume is left."""
    passes: int
    """Number of forms tried on each of them, if the tolerances are tested."""
    often: int
    """After this number of cut boxes, steps from the middle of one look for a solution."""
    steps: int
    """Number of these steps."""
    position: float
    """Tolerance of the tip [m]."""
    orientation: float
    """Tolerance of the hand's rotation [rad]."""
    gap: float
    """Relative difference of the bounds at which they are close enough."""


class Call(NamedTuple):
    """Extent of one call of the search."""

    kind: int
    """EXCLUDE, ENCLOSE or ISOLATE."""
    until: int
    """Number of boxes after which it ends."""
    budget: int
    """Largest number of boxes in total."""
