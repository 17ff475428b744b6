"""Choose how the kernels of this process run: from the library built with the package, or compiled by Numba.

`KINSEEK_JIT=1` compiles them. `KINSEEK_LEVEL` chooses among the processor levels that a library contains.
`NUMBA_DISABLE_JIT=1` runs them as plain Python, for tests (`python_backend`).
"""

from __future__ import annotations

import functools
import os
import sys
from collections.abc import Callable
from importlib.util import find_spec
from typing import Any

from kinseek.errors import InvalidUse
from kinseek.support.forks import Lock

from .entry import Bundle, Entry, Leaf
from .sources import ALL, source_digest

_FLOAT, _INTEGER, _FLAG, _ARRAY, _BUNDLE = range(5)  # As native/door.c reads them.
_OF = {"f": _FLOAT, "i": _INTEGER, "b": _FLAG}
_ANY_LENGTH = -2


class Library:
    """The machine code that was built with the package, for one level of processors.

    An editable install contains the kernels of `Arm.fk` and `Arm.ik`. The first call of a kernel from another folder
    compiles that folder, and the process then uses the larger library.
    """

    def __init__(self, door: Any, level: int, refused: str = "") -> None:
        """Use the extension module that contains it.

        Args:
            door: The module.
            level: The level of processors.
            refused: Why no kernel may be called; empty if they may.
        """
        self._door, self.level, self._refused = door, level, refused
        self._growing = Lock()

    def require_level(self) -> None:
        """Check that the library has the level that was chosen: its first use raises, not the import of kinseek.

        Raises:
            InvalidUse: It has not.
        """
        if self._refused:
            raise InvalidUse(self._refused)

    @property
    def rooms(self) -> list[str]:
        """Folders of kernels that it contains; `["all"]` if none is missing."""
        words: str = self._door.rooms
        return words.split()

    def caller(self, entry: Entry) -> Callable[..., Any]:
        """Return the callable of an entry, which raises TypeError if an argument does not fit the declaration.

        Raises:
            ImportError: The library does not contain it.
        """
        # A refusal is raised by the first call, so that kinseek can be imported.
        if self._refused or not self._has(entry.room):
            return self._compiled_when_called(entry)
        results = _bytes([_OF[leaf.element] for leaf in entry.returns])
        explain = _Explanation(entry)
        try:
            made: Callable[..., Any] = self._door.entry(
                entry.name, self.level, len(entry.takes), _program(entry), results, explain
            )
        except LookupError as error:
            raise ImportError(f"the library of kernels does not fit the package: {error}") from None
        return made

    def address(self, name: str, room: str) -> int:
        """Address of the machine code of a routine."""
        self.require_level()
        self._grow(room)
        found: int = self._door.address(name, self.level)
        return found

    def _compiled_when_called(self, entry: Entry) -> Callable[..., Any]:
        """Return a callable that compiles the entry's folder when it is first called."""

        @functools.cache
        def compiled() -> Callable[..., Any]:
            self.require_level()
            self._grow(entry.room)
            return self.caller(entry)

        def call(*given: Any) -> Any:
            return compiled()(*given)

        return call

    def complete(self) -> None:
        """Compile everything that is missing in the library.

        Raises:
            KinseekError: It cannot be compiled.
        """
        self._grow(ALL)

    def _has(self, room: str) -> bool:
        return not {ALL, room}.isdisjoint(self.rooms)

    def _grow(self, room: str) -> None:
        with self._growing.now:
            if not self._has(room):
                from .more_rooms import with_room

                self._door = with_room(self._door, room)


def _program(entry: Entry) -> bytes:
    """Encode the parameters of an entry as numbers, which native/door.c reads."""
    names: dict[str, int] = {}
    numbers: list[int] = []

    def add(one: Leaf | Bundle) -> None:
        if isinstance(one, Bundle):
            numbers.extend((_BUNDLE, len(one.fields)))
            for field in one.fields.values():
                add(field)
            return
        if not one.shape:
            numbers.append(_OF[one.element])
            return
        numbers.extend((_ARRAY, _OF[one.element], len(one.shape), int(one.written)))
        for dimension in one.shape:
            if dimension.name == "*":
                numbers.extend((_ANY_LENGTH, 0))
            else:
                name = names.setdefault(dimension.name, len(names)) if dimension.name else -1
                numbers.extend((name, dimension.plus))

    for one in entry.takes.values():
        add(one)
    return _bytes(numbers)


def _bytes(numbers: list[int]) -> bytes:
    return b"".join(number.to_bytes(4, sys.byteorder, signed=True) for number in numbers)


class _Explanation:
    """Callable for arguments that do not fit: reports which one, what it is, and what it should be."""

    def __init__(self, entry: Entry) -> None:
        self.entry = entry

    def __call__(self, *given: Any) -> None:
        """Raise the TypeError."""
        takes = self.entry.takes
        if len(given) != len(takes):
            raise TypeError(
                f"{self.entry.name} takes {len(takes)} arguments ({', '.join(takes)}), got {len(given)}"
            )
        known: dict[str, int] = {}
        for (name, one), value in zip(takes.items(), given, strict=True):
            self._check(name, one, value, known)
        raise TypeError(f"{self.entry.name} was given what it does not take")

    def _check(self, path: str, one: Leaf | Bundle, value: Any, known: dict[str, int]) -> None:
        if isinstance(one, Bundle):
            if not isinstance(value, tuple) or len(value) != len(one.fields):
                self._refuse(path, f"a {one.made_of.__name__} ({', '.join(one.fields)})", repr(type(value)))
            for (name, field), part in zip(one.fields.items(), value, strict=True):
                self._check(f"{path}.{name}", field, part, known)
            return
        expected = one.words(known)
        if not one.shape:
            ways = ("__index__",) if one.element == "i" else ("__index__", "__float__")
            if not any(hasattr(type(value), way) for way in ways):
                self._refuse(path, expected, repr(value))
            return
        if not one.fits(value, known):
            words = f"{getattr(value, 'dtype', type(value).__name__)} of shape {getattr(value, 'shape', '?')}"
            flags = getattr(value, "flags", None)
            if flags is not None and not flags.c_contiguous:
                words += ", not C-contiguous"
            if flags is not None and one.written and not flags.writeable:
                words += ", read-only"
            self._refuse(path, expected, words)

    def _refuse(self, path: str, expected: str, got: str) -> None:
        raise TypeError(f"{self.entry.name}: {path} must be {expected}, got {got}")


def _is_set(name: str) -> bool:
    return os.environ.get(name, "") not in ("", "0")


PLAIN = _is_set("NUMBA_DISABLE_JIT")
"""True if kernels run as plain Python."""


def _library() -> tuple[Library | None, str]:
    """Return the library, or None and the reason why it is not used."""
    if PLAIN:
        return None, "NUMBA_DISABLE_JIT asks for plain Python"
    if _is_set("KINSEEK_JIT"):
        return None, "KINSEEK_JIT asks for Numba"
    try:
        from . import _prebuilt as door  # type: ignore[attr-defined,unused-ignore]
    except ImportError as error:
        built = find_spec("kinseek.kernels._prebuilt") is not None
        return None, f"it cannot be loaded ({error})" if built else "none was built"
    if door.digest != (now := source_digest()):
        return (
            None,
            f"it was built from other sources (their digest is {door.digest}, that of those here {now})",
        )
    return _at_level(door)


def _at_level(door: Any) -> tuple[Library | None, str]:
    """Return the library for the highest level that this processor supports, or for KINSEEK_LEVEL."""
    levels, best = [int(level) for level in door.levels.split()], door.best_level()
    usable = [level for level in levels if level <= best]
    if requested := os.environ.get("KINSEEK_LEVEL"):
        if requested not in map(str, usable):
            refused = (
                f"KINSEEK_LEVEL={requested!r}: the library of kernels has the levels "
                f"{', '.join(map(str, levels))}, of which "
                f"this processor runs {', '.join(map(str, usable)) or 'none'}"
            )
            return Library(door, 0, refused), ""
        return Library(door, int(requested)), ""
    if not usable:
        return None, f"it needs a processor of level {min(levels)} at least, this one has {best}"
    return Library(door, max(usable)), ""


LIBRARY, WHY_NOT = _library()
"""The library, or None and the reason why it is not used."""

if LIBRARY is None and not PLAIN and find_spec("numba") is None:
    raise ImportError(
        f"kinseek has no library of compiled kernels that runs here: {WHY_NOT}. With Numba it compiles them itself: "
        "pip install 'kinseek[jit]'"
    )


def describe_backend() -> str:
    """Describe in a sentence how kernels run.

    Raises:
        InvalidUse: KINSEEK_LEVEL is not a level of the library.
    """
    if LIBRARY is not None:
        LIBRARY.require_level()
        rest = f" It has {', '.join(LIBRARY.rooms)}; the rest is compiled when it is first called."
        whole = LIBRARY.rooms == [ALL]
        return f"Kernels run from the library built with the package, level {LIBRARY.level}.{'' if whole else rest}"
    return f"Kernels {'run as plain Python' if PLAIN else 'are compiled by Numba'}: there is no library, {WHY_NOT}."
