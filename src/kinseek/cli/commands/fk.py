"""``kinseek fk``."""

from __future__ import annotations

import click

from kinseek.cli import report
from kinseek.cli.help import Command, option
from kinseek.cli.options import ARM, Chain, arm_argument, chain_options, json_option
from kinseek.cli.words import joint_values


@click.command(
    "fk",
    cls=Command,
    arguments=[ARM, ("Q...", "One value per joint, base to tip, rad or m; or JOINT=VALUE for every joint.")],
    examples=["kinseek fk planar2 0.3 -0.5", "kinseek fk scara4 90 -90 0.1 45 --deg --json"],
)
@arm_argument
@click.argument("q", metavar="Q...", nargs=-1)
@chain_options
@option("--deg", is_flag=True, help="Angles are in degrees.")
@json_option
def command(arm: str, q: tuple[str, ...], chain: Chain, deg: bool, as_json: bool) -> int:
    """Print the pose of the tip in the base at given joint values."""
    loaded = chain.load(arm)
    values = joint_values(loaded, " ".join(q), "fk", deg)
    report.print_pose(loaded, values, loaded.fk(values), as_json)
    return 0
