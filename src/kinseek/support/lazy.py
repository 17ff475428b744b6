"""Attributes that are computed when they are first read, without a lock, and that are not part of an object's state.

`functools.cached_property` is not used for two reasons. In Python 3.11 it holds one lock of the class while it computes a
value; a child that is forked meanwhile waits for that lock forever. And the value that it adds to an object stays in pickles
and copies, which raise an error if it is added while they are being made.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, ClassVar, Generic, Self, TypeVar, overload

T = TypeVar("T")


class Made:
    """A descriptor whose value is computed when it is first read, and then stored in the object's `__dict__`.

    It has no `__set__`, so a value that the object stores itself takes precedence.
    """

    name: str

    def __set_name__(self, owner: type, name: str) -> None:
        """Remember the name of the attribute.

        Raises:
            TypeError: The class does not derive from `Lazy`; pickles would hold the value.
        """
        if not issubclass(owner, Lazy):
            raise TypeError(f"{owner.__name__} has the lazy attribute {name!r}, and must derive from Lazy")
        self.name = name

    def can_be_remade(self, state: Mapping[str, Any]) -> bool:
        """Return whether the value follows from the other attributes of an object; if so, no copy holds it."""
        return True


class lazy(Made, Generic[T]):  # noqa: N801  # Used as a decorator, as `property` is.
    """A method whose result is computed when it is first read as an attribute.

    Two threads may both compute it. They must get equal values, and both are given the same object.
    """

    def __init__(self, compute: Callable[[Any], T]) -> None:
        """Take the method."""
        self._compute, self.__doc__ = compute, compute.__doc__

    @overload
    def __get__(self, instance: None, owner: type) -> Self: ...
    @overload
    def __get__(self, instance: object, owner: type) -> T: ...
    def __get__(self, instance: object | None, owner: type) -> Self | T:
        """Return the value, or the descriptor itself if it is read from the class."""
        if instance is None:
            return self
        value: T = instance.__dict__.setdefault(self.name, self._compute(instance))
        return value


class Lazy:
    """A base class for objects with lazy attributes, which pickles and copies leave out.

    Pickles and copies can be made while another thread uses the object, and their bytes do not depend on what was read
    before.
    """

    _lazy: ClassVar[Mapping[str, Made]] = {}

    def __init_subclass__(cls, **options: Any) -> None:
        """Find the lazy attributes of a class, and those that it inherits."""
        super().__init_subclass__(**options)
        attributes = {name: value for base in reversed(cls.__mro__) for name, value in vars(base).items()}
        cls._lazy = {name: value for name, value in attributes.items() if isinstance(value, Made)}

    def __getstate__(self) -> Any:
        """Return the state of the object, as pickle and copy take it."""
        state: Any = super().__getstate__()
        attributes, slots = state if isinstance(state, tuple) else (state, None)
        # A dictionary of strings is copied in one step: no other thread can add to it meanwhile.
        copied: dict[str, Any] = dict(attributes or {})
        for name in copied.keys() & self._lazy.keys():
            if self._lazy[name].can_be_remade(copied):
                del copied[name]
        return copied if slots is None else (copied, slots)
