"""Building the library of kernels: what is kept is taken up again, and a terminal sees how far it is."""

from __future__ import annotations

import os
import runpy
import subprocess
import sys
from pathlib import Path

import pytest

from kinseek.kernels.route import LIBRARY, told

ROOT = Path(__file__).resolve().parent.parent
if not (ROOT / "native").exists():
    pytest.skip("only the wheel is here", allow_module_level=True)
BUILD = runpy.run_path(str(ROOT / "native" / "build.py"))
take_up, objects = BUILD["_take_up"], BUILD["_objects"]


def test_what_an_earlier_run_did_not_finish_is_taken_again(tmp_path: Path) -> None:
    assert take_up([(tmp_path, 3)])
    for name in ("names.3.taken", "ks_a.3.taken", "ks_b.3.taken", "ks_a.3.o"):
        (tmp_path / name).touch()
    (tmp_path / "names.3").write_text("ks_a\nks_b")
    assert take_up([(tmp_path, 3)])
    assert (tmp_path / "ks_a.3.taken").exists()
    assert not (tmp_path / "ks_b.3.taken").exists()
    assert take_up([(tmp_path, 2)])
    for name in ("ks_b.3.taken", "ks_b.3.o"):
        (tmp_path / name).touch()
    assert not take_up([(tmp_path, 3)])


def test_what_is_made_for_two_machines_is_finished_for_both(tmp_path: Path) -> None:
    one, two = tmp_path / "one", tmp_path / "two"
    for folder in (one, two):
        folder.mkdir()
        (folder / "names.1").write_text("ks_a")
    (one / "ks_a.1.taken").touch()
    (one / "ks_a.1.o").touch()
    assert take_up([(one, 1), (two, 1)])
    assert not (one / "ks_a.1.taken").exists()


def test_objects_are_kept_apart_for_each_state_of_the_sources(tmp_path: Path) -> None:
    pytest.importorskip("numba")
    assert objects("", str(tmp_path)) == tmp_path
    kept = objects(str(tmp_path), "elsewhere")
    assert kept.is_dir()
    assert BUILD["source_digest"]() in kept.name
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


@pytest.mark.skipif(LIBRARY is None, reason=told())
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
