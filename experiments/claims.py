"""The tables of README.md, made from the CSVs: ``python -m experiments claims`` rewrites them."""

from __future__ import annotations

import json
from pathlib import Path

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


TABLES = {
    "figures": figures_table,
    "claims": claims_table,
    "reversals": reversals_table,
    "runs": machine_table,
}
"""Tables of the README by their names."""


def rewritten(text: str, folder: Path) -> str:
    """The README with every table between its markers made anew."""
    results = Results(folder)
    for name, make in TABLES.items():
        text = replaced(text, name, "experiments claims", make(results))
    return text


def rewrite(folder: Path, readme: Path, page: Path) -> None:
    """Make the tables of a README anew from the CSVs of a folder, and write the whole of it to a page."""
    page.write_text(rewritten(readme.read_text(), folder))
