"""What is written of a measurement: a page with every question, and the two pages that the repository keeps."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import pandas as pd

from benchmarks.command import HERE
from benchmarks.page import Page, Row
from benchmarks.workers.process import HANG

from .judge import ARMS
from .questions import SLICES
from .tables import HOST, NONE, Shown, best_settings, collect, marked, number, ratio, share, summed
from .tables import write as write_tables
from .tasks import DONE, Field
from .wins import BEYOND, wins

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


def write(field: Field, keep: bool = False) -> None:
    """Write the tables and the page of the pieces that are there, and the pages that the repository keeps if `keep`."""
    answers, known = collect(field)
    if known.empty:
        raise SystemExit(f"nothing measured yet in {field.folder}")
    write_tables(field, answers, known)
    shown = Shown.of(field, marked(answers), known)
    every_question(shown).write(field.folder / "index.md")
    if keep:
        if not field.size.questions:
            summary(_made_by(field), shown.answers, shown.names, _wins(shown)).write(PAGE)
        speed(_made_by(field), shown.answers, shown.names, reasons(shown)).write(SPEED)


def _made_by(field: Field) -> str:
    return f"benchmarks.field --{field.size.name}".removesuffix(" --full")


def _wins(shown: Shown) -> list[str]:
    return wins(shown.answers, shown.facts, shown.names, shown.branches)


def summary(made_by: str, answers: pd.DataFrame, names: dict[str, str], won: list[str]) -> Page:
    """The page in short.

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
    made.items(
        won, f"{'Nowhere in what' if HOST in names else 'kinseek is not among what'} was measured here."
    )
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
        rows += [
            _speed_row(arm, solver, names[solver], by.get(solver, {}), reasons) for solver in order if by
        ]
    made.rows(rows, show=False)
    return made


def _speed_row(
    arm: str, solver: str, name: str, by: dict[str, Any], reasons: dict[tuple[str, str], str]
) -> Row:
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


def every_question(shown: Shown) -> Page:
    """The summary, and after it a table for each question, each arm, and what is missing."""
    made = summary(_made_by(shown.field), shown.answers, shown.names, _wins(shown))
    for question in shown.field.questions:
        rows = [_figures(question.name, row, own, shown) for row, own in shown.groups(question.name)]
        if rows:
            made.head(question.title)
            made.rows(rows, show=False)
    made.head("Random poses, arm by arm")
    random = shown.answers[shown.answers["question"] == "random"]
    by_arm = summed(random, ["arm", "solver", "settings"]).to_dict("records") if len(random) else []
    made.rows(({"arm": row["arm"]} | _figures("", row, random, shown) for row in by_arm), show=False)
    made.head("The solvers and their settings")
    made.rows(_solvers(shown), show=False)
    made.head("Missing measurements, and why")
    made.items(_missing(shown))
    return made


def _figures(question: str, row: dict[str, Any], own: pd.DataFrame, shown: Shown) -> Row:
    """One solver with one set of settings: what `summed` gives, and what counts for a question alone."""
    cells: Row = {"solver": shown.names[row["solver"]], "settings": row["settings"], ">arms": row["arms"]}
    if question == "unreachable":
        cells |= {
            ">reports it %": number(100 * (~own["believed"]).mean()),
            ">returns joint values %": number(100 * own["position_error"].notna().mean()),
            ">nearest, excess %": number(own["excess"].median()),
        }
    elif question == "branches":
        each = shown.branches[shown.branches["solver"] == row["solver"]]
        cells |= {
            ">found of known %": number(100 * each["found"].sum() / each["known"].sum(), 4),
            ">poses with all known %": number(100 * (each["found"] == each["known"]).mean(), 4),
        }
    else:
        cells |= {">exact %": share(row), ">1 mm %": f"{row['near']:.1f}", ">false": row["false"]}
    if question == "start":
        near = own[own["near"]]
        farther = near["moved"] > 2 * near["needed"] + 1e-3
        cells[">of these twice as far from the start as needed %"] = number(100 * farther.mean())
    times = {f">{name} µs": number(row[name]) for name in ("median", "p99", "worst")}
    return cells | {">asked": row["count"], ">× kinseek": ratio(row)} | times


def _solvers(shown: Shown) -> Iterator[Row]:
    """Versions, settings, and what a solver weighs."""
    for solver, each in shown.about.items():
        versions = shown.known.loc[shown.known["solver"] == solver].get("version", pd.Series(dtype=str))
        facts = shown.facts.loc[solver] if solver in shown.facts.index else pd.Series(dtype=float)
        settings = each.get("settings", {})
        yield {
            "solver": shown.names[solver],
            "version": ", ".join(text for text in versions.dropna().unique() if text),
            "recommended": settings.get("recommended", NONE),
            "best": settings.get("best", NONE),
            ">first answer s": number(facts.get("first")),
            ">memory MB": number(facts.get("memory")),
            ">on disk MB": number(facts.get("megabytes")),
        }


def _missing(shown: Shown) -> Iterator[str]:
    """Solvers and questions without a measurement, and calls that raised."""
    known, names = shown.known, shown.names
    for solver, each in shown.about.items():
        if each["state"] != DONE:
            yield f"**{names[solver]}**: {each['state']}."
    best = best_settings(known["solver"], shown.about)
    known = known[(known["settings"] == "recommended") | (known["settings"] == best)]
    left = known[known["state"] != DONE].assign(why=lambda rows: rows["state"].map(_why))
    for (solver, why), rows in left.groupby(["solver", "why"], sort=False):
        asked, arms = ", ".join(rows["question"].unique()), rows["arm"].nunique()
        yield f"**{names[solver]}**: {why} ({asked}; {arms} {'arm' if arms == 1 else 'arms'})."
    if "raised" in known:
        raised = known.groupby("solver", sort=False)["raised"].sum()
        calls = ", ".join(f"{names[str(solver)]} {int(count)}" for solver, count in raised.items() if count)
        if calls:
            yield f"Calls that raised an exception, which count as failures: {calls}."


def reasons(shown: Shown) -> dict[tuple[str, str], str]:
    """Why there is no time: by solver and arm, and by solver and "" if it was not installed."""
    found = {
        (solver, ""): str(each["state"]) for solver, each in shown.about.items() if each["state"] != DONE
    }
    random = shown.known[(shown.known["question"] == "random") & (shown.known["state"] != DONE)]
    return found | {(str(row.solver), str(row.arm)): _why(str(row.state)) for row in random.itertuples()}


def _why(state: str) -> str:
    """A state without the numbers that differ from arm to arm."""
    state = re.sub(rf"^{HANG}: .*", HANG, state)
    state = re.sub(r"^ends with (\d+).*", r"the process ends with \1", state)
    return re.sub(r"^\d+ of \d+ in .*", "time was up before every target was asked", state)
