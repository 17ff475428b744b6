"""All solvers are measured by turns: each gets a slice of the targets, then each the next slice.

A machine that changes its speed does so for all of them, and what is compared is the time of a slice over that of kinseek
for the same slice. Every solver has a process of its own, which waits while the others have their turns. One that dies or
hangs is a result like any other; the solver gets a new process.
"""

from __future__ import annotations

import random
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from benchmarks.workers.process import HANG, Gone, Raised, Worker

from .judge import Judge
from .protocol import Adapter
from .questions import SWEEP, Question, fits
from .sweep import chosen, noise, swept
from .tables import HOST
from .tasks import DONE, Field, Task, save, settings_of, task

PATIENCE, LOADING = 10.0, 240.0
"""After how long [s] beyond its time a question hangs; and what importing a solver and reading an arm may take more."""

HANGS = 10
"""Arms on which a solver may hang with the same settings before it gets no more questions with them. On an arm on which it
hangs it gets no more questions at once."""

RENEWED = 5
"""Arms after which every process is replaced: some libraries keep what they compiled for an arm."""


class Solver:
    """A solver that takes part, and its process."""

    def __init__(self, adapter: Path, module: Adapter, python: Path, log: Path) -> None:
        """Nothing is started yet.

        Args:
            adapter: File.
            module: The same, imported.
            python: Of its environment.
            log: File for what its process prints.
        """
        self.adapter, self.module, self.version = adapter, module, ""
        self._python, self._log = python, log
        self._worker: Worker | None = None
        self._loaded: dict[str, str | None] = {}
        self._arm = ""
        self.hangs: set[tuple[str, str]] = set()
        """Arms and labels of settings with which a question hung."""

    def ask(
        self, judge: Judge, label: str, settings: dict[str, Any], way: str, seconds: float, **slice: Any
    ) -> dict[str, Any]:
        """Load the arm with these settings if it is not, and ask.

        Args:
            judge: Of the arm.
            label: Names the settings.
            settings: As the adapter takes them.
            way: How the slice is asked, see `benchmarks.field.worker`.
            seconds: That the question may take; after three times as much it hangs.
            slice: The other arguments of `benchmarks.field.worker.ask`.

        Returns:
            Columns of answers, and facts.

        Raises:
            Raised: The solver does not take the arm, or not this kind of question.
            Gone: Its process has ended, or hangs.
        """
        name = judge.arm.name
        if (why := self.weary(name, label)) is not None:
            raise Raised(why)
        if name != self._arm:
            self._arm, self._loaded = name, {}
        if way == "first":
            self.close()
        try:
            if label not in self._loaded:
                self._loaded[label] = self._load(judge, label, settings)
            if (refused := self._loaded[label]) is not None:
                raise Raised(refused)
            worker = self._started()
            found: dict[str, Any] = worker.ask("ask", PATIENCE + 3 * seconds, label=label, way=way, **slice)
        except Gone as gone:
            if str(gone).startswith(HANG):
                self.hangs.add((name, label))
            self.close()
            raise
        if way == "first":
            found["facts"]["seconds"] = worker.age
        return found

    def _started(self) -> Worker:
        if self._worker is None:
            self._worker = Worker(self._python, "benchmarks.field.worker", self._log)
            self.version = self._worker.ask("begin", PATIENCE + LOADING, file=str(self.adapter))
        return self._worker

    def _load(self, judge: Judge, label: str, settings: dict[str, Any]) -> str | None:
        """Load; why not, if it does not take the arm or ends at it: then it is not loaded for this arm again."""
        try:
            arm = asdict(judge.arm)
            self._started().ask("load", PATIENCE + LOADING, arm=arm, label=label, settings=settings)
        except Raised as raised:
            return str(raised)
        except Gone as gone:
            self.close()
            return str(gone)
        return None

    def weary(self, arm: str, label: str) -> str | None:
        """Why these settings get no more questions on an arm; None if they do."""
        if (arm, label) in self.hangs:
            return "not asked: another question hangs on this arm"
        hung = sum(other == label for _, other in self.hangs)
        return None if hung < HANGS else f"not asked: it hangs on {hung} arms"

    def close(self) -> None:
        """End the process; what refused the arm is remembered."""
        if self._worker is not None:
            self._worker.close()
        self._worker = None
        self._loaded = {label: why for label, why in self._loaded.items() if why is not None}


class Turn:
    """A task in progress, slice by slice."""

    def __init__(self, solver: Solver, task: Task, slices: list[tuple[int, int]]) -> None:
        """Nothing is known yet."""
        self.solver, self.task, self._slices = solver, task, slices
        self._columns: dict[str, list[Any]] = {
            name: [] for name in ("q", "target", "claimed", "times", "part")
        }
        self._facts: dict[str, Any] = {}
        self._asked, self._spent, self._ended = 0, 0.0, ""

    def take(self, judge: Judge, question: Question, asked: dict[str, Any], number: int) -> None:
        """Ask the slice of this number, for as long as the part of the time allows that belongs to the slices so far."""
        allowed = self.task.seconds * (number + 1) / len(self._slices) - self._spent
        if self._ended or allowed <= 0.0:
            return
        first, last = self._slices[number]
        # The slice, and behind it as many poses that follow it, to warm up with.
        rows = np.arange(first, 2 * last - first) % len(asked["poses"])
        targets = {
            "poses": asked["poses"][rows],
            "starts": asked["starts"][rows] if len(asked["starts"]) else [],
        }
        try:
            settings = self.task.label, self.task.settings
            slice = targets | {"count": last - first, "limit": allowed}
            found = self.solver.ask(judge, *settings, question.way, self.task.seconds, **slice)
        except (Raised, Gone) as ended:
            self._ended = str(ended)
            return
        facts = found.pop("facts")
        self._facts |= facts | {"raised": self._facts.get("raised", 0) + facts.get("raised", 0)}
        self._asked += len(set(found["target"]))
        self._spent += np.nansum(np.array(found["times"], dtype=float)) / 1e6
        found["target"] = [first + target for target in found["target"]]
        found["part"] = [number] * len(found["target"])
        for name, column in self._columns.items():
            column.extend(found[name])

    def medians(self) -> list[float]:
        """Median time of each slice [µs]; NaN where there is none."""
        times, part = np.array(self._columns["times"], dtype=float), np.array(self._columns["part"])
        each = (times[(part == number) & ~np.isnan(times)] for number in range(len(self._slices)))
        return [float(np.median(some)) if len(some) else np.nan for some in each]

    def piece(self, question: Question, count: int, host: list[float]) -> pd.DataFrame:
        """What came of it, and the times of kinseek for the same slices; if it ended early, the reason alone."""
        made = pd.DataFrame(self._columns)[: 0 if self._ended else None]
        short = question.timed and self._asked < count
        late = f"{self._asked} of {count} in {self.task.seconds:g} s"
        facts = self._facts | {"version": self.solver.version, "host": host}
        state = self._ended or (late if short else DONE)
        made.attrs = {"state": state, "facts": facts, "digest": self.task.digest}
        return made


def take_turns(field: Field, judge: Judge, question: Question, tasks: Sequence[tuple[Solver, Task]]) -> None:
    """Ask a question on one arm, all solvers by turns, and write the pieces that are missing.

    Where some are missing and others not, kinseek takes part again, so that there is something to compare with.
    """
    missing = [(solver, task) for solver, task in tasks if not task.done]
    if not missing:
        return
    with np.load(field.asked(judge, question)) as file:
        asked = dict(file)
    count = len(asked["poses"])
    slices = question.slices(count)
    again = [each for each in tasks if each[0].adapter.stem == HOST and each not in missing]
    turns = [Turn(solver, task, slices) for solver, task in [*again, *missing]]
    # In another order each time, so that nobody always follows the same neighbour.
    order = random.Random(f"{judge.arm.name} {question.name}")
    for number in range(len(slices)):
        for turn in order.sample(turns, len(turns)):
            turn.take(judge, question, asked, number)
    hosts = [turn for turn in turns if turn.solver.adapter.stem == HOST]
    host = hosts[0].medians() if hosts else [np.nan] * len(slices)
    for turn in turns[len(again) :]:
        save(turn.task.piece, turn.piece(question, count, host))


def measure(field: Field, solvers: Sequence[Solver]) -> dict[str, str]:
    """Ask all solvers everything that is not known yet.

    Args:
        field: The measurement.
        solvers: Those that take part.

    Returns:
        By the name of a solver, the label of the settings that did best in the sweep.
    """
    try:
        for judge in field.judges[: field.size.swept]:
            print(f"sweep on {judge.arm.name}", flush=True)
            varied = [
                (solver, task(field, solver.adapter, judge, SWEEP, label, each))
                for solver in solvers
                if solver.module.SWEEP
                for label, each in settings_of(solver.module).items()
            ]
            take_turns(field, judge, SWEEP, varied)
        best, parts = {}, {}
        for solver in solvers:
            found = swept(field, solver.adapter, settings_of(solver.module))
            best[solver.adapter.stem] = chosen(found)
            parts[solver.adapter.stem] = {label: noise(each) for label, each in found.items()}
        for place, judge in enumerate(field.judges):
            if place % RENEWED == 0:
                for solver in solvers:
                    solver.close()
            for question in field.questions:
                if not fits(question, judge, place, field.size):
                    continue
                print(f"{question.title.lower()} on {judge.arm.name}", flush=True)
                tasks = []
                for solver in solvers:
                    name, settings = solver.adapter.stem, settings_of(solver.module)
                    for label in labels(field, question, best[name]):
                        part = parts[name].get(label, 1.0)
                        of = (judge, question, label, settings[label], part)
                        tasks.append((solver, task(field, solver.adapter, *of)))
                take_turns(field, judge, question, tasks)
    finally:
        for solver in solvers:
            solver.close()
    return best


def labels(field: Field, question: Question, best: str) -> list[str]:
    """Settings that a question is asked with."""
    if not field.size.recommended:
        return [best]
    return list(dict.fromkeys(("recommended", best))) if question.tuned else ["recommended"]
