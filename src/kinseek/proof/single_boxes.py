"""Test single boxes as the searches do, without the search around them: for tests and pictures."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinseek.kernels.arm.division import TURN
from kinseek.kernels.arrays import Array
from kinseek.kernels.proof.box import Form, ProofGoal
from kinseek.kernels.proof.last_joint import LastJoint
from kinseek.kernels.proof.memory import Memory
from kinseek.kernels.proof.progress import (
    CEILING,
    COUNT,
    COUNTS,
    ENCLOSE,
    FIGURES,
    FLOOR,
    ISOLATE,
    LEFT,
    UPPER,
    USED,
    Question,
)
from kinseek.kernels.proof.search import search_boxes
from kinseek.problem import Problem

from .boxes import PASSES, heap_for, no_places, tuning_of


class Examined(NamedTuple):
    """Result of one test for each box."""

    left: Array
    """Halves of the remaining part, (k, 2, 2 dof): NaN if nothing remains; the same box twice if it is too narrow to be
    cut."""
    lower: Array
    """Lower bound of the weighted error in it, (k,); 0 if the tolerances decide."""


def examine(
    problem: Problem,
    reduction: tuple[Form, ProofGoal, LastJoint],
    boxes: Array,
    ceiling: float | None = None,
    passes: int = PASSES,
) -> Examined:
    """Test boxes one by one, as the search for all solutions or for the least weighted error does.

    Args:
        problem: One target.
        reduction: Its question in the form of the kernels, see `question` and `error_question`.
        boxes: Centres and half widths, (k, 2 dof).
        ceiling: Weighted error to stay below; None: the tolerances decide.
        passes: Forms tried to second order; 0 tests to first order only.
    """
    dof, n = boxes.shape[1] // 2, problem.chain.dof
    room, counts, figures = np.zeros((3, 2 * dof)), np.zeros(COUNTS, dtype=np.int64), np.zeros(FIGURES)
    heap, question = heap_for(3), Question(*reduction, problem.arrays, problem.goal.arrays)
    memory = Memory(room, heap, no_places(n, dof), np.zeros(n), counts, figures)
    tuning = tuning_of(problem, 1, 0)._replace(
        second_order=np.inf if passes else 0.0, shrink=0.0, passes=passes
    )
    left, lower = np.full((len(boxes), 2, 2 * dof), np.nan), np.zeros(len(boxes))
    for k, box in enumerate(boxes):
        room[0] = box
        counts[:], heap.bound[:], heap.order[:] = 0, 0.0, 0
        counts[COUNT] = counts[USED] = 1  # The heap begins without the whole arm.
        if ceiling is None:
            search_boxes(ISOLATE, question, tuning, memory, 1, 1)
        else:
            # No pose lowers the ceiling.
            figures[UPPER], figures[CEILING], figures[FLOOR] = 0.0, ceiling, np.inf
            search_boxes(ENCLOSE, question, tuning, memory, 1, 1)
            lower[k] = figures[FLOOR] if counts[LEFT] else heap.bound[0]
        if counts[LEFT]:
            left[k] = box
        elif counts[COUNT]:
            left[k] = room[:2]
    return Examined(left, lower)


def holds(form: Form, left: Array, q: Array, slack: float | Array = 0.0) -> NDArray[np.bool_]:
    """Return whether a joint vector is in the remaining part of each box, modulo whole turns of divided-out joints.

    Args:
        form: The part of the arm that the boxes refer to.
        left: See `Examined`, (k, 2, 2 dof).
        q: Joint values inside each box, (dof,) or (k, dof).
        slack: How far outside counts as inside [rad] or [m], a number or (dof,).

    Returns:
        Flags, (k,).
    """
    dof = q.shape[-1]
    away, half = (q[:, None] if q.ndim > 1 else q) - left[..., :dof], left[..., dof:]
    for i in [0] * (form.head == TURN) + [-1] * (form.tail == 1):
        beyond = np.abs(away[..., i]) > half[..., i] + 1e-9
        away[..., i] -= np.where(beyond, np.round(away[..., i] / math.tau) * math.tau, 0.0)
    inside = np.abs(away) <= half + slack
    first, second = (inside[:, side].all(axis=1) for side in (0, 1))
    return np.asarray(first | second)
