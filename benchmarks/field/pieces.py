"""Pieces of a measurement, each a file: one solver with one set of settings, one arm, one question. NumPy alone.

A piece is written when it is done, under another name first, so that a run that was stopped goes on from there.
"""

from __future__ import annotations

import json
import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .protocol import Array

DONE = "done"
"""The state of a piece of which every target was asked."""


@dataclass
class Piece:
    """What came of a question."""

    state: str
    """`DONE`, or why there is less."""
    q: Array = field(default_factory=lambda: np.zeros((0, 0)))
    """Answers, (k, n); NaN where there is none."""
    target: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, int))
    """Which target each answers, (k,): several may answer the same."""
    claimed: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, int))
    """1: the solver calls it a success; 0: it does not; -1: it says nothing. (k,)"""
    times: Array = field(default_factory=lambda: np.zeros(0))
    """[µs], (k,); NaN but for the first answer to a target."""
    part: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, int))
    """Which slice of the targets each belongs to, (k,)."""
    facts: dict[str, Any] = field(default_factory=dict)
    """What is no answer: seconds, megabytes, words."""
    digest: str = ""
    """Of all that it was measured with: what has changed is measured anew."""


def save(path: Path, piece: Piece) -> None:
    """Write a piece, whole or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    unfinished = path.with_suffix(".unfinished")
    told = json.dumps({"state": piece.state, "facts": piece.facts, "digest": piece.digest})
    with unfinished.open("wb") as file:
        np.savez(
            file,
            q=piece.q,
            target=piece.target,
            claimed=piece.claimed,
            times=piece.times,
            part=piece.part,
            told=np.array(told),
        )
    os.replace(unfinished, path)


def load(path: Path) -> Piece | None:
    """Read a piece; None where there is none."""
    if not path.is_file():
        return None
    with np.load(path, allow_pickle=False) as found:
        told = json.loads(str(found["told"]))
        arrays = {name: found[name] for name in ("q", "target", "claimed", "times", "part")}
    return Piece(**told, **arrays)
