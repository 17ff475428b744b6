"""PLY files: a header that declares elements, and their rows in text or bytes."""

from __future__ import annotations

import io
import re
from array import array
from collections import defaultdict
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinseek.errors import InvalidRobot

from .limits import MOST_LINE, MOST_LINES, Size, at_most, require_line_ends
from .polygons import Body, Indices, triangulated

MOST_HEADER = 1_000
"""Most lines in the header."""
MOST_PROPERTIES = 256
"""Most properties in the header."""
MOST_VALUES = 3 * 2**22
"""Most values of text, rows times properties, and most numbers in its rows."""

MOST_ROWS = 3 * 2**25
"""Most rows of all elements, and half of the corners of all faces: those of a file of 1 GiB with floats and triangles. A row
takes as much memory if it is one byte."""

_TYPES = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
    **{"int64": "i8", "uint64": "u8", "float16": "f2"},
}
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
"""Formats, with the order of their bytes as in NumPy; empty for text."""
_CORNERS = ("vertex_index", "vertex_indices")
"""Names of the list of a face."""
_TRIANGLES = ("tristrips", "trifans")
"""Elements with triangles that are not read."""


class _Property(NamedTuple):
    kind: str
    """Type of its numbers, as in NumPy, without the order of bytes."""
    length: str
    """Type of the length of a list; empty for one number."""


class _Element(NamedTuple):
    rows: int
    properties: dict[str, _Property]


def read(text: bytes, take: Callable[[Size], None]) -> list[Body]:
    """Read the polygons of the element ``face``; elements that have no polygons are skipped.

    Raises:
        InvalidRobot: The header or the rows are not as the format describes, or the file is too large.

    Source: G. Turk, "The PLY Polygon File Format" (1994).
    """
    order, elements, begin = _header(text)
    require_line_ends(text[:begin] if order else text)
    corners = _require_polygons(elements)
    at_most(sum(element.rows for element in elements.values()), MOST_ROWS, "rows")
    rows = _Rows(text, begin, order)
    if order:
        take(Size(1, 0))
    else:
        lines = text.count(b"\n") + 1
        at_most(lines, MOST_LINES, "lines")
        values = sum(element.rows * len(element.properties) for element in elements.values())
        at_most(values, MOST_VALUES, "values")
        take(Size(1, max(values, lines)))
        rows = _Rows.of_text(text, begin)
    found = {name: rows.next(name, element) for name, element in elements.items()}
    if text[rows.begin :].strip() if order else rows.begin < len(rows.content):
        raise InvalidRobot(f"it has more rows than its header declares, after {rows.place()}")
    vertex, face = found["vertex"], found["face"]
    kinds = {axis: elements["vertex"].properties[axis].kind for axis in "xyz"}
    whole = {axis: _whole(vertex[axis], kind) for axis, kind in kinds.items() if kind[0] != "f"}
    vertices = np.stack([(vertex | whole)[axis].astype(np.float64) for axis in "xyz"], axis=1)
    kind, length = elements["face"].properties[corners]
    at_most(len(face[corners]), 2 * MOST_ROWS, "corners of polygons")
    lists = _whole(face[f"{corners} length"], length), _whole(face[corners], kind)
    sizes, indices = (each.astype(np.int64) for each in lists)
    triangles, owners = triangulated(vertices, indices, sizes, lambda row: f"face {row + 1:,}", take)
    colours = _colours(face, elements["face"])
    return [
        Body(
            vertices,
            indices[triangles],
            _colours(vertex, elements["vertex"]),
            None if colours is None else colours[owners],
        )
    ]


def _header(text: bytes) -> tuple[str, dict[str, _Element], int]:
    """Return the order of bytes, the elements, and where the header ends."""
    file, order, elements, properties = io.BytesIO(text), None, dict[str, _Element](), 0
    for number in range(1, MOST_HEADER + 1):
        line = file.readline(MOST_LINE + 1)
        at_most(len(line), MOST_LINE, "bytes in a line of its header")
        match [word.decode(errors="replace") for word in line.split()]:
            case ["ply"] if number == 1:
                pass
            case ["comment" | "obj_info", *_] if number > 1:
                pass
            case ["format", name, "1.0"] if number > 1 and order is None and name in _ORDERS:
                order = _ORDERS[name]
            case ["element", name, rows] if order is not None and re.fullmatch("[0-9]{1,18}", rows):
                if name in elements:
                    raise InvalidRobot(f"it has two elements {name!r:.100}, expected one; write them as one")
                elements[name] = _Element(int(rows), {})
            case ["property", *kinds, name] if elements and _is_type(kinds):
                last = [*elements][-1]
                if name in elements[last].properties:
                    raise InvalidRobot(
                        f"its element {last!r:.100} has two properties {name!r:.100}, expected one"
                    )
                properties += 1
                at_most(properties, MOST_PROPERTIES, "properties in its header")
                elements[last].properties[name] = _Property(
                    _TYPES[kinds[-1]], _TYPES[kinds[1]] if kinds[1:] else ""
                )
            case ["end_header"] if order is not None:
                return order, elements, file.tell()
            case _ if line:
                raise InvalidRobot(
                    f"line {number} of its header is {line.decode(errors='replace').strip()!r:.100}, expected ply, a "
                    "format, then elements with a count, properties of a known type, and end_header"
                )
    raise InvalidRobot(f"its header must end with end_header, within {MOST_HEADER:,} lines")


def _is_type(kinds: list[str]) -> bool:
    """Return whether these words are the type of one number, or of a list."""
    if len(kinds) == 3 and kinds[0] == "list":
        return kinds[2] in _TYPES and _TYPES.get(kinds[1], "f")[0] != "f"
    return len(kinds) == 1 and kinds[0] in _TYPES


def _require_polygons(elements: Mapping[str, _Element]) -> str:
    """Check that there are vertices and polygons, and return the name of the list of a polygon."""
    for name, element in elements.items():
        if name in _TRIANGLES:
            raise InvalidRobot(f"it has {name}, expected the element face; write each triangle as a face")
        if element.rows and not element.properties:
            raise InvalidRobot(f"its element {name!r:.100} has rows without properties")
    if not {"vertex", "face"} <= elements.keys():
        raise InvalidRobot(
            f"it has the elements {[*elements]!r:.100}, expected vertex and face: it holds no triangles"
        )
    vertex, face = elements["vertex"].properties, elements["face"].properties
    if any(each.length for each in vertex.values()):
        raise InvalidRobot("its vertices have lists; remove them")
    if missing := [axis for axis in "xyz" if axis not in vertex]:
        raise InvalidRobot(f"its vertices have no {', '.join(missing)}, expected x, y and z")
    named = [name for name in _CORNERS if name in face]
    if len(named) != 1 or not face[named[0]].length or face[named[0]].kind[0] == "f":
        raise InvalidRobot(
            "its faces must have one list of corners, vertex_index or vertex_indices, of whole numbers"
        )
    return named[0]


@dataclass
class _Rows:
    """The rows of all elements."""

    content: bytes
    begin: int
    """Where the next row begins."""
    order: str
    """Order of bytes; empty for text, of which each number takes 8 bytes."""
    lines: list[int] = field(default_factory=list)
    """Where each line of text ends, from the next row on."""
    walked: int = 0
    """Values of all elements so far that have lists of different lengths."""

    @classmethod
    def of_text(cls, text: bytes, begin: int) -> _Rows:
        """Read the numbers of all lines; blank lines are skipped."""
        numbers, ends = array("d"), list[int]()
        for line in text[begin:].split(b"\n"):
            at_most(len(line), MOST_LINE, "bytes in a row")
            if words := line.split():
                try:
                    if b"_" in line:  # Python alone would read 1_000.
                        raise ValueError
                    numbers.extend(map(float, words))
                except ValueError:
                    raise InvalidRobot(
                        f"row {len(ends) + 1:,} is {line.decode(errors='replace')!r:.100}, expected numbers"
                    ) from None
                at_most(len(numbers), MOST_VALUES, "numbers in its rows")
                ends.append(8 * len(numbers))
        return cls(numbers.tobytes(), 0, "", ends)

    def place(self) -> str:
        return f"byte {self.begin:,}" if self.order else f"number {self.begin // 8:,} of its rows"

    def next(self, name: str, element: _Element) -> dict[str, NDArray[Any]]:
        """Return the columns of the next element, where a list has all its numbers in a row, and a column of lengths."""
        if not element.rows:
            return {column: np.zeros(0) for each in element.properties for column in (each, f"{each} length")}
        fields, at = list[tuple[str, str, int]](), self.begin
        for column, (kind, length) in element.properties.items():
            size = 1
            if length:
                fields.append((f"{column} length", self._kind(length), 1))
                size = self._length(self._kind(length), at, name)
                at += np.dtype(self._kind(length)).itemsize
            fields.append((column, self._kind(kind), size))
            at += size * np.dtype(self._kind(kind)).itemsize
        row = at - self.begin
        whole = min(element.rows, (len(self.content) - self.begin) // row)
        table = np.frombuffer(self.content, np.dtype([(n, k, (s,)) for n, k, s in fields]), whole, self.begin)
        lengths = [table[column] for column, *_ in fields if column.endswith(" length")]
        if whole == element.rows and all((each == each[0]).all() for each in lengths):
            columns = {column: table[column].ravel() for column, *_ in fields}
            # Those of bytes need no lines.
            ends = self.begin + row * np.arange(element.rows if self.order else 1, element.rows + 1)
        elif lengths:
            columns, ends = self._walked(name, element)
        else:
            raise self._missing(name)
        if not self.order:
            lines = np.array(self.lines[: element.rows])
            del self.lines[: element.rows]
            lines = np.pad(
                lines, (0, element.rows - len(lines))
            )  # Rows of one line leave fewer lines than rows.
            if len(wrong := np.flatnonzero(ends != lines)):
                raise InvalidRobot(
                    f"row {wrong[0] + 1:,} of its element {name!r:.100} does not have the numbers of one line: expected as "
                    "many as its properties and the lengths of its lists say"
                )
        self.begin = int(ends[-1])
        return columns

    def _walked(self, name: str, element: _Element) -> tuple[dict[str, NDArray[Any]], Indices]:
        """Return the columns of an element with lists of different lengths, and where its rows end."""
        self.walked += element.rows * len(element.properties)
        at_most(self.walked, MOST_LINES, "values and lists in rows of different lengths")
        parts = defaultdict[str, list[bytes]](list)
        kinds = {
            column: self._kind(kind)
            for each, (own, length) in element.properties.items()
            for column, kind in ([(f"{each} length", length)] if length else []) + [(each, own)]
        }
        steps = [
            (parts[column].append, column.endswith(" length"), np.dtype(kind).itemsize, kind)
            for column, kind in kinds.items()
        ]
        content, at, size, ends = self.content, self.begin, 1, list[int]()
        known = dict[tuple[str, bytes], int]()
        for _ in range(element.rows):
            for append, is_length, bytes_of, kind in steps:
                end = at + size * bytes_of
                part = content[at:end]
                append(part)
                size = 1
                if is_length:
                    if (kind, part) not in known:
                        known[kind, part] = self._length(kind, at, name)
                    size = known[kind, part]
                at = end
            if at > len(content):
                raise self._missing(name)
            ends.append(at)
        columns = {column: np.frombuffer(b"".join(each), kinds[column]) for column, each in parts.items()}
        return columns, np.array(ends)

    def _kind(self, kind: str) -> str:
        return self.order + kind if self.order else "=f8"

    def _length(self, kind: str, at: int, name: str) -> int:
        """Return the length of a list."""
        if at + np.dtype(kind).itemsize > len(self.content):
            raise self._missing(name)
        length = np.frombuffer(self.content, kind, 1, at)[0]
        if not 0 <= length <= len(self.content) or length % 1:
            raise InvalidRobot(
                f"its element {name!r:.100} has a list of {length} numbers, expected a whole number in the file"
            )
        return int(length)

    def _missing(self, name: str) -> InvalidRobot:
        return InvalidRobot(f"it ends in the element {name!r:.100}: rows or numbers are missing")


def _whole(values: NDArray[Any], kind: str) -> NDArray[Any]:
    """Check that numbers, which may be of text, are whole and of the declared type."""
    with np.errstate(invalid="ignore"):
        whole = values.astype(kind)
    if len(wrong := np.flatnonzero(whole != values)):
        raise InvalidRobot(
            f"a vertex or a list of a face has the number {values[wrong[0]]}, expected a whole one of type {np.dtype(kind)}"
        )
    return whole


def _colours(columns: Mapping[str, NDArray[Any]], element: _Element) -> NDArray[Any] | None:
    """Return the colours of rows, (n, 3) or (n, 4), in the range of their type."""
    names = [name for name in ("red", "green", "blue", "alpha") if name in columns]
    if len(names) < 3 or any(element.properties[name].length for name in names):
        return None
    with np.errstate(invalid="ignore"):
        return np.stack([columns[name].astype(element.properties[name].kind) for name in names], axis=1)
