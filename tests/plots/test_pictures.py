"""Every picture of the repository can be read, see `legible`; those of the examples: promises/test_examples.py."""

from __future__ import annotations

import runpy
import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import kinseek
from benchmarks import atlas_cost, atlas_pictures, proof_pictures
from experiments.effort import EXPERIMENTS, experiment
from experiments.store import Store
from legible import faults_of_saved
from places import ROOT

pytestmark = pytest.mark.slow

pytest.importorskip("matplotlib")

PICTURES = ROOT / "docs" / "pictures"


@pytest.fixture
def found(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    return faults_of_saved(monkeypatch)


@pytest.mark.thorough
@pytest.mark.parametrize("name", EXPERIMENTS)
def test_pictures_of_the_experiments(name: str, found: list[str], tmp_path: Path) -> None:
    module = experiment(name)
    rows = Store(ROOT / "experiments" / "results", name).rows()
    module.draw(rows, tmp_path / "picture.png")
    assert found == []


def test_pictures_of_the_page_on_pictures(
    found: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    example = ROOT / "examples" / "pictures.py"
    monkeypatch.setattr(sys, "argv", [str(example), str(tmp_path)])
    runpy.run_path(str(example), run_name="__main__")
    assert found == []
    written = {Path(line.split()[1]).name for line in capsys.readouterr().out.splitlines() if "wrote" in line}
    kept = {path.name: path.stat().st_size for path in PICTURES.glob("plots_*.png")}
    assert written == set(kept)
    assert max(kept.values()) < 150_000


def test_the_animation_is_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from PIL import Image

    spec = spec_from_file_location("animation", ROOT / "examples" / "animation.py")
    assert spec is not None
    assert spec.loader is not None
    animation = module_from_spec(spec)
    spec.loader.exec_module(animation)
    for name in ("CIRCLE", "MOVING", "STEPS_OUT", "HOLD"):
        monkeypatch.setattr(animation, name, 2)
    animation.main(tmp_path / "small.gif")
    with Image.open(tmp_path / "small.gif") as small, Image.open(PICTURES / "kinseek.gif") as kept:
        assert small.size == kept.size == (800, 450)
        # Two of the circle, eight passes, two of the way out, less the last, and two of the proof.
        assert getattr(small, "n_frames", 0) == 15
        assert small.info["loop"] == kept.info["loop"] == 0
    assert (PICTURES / "kinseek.gif").stat().st_size < 2_000_000


def test_pictures_of_the_proof(found: list[str], tmp_path: Path) -> None:
    proof_pictures.draw_cost(proof_pictures.read_rows(proof_pictures.ROWS), tmp_path)
    proof_pictures.draw_tightness(tmp_path)
    assert found == []


def test_pictures_of_the_atlas(found: list[str], tmp_path: Path) -> None:
    arm = kinseek.load(atlas_pictures.ARM)
    query = atlas_pictures.query(arm, arm.fk(atlas_pictures.VALUES))
    atlas_pictures.draw_samples(query, tmp_path)
    atlas_pictures.draw_query(query, tmp_path)
    assert found == []


def test_pictures_of_what_the_atlas_costs(found: list[str], tmp_path: Path) -> None:
    """Drawn from made-up times, which no machine has to be quiet for."""
    atlas_cost.draw_joints([(n, 4 + n / 3, 1 + n / 9, 100.0) for n in range(3, 21)], tmp_path)
    rows = {
        name: [(tolerance, level - 0.02 * np.log10(tolerance), 100.0) for tolerance in atlas_cost.TOLERANCES]
        for name, level in (("panda", 1.9), ("ur5e", 1.8), ("iiwa14", 1.7))
    }
    atlas_cost.draw_tolerances(rows, tmp_path)
    assert found == []


def test_an_arm_that_is_missing_is_explained(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from matplotlib.figure import Figure

    seen: list[tuple[int, list[str]]] = []

    def note(figure: Any, *args: object, **options: object) -> None:
        for axes in figure.axes[:3]:
            lines = [len(line.get_xdata()) for line in axes.lines]
            seen.append((min(lines), [text.get_text() for text in axes.texts]))

    monkeypatch.setattr(Figure, "savefig", note)
    module = experiment("question_10")
    module.draw(Store(ROOT / "experiments" / "results", "question_10").rows(), tmp_path / "one.png")
    assert seen == [(4, []), (4, []), (3, ["not run"])]
