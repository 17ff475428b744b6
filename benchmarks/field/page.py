"""The page: written by the one writer of pages, turned into HTML with tables that are sorted by a click."""

from __future__ import annotations

import html
import re
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from benchmarks.command import ROOT
from benchmarks.page import Page
from benchmarks.workers.process import HANG

from . import plots
from .judge import LOOSE, LOOSE_TURN, STRICT
from .pieces import DONE
from .questions import QUESTIONS, SLICES, WRONG
from .summary import PAGE, SPEED, speed, summary
from .tables import TITLES, collect, distinct, marked, solvers, summed
from .tables import write as write_tables
from .tasks import Field
from .wins import BEYOND, HOST, wins

HERE = Path(__file__).resolve().parent
ADD, HIDDEN = ROOT / "docs" / "field.md", "<!-- needs: scipy -->\n"
"""What says how to add a solver, and what in it is for those who test it."""

NONE = "–"
TIGHT = f"{STRICT:g}".replace("e-0", "e-")
EACH = ("random", "singular", "limits", "position", "start")


def write(field: Field, keep: bool = False) -> None:
    """Write the tables and the page of the pieces that are there, and the pages that the repository keeps if `keep`."""
    answers, known = collect(field)
    if known.empty:
        raise SystemExit(f"nothing measured yet in {field.folder}")
    write_tables(field, answers, known)
    answers = marked(answers)
    text = page(field, answers, known).text
    place = field.folder / "index.html"
    place.write_text(as_html(text), encoding="utf-8")
    print(f"wrote {place}")
    if keep:
        shown, names, facts = told(field, answers, known)
        if not field.size.questions:
            won = wins(shown, facts, names, found_of(shown, field))
            summary(_made_by(field), shown, names, won).write(PAGE)
        speed(_made_by(field), shown, names, reasons(known, solvers(field.folder))).write(SPEED)


def reasons(known: pd.DataFrame, about: dict[str, Any]) -> dict[tuple[str, str], str]:
    """Why there is no time: by solver and arm, and by solver and "" if it was not installed."""
    found = {(solver, ""): str(each["state"]) for solver, each in about.items() if each["state"] != DONE}
    random = known[known["question"] == "random"]
    return found | {
        (str(row.solver), str(row.arm)): _why(str(row.state))
        for row in random[random["state"] != DONE].itertuples()
    }


def _made_by(field: Field) -> str:
    return f"benchmarks.field --{field.size.name}".removesuffix(" --full")


def told(
    field: Field, answers: pd.DataFrame, known: pd.DataFrame
) -> tuple[pd.DataFrame, dict[str, str], pd.DataFrame]:
    """Answers with the two settings that are shown, by their names on the page; names of solvers; and what they weigh."""
    about = solvers(field.folder)
    names = {solver: str(each["name"]) for solver, each in about.items()}
    names |= {solver: solver for solver in known["solver"].unique() if solver not in names}
    best = {solver: str(each.get("best", "recommended")) for solver, each in about.items()}
    shown = answers["settings"].eq("recommended") | answers["settings"].eq(answers["solver"].map(best))
    answers = answers[shown].copy()
    answers["settings"] = [
        "recommended and best"
        if best.get(solver, settings) == "recommended" == settings
        else "recommended"
        if settings == "recommended"
        else "best"
        for solver, settings in answers[["solver", "settings"]].itertuples(index=False)
    ]
    return answers, names, light(known, about)


def page(field: Field, answers: pd.DataFrame, known: pd.DataFrame) -> Page:
    """All of it, as Markdown."""
    about = solvers(field.folder)
    answers, names, facts = told(field, answers, known)
    made = Page("Inverse kinematics, measured", _made_by(field))
    arms = known["arm"].nunique()
    branches = found_of(answers, field)
    made.say(
        f"{len(names)} solvers, {arms} {'arm' if arms == 1 else 'arms'}, seed {field.seed}. kinseek's authors make this "
        "page; every solver has its own environment, the same targets, and pinocchio as its judge. Where another does "
        "better than kinseek stands first."
    )
    made.head("Where others do better than kinseek")
    nowhere = "Nowhere in what was measured here." if HOST in names else "kinseek was not measured here."
    made.items(wins(answers, facts, names, branches), nowhere)
    made.say(BEYOND)
    _overview(made, answers, names, facts)
    _read(made)
    for question in EACH:
        _answers(made, answers, names, question)
    _unreachable(made, answers, names)
    _branches(made, answers, names, branches)
    _batches(made, answers, names)
    _again(made, known, names)
    _light(made, facts, names)
    _wrong(made, known, names)
    _arms(made, answers, names)
    _solvers(made, about, known, names)
    _missing(made, known, about, names)
    if ADD.is_file():
        made.head("Add a solver")
        made.say(ADD.read_text(encoding="utf-8").split("## Add a solver")[1].replace(HIDDEN, "").strip())
    return made


def number(value: Any, digits: int = 3) -> str:
    """A number in few digits, without an exponent."""
    if value is None or not np.isfinite(value):
        return NONE
    value = float(f"{float(value):.{digits}g}")
    return f"{value:.0f}" if abs(value) >= 10 ** (digits - 1) else f"{value:g}"


def share(row: Any) -> str:
    """A share with its interval [%]."""
    return f"{row['exact']:.1f} ({row['exact_low']:.1f}–{row['exact_high']:.1f})"


def _overview(made: Page, answers: pd.DataFrame, names: dict[str, str], facts: pd.DataFrame) -> None:
    if answers.empty:
        return
    made.head("In short")
    whole = summed(answers, ["solver", "settings", "question"])
    rows = []
    made.say("Sorted by the share of random poses, then by the time; a click on a column sorts by that.")
    for (solver, settings), group in whole.groupby(["solver", "settings"], sort=False):
        by = group.set_index("question")
        shares = [f"{by.loc[q, 'exact']:.1f}" if q in by.index else NONE for q in EACH]
        times = [
            number(by.loc["random", column]) if "random" in by.index else NONE
            for column in ("ratio", "median", "p99")
        ]
        false = int(by["false"].sum())
        light = [
            number(facts.loc[solver, name]) if solver in facts.index else NONE
            for name in ("first", "megabytes")
        ]
        tried = int(by.loc["random", "arms"]) if "random" in by.index else 0
        near = f"{by.loc['random', 'near']:.1f}" if "random" in by.index else NONE
        rank = (-by.loc["random", "exact"], by.loc["random", "median"]) if tried else (1.0, 0.0)
        rows.append((rank, (names[solver], settings, tried, *shares, near, *times, false, *light)))
    titles = " | ".join(f">{TITLES[question].lower()}, exact %" for question in EACH)
    made.table(
        f"solver | settings | >arms | {titles} | >random poses, 1 mm % | >× kinseek | >median µs | >p99 µs | >false"
        " | >first answer s | >on disk MB",
        [row for _, row in sorted(rows, key=lambda each: each[0])],
    )
    random = whole[whole["question"] == "random"]
    if len(random):
        made.say(f"<figure>{plots.exact_against_time(random, names)}")
        made.say(
            "<figcaption>Random poses: ring, recommended settings; dot, best ones; with intervals. Up and left is better."
            "</figcaption></figure>"
        )
        best = answers[(answers["question"] == "random") & (answers["settings"] != "recommended")]
        made.say(f"<figure>{plots.times(best, names)}")
        made.say("<figcaption>Random poses, best settings: the tails. Left is better.</figcaption></figure>")


def _read(made: Page) -> None:
    made.head("How to read it")
    made.items(
        [
            f"**Exact**: within {TIGHT} m and {TIGHT} rad of the pose by pinocchio's forward kinematics, and inside "
            "the limits but for as much of rounding. Of targets that were asked: every question has its time, and a slow "
            "solver is asked fewer. In brackets the 95 % interval (Wilson).",
            f"**1 mm**: within {LOOSE * 1e3:g} mm and {LOOSE_TURN:g} rad, and inside the limits.",
            "**False**: the solver calls it a success, or says nothing of success, and it is not even that.",
            "**Recommended**: what its maintainers' manual says, named in its adapter. **Best**: what did best in a "
            "small sweep on other targets of the first arms: most exact answers, and of those that may be within half "
            "a percent of that, by their interval, the quickest.",
            "A slow solver gets time in proportion to how much its share varied in the sweep: one that solves all or "
            "nothing gets less. The intervals show what is left of chance.",
            "**µs**: wall time of one call from Python, on one thread. All solvers are measured by turns, each on an "
            f"{SLICES}th of the targets and then each on the next, so that a machine that changes its speed does so for "
            "all. A solver that needs a start and gets none begins in the middle of the ranges.",
            "**× kinseek**: each time is divided by kinseek's median time for the same slice; the number is the median of "
            "these ratios, with its interval. It depends on the machine far less than microseconds do.",
            "Arms that a solver refuses do not count against it in shares; **arms** says how many it took.",
            "A difference that is smaller than the intervals is none.",
        ]
    )


def _answers(made: Page, answers: pd.DataFrame, names: dict[str, str], question: str) -> None:
    rows = answers[answers["question"] == question]
    if rows.empty:
        return
    made.head(TITLES[question])
    made.say(f"{next(each.what for each in QUESTIONS if each.name == question).capitalize()}.")
    cells = []
    for row in summed(rows, ["solver", "settings"]).to_dict("records"):
        own = rows[(rows["solver"] == row["solver"]) & (rows["settings"] == row["settings"])]
        more = []
        if question == "start":
            met = own[own["near"]]
            more = [number(100 * (met["moved"] > 2 * met["needed"] + 1e-3).mean())]
        cells.append((*_who(row, names), *_figures(row), *more))
    farther = " | >of these twice as far from the start as needed %" * (question == "start")
    made.table(f"{WHO} | {FIGURES}{farther}", cells)


WHO = "solver | settings | >arms | >asked"
FIGURES = ">exact % | >1 mm % | >false | >× kinseek | >median µs | >p99 µs | >worst µs"


def _who(row: Any, names: dict[str, str]) -> tuple[Any, ...]:
    return names[row["solver"]], row["settings"], row["arms"], row["count"]


def _figures(row: Any) -> tuple[Any, ...]:
    median = f"{number(row['median'])} ({number(row['median_low'])}–{number(row['median_high'])})"
    times = ratio(row), median, number(row["p99"]), number(row["worst"])
    return share(row), f"{row['near']:.1f}", row["false"], *times


def ratio(row: Any) -> str:
    """A time as a multiple of kinseek's, with its interval."""
    if np.isinf(row["ratio_high"]):
        return f"{number(row['ratio'])} ({NONE})"
    return f"{number(row['ratio'])} ({number(row['ratio_low'])}–{number(row['ratio_high'])})"


def _unreachable(made: Page, answers: pd.DataFrame, names: dict[str, str]) -> None:
    rows = answers[answers["question"] == "unreachable"]
    if rows.empty:
        return
    made.head(TITLES["unreachable"])
    made.say(
        "One and a half times as far off as all links in a row. *Says so*: no success claimed. *Nearest*: of what is handed "
        "back inside the limits, how much farther from the place it is than the nearest that anybody has, median; solvers "
        "weigh the turn against it as they do in reach, so how far that is off stands beside it."
    )
    cells = []
    for row in summed(rows, ["solver", "settings"]).to_dict("records"):
        own = rows[(rows["solver"] == row["solver"]) & (rows["settings"] == row["settings"])]
        shares = 100 * (~own["believed"]).mean(), 100 * own["position_error"].notna().mean()
        nearest = own["excess"].median(), np.degrees(own["orientation_error"].median())
        times = row["median"], row["p99"], row["worst"]
        cells.append((*_who(row, names), *map(number, (*shares, *nearest)), ratio(row), *map(number, times)))
    made.table(
        f"{WHO} | >says so % | >hands something back % | >nearest, excess % | >its turn is off by ° | >× kinseek | "
        ">median µs | >p99 µs | >worst µs",
        cells,
    )


def found_of(answers: pd.DataFrame, field: Field) -> pd.DataFrame:
    """How many of all answers each found."""
    turns = {
        each.arm.name: np.array([kind != "prismatic" for kind in each.arm.kinds]) for each in field.judges
    }
    return distinct(answers, turns)


def _branches(made: Page, answers: pd.DataFrame, names: dict[str, str], counted: pd.DataFrame) -> None:
    rows = answers[answers["question"] == "branches"]
    if rows.empty:
        return
    made.head(TITLES["branches"])
    made.say(
        "Six-jointed arms. *Known* is all that any solver found for a pose, judged, full turns counted as one; nobody knows "
        "more. A solver that does not offer all answers is not in this table."
    )
    figures = summed(rows, ["solver", "settings"]).set_index("solver")
    cells = []
    for solver, each in counted.groupby("solver"):
        own = rows[rows["solver"] == solver]
        shares = (
            100 * each["found"].sum() / each["known"].sum(),
            100 * (each["found"] == each["known"]).mean(),
        )
        times = (
            ratio(figures.loc[solver]),
            *(number(figures.loc[solver, column]) for column in ("median", "p99")),
        )
        counts = f"{each['found'].mean():.2f}", int(own["false"].sum())
        who = names[str(solver)], each["arm"].nunique(), len(each)
        cells.append((*who, *(number(share, 4) for share in shares), *counts, *times))
    made.table(
        "solver | >arms | >poses | >found of known % | >poses with all known % | >answers a pose | >false | >× kinseek"
        " | >median µs | >p99 µs",
        cells,
    )


def _batches(made: Page, answers: pd.DataFrame, names: dict[str, str]) -> None:
    rows = answers[answers["question"] == "batch"]
    if rows.empty:
        return
    made.head(TITLES["batch"])
    made.say(
        "Poses in one call, one thread; time is that of the call by the number of poses. Who takes no batches is left out."
    )
    cells = [
        (*_who(row, names), share(row), ratio(row), number(row["mean"]))
        for row in summed(rows, ["solver", "settings"]).to_dict("records")
    ]
    made.table(f"{WHO} | >exact % | >× kinseek | >µs a pose", cells)


def _again(made: Page, known: pd.DataFrame, names: dict[str, str]) -> None:
    rows = known[known["question"].isin(("twice", "threads")) & (known["settings"] == "recommended")]
    if rows.empty:
        return
    made.head("The same bits")
    made.say(
        "Poses that get the same bits from a second solver of the same kind, and from four at once in threads of a process."
    )
    cells = []
    for solver, group in rows.groupby("solver", sort=False):
        cells.append(
            (names[str(solver)], *(_least(group[group["question"] == each]) for each in ("twice", "threads")))
        )
    made.table("solver | >the same again % | >in four threads %", cells)


def _least(rows: pd.DataFrame) -> str:
    alike = rows["alike"].dropna() if "alike" in rows else pd.Series(dtype=float)
    if len(alike):
        return number(100 * alike.min())
    return str(rows["state"].iloc[0]) if len(rows) else NONE


def light(known: pd.DataFrame, about: dict[str, Any]) -> pd.DataFrame:
    """What a solver weighs: `first` [s] and `memory` [MB], medians over arms; `megabytes` on disk."""
    rows = known[(known["question"] == "first") & (known["settings"] == "recommended")]
    facts = pd.DataFrame(index=pd.Index(known["solver"].unique()))
    for name, column in (("first", "seconds"), ("memory", "memory")):
        facts[name] = rows.groupby("solver")[column].median() if column in rows else np.nan
    facts["megabytes"] = pd.Series(
        {solver: each.get("megabytes") for solver, each in about.items()}, dtype=float
    )
    return facts


def _light(made: Page, facts: pd.DataFrame, names: dict[str, str]) -> None:
    made.head("The first answer, memory, size")
    made.say(
        "Seconds from the start of Python to the first answer in a new process, the most memory it has held by then, and "
        "what the environment's packages take on disk, NumPy and all others that the solver stands on among them."
    )
    cells = [(names[str(solver)], *map(number, row)) for solver, row in facts.iterrows()]
    made.table("solver | >first answer s | >memory MB | >on disk MB", cells)


def _wrong(made: Page, known: pd.DataFrame, names: dict[str, str]) -> None:
    rows = known[known["question"].str.startswith("wrong ")]
    if rows.empty:
        return
    made.head("What wrong input does")
    made.say(
        "Each in a process that is watched. Joint values for something that is no pose are silence: the caller goes on with "
        "them. From a start outside the limits joint values are as good an answer as an exception."
    )
    cells = []
    for solver, group in rows.groupby("solver", sort=False):
        answered = group.sort_values("state", key=lambda states: states != DONE, kind="stable")
        by = answered.drop_duplicates("question").set_index("question")
        cells.append((names[str(solver)], *(_outcome(by, f"wrong {case}") for case in WRONG)))
    made.table(f"solver | {' | '.join(WRONG)}", cells)


ENDS = re.compile(r"^ends with (\d+).*")
LATE = re.compile(r"^\d+ of \d+ in .*")
HUNG = re.compile(rf"^{HANG}: .*")
"""Of states: what is the same but for numbers."""


def _outcome(by: pd.DataFrame, question: str) -> str:
    if question not in by.index:
        return NONE
    row = by.loc[question]
    if isinstance(row.get("outcome"), str):
        return str(row["outcome"])
    return ENDS.sub(r"ends the process, with \1", str(row["state"]))


def _arms(made: Page, answers: pd.DataFrame, names: dict[str, str]) -> None:
    rows = answers[answers["question"] == "random"]
    if rows.empty:
        return
    made.head("Random poses, arm by arm")
    cells = [
        (row["arm"], names[row["solver"]], row["settings"], row["count"], *_figures(row))
        for row in summed(rows, ["arm", "solver", "settings"])
        .sort_values(["arm", "exact", "median"], ascending=[True, False, True])
        .to_dict("records")
    ]
    made.table(f"arm | solver | settings | >asked | {FIGURES}", cells)


def _solvers(made: Page, about: dict[str, Any], known: pd.DataFrame, names: dict[str, str]) -> None:
    made.head("The solvers and their settings")
    cells = []
    for solver, each in about.items():
        rows = known[known["solver"] == solver]
        versions = [text for text in rows.get("version", pd.Series(dtype=str)).dropna().unique() if text]
        chosen = each.get("settings", {})
        note = " (an environment of the caller's)" if each.get("own") else ""
        told = html.escape(" ".join(str(each.get("about") or "").split()))
        cells.append(
            (
                names[solver],
                ", ".join(versions) + note,
                *(_set(chosen.get(k)) for k in ("recommended", "best")),
                told,
            )
        )
    made.table("solver | version | recommended | best | its adapter says", cells)


def _set(settings: Any) -> str:
    return (
        ", ".join(f"{key} {value}" for key, value in settings.items()) or "none"
        if settings is not None
        else NONE
    )


def _missing(made: Page, known: pd.DataFrame, about: dict[str, Any], names: dict[str, str]) -> None:
    made.head("What is not measured, and why")
    items = [
        f"**{names[solver]}**: {html.escape(each['state'])}."
        for solver, each in about.items()
        if each["state"] != DONE
    ]
    shown = np.array(
        [
            settings in ("recommended", about.get(solver, {}).get("best"))
            for solver, settings in known[["solver", "settings"]].itertuples(index=False)
        ],
        dtype=bool,
    )
    left = known[(known["state"] != DONE) & shown].assign(why=lambda rows: rows["state"].map(_why))
    for solver, whole in left.groupby("solver", sort=False):
        said = []
        for why, rows in whole.groupby("why", sort=False):
            questions = ("wrong input" if name.startswith("wrong ") else name for name in rows["question"])
            arms, asked = rows["arm"].nunique(), ", ".join(dict.fromkeys(questions))
            said.append(f"{html.escape(str(why))} ({asked}; {arms} {'arm' if arms == 1 else 'arms'})")
        items.append(f"**{names[str(solver)]}**: {'; '.join(said)}.")
    if "raised" in known:
        raised = known[shown].groupby("solver", sort=False)["raised"].sum()
        calls = ", ".join(f"{names[str(solver)]} {int(count)}" for solver, count in raised.items() if count)
        items += [f"Calls that ended in an exception, and count as failures: {calls}."] if calls else []
    made.items(items)


def _why(state: str) -> str:
    """A state without what differs from arm to arm."""
    state = ENDS.sub(r"the process ends with \1", HUNG.sub(HANG, state))
    return LATE.sub("time was up before every target was asked", state)


def as_html(text: str) -> str:
    """A page in Markdown as one file of HTML."""
    import markdown

    body = markdown.markdown(text, extensions=["tables", "fenced_code", "md_in_html", "toc"])
    template = (HERE / "page.html").read_text(encoding="utf-8")
    return template.replace("<!-- body -->", body)
