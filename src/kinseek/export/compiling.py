"""Compilation of declared kernels for another processor, in a separate process: see `emit`."""

from __future__ import annotations

import json
import os
import platform
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import kinseek
from kinseek.errors import InvalidExport, MissingExtra
from kinseek.kernels import jit  # Not by name: naming its decorators marks a file of kernels.
from kinseek.kernels.entry import Entry

from .targets import Cpu, Target


def compiled(
    target: Target,
    cpu: Cpu,
    entries: Sequence[Entry],
    routines: Sequence[str],
    name: str,
    lanes: int = 1,
    sizes: Sequence[int] = (1, 1, 1, 1),
) -> tuple[dict[str, Any], bytes]:
    """Compile entries and routines, whose modules have been imported.

    Args:
        target: The target.
        cpu: Processor of the target.
        entries: Functions that may be called from outside.
        routines: Names of the routines that these call by address.
        name: Name of the output file, one of `controller.FORMS`.
        lanes: Number of leaves that a descent tabulates at once.
        sizes: Sizes for which the memory of a descent is made.

    Returns:
        The report of `emit`, and the file.

    Raises:
        MissingExtra: Numba is not installed.
        InvalidExport: The kernels could not be compiled.
    """
    if find_spec("numba") is None:
        raise MissingExtra("compiling the kernels for another processor", "jit")
    optimised = target.numba and platform.machine().lower() in ("x86_64", "amd64")
    functions = [*(each.function for each in entries), *(jit.ROUTINES[each].function for each in routines)]
    job = {
        "lanes": lanes,
        "sizes": list(sizes),
        "modules": list(dict.fromkeys(each.__module__ for each in functions)),
        "entries": [each.name for each in entries],
        "routines": list(routines),
        "triple": target.triple,
        "cpu": cpu.name,
        "features": cpu.features,
        "relocation": target.relocation,
        "abi": target.abi,
        "optimised": optimised,
        "file": name,
    }
    with tempfile.TemporaryDirectory(prefix="kinseek-export-") as place:
        work = Path(place)
        (work / "job.json").write_text(json.dumps(job), encoding="utf-8")
        package = str(Path(kinseek.__file__).parent.parent)
        environment = {
            each: value for each, value in os.environ.items() if not each.startswith(("NUMBA_", "KINSEEK_"))
        }
        environment |= {
            "KINSEEK_JIT": "1",
            "NUMBA_CPU_NAME": cpu.name if optimised else "generic",
            "NUMBA_CPU_FEATURES": "",
            "NUMBA_CACHE_DIR": str(work),
            # It searches for code where the program does, but not in the working folder of now, which relative or empty
            # entries would mean.
            "PYTHONPATH": os.pathsep.join([*filter(os.path.isabs, sys.path), package]),
        }
        if not optimised:
            environment["NUMBA_OPT"] = "0"
        command = [
            sys.executable,
            "-P",
            "-W",
            "ignore",
            str(Path(__file__).with_name("emit.py")),
            str(work / "job.json"),
        ]
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
        if done.returncode:
            last = (done.stderr.strip().splitlines() or ["no reason given"])[-1]
            raise InvalidExport(f"the kernels could not be compiled for {target.triple}, {cpu.name}: {last}")
        report: dict[str, Any] = json.loads((work / "report.json").read_text(encoding="utf-8"))
        return report, (work / name).read_bytes()
