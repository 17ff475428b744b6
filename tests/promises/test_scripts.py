"""The scripts beside the package: `--help` prints and writes nothing, and what they do not know is refused."""

from __future__ import annotations

import re
import runpy
import subprocess
import sys
import warnings
from pathlib import Path

import pytest

from places import ROOT

pytestmark = pytest.mark.slow

KEPT = ("benchmarks", "experiments", "docs")
PARTS = {"__init__", "command", "moving", "outside", "page", "problems", "targets", "timing"}
"""Files of benchmarks/ that others import and nobody runs; those that begin with test_ are for pytest."""

SCRIPTS = [
    *(
        path
        for path in sorted((ROOT / "benchmarks").glob("*.py"))
        if path.stem not in PARTS and not path.stem.startswith("test_")
    ),
    ROOT / "benchmarks" / "field" / "__main__.py",
    ROOT / "benchmarks" / "maps" / "__main__.py",
    ROOT / "benchmarks" / "paths" / "__main__.py",
    ROOT / "benchmarks" / "paths" / "fastest.py",
    ROOT / "benchmarks" / "paths" / "scenes.py",
    ROOT / "experiments" / "__main__.py",
]
scripts = pytest.mark.parametrize(
    "script", SCRIPTS, ids=lambda path: str(path.relative_to(ROOT).with_suffix(""))
)


def module(script: Path) -> str:
    return ".".join(script.relative_to(ROOT).with_suffix("").parts).removesuffix(".__main__")


def kept() -> dict[str, tuple[int, int]]:
    """Time of change [ns] and size of everything that a script may write."""
    files = [path for folder in KEPT for path in (ROOT / folder).rglob("*")] + list(ROOT.glob("*"))
    ignored = {"__pycache__", ".since"}
    return {
        str(path): (path.stat().st_mtime_ns, path.stat().st_size)
        for path in files
        if path.is_file() and not ignored & set(path.parts)
    }


@pytest.mark.thorough
@scripts
def test_help_prints_and_writes_nothing(script: Path) -> None:
    before = kept()
    done = subprocess.run(
        [sys.executable, "-m", module(script), "--help"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "usage:" in done.stdout
    assert done.stderr == ""
    assert kept() == before


def run(script: Path) -> None:
    """Run a script as Python would, in this process, which has loaded most of what it needs."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # Python warns of a module that is run after it was imported.
        runpy.run_module(module(script), run_name="__main__", alter_sys=True)


@scripts
def test_an_unknown_argument_is_refused(
    script: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    before = kept()
    monkeypatch.setattr(sys, "argv", [str(script), "--helpless"])
    monkeypatch.syspath_prepend(str(script.parent))
    with pytest.raises(SystemExit) as ended:
        run(script)
    assert ended.value.code == 2
    assert "usage:" in capsys.readouterr().err
    assert kept() == before


def test_what_is_written_anew_can_be_told_to_go_elsewhere(tmp_path: Path) -> None:
    """The two scripts that need no measurement do it."""
    before = kept()
    for words in (
        ["benchmarks.speed_table", "--output", str(tmp_path / "one.md")],
        ["experiments", "claims", "--pages", str(tmp_path)],
    ):
        subprocess.run([sys.executable, "-m", *words], cwd=ROOT, check=True, capture_output=True)
    assert (tmp_path / "one.md").read_text() == (ROOT / "README.md").read_text()
    for page in ("experiments/README.md", "docs/paper.md", "docs/paper_questions.md"):
        assert (tmp_path / page).read_text() == (ROOT / page).read_text()
    assert kept() == before


def test_commands_in_the_documentation_exist() -> None:
    pages = [
        *ROOT.glob("*.md"),
        *ROOT.glob("docs/*.md"),
        *ROOT.glob("benchmarks/*.md"),
        *ROOT.glob("experiments/*.md"),
    ]
    text = "\n".join(path.read_text(encoding="utf-8") for path in pages)
    modules = set(re.findall(r"python -m (benchmarks[.\w]*|experiments)", text))
    files = set(re.findall(r"(?:python|pytest) ((?:benchmarks|examples)/\w+\.py)", text))
    assert len(modules) > 5
    assert len(files) > 3
    assert modules <= {module(script) for script in SCRIPTS}
    assert [name for name in files if not (ROOT / name).is_file()] == []
