"""The one loop of all searches by boxes: take a box, bound and cut it, halve it, look for an answer in it.

Three searches run it: `exclusion` asks whether a goal can be reached, `isolation` whether it has further answers, and
`enclosure` how near the arm can come. They differ in what the loop is given. With a `Heap` the box with the least bound
comes first and is judged by the weighted error; without one the last box comes first and is judged by the tolerances. With
`Places` every answer gets a neighbourhood, and boxes inside of one need no further look. What is None is left out when the
loop is compiled, once for each of the three entries below. (A function as an argument would do the same, but its machine
code is never found on disk again.)

All memory is the caller's: a kernel that hands a bundle of arrays to Python has Python build it, and where that is
interrupted there is nothing to hand back.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from kinseek.kernels.arm.forward import forward
from kinseek.kernels.arm.pose_error import errors, weighted_error
from kinseek.kernels.arrays import CHAIN, GOAL, Array, ChainArrays, GoalArrays, Indices
from kinseek.kernels.entry import F64, I64
from kinseek.kernels.jit import entry, hidden, spliced

from .approach import approach
from .box import (
    FORM,
    HEAD,
    MISS_COLUMNS,
    MISS_POINT,
    NARROW,
    NEAR,
    WANTED,
    Desk,
    Form,
    Wanted,
    halve,
    load_box,
    make_desk,
    store_box,
    widest,
)
from .enclosure import FINE, HEAP, Heap, bound_box, sift_down, sift_up, start_heap
from .exclusion import exclude_box
from .gate import gate
from .isolation import PLACES, Places, admit, inside
from .last_joint import ROLL, Roll
from .neighbourhood import make_expansion
from .progress import (
    AGAIN,
    CEILING,
    COUNT,
    COUNTS,
    ENDED,
    FIGURES,
    FLOOR,
    FOUND,
    FULL,
    GIVEN,
    GONE,
    KEPT,
    KNOWN,
    LEFT,
    SEEN,
    STOPPED,
    STUCK,
    TRIAL,
    TUNING,
    UPPER,
    USED,
    Tuning,
)


@spliced
def search_boxes(
    form: Form,
    wanted: Wanted,
    roll: Roll,
    chain: ChainArrays,
    goal: GoalArrays,
    boxes: Array,
    heap: Heap | None,
    places: Places | None,
    q: Array,
    tuning: Tuning,
    counts: Indices,
    figures: Array,
    until: int,
    budget: int,
) -> int:
    """Go through boxes of joint values until none is left, or until something makes it come back.

    It may be called again to go on where it stopped, and finds the same as if it had not stopped.

    Args:
        form: The part of the arm that the boxes are about.
        wanted: What is asked of it.
        roll: The last joint, where it is divided out.
        chain: The whole arm, to judge joint values by plain forward kinematics.
        goal: The goal as it was asked.
        boxes: The boxes that are left, (room, 2 dof): centres and half widths.
        heap: Their order and bounds, to enclose the least weighted error; it begins with the first COUNT rows.
        places: Answers and their neighbourhoods, to find all of them.
        q: The best joint values known or seen, (n,); better ones are written here.
        tuning: How hard to try.
        counts: COUNT and following, (COUNTS,).
        figures: UPPER and following, (FIGURES,).
        until: Boxes that may have been examined by the end of this call, but for second looks at the last one.
        budget: Boxes that may be examined in all.

    Returns:
        ENDED, FOUND, STOPPED or FULL; ENDED too where there is room for no more answers.
    """
    dof = boxes.shape[1] // 2
    desk, trial, T = make_desk(len(form.leader), dof), q.copy(), np.empty((3, 4))
    if heap is not None:
        if counts[USED] == 0:
            start_heap(form, wanted, chain, goal, heap, q, T, tuning, counts, figures)
    elif places is not None:
        around = make_expansion(dof)
    elif not gate(form, wanted, chain)[0]:
        counts[COUNT] = 0
    while True:
        if places is not None and counts[KNOWN] == len(places.q):
            return ENDED
        if places is not None and counts[GIVEN] < len(places.answers):
            for i in range(len(trial)):
                trial[i] = places.answers[counts[GIVEN], i]
            counts[GIVEN] += 1
        else:
            outcome = next_trial(
                form,
                wanted,
                roll,
                chain,
                goal,
                boxes,
                heap,
                places,
                q,
                tuning,
                counts,
                figures,
                until,
                budget,
                desk,
                trial,
                T,
            )
            if outcome != TRIAL:
                return outcome
        if heap is None:
            forward(chain, trial, T)
            position, orientation = errors(T, goal)
            met = position <= tuning.position and orientation <= tuning.orientation
            if places is not None:
                if met:
                    admit(form, wanted, desk, around, places, trial, counts)
            else:
                error = weighted_error(T, goal)
                if met or error < figures[UPPER]:
                    figures[UPPER] = error
                    for i in range(len(q)):
                        q[i] = trial[i]
                if met:
                    return FOUND


@spliced
def next_trial(
    form: Form,
    wanted: Wanted,
    roll: Roll,
    chain: ChainArrays,
    goal: GoalArrays,
    boxes: Array,
    heap: Heap | None,
    places: Places | None,
    q: Array,
    tuning: Tuning,
    counts: Indices,
    figures: Array,
    until: int,
    budget: int,
    desk: Desk,
    trial: Array,
    T: Array,
) -> int:
    """Box after box, until steps from the middle of one lead to joint values worth a judgement; these go to `trial`.

    Returns:
        TRIAL; or ENDED, STOPPED or FULL.
    """
    while counts[COUNT] > 0:
        if counts[SEEN] >= until:
            return STOPPED
        if counts[COUNT] == len(boxes):
            return FULL
        row, below = counts[COUNT] - 1, 0.0
        if heap is not None:
            row = heap.order[0]
            below = heap.bound[row]
            if below >= figures[CEILING]:
                return ENDED
        load_box(boxes, row, desk)
        verdict, spread = AGAIN, 0.0
        while verdict == AGAIN and counts[SEEN] < budget:
            counts[SEEN] += 1
            if places is not None:
                held = inside(desk, places, 0, counts[KNOWN], 1.0)
                if held >= 0:
                    counts[LEFT] += 0 if places.isolated[held] else 1
                    verdict = GONE
                    break
            if heap is None:
                verdict, spread = exclude_box(form, wanted, roll, desk, tuning)
            else:
                verdict, spread, below = bound_box(
                    form, wanted, roll, chain, goal, below, q, tuning, figures, desk, trial, T
                )
        if heap is not None:
            if below >= figures[CEILING]:
                verdict = GONE
        elif verdict == AGAIN:  # The budget is over.
            store_box(boxes, row, desk)
            continue
        variable = 0
        if verdict != GONE:
            variable = widest(form, wanted, desk, HEAD if heap is None or spread > FINE else 1.0)
            if desk.h[variable] < NARROW * (1.0 + abs(desk.c[variable])):
                counts[LEFT] += 1
                figures[STUCK] = max(figures[STUCK], desk.h[variable])
                figures[FLOOR] = min(figures[FLOOR], below)
                verdict = GONE
        if verdict == GONE:
            drop(heap, row, counts)
            continue
        split(boxes, heap, row, variable, below, counts, desk)
        if heap is None:
            # Wide tolerances may allow an answer in the middle, though no descent ends there.
            steps = tuning.steps if spread < NEAR and counts[KEPT] % tuning.often == 0 else 0
            near = desk.found[MISS_POINT] <= wanted.position and desk.found[MISS_COLUMNS] <= wanted.chord
            if steps > 0 or (places is None and near):
                approach(form, wanted, roll, chain, steps, desk, trial)
                return TRIAL
    return ENDED


@hidden
def drop(heap: Heap | None, row: int, counts: Indices) -> None:
    """The box in hand is done with."""
    counts[COUNT] -= 1
    if heap is not None:
        count, order = counts[COUNT], heap.order
        order[0], order[count] = order[count], row
        sift_down(heap.bound, order, count)


@hidden
def split(
    boxes: Array, heap: Heap | None, row: int, variable: int, below: float, counts: Indices, desk: Desk
) -> None:
    """Put the halves of the box in hand where it was and into another row."""
    count = counts[COUNT]
    other = count
    if heap is not None:
        if count == counts[USED]:
            heap.order[count] = count
            counts[USED] += 1
        other = heap.order[count]
    halve(desk, variable, boxes, row, other)
    if heap is not None:
        heap.bound[row] = heap.bound[other] = below
        sift_down(heap.bound, heap.order, count)
        sift_up(heap.bound, heap.order, count)
    counts[COUNT] += 1
    counts[KEPT] += 1


_ASKED: dict[str, Any] = {
    "form": FORM,
    "wanted": WANTED,
    "roll": ROLL,
    "chain": CHAIN,
    "goal": GOAL,
}
_TOLD: dict[str, Any] = {
    "q": F64["n"].out,
    "tuning": TUNING,
    "counts": I64[COUNTS].out,
    "figures": F64[FIGURES].out,
    "until": I64,
    "budget": I64,
}


@entry(returns=I64, **_ASKED, boxes=F64["room", "*"].out, **_TOLD)
def exclude_boxes(
    form: Form,
    wanted: Wanted,
    roll: Roll,
    chain: ChainArrays,
    goal: GoalArrays,
    boxes: Array,
    q: Array,
    tuning: Tuning,
    counts: Indices,
    figures: Array,
    until: int,
    budget: int,
) -> int:
    """`search_boxes` for one answer, or none."""
    return search_boxes(
        form, wanted, roll, chain, goal, boxes, None, None, q, tuning, counts, figures, until, budget
    )


@entry(returns=I64, **_ASKED, boxes=F64["room", "*"].out, heap=HEAP, **_TOLD)
def enclose_boxes(
    form: Form,
    wanted: Wanted,
    roll: Roll,
    chain: ChainArrays,
    goal: GoalArrays,
    boxes: Array,
    heap: Heap,
    q: Array,
    tuning: Tuning,
    counts: Indices,
    figures: Array,
    until: int,
    budget: int,
) -> int:
    """`search_boxes` for the least weighted error."""
    return search_boxes(
        form, wanted, roll, chain, goal, boxes, heap, None, q, tuning, counts, figures, until, budget
    )


@entry(returns=I64, **_ASKED, boxes=F64["room", "*"].out, places=PLACES, **_TOLD)
def isolate_boxes(
    form: Form,
    wanted: Wanted,
    roll: Roll,
    chain: ChainArrays,
    goal: GoalArrays,
    boxes: Array,
    places: Places,
    q: Array,
    tuning: Tuning,
    counts: Indices,
    figures: Array,
    until: int,
    budget: int,
) -> int:
    """`search_boxes` for all answers."""
    return search_boxes(
        form, wanted, roll, chain, goal, boxes, None, places, q, tuning, counts, figures, until, budget
    )
