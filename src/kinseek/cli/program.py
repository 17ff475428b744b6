"""The program: its commands, and their execution. A command is imported when it is called."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from importlib import import_module
from typing import Any, cast

import click

import kinseek
from kinseek.errors import KinseekError, suggest

from .help import Option, definitions, paragraph
from .output import buffered_output, complain, forget, warnings_in_one_line, write_out
from .words import join_lists

COMMANDS = (
    "solve",
    "follow",
    "map",
    "show",
    "fk",
    "view",
    "robots",
    "check",
    "export",
    "kernels",
    "completion",
)
"""Commands in the order of ``--help``; each is a file in `commands` with its command in `command`."""

NO_THREAD = "can't start new thread"
"""What Python says if the system gives it no thread."""

COMPLETE = "_KINSEEK_COMPLETE"
"""Set by a shell that requests a completion."""


class Program(click.Group):
    """All commands, imported one at a time."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Their names."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import a command; return None if there is none of that name."""
        if cmd_name not in COMMANDS:
            return None
        return cast(click.Command, import_module(f".commands.{cmd_name}", __package__).command)

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the command that is called.

        Raises:
            UsageError: There is none of that name.
        """
        if args[0] not in COMMANDS and not args[0].startswith("-") and not ctx.resilient_parsing:
            raise click.UsageError(suggest(args[0], COMMANDS, "command"))
        return super().resolve_command(ctx, args)

    def get_help(self, ctx: click.Context) -> str:
        """Format the help for the width of the terminal."""
        commands = [self.get_command(ctx, name) for name in COMMANDS]
        rows = [(each.name or "", each.get_short_help_str(200)) for each in commands if each]
        options = [record for each in self.get_params(ctx) if (record := each.get_help_record(ctx))]
        more = "kinseek COMMAND --help shows the arguments, options and examples of a command."
        return "\n\n".join(
            [
                paragraph("Usage: kinseek COMMAND ..."),
                paragraph(self.help or ""),
                definitions("Commands", rows),
                definitions("Options", options),
                paragraph(more),
            ]
        )


def _version(ctx: click.Context, option: Any, requested: bool) -> None:
    if requested and not ctx.resilient_parsing:
        print(kinseek.__version__)
        ctx.exit()


PROGRAM = Program(
    "kinseek",
    help="Solve the inverse kinematics of serial robot arms. Exit codes: 0 done or reached, 1 not reached or check "
    "failed, 2 misuse or output that cannot be written, 130 stopped with Ctrl-C.",
    params=[
        Option(
            ["--version"],
            is_flag=True,
            is_eager=True,
            expose_value=False,
            callback=_version,
            help="Print the version and stop.",
        )
    ],
    context_settings={"help_option_names": ["-h", "--help"]},
)


def run(arguments: Sequence[str]) -> int:
    """Run one command line and return its exit code; an error becomes one line on stderr."""
    if COMPLETE in os.environ:  # A shell requests a completion; it expects bytes.
        PROGRAM.main([], prog_name="kinseek", complete_var=COMPLETE)
    with buffered_output() as buffer, warnings_in_one_line():
        code = _run(arguments)
    try:
        return write_out(buffer.getvalue(), code)
    except KeyboardInterrupt:  # While a pipe waits for its reader.
        forget(sys.stdout)
        return 130


def _run(arguments: Sequence[str]) -> int:
    try:
        words = join_lists(list(arguments)) or ["--help"]
        return int(PROGRAM.main(words, prog_name="kinseek", standalone_mode=False) or 0)
    except click.Abort:
        return 130
    except click.ClickException as error:
        complain(error.format_message())
    except KinseekError as error:
        complain(str(error))
    except OSError as error:  # The working folder is gone, for example.
        where = "" if error.filename is None else f"{os.fsdecode(error.filename)!r}: "
        complain(f"{where}{error.strerror or error}")
    except MemoryError as error:
        complain(f"not enough memory: {error}" if str(error) else "not enough memory")
    except RuntimeError as error:
        if str(error) != NO_THREAD:
            raise
        complain(f"not enough memory, or too many threads: {error}")
    return 2
