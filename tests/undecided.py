"""What NaN leads to in kernels that compute a bound or a verdict: to none. ``python tests/undecided.py`` prints what fails.

Each check gives NaN where the shell would have refused it, and returns what was claimed all the same.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

import kinseek
from kinseek import Goal, Problem
from kinseek.kernels.maps.many_gates import many_gates
from kinseek.kernels.paths.motion import Margins
from kinseek.kernels.paths.steps import UNPROVED, Moves, prove_steps
from kinseek.kernels.proof.gate import least_by_gate
from kinseek.kernels.proof.infeasibility import OFTEN, STEPS
from kinseek.kernels.proof.memory import Heap, Places
from kinseek.kernels.proof.progress import (
    CEILING,
    COUNT,
    COUNTS,
    FIGURES,
    FLOOR,
    LEFT,
    UPPER,
    USED,
)
from kinseek.kernels.proof.root_isolation import MOST
from kinseek.kernels.proof.shoulder import enclose_ball
from kinseek.proof.boxes import Run, Watch, tuning_of
from kinseek.proof.reduce import error_question, question, question_without_last, start_boxes
from kinseek.proof.shoulder import shoulder_of

Array = NDArray[np.float64]

BOXES = 30


def spoilt(arrays: Array, at: tuple[int, ...]) -> Array:
    """A copy with NaN at a place."""
    other = arrays.copy()
    other[at] = np.nan
    return other


def spoilt_questions(asked: Any) -> Iterator[tuple[str, Any]]:
    """A question with NaN in one of its numbers."""
    form, wanted, roll = asked
    for at in ((0, 3), (2, 3), (1, 0)):
        yield f"target {at}", (form, wanted._replace(target=spoilt(wanted.target, at)), roll)
    for place in ((1, 0, 3), (len(form.fixed) - 1, 2, 3), (1, 0, 0)):
        yield f"fixed {place}", (form._replace(fixed=spoilt(form.fixed, place)), wanted, roll)
    yield "offset", (form._replace(offset=spoilt(form.offset, (-1,))), wanted, roll)
    if roll.present:
        yield "limit", (form, wanted, roll._replace(upper=np.nan))
    yield "margin", (form, wanted._replace(margin=np.nan), roll)
    yield "margin_a", (form, wanted._replace(margin_a=np.nan), roll)


def reached(name: str) -> Problem:
    """A goal that is reached: whatever is claimed of it, beside that, is false."""
    arm = kinseek.load(name)
    return Problem(arm.chain, Goal.pose(arm.fk(np.full(arm.dof, 0.3))))


def excluding() -> Iterator[str]:
    for name in ("planar2", "ur5e"):
        problem = reached(name)
        asked = question(problem)
        boxes = start_boxes(problem.chain, asked[2].present)
        spoilt_boxes = spoilt(boxes, (0, boxes.shape[1] // 2 - 1))
        tries = [(what, other, boxes) for what, other in spoilt_questions(asked)]
        for what, other, begin in [*tries, ("a box", asked, spoilt_boxes)]:
            run = Run(problem, other, begin, np.zeros(problem.chain.dof), tuning_of(problem, OFTEN, 0))
            run.go(BOXES, Watch())
            if run.counts[COUNT] + run.counts[LEFT] == 0:
                yield f"{name}, {what}: excluded"


def isolating() -> Iterator[str]:
    arm = kinseek.load("ur5e")
    q = np.array([0.3, -1.0, 1.2, 0.4, 0.8, 0.1])
    problem = Problem(arm.chain, Goal.pose(arm.fk(q)))
    asked = question(problem)
    boxes = start_boxes(problem.chain, asked[2].present)
    dof, most = boxes.shape[1] // 2, MOST + 1
    for what, other in spoilt_questions(asked):
        places = Places(
            q[None],
            arm.chain.periodic[:dof].copy(),
            np.zeros(most, dtype=np.bool_),
            np.zeros(most, dtype=np.int64),
            np.zeros((most, 6)),
            np.zeros((most, dof)),
            np.zeros((most, dof)),
            np.zeros((most, dof)),
            np.zeros(most, dtype=np.bool_),
        )
        run = Run(problem, other, boxes, np.zeros(6), tuning_of(problem, OFTEN, STEPS), places=places)
        run.go(BOXES, Watch())
        if run.counts[COUNT] + run.counts[LEFT] == 0:
            yield f"{what}: complete"
        if what != "limit" and (places.isolated.any() or places.exists.any()):  # It has no part in that.
            yield f"{what}: a neighbourhood"
    spoilt_boxes = spoilt(boxes, (0, 0))
    places = places._replace(isolated=np.ones(most, dtype=np.bool_), radius=np.full((most, dof), 0.5))
    run = Run(problem, asked, spoilt_boxes, np.zeros(6), tuning_of(problem, OFTEN, STEPS), places=places)
    run.counts[5], run.counts[6] = (
        1,
        1,
    )  # One answer, whose neighbourhood must not hold a box that is nowhere.
    run.go(BOXES, Watch())
    if run.counts[COUNT] + run.counts[LEFT] == 0:
        yield "a box that is nowhere is in a neighbourhood"


def enclosing() -> Iterator[str]:
    for name in ("planar2", "ur5e"):
        problem = reached(name)
        q = np.full(problem.chain.dof, -0.2)
        for what, asked in spoilt_questions(error_question(problem, q, 0.1)):
            heap = Heap(np.zeros(1), np.zeros(1, dtype=np.int64))
            boxes = start_boxes(problem.chain, asked[2].present)
            run = Run(problem, asked, boxes, q.copy(), tuning_of(problem, OFTEN, 0, 0.1), heap)
            run.go(BOXES, Watch())
            if run.counts[COUNT] + run.counts[LEFT] == 0:
                yield f"{name}, {what}: all boxes are gone"


def gates() -> Iterator[str]:
    for name in ("planar2", "ur5e"):
        problem = reached(name)
        for what, (form, wanted, _) in spoilt_questions(question(problem)):
            if least_by_gate(form, wanted, problem.arrays) > 0.0:
                yield f"{name}, {what}: a bound"
            target, closed, still = wanted.target.copy(), np.zeros(1), np.eye(4)[:3].copy()
            same = wanted._replace(target=target)
            many_gates(form, same, problem.arrays, still, still, wanted.target[None].copy(), target, closed)
            if closed[0]:
                yield f"{name}, {what}: a gate is shut"


def ball() -> Iterator[str]:
    arm = kinseek.load("panda")
    problem = Problem(arm.chain, Goal.pose(arm.fk(np.array([0.3, 0.3, 0.3, -1.0, 0.3, 1.0, 0.3]))))
    found = shoulder_of(problem, *question_without_last(problem))
    assert found is not None
    shoulder, first = found
    count = round(np.log(shoulder.invariants.shape[1]) / np.log(3))
    start = start_boxes(arm.chain, False)[0].reshape(2, -1)
    for what, other in (
        ("invariants", shoulder._replace(invariants=spoilt(shoulder.invariants, (0, 5)))),
        ("goal", shoulder._replace(goal=spoilt(shoulder.goal, (0, 0)), plane=spoilt(shoulder.plane, (0, 0)))),
        ("margin", shoulder._replace(margin=np.nan)),
    ):
        boxes = np.zeros((256, 2 * count + 6))
        boxes[0, : 2 * count] = start[:, first : first + count].ravel()
        heap = Heap(np.zeros(256), np.zeros(256, dtype=np.int64))
        counts, figures = np.zeros(COUNTS, dtype=np.int64), np.zeros(FIGURES)
        counts[COUNT] = counts[USED] = 1
        figures[UPPER], figures[CEILING] = np.inf, 0.1
        enclose_ball(other, boxes, heap, counts, figures, BOXES)
        if figures[FLOOR] > 0.0:
            yield f"{what}: the error is at least {figures[FLOOR]:g}"


def steps() -> Iterator[str]:
    arm = kinseek.load("ur5e")
    q = np.array([[0.3, -1.0, 1.2, 0.4, 0.8, 0.1], [0.301, -1.0, 1.2, 0.4, 0.8, 0.1]])
    T = arm.fk(q)[:, :3].copy()
    margins = Margins(1.0, 1e-12, 1e-12)
    arrays = Problem(arm.chain, Goal.pose(arm.fk(q[0]))).arrays
    for what, at in (("target", 0), ("slide", 1), ("turn", 2), ("begin", 3), ("end", 4), ("nothing", -1)):
        given: list[Any] = [
            T[:1].copy(),
            (T[1:] - T[:1])[:, :, 3].copy(),
            np.zeros((1, 3)),
            q[:1].copy(),
            q[1:].copy(),
        ]
        turn = T[1, :, :3] @ T[0, :, :3].T
        given[2][0] = 0.5 * np.array(
            [turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]
        )
        if at >= 0:
            given[at].reshape(-1)[-1] = np.nan
        state, within = np.zeros(1, dtype=np.int64), np.zeros((1, 2))
        room = np.full((1, 2), 1e-3)
        hold = np.zeros((1, 0, 6))
        moves = Moves(*(*given, hold, room, np.ones(1, dtype=np.bool_)))
        prove_steps(arrays, 3, moves, False, margins, state, within)
        if (state[0] == UNPROVED) != (at >= 0):
            yield f"{what}: {state[0]}"


CHECKS: dict[str, Callable[[], Iterator[str]]] = {
    each.__name__: each for each in (excluding, isolating, enclosing, gates, ball, steps)
}

if __name__ == "__main__":
    wrong = [f"{name}: {claim}" for name, check in CHECKS.items() for claim in check()]
    print("\n".join(wrong))
    sys.exit(bool(wrong))
