"""``kinseek show``."""

from __future__ import annotations

import click

from kinseek.cli import report
from kinseek.cli.help import Command
from kinseek.cli.options import ARM, Chain, arm_argument, chain_options
from kinseek.robots import catalog_entry, catalog_names


@click.command(
    "show",
    cls=Command,
    arguments=[ARM],
    examples=["kinseek show ur5e", "kinseek show panda --base panda_link2 --tip panda_link5"],
)
@arm_argument
@chain_options
def command(arm: str, chain: Chain) -> int:
    """Show the joints, limits, speeds and reach of an arm."""
    report.print_arm(chain.load(arm), catalog_entry(arm).limits if arm in catalog_names() else "")
    return 0
