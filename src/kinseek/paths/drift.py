"""Where the joints of a redundant arm drift while its hand follows a target: Liégeois 1977, section III."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple, assert_never

import numpy as np
from numpy.typing import NDArray

from kinseek.branches.index import index_of
from kinseek.branches.order import ORDERS, Order, manipulability
from kinseek.derivatives import constraint_jacobian
from kinseek.errors import InvalidProblem, suggest
from kinseek.kinds import PLAIN_KINDS
from kinseek.postures import ARM_ANGLE, PostureRequest, read_posture
from kinseek.problem import Problem, as_joints
from kinseek.support.turns import shortest

Array = NDArray[np.float64]

APPROACH = 0.2
"""Time constant with which a posture is approached [s]. Not examined further."""

RISE = 0.1
"""Time constant with which the velocity of a drift rises and falls [s]. Not examined further."""

RCOND, TINY = 1e-3, 1e-9
"""Singular values that count as 0, relative to the largest one, and squares of gradients that do."""

AGAIN = 0.01
"""The velocities of a drift are computed again after this time [s]."""

SMALL = 1e-4
"""Step of the differences for the gradient of the dexterity [rad] or [m]."""


class DriftOptions(NamedTuple):
    """What a redundant arm prefers while its hand follows a target."""

    what: Any = None
    """See `Arm.track`; None for nothing."""
    speed: float = 0.2
    """Largest velocity of a joint [rad/s] or [m/s]."""


ANYWHERE = DriftOptions()


class DriftState(NamedTuple):
    """What a drift goes on from."""

    age: float
    """Time since the aim was computed [s]."""
    aim: Array
    """Velocity that is approached, (n,)."""
    velocity: Array
    """(n,)"""


class Drift:
    """A preferred motion of joints of which the hand needs only what does not move it."""

    def __init__(self, problem: Problem, prefer: Any, speed: float) -> None:
        """Read a preference.

        Args:
            problem: The arm, and a goal like those to come.
            prefer: A name of `ORDERS`, ``{"arm_angle": angle}``, or joint values, (n,).
            speed: Largest velocity of each joint [rad/s] or [m/s].

        Raises:
            InvalidProblem: An unknown preference, or the goal leaves the arm no choice.
        """
        self._problem, self._speed = problem, speed
        self._posture: PostureRequest | None = None
        self._order: Order | None = None
        chain = problem.chain
        self.state = DriftState(np.inf, np.zeros(chain.dof), np.zeros(chain.dof))
        """Before the next step."""
        self._ends = np.array(chain.kinds) != "continuous"
        self._middle = np.where(self._ends, (chain.lower + chain.upper) / 2.0, 0.0)
        self._half = np.where(self._ends, np.maximum(chain.upper - chain.lower, 1e-12) / 2.0, 1.0)
        if index_of(problem).freedom == 0:
            raise InvalidProblem(
                f"prefer= needs an arm that can move while its hand is at the goal, and the {chain.dof} joints of "
                f"{problem.mechanism.name!r} have a finite number of solutions"
            )
        if problem.goal.form.ranges:
            raise InvalidProblem(
                f"prefer= of a tracker takes goals of {', '.join(kind.noun for kind in PLAIN_KINDS)}, got "
                f"{problem.goal.form.noun}"
            )
        if isinstance(prefer, str):
            if prefer not in ORDERS:
                raise InvalidProblem(suggest(prefer, ORDERS, "preference"))
            self._order = prefer
        elif isinstance(prefer, Mapping) and set(prefer) == {ARM_ANGLE}:
            self._posture = read_posture(problem.mechanism, prefer)
        else:
            if isinstance(prefer, Mapping) and ARM_ANGLE in prefer:
                raise InvalidProblem(
                    f"prefer= of a tracker takes {ARM_ANGLE!r} alone, got {', '.join(map(str, prefer))}"
                )
            self._middle = as_joints(problem.mechanism, prefer, "prefer")
            if self._middle.shape != (chain.dof,):
                raise InvalidProblem(
                    f"prefer must be one of {', '.join(map(repr, ORDERS))}, {{'arm_angle': angle}}, or joint values, "
                    f"({chain.dof},), got shape {self._middle.shape}"
                )

    def step(self, q: Array, h: float) -> Array:
        """Return by how much the preference moves the joints at q in the next step, (n,)."""
        age, aim, velocity = self.state
        age += h
        if age >= AGAIN:
            age, wanted = 0.0, self._wanted(q)
            fastest = np.abs(wanted).max(initial=0.0)
            aim = wanted * min(1.0, self._speed / fastest) if fastest > 0.0 else wanted
        self.state = DriftState(age, aim, velocity + (1.0 - np.exp(-h / RISE)) * (aim - velocity))
        return self.state.velocity * h

    def _wanted(self, q: Array) -> Array:
        """Return the preferred velocity of joints that does not move the hand: the projection of the gradient."""
        J = constraint_jacobian(self._problem, q[None])[0]
        still = np.eye(len(q)) - np.linalg.pinv(J, rcond=RCOND) @ J
        if self._posture is not None:
            off, gradient = self._posture.angle_errors(q[None])
            along = still @ gradient[0]
            rate = float(along @ gradient[0])
            # Where the angle is undefined, there is nothing to be approached.
            return along * off[0] / (APPROACH * rate) if rate > TINY else np.zeros(len(q))
        return np.asarray(still @ self._gradient(q))

    def _gradient(self, q: Array) -> Array:
        away = q - self._middle
        match self._order:
            case "dexterity":
                steps = SMALL * np.eye(len(q))
                with np.errstate(divide="ignore"):
                    values = np.log(manipulability(self._problem, q + np.concatenate([steps, -steps])))
                gradient = (values[: len(q)] - values[len(q) :]) / (2.0 * SMALL)
                gradient[~np.isfinite(gradient)] = 0.0
                return self._speed * gradient
            case "limits":
                return -self._speed * np.where(self._ends, away / self._half, 0.0) ** 3
            case "mid-range":
                return -np.where(self._ends, away, 0.0) / APPROACH
            case None:  # To joint values.
                return -np.where(self._ends, away, shortest(away)) / APPROACH
            case _:
                assert_never(self._order)
