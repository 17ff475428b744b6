"""``kinseek export``."""

from __future__ import annotations

import os
import re
import stat
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import click

from kinseek.arm import Arm
from kinseek.cli import report
from kinseek.cli.goals import PoseWords
from kinseek.cli.help import Command, bundle, option
from kinseek.cli.options import GOAL, Robot, complete, complete_joints, pose_options, robot_options
from kinseek.cli.output import complain
from kinseek.cli.searches import make_search, search_options
from kinseek.cli.words import limits, option_of, size
from kinseek.errors import InvalidExport, suggest
from kinseek.export import TARGETS, checked_folder, prepare
from kinseek.goal import Goal

if TYPE_CHECKING:
    from kinseek.paths.tracker import Tracker
    from kinseek.solvers.atlas.solver import Atlas
    from kinseek.solvers.divide_and_conquer import DivideAndConquer

_EXPORTED = ("divide-and-conquer", "atlas")
"""The searches that can be exported; the first is the default."""

_TRACKER = "tracker"
"""What can be exported instead of a search."""


class Tracking(NamedTuple):
    """Period and limits of a tracker, as words."""

    period: float | None
    velocity: str | None
    acceleration: str | None
    jerk: str | None

    def tracker(self, arm: Arm) -> Tracker:
        """Return a tracker that starts at some joint values; the program starts wherever the arm is.

        Raises:
            InvalidProblem: Words that are not one number, or one for each joint.
        """
        given = {name: text for name, text in self._asdict().items() if isinstance(text, str)}
        read: dict[str, Any] = {name: limits(arm, text, f"--{name}") for name, text in given.items()}
        if self.period is not None:
            read["period"] = self.period
        return arm.track(arm.sample(1)[0], recover=False, **read)


_tracking_options = bundle(
    "tracking",
    Tracking,
    option(
        "--period",
        metavar="S",
        type=float,
        group="The tracker",
        help="Time between two steps, s; 0.002 by default.",
    ),
    *(
        option(
            f"--{name}",
            metavar="X...",
            shell_complete=complete_joints,
            group="The tracker",
            help=f"Limits of {name}, {unit}: one for all joints, one per joint, or JOINT=VALUE for every joint; by default "
            "those of the arm's file.",
        )
        for name, unit in (
            ("velocity", "rad/s or m/s"),
            ("acceleration", "rad/s² or m/s²"),
            ("jerk", "rad/s³ or m/s³"),
        )
    ),
)


@click.command(
    "export",
    cls=Command,
    examples=["kinseek export scara4 --to c --folder scara4_c --position-only --at 0.3 -0.1 0.2 --breadth 2"],
)
@option("--to", metavar="c", required=True, help="Language of the generated files.")
@option(
    "--folder",
    type=click.Path(path_type=Path),
    metavar="FOLDER",
    help="Output folder, created if it does not exist. Default: ARM_c.",
)
@option(
    "--target",
    metavar="NAME",
    default="x86-64",
    shell_complete=complete(lambda: TARGETS),
    help=f"Kind of processor: {', '.join(TARGETS)}.",
)
@option("--cpu", metavar="NAME", help="Processor of that kind, by its name in LLVM.")
@option(
    "--form",
    metavar="WORD",
    default="object",
    help="Form of the kernels: object, assembly or llvm (LLVM assembly).",
)
@option("--ram", metavar="BYTES", help="Limit of static memory, e.g. 65536, 64k or 1M.")
@option("--flash", metavar="BYTES", help="Limit of the size of kernels and constants.")
@option(
    "--solver",
    metavar="NAME",
    default=_EXPORTED[0],
    shell_complete=complete(lambda: (*_EXPORTED, _TRACKER)),
    help=f"Search: {' or '.join(_EXPORTED)}; the atlas needs 3 to 4 MB of flash. Or {_TRACKER}, which follows poses.",
)
@pose_options
@option(
    "--position-only",
    is_flag=True,
    group=GOAL,
    help="Any orientation is allowed, here and in the exported program.",
)
@option("--deg", is_flag=True, group=GOAL, help="--rpy and --rotvec are in degrees.")
@robot_options
@_tracking_options
@search_options(_EXPORTED)
def command(
    to: str,
    folder: Path | None,
    target: str,
    cpu: str | None,
    form: str,
    ram: str | None,
    flash: str | None,
    solver: str,
    words: PoseWords,
    position_only: bool,
    deg: bool,
    robot: Robot,
    tracking: Tracking,
    **more: Any,
) -> int:
    """Write an arm as C and machine code for a small controller: forward kinematics, and a search or a tracker.

    The program solves the goal of --at, or without --at a pose that the arm can reach. With a tracker it follows a pose that
    moves.
    """
    if to != "c":
        raise InvalidExport(suggest(to, ["c"], "language"))
    loaded = robot.load()
    goal = None
    if words.given or position_only:
        pose = words.target(position_only, deg)
        goal = Goal.position(pose[:3, 3]) if position_only else Goal.pose(pose)
    search = _search(solver, loaded, tracking, more)
    place = checked_folder(folder or _folder_of(loaded.name))
    parts = prepare(
        loaded,
        target,
        cpu=cpu,
        search=search,
        goal=goal,
        form=form,
        ram=size(ram, "--ram"),
        flash=size(flash, "--flash"),
        notice=complain,
    )
    complain(str(parts))  # Before anything is written, and what goes to stdout waits for the end.
    parts.write(place, named=folder is not None)
    report.print_parts(place, parts)
    return 0


def _search(
    solver: str, arm: Arm, tracking: Tracking, more: dict[str, Any]
) -> DivideAndConquer | Atlas | Tracker:
    """Return the search or the tracker to export.

    Raises:
        InvalidExport: An unknown search, or an option of another one.
    """
    if solver not in (*_EXPORTED, _TRACKER):
        raise InvalidExport(suggest(solver, (*_EXPORTED, _TRACKER), "search for a controller"))
    of_a_search = [name for name, value in more.items() if value is not None]
    of_a_tracker = [name for name, value in tracking._asdict().items() if value is not None]
    if solver == _TRACKER:
        if of_a_search:
            raise InvalidExport(
                f"{_TRACKER} has no option {option_of(of_a_search[0])}: it is one of a search"
            )
        return tracking.tracker(arm)
    if of_a_tracker:
        raise InvalidExport(f"{option_of(of_a_tracker[0])} needs --solver {_TRACKER}, got {solver}")
    return cast("DivideAndConquer | Atlas", make_search(solver, more))


def _folder_of(name: str) -> Path:
    """The folder in the working folder that is named after an arm.

    Raises:
        InvalidExport: It is a link, or belongs to another user: this user has named neither of them.
    """
    place = Path(re.sub(r"[^\w.-]", "_", name) + "_c")
    try:
        status = place.lstat()
    except OSError:  # Nothing is there, or what writes it reports the error.
        return place
    if stat.S_ISLNK(status.st_mode):
        raise InvalidExport(f"{str(place)!r} is a link; name the folder with --folder")
    if hasattr(os, "geteuid") and status.st_uid != os.geteuid():
        raise InvalidExport(f"{str(place)!r} belongs to another user; name a folder with --folder")
    return place
