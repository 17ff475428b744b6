"""What an adapter is: a module of four names and one function. Imports NumPy alone, for it is read in every environment.

    NAME = "My solver"                      # as it stands on the page
    PACKAGE = "my-solver"                   # whose version is told
    RECOMMENDED = {"tolerance": 1e-4}       # what its manual says; say in the docstring where
    SWEEP = ({"tolerance": 1e-6},)          # other settings, of which the best is shown too

    def load(arm: Arm, settings: dict[str, Any]) -> Solver: ...

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
