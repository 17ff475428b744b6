"""The tables of README.md, made from the CSVs: ``python -m experiments claims`` rewrites them."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from . import judges
from .effort import EXPERIMENTS
from .judges import Results, Verdict
from .store import ExperimentError


@dataclass(frozen=True)
class Claim:
    """A sentence of the paper and the rule that judges it."""

    number: int
    section: str
    sentence: str
    source: str
    judge: Callable[[Results], Verdict]


CLAIMS = (
    Claim(
        1,
        "abstract, 4.2",
        "finds the best solution, in logarithmic time",
        "figure_11, claim_01",
        judges.claim_1,
    ),
    Claim(2, "3.1", "Eq. 1 is the number of nodes that brute force expands", "figure_05", judges.claim_2),
    Claim(
        3, "4.2", "brute force on 4 DOF at B = 60 expands over 10 million nodes", "figure_05", judges.claim_3
    ),
    Claim(4, "4.2", "time rises steeply with D and with DOF", "figure_06", judges.claim_4),
    Claim(
        5,
        "4.2",
        "the error tends to rise with D in 3 … 32; D = 3 is best",
        "figure_07, question_05",
        judges.claim_5,
    ),
    Claim(6, "4.2, 5", "a spike at D = 4, for 2 DOF alone", "question_06", judges.claim_6),
    Claim(
        7,
        "4.2",
        "at D = 180 and 360 the error falls and the time rises much",
        "figure_06, figure_07",
        judges.claim_7,
    ),
    Claim(
        8,
        "4.2",
        "CB(1) is worst by far, the others are near or below 1 mm",
        "figure_08, question_08",
        judges.claim_8,
    ),
    Claim(
        9,
        "4.2",
        "CB(1) is fastest by nearly ten times, CB(3) slowest by ten or more",
        "figure_09",
        judges.claim_9,
    ),
    Claim(10, "4.2, 5", "CB(2) and CB(3) show extreme errors at 2 DOF", "question_10", judges.claim_10),
    Claim(11, "4.2", "BT and DT + BT give the same answers", "figure_08", judges.claim_11),
    Claim(12, "4.2", "DT creates fewer nodes above B ≈ 10,000, more below", "figure_10", judges.claim_12),
    Claim(13, "4.2", "without DT it is slightly faster", "figure_11", judges.claim_13),
    Claim(
        14,
        "5",
        "6 DOF below 1 mm on average, in under 2 s",
        "figure_08, figure_09, question_08",
        judges.claim_14,
    ),
    Claim(15, "4.2", "the orientation error moves with the position error", "claim_15", judges.claim_15),
    Claim(16, "2.1", "an unreachable goal makes the arm point towards it", "claim_16", judges.claim_16),
    Claim(17, "5", "500 points of a 7-DOF arm take 10 s numerically (MATLAB)", "claim_17", judges.claim_17),
)

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
    lines = [
        "| # | section | the paper says | measured | verdict | from |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for claim in CLAIMS:
        measured, verdict = claim.judge(results)
        cells = (str(claim.number), claim.section, claim.sentence, measured, verdict, claim.source)
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def figures_table(results: Results) -> str:
    """All figures with the command, what the paper says, our picture and the verdicts, in Markdown."""
    lines = ["| figure | command | the paper says | ours | verdict |", "| --- | --- | --- | --- | --- |"]
    judge = {claim.number: claim.judge for claim in CLAIMS}
    for name, (sentence, numbers) in FIGURES.items():
        verdicts = "; ".join(f"({number}) {judge[number](results)[1]}" for number in numbers)
        ours = f"[picture](results/{name}.png), [rows](results/{name}.csv)"
        cells = (f"Fig. {int(name[-2:])}", f"`python -m experiments {name}`", sentence, ours, verdicts)
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def machine_table(results: Results) -> str:
    """Where the numbers come from, in Markdown."""
    lines = ["| experiment | rows | seconds | commit | processor |", "| --- | --- | --- | --- | --- |"]
    for name in EXPERIMENTS:
        told = json.loads((results.folder / f"{name}.json").read_text())
        cells = (name, told["rows"], told["seconds"], told["commit"][:10], told["processor"])
        lines.append("| " + " | ".join(map(str, cells)) + " |")
    return "\n".join(lines)


def rewritten(text: str, folder: Path) -> str:
    """The README with every table between its markers made anew."""
    results = Results(folder)
    for name, table in (("figures", figures_table), ("claims", claims_table), ("runs", machine_table)):
        begin, end = f"<!-- {name}: made by python -m experiments claims -->", f"<!-- end of {name} -->"
        if begin not in text or end not in text:
            raise ExperimentError(f"README.md lacks the markers of the table {name!r}")
        head, rest = text.split(begin, 1)
        tail = rest.split(end, 1)[1]
        text = f"{head}{begin}\n\n{table(results)}\n\n{end}{tail}"
    return text


def rewrite(folder: Path, readme: Path, page: Path) -> None:
    """Make the tables of a README anew from the CSVs of a folder, and write the whole of it to a page."""
    page.write_text(rewritten(readme.read_text(), folder))
