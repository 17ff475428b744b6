"""Checks around a search: whether an object is a search, and whether a missed goal is in another unit."""

from __future__ import annotations

import math
from dataclasses import fields, is_dataclass, replace
from typing import Any, cast

import numpy as np

from kinseek.errors import InvalidSolver
from kinseek.ranges import PINNED
from kinseek.solution import Solution
from kinseek.support.units import warn_of_distance

from . import MODULES
from .base import Solver


def as_solver(value: Any, what: str = "solver") -> Solver:
    """Return an object with a method ``solve`` as a search.

    Args:
        value: The object.
        what: The name of the argument.

    Raises:
        InvalidSolver: The object is a name, a class instead of an instance, or anything else without ``solve``.
    """
    if not isinstance(value, type) and callable(getattr(value, "solve", None)):
        return cast(Solver, value)
    names = list(MODULES)
    if isinstance(value, type):
        own = value.__name__
        got = (
            f"the class {own}; write {what}={own}()"
            if callable(getattr(value, "solve", None))
            else f"the class {own}"
        )
    else:
        got = f"{value!r:.80} ({type(value).__name__})"
        plain = value.replace("-", "").replace("_", "").lower() if isinstance(value, str) else None
        meant = next((name for name in names if name.lower() == plain), None)
        got += f"; write {what}=kinseek.{meant}()" if meant else ""
    raise InvalidSolver(
        f"{what} must be a search, an object with a method solve, got {got}. Valid: {', '.join(f'{n}()' for n in names)}"
    )


def with_progress(solver: Solver, show_progress: bool) -> Solver:
    """Return the same search with a progress bar, if one is requested and the search supports it."""
    if show_progress and is_dataclass(solver) and any(each.name == "progress" for each in fields(solver)):
        return replace(cast(Any, solver), progress=True)
    return solver


def warn_if_far(solution: Solution) -> None:
    """Warn about missed goals whose distance is many times the arm's length.

    Warns:
        UnitWarning: The farthest missed goal is that far away.
    """
    goal, chain = solution.problem.goal, solution.problem.axes
    if np.all(solution.success) or chain is None:
        return
    if goal.ranges is not None and goal.ranges[:3] != (PINNED,) * 3:
        return  # How far away it is depends on what is left open.
    places = goal.targets[~np.atleast_1d(solution.success).reshape(-1), :, 3]
    tool = 0.0 if goal.tool is None else float(np.linalg.norm(goal.tool[:3, 3]))
    far = math.sqrt((places * places).sum(axis=1).max())
    warn_of_distance(far, chain.reach + tool, 3)
