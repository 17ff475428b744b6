"""How much longer a call may take: asked between chunks of work, so that what was found is kept."""

from __future__ import annotations

import math
import time
from numbers import Real

from .errors import InvalidProblem

MOST = 1e300
"""[s] Longer than this is without end."""


class TimeUp(Exception):
    """Raised by `Deadline.check` inside a call, which catches it and keeps what was found; no caller sees it."""


class Deadline:
    """A moment after which no further chunk of work is begun.

    Raises:
        InvalidProblem: Not a number of seconds above zero.
    """

    def __init__(self, time_limit: float | None = None) -> None:
        """Begin to count now; None never ends.

        Args:
            time_limit: [s]
        """
        self.begin = time.monotonic()
        if time_limit is None:
            self.end = math.inf
            return
        if isinstance(time_limit, bool) or not isinstance(time_limit, Real) or not time_limit > 0:
            raise InvalidProblem(
                f"time_limit must be a number of seconds above 0, or None, got {time_limit!r}"
            )
        # A whole number may be larger than any float.
        self.end = self.begin + float(time_limit) if time_limit <= MOST else math.inf

    @property
    def limited(self) -> bool:
        """Is there an end at all?"""
        return self.end < math.inf

    @property
    def passed(self) -> bool:
        """Is the time up?"""
        return self.end < math.inf and time.monotonic() >= self.end

    def check(self) -> None:
        """Stop a part of the work that is too long to wait for.

        Raises:
            TimeUp: The time is up.
        """
        if self.passed:
            raise TimeUp

    def share(self, part: float) -> Deadline:
        """A deadline for the first step of some work: it ends when this part of the time left is over."""
        return self if self.left is None else Deadline(part * self.left)

    def before(self, part: float) -> Deadline:
        """A deadline that leaves time for a last step: this part of the time spent so far, at most half of what is left."""
        if self.left is None:
            return self
        return Deadline(max(self.left / 2, self.left - part * (time.monotonic() - self.begin)))

    @property
    def left(self) -> float | None:
        """Seconds left, as a time limit for a part of the work: above 0 even if the time is up; None without an end."""
        return None if self.end == math.inf else max(self.end - time.monotonic(), 1e-9)
