"""Tasks: a solver with one set of settings gets one question on one arm. What comes of it is a piece, a file each.

A piece is a table with a row for each result: joint values `q`, (n,), NaN where there is none; the number of the `target`
that it answers; `claimed`, 1 if the solver calls it a success, 0 if not, -1 if it says nothing; `times` [µs], NaN but for
the first result of a target; and the `part`, the slice of the target. Its `attrs` are the `state`, which is `DONE` or says
why there is less; `facts` that are no results; and the `digest` of all that it was measured with.
"""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from benchmarks.workers.environments import digest, required

from .judge import Judge
from .protocol import Adapter
from .questions import SIZES, SLICES, Question, Size

FORMAT = "2"
"""Another number, and other targets are drawn and everything is measured again."""


DONE = "done"
"""The state of a piece of which every target was asked."""


def save(path: Path, piece: pd.DataFrame) -> None:
    """Write a piece, whole or not at all, so that a run that was stopped goes on from there."""
    path.parent.mkdir(parents=True, exist_ok=True)
    piece.to_parquet(path.with_suffix(".unfinished"))
    os.replace(path.with_suffix(".unfinished"), path)


def load(path: Path) -> pd.DataFrame | None:
    """Read a piece; None where there is none."""
    if not path.is_file():
        return None
    piece = pd.read_parquet(path)
    if len(piece):  # Where every number is NaN, Parquet gives None.
        piece["q"] = [np.array(q, dtype=np.float64) for q in piece["q"]]
    return piece


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
        found = load(self.piece)
        return found is not None and found.attrs["digest"] == self.digest


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
    path = field.folder / "pieces" / adapter.stem / label / judge.arm.name / f"{question.name}.parquet"
    return Task(path, label, settings, seconds, known)
