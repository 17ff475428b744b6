"""Which settings serve a solver best, found on arms and targets apart from what is measured."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from .judge import STRICT, good
from .questions import SWEEP
from .tables import interval
from .tasks import Field, load, task

LEAST = 0.4
"""Part of the time that is spent however sure the share is: times vary, too."""


class Swept(NamedTuple):
    """What came of one set of settings in the sweep."""

    solved: int
    asked: int
    mean: float
    """Of a call [µs]."""


def swept(field: Field, adapter: Path, settings: dict[str, dict[str, Any]]) -> dict[str, Swept]:
    """What came of each set of settings that answered at all; of a single one nothing, for there is nothing to choose."""
    found: dict[str, Swept] = {}
    for label, each in settings.items() if len(settings) > 1 else ():
        solved, asked, times = 0, 0, []
        for judge in field.judges[: field.size.swept]:
            one = task(field, adapter, judge, SWEEP, label, each)
            piece = load(one.piece)
            if piece is None or piece.empty:
                continue
            with np.load(field.asked(judge, SWEEP)) as targets:
                verdict = judge.judge(np.stack(piece["q"]), targets["poses"][piece["target"]])
            solved += int(good(verdict, STRICT, STRICT).sum())
            times.append(piece["times"])
            asked += len(piece)
        if asked:
            found[label] = Swept(solved, asked, float(np.concatenate(times).mean()))
    return found


def chosen(found: dict[str, Swept]) -> str:
    """The settings that solve most; of those that may be within half a percent of that, the quickest.

    What is asked few targets and misses one may solve as many as what misses none: the 95 % interval decides.
    """
    if not found:
        return "recommended"
    most = max(each.solved / each.asked for each in found.values())
    near = (label for label, each in found.items() if interval(each.solved, each.asked)[1] >= most - 0.005)
    return min(near, key=lambda label: found[label].mean)


def noise(found: Swept | None) -> float:
    """What part of a question's time is spent: in proportion to how much a share varies, by the sweep.

    A share of all or of nothing is known from few targets; one of a half needs most. The sweep has other targets than what
    is measured by it, so that when to stop does not depend on what comes out.
    """
    if found is None:
        return 1.0
    share = (found.solved + 2) / (found.asked + 4)  # Agresti and Coull 1998: never quite all or nothing.
    return max(round(2.0 * float(np.sqrt(share * (1.0 - share))), 1), LEAST)
