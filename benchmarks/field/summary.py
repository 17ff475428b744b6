"""What the repository keeps of a run: a page in Markdown, of which the README's table is made."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pandas as pd

from benchmarks.page import Page

from .tables import summed
from .wins import BEYOND

PAGE = Path(__file__).resolve().parents[1] / "field.md"
SHOWN = ("ur5e", "panda", "iiwa14", "irb120", "kr6r900", "puma560")
"""Arms whose rows are kept, first one that all take; the others are in the Parquet files that the command writes."""


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
        "Single calls from Python, one thread, no start from the answer, each solver with the settings that did best in a",
        "small sweep. Exact: within 1e-6 m and 1e-6 rad by pinocchio's forward kinematics, and inside the limits; in",
        "brackets the 95 % interval. [How it is measured](../docs/field.md); the command writes all questions and all arms,",
        "as a page and as Parquet.",
    )
    made.head("Where others do better than kinseek")
    made.items(won, "Nowhere in what was measured here.")
    made.say(BEYOND)
    best = answers[answers["settings"] != "recommended"]
    made.head("All arms")
    whole = summed(best, ["solver", "question"]).set_index(["solver", "question"])
    rows, order = [], _by_time(whole, names)
    for solver in (each for each in order if each in whole.index):
        cells = [_share(whole, solver, question) for question in ("random", "singular", "limits")]
        by = whole.loc[(solver, "random")] if (solver, "random") in whole.index else None
        arms, median = (0, "–") if by is None else (int(by["arms"]), f"{by['median']:.1f}")
        rows.append((names[solver], arms, *cells, median, int(whole.loc[solver]["false"].sum())))
    made.table(
        "solver | >arms | >random poses, exact % | >near singularities | >at limits | >median µs | >false successes",
        rows,
    )
    made.head("Six arms")
    made.table(
        "arm | who | >median µs | >mean µs | >p99 µs | >exact % random | >exact % near singular | >asked",
        [row for arm in SHOWN for row in _of(arm, best[best["arm"] == arm], names, order)],
    )
    return made


def _share(whole: pd.DataFrame, solver: str, question: str) -> str:
    if (solver, question) not in whole.index:
        return "–"
    row = whole.loc[(solver, question)]
    return f"{row['exact']:.1f} ({row['exact_low']:.1f}–{row['exact_high']:.1f})"


def _by_time(whole: pd.DataFrame, names: dict[str, str]) -> list[str]:
    """Solvers, the quickest first."""
    times = {
        solver: whole.loc[(solver, "random"), "median"]
        for solver in names
        if (solver, "random") in whole.index
    }
    return sorted(names, key=lambda solver: (times.get(solver, float("inf")), solver))


def _of(arm: str, answers: pd.DataFrame, names: dict[str, str], order: list[str]) -> list[tuple[Any, ...]]:
    """Rows of an arm; who takes other arms and not this one has none of these numbers."""
    if answers.empty:
        return []
    by = summed(answers, ["solver", "question"]).set_index(["solver", "question"])
    rows: list[tuple[Any, ...]] = []
    for solver in order:
        if (solver, "random") not in by.index:
            rows.append((arm, names[solver], *["–"] * 6))
            continue
        random = by.loc[(solver, "random")]
        near = by.loc[(solver, "singular"), "exact"] if (solver, "singular") in by.index else None
        times = (f"{random[column]:.1f}" for column in ("median", "mean", "p99"))
        asked = int(random["count"])
        rows.append(
            (
                arm,
                names[solver],
                *times,
                f"{random['exact']:.1f}",
                "–" if near is None else f"{near:.1f}",
                asked,
            )
        )
    return rows
