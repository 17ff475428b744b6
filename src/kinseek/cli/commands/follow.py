"""``kinseek follow``: one motion through the poses of a file."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import click
import numpy as np
from numpy.typing import NDArray

from kinseek.arm import Arm
from kinseek.cli import report
from kinseek.cli.columns import TIME, VALID
from kinseek.cli.files import is_same_file, read_path, writable
from kinseek.cli.goals import GoalSpec
from kinseek.cli.help import Command, argument, bundle, option
from kinseek.cli.options import (
    GOAL,
    Robot,
    complete_joints,
    goal_options,
    json_option,
    robot_options,
)
from kinseek.cli.output import complain, on_terminal
from kinseek.cli.scenes import Cell, scene_options
from kinseek.cli.words import joint_values, limits
from kinseek.errors import InvalidProblem
from kinseek.interpolation import interpolate
from kinseek.tables import path_table, write_table
from kinseek.timing.formats import output_form, save
from kinseek.timing.limits import read_limits

Array = NDArray[np.float64]

_MOTION, _TIME = "The motion", "The motion in time"
_POSES, _OUT, _TRAJECTORY = "POSES", "OUT", "--out"


class Speed(NamedTuple):
    """A motion in time: its limits, as words, and whether it is the fastest."""

    velocity: str | None
    acceleration: str | None
    jerk: str | None
    tool_speed: float | None
    fastest: bool

    def values(self, arm: Arm) -> dict[str, Any]:
        """Return the limits as `Path.timed` takes them.

        Raises:
            InvalidProblem: Words that are not one number, or one for each joint.
        """
        texts = {"velocity": self.velocity, "acceleration": self.acceleration, "jerk": self.jerk}
        read = {
            name: None if text is None else limits(arm, text, f"--{name}") for name, text in texts.items()
        }
        return read | {"tool_speed": self.tool_speed}

    def cost(self, values: dict[str, Any]) -> dict[str, Any]:
        """Return the options of `Arm.follow` that choose the fastest motion within limits."""
        return {"cost": "time", "velocity": values["velocity"], "acceleration": values["acceleration"]}


_speed_options = bundle(
    "speed",
    Speed,
    option(
        "--velocity",
        metavar="X...",
        shell_complete=complete_joints,
        group=_TIME,
        help="Speed limits, rad/s or m/s, also with --deg: one for all joints, one per joint, or JOINT=VALUE for every "
        "joint; by default those of the arm's file or of a joint_limits.yaml (--limits).",
    ),
    option(
        "--acceleration",
        metavar="X...",
        shell_complete=complete_joints,
        group=_TIME,
        help="Limits of acceleration, rad/s² or m/s², in the form of --velocity and with the same default.",
    ),
    option(
        "--jerk",
        metavar="X...",
        shell_complete=complete_joints,
        group=_TIME,
        help="Limits of jerk, rad/s³ or m/s³, in the form of --velocity; by default there are none.",
    ),
    option(
        "--tool-speed",
        metavar="X",
        type=float,
        group=_TIME,
        help="Largest speed of the tip, m/s; it is kept constant where the other limits permit it.",
    ),
    option(
        "--fastest",
        is_flag=True,
        group=_TIME,
        help="Choose joint values for the fastest trajectory, not for the shortest motion of the joints; takes longer.",
    ),
)


@click.command(
    "follow",
    cls=Command,
    examples=[
        "kinseek follow ur5e poses.csv q.csv",
        "kinseek follow ur5e poses.csv q.npy --free rz --max-step 0.2",
        "kinseek follow ur5e poses.csv q.csv --period 0.01",
        "kinseek follow ur5e poses.csv q.csv --step 0.005 --turn 0.02",
        "kinseek follow ur5e poses.csv q.csv --scene cell.urdf --capsules 0.05",
        "kinseek follow ur5e poses.csv --acceleration 5 --period 0.008 --out seam.script",
    ],
    more=[
        f"Columns of POSES, lengths in m, angles in rad: {VALID}. The column {TIME} is optional: the time of each pose, "
        "s; no joint exceeds the speed in the arm's file.",
        "With --step and --turn, POSES are key poses, and OUT has rows for the poses between them as well.",
        "OUT has one row per pose: the joints, the time if it is known, whether the pose is reached and its errors, and "
        "whether the motion has a break after it.",
        "With --out, the fastest motion through the poses within limits is written too: a table, or a program for a robot. "
        "No program was run on a controller: try it in simulation first.",
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
    required=False,
    type=click.Path(path_type=Path),
    help="Output file for the joint values, .csv, .npy or .parquet; written once all are computed. It may be left out with "
    "--out.",
)
@scene_options
@option(
    "--deg",
    is_flag=True,
    group=GOAL,
    help="Angles of the poses, --start, --end, --tool, --box and --cone are in degrees.",
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
    help="Time from pose to pose, s; no joint exceeds the speed in the arm's file. With --out, time between two points of "
    "the trajectory; without it there is a point at each pose.",
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
@option(
    _TRAJECTORY,
    "trajectory_file",
    metavar="FILE",
    type=click.Path(path_type=Path),
    group=_TIME,
    help="Output file for the trajectory: .csv, .npy, .parquet, .script (URScript), .src (KRL) or .mod (RAPID).",
)
@_speed_options
@goal_options
@json_option
def command(
    poses: Path,
    out: Path | None,
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
    trajectory_file: Path | None,
    speed: Speed,
    as_json: bool,
) -> int:
    """Find one continuous motion through many poses, with as few breaks as possible."""
    loaded = robot.load()
    # Before any work is done.
    place = None if out is None else writable(out, poses, _OUT, _POSES)
    _require_output(loaded, poses, out, trajectory_file, period)
    fastest = speed.values(loaded)
    if trajectory_file is not None:
        read_limits(loaded.mechanism, **fastest)
    elif speed.fastest or any(each is not None for each in fastest.values()):
        raise InvalidProblem(f"limits of a motion in time are for {_TRAJECTORY}, which is not given")
    given, times = read_path(poses, goal_spec.position_only, deg, _POSES)
    goal = goal_spec.goal(_with_poses_between(given, step, turn, blend), deg)
    if trajectory_file is None:
        times = _times(times, period, len(given), len(goal.target))
    elif times is not None:
        raise InvalidProblem(
            f"the column {TIME} has the time of each pose; it cannot be combined with {_TRAJECTORY}"
        )
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
        **(speed.cost(fastest) if speed.fastest else {}),
    )
    seconds = time.perf_counter() - clock
    table = path_table(path)
    if times is not None:
        table = replace(table, columns={TIME: times, **table.columns})
    trajectory = path.timed(**fastest) if trajectory_file is not None and path.reached.all() else None
    if trajectory_file is not None and trajectory is not None:
        if period is not None and period > trajectory.duration:
            complain(
                f"warning: the period of {period:g} s is longer than the motion of {trajectory.duration:.3g} s: only the "
                "two ends of it are written"
            )
        # First, since it may be impossible with these limits and this period.
        save(trajectory, trajectory_file, period)
    if place is not None and out is not None:
        write_table(place, table, out.suffix)
    files = report.PathFiles(out, trajectory_file)
    report.print_path(loaded, path, trajectory, files, seconds, as_json)
    return 0 if path.success else 1


def _require_output(
    arm: Arm, poses: Path, out: Path | None, trajectory: Path | None, period: float | None
) -> None:
    """Check that there is an output file, and that a trajectory can be written to its file.

    Raises:
        KinseekError: There is none, or it cannot.
    """
    if trajectory is None:
        if out is None:
            raise InvalidProblem(
                f"follow needs an output file: {_OUT} for joint values, or {_TRAJECTORY} for a trajectory"
            )
        return
    place = output_form(arm.mechanism, trajectory, period).place
    for name, other in ((_POSES, poses), (_OUT, out)):
        if other is not None and is_same_file(place, other):
            raise InvalidProblem(f"{_TRAJECTORY} {str(trajectory)!r} is the file of {name} too")


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
