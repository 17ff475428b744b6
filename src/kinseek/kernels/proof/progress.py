"""What a search by boxes is asked and told, and what it counts."""

from __future__ import annotations

from typing import NamedTuple

from kinseek.kernels.arrays import CHAIN, GOAL, ChainArrays, GoalArrays
from kinseek.kernels.entry import F64, I64, Bundle

from .box import FORM, PROOF_GOAL, Form, ProofGoal
from .last_joint import ROLL, LastJoint

EXCLUDE, ENCLOSE, ISOLATE = 0, 1, 2
"""What is asked of boxes: one answer, or that there is none; the least weighted error; all answers."""

ENDED, FOUND, STOPPED, FULL = 0, 1, 2, 3
"""No box is left; an answer was found; as many boxes as were asked for have been examined; there is no room for more."""

TRIAL = 4
"""Inside the loop: here are joint values to be judged."""

GONE, AGAIN, OPEN = 0, 1, 2
"""What a look at a box says: nothing in it counts; it shrank so much that it is worth another look; it has to be cut."""

# What a search counts.
COUNT = 0
"""Boxes that are left."""
SEEN = 1
"""Boxes examined."""
KEPT = 2
"""Boxes cut in half."""
USED = 3
"""Rows that have held a box, where the best box comes first: those of boxes that are done are taken again."""
LEFT = 4
"""Boxes given up: too narrow to be cut, or passed over near an answer without a neighbourhood."""
GIVEN = 5
"""Answers given that have been looked at."""
KNOWN = 6
"""Answers that are no others' neighbours."""
COUNTS = 7
"""So many counts."""

# What a search knows.
UPPER = 0
"""Weighted error of the best joint values seen."""
CEILING = 1
"""What the bound of a box must stay below to count, where the best box comes first."""
STUCK = 2
"""Widest box that was given up as too narrow, [rad] or [m]."""
FLOOR = 3
"""Least bound of the boxes given up as too narrow."""
FIGURES = 4
"""So many figures."""


class Question(NamedTuple):
    """What is asked, of which arm."""

    form: Form
    """The part of the arm that the boxes are about."""
    proof_goal: ProofGoal
    """What is asked of it."""
    roll: LastJoint
    """The last joint, where it is divided out."""
    chain: ChainArrays
    """The whole arm, to judge joint values by plain forward kinematics."""
    goal: GoalArrays
    """The goal as it was asked."""


QUESTION = Bundle(Question, form=FORM, proof_goal=PROOF_GOAL, roll=ROLL, chain=CHAIN, goal=GOAL)


class Tuning(NamedTuple):
    """How hard a search tries, and how near is near enough."""

    spread: float
    """Boxes that turn the hand by less [rad] are looked at to second order."""
    shrink: float
    """Those that this leaves less of than such a part of their volume are looked at again."""
    passes: int
    """Forms tried on each of them, where the tolerances decide."""
    often: int
    """Every so many boxes that are cut, steps from the middle of one look for an answer."""
    steps: int
    """So many."""
    position: float
    """Tolerance of the tip [m]."""
    orientation: float
    """Tolerance of the hand's turn [rad]."""
    gap: float
    """Bounds are close enough where they differ by this part of the upper one."""


TUNING = Bundle(
    Tuning,
    spread=F64,
    shrink=F64,
    passes=I64,
    often=I64,
    steps=I64,
    position=F64,
    orientation=F64,
    gap=F64,
)
