"""What an adapter is: a module of four names and one function. Imports NumPy alone, for it is read in every environment.

    NAME = "My solver"                      # as it stands on the page
    PACKAGE = "my-solver"                   # whose version is told
    RECOMMENDED = {"tolerance": 1e-4}       # what its manual says; say in the docstring where
    SWEEP = ({"tolerance": 1e-6},)          # other settings, of which the best is shown too

    def load(arm: Arm, settings: dict[str, Any]) -> Solver: ...     # or load = a class that is made so

What it needs to be installed stands beside it in a file of requirements of the same name, with pinned versions. The library
itself is imported within `load`, for the name and the settings are read where it is not installed. What has to be compiled
for an arm is compiled in `load`, too, which has minutes; a question has seconds.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from benchmarks.workers.serve import Refused as Refused

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Arm:
    """An arm, as the judge reads it from its file."""

    name: str
    urdf: str
    """Path of the file, which holds the chain from base to tip and nothing else."""
    base: str
    tip: str
    joints: tuple[str, ...]
    """Names of the joints that are asked for, from base to tip, n of them."""
    kinds: tuple[str, ...]
    """``revolute``, ``continuous`` or ``prismatic``, of each."""
    lower: Array
    """(n,), [rad] or [m]; -π of a continuous joint, which has no limits."""
    upper: Array
    """(n,), [rad] or [m]"""
    axes: Array
    """Unit axes in the base with all joints at zero, (n, 3)."""
    points: Array
    """A point on each axis in the base with all joints at zero, (n, 3), [m]."""
    home: Array
    """Pose of the tip in the base with all joints at zero, (4, 4)."""
    follows: bool
    """Whether some joint follows another: then axes and points do not tell all, and the file does."""

    @property
    def middle(self) -> Array:
        """The middle of the ranges, (n,): where a solver begins that needs a start and was given none."""
        return (self.lower + self.upper) / 2


def arm_of(values: dict[str, Any]) -> Arm:
    """An arm from what JSON keeps of it."""
    arrays = {name: np.array(values[name]) for name in ("lower", "upper", "axes", "points", "home")}
    return Arm(**(values | arrays | {name: tuple(values[name]) for name in ("joints", "kinds")}))


class Answer(NamedTuple):
    """What a solver says to one question."""

    q: Array | None
    """Joint values, (n,), or None where it has nothing to give."""
    claimed: bool | None
    """Whether the solver itself calls it a success; None where it says nothing, and its user believes it."""


class Solver(Protocol):
    """What `load` makes of an arm.

    It may have more, each of which is asked for only if it is there::

        def position(self, place: Array, start: Array | None) -> Answer       # (3,) [m], no matter how it is turned
        def branches(self, T: Array) -> Sequence[Array]                       # every answer, (n,) each
        def batch(self, poses: Array) -> tuple[Array, Sequence[bool] | None]  # (k, 4, 4) -> (k, n), claimed
    """

    def solve(self, T: Any, start: Any) -> Answer:
        """One answer to a pose of the tip in the base, (4, 4), near a start, (n,), where one is given and not None."""


class Adapter(Protocol):
    """An adapter, as Python sees its module."""

    NAME: str
    PACKAGE: str
    RECOMMENDED: dict[str, Any]
    SWEEP: Sequence[dict[str, Any]]
    load: Callable[[Arm, dict[str, Any]], Solver]
    __doc__: str | None
    __file__: str


class Restarting:
    """What most adapters share: they descend from a start, and then from random ones until they succeed."""

    def __init__(self, arm: Arm, starts: int) -> None:
        """Of an arm without joints that follow others; `starts` counts all of them."""
        without_followers(arm)
        self.arm, self._starts, self._rng = arm, starts, np.random.default_rng(0)

    def solve(self, T: Any, start: Any) -> Answer:
        """Descend until it succeeds."""
        return self.descended(T, start)

    def descended(self, goal: Any, start: Any) -> Answer:
        """The answer to whatever `descend` takes as a goal."""
        q = self.arm.middle if start is None else np.asarray(start, dtype=float)
        for _ in range(self._starts):
            answer = self.descend(goal, q)
            if answer.claimed:
                break
            q = self._rng.uniform(self.arm.lower, self.arm.upper)
        return answer

    def descend(self, goal: Any, q: Array) -> Answer:
        """One descent from joint values, (n,)."""
        raise NotImplementedError


class Steps(Protocol):
    """A differential method: it stands somewhere, and makes one step a period towards a pose."""

    def stand(self, q: Any) -> None:
        """Begin there, (n,)."""

    def aim(self, T: Any) -> Any:
        """Take a pose for the target; how far it is, (6,)."""

    def missing(self) -> Any:
        """How far the target is from here, (6,)."""

    def step(self) -> None:
        """One period on, from where `aim` or `missing` looked last."""

    @property
    def q(self) -> Array:
        """Where it stands, (n,)."""


class Stepping(Restarting):
    """A differential method that makes steps until the pose is there."""

    def __init__(self, arm: Arm, method: Steps, settings: dict[str, Any]) -> None:
        """With settings `restarts`, `steps` and `tolerance`."""
        super().__init__(arm, settings["restarts"] + 1)
        self._method, self._steps, self._tolerance = method, settings["steps"], settings["tolerance"]

    def descend(self, goal: Any, q: Array) -> Answer:
        """Steps from joint values."""
        self._method.stand(q)
        error = self._method.aim(goal)
        for _ in range(self._steps):
            if self.far(error) < self._tolerance:
                return Answer(self._method.q, True)
            self._method.step()
            error = self._method.missing()
        return Answer(self._method.q, False)

    def far(self, error: Any) -> float:
        """How far an error is, (6,), in one number: the larger one of place and turn."""
        return max(float(np.linalg.norm(error[:3])), float(np.linalg.norm(error[3:])))


def without_followers(arm: Arm) -> None:
    """Refuse an arm some of whose joints follow others."""
    if arm.follows:
        raise Refused("joints that follow others are not read")
