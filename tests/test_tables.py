"""Results as tables, and what each writer makes of the same columns."""

from __future__ import annotations

import csv
import json
import os
import sys
from pathlib import Path

import numpy as np
import pytest

import kinseek
from kinseek.support.whole_file import whole_file
from kinseek.tables import Table, branches_table, path_table, solution_table, write_table

UR5E = kinseek.load("ur5e")
TARGETS = UR5E.fk(UR5E.sample(30, seed=2))
SPOILT = np.where(np.arange(30)[:, None, None] == 2, np.nan, TARGETS)
FACTS = ["success", "status", "position_error", "orientation_error", "weighted_error", "evaluations"]


@pytest.mark.slow
def test_a_solution_as_a_data_frame() -> None:
    pd = pytest.importorskip("pandas")
    solution = UR5E.ik(SPOILT, bad="skip")
    table = solution.to_frame()
    assert list(table.columns) == [*UR5E.joint_names, *FACTS]
    np.testing.assert_array_equal(table[list(UR5E.joint_names)].to_numpy(), solution.q)
    assert table.index.name == "target"
    assert table["status"].value_counts().to_dict() == {"SOLVED": 29, "INVALID": 1}
    assert (table.dtypes["success"], table.dtypes["evaluations"]) == (np.dtype(bool), np.dtype(np.int64))
    one = UR5E.ik(TARGETS[0]).to_frame()
    assert (one.shape, one["status"][0]) == ((1, 6 + len(FACTS)), "SOLVED")
    grid = UR5E.ik(TARGETS.reshape(5, 6, 4, 4)).to_frame()
    assert isinstance(grid.index, pd.MultiIndex)
    assert grid.loc[(1, 2), "elbow_joint"] == UR5E.ik(TARGETS.reshape(5, 6, 4, 4)).q[1, 2, 2]
    assert UR5E.ik(np.zeros((0, 4, 4))).to_frame().shape == (0, 6 + len(FACTS))


def test_branches_as_a_data_frame() -> None:
    pytest.importorskip("pandas")
    branches = UR5E.branches(TARGETS[0])
    table = branches.to_frame()
    np.testing.assert_array_equal(table[list(UR5E.joint_names)].to_numpy(), branches.q)
    many = UR5E.branches(TARGETS[:3])
    assert isinstance(many, kinseek.BranchesBatch)
    table = many.to_frame()
    assert table.index.names == ["target", "branch"]
    np.testing.assert_array_equal(table.loc[1, "elbow_joint"].to_numpy(), many[1].q[:, 2])
    empty = UR5E.branches(np.zeros((0, 4, 4)))
    with pytest.raises(kinseek.InvalidUse, match="a batch of no goals has no table"):
        empty.to_frame()


def test_every_joint_has_a_column_whatever_it_is_called() -> None:
    names = ["success", "joint success", "joint joint success", "t", "x"]
    q = np.arange(10.0).reshape(2, 5)
    columns = Table(names, q, {"success": np.array([True, False]), "t": np.zeros(2)}, {}).by_name()
    expected = ["joint joint joint success", "joint success", "joint joint success", "joint t", "x"]
    assert list(columns) == [*expected, "success", "t"]
    np.testing.assert_array_equal(np.stack([columns[name] for name in expected], axis=1), q)


@pytest.mark.skipif(os.name == "nt", reason="needs POSIX permissions")
@pytest.mark.parametrize("mode", [0o600, 0o640, 0o666])
def test_a_file_that_is_replaced_keeps_its_permissions(tmp_path: Path, mode: int) -> None:
    path = tmp_path / "q.csv"
    path.touch()
    path.chmod(mode)
    write_table(path, solution_table(UR5E.ik(TARGETS[0])))
    assert path.read_text().startswith("shoulder_pan_joint,")
    assert path.stat().st_mode & 0o777 == mode


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root gives files away")
@pytest.mark.parametrize(("mode", "elsewhere"), [(0o640, 0o600), (0o660, 0o600), (0o644, 0o644)])
def test_a_file_that_is_replaced_keeps_its_group(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, mode: int, elsewhere: int
) -> None:
    """The members of this user's group need not be those who may read it."""
    path = tmp_path / "q.csv"
    path.touch()
    path.chmod(mode)
    os.chown(path, -1, 65534)
    with whole_file(path) as file:
        file.write(b"q")
    assert (path.stat().st_gid, path.stat().st_mode & 0o777) == (65534, mode)

    def refused(*_: int) -> None:
        raise PermissionError

    monkeypatch.setattr(os, "fchown", refused)
    with whole_file(path) as file:
        file.write(b"q")
    assert (path.stat().st_gid, path.stat().st_mode & 0o777) == (os.getegid(), elsewhere)


@pytest.mark.skipif(os.name == "nt", reason="needs POSIX permissions")
def test_a_file_that_is_replaced_runs_as_nobody(tmp_path: Path) -> None:
    path = tmp_path / "q.csv"
    path.touch()
    path.chmod(0o6777)
    with whole_file(path) as file:
        file.write(b"q")
        assert os.fstat(file.fileno()).st_mode & 0o7777 == 0o777


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root gives files away")
def test_another_user_who_made_the_file_first_cannot_write_to_it(tmp_path: Path) -> None:
    """In a folder like /tmp anybody can make a file with the name of a program that root saves."""
    path = tmp_path / "q.csv"
    path.touch()
    path.chmod(0o666)
    os.chown(path, 65534, 65534)
    with whole_file(path) as file:
        assert os.fstat(file.fileno()).st_mode & 0o777 == 0o644
    assert (path.stat().st_uid, path.stat().st_mode & 0o777) == (0, 0o644)


@pytest.mark.skipif(os.name == "nt", reason="needs POSIX permissions")
def test_permissions_of_no_other_file_change(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, private = tmp_path / "q.csv", tmp_path / "key"
    for each, mode in ((path, 0o640), (private, 0o600)):
        each.touch()
        each.chmod(mode)
    chmod = os.chmod

    def exchanged(place: int | str | Path, mode: int, **named: bool) -> None:
        (part,) = tmp_path.glob(".*.part")
        assert not part.stat().st_mode & ~mode & 0o777
        part.unlink()
        part.symlink_to(private)
        chmod(place, mode, **named)

    monkeypatch.setattr(os, "chmod", exchanged)
    monkeypatch.setattr(os, "supports_fd", {*os.supports_fd, exchanged})
    with whole_file(path) as file:
        file.write(b"q")
    assert private.stat().st_mode & 0o777 == 0o600


def test_a_path_as_rows() -> None:
    path = UR5E.follow(np.array([kinseek.pose([0.4, y, 0.3], rpy=[np.pi, 0, 0]) for y in (0.0, 0.01, 5.0)]))
    rows = path_table(path).records()
    assert list(rows[0]) == ["q", "reached", "position_error", "orientation_error", "break_after"]
    assert [row["reached"] for row in rows] == [True, True, False]
    assert rows[1]["q"] == path.q[1].tolist()


def test_a_joint_called_as_a_column_is(tmp_path: Path) -> None:
    arm = kinseek.Arm.from_dh([(0.5, 0, 0, 0)] * 2, [-1, -1], [1, 1], names=["status", "b"])
    table = solution_table(arm.ik(arm.fk([0.1, 0.2])))
    assert list(table.by_name()) == ["joint status", "b", *FACTS]
    write_table(tmp_path / "q.csv", table)
    assert (tmp_path / "q.csv").read_text().startswith("joint status,b,success,")


def test_a_column_may_have_a_number_for_each_joint(tmp_path: Path) -> None:
    q = np.array([[0.1, 0.2], [0.3, 0.4]])
    columns = {"t": np.array([0.0, 1.0]), "velocity": 10 * q}
    table = Table(["a", "a velocity"], q, columns, {"sample": np.arange(2)})
    assert list(table.by_name()) == ["a", "joint a velocity", "t", "a velocity", "a velocity velocity"]
    np.testing.assert_array_equal(table.by_name()["a velocity"], [1.0, 3.0])
    assert table.records()[1] == {"q": [0.3, 0.4], "t": 1.0, "velocity": [3.0, 4.0]}
    write_table(tmp_path / "q.npy", table)
    np.testing.assert_array_equal(np.load(tmp_path / "q.npy")["velocity"], 10 * q)


@pytest.mark.parametrize("every", [False, True])
def test_every_writer_has_the_same_columns(every: bool, tmp_path: Path) -> None:
    pytest.importorskip("pandas")
    parquet = pytest.importorskip("pyarrow.parquet")
    table = branches_table(UR5E.branches(TARGETS[0])) if every else solution_table(UR5E.ik(TARGETS))
    names = list(table.by_name())
    for ending in ("csv", "npy", "parquet"):
        write_table(tmp_path / f"q.{ending}", table)
    with (tmp_path / "q.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    written = parquet.read_table(tmp_path / "q.parquet")
    records = np.load(tmp_path / "q.npy")
    assert list(rows[0]) == written.column_names == list(table.to_frame().columns) == names
    assert list(records.dtype.names) == list(table.records()[0]) == ["q", *names[6:]]
    np.testing.assert_array_equal(records["q"], table.q)
    for name, values in table.columns.items():
        np.testing.assert_array_equal(records[name], values)
        assert written.column(name).to_pylist() == values.tolist()
        assert [row[name] for row in rows] == [
            str(value).replace("True", "true") for value in values.tolist()
        ]


def test_an_error_that_the_goal_does_not_have() -> None:
    goal = kinseek.Goal.position([0.4, 0.2, 0.3])
    (solution,) = solution_table(UR5E.ik(goal)).records()
    (branch, *_) = branches_table(UR5E.branches(goal, count=2)).records()
    assert solution["orientation_error"] is branch["orientation_error"] is None
    assert json.loads(json.dumps(solution, allow_nan=False)) == solution


def test_without_pandas_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(kinseek.MissingExtra, match=r"pip install 'kinseek\[frame\]'"):
        UR5E.ik(TARGETS[0]).to_frame()
