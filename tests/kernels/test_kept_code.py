"""Files of compiled kernels that are damaged, or cannot be written: the kernels run all the same, and one line says why."""

from __future__ import annotations

import hashlib
import os
import shutil
import signal
import stat
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

import kinseek

pytestmark = [pytest.mark.slow, pytest.mark.jit]

PACKAGE = Path(kinseek.__file__).parent

TINY = """
from .jit import kernel
from .pointers import routine

@kernel
def double(x: float) -> float:
    return 2.0 * x

@routine
def triple(x: int) -> int:
    return 3 * x
"""

CALL = """
import ctypes
from kinseek.kernels.tiny import double, triple
print(double(21.0), ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_int64)(triple.address)(14))
"""

COMPILES = "kinseek: compiling kernels, once per machine"
DAMAGED = "kinseek: compiling kernels anew, for their cache is damaged"
DISTRUSTED = "kinseek: compiling kernels anew, for others may have changed their cache"
UNWRITTEN = "kinseek: doing without a cache of compiled kernels"


@pytest.fixture(name="warm", scope="module")
def _warm(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the package with two kernels that compile in no time, and a cache that holds them."""
    folder = tmp_path_factory.mktemp("warm")
    shutil.copytree(PACKAGE, folder / "site" / "kinseek", ignore=shutil.ignore_patterns("__pycache__"))
    (folder / "site" / "kinseek" / "kernels" / "tiny.py").write_text(TINY, encoding="utf-8")
    assert COMPILES in run(folder, folder / "cache")
    return folder


@pytest.fixture(name="cache")
def _cache(warm: Path, tmp_path: Path) -> Path:
    """A cache of one's own, as `warm` left it."""
    shutil.copytree(warm / "cache", tmp_path / "cache")
    return tmp_path / "cache"


def start(folder: Path, cache: Path, before: str = "", first: str = "") -> subprocess.Popen[str]:
    """Run `CALL` in a process, after `before`; a program `first` starts that process, if it is given."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith("NUMBA_")}
    environment |= {"PYTHONPATH": str(folder / "site"), "XDG_CACHE_HOME": str(cache)}
    # Nowhere else to go: a cache that does not work must not be hidden by the one after it.
    program = f"import tempfile; tempfile.tempdir = '/proc/nowhere'\n{before}{CALL}"
    return subprocess.Popen(
        [sys.executable, *(["-c", first] if first else []), "-c", program],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def run(folder: Path, cache: Path, before: str = "", first: str = "") -> str:
    """What it says on stderr; the result is right."""
    process = start(folder, cache, before, first)
    out, said = process.communicate()
    assert process.returncode == 0, said
    assert out == "42.0 42\n"
    return said


def cut_short(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def cut_by_one(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-1])


def empty(path: Path) -> None:
    path.write_bytes(b"")


def zeros(path: Path) -> None:
    path.write_bytes(bytes(path.stat().st_size))


def garbage(path: Path) -> None:
    path.write_bytes(b"\x80\x05\x8c\x05hello" * 100)


def one_bit(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)


DAMAGES: list[tuple[Callable[[Path], None], str]] = [
    (cut_short, "nbi"),
    (empty, "nbi"),
    (one_bit, "nbi"),
    (cut_short, "nbc"),
    (cut_by_one, "nbc"),
    (zeros, "nbc"),
    (garbage, "nbc"),
    (one_bit, "nbc"),
]
"""Of the index of a kernel, and of its machine code."""


@pytest.mark.parametrize(("damage", "ending"), DAMAGES)
def test_a_damaged_file_is_compiled_anew_and_replaced(
    warm: Path, cache: Path, damage: Callable[[Path], None], ending: str
) -> None:
    files = list(cache.rglob(f"tiny.*.{ending}"))
    assert len(files) == 3  # Of a kernel; of a routine, and of the kernel that it calls.
    for path in files:
        damage(path)
    said = run(warm, cache)
    assert said.count(DAMAGED) == 1
    assert said.count("\n") == 2
    assert COMPILES in said
    assert run(warm, cache) == ""


@pytest.mark.parametrize("name", ["tiny.double", "tiny.triple"])
def test_machine_code_that_is_missing_is_compiled_anew(warm: Path, cache: Path, name: str) -> None:
    next(cache.rglob(f"{name}*.nbc")).unlink()
    assert DAMAGED not in run(warm, cache)
    assert run(warm, cache) == ""


def test_machine_code_of_another_call_is_not_run(warm: Path, cache: Path) -> None:
    """Two processes that compile the same kernel for two kinds of calls may both take the first number."""
    double, triple = (next(cache.rglob(f"tiny.{name}*.nbc")) for name in ("double", "triple"))
    shutil.copyfile(triple, double)
    assert DAMAGED not in run(warm, cache)
    assert run(warm, cache) == ""


@pytest.mark.parametrize("ending", ["nbi", "nbc"])
def test_what_can_neither_be_read_nor_replaced_is_done_without(warm: Path, cache: Path, ending: str) -> None:
    for path in cache.rglob(f"tiny.*.{ending}"):
        path.unlink()
        path.mkdir()
    for _ in range(2):
        said = run(warm, cache)
        assert said.count(DAMAGED) == said.count(UNWRITTEN) == 1
        assert said.count("\n") == 3


@pytest.mark.skipif(not hasattr(os, "getuid") or os.getuid() == 0, reason="root may read everything")
def test_files_without_permission_are_replaced(warm: Path, cache: Path) -> None:
    for path in cache.rglob("tiny.*"):
        path.chmod(0)
    assert run(warm, cache).count(DAMAGED) == 1
    assert run(warm, cache) == ""


def plant(path: Path, mark: Path) -> None:
    """Write a file that says who was here when it is read as machine code; its digest is right."""
    code = f"__import__('pathlib').Path({str(mark)!r}).touch()".encode()
    data = b"c__builtin__\neval\n(V" + code + b"\ntR."
    path.write_bytes(hashlib.sha256(data).digest() + data)
    path.chmod(0o600)


def test_what_is_planted_would_run(warm: Path, cache: Path, tmp_path: Path) -> None:
    """By who has the user's rights, and so needs no cache for it: the other tests of what is planted are able to fail."""
    for path in cache.rglob("tiny.*.nbc"):
        plant(path, tmp_path / "mark")
    run(warm, cache)
    assert (tmp_path / "mark").exists()


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="needs POSIX permissions")
@pytest.mark.parametrize("ending", ["nbi", "nbc"])
@pytest.mark.parametrize("how", ["a link", "others may write to it", "it belongs to another user"])
def test_a_planted_file_is_neither_run_nor_kept(
    warm: Path, cache: Path, tmp_path: Path, ending: str, how: str
) -> None:
    if how == "it belongs to another user" and os.getuid() != 0:
        pytest.skip("only root gives files away")
    plant(tmp_path / "planted", tmp_path / "mark")
    for path in cache.rglob(f"tiny.*.{ending}"):
        if how == "a link":
            path.unlink()
            path.symlink_to(tmp_path / "planted")
            continue
        plant(path, tmp_path / "mark")
        if how == "others may write to it":
            path.chmod(0o660)
        else:
            os.chown(path, 65534, 65534)
    said = run(warm, cache)
    assert not (tmp_path / "mark").exists()
    assert said.count(DISTRUSTED) == 1
    assert said.count("\n") == 2
    assert run(warm, cache) == ""


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="needs POSIX permissions")
def test_a_folder_that_is_swapped_while_kinseek_runs_is_not_read(
    warm: Path, cache: Path, tmp_path: Path
) -> None:
    """What is looked at and what is read later are one folder, though a link on the way leads elsewhere by then."""
    planted = tmp_path / "planted"
    shutil.copytree(cache, planted)
    for path in planted.rglob("tiny.*.nb?"):
        plant(path, tmp_path / "mark")
    link = tmp_path / "link"
    link.symlink_to(cache)
    swap = f"""
import kinseek.kernels.compiler
from pathlib import Path
Path({str(link)!r}).unlink()
Path({str(link)!r}).symlink_to({str(planted)!r})
"""
    said = run(warm, link, swap)
    assert not (tmp_path / "mark").exists()
    assert said == ""


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="needs POSIX permissions")
@pytest.mark.parametrize("how", ["a link", "group-writable", "in a folder that others may write to"])
def test_a_folder_that_others_could_have_filled_is_not_used(
    warm: Path, cache: Path, tmp_path: Path, how: str
) -> None:
    for path in cache.rglob("tiny.*.nb?"):
        plant(path, tmp_path / "mark")
    if how == "a link":
        (cache / "kinseek").rename(cache / "elsewhere")
        (cache / "kinseek").symlink_to("elsewhere")
    elif how == "group-writable":
        (cache / "kinseek").chmod(0o770)
    else:
        cache.chmod(0o777)
    said = run(warm, cache)
    assert not (tmp_path / "mark").exists()
    assert said.count(UNWRITTEN) == 1
    assert COMPILES in said
    assert said.count("\n") == 2


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="needs POSIX permissions")
def test_the_name_of_a_folder_is_printed_with_escapes(warm: Path, tmp_path: Path) -> None:
    (shared := tmp_path / "\x1b]0;owned\x07").mkdir()
    shared.chmod(0o777)
    said = run(warm, shared)
    assert UNWRITTEN in said
    assert "\\x1b]0;owned\\x07" in said
    assert said.replace("\n", "").isprintable()


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs a device that is always full")
@pytest.mark.parametrize("descriptor", ["os.close(2)", "os.dup2(os.open('/dev/full', os.O_WRONLY), 2)"])
def test_a_stderr_that_accepts_nothing_changes_no_result(warm: Path, tmp_path: Path, descriptor: str) -> None:
    (shared := tmp_path / "shared").mkdir()
    shared.chmod(0o777)  # A cache that others may write to is reported on stderr.
    program = f"import os, sys; {descriptor}; os.execv(sys.executable, [sys.executable, *sys.argv[1:]])"
    assert run(warm, shared, first=program) == ""


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="needs POSIX permissions")
@pytest.mark.parametrize("umask", ["0o002", "0o000"])
def test_the_cache_is_private_and_serves_whatever_the_umask(warm: Path, tmp_path: Path, umask: str) -> None:
    home = tmp_path / "home"
    before = f"import os; os.umask({umask})\n"
    assert COMPILES in run(warm, home / "cache", before)
    assert run(warm, home / "cache", before) == ""
    modes = {(path.is_dir(), stat.S_IMODE(path.lstat().st_mode)) for path in [home, *home.rglob("*")]}
    assert modes == {(True, 0o700), (False, 0o600)}


FULL = """
import resource
resource.setrlimit(resource.RLIMIT_FSIZE, (100, 100))  # Every write beyond this fails, as on a full disk.
"""

FULL_IN_NUMBA = """
import errno, numba.core.caching as caching
class Full:
    def __init__(self, *_): raise OSError(errno.ENOSPC, "No space left on device")
caching.open = Full
"""


@pytest.mark.parametrize("full", [FULL, FULL_IN_NUMBA], ids=["writes fail", "nothing can be opened"])
def test_a_full_disk_is_done_without(warm: Path, tmp_path: Path, full: str) -> None:
    pytest.importorskip("resource")
    cache = tmp_path / "cache"
    for _ in range(2):
        said = run(warm, cache, full)
        assert said.count(UNWRITTEN) == 1
        assert COMPILES in said
        assert said.count("\n") == 2
    assert not [path for path in cache.rglob("*") if path.is_file() and path.stat().st_size > 100]
    assert COMPILES in run(warm, cache)
    assert run(warm, cache) == ""


def test_a_folder_that_breaks_while_kernels_are_defined_is_not_replaced_by_the_sources(
    warm: Path, tmp_path: Path
) -> None:
    """Numba would go on to the folder of the sources, where no digest guards against stale code."""
    broken = """
import kinseek.kernels.compiler as compiler
folder = compiler._CACHE
folder.rename(folder.with_name("gone"))
folder.write_text("")
"""
    said = run(warm, tmp_path / "cache", broken)
    assert said.count(UNWRITTEN) == 1
    assert not list((warm / "site").rglob("*.nb?"))


def test_a_locator_that_the_user_sets_for_other_code_does_not_move_ours(warm: Path, tmp_path: Path) -> None:
    setting = "import os; os.environ['NUMBA_CACHE_LOCATOR_CLASSES'] = 'InTreeCacheLocator'\n"
    run(warm, tmp_path / "cache", setting)
    assert not list((warm / "site").rglob("*.nb?"))
    assert list((tmp_path / "cache").rglob("tiny.*.nbc"))


def test_two_processes_at_once(warm: Path, tmp_path: Path) -> None:
    both = [start(warm, tmp_path / "cache") for _ in range(2)]
    for process in both:
        out, said = process.communicate()
        assert (process.returncode, out) == (0, "42.0 42\n")
        assert DAMAGED not in said
        assert UNWRITTEN not in said
    assert run(warm, tmp_path / "cache") == ""


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs SIGKILL")
def test_a_process_that_is_killed_leaves_nothing_that_breaks_the_next(warm: Path, tmp_path: Path) -> None:
    """Killed at the moment at which the first files appear, and at a few after it."""
    for moment in range(3):
        cache = tmp_path / f"cache{moment}"
        process = start(warm, cache)
        while process.poll() is None and not list(cache.rglob("tiny.*.nbi")):
            time.sleep(0.001)
        time.sleep(0.005 * moment)
        process.kill()
        process.communicate()
        said = run(warm, cache)
        assert DAMAGED not in said
        assert UNWRITTEN not in said
        assert run(warm, cache) == ""
