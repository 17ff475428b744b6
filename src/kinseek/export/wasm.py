"""The kernels as one WebAssembly module, the same for every arm; zig links it."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path

from kinseek.errors import InvalidExport, MissingExtra
from kinseek.kernels.atlas.task import ROUTINE
from kinseek.kernels.entry import ENTRIES

from .compiling import compiled
from .targets import TARGETS

CALLED = (
    "ks_write_poses",
    "ks_fill_atlas",
    "ks_fill_steps",
    "ks_solve_plain",
    "ks_solve_goal",
    "ks_many_branches",
    "ks_search_boxes",
)
"""Entries that JavaScript calls."""

PLACES = {
    f"ks_{name}_routine": ROUTINE.first[name] for name in ("iterate", "search", "ending", "closed", "far")
}
"""Routines that kernels call, and the positions of their addresses in a task."""

RUNTIME = Path(__file__).parent / "js" / "runtime.c"
"""Memory management for the kernels."""


def wasm_module(notice: Callable[[str], object] = lambda words: None) -> bytes:
    """Compile and link the kernels.

    Args:
        notice: Called with a message when compilation begins.

    Raises:
        MissingExtra: Numba or ziglang is not installed.
        InvalidExport: They cannot be compiled or linked.
    """
    if find_spec("ziglang") is None:
        raise MissingExtra("linking WebAssembly", "wasm")
    target = TARGETS["wasm32"]
    entries = [ENTRIES[name] for name in CALLED]
    notice(f"compiling the kernels for {target.triple} (some minutes) ...")
    _, kernels = compiled(target, target.cpus[0], entries, list(PLACES), "kernels.o")
    exports = [f"-Wl,--export={name}" for name in (*CALLED, *PLACES, "malloc", "free")]
    command = [
        sys.executable,
        "-m",
        "ziglang",
        "cc",
        "-target",
        "wasm32-wasi",
        "-mexec-model=reactor",
        "-O2",
        "-s",
    ]
    # Kernels call each other by address: JavaScript puts the callable ones into the table of functions.
    command += [
        "-Wl,--no-entry",
        "-Wl,--export-table",
        "-Wl,--growable-table",
        "-Wl,-z,stack-size=1048576",
        *exports,
    ]
    with tempfile.TemporaryDirectory(prefix="kinseek-wasm-") as place:
        (Path(place) / "kernels.o").write_bytes(kernels)
        command += [str(RUNTIME), "kernels.o", "-o", "kinseek.wasm"]
        done = subprocess.run(command, cwd=place, capture_output=True, text=True, check=False)
        if done.returncode:
            raise InvalidExport(f"the kernels could not be linked: {done.stderr.strip()}")
        return (Path(place) / "kinseek.wasm").read_bytes()
