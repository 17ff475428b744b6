"""The library of kernels: nothing passes its door unchecked, and it never runs where it does not belong.

Where none was built, or KINSEEK_JIT=1 has kernels compiled, there is nothing to test; `.ci/run` builds one.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import threading
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pytest
from numpy.typing import NDArray

import kinseek
from kinseek.kernels.arm.forward import write_poses
from kinseek.kernels.arm.pose_error import first_loose
from kinseek.kernels.atlas.one_goal import solve_plain
from kinseek.kernels.backend import LIBRARY, describe_backend
from kinseek.kernels.entry import ENTRIES, OUT, Dimension, Leaf, declare, declared
from kinseek.kernels.sources import PACKAGE

library = pytest.mark.skipif(LIBRARY is None, reason=describe_backend())
PANDA = kinseek.load("panda")


def given(**changed: Any) -> tuple[Any, ...]:
    """What `write_poses` takes, with changes."""
    arrays = PANDA.chain.arrays
    fields = {name: changed.pop(name) for name in tuple(changed) if name in arrays._fields}
    arguments = {
        "chain": arrays._replace(**fields),
        "q": np.zeros((3, 7)),
        "poses": np.empty((3, 4, 4)),
    } | changed
    return tuple(arguments.values())


@library
@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"q": np.zeros((3, 6))}, r"q must be .*shape \(k, 7\), got float64 of shape \(3, 6\)"),
        ({"q": np.zeros((3, 7), dtype=np.float32)}, "q must be .* got float32"),
        ({"q": np.zeros((3, 7), dtype=">f8")}, "q must be"),
        ({"q": np.zeros((3, 14))[:, ::2]}, "not C-contiguous"),
        ({"q": np.zeros((7, 3)).T}, "not C-contiguous"),
        ({"q": np.zeros(7)}, r"got float64 of shape \(7,\)"),
        ({"q": [[0.0] * 7]}, "q must be"),
        ({"q": None}, "q must be"),
        (
            {"poses": np.empty((2, 4, 4))},
            r"poses must be .*shape \(3, 4, 4\), got float64 of shape \(2, 4, 4\)",
        ),
        ({"poses": np.empty((3, 3, 4))}, r"poses must be .*shape \(3, 4, 4\)"),
        ({"poses": np.broadcast_to(np.empty((4, 4)), (3, 4, 4))}, "poses must be"),
        ({"fixed": np.zeros((7, 3, 4))}, r"chain.prismatic must be .*shape \(6,\)"),
        ({"leader": np.zeros(7, dtype=np.int32)}, "chain.leader must be .*int64"),
        ({"prismatic": np.zeros(7, dtype=np.uint8)}, "chain.prismatic must be .*bool"),
        ({"chain": tuple(PANDA.chain.arrays)[:-1]}, "chain must be a ChainArrays"),
        ({"chain": list(PANDA.chain.arrays)}, "chain must be a ChainArrays"),
    ],
)
def test_what_does_not_fit_is_refused_by_name(changed: dict[str, Any], words: str) -> None:
    with pytest.raises(TypeError, match=f"ks_write_poses: {words}|{words}"):
        write_poses(*given(**changed))


@library
def test_read_only_memory_is_read_and_never_written() -> None:
    q, poses = np.zeros((3, 7)), np.empty((3, 4, 4))
    q.setflags(write=False)
    write_poses(*given(q=q, poses=poses))
    np.testing.assert_array_equal(poses[0], PANDA.fk(q[0]))
    poses.setflags(write=False)
    with pytest.raises(TypeError, match="read-only"):
        write_poses(*given(poses=poses))


@library
def test_numbers_are_numbers() -> None:
    assert first_loose(np.eye(4)[None], 1, False) == -1  # A whole number is a float too.
    assert first_loose(np.eye(4)[None] * 2.0, np.float64(1e-9), np.bool_(False)) == 0  # type: ignore[arg-type]
    for wrong in ("1", None, [1.0]):
        with pytest.raises(TypeError, match="tolerance must be a number"):
            first_loose(np.eye(4)[None], wrong, False)  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="address must be a whole number"):
        solve_plain(0.5, np.eye(4), np.zeros(7))  # type: ignore[arg-type]
    with pytest.raises(TypeError, match=r"takes 3 arguments .*, got 2"):
        first_loose(np.eye(4)[None], 1.0)  # type: ignore[call-arg]


@library
def test_an_empty_batch_is_nothing_to_do() -> None:
    poses = np.empty((0, 4, 4))
    write_poses(*given(q=np.empty((0, 7)), poses=poses))


@library
def test_other_threads_run_while_a_kernel_runs() -> None:
    q, counted, done = np.zeros((400_000, 7)), 0, threading.Event()
    poses = np.empty((len(q), 4, 4))

    def work() -> None:
        write_poses(*given(q=q, poses=poses))
        done.set()

    worker = threading.Thread(target=work)
    worker.start()
    while not done.wait(0.001):
        counted += 1
    worker.join()
    assert counted > 3


@library
def test_nothing_is_kept_of_what_it_was_given() -> None:
    q, poses = np.zeros((3, 7)), np.empty((3, 4, 4))
    before = sys.getrefcount(q), sys.getrefcount(poses)
    for _ in range(100):
        write_poses(*given(q=q, poses=poses))
        with pytest.raises(TypeError):
            write_poses(*given(q=q[:, :6], poses=poses))
    assert (sys.getrefcount(q), sys.getrefcount(poses)) == before


@library
def test_every_entry_is_in_the_library() -> None:
    assert len(ENTRIES) >= 10
    for entry in ENTRIES.values():
        assert LIBRARY is not None
        assert callable(LIBRARY.caller(entry))


def run(code: str, **environment: str) -> subprocess.CompletedProcess[str]:
    clean = {
        name: value for name, value in os.environ.items() if name not in ("KINSEEK_JIT", "KINSEEK_LEVEL")
    }
    return subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=clean | environment, check=False
    )


TOLD = "import kinseek; from kinseek.kernels.backend import describe_backend; print(describe_backend())"


@pytest.mark.slow
@library
def test_a_level_can_be_chosen_and_an_unknown_one_is_refused() -> None:
    assert LIBRARY is not None
    assert f"level {LIBRARY.level}" in run(TOLD, KINSEEK_LEVEL=str(LIBRARY.level)).stdout
    for wrong in ("9", "v3", "x86-64-v3"):
        done = run(TOLD, KINSEEK_LEVEL=wrong)
        assert done.returncode != 0
        assert f"KINSEEK_LEVEL='{wrong}': the library of kernels has the levels" in done.stderr


@pytest.mark.slow
@library
def test_the_command_line_says_in_a_sentence_that_there_is_no_such_level(tmp_path: Path) -> None:
    for words in ("fk panda 0 0 0 -1 0 1 0", "solve panda --at 0.4 0.1 0.5 --position-only", "kernels"):
        done = run(f"from kinseek.cli import main; main({words.split()})", KINSEEK_LEVEL="x")
        assert (done.returncode, done.stdout) == (2, "")
        assert done.stderr.startswith("kinseek: KINSEEK_LEVEL='x': the library of kernels has the levels")
        assert done.stderr.count("\n") == 1


@pytest.mark.slow
@library
def test_numba_is_left_alone_unless_it_is_asked_for() -> None:
    code = "import sys, kinseek; a = kinseek.load('panda'); a.ik(a.fk(a.lower + 0.3)); print('numba' in sys.modules)"
    assert run(code).stdout == "False\n"
    assert "KINSEEK_JIT asks for Numba" in run(TOLD, KINSEEK_JIT="1").stdout


def copied(tmp_path: Path) -> Path:
    """A copy of the package, with its library, and with the modules that are compiled already."""
    shutil.copytree(PACKAGE, tmp_path / "kinseek", ignore=shutil.ignore_patterns("*.nbi", "*.nbc"))
    return tmp_path / "kinseek"


@pytest.mark.slow
@library
def test_a_library_of_other_sources_is_refused(tmp_path: Path) -> None:
    package = copied(tmp_path)
    with (package / "kernels" / "arrays.py").open("a") as file:
        file.write("# changed\n")
    done = run(TOLD, PYTHONPATH=str(tmp_path))
    assert "it was built from other sources" in done.stdout
    done = run(
        "import importlib.util as u; f = u.find_spec\nu.find_spec = lambda n, *a: None if n == 'numba' else f(n, *a)\n"
        + TOLD,
        PYTHONPATH=str(tmp_path),
    )
    assert done.returncode != 0
    assert (
        "kinseek has no library of compiled kernels that runs here: it was built from other sources"
        in done.stderr
    )
    assert "pip install 'kinseek[jit]'" in done.stderr


@pytest.mark.slow
@library
def test_without_a_library_and_without_numba_one_message_says_what_to_do(tmp_path: Path) -> None:
    package = copied(tmp_path)
    for file in (package / "kernels").glob("_prebuilt.*"):
        file.write_bytes(b"no library")
    hidden = "import importlib.util as u; f = u.find_spec\nu.find_spec = lambda n, *a: None if n == 'numba' else f(n, *a)\n"
    done = run(hidden + TOLD, PYTHONPATH=str(tmp_path))
    assert "it cannot be loaded" in done.stderr
    for file in (package / "kernels").glob("_prebuilt.*"):
        file.unlink()
    done = run(hidden + TOLD, PYTHONPATH=str(tmp_path))
    assert "none was built" in done.stderr
    assert "pip install 'kinseek[jit]'" in done.stderr
    assert run(TOLD, PYTHONPATH=str(tmp_path)).stdout.startswith("Kernels are compiled by Numba")


SOME_ROOMS = """
import kinseek
from kinseek.kernels.backend import LIBRARY

arm = kinseek.load("panda")
T = arm.fk(arm.lower + 0.3)
print(LIBRARY.rooms)
print([float(x).hex() for x in arm.ik(T).q])
print(LIBRARY.rooms)
"""


@library
@pytest.mark.slow
def test_what_a_library_lacks_is_compiled_when_it_is_called(tmp_path: Path) -> None:
    pytest.importorskip("numba")
    native, place = PACKAGE.parents[1] / "native", tmp_path / "src"
    if not native.exists():
        pytest.skip("only the wheel is here")
    place.mkdir()
    library = next((copied(place) / "kernels").glob("_prebuilt.*"))
    shutil.copytree(native, tmp_path / "native")
    library.unlink()
    assert LIBRARY is not None
    words = [str(library.parent), "--levels", str(LIBRARY.level), "--rooms", "arm"]
    (tmp_path / ".numba_config.yaml").write_text("not settings: [")
    build = [sys.executable, str(tmp_path / "native" / "build.py"), *words]
    subprocess.run(build, check=True, cwd=tmp_path, umask=0)
    assert not library.stat().st_mode & 0o022
    before, q, after = run(SOME_ROOMS, PYTHONPATH=str(place)).stdout.splitlines()
    assert before == "['arm']"
    assert after == "['arm', 'atlas', 'structure']"
    assert q == run(SOME_ROOMS).stdout.splitlines()[1]
    assert (
        run(SOME_ROOMS, PYTHONPATH=str(place)).stdout.splitlines()[0] == after
    )  # Kept for the next process.
    (tmp_path / "native" / "emit.py").write_text("raise ImportError('no Numba')")
    done = run(SOME_ROOMS + "arm.branches(T)", PYTHONPATH=str(place))
    assert "KinseekError: kernels (branches) are not compiled yet, and cannot be: " in done.stderr
    assert "no Numba" in done.stderr


def test_declarations_are_checked() -> None:
    Array, Flags = NDArray[np.float64], NDArray[np.bool_]

    def double(x: np.ndarray, n: int) -> None: ...

    with pytest.raises(
        TypeError, match=r"x needs a number, a named tuple or Annotated\[Array, shape ...\], got"
    ):
        declare(double)
    with pytest.raises(TypeError, match="a dimension is"):
        declared(Annotated[Array, "2n"], "x")
    assert str(Dimension.read("m+1")) == "m+1"
    known, fixed = {"m": 7}, declared(Annotated[Array, "m+1", 3, 4, OUT], "fixed")
    assert isinstance(fixed, Leaf)
    assert fixed.written
    assert fixed.fits(np.zeros((8, 3, 4)), known)
    assert not fixed.fits(np.zeros((7, 3, 4)), known)
    assert not fixed.fits(np.zeros((0, 3, 4)), {})
    flags = declared(Annotated[Flags, "k"], "flags")
    assert isinstance(flags, Leaf)
    assert flags.words({}) == "a C-contiguous array of bool of shape (k,)"


@library
@pytest.mark.slow
@pytest.mark.thorough
def test_the_library_has_the_bits_of_kernels_compiled_for_its_level() -> None:
    pytest.importorskip("numba")
    assert LIBRARY is not None
    names = {1: "generic", 2: "x86-64-v2", 3: "x86-64-v3", 4: "x86-64-v4"}
    level = {"KINSEEK_LEVEL": str(LIBRARY.level)}
    compiled = {"KINSEEK_JIT": "1", "NUMBA_CPU_NAME": names[LIBRARY.level], "NUMBA_CPU_FEATURES": ""}
    built, made = (
        run("import tests.bits; tests.bits.main()", **level),
        run("import tests.bits; tests.bits.main()", **compiled),
    )
    assert built.returncode == 0, built.stderr
    assert made.returncode == 0, made.stderr
    assert built.stdout.count("\n") > 40
    assert built.stdout.splitlines() == made.stdout.splitlines()
