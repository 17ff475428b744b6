"""Answer what Numba asks itself again and again while it compiles: a tenth of the time of a build.

Every object file is the same to the byte with these shortcuts and without them, which `tests/kernels/test_start_build.py`
checks. They change Numba for the whole process, so only `emit.py` takes them.
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


def take() -> None:
    """Take all shortcuts."""
    _report_no_calls_of_llvm()
    _compare_flags_by_what_is_set()
    _list_variables_by_type()
    _remember_types_of_operations()


def _report_no_calls_of_llvm() -> None:
    """Make no events when a call of LLVM begins and ends; nobody listens."""
    for acquired, released in tuple(ffi.lib._lock._cblist):
        ffi.unregister_lock_callback(acquired, released)


def _compare_flags_by_what_is_set() -> None:
    """Take flags as equal if the same ones are set to the same values, before all values are compared, defaults too.

    Numba's hash of flags goes through all their names, which are the same for all.
    """
    flags = targetconfig.TargetConfig
    compare = flags.__eq__

    def equal(self: Any, other: Any) -> Any:
        if type(self) is type(other) and self._values == other._values:
            return True
        return compare(self, other)

    flags.__eq__, flags.__hash__ = equal, lambda self: hash(type(self))


def _list_variables_by_type() -> None:
    """See by its type that a field of a statement, such as its place in the file, contains no variable."""
    list_variables = ir.Inst._rec_list_vars
    nothing = {ir.Loc, str, int, float, bool, type(None)}

    def listed(self: Any, value: Any) -> Any:
        kind = type(value)
        if kind is ir.Var:
            return [value]
        return [] if kind in nothing else list_variables(self, value)

    ir.Inst._rec_list_vars = listed


def _remember_types_of_operations() -> None:
    """Find the result of an operation of Numba's own, such as a product of two floats, once for each type of operands.

    Not of what Numba compiles when it is called: such results depend on the flags of the caller.
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
