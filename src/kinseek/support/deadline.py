"""Time limits of calls, checked between chunks of work so that the results so far are kept."""

from __future__ import annotations

import math
import time
from numbers import Real

from kinseek.errors import InvalidProblem

MOST = 1e300
"""A longer time limit counts as no limit [s]."""


class TimeUp(Exception):
    """Raised by `Deadline.check` inside a call, which catches it and keeps its results; no caller sees it."""


class Deadline:
    """A moment after which no further chunk of work is begun.

    Raises:
        InvalidProblem: Not a number of seconds above zero.
    """

    def __init__(self, time_limit: float | None = None) -> None:
        """Start the time limit now.

        Args:
            time_limit: [s]; None sets no limit.
        """
        self.begin = time.monotonic()
        if time_limit is None:
            self.end = math.inf
            return
        if isinstance(time_limit, bool) or not isinstance(time_limit, Real) or not time_limit > 0:
            raise InvalidProblem(
                f"time_limit must be a number of seconds above 0, or None, got {time_limit!r}"
            )
        # An integer may be larger than any float.
        self.end = self.begin + float(time_limit) if time_limit <= MOST else math.inf

    @property
    def limited(self) -> bool:
        """Is there a time limit?"""
        return self.end < math.inf

    @property
    def passed(self) -> bool:
        """Is the time up?"""
        return self.end < math.inf and time.monotonic() >= self.end

    def check(self) -> None:
        """Raise an error if the time is up.

        Raises:
            TimeUp: The time is up.
        """
        if self.passed:
            raise TimeUp

    def share(self, part: float) -> Deadline:
        """Return a deadline for the first step of some work: it ends after this fraction of the time left."""
        return self if self.left is None else Deadline(part * self.left)

    def before(self, part: float) -> Deadline:
        """Return a deadline that leaves this fraction of the time spent so far, at most half the rest, for a last step."""
        if self.left is None:
            return self
        return Deadline(max(self.left / 2, self.left - part * (time.monotonic() - self.begin)))

    def extended(self, seconds: float) -> Deadline:
        """Return a deadline that ends some seconds after this one, or from now if the time is up: for a short last step."""
        return self if self.left is None else Deadline(self.left + seconds)

    def at_least(self, seconds: float) -> Deadline:
        """Return this deadline, or one that ends after some seconds if that is later: for a step that must do something."""
        return self if self.end >= time.monotonic() + seconds else Deadline(seconds)

    @property
    def left(self) -> float | None:
        """Seconds left, as a time limit for a part of the work. Above 0 even if the time is up; None without a limit."""
        return None if self.end == math.inf else max(self.end - time.monotonic(), 1e-9)
