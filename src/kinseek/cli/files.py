"""Tables in files by file type: reading of poses, and checks of output files."""

from __future__ import annotations

import codecs
import contextlib
import csv
import os
import warnings
from array import array
from collections import Counter
from collections.abc import Collection, Iterator
from functools import partial
from pathlib import Path
from typing import Any, TextIO

import numpy as np
from numpy.typing import NDArray

from kinseek.errors import InvalidGoal, InvalidProblem, reason
from kinseek.robots.files import instead_of_a_file
from kinseek.support.whole_file import output_path
from kinseek.support.workers import Worker, WorkerDied, limit_process
from kinseek.tables import TABLE_ENDINGS, import_pyarrow, require_pyarrow

from .columns import TIME, VALID, kind_of_rotation, poses_of, rigid
from .parquet_pages import MOST_FOOTER, require_small_footer, unpacked_bytes
from .words import is_number

Array = NDArray[np.float64]

MOST_LINE = 2**20
"""Maximum number of letters in a line of a .csv file. A file with holes may have a line that is longer than the disk."""
MOST_VALUES = 2**24
"""Maximum number of values in a Parquet file, independent of its size."""
VALUES_OF_A_BYTE = 16
"""Maximum number of values per byte of a larger one: those of a constant column take hardly any space."""
_PIPES = ("-", "/dev/stdin", "/dev/stdout")
"""What other programs take for standard input and output."""
BYTES_OF_A_VALUE = 16
"""Maximum size of all unpacked pages, per allowed value: 8 in a page of numbers, and as many in a dictionary."""

MOST_MEMORY, MOST_SECONDS = 2**33, 600
"""Most memory [bytes] and processor time [s] of the process that reads a Parquet file."""


def read_poses(path: Path, position_only: bool, deg: bool, option: str = "--batch") -> Array:
    """Read poses, (N, 4, 4), lengths in [m].

    Args:
        path: A table with named columns in a .csv or .parquet file, or an array (N, 4, 4) in a .npy file.
        position_only: Are columns of a rotation unnecessary?
        deg: Are angles in degrees?
        option: The option with the file on the command line, for messages.

    Raises:
        InvalidProblem: The file does not exist, is not a regular file, or is of another kind.
        InvalidGoal: Its contents are not poses; the message names the column and the row, counted from 1 without the header.
        MissingExtra: A .parquet file, and pyarrow is not installed.
    """
    return _read(path, position_only, deg, option, timed=False)[0]


def read_path(path: Path, position_only: bool, deg: bool, option: str) -> tuple[Array, Array | None]:
    """Read poses, (N, 4, 4), as `read_poses`, and their times, (N,) [s], if the table has a column of these.

    Raises:
        KinseekError: As `read_poses`.
    """
    return _read(path, position_only, deg, option, timed=True)


def _read(path: Path, position_only: bool, deg: bool, option: str, timed: bool) -> tuple[Array, Array | None]:
    where, extra = str(path), {TIME} if timed else set[str]()
    try:
        kind = ending(path, option)
        if what := instead_of_a_file(path):
            raise InvalidProblem(f"cannot read {where!r}: it is {what}, expected a regular file")
        match kind:
            case ".npy":
                return rigid(_npy(path), where), None
            case ".parquet":
                columns = _parquet(path, position_only, extra)
            case _:
                columns = _csv(path)
        times = columns.pop(TIME, None) if timed else None
        return poses_of(columns, where, position_only, deg), times
    except OSError as error:
        raise InvalidProblem(f"cannot read {where!r}: {error.strerror or error}") from None


def ending(path: Path, option: str) -> str:
    """Return the ending of a file's name.

    Raises:
        InvalidProblem: The ending is unknown.
    """
    found = path.suffix.lower()
    if found not in TABLE_ENDINGS:
        pipe = str(path) in _PIPES
        raise InvalidProblem(
            f"{option} takes a file that ends in {', '.join(TABLE_ENDINGS)}, got {str(path)!r}"
            + ("; through a pipe, solve --jsonl takes poses line by line" if pipe else "")
        )
    return found


def is_same_file(one: Path, other: Path) -> bool:
    """Return whether two paths are of one file, which may have several names, by links or by letter case."""
    if one.exists() and other.exists():
        return one.samefile(other)
    # Not `Path.resolve`, which raises RuntimeError for a link to itself.
    return os.path.realpath(one) == os.path.realpath(other)


def writable(path: Path, source: Path, option: str = "--out", read: str = "--batch") -> Path:
    """Return the path of an output file, with links resolved; `option` and `read` are the options of both files.

    Raises:
        InvalidProblem: An unknown ending, a missing folder, a target that is not a regular file, or the input file itself.
        MissingExtra: A .parquet file, and pyarrow is not installed.
    """
    if ending(path, option) == ".parquet":
        import_pyarrow()
    place = output_path(path, option)
    if is_same_file(place, source):
        raise InvalidProblem(f"{option} {str(path)!r} is the file that {read} reads")
    return place


def _csv(path: Path) -> dict[str, Array]:
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            lines = _lines(file, path)
            header = next(lines, "")
            delimiter = next((each for each in ",;\t" if each in header), ",")
            names = [name.strip() for name in next(csv.reader([header], delimiter=delimiter), [])]
            if not all(names) or all(map(is_number, names)):
                got = ", ".join(names) or "nothing"
                raise InvalidGoal(
                    f"{path}: the first row must name the columns, got {got:.200}. Valid: {VALID}"
                )
            _refuse_twice(names, str(path))
            numbers = array("d")
            for number, row in enumerate(filter(None, csv.reader(lines, delimiter=delimiter)), 1):
                try:
                    numbers.extend(_row(row, names))
                except ValueError as error:
                    raise InvalidGoal(f"{path}: row {number:,}: {error}") from None
    except UnicodeDecodeError as error:
        raise InvalidGoal(
            f"{str(path)!r} is not UTF-8 text: {error.reason} at byte {_where(error, path):,}"
        ) from None
    except csv.Error as error:
        raise InvalidGoal(f"{str(path)!r} cannot be read as a table: {error}") from None
    return dict(zip(names, np.array(numbers).reshape(-1, len(names)).T, strict=True))


def _lines(file: TextIO, path: Path) -> Iterator[str]:
    """Iterate over the lines of a file.

    Raises:
        InvalidGoal: A line is too long.
    """
    for number, line in enumerate(iter(partial(file.readline, MOST_LINE + 1), ""), 1):
        if len(line) > MOST_LINE:
            raise InvalidGoal(f"{path}: line {number:,} has more than {MOST_LINE:,} letters. Valid: {VALID}")
        yield line


def _row(words: list[str], names: list[str]) -> list[float]:
    """Read the numbers of a row.

    Raises:
        ValueError: Another number of words than of names, or one that is not a number; the message names its column.
    """
    if len(words) != len(names):
        raise ValueError(f"{len(words)} values, expected {len(names)}, one per column")
    with contextlib.suppress(ValueError):
        if "_" not in (line := "".join(words)) and line.isascii():  # Which float() takes inside a number.
            return list(map(float, words))
    name, word = next(each for each in zip(names, words, strict=True) if not _is_one_number(each[1]))
    hint = ""
    if is_number(word):  # Several, with commas or blanks between them.
        point, blanks = "numbers have a point, not a comma", "columns are separated by commas, not by blanks"
        hint = f"; {point if ',' in word else blanks}"
    raise ValueError(f"{name:.200} is {word!r:.200}, which is not a number{hint}")


def _where(error: UnicodeDecodeError, path: Path) -> int:
    """Return the place in a file of the first byte that is no text; the error has that in the part that was read last."""
    decoder, read = codecs.getincrementaldecoder("utf-8")(), 0
    with path.open("rb") as file:
        while part := file.read(2**20):
            kept = len(decoder.getstate()[0])
            try:
                decoder.decode(part)
            except UnicodeDecodeError as found:
                return read - kept + found.start
            read += len(part)
    return error.start  # The last letter is incomplete, or the file has changed.


def _is_one_number(word: str) -> bool:
    return is_number(word) and "," not in word and len(word.split()) == 1


def _refuse_twice(names: list[str], where: str) -> None:
    if twice := [name for name, count in Counter(names).items() if count > 1]:
        raise InvalidGoal(f"{where}: two columns are called {twice[0]!r:.200}")


def _npy(path: Path) -> Array:
    try:
        # A mapped file cannot claim more data than it has; and unlike numpy.load this opens no archive.
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # About overflowing shapes, which are rejected.
            array = np.lib.format.open_memmap(path, mode="r")
    except OSError:
        raise
    except Exception as error:
        # Python's parser reads the header; it raises MemoryError, TokenError and others.
        raise InvalidGoal(f"{str(path)!r} cannot be read as a .npy file: {reason(error)}") from None
    if array.ndim != 3 or array.shape[1:] != (4, 4) or array.dtype.kind not in "fiu":
        raise InvalidGoal(
            f"{path}: expected numbers of shape (N, 4, 4), got {array.dtype} of shape {array.shape}"
        )
    # Only the header comes from the mapped file: the system ends a process that reads one which its owner has shortened.
    values = np.fromfile(path, array.dtype, array.size, offset=array.offset)
    if len(values) < array.size:
        raise InvalidGoal(f"{str(path)!r} cannot be read as a .npy file: it became shorter meanwhile")
    return values.reshape(array.shape, order="F" if array.flags.fnc else "C").astype(np.float64)


def _parquet(path: Path, position_only: bool, extra: Collection[str]) -> dict[str, Array]:
    """Read a Parquet file in a process of its own, since pyarrow ends the process for some damaged files."""
    require_pyarrow()
    try:
        with Worker() as worker:
            worker.begin(_columns)
            columns: dict[str, Array] = worker.compute(
                (path, position_only, frozenset(extra), MOST_VALUES),
                "when pyarrow read it: it is damaged, or too large",
            )
    except (WorkerDied, MemoryError) as error:
        when = error if isinstance(error, WorkerDied) else f"at {MOST_MEMORY:,} bytes of memory"
        raise InvalidGoal(
            f"{str(path)!r} cannot be read as a Parquet file: the process that reads it ended {when}"
        ) from None
    return columns


def _columns(request: tuple[Path, bool, Collection[str], int]) -> dict[str, Array]:
    """Read the columns of a Parquet file in the process; see `_read`."""
    path, position_only, extra, most = request
    limit_process(MOST_MEMORY, MOST_SECONDS)
    pyarrow, parquet = import_pyarrow()
    try:
        with path.open("rb") as raw:
            require_small_footer(raw)
    except ValueError as error:
        raise InvalidGoal(f"{str(path)!r} cannot be read as a Parquet file: {error}") from None
    limits = {"thrift_string_size_limit": MOST_FOOTER, "thrift_container_size_limit": MOST_FOOTER}
    try:
        with parquet.ParquetFile(path, **limits) as file:
            _require_numbers(file, path, most)
            # Not only when all is read.
            names = [name for name in file.schema_arrow.names if name not in extra]
            kind_of_rotation(names, str(path), position_only)
            table = file.read()
        columns = {name: table.column(name).to_numpy() for name in table.column_names}
    except (pyarrow.ArrowException, UnicodeDecodeError) as error:  # The latter in names of columns.
        raise InvalidGoal(f"{str(path)!r} cannot be read as a Parquet file: {error}") from None
    for name, values in columns.items():
        if values.dtype.kind not in "fiu":
            raise InvalidGoal(f"{path}: column {name} holds {values.dtype}, expected numbers")
    return {name: np.asarray(values, dtype=np.float64) for name, values in columns.items()}


def _require_numbers(file: Any, path: Path, most_values: int) -> None:
    """Before unpacking, reject a Parquet file with other columns, or with many more values than bytes.

    Raises:
        InvalidGoal: It is rejected.
    """
    from pyarrow import types

    schema, metadata = file.schema_arrow, file.metadata
    _refuse_twice(schema.names, str(path))
    for column in schema:
        if not (types.is_integer(column.type) or types.is_floating(column.type)):
            raise InvalidGoal(f"{path}: column {column.name} holds {column.type!s:.200}, expected numbers")
    groups = [metadata.row_group(i) for i in range(metadata.num_row_groups)]
    for group in groups:
        if group.num_columns != metadata.num_columns:  # pyarrow ends the process when it looks for one more.
            raise InvalidGoal(
                f"{path}: a group of rows has {group.num_columns:,} columns, expected {metadata.num_columns:,}"
            )
    parts = [group.column(j) for group in groups for j in range(group.num_columns)]
    count_values = sum(abs(part.num_values) for part in parts)  # May be negative in a damaged file.
    count = max(count_values, metadata.num_rows * len(schema.names))
    if count > (most := max(most_values, VALUES_OF_A_BYTE * path.stat().st_size)):
        raise InvalidGoal(
            f"{path}: {count:,} numbers, expected at most {most:,} in a file of this size, {VALUES_OF_A_BYTE} per byte"
        )
    try:
        if sum(abs(part.total_compressed_size) for part in parts) > path.stat().st_size:
            raise ValueError("columns overlap")  # Otherwise a page could be read repeatedly.
        with path.open("rb") as raw:
            # pyarrow reads no page of a column without values, and writes no offset for it.
            unpacked = sum(unpacked_bytes(raw, part) for part in parts if part.num_values > 0)
    except ValueError as error:
        raise InvalidGoal(f"{str(path)!r} cannot be read as a Parquet file: {error}") from None
    if unpacked > (most := BYTES_OF_A_VALUE * most):
        raise InvalidGoal(
            f"{path}: pages of {unpacked:,} bytes, expected at most {most:,} for a file of its size"
        )
