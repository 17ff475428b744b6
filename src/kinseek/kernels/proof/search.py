"""The common loop of all searches by boxes: take a box, bound and cut it, look for a solution in it, and halve it.

Three searches run it: `infeasibility` tests whether a goal can be reached, `root_isolation` whether it has further
solutions, and `branch_and_bound` how near the arm can come. They differ in three places:

- *Which box comes next?* For ENCLOSE the one with the smallest bound, else the last one.
- *What counts?* For ENCLOSE anything that may have a smaller error than the best known joint values, else anything that
  may meet the tolerances. For ISOLATE the neighbourhoods of solutions are excluded.
- *What happens to joint values from the middle of a box?* For ENCLOSE they are judged by the weighted error while the box
  is examined. Otherwise they are judged by the tolerances. Those that meet them end the search for EXCLUDE, and get a
  neighbourhood for ISOLATE.

One loop is compiled for all three, because three loops would be nearly identical.
"""

from __future__ import annotations

import numpy as np

from kinseek.kernels.arm.forward import forward
from kinseek.kernels.arm.pose_error import errors, weighted_error
from kinseek.kernels.jit import entry, inlined, ir_inlined

from .approach import approach
from .bounds import first_order
from .box import (
    BELOW,
    HEAD,
    MISS_COLUMNS,
    MISS_POINT,
    NARROW,
    NEAR,
    BoxScratch,
    halve,
    load_box,
    place,
    store_box,
    turned,
    volume,
    widest,
    widths,
)
from .branch_and_bound import FINE, enclose, sift_down, sift_up, start_heap
from .gate import gate
from .infeasibility import exclude
from .last_joint import cut_twist
from .memory import Memory, SearchScratch, make_search_scratch
from .progress import (
    AGAIN,
    CEILING,
    COUNT,
    ENCLOSE,
    ENDED,
    EXCLUDE,
    FLOOR,
    FOUND,
    FULL,
    GIVEN,
    GONE,
    ISOLATE,
    KEPT,
    KNOWN,
    LEFT,
    OPEN,
    SEEN,
    STOPPED,
    STUCK,
    TRIAL,
    UPPER,
    USED,
    Question,
    Tuning,
)
from .root_isolation import admit, inside


@entry
def search_boxes(
    kind: int, question: Question, tuning: Tuning, memory: Memory, until: int, budget: int
) -> int:
    """Process boxes of joint values until none is left, or until another condition ends the call.

    It may be called again to continue where it stopped, with the same result as without the stop.

    Args:
        kind: EXCLUDE, ENCLOSE or ISOLATE.
        question: The goal and the arm.
        tuning: Effort and precision.
        memory: State of the search, which is updated.
        until: Number of boxes after which this call ends, not counting second looks at the last one.
        budget: Largest number of boxes in total.

    Returns:
        ENDED, FOUND, STOPPED or FULL; ENDED also if there is no room for more solutions.
    """
    work = make_search_scratch(len(question.form.leader), memory)
    return search(kind, question, tuning, memory, work, until, budget)


@inlined
def search(
    kind: int,
    question: Question,
    tuning: Tuning,
    memory: Memory,
    work: SearchScratch,
    until: int,
    budget: int,
) -> int:
    """Do the work of `search_boxes` without allocating memory.

    Allocation counts references to arrays; without it this compiles faster.
    """
    form, proof_goal, chain, goal = question.form, question.proof_goal, question.chain, question.goal
    places, q, counts, figures = memory.places, memory.q, memory.counts, memory.figures
    trial, T = work.trial, work.T
    open_, least = gate(form, proof_goal, chain)
    if kind == EXCLUDE and not open_:
        counts[COUNT] = 0
    if kind == ENCLOSE and counts[USED] == 0:
        start_heap(question, tuning, memory, T, least)
    while True:
        if counts[GIVEN] < len(places.answers):
            for i in range(len(trial)):
                trial[i] = places.answers[counts[GIVEN], i]
            counts[GIVEN] += 1
        else:
            outcome = next_trial(kind, question, tuning, memory, work, until, budget)
            if outcome != TRIAL:
                return outcome
        forward(chain, trial, T)
        position, orientation = errors(T, goal)
        met = position <= tuning.position and orientation <= tuning.orientation
        if kind == ISOLATE:
            if met:
                admit(form, proof_goal, work.scratch, work.around, places, trial, counts)
                if counts[KNOWN] == len(places.q):
                    return ENDED
        else:
            error = weighted_error(T, goal)
            if met or error < figures[UPPER]:
                figures[UPPER] = error
                for i in range(len(q)):
                    q[i] = trial[i]
            if met:
                return FOUND


@ir_inlined
def next_trial(
    kind: int,
    question: Question,
    tuning: Tuning,
    memory: Memory,
    work: SearchScratch,
    until: int,
    budget: int,
) -> int:
    """Process boxes until steps from the middle of one lead to joint values worth judging, and write these to `work`.

    Returns:
        TRIAL; or ENDED, STOPPED or FULL.
    """
    form, proof_goal, scratch = question.form, question.proof_goal, work.scratch
    boxes, heap, places, counts = memory.boxes, memory.heap, memory.places, memory.counts
    figures, best_first = memory.figures, kind == ENCLOSE
    while counts[COUNT] > 0:
        if counts[SEEN] >= until:
            return STOPPED
        if counts[COUNT] == len(boxes):
            return FULL
        row, below = counts[COUNT] - 1, 0.0
        if best_first:
            row = heap.order[0]
            below = heap.bound[row]
            if below >= figures[CEILING]:
                return ENDED
        load_box(boxes, row, scratch)
        verdict, spread = AGAIN, 0.0
        while verdict == AGAIN and counts[SEEN] < budget:
            counts[SEEN] += 1
            held = inside(scratch, places, 0, counts[KNOWN], 1.0) if kind == ISOLATE else -1
            if held >= 0:
                counts[LEFT] += 0 if places.isolated[held] else 1
                verdict = GONE
            else:
                verdict, spread, below = look(kind, question, tuning, memory, work, below)
        if best_first:
            if below >= figures[CEILING]:
                verdict = GONE
        elif verdict == AGAIN:  # The budget is used up.
            store_box(boxes, row, scratch)
            continue
        variable = 0
        if verdict != GONE:
            variable = widest(form, proof_goal, scratch, HEAD if not best_first or spread > FINE else 1.0)
            if scratch.h[variable] < NARROW * (1.0 + abs(scratch.c[variable])):
                counts[LEFT] += 1
                figures[STUCK] = max(figures[STUCK], scratch.h[variable])
                figures[FLOOR] = min(figures[FLOOR], below)
                verdict = GONE
        if verdict == GONE:
            drop(best_first, memory, row)
            continue
        split(best_first, memory, scratch, row, variable, below)
        if not best_first:
            # Wide tolerances may allow a solution in the middle, even if no descent ends there.
            steps = tuning.steps if spread < NEAR and counts[KEPT] % tuning.often == 0 else 0
            near = (
                scratch.found[MISS_POINT] <= proof_goal.position
                and scratch.found[MISS_COLUMNS] <= proof_goal.chord
            )
            if steps > 0 or (kind == EXCLUDE and near):
                approach(form, proof_goal, question.roll, question.chain, steps, scratch, work.trial)
                return TRIAL
    return ENDED


@inlined
def look(
    kind: int, question: Question, tuning: Tuning, memory: Memory, work: SearchScratch, below: float
) -> tuple[int, float, float]:
    """Examine the current box once, and cut off the parts that do not count.

    Returns:
        GONE, AGAIN or OPEN; the rotation of the hand within the box [rad]; and a lower bound of the error in it, at least
        `below`.
    """
    form, proof_goal, scratch = question.form, question.proof_goal, work.scratch
    ceiling = memory.figures[CEILING] if kind == ENCLOSE else -1.0  # Negative: the tolerances are tested.
    scratch.found[BELOW], scratch.found[MISS_POINT] = 0.0, np.inf
    place(form, scratch)
    widths(form, scratch)
    kept = first_order(form, proof_goal, scratch, ceiling)
    below = max(below, scratch.found[BELOW])
    if kept and kind == ENCLOSE and form.tail == 1:
        kept = cut_twist(form, proof_goal, scratch, ceiling)
    spread = turned(form, scratch, len(form.leader))
    if not kept:
        return GONE, spread, below
    if not spread < tuning.spread:
        return OPEN, spread, below
    before = volume(scratch)
    if kind == ENCLOSE:
        kept, below = enclose(question, tuning, memory, work, below)
    else:
        kept = exclude(form, proof_goal, question.roll, scratch, tuning.passes)
    if not kept:
        return GONE, spread, below
    return AGAIN if volume(scratch) < tuning.shrink * before else OPEN, spread, below


@inlined
def drop(best_first: bool, memory: Memory, row: int) -> None:
    """Remove the current box."""
    heap, counts = memory.heap, memory.counts
    counts[COUNT] -= 1
    if best_first:
        count, order = counts[COUNT], heap.order
        order[0], order[count] = order[count], row
        sift_down(heap.bound, order, count)


@inlined
def split(
    best_first: bool, memory: Memory, scratch: BoxScratch, row: int, variable: int, below: float
) -> None:
    """Store the halves of the current box in its row and in another row."""
    heap, counts = memory.heap, memory.counts
    count = counts[COUNT]
    other = count
    if best_first:
        if count == counts[USED]:
            heap.order[count] = count
            counts[USED] += 1
        other = heap.order[count]
    halve(scratch, variable, memory.boxes, row, other)
    if best_first:
        heap.bound[row] = heap.bound[other] = below
        sift_down(heap.bound, heap.order, count)
        sift_up(heap.bound, heap.order, count)
    counts[COUNT] += 1
    counts[KEPT] += 1
