"""``--help`` of a command, laid out as a manual page: what it does, its options by group, examples that run."""

from __future__ import annotations

import re
import shutil
import textwrap
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import click

_WIDEST, _TWO_COLUMNS = 100, 70
"""Maximum width of a line, and width from which names and their meaning are side by side."""
_NAMES = 28
"""Width of the column of names."""

Decorated = TypeVar("Decorated", bound=Callable[..., Any])


class Option(click.Option):
    """An option that belongs to a group, and whose help may be made at its first use."""

    def __init__(
        self, *args: Any, group: str = "Options", lazy_help: Callable[[], str] | None = None, **rest: Any
    ) -> None:
        """Store the group, and the function that makes the help."""
        super().__init__(*args, **rest)
        self.group, self._lazy_help = group, lazy_help

    def get_help_record(self, ctx: click.Context) -> tuple[str, str] | None:
        """Return its name and its help."""
        if self._lazy_help is not None:
            self.help = self._lazy_help()
        return super().get_help_record(ctx)


class Command(click.Command):
    """A command whose help has examples."""

    def __init__(
        self,
        *args: Any,
        examples: Sequence[str] = (),
        arguments: Sequence[tuple[str, str]] = (),
        more: Sequence[str] = (),
        **rest: Any,
    ) -> None:
        """Store examples, arguments with their meaning, and further paragraphs for the help."""
        super().__init__(*args, **rest)
        self.examples, self._arguments, self._more = tuple(examples), tuple(arguments), tuple(more)

    def get_help(self, ctx: click.Context) -> str:
        """Format the help for the width of the terminal."""
        width = help_width()
        parts = [paragraph(f"Usage: {' '.join([ctx.command_path, *self.collect_usage_pieces(ctx)])}", width)]
        parts += [paragraph(text, width) for text in (self.help or "").split("\n\n")]
        if self._arguments:
            parts.append("Arguments:\n" + definitions(self._arguments, width))
        groups: dict[str, list[tuple[str, str]]] = {}
        for each in self.get_params(ctx):
            if isinstance(each, click.Option) and (record := each.get_help_record(ctx)):
                groups.setdefault(getattr(each, "group", "Options"), []).append(record)
        parts += [
            f"{paragraph(name, width - 1)}:\n{definitions(rows, width)}" for name, rows in groups.items()
        ]
        parts += [paragraph(text, width) for text in self._more]
        if self.examples:
            lines = "\n".join(_command_line(example, width) for example in self.examples)
            parts.append(f"{'Examples' if len(self.examples) > 1 else 'Example'}:\n{lines}")
        return "\n\n".join(parts)


def option(*names: str, **rest: Any) -> Callable[[Decorated], Decorated]:
    """Declare an option of a command; `group` and `lazy_help` as in `Option`."""
    return click.option(*names, cls=Option, **rest)


def together(
    *options: Callable[[Callable[..., Any]], Callable[..., Any]],
) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Declare several options at once, in this order."""

    def declare(command: Callable[..., Any]) -> Callable[..., Any]:
        for each in reversed(options):
            command = each(command)
        return command

    return declare


def help_width() -> int:
    """Return the width of help; on a pipe the value of COLUMNS, or 80."""
    return min(shutil.get_terminal_size().columns, _WIDEST)


def paragraph(text: str, width: int) -> str:
    """Wrap a text into lines."""
    return _filled(" ".join(text.split()), width, "", "")


def definitions(rows: Sequence[tuple[str, str]], width: int) -> str:
    """Format names and their meaning: side by side if there is space, otherwise the meaning below the name."""
    side_by_side = width >= _TWO_COLUMNS
    lines, gap = [], " " * (_NAMES + 4 if side_by_side else 6)
    for name, text in rows:
        if side_by_side and len(name) <= _NAMES:
            lines.append(_filled(text, width, f"  {name:{_NAMES}}  ", gap))
        else:
            lines += [_filled(name, width, "  ", "    "), _filled(text, width, gap, gap)]
    return "\n".join(lines)


def _command_line(words: str, width: int) -> str:
    """Format a command for copying: it is wrapped before options, with line continuations."""
    unbroken = re.sub(r" (?!--)", "\N{NO-BREAK SPACE}", words)
    lines = _filled(unbroken, width - 2, "  ", "      ").splitlines()
    return " \\\n".join(lines).replace("\N{NO-BREAK SPACE}", " ")


def _filled(text: str, width: int, first: str, rest: str) -> str:
    return textwrap.fill(
        text,
        max(width, 1),
        initial_indent=first,
        subsequent_indent=rest,
        break_long_words=False,
        break_on_hyphens=False,
    )
