"""The import contracts hold, and a way back through them is seen."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import kinseek
from places import ROOT

pytestmark = pytest.mark.slow

PACKAGE = Path(kinseek.__file__).parent


@pytest.fixture(name="copy")
def _copy(tmp_path: Path) -> Path:
    pytest.importorskip("importlinter")
    shutil.copytree(PACKAGE, tmp_path / "site" / "kinseek", ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copyfile(ROOT / "pyproject.toml", tmp_path / "pyproject.toml")
    return tmp_path


def lint(folder: Path) -> tuple[int, str]:
    program = "from importlinter.cli import lint_imports_command; lint_imports_command()"
    environment = os.environ | {"PYTHONPATH": str(folder / "site"), "PYTHONDONTWRITEBYTECODE": "1"}
    done = subprocess.run(
        [sys.executable, "-c", program, "--no-cache"],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    return done.returncode, done.stdout + done.stderr


def test_a_problem_knows_nothing_of_what_is_made_of_it(copy: Path) -> None:
    above = ("proof.certificate", "solution", "branches.result", "arm", "cli.words", "plots")
    with (copy / "site" / "kinseek" / "problem.py").open("a", encoding="utf-8") as file:
        file.write("\n\ndef _later() -> None:\n" + "".join(f"    import kinseek.{name}\n" for name in above))
    code, said = lint(copy)
    assert code == 1, said
    assert [name for name in above if f"kinseek.problem -> kinseek.{name}" not in said] == []


def test_a_new_file_has_to_say_where_it_stands(copy: Path) -> None:
    assert lint(copy)[0] == 0
    (copy / "site" / "kinseek" / "anywhere.py").write_text('"""Nowhere in the layers."""\n', encoding="utf-8")
    code, said = lint(copy)
    assert code != 0
    assert "anywhere" in said
