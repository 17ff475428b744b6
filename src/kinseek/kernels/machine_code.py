"""From compiled kernels to an object file, for this machine or another one; the build and the export use it.

For this machine Numba optimises a kernel. For another processor Numba only types and lowers it, with ``NUMBA_OPT=0``, and
LLVM optimises it here: a finished module contains instructions of the processor for which it was optimised.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, cast

import llvmlite.binding as llvm
from numba.core import codegen
from numba.core.datamodel import models
from numba.core.registry import cpu_target as typed_cpu_target

from .compiler import EFFORT, SHIPPED, FirstRunNotice, JITCodeLibrary, contiguous
from .entry import Entry
from .jit import Routine
from .wrapper import WORD, compiled, wrapper_of

cpu_target: Any = typed_cpu_target  # Half typed in Numba itself.

ADDRESSES = "numba.dynamic.globals"
"""Beginning of the names of variables with addresses of the process that compiles. Numba leaves unused ones in a module;
machine code must not use one."""

_WITHOUT_COPIES = ("-unroll-runtime=false",)
"""LLVM options for builds. It would unroll each loop whose length is known only at run time, mostly over a few joints, into
eight copies that are hardly ever reached. That took half of the time of its passes over a whole kernel, and a third of the
size of the object. The options hold for all that a process compiles, so they are not set where users compile."""


def never_run() -> None:
    """Let Numba compile without machine code for this process, for builds whose results are written out and not called.

    Call it before kernels are imported. Otherwise Numba would make machine code and Python wrappers of every kernel and
    all its parts, which takes more than a third of the time to build a library. Processes then exchange LLVM's own format
    through the cache.
    """
    for option in _WITHOUT_COPIES:
        llvm.set_option("kinseek", option)
    library, generator = JITCodeLibrary, cast("Any", codegen.JITCPUCodegen)
    # Each lookup would ask LLVM for an address and so create machine code.
    library.get_pointer_to_function = lambda self, name: self._ensure_finalized() or 0
    generator.set_env = lambda self, name, environment: None
    library._finalize_specific = lambda self: None
    library.serialize_using_object_code = library.serialize_using_bitcode
    _pass_arrays_briefly()
    SHIPPED["no_cpython_wrapper"] = True
    FirstRunNotice.said = True  # The notice would be wrong here.


def _pass_arrays_briefly() -> None:
    """Let functions take a contiguous array as its address and lengths, from which they compute the rest.

    Numba passes seven or nine numbers: also an owner, strides and sizes. A bundle of twenty arrays is taken apart at every
    call and put together in every callee, so these were half of all instructions that LLVM had to remove again. Callees get
    no owner: an array belongs to the caller for the time of the call, and no kernel returns one that it was given.
    """
    model = cast("Any", models.ArrayModel)
    longer = {name: getattr(model, name) for name in ("get_argument_type", "as_argument", "from_argument")}

    def argument_type(self: Any) -> Any:
        if self.fe_type.layout != "C":
            return longer["get_argument_type"](self)
        return (self.get_value_type().elements[self.get_field_position("data")], *[WORD] * self.fe_type.ndim)

    def as_argument(self: Any, builder: Any, value: Any) -> Any:
        if self.fe_type.layout != "C":
            return longer["as_argument"](self, builder, value)
        shape = self.get_field_position("shape")
        data = builder.extract_value(value, self.get_field_position("data"))
        return (data, *(builder.extract_value(value, [shape, i]) for i in range(self.fe_type.ndim)))

    def from_argument(self: Any, builder: Any, value: Any) -> Any:
        if self.fe_type.layout != "C":
            return longer["from_argument"](self, builder, value)
        data, *lengths = value
        return contiguous(self, builder, data, lengths)

    model.get_argument_type, model.as_argument, model.from_argument = (
        argument_type,
        as_argument,
        from_argument,
    )


def module_of(named: Mapping[str, Entry | Routine]) -> Any:
    """Return one LLVM module with the wrappers of entries and routines and all that they call.

    Args:
        named: Entries and routines by the names of their wrappers; nothing else in the module is visible.
    """
    whole: Any = None
    for name, one in named.items():
        result = compiled(one)
        final = result.library._final_module
        # The wrapper comes first: of functions that occur twice, only those that it needs are linked.
        module = llvm.parse_assembly(wrapper_of(one, result, name))
        module.triple, module.data_layout = final.triple, final.data_layout
        module.link_in(llvm.parse_bitcode(final.as_bitcode()))
        for each in [*module.functions, *module.global_variables]:  # Two kernels may contain the same part.
            if not each.is_declaration and each.linkage == llvm.Linkage.external and each.name not in named:
                each.linkage = "linkonce_odr"
        if whole is None:
            whole = module
        else:
            whole.link_in(module)
    for each in [*whole.functions, *whole.global_variables]:
        if not each.is_declaration and each.name not in named and not each.name.startswith(ADDRESSES):
            each.linkage = "internal"
    return whole


def machine_for(
    triple: str, cpu: str, features: str = "", relocation: str = "pic", abi: str = ""
) -> llvm.TargetMachine:
    """Return what makes machine code for a processor, named as in LLVM."""
    return llvm.Target.from_triple(triple).create_target_machine(
        cpu=cpu, features=features, opt=EFFORT, reloc=relocation, codemodel="default", abiname=abi
    )


def this_machine(triple: str) -> llvm.TargetMachine:
    """Return what makes machine code for the processor that Numba optimises for."""
    codegen = cpu_target.target_context.codegen()
    return machine_for(triple, codegen._get_host_cpu_name(), codegen._get_host_cpu_features())


def optimised_for(module: Any, triple: str, machine: Any, threads: bool = True) -> Any:
    """Return a copy of a module that Numba only lowered, optimised for another machine.

    Args:
        module: As `module_of` returns it.
        triple: The target, as LLVM names it.
        machine: The machine of this target.
        threads: Whether kernels may run in several threads; otherwise atomic operations become plain ones.
    """
    module = llvm.parse_bitcode(
        module.as_bitcode()
    )  # The triple of a module can change only before its first use.
    module.triple, module.data_layout = triple, str(machine.target_data)
    builder = _passes_for(machine)
    if not threads:
        passes = llvm.create_new_module_pass_manager()
        passes.add_lower_atomic_pass()
        passes.run(module, builder)
    builder.getModulePassManager().run(module, builder)
    return module


def without_unused(module: Any, machine: Any) -> Any:
    """Remove from a module what no wrapper needs, and check the rest.

    Raises:
        ValueError: Its machine code would contain addresses of this process.
    """
    passes = llvm.create_new_module_pass_manager()
    passes.add_global_dead_code_eliminate_pass()
    passes.run(module, _passes_for(machine))
    module.verify()
    if kept := [each.name for each in module.global_variables if each.name.startswith(ADDRESSES)]:
        raise ValueError(f"{module.name} contains addresses of this process: {', '.join(kept)}")
    return module


def _passes_for(machine: Any) -> Any:
    """Return LLVM's builder of passes for a machine."""
    return llvm.create_pass_builder(machine, llvm.create_pipeline_tuning_options(speed_level=EFFORT))
