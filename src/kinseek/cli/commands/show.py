"""``kinseek show``."""

from __future__ import annotations

import click

from kinseek.cli import report
from kinseek.cli.help import Command
from kinseek.cli.options import Robot, robot_options
from kinseek.robots import catalog_entry, catalog_names


@click.command(
    "show",
    cls=Command,
    examples=["kinseek show ur5e", "kinseek show panda --base panda_link2 --tip panda_link5"],
)
@robot_options
def command(robot: Robot) -> int:
    """Show the joints, limits, speeds and reach of an arm."""
    known = robot.arm in catalog_names() and not robot.limits
    limits = catalog_entry(robot.arm).limits if known else ""
    report.print_arm(robot.load(), limits)
    return 0
