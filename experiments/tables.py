"""Tables in Markdown, and where they stand on a page."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from .store import ExperimentError


def table(columns: Sequence[object], rows: Iterable[Sequence[object]]) -> str:
    """A table of named columns."""
    lines = [columns, ["---"] * len(columns), *rows]
    return "\n".join(f"| {' | '.join(map(str, cells))} |" for cells in lines)


def replaced(text: str, name: str, made_by: str, table: str) -> str:
    """A page with another table between the two markers of its name.

    Raises:
        ExperimentError: The page has no such markers.
    """
    begin, end = f"<!-- {name}: made by python -m {made_by} -->", f"<!-- end of {name} -->"
    if begin not in text or end not in text:
        raise ExperimentError(f"the page has no markers of the table {name!r}")
    head, rest = text.split(begin, 1)
    return f"{head}{begin}\n\n{table}\n\n{end}{rest.split(end, 1)[1]}"
