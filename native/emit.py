"""emit.py FOLDER LEVEL: compile entries and routines, and write an object file of each; several may run at once."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path
from typing import Any

import llvmlite.binding as llvm
from llvmlite import ir
from numba.core import cgutils as typed_cgutils
from numba.core import types as typed_types
from numba.np import arrayobj as typed_arrayobj

from kinseek.kernels import compiler, entry, jit
from kinseek.kernels.sources import PACKAGE, kernel_sources

# Half typed in Numba itself.
types: Any = typed_types
cgutils: Any = typed_cgutils
arrayobj: Any = typed_arrayobj

ELEMENTS = {"f": types.float64, "i": types.int64, "b": types.boolean}


def main() -> None:
    """Compile what nobody else has taken yet."""
    folder, level = Path(sys.argv[1]), int(sys.argv[2])
    for path in kernel_sources():
        importlib.import_module(".".join(["kinseek", *path.relative_to(PACKAGE).with_suffix("").parts]))
    # Routines take longest, so they come first.
    jobs: list[Any] = [*jit.ROUTINES.values(), *entry.ENTRIES.values()]
    if _taken(folder / f"names.{level}.taken"):
        _put(folder / f"names.{level}", "\n".join(job.name for job in jobs).encode())
    for job in jobs:
        if _taken(folder / f"{job.name}.{level}.taken"):
            data = compile_routine(job, level) if isinstance(job, jit.Routine) else compile_entry(job, level)
            _put(folder / f"{job.name}.{level}.o", data)


def _put(path: Path, data: bytes) -> None:
    """Write a file that is whole from the moment on at which it is there."""
    new = path.with_name(path.name + ".new")
    new.write_bytes(data)
    new.rename(path)


def _taken(path: Path) -> bool:
    """Was a file made by this very process, and by no other before?"""
    try:
        path.touch(exist_ok=False)
    except FileExistsError:
        return False
    return True


def compile_entry(one: entry.Entry, level: int) -> bytes:
    """An entry and its wrapper: takes the table of its arguments, returns 0 or Numba's number for a failure."""
    compiled = compiler.bare(one.function, getattr(one, "exact", False))
    signature = tuple(map(numba_type, one.takes.values()))
    compiled.compile(signature)
    made = compiled.overloads[signature]

    def wrap(builder: Any, context: Any, function: Any) -> Any:
        table = builder.inttoptr(function.args[0], ir.IntType(64).as_pointer())
        reader = _Table(context, builder, table)
        arguments = [reader.read(kind) for kind in signature]
        status, value = context.call_conv.call_function(
            builder,
            context.declare_function(builder.module, made.fndesc),
            made.signature.return_type,
            signature,
            arguments,
        )
        reader.write(made.signature.return_type, value, one)
        return status.code

    return _object(made, f"{one.name}_l{level}", [types.int64], types.int32, wrap)


def compile_routine(one: Any, level: int) -> bytes:
    """A routine, and its wrapper: a C function of numbers that returns a number, -1 where it failed."""
    compiled = compiler.bare(one.function, getattr(one, "exact", False))
    signature = tuple(compiler.signature_of(one.signature)[0])
    compiled.compile(signature)
    made = compiled.overloads[signature]

    def wrap(builder: Any, context: Any, function: Any) -> Any:
        status, value = context.call_conv.call_function(
            builder,
            context.declare_function(builder.module, made.fndesc),
            made.signature.return_type,
            signature,
            list(function.args),
        )
        return builder.select(status.is_ok, value, ir.Constant(value.type, -1))

    return _object(made, f"{one.name}_l{level}", list(signature), types.int64, wrap)


def numba_type(one: Any) -> Any:
    """What Numba calls it."""
    if isinstance(one, entry.Bundle):
        return types.BaseTuple.from_types(tuple(map(numba_type, one.fields.values())), one.made_of)
    element = ELEMENTS[one.element]
    return types.Array(element, len(one.shape), "C") if one.shape else element


class _Table:
    """Reads arguments from a table of 64-bit numbers, one after the other."""

    def __init__(self, context: Any, builder: Any, table: Any) -> None:
        self.context, self.builder, self.table, self.place = context, builder, table, 0

    def _next(self) -> Any:
        place = self.builder.gep(self.table, [ir.Constant(ir.IntType(64), self.place)])
        self.place += 1
        return place

    def read(self, kind: Any) -> Any:
        """The value of a type."""
        builder, context = self.builder, self.context
        if isinstance(kind, types.BaseTuple):
            return context.make_tuple(builder, kind, [self.read(each) for each in kind.types])
        if isinstance(kind, types.Array):
            return self._array(kind)
        place = self._next()
        if kind == types.float64:
            return builder.load(builder.bitcast(place, ir.DoubleType().as_pointer()))
        number = builder.load(place)
        return (
            builder.icmp_signed("!=", number, ir.Constant(number.type, 0))
            if kind == types.boolean
            else number
        )

    def _array(self, kind: Any) -> Any:
        builder, context = self.builder, self.context
        array = arrayobj.make_array(kind)(context, builder)
        data = builder.inttoptr(builder.load(self._next()), array.data.type)
        shape = [builder.load(self._next()) for _ in range(kind.ndim)]
        size = context.get_abi_sizeof(context.get_data_type(kind.dtype))
        strides = [ir.Constant(ir.IntType(64), size)]
        for length in reversed(shape[1:]):
            strides.insert(0, builder.mul(strides[0], length))
        arrayobj.populate_array(array, data, shape, strides, size, None)
        return array._getvalue()

    def write(self, kind: Any, value: Any, one: entry.Entry) -> None:
        """Put what a kernel returns behind its arguments.

        Raises:
            TypeError: It is not what is declared.
        """
        kinds = () if kind == types.none else kind.types if isinstance(kind, types.BaseTuple) else (kind,)
        if tuple(kinds) != tuple(map(numba_type, one.returns)):
            raise TypeError(f"{one.name} returns {kind}, declared is {one.returns}")
        for i, each in enumerate(kinds):
            part = (
                cgutils.unpack_tuple(self.builder, value)[i] if isinstance(kind, types.BaseTuple) else value
            )
            place = self._next()
            if each == types.float64:
                self.builder.store(part, self.builder.bitcast(place, ir.DoubleType().as_pointer()))
            else:
                wide = self.builder.zext(part, ir.IntType(64)) if each == types.boolean else part
                self.builder.store(wide, place)


def _object(made: Any, name: str, takes: list[Any], returns: Any, wrap: Any) -> bytes:
    """Link a compiled function and its wrapper, leave nothing else visible, and write the machine code."""
    library = made.library
    codegen, context = library._codegen, made.target_context
    module = ir.Module(name)
    kind = ir.FunctionType(context.get_value_type(returns), [context.get_value_type(each) for each in takes])
    function = ir.Function(module, kind, name)
    builder = ir.IRBuilder(function.append_basic_block())
    builder.ret(wrap(builder, context, function))
    final = library._final_module
    whole = llvm.parse_assembly(str(module))
    whole.triple, whole.data_layout = final.triple, final.data_layout
    whole.link_in(llvm.parse_bitcode(final.as_bitcode()))
    for one in [*whole.functions, *whole.global_variables]:
        if not one.is_declaration and one.name != name:
            one.linkage = "internal"
    target = llvm.Target.from_triple(whole.triple)
    machine = target.create_target_machine(
        cpu=codegen._get_host_cpu_name(),
        features=codegen._get_host_cpu_features(),
        opt=3,
        reloc="pic",
        codemodel="default",
    )
    passes = llvm.create_new_module_pass_manager()
    passes.add_global_dead_code_eliminate_pass()
    passes.run(whole, llvm.create_pass_builder(machine, llvm.create_pipeline_tuning_options(speed_level=2)))
    whole.verify()
    data: bytes = machine.emit_object(whole)
    return data


if __name__ == "__main__":
    main()
