"""Shortcuts through computations that Numba repeats while it compiles; they save a tenth of the time of a build.

Every object file is the same to the byte with these shortcuts and without them, which `tests/kernels/test_start_build.py`
checks. They change Numba for the whole process, so only `emit.py` uses them.
"""

from __future__ import annotations

from typing import Any

from llvmlite.binding import ffi
from numba.core import ir as typed_ir
from numba.core import targetconfig as typed_targetconfig
from numba.core.types import functions as typed_functions

# Untyped, or half typed, in Numba itself.
ir: Any = typed_ir
targetconfig: Any = typed_targetconfig
functions: Any = typed_functions


def apply() -> None:
    """Apply all shortcuts to Numba."""
    _report_no_calls_of_llvm()
    _compare_flags_by_what_is_set()
    _list_variables_by_type()
    _remember_types_of_operations()


def _report_no_calls_of_llvm() -> None:
    """Create no events when calls of LLVM begin and end; nothing listens to them."""
    for acquired, released in tuple(ffi.lib._lock._cblist):
        ffi.unregister_lock_callback(acquired, released)


def _compare_flags_by_what_is_set() -> None:
    """Compare only the flags that are set, and the defaults of all flags only if these differ.

    Numba's hash of flags is computed from their names, which are always the same.
    """
    flags = targetconfig.TargetConfig
    compare = flags.__eq__

    def equal(self: Any, other: Any) -> Any:
        if type(self) is type(other) and self._values == other._values:
            return True
        return compare(self, other)

    flags.__eq__, flags.__hash__ = equal, lambda self: hash(type(self))


def _list_variables_by_type() -> None:
    """Skip fields of statements whose type shows that they contain no variable, such as the line in the file."""
    list_variables = ir.Inst._rec_list_vars
    nothing = {ir.Loc, str, int, float, bool, type(None)}

    def listed(self: Any, value: Any) -> Any:
        kind = type(value)
        if kind is ir.Var:
            return [value]
        return [] if kind in nothing else list_variables(self, value)

    ir.Inst._rec_list_vars = listed


def _remember_types_of_operations() -> None:
    """Cache the type of the result of Numba's own operations, such as a product of two floats, by the types of operands.

    Operations that Numba compiles when they are called are not cached: their results depend on the flags of the caller.
    """
    operation = functions.BaseFunction
    find, known = operation.get_call_type, dict[tuple[Any, Any], Any]()

    def found(self: Any, context: Any, args: Any, kws: Any) -> Any:
        if kws:
            return find(self, context, args, kws)
        if (signature := known.get((self, args))) is None:
            signature = find(self, context, args, kws)
            if self._impl_keys[signature.args] is self.typing_key:
                known[self, args] = signature
        return signature

    operation.get_call_type = found
