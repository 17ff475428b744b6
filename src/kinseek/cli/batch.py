"""``solve --batch``: a file of poses in, a file of solutions out."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from kinseek.branches.result import BranchesBatch
from kinseek.tables import branches_batch_table, solution_table, write_table

from . import report
from .files import read_poses, writable
from .output import on_terminal
from .request import SolveRequest


def solve_file(request: SolveRequest, source: Path, out: Path, as_json: bool) -> int:
    """Solve every pose of a file, and write the solutions when all are computed.

    Args:
        request: The arm and the options of the command line.
        source: The poses, as `read_poses` takes them.
        out: The output file: a row per pose, or with ``--all`` a row per solution.
        as_json: Print the summary as JSON?

    Returns:
        0 if every pose was reached, else 1.

    Raises:
        InvalidProblem: A file cannot be read or written, or both are the same file.
        InvalidGoal: A row is not a pose; the message names it.
        MissingExtra: A .parquet file, and pyarrow is not installed.
    """
    place = writable(out, source)  # Checked before any work is done.
    spec, deg = request.goal_spec, request.deg
    goal = spec.goal(read_poses(source, spec.position_only, deg), deg)
    clock = time.perf_counter()
    if request.every:
        found = request.branches(goal)
        assert isinstance(found, BranchesBatch)
        reached, table = found.counts > 0, branches_batch_table(found)
        table = replace(table, columns={"row": table.index["target"] + 1, **table.columns})
    else:
        solution = request.solve(goal, progress=on_terminal())
        reached, table = np.asarray(solution.success), solution_table(solution, request.scene is not None)
    seconds = time.perf_counter() - clock
    write_table(place, table, out.suffix)
    report.print_batch(request.arm, reached, str(out), seconds, as_json)
    return 0 if reached.all() else 1
