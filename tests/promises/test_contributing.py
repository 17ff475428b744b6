"""The table of layers in CONTRIBUTING.md has the order that lint-imports checks, and names every module."""

from __future__ import annotations

import re
import tomllib

import pytest

from places import ROOT

if not (ROOT / "CONTRIBUTING.md").is_file():
    pytest.skip("the documentation is not part of what is tested here", allow_module_level=True)

SECTION = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8").split("\n## The layers of the package\n")[1]
ROWS = dict(re.findall(r"^\| (`[^|]+`) \| (.+) \|$", SECTION.split("\n## ")[0], re.MULTILINE))
PACKAGE = ROOT / "src" / "kinseek"


def words(text: str) -> list[str]:
    """The words in backticks, without slashes at the end and without .py."""
    return [word.rstrip("/").removesuffix(".py") for word in re.findall("`([^`]+)`", text)]


def test_the_order_is_that_of_the_layers() -> None:
    config = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    (contract,) = (
        each for each in config["tool"]["importlinter"]["contracts"] if each.get("containers") == ["kinseek"]
    )
    layers = [layer.split(" | ") for layer in contract["layers"]]
    level = {name: number for number, layer in enumerate(layers) for name in layer}
    named = [name for row in ROWS for name in words(row) if name in level]
    assert sorted([*named, "__main__"]) == sorted(level)
    assert named == sorted(named, key=level.__getitem__)


@pytest.mark.parametrize(
    "folder", [name for row in ROWS for name in words(row) if "/" in row and name != "kernels"]
)
def test_every_module_is_named(folder: str) -> None:
    place = next((each for each in (PACKAGE / folder, ROOT / folder) if each.is_dir()), PACKAGE)
    there = {path.stem for path in place.glob("*.py")} - {"__init__", "__main__"}
    if folder == "solvers":  # The searches themselves have their list.
        from kinseek.solvers import MODULES

        there -= {module.lstrip(".") for module in MODULES.values()}
    assert there - {word.rpartition("/")[2] for word in words(ROWS[f"`{folder}/`"])} == set()
