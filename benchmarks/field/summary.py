"""What the repository keeps of a run: a page in short, and the page from which the README's table is made."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pandas as pd

from benchmarks.page import Page

from .judge import ARMS
from .questions import SLICES
from .tables import summed
from .wins import BEYOND

PAGE, SPEED = (Path(__file__).resolve().parents[1] / name for name in ("field.md", "speed.md"))
SHOWN = ARMS[:6]
"""Arms of the table of speed; the others are in the Parquet files that the command writes."""

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
    whole = summed(best, ["solver", "question"]).set_index(["solver", "question"])
    rows, order = [], _by_time(whole, names)
    for solver in (each for each in order if each in whole.index):
        cells = [_share(whole, solver, question) for question in ("random", "singular", "limits")]
        by = whole.loc[(solver, "random")] if (solver, "random") in whole.index else None
        arms, times = (
            (0, ("–", "–")) if by is None else (int(by["arms"]), (f"{by['median']:.1f}", _ratio(by)))
        )
        rows.append((names[solver], arms, *cells, *times, int(whole.loc[solver]["false"].sum())))
    made.table(
        "solver | >arms | >random poses, exact % | >near singularities | >at limits | >median µs | >× kinseek | "
        ">false successes",
        rows,
    )
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
    order = _by_time(summed(best, ["solver", "question"]).set_index(["solver", "question"]), names)
    made.table(
        "arm | solver | >median µs | >× kinseek | >mean µs | >p99 µs | >exact % random | >exact % near singular | >poses | ",
        [row for arm in SHOWN for row in _of(arm, best[best["arm"] == arm], names, order, reasons)],
    )
    return made


def _ratio(row: Any) -> str:
    digits = _digits(row["ratio"])
    low, high = (f"{row[each]:,.{digits}f}" for each in ("ratio_low", "ratio_high"))
    return f"{row['ratio']:,.{digits}f} ({'–' if row['ratio_high'] == float('inf') else f'{low}–{high}'})"


def _digits(ratio: float) -> int:
    return 2 if ratio < 10.0 else 1 if ratio < 100.0 else 0


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


def _of(
    arm: str,
    answers: pd.DataFrame,
    names: dict[str, str],
    order: list[str],
    reasons: dict[tuple[str, str], str],
) -> list[tuple[Any, ...]]:
    """Rows of an arm; a solver without a time has the reason instead."""
    if answers.empty:
        return []
    by = summed(answers, ["solver", "question"]).set_index(["solver", "question"])
    rows: list[tuple[Any, ...]] = []
    for solver in order:
        if (solver, "random") not in by.index:
            why = reasons.get((solver, "")) or reasons.get((solver, arm), "not measured")
            rows.append((arm, names[solver], *["–"] * 7, why.split(":")[0]))
            continue
        random = by.loc[(solver, "random")]
        near = f"{by.loc[(solver, 'singular'), 'exact']:.1f}" if (solver, "singular") in by.index else "–"
        times = (f"{random[column]:.1f}" for column in ("mean", "p99"))
        rows.append(
            (
                *(arm, names[solver], f"{random['median']:.1f}", _ratio(random), *times),
                *(f"{random['exact']:.1f}", near, int(random["count"]), ""),
            )
        )
    return rows
