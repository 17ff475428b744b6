"""Decorators that define kernels. `backend` decides how kernels run, and `compiler` compiles them.

Kernels take and return numbers, arrays and named tuples of them, and use nothing of kinseek outside this folder.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar, overload

from . import entry as entries
from .backend import LIBRARY, PLAIN
from .python_backend import address_of, plainly
from .sources import room_of

if TYPE_CHECKING or (LIBRARY is None and not PLAIN):
    from . import compiler

P = ParamSpec("P")
R = TypeVar("R")

COMPILES = LIBRARY is None and not PLAIN
"""True if Numba compiles decorated functions."""


@overload
def entry(function: Callable[P, R]) -> Callable[P, R]: ...


@overload
def entry(*, exact: bool) -> Callable[[Callable[P, R]], Callable[P, R]]: ...


def entry(
    function: Callable[P, R] | None = None, *, exact: bool = False
) -> Callable[P, R] | Callable[[Callable[P, R]], Callable[P, R]]:
    """Make a kernel that Python calls; its annotations declare what it takes, see `entry.declared`.

    It returns numbers only: memory for results belongs to the caller, who passes it to be filled.

    Args:
        function: The kernel.
        exact: True if it may receive NaN and must not assume that there is none.
    """

    def make(function: Callable[P, R]) -> Callable[P, R]:
        declared = entries.declare(function, exact)
        if LIBRARY is not None:
            return LIBRARY.caller(declared)
        return kernel_exact(function) if exact else kernel(function)

    return make if function is None else make(function)


def kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile on first call, keep the machine code on disk, and release the GIL while running."""
    if LIBRARY is not None:
        return _absent(function)
    return plainly(function) if PLAIN else _compiled(function)


def inlined_with_wrapper(function: Callable[P, R]) -> Callable[P, R]:
    """Do the same as `inlined`, for a kernel that Python calls too."""
    return _part(function, forceinline=True, _nrt=False)


def inlined(function: Callable[P, R]) -> Callable[P, R]:
    """Compile an inner kernel that is always inlined, without reference counts and without a wrapper for Python.

    It must not allocate, and arrays or bundles that it returns must be views by address (see `pointers`): whoever counts
    references releases what it receives. Counting references to a bundle would double the code of a caller, and take half
    of the 200 ns in which twenty arrays are passed.
    """
    return _part(function, forceinline=True, _nrt=False, no_cpython_wrapper=True)


def counted(function: Callable[P, R]) -> Callable[P, R]:
    """Compile an inlined kernel that allocates, or returns a single array, in which Numba has to count references.

    Only entries and such kernels may call one that returns what it allocates: other kernels release nothing.
    """
    return _part(function, forceinline=True, _nrt=True, no_cpython_wrapper=True)


def noinline(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a long kernel without a Python wrapper, and call it: inlining would compile it again for every use.

    It takes handles and memory by address, because a bundle of arrays is a hundred arguments.
    """
    return _compiled(function, no_cpython_wrapper=True)


def exact(function: Callable[P, R]) -> Callable[P, R]:
    """Compile an inner kernel that never fuses a product with a sum.

    It gives the same bits as NumPy wherever it is inlined.
    """
    return _part(function, forceinline=True, _nrt=False, fastmath=False)


def kernel_exact(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a kernel that may receive NaN and must not assume that there is none."""
    if LIBRARY is not None:
        return _absent(function)
    return plainly(function) if PLAIN else _compiled(function, fastmath=False)


def exposed(function: Callable[P, R]) -> Callable[P, R]:
    """Make an inlined kernel callable from Python, for tests and drawings.

    If kernels run from the library, which contains only entries, it raises a RuntimeError when called.
    """
    if LIBRARY is not None:
        return _absent(function)
    return function if PLAIN else compiler.exposed(function)


def _absent(function: Callable[P, R]) -> Callable[P, R]:
    """Placeholder for a kernel that the library contains only as part of other kernels."""

    def refuse(*given: P.args, **named: P.kwargs) -> R:
        raise RuntimeError(
            f"{function.__name__} is no entry of the library of kernels; KINSEEK_JIT=1 compiles it"
        )

    return refuse


def _compiled(function: Callable[P, R], **options: Any) -> Callable[P, R]:
    """Compile a function, or return it unchanged if Numba does not compile.

    It does not if the library contains the function, or if kernels run as Python.
    """
    return compiler.compiled(function, **options) if COMPILES else function


def _part(function: Callable[P, R], **options: Any) -> Callable[P, R]:
    """Do the same for a function that is inlined into all kernels that use it."""
    return compiler.part(function, **options) if COMPILES else function


class Routine:
    """A function that kernels call by its address: its machine code is compiled once, independently of its callers.

    Numba optimises a function that it links into a kernel again with that kernel, and with all its callers. For a search
    that is four calls deep this took most of the compile time. See `pointers.routine` and `pointers.call`.
    """

    def __init__(self, signature: str, function: Callable[..., int], original: Callable[..., int]) -> None:
        """Store what to compile.

        Args:
            signature: That of a C function of numbers, as Numba reads it.
            function: A function of numbers, which calls the original.
            original: The kernel itself, for plain Python.
        """
        self.signature, self.function, self.original = signature, function, original
        self.name, self.room = f"ks_{function.__name__}", room_of(function.__module__)
        self._compiled = compiler.Compiled(signature, function) if COMPILES else None
        if self.name in ROUTINES and ROUTINES[self.name].function.__module__ != function.__module__:
            raise TypeError(f"two routines are called {self.name}")
        ROUTINES[self.name] = self

    @property
    def address(self) -> int:
        """Address of its machine code, compiled by now or in the library."""
        if LIBRARY is not None:
            return LIBRARY.address(self.name, self.room)
        return address_of(self.original) if self._compiled is None else self._compiled.address


ROUTINES: dict[str, Routine] = {}
"""All routines of the imported modules."""
