"""What makes a function a kernel. How kernels run is decided in `backend`, and how they are compiled in `compiler`.

Kernels take and give numbers, arrays and named tuples of them, and use nothing of ours from outside this folder.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

from . import entry as entries
from .backend import LIBRARY, PLAIN
from .entry import Bundle, Leaf
from .python_backend import address_of, plainly
from .sources import room_of

if TYPE_CHECKING or (LIBRARY is None and not PLAIN):
    from . import compiler

P = ParamSpec("P")
R = TypeVar("R")

COMPILES = LIBRARY is None and not PLAIN
"""Does Numba compile what is decorated here?"""


def entry(
    returns: Leaf | tuple[Leaf, ...] = (), exact: bool = False, **takes: Leaf | Bundle
) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Declare a kernel that Python calls: what it takes, by name, and the numbers that it returns.

    Args:
        returns: Numbers alone: memory that comes back belongs to the caller, who hands it over to be filled.
        exact: It may meet NaN, and must not assume it away.
        takes: Of each parameter what it is, see `kinseek.kernels.entry`.
    """

    def make(function: Callable[P, R]) -> Callable[P, R]:
        numbers = returns if isinstance(returns, tuple) else (returns,)
        declared = entries.declare(function, numbers, takes, exact)
        if LIBRARY is not None:
            return LIBRARY.caller(declared)
        return kernel_exact(function) if exact else kernel(function)

    return make


def kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile on first call, keep the machine code on disk, release the GIL while running."""
    if LIBRARY is not None:
        return _absent(function)
    return plainly(function) if PLAIN else _compiled(function)


def inlined_with_wrapper(function: Callable[P, R]) -> Callable[P, R]:
    """Compile an inner kernel: always inlined, and without reference counts, so it must not allocate or hand back arrays.

    Handing a bundle of arrays to a function costs more than a short function does: some 200 ns for twenty arrays, half of
    it for counting references.
    """
    return _part(function, forceinline=True, _nrt=False)


def inlined(function: Callable[P, R]) -> Callable[P, R]:
    """Compile an inner kernel that Python never calls: without the wrapper, which takes longer than the kernel."""
    return _part(function, forceinline=True, _nrt=False, no_cpython_wrapper=True)


def noinline(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a long kernel without a Python wrapper, and call it: inlining would compile it for every place that needs it.

    It takes handles and memory by address: a bundle of arrays as an argument is a hundred arguments.
    """
    return _compiled(function, no_cpython_wrapper=True)


def array_view(function: Callable[P, R]) -> Callable[P, R]:
    """Compile an inlined kernel that makes or hands back views of memory somebody else owns.

    What hands back an array or a bundle must count references: its caller gives one back. It has to be said, else Numba
    leaves counting out where the first that calls it, of all, does.
    """
    return _part(function, forceinline=True, _nrt=True, no_cpython_wrapper=True)


def ir_inlined(function: Callable[P, R]) -> Callable[P, R]:
    """Make a long function part of the one kernel that calls it, before anything is compiled: it is compiled once less."""
    return _compiled(function, inline="always")


def exact(function: Callable[P, R]) -> Callable[P, R]:
    """Compile an inner kernel that never fuses a product with a sum: the same bits as NumPy, wherever inlined."""
    return _part(function, forceinline=True, _nrt=False, fastmath=False)


def kernel_exact(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a kernel that may meet NaN, and must not assume it away."""
    if LIBRARY is not None:
        return _absent(function)
    return plainly(function) if PLAIN else _compiled(function, fastmath=False)


def exposed(function: Callable[P, R]) -> Callable[P, R]:
    """Let Python call an inlined kernel, to test it or to draw what it does.

    Where kernels run from the library, which holds entries alone, it raises a RuntimeError when called.
    """
    if LIBRARY is not None:
        return _absent(function)
    return function if PLAIN else compiler.exposed(function)


def _absent(function: Callable[P, R]) -> Callable[P, R]:
    """What stands for a kernel that the library has in other kernels only."""

    def refuse(*given: P.args, **named: P.kwargs) -> R:
        raise RuntimeError(
            f"{function.__name__} is no entry of the library of kernels; KINSEEK_JIT=1 compiles it"
        )

    return refuse


def _compiled(function: Callable[P, R], **options: Any) -> Callable[P, R]:
    """Leave a function as it is where Numba does not compile: the library holds it, or it runs as Python."""
    return compiler.compiled(function, **options) if COMPILES else function


def _part(function: Callable[P, R], **options: Any) -> Callable[P, R]:
    """The same of a function that is inlined into all kernels that it is part of."""
    return compiler.part(function, **options) if COMPILES else function


class Routine:
    """A function that kernels call by its address: its machine code is made once, and never again for what calls it.

    What Numba links into a kernel it optimises anew with that kernel, and with all that call that one in turn: of a
    search that is four calls deep most of the compile time went there. See `pointers.call`.
    """

    def __init__(self, signature: str, function: Callable[..., int]) -> None:
        """Remember what to compile, as a C function of this signature: numbers, and memory by address."""
        self.signature, self.function = signature, function
        self.name, self.room = f"ks_{function.__name__}", room_of(function.__module__)
        self._compiled = compiler.Compiled(signature, function) if COMPILES else None

    @property
    def address(self) -> int:
        """Where its machine code stands: compiled by now, or in the library."""
        if LIBRARY is not None:
            return LIBRARY.address(self.name, self.room)
        return address_of(self.function) if self._compiled is None else self._compiled.address


ROUTINES: dict[str, Routine] = {}
"""All routines of the modules that are imported."""


def routine(signature: str) -> Callable[[Callable[..., int]], Routine]:
    """Make a `Routine` of a function that hands back an integer; compiled when its address is asked."""

    def make(function: Callable[..., int]) -> Routine:
        made = Routine(signature, function)
        if made.name in ROUTINES and ROUTINES[made.name].function.__module__ != function.__module__:
            raise TypeError(f"two routines are called {made.name}")
        ROUTINES[made.name] = made
        return made

    return make
