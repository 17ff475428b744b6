"""The digest of the kernels' sources: every file that machine code is made of counts, and no other."""

from __future__ import annotations

import shutil
from importlib.util import find_spec
from pathlib import Path

import pytest

import kinseek
from kinseek.kernels.entry import declare
from kinseek.kernels.sources import kernel_sources, module_digest, source_digest

PACKAGE = Path(kinseek.__file__).parent


@pytest.fixture(name="copy")
def _copy(tmp_path: Path) -> Path:
    shutil.copytree(PACKAGE, tmp_path / "site" / "kinseek", ignore=shutil.ignore_patterns("__pycache__"))
    return tmp_path


@pytest.mark.slow
@pytest.mark.parametrize("name", ["kernels/arm/forward.py", "solvers/blind_search.py"])
def test_the_digest_sees_every_file_with_kernels(copy: Path, name: str) -> None:
    package = copy / "site" / "kinseek"
    before = source_digest(package)
    assert before == source_digest(PACKAGE)
    with (package / name).open("a", encoding="utf-8") as file:
        file.write("\n")
    assert source_digest(package) != before


@pytest.mark.slow
def test_a_change_recompiles_what_is_made_of_it_and_nothing_else(copy: Path) -> None:
    package = copy / "site" / "kinseek"
    leaf, user, other = (
        f"kinseek.kernels.{name}" for name in ("proof.cone", "proof.infeasibility", "atlas.one_goal")
    )
    assert all(
        find_spec(name) for name in (leaf, user, other)
    )  # Of a name that is unknown all sources count.
    layout = "kinseek.kernels.layout"  # It writes functions out, of what any file may declare.
    changed = copy / "changed" / "kinseek"
    shutil.copytree(package, changed)
    with (changed / "kernels" / "proof" / "cone.py").open("a", encoding="utf-8") as file:
        file.write("\n")
    same = [
        name
        for name in (leaf, user, other, layout)
        if module_digest(name, package) == module_digest(name, changed)
    ]
    assert same == [other]


def test_every_file_that_takes_a_decorator_is_digested() -> None:
    taking = {path for path in PACKAGE.rglob("*.py") if b"kernels.jit import" in path.read_bytes()}
    assert taking <= set(kernel_sources()), "add these files to ELSEWHERE of kinseek/kernels/sources.py"


def test_an_entry_of_another_file_is_rejected() -> None:
    """Its library would lack the entry, or have another one of the same name, and would pass for current."""

    def walk(steps: int) -> int:
        return steps

    walk.__module__ = "kinseek.solvers.grid_search"
    with pytest.raises(TypeError, match=r"grid_search has kernels: add its file to ELSEWHERE"):
        declare(walk)
