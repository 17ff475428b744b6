"""Results as pandas tables, if pandas is installed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinseek.errors import InvalidUse, MissingExtra

Array = NDArray[np.float64]


_REPORTED = ("success", "position_error", "orientation_error", "weighted_error", "evaluations")
_ERRORS = ("position_error", "orientation_error")


def solution_frame(solution: Any) -> Any:
    """Return a table with a row for each target of a `Solution`."""
    shape = np.shape(solution.success) or (1,)
    names = solution.problem.mechanism.joint_names
    status = [status.name for status in np.ravel(np.asarray(solution.status, dtype=object))]
    facts = {"status": status} | {name: np.ravel(getattr(solution, name)) for name in _REPORTED}
    levels = ["target"] if len(shape) == 1 else [f"target {i}" for i in range(len(shape))]
    numbers = [each.ravel() for each in np.indices(shape)]
    return _frame(names, solution.q.reshape(-1, len(names)), facts, dict(zip(levels, numbers, strict=True)))


def branches_frame(branches: Any) -> Any:
    """Return a table with a row for each solution in `Branches`."""
    facts = {name: getattr(branches, name) for name in _ERRORS}
    names = branches.problem.mechanism.joint_names
    return _frame(names, branches.q, facts, {"branch": np.arange(len(branches))})


def branches_batch_frame(batch: Any) -> Any:
    """Return a table with a row for each solution of each goal of a `BranchesBatch`.

    Raises:
        InvalidUse: The batch is empty, so the joints are unknown.
    """
    if not batch.each:
        raise InvalidUse("a batch of no goals has no table")
    facts = {name: np.concatenate([getattr(one, name) for one in batch.each]) for name in _ERRORS}
    index = {
        "target": np.repeat(np.arange(len(batch)), batch.counts.ravel()),
        "branch": np.concatenate([np.arange(len(one)) for one in batch.each]),
    }
    return _frame(batch.each[0].problem.mechanism.joint_names, batch.q, facts, index)


def _frame(names: Sequence[str], q: Array, facts: Mapping[str, Any], index: Mapping[str, Any]) -> Any:
    """Return a ``pandas.DataFrame``: a column for each joint, one for each fact, a row for each solution.

    Args:
        names: Names of the joints.
        q: Joint values, (k, n).
        facts: Further columns, (k,) each. A joint with the name of one of them is renamed to ``joint NAME``.
        index: Row index: names of the levels, and numbers, (k,) each.

    Raises:
        MissingExtra: pandas is not installed.
    """
    try:
        import pandas as pd
    except ImportError as error:
        raise MissingExtra("to_frame", "frame") from error
    columns = {f"joint {name}" if name in facts else name: q[:, i] for i, name in enumerate(names)}
    levels = [pd.Index(numbers, name=name) for name, numbers in index.items()]
    rows = levels[0] if len(levels) == 1 else pd.MultiIndex.from_arrays(levels)
    return pd.DataFrame({**columns, **facts}, index=rows)
