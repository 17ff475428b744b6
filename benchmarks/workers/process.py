"""A worker process, as its caller sees it: it answers, it raises, or it is gone."""

from __future__ import annotations

import contextlib
import json
import os
import queue
import signal
import subprocess
import tempfile
import threading
import time
from dataclasses import asdict
from pathlib import Path
from typing import Any

from benchmarks.command import ROOT
from benchmarks.field.adapters import path_of

from .environments import environment
from .serve import as_list

HANG = "hangs"
"""Begins the message of `Gone` if no reply came in time."""

LOADING = 300.0
"""What importing a solver and reading an arm may take [s]."""

ONE_THREAD = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "RAYON_NUM_THREADS", "XLA_NUM_THREADS"),
    "1",
)


class Raised(Exception):
    """A call raised an exception in the worker, which goes on."""


class Gone(Exception):
    """The worker has ended, or was killed because it hangs; the message says how."""


class Worker:
    """A process that serves the functions of one module."""

    def __init__(self, python: Path, module: str, log: Path, *, source: Path | None = None) -> None:
        """Start it.

        Args:
            python: Of its environment.
            module: What it serves, as ``import`` takes it.
            log: File for what it prints.
            source: Folder of packages that come before those of the environment.
        """
        paths = (source, ROOT, os.environ.get("PYTHONPATH"))
        kept = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
        self._began = time.monotonic()
        self._log = log
        with log.open("wb") as file:
            self._process = subprocess.Popen(
                [str(python), "-m", "benchmarks.workers.serve", module],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=file,
                start_new_session=True,
                env=kept | ONE_THREAD | {"PYTHONPATH": os.pathsep.join(str(path) for path in paths if path)},
                cwd=ROOT,
                text=True,
                encoding="utf-8",
            )
        self._lines: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self._process.stdout is not None
        with self._process.stdout as lines:
            for line in lines:
                self._lines.put(line)
        self._lines.put("")

    def ask(self, call: str, seconds: float, /, **arguments: Any) -> Any:
        """Call a function and return its value.

        Raises:
            Raised: The function raised an exception.
            Gone: The process ended, or did not reply within `seconds` and was killed.
        """
        assert self._process.stdin is not None
        try:
            with contextlib.suppress(BrokenPipeError):
                request = {"call": call, "arguments": arguments}
                self._process.stdin.write(json.dumps(request, default=as_list) + "\n")
                self._process.stdin.flush()
            line = self._lines.get(timeout=seconds)
        except queue.Empty:
            self.close()
            raise Gone(f"{HANG}: nothing for {seconds:.0f} s") from None
        if not line:
            raise Gone(self._how_it_ended())
        reply = json.loads(line)
        if "raised" in reply:
            raise Raised(reply["raised"])
        return reply["value"]

    @property
    def age(self) -> float:
        """How long ago it was started [s]."""
        return time.monotonic() - self._began

    def _how_it_ended(self) -> str:
        code = self._process.wait()
        if code < 0:
            return f"crashes: {signal.Signals(-code).name}"
        text = self._log.read_text(encoding="utf-8", errors="replace")
        lines = [line for line in text.splitlines() if line.strip()]
        return f"ends with {code}: {lines[-1][:100] if lines else ''}"

    def close(self) -> None:
        """End it and all processes that it has started."""
        if self._process.poll() is None:
            if hasattr(os, "killpg"):
                os.killpg(self._process.pid, signal.SIGKILL)
            else:
                self._process.kill()
            self._process.wait()
        self._reader.join(1.0)
        with contextlib.suppress(BrokenPipeError):
            if self._process.stdin is not None:
                self._process.stdin.close()


def called(peer: str, module: str, call: str, seconds: float, /, arm: str = "", **arguments: Any) -> Any:
    """Call one function in a process of its own; its value, or a string that says why there is none.

    Args:
        peer: Name of the requirements of the environment, which is made if it is not there.
        module: As `Worker` takes it.
        call: Name of the function.
        seconds: After so many the process is ended.
        arm: Name of a bundled arm that the function gets as `Arm` of the field has it, if any.
        arguments: Of the function.
    """
    if arm:
        from benchmarks.field.judge import bundled

        arguments["arm"] = asdict(bundled(arm).arm)
    python = environment(path_of(peer))
    if isinstance(python, str):
        return python[:60]
    with tempfile.TemporaryDirectory() as folder:
        worker = Worker(python, module, Path(folder) / "log.txt")
        try:
            return worker.ask(call, seconds, **arguments)
        except (Raised, Gone) as why:
            return str(why)[:60]
        finally:
            worker.close()


def called_solver(
    arm: str, solver: str, settings: dict[str, Any], way: str, poses: Any, seconds: float
) -> dict[str, Any] | str:
    """Let a solver of the field answer poses for some time; see `answers` of `benchmarks.field.worker`."""
    asked = {"file": str(path_of(solver)), "settings": settings, "way": way, "poses": poses, "limit": seconds}
    module = "benchmarks.field.worker", "answers", LOADING + 3 * seconds
    found: dict[str, Any] | str = called(solver, *module, arm=arm, **asked)
    return found


def releases(versions: dict[str, str]) -> str:
    """One sentence of the peers that answered, and their versions."""
    return f"Peers: {', '.join(f'{peer} {release}' for peer, release in versions.items() if release)}."
