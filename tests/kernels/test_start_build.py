"""Building the library of kernels: what is kept is taken up again, and a terminal sees how far it is."""

from __future__ import annotations

import os
import runpy
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from kinseek.kernels.backend import LIBRARY, describe_backend
from places import ROOT

if not (ROOT / "native").exists():
    pytest.skip("only the wheel is here", allow_module_level=True)
BUILD = runpy.run_path(str(ROOT / "native" / "build.py"))
take_up, objects, keep = BUILD["_take_up"], BUILD["_objects"], BUILD["KEPT"]["keep"]


def name(folder: Path, level: int, *stems: str, room: str = "paths") -> None:
    """Write down what the library is made of for a level, as native/emit.py does."""
    names = "\n".join(f"{room} {stem}" for stem in stems)
    keep(folder / f"{BUILD['source_digest']()}.{level}.names", names.encode())


def emitted(path: Path) -> None:
    """Write an object file and the mark of the process that has taken it, as native/emit.py does."""
    path.with_suffix(".taken").touch()
    keep(path, b"machine code")


def test_what_an_earlier_run_did_not_finish_is_taken_again(tmp_path: Path) -> None:
    assert take_up([(tmp_path, 3)], [])
    emitted(tmp_path / "ks_a-1.3.o")
    (tmp_path / "ks_b-2.3.taken").touch()
    name(tmp_path, 3, "ks_a-1", "ks_b-2")
    assert take_up([(tmp_path, 3)], [])
    assert (tmp_path / "ks_a-1.3.taken").exists()
    assert not (tmp_path / "ks_b-2.3.taken").exists()
    assert take_up([(tmp_path, 2)], [])
    emitted(tmp_path / "ks_b-2.3.o")
    assert not take_up([(tmp_path, 3)], [])


@pytest.mark.parametrize("damage", ["empty", "cut", "zeros", "bit"])
@pytest.mark.parametrize("damaged", ["ks_a-1.3.o", "names"])
def test_what_a_crash_has_damaged_is_compiled_anew(damage: str, damaged: str, tmp_path: Path) -> None:
    name(tmp_path, 3, "ks_a-1", "ks_b-2")
    for each in ("ks_a-1.3.o", "ks_b-2.3.o"):
        emitted(tmp_path / each)
    assert not take_up([(tmp_path, 3)], [])
    path = next(tmp_path.glob("*.names")) if damaged == "names" else tmp_path / damaged
    content = path.read_bytes()
    last = content[:-1] + bytes([content[-1] ^ 1])
    path.write_bytes({"empty": b"", "cut": content[:-1], "zeros": bytes(len(content)), "bit": last}[damage])
    assert take_up([(tmp_path, 3)], [])
    assert not path.exists()
    assert (tmp_path / "ks_a-1.3.taken").exists() == (damaged == "names")
    assert (tmp_path / "ks_b-2.3.taken").exists()


def test_objects_are_linked_as_they_were_compiled_or_not_at_all(tmp_path: Path) -> None:
    keep(tmp_path / "ks_a-1.3.o", b"machine code")
    (into := tmp_path / "into").mkdir()
    (copy,) = BUILD["_unpacked"]([tmp_path / "ks_a-1.3.o"], into)
    assert copy.read_bytes() == b"machine code"
    (tmp_path / "ks_a-1.3.o").write_bytes(b"machine code")
    with pytest.raises(BUILD["BuildError"], match=r"ks_a-1\.3\.o is missing or damaged: build again"):
        BUILD["_unpacked"]([tmp_path / "ks_a-1.3.o"], into)


def test_objects_for_other_machines_are_linked_as_they_were_compiled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    build_for, linked = BUILD["build_for"], list[bytes]()

    def emit(work: Path, targets: list[str]) -> None:
        for target in targets:
            (work / target).mkdir()
            for level in BUILD["TARGETS"][target].levels:
                name(work / target, level, "ks_a-1")
                keep(work / target / f"ks_a-1.{level}.o", f"{target} {level}".encode())

    def link(library: Path, target: Any, table: Path, objects: list[Path], work: Path) -> Path:
        linked.extend(path.read_bytes() for path in objects)
        return library

    monkeypatch.setitem(build_for.__globals__, "_emit_foreign", emit)
    monkeypatch.setitem(build_for.__globals__, "_link_foreign", link)
    both = ["aarch64-linux-gnu", "x86_64-pc-windows-msvc"]
    assert build_for(tmp_path / "out", both) == [tmp_path / "out" / both[0] / "_prebuilt.abi3.so"]
    levels = [BUILD["TARGETS"][target].levels for target in both]
    assert linked == [f"{both[0]} {level}".encode() for level in levels[0]]
    # Nobody links for Windows here.
    given = sorted(path.name for path in (tmp_path / "out" / both[1]).iterdir())
    assert given == sorted(["table.c", *(f"ks_a-1.{level}.o" for level in levels[1])])
    for level in levels[1]:
        assert (
            tmp_path / "out" / both[1] / f"ks_a-1.{level}.o"
        ).read_bytes() == f"{both[1]} {level}".encode()


def test_objects_of_other_sources_are_not_those_of_these(tmp_path: Path) -> None:
    name(tmp_path, 3, "ks_a-1", "ks_b-2")
    for each in ("ks_a-1.3.o", "ks_b-old.3.o", "ks_b-2.2.o"):
        emitted(tmp_path / each)
    assert take_up([(tmp_path, 3)], [])
    assert BUILD["_wanted"](tmp_path, 3, []) == [tmp_path / "ks_a-1.3.o", tmp_path / "ks_b-2.3.o"]


@pytest.mark.parametrize(
    ("options", "levels"),
    [([], BUILD["this_level"]()), (["--levels"], []), (["--levels", "2", "3"], [2, 3])],
    ids=["own", "all", "some"],
)
def test_the_library_is_built_for_this_processor_alone_unless_levels_are_named(
    options: list[str], levels: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []
    monkeypatch.setitem(BUILD["main"].__globals__, "build", lambda *given: asked.append(given))
    monkeypatch.setattr(sys, "argv", ["build.py", "out", *options])
    BUILD["main"]()
    assert asked == [(Path("out"), levels, ())]


def test_only_the_rooms_that_are_asked_for_are_waited_for(tmp_path: Path) -> None:
    name(tmp_path, 3, "ks_a-1")
    emitted(tmp_path / "ks_a-1.3.o")
    assert not take_up([(tmp_path, 3)], ["paths"])
    assert BUILD["_wanted"](tmp_path, 3, ["proof"]) == []
    assert BUILD["has_rooms"]({"paths", "proof"}, ["paths"])
    assert not BUILD["has_rooms"]({"paths", "proof"}, [])
    assert not BUILD["has_rooms"]({"paths"}, ["proof"])
    assert BUILD["has_rooms"]({"all"}, ["proof"])
    with pytest.raises(
        BUILD["BuildError"], match=r"rooms \['kitchen'\] are not known, known are \['arm', 'atlas', "
    ):
        BUILD["build"](tmp_path, None, ["kitchen"])


def test_what_is_made_for_two_machines_is_finished_for_both(tmp_path: Path) -> None:
    one, two = tmp_path / "one", tmp_path / "two"
    for folder in (one, two):
        folder.mkdir()
        name(folder, 1, "ks_a-1")
    emitted(one / "ks_a-1.1.o")
    assert take_up([(one, 1), (two, 1)], [])
    assert not (one / "ks_a-1.1.taken").exists()


@pytest.mark.parametrize("lock", ["_alone", "_alone_into"])
def test_a_second_build_waits_for_the_first(tmp_path: Path, lock: str) -> None:
    pytest.importorskip("fcntl")
    order, alone = list[str](), BUILD[lock]

    def second() -> None:
        with alone(tmp_path):
            order.append("second")

    with alone(tmp_path):
        waiting = threading.Thread(target=second)
        waiting.start()
        waiting.join(0.1)
        order.append("first")
    waiting.join()
    assert order == ["first", "second"]


def test_builds_that_do_not_wait_for_each_other_write_different_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # The second one begins and ends in the middle of the first one.
    library, put, replace = tmp_path / "_prebuilt.abi3.so", BUILD["_put"], os.replace
    for name in ("first", "second"):
        (tmp_path / name).write_text(name)

    def slow(*names: Path) -> None:
        monkeypatch.setattr(os, "replace", replace)
        put(tmp_path / "second", library)
        assert library.read_text() == "second"
        replace(*names)

    monkeypatch.setattr(os, "replace", slow)
    put(tmp_path / "first", library)
    assert library.read_text() == "first"
    assert len(list(tmp_path.iterdir())) == 3


def test_builds_with_different_objects_keep_the_rooms_of_each_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("fcntl")
    build, library = BUILD["build"], tmp_path / "out" / "_prebuilt.abi3.so"
    emitted = threading.Barrier(2)

    def emit(work: Path, levels: list[int], known: object, rooms: list[str]) -> None:
        with suppress(threading.BrokenBarrierError):  # Both are here at once only if neither waits.
            emitted.wait(0.5)

    def link(command: list[str]) -> None:
        table = next(Path(word) for word in command if word.endswith("table.c"))
        Path(command[-1]).write_text(table.read_text())

    for name, each in {
        "_emit_all": emit,
        "_run": link,
        "_objects": lambda keep, place: Path(place),
        "_forget": lambda work: None,
    }.items():
        monkeypatch.setitem(build.__globals__, name, each)
    with ThreadPoolExecutor(2) as pool:
        for done in [pool.submit(build, tmp_path / "out", None, [room]) for room in ("arm", "paths")]:
            done.result()
    levels = list(BUILD["LEVELS"][BUILD["machine"]()])
    assert BUILD["rooms_in"](library, levels) == {"arm", "paths"}


def test_a_library_that_cannot_be_replaced_leaves_no_file(tmp_path: Path) -> None:
    (tmp_path / "new").touch()
    (library := tmp_path / "_prebuilt.abi3.so").mkdir()
    with pytest.raises(OSError, match=library.name):
        BUILD["_put"](tmp_path / "new", library)
    assert sorted(path.name for path in tmp_path.iterdir()) == [library.name, "new"]


def test_what_nobody_took_for_a_month_is_forgotten(tmp_path: Path) -> None:
    name(tmp_path, 3, "ks_a-1")
    deep = tmp_path / "cache" / "kinseek-0" / "digest" / "place"
    deep.mkdir(parents=True)
    old = [tmp_path / "ks_a-1.3.o", tmp_path / "ks_a-0.3.o", tmp_path / "ks_a-0.3.taken", deep / "a.nbc"]
    for path in old:
        path.touch()
        os.utime(path, (0, 0))
    BUILD["_forget"](tmp_path)
    assert [path.exists() for path in old] == [True, False, False, False]


@pytest.mark.skipif(not hasattr(os, "getuid") or os.getuid() == 0, reason="nothing stops root")
def test_where_no_objects_can_be_kept_none_are(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("numba")
    tmp_path.chmod(0o500)
    assert objects(tmp_path / "kept", "elsewhere") == Path("elsewhere")
    assert "keeping none, for" in capsys.readouterr().err


SOME = """
import sys

sys.path.insert(0, sys.argv[1])
import emit

emit.never_run()
if sys.argv[2] == "shortcuts":
    emit.shortcuts.apply()
import kinseek.kernels.ranges.search
from kinseek.kernels.entry import ENTRIES
from kinseek.kernels.jit import ROUTINES

known = {**ENTRIES, **ROUTINES}
for name in sys.argv[3:]:
    data = emit._object_of(emit.module_of({name: known[name]}), name, None, 0)
    print(emit.hashlib.sha256(data).hexdigest())
"""


@pytest.mark.slow
@pytest.mark.thorough
def test_an_object_has_the_same_bytes_whatever_was_compiled_before(tmp_path: Path) -> None:
    """Numba lets a function take options from whichever kernel calls it first, and counts what it compiles in names."""
    pytest.importorskip("numba")

    def bytes_of(*names: str, how: str = "shortcuts") -> dict[str, str]:
        cache = tmp_path / f"{how} {names[0]}"
        environment = os.environ | {"KINSEEK_JIT": "1", "NUMBA_CACHE_DIR": str(cache)}
        done = subprocess.run(
            [sys.executable, "-c", SOME, str(ROOT / "native"), how, *names],
            env=environment | {"PYTHONHASHSEED": "0", "NUMBA_DISABLE_JIT": "0"},
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        return dict(zip(names, done.stdout.split(), strict=True))

    one, other = "ks_write_range_errors", "ks_range_judge_routine"
    first, second = bytes_of(one, other), bytes_of(other, one)
    assert first == second
    assert bytes_of(other, one) == first  # With what the caches hold by now.
    assert bytes_of(one, other, how="as Numba does it") == first


def test_objects_are_kept_apart_for_each_compiler(tmp_path: Path) -> None:
    pytest.importorskip("numba")
    assert objects("", str(tmp_path)) == tmp_path
    kept = objects(str(tmp_path), "elsewhere")
    assert kept.is_dir()
    assert BUILD["_digest_of"]("emit.py", "kept.py", "shortcuts.py", "targets.py") in kept.name
    assert objects(tmp_path, "elsewhere") == kept


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="needs POSIX permissions")
@pytest.mark.parametrize("how", ["folder", "object", "link", "folder inside"])
def test_objects_that_others_could_have_put_there_are_not_linked(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], how: str
) -> None:
    pytest.importorskip("numba")
    kept = objects(tmp_path / "kept", "elsewhere")
    (kept / "ks_a.3.o").touch(mode=0o600)
    (kept / "cache").mkdir(mode=0o700)
    assert objects(tmp_path / "kept", "elsewhere") == kept
    assert capsys.readouterr().err == ""
    if how == "link":
        (kept / "ks_b.3.o").symlink_to(tmp_path / "planted.o")
    else:
        (tmp_path / "kept" if how == "folder" else kept / ("cache" if "inside" in how else "ks_a.3.o")).chmod(
            0o770
        )
    assert objects(tmp_path / "kept", "elsewhere") == Path("elsewhere")
    said = capsys.readouterr().err
    assert said.startswith("native/build.py: compiling every kernel and keeping none, for ")
    assert said.count("\n") == 1


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="needs POSIX permissions")
def test_objects_are_kept_whatever_the_umask(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("numba")
    before = os.umask(0o002)
    try:
        kept = objects(tmp_path / "kept", "elsewhere")
        with BUILD["_alone"](kept):
            pass
        assert objects(tmp_path / "kept", "elsewhere") == kept
    finally:
        os.umask(before)
    assert capsys.readouterr().err == ""


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="needs POSIX permissions")
def test_the_name_of_a_folder_is_printed_with_escapes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("numba")
    (shared := tmp_path / "\x1b]0;owned\x07").mkdir()
    shared.chmod(0o777)
    assert objects(shared / "kept", "elsewhere") == Path("elsewhere")
    said = capsys.readouterr().err
    assert "\\x1b]0;owned\\x07" in said
    assert said.rstrip("\n").isprintable()


@pytest.mark.skipif(LIBRARY is None, reason=describe_backend())
@pytest.mark.skipif(not Path("/proc/cpuinfo").exists(), reason="the system tells it elsewhere")
def test_what_is_built_for_this_machine_is_the_best_that_its_door_takes() -> None:
    from kinseek.kernels import _prebuilt as door  # type: ignore[attr-defined,unused-ignore]

    assert BUILD["this_level"]() == [door.best_level()]


SHOWN = f"""
import runpy
with runpy.run_path({str(ROOT / "native" / "build.py")!r})["_screen"]() as screen:
    screen.write("seen")
"""


@pytest.mark.skipif(sys.platform == "win32", reason="other terminals")
def test_the_progress_is_seen_in_a_terminal_though_output_is_captured() -> None:
    import pty

    child, terminal = pty.fork()
    if child == 0:
        os.execv(
            sys.executable,
            [
                sys.executable,
                "-c",
                f"import subprocess, sys\nsubprocess.run([sys.executable, '-c', {SHOWN!r}], capture_output=True)",
            ],
        )
    try:
        assert os.read(terminal, 100) == b"seen"
    finally:
        assert os.waitpid(child, 0)[1] == 0
        os.close(terminal)


@pytest.mark.skipif(sys.platform == "win32", reason="other terminals")
def test_without_a_terminal_nothing_is_said() -> None:
    done = subprocess.run(
        [sys.executable, "-c", SHOWN], capture_output=True, text=True, check=True, start_new_session=True
    )
    assert done.stdout + done.stderr == ""


ADDITIONS = """
from kinseek.kernels.compiler import compiled
from kinseek.kernels.machine_code import never_run
{}

def total(numbers):
    result = 0.0
    for each in numbers:
        result += each
    return result

made = compiled(total)
made.compile("float64(float64[::1])")
made.overloads[made.signatures[0]].library._ensure_finalized()
print(made.inspect_llvm(made.signatures[0]).count(" fadd "))
"""


@pytest.mark.slow
@pytest.mark.parametrize(("shipped", "unrolled"), [("never_run()", False), ("", True)])
def test_a_build_does_not_unroll_loops_of_unknown_length(
    shipped: str, unrolled: bool, tmp_path: Path
) -> None:
    pytest.importorskip("numba")
    environment = os.environ | {
        "KINSEEK_JIT": "1",
        "NUMBA_CACHE_DIR": str(tmp_path),
        "NUMBA_DISABLE_JIT": "0",
    }
    file = tmp_path / "additions.py"  # Numba keeps code of files alone.
    file.write_text(ADDITIONS.format(shipped), encoding="utf-8")
    done = subprocess.run(
        [sys.executable, str(file)], env=environment, check=True, capture_output=True, text=True
    )
    assert (int(done.stdout) > 1) == unrolled
