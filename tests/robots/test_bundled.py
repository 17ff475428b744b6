"""Bundled arms as numbers: the same bits as their files, and never those of another file."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from kinseek.robots import bundled, catalog_entry, catalog_names, catalog_path, read, read_urdf
from kinseek.robots.chain import SerialChain


def same(a: object, b: object) -> bool:
    if isinstance(a, np.ndarray):
        return (
            isinstance(b, np.ndarray)
            and a.dtype == b.dtype
            and a.shape == b.shape
            and a.tobytes() == b.tobytes()
        )
    if isinstance(a, dict):
        return isinstance(b, dict) and list(a) == list(b) and all(same(a[key], b[key]) for key in a)
    if isinstance(a, tuple):
        return isinstance(b, tuple) and len(a) == len(b) and all(map(same, a, b))
    return a == b


@pytest.mark.parametrize("name", catalog_names())
def test_numbers_are_those_of_the_file_to_the_last_bit(name: str) -> None:
    entry, kept = catalog_entry(name), bundled.read_bundled(name)
    chain = read_urdf(catalog_path(name), entry.base, entry.tip)
    assert kept is not None, "run python -m kinseek.robots.prepare_catalog"
    for field in fields(SerialChain):
        assert same(getattr(kept, field.name), getattr(chain, field.name)), field.name


def test_a_file_that_changed_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = catalog_path("planar2").read_text(encoding="utf-8")
    (tmp_path / "planar2.json").write_text(catalog_path("planar2").with_suffix(".json").read_text())
    (tmp_path / "planar2.urdf").write_text(text.replace("0.25", "0.35"))
    monkeypatch.setattr("kinseek.robots.catalog._folder", lambda: tmp_path)
    assert bundled.read_bundled("planar2") is None
    assert read("planar2").fixed[-1, 0, 3] == 0.35


@pytest.mark.parametrize("damage", ["", "{", "[]", "{}", "null"])
def test_a_damaged_file_of_numbers_is_passed_over(
    damage: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "planar2.urdf").write_text(catalog_path("planar2").read_text(encoding="utf-8"))
    (tmp_path / "planar2.json").write_text(damage)
    monkeypatch.setattr("kinseek.robots.catalog._folder", lambda: tmp_path)
    assert bundled.read_bundled("planar2") is None
    assert read("planar2").dof == 2


def test_other_ends_are_read_from_the_file() -> None:
    assert read("panda", tip="panda_link7").tip == "panda_link7"


def test_a_bundled_arm_needs_no_reader_of_xml() -> None:
    code = """
import json, sys
import kinseek
arm = kinseek.load("panda")
arm.fk(arm.lower)
heavy = ("lxml", "urdf_parser_py", "scipy.spatial", "xacrodoc", "mujoco")
print(json.dumps([name for name in heavy if name in sys.modules]))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert json.loads(done.stdout) == []
