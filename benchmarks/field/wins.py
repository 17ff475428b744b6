"""Where another than kinseek does better, in sentences: what the page says first."""

from __future__ import annotations

from typing import Any

import pandas as pd

from .questions import QUESTIONS
from .tables import TITLES, summed

HOST = "kinseek"
"""Who makes the benchmark, and is therefore the last to be praised in it."""

COMPARED = tuple(
    each.name for each in QUESTIONS if each.way in ("solve", "position", "start", "batch", "branches")
)


def wins(answers: pd.DataFrame, facts: pd.DataFrame, names: dict[str, str]) -> list[str]:
    """Sentences; a difference counts beyond the 95 % intervals of both, on the same arms.

    Args:
        answers: Marked.
        facts: A row a solver: `first` [s], `memory` [MB], `megabytes`.
        names: Of solvers, as they stand on the page.
    """
    found = []
    for question in COMPARED:
        asked = answers[answers["question"] == question]
        ours = asked[asked["solver"] == HOST]
        for key, theirs in asked[asked["solver"] != HOST].groupby(["solver", "settings"]):
            solver, settings = map(str, key)
            found += _compared(question, f"{names[solver]} ({settings})", theirs, ours)
    return found + _lighter(facts, names)


def _compared(question: str, who: str, theirs: pd.DataFrame, ours: pd.DataFrame) -> list[str]:
    arms = sorted(set(theirs["arm"]) & set(ours["arm"]))
    pairs = [(arm, _one(theirs[theirs["arm"] == arm]), _one(ours[ours["arm"] == arm])) for arm in arms]
    said = []
    more = [arm for arm, they, we in pairs if they["exact_low"] > we["exact_high"]]
    if more and question != "unreachable":
        said.append(f"**{TITLES[question]}**: {who} solves more on {_of(more, arms)}.")
    level = [
        arm
        for arm, they, we in pairs
        if they["median_high"] < we["median_low"]
        and (question == "unreachable" or they["exact_high"] >= we["exact_low"])
    ]
    if level:
        here = [(they["median"], we["median"]) for arm, they, we in pairs if arm in level]
        they, we = (sum(each) / len(each) for each in zip(*here, strict=True))
        least = "" if question == "unreachable" else ", and solves no less"
        said.append(
            f"**{TITLES[question]}**: {who} is quicker on {_of(level, arms)}: {they:.3g} µs against {we:.3g}, means of "
            f"medians{least}."
        )
    return said


def _one(rows: pd.DataFrame) -> dict[str, Any]:
    found: dict[str, Any] = summed(rows, ["solver"]).iloc[0].to_dict()
    return found


def _of(some: list[str], every: list[str]) -> str:
    return f"{len(some)} of {len(every)} {'arm' if len(every) == 1 else 'arms'} ({', '.join(some)})"


def _lighter(facts: pd.DataFrame, names: dict[str, str]) -> list[str]:
    said = []
    for column, what, unit in (
        ("first", "answers first sooner", "s"),
        ("memory", "holds less memory", "MB"),
        ("megabytes", "takes less on disk", "MB"),
    ):
        if HOST not in facts.index or pd.isna(facts.loc[HOST, column]):
            continue
        ours = float(facts.loc[HOST, column])
        less = facts[(facts[column] < ours) & (facts.index != HOST)][column].sort_values()
        said += [
            f"**{names[solver]}** {what}: {value:.3g} {unit} against {ours:.3g}."
            for solver, value in less.items()
        ]
    return said
