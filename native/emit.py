"""Compile entries and routines, and write an object file of each; several processes may run at once.

    emit.py FOLDER LEVEL [ROOM...] [backwards]    # for this machine, a level of its processor; some rooms, or all
    emit.py FOLDER TARGET... [backwards]          # for other machines (targets.py), every level, in a folder for each

`kinseek.kernels.machine_code` describes who optimises for which machine.
"""

from __future__ import annotations

import os

_PARENT = os.getppid()  # Before the imports, which take seconds: it may end meanwhile.
# ruff: noqa: E402

import gc
import hashlib
import importlib
import sys
from pathlib import Path
from typing import Any

# In an isolated build, pip removes the sources, which an editable install adds to the path.
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "src"))

import kinseek.kernels.away  # Before Numba, which would read a file of settings in the working folder.  # noqa: F401, I001

import llvmlite.binding as llvm
import shortcuts
from kept import keep
from targets import TARGETS, Target

from kinseek.kernels import entry, jit
from kinseek.kernels.machine_code import (
    machine_for,
    module_of,
    never_run,
    optimised_for,
    this_machine,
    without_unused,
)
from kinseek.kernels.sources import PACKAGE, kernel_sources, module_digest, source_digest


def main() -> None:
    """Compile each kernel that no other process has taken."""
    os.umask(0o077)  # Other builds use these files only if no other user can write to them.
    folder, first, *rest = Path(sys.argv[1]), *sys.argv[2:]
    backwards = rest[-1:] == ["backwards"]
    never_run()
    shortcuts.apply()
    for path in kernel_sources():
        importlib.import_module(".".join(["kinseek", *path.relative_to(PACKAGE).with_suffix("").parts]))
    # Compiling creates millions of objects that stay. Searching them for garbage took a twentieth of the time, and saved a
    # third of the memory.
    gc.disable()
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
        keep(place / f"{source_digest()}.{level}.names", stems)
    for stem, job in reversed(jobs.items()) if backwards else jobs.items():
        if os.getppid() != _PARENT:
            sys.exit("native/emit.py: the build that asked for kernels has ended")
        if _taken(places[0][0] / f"{stem}.{places[0][1]}.taken"):
            whole = module_of({job.name: job})
            for place, level, target in places:
                keep(place / f"{stem}.{level}.o", _object_of(whole, job.name, target, level))


def _digest(job: Any) -> str:
    """Return the digest of the sources of an object file."""
    kernel, wrapper = module_digest(job.function.__module__), module_digest(module_of.__module__)
    return hashlib.sha256(f"{kernel} {wrapper}".encode()).hexdigest()[:16]


def _taken(path: Path) -> bool:
    """Return whether this process has created the file, because it did not exist."""
    try:
        path.touch(exist_ok=False)
    except FileExistsError:
        return False
    return True


def _object_of(whole: Any, name: str, target: Target | None, level: int) -> bytes:
    """Return the object file of a module with one wrapper, whose name it gets with the level; no target is this machine."""
    if target is None:
        machine = this_machine(whole.triple)
    else:
        machine = machine_for(target.triple, target.levels[level])
        whole = optimised_for(whole, target.triple, machine)
    whole.get_function(name).name = f"{name}_l{level}"
    whole = without_unused(whole, machine)
    # Numba counts what it compiles, and the names contain the count: two builds would differ.
    inside = [each for each in [*whole.functions, *whole.global_variables] if each.linkage.name == "internal"]
    for number, each in enumerate(inside):
        each.name = f"part{number}"
    data: bytes = machine.emit_object(whole)
    return data


if __name__ == "__main__":
    main()
