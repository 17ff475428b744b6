"""What a mechanism can: the only place where an arm with axes and one that is a mere function are told apart.

A search that needs nothing but poses runs on any `Mechanism`. One that works with axes and links asks for them,
``axes = problem.axes``, and type checkers then know that they are there or that they are None.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from kinseek.lazy import Lazy, lazy
from kinseek.turns import TURN, ends_meet, holds_a_turn

if TYPE_CHECKING:
    from .chain import SerialChain

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

REVOLUTE, CONTINUOUS, PRISMATIC = "revolute", "continuous", "prismatic"


class Mechanism(Protocol):
    """Joint variables between limits, and the pose of the tip at their values: a `SerialChain` or a `BlackBox`."""

    @property
    def name(self) -> str:
        """For people."""

    @property
    def base(self) -> str:
        """Link in which poses are given."""

    @property
    def tip(self) -> str:
        """Link whose pose is meant."""

    @property
    def joint_names(self) -> tuple[str, ...]:
        """One a variable, base to tip."""

    @property
    def kinds(self) -> tuple[str, ...]:
        """Of each variable: revolute, continuous or prismatic; of a function also number."""

    @property
    def lower(self) -> Array:
        """(n,), [rad] or [m]; a continuous joint has no limits, and -π here."""

    @property
    def upper(self) -> Array:
        """(n,), [rad] or [m]; a continuous joint has no limits, and π here."""

    @property
    def velocity(self) -> Array:
        """How fast each variable may go, (n,), [rad/s] or [m/s]; NaN where nobody said."""

    @property
    def dof(self) -> int:
        """Number of joint variables n."""

    @property
    def turns(self) -> Flags:
        """Of each variable, (n,): is it an angle, by its kind?"""

    @property
    def periodic(self) -> Flags:
        """Of each variable, (n,): does a full turn leave every pose as it is?"""

    @property
    def wraps(self) -> Flags:
        """Of each variable, (n,): do both ends of its range give the same poses?"""

    @property
    def endless(self) -> Flags:
        """Of each variable, (n,): is it a continuous joint that has the same pose after a full turn?"""

    @property
    def full(self) -> Flags:
        """Of each variable, (n,): is it an angle whose range holds a whole turn? Then no limit ever stops it."""

    @property
    def span(self) -> Array:
        """What joint values are scaled by, (n,): the range, and of an angle one turn at most."""

    @property
    def axes(self) -> SerialChain | None:
        """Its axes and links, which compiled searches, Jacobians and proofs run on; None where only poses are known."""

    @property
    def cheap(self) -> bool:
        """Does one more pose cost little, since no Python runs for it?"""

    @property
    def partial(self) -> bool:
        """Are there joint values inside the limits without a pose, NaN?"""

    @property
    def single(self) -> bool:
        """Are poses computed in single precision?"""

    def limited(self, lower: Array, upper: Array, kinds: tuple[str, ...]) -> Mechanism:
        """The same with other limits, (n,), and kinds that fit them."""

    def part(self, joints: tuple[int, ...], q: Array, tool: Array | None) -> Mechanism:
        """The same, of which only some joints move, by number; the others stand as in q, (n,).

        A tool, its pose in the frame of the tip, (4, 4), lengths in [m], goes to the tip.
        """

    def forward(self, q: Array) -> Array:
        """Poses of the tip, (k, n) -> (k, 4, 4), lengths in [m]; NaN where there is none.

        Raises:
            FailedKinematics: A function that fails.
        """


class Variables(Lazy):
    """What follows from the kinds and the limits of joint variables, whatever stands behind them."""

    if TYPE_CHECKING:  # Whoever derives from it has these, as a field or as a property.
        kinds: tuple[str, ...]
        lower: Array
        upper: Array
        periodic: Any

    @property
    def dof(self) -> int:
        """Number of joint variables n."""
        return len(self.kinds)

    @lazy
    def turns(self) -> Flags:
        """Of each variable, (n,): is it an angle, by its kind?"""
        return np.array([kind in (REVOLUTE, CONTINUOUS) for kind in self.kinds])

    @lazy
    def wraps(self) -> Flags:
        """Of each variable, (n,): do both ends of its range give the same poses?"""
        return np.asarray(ends_meet(self.lower, self.upper) & self.periodic)

    @lazy
    def endless(self) -> Flags:
        """Of each variable, (n,): is it a continuous joint that has the same pose after a full turn?

        One with a follower that turns by a broken number of turns has not.
        """
        return np.asarray(np.array([kind == CONTINUOUS for kind in self.kinds]) & self.periodic)

    @lazy
    def full(self) -> Flags:
        """Of each variable, (n,): is it an angle whose range holds a whole turn? Then no limit ever stops it."""
        return self.turns & holds_a_turn(self.lower, self.upper)

    @lazy
    def span(self) -> Array:
        """What joint values are scaled by, (n,): the range, and of an angle one turn at most."""
        return np.where(self.turns, np.minimum(self.upper - self.lower, TURN), self.upper - self.lower)


def no_axes(mechanism: Mechanism, why: str) -> str:
    """Say that something needs axes and links, and that there are none; `why` says what would need them."""
    return f"{why}, and {mechanism.name!r} is a function of which only values are known"
