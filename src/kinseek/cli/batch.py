"""``solve --batch``: a file of poses in, a file of solutions out."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinseek.arm import Arm
from kinseek.branches.result import BranchesBatch
from kinseek.errors import InvalidProblem
from kinseek.solution import Solution

from . import report
from .files import read_poses, writable, write_columns
from .output import on_terminal
from .request import SolveRequest
from .scenes import contacts_column

Columns = dict[str, NDArray[Any]]


def solve_file(
    request: SolveRequest, source: Path, out: Path, deg: bool, every: bool, count: int | None, as_json: bool
) -> int:
    """Solve every pose of a file, and write the solutions when all are computed.

    Args:
        request: The arm and the options of the command line.
        source: The poses, as `read_poses` takes them.
        out: The output file: a row per pose, or with `every` a row per solution.
        deg: Are angles of the poses in degrees?
        every: Is every solution requested?
        count: Maximum number of these per pose.
        as_json: Print the summary as JSON?

    Returns:
        0 if every pose was reached, else 1.

    Raises:
        InvalidProblem: A file cannot be read or written, or both are the same file.
        InvalidGoal: A row is not a pose; the message names it.
        MissingExtra: A .parquet file, and pyarrow is not installed.
    """
    place = writable(out, source)  # Checked before any work is done.
    goal = request.goal_spec.goal(read_poses(source, request.goal_spec.position_only, deg))
    clock = time.perf_counter()
    if every:
        found = request.branches(goal, count)
        assert isinstance(found, BranchesBatch)
        reached, columns = found.counts > 0, _branches_columns(request.arm, found)
    else:
        solution = request.solve(goal, progress=on_terminal())
        reached, columns = np.asarray(solution.success), _solution_columns(request, solution)
    seconds = time.perf_counter() - clock
    write_columns(place, columns, request.arm.joint_names)
    report.print_batch(request.arm, reached, str(out), seconds, as_json)
    return 0 if reached.all() else 1


def _solution_columns(request: SolveRequest, solution: Solution) -> Columns:
    columns: Columns = dict(zip(request.arm.joint_names, solution.q.T, strict=True))
    return beside(
        columns,
        ({"contacts": contacts_column(solution)} if request.scene is not None else {})
        | {
            "success": np.asarray(solution.success),
            "status": np.array([status.name for status in np.atleast_1d(solution.status)]),
            "position_error": np.asarray(solution.position_error),
            "orientation_error": np.asarray(solution.orientation_error),
            "evaluations": np.asarray(solution.evaluations),
        },
    )


def _branches_columns(arm: Arm, found: BranchesBatch) -> Columns:
    q = found.q.reshape(-1, arm.dof)
    columns: Columns = dict(zip(arm.joint_names, q.T, strict=True))
    return beside(
        columns,
        {
            "row": np.repeat(np.arange(1, len(found) + 1), found.counts),
            "position_error": np.concatenate([one.position_error for one in found]),
            "orientation_error": np.concatenate([one.orientation_error for one in found]),
        },
    )


def beside(joints: Columns, others: Columns) -> Columns:
    """Combine joint values with the other columns.

    Raises:
        InvalidProblem: A joint has the name of one of the other columns.
    """
    if both := joints.keys() & others.keys():
        raise InvalidProblem(
            f"joint {both.pop()!r} has the name of another column of the output; rename the joint"
        )
    return joints | others
