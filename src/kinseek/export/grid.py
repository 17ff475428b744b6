"""Export of divide and conquer with the dynamic tree, in memory of a fixed size."""

from __future__ import annotations

import math

import numpy as np

from kinseek.errors import InvalidExport
from kinseek.kernels.entry import ENTRIES
from kinseek.kernels.grid.descent import BEGINNING, LEAVES, NODES
from kinseek.kernels.grid.memory import A_LANE, MOST_LANES, memory_size
from kinseek.kernels.grid.window import PART, PAUSED, split_depth
from kinseek.problem import Problem
from kinseek.solvers.divide_and_conquer import DivideAndConquer
from kinseek.solvers.grid_search import Plan
from kinseek.support.deadline import Deadline

from .c_text import array, guarded, number, structure
from .design import Design, room_for


def grid_design(search: DivideAndConquer, problem: Problem, ram: int | None) -> Design:
    """Return the design of the search; it tabulates fewer leaves at once if the limit `ram` [bytes] requires it.

    Raises:
        InvalidExport: A search that the exported program does not support, or too little memory.
        InvalidSolver: Parameters of the search that do not fit the arm.
    """
    if search.tree != "dynamic":
        raise InvalidExport(f"tree must be 'dynamic' in an exported search, got {search.tree!r}")
    if search.ties != "rounding":
        raise InvalidExport(f"ties must be 'rounding' in an exported search, got {search.ties!r}")
    plan, dof = search._plan(problem, Deadline()), problem.mechanism.dof
    most_lanes = _lanes(problem, plan)
    room = room_for(12, dof)  # A pose without its last row, and a node of each joint.
    least = memory_size(*plan.sizes) - A_LANE * MOST_LANES
    fixed, lanes = 8 * (least + 12 + len(BEGINNING)) + room, most_lanes
    if ram is not None and fixed + 8 * A_LANE * lanes > ram:
        lanes = (ram - fixed) // (8 * A_LANE)
        if lanes < 1:
            raise InvalidExport(
                f"{problem.mechanism.name!r} with {dof} joints needs {fixed + 8 * A_LANE:,} bytes of RAM at least for this "
                f"search, got {ram:,}. Fewer joints (with_locked), a smaller beam or breadth, or fewer divisions need less"
            )
    numbers = least + A_LANE * lanes
    text, constants = _plan_in_c(plan)
    entry = ENTRIES["ks_descend"]
    return Design(
        folder="grid",
        entries=(entry,),
        routines=(),
        numbers={
            "GRID": "1 /* The search can be done in parts. */",
            "MEMORY": f"{numbers} /* Numbers of 8 bytes that a search works on. */",
            "PROGRESS": len(BEGINNING),
            "BEGINNING": f"{{{', '.join(map(str, BEGINNING))}}}",
            "LEAVES": LEAVES,
            "NODES": NODES,
            "PASSES": len(plan.passes.spacings),
            "PAUSED": PAUSED,
            "PART": f"{PART} /* Leaves of a part of the search, by default. */",
        },
        chain=problem.arrays,
        axis_weights=problem.goal.arrays.axis_weights,
        texts={"plan.h": text},
        data={},
        constants=constants,
        room=room,
        ram=fixed + 8 * A_LANE * lanes,
        lanes=lanes,
        most_lanes=most_lanes,
        sizes=plan.sizes,
        memory=numbers,
    )


def _plan_in_c(plan: Plan) -> tuple[str, int]:
    """Return the grid and the passes in C, and their size in bytes."""
    grid, passes = plan.grid, plan.passes
    arrays = {name: getattr(grid, name) for name in ("step", "wraps")}
    arrays |= {name: getattr(passes, name) for name in ("spacings", "counts", "first")}
    of_grid = {
        "lower": "chain_lower",
        "upper": "chain_upper",
        "step": "step",
        "wraps": "wraps",
        "size": str(grid.size),
        "table": "chain_lower",
        "table_length": "0 /* No node is made beforehand. */",
    }
    of_passes = {
        "spacings": "spacings",
        "counts": "counts",
        "first": "first",
        "first_length": str(passes.first.shape[1]),
        "clips": str(int(passes.clips)),
        "stop_below": number(passes.stop_below),
        "tie": number(passes.tie),
        "budget": "INT64_MAX",
        "beam": str(passes.beam),
        "children": str(passes.children),
    }
    lines = [array(name, each) for name, each in arrays.items()]
    lines += [structure("KinseekGrid", "grid", of_grid), structure("KinseekPasses", "passes", of_passes)]
    return guarded("KINSEEK_PLAN_H", ['#include "constants.h"', *lines]), sum(
        each.nbytes for each in arrays.values()
    )


def _lanes(problem: Problem, plan: Plan) -> int:
    """Return the number of leaves tabulated at once: those of the suffix that it chooses for a full window of each pass."""
    passes, most = plan.passes, 1
    for k, spacing in enumerate(passes.spacings.tolist()):
        counts = (
            passes.counts[k] if k == 0 else np.minimum(passes.counts[k], (plan.grid.size - 1) // spacing + 1)
        )
        s = split_depth(problem.arrays, counts)
        most = max(most, math.prod(counts[s:].tolist()))
    return most
