"""One solver is asked, in processes of its own that are watched: one that dies or never ends is an answer like any other."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.command import ROOT

from . import pieces
from .judge import Judge
from .pieces import Piece
from .protocol import Adapter, Arm
from .questions import SWEEP, fits
from .sweep import chosen, noise, swept
from .tasks import Field, Task, finished, missing, settings_of, task, tuned_on

PATIENCE, LOADING = 10.0, 240.0
"""After how long [s] beyond its time a question hangs; and what importing a solver and reading an arm may take more."""

HANG = "hangs"
"""What the state of a piece begins with of which no answer came in time."""

HANGS = 10
"""Arms on which a solver may hang with the same settings before it is asked no more with them: each hang takes its time many
times over. On an arm on which it hangs it is asked nothing more."""

TOGETHER = 5
"""Arms of which one process is asked: some libraries take seconds to import."""

ONE_THREAD = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "RAYON_NUM_THREADS", "XLA_NUM_THREADS"),
    "1",
)


def work(
    python: Path,
    adapter: Path,
    judges: Sequence[Judge],
    tasks: Sequence[Task],
    folder: Path,
    hangs: set[tuple[str, str]] | None = None,
) -> Iterator[Task]:
    """Have tasks done that are missing, on arms of these judges; gives back each that is done, in whatever way it ended.

    Args:
        python: Of the solver's environment.
        adapter: File.
        judges: Of the arms.
        tasks: What is to be done.
        folder: Where it is written down what is being done.
        hangs: Arms and labels of settings with which a question hung before, wrong input aside; more are added.
    """
    hangs = set() if hangs is None else hangs
    left = list(tasks)
    current, job, log = (folder / name for name in ("current.json", "job.json", "log.txt"))
    arms = {judge.arm.name: _told(judge.arm) for judge in judges}
    while left:
        for each in list(left):
            if (why := _weary(each, hangs)) is not None:
                _given_up(each, why, left)
                yield each
        if not left:
            return
        current.unlink(missing_ok=True)
        described = {
            "adapter": str(adapter),
            "current": str(current),
            "arms": arms,
            "tasks": [asdict(t) for t in left],
        }
        job.write_text(json.dumps(described), encoding="utf-8")
        began = time.time()
        reason = _watched(python, job, current, log)
        before = len(left)
        for each in finished(left):
            _told_when(each, began)
            left.remove(each)
            yield each
        if left and reason is None and len(left) == before:
            reason = "ended without an answer"
        if left and reason is not None:
            stuck = _stuck(current, left)
            if reason.startswith(HANG) and stuck[0].way != "wrong":
                hangs.add((stuck[0].arm, stuck[0].label))
            for each in stuck:
                _given_up(each, reason, left)
                yield each


def _weary(each: Task, hangs: set[tuple[str, str]]) -> str | None:
    """Why something is not asked any more."""
    if (each.arm, each.label) in hangs:
        return "not asked: another question hangs on this arm"
    hung = sum(label == each.label for _, label in hangs)
    return None if hung < HANGS else f"not asked: it hangs on {hung} arms"


def _given_up(each: Task, reason: str, left: list[Task]) -> None:
    pieces.save(Path(each.piece), Piece(reason, digest=each.digest))
    left.remove(each)


def _stuck(current: Path, left: Sequence[Task]) -> list[Task]:
    """The task at which a worker ended; where the arm was not even read, all that are asked of it with the same settings."""
    told = json.loads(current.read_text(encoding="utf-8")) if current.is_file() else {}
    one = next((each for each in left if each.piece == told.get("piece")), left[0])
    if told.get("loaded", True):
        return [one]
    return [each for each in left if (each.arm, each.label) == (one.arm, one.label)]


def _told(arm: Arm) -> dict[str, Any]:
    """An arm, as JSON takes it."""
    return {
        name: value.tolist() if isinstance(value, np.ndarray) else value
        for name, value in asdict(arm).items()
    }


def _told_when(each: Task, began: float) -> None:
    """The first answer's time counts from the start of the process."""
    piece = pieces.load(Path(each.piece))
    if each.way == "first" and piece is not None and "ended" in piece.facts:
        piece.facts["seconds"] = piece.facts.pop("ended") - began
        pieces.save(Path(each.piece), piece)


def _watched(python: Path, job: Path, current: Path, log: Path) -> str | None:
    """Run a worker; why it did not end by itself, or None."""
    with log.open("wb") as file:
        process = subprocess.Popen(
            [str(python), "-m", "benchmarks.field.worker", str(job)],
            stdout=file,
            stderr=file,
            stdin=subprocess.DEVNULL,
            start_new_session=True,
            env=_surroundings(),
            cwd=ROOT,
        )
        seen, since = "", time.monotonic()
        try:
            while True:
                try:
                    code = process.wait(0.1)
                    break
                except subprocess.TimeoutExpired:
                    now = time.monotonic()
                told = current.read_text(encoding="utf-8") if current.is_file() else ""
                if told != seen:
                    seen, since = told, now
                if now - since > (allowed := _allowed(seen)):
                    return f"{HANG}: nothing for {allowed:.0f} s"
        finally:
            if process.poll() is None:
                _kill(process)
    if code == 0:
        return None
    if code < 0:
        return f"crashes: {signal.Signals(-code).name}"
    lines = [line for line in log.read_text(encoding="utf-8", errors="replace").splitlines() if line.strip()]
    return f"ends with {code}: {lines[-1][:100] if lines else ''}"


def _surroundings() -> dict[str, str]:
    """One thread, and compiled modules kept, as for any user."""
    path = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH", ""))))
    kept = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    return kept | ONE_THREAD | {"PYTHONPATH": path}


def _allowed(told: str) -> float:
    """How long what a worker does may take [s]."""
    try:
        task = json.loads(told)
    except ValueError:  # not begun, or just being written
        return PATIENCE + LOADING
    return PATIENCE + (3 * float(task["seconds"]) if task["loaded"] else LOADING)


def _kill(process: subprocess.Popen[bytes]) -> None:
    if hasattr(os, "killpg"):
        os.killpg(process.pid, signal.SIGKILL)
    else:
        process.kill()
    process.wait()


def measure(
    field: Field, adapter: Path, module: Adapter, python: Path, told: Callable[[str, int], None]
) -> str:
    """Ask one solver everything; returns the label of the settings that did best in the sweep.

    Args:
        field: The measurement.
        adapter: File.
        module: The same, imported.
        python: Of its environment.
        told: Called with what is being done and how many tasks of all are done since the last call.
    """
    settings, name, tuned = settings_of(module), module.NAME, tuned_on(field)
    hangs: set[tuple[str, str]] = set()
    if len(settings) > 1:
        for judge in tuned:
            tasks = [task(field, adapter, judge, SWEEP, label, each) for label, each in settings.items()]
            _do(field, python, adapter, [judge], tasks, told, f"{name}, sweep on {judge.arm.name}", hangs)
    found = swept(field, adapter, tuned, settings)
    best = chosen(found)
    labels = dict.fromkeys(("recommended", best))
    every = [
        task(field, adapter, judge, question, label, settings[label], noise(found.get(label)))
        for place, judge in enumerate(field.judges)
        for label in labels
        for question in field.questions
        if fits(question, judge, place, field.size) and (question.tuned or label == "recommended")
    ]
    for judge in field.judges:
        for each in every:
            if each.way == "first" and each.arm == judge.arm.name:
                _do(field, python, adapter, [judge], [each], told, f"{name} on {judge.arm.name}", hangs)
    for begin in range(0, len(field.judges), TOGETHER):
        judges = field.judges[begin : begin + TOGETHER]
        arms = [judge.arm.name for judge in judges]
        tasks = [each for each in every if each.way != "first" and each.arm in arms]
        _do(field, python, adapter, judges, tasks, told, f"{name} on {', '.join(arms)}", hangs)
    return best


def _do(
    field: Field,
    python: Path,
    adapter: Path,
    judges: Sequence[Judge],
    tasks: list[Task],
    told: Callable[[str, int], None],
    what: str,
    hangs: set[tuple[str, str]],
) -> None:
    absent = missing(tasks)
    told(what, len(tasks) - len(absent))
    for _ in work(python, adapter, judges, absent, field.folder, hangs):
        told(what, 1)
