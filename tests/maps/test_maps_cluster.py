"""A cluster in small: scheduler, workers and clients, each a process on a machine of its own, and some are killed."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import pytest

import kinseek
from kinseek import maps
from kinseek.maps import block, make, store
from map_files import files, marks

pytest.importorskip("xarray")
pytest.importorskip("zarr")
pytest.importorskip("distributed")

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

NUMBERS: dict[str, Any] = {
    "ranges": [(-0.9, 0.9, 0.3), (-0.9, 0.9, 0.3), (-0.3, 0.9, 0.3)],
    "orientations": 144,
    "what": ["reached", "dexterity"],
    "block": 144 * 2,
}

MACHINES = 7
"""Two schedulers, three workers of one, one of the other, and the client."""


class Machine(NamedTuple):
    """Where a process runs."""

    words: tuple[str, ...]
    """Of the command that brings it there."""
    address: str


@pytest.fixture(name="machines")
def _machines() -> Iterator[list[Machine]]:
    """Network namespaces with an address each, on a bridge in one more; where the system allows none, this machine."""
    name, made = f"kinseek{os.getpid()}", list[str]()

    def ip(words: str) -> None:
        subprocess.run(["ip", *words.split()], check=True, capture_output=True)

    try:
        for k in range(MACHINES + 1):
            ip(f"netns add {name}-{k}")
            made.append(f"{name}-{k}")
            ip(f"-n {made[k]} link set lo up")
        ip(f"-n {made[0]} link add bridge type bridge")
        ip(f"-n {made[0]} link set bridge up")
        for k, there in enumerate(made[1:], start=1):
            ip(f"link add port{k} netns {made[0]} type veth peer name eth0 netns {there}")
            ip(f"-n {made[0]} link set port{k} master bridge up")
            ip(f"-n {there} address add 10.97.0.{k}/24 dev eth0")
            ip(f"-n {there} link set eth0 up")
        machines = [
            Machine(("ip", "netns", "exec", there), f"10.97.0.{k}")
            for k, there in enumerate(made[1:], start=1)
        ]
    except (OSError, subprocess.CalledProcessError):
        machines = [Machine((), "127.0.0.1")] * MACHINES
    try:
        yield machines
    finally:
        for there in made:
            ip(f"netns delete {there}")


class Processes:
    """A scheduler, workers and clients, each a process of its own."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.all: list[subprocess.Popen[str]] = []
        (folder / "client.py").write_text(PROGRAM)

    def start(self, machine: Machine, *words: str) -> subprocess.Popen[str]:
        environment = {**os.environ, "DASK_DISTRIBUTED__COMM__TIMEOUTS__CONNECT": "3s"}
        with (self.folder / f"log{len(self.all)}").open("w") as log:
            process = subprocess.Popen(
                [*machine.words, sys.executable, *words], stdout=log, stderr=log, text=True, env=environment
            )
        self.all.append(process)
        return process

    def cluster(
        self, machine: Machine, workers: list[Machine]
    ) -> tuple[str, subprocess.Popen[str], list[subprocess.Popen[str]]]:
        at = str(self.folder / f"scheduler{len(self.all)}.json")
        common = ["--no-dashboard", "--scheduler-file", at]
        words = ["-m", "dask", "scheduler", "--host", machine.address, "--port", "0", *common]
        scheduler = self.start(machine, *words)
        some = ["--nthreads", "1", "--no-nanny", "--death-timeout", "60"]
        return at, scheduler, [self.start(each, "-m", "dask", "worker", *some, *common) for each in workers]

    def client(self, machine: Machine, place: Path, at: str) -> subprocess.Popen[str]:
        return self.start(machine, str(self.folder / "client.py"), json.dumps(NUMBERS), str(place), at)

    def end(self) -> None:
        for process in self.all:
            if process.poll() is None:
                process.kill()
            process.wait()


def uninterrupted(place: Path) -> int:
    """Make the same map block by block in this process, and say how many blocks it has."""
    arm, (x, y, z) = kinseek.load("ur5e"), NUMBERS["ranges"]
    grid, options = maps.Grid(x, y, z, maps.orientations(NUMBERS["orientations"])), make.DEFAULTS.copy()
    options["block"] = NUMBERS["block"]
    work = make.work_of(arm, grid, NUMBERS["what"], store=str(place), **options)
    todo = make.store_of(arm, grid, work).missing()
    for index in todo:
        block.do(work, index)
    return len(todo)


@pytest.mark.slow
@pytest.mark.thorough
@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_nothing_is_lost_or_done_twice_when_processes_are_killed(
    tmp_path: Path, machines: list[Machine]
) -> None:
    """A worker is killed at 30 %, the scheduler at 60 %, a client at 80 %; the next client ends the work."""
    whole, place = uninterrupted(tmp_path / "calm.zarr"), tmp_path / "map.zarr"
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
        here = machines[6]
        at, scheduler, workers = processes.cluster(machines[0], machines[1:4])
        second, _, _ = processes.cluster(machines[4], machines[5:6])  # It starts while the first works.
        client = processes.client(here, place, at)
        kept = wait_for(0.3, client)
        workers[0].send_signal(signal.SIGKILL)
        kept |= wait_for(0.6, client)
        scheduler.send_signal(signal.SIGKILL)
        assert client.wait(120) == 3, "the client says that the scheduler is gone"
        # The workers would go on with what they have; a block that both write has the same bits.
        for worker in workers:
            worker.kill()
            worker.wait()
        kept |= marks(place)
        assert len(marks(place)) < 2 * whole, "nothing is left to be done"
        client = processes.client(here, place, second)
        kept |= wait_for(0.8, client)
        client.send_signal(signal.SIGKILL)
        client.wait()
        client = processes.client(here, place, second)
        assert client.wait(120) == 0
    finally:
        processes.end()
    now = marks(place)
    assert {path: now[path] for path in kept} == kept, "a block that was done has been written again"
    assert not store.Store.at(str(place)).missing()
    calm, stormy = files(tmp_path / "calm.zarr"), files(place)
    assert {name: each for name, each in stormy.items() if not name.endswith(".partial")} == calm
    shutil.rmtree(tmp_path)
