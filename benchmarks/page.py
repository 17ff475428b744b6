"""Writes all pages of this folder: title, machine and load, paragraphs, tables and lists."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from .targets import load, machine


class Page:
    """A page in Markdown, written from top to bottom."""

    def __init__(self, title: str, module: str, minutes: float | None = None, note: str = "") -> None:
        """Begin with what made it and on which machine.

        Args:
            title: Of the page.
            module: What makes it, as ``python -m`` takes it.
            minutes: How long that took.
            note: What else to say about the machine.
        """
        taken = "" if minutes is None else f" in {max(minutes, 1):.0f} minute{'s' * (minutes >= 1.5)}"
        made = f"Made by `python -m {module}`{taken}. {machine()}."
        busy = f"Load of the machine over the last fifteen minutes: {load()}."
        self._parts = [f"# {title}", "\n".join([made, *([note] if note else []), busy])]

    def say(self, *lines: str) -> None:
        """A paragraph, in lines as they stand."""
        self._parts.append("\n".join(lines))

    def head(self, title: str) -> None:
        """The title of a section."""
        self._parts.append(f"## {title}")

    def table(self, columns: str, rows: Iterable[Sequence[object]]) -> None:
        """A table.

        Args:
            columns: Their names with | between them; one that starts with > is set flush right.
            rows: Cells, as many as there are columns.
        """
        names = [name.strip() for name in columns.split("|")]
        lines = [
            row_of(name.removeprefix(">") for name in names),
            "|" + "".join("--:|" if name.startswith(">") else "---|" for name in names),
        ]
        self._parts.append("\n".join([*lines, *(row_of(cells) for cells in rows)]))

    def rows(self, rows: Sequence[Mapping[str, object]]) -> None:
        """A table of rows that name their cells, all the same ones; none if there are no rows."""
        if rows:
            self.table(" | ".join(rows[0]), [tuple(row.values()) for row in rows])

    def items(self, each: Iterable[str], none: str = "None.") -> None:
        """A list; where it is empty, the words for that."""
        self._parts.append("\n".join([f"- {item}" for item in each]) or none)

    @property
    def body(self) -> str:
        """All that follows its head."""
        return "\n\n".join(self._parts[2:])

    @property
    def text(self) -> str:
        """All of it."""
        return "\n\n".join(self._parts) + "\n"

    def write(self, path: Path) -> None:
        """Write it, and say so."""
        path.write_text(self.text, encoding="utf-8")
        print(f"wrote {path}")


def row_of(cells: Iterable[object]) -> str:
    """A row of a table."""
    return f"| {' | '.join(map(str, cells))} |"


def percent(some: int, of: int) -> str:
    """Percent to three digits; 100.000 only if it is all of them."""
    return f"{np.floor(1e5 * some / of) / 1e3:.3f}"
