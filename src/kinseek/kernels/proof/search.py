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
from kinseek.kernels.jit import entry, inlined, ir_inlined

from .approach import approach
from .bounds import first_order
from .box import (
    HEAD,
    NARROW,
    NEAR,
    BoxScratch,
    halve,
    load_box,
    place,
    turned,
    widest,
    widths,
)
from .branch_and_bound import FINE, enclose, start_heap
from .gate import gate
from .heap import free_row, pop, push, sift_down
from .infeasibility import exclude
from .last_joint import cut_twist
from .memory import Memory, SearchScratch, make_search_scratch
from .progress import (
    CEILING,
    COUNT,
    ENCLOSE,
    ENDED,
    EXCLUDE,
    FLOOR,
    FOUND,
    FULL,
    GIVEN,
    ISOLATE,
    KEPT,
    KNOWN,
    LEFT,
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
def search_boxes(kind: int, question: Question, tuning: Tuning, memory: Memory, until: int) -> int:
    """Process boxes of joint values until none is left, or until another condition ends the call.

    It may be called again to continue where it stopped, with the same result as without the stop.

    Args:
        kind: EXCLUDE, ENCLOSE or ISOLATE.
        question: The goal and the arm.
        tuning: Effort and precision.
        memory: State of the search, which is updated.
        until: Number of boxes after which this call ends.

    Returns:
        ENDED, FOUND, STOPPED or FULL; ENDED also if there is no room for more solutions.
    """
    work = make_search_scratch(len(question.form.leader), memory)
    return search(kind, question, tuning, memory, work, until)


@inlined
def search(
    kind: int, question: Question, tuning: Tuning, memory: Memory, work: SearchScratch, until: int
) -> int:
    """Do the work of `search_boxes` without allocating memory.

    Allocation counts references to arrays; without it this compiles faster.
    """
    chain, goal = question.chain, question.goal
    places, q, counts, figures = memory.places, memory.q, memory.counts, memory.figures
    trial, T = work.trial, work.T
    open_, least = gate(question.form, question.proof_goal, chain)
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
            outcome = next_trial(kind, question, tuning, memory, work, until)
            if outcome != TRIAL:
                return outcome
        forward(chain, trial, T)
        position, orientation = errors(T, goal)
        met = position <= tuning.position and orientation <= tuning.orientation
        if kind == ISOLATE:
            if met:
                admit(question, memory, work)
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
    kind: int, question: Question, tuning: Tuning, memory: Memory, work: SearchScratch, until: int
) -> int:
    """Process boxes until steps from the middle of one lead to joint values worth judging, and write these to `work`.

    Returns:
        TRIAL; or ENDED, STOPPED or FULL.
    """
    scratch, boxes, heap, places = work.scratch, memory.boxes, memory.heap, memory.places
    counts, figures, best_first = memory.counts, memory.figures, kind == ENCLOSE
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
        counts[SEEN] += 1
        held = inside(scratch, places, 0, counts[KNOWN], 1.0) if kind == ISOLATE else -1
        seen = Look(False, 0.0, below, False)
        if held < 0:
            seen = look(kind, question, tuning, memory, work, below)
        elif not places.isolated[held]:
            counts[LEFT] += 1
        kept, spread, below = seen.kept, seen.spread, seen.below
        if best_first and below >= figures[CEILING]:
            kept = False
        variable = 0
        if kept:
            head = HEAD if not best_first or spread > FINE else 1.0
            variable = widest(question.form, question.proof_goal, scratch, head)
            if scratch.h[variable] < NARROW * (1.0 + abs(scratch.c[variable])):
                counts[LEFT] += 1
                figures[STUCK] = max(figures[STUCK], scratch.h[variable])
                figures[FLOOR] = min(figures[FLOOR], below)
                kept = False
        if not kept:
            drop(best_first, memory)
            continue
        split(best_first, memory, scratch, row, variable, below)
        if not best_first:
            # Wide tolerances may allow a solution in the middle, even if no descent ends there.
            steps = tuning.steps if spread < NEAR and counts[KEPT] % tuning.often == 0 else 0
            if steps > 0 or (kind == EXCLUDE and seen.near):
                approach(question, scratch, steps, work.trial)
                return TRIAL
    return ENDED


class Look(NamedTuple):
    """Result of a look at a box."""

    kept: bool
    """False if nothing in it counts."""
    spread: float
    """Rotation of the hand within the box [rad]."""
    below: float
    """A lower bound of the error in it."""
    near: bool
    """True if its centre nearly meets the tolerances, see `exclude`."""


@inlined
def look(
    kind: int, question: Question, tuning: Tuning, memory: Memory, work: SearchScratch, below: float
) -> Look:
    """Examine the current box, and cut off the parts that do not count; the error in it is at least `below`."""
    form, proof_goal, scratch, near = question.form, question.proof_goal, work.scratch, False
    ceiling = memory.figures[CEILING] if kind == ENCLOSE else -1.0  # Negative: the tolerances are tested.
    place(form, scratch)
    widths(form, scratch)
    kept, first = first_order(form, proof_goal, scratch, ceiling)
    below = max(below, first)
    if kept and kind == ENCLOSE and form.tail == 1:
        kept = cut_twist(form, proof_goal, scratch, ceiling)
    spread = turned(form, scratch, len(form.leader))
    if kept and spread < tuning.spread:
        if kind == ENCLOSE:
            kept, bound = enclose(question, tuning, memory, work, first)
            below = max(below, bound)
        else:
            kept, near = exclude(question, scratch)
    return Look(kept, spread, below, near)


@inlined
def drop(best_first: bool, memory: Memory) -> None:
    """Remove the current box."""
    if best_first:
        pop(memory.heap, memory.counts)
    else:
        memory.counts[COUNT] -= 1


@inlined
def split(
    best_first: bool, memory: Memory, scratch: BoxScratch, row: int, variable: int, below: float
) -> None:
    """Store the halves of the current box in its row and in another row."""
    heap, counts = memory.heap, memory.counts
    if best_first:
        other = free_row(heap, counts)
        heap.bound[row] = heap.bound[other] = below
        sift_down(heap.bound, heap.order, counts[COUNT])
        push(heap, counts)
    else:
        other = counts[COUNT]
        counts[COUNT] += 1
    halve(scratch, variable, memory.boxes, row, other)
    counts[KEPT] += 1
