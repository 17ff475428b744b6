"""Where another than kinseek does better, in sentences: what the page says first."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd

from .judge import LOOSE
from .questions import QUESTIONS
from .tables import HOST, TITLES, quantile_interval, summed

COMPARED = tuple(
    each.name for each in QUESTIONS if each.way in ("solve", "position", "start", "batch", "branches")
)

BEYOND = (
    "These differences exceed the 95 % intervals of both solvers, on arms that both support. Times are multiples of "
    "kinseek's time for the same targets, measured alternately; medians of the arms."
)
"""Applies to all sentences."""

SHOWN = 4
"""Arms that are named."""


def wins(
    answers: pd.DataFrame, facts: pd.DataFrame, names: dict[str, str], branches: pd.DataFrame | None = None
) -> list[str]:
    """A sentence for each question and each way to be better, and in it all who are.

    Args:
        answers: Marked.
        facts: A row a solver: `first` [s], `memory` [MB], `megabytes`.
        names: Of solvers, as they stand on the page.
        branches: What `distinct` makes of the answers to `branches`.
    """
    said: dict[tuple[str, str], list[str]] = {}
    ours_of = answers[answers["solver"] == HOST]
    for question in COMPARED:
        asked = answers[(answers["question"] == question) & (answers["solver"] != HOST)]
        ours = ours_of[ours_of["question"] == question]
        for key, theirs in asked.groupby(["solver", "settings"]):
            solver, settings = map(str, key)
            who = names[solver] if "and" in settings else f"{names[solver]} ({settings})"
            found = _fewer(branches, solver) if branches is not None and question == "branches" else {}
            for how, what in _compared(question, theirs, ours, found):
                said.setdefault((question, how), []).append(f"{who} {what}")
    told = [f"**{TITLES[question]}**, {how}: {'; '.join(whose)}." for (question, how), whose in said.items()]
    return [*told, *_false(ours_of), *_lighter(facts, names)]


def _compared(
    question: str, theirs: pd.DataFrame, ours: pd.DataFrame, branches: dict[str, int]
) -> Iterator[tuple[str, str]]:
    """How somebody is better, and where.

    Args:
        question: Its name.
        theirs: Answers.
        ours: Answers.
        branches: By arm, whether he finds more of all answers than kinseek (1), fewer (-1), or neither can be told (0).
    """
    arms = sorted(set(theirs["arm"]) & set(ours["arm"]))
    pairs = {arm: (_one(theirs[theirs["arm"] == arm]), _one(ours[ours["arm"] == arm])) for arm in arms}
    if not pairs:
        return
    if question == "unreachable":
        honest = theirs["believed"].mean() <= ours["believed"].mean()
        yield from _quicker("quicker", pairs, [arm for arm in arms if honest])
        yield from _nearer(theirs, ours)
        return
    if question == "branches":
        more = [arm for arm in arms if branches.get(arm, 0) > 0]
        level = [arm for arm in arms if branches.get(arm, 0) >= 0]
    else:
        more = [arm for arm, (they, we) in pairs.items() if they["exact_low"] > we["exact_high"]]
        level = [arm for arm, (they, we) in pairs.items() if they["exact_high"] >= we["exact_low"]]
    if more:
        what = "finds more of all answers" if question == "branches" else "more solved exactly"
        yield what, _on(more, arms)
    yield from _quicker("quicker and no fewer solved exactly", pairs, level)
    if question != "branches":
        loose = [arm for arm, (they, we) in pairs.items() if they["near_high"] >= we["near_low"]]
        rest = [arm for arm in loose if arm not in level]
        yield from _quicker(f"quicker and no fewer solved within {LOOSE * 1e3:g} mm", pairs, rest)
    if len(level) == len(arms):
        they, we = (_tail(each[each["arm"].isin(arms)]) for each in (theirs, ours))
        if they["high"] < we["low"]:
            how = "a shorter tail and no fewer solved exactly"
            yield how, f"{they['p99']:.2f} × kinseek's median against {we['p99']:.2f} × (p99)"


def _quicker(how: str, pairs: dict[str, Any], level: list[str]) -> Iterator[tuple[str, str]]:
    here = [arm for arm in level if pairs[arm][0]["ratio_high"] < 1.0]
    if here:
        ratio = np.median([pairs[arm][0]["ratio"] for arm in here])
        yield how, f"{ratio:.2f} × kinseek's time {_on(here, list(pairs))}"


def _nearer(theirs: pd.DataFrame, ours: pd.DataFrame) -> Iterator[tuple[str, str]]:
    one, other = (each["excess"].dropna() for each in (theirs, ours[ours["arm"].isin(theirs["arm"])]))
    if quantile_interval(one, 0.5)[1] < quantile_interval(other, 0.5)[0]:
        yield (
            "a nearer position",
            f"{one.median():.3g} % farther than the nearest known against {other.median():.3g}, with any orientation",
        )


def _tail(rows: pd.DataFrame) -> dict[str, float]:
    times = rows["relative"].dropna()
    low, high = quantile_interval(times, 0.99)
    return {"p99": times.quantile(0.99), "low": low, "high": high}


def _one(rows: pd.DataFrame) -> dict[str, Any]:
    found: dict[str, Any] = summed(rows, ["solver"]).iloc[0].to_dict()
    return found


def _fewer(branches: pd.DataFrame, solver: str) -> dict[str, int]:
    """By arm, who finds more of the answers to the poses that both were asked."""
    found = branches.pivot_table(index=["arm", "target"], columns="solver", values="found")
    if not {solver, HOST} <= set(found):
        return {}
    both = found[[solver, HOST]].dropna().groupby("arm").sum()
    return {str(arm): int(np.sign(row[solver] - row[HOST])) for arm, row in both.iterrows()}


def _on(some: list[str], every: list[str]) -> str:
    more = f" and {len(some) - SHOWN} more" if len(some) > SHOWN + 1 else ""
    named = ", ".join(some[:SHOWN] if more else some)
    return f"on {len(some)} of {len(every)} {'arm' if len(every) == 1 else 'arms'} ({named}{more})"


def _false(ours: pd.DataFrame) -> list[str]:
    """What is called a success and is none: not one should be, so that any of kinseek's stands here."""
    counted = ours.groupby("question", sort=False)["false"].sum() if len(ours) else pd.Series(dtype=int)
    where = ", ".join(
        f"{TITLES[str(question)].lower()} {count}" for question, count in counted.items() if count
    )
    return [f"**False successes** of kinseek: {where}."] if where else []


def _lighter(facts: pd.DataFrame, names: dict[str, str]) -> list[str]:
    said = []
    for column, what, unit in (
        ("first", "The first answer", "s"),
        ("memory", "Memory", "MB"),
        ("megabytes", "On disk", "MB"),
    ):
        if HOST not in facts.index or pd.isna(facts.loc[HOST, column]):
            continue
        ours = float(facts.loc[HOST, column])
        less = facts[(facts[column] < ours) & (facts.index != HOST)][column].sort_values()
        whose = ", ".join(f"{names[solver]} {value:.3g}" for solver, value in less.items())
        if whose:
            said.append(f"**{what}**, less than kinseek's {ours:.3g} {unit}: {whose}.")
    return said
