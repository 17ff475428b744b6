"""Follow poses that arrive one after the other, with memory that does not depend on their number."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinseek.errors import InvalidGoal, InvalidProblem
from kinseek.goal import Goal
from kinseek.robots.mechanism import Mechanism
from kinseek.support.interrupts import raise_of_handler

from .arguments import read, row_of_goals, together
from .follow import follow
from .path import Path

Array = NDArray[np.float64]


def stream(
    arm: Mechanism,
    poses: Iterable[Any],
    window: int,
    look_ahead: int,
    options: dict[str, Any],
    threads: int | None,
) -> Iterator[Path]:
    """Yield pieces of a path as soon as their poses and those of the look-ahead have arrived; see `Arm.follow_stream`."""
    if isinstance(options["cost"], str):
        raise InvalidProblem(
            "the cost of a stream must be a function from joint values, (k, n), to costs, (k,), got "
            f"{options['cost']!r:.80}; "
            'cost="time" needs all poses at once: use Arm.follow'
        )
    source, handed = _Source(poses), 0
    rows: list[Any] = []
    here: Array | None = None
    while True:
        rows += source.next(window + look_ahead + 1 - len(rows))
        goal, good = _as_far_as_good(rows, handed, source)
        ended = source.ended or good < len(rows)
        if goal is None or (handed and good == 1):
            break
        request = read(arm, goal, **options)
        if here is not None:  # No check: where a pose was missed, the path continues from the nearest pose.
            request = replace(request, start=here)
        take = good if ended else window + 1
        path = follow(request, threads, lambda done: None, take)
        yield path
        if ended:
            break
        here, rows, handed = path.q[-1], rows[window:], handed + window
        options["start"] = None
    if source.error is not None:
        raise source.error
    if not handed and goal is None:
        raise InvalidGoal("a path needs at least one pose, got none")


class _Source:
    """Poses in the order of arrival."""

    def __init__(self, poses: Iterable[Any]) -> None:
        self._poses = row_of_goals(poses)
        self.ended = False
        self.error: Exception | None = None
        """The exception that the iterator raised, or the error of an invalid pose."""

    def next(self, count: int) -> list[Any]:
        """Return `count` more poses, or fewer if the iterator ends."""
        rows: list[Any] = []
        while len(rows) < count and not self.ended:
            try:
                rows.append(next(self._poses))
            except StopIteration:
                self.ended = True
            except Exception as error:
                raise_of_handler(error)
                self.ended, self.error = True, error
        return rows


def _as_far_as_good(rows: list[Any], handed: int, source: _Source) -> tuple[Goal | None, int]:
    """Return one goal of the poses before the first invalid one, and their number; store the error in the source."""
    if not rows:
        return None, 0
    try:
        return together(rows), len(rows)
    except InvalidGoal:
        pass
    good = 0
    for row in rows:
        try:
            together([*rows[:1], row] if good else [row])
        except InvalidGoal as error:
            source.error = InvalidGoal(f"pose {handed + good}: {error}")
            break
        good += 1
    return (together(rows[:good]) if good else None), good
