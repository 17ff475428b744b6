"""``kinseek kernels``."""

from __future__ import annotations

import click

from kinseek.cli.help import Command
from kinseek.kernels.backend import describe_backend


@click.command("kernels", cls=Command, examples=["kinseek kernels"])
def command() -> int:
    """Show which kernels are in use: the prebuilt library, Numba or Python."""
    print(describe_backend())
    return 0
