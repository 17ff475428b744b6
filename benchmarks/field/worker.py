"""One solver on some arms, in the solver's own environment: does what a job says, and writes a piece for every question.

    python -m benchmarks.field.worker JOB.json

Imports NumPy and the adapter, nothing of kinseek. Before each question it writes down which one comes: of a process that
dies or never ends, the question is known.
"""

from __future__ import annotations

import contextlib
import json
import sys
import threading
import time
from collections.abc import Callable
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.peers.worker import limit_memory

from .adapters import adapter
from .pieces import DONE, Piece, save
from .protocol import Answer, Arm, Array, Refused, Solver

WARM = 3
"""Calls before time is taken."""

CLAIMS = {True: 1, False: 0, None: -1}


class Rows:
    """Answers as they come."""

    def __init__(self, joints: int) -> None:
        """None yet."""
        self._joints = joints
        self._rows: list[tuple[Array, int, int, float]] = []

    def add(self, target: int, answer: Answer, microseconds: float) -> None:
        """Keep an answer; what is no list of n numbers counts as none."""
        q = np.full(self._joints, np.nan)
        if answer.q is not None and np.shape(answer.q) == q.shape:
            q[:] = answer.q
        claimed = None if answer.claimed is None else bool(answer.claimed)
        self._rows.append((q, target, CLAIMS[claimed], microseconds))

    def piece(self, state: str, **facts: Any) -> Piece:
        """All of them."""
        q, target, claimed, times = zip(*self._rows, strict=True) if self._rows else ((), (), (), ())
        return Piece(
            *(state, np.array(q).reshape(-1, self._joints), np.array(target, dtype=int)),
            *(np.array(claimed, dtype=int), np.array(times, dtype=float), facts),
        )


class Work:
    """What a question needs: a solver, targets, time."""

    def __init__(
        self, solver: Solver, make: Callable[[], Solver], arm: Arm, asked: dict[str, Array], seconds: float
    ) -> None:
        """Keep them."""
        self.solver, self.make, self.arm, self.seconds = solver, make, arm, seconds
        self.poses, self.starts = asked["poses"], asked["starts"]

    def each(self, call: Callable[[int], Answer]) -> Piece:
        """Ask target by target, until there are no more or time is up; an exception is a failure that is told."""
        rows, raised = Rows(len(self.arm.joints)), 0
        begin = time.perf_counter()
        for i in range(min(WARM, len(self.poses))):
            with contextlib.suppress(Exception):
                call(i)
            if time.perf_counter() - begin > self.seconds / 4:
                break
        begin = time.perf_counter()
        for i in range(len(self.poses)):
            before = time.perf_counter_ns()
            try:
                answer = call(i)
            except Exception:
                answer, raised = Answer(None, False), raised + 1
            rows.add(i, answer, (time.perf_counter_ns() - before) / 1e3)
            if time.perf_counter() - begin > self.seconds and i + 1 < len(self.poses):
                return rows.piece(f"{i + 1} of {len(self.poses)} in {self.seconds:g} s", raised=raised)
        return rows.piece(DONE, raised=raised)

    def has(self, name: str) -> Any:
        """A function that not every solver has."""
        call = getattr(self.solver, name, None)
        if call is None:
            raise Refused("not offered")
        return call


def solve(work: Work) -> Piece:
    """Poses without a start."""
    return work.each(lambda i: work.solver.solve(work.poses[i], None))


def start(work: Work) -> Piece:
    """Poses with a start."""
    return work.each(lambda i: work.solver.solve(work.poses[i], work.starts[i]))


def position(work: Work) -> Piece:
    """Places."""
    call = work.has("position")
    return work.each(lambda i: call(work.poses[i, :3, 3], None))


def branches(work: Work) -> Piece:
    """Every answer, each a row; the first has the time of all."""
    call, rows = work.has("branches"), Rows(len(work.arm.joints))
    call(work.poses[0])
    begin = time.perf_counter()
    for i, T in enumerate(work.poses):
        before = time.perf_counter_ns()
        found = call(T)
        taken = (time.perf_counter_ns() - before) / 1e3
        for number, q in enumerate(found if len(found) else [None]):
            rows.add(i, Answer(q, q is not None), taken if number == 0 else np.nan)
        if time.perf_counter() - begin > work.seconds and i + 1 < len(work.poses):
            return rows.piece(f"{i + 1} of {len(work.poses)} in {work.seconds:g} s")
    return rows.piece(DONE)


def batch(work: Work) -> Piece:
    """All at once; every row has its part of the time."""
    call, rows = work.has("batch"), Rows(len(work.arm.joints))
    call(work.poses[:10])
    before = time.perf_counter_ns()
    q, claimed = call(work.poses)
    taken = (time.perf_counter_ns() - before) / 1e3 / len(work.poses)
    for i, each in enumerate(q):
        rows.add(i, Answer(each, None if claimed is None else claimed[i]), taken)
    return rows.piece(DONE)


def _answers(solver: Solver, poses: Array) -> list[bytes]:
    found = (solver.solve(T, None).q for T in poses)
    return [b"" if q is None else np.asarray(q, dtype=float).tobytes() for q in found]


def _alike(one: list[bytes], other: list[bytes]) -> float:
    return sum(a == b for a, b in zip(one, other, strict=True)) / len(one)


def _timely(work: Work, runs: int) -> Array:
    """As many poses as can be asked so many times."""
    before = time.perf_counter()
    work.solver.solve(work.poses[0], None)
    taken = max(time.perf_counter() - before, 1e-9)
    return work.poses[: max(int(work.seconds / runs / taken), 2)]


def twice(work: Work) -> Piece:
    """The same poses by two solvers, made anew."""
    poses = _timely(work, 2)
    return Piece(DONE, facts={"alike": _alike(_answers(work.make(), poses), _answers(work.make(), poses))})


def threads(work: Work) -> Piece:
    """The same poses by four solvers at once, and by one alone."""
    poses, found = _timely(work, 5), {}
    solvers = [work.make() for _ in range(5)]
    alone = _answers(solvers[0], poses)

    def run(number: int) -> None:
        found[number] = _answers(solvers[number], poses)

    others = [threading.Thread(target=run, args=(number,)) for number in range(1, 5)]
    for thread in others:
        thread.start()
    for thread in others:
        thread.join()
    if len(found) < len(others):
        return Piece(DONE, facts={"alike": 0.0, "outcome": "raised an exception"})
    return Piece(DONE, facts={"alike": min(_alike(alone, each) for each in found.values())})


def first(work: Work) -> Piece:
    """One pose; the caller knows when this process began."""
    work.solver.solve(work.poses[0], None)
    return Piece(DONE, facts={"ended": time.time(), "memory": _held()})


def _held() -> float:
    """Most memory that this process has held [MB]; NaN where the system does not tell."""
    # What getrusage says on Linux is no less than what the process held that began this one.
    status = Path("/proc/self/status")
    if not status.is_file():
        return float("nan")
    lines = status.read_text(encoding="ascii").splitlines()
    return float(next(line.split()[1] for line in lines if line.startswith("VmHWM"))) * 1024 / 1e6


def wrong(work: Work) -> Piece:
    """Something that is no pose, or no start: in words, what comes back."""
    begin = work.starts[0] if len(work.starts) else None
    rows = Rows(len(work.arm.joints))
    try:
        answer = work.solver.solve(work.poses[0], begin)
    except (KeyboardInterrupt, SystemExit):
        raise
    except BaseException as error:  # such as a panic of Rust
        past = "" if isinstance(error, Exception) else ", past `except Exception`"
        return Piece(DONE, facts={"outcome": f"raises {type(error).__name__}{past}"})
    if answer.q is None or answer.claimed is False:
        return Piece(DONE, facts={"outcome": "says that it failed"})
    rows.add(0, answer, np.nan)
    numbers = np.isfinite(np.asarray(answer.q, dtype=float)).all()
    return rows.piece(DONE, outcome="joint values" if numbers else "NaN as joint values")


WAYS: dict[str, Callable[[Work], Piece]] = {
    each.__name__: each for each in (solve, start, position, branches, batch, twice, threads, first, wrong)
}


def _arm(told: dict[str, Any]) -> Arm:
    arrays = {name: np.array(told[name]) for name in ("lower", "upper", "axes", "points", "home")}
    names = {name: tuple(told[name]) for name in ("joints", "kinds")}
    return Arm(**{**told, **arrays, **names})


def _release(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return ""


def answered(work: Work, way: str) -> Piece:
    """Ask; what the solver raises is the answer."""
    try:
        return WAYS[way](work)
    except Exception as error:
        return Piece(_told(error))


def _told(error: Exception) -> str:
    return (
        str(error) if isinstance(error, Refused) else f"{type(error).__name__}: {error}".splitlines()[0][:120]
    )


def main() -> None:
    """Do a job: questions in turn, each with its settings."""
    limit_memory(8)
    job = json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))
    module, current = adapter(Path(job["adapter"])), Path(job["current"])
    arms = {name: _arm(told) for name, told in job["arms"].items()}
    release = _release(module.PACKAGE)
    loaded: dict[str, Solver | str] = {}
    at: Arm | None = None
    for task in job["tasks"]:
        arm, label = arms[task["arm"]], task["label"]
        make = partial(module.load, arm, task["settings"])
        if arm is not at:
            at = arm
            loaded.clear()
        before = time.perf_counter()
        current.write_text(json.dumps(task | {"loaded": label in loaded}), encoding="utf-8")
        if label not in loaded:
            try:
                loaded[label] = make()
            except Exception as error:
                loaded[label] = _told(error)
            current.write_text(json.dumps(task | {"loaded": True}), encoding="utf-8")
        solver = loaded[label]
        if isinstance(solver, str):
            piece = Piece(solver)
        else:
            with np.load(task["asked"]) as asked:
                piece = answered(Work(solver, make, arm, dict(asked), task["seconds"]), task["way"])
        piece.facts |= {"version": release, "taken": time.perf_counter() - before}
        piece.digest = task["digest"]
        save(Path(task["piece"]), piece)


if __name__ == "__main__":
    main()
