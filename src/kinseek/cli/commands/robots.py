"""``kinseek robots``."""

from __future__ import annotations

import click

from kinseek.cli import report
from kinseek.cli.help import Command


@click.command("robots", cls=Command, examples=["kinseek robots"])
def command() -> int:
    """List the bundled arms."""
    report.print_robots()
    return 0
