"""``kinseek fk``."""

from __future__ import annotations

import click

from kinseek.cli import report
from kinseek.cli.help import Command, argument, option
from kinseek.cli.options import Robot, json_option, robot_options
from kinseek.cli.words import joint_values


@click.command(
    "fk",
    cls=Command,
    examples=["kinseek fk planar2 0.3 -0.5", "kinseek fk scara4 90 -90 0.1 45 --deg --json"],
)
@robot_options
@argument(
    "q",
    metavar="Q...",
    nargs=-1,
    help="One value per joint, base to tip, rad or m; or JOINT=VALUE for every joint.",
)
@option("--deg", is_flag=True, help="Angles are in degrees.")
@json_option
def command(robot: Robot, q: tuple[str, ...], deg: bool, as_json: bool) -> int:
    """Print the pose of the tip in the base at given joint values."""
    loaded = robot.load()
    values = joint_values(loaded, " ".join(q), "fk", deg)
    report.print_pose(loaded, values, loaded.fk(values), as_json)
    return 0
