"""Results as tables, from which all writers take their columns: pandas, files, and the JSON of the command line.

Each kind of result has one function here that names its columns. A writer does not know what a column means.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from kinseek.errors import InvalidUse, MissingExtra, reason
from kinseek.support.interrupts import raise_of_handler
from kinseek.support.whole_file import whole_file

Column = NDArray[Any]

TABLE_ENDINGS = (".csv", ".npy", ".parquet")
"""Endings of the files that `write_table` can write."""


@dataclass(frozen=True)
class Table:
    """Rows of a result.

    Attributes:
        joint_names: Names of the joints.
        q: Joint values, (k, n), [rad] or [m].
        columns: Further columns by name, (k,) each: flags, counts, texts, lengths in [m] and angles in [rad]; or with a
            number for each joint, (k, n), such as velocities.
        index: What numbers the rows, from 0: the numbers by name, (k,) each; several names for nested rows.
    """

    joint_names: Sequence[str]
    q: NDArray[np.float64]
    columns: Mapping[str, Column]
    index: Mapping[str, Column]

    def by_name(self) -> dict[str, Column]:
        """Return a column for each joint, then the further columns.

        A joint with the name of one of these is called ``joint NAME``, or ``joint joint NAME`` if another joint is called
        so. Of a column with a number for each joint, those of a joint are called ``JOINT COLUMN``.
        """
        further: dict[str, Column] = {}
        for name, values in self.columns.items():
            if values.ndim == 1:
                further[name] = values
            else:
                further |= {f"{joint} {name}": values[:, j] for j, joint in enumerate(self.joint_names)}
        names = list(self.joint_names)
        for j in range(len(names)):
            while names[j] in further or names.count(names[j]) > 1:
                names[j] = f"joint {names[j]}"
        return dict(zip(names, self.q.T, strict=True)) | further

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


def write_table(path: Path, table: Table, ending: str | None = None) -> None:
    """Write a table completely, or not at all; a .npy file has the joint values in one field ``q``, (k, n).

    Args:
        path: A path from `output_path`.
        table: The table.
        ending: One of the `TABLE_ENDINGS`, by default that of the path; a link to it may have another one.

    Raises:
        InvalidProblem: It cannot be written.
        MissingExtra: A .parquet file, and pyarrow is not installed.
    """
    with whole_file(path) as file:
        match (ending or path.suffix).lower():
            case ".npy":
                np.save(file, _records({"q": table.q, **table.columns}))
            case ".parquet":
                pyarrow, parquet = import_pyarrow()
                parquet.write_table(pyarrow.table(table.by_name()), file)
            case _:
                _write_csv(file, table.by_name())


def require_pyarrow() -> None:
    """Make sure that pyarrow is installed, without importing it.

    Raises:
        MissingExtra: It is not.
    """
    if find_spec("pyarrow") is None:
        raise MissingExtra("A .parquet file", "parquet")


def import_pyarrow() -> tuple[Any, Any]:
    """Import pyarrow, and return it with its module for Parquet files.

    Raises:
        MissingExtra: It is not installed, or cannot be imported, for example because it was built for another NumPy.
    """
    try:
        import pyarrow
        import pyarrow.parquet
    except MemoryError:
        raise
    except Exception as error:  # Libraries raise anything at their import.
        raise_of_handler(error)
        missing = isinstance(error, ModuleNotFoundError) and (error.name or "").partition(".")[0] == "pyarrow"
        raise MissingExtra("A .parquet file", "parquet", "" if missing else reason(error)) from None
    return pyarrow, pyarrow.parquet


def _records(fields: Mapping[str, NDArray[Any]]) -> NDArray[Any]:
    """Return one record per row."""
    records = np.empty(
        len(fields["q"]), [(name, values.dtype, values.shape[1:]) for name, values in fields.items()]
    )
    for name, values in fields.items():
        records[name] = values
    return records


def _write_csv(file: BinaryIO, columns: Mapping[str, NDArray[Any]]) -> None:
    text = io.TextIOWrapper(file, encoding="utf-8", newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    lists = [values.tolist() for values in columns.values()]
    lists = [
        [str(value).lower() for value in each] if isinstance(each[0], bool) else each
        for each in lists
        if each
    ]
    writer.writerows(zip(*lists, strict=True))
    text.detach()  # Flushes, and leaves the file open.


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
        "orientation_error": _orientation_errors(solution.problem, solution.orientation_error),
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
        "orientation_error": _orientation_errors(problem, branches.orientation_error),
    }


def path_table(path: Any) -> Table:
    """Return a row for each pose of a `Path`."""
    breaks = np.zeros(len(path), dtype=np.bool_)
    breaks[path.breaks] = True
    columns = {
        "reached": path.reached,
        "position_error": path.position_error,
        "orientation_error": _orientation_errors(path.problem, path.orientation_error),
        "break_after": breaks,
        **({"proved_after": np.append(path.proved, False)[: len(path)]} if path.proof is not None else {}),
    }
    return Table(path.problem.mechanism.joint_names, path.q, columns, {"pose": np.arange(len(path))})


def _orientation_errors(problem: Any, error: Any) -> Column:
    """Return orientation errors, or NaN if the goal has no orientation."""
    return np.ravel(error) if problem.goal.form.columns else np.full(np.size(error), np.nan)


def _objects(values: Any) -> list[Any]:
    """Return the values of all targets of a batch, or that of one target."""
    return values.ravel().tolist() if isinstance(values, np.ndarray) else [values]


def _nan_as_none(value: Any) -> Any:
    return None if isinstance(value, float) and math.isnan(value) else value
