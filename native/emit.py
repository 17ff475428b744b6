"""Compile entries and routines, and write an object file of each; several processes may run at once.

    emit.py FOLDER LEVEL        # for this machine, a level of its processor
    emit.py FOLDER TARGET...    # for other machines (targets.py), every level of each, in a folder for each

For this machine Numba optimises. For another one Numba types and lowers alone, with ``NUMBA_OPT=0``, and LLVM optimises for
that machine what came out: finished modules hold instructions of the processor that they were made on.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import llvmlite.binding as llvm
from llvmlite import ir
from numba.core import cgutils as typed_cgutils
from numba.core import types as typed_types
from numba.core.registry import cpu_target as typed_cpu_target
from numba.np import arrayobj as typed_arrayobj
from targets import TARGETS, Target

from kinseek.kernels import compiler, entry, jit
from kinseek.kernels.sources import PACKAGE, kernel_sources

# Half typed in Numba itself.
types: Any = typed_types
cgutils: Any = typed_cgutils
arrayobj: Any = typed_arrayobj
cpu_target: Any = typed_cpu_target

ELEMENTS = {"f": types.float64, "i": types.int64, "b": types.boolean}

Linked = Callable[[int], Any]
"""Makes the module of a compiled kernel and its wrapper, for a level."""

DYNAMIC = "numba.dynamic.globals"
"""Names of what holds addresses of the process that compiles. Lowering leaves unused ones, no machine code may keep one."""


def main() -> None:
    """Compile what nobody else has taken yet."""
    folder = Path(sys.argv[1])
    for path in kernel_sources():
        importlib.import_module(".".join(["kinseek", *path.relative_to(PACKAGE).with_suffix("").parts]))
    # Routines take longest, so they come first.
    jobs: list[Any] = [*jit.ROUTINES.values(), *entry.ENTRIES.values()]
    names = "\n".join(job.name for job in jobs).encode()
    if sys.argv[2].isdecimal():
        places: list[tuple[Path, int, Target | None]] = [(folder, int(sys.argv[2]), None)]
    else:
        llvm.initialize_all_targets()
        llvm.initialize_all_asmprinters()
        targets = {name: TARGETS[name] for name in sys.argv[2:]}
        places = [(folder / name, level, one) for name, one in targets.items() for level in one.levels]
    for place, level, _ in places:
        place.mkdir(exist_ok=True)
        if _taken(place / f"names.{level}.taken"):
            _put(place / f"names.{level}", names)
    for job in jobs:
        if _taken(places[0][0] / f"{job.name}.{places[0][1]}.taken"):
            link = compiled_routine(job) if isinstance(job, jit.Routine) else compiled_entry(job)
            for place, level, target in places:
                whole = link(level)
                data = _native_object(whole) if target is None else _foreign_object(whole, target, level)
                _put(place / f"{job.name}.{level}.o", data)


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


def compiled_entry(one: entry.Entry) -> Linked:
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

    return lambda level: _linked(made, f"{one.name}_l{level}", [types.int64], types.int32, wrap)


def compiled_routine(one: Any) -> Linked:
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

    return lambda level: _linked(made, f"{one.name}_l{level}", list(signature), types.int64, wrap)


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


def _linked(made: Any, name: str, takes: list[Any], returns: Any, wrap: Any) -> Any:
    """A module of a compiled function and its wrapper, nothing else of which is visible."""
    library, context = made.library, made.target_context
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
        if not one.is_declaration and one.name != name and not one.name.startswith(DYNAMIC):
            one.linkage = "internal"
    return whole


def _native_object(whole: Any) -> bytes:
    """Machine code of what Numba has optimised for this machine."""
    codegen = cpu_target.target_context.codegen()
    machine = llvm.Target.from_triple(whole.triple).create_target_machine(
        cpu=codegen._get_host_cpu_name(),
        features=codegen._get_host_cpu_features(),
        opt=3,
        reloc="pic",
        codemodel="default",
    )
    return _emitted(whole, machine, llvm.create_pass_builder(machine, _tuning(2)))


def _foreign_object(whole: Any, target: Target, level: int) -> bytes:
    """Optimise for another machine as Numba does: inline first, drop pairs of reference counts, then everything."""
    whole = llvm.parse_bitcode(whole.as_bitcode())  # Its triple may change only before anything asked for it.
    machine = llvm.Target.from_triple(target.triple).create_target_machine(
        cpu=target.levels[level], features="", opt=3, reloc="pic", codemodel="default"
    )
    whole.triple, whole.data_layout = target.triple, str(machine.target_data)
    for options, loops in ((_tuning(0), True), (_tuning(3), False)):
        builder = llvm.create_pass_builder(machine, options)
        passes = builder.getModulePassManager()
        if loops:
            passes.add_loop_rotate_pass()
            passes.add_instruction_combine_pass()
            passes.add_jump_threading_pass()
        passes.add_refprune_pass()
        passes.run(whole, builder)
    return _emitted(whole, machine, builder)


def _tuning(speed: int) -> Any:
    options = llvm.create_pipeline_tuning_options(speed_level=speed)
    options.loop_vectorization, options.slp_vectorization = speed == 3, False
    return options


def _emitted(whole: Any, machine: Any, builder: Any) -> bytes:
    """Leave out what nobody calls, and write machine code."""
    passes = llvm.create_new_module_pass_manager()
    passes.add_global_dead_code_eliminate_pass()
    passes.run(whole, builder)
    whole.verify()
    if kept := [one.name for one in whole.global_variables if one.name.startswith(DYNAMIC)]:
        raise ValueError(f"{whole.name} holds addresses of this very process: {', '.join(kept)}")
    data: bytes = machine.emit_object(whole)
    return data


if __name__ == "__main__":
    main()
