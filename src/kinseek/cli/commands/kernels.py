"""``kinseek kernels``."""

from __future__ import annotations

import click

from kinseek.cli.help import Command
from kinseek.kernels.backend import describe_backend


@click.command("kernels", cls=Command, examples=["kinseek kernels"])
def command() -> int:
    """Say how the compiled kernels run here: from the library built with the package, or by Numba."""
    print(describe_backend())
    return 0
