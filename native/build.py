"""Compile the kernels before they are shipped: one library that needs neither Numba nor a compiler where it runs.

Numba types, lowers and optimises every entry (`kinseek.kernels.entry`) and every routine for one level of processors, as it
does when it compiles them for this machine. A wrapper that takes all arguments from a table of numbers goes beside each,
the object file is written as it is, and a C compiler links all of them with the door (``door.c``) and the little that
kernels ask of Numba's runtime (``runtime.c``). No optimisation runs a second time: the same bits as compiled on the spot.

    python native/build.py src/kinseek/kernels          # the library, for every level of this kind of processor
    python native/build.py OUT --levels 3
"""

from __future__ import annotations

import argparse
import os
import platform
import re
import runpy
import shutil
import subprocess
import sys
import sysconfig
import tempfile
import time
from pathlib import Path

HERE = Path(__file__).resolve().parent
SOURCE = HERE.parent / "src"
LEVELS = {
    "x86_64": {2: "x86-64-v2", 3: "x86-64-v3"},
    "aarch64": {1: "generic"},
}
"""Names that LLVM has for the levels of each kind of processor; x86-64-v4 was no faster than v3 where it was tried."""

ALIASES = {"amd64": "x86_64", "x64": "x86_64", "arm64": "aarch64"}


def main() -> None:
    """Build what the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folder", type=Path, help="where the library goes")
    parser.add_argument("--levels", type=int, nargs="*", help="levels of the processor; all by default")
    options = parser.parse_args()
    print(build(options.folder, options.levels))


def machine() -> str:
    """The kind of processor."""
    name = platform.machine().lower()
    return ALIASES.get(name, name)


def this_level() -> list[int]:
    """The highest level that this very processor runs; all where it cannot be told."""
    known = LEVELS.get(machine(), {})
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    except OSError:
        return list(known)
    flags = set(next((line for line in text.splitlines() if line.startswith("flags")), "").split())
    return [3] if 3 in known and {"avx2", "fma", "bmi1", "bmi2"} <= flags else list(known)[:1]


def platform_tag(library: Path) -> str:
    """Of a wheel with this library: the oldest glibc that has all it asks for, else the platform's own."""
    platform_name = sysconfig.get_platform().replace("-", "_").replace(".", "_")
    if not platform_name.startswith("linux"):
        return platform_name
    asked = re.findall(rb"GLIBC_(\d+)\.(\d+)", library.read_bytes())
    major, minor = max((int(a), int(b)) for a, b in asked)
    return f"manylinux_{major}_{minor}_{machine()}"


def is_current(library: Path, levels: list[int]) -> bool:
    """Was the library that is there made from these sources, for these levels?"""
    if not library.exists():
        return False
    content = library.read_bytes()
    return f"kinseek kernels {source_digest()} levels {' '.join(map(str, levels))};".encode() in content


def source_digest() -> str:
    """Of the sources as they are, see `kinseek.kernels.sources`."""
    digest: str = runpy.run_path(str(SOURCE / "kinseek" / "kernels" / "sources.py"))["source_digest"](
        SOURCE / "kinseek"
    )
    return digest


def build(folder: Path, levels: list[int] | None = None) -> Path:
    """Compile and link, unless the library that is there is current; return where it is.

    Raises:
        BuildError: There is no C compiler, this kind of processor is not known, or a step failed.
    """
    known = LEVELS.get(machine())
    if known is None:
        raise BuildError(f"no level is known for {machine()}, known are {', '.join(LEVELS)}")
    compiler = shutil.which(os.environ.get("CC", "cc")) or shutil.which("gcc") or shutil.which("clang")
    if compiler is None:
        raise BuildError("there is no C compiler (set CC, or install gcc or clang)")
    wanted = levels or list(known)
    if unknown := [level for level in wanted if level not in known]:
        raise BuildError(f"levels {unknown} are not known for {platform.machine()}, known are {list(known)}")
    library = folder / f"_prebuilt{'.pyd' if os.name == 'nt' else '.abi3.so'}"
    if is_current(library, wanted):
        return library
    with tempfile.TemporaryDirectory() as place:
        work = Path(place)
        _emit_all(work, wanted, known)
        table = _table(work, wanted)
        objects = sorted(map(str, work.glob("*.o")))
        hidden = ["-fvisibility=hidden", f"-I{sysconfig.get_path('include')}", f"-I{HERE}"]
        new = work / library.name
        sources = [str(HERE / "door.c"), str(HERE / "runtime.c"), str(table)]
        options = ["-O2", "-shared", "-fPIC", "-s", "-Wl,-Bsymbolic", "-Wl,--gc-sections", *hidden]
        _run([compiler, *options, *sources, *objects, "-lm", "-o", str(new)])
        folder.mkdir(parents=True, exist_ok=True)
        shutil.copy2(new, folder / (library.name + ".new"))
        os.replace(folder / (library.name + ".new"), library)
    return library


def _emit_all(work: Path, levels: list[int], known: dict[int, str]) -> None:
    """Have every entry and routine compiled: each process takes the next that nobody has taken, all of one level."""
    share = max(1, (os.cpu_count() or 1) // len(levels))
    running = []
    for level in levels:
        environment = os.environ | {
            "KINSEEK_JIT": "1",
            "NUMBA_CPU_NAME": known[level],
            "NUMBA_CPU_FEATURES": "",
            "NUMBA_DISABLE_JIT": "0",
            "NUMBA_CACHE_DIR": str(work / "cache"),
            # A build in an environment of its own finds Numba by this path too.
            "PYTHONPATH": os.pathsep.join(filter(None, (str(SOURCE), os.environ.get("PYTHONPATH")))),
            "PYTHONDONTWRITEBYTECODE": "1",
        }
        command = [sys.executable, str(HERE / "emit.py"), str(work), str(level)]
        running += [subprocess.Popen(command, env=environment) for _ in range(share)]
    began = time.monotonic()
    try:
        while any(one.poll() is None for one in running) and not any(one.poll() for one in running):
            time.sleep(0.2)
            _show(work, len(levels), time.monotonic() - began)
    finally:
        for one in running:
            one.terminate()
        sys.stderr.write("\n")
    if any(one.wait() for one in running):
        raise BuildError("the kernels could not be compiled, see above")


def _show(work: Path, levels: int, seconds: float) -> None:
    """Draw how many are done: in place in a terminal, now and then in a file."""
    lists = list(work.glob("names.?"))
    total = max([len(path.read_text().split()) for path in lists], default=0) * levels
    done = len(list(work.glob("*.o")))
    if sys.stderr.isatty() and total:
        bar = "#" * (30 * done // total)
        sys.stderr.write(f"\rkernels [{bar:30s}] {done} of {total}, {seconds:.0f} s ")
        sys.stderr.flush()


def _table(work: Path, levels: list[int]) -> Path:
    """Write down the symbols of all objects as C."""
    names = {level: (work / f"names.{level}").read_text().split() for level in levels}
    digest = source_digest()
    lines = ['#include "door.h"', ""]
    lines += [f"extern void {name}_l{level}(void);" for level in levels for name in names[level]]
    rows = [f'    {{"{name}", {level}, {name}_l{level}}},' for level in levels for name in names[level]]
    lines += ["", "const Symbol symbols[] = {", *rows, "    {0, 0, 0}};"]
    told = " ".join(map(str, levels))
    lines += [f'const char digest[] = "{digest}";', f'const char levels_built[] = "{told}";']
    lines += [f'const char made_of[] = "kinseek kernels {digest} levels {told};";', ""]
    path = work / "table.c"
    path.write_text("\n".join(lines))
    return path


def _run(command: list[str]) -> None:
    try:
        subprocess.run(command, check=True)
    except (OSError, subprocess.CalledProcessError) as error:
        raise BuildError(f"{command[0]} failed: {error}") from error


class BuildError(RuntimeError):
    """There is no library, and the message says why."""


if __name__ == "__main__":
    try:
        main()
    except BuildError as error:
        sys.exit(f"native/build.py: {error}")
