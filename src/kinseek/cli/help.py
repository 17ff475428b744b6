"""``--help`` of a command, laid out as a manual page: what it does, its options by group, examples that run."""

from __future__ import annotations

import functools
import re
import shutil
import textwrap
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import click

from .layout import table, wrapped

_NARROWEST, _WIDEST = 40, 100
"""Range of the width of a line."""
_NAMES = 28
"""Least width of the column of names, so that the columns of most groups stand below each other."""

Decorated = TypeVar("Decorated", bound=Callable[..., Any])
Declaration = Callable[[Callable[..., Any]], Callable[..., Any]]


class Option(click.Option):
    """An option that belongs to a group, shows its default, and whose help may be made at its first use."""

    def __init__(
        self, *args: Any, group: str = "Options", lazy_help: Callable[[], str] | None = None, **rest: Any
    ) -> None:
        """Store the group, and the function that makes the help."""
        super().__init__(*args, **{"show_default": True, **rest})
        self.group, self._lazy_help = group, lazy_help

    def get_help_record(self, ctx: click.Context) -> tuple[str, str] | None:
        """Return its name and its help."""
        if self._lazy_help is not None:
            self.help = self._lazy_help()
        return super().get_help_record(ctx)


class Argument(click.Argument):
    """An argument with help."""

    group = "Arguments"

    def __init__(self, *args: Any, help: str, **rest: Any) -> None:
        """Store the help."""
        super().__init__(*args, **rest)
        self._help = help

    def get_help_record(self, ctx: click.Context) -> tuple[str, str]:
        """Return its name and its help."""
        return self.metavar or "", self._help


class Command(click.Command):
    """A command whose help has examples, and whose options are given once, unless they are made to be repeated."""

    def __init__(self, *args: Any, examples: Sequence[str], more: Sequence[str] = (), **rest: Any) -> None:
        """Store examples, and further paragraphs for the help."""
        super().__init__(*args, **rest)
        self.examples, self._more = tuple(examples), tuple(more)

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Read the words after the command.

        Raises:
            click.UsageError: An option is given twice, of which click would take the last value, or has an empty value, as
                of a variable of the shell that is not set.
        """
        if not ctx.resilient_parsing:  # Not for what is being typed.
            values, _, order = self.make_parser(ctx).parse_args(args=list(args))
            options = [
                each for each in order if isinstance(each, Option) and not (each.multiple or each.is_flag)
            ]
            if twice := next((each for each in options if options.count(each) > 1), None):
                raise click.UsageError(f"{twice.opts[-1]} is given twice, expected once", ctx)
            for each in order:
                value = values.get(each.name)
                words = value if isinstance(value, list) else [value]
                # A list of words may be separated by commas.
                if isinstance(each, Option) and any(
                    isinstance(one, str) and not one.strip(" ,") for one in words
                ):
                    raise click.UsageError(
                        f"{each.opts[-1]} is empty, expected {each.metavar or 'a value'}", ctx
                    )
        return super().parse_args(ctx, args)

    def get_help(self, ctx: click.Context) -> str:
        """Format the help for the width of the terminal."""
        groups: dict[str, list[tuple[str, str]]] = {Argument.group: []}
        for each in self.get_params(ctx):
            if record := each.get_help_record(ctx):
                name, text = record
                groups.setdefault(getattr(each, "group", "Options"), []).append((name.ljust(_NAMES), text))
        usage = f"Usage: {' '.join([ctx.command_path, *self.collect_usage_pieces(ctx)])}"
        title = "Examples" if len(self.examples) > 1 else "Example"
        lines = "\n".join(_command_line(example, help_width()) for example in self.examples)
        parts = [paragraph(text) for text in (usage, *(self.help or "").split("\n\n"))]
        parts += [definitions(name, rows) for name, rows in groups.items() if rows]
        parts += [paragraph(text) for text in self._more]
        return "\n\n".join([*parts, f"{title}:\n{lines}"])


def argument(name: str, **rest: Any) -> Callable[[Decorated], Decorated]:
    """Declare an argument of a command, with its help."""
    return click.argument(name, cls=Argument, **rest)


def option(*names: str, **rest: Any) -> Callable[[Decorated], Decorated]:
    """Declare an option of a command; `group` and `lazy_help` as in `Option`."""
    return click.option(*names, cls=Option, **rest)


def together(*options: Declaration) -> Declaration:
    """Declare several options at once, in this order."""

    def declare(command: Callable[..., Any]) -> Callable[..., Any]:
        for each in reversed(options):
            command = each(command)
        return command

    return declare


def bundle(name: str, kind: Any, *options: Declaration) -> Declaration:
    """Declare the options that are the fields of a named tuple; the command gets them as one argument of that name."""

    def declare(command: Callable[..., Any]) -> Callable[..., Any]:
        @functools.wraps(command)
        def called(**given: Any) -> Any:
            values = {field: given.pop(field) for field in kind._fields}
            return command(**{name: kind(**values)}, **given)

        return together(*options)(called)

    return declare


def help_width() -> int:
    """Return the width of help; on a pipe it follows the value of COLUMNS, or 80."""
    return min(max(shutil.get_terminal_size().columns, _NARROWEST), _WIDEST)


def paragraph(text: str) -> str:
    """Wrap a text into lines."""
    return wrapped(" ".join(text.split()), help_width())


def definitions(title: str, rows: Sequence[tuple[str, str]]) -> str:
    """Format names and their meaning below a title: side by side if there is space, otherwise the meaning below the name."""
    lines = table(("", ""), rows, help_width() - 2)
    return f"{wrapped(title, help_width() - 1)}:\n{textwrap.indent(lines, '  ')}"


def _command_line(words: str, width: int) -> str:
    """Format a command for copying: it is wrapped before options, with line continuations."""
    unbroken = re.sub(r" (?!--)", "\N{NO-BREAK SPACE}", f"  {words}")
    return wrapped(unbroken, width - 2, " " * 6).replace("\n", " \\\n").replace("\N{NO-BREAK SPACE}", " ")
