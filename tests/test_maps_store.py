"""What a map's store survives: half a block, a full disk, another arm, another version, and processes that are killed."""

from __future__ import annotations

import errno
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import pytest

import kinseek
from kinseek import maps
from kinseek.maps import block, run, store

pytest.importorskip("xarray")
pytest.importorskip("zarr")
distributed = pytest.importorskip("distributed")

ARM = kinseek.load("ur5e")
GRID = maps.Grid((-0.9, 0.9, 0.3), (-0.9, 0.9, 0.3), (-0.3, 0.9, 0.3), maps.orientations(24))
SMALL: dict[str, Any] = {"block": 24 * 8}


@pytest.fixture(autouse=True)
def _here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Blocks are done in this process, one after the other, unless a client is given."""

    def one_by_one(
        work: Any, todo: Any, blocks: int, client: Any, advance: Any, written: Any, whole: Any = run._spread
    ) -> None:
        if client is not None:
            whole(work, todo, blocks, client, advance, written)
            return
        for done, index in enumerate(todo):
            run._here(work, index, blocks - len(todo) + done, blocks, written)

    monkeypatch.setattr(run, "_local_client", lambda blocks: nullcontext())
    monkeypatch.setattr(run, "_spread", one_by_one)
    monkeypatch.setattr(
        run, "_require_same", lambda at, work, whole=run._require_same: at and whole(at, work)
    )


def files(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def marks(folder: Path) -> dict[Path, tuple[int, int]]:
    """Of the blocks that are done, when and as which file their marks and values were written."""
    done = (folder / "blocks" / "done" / "c").rglob("*")
    blocks = [path for path in done if path.is_file() and not path.name.endswith(".partial")]
    values = [folder / "reached" / path.relative_to(folder / "blocks" / "done") for path in blocks]
    return {path: (path.stat().st_mtime_ns, path.stat().st_ino) for path in [*blocks, *values]}


def test_a_map_goes_on_where_it_stopped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = maps.reach(ARM, GRID, store=tmp_path / "whole.zarr", **SMALL)
    computed = []

    def stops(work: Any, index: Any, real: Any = block.compute) -> Any:
        computed.append(index)
        if len(computed) == 5:
            raise OSError(errno.ENOSPC, "No space left on device")
        return real(work, index)

    monkeypatch.setattr(block, "compute", stops)
    with pytest.raises(
        kinseek.MapInterrupted, match=r"No space left on device; 4 of \d+ blocks are done"
    ) as told:
        maps.reach(ARM, GRID, store=tmp_path / "part.zarr", **SMALL)
    assert told.value.done == 4
    part = maps.open(tmp_path / "part.zarr")
    known = part.reached.values >= 0
    assert 0.0 < known.mean() < 1.0
    assert (part.reached.values[known] == whole.reached.values[known]).all()
    before = marks(tmp_path / "part.zarr")
    maps.reach(ARM, GRID, store=tmp_path / "part.zarr", **SMALL)
    after = marks(tmp_path / "part.zarr")
    assert {path: after[path] for path in before} == before
    assert len(set(computed)) == told.value.blocks == len(computed) - 1
    assert files(tmp_path / "part.zarr") == files(tmp_path / "whole.zarr")


def test_a_half_written_block_is_made_anew(tmp_path: Path) -> None:
    maps.reach(ARM, GRID, store=tmp_path / "map.zarr", **SMALL)
    good = files(tmp_path / "map.zarr")
    chunk = next(path for path in (tmp_path / "map.zarr" / "reached" / "c").rglob("*") if path.is_file())
    chunk.write_bytes(chunk.read_bytes()[:7])
    (
        tmp_path / "map.zarr" / "blocks" / "done" / chunk.relative_to(tmp_path / "map.zarr" / "reached")
    ).unlink()
    maps.reach(ARM, GRID, store=tmp_path / "map.zarr", **SMALL)
    assert files(tmp_path / "map.zarr") == good


def test_a_store_of_another_map_is_refused(tmp_path: Path) -> None:
    place = tmp_path / "map.zarr"
    maps.reach(ARM, GRID, store=place, **SMALL)
    before = files(place)
    coarse = maps.Grid((-0.9, 0.9, 0.9), (-0.9, 0.9, 0.3), (-0.3, 0.9, 0.3), maps.orientations(24))
    others: list[tuple[kinseek.Arm, maps.Grid, dict[str, Any], str]] = [
        (kinseek.load("ur10e"), GRID, {}, "name 'ur5e' there, 'ur10e' asked"),
        (ARM.with_limits({ARM.joint_names[1]: (-1.0, 1.0)}), GRID, {}, "arm '.*' there, '.*' asked"),
        (ARM, coarse, {}, "grid .* there"),
        (ARM, GRID, {"position_tolerance": 1e-3}, "position_tolerance 1e-06 there, 0.001 asked"),
        (ARM, GRID, {"prove": True}, "prove False there"),
    ]
    for arm, grid, options, said in others:
        with pytest.raises(kinseek.InvalidMap, match=said):
            maps.reach(arm, grid, store=place, **{**SMALL, **options})
    assert files(place) == before


def test_a_folder_that_is_no_map_is_refused(tmp_path: Path) -> None:
    (tmp_path / "letters").mkdir()
    (tmp_path / "letters" / "a.txt").write_text("dear")
    with pytest.raises(kinseek.InvalidMap, match="no map in"):
        maps.reach(ARM, GRID, store=tmp_path / "letters", **SMALL)
    with pytest.raises(kinseek.InvalidMap, match="cannot be made"):
        maps.reach(ARM, GRID, store=tmp_path / "letters" / "a.txt" / "map.zarr", **SMALL)
    assert [path.name for path in tmp_path.iterdir()] == ["letters"]


@pytest.fixture(name="client", scope="module")
def _client() -> Iterator[Any]:
    with distributed.Client(
        processes=False, n_workers=1, threads_per_worker=1, dashboard_address=":0"
    ) as client:
        yield client


@pytest.mark.slow
def test_a_client_gives_the_same_bits(tmp_path: Path, client: Any) -> None:
    maps.reach(ARM, GRID, store=tmp_path / "here.zarr", **SMALL)
    maps.reach(ARM, GRID, store=tmp_path / "there.zarr", client=client, **SMALL)
    assert files(tmp_path / "here.zarr") == files(tmp_path / "there.zarr")
    sent = maps.reach(ARM, GRID, client=client, **SMALL)
    assert (sent.reached.values == maps.open(tmp_path / "here.zarr").reached.values).all()


@pytest.mark.slow
def test_workers_with_another_version_are_refused_by_name(
    client: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    address = next(iter(client.scheduler_info()["workers"]))
    monkeypatch.setattr("kinseek.maps.make.version", lambda: "9.9.9+feed")
    with pytest.raises(kinseek.InvalidMap, match=rf"9\.9\.9\+feed.*{address} has {kinseek.__version__}"):
        maps.reach(ARM, GRID, client=client, store=tmp_path / "map.zarr", **SMALL)


@pytest.mark.slow
def test_a_client_that_is_gone(client: Any) -> None:
    gone = distributed.Client(client.scheduler.address)
    gone.close()
    with pytest.raises(kinseek.InvalidMap, match="the client is closed"):
        maps.reach(ARM, GRID, client=gone, **SMALL)


PROGRAM = """
import json, sys
import distributed, kinseek
from kinseek import maps
numbers, store, at = json.loads(sys.argv[1]), sys.argv[2], sys.argv[3]
grid = maps.Grid(*numbers["ranges"], maps.orientations(numbers["orientations"]))
with distributed.Client(scheduler_file=at) as client:
    try:
        maps.reach(kinseek.load("ur5e"), grid, numbers["what"], store=store, client=client, block=numbers["block"])
    except kinseek.MapInterrupted as error:
        print(error)
        sys.exit(3)
"""


class Processes:
    """A scheduler, workers and clients, each a process of its own."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.count = folder, 0
        self.all: list[subprocess.Popen[str]] = []
        (folder / "client.py").write_text(PROGRAM)

    def start(self, *words: str) -> subprocess.Popen[str]:
        environment = {**os.environ, "DASK_DISTRIBUTED__COMM__TIMEOUTS__CONNECT": "3s"}
        with (self.folder / f"log{len(self.all)}").open("w") as log:
            process = subprocess.Popen(
                [sys.executable, *words], stdout=log, stderr=log, text=True, env=environment
            )
        self.all.append(process)
        return process

    def cluster(self, workers: int) -> tuple[str, subprocess.Popen[str], list[subprocess.Popen[str]]]:
        self.count += 1
        at = str(self.folder / f"scheduler{self.count}.json")
        common = ["--no-dashboard", "--scheduler-file", at]
        scheduler = self.start("-m", "dask", "scheduler", "--host", "127.0.0.1", "--port", "0", *common)
        some = ["--nthreads", "1", "--no-nanny", "--death-timeout", "60"]
        return at, scheduler, [self.start("-m", "dask", "worker", *some, *common) for _ in range(workers)]

    def end(self) -> None:
        for process in self.all:
            if process.poll() is None:
                process.kill()
            process.wait()


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_nothing_is_lost_or_done_twice_when_processes_are_killed(tmp_path: Path) -> None:
    """A worker is killed at 30 %, the scheduler at 60 %, a client at 80 %; the next client ends the work."""
    numbers: dict[str, Any] = {
        "ranges": [(-0.9, 0.9, 0.3), (-0.9, 0.9, 0.3), (-0.3, 0.9, 0.3)],
        "orientations": 144,
        "what": ["reached", "dexterity"],
        "block": 144 * 2,
    }
    x, y, z = numbers["ranges"]
    grid = maps.Grid(x, y, z, maps.orientations(numbers["orientations"]))
    maps.reach(ARM, grid, numbers["what"], store=tmp_path / "calm.zarr", block=numbers["block"])
    whole, place = len(marks(tmp_path / "calm.zarr")) // 2, tmp_path / "map.zarr"
    assert whole == 72
    processes = Processes(tmp_path)

    def wait_for(share: float, client: subprocess.Popen[str]) -> dict[Path, tuple[int, int]]:
        until = time.monotonic() + 120
        while (len(now := marks(place)) / 2 if place.exists() else 0) < share * whole:
            assert time.monotonic() < until, "the client stands still"
            assert client.poll() is None, "the client has ended"
            time.sleep(0.01)
        return now

    try:
        at, scheduler, workers = processes.cluster(3)
        second = processes.cluster(1)  # It starts while the first works.
        words = (str(tmp_path / "client.py"), json.dumps(numbers), str(place))
        client = processes.start(*words, at)
        kept = wait_for(0.3, client)
        workers[0].send_signal(signal.SIGKILL)
        kept |= wait_for(0.6, client)
        scheduler.send_signal(signal.SIGKILL)
        assert client.wait(120) == 3, "the client says that the scheduler is gone"
        for (
            worker
        ) in workers:  # They would go on with what they have; a block that both write has the same bits.
            worker.kill()
            worker.wait()
        kept |= marks(place)
        assert len(marks(place)) < 2 * whole, "nothing is left to be done"
        client = processes.start(*words, second[0])
        kept |= wait_for(0.8, client)
        client.send_signal(signal.SIGKILL)
        client.wait()
        client = processes.start(*words, second[0])
        assert client.wait(120) == 0
    finally:
        processes.end()
    now = marks(place)
    assert {path: now[path] for path in kept} == kept, "a block that was done has been written again"
    assert (store.Store.at(str(place))._done[...] == 1).all()
    calm, stormy = files(tmp_path / "calm.zarr"), files(place)
    assert {name: each for name, each in stormy.items() if not name.endswith(".partial")} == calm
    shutil.rmtree(tmp_path)
