"""Batches with invalid targets: the valid targets are solved, the invalid ones are marked."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .errors import InvalidProblem, suggest
from .goal import Goal
from .poses import good_and_bad
from .problem import Problem, as_joints
from .robots.mechanism import Mechanism
from .solution import Solution

Array = NDArray[np.float64]

WAYS = ("error", "skip")
"""Ways to treat a target that is not a pose."""


def without_invalid(
    bad: str, target: Any, near: Any, mechanism: Mechanism, solve_valid: Callable[..., Solution]
) -> Solution:
    """Solve the targets that are poses, and mark the others as invalid.

    Args:
        bad: How to treat invalid targets, ``"skip"``.
        target: As `as_pose` takes it, (..., 4, 4).
        near: As `Arm.ik` takes it.
        mechanism: The arm.
        solve_valid: Solves a batch, (k, 4, 4), with `near` as joint values, (n,), (k, n) or None.

    Raises:
        InvalidProblem: `bad` is another word.
    """
    if bad not in WAYS:
        raise InvalidProblem(suggest(str(bad), WAYS, "value of bad="))
    matrix, good = good_and_bad(target)
    if good.all():
        return solve_valid(matrix, near=near)
    shape, chosen = good.shape, good.ravel()
    start = None if near is None else as_joints(mechanism, near, "near")
    # As for a whole batch: a row of values for every target, unless one row is shared by all.
    poses = np.where(good[..., None, None], matrix, np.eye(4))
    starts = Problem(mechanism, Goal.pose(poses), start).near
    if starts is not None and starts.ndim > 1:
        starts = np.broadcast_to(starts, (*shape, mechanism.dof)).reshape(-1, mechanism.dof)[chosen]
    return _scatter(solve_valid(poses.reshape(-1, 4, 4)[chosen], near=starts), poses, good, start)


def _scatter(solved: Solution, poses: Array, good: NDArray[np.bool_], near: Array | None) -> Solution:
    """Put the solutions of some targets of a batch in their places."""
    shape = good.shape

    def column(values: NDArray[Any]) -> Any:
        whole = np.full((*shape, *values.shape[1:]), np.nan if values.dtype.kind == "f" else 0, values.dtype)
        whole[good] = values
        return whole if whole.ndim else whole.item()

    columns = {
        each.name: column(getattr(solved, each.name))
        for each in fields(solved)
        if each.name not in ("problem", "_trace", "_contacts", "invalid")
    }

    def objects(values: NDArray[np.object_] | None) -> NDArray[np.object_] | None:
        if values is None or not shape:
            return None
        whole = np.empty(shape, dtype=object)
        whole[good] = values
        return whole

    problem = solved.problem
    return replace(
        solved,
        **columns,
        invalid=~good if shape else True,
        problem=replace(problem, goal=problem.goal.at(poses), near=near),
        _trace=objects(solved._trace),
        _contacts=objects(solved._contacts),
    )
