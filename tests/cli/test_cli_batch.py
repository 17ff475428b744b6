"""``kinseek solve --batch``: tables in, tables out, rows named in errors, nothing half-written."""

from __future__ import annotations

import csv
import io
import json
import os
import subprocess
import sys
import types
import uuid
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

import kinseek
from command_line import CommandLine
from kinseek import tables
from kinseek.cli import files
from kinseek.cli.columns import MATRIX
from kinseek.cli.parquet_pages import unpacked_bytes
from kinseek.tables import Table

ARM = "planar2"
IN = Path("in.parquet")
XYZ = ["x", "y", "z"]
TABLE = Table([], np.zeros((1, 0)), {"a": np.zeros(1)}, {})


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.fixture(name="poses")
def _poses() -> Any:
    arm = kinseek.load("ur5e")
    return arm.fk(arm.sample(5, seed=3))


def write_csv(path: Path, names: str, rows: Any) -> Path:
    lines = [names, *(",".join(f"{value!r}" for value in row) for row in np.asarray(rows).tolist())]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def read_csv(path: Path) -> dict[str, list[str]]:
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    return {name: [row[name] for row in rows] for name in rows[0]}


def angles_of(poses: Any) -> dict[str, Any]:
    from scipy.spatial.transform import Rotation

    turns = Rotation.from_matrix(poses[:, :3, :3])
    return {
        "qw,qx,qy,qz": np.roll(turns.as_quat(), 1, axis=1),
        "roll,pitch,yaw": turns.as_euler("xyz"),
        "rotvec_x,rotvec_y,rotvec_z": turns.as_rotvec(),
        "nx,ny,nz,tx,ty,tz": np.hstack(
            [3.0 * poses[:, :3, 2], 0.2 * poses[:, :3, 0] + 0.01 * poses[:, :3, 2]]
        ),
    }


@pytest.mark.slow
@pytest.mark.parametrize(
    "turn",
    ["qw,qx,qy,qz", "roll,pitch,yaw", "rotvec_x,rotvec_y,rotvec_z", "nx,ny,nz,tx,ty,tz", "matrix"],
)
def test_every_way_to_give_a_pose(turn: str, poses: Any, tmp_path: Path, cli: CommandLine) -> None:
    if turn == "matrix":
        write_csv(tmp_path / "in.csv", ",".join(MATRIX), poses.reshape(-1, 16))
    else:
        rows = np.hstack([poses[:, :3, 3], angles_of(poses)[turn]])
        write_csv(tmp_path / "in.csv", f"x,y,z,{turn}", rows)
    assert "5 poses: 5 reached, 0 not" in cli("solve ur5e --batch in.csv --out out.csv").out
    columns, arm = read_csv(tmp_path / "out.csv"), kinseek.load("ur5e")
    assert list(columns)[:6] == list(arm.joint_names)
    q = np.array([columns[name] for name in arm.joint_names], dtype=float).T
    assert np.abs(arm.fk(q) - poses).max() < 5e-6
    assert columns["success"] == ["true"] * 5
    assert columns["status"] == ["SOLVED"] * 5
    assert max(map(float, columns["position_error"])) <= 1e-6


def test_columns_may_stand_in_any_order_and_be_in_degrees(
    poses: Any, tmp_path: Path, cli: CommandLine
) -> None:
    angles = np.rad2deg(angles_of(poses)["roll,pitch,yaw"])
    rows = np.hstack([angles[:, ::-1], poses[:, :3, 3]])
    source = write_csv(tmp_path / "in.csv", "yaw, pitch ,roll,x,y,z", rows)
    source.write_text("\ufeff" + source.read_text(encoding="utf-8").replace(",", ";"), encoding="utf-8")
    cli("solve ur5e --batch in.csv --out out.npy --deg")
    assert np.abs(kinseek.load("ur5e").fk(np.load("out.npy")["q"]) - poses).max() < 5e-6


def test_a_file_that_a_killed_process_left_is_not_in_the_way(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out, cut = tmp_path / "out.csv", list[str]()

    def killed(*_: Any) -> None:
        cut.extend(each.name for each in tmp_path.iterdir())
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(tables, "_write_csv", killed)
        with pytest.raises(KeyboardInterrupt):
            tables.write_table(out, TABLE)
    (tmp_path / cut[0]).touch()
    tables.write_table(out, TABLE)  # By a process of the same id, as in a container.
    assert out.read_text() == "a\n0.0\n"
    longest = tmp_path / f"{'a' * 251}.csv"
    tables.write_table(longest, TABLE)
    assert longest.exists()


def test_arrays_in_and_out(poses: Any, cli: CommandLine) -> None:
    poses[3, :3, 3] = [5.0, 0.0, 0.0]
    np.save("in.npy", poses)
    facts = cli("solve ur5e --batch in.npy --out out.npy --json", code=1).facts
    assert (facts["poses"], facts["reached"], facts["not_reached"]) == (5, 4, [4])
    found, expected = np.load("out.npy"), kinseek.load("ur5e").ik(poses)
    assert np.array_equal(found["q"], expected.q)
    assert np.array_equal(found["success"], expected.success)
    assert np.array_equal(found["position_error"], expected.position_error)
    assert found["status"].tolist() == [status.name for status in expected.status]


@pytest.mark.slow
def test_parquet_in_and_out(poses: Any, arrow: Arrow, cli: CommandLine) -> None:
    arrow.write(dict(zip(MATRIX, poses.reshape(-1, 16).T, strict=True)))
    cli("solve ur5e --batch in.parquet --out out.parquet")
    table, arm = arrow.parquet.read_table("out.parquet"), kinseek.load("ur5e")
    q = np.stack([table.column(name).to_numpy() for name in arm.joint_names], axis=1)
    assert np.array_equal(q, arm.ik(poses).q)
    assert table.column("success").to_pylist() == [True] * 5


class Arrow(NamedTuple):
    """pyarrow and what tests need of it."""

    pa: Any
    parquet: Any

    def write(self, columns: dict[str, Any], **options: Any) -> None:
        """Write the file in.parquet."""
        self.parquet.write_table(self.pa.table(columns), IN, **options)


@pytest.fixture
def arrow() -> Arrow:
    return Arrow(pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet"))


def npy_of(header: str) -> bytes:
    """A file with a header, and the numbers of one pose."""
    header += " " * (117 - len(header)) + "\n"
    return b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header.encode() + bytes(128)


def shaped(shape: str) -> str:
    return f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}}}"


HEADERS = {
    "a product": shaped("(10**9, 4, 4)"),
    "more than it holds": shaped("(1000000000, 4, 4)"),
    "far more than it holds": shaped(f"({10**30}, 4, 4)"),
    "below zero": shaped("(-1, 4, 4)"),
    "many signs": "-" * 9_000 + "1",
    "a number of Python 2": "(1L," * 1_000,
    "a truth": shaped("(True, 4, 4)"),
    "no type": "{'descr': (), 'fortran_order': False, 'shape': (1, 4, 4)}",
    "lines": "  1\n 2",
    "a key": "{[]: 1}",
    "overflow": shaped(f"({2**57 + 1}, 4, 4)"),
}


def read(name: str, positions: bool = False) -> Any:
    """Poses of a table; positions alone, if that is asked for."""
    return files.read_poses(Path(name), positions, False)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("case", HEADERS)
def test_a_damaged_header_of_an_array_is_refused(case: str) -> None:
    Path("in.npy").write_bytes(npy_of(HEADERS[case]))
    with pytest.raises(kinseek.InvalidGoal, match=r"cannot be read as a \.npy file: ."):
        read("in.npy")


def test_an_archive_of_arrays_is_refused_and_an_array_is_read() -> None:
    np.savez("in.npz", np.eye(4))
    Path("in.npz").rename("in.npy")
    with pytest.raises(kinseek.InvalidGoal, match=r"cannot be read as a \.npy file"):
        read("in.npy")
    np.save("in.npy", np.eye(4)[None])
    assert type(read("in.npy")) is np.ndarray
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[:, :3, 3] = np.arange(9.0).reshape(3, 3)
    np.save("in.npy", np.asfortranarray(poses, dtype=">f4"))
    np.testing.assert_array_equal(read("in.npy"), poses)
    np.save("in.npy", np.empty((0, 4, 4)))
    with pytest.raises(kinseek.InvalidGoal, match="no poses"):
        read("in.npy")


def test_a_file_that_its_owner_shortens_does_not_end_the_process(monkeypatch: pytest.MonkeyPatch) -> None:
    mapped = np.lib.format.open_memmap
    np.save("in.npy", np.tile(np.eye(4), (1000, 1, 1)))

    def shortened(*given: Any, **named: Any) -> Any:
        array = mapped(*given, **named)
        os.truncate("in.npy", 200)
        return array

    monkeypatch.setattr(np.lib.format, "open_memmap", shortened)
    with pytest.raises(kinseek.InvalidGoal, match="it became shorter meanwhile"):
        read("in.npy")


def test_a_parquet_file_that_would_grow_is_refused(arrow: Arrow, monkeypatch: pytest.MonkeyPatch) -> None:
    """1 MB with 30 million rows of zeros took 9 s and 3.6 GB."""
    names = ("x", "y", "z", "qw", "qx", "qy", "qz")
    arrow.write({name: np.ones(100_000) for name in names})
    assert len(read("in.parquet")) == 100_000
    monkeypatch.setattr(files, "MOST_VALUES", 10_000)
    with pytest.raises(kinseek.InvalidGoal, match="700,000 numbers, expected at most"):
        read("in.parquet")
    arrow.write({"x": ["a" * 1000] * 1000})
    with pytest.raises(kinseek.InvalidGoal, match="column x holds string, expected numbers"):
        read("in.parquet")


def plain(value: int, length: int = 0) -> bytes:
    """An unsigned integer of Thrift's compact protocol, as long as is asked for."""
    sevens = [value >> shift & 127 for shift in range(0, max(7 * length, value.bit_length(), 1), 7)]
    return bytes([each | 128 for each in sevens[:-1]] + sevens[-1:])


def varint(value: int, length: int = 0) -> bytes:
    """A signed integer of this protocol."""
    return plain(value << 1 if value >= 0 else (-value << 1) - 1, length)


def test_a_parquet_page_that_would_grow_is_refused(arrow: Arrow, monkeypatch: pytest.MonkeyPatch) -> None:
    """What the footer says is small: pyarrow unpacked 8 GB of 264 kB, for it believes the header of the page."""
    rows = 100_001
    left_out = dict.fromkeys(("use_dictionary", "write_statistics", "store_schema"), False)
    arrow.write({name: np.zeros(rows) for name in XYZ}, compression="zstd", **left_out)
    text = IN.read_bytes()
    start = len(text) - 8 - int.from_bytes(text[-8:-4], "little")
    assert text[start:].count(varint(rows)) >= 4  # In each column, and in the group of them.
    IN.write_bytes(text[:start] + text[start:].replace(varint(rows), varint(4, len(varint(rows)))))
    assert arrow.parquet.read_metadata(IN).num_rows == 4
    monkeypatch.setattr(files, "MOST_VALUES", 1_000)
    with pytest.raises(kinseek.InvalidGoal, match=r"pages of 2,400,[0-9]{3} bytes, expected at most"):
        read("in.parquet", positions=True)


@pytest.mark.parametrize("codec", ["none", "snappy", "zstd"])
@pytest.mark.parametrize("version", ["1.0", "2.0"])
@pytest.mark.parametrize("more", [True, False])
def test_pages_are_added_up(version: str, codec: str, more: bool, arrow: Arrow) -> None:
    """The footer of a file that pyarrow writes counts the same bytes, and the headers of the pages."""
    rng = np.random.default_rng(0)
    columns = {"x": rng.normal(size=20_000), "y": rng.integers(0, 9, 20_000), "z": [None, 1.0] * 10_000}
    options: dict[str, Any] = {"compression": codec, "data_page_version": version, "data_page_size": 9_000}
    options |= dict.fromkeys(("use_dictionary", "write_statistics", "write_page_checksum"), more)
    arrow.write(columns, **options)
    group = arrow.parquet.read_metadata(IN).row_group(0)
    with IN.open("rb") as file:
        for column in map(group.column, range(3)):
            rest = column.total_uncompressed_size - unpacked_bytes(file, column)
            assert 0 < rest < 100 + column.total_uncompressed_size / 50


def field(number: int, kind: int, value: bytes) -> bytes:
    """One of a struct of Thrift's compact protocol."""
    return bytes([kind]) + varint(number) + value


def many(kind: int, count: int, values: bytes) -> bytes:
    """A list of Thrift's compact protocol."""
    return bytes([15 << 4 | kind]) + plain(count) + values


def footer(names: list[str], groups: int = 1, parts: int = 0, more: bytes = b"", kind: int = 12) -> bytes:
    """A Parquet file without a page: so many groups of so many parts, all with the same fields."""
    words = [
        field(1, 5, varint(5)) + field(3, 5, varint(0)) + field(4, 8, plain(len(n)) + n.encode())
        for n in names
    ]
    table = field(4, 8, b"\x01t") + field(5, 5, varint(len(names))) + b"\0"
    schema = many(12, 1 + len(names), table + b"".join(each + b"\0" for each in words))
    part = field(2, 6, varint(0)) + more + b"\0"
    group = (
        field(1, 9, many(kind, parts, part * parts)) + field(2, 6, varint(0)) + field(3, 6, varint(0)) + b"\0"
    )
    text = field(1, 5, varint(1)) + field(2, 9, schema) + field(3, 6, varint(0))
    text += field(4, 9, many(12, groups, group * groups)) + b"\0"
    return b"PAR1" + text + len(text).to_bytes(4, "little") + b"PAR1"


FOOTERS: dict[str, tuple[bytes, str]] = {
    "no rows": (footer(XYZ, 1, 3), "holds no poses"),
    "more parts than columns": (footer(XYZ, 4, 1000), "a group of rows has 1,000 columns, expected 3"),
    "too few parts": (footer(XYZ, 1, 2), "a group of rows has 2 columns, expected 3"),
    "very many parts": (footer(XYZ, 4, 10_000), "it has 40,000 parts of columns, expected at most 32,768"),
    "very many columns": (
        footer([f"c{i}" for i in range(1001)], 0),
        "it has 1,001 columns, expected at most 1,000",
    ),
    "unknown columns": (footer(["x", "y", "height"], 1, 3), "unknown column 'height'"),
    "encrypted": (
        footer(XYZ, 1, 3, field(8, 12, field(2, 12, field(1, 9, many(8, 1, b"\x01x")) + b"\0") + b"\0")),
        "its columns are encrypted",
    ),
    "encrypted by the footer's key": (
        footer(XYZ, 1, 3, field(8, 12, field(1, 12, b"\0") + b"\0")),
        "its columns are encrypted",
    ),
    "parts that are numbers": (footer(XYZ, 1, 3, kind=5), "a list of an unexpected type"),
    "large": (
        b"PAR1" + b"\0" * 2_000_000 + (2_000_000).to_bytes(4, "little") + b"PAR1",
        "takes 2,000,000 bytes",
    ),
    "longer than the file": (b"PAR1" + (2**32 - 1).to_bytes(4, "little") + b"PAR1", "not end with a footer"),
    "cut": (footer(XYZ, 1, 3)[:-20] + footer(XYZ, 1, 3)[-8:], "footer"),
    "nested": (
        b"PAR1" + b"\x1c" * 100_000 + (100_000).to_bytes(4, "little") + b"PAR1",
        "its footer is damaged",
    ),
}


READ_ALL = """
import json, pathlib, sys
import kinseek
from kinseek.cli import files
for path in sys.argv[1:]:
    try:
        files.read_poses(pathlib.Path(path), True, False)
    except kinseek.InvalidGoal as error:
        print(json.dumps([path, str(error)]), flush=True)
"""


@pytest.fixture(name="refusals", scope="module")
def _refusals(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Why each footer is refused; in a process of its own, which pyarrow may end."""
    pytest.importorskip("pyarrow")
    paths = {case: tmp_path_factory.mktemp("footer") / "in.parquet" for case in FOOTERS}
    for case, path in paths.items():
        path.write_bytes(FOOTERS[case][0])
    ended = subprocess.run(
        [sys.executable, "-c", READ_ALL, *paths.values()],
        check=False,
        capture_output=True,
        text=True,
        timeout=100,
    )
    said = dict(json.loads(line) for line in ended.stdout.splitlines())
    return {case: said.get(str(path), f"not refused: {ended}") for case, path in paths.items()}


@pytest.mark.slow
@pytest.mark.parametrize("case", FOOTERS)
def test_a_footer_that_pyarrow_would_end_for_is_refused(case: str, refusals: dict[str, str]) -> None:
    """75 bytes ended Python without an error; 9.5 MB took 86 s and 3.3 GB."""
    assert FOOTERS[case][1] in refusals[case]


def test_a_footer_of_many_groups_is_read(arrow: Arrow) -> None:
    pa, parquet = arrow
    table = pa.table({name: np.arange(20_000.0) for name in XYZ}).replace_schema_metadata({"a": "b"})
    options = {"row_group_size": 50, "write_page_index": True, "sorting_columns": [parquet.SortingColumn(0)]}
    parquet.write_table(table, IN, **options)
    assert len(read("in.parquet", positions=True)) == 20_000


def test_a_parquet_file_with_groups_of_no_rows(arrow: Arrow) -> None:
    pa, parquet = arrow
    schema = pa.schema([(name, pa.float64()) for name in XYZ])
    for counts in ((3, 0, 5), (0,)):
        with parquet.ParquetWriter(IN, schema) as writer:
            for count in counts:
                writer.write_table(pa.table(dict.fromkeys(XYZ, np.ones(count)), schema=schema))
        if sum(counts):
            assert len(read("in.parquet", positions=True)) == 8
    with pytest.raises(kinseek.InvalidGoal, match="no poses"):
        read("in.parquet", positions=True)


HEADER = b"\x15\x00\x15" + varint(9) + b"\x15" + varint(3) + b"\x2c\x15" + varint(2) + b"\x00"
"""Of a page of 3 bytes with 2 values that unpacks to 9, with nothing more."""
PAGES = {
    "a size below zero": HEADER.replace(varint(9), varint(-9)) + b"\x00abc",
    "a size that is cut off": HEADER.replace(varint(3), varint(2**31 + 3)) + b"\x00abc",
    "longer than the column": HEADER.replace(varint(3), varint(4)) + b"\x00abc",
    "few values": HEADER.replace(varint(2) + b"\x00", varint(1) + b"\x00") + b"\x00abc",
    "values of no page": HEADER.replace(b"\x15\x00", b"\x15\x02") + b"\x00abc",
    "values that are no struct": HEADER[:6] + b"\x25\x00\x00abc",
    "a size that is no number": b"\x15\x00\x1c\x00\x15\x00\x2c\x15\x04\x00\x00abc",
    "a size that is a text": b"\x15\x00\x15\x00\x18\x00\x2c\x15\x04\x00\x00abc",
    "no size": HEADER[:5] + b"\x00abc",
    "an end in the middle": HEADER,
    "a field twice": HEADER + b"\x05" + varint(2) + varint(10**9) + b"\x00abc",
    "a field that is cut off": HEADER + b"\x05" + varint(2**16 + 2) + varint(10**9) + b"\x00abc",
    "an unknown type": HEADER + b"\x1f\x00abc",
    "structs without an end": HEADER + b"\x1c" * 100_000,
    "a number without an end": b"\x15" + b"\xff" * 100,
    "a text without an end": HEADER + b"\x18" + b"\xff" * 9 + b"\x01\x00abc",
}


def column_of(text: bytes) -> Any:
    return types.SimpleNamespace(
        data_page_offset=0, dictionary_page_offset=None, total_compressed_size=len(text), num_values=4
    )


@pytest.mark.parametrize("case", PAGES)
def test_a_damaged_header_of_a_page_is_refused(case: str) -> None:
    good = HEADER + b"\x00abc"
    assert unpacked_bytes(io.BytesIO(2 * good), column_of(2 * good)) == 18
    text = good + PAGES[case]
    with pytest.raises(ValueError, match="page"):
        unpacked_bytes(io.BytesIO(text), column_of(text))


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes here")
@pytest.mark.parametrize("ending", tables.TABLE_ENDINGS)
def test_a_pipe_or_a_device_is_no_table(ending: str) -> None:
    """A pipe that nobody writes to hung, and /dev/zero filled the memory."""
    table = Path(f"in{ending}")
    os.mkfifo(table)
    with pytest.raises(kinseek.InvalidProblem, match="it is a pipe, expected a regular file"):
        read(table.name)
    table.unlink()
    table.symlink_to("/dev/null")  # As /dev/zero, which has no end.
    with pytest.raises(kinseek.InvalidProblem, match="it is a device, expected a regular file"):
        read(table.name)


@pytest.mark.parametrize("before", [b"", b"x,y,z\n1,2,3\n"])
def test_a_line_has_a_largest_length(before: bytes) -> None:
    """Such a line was held in memory as a whole, and a file with a hole of 1 TB has few bytes on disk."""
    with Path("in.csv").open("wb") as file:
        file.write(before)
        file.truncate(2**22)
    number = before.count(b"\n") + 1
    with pytest.raises(kinseek.InvalidGoal, match=f"line {number} has more than 1,048,576 letters"):
        read("in.csv")


def test_without_pyarrow_it_says_what_to_install(
    poses: Any, monkeypatch: pytest.MonkeyPatch, cli: CommandLine
) -> None:
    np.save("in.npy", poses)
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    assert "pip install 'kinseek[parquet]'" in cli.refused("solve ur5e --batch in.npy --out o.parquet")


def test_every_answer_of_every_pose(poses: Any, cli: CommandLine) -> None:
    np.save("in.npy", poses)
    cli("solve ur5e --batch in.npy --out out.csv --all")
    columns, arm = read_csv(Path("out.csv")), kinseek.load("ur5e")
    expected = arm.branches(poses)
    assert [columns["row"].count(str(k + 1)) for k in range(5)] == expected.counts.tolist()
    assert np.array_equal(np.array([columns[name] for name in arm.joint_names], dtype=float).T, expected.q)


def test_options_of_a_goal_hold_for_every_row(cli: CommandLine) -> None:
    rows = [[0.3, 0.4, 0.0], [0.3, -0.4, 0.0]]
    write_csv(Path("in.csv"), "x,y,z", rows)
    cli("solve", ARM, "--batch in.csv --out out.npy --position-only --near joint1=1,joint2=-2")
    near = kinseek.load(ARM).ik(kinseek.Goal.position(rows), near=[1.0, -2.0])
    assert np.array_equal(np.load("out.npy")["q"], near.q)


WRONG = {
    "unknown column": ("x,y,z,qw,qx,qy,qq\n1,2,3,1,0,0,0\n", "unknown column 'qq'; did you mean"),
    "valid ones": ("x,y,zz\n1,2,3\n", "Valid: x, y, z with qw, qx, qy, qz or roll, pitch, yaw or rotvec_x"),
    "missing": ("x,y,z,qw,qx,qy\n1,2,3,1,0,0\n", "missing column qz"),
    "no rotation": ("x,y,z\n1,2,3\n", "columns of a rotation are missing"),
    "one axis": ("x,y,z,nx,ny,nz\n1,2,3,0,0,1\n", "missing column tx, ty, tz"),
    "axes with another rotation": ("x,y,z,roll,pitch,yaw,nx\n1,2,3,0,0,0,1\n", "more than one way"),
    "oblique axes": (
        "x,y,z,nx,ny,nz,tx,ty,tz\n0,0,0,0,0,1,1,0,0\n0,0,0,0,0,1,1,0,1\n",
        "in.csv: row 2: the angle between z_axis and x_axis must be within 10° of 90°, got 45°",
    ),
    "two rotations": ("x,y,z,qw,qx,qy,qz,roll,pitch,yaw\n1,2,3,1,0,0,0,0,0,0\n", "more than one way"),
    "misspelt": ("x,y,z,qw,qx,qy,q_z\n1,2,3,1,0,0,0\n", "did you mean 'qz' or 'z'? Valid: x,"),
    "twice": ("x,x,z\n1,2,3\n", "two columns are called 'x'"),
    "no header": ("1,2,3,1,0,0,0\n", "the first row must name the columns"),
    "empty file": ("", "the first row must name the columns, got nothing"),
    "no rows": ("x,y,z,qw,qx,qy,qz\n", "holds no poses"),
    "a word": (
        "x,y,z,qw,qx,qy,qz\n1,2,3,1,0,0,0\n1,two,3,1,0,0,0\n",
        "row 2: y is 'two', which is not a number",
    ),
    "a decimal comma": (
        "x;y;z;qw;qx;qy;qz\n1;2;3;1;0;0;0\n1;2,5;3;1;0;0;0\n",
        "row 2: y is '2,5', which is not a number; numbers have a point",
    ),
    "far away": (
        "x,y,z,roll,pitch,yaw\n1,2,3,0,0,0\n2e7,2,3,0,0,0\n",
        "in.csv: row 2: a position must lie within 1e+07 m",
    ),
    "blanks for commas": (
        "x y z\n0.4 0.2 0.3\n",
        "row 1: x y z is '0.4 0.2 0.3', which is not a number; columns are separated by commas, not by blanks",
    ),
    "a blank in a number": ("x,y,z\n1,2,3\n1,2 000,3\n", "row 2: y is '2 000', which is not a number"),
    "digits of another script": ("x,y,z\n1,\u0662,3\n", "row 1: y is '\u0662', which is not a number"),
    "a number of Python": ("x,y,z\n1,2,3\n1,2_0,3\n", "row 2: y is '2_0', which is not a number"),
    "nothing": ("x,y,z,qw,qx,qy,qz\n1,2,3,1,0,0,0\n1,,3,1,0,0,0\n", "row 2: y is '', which is not a number"),
    "short row": ("x,y,z,qw,qx,qy,qz\n1,2,3,1,0,0,0\n1,2,3\n", "row 2: 3 values, expected 7"),
    "all rows short": ("x,y,z,qw,qx,qy,qz\n1,2,3\n1,2,3\n", "row 1: 3 values, expected 7"),
    "no end of a letter": (
        "x,y,z,qw,qx,qy,qz\n" + "a" * 200_000 + "\n",
        "cannot be read as a table: field larger",
    ),
    "a blank row": ("x,y,z,qw,qx,qy,qz\n   \n", "row 1: 1 values, expected 7"),
    "infinite": ("x,y,z,qw,qx,qy,qz\n1,2,3,1,0,0,0\n\n1,2,inf,1,0,0,0\n", "row 2: z is inf"),
    "no quaternion": (
        "x,y,z,qw,qx,qy,qz\n1,2,3,1,0,0,0\n1,2,3,0,0,0,0\n1,2,3,1,0,0,0\n",
        "row 2: quat_wxyz has length 0",
    ),
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_tables(case: str, tmp_path: Path, cli: CommandLine) -> None:
    text, said = WRONG[case]
    Path("in.csv").write_text(text, encoding="utf-8")
    assert said in cli.refused("solve ur5e --batch in.csv --out out.csv")
    assert [path.name for path in tmp_path.iterdir()] == ["in.csv"]


@pytest.mark.parametrize(("header", "row"), [("a," * 500_000, "1"), ("x,y,z", "1,2," + "a" * 100_000)])
def test_what_is_wrong_is_said_in_few_words(header: str, row: str, cli: CommandLine) -> None:
    Path("in.csv").write_text(f"{header}\n{row}\n", encoding="utf-8")
    assert len(cli.refused("solve ur5e --position-only --batch in.csv --out out.csv")) < 2_000


def test_the_place_of_a_byte_that_is_no_text(cli: CommandLine) -> None:
    rows = b"x,y,z\n" + 10_000 * b"1,2,3\n"
    Path("in.csv").write_bytes(rows + b"\xe4,1,2\n")
    assert f"at byte {len(rows):,}" in cli.refused("solve ur5e --position-only --batch in.csv --out out.csv")


@pytest.mark.skipif(not hasattr(os, "symlink"), reason="links")
@pytest.mark.parametrize(
    ("name", "target"), [("o.npy", "blob"), ("o.csv", "o.npy"), ("o.parquet", "blob.csv")]
)
def test_the_name_that_was_given_decides_the_format(
    name: str, target: str, poses: Any, cli: CommandLine
) -> None:
    if name.endswith("parquet"):
        pytest.importorskip("pyarrow")
    np.save("in.npy", poses)
    Path(name).symlink_to(target)
    cli("solve ur5e --batch in.npy --out", name)
    start = {"o.npy": b"\x93NUMPY", "o.csv": b"shoulder", "o.parquet": b"PAR1"}[name]
    assert Path(target).read_bytes().startswith(start)


def test_a_write_protected_file_stays(poses: Any, cli: CommandLine) -> None:
    np.save("in.npy", poses)
    Path("out.csv").write_text("kept", encoding="utf-8")
    Path("out.csv").chmod(0o444)
    assert "'out.csv' is write-protected" in cli.refused("solve ur5e --batch in.npy --out out.csv")
    assert Path("out.csv").read_text(encoding="utf-8") == "kept"


def test_a_damaged_name_of_a_parquet_column(arrow: Arrow, cli: CommandLine) -> None:
    pa, parquet = arrow
    parquet.write_table(pa.table({name: [1.0] for name in "xyz"}), IN)
    IN.write_bytes(IN.read_bytes().replace(b"\x01x", b"\x01\xcb"))
    assert "cannot be read as a Parquet file" in cli.refused(
        "solve ur5e --position-only --batch in.parquet --out out.csv"
    )


@pytest.mark.parametrize("end", ["os.abort()", "sys.exit(3)", "[0] * 10**12"])
def test_a_file_that_ends_the_process_which_reads_it(end: str, arrow: Arrow, cli: CommandLine) -> None:
    """pyarrow checks sizes in a footer by ending the process."""
    arrow.write({name: np.ones(2) for name in XYZ})
    Path("pyarrow.py").write_text(f"import os, sys\n{end}\n", encoding="utf-8")
    program = "import sys; sys.path.insert(0, ''); from kinseek.cli import main; main(sys.argv[1:])"
    words = [*["solve", "ur5e", "--position-only", "--batch", "in.parquet", "--out"], "out.csv"]
    done = subprocess.run(
        [sys.executable, "-c", program, *words], capture_output=True, text=True, check=False, timeout=100
    )
    assert done.returncode == 2
    assert "'in.parquet' cannot be read as a Parquet file: the process that reads it ended" in done.stderr
    assert done.stderr.count("\n") == 1


@pytest.mark.slow
def test_the_row_of_a_large_table(cli: CommandLine) -> None:
    rows = np.tile([0.4, 0.2, 0.3, 1.0, 0.0, 0.0, 0.0], (50_000, 1))
    for column, value, said in ((0, np.nan, "x is nan"), (slice(3, 7), 0.0, "zero quaternion")):
        broken = rows.copy()
        broken[41_326, column] = value
        np.savetxt("in.csv", broken, delimiter=",", header="x,y,z,qw,qx,qy,qz", comments="")
        heard = cli.refused("solve ur5e --batch in.csv --out out.csv")
        assert "row 41,327: " in heard
        assert said in heard
    matrices = np.tile(np.eye(4), (50_000, 1, 1))
    matrices[41_326, 0, 0] = -1.0
    np.save("in.npy", matrices)
    heard = cli.refused("solve ur5e --batch in.npy --out out.csv")
    assert "row 41,327: not a rigid transform" in heard
    assert not Path("out.csv").exists()


MISUSE = {
    "no file": ("--batch nowhere.csv --out out.csv", "cannot read 'nowhere.csv'"),
    "no ending": (
        "--batch in.npy --out out.txt",
        "--out takes a file that ends in .csv, .npy, .parquet",
    ),
    "other ending": ("--batch in.json --out out.csv", "--batch takes a file that ends in .csv"),
    "a pipe": ("--batch - --out out.csv", "got '-'; through a pipe, solve --jsonl takes poses"),
    "a pipe by name": ("--batch /dev/stdin --out out.csv", "solve --jsonl takes poses line by line"),
    "out to a pipe": ("--batch in.npy --out -", "got '-'; through a pipe, solve --jsonl"),
    "no folder": ("--batch in.npy --out nowhere/out.csv", "does not exist"),
    "a folder": ("--batch in.npy --out folder.csv", "is not a regular file"),
    "the same": ("--batch in.npy --out ./in.npy", "is the file that --batch reads"),
    "no out": ("--batch in.npy", "--batch needs --out"),
    "out alone": ("--out out.csv", "add --batch"),
    "at": ("--batch in.npy --out out.csv --at 1 2 3", "it cannot be combined with --at"),
    "rpy": ("--batch in.npy --out out.csv --rpy 1 2 3", "it cannot be combined with --rpy"),
    "lines": ("--batch in.npy --out out.csv --jsonl", "cannot be combined"),
    "lines out": ("--out out.csv --jsonl", "--out names the output file of --batch, and --jsonl prints"),
    "pickle": ("--batch pickle.npy --out out.csv", "cannot be read as a .npy file"),
    "shape": ("--batch shape.npy --out out.csv", "expected numbers of shape (N, 4, 4)"),
    "letters": ("--batch latin.csv --out out.csv", "is not UTF-8 text"),
    "parquet": ("--batch in.parquet --out out.csv", "cannot be read as a Parquet file"),
}


@pytest.mark.parametrize("case", MISUSE)
def test_misuse(case: str, poses: Any, tmp_path: Path, cli: CommandLine) -> None:
    if case == "parquet":
        pytest.importorskip("pyarrow")
    np.save("in.npy", poses)
    np.save("shape.npy", poses[:, :3])
    np.save("pickle.npy", np.array([{}, {}]), allow_pickle=True)
    Path("folder.csv").mkdir()
    Path("latin.csv").write_bytes(b"x,y,z\n\xe4,1,2\n")
    IN.write_bytes(b"no table")
    before = sorted(path.name for path in tmp_path.iterdir())
    words, said = MISUSE[case]
    assert said in cli.refused("solve ur5e", words)
    assert sorted(path.name for path in tmp_path.iterdir()) == before


@pytest.mark.parametrize("ending", ["csv", "npy"])
def test_nothing_is_half_written(
    ending: str, poses: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cli: CommandLine
) -> None:
    np.save("in.npy", poses)
    out = tmp_path / f"out.{ending}"
    out.write_text("what was there", encoding="utf-8")

    def stopped(file: Any, *rest: Any) -> None:
        file.write(b"half")
        raise KeyboardInterrupt

    monkeypatch.setattr(tables, "_write_csv", stopped)
    monkeypatch.setattr("numpy.save", stopped)
    cli("solve ur5e --batch in.npy --out", out.name, code=130)
    assert out.read_text(encoding="utf-8") == "what was there"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["in.npy", out.name]


def test_what_lies_in_the_way_stays(poses: Any, monkeypatch: pytest.MonkeyPatch, cli: CommandLine) -> None:
    np.save("in.npy", poses)
    known = uuid.uuid4()
    monkeypatch.setattr(uuid, "uuid4", lambda: known)
    other = Path(f".{known.hex}.part")
    other.write_text("not ours", encoding="utf-8")
    assert "cannot write" in cli.refused("solve ur5e --batch in.npy --out out.npy")
    assert other.read_text(encoding="utf-8") == "not ours"


PROGRAM = """
import os, signal, sys, threading
from kinseek.cli import batch, program
{before}
sys.exit(program.run(sys.argv[1:]))
"""
INTERRUPTED = """
signal.signal(signal.SIGINT, signal.default_int_handler)  # A job in the background begins without it.
given = batch.read_poses
def read(*words):
    poses = given(*words)
    threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT)).start()
    return poses
batch.read_poses = read
"""
FULL = """
import resource
resource.setrlimit(resource.RLIMIT_FSIZE, (3000, 3000))
"""


def outside(before: str, *words: str) -> subprocess.CompletedProcess[str]:
    program = [sys.executable, "-c", PROGRAM.format(before=before), *words]
    return subprocess.run(program, capture_output=True, text=True, check=False, timeout=100)


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="other signals")
def test_ctrl_c_in_a_batch(tmp_path: Path) -> None:
    arm = kinseek.load(ARM)
    np.save(tmp_path / "in.npy", arm.fk(arm.sample(200_000)))
    words = ("--solver", "brute-force", "--branching-factor", "1000")  # For an hour or so.
    done = outside(INTERRUPTED, "solve", ARM, "--batch", "in.npy", "--out", "o.csv", *words)
    assert (done.returncode, done.stdout) == (130, "")
    assert "Traceback" not in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["in.npy"]


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="no such limit")
@pytest.mark.parametrize("ending", ["csv", "npy"])
def test_a_full_disk(ending: str, poses: Any, tmp_path: Path) -> None:
    np.save(tmp_path / "in.npy", np.tile(poses, (40, 1, 1)))
    out = tmp_path / f"out.{ending}"
    done = outside(FULL, "solve", "ur5e", "--batch", str(tmp_path / "in.npy"), "--out", str(out))
    assert done.returncode == 2
    assert done.stderr.startswith(f"kinseek: cannot write '{out}'")
    assert done.stderr.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["in.npy"]
