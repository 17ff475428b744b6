"""emit.py JOB.json: compile declared entries for a target, in a separate process because the kernels' sizes differ.

Numba types the entries and lowers them. For x86-64 it also optimises them as for this machine, which gives the same bits.
For any other processor, optimisation starts when the code is for that processor. Each entry gets a wrapper that takes all
arguments from a table of 64-bit numbers.
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
"""The module with the maximum number of leaves that a search tabulates, and the name of this constant."""


class _Loader(SourceFileLoader):
    """Loads a module with another value of a constant."""

    def __init__(self, name: str, path: str, value: int) -> None:
        super().__init__(name, path)
        self.value = value

    def get_code(self, fullname: str) -> CodeType:
        """Compile the source with the other value, without a cache on disk.

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
    """Assigns `_Loader` to the sized module."""

    def __init__(self, value: int) -> None:
        self.value = value

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Find the sized module."""
        if fullname != SIZED:
            return None
        spec = PathFinder.find_spec(fullname, path, target)
        if spec is not None and spec.origin is not None:
            spec.loader = _Loader(fullname, spec.origin, self.value)
            spec.cached = None
        return spec


def main() -> None:
    """Do the job that a file describes, and write the results beside it."""
    path = Path(sys.argv[1])
    job = json.loads(path.read_text(encoding="utf-8"))
    sys.dont_write_bytecode = True
    sys.meta_path.insert(0, _Finder(job["lanes"]))
    for name in job["modules"]:
        importlib.import_module(name)
    from kinseek.kernels.grid.memory import memory_size
    from kinseek.kernels.machine_code import never_run

    never_run()
    report = _written(*_module(job), job, path.parent)
    report["memory"] = memory_size(*job["sizes"])
    (path.parent / "report.json").write_text(json.dumps(report), encoding="utf-8")


def _module(job: dict[str, Any]) -> tuple[Any, Any]:
    """Return the module with the wrappers of all kernels of a job, optimised, and the machine that writes its code."""
    import llvmlite.binding as llvm

    from kinseek.kernels import jit  # Not by name: naming its decorators marks a file of kernels.
    from kinseek.kernels.entry import ENTRIES
    from kinseek.kernels.machine_code import (
        machine_for,
        module_of,
        optimised_for,
        this_machine,
        without_unused,
    )

    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    named = {name: ENTRIES[name] for name in job["entries"]}
    module = module_of(named | {name: jit.ROUTINES[name] for name in job["routines"]})
    if job["optimised"]:
        machine = this_machine(job["triple"])
    else:
        machine = machine_for(job["triple"], job["cpu"], job["features"], job["relocation"], job["abi"])
        module = optimised_for(module, job["triple"], machine, threads=False)
    return without_unused(module, machine), machine


def _written(module: Any, machine: Any, job: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Write the object file, and if requested the assembly of the processor or of LLVM."""
    import llvmlite.binding as llvm

    data = machine.emit_object(module)
    (folder / "kernels.o").write_bytes(data)
    # The others are written on request, because writing machine code again takes as long as the first time.
    if job["file"] == "kernels.s":
        (folder / "kernels.s").write_text(machine.emit_assembly(module), encoding="utf-8")
    if job["file"] == "kernels.ll":
        (folder / "kernels.ll").write_text(str(module), encoding="utf-8")
    imported = [each.name for each in [*module.functions, *module.global_variables] if each.is_declaration]
    # Names in WebAssembly do not end where LLVM expects; those of code and data do.
    sections = [
        ((one.name() or b"").decode(errors="replace"), one.size())
        for one in llvm.ObjectFileRef.from_data(data).sections()
    ]
    return {
        "externals": sorted(name for name in imported if not name.startswith("llvm.")),
        "sections": sections,
    }


if __name__ == "__main__":
    main()
