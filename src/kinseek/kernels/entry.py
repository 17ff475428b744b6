"""Entries: the kernels that may be called from outside, declared by their annotations with element types and shapes.

The annotation defines the compiled function, the symbol in a prebuilt library, the argument checks of that library, and
a C header. Machine code does not check its arguments: it would read beyond the end of memory with another shape. All
arguments are therefore checked.
"""

from __future__ import annotations

import functools
import inspect
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, get_args, get_type_hints

import numpy as np

from .sources import is_source, room_of


@dataclass(frozen=True)
class Dimension:
    """Length of an array along one dimension: a number, or a name that means the same number throughout a call, plus one."""

    name: str = ""
    plus: int = 0

    @classmethod
    def read(cls, value: int | str) -> Dimension:
        """Read ``4``, ``"n"``, ``"m+1"``, or ``"*"`` for any length.

        Raises:
            TypeError: Anything else.
        """
        if isinstance(value, int):
            return cls("", value)
        found = re.fullmatch(r"([a-z_]+|\*)(?:\+(\d+))?", value)
        if found is None:
            raise TypeError(f"a dimension is a number, a name, a name plus a number or '*', got {value!r}")
        return cls(found[1], int(found[2] or 0))

    def __str__(self) -> str:
        """The text from which it was read."""
        return f"{self.name}+{self.plus}" if self.name and self.plus else self.name or str(self.plus)


@dataclass(frozen=True)
class Leaf:
    """A number, or a C-contiguous array of them."""

    element: str
    """``"f"`` for a float, ``"i"`` for a 64-bit integer, ``"b"`` for a boolean."""
    shape: tuple[Dimension, ...] = ()
    written: bool = False
    """True if the kernel writes into it."""

    def words(self, known: Mapping[str, int]) -> str:
        """Description for messages, with the lengths that are already known."""
        if not self.shape:
            return _NAMES[self.element][0]
        lengths = [str(known[d.name] + d.plus) if d.name in known else str(d) for d in self.shape]
        kind = "writable, C-contiguous" if self.written else "C-contiguous"
        return f"a {kind} array of {_NAMES[self.element][1]} of shape ({', '.join(lengths)}{',' * (len(lengths) == 1)})"

    def fits(self, value: Any, known: dict[str, int]) -> bool:
        """Return True if a value is such an array; named lengths become known."""
        if (
            not isinstance(value, np.ndarray)
            or value.dtype != _NAMES[self.element][1]
            or value.ndim != len(self.shape)
        ):
            return False
        if not value.flags.c_contiguous or (self.written and not value.flags.writeable):
            return False
        for length, dimension in zip(value.shape, self.shape, strict=True):
            if dimension.name != "*":
                free = known.setdefault(dimension.name, length - dimension.plus) if dimension.name else 0
                # `free` is negative if an array of length n + 1 is empty.
                if length != free + dimension.plus or free < 0:
                    return False
        return True


_NAMES = {"f": ("a number", "float64"), "i": ("a whole number", "int64"), "b": ("True or False", "bool")}


class Out:
    """Marks an annotation of memory that a kernel writes into."""


OUT = Out()


class Bundle:
    """A named tuple of numbers, arrays and bundles, declared by its annotations."""

    def __init__(self, made_of: Any) -> None:
        """Read the annotations of the fields, see `declared`.

        Raises:
            TypeError: A field is neither a number nor a named tuple nor an array with a shape.
        """
        self.made_of = made_of
        self.fields: dict[str, Leaf | Bundle] = {
            name: declared(hint, f"{made_of.__name__}.{name}") for name, hint in _hints(made_of).items()
        }


def declared(hint: Any, name: str) -> Leaf | Bundle:
    """Read an annotation.

    Args:
        hint: `int`, `float` or `bool` for a number; a named tuple; or an array with its shape and, if the kernel writes into
            it, `OUT`: ``Annotated[Array, "k", 3, "n+1", OUT]``. See `Dimension` for the lengths.
        name: Name of what has the annotation, for messages.

    Raises:
        TypeError: It is none of these.
    """
    if hint in _NUMBERS:
        return Leaf(_NUMBERS[hint])
    if hasattr(hint, "_fields"):
        return bundle_of(hint)
    marks, array = getattr(hint, "__metadata__", ()), get_args(getattr(hint, "__origin__", None))
    if not marks or len(array) != 2:
        raise TypeError(f"{name} needs a number, a named tuple or Annotated[Array, shape ...], got {hint}")
    lengths = tuple(Dimension.read(each) for each in marks if each is not OUT)
    return Leaf(_ELEMENTS[get_args(array[1])[0]], lengths, OUT in marks)


_NUMBERS = {float: "f", int: "i", bool: "b"}
_ELEMENTS = {np.float64: "f", np.int64: "i", np.bool_: "b"}


@functools.cache
def bundle_of(made_of: Any) -> Bundle:
    """The declaration of a named tuple."""
    return Bundle(made_of)


def _hints(thing: Any) -> dict[str, Any]:
    return get_type_hints(thing, include_extras=True)


@dataclass(frozen=True)
class Entry:
    """A kernel that Python calls."""

    function: Callable[..., Any]
    takes: dict[str, Leaf | Bundle]
    returns: tuple[Leaf, ...]
    exact: bool

    @property
    def name(self) -> str:
        """Name of the symbol."""
        return f"ks_{self.function.__name__}"

    @property
    def room(self) -> str:
        """Folder of its module."""
        return room_of(self.function.__module__)

    def leaves(self) -> Iterator[tuple[str, Leaf]]:
        """All numbers and arrays in the order in which they are passed, with bundles flattened."""
        for name, one in self.takes.items():
            yield from _leaves(name, one)


def _leaves(path: str, one: Leaf | Bundle) -> Iterator[tuple[str, Leaf]]:
    if isinstance(one, Leaf):
        yield path, one
        return
    for name, field in one.fields.items():
        yield from _leaves(f"{path}.{name}", field)


ENTRIES: dict[str, Entry] = {}
"""All entries of the imported modules."""


def parameters(function: Callable[..., Any]) -> dict[str, Leaf | Bundle]:
    """Parameters of a kernel, declared by their annotations, see `declared`.

    Raises:
        TypeError: An annotation is missing or unsuitable.
    """
    hints = _hints(function)
    return {name: declared(hints.get(name), name) for name in inspect.signature(function).parameters}


def declare(function: Callable[..., Any], exact: bool = False) -> Entry:
    """Register an entry. Its parameters are declared by their annotations, see `declared`; it returns numbers.

    Raises:
        TypeError: An annotation is missing or unsuitable, another entry has its name, or its file does not count as a
            source of kernels: a library without it would then pass for current.
    """
    module = function.__module__
    if module.startswith("kinseek.") and not is_source(module):
        raise TypeError(f"{module} has kernels: add its file to ELSEWHERE in kinseek/kernels/sources.py")
    takes, result = parameters(function), _hints(function).get("return")
    numbers = get_args(result) or (() if result in (None, type(None)) else (result,))
    returns = tuple(Leaf(_NUMBERS[each]) for each in numbers)
    made = Entry(function, takes, returns, exact)
    if made.name in ENTRIES and (other := ENTRIES[made.name].function.__module__) != module:
        raise TypeError(f"two entries are called {made.name}, in {other} and in {module}")
    ENTRIES[made.name] = made
    return made
