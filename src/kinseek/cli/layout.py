"""Tables and sentences that fit the width of the terminal; in a pipe, one row per line with nothing cut.

If a row is wider than the terminal, its cells continue in the next line, indented. A cell that is still wider is wrapped at
its blanks. So nothing is cut off, however narrow the terminal is.
"""

from __future__ import annotations

import shutil
import sys
import textwrap
from collections.abc import Sequence
from unicodedata import east_asian_width

from kinseek.printable import printable

_GAP = "  "
"""Space between two columns."""
_SECOND = "\ue000"
"""The second column of a wide letter, while lines are laid out; `printable` leaves none in a name."""
_INDENT = "  "
"""Indentation of continuation lines."""


def terminal_width() -> int | None:
    """Return the width of the terminal that is written to; None for other streams, whose lines are not limited."""
    return shutil.get_terminal_size().columns if sys.stdout is not None and sys.stdout.isatty() else None


def table(
    columns: Sequence[str],
    rows: Sequence[Sequence[str]],
    width: int | None,
    blocks: Sequence[int] | None = None,
) -> str:
    """Lay out a table.

    Args:
        columns: Their names, in several lines if that is narrower; a name that starts with > is right-aligned. Without any
            name there is no header.
        rows: Cells, as many as there are columns; each is one line.
        width: Width of a line, or None: every row is one line.
        blocks: Numbers of neighbouring columns that stay together when a row is wrapped; by default each column is separate.
    """
    right = [name.startswith(">") for name in columns]
    names = [name.removeprefix(">") for name in columns]
    rows = [[_widened(printable(cell)) for cell in row] for row in rows]
    heads = [name.replace("\n", " ").splitlines() if width is None else name.splitlines() for name in names]
    tall = max(map(len, heads))
    header = [[([""] * tall + head)[k - tall] for head in heads] for k in range(tall)]
    lines = [*header, *rows]
    wide = [max(len(line[i]) for line in lines) for i in range(len(names))]
    groups = _groups(wide, width, blocks or [1] * len(wide))

    def laid(line: Sequence[str], g: int) -> str:
        cells = [line[i].rjust(wide[i]) if right[i] else line[i].ljust(wide[i]) for i in groups[g]]
        before = sum(wide[i] + len(_GAP) for i in groups[g][:-1]) + (len(_INDENT) if g else 0)
        return _broken((_INDENT if g else "") + _GAP.join(cells).rstrip(), before, width)

    numbers = range(len(groups))
    top = [laid(line, g) for g in numbers for line in header]
    return "\n".join([*top, *(laid(line, g) for line in rows for g in numbers)]).replace(_SECOND, "")


def sentence(text: str, width: int | None) -> str:
    """Wrap a sentence at its blanks."""
    text = printable(text)
    return text if width is None else wrapped(_widened(text), width, _INDENT).replace(_SECOND, "")


def _widened(text: str) -> str:
    """Add a mark after every letter that takes two columns of a terminal, so that lengths are numbers of columns.

    These are the wide and fullwidth letters of *Unicode Standard Annex 11*, such as those of Chinese and Japanese.
    """
    if text.isascii():
        return text
    return "".join(letter + _SECOND if east_asian_width(letter) in "WF" else letter for letter in text)


def _groups(wide: Sequence[int], width: int | None, blocks: Sequence[int]) -> list[list[int]]:
    """Return which columns share a line."""
    groups: list[list[int]] = [[]]
    used, first = 0, 0
    for count in blocks:
        block = range(first, first + count)
        first += count
        letters = sum(wide[i] for i in block) + len(_GAP) * (count - 1)
        more = letters + (len(_GAP) if groups[-1] else 0)
        # The last column, if it is text, may be wrapped in place, but not into a narrow ribbon.
        fits = width is None or used + more <= width or _ribbon(first - 1, wide, used, width)
        if groups[-1] and not fits:
            groups.append([])
            used, more = len(_INDENT), letters
        groups[-1] += block
        used += more
    return groups


def _ribbon(i: int, wide: Sequence[int], used: int, width: int) -> bool:
    return i == len(wide) - 1 and wide[i] > width // 2 and width - used - len(_GAP) >= 40


def _broken(text: str, before: int, width: int | None) -> str:
    """Wrap a line, with the rest of its last cell below the cell's beginning if there is space."""
    if width is None or len(text) <= width:
        return text
    return wrapped(text, width, " " * before if width - before >= 30 else _INDENT)


def wrapped(text: str, width: int, indent: str = "") -> str:
    """Wrap a line at blanks, the further lines indented; blanks inside it stay."""
    return textwrap.fill(
        text,
        width,
        subsequent_indent=indent,
        break_long_words=False,
        break_on_hyphens=False,
        drop_whitespace=True,
        replace_whitespace=False,
    )
