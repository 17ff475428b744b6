"""The tables of README.md, made from the CSVs: ``python -m experiments claims`` rewrites them."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from . import judges
from .effort import EXPERIMENTS
from .judges import Results, Verdict
from .tables import replaced, table


@dataclass(frozen=True)
class Claim:
    """A sentence of the paper and the rule that judges it."""

    number: int
    section: str
    sentence: str
    source: str
    judge: Callable[[Results], Verdict]
    reversal: str
    """What would change the verdict. A test changes the rows in this way."""


CLAIMS = (
    Claim(
        1,
        "abstract, 4.2",
        "finds the best solution, in logarithmic time",
        "figure_11, claim_01",
        judges.claim_1,
        "holds if CB(3) finds the best node for 99.5 % of the points on every grid; fails if it does not and the nodes "
        "of a pass grow with B",
    ),
    Claim(
        2,
        "3.1",
        "Eq. 1 is the number of nodes that brute force expands",
        "figure_05",
        judges.claim_2,
        "holds in part if one count differs by one node, fails if all do",
    ),
    Claim(
        3,
        "4.2",
        "brute force on 4 DOF at B = 60 expands over 10 million nodes",
        "figure_05",
        judges.claim_3,
        "fails at 10 million or fewer",
    ),
    Claim(
        4,
        "4.2",
        "time rises steeply with D and with DOF",
        "figure_06",
        judges.claim_4,
        "in part if the nodes of one arm grow five times or less from D = 3 to 32, or less than those of a smaller arm",
    ),
    Claim(
        5,
        "4.2",
        "the error tends to rise with D in 3 … 32; D = 3 is best",
        "figure_07, question_05",
        judges.claim_5,
        "holds if for one breadth the error rises on all three arms, and no D is better than 3 on any of them, both beyond "
        "the intervals; fails if fewer than half of these six conditions are met",
    ),
    Claim(
        6,
        "4.2, 5",
        "a spike at D = 4, for 2 DOF alone",
        "question_06",
        judges.claim_6,
        "holds if with K_P = K_A the error at D = 4 is 1.2 times that of its neighbours on this arm and on no other; fails "
        "if, under every weight that gives this arm a spike, another arm has one too",
    ),
    Claim(
        7,
        "4.2",
        "at D = 180 and 360 the error falls and the time rises much",
        "figure_06, figure_07",
        judges.claim_7,
        "in part if for one breadth the error at D = 360 is not below that at 32, or takes less than three times as long",
    ),
    Claim(
        8,
        "4.2",
        "CB(1) is worst by far, the others are near or below 1 mm",
        "figure_08, question_08",
        judges.claim_8,
        "holds if all others are below 1.5 mm and CB(1) is three times worse on every arm; fails if CB(1) is not the worst "
        "on one arm",
    ),
    Claim(
        9,
        "4.2",
        "CB(1) is fastest by nearly ten times, CB(3) slowest by ten or more",
        "figure_09",
        judges.claim_9,
        "holds if CB(1) is fastest and CB(3) slowest on every arm, and each of the two factors is met on one arm (the paper "
        "does not say on which); fails if none of these four conditions is met",
    ),
    Claim(
        10,
        "4.2, 5",
        "CB(2) and CB(3) show extreme errors at 2 DOF",
        "question_10, question_10_exchanged",
        judges.claim_10,
        "holds if under one reading CB(2) and CB(3) have extreme errors on two joints, and errors below 1.5 mm on the other "
        "arms; fails if they have extreme errors on two joints under no reading",
    ),
    Claim(
        11,
        "4.2",
        "BT and DT + BT give the same answers",
        "figure_08",
        judges.claim_11,
        "in part if one arm's answers differ in a bit",
    ),
    Claim(
        12,
        "4.2",
        "DT creates fewer nodes above B ≈ 10,000, more below",
        "figure_10",
        judges.claim_12,
        "holds if the curves of all four arms cross between 3,300 and 30,000, fails if none does",
    ),
    Claim(
        13,
        "4.2",
        "without DT it is slightly faster",
        "objects, figure_11",
        judges.claim_13,
        "in part if the lower quartile of the ratios falls to 1.02, fails if the median does",
    ),
    Claim(
        14,
        "5",
        "6 DOF below 1 mm on average, in under 2 s",
        "figure_08, figure_09, question_08, objects",
        judges.claim_14,
        "holds if CB(3) or DT + BT is below both limits at K_P = K_A; fails if no weight and breadth gives an error below "
        "1 mm, or if all that do take 2 s a point",
    ),
    Claim(
        15,
        "4.2",
        "no case of a high position error with a low orientation error, or vice versa",
        "claim_15",
        judges.claim_15,
        "holds if no point has one error high and the other low",
    ),
    Claim(
        16,
        "2.1",
        "an unreachable goal makes the arm point towards it",
        "claim_16",
        judges.claim_16,
        "holds if the mean angle is below 5° for whole poses too; fails if positions are not within 5°",
    ),
    Claim(
        17,
        "5",
        "one or two orders of magnitude slower than twists and exponentials (500 points of a 7-DOF arm in 10 s)",
        "objects, claim_17",
        judges.claim_17,
        "holds if the ratio lies between 10 and 100, fails if the search is as fast or a thousand times slower",
    ),
    Claim(
        18,
        "2.1",
        "a larger branching factor gives greater precision",
        "claim_18",
        judges.claim_18,
        "holds if divide and conquer gains from B = 810 to a million on every arm; fails if brute force gains nothing in "
        "one step",
    ),
    Claim(
        19,
        "2.1",
        "breadth-first search is not possible; nodes with only some joints set make no sense",
        "claim_19",
        judges.claim_19,
        "holds if breadth first finds the best node of no grid",
    ),
    Claim(
        20,
        "4.2",
        "brute force on 2 DOF can handle B = 720 in a few seconds",
        "objects",
        judges.claim_20,
        "in part if node objects take ten seconds; fails if bare numbers take ten seconds too",
    ),
    Claim(
        21,
        "1",
        "Blind Search only works very close to its start",
        "claim_21",
        judges.claim_21,
        "holds if with fixed changes more than a tenth of the starts anywhere are stuck, and five times as many as of the "
        "near ones, on every arm; in part if on one arm",
    ),
    Claim(
        22,
        "5",
        "DaC can be improved by breaking up the arm into separate chains, in certain cases",
        "separate",
        judges.claim_22,
        "in part if for one arm and breadth one of the two errors, or the evaluations, are above those of the whole arm; "
        "fails if this is so for every arm and breadth",
    ),
    Claim(
        23,
        "3.2",
        "Br needs to be a whole number",
        "fraction",
        judges.claim_23,
        "holds if no half lies between its whole breadths; in part if some do not",
    ),
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
