"""The page: written by the one writer of pages, turned into HTML with tables that are sorted by a click."""

from __future__ import annotations

import html
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from benchmarks.command import ROOT
from benchmarks.page import Page, Row
from benchmarks.workers.process import HANG

from . import plots
from .judge import LOOSE, LOOSE_TURN, STRICT
from .pieces import DONE
from .questions import QUESTIONS, SLICES, WRONG
from .summary import PAGE, SPEED, speed, summary
from .tables import HOST, NONE, TITLES, Shown, best_settings, collect, marked, number, ratio, share, summed
from .tables import write as write_tables
from .tasks import Field
from .wins import BEYOND, wins

Table = Sequence[Mapping[str, object]]
"""Rows that name their cells."""

HERE = Path(__file__).resolve().parent
ADD, HIDDEN = ROOT / "docs" / "field.md", "<!-- needs: scipy -->\n"
"""What says how to add a solver, and what in it is for those who test it."""

TIGHT = f"{STRICT:g}".replace("e-0", "e-")
EACH = ("random", "singular", "limits", "position", "start")


def write(field: Field, keep: bool = False) -> None:
    """Write the tables and the page of the pieces that are there, and the pages that the repository keeps if `keep`."""
    answers, known = collect(field)
    if known.empty:
        raise SystemExit(f"nothing measured yet in {field.folder}")
    write_tables(field, answers, known)
    shown = Shown.of(field, marked(answers), known)
    place = field.folder / "index.html"
    place.write_text(as_html(page(shown).text), encoding="utf-8")
    print(f"wrote {place}")
    if keep:
        if not field.size.questions:
            summary(_made_by(field), shown.answers, shown.names, _wins(shown)).write(PAGE)
        speed(_made_by(field), shown.answers, shown.names, reasons(shown)).write(SPEED)


def reasons(shown: Shown) -> dict[tuple[str, str], str]:
    """Why there is no time: by solver and arm, and by solver and "" if it was not installed."""
    found = {
        (solver, ""): str(each["state"]) for solver, each in shown.about.items() if each["state"] != DONE
    }
    random = shown.known[(shown.known["question"] == "random") & (shown.known["state"] != DONE)]
    return found | {(str(row.solver), str(row.arm)): _why(str(row.state)) for row in random.itertuples()}


def _made_by(field: Field) -> str:
    return f"benchmarks.field --{field.size.name}".removesuffix(" --full")


def _wins(shown: Shown) -> list[str]:
    return wins(shown.answers, shown.facts, shown.names, shown.branches)


def page(shown: Shown) -> Page:
    """All of it, as Markdown."""
    made = Page("Inverse kinematics, measured", _made_by(shown.field))
    arms = shown.known["arm"].nunique()
    made.say(
        f"{len(shown.names)} solvers, {arms} {'arm' if arms == 1 else 'arms'}, seed {shown.field.seed}. kinseek's authors "
        "make this page; every solver has its own environment, the same targets, and pinocchio as its judge. Where another "
        "does better than kinseek stands first."
    )
    made.head("Where others do better than kinseek")
    nowhere = (
        "Nowhere in what was measured here." if HOST in shown.names else "kinseek was not measured here."
    )
    made.items(_wins(shown), nowhere)
    made.say(BEYOND)
    _overview(made, shown)
    _read(made)
    for title, text, rows in SECTIONS:
        cells = rows(shown)
        if cells:
            made.head(title)
            made.say(text)
            made.rows(cells, show=False)
    _missing(made, shown)
    if ADD.is_file():
        made.head("Add a solver")
        made.say(ADD.read_text(encoding="utf-8").split("## Add a solver")[1].replace(HIDDEN, "").strip())
    return made


def _overview(made: Page, shown: Shown) -> None:
    if shown.answers.empty:
        return
    made.head("In short")
    made.say("Sorted by the share of random poses, then by the time. Click on a column to sort by it.")
    whole = summed(shown.answers, ["solver", "settings", "question"])
    rows = []
    for (solver, settings), group in whole.groupby(["solver", "settings"], sort=False):
        by = {str(row["question"]): row for row in group.to_dict("records")}
        random = by.get("random", {})
        row: Row = {"solver": shown.names[solver], "settings": settings, ">arms": random.get("arms", 0)}
        for question in EACH:
            exact = f"{by[question]['exact']:.1f}" if question in by else NONE
            row[f">{TITLES[question].lower()}, exact %"] = exact
        row[">random poses, 1 mm %"] = f"{random['near']:.1f}" if random else NONE
        for column, key in ((">× kinseek", "ratio"), (">median µs", "median"), (">p99 µs", "p99")):
            row[column] = number(random.get(key))
        row[">false"] = int(group["false"].sum())
        for column, key in ((">first answer s", "first"), (">on disk MB", "megabytes")):
            row[column] = number(shown.facts[key].get(solver))
        rows.append(((-random["exact"], random["median"]) if random else (1.0, 0.0), row))
    made.rows([row for _, row in sorted(rows, key=lambda each: each[0])], show=False)
    random = whole[whole["question"] == "random"]
    if len(random):
        made.say(f"<figure>{plots.exact_against_time(random, shown.names)}")
        made.say(
            "<figcaption>Random poses, with intervals. Rings: recommended settings; dots: best ones. Up and left is better."
            "</figcaption></figure>"
        )
        answers = shown.answers
        best = answers[(answers["question"] == "random") & (answers["settings"] != "recommended")]
        made.say(f"<figure>{plots.times(best, shown.names)}")
        made.say("<figcaption>Random poses, best settings: the tails. Left is better.</figcaption></figure>")


def _read(made: Page) -> None:
    made.head("How to read it")
    made.items(
        [
            f"**Exact**: within {TIGHT} m and {TIGHT} rad of the pose by pinocchio's forward kinematics, and inside "
            "the limits up to the same tolerance. It is a share of the measured targets: every question has a time limit, "
            "so a slow solver gets fewer. In brackets the 95 % interval (Wilson).",
            f"**1 mm**: within {LOOSE * 1e3:g} mm and {LOOSE_TURN:g} rad, and inside the limits.",
            "**False**: the solver reports a success, or reports nothing, and the result is not even within 1 mm.",
            "**Recommended**: the settings of the maintainers' manual, named in the adapter. **Best**: the settings that "
            "did best in a small sweep on other targets of the first arms: the fastest of those whose share of exact "
            "solutions is the largest, or may be within half a percent of it, by their interval.",
            "The time limit depends on how much the share varied in the sweep: a solver that solves all or no targets gets "
            "less time. The intervals show the remaining uncertainty.",
            "**µs**: wall time of one call from Python, on one thread. The solvers are measured alternately, each on an "
            f"{SLICES}th of the targets and then each on the next, so a change of the machine's speed affects all of them. "
            "A solver that needs a start and gets none begins in the middle of the ranges.",
            "**× kinseek**: each time is divided by kinseek's median time for the same slice; the number is the median of "
            "these ratios, with its interval. It depends on the machine far less than microseconds do.",
            "Arms that a solver rejects do not count against it; **arms** is the number of arms that it accepts.",
            "A difference that is smaller than the intervals is not significant.",
        ]
    )


def _who(row: Any, shown: Shown) -> Row:
    who: Row = {"solver": shown.names[row["solver"]], "settings": row["settings"]}
    return who | {">arms": row["arms"], ">asked": row["count"]}


def _figures(row: Any) -> Row:
    median = f"{number(row['median'])} ({number(row['median_low'])}–{number(row['median_high'])})"
    cells: Row = {">exact %": share(row), ">1 mm %": f"{row['near']:.1f}", ">false": row["false"]}
    cells |= {">× kinseek": ratio(row), ">median µs": median}
    return cells | {">p99 µs": number(row["p99"]), ">worst µs": number(row["worst"])}


def _answers(question: str) -> Callable[[Shown], Table]:
    """Rows of a question that is about exact answers."""
    return lambda shown: [_who(row, shown) | _figures(row) for row, _ in shown.groups(question)]


def _start(shown: Shown) -> Table:
    rows = []
    for row, own in shown.groups("start"):
        met = own[own["near"]]
        far = number(100 * (met["moved"] > 2 * met["needed"] + 1e-3).mean())
        far_column = ">of these twice as far from the start as needed %"
        rows.append(_who(row, shown) | _figures(row) | {far_column: far})
    return rows


def _unreachable(shown: Shown) -> Table:
    rows = []
    for row, own in shown.groups("unreachable"):
        cells = {
            ">reports it %": 100 * (~own["believed"]).mean(),
            ">returns joint values %": 100 * own["position_error"].notna().mean(),
            ">nearest, excess %": own["excess"].median(),
            ">orientation error °": np.degrees(own["orientation_error"].median()),
        }
        times = {f">{name} µs": number(row[name]) for name in ("median", "p99", "worst")}
        figures = {column: number(value) for column, value in cells.items()}
        rows.append(_who(row, shown) | figures | {">× kinseek": ratio(row)} | times)
    return rows


def _branches(shown: Shown) -> Table:
    rows = []
    for row, _ in shown.groups("branches"):
        each = shown.branches[shown.branches["solver"] == row["solver"]]
        found = 100 * each["found"].sum() / each["known"].sum(), 100 * (each["found"] == each["known"]).mean()
        rows.append(
            {
                "solver": shown.names[row["solver"]],
                ">arms": each["arm"].nunique(),
                ">poses": len(each),
                ">found of known %": number(found[0], 4),
                ">poses with all known %": number(found[1], 4),
                ">answers a pose": f"{each['found'].mean():.2f}",
                ">false": row["false"],
                ">× kinseek": ratio(row),
                ">median µs": number(row["median"]),
                ">p99 µs": number(row["p99"]),
            }
        )
    return rows


def _batches(shown: Shown) -> Table:
    return [
        _who(row, shown)
        | {">exact %": share(row), ">× kinseek": ratio(row), ">µs a pose": number(row["mean"])}
        for row, _ in shown.groups("batch")
    ]


def _again(shown: Shown) -> Table:
    known = shown.known
    rows = known[known["question"].isin(("twice", "threads")) & (known["settings"] == "recommended")]
    return [
        {
            "solver": shown.names[str(solver)],
            ">the same again %": _least(group[group["question"] == "twice"]),
            ">in four threads %": _least(group[group["question"] == "threads"]),
        }
        for solver, group in rows.groupby("solver", sort=False)
    ]


def _least(rows: pd.DataFrame) -> str:
    alike = rows["alike"].dropna() if "alike" in rows else pd.Series(dtype=float)
    if len(alike):
        return number(100 * alike.min())
    return str(rows["state"].iloc[0]) if len(rows) else NONE


def _light(shown: Shown) -> Table:
    columns = {">first answer s": "first", ">memory MB": "memory", ">on disk MB": "megabytes"}
    return [
        {"solver": shown.names[str(solver)]} | {name: number(row[key]) for name, key in columns.items()}
        for solver, row in shown.facts.iterrows()
    ]


def _wrong(shown: Shown) -> Table:
    rows = shown.known[shown.known["question"].str.startswith("wrong ")]
    cells = []
    for solver, group in rows.groupby("solver", sort=False):
        answered = group.sort_values("state", key=lambda states: states != DONE, kind="stable")
        by = answered.drop_duplicates("question").set_index("question")
        outcomes = {case: _outcome(by, f"wrong {case}") for case in WRONG}
        cells.append({"solver": shown.names[str(solver)]} | outcomes)
    return cells


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


def _arms(shown: Shown) -> Table:
    rows = shown.answers[shown.answers["question"] == "random"]
    if rows.empty:
        return []
    by = summed(rows, ["arm", "solver", "settings"])
    by = by.sort_values(["arm", "exact", "median"], ascending=[True, False, True])
    return [{"arm": row["arm"]} | _who(row, shown) | _figures(row) for row in by.to_dict("records")]


def _solvers(shown: Shown) -> Table:
    cells = []
    for solver, each in shown.about.items():
        rows = shown.known[shown.known["solver"] == solver]
        versions = [text for text in rows.get("version", pd.Series(dtype=str)).dropna().unique() if text]
        chosen, note = (
            each.get("settings", {}),
            " (an environment of the caller's)" if each.get("own") else "",
        )
        cells.append(
            {
                "solver": shown.names[solver],
                "version": ", ".join(versions) + note,
                "recommended": _set(chosen.get("recommended")),
                "best": _set(chosen.get("best")),
                "its adapter says": html.escape(" ".join(str(each.get("about") or "").split())),
            }
        )
    return cells


def _set(settings: Any) -> str:
    if settings is None:
        return NONE
    return ", ".join(f"{key} {value}" for key, value in settings.items()) or "none"


def _asked(question: str) -> str:
    return f"{next(each.what for each in QUESTIONS if each.name == question).capitalize()}."


SECTIONS: tuple[tuple[str, str, Callable[[Shown], Table]], ...] = (
    *((TITLES[name], _asked(name), _answers(name)) for name in EACH[:-1]),
    (TITLES["start"], _asked("start"), _start),
    (
        TITLES["unreachable"],
        "Positions at 1.5 times the length of the arm from the base. *Reports it*: the solver does not report a success. "
        "*Nearest, excess*: for joint values inside the limits, how much farther the hand is from the position than in the "
        "nearest pose of all solvers, median. Solvers weigh position against orientation, so the orientation error follows.",
        _unreachable,
    ),
    (
        TITLES["branches"],
        "Arms with six joints. *Known* solutions of a pose are those that any solver found, as judged; full turns count as "
        "one. Solvers that do not return all solutions are not in this table.",
        _branches,
    ),
    (
        TITLES["batch"],
        "Many poses in one call, on one thread; the time is that of the call divided by the number of poses. Solvers "
        "without batches are not in this table.",
        _batches,
    ),
    (
        "The same bits",
        "Share of poses for which a second instance of the solver, or four instances in threads, return the same bits.",
        _again,
    ),
    (
        "The first answer, memory, size",
        "Seconds from the start of Python to the first solution in a new process, the peak memory until then, and the disk "
        "space of all packages of the environment, NumPy included.",
        _light,
    ),
    (
        "What wrong input does",
        "Each case runs in a supervised process. A solver that returns joint values for an invalid pose reports nothing, so "
        "its caller would use them. For a start outside the limits, joint values are as good as an exception.",
        _wrong,
    ),
    ("Random poses, arm by arm", "The figures of each arm.", _arms),
    ("The solvers and their settings", "Versions and settings of each solver.", _solvers),
)
"""Sections of the page that are a table: title, what it shows, and its rows; one without rows is left out."""


def _missing(made: Page, shown: Shown) -> None:
    made.head("Missing measurements, and why")
    known, names = shown.known, shown.names
    items = [
        f"**{names[solver]}**: {html.escape(each['state'])}."
        for solver, each in shown.about.items()
        if each["state"] != DONE
    ]
    best = best_settings(known["solver"], shown.about)
    known = known[(known["settings"] == "recommended") | (known["settings"] == best)]
    left = known[known["state"] != DONE].assign(why=lambda rows: rows["state"].map(_why))
    for solver, whole in left.groupby("solver", sort=False):
        said = []
        for why, rows in whole.groupby("why", sort=False):
            questions = ("wrong input" if name.startswith("wrong ") else name for name in rows["question"])
            arms, asked = rows["arm"].nunique(), ", ".join(dict.fromkeys(questions))
            said.append(f"{html.escape(str(why))} ({asked}; {arms} {'arm' if arms == 1 else 'arms'})")
        items.append(f"**{names[str(solver)]}**: {'; '.join(said)}.")
    if "raised" in known:
        raised = known.groupby("solver", sort=False)["raised"].sum()
        calls = ", ".join(f"{names[str(solver)]} {int(count)}" for solver, count in raised.items() if count)
        items += [f"Calls that raised an exception, which count as failures: {calls}."] if calls else []
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
