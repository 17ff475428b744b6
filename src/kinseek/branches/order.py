"""Order of several solutions: by ranges, limits, dexterity, a start, or a user's cost."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from kinseek.derivatives import constraint_jacobian
from kinseek.errors import InvalidProblem
from kinseek.kernels.arrays import Array
from kinseek.problem import Problem
from kinseek.support.interrupts import raise_of_handler
from kinseek.support.turns import shortest
from kinseek.virtual_joints import extended

from .index import index_of

Cost = Callable[[Array], Any]
"""Function from joint values, (k, n), to costs, (k,); the least is best."""


Valid = Callable[[Array], Any]
"""Function from joint values, (n,), to a bool."""


Order = Literal["mid-range", "limits", "dexterity"]
"""Criterion that orders several solutions; see `Arm.branches`."""


ORDERS: tuple[Order, ...] = get_args(Order)

DEFAULT: Order = "mid-range"
"""Order in which the kernels return solutions."""


Preferred = Order | Mapping[str, Any]
"""Preferred solution of `Arm.ik`: the first by a criterion, or one with a posture."""


@dataclass(frozen=True)
class Selection:
    """Which solutions are requested, and in which order; see `Arm.branches`."""

    order: str = DEFAULT
    cost: Cost | None = None
    valid: Valid | None = None
    copies: bool = False
    count: int | None = None
    prove: bool = False

    @property
    def as_found(self) -> bool:
        """Return whether solutions are requested as the kernels find and sort them."""
        needs_choice = self.cost is not None or self.valid is not None or self.copies or self.prove
        return self.order == DEFAULT and not needs_choice


def scores(problem: Problem, q: Array, order: str, cost: Cost | None) -> Array:
    """Return the cost of each solution, (k,); the least is best."""
    chain = problem.chain
    if not len(q):
        return np.zeros(0)
    if cost is not None:
        return cost_of(cost, q)
    if problem.near is not None:
        gap = q - problem.near
        turning = np.array(chain.kinds) == "continuous"
        gap = np.where(turning, shortest(gap), gap)
        return np.asarray(np.linalg.norm(gap, axis=-1))
    return _MEASURES[order](problem, q)


def _from_mid_range(problem: Problem, q: Array) -> Array:
    return np.asarray(np.linalg.norm(_away(problem, q), axis=-1))


def _towards_limits(problem: Problem, q: Array) -> Array:
    limited = np.array(problem.chain.kinds) != "continuous"
    return np.asarray(np.abs(_away(problem, q)[..., limited]).max(axis=-1, initial=0.0))


def _away(problem: Problem, q: Array) -> Array:
    """Return how far joints are from the middle of their ranges, in halves of these, (..., n)."""
    lower, upper = problem.chain.lower, problem.chain.upper
    return np.asarray((q - (lower + upper) / 2) / np.maximum((upper - lower) / 2, 1e-12))


def _without_dexterity(problem: Problem, q: Array) -> Array:
    return -manipulability(problem, q)


def manipulability(problem: Problem, q: Array) -> Array:
    """Product of the singular values of what the goal constrains, (k, n) -> (k,) (Yoshikawa 1985, eq. 4).

    Only as many of them are used as can be nonzero for this arm: a planar arm moves in three directions of six. A goal with
    ranges constrains what it would without their widths.
    """
    if problem.goal.form.ranges:
        rigid = replace(extended(problem).problem.goal, tool=problem.goal.tool)
        problem = Problem(problem.mechanism, rigid)
    values = np.linalg.svd(constraint_jacobian(problem, q), compute_uv=False)
    return np.asarray(values[:, : problem.chain.dof - index_of(problem).freedom].prod(axis=1))


_MEASURES: dict[str, Callable[[Problem, Array], Array]] = {
    "mid-range": _from_mid_range,
    "limits": _towards_limits,
    "dexterity": _without_dexterity,
}
"""Cost of each solution by each of the `ORDERS`, (k, n) -> (k,)."""


def cost_of(cost: Cost, q: Array) -> Array:
    """Evaluate the user's cost.

    Raises:
        InvalidProblem: It raised an exception, or did not return one number for each solution.
    """
    try:
        raw = cost(q.copy())
        values = np.asarray(raw, dtype=np.float64)
    except Exception as error:
        raise_of_handler(error)
        raise InvalidProblem(
            f"cost raised {type(error).__name__}: {error}, for {len(q)} solutions, the first q = {_written(q[0])}"
        ) from error
    if values.shape != (len(q),):
        raise InvalidProblem(
            f"cost must take (k, n) and return (k,): for {q.shape} it returned {values.shape}, "
            f"the first q = {_written(q[0])}"
        )
    if np.isnan(values).any():
        raise InvalidProblem(f"cost returned NaN for q = {_written(q[np.isnan(values)][0])}")
    return values


def is_valid(valid: Valid, q: Array) -> bool:
    """Call the user's predicate for one solution, (n,).

    Raises:
        InvalidProblem: It raised an exception, or did not return a bool.
    """
    try:
        accepted = valid(q.copy())
    except Exception as error:
        raise_of_handler(error)
        raise InvalidProblem(
            f"valid raised {type(error).__name__}: {error}, for q = {_written(q)}"
        ) from error
    if isinstance(accepted, bool | np.bool_) or (
        isinstance(accepted, np.ndarray) and accepted.shape == () and accepted.dtype == bool
    ):
        return bool(accepted)
    raise InvalidProblem(f"valid must return a bool, got {accepted!r} for q = {_written(q)}")


class ManyAtOnce(ABC):
    """A predicate of kinseek that checks many solutions in one call."""

    @abstractmethod
    def __call__(self, q: Array) -> bool:
        """Check one solution, (n,)."""

    @abstractmethod
    def many(self, q: Array) -> NDArray[np.bool_]:
        """Check each solution, (k, n) -> (k,)."""


def which_valid(valid: Valid, q: Array) -> NDArray[np.bool_]:
    """Check each solution with a predicate, (k, n) -> (k,).

    Raises:
        InvalidProblem: As `is_valid`.
    """
    if isinstance(valid, ManyAtOnce):
        return valid.many(q)
    return np.array([is_valid(valid, one) for one in q], dtype=np.bool_)


def _written(q: Array) -> str:
    return np.array2string(q, precision=6, separator=", ", max_line_width=1000)
