"""Unpacked sizes of the pages of a Parquet file, from the header of each page: pyarrow trusts it, and reserves the memory.

The footer has the size, too, but no reader compares it with the pages. A header is a struct PageHeader of
https://github.com/apache/parquet-format/blob/master/src/main/thrift/parquet.thrift in the compact protocol of Thrift,
https://github.com/apache/thrift/blob/master/doc/specs/thrift-compact-protocol.md.
"""

from __future__ import annotations

import io
import os
from typing import Any, BinaryIO

MOST_FOOTER = 2**20
"""Bytes of a footer: pyarrow writes 2 kB for a million poses, and 0.8 MB if every 1,000 rows are a group."""
MOST_COLUMNS = 1_000
"""Of a file; poses have at most 16."""
MOST_PARTS = 2**15
"""Columns of all groups of rows, added up: each takes more than 32 bytes of a footer that pyarrow writes."""

_KIND, _UNPACKED, _PACKED, _VALUES = 1, 2, 3, 1
"""Fields of a header: kind of the page, its size unpacked and in the file; field of its inner header: values."""
_INNER = {0: 5, 3: 8}
"""By the kind of a page with values, the field with its inner header."""
_BOOLEANS, _BYTE, _INTEGERS, _DOUBLE, _BINARY, _LIST, _STRUCT = (1, 2), 3, (4, 5, 6), 7, 8, 9, 12
"""Types of a field."""
_SCHEMA, _GROUPS, _PARTS, _ENCRYPTED = 2, 4, 1, 8
"""Fields of a footer: columns, groups of rows; of a group: its parts of columns; of a part: how it is encrypted."""
_COUNTS, _NAMES, _STRUCTS = [_INTEGERS], [(_BINARY,)], [dict[int, Any]()]
_REPORT = {2: _COUNTS, 3: _NAMES, 8: _STRUCTS, 13: _STRUCTS, 16: {2: _COUNTS, 3: _COUNTS}, 17: {2: _COUNTS}}
_LISTS_OF_FOOTER = {
    2: _STRUCTS,
    4: [{1: [{3: _REPORT, 8: {2: {1: _NAMES}}}], 4: _STRUCTS}],
    5: _STRUCTS,
    7: _STRUCTS,
}
"""Where a footer has lists, and of what: pyarrow does not look at the type that a list says it is of. Headers have none."""


def require_small_footer(file: BinaryIO) -> None:
    """Refuse a footer that takes pyarrow long, or that pyarrow ends the process for, before pyarrow reads it.

    Args:
        file: The Parquet file.

    Raises:
        ValueError: It is refused, or damaged.
    """
    size = file.seek(0, os.SEEK_END)
    file.seek(max(0, size - 8))
    end = file.read(8)
    length = int.from_bytes(end[:4], "little")
    if end[4:] != b"PAR1" or length > size - 8:
        raise ValueError("it does not end with a footer")
    if length > MOST_FOOTER:
        raise ValueError(f"its footer takes {length:,} bytes, expected at most {MOST_FOOTER:,}")
    file.seek(size - 8 - length)
    try:
        footer = _struct(io.BytesIO(file.read(length)), _LISTS_OF_FOOTER)
        columns = len(footer[_SCHEMA]) - 1  # The first one stands for the table.
        parts = [part for group in footer[_GROUPS] for part in group[_PARTS]]
        encrypted = any(_ENCRYPTED in part for part in parts)
    except (IndexError, KeyError, TypeError, OverflowError, RecursionError):
        raise ValueError("its footer is damaged") from None
    if columns > MOST_COLUMNS:
        raise ValueError(f"it has {columns:,} columns, expected at most {MOST_COLUMNS:,}")
    if len(parts) > MOST_PARTS:
        raise ValueError(f"it has {len(parts):,} parts of columns, expected at most {MOST_PARTS:,}")
    if encrypted:
        raise ValueError("its columns are encrypted, expected plain ones")


def unpacked_bytes(file: BinaryIO, column: Any) -> int:
    """Return the total unpacked size of all pages of a column.

    Args:
        file: The Parquet file.
        column: pyarrow's metadata of the column in one group of rows.

    Raises:
        ValueError: A header is damaged.
    """
    at, dictionary = column.data_page_offset, column.dictionary_page_offset
    if dictionary is not None and 0 < dictionary < at:
        at = dictionary
    end, total, values = at + column.total_compressed_size, 0, 0
    if not 0 <= at <= end:
        raise ValueError("a column has an invalid offset")
    while at < end:
        file.seek(at)
        try:
            header = _struct(file)
            values_of_page = header[_INNER[header[_KIND]]][_VALUES] if header[_KIND] in _INNER else 0
            unpacked, packed, values_of_page = map(int, (header[_UNPACKED], header[_PACKED], values_of_page))
        except (IndexError, KeyError, TypeError, OverflowError, RecursionError):
            raise ValueError("the header of a page is damaged") from None
        at = file.tell() + packed
        # pyarrow truncates longer numbers, and would so find other sizes and other following pages.
        if not (all(0 <= size < 2**31 for size in (unpacked, packed, values_of_page)) and at <= end):
            raise ValueError("a page has an invalid size")
        total += unpacked
        values += values_of_page
    if values < column.num_values:  # For some old writers pyarrow reads beyond the column.
        raise ValueError(f"the pages of a column hold {values:,} values, expected {column.num_values:,}")
    return total


def _struct(file: BinaryIO, lists: Any = None) -> dict[int, Any]:
    """Read integers and structs by the number of their field; other values are None."""
    fields: dict[int, Any] = {}
    name = 0
    while kind := file.read(1)[0]:
        name = name + (kind >> 4) if kind >> 4 else _signed(_varint(file))
        if name in fields or not 0 < name < 2**15:  # pyarrow takes the last one, and cuts longer numbers off.
            raise ValueError("a page or the footer has a duplicate field, or an invalid field number")
        fields[name] = _value(file, kind & 15, lists.get(name) if isinstance(lists, dict) else None)
    return fields


def _value(file: BinaryIO, kind: int, lists: Any) -> Any:
    if kind in _INTEGERS:
        return _signed(_varint(file))
    if kind == _STRUCT:
        return _struct(file, lists)
    if kind == _LIST and isinstance(lists, list):
        return _list(file, lists[0])
    if kind in (_BYTE, _DOUBLE, _BINARY):
        file.seek({_BYTE: 1, _DOUBLE: 8}.get(kind) or _varint(file), 1)
    elif kind not in _BOOLEANS:
        raise ValueError("a page or the footer has a field of an unknown type")
    return None


def _list(file: BinaryIO, of: Any) -> list[Any]:
    """Read a list of one of some types, or of structs."""
    count, kind = divmod(file.read(1)[0], 16)
    count = _varint(file) if count == 15 else count
    if count and kind not in ((_STRUCT,) if isinstance(of, dict) else of):
        raise ValueError("the footer has a list of an unexpected type")
    return [_value(file, kind, of) for _ in range(count)]


def _varint(file: BinaryIO) -> int:
    value = 0
    for shift in range(0, 70, 7):
        byte = file.read(1)[0]
        value |= (byte & 127) << shift
        if byte < 128:
            return value
    raise ValueError("a number in a page or the footer is too long")


def _signed(value: int) -> int:
    """Undo the zigzag."""
    return (value >> 1) ^ -(value & 1)
