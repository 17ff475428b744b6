"""Records: named tuples of numbers in consecutive entries of a flat array.

An array reaches a kernel as one address, and is there read as a value whose fields have names. One declaration gives the
length of the array, the function that reads it, and the entries that Python writes.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from typing import Any, get_type_hints

import numpy as np
from numpy.typing import NDArray

from kinseek.kernels.jit import inlined


class Record:
    """The entries of a named tuple whose fields are numbers, all of one type, or such named tuples."""

    def __init__(self, bundle: Any) -> None:
        """Declare the entries in the order of the annotated fields."""
        # Machine code is stored under the module of the declaration, on which it depends.
        self._scope: dict[str, Any] = {"__name__": bundle.__module__}
        self.first: dict[str, int] = {}
        """First entry of each field."""
        self.size = 0
        """Number of entries."""
        name = f"read_{bundle.__name__.lower()}"
        source = f"def {name}(numbers):\n    return {self._reader(bundle, self.first)}\n"
        exec(compile(source, str(sys.modules[bundle.__module__].__file__), "exec"), self._scope)
        self.value: Any = self._scope[name]
        """From an array to the named tuple, in Python."""
        self.read: Any = inlined(self.value)
        """The same as a kernel."""

    def _reader(self, kind: Any, first: dict[str, int]) -> str:
        """An expression for a field, from the next entry on; `first` receives the first entries of its own fields."""
        if kind in (int, float):
            self.size += 1
            return f"numbers[{self.size - 1}]"
        self._scope[kind.__name__], fields = kind, []
        for name, hint in get_type_hints(kind).items():
            first[name] = self.size
            fields.append(self._reader(hint, {}))
        return f"{kind.__name__}({', '.join(fields)})"

    def numbers(self, value: Any, dtype: type = float) -> NDArray[Any]:
        """The entries of a named tuple, (size,)."""
        return np.array(list(_entries(value)), dtype=dtype)


def _entries(value: Any) -> Iterator[float]:
    if isinstance(value, tuple):
        for each in value:
            yield from _entries(each)
    else:
        yield value
