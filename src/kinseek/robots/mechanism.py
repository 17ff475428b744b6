"""Interface of a mechanism: the only place that distinguishes arms with axes from black-box kinematics.

A search that only needs poses works with any `Mechanism`. A search that needs axes and links gets them by ``axes =
problem.axes``; for type checkers the result is a chain or None.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from kinseek.support.lazy import Lazy, lazy
from kinseek.support.turns import TURN, ends_meet, holds_a_turn

if TYPE_CHECKING:
    from .chain import SerialChain

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

REVOLUTE, CONTINUOUS, PRISMATIC = "revolute", "continuous", "prismatic"

RATES = {
    "velocity": "rad/s or m/s",
    "acceleration": "rad/s² or m/s²",
    "jerk": "rad/s³ or m/s³",
}
"""The derivatives of joint values that have limits, in the order of rows, with their units."""


class Mechanism(Protocol):
    """Joint variables with limits, and the pose of the tip at their values: a `SerialChain` or a `BlackBox`."""

    @property
    def name(self) -> str:
        """Name for display."""

    @property
    def base(self) -> str:
        """Link in which poses are given."""

    @property
    def tip(self) -> str:
        """Link whose pose is computed."""

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Name of each variable, from base to tip."""

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kind of each variable: revolute, continuous or prismatic; for black-box kinematics also number."""

    @property
    def lower(self) -> Array:
        """Lower limits, (n,), [rad] or [m]; a continuous joint has no limits, and is represented by -π."""

    @property
    def upper(self) -> Array:
        """Upper limits, (n,), [rad] or [m]; a continuous joint has no limits, and is represented by π."""

    @property
    def rates(self) -> Array:
        """Limits of velocity, acceleration and jerk of each variable, (3, n), in the units of `RATES`; NaN if unknown."""

    @property
    def velocity(self) -> Array:
        """Speed limit of each variable, (n,), [rad/s] or [m/s]; NaN if unknown."""

    @property
    def acceleration(self) -> Array:
        """Acceleration limit of each variable, (n,), [rad/s²] or [m/s²]; NaN if unknown."""

    @property
    def jerk(self) -> Array:
        """Jerk limit of each variable, (n,), [rad/s³] or [m/s³]; NaN if unknown."""

    @property
    def dof(self) -> int:
        """Number of joint variables n."""

    @property
    def turns(self) -> Flags:
        """Whether each variable is an angle, by its kind, (n,)."""

    @property
    def periodic(self) -> Flags:
        """Whether a full turn of each variable leaves every pose unchanged, (n,)."""

    @property
    def wraps(self) -> Flags:
        """Whether both ends of each variable's range give the same poses, (n,)."""

    @property
    def endless(self) -> Flags:
        """Whether each variable is a continuous joint that has the same pose after a full turn, (n,)."""

    @property
    def full(self) -> Flags:
        """Whether each variable is an angle whose range contains a whole turn, (n,), so that no limit ever stops it."""

    @property
    def span(self) -> Array:
        """Scale of joint values, (n,): the range, for an angle at most one turn."""

    @property
    def axes(self) -> SerialChain | None:
        """Axes and links for compiled searches, Jacobians and proofs; None if only poses are known."""

    @property
    def cheap(self) -> bool:
        """Whether one more pose costs little, since no Python code runs for it."""

    @property
    def partial(self) -> bool:
        """Whether there are joint values inside the limits without a pose (NaN)."""

    @property
    def single(self) -> bool:
        """Whether poses are computed in single precision."""

    def limited(
        self, lower: Array, upper: Array, kinds: tuple[str, ...], rates: Array | None = None
    ) -> Mechanism:
        """Return the same mechanism with other limits, (n,), kinds that fit them, and if given other rates, (3, n)."""

    def part(self, joints: tuple[int, ...], q: Array, tool: Array | None) -> Mechanism:
        """Return the same mechanism in which only some joints move, by index; the others stay at q, (n,).

        A tool, its pose in the frame of the tip, (4, 4), lengths in [m], is added to the tip.
        """

    def forward(self, q: Array) -> Array:
        """Return poses of the tip, (k, n) -> (k, 4, 4), lengths in [m]; NaN for joint values without a pose.

        Raises:
            FailedKinematics: A function fails.
        """


class Variables(Lazy):
    """Properties that follow from the kinds and limits of joint variables, for any mechanism."""

    if TYPE_CHECKING:  # Subclasses define these as a field or as a property.
        kinds: tuple[str, ...]
        lower: Array
        upper: Array
        rates: Array
        periodic: Any

    @property
    def dof(self) -> int:
        """Number of joint variables n."""
        return len(self.kinds)

    @property
    def velocity(self) -> Array:
        """Speed limit of each variable, (n,), [rad/s] or [m/s]; NaN if unknown."""
        return np.asarray(self.rates[0])

    @property
    def acceleration(self) -> Array:
        """Acceleration limit of each variable, (n,), [rad/s²] or [m/s²]; NaN if unknown."""
        return np.asarray(self.rates[1])

    @property
    def jerk(self) -> Array:
        """Jerk limit of each variable, (n,), [rad/s³] or [m/s³]; NaN if unknown."""
        return np.asarray(self.rates[2])

    @lazy
    def turns(self) -> Flags:
        """Whether each variable is an angle, by its kind, (n,)."""
        return np.array([kind in (REVOLUTE, CONTINUOUS) for kind in self.kinds])

    @lazy
    def wraps(self) -> Flags:
        """Whether both ends of each variable's range give the same poses, (n,)."""
        return np.asarray(ends_meet(self.lower, self.upper) & self.periodic)

    @lazy
    def endless(self) -> Flags:
        """Whether each variable is a continuous joint that has the same pose after a full turn, (n,).

        This is False for a joint with a mimic joint whose multiplier is not a whole number.
        """
        return np.asarray(np.array([kind == CONTINUOUS for kind in self.kinds]) & self.periodic)

    @lazy
    def full(self) -> Flags:
        """Whether each variable is an angle whose range contains a whole turn, (n,), so that no limit ever stops it."""
        return self.turns & holds_a_turn(self.lower, self.upper)

    @lazy
    def span(self) -> Array:
        """Scale of joint values, (n,): the range, for an angle at most one turn."""
        return np.where(self.turns, np.minimum(self.upper - self.lower, TURN), self.upper - self.lower)


def no_axes(mechanism: Mechanism, why: str) -> str:
    """Return the message that axes and links are required but not available; `why` names what requires them."""
    return f"{why}, but {mechanism.name!r} has black-box kinematics: only its poses are known"
