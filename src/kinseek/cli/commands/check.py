"""``kinseek check``."""

from __future__ import annotations

import click

from kinseek.cli import report
from kinseek.cli.help import Command
from kinseek.cli.options import Robot, json_option, robot_options
from kinseek.errors import InvalidProblem, InvalidRobot, suggest
from kinseek.robots import catalog_entry, catalog_names, catalog_path
from kinseek.robots.checks import Severity
from kinseek.robots.files import ENDINGS, home_path, instead_of_a_description
from kinseek.robots.soundness import check


@click.command(
    "check",
    cls=Command,
    examples=["kinseek check ur5e"],
    more=["Exit codes: 0 sound, or only notes; 1 errors or warnings; 2 the file cannot be read."],
)
@robot_options
@json_option
def command(robot: Robot, as_json: bool) -> int:
    """Check whether the description of a robot is sound, and print one line for each finding.

    An error is something that kinseek rejects, a warning is probably a mistake, a note is good to know. The check covers the
    tree of links, limits and soft limits, axes, mimic joints, kinds of joints, masses and inertias, and missing meshes. For
    a bundled arm, one more line gives the source of its limits and speeds.
    """
    for name in ("calibration", "srdf", "group"):
        if getattr(robot, name) is not None:
            raise InvalidProblem(f"--{name} is not checked: check reads the description of the robot alone")
    if isinstance(robot.limits, str):
        raise InvalidProblem("--limits FILE is not checked: check reads the description of the robot alone")
    arm = robot.arm
    path = catalog_path(arm) if arm in catalog_names() else home_path(arm)
    if path.suffix.lower() not in ENDINGS:
        if instead := instead_of_a_description(path):
            raise InvalidRobot(f"{arm!r} is {instead}; expected the path of a {', '.join(ENDINGS)} file")
        raise InvalidRobot(
            f"{suggest(arm, catalog_names(), 'robot')}. A path must end in {', '.join(ENDINGS)}"
        )
    found = check(path, robot.base, robot.tip, robot.args, robot.packages, not robot.untrusted, robot.limits)
    if arm in catalog_names():
        entry = catalog_entry(arm)
        found.add(Severity.WARNING if entry.differs else Severity.NOTE, "limits", entry.limits)
    report.print_checkup(arm, found, as_json)
    return 0 if found.sound else 1
