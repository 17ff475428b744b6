"""Arrays by address: one integer array names all the arrays of an arm, so that a call hands over one argument.

Numba takes about 0.2 µs to unwrap each array argument, and counts references to each inside. An atlas has twenty arrays and
an answer takes 5 µs. So the shell writes their addresses and shapes down once, keeps the arrays alive, and kernels make
plain views of them.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba.extending import intrinsic
from numpy.typing import NDArray

from .arrays import Array, Indices
from .jit import view
from .without_jit import WITHOUT_JIT, call_at, view_at

ROW = 4
"""Numbers a row of a handle holds: address and three dimensions."""


types: Any = numba.types  # Untyped in Numba itself.
carray: Any = view_at if WITHOUT_JIT else vars(numba)["carray"]


def _pointer_to(dtype: Any) -> Any:
    if WITHOUT_JIT:
        return lambda address: (address, numba.np.numpy_support.as_dtype(dtype))

    @intrinsic
    def pointer(typing_context: Any, address: Any) -> Any:
        """Turn an address into a pointer."""
        result = types.CPointer(dtype)

        def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            return builder.inttoptr(args[0], context.get_value_type(result))

        return result(types.int64), generate

    return pointer


_floats, _integers, _bools = (_pointer_to(t) for t in (types.float64, types.int64, types.boolean))


@intrinsic
def _call(typing_context: Any, address: Any, arguments: Any) -> Any:
    """Call the `jit.Routine` at an address with a tuple of integers and floats; return the integer it returns."""
    result = types.int64

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        given = [builder.extract_value(values[1], i) for i in range(len(arguments))]
        kind = ir.FunctionType(context.get_value_type(result), [value.type for value in given])
        return builder.call(builder.inttoptr(values[0], kind.as_pointer()), given)

    return result(types.int64, arguments), generate


call: Any = call_at if WITHOUT_JIT else _call  # To its stubs an intrinsic is called with its typing context.


def handle_of(arrays: list[NDArray[Any]]) -> Indices:
    """Write down where arrays are, (k · ROW,); the caller keeps them alive."""
    rows = [(a.ctypes.data, *a.shape, *(1,) * (3 - a.ndim)) for a in arrays]
    return np.array(rows, dtype=np.int64).ravel()


@view
def floats1(handle: Indices, k: int) -> Array:
    """View array k, one-dimensional."""
    seen: Array = carray(_floats(handle[ROW * k]), (handle[ROW * k + 1],))
    return seen


@view
def floats2(handle: Indices, k: int) -> Array:
    """View array k, two-dimensional."""
    seen: Array = carray(_floats(handle[ROW * k]), (handle[ROW * k + 1], handle[ROW * k + 2]))
    return seen


@view
def floats3(handle: Indices, k: int) -> Array:
    """View array k, three-dimensional."""
    o = ROW * k
    seen: Array = carray(_floats(handle[o]), (handle[o + 1], handle[o + 2], handle[o + 3]))
    return seen


@view
def integers(handle: Indices, k: int) -> Indices:
    """View array k, one-dimensional, of integers."""
    seen: Indices = carray(_integers(handle[ROW * k]), (handle[ROW * k + 1],))
    return seen


@view
def flags(handle: Indices, k: int) -> NDArray[np.bool_]:
    """View array k, one-dimensional, of truth values."""
    seen: NDArray[np.bool_] = carray(_bools(handle[ROW * k]), (handle[ROW * k + 1],))
    return seen


@view
def part1(address: int, first: int, count: int) -> Array:
    """View `count` floats of a memory from number `first` on."""
    seen: Array = carray(_floats(address + 8 * first), (count,))
    return seen


@view
def part2(address: int, first: int, rows: int, columns: int) -> Array:
    """View a table of floats in a memory from number `first` on."""
    seen: Array = carray(_floats(address + 8 * first), (rows, columns))
    return seen


@view
def integer_part(address: int, first: int, count: int) -> Indices:
    """View `count` integers in a memory of 8-byte numbers from number `first` on."""
    seen: Indices = carray(_integers(address + 8 * first), (count,))
    return seen


@view
def integer_part2(address: int, first: int, rows: int, columns: int) -> Indices:
    """View a table of integers in a memory of 8-byte numbers from number `first` on."""
    seen: Indices = carray(_integers(address + 8 * first), (rows, columns))
    return seen


@view
def part3(address: int, first: int, tables: int, rows: int, columns: int) -> Array:
    """View tables of floats in a memory from number `first` on."""
    seen: Array = carray(_floats(address + 8 * first), (tables, rows, columns))
    return seen
