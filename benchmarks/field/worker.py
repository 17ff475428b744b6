"""What a worker does for one solver: loads it for an arm, and asks it one slice of targets at a time.

Served by `benchmarks.workers.serve` in the solver's own environment. Imports NumPy and the adapter, nothing of kinseek.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from .adapters import adapter
from .protocol import Adapter, Answer, Arm, Refused, Solver, arm_of

WARM = 2e-3
"""How long a solver is called before times are taken [s]: it was idle while the others had their turns."""

CLAIMS = {True: 1, False: 0, None: -1}

MODULE: list[Adapter] = []
SOLVERS: dict[str, tuple[Arm, Solver]] = {}
"""By the label of the settings; all of one arm."""

LAST: dict[str, float] = {}
"""What the last call of each took [s]: one that takes longer than `WARM` needs no more calls to warm up."""


def begin(file: str) -> str:
    """Import the adapter; return the version of its package."""
    MODULE[:] = [adapter(Path(file))]
    try:
        return version(MODULE[0].PACKAGE)
    except PackageNotFoundError:
        return ""


def load(arm: dict[str, Any], label: str, settings: dict[str, Any]) -> None:
    """Make a solver of an arm; those of another arm are dropped."""
    read = arm_of(arm)
    if any(other.name != read.name for other, _ in SOLVERS.values()):
        SOLVERS.clear()
        LAST.clear()
    SOLVERS[label] = read, MODULE[0].load(read, settings)


def answers(
    file: str, arm: dict[str, Any], settings: dict[str, Any], way: str, poses: Any, limit: float
) -> dict[str, Any]:
    """Ask a solver of an arm for some poses, for `limit` seconds, in one call; also returns the version of its package."""
    release = begin(file)
    load(arm, "", settings)
    # Behind them some of the poses again, to warm up with.
    found = ask("", way, [*poses, *poses[:50]], [], len(poses), limit)
    return found | {"version": release}


class Slice:
    """Some targets of a question, and the solver that gets them."""

    def __init__(self, label: str, poses: Any, starts: Any, count: int, seconds: float) -> None:
        """Read what a call brings; the poses after the first `count` only warm the solver up."""
        self.arm, self.solver = SOLVERS[label]
        self.label, self.poses, self.starts = label, np.array(poses, float), np.array(starts, float)
        self.count, self.seconds = count, seconds
        self.columns: dict[str, list[Any]] = {"q": [], "target": [], "claimed": [], "times": []}
        self.facts: dict[str, Any] = {}

    def add(self, target: int, answer: Answer, microseconds: float) -> None:
        """Keep an answer; what is not a list of n numbers counts as none."""
        q = np.full(len(self.arm.joints), np.nan)
        if answer.q is not None and np.shape(answer.q) == q.shape:
            q[:] = answer.q
        claimed = None if answer.claimed is None else bool(answer.claimed)
        row = (q.tolist(), target, CLAIMS[claimed], microseconds)
        for column, value in zip(self.columns.values(), row, strict=True):
            column.append(value)

    def each(self, call: Callable[[int], Sequence[Answer]]) -> None:
        """Ask target by target until time is up, the first in any case; an exception is a failure that is counted."""
        began = time.perf_counter()
        for i in range(self.count, len(self.poses)):
            if LAST.get(self.label, 0.0) + time.perf_counter() - began > WARM:
                break
            with contextlib.suppress(Exception):
                call(i)
        raised, began = 0, time.perf_counter()
        for i in range(self.count):
            before = time.perf_counter_ns()
            try:
                answers = call(i)
            except Exception:
                answers, raised = (Answer(None, False),), raised + 1
            taken = (time.perf_counter_ns() - before) / 1e3
            for number, answer in enumerate(answers or (Answer(None, False),)):
                self.add(i, answer, np.nan if number else taken)
            LAST[self.label] = taken / 1e6
            if time.perf_counter() - began > self.seconds:
                break
        self.facts["raised"] = raised

    def has(self, name: str) -> Any:
        """A function that not every solver has."""
        call = getattr(self.solver, name, None)
        if call is None:
            raise Refused("not offered")
        return call


def solve(asked: Slice) -> None:
    """Poses without a start."""
    asked.each(lambda i: (asked.solver.solve(asked.poses[i], None),))


def start(asked: Slice) -> None:
    """Poses with a start."""
    asked.each(lambda i: (asked.solver.solve(asked.poses[i], asked.starts[i]),))


def position(asked: Slice) -> None:
    """Places."""
    call = asked.has("position")
    asked.each(lambda i: (call(asked.poses[i, :3, 3], None),))


def branches(asked: Slice) -> None:
    """Every answer, each a row; the first has the time of all."""
    call = asked.has("branches")
    asked.each(lambda i: [Answer(q, True) for q in call(asked.poses[i])])


def batch(asked: Slice) -> None:
    """All at once; every row has its part of the time."""
    call, poses = asked.has("batch"), asked.poses[: asked.count]
    call(asked.poses[asked.count :])
    before = time.perf_counter_ns()
    q, claimed = call(poses)
    taken = (time.perf_counter_ns() - before) / 1e3 / len(poses)
    for i, each in enumerate(q):
        asked.add(i, Answer(each, None if claimed is None else claimed[i]), taken)


def first(asked: Slice) -> None:
    """One pose, in a process that has just begun; the caller takes the time. And the most memory held by then [MB]."""
    asked.solver.solve(asked.poses[0], None)
    # What getrusage reports on Linux is at least what the parent held when this process began.
    status = Path("/proc/self/status")
    lines = status.read_text(encoding="ascii").splitlines() if status.is_file() else []
    held = (line.split()[1] for line in lines if line.startswith("VmHWM"))
    asked.facts["memory"] = float(next(held, np.nan)) * 1024 / 1e6


WAYS: dict[str, Callable[[Slice], None]] = {
    each.__name__: each for each in (solve, start, position, branches, batch, first)
}


def ask(label: str, way: str, poses: Any, starts: Any, count: int, limit: float) -> dict[str, Any]:
    """Ask a loaded solver for the first `count` of some poses, for `limit` seconds; return columns of answers, and facts."""
    asked = Slice(label, poses, starts, count, limit)
    WAYS[way](asked)
    return asked.columns | {"facts": asked.facts}
