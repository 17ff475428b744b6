"""Unpacked sizes of the pages of a Parquet file, from the header of each page: pyarrow trusts it, and reserves the memory.

The footer has the size, too, but no reader compares it with the pages. A header is a struct PageHeader of
https://github.com/apache/parquet-format/blob/master/src/main/thrift/parquet.thrift in the compact protocol of Thrift,
https://github.com/apache/thrift/blob/master/doc/specs/thrift-compact-protocol.md.
"""

from __future__ import annotations

from typing import Any, BinaryIO

_KIND, _UNPACKED, _PACKED, _VALUES = 1, 2, 3, 1
"""Fields of a header: kind of the page, its size unpacked and in the file; field of its inner header: values."""
_INNER = {0: 5, 3: 8}
"""Field with the inner header, by the kind of a page with values."""
_BOOLEANS, _BYTE, _INTEGERS, _DOUBLE, _BINARY, _STRUCT = (1, 2), 3, (4, 5, 6), 7, 8, 12
"""Types of a field; a header has no lists."""


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
        raise ValueError("a column has an impossible place")
    while at < end:
        file.seek(at)
        try:
            header = _struct(file)
            held = header[_INNER[header[_KIND]]][_VALUES] if header[_KIND] in _INNER else 0
            unpacked, packed, held = map(int, (header[_UNPACKED], header[_PACKED], held))
        except (IndexError, KeyError, TypeError, OverflowError, RecursionError):
            raise ValueError("the header of a page is damaged") from None
        at = file.tell() + packed
        # pyarrow truncates longer numbers, and would so find other sizes and other following pages.
        if not (all(0 <= size < 2**31 for size in (unpacked, packed, held)) and at <= end):
            raise ValueError("a page has an impossible size")
        total += unpacked
        values += held
    if values < column.num_values:  # For some old writers pyarrow reads beyond the column.
        raise ValueError(f"the pages of a column hold {values:,} values, expected {column.num_values:,}")
    return total


def _struct(file: BinaryIO) -> dict[int, Any]:
    """Read integers and structs by the number of their field; other values are None."""
    fields: dict[int, Any] = {}
    name = 0
    while kind := file.read(1)[0]:
        name = name + (kind >> 4) if kind >> 4 else _signed(_varint(file))
        if name in fields or not 0 < name < 2**15:  # pyarrow uses the last one, and truncates longer numbers.
            raise ValueError("the header of a page has a field twice, or one of an impossible number")
        fields[name] = _value(file, kind & 15)
    return fields


def _value(file: BinaryIO, kind: int) -> Any:
    if kind in _INTEGERS:
        return _signed(_varint(file))
    if kind == _STRUCT:
        return _struct(file)
    if kind in (_BYTE, _DOUBLE, _BINARY):
        file.seek({_BYTE: 1, _DOUBLE: 8}.get(kind) or _varint(file), 1)
    elif kind not in _BOOLEANS:
        raise ValueError("the header of a page has a field of an unknown type")
    return None


def _varint(file: BinaryIO) -> int:
    value = 0
    for shift in range(0, 70, 7):
        byte = file.read(1)[0]
        value |= (byte & 127) << shift
        if byte < 128:
            return value
    raise ValueError("a number in the header of a page is too long")


def _signed(value: int) -> int:
    """Undo the zigzag."""
    return (value >> 1) ^ -(value & 1)
