"""``kinseek export``."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import click

from kinseek.cli import report
from kinseek.cli.goals import PoseWords
from kinseek.cli.help import Command, option
from kinseek.cli.options import GOAL, Robot, complete, pose_options, robot_options
from kinseek.cli.output import complain
from kinseek.cli.searches import make_search, search_options
from kinseek.cli.words import size
from kinseek.errors import InvalidExport, suggest
from kinseek.export import TARGETS, checked_folder, prepare
from kinseek.goal import Goal

if TYPE_CHECKING:
    from kinseek.solvers.atlas.solver import Atlas
    from kinseek.solvers.divide_and_conquer import DivideAndConquer

_EXPORTED = ("divide-and-conquer", "atlas")
"""The searches that can be exported; the first is the default."""


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
    shell_complete=complete(lambda: _EXPORTED),
    help=f"Search: {' or '.join(_EXPORTED)}; the atlas needs 3 to 4 MB of flash.",
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
    **more: Any,
) -> int:
    """Write an arm as C and machine code for a small controller: forward kinematics, and a search.

    The program solves the goal of --at, or without --at a pose that the arm can reach.
    """
    if to != "c":
        raise InvalidExport(suggest(to, ["c"], "language"))
    loaded = robot.load()
    goal = None
    if words.given or position_only:
        pose = words.target(position_only, deg)
        goal = Goal.position(pose[:3, 3]) if position_only else Goal.pose(pose)
    if solver not in _EXPORTED:
        raise InvalidExport(suggest(solver, _EXPORTED, "search for a controller"))
    search = cast("DivideAndConquer | Atlas", make_search(solver, more))
    place = checked_folder(folder if folder is not None else _folder_of(loaded.name))
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
    parts.write(place)
    report.print_parts(place, parts)
    return 0


def _folder_of(name: str) -> Path:
    """The folder in the working folder that is named after an arm.

    Raises:
        InvalidExport: It is a link: the user named neither the link nor the folder that it leads to.
    """
    place = Path(re.sub(r"[^\w.-]", "_", name) + "_c")
    if place.is_symlink():
        raise InvalidExport(f"{str(place)!r} is a link; name the folder with --folder")
    return place
