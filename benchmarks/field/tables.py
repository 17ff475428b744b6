"""All pieces as two tables: every answer, judged, and what is known of every piece; and what pages make of them."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import binomtest

from .judge import LOOSE, LOOSE_TURN, SLACK, STRICT, Verdict
from .questions import QUESTIONS
from .tasks import Field, load

ANSWERS, PIECES = "answers.parquet", "pieces.parquet"

BY = ("solver", "settings", "arm", "question")
"""What a piece is about."""

HOST = "kinseek"
"""Who makes the benchmark, and is therefore the last to be praised in it."""

TITLES = {question.name: question.title for question in QUESTIONS}

NONE = "–"


def collect(field: Field) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Read and judge every piece; (answers, pieces), as they are written to Parquet."""
    answers, known = [], []
    judges = {judge.arm.name: judge for judge in field.judges}
    wanted = {question.name: question for question in field.questions}
    for path in sorted((field.folder / "pieces").glob("*/*/*/*.parquet")):
        place = dict(zip(BY, (*path.parts[-4:-1], path.stem), strict=True))
        arm, question = place["arm"], place["question"]
        piece = load(path)
        if piece is None or arm not in judges or question not in wanted:
            continue
        with np.load(field.asked(judges[arm], wanted[question])) as asked:
            poses, origins, starts = asked["poses"], asked["origins"], asked["starts"]
        facts = dict(piece.attrs["facts"])
        host = np.array(facts.pop("host"), dtype=float)
        known.append(place | {"state": piece.attrs["state"], "asked": len(poses)} | facts)
        if len(piece):
            q, target = np.stack(piece["q"]), piece["target"].to_numpy()
            rows = piece.rename(columns={"times": "microseconds"}).assign(
                **judges[arm].judge(q, poses[target])._asdict(),
                relative=piece["times"] / host[piece["part"]],
                claimed=piece["claimed"].map({1: True, 0: False, -1: None}).astype("boolean"),
            )
            if len(starts):
                rows["moved"] = np.abs(q - starts[target]).max(axis=1)
                rows["needed"] = np.abs(origins - starts)[target].max(axis=1)
            rows.attrs = {}
            answers.append(rows.assign(**place))
    columns = [*BY, "target", "part", "microseconds", "relative", "claimed", *Verdict._fields, "q"]
    every = pd.concat(answers, ignore_index=True) if answers else pd.DataFrame(columns=columns)
    return every[[*columns, *(name for name in every if name not in columns)]], pd.DataFrame(known)


def write(field: Field, answers: pd.DataFrame, known: pd.DataFrame) -> None:
    """Both as Parquet."""
    for name, table in ((ANSWERS, answers), (PIECES, known)):
        table.to_parquet(field.folder / name, index=False)


def solvers(folder: Path) -> dict[str, dict[str, Any]]:
    """What is known of each solver, by the name of its adapter's file."""
    paths = sorted((folder / "solvers").glob("*.json"))
    return {path.stem: json.loads(path.read_text(encoding="utf-8")) for path in paths}


def marked(answers: pd.DataFrame) -> pd.DataFrame:
    """What each answer counts as."""
    inside = answers["outside"] <= SLACK
    position_only = answers["question"] == "position"
    turn = answers["orientation_error"].where(~position_only, 0.0)
    exact = inside & (answers["position_error"] <= STRICT) & (turn <= STRICT)
    near = inside & (answers["position_error"] <= LOOSE) & (turn <= LOOSE_TURN)
    believed = answers["position_error"].notna() & answers["claimed"].fillna(True)
    return answers.assign(
        exact=exact, near=near, false=believed & ~near, believed=believed, excess=excess(answers)
    )


def interval(successes: float, count: int) -> tuple[float, float]:
    """95 % of a share, by Wilson 1927."""
    if not count:
        return float("nan"), float("nan")
    low, high = binomtest(int(successes), count).proportion_ci(method="wilson")
    return float(low), float(high)


def quantile_interval(values: Any, share: float) -> tuple[float, float]:
    """95 % of a quantile, by the ranks that a binomial gives; without an end where there are too few values to tell."""
    ranked = np.sort(np.asarray(values, dtype=float))
    middle, half = len(ranked) * share, 1.96 * np.sqrt(len(ranked) * share * (1.0 - share))
    low, high = int(max(middle - half, 0)), int(middle + half)
    if not len(ranked):
        return float("nan"), float("nan")
    return float(ranked[low]), float(ranked[high]) if high < len(ranked) else float("inf")


def summed(answers: pd.DataFrame, by: list[str]) -> pd.DataFrame:
    """Shares, times and what is false, of groups.

    `median` is that of all calls [µs]. `ratio` compares with kinseek: each time is divided by kinseek's median for the same
    slice; of these the median. Medians of the slices first, and then their median, would count a slice in which one long
    call took all the time as much as one with many short calls.
    """
    rows = []
    for key, group in answers.groupby(by, sort=False):
        times = group["microseconds"].dropna()
        quick, slow = quantile_interval(times, 0.5)
        ratio_low, ratio_high = ratio_interval(group)
        row = dict(zip(by, key, strict=True)) | {"count": len(group), "arms": group["arm"].nunique()}
        for name in ("exact", "near"):
            low, high = interval(float(group[name].sum()), len(group))
            row |= {name: 100 * group[name].mean(), f"{name}_low": 100 * low, f"{name}_high": 100 * high}
        rows.append(
            row
            | {"false": int(group["false"].sum())}
            | {"median": times.median(), "median_low": quick, "median_high": slow, "mean": times.mean()}
            | {"ratio": group["relative"].median(), "ratio_low": ratio_low, "ratio_high": ratio_high}
            | {"p99": times.quantile(0.99), "worst": times.max()}
        )
    return pd.DataFrame(rows)


def ratio_interval(rows: pd.DataFrame, draws: int = 200) -> tuple[float, float]:
    """95 % of the median of `relative`, by drawing slices anew (cluster bootstrap, Davison and Hinkley 1997, 3.8).

    Calls of a slice share the state of the machine, so that they are not independent. Fewer than five slices say nothing:
    (0, inf).
    """
    rows = rows.dropna(subset=["relative"]).sort_values("relative")
    slices = rows.groupby(["arm", "part"], sort=False).ngroup().to_numpy()
    number = slices.max(initial=-1) + 1
    if number < 5:
        return 0.0, float("inf")
    drawn = np.random.default_rng(0).multinomial(number, np.full(number, 1.0 / number), draws)
    weights = np.cumsum(drawn[:, slices], axis=1)
    medians = rows["relative"].to_numpy()[(2 * weights >= weights[:, -1:]).argmax(axis=1)]
    low, high = np.quantile(medians, [0.025, 0.975])
    return float(low), float(high)


def excess(answers: pd.DataFrame) -> pd.Series:
    """Of places out of reach: how much farther off an answer inside the limits is than the nearest that anybody has [%]."""
    usable = answers["position_error"].where(
        (answers["question"] == "unreachable") & (answers["outside"] <= SLACK)
    )
    least = usable.groupby([answers["arm"], answers["target"], answers["question"]]).transform("min")
    return 100.0 * (usable / least - 1.0)


def distinct(answers: pd.DataFrame, periodic: dict[str, np.ndarray[Any, Any]]) -> pd.DataFrame:
    """Of the answers to `branches`: how many right ones are distinct, of all that anybody found.

    Args:
        answers: Marked.
        periodic: Of each arm, which joints turn: there values that differ by full turns are one answer, (n,).

    Returns:
        A row for each solver, arm and target: `found` and `known`.
    """
    rows = []
    for (arm, target), group in answers[answers["question"] == "branches"].groupby(["arm", "target"]):
        known: list[Any] = []
        found: dict[str, set[int]] = {solver: set() for solver in group["solver"]}
        for solver, q in group.loc[group["near"], ["solver", "q"]].itertuples(index=False):
            found[solver].add(_number(known, np.asarray(q), periodic[arm]))
        rows += [
            {"solver": solver, "arm": arm, "target": target, "found": len(each), "known": len(known)}
            for solver, each in found.items()
        ]
    return pd.DataFrame(rows, columns=["solver", "arm", "target", "found", "known"])


def _number(known: list[Any], q: Any, turns: Any) -> int:
    """Which of the known answers this is; a new one is added."""
    for number, other in enumerate(known):
        apart = q - other
        apart = np.where(turns, (apart + np.pi) % (2 * np.pi) - np.pi, apart)
        if np.abs(apart).max() < 1e-3:
            return number
    known.append(q)
    return len(known) - 1


@dataclass(frozen=True)
class Shown:
    """What pages show of a measurement: of each solver the recommended settings and the best ones."""

    field: Field
    known: pd.DataFrame
    """Of every piece."""
    answers: pd.DataFrame
    """Marked, with the settings by their names on the page."""
    about: dict[str, dict[str, Any]]
    """What is known of each solver."""
    names: dict[str, str]
    """Of the solvers, as they stand on the page."""

    @classmethod
    def of(cls, field: Field, answers: pd.DataFrame, known: pd.DataFrame) -> Shown:
        """Choose from all answers, marked."""
        about = solvers(field.folder)
        names = {solver: solver for solver in known["solver"].unique()}
        names |= {solver: str(each["name"]) for solver, each in about.items()}
        best = best_settings(answers["solver"], about)
        plain = answers["settings"] == "recommended"
        words = np.where(
            plain, np.where(best == "recommended", "recommended and best", "recommended"), "best"
        )
        chosen = plain | (answers["settings"] == best)
        return cls(field, known, answers.assign(settings=words)[chosen], about, names)

    @cached_property
    def facts(self) -> pd.DataFrame:
        """What a solver weighs: `first` [s] and `memory` [MB], medians over arms; `megabytes` on disk."""
        known = self.known
        rows = known[(known["question"] == "first") & (known["settings"] == "recommended")]
        facts = pd.DataFrame(index=pd.Index(known["solver"].unique()))
        for name, column in (("first", "seconds"), ("memory", "memory")):
            facts[name] = rows.groupby("solver")[column].median() if column in rows else np.nan
        disk = {solver: each.get("megabytes") for solver, each in self.about.items()}
        facts["megabytes"] = pd.Series(disk, dtype=float)
        return facts

    @cached_property
    def branches(self) -> pd.DataFrame:
        """How many of all answers each found."""
        arms = [judge.arm for judge in self.field.judges]
        return distinct(
            self.answers, {arm.name: np.array([kind != "prismatic" for kind in arm.kinds]) for arm in arms}
        )

    def groups(self, question: str) -> Iterator[tuple[dict[str, Any], pd.DataFrame]]:
        """Of each solver and its settings what `summed` gives for a question, and its answers."""
        rows = self.answers[self.answers["question"] == question]
        for row in summed(rows, ["solver", "settings"]).to_dict("records") if len(rows) else ():
            own = rows[(rows["solver"] == row["solver"]) & (rows["settings"] == row["settings"])]
            yield {str(name): value for name, value in row.items()}, own


def best_settings(solvers: pd.Series, about: dict[str, dict[str, Any]]) -> pd.Series:
    """Labels of the settings that did best in the sweep, for solvers by their names."""
    return solvers.map(lambda solver: about.get(solver, {}).get("best", "recommended")).astype(object)


def number(value: Any, digits: int = 3) -> str:
    """A number in few digits, without an exponent."""
    if value is None or not np.isfinite(value):
        return NONE
    value = float(f"{float(value):.{digits}g}")
    return f"{value:.0f}" if abs(value) >= 10 ** (digits - 1) else f"{value:g}"


def share(row: Any) -> str:
    """A share with its interval [%]."""
    return f"{row['exact']:.1f} ({row['exact_low']:.1f}–{row['exact_high']:.1f})"


def ratio(row: Any) -> str:
    """A time as a multiple of kinseek's, with its interval."""
    ends = [row["ratio_low"], row["ratio_high"]]
    return f"{number(row['ratio'])} ({NONE if np.isinf(ends[1]) else '–'.join(map(number, ends))})"
