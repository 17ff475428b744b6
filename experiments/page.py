"""The tables of docs/paper.md and docs/paper_questions.md, made from the CSVs: ``python -m experiments.page``."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from . import choices, fraction, question_08
from .effort import Row
from .judges import Results
from .tables import replaced

RESULTS = Path(__file__).resolve().parent / "results"
DOCS = RESULTS.parents[1] / "docs"
PAGES: dict[Path, dict[str, tuple[str, Callable[[Sequence[Row]], str]]]] = {
    DOCS / "paper.md": {
        "fractions": ("fraction", fraction.table),
        "mixtures": ("fraction", fraction.mixtures_table),
    },
    DOCS / "paper_questions.md": {
        "breadths": ("question_08", question_08.table),
        "choices": ("choices", choices.table),
        "walks": ("choices", choices.walks_table),
    },
}
"""For each table of a page: the experiment, and the function that makes the table from its rows."""


def rewritten(page: Path, results: Results) -> str:
    """The text of a page with all of its tables made again."""
    text = page.read_text()
    for name, (source, table) in PAGES[page].items():
        text = replaced(text, name, "experiments.page", table(results(source)))
    return text


if __name__ == "__main__":
    for page in PAGES:
        page.write_text(rewritten(page, Results(RESULTS)))
        print(f"{page}: tables rewritten")
