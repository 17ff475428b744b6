"""How much an experiment may spend, and what one is: what `python -m experiments` expects of its files."""

from __future__ import annotations

import importlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, TypeVar, cast

Row = Mapping[str, Any]
"""Names of columns, and text or numbers."""
T = TypeVar("T")

EXPERIMENTS = (
    "figure_05",
    "figure_06",
    "figure_07",
    "figure_08",
    "figure_09",
    "figure_10",
    "figure_11",
    "beyond",
    "equal",
    "lengths",
    "separate",
    "question_05",
    "question_05_rounding",
    "question_06",
    "question_06_walk",
    "question_06_map",
    "question_06_slide",
    "question_06_rival",
    "question_08",
    "fraction",
    "question_10",
    "question_10_exchanged",
    "choices",
    "claim_01",
    "claim_15",
    "claim_16",
    "claim_17",
    "claim_18",
    "claim_19",
    "claim_21",
    "objects",
)
"""Every experiment, in the order in which they run."""


@dataclass(frozen=True)
class Effort:
    """Full size, or quick; and the seed of the random points."""

    quick: bool = False
    seed: int = 0

    def pick(self, full: T, quick: T) -> T:
        """Choose by size."""
        return quick if self.quick else full


class Experiment(Protocol):
    """What every file in `EXPERIMENTS` offers. `measure` and `draw` meet only in the CSV."""

    def cases(self, effort: Effort) -> Sequence[Row]:
        """What to measure: the leading columns of each row. Names of columns include units."""
        ...

    def measure(self, case: Row, effort: Effort) -> Row:
        """Measure one case: the other columns of its row."""
        ...

    def draw(self, rows: Sequence[Row], path: Path) -> None:
        """Draw the rows of the CSV into a PNG."""
        ...


def experiment(name: str) -> Experiment:
    """The module of an experiment."""
    return cast(Experiment, importlib.import_module(f"experiments.{name}"))
