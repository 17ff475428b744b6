"""Results as tables, from which all writers take their columns: pandas, and the files and JSON of the command line.

Each kind of result has one function here that names its columns. A writer does not know what a column means.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinseek.errors import InvalidUse, MissingExtra

Column = NDArray[Any]


@dataclass(frozen=True)
class Table:
    """Rows of a result.

    Attributes:
        joint_names: Names of the joints.
        q: Joint values, (k, n), [rad] or [m].
        columns: Further columns by name, (k,) each: flags, counts, texts, lengths in [m] and angles in [rad].
        index: What numbers the rows, from 0: the numbers by name, (k,) each; several names for nested rows.
    """

    joint_names: Sequence[str]
    q: NDArray[np.float64]
    columns: Mapping[str, Column]
    index: Mapping[str, Column]

    def by_name(self) -> dict[str, Column]:
        """Return a column for each joint, then the further columns.

        A joint with the name of one of these is called ``joint NAME``.
        """
        names = [f"joint {name}" if name in self.columns else name for name in self.joint_names]
        return dict(zip(names, self.q.T, strict=True)) | dict(self.columns)

    def records(self) -> list[dict[str, Any]]:
        """Return a mapping for each row, as JSON takes it: ``q`` and the further columns, None for a number that is NaN."""
        rows = zip(self.q.tolist(), *(values.tolist() for values in self.columns.values()), strict=True)
        return [dict(zip(("q", *self.columns), map(_nan_as_none, row), strict=True)) for row in rows]

    def to_frame(self) -> Any:
        """Return a ``pandas.DataFrame`` with the columns of `by_name`.

        Raises:
            MissingExtra: pandas is not installed.
        """
        try:
            import pandas as pd
        except ImportError as error:
            raise MissingExtra("to_frame", "frame") from error
        levels = [pd.Index(numbers, name=name) for name, numbers in self.index.items()]
        rows = levels[0] if len(levels) == 1 else pd.MultiIndex.from_arrays(levels)
        return pd.DataFrame(self.by_name(), index=rows)


def solution_table(solution: Any, in_scene: bool = False) -> Table:
    """Return a row for each target of a `Solution`; `in_scene` adds the colliding pairs as text."""
    shape = np.shape(solution.success) or (1,)
    names = solution.problem.mechanism.joint_names
    contacts = ["; ".join(map(str, each)) for each in _objects(solution.contacts)] if in_scene else []
    columns = {
        **({"contacts": np.array(contacts, dtype=str)} if in_scene else {}),
        "success": np.ravel(solution.success),
        "status": np.array([status.name for status in _objects(solution.status)], dtype=str),
        "position_error": np.ravel(solution.position_error),
        "orientation_error": _turns(solution.problem, solution.orientation_error),
        "weighted_error": np.ravel(solution.weighted_error),
        "evaluations": np.ravel(solution.evaluations),
    }
    levels = ["target"] if len(shape) == 1 else [f"target {i}" for i in range(len(shape))]
    index = dict(zip(levels, map(np.ravel, np.indices(shape)), strict=True))
    return Table(names, solution.q.reshape(-1, len(names)), columns, index)


def branches_table(branches: Any) -> Table:
    """Return a row for each solution in `Branches`."""
    problem, columns = branches.problem, _branches_columns(branches, branches.problem)
    return Table(problem.mechanism.joint_names, branches.q, columns, {"branch": np.arange(len(branches))})


def branches_batch_table(batch: Any) -> Table:
    """Return a row for each solution of each goal of a `BranchesBatch`.

    Raises:
        InvalidUse: The batch is empty, so the joints are unknown.
    """
    if not batch.each:
        raise InvalidUse("a batch of no goals has no table")
    problem = batch.each[0].problem  # The goals of a batch differ in their targets alone.
    parts = [_branches_columns(one, problem) for one in batch.each]
    columns = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    target = np.repeat(np.arange(len(batch)), batch.counts.ravel())
    index = {"target": target, "branch": np.arange(len(target)) - batch.offsets[target]}
    return Table(problem.mechanism.joint_names, batch.q, columns, index)


def _branches_columns(branches: Any, problem: Any) -> dict[str, Column]:
    return {
        "position_error": branches.position_error,
        "orientation_error": _turns(problem, branches.orientation_error),
    }


def path_table(path: Any) -> Table:
    """Return a row for each pose of a `Path`."""
    breaks = np.zeros(len(path), dtype=np.bool_)
    breaks[path.breaks] = True
    columns = {
        "reached": path.reached,
        "position_error": path.position_error,
        "orientation_error": _turns(path.problem, path.orientation_error),
        "break_after": breaks,
        **({"proved_after": np.append(path.proved, False)[: len(path)]} if path.proof is not None else {}),
    }
    return Table(path.problem.mechanism.joint_names, path.q, columns, {"pose": np.arange(len(path))})


def _turns(problem: Any, error: Any) -> Column:
    """Return orientation errors, or NaN if the goal has no orientation."""
    return np.ravel(error) if problem.goal.form.columns else np.full(np.size(error), np.nan)


def _objects(values: Any) -> list[Any]:
    """Return the values of all targets of a batch, or that of one target."""
    return values.ravel().tolist() if isinstance(values, np.ndarray) else [values]


def _nan_as_none(value: Any) -> Any:
    return None if isinstance(value, float) and math.isnan(value) else value
