"""GLB files: a container of JSON and bytes, and the numbers in them.

Source: *glTF 2.0 Specification*, Khronos Group (2021), to whose sections the numbers refer.
"""

from __future__ import annotations

import json
import re
import reprlib
import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinseek.errors import InvalidRobot

from .limits import at_most

Json = dict[str, Any]
Numbers = NDArray[Any]

MOST_JSON = 2**22
"""Most bytes of the description at the beginning of a file."""
MOST_CHUNKS = 1_000
"""Most chunks of a file; all but two are ignored."""

_MAGIC, _JSON, _BINARY = 0x46546C67, 0x4E4F534A, 0x004E4942
"""The first number of a file, and the kinds of its two chunks."""
_KINDS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
"""Numbers of accessors by their component type."""
_COLUMNS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
"""Numbers of an element by its type; matrices are not needed."""
_MOST_STRIDE = 252
"""Most bytes from an element to the next."""


class GlbFile:
    """The description of a file, and its buffer of numbers and images."""

    def __init__(self, text: bytes) -> None:
        """Divide a file.

        Raises:
            InvalidRobot: It is not GLB of version 2, or its JSON cannot be read.
        """
        description, self._content = _chunks(text)
        self.document = _parsed(description)
        asset = entry(self.document, "asset")
        version, least = asset.get("version"), asset.get("minVersion", "2.0")
        # A later version may have parts that a reader of 2.0 may ignore, if the least version says so (3.2).
        if not isinstance(version, str) or not re.fullmatch(r"2\.[0-9]+", version) or least != "2.0":
            raise InvalidRobot(
                f"it is glTF of version {version!r:.100}, for readers from {least!r:.100} on; expected 2.0"
            )

    def element(self, name: str, index: int) -> Json:
        """Return an element of a list of the description."""
        found = listed(self.document, name)
        if index >= len(found):
            raise InvalidRobot(f"it refers to element {index} of {name!r}, of which it has {len(found)}")
        return _object(found[index], f"element {index} of {name!r}")

    def view(self, view: Json) -> memoryview:
        """Return the bytes of a view (3.6.1)."""
        _require_no_extension(view, "bufferViews")
        buffer = self.element("buffers", 0)
        if whole(view, "buffer") != 0 or "uri" in buffer:
            raise InvalidRobot(
                "parts of it are in other files or buffers; write it as one file with one buffer"
            )
        _require_no_extension(buffer, "buffers")
        size, begin, length = (
            whole(buffer, "byteLength"),
            whole(view, "byteOffset", 0),
            whole(view, "byteLength"),
        )
        if size > len(self._content) or begin + length > size:
            raise InvalidRobot(
                f"a view has the bytes from {begin:,} to {begin + length:,} of {size:,} bytes, of which "
                f"{len(self._content):,} are in the binary chunk"
            )
        return self._content[begin : begin + length]

    def numbers(self, accessor: Json, tight: bool = False) -> Numbers:
        """Return the numbers of an accessor as they lie in the file, (n, columns) (3.6.2).

        Args:
            accessor: Its description.
            tight: May no other bytes lie between its elements?
        """
        _require_no_extension(accessor, "accessors")
        if "sparse" in accessor:
            raise InvalidRobot("its accessors are sparse, expected all their values; write them as a whole")
        told = accessor.get("type")
        kind = _KINDS.get(whole(accessor, "componentType"))
        columns = _COLUMNS.get(told) if isinstance(told, str) else None
        if kind is None or columns is None:
            raise InvalidRobot(
                f"an accessor has the type {brief(told)} of component type {accessor['componentType']}, "
                f"expected one of {', '.join(_COLUMNS)} of one of {', '.join(map(str, _KINDS))}"
            )
        view = self.element("bufferViews", whole(accessor, "bufferView"))
        content, each = self.view(view), np.dtype(kind).itemsize
        size, count, begin = each * columns, whole(accessor, "count"), whole(accessor, "byteOffset", 0)
        stride = whole(view, "byteStride", size)
        # Readers differ on elements that overlap, and on spaces between indices.
        if not size <= stride <= (size if tight else _MOST_STRIDE):
            raise InvalidRobot(
                f"a view has a byteStride of {stride}, expected {size}{'' if tight else f' to {_MOST_STRIDE}'}"
            )
        if any(place % each for place in (begin, begin + whole(view, "byteOffset", 0), stride)):  # 3.6.2.4
            raise InvalidRobot(
                f"an accessor is at byte {begin:,} of a view with a byteStride of {stride}, expected multiples of {each}, "
                "the bytes of its numbers"
            )
        if count < 1 or begin + stride * (count - 1) + size > len(content):
            raise InvalidRobot(
                f"an accessor has {count:,} elements of {size} bytes with a stride of {stride}, from byte {begin:,} on of "
                f"{len(content):,} bytes of a view; expected at least one, and all in the view"
            )
        return np.ndarray((count, columns), kind, content, begin, (stride, each))


class _Brief(reprlib.Repr):
    """Writes the beginning of a value only: many parts of a file may name one that fills it."""

    def __init__(self) -> None:
        """Set how much is written."""
        super().__init__()
        self.maxlevel, self.maxlist, self.maxstring = 2, 10, 100

    def repr_dict(self, x: Json, level: int) -> str:
        """Write an object."""
        return "{...}" if x else "{}"


brief = _Brief().repr


def whole(owner: Json, name: str, default: int | None = None) -> int:
    """Return a count or an index; Python would count negative ones from the end, and true as 1."""
    value = owner.get(name, default)
    if isinstance(value, bool) or not isinstance(value, int) or value < 0:
        raise InvalidRobot(f"{name!r} is {brief(value)}, expected a whole number from 0 on")
    return value


def listed(owner: Json, name: str) -> list[Any]:
    """Return a list of an object; an empty one if it has none."""
    value = owner.get(name, [])
    if not isinstance(value, list):
        raise InvalidRobot(f"{name!r} is {brief(value)}, expected a list")
    return value


def entry(owner: Json, name: str) -> Json:
    """Return an object of an object; an empty one if it has none."""
    return _object(owner.get(name, {}), repr(name))


def _object(value: Any, who: str) -> Json:
    if not isinstance(value, dict):
        raise InvalidRobot(f"{who} is {brief(value)}, expected an object")
    return value


def _require_no_extension(element: Json, name: str) -> None:
    """Refuse extensions of numbers: they hold other numbers, such as compressed ones, than those without them."""
    if extensions := entry(element, "extensions"):
        raise InvalidRobot(
            f"one of its {name!r} has the extension {brief(next(iter(extensions)))}, expected none; write it without"
        )


def _chunks(text: bytes) -> tuple[bytes, memoryview]:
    """Return the JSON, and the binary chunk after it; chunks of other kinds may follow, and are ignored (4.4)."""
    if len(text) < 20 or struct.unpack_from("<III", text) != (_MAGIC, 2, len(text)):
        raise InvalidRobot(
            f"it begins with {text[:12]!r}, expected 'glTF', version 2 and a length of {len(text):,} bytes"
        )
    found, at, number = {_JSON: memoryview(b""), _BINARY: memoryview(b"")}, 12, 0
    while at < len(text):
        at_most(number + 1, MOST_CHUNKS, "chunks")
        size, kind = struct.unpack_from("<II", text, at) if at + 8 <= len(text) else (len(text), 0)
        end = at + 8 + size
        if end > len(text):
            raise InvalidRobot(f"its chunk at byte {at:,} goes beyond its {len(text):,} bytes")
        place = {_JSON: 0, _BINARY: 1}.get(kind, number)
        if place != number or (number == 0 and kind != _JSON):
            raise InvalidRobot(
                f"its chunk {number + 1} is of the kind {kind:#x}, expected JSON first, and one binary chunk only, after it"
            )
        if kind in found:
            found[kind] = memoryview(text)[at + 8 : end]
        at, number = end, number + 1
    at_most(len(found[_JSON]), MOST_JSON, "bytes of JSON")
    return bytes(found[_JSON]), found[_BINARY]


def _parsed(text: bytes) -> Json:
    """Return the description (4.4.3.2)."""

    def refuse(constant: str) -> None:
        raise InvalidRobot(f"it has {constant}, expected finite numbers")

    try:
        found = json.loads(text.decode(), object_pairs_hook=_once, parse_constant=refuse)
    except (ValueError, RecursionError) as error:
        raise InvalidRobot(f"its JSON cannot be read: {error}") from None
    return _object(found, "its JSON")


def _once(pairs: list[tuple[str, Any]]) -> Json:
    """Return an object of JSON; readers differ on a name that it has twice: some use the first value, some the last one."""
    found = dict(pairs)
    if len(found) < len(pairs):
        raise InvalidRobot("an object has a name twice; readers differ on its value")
    return found
