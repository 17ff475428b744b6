"""A map's own processes: nobody else can reach them, and a map outlives their deaths."""

from __future__ import annotations

import json
import os
import pickle
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import kinseek
from kinseek import maps
from kinseek.maps import block, make, processes
from kinseek.support import workers
from map_files import ARM, GRID, SMALL

pytest.importorskip("xarray")
pytest.importorskip("zarr")
psutil = pytest.importorskip("psutil")

pytestmark = pytest.mark.slow

WHOLE = make.work_of(ARM, GRID, ("reached",), store=None, **make.options_of(SMALL))

REACHABLE = """
import json, os, stat, sys, tempfile, threading
import psutil
import kinseek
from kinseek import maps

here, seen, files, made = psutil.Process(), set(), set(), threading.Event()

def look():
    while not made.is_set():
        family = [here, *here.children(recursive=True)]
        for process in family:
            try:
                connections = process.net_connections("all")
            except psutil.Error:  # It has ended.
                continue
            # Of a socket of this machine psutil knows no state: one that has a path can be connected to.
            seen.update(
                (len(family) > 1, str(each.laddr) if each.status in (psutil.CONN_LISTEN, psutil.CONN_NONE) else "")
                for each in connections
            )
            seen.add((len(family) > 1, ""))
        files.update(os.listdir(tempfile.gettempdir()))

watch = threading.Thread(target=look)
watch.start()
grid = maps.Grid((-0.9, 0.9, 0.3), (-0.9, 0.9, 0.3), (-0.3, 0.9, 0.3), maps.orientations(24))
m = maps.reach(kinseek.load("ur5e"), grid, block=24 * 8)
made.set()
watch.join()
told = {"share": float((m.reached == 1).mean()), "watched": any(children for children, _ in seen)}
print(json.dumps(told | {"addresses": sorted({at for _, at in seen if at}), "files": sorted(files)}))
"""
"""A script as a user writes it, without a guard around its calls."""


def test_nothing_listens_and_nothing_lies_in_the_shared_temporary_folder(tmp_path: Path) -> None:
    """Another user of the machine reaches a process through a port, a socket with a path, or files in a shared folder."""
    script = tmp_path / "script.py"
    script.write_text(REACHABLE, encoding="utf-8")
    (tmp_path / "temporary").mkdir()
    done = subprocess.run(
        [sys.executable, str(script)],
        env=os.environ | {"TMPDIR": str(tmp_path / "temporary")},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert told["watched"]
    assert told["share"] > 0.0
    assert told["addresses"] == []
    assert told["files"] == []


def test_the_command_line_of_a_process_tells_nothing() -> None:
    """Everybody may read it."""
    with workers.Worker() as worker:
        started = psutil.Process(worker._process.pid)
        until = time.monotonic() + 10.0
        while not (words := started.cmdline()) and time.monotonic() < until:  # The system still loads it.
            time.sleep(0.01)
        assert words[1:] == ["-P", "-c", workers.PROGRAM]


def blocks_of(count: int) -> list[block.Index]:
    return [(k // 6, k % 6, 0, 0) for k in range(count)]


def kill(worker: workers.Worker) -> None:
    worker._process.send_signal(signal.SIGKILL if hasattr(signal, "SIGKILL") else signal.SIGTERM)
    worker._process.wait()


@pytest.fixture(name="before_each")
def _before_each(monkeypatch: pytest.MonkeyPatch) -> Callable[[Callable[..., None]], None]:
    """Have something done before a block is computed."""

    def use(action: Callable[[workers.Worker, block.Index], None]) -> None:
        real = workers.Worker.compute

        def compute(worker: workers.Worker, index: block.Index, when: str) -> Any:
            action(worker, index)
            return real(worker, index, when)

        monkeypatch.setattr(workers.Worker, "compute", compute)

    return use


def test_a_block_whose_process_dies_is_computed_by_another(before_each: Callable[..., None]) -> None:
    lock, died, found = threading.Lock(), set[block.Index](), dict[block.Index, Any]()

    def once(worker: workers.Worker, index: block.Index) -> None:
        with lock:
            dies = len(died) < 3 and index not in died
            if dies:
                died.add(index)
        if dies:
            kill(worker)

    before_each(once)
    processes.compute_all(WHOLE, blocks_of(8), found.__setitem__)
    assert len(died) == 3
    assert sorted(found) == blocks_of(8)
    for index, values in found.items():
        assert np.array_equal(values["reached"], block.compute(WHOLE, index)["reached"])


def test_a_block_that_ends_every_process_interrupts_the_map(
    before_each: Callable[..., None], tmp_path: Path
) -> None:
    def at_one(worker: workers.Worker, index: block.Index) -> None:
        if index == (1, 1, 0, 0):
            kill(worker)

    before_each(at_one)
    others = set(psutil.Process().children())  # Such as multiprocessing's own, if another test has used it.
    with pytest.raises(
        kinseek.MapInterrupted, match=r"3 processes ended in turn, the last at block \(1, 1"
    ) as told:
        maps.reach(ARM, GRID, store=tmp_path / "map.zarr", **SMALL)
    assert told.value.done < told.value.blocks
    assert set(psutil.Process().children()) <= others


def test_processes_that_do_not_start_interrupt_the_map(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(workers, "PROGRAM", "raise SystemExit(1)")
    with pytest.raises(kinseek.MapInterrupted, match="the last while it imported kinseek"):
        maps.reach(ARM, GRID, **SMALL)
    monkeypatch.setattr(sys, "executable", "/nowhere/python")
    with pytest.raises(kinseek.MapInterrupted, match=r"the last before it started: .*/nowhere/python"):
        maps.reach(ARM, GRID, **SMALL)


def test_a_block_that_cannot_be_written_interrupts_the_map(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    real = make.store_of

    def in_the_way(*given: Any) -> Any:
        store = real(*given)
        (tmp_path / "map.zarr" / "reached" / "c").write_text(
            ""
        )  # A file where a folder belongs stops root, too.
        return store

    monkeypatch.setattr(make, "store_of", in_the_way)
    with pytest.raises(kinseek.MapInterrupted, match="a block cannot be written"):
        maps.reach(ARM, GRID, store=tmp_path / "map.zarr", **SMALL)


def test_a_process_prints_nothing_if_the_one_that_started_it_has_ended() -> None:
    """It printed a traceback, for nobody read its first line."""
    command, pipe = [sys.executable, "-P", "-c", workers.PROGRAM], subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=pipe) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()
        pickle.dump(sys.path, process.stdin)
        process.stdin.close()
        assert process.stderr.read() == b""


def test_what_a_process_prints_does_not_come_between_its_answers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "sitecustomize.py").write_text(
        "import os, threading, time\n"
        "def say():\n"
        "    while True:\n"
        "        os.write(1, b'noise')\n"
        "        time.sleep(0.001)\n"
        "threading.Thread(target=say, daemon=True).start()\n"
    )
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")]))
    found = dict[block.Index, Any]()
    processes.compute_all(WHOLE, blocks_of(4), found.__setitem__)
    assert sorted(found) == blocks_of(4)
