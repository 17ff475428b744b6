"""The tables of README.md and of docs/paper*.md, made from the CSVs: ``python -m experiments claims`` rewrites them."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

from . import choices, fraction, question_08
from .effort import EXPERIMENTS
from .judges import CLAIMS, Results
from .tables import replaced, table

FIGURES: dict[str, tuple[str, tuple[int, ...]]] = {
    "figure_05": ("brute force grows exponentially past ten million nodes, DaC stays far below", (2, 3)),
    "figure_06": ("time rises quickly with D and DOF", (4,)),
    "figure_07": ("error tends to rise with D, a spike at D = 4 for 2 DOF", (5, 6, 7)),
    "figure_08": ("CB(1) is far off, the rest near 1 mm; CB(2) and CB(3) are extreme at 2 DOF", (8, 10, 11)),
    "figure_09": ("CB(1) fastest, CB(3) slowest, a factor of ten each", (9,)),
    "figure_10": ("a straight line without DT, nearly flat with it; they cross near 10,000", (12,)),
    "figure_11": ("seven times slower while B grows 4.7 million times; slightly faster without DT", (1, 13)),
}


def claims_table(results: Results) -> str:
    """All claims with our measurement and the verdict, in Markdown."""
    rows = (
        (claim.number, claim.section, claim.sentence, *claim.judge(results), claim.source) for claim in CLAIMS
    )
    return table(("#", "section", "the paper says", "measured", "verdict", "from"), rows)


def reversals_table(results: Results) -> str:
    """What would change each verdict, in Markdown."""
    rows = ((claim.number, claim.judge(results)[1], claim.reversal) for claim in CLAIMS)
    return table(("#", "verdict", "what would change it"), rows)


def figures_table(results: Results) -> str:
    """All figures with the command, what the paper says, our picture and the verdicts, in Markdown."""
    rows = []
    verdicts = {claim.number: claim.judge(results)[1] for claim in CLAIMS}
    for name, (sentence, numbers) in FIGURES.items():
        told = "; ".join(f"({number}) {verdicts[number]}" for number in numbers)
        ours = f"[picture](results/{name}.png), [rows](results/{name}.csv)"
        rows.append((f"Fig. {int(name[-2:])}", f"`python -m experiments {name}`", sentence, ours, told))
    return table(("figure", "command", "the paper says", "ours", "verdict"), rows)


def machine_table(results: Results) -> str:
    """Where the numbers come from, in Markdown."""
    runs = {name: json.loads((results.folder / f"{name}.json").read_text()) for name in EXPERIMENTS}
    rows = (
        (name, run["rows"], run["seconds"], run["commit"][:10], run["processor"])
        for name, run in runs.items()
    )
    return table(("experiment", "rows", "seconds", "commit", "processor"), rows)


ROOT = Path(__file__).resolve().parents[1]
PAGES: dict[str, dict[str, Callable[[Results], str]]] = {
    "experiments/README.md": {
        "figures": figures_table,
        "claims": claims_table,
        "reversals": reversals_table,
        "runs": machine_table,
    },
    "docs/paper.md": {
        "fractions": lambda results: fraction.table(results("fraction")),
        "mixtures": lambda results: fraction.mixtures_table(results("fraction")),
    },
    "docs/paper_questions.md": {
        "breadths": lambda results: question_08.table(results("question_08")),
        "choices": lambda results: choices.table(results("choices")),
        "walks": lambda results: choices.walks_table(results("choices")),
    },
}
"""The tables of each page by their names."""


def rewritten(page: str, results: Results) -> str:
    """The text of a page with every table between its markers made anew."""
    text = (ROOT / page).read_text()
    for name, make in PAGES[page].items():
        text = replaced(text, name, "experiments claims", make(results))
    return text


def rewrite(results: Results, folder: Path) -> None:
    """Make the tables of all pages anew, and write the pages below a folder."""
    for page in PAGES:
        (folder / page).parent.mkdir(parents=True, exist_ok=True)
        (folder / page).write_text(rewritten(page, results))
        print(f"{folder / page}: tables rewritten")
