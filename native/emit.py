"""Compile entries and routines, and write an object file of each; several processes may run at once.

    emit.py FOLDER LEVEL [ROOM...] [backwards]    # for this machine, a level of its processor; some rooms, or all
    emit.py FOLDER TARGET... [backwards]          # for other machines (targets.py), every level, in a folder for each

For this machine Numba optimises. For another one Numba types and lowers alone, with ``NUMBA_OPT=0``, and LLVM optimises for
that machine what came out: finished modules hold instructions of the processor that they were made on.
"""

from __future__ import annotations

import gc
import hashlib
import importlib
import os
import sys
from pathlib import Path
from typing import Any

# Where pip builds apart from what is installed, it takes away what an editable install has put on the path: these sources.
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "src"))

import kinseek.kernels.away  # Before Numba, which would obey a file of settings in the working folder.  # noqa: F401, I001

import llvmlite.binding as llvm
import shortcuts
from numba.core.registry import cpu_target as typed_cpu_target
from targets import TARGETS, Target

from kinseek.kernels import entry, jit
from kinseek.kernels.compiler import never_run
from kinseek.kernels.sources import PACKAGE, kernel_sources, module_digest, source_digest
from kinseek.kernels.wrapper import compiled, wrapper_of

cpu_target: Any = typed_cpu_target  # Half typed in Numba itself.

DYNAMIC = "numba.dynamic.globals"
"""Names of what holds addresses of the process that compiles. Lowering leaves unused ones, no machine code may keep one."""


def main() -> None:
    """Compile what nobody else has taken yet."""
    os.umask(0o077)  # What is kept is taken up by another build only if nobody else can write to it.
    folder, first, *rest = Path(sys.argv[1]), *sys.argv[2:]
    backwards = rest[-1:] == ["backwards"]
    never_run()
    shortcuts.take()
    for path in kernel_sources():
        importlib.import_module(".".join(["kinseek", *path.relative_to(PACKAGE).with_suffix("").parts]))
    # Compiling makes millions of objects that stay, and going through them again and again takes a tenth of the time.
    gc.set_threshold(100_000, 20, 50)
    known: list[Any] = [*jit.ROUTINES.values(), *entry.ENTRIES.values()]
    jobs = {f"{job.name}-{_digest(job)}": job for job in known}
    stems = "\n".join(f"{job.room} {stem}" for stem, job in jobs.items()).encode()
    rest = rest[: len(rest) - backwards]
    if first.isdecimal():
        places: list[tuple[Path, int, Target | None]] = [(folder, int(first), None)]
        jobs = {stem: job for stem, job in jobs.items() if not rest or job.room in rest}
    else:
        llvm.initialize_all_targets()
        llvm.initialize_all_asmprinters()
        targets = {name: TARGETS[name] for name in [first, *rest]}
        places = [(folder / name, level, one) for name, one in targets.items() for level in one.levels]
    for place, level, _ in places:
        place.mkdir(exist_ok=True)
        _put(place / f"{source_digest()}.{level}.names", stems)
    parent = os.getppid()
    for stem, job in reversed(jobs.items()) if backwards else jobs.items():
        if os.getppid() != parent:
            sys.exit("native/emit.py: the build that asked for kernels has ended")
        if _taken(places[0][0] / f"{stem}.{places[0][1]}.taken"):
            made = compiled(job)
            for place, level, target in places:
                name = f"{job.name}_l{level}"
                whole = linked(made, wrapper_of(job, made, name), name)
                data = _native_object(whole) if target is None else _foreign_object(whole, target, level)
                _put(place / f"{stem}.{level}.o", data)


def _digest(job: Any) -> str:
    """Of the sources that an object is made of."""
    kernel, wrapper = module_digest(job.function.__module__), module_digest(wrapper_of.__module__)
    return hashlib.sha256(f"{kernel} {wrapper}".encode()).hexdigest()[:16]


def _put(path: Path, data: bytes) -> None:
    """Write a file that is whole from the moment on at which it is there."""
    new = path.with_name(f"{path.name}.{os.getpid()}.new")
    new.write_bytes(data)
    new.rename(path)


def _taken(path: Path) -> bool:
    """Was a file made by this very process, and by no other before?"""
    try:
        path.touch(exist_ok=False)
    except FileExistsError:
        return False
    return True


def linked(made: Any, wrapper: str, name: str) -> Any:
    """A module of a compiled function and its wrapper, nothing else of which is visible."""
    code = made.library
    final = code._final_module
    whole = llvm.parse_assembly(wrapper)
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
    # Numba counts what it compiles, and writes the number into each name: two builds would not give the same bytes.
    inside = [one for one in [*whole.functions, *whole.global_variables] if one.linkage.name == "internal"]
    for number, one in enumerate(inside):
        one.name = f"part{number}"
    data: bytes = machine.emit_object(whole)
    return data


if __name__ == "__main__":
    main()
