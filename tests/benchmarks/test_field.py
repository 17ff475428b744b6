"""The benchmark of all solvers: its judge, what adapters are, that what was measured is kept; with solvers made for it."""

from __future__ import annotations

import itertools
import json
import re
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import kinseek
from benchmarks.field import run, sweep, tasks
from benchmarks.field.adapters import SOLVERS, adapter, path_of
from benchmarks.field.judge import ARMS, bundled, good
from benchmarks.field.page import every_question, speed, summary
from benchmarks.field.questions import QUESTIONS, SIZES, SLICES, SWEEP, fits
from benchmarks.field.run import Solver, measure
from benchmarks.field.tables import (
    Shown,
    collect,
    distinct,
    interval,
    marked,
    quantile_interval,
    ratio_interval,
    summed,
    write,
)
from benchmarks.field.tasks import Field
from benchmarks.speed_table import table
from places import ROOT

SOLVER = '''
"""Solves a plane arm of two links in closed form, and does what a test wants."""
import os, signal, time
from pathlib import Path
import numpy as np
from benchmarks.field.protocol import Answer

NAME, PACKAGE = "Plane", "numpy"
RECOMMENDED, SWEEP = {{"off": 0.5}}, ({{"off": 0.0}},)
LOG = Path({log!r})


class Solver:
    def __init__(self, arm, settings):
        self.off = settings["off"]

    def solve(self, T, start):
        {solve}
        with LOG.open("a") as file:
            file.write("{name}\\n")
        a, b = 0.5, 0.25
        x, y = T[:2, 3]
        c = np.clip((x * x + y * y - a * a - b * b) / (2 * a * b), -1, 1)
        found = []
        for q2 in (np.arccos(c), -np.arccos(c)):
            q1 = np.arctan2(y, x) - np.arctan2(b * np.sin(q2), a + b * np.cos(q2))
            q = np.array([q1, q2]) % (2 * np.pi)
            turn = np.arctan2(T[1, 0], T[0, 0]) - q.sum()
            found.append((abs((turn + np.pi) % (2 * np.pi) - np.pi), tuple(q)))
        return Answer(np.array(min(found)[1]) + self.off, None)


def load(arm, settings):
    {load}
    return Solver(arm, settings)
'''


QUICK = SIZES["quick"]
PINNED = r"[A-Za-z0-9_.\[\]-]+(==[0-9a-z.+]+| @ git\+https://\S+@[0-9a-f]{40})"


def a_solver(folder: Path, solve: str = "pass", name: str = "plane", load: str = "pass") -> Path:
    path = folder / f"{name}.py"
    text = SOLVER.format(log=str(folder / "log.txt"), solve=solve, name=name, load=load)
    path.write_text(text, encoding="utf-8")
    return path


def a_field(folder: Path, *names: str) -> Field:
    asked = [each for each in QUESTIONS if each.name in names]
    return Field(folder / "out", [bundled("planar2")], asked, size=QUICK)


def taking_part(field: Field, path: Path) -> Solver:
    field.folder.mkdir(exist_ok=True)
    return Solver(path, adapter(path), Path(sys.executable), field.folder / f"{path.stem}.txt")


def measured(field: Field, *paths: Path) -> str:
    return measure(field, [taking_part(field, path) for path in paths])[paths[0].stem]


def states(field: Field) -> dict[str, str]:
    _, known = collect(field)
    return {f"{row.settings} {row.question}": row.state for row in known.itertuples()}


@pytest.mark.parametrize("name", ["panda", "gen3", "irb5400", "ur10e_rail"])
def test_the_judge_reads_arms_as_kinseek_does(name: str) -> None:
    judge, arm = bundled(name), kinseek.load(name)
    assert judge.arm.joints == tuple(arm.joint_names)
    np.testing.assert_array_equal([judge.arm.lower, judge.arm.upper], [arm.lower, arm.upper])
    q = np.random.default_rng(0).uniform(arm.lower, arm.upper, (20, arm.dof))
    np.testing.assert_allclose(judge.fk(q), arm.fk(q), atol=1e-12)
    assert (np.linalg.norm(arm.fk(q)[:, :3, 3], axis=1) <= judge.reach + 1e-12).all()


def test_the_judge_sees_what_is_off_and_what_is_outside() -> None:
    judge = bundled("panda")
    q = np.tile(judge.arm.middle, (4, 1))
    target = judge.fk(q)
    q[1, 0] += 1e-5
    q[2] = np.nan
    q[3, 3] = judge.arm.upper[3] + 1e-3
    verdict = judge.judge(q, target)
    np.testing.assert_array_equal(good(verdict, 1e-6, 1e-6), [True, False, False, False])
    assert verdict.orientation_error[1] == pytest.approx(1e-5)
    assert np.isnan(verdict.position_error[2])
    assert verdict.outside[3] == pytest.approx(1e-3)
    assert judge.arm.name == "panda"


def test_a_continuous_joint_has_no_limits() -> None:
    judge = bundled("gen3")
    q = judge.arm.middle[None] + 2 * np.pi * np.array([kind == "continuous" for kind in judge.arm.kinds])
    assert good(judge.judge(q, judge.fk(judge.arm.middle[None])), 1e-9, 1e-7).all()


def test_thirty_arms_and_what_they_are_asked() -> None:
    assert len(ARMS) == len(set(ARMS)) == 30
    judge = bundled("ur5e")
    for question in (*QUESTIONS, SWEEP):
        one, other = (question.of(judge, seed, QUICK) for seed in (0, 0))
        np.testing.assert_array_equal(one.poses, other.poses)
        assert len(one.poses) == max(int(question.count * 0.2), 1)
        if len(one.origins):
            assert ((one.origins >= judge.arm.lower) & (one.origins <= judge.arm.upper)).all()
    far = next(each for each in QUESTIONS if each.name == "unreachable").of(judge, 0, QUICK)
    assert (np.linalg.norm(far.poses[:, :3, 3], axis=1) > judge.reach).all()
    limits = next(each for each in QUESTIONS if each.name == "limits").of(judge, 0, QUICK).origins
    assert ((limits == judge.arm.lower) | (limits == judge.arm.upper)).any(axis=1).all()
    every_answer = next(each for each in QUESTIONS if each.name == "branches")
    assert [fits(every_answer, bundled(name), 0, SIZES["full"]) for name in ("ur5e", "panda")] == [
        True,
        False,
    ]


@pytest.mark.parametrize("name", SOLVERS)
def test_adapters_keep_to_their_protocol(name: str) -> None:
    path = path_of(name)
    module = adapter(path)
    assert module.__doc__
    for settings in module.SWEEP:
        assert set(settings) == set(module.RECOMMENDED), "a sweep changes settings, it does not invent them"
    json.dumps([module.RECOMMENDED, *module.SWEEP])
    lines = path.with_suffix(".txt").read_text(encoding="utf-8").splitlines()
    pinned = [line for line in lines if line and not line.startswith(("#", "--"))]
    assert all(line == "." or re.fullmatch(PINNED, line) for line in pinned), pinned


def test_what_is_no_adapter_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="no such adapter; there are kinseek"):
        adapter(tmp_path / "none.py")
    (tmp_path / "half.py").write_text("NAME = 'half'", encoding="utf-8")
    with pytest.raises(ValueError, match="missing: PACKAGE, RECOMMENDED, SWEEP, load"):
        adapter(tmp_path / "half.py")


@pytest.mark.slow
def test_a_solver_is_swept_measured_judged_and_not_asked_again(tmp_path: Path) -> None:
    path, field = a_solver(tmp_path), a_field(tmp_path, "random", "first", "position")
    assert measured(field, path) == "sweep 1", "an answer that is off half a radian is not the best"
    answers, known = collect(field)
    shares = marked(answers).groupby(["settings", "question"])["exact"].mean()
    assert shares["recommended", "random"] == 0.0
    assert shares["sweep 1", "random"] == 1.0
    false = marked(answers).groupby("settings")["false"].sum()
    assert false["sweep 1"] == 0 < false["recommended"]
    by = known.set_index(["settings", "question"])
    assert 0 < by.loc[("recommended", "first"), "seconds"] < 60
    assert by.loc[("recommended", "position"), "state"] == "not offered"
    asked = (tmp_path / "log.txt").read_text(encoding="utf-8")
    assert measured(field, path) == "sweep 1"
    assert (tmp_path / "log.txt").read_text(encoding="utf-8") == asked, "asked again what was known"
    (field.folder / "pieces/plane/sweep 1/planar2/random.parquet").unlink()
    measured(field, path)
    again = (tmp_path / "log.txt").read_text(encoding="utf-8")
    assert 0 < len(again) - len(asked) <= len("plane\n") * 2 * 40, "more than the piece that was missing"
    write(field, answers, known)
    assert pd.read_parquet(field.folder / "answers.parquet")["q"].map(len).eq(2).all()
    text = every_question(Shown.of(field, marked(answers), known)).text
    assert "## Random poses" in text
    assert "- **plane**: not offered (position; 1 arm)." in text


@pytest.mark.slow
def test_a_crash_and_a_hang_are_answers_and_the_rest_is_asked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run, "PATIENCE", 1.0)  # the first question of a process has more, to load
    crash = "if start is not None: os.kill(os.getpid(), signal.SIGSEGV)"
    far = "np.hypot(*T[:2, 3]) > 1.0"
    path = a_solver(tmp_path, f"{crash}\n        if {far} and self.off: time.sleep(600)")
    field = a_field(tmp_path, "random", "limits", "start", "unreachable")
    field = replace(field, questions=[replace(each, seconds=0.2) for each in field.questions])
    measured(field, path)
    found = states(field)
    assert found["recommended unreachable"].startswith("hangs: nothing for ")
    assert found["sweep 1 unreachable"] == tasks.DONE
    assert found["sweep 1 start"] == "crashes: SIGSEGV"
    assert found["recommended start"] == "not asked: another question hangs on this arm"
    assert found["sweep 1 limits"] == found["sweep 1 random"] == found["recommended random"] == tasks.DONE


@pytest.mark.slow
def test_an_arm_on_which_a_solver_hangs_is_left_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run, "PATIENCE", 1.0)
    path = a_solver(tmp_path, "if self.off: time.sleep(600)")
    field = a_field(tmp_path, "random", "singular", "limits")
    field = replace(field, questions=[replace(each, seconds=0.2) for each in field.questions])
    measured(field, path)
    found = states(field)
    for question in ("random", "singular", "limits"):
        assert found[f"recommended {question}"] == "not asked: another question hangs on this arm", (
            "the sweep"
        )
        assert found[f"sweep 1 {question}"] == tasks.DONE


def test_who_hangs_on_many_arms_is_asked_no_more(tmp_path: Path) -> None:
    solver = taking_part(a_field(tmp_path), a_solver(tmp_path))
    assert solver.weary("one", "best") is None
    solver.hangs = {("one", "recommended")}
    assert solver.weary("one", "best") is None, "other settings may do"
    solver.hangs = {("one", "best")}
    assert solver.weary("one", "best") == "not asked: another question hangs on this arm"
    solver.hangs = {(f"arm {number}", "best") for number in range(run.HANGS)}
    assert solver.weary("one", "best") == f"not asked: it hangs on {run.HANGS} arms"
    solver.hangs.pop()
    assert solver.weary("one", "best") is None


@pytest.mark.slow
def test_an_arm_at_which_reading_ends_is_not_read_again(tmp_path: Path) -> None:
    log = tmp_path / "loads.txt"
    dies = f"Path({str(log)!r}).open('a').write('load\\n'); settings['off'] and os.kill(os.getpid(), signal.SIGSEGV)"
    path, field = a_solver(tmp_path, load=dies), a_field(tmp_path, "random", "singular")
    assert measured(field, path) == "sweep 1"
    found = states(field)
    assert found["recommended random"] == found["recommended singular"] == "crashes: SIGSEGV"
    assert found["sweep 1 random"] == found["sweep 1 singular"] == tasks.DONE
    loads = log.read_text(encoding="utf-8").count("load")
    assert loads <= 2 * 3, "once a process for either settings, and again for those that a crash took away"


@pytest.mark.slow
def test_solvers_are_measured_by_turns_and_compared_slice_by_slice(tmp_path: Path) -> None:
    calm = "LOG.parent.joinpath('slow').exists() and time.sleep(2e-3)"
    host, slow = (
        a_solver(tmp_path, calm, "kinseek"),
        a_solver(tmp_path, f"time.sleep(1e-3); {calm}", "slow_one"),
    )
    other = a_solver(tmp_path, f"time.sleep(2e-3); {calm}", "other")
    field = a_field(tmp_path, "random")
    field = replace(field, size=replace(QUICK, swept=0), questions=[replace(field.questions[0], seconds=9.0)])
    assert measured(field, host, slow) == "recommended"
    order = (tmp_path / "log.txt").read_text(encoding="utf-8").split()
    changes = sum(one != other for one, other in itertools.pairwise(order))
    assert changes >= SLICES - 1, "each took all of its targets at once"
    (tmp_path / "slow").touch()
    measured(field, host, slow, other)
    answers, _ = collect(field)
    rows = summed(marked(answers), ["solver"]).set_index("solver")
    assert rows.loc["kinseek", ["ratio", "ratio_low", "ratio_high"]].tolist() == [1.0, 1.0, 1.0]
    assert rows.loc["slow_one", "ratio"] > 5.0
    assert 1.5 < rows.loc["other", "ratio"] < 2.5, "compared with kinseek on the machine as it was before"
    assert set(answers["part"]) == set(range(SLICES))


def test_what_changed_is_measured_anew(tmp_path: Path) -> None:
    path, field = a_solver(tmp_path), a_field(tmp_path, "random")
    question, judge = field.questions[0], field.judges[0]
    one = tasks.task(field, path, judge, question, "recommended", {"off": 0.5})
    piece = pd.DataFrame()
    piece.attrs = {"state": tasks.DONE, "facts": {"host": []}, "digest": one.digest}
    tasks.save(one.piece, piece)
    assert one.done
    answers, known = collect(field)
    text = every_question(Shown.of(field, marked(answers), known)).text
    assert "kinseek is not among what was measured here." in text, "a page without any answer"
    other = tasks.task(field, path, judge, question, "recommended", {"off": 0.0})
    assert not other.done
    a_solver(tmp_path, "T = T")
    changed = tasks.task(field, path, judge, question, "recommended", {"off": 0.5})
    assert not changed.done


def test_answers_are_counted_once_whoever_found_them() -> None:
    def row(solver: str, q: Sequence[float], near: bool = True) -> dict[str, object]:
        return {
            "solver": solver,
            "arm": "a",
            "target": 0,
            "question": "branches",
            "q": np.array(q),
            "near": near,
        }

    table = pd.DataFrame(
        [
            *(
                row("one", [0.0, 0.0]),
                row("one", [1.0, 1.0]),
                row("one", [1.0, 1.0]),
                row("one", [2.0, 0.0], near=False),
            ),
            *(row("two", [2 * np.pi, 0.0]), row("two", [0.0, 2 * np.pi])),
        ]
    )
    found = distinct(table, {"a": np.array([True, False])}).set_index("solver")
    assert found.loc["one", "found"] == 2
    assert found.loc["two", "found"] == 2
    assert (found["known"] == 3).all()


def test_intervals_hold_what_they_are_of() -> None:
    low, high = interval(95, 100)
    assert (round(low, 3), round(high, 3)) == (0.888, 0.978)
    assert interval(100, 100)[1] == pytest.approx(1.0)
    rng = np.random.default_rng(0)
    hits = [
        low <= 0.0 <= high for low, high in (quantile_interval(rng.normal(size=101), 0.5) for _ in range(400))
    ]
    assert 0.92 < np.mean(hits) < 0.99
    assert quantile_interval(np.arange(80.0), 0.99)[1] == np.inf, (
        "too few to tell where the last hundredth begins"
    )
    low, high = quantile_interval(np.arange(3000.0), 0.99)
    assert 2950 < low < 2970 < high < 2990


@pytest.mark.slow
def test_the_interval_of_a_ratio_knows_that_a_slice_shares_its_luck() -> None:
    rng = np.random.default_rng(0)
    hits: list[bool] = []
    narrow: list[bool] = []
    for _ in range(200):
        luck = np.repeat(rng.normal(scale=0.1, size=20), 25)
        relative = 2.0 + luck + rng.normal(scale=0.02, size=500)
        rows = pd.DataFrame({"arm": "a", "part": np.repeat(np.arange(20), 25), "relative": relative})
        for found, (low, high) in (
            (hits, ratio_interval(rows)),
            (narrow, quantile_interval(relative, 0.5)),
        ):
            found.append(low <= 2.0 <= high)
    assert 0.88 < np.mean(hits) < 0.99
    assert np.mean(narrow) < 0.6, "as if all calls were independent"
    few = pd.DataFrame({"arm": "a", "part": [0, 1, 2, 3], "relative": 0.5})
    assert ratio_interval(few) == (0.0, np.inf), "four slices say nothing"


def test_a_long_call_that_ends_a_slice_counts_once() -> None:
    part = [0, 1, 2, 3, 4, 5, *[6] * 20, *[7] * 20]
    rows = pd.DataFrame({"arm": "a", "part": part, "relative": [90.0] * 6 + [2.0] * 40})
    counted = rows.assign(solver="one", microseconds=1.0, exact=True, near=True, false=False)
    assert summed(counted, ["solver"])["ratio"].tolist() == [2.0]


@pytest.mark.slow
def test_the_adapter_of_the_documentation_is_short_and_solves(tmp_path: Path) -> None:
    pytest.importorskip("scipy")
    pages = ROOT / "docs" / "field.md"
    if not pages.is_file():
        pytest.skip("the documentation is not part of what is tested here")
    code = pages.read_text(encoding="utf-8").split("```python\n")[1].split("```")[0]
    assert sum(bool(line.strip()) for line in code.splitlines()) <= 30
    path = tmp_path / "mine.py"
    path.write_text(code, encoding="utf-8")
    random = next(each for each in QUESTIONS if each.name == "random")
    field = Field(tmp_path / "out", [bundled("ur5e")], [replace(random, count=25, seconds=5.0)], size=QUICK)
    field.folder.mkdir()
    field = replace(field, size=replace(QUICK, swept=0))
    measured(field, path)
    answers, _ = collect(field)
    assert len(answers) == 5
    assert marked(answers)["near"].any()


def test_a_piece_without_any_joint_values_counts_as_missed(tmp_path: Path) -> None:
    path, field = a_solver(tmp_path, "return Answer(None, False)"), a_field(tmp_path, "random")
    measured(field, path)
    answers, _ = collect(field)
    assert len(answers)
    assert answers["position_error"].isna().all()


def test_time_is_spent_where_shares_vary_and_never_less_than_a_part() -> None:
    known, even, unknown = (
        sweep.noise(each) for each in (sweep.Swept(300, 300, 1.0), sweep.Swept(50, 100, 1.0), None)
    )
    assert known == sweep.LEAST < even == unknown == 1.0
    assert sweep.noise(sweep.Swept(0, 300, 1.0)) == known
    slow_and_sure, quick = sweep.Swept(300, 300, 1e4), sweep.Swept(299, 300, 10.0)
    assert sweep.chosen({"recommended": slow_and_sure, "sweep 1": quick}) == "sweep 1", (
        "within half a percent, the quicker"
    )
    one_missed, all_of_few = sweep.Swept(155, 156, 10.0), sweep.Swept(154, 154, 30.0)
    assert sweep.chosen({"recommended": all_of_few, "sweep 1": one_missed}) == "sweep 1", (
        "one miss of so many is chance"
    )
    many_missed = sweep.Swept(140, 156, 10.0)
    assert sweep.chosen({"recommended": all_of_few, "sweep 1": many_missed}) == "recommended"
    assert sweep.chosen({}) == "recommended"


def test_what_is_installed_from_the_repository_is_made_anew_when_its_sources_change(tmp_path: Path) -> None:
    from benchmarks.workers.environments import required

    (tmp_path / "a.txt").write_text("numpy==2.4.6\n", encoding="utf-8")
    (tmp_path / "b.txt").write_text(".\nnumpy==2.4.6\n", encoding="utf-8")
    assert required(tmp_path / "none.py") == ""
    assert len({required(tmp_path / name) for name in ("a.py", "b.py")}) == 2


def test_the_page_of_speed_is_what_the_table_of_the_readme_shows() -> None:
    def rows(solver: str, question: str, microseconds: float) -> list[dict[str, object]]:
        counted = {"exact": True, "near": True, "false": False}
        return [
            {"solver": solver, "settings": "best", "arm": "panda", "question": question, "part": i % SLICES}
            | {"microseconds": microseconds + i - 8, "relative": (microseconds + i - 8) / 8.0}
            | counted
            for i in range(17)
        ]

    answers = pd.DataFrame(
        [*rows("one", "random", 8.0), *rows("one", "singular", 9.0), *rows("two", "random", 20.0)]
    )
    names = {"one": "One", "two": "Two", "three": "Three", "four": "Four"}
    text = summary("some", answers, names, ["**Two** is smaller."]).text
    assert "- **Two** is smaller." in text
    assert "| One | 1 | 100.0 (81.6–100.0) | 100.0 (81.6–100.0) | – | 8.0 | 1 (0.75–1) | 0 |" in text
    reasons = {("three", ""): "could not be installed: no such wheel", ("four", "panda"): "hangs"}
    text = speed("some", answers, names, reasons).text
    assert "| panda | Three | – | – | – | – | – | – | – | could not be installed |" in text
    assert table(text).splitlines()[2:] == [
        "| One | 8.0 | 100.0 – 100.0 % |",
        "| Two | 20.0 (2.5) | – |",
        "| Four | – | hangs |",
        "| Three | – | could not be installed |",
    ]
