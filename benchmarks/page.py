"""Writes all pages of this folder: title, machine and load, paragraphs, tables and lists."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import kinseek

from .command import ROOT
from .pages import mark_of
from .targets import Array, load, machine
from .workers.environments import digest

Row = dict[str, object]
"""Cells of a line of a table by the names of its columns; a name that starts with > is set flush right."""

Flags = NDArray[np.bool_]

KEPT = ROOT / "build" / "benchmarks"
"""Where finished parts of a page are kept."""


class Page:
    """A page in Markdown, written from top to bottom."""

    def __init__(self, title: str, module: str, doc: str | None = None) -> None:
        """Begin with what made it.

        Args:
            title: Of the page.
            module: What makes it, as ``python -m`` takes it.
            doc: Docstring of that module; what it says before its commands is said on the page, too.
        """
        self._title, self._module = title, module
        self.note = ""
        """What else to say about the machine, in a line."""
        self._parts = [introduction(doc)] if doc else []

    def say(self, *lines: str) -> None:
        """A paragraph, in lines as they stand."""
        self._parts.append("\n".join(lines))

    def head(self, title: str) -> None:
        """The title of a section."""
        self._parts.append(f"## {title}")

    @contextmanager
    def section(self, title: str) -> Iterator[None]:
        """A section that ends with what it took, and with the machine's load after it."""
        self.head(title)
        began = time.perf_counter()
        yield
        took = time.perf_counter() - began
        self.say(f"*Measured in {took:.0f} s; load of the machine over the last fifteen minutes: {load()}.*")

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

    def rows(self, rows: Iterable[Mapping[str, object]], show: bool = True) -> list[Mapping[str, object]]:
        """A table of rows that name their cells; none if there are no rows.

        Args:
            rows: All have the same columns.
            show: Whether each is printed as soon as it is measured.

        Returns:
            The rows.
        """
        kept = []
        for row in rows:
            kept.append(row)
            if show:
                print(*(f"{name.lstrip('>')} {cell};" for name, cell in row.items()), flush=True)
        if kept:
            self.table(" | ".join(kept[0]), [tuple(row.values()) for row in kept])
        return kept

    def items(self, each: Iterable[str], none: str = "None.") -> None:
        """A list; where it is empty, the words for that."""
        self._parts.append("\n".join([f"- {item}" for item in each]) or none)

    @property
    def body(self) -> str:
        """All that follows its head."""
        return "\n\n".join(self._parts)

    @property
    def text(self) -> str:
        """All of it."""
        made = f"Made by `python -m {self._module}`. {machine()}."
        busy = f"Load of the machine over the last fifteen minutes: {load()}."
        mark = mark_of(self._module)
        head = "\n".join(line for line in (made, self.note, busy, mark) if line)
        return f"# {self._title}\n\n{head}\n\n{self.body}\n"

    def end(self, options: argparse.Namespace) -> None:
        """Write it where the options say, and say so; a quick one is printed."""
        if options.quick:
            print(self.text)
        else:
            self.write(options.output)

    def write(self, path: Path) -> None:
        """Write it, and say so."""
        path.write_text(self.text, encoding="utf-8")
        print(f"wrote {path}")


Part = Callable[[Page, argparse.Namespace], None]
"""Measures a part of a page, and writes it."""


def in_parts(
    title: str, module: str, doc: str | None, parts: Mapping[str, Part], options: argparse.Namespace
) -> None:
    """Make a page part by part; a part that is done is kept, so that what is stopped goes on there.

    Args:
        title: Of the page.
        module: What makes it, as ``python -m`` takes it.
        doc: Docstring of that module.
        parts: What the page consists of.
        options: `only` names parts that are measured anew; the page is written if the others are there.
    """
    page = Page(title, module, doc)
    sources = digest(*(path.read_bytes() for path in sorted(ROOT.glob("src/**/*.py"))))
    missing: list[str] = []
    folder, stamp = KEPT / module.rpartition(".")[2], f"<!-- {sources}, {machine()} -->\n"
    for name, measure in parts.items():
        place = folder / f"{name}.md"
        text = place.read_text(encoding="utf-8") if place.is_file() and not options.quick else ""
        if name in options.only or (not options.only and not text.startswith(stamp)):
            one = Page(title, module)
            measure(one, options)
            text = stamp + one.body
            if not options.quick:
                folder.mkdir(parents=True, exist_ok=True)
                place.with_suffix(".unfinished").write_text(text, encoding="utf-8")
                place.with_suffix(".unfinished").replace(place)
        if text.startswith(stamp):
            page.say(text.removeprefix(stamp))
        elif not options.quick:
            missing.append(name)
    if missing:
        print(f"no page yet: {', '.join(missing)} missing")
    else:
        page.end(options)


def introduction(doc: str) -> str:
    """What a docstring says before its commands, which are set in."""
    return doc.split("\n\n    python -m")[0].strip()


def row_of(cells: Iterable[object]) -> str:
    """A row of a table."""
    return f"| {' | '.join(map(str, cells))} |"


def missed(label: str, answer: kinseek.Solution, good: Flags, made_from: Array) -> list[str]:
    """A line for each target that is not reached; prints how many solutions claim what is not so.

    Args:
        label: Of the arm and the kind of targets.
        answer: The solutions of a batch of k targets.
        good: Which reach their target, by plain forward kinematics, (k,).
        made_from: Joint values that the targets were made from, (k, n), [rad] or [m].
    """
    claimed = np.asarray(answer.success)
    if (claimed != good).any():
        false, modest = (claimed & ~good).sum(), (good & ~claimed).sum()
        print(f"  {label}: {false} answers claim what outside FK denies, {modest} deny it")
    return [
        f"{label}, number {i}: {answer.position_error[i]:.1e} m, {answer.orientation_error[i]:.1e} rad; made from "
        f"q = {made_from[i].tolist()}"
        for i in np.flatnonzero(~good)
    ]


def share(good: Any, digits: int = 3) -> str:
    """Percent, rounded down, so that 100 is all of them."""
    scale = 10.0**digits
    # Rounding of the mean must not take a digit away.
    return f"{np.floor(100 * scale * np.mean(good) + 1e-6) / scale:.{digits}f}"


def list_misses(page: Page, misses: list[str]) -> None:
    """End a page with all targets that are missed, and with their number."""
    page.head(f"Misses: {len(misses)}")
    page.items(misses)
    print(f"{len(misses)} misses")
