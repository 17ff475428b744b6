"""``--help`` of a command, laid out as a manual page: what it does, its options by group, examples that run."""

from __future__ import annotations

import re
import shutil
import textwrap
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import click

_WIDEST, _TWO_COLUMNS = 100, 70
"""Letters in a line at most, and from how many on names and their meaning stand side by side."""
_NAMES = 28
"""Letters of the column of names."""

Decorated = TypeVar("Decorated", bound=Callable[..., Any])


class Option(click.Option):
    """An option that belongs to a group, and whose help may be made when it is asked for."""

    def __init__(
        self, *args: Any, group: str = "Options", later: Callable[[], str] | None = None, **rest: Any
    ) -> None:
        """Keep the group, and what makes the help."""
        super().__init__(*args, **rest)
        self.group, self._later = group, later

    def get_help_record(self, ctx: click.Context) -> tuple[str, str] | None:
        """Its name and its help."""
        if self._later is not None:
            self.help = self._later()
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
        """Keep what help needs: examples, arguments with their meaning, and further paragraphs."""
        super().__init__(*args, **rest)
        self.examples, self._arguments, self._more = tuple(examples), tuple(arguments), tuple(more)

    def get_help(self, ctx: click.Context) -> str:
        """Lay the help out as wide as the terminal is."""
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
    """Declare an option of a command; `group` and `later` as `Option` takes them."""
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
    """Letters in a line of help; on a pipe as many as COLUMNS says, or 80."""
    return min(shutil.get_terminal_size().columns, _WIDEST)


def paragraph(text: str, width: int) -> str:
    """Break a text into lines."""
    return _filled(" ".join(text.split()), width, "", "")


def definitions(rows: Sequence[tuple[str, str]], width: int) -> str:
    """Names and what they mean: side by side where there is room, else the meaning below the name."""
    side_by_side = width >= _TWO_COLUMNS
    lines, gap = [], " " * (_NAMES + 4 if side_by_side else 6)
    for name, text in rows:
        if side_by_side and len(name) <= _NAMES:
            lines.append(_filled(text, width, f"  {name:{_NAMES}}  ", gap))
        else:
            lines += [_filled(name, width, "  ", "    "), _filled(text, width, gap, gap)]
    return "\n".join(lines)


def _command_line(words: str, width: int) -> str:
    """A command to be copied: it is broken before options, and a shell reads on."""
    kept = re.sub(r" (?!--)", "\N{NO-BREAK SPACE}", words)
    lines = _filled(kept, width - 2, "  ", "      ").splitlines()
    return " \\\n".join(lines).replace("\N{NO-BREAK SPACE}", " ")


def _filled(text: str, width: int, first: str, rest: str) -> str:
    return textwrap.fill(
        text,
        width,
        initial_indent=first,
        subsequent_indent=rest,
        break_long_words=False,
        break_on_hyphens=False,
    )
