"""A map's own processes end with the one that has started them, whatever ends that, and whenever."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
import uuid
from collections.abc import Iterator
from pathlib import Path

import pytest

pytest.importorskip("xarray")
pytest.importorskip("zarr")
pytest.importorskip("distributed")
psutil = pytest.importorskip("psutil")

PROGRAM = """
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)  # A job in the background begins without it.
import kinseek
from kinseek import maps
arm, grid = kinseek.load("ur5e"), maps.Grid((-1, 1, 0.1), (-1, 1, 0.1), (-1, 1, 0.1), maps.orientations(2304))
print("begins", flush=True)
try:
    maps.reach(arm, grid, ("reached", "branches"), block=2304 * 8)
except KeyboardInterrupt:
    print("stopped", flush=True)
    sys.stdin.read()  # As somebody at a prompt, who goes on with something else.
"""

MARK = "KINSEEK_TEST_OF_MAPS"
"""Of the environment, which processes hand on to theirs."""


def marked(mark: str) -> Iterator[int]:
    for process in psutil.process_iter():
        try:
            if process.environ().get(MARK) == mark and process.status() != psutil.STATUS_ZOMBIE:
                yield process.pid
        except (psutil.Error, OSError):
            continue


def wait_for(mark: str, enough: int, most: int) -> list[int]:
    """Wait until there are so many processes with a mark."""
    until = time.monotonic() + 60
    while not enough <= len(there := list(marked(mark))) <= most and time.monotonic() < until:
        time.sleep(0.05)
    return there


@pytest.mark.slow
@pytest.mark.thorough
@pytest.mark.skipif(sys.platform == "win32", reason="signals")
@pytest.mark.parametrize(
    ("ended_by", "after"),
    [(signal.SIGINT, 0.0), (signal.SIGKILL, 0.0), (signal.SIGINT, 3.0), (signal.SIGKILL, 3.0)],
    ids=["Ctrl-C as workers start", "kill as workers start", "Ctrl-C as they work", "kill as they work"],
)
def test_no_process_is_left(ended_by: signal.Signals, after: float) -> None:
    mark = uuid.uuid4().hex
    program = subprocess.Popen(
        [sys.executable, "-c", PROGRAM],
        env={**os.environ, MARK: mark},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    assert program.stdout is not None
    try:
        assert program.stdout.readline() == "begins\n"
        assert len(wait_for(mark, 2, 100)) >= 2
        time.sleep(after)
        program.send_signal(ended_by)  # To it alone: a terminal would tell the others, too.
        left = 0
        if ended_by == signal.SIGINT:
            assert program.stdout.readline() == "stopped\n"
            left = 1
        assert len(wait_for(mark, 0, left)) <= left
    finally:
        for pid in marked(mark):
            os.kill(pid, signal.SIGKILL)
        program.communicate()


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_a_terminal_that_stops_an_estimate_shows_no_traceback() -> None:
    mark = uuid.uuid4().hex
    words = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); from kinseek.cli import main; main()"
    program = subprocess.Popen(
        [sys.executable, "-c", words, "map", "ur5e", "--step", "0.05", "--estimate"],
        env={**os.environ, MARK: mark},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    assert len(wait_for(mark, 2, 100)) == 2  # The one that measures how long a start takes.
    time.sleep(0.2)  # It imports, for half a second on a quick machine.
    os.killpg(program.pid, signal.SIGINT)
    _, said = program.communicate(timeout=60)
    assert program.returncode == 130
    assert "Traceback" not in said


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="signals")
@pytest.mark.parametrize("delay", [0.0, 0.05, 0.2])
def test_a_terminal_that_stops_a_map_shows_no_traceback(delay: float, tmp_path: Path) -> None:
    """Zarr's thread went on with a call, and printed its errors when Python ended."""
    words = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); from kinseek.cli import main; main()"
    program = subprocess.Popen(
        [sys.executable, "-c", words, "map", "ur5e", "--step", "0.1", "--prove", "--store", tmp_path / "map"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    until = time.monotonic() + 100
    while not list(tmp_path.iterdir()):  # The store is being made.
        assert time.monotonic() < until
        time.sleep(0.001)
    time.sleep(delay)
    os.killpg(program.pid, signal.SIGINT)
    _, said = program.communicate(timeout=60)
    assert program.returncode == 130
    assert "Traceback" not in said
    assert "Task was destroyed" not in said
