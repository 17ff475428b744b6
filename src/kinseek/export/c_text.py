"""Formatting of constants in C."""

from __future__ import annotations

import math
from string import ascii_letters, digits
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinseek.errors import InvalidExport

_PLAIN = f"{ascii_letters}{digits} _.,:+-()"
_ELEMENTS = {"f": "double", "i": "int64_t", "b": "bool"}


def array(name: str, values: NDArray[Any], infinite: bool = False) -> str:
    """Format an array of constants in C, every number exactly; see `number`."""
    flat = np.ravel(values)
    floats = flat.dtype.kind == "f"
    words = ", ".join(number(each, infinite) if floats else str(int(each)) for each in flat.tolist())
    shape = f"  /* {values.shape} */" if values.ndim > 1 else ""
    return f"static const {_ELEMENTS[flat.dtype.kind]} {name}[] = {{{words}}};{shape}"


def number(value: float, infinite: bool = False) -> str:
    """Format a number exactly; an infinite one, if that is allowed, by its name in math.h.

    Raises:
        InvalidExport: It is not finite.
    """
    if infinite and math.isinf(value):
        return "INFINITY" if value > 0.0 else "-INFINITY"
    if not math.isfinite(value):
        raise InvalidExport(f"a constant of the arm or search is {value}")
    return value.hex()


def string(text: str) -> str:
    """Format a string in C, also safe in a comment: every character but plain letters becomes octal UTF-8 bytes."""
    plain = "".join(
        chr(byte) if chr(byte) in _PLAIN else f"\\{byte:03o}" for byte in text.encode("utf-8", "replace")
    )
    return f'"{plain}"'


def structure(kind: str, name: str, fields: dict[str, str]) -> str:
    """Format a constant structure."""
    lines = [f"    .{field} = {value}," for field, value in fields.items()]
    return "\n".join([f"static const {kind} {name} = {{", *lines, "};"])


def defined(guard: str, values: dict[str, object]) -> str:
    """Format a header with named numbers."""
    return guarded(guard, [f"#define KINSEEK_{name} {value}" for name, value in values.items()])


def guarded(guard: str, lines: list[str]) -> str:
    """Format a header with an include guard."""
    return "\n".join([f"#ifndef {guard}", f"#define {guard}", "", *lines, "", "#endif", ""])
