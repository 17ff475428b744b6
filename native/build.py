"""Build the library of compiled kernels, which needs neither Numba nor a compiler where it runs.

Processes of ``emit.py`` compile every entry (`kinseek.kernels.entry`) and every routine for one level of processors, and
write an object file of each. A C compiler links these files with ``door.c``, which Python calls, and with ``runtime.c``, the
part of Numba's runtime that kernels need. It optimises nothing, so results have the same bits as with kernels that Numba
compiles on first call.

    python native/build.py src/kinseek/kernels          # the library, for the level of this processor
    python native/build.py OUT --levels 2 3             # for other levels; for all levels if none is named
    python native/build.py OUT --rooms paths            # some folders of kernels, and those that the library there has
    python native/build.py OUT --target aarch64-linux-gnu arm64-apple-darwin    # for other machines, a folder for each

Libraries for other machines are linked by ``zig cc`` (ziglang on PyPI), see docs/building.md.
"""

from __future__ import annotations

import argparse
import functools
import hashlib
import importlib.metadata
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
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, TextIO

try:
    import fcntl
except ImportError:  # Windows.
    fcntl = None  # type: ignore[assignment]

HERE = Path(__file__).resolve().parent
SOURCE = HERE.parent / "src"
MACHINES: dict[str, Any] = runpy.run_path(str(HERE / "targets.py"))
TARGETS: dict[str, Any] = MACHINES["TARGETS"]
LEVELS: dict[str, dict[int, str]] = MACHINES["LEVELS"]
COMPILING: dict[str, str] = MACHINES["COMPILING"]
OUTSIDE: dict[str, Any] = runpy.run_path(str(HERE / "outside.py"))
KEPT: dict[str, Any] = runpy.run_path(str(HERE / "kept.py"))
SOURCES: dict[str, Any] = runpy.run_path(str(SOURCE / "kinseek" / "kernels" / "sources.py"))
ALL: str = SOURCES["ALL"]
PRIVATE: dict[str, Any] = runpy.run_path(str(SOURCE / "kinseek" / "support" / "private.py"))
PRINTABLE: dict[str, Any] = runpy.run_path(str(SOURCE / "kinseek" / "printable.py"))

FIRST = ("arm", "structure", "atlas")
"""Folders of kernels that `Arm.fk` and `Arm.ik` need. An editable install has only these, and compiles others on their first
call."""

MONTH = 30 * 24 * 3600.0
"""How long unused object files are kept [s]."""

ALIASES = {"amd64": "x86_64", "x64": "x86_64", "arm64": "aarch64"}


def main() -> None:
    """Build what the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folder", type=Path, help="where the library goes")
    parser.add_argument(
        "--levels",
        type=int,
        nargs="*",
        help="levels of the processor: the level of this one by default, all if none is named",
    )
    parser.add_argument("--rooms", nargs="*", default=(), help="folders of kernels; all by default")
    parser.add_argument("--target", nargs="+", choices=TARGETS, help="build for other machines, every level")
    parser.add_argument(
        "--keep", type=Path, help="where object files for other machines stay; a second run takes them"
    )
    options = parser.parse_args()
    if not options.target:
        levels = this_level() if options.levels is None else options.levels
        print(build(options.folder, levels, options.rooms))
    elif options.levels or options.rooms:
        parser.error("--target builds every level, and every room")
    else:
        for path in build_for(options.folder, options.target, options.keep):
            print(path, platform_tag(path, path.parent.name))


def machine() -> str:
    """Return the kind of this processor."""
    name = platform.machine().lower()
    return ALIASES.get(name, name)


def this_level() -> list[int]:
    """Return the highest level that this processor runs, or all levels if its features are unknown."""
    known = LEVELS.get(machine(), {})
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    except OSError:
        return list(known)
    flags = set(next((line for line in text.splitlines() if line.startswith("flags")), "").split())
    third = {"avx2", "fma", "bmi1", "bmi2"}
    fourth = third | {"avx512f", "avx512dq", "avx512cd", "avx512bw", "avx512vl"}
    best = 4 if fourth <= flags else 3 if third <= flags else 0
    return [best] if best in known else list(known)[:1]


def platform_tag(library: Path, target: str = "") -> str:
    """Return the platform tag of a wheel with this library.

    On Linux it names the oldest glibc that has all symbols of the library, but at least 2.17, the oldest still in use.
    """
    platform_name = sysconfig.get_platform().replace("-", "_").replace(".", "_")
    processor = machine()
    if target:
        platform_name, processor = TARGETS[target].tag or "linux", TARGETS[target].processor
    asked = re.findall(rb"GLIBC_(\d+)\.(\d+)", library.read_bytes())
    if not platform_name.startswith("linux") or not asked:
        return platform_name
    major, minor = max((2, 17), *((int(a), int(b)) for a, b in asked))
    return f"manylinux_{major}_{minor}_{processor}"


def rooms_in(library: Path, levels: list[int]) -> set[str]:
    """Return the folders of kernels in an existing library; none if it has other sources or other levels."""
    if not library.exists():
        return set()
    found = re.search(re.escape(made_of(levels).encode()) + rb" rooms ([a-z ]+);", library.read_bytes())
    return set(found[1].decode().split()) if found else set()


def has_rooms(there: set[str], rooms: Iterable[str]) -> bool:
    """Return whether a library has some folders of kernels, or all of them if none is named."""
    return ALL in there or (bool(rooms) and there.issuperset(rooms))


def made_of(levels: list[int]) -> str:
    """Return a text that identifies the sources of a library: digests of the kernels and of this folder, and the levels."""
    own = _digest_of(*sorted(path.name for path in HERE.glob("*.[cph]*")))
    return f"kinseek kernels {source_digest()} by {own} levels {' '.join(map(str, levels))}"


def _digest_of(*names: str) -> str:
    """Return the digest of some files of this folder."""
    return hashlib.sha256(b"".join((HERE / name).read_bytes() for name in names)).hexdigest()[:16]


def _cache() -> str:
    """Return where object files for this machine are kept: KINSEEK_OBJECTS, else the user's cache."""
    user: str = PRIVATE["user_cache"]()
    return os.environ.get("KINSEEK_OBJECTS") or os.path.join(os.path.expanduser(user), "kinseek", "objects")


@contextmanager
def _alone(work: Path) -> Iterator[None]:
    """Let a second build wait for the first one, which has marked kernels as taken that are not finished yet."""
    if fcntl is None:
        yield
        return
    # With some umasks others could write to a new file, and then `_objects` would reject the folder.
    with open(os.open(work / "lock", os.O_WRONLY | os.O_CREAT, 0o600), "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


@contextmanager
def _alone_into(folder: Path) -> Iterator[None]:
    """Let a second build into a folder wait for the first one, so that it keeps the rooms of that one's library."""
    if fcntl is None:
        yield
        return
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        with suppress(OSError):  # NFS locks no folder.
            fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)


def _put(new: Path, library: Path) -> None:
    """Replace a library atomically: on systems without locks another build may do the same at this moment."""
    descriptor, name = tempfile.mkstemp(suffix=".new", prefix=f"{library.name}.", dir=library.parent)
    os.close(descriptor)
    try:
        shutil.copyfile(new, name)
        # Despite the umask, no other user may write to a file that every process loads.
        os.chmod(name, 0o755)
        os.replace(name, library)
    except BaseException:  # Includes Ctrl-C.
        os.unlink(name)
        raise


def _forget(work: Path) -> None:
    """Remove files that no build has written or used for a month; files of the present sources count as used."""
    for level in {path.name.split(".")[1] for path in work.glob("*.names")}:
        for path in _wanted(work, int(level), []):
            for one in (path, path.with_suffix(".taken")):
                if one.exists():
                    os.utime(one)
    for path in [*work.glob("*.*"), *work.glob("cache/*/*/*/*")]:
        if path.is_file() and path.stat().st_mtime < time.time() - MONTH:
            path.unlink(missing_ok=True)


def _objects(keep: str | Path | None, place: str) -> Path:
    """Return the folder for object files: a folder of this compiler below `keep`, or `place`.

    Files in it become part of the library. So a folder in which other users can change something is not used; one line on
    stderr reports that.
    """
    if not keep:
        return Path(place)
    versions = [importlib.metadata.version(each) for each in ("numba", "llvmlite")]
    # Object files depend neither on this file nor on door.c.
    name = "-".join([_digest_of("emit.py", "kept.py", "shortcuts.py", "targets.py"), *versions])
    try:
        work: Path = PRIVATE["private_folder"](Path(keep), name)
        for path in work.rglob("*"):
            if path.is_symlink():
                raise PRIVATE["NotPrivate"](f"{path} is a link")
            PRIVATE["require_private"](path, path.lstat())
    except OSError as error:  # NotPrivate is one; a full disk and a home without room for it are others.
        why = PRINTABLE["printable"](str(error))
        print(f"native/build.py: compiling every kernel and keeping none, for {why}", file=sys.stderr)
        return Path(place)
    return work


@functools.cache
def source_digest() -> str:
    """Return the digest of the kernels' sources at the time of the first call, see `kinseek.kernels.sources`."""
    digest: str = SOURCES["source_digest"](SOURCE / "kinseek")
    return digest


def build(folder: Path, levels: list[int] | None = None, rooms: Iterable[str] = ()) -> Path:
    """Compile and link, unless the existing library is current; return its path.

    Args:
        folder: Where the library goes.
        levels: Levels of the processor; all by default.
        rooms: Folders of kernels, all by default. An existing library of the same sources keeps its other folders.

    Raises:
        BuildError: There is no C compiler, the kind of processor or a folder is unknown, or a step failed.
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
    known_rooms = {path.parent.name for path in SOURCES["kernel_sources"](SOURCE / "kinseek")}
    if unknown_rooms := set(rooms) - known_rooms:
        raise BuildError(f"rooms {sorted(unknown_rooms)} are not known, known are {sorted(known_rooms)}")
    library = folder / f"_prebuilt{'.pyd' if os.name == 'nt' else '.abi3.so'}"
    if has_rooms(rooms_in(library, wanted), rooms):
        return library
    folder.mkdir(parents=True, exist_ok=True)
    with (
        tempfile.TemporaryDirectory() as place,
        _alone(work := _objects(_cache(), place)),
        _alone_into(folder),
    ):
        if has_rooms(there := rooms_in(library, wanted), rooms):  # Another build has made it in the meantime.
            return library
        some = sorted({*rooms, *there}) if rooms else []
        _emit_all(work, wanted, known, some)
        _forget(work)
        table = _table(work, wanted, some, Path(place))
        objects = _unpacked([path for level in wanted for path in _wanted(work, level, some)], Path(place))
        hidden = ["-fvisibility=hidden", f"-I{sysconfig.get_path('include')}", f"-I{HERE}"]
        new = Path(place) / library.name
        sources = [str(HERE / "door.c"), str(HERE / "runtime.c"), str(table)]
        bound = ["-s", "-Wl,-Bsymbolic", "-Wl,--gc-sections"]
        if sys.platform == "darwin":
            bound = list(TARGETS["arm64-apple-darwin"].options)
        options = ["-O2", "-shared", "-fPIC", *bound, *hidden]
        if platform.libc_ver()[0] == "glibc" and machine() in LEVELS:
            options += ["-DWRAP_POW", "-Wl,--wrap=pow"]  # See runtime.c.
        _run([compiler, *options, *sources, *map(str, objects), "-lm", "-o", str(new)])
        _put(new, library)
    return library


def build_for(folder: Path, targets: list[str], keep: Path | None = None) -> list[Path]:
    """Compile for other machines and link; return the libraries, each in a folder named after its target.

    If no linker for a target is known (``x86_64-pc-windows-msvc``), its folder gets the object files and their table.

    Raises:
        BuildError: A step failed.
    """
    made = []
    with tempfile.TemporaryDirectory() as place:
        work = _objects(keep, place)
        _emit_foreign(work, targets)
        for name in targets:
            target, at = TARGETS[name], folder / name
            at.mkdir(parents=True, exist_ok=True)
            (into := Path(place) / "tables" / name).mkdir(parents=True)
            table = _table(work / name, list(target.levels), [], into)
            wanted = [path for level in target.levels for path in _wanted(work / name, level, [])]
            objects = _unpacked(wanted, into)
            if target.linker:
                made.append(
                    _link_foreign(at / f"_prebuilt{target.suffix}", target, table, objects, Path(place))
                )
            else:
                for path in [table, *objects]:
                    shutil.copy2(path, at)
    return made


def _link_foreign(library: Path, target: Any, table: Path, objects: list[Path], work: Path) -> Path:
    """Compile ``door.c`` for another machine and link, with the C compiler of ziglang."""
    zig = [sys.executable, "-m", "ziglang"]
    include = [
        "-include",
        str(HERE / "foreign_pyconfig.h"),
        f"-I{sysconfig.get_path('include')}",
        f"-I{HERE}",
    ]
    new, against = work / f"{target.linker}{target.suffix}", []
    if target.windows:
        # Linking needs only the names, and no Python for Windows.
        data = [f"    {name} DATA" for name in OUTSIDE["PYTHON_DATA"]]
        names = ["LIBRARY python3.dll", "EXPORTS", *(f"    {name}" for name in OUTSIDE["PYTHON"]), *data, ""]
        (work / "python3.def").write_text("\n".join(names))
        against = [str(work / "python3.lib")]
        _run([*zig, "dlltool", "-m", "i386:x86-64", "-d", str(work / "python3.def"), "-l", against[0]])
    options = [
        "-target",
        target.linker,
        "-O2",
        "-shared",
        "-fPIC",
        "-s",
        "-fvisibility=hidden",
        *target.options,
    ]
    sources = [str(HERE / "door.c"), str(HERE / "runtime.c"), str(table)]
    _run([*zig, "cc", *options, *include, *sources, *map(str, objects), *against, "-lm", "-o", str(new)])
    _put(new, library)
    return library


def _emit_foreign(work: Path, targets: list[str]) -> None:
    """Run processes that lower every kernel once and write its machine code for every target."""
    places = [(work / name, level) for name in targets for level in TARGETS[name].levels]
    _take_up(places, [])
    environment = _environment(work, MACHINES["COMPILING_FOR_OTHERS"])
    running = _start([str(work), *targets], environment, os.cpu_count() or 1)
    _wait(running, places, [])


def _wanted(place: Path, level: int, rooms: list[str]) -> list[Path]:
    """Return the paths of the object files of some folders for a level, none before their names are known."""
    names = place / f"{source_digest()}.{level}.names"
    known = [line.split() for line in (KEPT["kept"](names) or b"").decode().splitlines()]
    return [place / f"{stem}.{level}.o" for room, stem in known if not rooms or room in rooms]


def _unpacked(objects: list[Path], into: Path) -> list[Path]:
    """Copy object files that are kept into a folder, ready to be linked; return the paths of the copies.

    Raises:
        BuildError: One is missing or damaged; the next build compiles it anew.
    """
    copies = []
    for path in objects:
        data = KEPT["kept"](path)
        if data is None:
            raise BuildError(f"{PRINTABLE['printable'](str(path))} is missing or damaged: build again")
        copies.append(into / path.name)
        copies[-1].write_bytes(data)
    return copies


def _take_up(places: list[tuple[Path, int]], rooms: list[str]) -> bool:
    """Remove damaged files, and unmark kernels that an earlier run took and did not finish.

    Returns:
        Whether any kernel is left to compile.
    """
    first, level = places[0]
    for place, each in places:
        for path in [*place.glob(f"*.{each}.names"), *place.glob(f"*.{each}.o")]:
            if KEPT["kept"](path) is None:
                path.unlink()
    for mark in first.glob(f"*.{level}.taken"):
        if not all((place / f"{mark.name.split('.')[0]}.{each}.o").exists() for place, each in places):
            mark.unlink()
    wanted = [path for each in places for path in _wanted(*each, rooms)]
    return not wanted or not all(path.exists() for path in wanted)


def _environment(work: Path, asked: dict[str, str]) -> dict[str, str]:
    """Return the environment of a process that compiles."""
    return (
        os.environ
        | {
            "NUMBA_CACHE_DIR": str(work / "cache"),
            # An isolated build environment also finds Numba by this path.
            "PYTHONPATH": os.pathsep.join(filter(None, (str(SOURCE), os.environ.get("PYTHONPATH")))),
        }
        | COMPILING
        | asked
    )


def _emit_all(work: Path, levels: list[int], known: dict[int, str], rooms: list[str]) -> None:
    """Compile every entry and routine of some folders for each level that is not complete yet."""
    undone = [level for level in levels if _take_up([(work, level)], rooms)]
    share = max(1, (os.cpu_count() or 1) // max(1, len(undone)))
    running = []
    for level in undone:
        environment = _environment(work, {"NUMBA_CPU_NAME": known[level]})
        running += _start([str(work), str(level), *rooms], environment, share)
    _wait(running, [(work, level) for level in undone], rooms)


def _start(words: list[str], environment: dict[str, str], count: int) -> list[subprocess.Popen[bytes]]:
    """Start processes, each of which compiles the next kernel that none has taken.

    Every second process begins at the end of the list. Neighbours have many parts in common, and so most parts are compiled
    by one process only.
    """
    command = [sys.executable, str(HERE / "emit.py"), *words]
    ends: tuple[list[str], ...] = ([], ["backwards"])
    return [subprocess.Popen([*command, *ends[i % 2]], env=environment) for i in range(count)]


def _wait(running: list[subprocess.Popen[bytes]], places: list[tuple[Path, int]], rooms: list[str]) -> None:
    """Wait until all processes have ended, and show their progress if there is a terminal."""
    began = time.monotonic()
    with _screen() as screen:
        try:
            while any(one.poll() is None for one in running) and not any(one.poll() for one in running):
                time.sleep(0.2)
                _show(
                    screen,
                    [path for place in places for path in _wanted(*place, rooms)],
                    time.monotonic() - began,
                )
        finally:
            for one in running:
                one.terminate()
            screen.write("\r\x1b[K")
    if any(one.wait() for one in running):
        raise BuildError("the kernels could not be compiled, see above")


def _screen() -> TextIO:
    """Return the terminal of this process, or the null device. pip does not show the output of a build."""
    try:
        screen = open("/dev/tty", "w", encoding="utf-8")  # noqa: SIM115  # The caller closes it.
        if os.tcgetpgrp(screen.fileno()) == os.getpgrp():
            return screen
        screen.close()  # This is a background job.
    except OSError:
        pass
    return open(os.devnull, "w", encoding="utf-8")


def _show(screen: TextIO, wanted: list[Path], seconds: float) -> None:
    """Show how many object files are finished, in place."""
    total, done = len(wanted), sum(path.exists() for path in wanted)
    if total:
        bar = "#" * (30 * done // total)
        screen.write(f"\rkinseek: compiling kernels [{bar:30s}] {done} of {total}, {seconds:.0f} s ")
        screen.flush()


def _table(work: Path, levels: list[int], rooms: list[str], into: Path) -> Path:
    """Write a C file with the table of the symbols of some folders' object files; return its path."""
    names = {level: [path.name.partition("-")[0] for path in _wanted(work, level, rooms)] for level in levels}
    digest, named = source_digest(), " ".join(rooms or [ALL])
    lines = ['#include "door.h"', ""]
    lines += [f"extern void {name}_l{level}(void);" for level in levels for name in names[level]]
    rows = [f'    {{"{name}", {level}, {name}_l{level}}},' for level in levels for name in names[level]]
    lines += ["", "const Symbol symbols[] = {", *rows, "    {0, 0, 0}};"]
    built = " ".join(map(str, levels))
    lines += [f'const char digest[] = "{digest}";', f'const char levels_built[] = "{built}";']
    lines += [f'const char rooms_built[] = "{named}";']
    lines += [f'const char made_of[] = "{made_of(levels)} rooms {named};";', ""]
    path = into / "table.c"
    path.write_text("\n".join(lines))
    return path


def _run(command: list[str]) -> None:
    try:
        subprocess.run(command, check=True)
    except (OSError, subprocess.CalledProcessError) as error:
        raise BuildError(f"{command[0]} failed: {error}") from error


class BuildError(RuntimeError):
    """The library was not built; the message says why."""


if __name__ == "__main__":
    try:
        main()
    except BuildError as error:
        sys.exit(f"native/build.py: {error}")
