"""Wrappers in LLVM IR through which declared kernels are called from outside, next to Numba's code of the kernel.

An entry's wrapper takes a table of 64-bit numbers: the value of every number, and the address and lengths of every array,
in the order of the declaration with bundles flattened. It writes the results after them. The library that is built with
the package and the code exported for controllers are called this way.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba.core import cgutils as typed_cgutils
from numba.core import types as typed_types

from .compiler import array_at, bare, signature_of
from .entry import Bundle, Entry
from .jit import Routine

# Half typed in Numba itself.
types: Any = typed_types
cgutils: Any = typed_cgutils

ELEMENTS = {"f": types.float64, "i": types.int64, "b": types.boolean}
WORD = ir.IntType(64)


def compiled(one: Entry | Routine) -> Any:
    """Numba's compilation result for an entry or a routine."""
    declared = (
        map(numba_type, one.takes.values()) if isinstance(one, Entry) else signature_of(one.signature)[0]
    )
    signature = tuple(declared)
    # A routine is called with addresses: it owns no array.
    counted = isinstance(one, Entry)
    kernel = bare(one.function, isinstance(one, Entry) and one.exact, counted)
    kernel.compile(signature)
    return kernel.overloads[signature]


def wrapper_of(one: Entry | Routine, made: Any, name: str) -> str:
    """A module in LLVM IR that contains only the wrapper of the result of `compiled`.

    The wrapper of an entry returns 0, or Numba's number for a failure. That of a routine is a C function of numbers that
    returns a number, -1 if it failed.
    """
    signature = tuple(made.signature.args)
    context, result = made.target_context, made.signature.return_type
    module = ir.Module(name)
    if isinstance(one, Entry):
        kind = ir.FunctionType(ir.IntType(32), [WORD.as_pointer()])
    else:
        kind = ir.FunctionType(WORD, [context.get_value_type(each) for each in signature])
    function = ir.Function(module, kind, name)
    builder = ir.IRBuilder(function.append_basic_block())
    callee = context.declare_function(module, made.fndesc)

    def call(arguments: list[Any]) -> Any:
        return context.call_conv.call_function(builder, callee, result, signature, arguments)

    if isinstance(one, Entry):
        table = Table(context, builder, function.args[0])
        status, value = call([table.read(each) for each in signature])
        table.write(result, value, one)
        builder.ret(status.code)
    else:
        status, value = call(list(function.args))
        builder.ret(builder.select(status.is_ok, value, WORD(-1)))
    return str(module)


def numba_type(one: Any) -> Any:
    """Numba's type for a parameter of an entry."""
    if isinstance(one, Bundle):
        return types.BaseTuple.from_types(tuple(map(numba_type, one.fields.values())), one.made_of)
    element = ELEMENTS[one.element]
    return types.Array(element, len(one.shape), "C") if one.shape else element


class Table:
    """Arguments in a table of 64-bit numbers, one after the other, followed by the results."""

    def __init__(self, context: Any, builder: Any, table: Any) -> None:
        """Start at the beginning of a table."""
        self.context, self.builder, self.table, self.place = context, builder, table, 0

    def _next(self, kind: Any) -> Any:
        """Pointer to the next number, as a value of this type."""
        place = self.builder.gep(self.table, [WORD(self.place)])
        self.place += 1
        return self.builder.bitcast(place, kind.as_pointer())

    def read(self, kind: Any) -> Any:
        """Read the value of a type."""
        if isinstance(kind, types.BaseTuple):
            return self.context.make_tuple(self.builder, kind, [self.read(each) for each in kind.types])
        if isinstance(kind, types.Array):
            return self._array(kind)
        if kind == types.float64:
            return self.builder.load(self._next(ir.DoubleType()))
        number = self.builder.load(self._next(WORD))
        return self.builder.icmp_signed("!=", number, WORD(0)) if kind == types.boolean else number

    def _array(self, kind: Any) -> Any:
        address = self.builder.load(self._next(WORD))
        shape = [self.builder.load(self._next(WORD)) for _ in range(kind.ndim)]
        return array_at(self.context, self.builder, kind, address, shape)

    def write(self, kind: Any, value: Any, one: Entry) -> None:
        """Write the result of an entry after its arguments.

        Raises:
            TypeError: It does not fit the declaration.
        """
        many = isinstance(kind, types.BaseTuple)
        kinds = tuple(kind.types) if many else () if kind == types.none else (kind,)
        if kinds != tuple(map(numba_type, one.returns)):
            raise TypeError(f"{one.name} returns {kind}, declared is {one.returns}")
        values = cgutils.unpack_tuple(self.builder, value) if many else [value]
        # An entry without a declared result has a value too.
        for each, part in zip(kinds, values, strict=False):
            wide = self.builder.zext(part, WORD) if each == types.boolean else part
            self.builder.store(wide, self._next(ir.DoubleType() if each == types.float64 else WORD))
