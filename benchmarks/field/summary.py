"""What the repository keeps of a run: a page in short, and the page from which the README's table is made."""

from __future__ import annotations

from typing import Any

import pandas as pd

from benchmarks.command import HERE
from benchmarks.page import Page, Row

from .judge import ARMS
from .questions import SLICES
from .tables import NONE, ratio, share, summed
from .wins import BEYOND

PAGE, SPEED = HERE / "field.md", HERE / "speed.md"
SHOWN = ARMS[:6]
"""Arms of the table of speed; the others are in the Parquet files that the command writes."""

SHARES = {
    "random": ">random poses, exact %",
    "singular": ">near singularities",
    "limits": ">at limits",
}

COLUMNS = (
    "**median µs**: the time of one call from Python for one random reachable pose, in microseconds. Half of the calls are "
    "faster. One thread, no starting guess. It depends on the machine.",
    "**× kinseek**: how many times as long the solver takes as kinseek. The solvers are measured alternately on the same "
    f"slices of up to {200 // SLICES} poses, each in its own process, so a change of the machine's speed affects all of "
    "them. Each time is divided by kinseek's median time for the same slice; the number is the median of these ratios, "
    "so it differs from the quotient of the two medians. In brackets the 95 % interval, or a dash if fewer than five "
    "slices were reached.",
    "**mean µs**, **p99 µs**: the mean of all calls, and the time that one call in a hundred exceeds.",
    "**exact % random**: the share of the random poses that the solver reaches within 1e-6 m and 1e-6 rad, inside the "
    "limits, by the forward kinematics of pinocchio.",
    "**exact % near singular**: the same share for poses at or near a singularity of the arm.",
    "**poses**: how many random poses the solver got. Slow solvers get fewer.",
)


def summary(made_by: str, answers: pd.DataFrame, names: dict[str, str], won: list[str]) -> Page:
    """The page.

    Args:
        made_by: What made it, as ``python -m`` takes it.
        answers: Marked, with the settings named as on the page.
        names: Of solvers.
        won: Where others do better than kinseek, in sentences.
    """
    made = Page("Every solver, in short", made_by)
    made.say(
        "Single calls from Python, one thread, no starting guess, each solver with the settings that did best in a small",
        "sweep. Exact: within 1e-6 m and 1e-6 rad by pinocchio's forward kinematics, and inside the limits. × kinseek: the",
        "time divided by that of kinseek for the same targets, measured alternately. In brackets: 95 % intervals.",
        "[How it is measured](../docs/field.md); the command writes all questions and all arms, as a page and as Parquet.",
        "[Six arms one by one](speed.md).",
    )
    made.head("Where others do better than kinseek")
    made.items(won, "Nowhere in what was measured here.")
    made.say(BEYOND)
    best = answers[answers["settings"] != "recommended"]
    made.head("All arms")
    whole = _by(best)
    rows: list[Row] = []
    for solver in _by_time(whole, names):
        by = whole.get(solver, {})
        random = by.get("random")
        row: Row = {"solver": names[solver], ">arms": random["arms"] if random else 0}
        for question, column in SHARES.items():
            row[column] = share(by[question]) if question in by else NONE
        row[">median µs"] = f"{random['median']:.1f}" if random else NONE
        row[">× kinseek"] = ratio(random) if random else NONE
        row[">false successes"] = sum(each["false"] for each in by.values())
        if by:
            rows.append(row)
    made.rows(rows, show=False)
    return made


def speed(
    made_by: str, answers: pd.DataFrame, names: dict[str, str], reasons: dict[tuple[str, str], str]
) -> Page:
    """The page of six arms.

    Args:
        made_by: What made it, as ``python -m`` takes it.
        answers: Marked, with the settings named as on the page.
        names: Of solvers.
        reasons: Why there is no time, by solver and arm, or by solver and "".
    """
    made = Page("How fast, beside other solvers", made_by)
    made.say(
        "Each solver runs with the settings that did best in a small sweep on other poses. The README shows the medians and",
        "ratios of this table (`python -m benchmarks.speed_table`). [How it is measured](../docs/field.md).",
    )
    made.items(COLUMNS)
    best = answers[answers["settings"] != "recommended"]
    order, rows = _by_time(_by(best), names), list[Row]()
    for arm in SHOWN:
        by = _by(best[best["arm"] == arm])
        rows += [_row(arm, solver, names[solver], by.get(solver, {}), reasons) for solver in order if by]
    made.rows(rows, show=False)
    return made


def _row(arm: str, solver: str, name: str, by: dict[str, Any], reasons: dict[tuple[str, str], str]) -> Row:
    """A solver on an arm; one without a time has the reason instead."""
    row: Row = {"arm": arm, "solver": name}
    columns = (
        *(">median µs", ">× kinseek", ">mean µs", ">p99 µs"),
        *(">exact % random", ">exact % near singular", ">poses"),
    )
    if "random" not in by:
        why = reasons.get((solver, "")) or reasons.get((solver, arm), "not measured")
        return row | dict.fromkeys(columns, NONE) | {"": why.split(":")[0]}
    random = by["random"]
    figures = (
        *(f"{random['median']:.1f}", ratio(random), f"{random['mean']:.1f}", f"{random['p99']:.1f}"),
        f"{random['exact']:.1f}",
        f"{by['singular']['exact']:.1f}" if "singular" in by else NONE,
        random["count"],
    )
    return row | dict(zip(columns, figures, strict=True)) | {"": ""}


def _by(answers: pd.DataFrame) -> dict[str, dict[str, Any]]:
    """What `summed` gives, by solver and question."""
    found: dict[str, dict[str, Any]] = {}
    for row in summed(answers, ["solver", "question"]).to_dict("records"):
        found.setdefault(row["solver"], {})[row["question"]] = row
    return found


def _by_time(whole: dict[str, dict[str, Any]], names: dict[str, str]) -> list[str]:
    """Solvers, the quickest first."""

    def key(solver: str) -> tuple[float, str]:
        return whole.get(solver, {}).get("random", {}).get("median", float("inf")), solver

    return sorted(names, key=key)
