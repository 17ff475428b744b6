"""What a solver is asked: a task is one question, with one set of settings, on one arm."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from . import pieces
from .environments import digest, required
from .judge import Judge
from .protocol import Adapter
from .questions import SIZES, Question, Size, fits

FORMAT = "1"
"""Another number, and other targets are drawn and everything is measured anew."""


@dataclass(frozen=True)
class Task:
    """One question to one solver, with one set of settings, on one arm."""

    piece: str
    """File that is written."""
    arm: str
    """Name."""
    asked: str
    """File of targets."""
    label: str
    """Of the settings."""
    settings: dict[str, Any]
    way: str
    seconds: float
    digest: str


@dataclass(frozen=True)
class Field:
    """A measurement: where it is kept, and what every solver is asked the same."""

    folder: Path
    judges: Sequence[Judge]
    questions: Sequence[Question]
    seed: int = 0
    size: Size = SIZES["full"]

    def asked(self, judge: Judge, question: Question) -> Path:
        """File of targets, made if it is not there."""
        path = self.folder / f"targets-{FORMAT}" / f"{judge.arm.name}-{question.name}.npz"
        if not path.is_file():
            path.parent.mkdir(parents=True, exist_ok=True)
            unfinished = path.with_suffix(".unfinished")
            with unfinished.open("wb") as file:
                np.savez(file, **question.of(judge, self.seed, self.size)._asdict())
            os.replace(unfinished, path)
        return path


def settings_of(adapter: Adapter) -> dict[str, dict[str, Any]]:
    """Sets of settings by their labels."""
    return {"recommended": adapter.RECOMMENDED} | {
        f"sweep {i}": each for i, each in enumerate(adapter.SWEEP, 1)
    }


def task(
    field: Field,
    adapter: Path,
    judge: Judge,
    question: Question,
    label: str,
    settings: dict[str, Any],
    part: float = 1.0,
) -> Task:
    """Make one, with the digest of all that it is measured with; `part` of the question's seconds."""
    asked = field.asked(judge, question)
    seconds = question.seconds * (field.size.time * part if question.tuned else 1.0)
    known = digest(
        *(FORMAT, adapter.read_bytes(), required(adapter)),
        *(asked.read_bytes(), json.dumps(settings, sort_keys=True), question.way, f"{seconds:g}"),
    )
    path = field.folder / "pieces" / adapter.stem / label / judge.arm.name / f"{question.name}.npz"
    return Task(str(path), judge.arm.name, str(asked), label, settings, question.way, seconds, known)


def missing(tasks: Sequence[Task]) -> list[Task]:
    """Those of which there is no piece, or one that was measured with something else."""
    return [
        each for each in tasks if not (found := pieces.load(Path(each.piece))) or found.digest != each.digest
    ]


def finished(tasks: Sequence[Task]) -> list[Task]:
    """Those that are done."""
    absent = {each.piece for each in missing(tasks)}
    return [each for each in tasks if each.piece not in absent]


def tuned_on(field: Field) -> Sequence[Judge]:
    """Arms of the sweep."""
    return field.judges[: field.size.swept]


def planned(field: Field, module: Adapter) -> int:
    """How many tasks there are for a solver, if another than the recommended settings do best."""
    settings = len(settings_of(module))
    sweep = len(tuned_on(field)) * settings if settings > 1 else 0
    return sweep + sum(
        1 + (question.tuned and settings > 1)
        for place, judge in enumerate(field.judges)
        for question in field.questions
        if fits(question, judge, place, field.size)
    )
