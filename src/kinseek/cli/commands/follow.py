"""``kinseek follow``: one motion through the poses of a file."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import click
import numpy as np
from numpy.typing import NDArray

from kinseek.cli import report
from kinseek.cli.columns import TIME, VALID
from kinseek.cli.files import read_path, writable
from kinseek.cli.goals import GoalSpec
from kinseek.cli.help import Command, argument, option
from kinseek.cli.options import (
    GOAL,
    Robot,
    complete_joints,
    goal_options,
    json_option,
    robot_options,
)
from kinseek.cli.output import on_terminal
from kinseek.cli.scenes import Cell, scene_options
from kinseek.cli.words import joint_values
from kinseek.errors import InvalidProblem
from kinseek.interpolation import interpolate
from kinseek.tables import path_table, write_table

Array = NDArray[np.float64]

_MOTION = "The motion"
_POSES, _OUT = "POSES", "OUT"


@click.command(
    "follow",
    cls=Command,
    examples=[
        "kinseek follow ur5e poses.csv q.csv",
        "kinseek follow ur5e poses.csv q.npy --free rz --max-step 0.2",
        "kinseek follow ur5e poses.csv q.csv --period 0.01",
        "kinseek follow ur5e poses.csv q.csv --step 0.005 --turn 0.02",
        "kinseek follow ur5e poses.csv q.csv --scene cell.urdf --capsules 0.05",
    ],
    more=[
        f"Columns of POSES, lengths in m, angles in rad: {VALID}. The column {TIME} is optional: the time of each pose, "
        "s; no joint exceeds the speed in the arm's file.",
        "With --step and --turn, POSES are key poses, and OUT has rows for the poses between them as well.",
        "OUT has one row per pose: the joints, the time if it is known, whether the pose is reached and its errors, and "
        "whether the motion has a break after it.",
        "Exit codes: 0 one continuous motion, 1 breaks or missed poses, 2 misuse; 130 stopped with Ctrl-C.",
    ],
)
@robot_options
@argument(
    "poses",
    metavar=_POSES,
    type=click.Path(path_type=Path),
    help="Poses in a .csv or .parquet file, or an array (N, 4, 4) in a .npy file.",
)
@argument(
    "out",
    metavar=_OUT,
    type=click.Path(path_type=Path),
    help="Output file for the joint values, .csv, .npy or .parquet; written once all are computed.",
)
@scene_options
@option(
    "--deg",
    is_flag=True,
    group=GOAL,
    help="Angles of the poses, --start, --end, --tool and --box are in degrees.",
)
@option(
    "--start",
    metavar="Q...",
    shell_complete=complete_joints,
    group=_MOTION,
    help="Joint values to begin with, rad or m: one per joint, or JOINT=VALUE for every joint.",
)
@option(
    "--end",
    metavar="Q...",
    shell_complete=complete_joints,
    group=_MOTION,
    help="Joint values to end with, in the form of --start.",
)
@option(
    "--closed",
    is_flag=True,
    group=_MOTION,
    help="The path is closed: the last pose is followed by the first.",
)
@option(
    "--max-step",
    metavar="X",
    type=float,
    default=0.3,
    group=_MOTION,
    help="Largest motion of a joint between two poses, rad or m, also with --deg; more is a break.",
)
@option(
    "--step",
    metavar="M",
    type=float,
    group=_MOTION,
    help="Insert poses on straight lines, so that consecutive ones are at most this far apart, m; needs --turn.",
)
@option(
    "--turn",
    metavar="RAD",
    type=float,
    group=_MOTION,
    help="Largest angle between consecutive poses, rad, also with --deg; needs --step.",
)
@option(
    "--blend",
    metavar="M",
    type=float,
    group=_MOTION,
    help="Radius around the given poses in which the inserted ones pass on a smooth curve, m; needs --step.",
)
@option(
    "--period",
    metavar="X",
    type=float,
    group=_MOTION,
    help="Time from pose to pose, s; no joint exceeds the speed in the arm's file.",
)
@option(
    "--prove",
    is_flag=True,
    group=_MOTION,
    help="Prove as far as possible that no step jumps, that missed poses are out of reach and that breaks are "
    "unavoidable.",
)
@option(
    "--time-limit",
    metavar="X",
    type=float,
    group=_MOTION,
    help="Time limit, s: no further part of the work is begun after it; poses that are not planned by then are missed.",
)
@goal_options
@json_option
def command(
    poses: Path,
    out: Path,
    robot: Robot,
    cell: Cell,
    goal_spec: GoalSpec,
    deg: bool,
    start: str | None,
    end: str | None,
    closed: bool,
    max_step: float,
    step: float | None,
    turn: float | None,
    blend: float | None,
    period: float | None,
    prove: bool,
    time_limit: float | None,
    as_json: bool,
) -> int:
    """Find one continuous motion through many poses, with as few breaks as possible."""
    loaded = robot.load()
    place = writable(out, poses, _OUT, _POSES)  # Before any work is done.
    given, times = read_path(poses, goal_spec.position_only, deg, _POSES)
    goal = goal_spec.goal(_with_poses_between(given, step, turn, blend), deg)
    times = _times(times, period, len(given), len(goal.target))
    first = None if start is None else joint_values(loaded, start, "--start", deg)
    last = None if end is None else joint_values(loaded, end, "--end", deg)
    scene = cell.of(loaded, robot)
    clock = time.perf_counter()
    path = loaded.follow(
        goal,
        start=first,
        end=last,
        closed=closed,
        max_step=max_step,
        times=times,
        prove=prove,
        scene=scene,
        clearance=cell.clearance,
        progress=on_terminal(),
        time_limit=time_limit,
    )
    seconds = time.perf_counter() - clock
    table = path_table(path)
    if times is not None:
        table = replace(table, columns={TIME: times, **table.columns})
    write_table(place, table)
    report.print_path(loaded, path, str(out), seconds, as_json)
    return 0 if path.success else 1


def _times(column: Array | None, period: float | None, given: int, count: int) -> Array | None:
    """Return the time of each of `count` poses, [s], from the column of the file or from ``--period``."""
    if period is None and column is None:
        return None
    if column is not None and (period is not None or count != given):
        raise InvalidProblem(
            f"the column {TIME} has the time of each pose; it cannot be combined with --period or --step"
        )
    if period is not None and not 0 < period < np.inf:
        raise InvalidProblem(f"--period must be above 0 [s], got {period:g}")
    return column if period is None else np.arange(count, dtype=np.float64) * period


def _with_poses_between(poses: Array, step: float | None, turn: float | None, blend: float | None) -> Array:
    if step is None and turn is None and blend is None:
        return poses
    if step is None or turn is None:
        raise InvalidProblem("--step and --turn are needed together, and with --blend")
    return interpolate(poses, step=step, turn=turn, blend=blend or 0.0)
