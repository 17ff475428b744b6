"""What the commands print fits a terminal, is one row a line in a pipe, and ends well when nobody reads it."""

from __future__ import annotations

import io
import json
import math
import os
import re
import subprocess
import sys
import types
import unicodedata
from functools import cache
from pathlib import Path

import pytest

import kinseek
from command_line import CommandLine
from kinseek.cli import main
from kinseek.cli.layout import sentence, table
from kinseek.cli.program import run
from kinseek.robots import catalog_names
from robot_files import TURNING, robot, write

pytestmark = pytest.mark.slow

MAIN = [sys.executable, "-c", "from kinseek.cli import main; main()"]
SHOWN = {
    "show": ("show", "ur5e"),
    "show a slide": ("show", "scara4"),
    "show free joints": ("show", "gen3"),
    "robots": ("robots",),
    "check": ("check", "ur5e"),
    "fk": ("fk", "panda", "0", "0", "0", "-1", "0", "1", "0"),
}
POSE = ("--at", "0.4", "0.2", "0.3", "--rpy", "180", "0", "0", "--deg", "--all")
COMMANDS = [
    *SHOWN.values(),
    *(("solve", name, *POSE) for name in ("ur5e", "panda")),
    *(("show", name) for name in ("pr2_left", "ur10e_rail")),
]
"""What the tests below look at, asked in one process for each kind of output: Python starts once for all of them."""
ALL = """
import json, sys
from kinseek.cli import main
for words in json.loads(sys.argv[1]):
    try:
        main(words)
    except SystemExit as ended:
        assert not ended.code, words
    print("\x1e", flush=True)
"""
ASKED = [sys.executable, "-c", ALL, json.dumps(COMMANDS)]


def parts(said: str) -> dict[tuple[str, ...], str]:
    """What each command printed."""
    *texts, last = said.split("\x1e\n")
    assert last == ""
    return dict(zip(COMMANDS, texts, strict=True))


@cache
def in_terminal(columns: int) -> dict[tuple[str, ...], str]:
    """What each command prints on a terminal that wide."""
    fcntl, pty = pytest.importorskip("fcntl"), pytest.importorskip("pty")
    import struct
    import termios

    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 50, columns, 0, 0))
    environment = {name: value for name, value in os.environ.items() if name not in ("COLUMNS", "LINES")}
    process = subprocess.Popen(ASKED, stdin=theirs, stdout=theirs, stderr=subprocess.DEVNULL, env=environment)
    os.close(theirs)
    said = b""
    while True:
        try:
            piece = os.read(ours, 65536)
        except OSError:  # Linux says so where others end.
            break
        if not piece:
            break
        said += piece
    os.close(ours)
    assert process.wait() == 0
    return parts(said.decode().replace("\r", ""))


@cache
def in_pipe() -> dict[tuple[str, ...], str]:
    """What each command prints into a pipe."""
    environment = {**os.environ, "COLUMNS": "30"}
    done = subprocess.run(ASKED, capture_output=True, text=True, check=True, env=environment)
    return parts(done.stdout)


@pytest.mark.parametrize("columns", [80, 40])
@pytest.mark.parametrize("case", SHOWN)
def test_nothing_is_cut_and_every_line_fits(case: str, columns: int) -> None:
    wide, narrow = in_pipe()[SHOWN[case]], in_terminal(columns)[SHOWN[case]]
    assert max(map(len, narrow.splitlines())) <= columns
    assert "…" not in narrow
    assert sorted(narrow.split()) == sorted(wide.split())  # Every word is there, and none is broken.


@pytest.mark.parametrize("columns", [80, 40])
@pytest.mark.parametrize("name", ["ur5e", "panda"])
def test_every_answer_fits(name: str, columns: int) -> None:
    words = ("solve", name, *POSE)
    wide, narrow = in_pipe()[words], in_terminal(columns)[words]
    assert max(map(len, narrow.splitlines())) <= columns
    numbers = [sorted(re.findall(r"-?\d\.\d{6}", said)) for said in (wide, narrow)]
    assert numbers[0] == numbers[1]
    assert all(
        f"j{i + 1} {joint}" in " ".join(narrow.split())
        for i, joint in enumerate(kinseek.load(name).joint_names)
    )


def test_every_arm_fits_eighty_columns_in_one_line_a_joint() -> None:
    for name in ("pr2_left", "ur5e", "ur10e_rail"):
        said = in_terminal(80)["show", name]
        for joint in kinseek.load(name).joint_names:
            assert len(re.findall(rf"^{joint} +\w+( +[-\d.]+| +none){{4}}$", said, re.MULTILINE)) == 1


def test_a_pipe_gets_one_row_a_line() -> None:
    lines = in_pipe()[("robots",)].splitlines()
    assert [line.split()[0] for line in lines] == ["name", *catalog_names()]
    lines = in_pipe()["show", "ur5e"].splitlines()
    assert [line.split()[0] for line in lines[2:8]] == list(kinseek.load("ur5e").joint_names)
    assert [len(line.split()) for line in lines[2:8]] == [7] * 6


@pytest.mark.skipif(sys.platform == "win32", reason="other pipes")
@pytest.mark.parametrize("words", [("robots",), ("--help",)])
def test_a_closed_pipe_ends_quietly(words: tuple[str, ...]) -> None:
    reading, writing = os.pipe()
    os.close(reading)
    done = subprocess.run([*MAIN, *words], stdout=writing, stderr=subprocess.PIPE, text=True, check=False)
    os.close(writing)
    said = [line for line in done.stderr.splitlines() if "compiling kernels" not in line]
    assert (done.returncode, said) == (141, [])


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no such device here")
@pytest.mark.parametrize(
    "words",
    ["robots", "fk planar2 0 0 --json", "--version", "solve planar2 --jsonl --position-only"],
)
def test_a_full_disk_is_one_line(words: str) -> None:
    lines = '{"position": [0.3, 0.4, 0]}\n' * 3  # What the last one reads.
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [*MAIN, *words.split()], input=lines, stdout=full, stderr=subprocess.PIPE, text=True, check=False
        )
    said = [line for line in done.stderr.splitlines() if "compiling kernels" not in line]
    assert (done.returncode, len(said)) == (2, 1)
    assert said[0].startswith("kinseek: cannot write the output: ")


def test_letters_that_a_terminal_has_not_are_escaped(tmp_path: Path) -> None:
    path = write(tmp_path, "r.urdf", robot(TURNING, links="a b", name="Händchen"))
    environment = {**os.environ, "PYTHONIOENCODING": "ascii"}
    done = subprocess.run(
        [*MAIN, "show", str(path)], capture_output=True, text=True, check=False, env=environment
    )
    assert (done.returncode, done.stdout.split(":")[0]) == (0, "H\\xe4ndchen")


def test_the_progress_bar_is_on_stderr(capfd: pytest.CaptureFixture[str]) -> None:
    arm = kinseek.load("planar2")
    targets = arm.fk(arm.chain.lower + (arm.upper - arm.lower) * [[0.3, 0.4], [0.5, 0.6]])
    arm.ik(targets, progress=True)
    said = capfd.readouterr()
    assert said.out == ""
    assert "solving" in said.err


# Layout


def test_a_wide_table_goes_on_in_the_next_line() -> None:
    rows = [("a" * 10, "b" * 10, "1"), ("c", "d", "22")]
    assert table(("x", "y", ">z"), rows, None).splitlines() == [
        "x           y            z",
        "aaaaaaaaaa  bbbbbbbbbb   1",
        "c           d           22",
    ]
    assert table(("x", "y", ">z"), rows, 20).splitlines() == [
        *("x", "  y            z"),
        *("aaaaaaaaaa", "  bbbbbbbbbb   1"),
        *("c", "  d           22"),
    ]


def test_columns_that_belong_together_stay_together() -> None:
    rows = [("aaaa", "1111", "2222")]
    assert table(("", "", ""), rows, 12, (1, 2)).splitlines() == ["aaaa", "  1111  2222"]


def test_a_sentence_is_broken_at_blanks() -> None:
    assert sentence("one two three", 8) == "one two\n  three"
    assert sentence("one two three", None) == "one two three"


# What --json says of goals and proofs

SOLVE = "solve ur5e --at 0.4 0.2 0.3 --rpy 180 0 0 --deg --json"


def test_a_reader_that_is_slow_does_not_keep_control_c(monkeypatch: pytest.MonkeyPatch) -> None:
    class Slow(io.StringIO):
        def flush(self) -> None:
            raise KeyboardInterrupt

    monkeypatch.setattr(sys, "stdout", Slow())
    assert run(["--version"]) == 130


@pytest.mark.parametrize(
    ("options", "free", "frame", "cone"),
    [
        ("", [], "tool", 0.0),
        ("--free z,rz", ["z", "rz"], "tool", 0.0),
        ("--free x --frame base", ["x"], "base", 0.0),
        ("--free rx", ["rx"], "tool", 0.0),
        ("--free rx,ry,rz", ["rx", "ry", "rz"], "tool", 0.0),
        ("--free rz --cone 10", ["rz"], "tool", 10.0),
    ],
)
def test_json_says_what_is_free(
    options: str, free: list[str], frame: str, cone: float, cli: CommandLine
) -> None:
    goal = cli(SOLVE, options).facts["goal"]
    assert (goal["free"], goal["ranges"], goal["frame"]) == (free, {}, frame)
    assert goal["cone"] == pytest.approx(math.radians(cone))


@pytest.mark.parametrize("goal", ["--rpy 3 0 0", "--position-only"])
def test_an_unknown_frame_is_refused(goal: str, cli: CommandLine) -> None:
    told = cli.refused("solve ur5e --at 0.4 0.2 0.3", f"{goal} --frame tip")
    assert told == "kinseek: --frame must be tool or base, got 'tip'\n"


def test_json_says_ranges() -> None:
    from kinseek.cli.report import solution_facts

    arm = kinseek.load("ur5e")
    goal = kinseek.Goal.pose(
        kinseek.pose([0.4, 0.2, 0.3]), free="rz", box={"x": (-0.1, 0.2), "y": (0.0, float("inf"))}
    )
    facts = json.loads(json.dumps(solution_facts(arm, arm.ik(goal), None, 0.0), allow_nan=False))
    assert facts["goal"]["ranges"] == {"x": [-0.1, 0.2], "y": [0.0, None]}
    assert facts["goal"]["free"] == ["rz"]


def test_json_holds_the_proof(cli: CommandLine) -> None:
    far = "solve planar2 --position-only --json --at 0.9 0 0"
    near = "solve planar2 --position-only --json --at 0.4 0.3 0"
    proof = cli(far, "--prove", code=1).facts["proof"]
    assert proof["verdict"] == "UNREACHABLE"
    assert 0.0 < proof["lower_bound"] <= proof["upper_bound"] == pytest.approx(0.15, abs=1e-3)
    assert proof["boxes"] >= 0
    assert cli(far, code=1).facts["proof"] is None
    assert cli(near, "--prove").facts["proof"]["verdict"] == "REACHABLE"


@pytest.mark.parametrize("columns", ["1", "2", "3"])
def test_help_is_printed_however_narrow_the_terminal_is(
    columns: str, monkeypatch: pytest.MonkeyPatch, cli: CommandLine
) -> None:
    monkeypatch.setenv("COLUMNS", columns)
    assert "--trace" in cli("solve --help").out


def test_ctrl_c_during_the_import_ends_without_a_traceback(monkeypatch: pytest.MonkeyPatch) -> None:
    class Interrupted(types.ModuleType):
        def __getattr__(self, name: str) -> None:
            raise KeyboardInterrupt

    monkeypatch.setitem(sys.modules, "kinseek.cli.program", Interrupted("kinseek.cli.program"))
    with pytest.raises(SystemExit) as ended:
        main(["robots"])
    assert ended.value.code == 130


@pytest.mark.parametrize("address", ["tls://127.0.0.1:1", "ucx://127.0.0.1:1", "tcp://127.0.0.1"])
def test_a_scheduler_that_cannot_be_reached_is_said_to_be_so(address: str) -> None:
    """Without certificates, Dask raised a TypeError.

    In a process of its own: where Python collects a client that could not connect while Dask starts another one, Dask waits
    for itself.
    """
    pytest.importorskip("distributed")
    command = [sys.executable, "-m", "kinseek", "map", "panda", "--step", "0.5", "--scheduler", address]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)
    assert done.returncode == 2
    assert f"cannot connect to a Dask scheduler at '{address}': " in done.stderr


def test_a_picture_without_a_folder_is_refused_before_the_map_is_made(
    tmp_path: Path, cli: CommandLine
) -> None:
    assert "does not exist" in cli.refused("map panda --picture", tmp_path / "none" / "map.png")
    (tmp_path / "map.png").mkdir()
    assert "is not a regular file" in cli.refused("map panda --picture", tmp_path / "map.png")


def test_a_map_is_reported_if_its_picture_cannot_be_written(
    tmp_path: Path, cli: CommandLine, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("matplotlib")
    pytest.importorskip("zarr")
    from kinseek import plots

    def full(*_: object) -> None:
        raise kinseek.InvalidProblem("cannot write the picture: no space left")

    monkeypatch.setattr(plots, "save", full)
    heard = cli("map ur5e --step 0.6 --orientations 12 --picture", tmp_path / "map.png", code=2)
    assert "no space left" in heard.err
    assert "\nreached: " in heard.out


@pytest.mark.parametrize("width", [30, 80])
def test_wide_letters_take_two_columns(width: int) -> None:
    """A terminal broke longer lines itself, and what followed began a row of its own."""
    names = ["\u672c" * 10 + " row: sound", "joint \uff21", "plain"]
    rows = [[name, "1.0", "and a sentence that goes on " + "\u65e5" * 8 + " to the end"] for name in names]
    lines = [
        *table(["joint", ">q", "said"], rows, width).splitlines(),
        *sentence(rows[0][2], width).splitlines(),
    ]
    columns = [sum(2 if unicodedata.east_asian_width(each) in "WF" else 1 for each in line) for line in lines]
    assert max(columns) <= width
    assert "\ue000" not in "".join(lines)
    text = "".join("".join(lines).split())
    assert all("".join(name.split()) in text for name in names)
    if width == 80:
        before = [line[: line.index("1.0")] for line in lines if "1.0" in line]
        assert (
            len({len(each) + sum(unicodedata.east_asian_width(x) in "WF" for x in each) for each in before})
            == 1
        )
