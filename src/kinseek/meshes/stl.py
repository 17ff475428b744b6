"""STL files: triangles in bytes or in text."""

from __future__ import annotations

import re
from array import array
from collections.abc import Callable

import numpy as np

from kinseek.errors import InvalidRobot

from .limits import MOST_LINES, Size, at_most, utf8
from .polygons import Body

NUMBER = rb"[+-]?(?:[0-9]++\.?[0-9]*+|\.[0-9]++)(?:[eE][+-]?[0-9]++)?"
"""A finite number in text. Digits are matched once (``++``): dividing n of them again and again takes n² steps."""

_VERTEX = rb"vertex\s+(%s\s+%s\s+%s)\s+" % ((NUMBER,) * 3)
_FACET = re.compile(
    rb"facet\s+normal\s+\S+\s+\S+\s+\S+\s+outer\s+loop\s+" + 3 * _VERTEX + rb"endloop\s+endfacet(?!\S)\s*",
    re.I,
)
_SOLID, _END = (
    re.compile(rb"\s*%s(?:[ \t](?![^\n]*endfacet)[^\n]*)?(?:\n|$)\s*" % word, re.I)
    for word in (b"solid", b"endsolid")
)
"""Each with a name up to the end of the line. A facet in that line would be lost with the name."""
_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def read(text: bytes, take: Callable[[Size], None]) -> list[Body]:
    """Read the triangles of all solids; normals are ignored.

    A file with the length that it declares is binary.

    Raises:
        InvalidRobot: The file is neither binary nor text STL, or too large.

    Source: M. Burns, "Automated Fabrication" (1993), section 6.5.
    """
    declared = int.from_bytes(text[80:84], "little")
    if len(text) == 84 + _TRIANGLE.itemsize * declared:
        take(Size(1, 0))
        corners = np.frombuffer(text, _TRIANGLE, offset=84)["corners"].reshape(-1, 3).astype(np.float64)
    elif b"\0" not in text and re.match(rb"\s*solid\b", utf8(text), re.I):
        corners = np.frombuffer(
            _text(utf8(text).replace(b"\r\n", b"\n").replace(b"\r", b"\n"), take)
        ).reshape(-1, 3)
    else:
        raise InvalidRobot(
            f"it begins with {text[:5]!r} and has {len(text):,} bytes, expected text that begins with 'solid' or, for the "
            f"{declared:,} triangles that it declares, {84 + _TRIANGLE.itemsize * declared:,} bytes"
        )
    return [Body(corners, np.arange(len(corners)).reshape(-1, 3))]


def _text(text: bytes, take: Callable[[Size], None]) -> array[float]:
    """Return the coordinates of all corners."""
    lower = text.lower()
    lines = sum(map(lower.count, (b"vertex", b"normal", b"solid")))
    at_most(lines, MOST_LINES, "vertices, normals and solids")
    take(Size(1, lines))
    corners, at = array("d"), 0
    while at < len(text):
        at = _after(_SOLID, text, at, "solid")
        while facet := _FACET.match(text, at):
            corners.extend(map(float, b" ".join(facet.groups()).split()))
            at = facet.end()
        at = _after(
            _END,
            text,
            at,
            "endsolid, or a facet of a normal and an outer loop of three vertices, each with three numbers",
        )
    return corners


def _after(pattern: re.Pattern[bytes], text: bytes, at: int, expected: str) -> int:
    found = pattern.match(text, at)
    if found is None:
        line = text.count(b"\n", 0, at) + 1
        raise InvalidRobot(
            f"line {line}: it has {text[at : at + 100].decode(errors='replace')!r}, expected {expected}"
        )
    return found.end()
