"""Tasks: a solver with one set of settings gets one question on one arm. Each has a file for what comes of it."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.workers.environments import digest, required

from . import pieces
from .judge import Judge
from .protocol import Adapter
from .questions import SIZES, SLICES, Question, Size

FORMAT = "2"
"""Another number, and other targets are drawn and everything is measured again."""


@dataclass(frozen=True)
class Task:
    """One question to one solver, with one set of settings, on one arm."""

    piece: Path
    """File that is written."""
    label: str
    """Of the settings."""
    settings: dict[str, Any]
    seconds: float
    digest: str

    @property
    def done(self) -> bool:
        """Whether there is a piece, measured with the same adapter, requirements, settings and targets."""
        found = pieces.load(self.piece)
        return found is not None and found.digest == self.digest


@dataclass(frozen=True)
class Field:
    """A measurement: where it is kept, and what every solver gets."""

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
        *(FORMAT, adapter.read_bytes(), required(adapter), asked.read_bytes()),
        *(json.dumps(settings, sort_keys=True), f"{question.way} {SLICES} {seconds:g}"),
    )
    path = field.folder / "pieces" / adapter.stem / label / judge.arm.name / f"{question.name}.npz"
    return Task(path, label, settings, seconds, known)
