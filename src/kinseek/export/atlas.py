"""Export of the atlas: sorted samples in flash, and the refinement of the nearest ones."""

from __future__ import annotations

import numpy as np

from kinseek.errors import InvalidExport
from kinseek.goal import Goal
from kinseek.kernels import jit  # Not by name: naming its decorators marks a file of kernels.
from kinseek.kernels.atlas import lanes_newton, memory
from kinseek.kernels.atlas.task import ROUTINE, ROUTINES
from kinseek.kernels.entry import ENTRIES
from kinseek.kernels.pointers import ROW
from kinseek.problem import Problem
from kinseek.solvers.atlas.index import atlas_of
from kinseek.solvers.atlas.solver import Atlas

from .c_calls import prototype
from .c_text import guarded
from .design import Design, room_for

_LINE = 64


def atlas_design(search: Atlas, problem: Problem, ram: int | None) -> Design:
    """Return the design of the search.

    Raises:
        InvalidExport: A goal that the exported program does not support, or too little memory.
    """
    plain = Goal.pose(np.eye(4))
    options = ("kind", "position_tolerance", "orientation_tolerance", "position_weight", "orientation_weight")
    if changed := [name for name in options if getattr(problem.goal, name) != getattr(plain, name)]:
        raise InvalidExport(
            "the atlas on a controller supports whole poses with the default tolerances and weights; got another "
            f"{' and '.join(changed)}"
        )
    chain, dof = problem.arrays, problem.mechanism.dof
    joints = len(chain.leader)
    index = atlas_of(problem.chain, None, search.samples)
    blob, rows = bytearray(), []
    for each in index._arrays:
        blob.extend(b"\0" * (-len(blob) % _LINE))
        rows.append((len(blob), *each.shape, *(1,) * (ROW - 1 - each.ndim)))
        blob.extend(each.astype(each.dtype.newbyteorder("<")).tobytes())
    # Working memory of a call, including that of the nearest pose, one after the other: `minimise_lanes` and `minimise`.
    scratch = memory.LAYOUT.count.of(dof=dof, joints=joints)
    model = lanes_newton.LAYOUT.count.of(dof=dof, joints=joints, pairs=dof * (dof + 1) // 2)
    alone = (12, 6 * joints, 3 * joints, dof, dof, dof, dof * dof, dof * dof, dof, 3 * dof)
    room = room_for(scratch) + max(room_for(model), room_for(*alone))
    taken = room + 8 * (ROUTINE.size + ROW * len(rows) + 1)
    if ram is not None and taken > ram:
        raise InvalidExport(
            f"{problem.mechanism.name!r} with {dof} joints needs {taken:,} bytes of RAM for the atlas, got {ram:,}; divide "
            "and conquer needs less"
        )
    entry = ENTRIES["ks_solve_plain"]
    names = ("iterate", "search", "ending", "far", *(("closed",) * (index.structure.word != "none")))
    places = {name: ROUTINE.first[name] for name in names}
    routines = tuple(f"ks_{name}_routine" for name in places)
    lines = [
        f"{prototype(jit.ROUTINES[name])} /* A number to the kernels, not to be called from C. */"
        for name in routines
    ]
    table = ",\n    ".join("{" + ", ".join(map(str, row)) + "}" for row in rows)
    lines.append(f"static const int64_t rows[][{ROW}] = {{\n    {table}}};")
    return Design(
        folder="atlas",
        entries=(entry,),
        routines=routines,
        numbers={
            "ROWS": len(rows),
            "ROUTINES": ROUTINE.size,
            "ROUTINES_ROW": ROUTINES,
            **{name.upper(): place for name, place in places.items()},
        },
        chain=chain,
        axis_weights=problem.goal.arrays.axis_weights,
        texts={"rows.h": guarded("KINSEEK_ROWS_H", ["#include <stdint.h>", *lines])},
        data={"atlas.bin": bytes(blob)},
        constants=len(blob) + 8 * ROW * len(rows),
        room=room,
        ram=taken,
    )
