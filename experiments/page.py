"""The tables of docs/paper.md, made from the CSVs: ``python -m experiments.page`` rewrites them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from . import choices, fraction, question_08
from .effort import Row
from .judges import Results

RESULTS = Path(__file__).resolve().parent / "results"
PAGE = RESULTS.parents[1] / "docs" / "paper.md"
TABLES: dict[str, tuple[str, Callable[[Sequence[Row]], str]]] = {
    "breadths": ("question_08", question_08.table),
    "fractions": ("fraction", fraction.table),
    "mixtures": ("fraction", fraction.mixtures_table),
    "choices": ("choices", choices.table),
    "walks": ("choices", choices.walks_table),
}
"""Of each table the experiment and the function that makes it of its rows."""


def rewritten(text: str, results: Results) -> str:
    """The page with every table made anew."""
    for name, (source, table) in TABLES.items():
        begin, end = f"<!-- {name}: made by python -m experiments.page -->", f"<!-- end of {name} -->"
        head, rest = text.split(begin, 1)
        text = f"{head}{begin}\n\n{table(results(source))}\n\n{end}{rest.split(end, 1)[1]}"
    return text


if __name__ == "__main__":
    PAGE.write_text(rewritten(PAGE.read_text(), Results(RESULTS)))
    print(f"{PAGE}: tables rewritten")
