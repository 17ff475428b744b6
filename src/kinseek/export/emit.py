"""emit.py JOB.json: compile declared entries for a target; a process of its own, for it compiles kernels of another size.

Numba types the entries and lowers them. For the x86-64 it also optimises them, as it does for this machine, which gives the
same bits; for any other processor nothing is optimised before the code is that processor's. A wrapper that takes all
arguments from a table of 64-bit numbers goes beside each entry.
"""

from __future__ import annotations

import ast
import importlib
import importlib.abc
import importlib.machinery
import json
import sys
from collections.abc import Sequence
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any

SIZED, CONSTANT = "kinseek.kernels.grid.memory", "MOST_LANES"
"""The module that says how many leaves a search tabulates at most, and the name that it has there."""


class _Loader(SourceFileLoader):
    """Loads a module with another value of a constant."""

    def __init__(self, name: str, path: str, value: int) -> None:
        super().__init__(name, path)
        self.value = value

    def get_code(self, fullname: str) -> CodeType:
        """Compile the source with the other value, and keep nothing on disk.

        Raises:
            ImportError: The module has no such constant.
        """
        tree = ast.parse(self.get_data(self.path))
        found = 0
        for one in tree.body:
            if isinstance(one, ast.Assign) and [ast.unparse(each) for each in one.targets] == [CONSTANT]:
                one.value = ast.copy_location(ast.Constant(self.value), one.value)
                found += 1
        if found != 1:
            raise ImportError(f"{fullname} sets {CONSTANT} {found} times, expected once")
        return compile(tree, self.path, "exec")


class _Finder(importlib.abc.MetaPathFinder):
    """Gives the sized module to `_Loader`."""

    def __init__(self, value: int) -> None:
        self.value = value

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Find the one module."""
        if fullname != SIZED:
            return None
        spec = PathFinder.find_spec(fullname, path, target)
        if spec is not None and spec.origin is not None:
            spec.loader = _Loader(fullname, spec.origin, self.value)
            spec.cached = None
        return spec


def main() -> None:
    """Do the job that a file describes, and write beside it what came of it."""
    path = Path(sys.argv[1])
    job = json.loads(path.read_text(encoding="utf-8"))
    sys.dont_write_bytecode = True
    sys.meta_path.insert(0, _Finder(job["lanes"]))
    for name in job["modules"]:
        importlib.import_module(name)
    from kinseek.kernels.grid.memory import memory_size

    module, host = _lowered(job["entries"], job["routines"])
    told = _written(module, host, job, path.parent)
    told["memory"] = memory_size(*job["sizes"])
    (path.parent / "told.json").write_text(json.dumps(told), encoding="utf-8")


def _lowered(entries: list[str], routines: list[str]) -> tuple[Any, tuple[str, str]]:
    """One module with all entries and routines, and the processor and its features that Numba compiled them for."""
    import llvmlite.binding as llvm

    from kinseek.kernels import jit
    from kinseek.kernels.entry import ENTRIES

    whole: Any = None
    names = [*entries, *routines]
    for name in names:
        parts, codegen = _entry(ENTRIES[name]) if name in entries else _routine(jit.ROUTINES[name])
        for part in parts:
            one = llvm.parse_bitcode(part)
            for each in [*one.functions, *one.global_variables]:  # What two entries share comes twice.
                if not each.is_declaration and each.linkage == llvm.Linkage.external and each.name != name:
                    each.linkage = "linkonce_odr"
            if whole is None:
                whole = one
            else:
                whole.link_in(one)
    for each in [*whole.functions, *whole.global_variables]:
        if not each.is_declaration and each.name not in names:
            each.linkage = "internal"
    return whole, (codegen._get_host_cpu_name(), codegen._get_host_cpu_features())


def _entry(one: Any) -> tuple[list[bytes], Any]:
    """The compiled function and a wrapper that takes the table of its arguments, as bitcode."""
    from llvmlite import ir

    signature = tuple(map(_numba_type, one.takes.values()))

    def wrap(call: Any, context: Any, builder: Any, given: Any, result: Any) -> Any:
        table = _Table(context, builder, given[0])
        status, value = call([table.read(kind) for kind in signature])
        table.write(result, value, one)
        return status.code

    kind = ir.FunctionType(ir.IntType(32), [ir.IntType(64).as_pointer()])
    return _wrapped(one, one.exact, signature, kind, wrap)


def _routine(one: Any) -> tuple[list[bytes], Any]:
    """The compiled function and a wrapper that is a function in C: numbers in, a number out, -1 where it failed."""
    from llvmlite import ir

    from kinseek.kernels import compiler

    types = _untyped("numba.core.types")
    word = ir.IntType(64)
    signature = tuple(compiler.signature_of(one.signature)[0])

    def wrap(call: Any, context: Any, builder: Any, given: Any, result: Any) -> Any:
        status, value = call(list(given))
        return builder.select(status.is_ok, value, word(-1))

    takes = [ir.DoubleType() if each == types.float64 else word for each in signature]
    return _wrapped(one, False, signature, ir.FunctionType(word, takes), wrap)


def _wrapped(one: Any, exact: bool, signature: Any, kind: Any, wrap: Any) -> tuple[list[bytes], Any]:
    import llvmlite.binding as llvm
    from llvmlite import ir

    from kinseek.kernels import compiler

    compiled = compiler.bare(one.function, exact)
    compiled.compile(signature)
    made = compiled.overloads[signature]
    context, library = made.target_context, made.library
    final = library._final_module
    module = ir.Module(one.name)
    function = ir.Function(module, kind, one.name)
    builder = ir.IRBuilder(function.append_basic_block())
    callee = context.declare_function(module, made.fndesc)
    result = made.signature.return_type

    def call(arguments: list[Any]) -> Any:
        return context.call_conv.call_function(builder, callee, result, signature, arguments)

    builder.ret(wrap(call, context, builder, function.args, result))
    wrapper = llvm.parse_assembly(str(module))
    wrapper.triple, wrapper.data_layout = final.triple, final.data_layout
    # The wrapper goes first: of what may come twice only that is linked which something asks for.
    return [wrapper.as_bitcode(), final.as_bitcode()], library._codegen


def _untyped(module: str) -> Any:
    """A module that says nothing of its types."""
    return importlib.import_module(module)


def _numba_type(one: Any) -> Any:
    """What Numba calls what an entry takes."""
    from kinseek.kernels import entry

    types = _untyped("numba.core.types")

    if isinstance(one, entry.Bundle):
        return types.BaseTuple.from_types(tuple(map(_numba_type, one.fields.values())), one.made_of)
    element = {"f": types.float64, "i": types.int64, "b": types.boolean}[one.element]
    return types.Array(element, len(one.shape), "C") if one.shape else element


class _Table:
    """Arguments in a table of 64-bit numbers, one after the other, results behind them."""

    def __init__(self, context: Any, builder: Any, table: Any) -> None:
        self.context, self.builder, self.table, self.place = context, builder, table, 0

    def _next(self, kind: Any) -> Any:
        """Where the next number stands, as a pointer to such a value."""
        from llvmlite import ir

        place = self.builder.gep(self.table, [ir.Constant(ir.IntType(64), self.place)])
        self.place += 1
        return self.builder.bitcast(place, kind.as_pointer())

    def read(self, kind: Any) -> Any:
        """The value of a type."""
        from llvmlite import ir

        types = _untyped("numba.core.types")

        builder, word = self.builder, ir.IntType(64)
        if isinstance(kind, types.BaseTuple):
            return self.context.make_tuple(builder, kind, [self.read(each) for each in kind.types])
        if isinstance(kind, types.Array):
            return self._array(kind)
        if kind == types.float64:
            return builder.load(self._next(ir.DoubleType()))
        number = builder.load(self._next(word))
        return builder.icmp_signed("!=", number, word(0)) if kind == types.boolean else number

    def _array(self, kind: Any) -> Any:
        from llvmlite import ir

        arrayobj = _untyped("numba.np.arrayobj")

        builder, word = self.builder, ir.IntType(64)
        array = arrayobj.make_array(kind)(self.context, builder)
        data = builder.inttoptr(builder.load(self._next(word)), array.data.type)
        shape = [builder.load(self._next(word)) for _ in range(kind.ndim)]
        strides = [word(self.context.get_abi_sizeof(self.context.get_data_type(kind.dtype)))]
        for length in reversed(shape[1:]):
            strides.insert(0, builder.mul(strides[0], length))
        arrayobj.populate_array(array, data, shape, strides, strides[-1].constant, None)
        return array._getvalue()

    def write(self, kind: Any, value: Any, one: Any) -> None:
        """Put what an entry returns behind its arguments.

        Raises:
            TypeError: It is not what is declared.
        """
        from llvmlite import ir

        types, cgutils = _untyped("numba.core.types"), _untyped("numba.core.cgutils")

        many = isinstance(kind, types.BaseTuple)
        kinds = tuple(kind.types) if many else () if kind == types.none else (kind,)
        if kinds != tuple(map(_numba_type, one.returns)):
            raise TypeError(f"{one.name} returns {kind}, declared is {one.returns}")
        values = cgutils.unpack_tuple(self.builder, value) if many else [value]
        for each, part in zip(kinds, values, strict=False):
            place = self._next(ir.DoubleType() if each == types.float64 else ir.IntType(64))
            wide = self.builder.zext(part, ir.IntType(64)) if each == types.boolean else part
            self.builder.store(wide, place)


def _written(module: Any, host: tuple[str, str], job: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Optimise for the target, and write the object file, the assembly of the processor and that of LLVM."""
    import llvmlite.binding as llvm

    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    target = llvm.Target.from_triple(job["triple"])
    machine = target.create_target_machine(
        cpu=job["cpu"],
        features=host[1] if job["optimised"] else job["features"],
        opt=3,
        reloc=job["relocation"],
        codemodel="default",
        abiname=job["abi"],
    )
    module.triple, module.data_layout = job["triple"], str(machine.target_data)
    tuning = llvm.create_pipeline_tuning_options(speed_level=2 if job["optimised"] else 3)
    builder = llvm.create_pass_builder(machine, tuning)
    passes = llvm.create_new_module_pass_manager()
    if not job["optimised"]:
        # Only references to memory are counted atomically, and a part without threads has nobody to count against.
        passes.add_lower_atomic_pass()
        passes.run(module, builder)
        passes = builder.getModulePassManager()
    passes.add_global_dead_code_eliminate_pass()
    passes.run(module, builder)
    module.verify()
    data = machine.emit_object(module)
    (folder / "kernels.o").write_bytes(data)
    (folder / "kernels.s").write_text(machine.emit_assembly(module), encoding="utf-8")
    (folder / "kernels.ll").write_text(str(module), encoding="utf-8")
    asked = [each.name for each in [*module.functions, *module.global_variables] if each.is_declaration]
    sections = [
        ((one.name() or b"").decode(), one.size()) for one in llvm.ObjectFileRef.from_data(data).sections()
    ]
    return {"asks": sorted(name for name in asked if not name.startswith("llvm.")), "sections": sections}


if __name__ == "__main__":
    main()
