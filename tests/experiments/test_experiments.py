"""Every experiment runs, writes what it promises, counts exactly, resumes, and says what is wrong."""

import csv
import json
import math
import shutil
from pathlib import Path

import numpy as np
import pytest

import kinseek
from experiments import __main__ as command
from experiments import claims, judges, readings
from experiments.arms import ARMS, divide_and_conquer_nodes, equation_1, random_goals
from experiments.effort import EXPERIMENTS, Effort, Row, experiment
from experiments.store import Store, read_rows

pytestmark = pytest.mark.slow

pytest.importorskip("matplotlib")

QUICK = Effort(quick=True)
ROOT = Path(command.__file__).parent


@pytest.fixture(scope="session")
def quick(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results of a quick run of everything."""
    folder = tmp_path_factory.mktemp("results")
    assert command.main(["--quick", "--out", str(folder)]) == 0
    return folder


@pytest.fixture(scope="session")
def figure_05(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results of a quick run of one experiment."""
    folder = tmp_path_factory.mktemp("figure_05")
    assert command.main(["figure_05", "--quick", "--out", str(folder)]) == 0
    return folder


@pytest.mark.thorough
@pytest.mark.parametrize("name", EXPERIMENTS)
def test_schema(quick: Path, name: str) -> None:
    module = experiment(name)
    with (quick / f"{name}.csv").open() as file:
        header, *lines = csv.reader(file)
    cases = module.cases(QUICK)
    keys = list(cases[0])
    with (ROOT / "results" / f"{name}.csv").open() as file:
        assert header == next(csv.reader(file)), "the kept results have other columns"
    assert keys == header[: len(keys)], "the columns of a case come first"
    assert [line[: len(keys)] for line in lines] == [[str(case[key]) for key in keys] for case in cases]
    for row in read_rows(quick / f"{name}.csv"):
        for column in header[len(keys) :]:
            value = row[column]
            if column not in ("breadths", "q_digest"):
                assert isinstance(value, int | float), (column, value)
                assert math.isfinite(value), (column, value)
            if column.startswith(("position_", "orientation_", "nodes_", "points")):
                assert isinstance(value, int | float)
                assert value >= 0
    assert not list(quick.glob("*.part")), "nothing unfinished is left"


@pytest.mark.thorough
@pytest.mark.parametrize("name", EXPERIMENTS)
def test_manifest_and_picture(quick: Path, name: str) -> None:
    told = json.loads((quick / f"{name}.json").read_text())
    assert told["arguments"] == {"quick": True, "seed": 0}
    assert told["rows"] == len(experiment(name).cases(QUICK))
    assert told["versions"]["kinseek"] == kinseek.__version__
    assert told["command"] == f"python -m experiments {name} --quick"
    assert {"processor", "cores", "commit", "seconds", "finished"} <= set(told)
    assert (quick / f"{name}.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("name", ["figure_05", "figure_06", "figure_09", "figure_10"])
@pytest.mark.parametrize("kept", [pytest.param(False, marks=pytest.mark.thorough), True])
def test_node_counts_equal_closed_forms(request: pytest.FixtureRequest, name: str, kept: bool) -> None:
    folder = ROOT / "results" if kept else request.getfixturevalue("quick")
    rows = read_rows(folder / f"{name}.csv")
    counted = "nodes_created" if name == "figure_10" else "nodes_expanded"
    for row in rows:
        assert row[counted] == row["closed_form"], row


def test_closed_forms_by_hand() -> None:
    assert equation_1(60, 4) == 60 + 60**2 + 60**3 + 60**4
    # B = 9, D = 3: spacings 3 and 1; the first pass 3 + 9, the second 5 + 25 with Br = 2.
    assert divide_and_conquer_nodes(9, 3, (2, 2)) == 3 + 9 + 5 + 25


@pytest.mark.parametrize("divisions", [3, 4, 5, 8])
@pytest.mark.parametrize("breadth", [1, 2, 3])
def test_the_slow_twin_gives_the_same_answers(divisions: int, breadth: int) -> None:
    arm = kinseek.load("planar2")
    goals = random_goals(arm, 40, 3)
    solver = kinseek.DivideAndConquer(7200, divisions, breadth)
    slow = readings.search(arm, goals, readings.Reading(), 7200, divisions, breadth)
    np.testing.assert_allclose(slow, arm.ik(goals, solver=solver).q, atol=1e-12)


def test_spacings_of_the_readings() -> None:
    reading = readings.Reading
    assert reading().spacings(7200, 32) == [225, 7, 1]
    assert reading(last="below one").spacings(7200, 32) == [225, 7]
    assert reading(divisor="B", last="below one").spacings(7200, 3) == [2400]
    assert reading(rounding="up").spacings(7200, 32) == [225, 8, 1]
    assert reading(rounding="exact").spacings(10, 4) == [2.5, 1.0]


def test_a_finished_experiment_is_skipped_unless_forced(
    figure_05: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for path in figure_05.glob("figure_05.*"):
        shutil.copy(path, tmp_path)
    manifest = tmp_path / "figure_05.json"
    before = manifest.stat().st_mtime_ns
    asked = ["figure_05", "--quick", "--out", str(tmp_path)]
    assert command.main(asked) == 0
    assert "finished already" in capsys.readouterr().out
    assert manifest.stat().st_mtime_ns == before
    assert command.main([*asked, "--force"]) == 0
    assert manifest.stat().st_mtime_ns > before
    assert command.main([*asked, "--seed", "1"]) == 0, "other arguments run again"
    assert json.loads(manifest.read_text())["arguments"]["seed"] == 1


class Interrupted:
    """Figure 5, interrupted after some rows."""

    def __init__(self, after: int) -> None:
        self.module, self.after, self.measured = experiment("figure_05"), after, 0
        self.cases, self.draw = self.module.cases, self.module.draw

    def measure(self, case: Row, effort: Effort) -> Row:
        if self.measured == self.after:
            raise KeyboardInterrupt
        self.measured += 1
        return self.module.measure(case, effort)


def test_an_interrupted_run_resumes_without_losing_rows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = ["figure_05", "--quick", "--out", str(tmp_path)]
    first, second = Interrupted(2), Interrupted(99)
    monkeypatch.setattr(command, "experiment", lambda name: first)
    assert command.main(asked) == 130
    assert "same command goes on" in capsys.readouterr().err
    assert not (tmp_path / "figure_05.csv").exists(), "half a result has no final name"
    partial = tmp_path / "figure_05.csv.part"
    with partial.open("a") as file:
        file.write("4,sca")  # A line that a power cut left behind.
    monkeypatch.setattr(command, "experiment", lambda name: second)
    assert command.main(asked) == 0
    total = len(first.cases(QUICK))
    assert second.measured == total - 2
    rows = Store(tmp_path, "figure_05").rows()
    assert [row["method"] for row in rows] == [case["method"] for case in first.cases(QUICK)]


def test_rows_of_other_arguments_are_not_taken_over(tmp_path: Path) -> None:
    module = experiment("figure_05")
    store = Store(tmp_path, "figure_05")
    store.begin(QUICK)
    case = module.cases(QUICK)[0]
    store.append({**case, **module.measure(case, QUICK)})
    assert len(store.begin(QUICK)) == 1
    assert store.begin(Effort(quick=True, seed=7)) == []


def test_unknown_experiment(capsys: pytest.CaptureFixture[str]) -> None:
    assert command.main(["figure_12"]) == 2
    told = capsys.readouterr().err
    assert "figure_12" in told
    assert "figure_05" in told
    assert "Traceback" not in told


def test_unwritable_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("")
    assert command.main(["figure_05", "--quick", "--out", str(blocked / "results")]) == 2
    told = capsys.readouterr().err
    assert "cannot write" in told
    assert "--out" in told


def test_redraw_without_rows(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert command.main(["figure_05", "--redraw", "--out", str(tmp_path)]) == 2
    assert "has not been run" in capsys.readouterr().err


def test_rows_of_an_older_version(
    figure_05: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "figure_05.csv").write_text("other,columns\n1,2\n")
    shutil.copy(figure_05 / "figure_05.json", tmp_path)
    assert command.main(["figure_05", "--quick", "--out", str(tmp_path)]) == 2
    assert "--force" in capsys.readouterr().err


def test_the_committed_tables_are_what_the_committed_rows_give() -> None:
    results = judges.Results(ROOT / "results")
    for page in claims.PAGES:
        assert claims.rewritten(page, results) == (claims.ROOT / page).read_text(), (
            "python -m experiments claims"
        )


def test_every_claim_has_one_of_the_verdicts() -> None:
    table = claims.claims_table(judges.Results(ROOT / "results")).splitlines()[2:]
    assert len(table) == len(judges.CLAIMS) == 23
    verdicts = ("**holds**", "**holds in part**", "**does not hold**")
    assert all(any(f"| {verdict} |" in line for verdict in verdicts) for line in table)


def test_the_committed_results_are_the_full_ones() -> None:
    for name in EXPERIMENTS:
        told = json.loads((ROOT / "results" / f"{name}.json").read_text())
        assert told["arguments"] == {"quick": False, "seed": 0}
        assert told["rows"] == len(experiment(name).cases(Effort()))
        assert (ROOT / "results" / f"{name}.png").exists()


def test_the_arms_reach_equally_far() -> None:
    assert {dof: kinseek.load(name).dof for dof, name in ARMS.items()} == {dof: dof for dof in ARMS}
