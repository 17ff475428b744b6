"""``kinseek completion``."""

from __future__ import annotations

import click
from click.shell_completion import get_completion_class

from kinseek.cli.help import Command, argument
from kinseek.errors import InvalidProblem, suggest

SHELLS = ("bash", "zsh", "fish")


@click.command(
    "completion",
    cls=Command,
    examples=["kinseek completion bash"],
    more=[
        'Load it in the file that the shell reads when it starts: eval "$(kinseek completion bash)" in ~/.bashrc, '
        'eval "$(kinseek completion zsh)" in ~/.zshrc, kinseek completion fish | source in '
        "~/.config/fish/config.fish."
    ],
)
@argument("shell", metavar="SHELL", help=f"{', '.join(SHELLS[:-1])} or {SHELLS[-1]}.")
def command(shell: str) -> int:
    """Print the script for a shell to complete commands, options, and names of arms, searches and joints."""
    if shell not in SHELLS:
        raise InvalidProblem(suggest(shell, SHELLS, "shell"))
    from kinseek.cli.program import COMPLETE, PROGRAM

    completion = get_completion_class(shell)
    assert completion is not None
    print(completion(PROGRAM, {}, "kinseek", COMPLETE).source())
    return 0
