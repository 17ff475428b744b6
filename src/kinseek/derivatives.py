"""How joint values and goals move together: Jacobians of what a goal constrains, and derivatives of solutions.

Joint values q that reach a goal solve an equation f(q) = t. By the implicit function theorem dq/dt is the inverse of
J = df/dq, and the pseudo-inverse if the arm is redundant.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .errors import InvalidUse
from .kernels.arm.forward import forward_many
from .kernels.arm.jacobian import jacobian_many
from .problem import Problem
from .robots.mechanism import no_axes
from .robots.sampling import weyl
from .support.interrupts import in_chunks

Array = NDArray[np.float64]

SINGULAR = 1e-6
"""Singular value of the Jacobian at and below which a solution is singular; lengths are relative to the length of the arm.
There a change of the target by the default tolerance moves joints by about a radian."""

_PLACES = 7
"""Configurations at which the redundancy is computed. The least value counts, since singularities increase it."""


def constraint_jacobian(problem: Problem, q: Array) -> Array:
    """Jacobian of the pose components that the goal constrains, (k, n) -> (k, rows, n); [m] or [rad] per joint unit."""
    return _constrained(problem, q, jacobian_many(problem.arrays, np.ascontiguousarray(q)))


def _constrained(problem: Problem, q: Array, twists: Array) -> Array:
    """Return the components of twists of the tip, the columns of (k, 6, m), that the goal constrains at q, (k, rows, m)."""
    columns = problem.goal.columns
    if columns == 0:
        return twists[:, :3]
    if columns == 1:
        # A rotation about the tool axis does not change its direction, so that component is not constrained.
        tool = forward_many(problem.arrays, np.ascontiguousarray(q))[:, :3, 0]
        turns = twists[:, 3:]
        across = turns - tool[:, :, None] * np.einsum("kr,krn->kn", tool, turns)[:, None, :]
        return np.concatenate([twists[:, :3], across], axis=1)
    return twists


def freedom(problem: Problem) -> int:
    """Return the number of joints minus the rank of the goal's constraints away from singularities."""
    chain = problem.chain
    q = chain.lower + (0.1 + 0.8 * weyl(_PLACES, chain.dof)) * (chain.upper - chain.lower)
    values = np.linalg.svd(constraint_jacobian(problem, q), compute_uv=False)
    rank = int((values > 1e-6 * values.max()).sum(axis=1).max())
    return chain.dof - rank


def derivatives_of(problem: Problem, q: Array, reached: Any) -> Array:
    """Differentiate solutions by their targets; see `Solution.derivative`.

    Args:
        problem: The arm and the goal. Its targets do not matter, because q is differentiated at the pose that q reaches.
        q: Joint values, (..., n), [rad] or [m].
        reached: Which of them reach their targets, (...).

    Returns:
        (..., n, 6); NaN for joint values that are singular or do not reach their target.

    Raises:
        InvalidUse: The goal has free axes or ranges, or the arm has black-box kinematics.
    """
    rank = _rank(problem, "derivative")
    axes = np.eye(6)  # From the axes of the frame in which the goal is given to those of the arm's base.
    if problem.goal.base is not None:
        axes[:3, :3] = axes[3:, 3:] = problem.goal.base[:3, :3].T

    def differentiate(q: Array, reached: NDArray[np.bool_]) -> Array:
        scale, U, values, V = _decomposed(problem, q)
        inverted = np.swapaxes(V[:, :rank], 1, 2) / values[:, None, :rank] @ np.swapaxes(U[:, :, :rank], 1, 2)
        # The target may move in any way.
        free = _constrained(problem, q, np.broadcast_to(np.eye(6), (len(q), 6, 6)))
        D = inverted * scale @ free @ axes
        D[~reached | _is_singular(values, rank)] = np.nan
        return np.asarray(D)

    return _of_each(differentiate, q, reached)


def null_spaces_of(problem: Problem, q: Array, reached: Any) -> Array:
    """Return orthonormal directions in which joints move while the tip stays; see `Solution.null_space`.

    Args:
        problem: As in `derivatives_of`.
        q: As in `derivatives_of`.
        reached: As in `derivatives_of`.

    Returns:
        (..., n, degree of redundancy); NaN as in `derivatives_of`.

    Raises:
        InvalidUse: As in `derivatives_of`.
    """
    rank = _rank(problem, "null_space")

    def complement(q: Array, reached: NDArray[np.bool_]) -> Array:
        _, _, values, V = _decomposed(problem, q)
        null = np.swapaxes(V[:, rank:], 1, 2).copy()
        null[~reached | _is_singular(values, rank)] = np.nan
        return null

    return _of_each(complement, q, reached)


def _of_each(work: Callable[[Array, NDArray[np.bool_]], Array], q: Array, reached: Any) -> Array:
    """Apply a function of k solutions to all of a batch, (..., n) -> (..., rows, columns)."""
    flags = np.atleast_1d(np.asarray(reached, dtype=np.bool_)).ravel()
    # Joint values of a target that is not a pose are NaN, which no decomposition takes.
    rows = np.where(flags[:, None], q.reshape(-1, q.shape[-1]), 0.0)
    found = in_chunks(work, rows, flags)
    return found.reshape(*q.shape[:-1], *found.shape[1:])


def _rank(problem: Problem, what: str) -> int:
    """Return the number of independent constraints of the goal away from singularities."""
    if problem.axes is None:
        raise InvalidUse(no_axes(problem.mechanism, f"{what} is computed from axes"))
    if problem.goal.form.ranges:
        loose = [*problem.goal.free, *problem.goal.within]
        raise InvalidUse(
            f"{what} is defined for whole poses, positions and pointing goals, got a goal with free axes or ranges "
            f"({', '.join(loose)}): while its target moves, a solution may also move inside the ranges, or stay"
        )
    return problem.chain.dof - freedom(problem)


def _decomposed(problem: Problem, q: Array) -> tuple[Array, Array, Array, Array]:
    """Return the scale of each row of the Jacobian, (rows,), and the singular value decomposition of the scaled one.

    Lengths are relative to the length of the arm, so that they can be compared with angles.
    """
    J = constraint_jacobian(problem, q)
    scale = np.ones(J.shape[1])
    scale[:3] /= problem.chain.length
    U, values, V = np.linalg.svd(scale[:, None] * J)
    return scale, U, values, V


def _is_singular(values: Array, rank: int) -> NDArray[np.bool_]:
    return np.asarray(values[:, rank - 1] <= SINGULAR)
