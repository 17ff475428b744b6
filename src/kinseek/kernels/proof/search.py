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

from typing import NamedTuple

from kinseek.kernels.arm.forward import forward
from kinseek.kernels.arm.pose_error import errors, weighted_error
from kinseek.kernels.jit import entry, inlined

from . import progress
from .approach import approach
from .bounds import first_order
from .box import (
    HEAD,
    NARROW,
    NEAR,
    BoxScratch,
    halve,
    largest_rotation,
    load_box,
    place,
    store_box,
    volume,
    widest,
    widths,
)
from .branch_and_bound import FINE, enclose, pop, push, sift_down, start_heap
from .gate import gate
from .infeasibility import exclude
from .last_joint import cut_twist
from .memory import Memory, SearchScratch, make_search_scratch
from .progress import Call, Question, Tuning
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
        until: Number of boxes after which this call ends, not counting further examinations of the last one.
        budget: Largest number of boxes in total.

    Returns:
        ENDED, FOUND, STOPPED or FULL; ENDED also if there is no room for more solutions.
    """
    work = make_search_scratch(len(question.form.leader), memory)
    return search(Call(kind, until, budget), question, tuning, memory, work)


@inlined
def search(call: Call, question: Question, tuning: Tuning, memory: Memory, work: SearchScratch) -> int:
    """Do the work of `search_boxes` without counted memory.

    Allocation counts references to arrays; without it this compiles faster.
    """
    chain, goal = question.chain, question.goal
    places, q, counts, figures = memory.places, memory.q, memory.counts, memory.figures
    trial, T = work.trial, work.T
    open_, least = gate(question.form, question.proof_goal, chain)
    if call.kind == progress.EXCLUDE and not open_:
        counts[progress.COUNT] = 0
    if call.kind == progress.ENCLOSE and counts[progress.USED] == 0:
        start_heap(question, tuning, memory, T, least)
    while True:
        if counts[progress.GIVEN] < len(places.answers):
            for i in range(len(trial)):
                trial[i] = places.answers[counts[progress.GIVEN], i]
            counts[progress.GIVEN] += 1
        else:
            outcome = next_trial(call, question, tuning, memory, work)
            if outcome != progress.TRIAL:
                return outcome
        forward(chain, trial, T)
        position, orientation = errors(T, goal)
        met = position <= tuning.position and orientation <= tuning.orientation
        if call.kind == progress.ISOLATE:
            if met:
                admit(question, memory, work)
                if counts[progress.KNOWN] == len(places.q):
                    return progress.ENDED
        else:
            error = weighted_error(T, goal)
            if met or error < figures[progress.UPPER]:
                figures[progress.UPPER] = error
                for i in range(len(q)):
                    q[i] = trial[i]
            if met:
                return progress.FOUND


@inlined
def next_trial(call: Call, question: Question, tuning: Tuning, memory: Memory, work: SearchScratch) -> int:
    """Process boxes until steps from the middle of one lead to joint values worth judging, and write these to `work`.

    Returns:
        TRIAL; or ENDED, STOPPED or FULL.
    """
    scratch, boxes, heap, places = work.scratch, memory.boxes, memory.heap, memory.places
    counts, figures, best_first = memory.counts, memory.figures, call.kind == progress.ENCLOSE
    while counts[progress.COUNT] > 0:
        if counts[progress.SEEN] >= call.until:
            return progress.STOPPED
        if counts[progress.COUNT] == len(boxes):
            return progress.FULL
        row, below = counts[progress.COUNT] - 1, 0.0
        if best_first:
            row = heap.order[0]
            below = heap.bound[row]
            # This box has the smallest bound of all, so no other box can contain a smaller error either.
            if below >= figures[progress.CEILING]:
                return progress.ENDED
        load_box(boxes, row, scratch)
        result = Examination(progress.AGAIN, 0.0, below, False)
        while result.verdict == progress.AGAIN and counts[progress.SEEN] < call.budget:
            counts[progress.SEEN] += 1
            containing = (
                inside(scratch, places, 0, counts[progress.KNOWN], 1.0)
                if call.kind == progress.ISOLATE
                else -1
            )
            if containing >= 0:
                counts[progress.LEFT] += 0 if places.isolated[containing] else 1
                result = Examination(progress.GONE, 0.0, below, False)
            else:
                result = examine(call.kind, question, tuning, memory, work, result.below)
        gone, rotation, below = result.verdict == progress.GONE, result.rotation, result.below
        if best_first:
            gone = gone or below >= figures[progress.CEILING]
        elif result.verdict == progress.AGAIN:  # The budget is used up.
            store_box(boxes, row, scratch)
            continue
        variable = 0
        if not gone:
            head = HEAD if not best_first or rotation > FINE else 1.0
            variable = widest(question.form, question.proof_goal, scratch, head)
            if scratch.h[variable] < NARROW * (1.0 + abs(scratch.c[variable])):
                counts[progress.LEFT] += 1
                figures[progress.STUCK] = max(figures[progress.STUCK], scratch.h[variable])
                figures[progress.FLOOR] = min(figures[progress.FLOOR], below)
                gone = True
        if gone:
            if best_first:
                pop(heap, counts)
            else:
                counts[progress.COUNT] -= 1
            continue
        split(best_first, memory, scratch, row, variable, below)
        if not best_first:
            # Wide tolerances may allow a solution in the middle, even if no descent ends there.
            steps = tuning.steps if rotation < NEAR and counts[progress.KEPT] % tuning.often == 0 else 0
            if steps > 0 or (call.kind == progress.EXCLUDE and result.near):
                approach(question, scratch, steps, work.trial)
                return progress.TRIAL
    return progress.ENDED


class Examination(NamedTuple):
    """Result of one examination of a box."""

    verdict: int
    """GONE, AGAIN or OPEN."""
    rotation: float
    """Rotation of the hand within the box [rad]."""
    below: float
    """A lower bound of the error in it."""
    near: bool
    """True if its centre nearly meets the tolerances, see `exclude`."""


@inlined
def examine(
    kind: int, question: Question, tuning: Tuning, memory: Memory, work: SearchScratch, below: float
) -> Examination:
    """Examine the current box once, and cut off the parts that do not count; the error in it is at least `below`."""
    form, proof_goal, scratch = question.form, question.proof_goal, work.scratch
    ceiling = (
        memory.figures[progress.CEILING] if kind == progress.ENCLOSE else -1.0
    )  # Negative: the tolerances are tested.
    place(form, scratch)
    widths(form, scratch)
    kept, first = first_order(form, proof_goal, scratch, ceiling)
    below = max(below, first)
    if kept and kind == progress.ENCLOSE and form.tail == 1:
        kept = cut_twist(form, proof_goal, scratch, ceiling)
    rotation = largest_rotation(form, scratch, len(form.leader))
    if not kept:
        return Examination(progress.GONE, rotation, below, False)
    if not rotation < tuning.second_order:
        return Examination(progress.OPEN, rotation, below, False)
    before, near = volume(scratch), False
    if kind == progress.ENCLOSE:
        kept, bound = enclose(question, tuning, memory, work, first)
        below = max(below, bound)
    else:
        kept, near = exclude(question, scratch, tuning.passes)
    if not kept:
        return Examination(progress.GONE, rotation, below, near)
    return Examination(
        progress.AGAIN if volume(scratch) < tuning.shrink * before else progress.OPEN, rotation, below, near
    )


@inlined
def split(
    best_first: bool, memory: Memory, scratch: BoxScratch, row: int, variable: int, below: float
) -> None:
    """Store the halves of the current box in its row and in another row."""
    heap, counts = memory.heap, memory.counts
    other = counts[progress.COUNT]
    if best_first:
        # One half takes the row of the whole box, which is still at the top of the heap.
        heap.bound[row] = below
        sift_down(heap.bound, heap.order, other)
        other = push(heap, counts, below)
    else:
        counts[progress.COUNT] += 1
    halve(scratch, variable, memory.boxes, row, other)
    counts[progress.KEPT] += 1
