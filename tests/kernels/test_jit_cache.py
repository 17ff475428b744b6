"""The kernels' disk cache: never stale, never needed, and a first run says that it compiles."""

from __future__ import annotations

import ast
import importlib.util
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from types import CodeType, ModuleType

import pytest

import kinseek
from kinseek.kernels.sources import PACKAGE as SOURCES
from kinseek.kernels.sources import _closure, kernel_sources

pytestmark = [pytest.mark.slow, pytest.mark.jit]

PACKAGE = Path(kinseek.__file__).parent

CALL = """
import numpy as np
from kinseek.kernels.arrays import chain_arrays
from kinseek.kernels.arm.pose_error import judge
from kinseek.kernels.arrays import GoalArrays
rigid = np.eye(4)[None, :3].repeat(2, axis=0)
one, flag, zero = np.ones(1), np.array([True]), np.zeros(1, dtype=np.int64)
chain = chain_arrays(rigid, flag, zero, one, np.zeros(1), (np.zeros(1), one))
goal = GoalArrays(np.array(rigid[0] + np.eye(3, 4, 3)[[2, 1, 0]]), 1.0, np.zeros(3))
print(judge(chain, np.array([[0.25]]), goal.target[None], goal)[0, 0])
"""
"""How far a slide of 0.25 m along z is from 1 m up: 0.75 m; if FK slid the other way, 1.25 m."""


@pytest.fixture(name="copy")
def _copy(tmp_path: Path) -> Path:
    shutil.copytree(PACKAGE, tmp_path / "site" / "kinseek", ignore=shutil.ignore_patterns("__pycache__"))
    return tmp_path


def run(folder: Path, before: str = "", cache: str | None = None) -> tuple[float, str]:
    environment = {name: value for name, value in os.environ.items() if not name.startswith("NUMBA_")}
    environment |= {"PYTHONPATH": str(folder / "site"), "XDG_CACHE_HOME": cache or str(folder / "cache")}
    done = subprocess.run(
        [sys.executable, "-c", before + CALL], env=environment, capture_output=True, text=True, check=True
    )
    return float(done.stdout), done.stderr


def test_an_upgrade_in_place_never_runs_stale_kernels(copy: Path) -> None:
    caller, callee = (
        copy / "site" / "kinseek" / "kernels" / "arm" / name for name in ("pose_error.py", "forward.py")
    )
    result, notice = run(copy)
    assert result == pytest.approx(0.75)
    assert notice.count("\n") == 1
    assert "compiling kernels" in notice
    assert run(copy) == (result, "")

    stamp, text = caller.stat(), callee.read_text(encoding="utf-8")
    assert text.count("= p + z * slide") == 1
    callee.write_text(text.replace("= p + z * slide", "= p - z * slide"), encoding="utf-8")
    assert (caller.stat().st_mtime_ns, caller.stat().st_size) == (stamp.st_mtime_ns, stamp.st_size)
    result, notice = run(copy)
    assert result == pytest.approx(1.25)
    assert "compiling kernels" in notice


def test_a_file_of_settings_in_the_working_folder_is_not_obeyed(
    copy: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It may have come with a robot; `dump_html` has Numba write a file."""
    (tmp_path / "handed").mkdir()
    monkeypatch.chdir(tmp_path / "handed")
    settings = "dump_html: notes.txt\nchrome_trace: trace.json\nopt: 0\n"
    Path(".numba_config.yaml").write_text(settings, encoding="utf-8")
    asked = "import kinseek.kernels.compiler as c; assert (c.config.HTML, int(c.config.OPT)) == (None, 3)\n"
    assert run(copy, asked)[0] == pytest.approx(0.75)
    assert [path.name for path in Path().iterdir()] == [".numba_config.yaml"]
    Path(".numba_config.yaml").write_text("- no mapping\n", encoding="utf-8")
    assert run(copy)[0] == pytest.approx(0.75)


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="needs POSIX permissions")
def test_a_file_of_settings_that_another_user_puts_there_meanwhile_is_not_obeyed(
    copy: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "shared").mkdir()
    monkeypatch.chdir(tmp_path / "shared")
    Path(".numba_config.yaml").write_text("cpu_name: generic\n", encoding="utf-8")
    not_yet = "import os; os.path.lexists = lambda path: False\n"
    asked = f"{not_yet}import kinseek.kernels.compiler as c; assert c.config.CPU_NAME == {{!r}}\n"
    run(copy, asked.format("generic"))  # The user's own folder: nobody else puts a file there.
    Path().chmod(0o1777)
    run(copy, asked.format(None))


def test_without_any_writable_folder_it_compiles_each_time(copy: Path) -> None:
    nowhere = "import tempfile; tempfile.tempdir = '/proc/nowhere'\n"
    for _ in range(2):
        result, notice = run(copy, nowhere, cache="/proc/nowhere")
        assert result == pytest.approx(0.75)
        assert "compiling kernels" in notice


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="needs POSIX permissions")
def test_a_folder_that_others_may_write_to_is_not_trusted(copy: Path) -> None:
    shared = copy / "shared" / "kinseek"
    shared.mkdir(parents=True)
    shared.chmod(0o777)
    private = copy / "tmp"
    private.mkdir(mode=0o700)
    run(copy, f"import tempfile; tempfile.tempdir = {str(private)!r}\n", cache=str(shared.parent))
    assert not list(shared.rglob("*.nbi"))
    assert list(private.rglob("*.nbi"))


@pytest.mark.parametrize("umask", [0o002, 0o022])
def test_where_the_cache_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], umask: int
) -> None:
    """The user's choice, else the user's cache, else the temporary folder: the first that is the user's alone."""
    from kinseek.kernels import compiler, kept_code

    home, temporary, chosen = (tmp_path / name for name in ("home", "temporary", "chosen"))
    temporary.mkdir(mode=0o700)
    monkeypatch.setattr(tempfile, "tempdir", str(temporary))
    monkeypatch.setattr(kept_code, "_report", set())
    for name in ("XDG_CACHE_HOME", "LOCALAPPDATA", "NUMBA_CACHE_DIR"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("HOME", str(home))
    before = os.umask(umask)
    try:
        found = compiler._cache_folder()
        assert found is not None
        assert found.parent == home / ".cache" / "kinseek"
        monkeypatch.setenv("NUMBA_CACHE_DIR", str(chosen))
        assert compiler._cache_folder() == chosen / found.name
        with monkeypatch.context() as prepared:  # A robot may have come with files for this folder.
            prepared.chdir(tmp_path)
            prepared.setenv("NUMBA_CACHE_DIR", chosen.name)
            assert compiler._cache_folder() == found
        if not hasattr(os, "getuid"):
            return
        chosen.chmod(0o770)  # As a team shares it.
        assert compiler._cache_folder() == found
        home.chmod(0o770)
        in_temporary = temporary / f"kinseek-{os.getuid()}" / found.name
        assert compiler._cache_folder() == in_temporary
        with (
            monkeypatch.context() as within
        ):  # Where no other folder takes files, Python takes the working folder.
            within.chdir(temporary)
            assert compiler._cache_folder() is None
        capsys.readouterr()
        kept_code._report.clear()
        home.chmod(0o700)
        monkeypatch.delenv("NUMBA_CACHE_DIR")
        with monkeypatch.context() as without_home:
            without_home.setattr(Path, "expanduser", _no_home)
            without_home.setattr(tempfile, "tempdir", "/proc/nowhere")
            assert compiler._cache_folder() is None
        told = capsys.readouterr().err
        assert told == (
            "kinseek: doing without a cache of compiled kernels, for ~/.cache takes none "
            "(RuntimeError: Could not determine home directory.)\n"
        )
    finally:
        os.umask(before)


def _no_home(path: Path) -> Path:
    raise RuntimeError("Could not determine home directory.")


@pytest.mark.parametrize("name", ["cli/words.py", "arm.py", "solvers/base.py"])
def test_a_change_where_no_kernel_is_recompiles_nothing(copy: Path, name: str) -> None:
    package = copy / "site" / "kinseek"
    assert run(copy)[1] != ""
    with (package / name).open("a", encoding="utf-8") as file:
        file.write("# A comment.\n")
    assert run(copy)[1] == ""


def test_kernels_use_nothing_of_ours_from_files_that_the_digest_leaves_out() -> None:
    digested, looked_at = set(kernel_sources()), 0
    for path in digested:
        name = ".".join(("kinseek", *path.relative_to(PACKAGE).with_suffix("").parts))
        module = importlib.import_module(name.removesuffix(".__init__"))
        for function in [getattr(each, "py_func", None) for each in vars(module).values()]:
            if function is None or function.__module__ != module.__name__:
                continue
            looked_at += 1
            for used in set(_names_in(function.__code__)) & set(vars(module)):
                origin = _origin(module, path, used)
                assert origin in digested, f"{function.__qualname__} uses {used}"
                assert origin in _closure(path, SOURCES), f"{function.__qualname__} uses {used}"
    assert looked_at > 100


def _names_in(code: CodeType) -> Iterator[str]:
    yield from code.co_names
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _names_in(constant)


def _origin(module: ModuleType, path: Path, name: str) -> Path:
    """The file that the module got a name of ours from; a name of Python's or NumPy's counts as the module's own."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and name in [each.asname or each.name for each in node.names]:
            source = "." * node.level + (node.module or "")
            found = importlib.util.find_spec(source, module.__package__)
            if found is not None and (found.name == "kinseek" or found.name.startswith("kinseek.")):
                return Path(str(found.origin))
    return path
