"""From compiled kernels to an object file, for this machine or another one; the build and the export use it.

For this machine Numba optimises a kernel. For another processor Numba only types and lowers it, with ``NUMBA_OPT=0``, and
LLVM optimises it here: a finished module contains instructions of the processor for which it was optimised.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import llvmlite.binding as llvm
from numba.core.registry import cpu_target as typed_cpu_target

from .compiler import EFFORT
from .entry import Entry
from .jit import Routine
from .wrapper import compiled, wrapper_of

cpu_target: Any = typed_cpu_target  # Half typed in Numba itself.

ADDRESSES = "numba.dynamic.globals"
"""Beginning of the names of variables with addresses of the process that compiles. Numba leaves unused ones in a module;
machine code must not use one."""


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
