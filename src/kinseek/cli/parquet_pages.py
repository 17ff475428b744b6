"""What the pages of a Parquet file unpack to, by the header of each page: pyarrow believes it, and reserves the memory.

The footer says it, too, but nobody compares it with the pages. A header is a struct PageHeader of
https://github.com/apache/parquet-format/blob/master/src/main/thrift/parquet.thrift in the compact protocol of Thrift,
https://github.com/apache/thrift/blob/master/doc/specs/thrift-compact-protocol.md.
"""

from __future__ import annotations

from typing import Any, BinaryIO

_UNPACKED, _PACKED = 2, 3
"""Fields of a header: bytes of the page when it is unpacked, and in the file."""
_BOOLEANS, _BYTE, _INTEGERS, _DOUBLE, _BINARY, _STRUCT = (1, 2), 3, (4, 5, 6), 7, 8, 12
"""Types of a field; a header has no lists."""


def unpacked_bytes(file: BinaryIO, column: Any) -> int:
    """Add up what all pages of a column unpack to.

    Args:
        file: The Parquet file.
        column: pyarrow's metadata of the column in one group of rows.

    Raises:
        ValueError: A header is damaged.
    """
    at, dictionary = column.data_page_offset, column.dictionary_page_offset
    if dictionary is not None and 0 < dictionary < at:
        at = dictionary
    end, total = at + column.total_compressed_size, 0
    if not 0 <= at <= end:
        raise ValueError("a column has an impossible place")
    while at < end:
        file.seek(at)
        try:
            header = _struct(file)
            unpacked, packed = header[_UNPACKED], header[_PACKED]
        except (IndexError, KeyError, OverflowError, RecursionError):
            raise ValueError("the header of a page is damaged") from None
        at = file.tell() + packed
        # pyarrow cuts longer numbers off, and would so find other sizes, and other pages behind.
        if not (0 <= unpacked < 2**31 and 0 <= packed < 2**31 and at <= end):
            raise ValueError("a page has an impossible size")
        total += unpacked
    return total


def _struct(file: BinaryIO) -> dict[int, int]:
    """Read integers by the number of their field; other values are 0."""
    fields: dict[int, int] = {}
    name = 0
    while kind := file.read(1)[0]:
        name = name + (kind >> 4) if kind >> 4 else _signed(_varint(file))
        if name in fields or not 0 < name < 2**15:  # pyarrow takes the last one, and cuts longer numbers off.
            raise ValueError("the header of a page has a field twice, or one of an impossible number")
        fields[name] = _value(file, kind & 15)
    return fields


def _value(file: BinaryIO, kind: int) -> int:
    if kind in _INTEGERS:
        return _signed(_varint(file))
    if kind == _STRUCT:
        _struct(file)
    elif kind in (_BYTE, _DOUBLE, _BINARY):
        file.seek({_BYTE: 1, _DOUBLE: 8}.get(kind) or _varint(file), 1)
    elif kind not in _BOOLEANS:
        raise ValueError("the header of a page has a field of an unknown type")
    return 0


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
