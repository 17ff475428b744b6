"""Maps from the shell, and their pictures."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import kinseek
from command_line import CommandLine
from kinseek import maps, plots

pytest.importorskip("xarray")
pytest.importorskip("zarr")
pytest.importorskip("distributed")


@pytest.mark.slow
def test_a_map_from_the_shell(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cli: CommandLine) -> None:
    monkeypatch.chdir(tmp_path)
    coarse = "--step 0.5 --orientations 12 --store m.zarr"
    ended = cli("map ur5e", coarse, "--picture m.png --json")
    told = ended.facts
    assert f"{told['cells']:,} cells at" in ended.err
    assert Path("m.png").stat().st_size > 1000
    m = maps.open("m.zarr")
    assert told["cells"] == m.reached.size
    assert told["reached"] == pytest.approx(float((m.reached == 1).mean()))
    assert "add --resume" in cli("map ur5e", coarse, code=2).err
    cli("map ur5e", coarse, "--resume")
    assert "has another map" in cli("map ur10e", coarse, "--resume", code=2).err


@pytest.mark.slow
def test_a_picture_does_not_obey_the_working_folder(tmp_path: Path) -> None:
    (tmp_path / "matplotlibrc").write_text("no.such.key: 1\nbackend: module://nowhere\ntext.usetex: True\n")
    words = ["map", "planar2", "--step", "1", "--orientations", "12", "--picture", "m.png"]
    done = subprocess.run(
        [sys.executable, "-m", "kinseek", *words], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "matplotlibrc" not in done.stderr
    assert (tmp_path / "m.png").is_file()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("--resume", "--resume needs --store FOLDER"),
        ("--step 0", "positive length"),
        ("--range '0 1 2'", "--range needs 6 numbers, got 3: 0 1 2"),
        ("--range 'a b c d e f'", "--range: 'a' is not a number"),
        ("--step 0.3 --range '-1 1 -1 1 0 1'", "must divide its range"),
        ("--step 0.0005", "too large"),
        ("--what speed", "unknown measure 'speed'"),
        ("--picture m.jpg", "must end in .png"),
        ("--depth -1 --prove", "depth must be"),
    ],
)
def test_misuse_at_the_shell(
    words: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cli: CommandLine
) -> None:
    monkeypatch.chdir(tmp_path)
    out, err = cli("map ur5e", words, code=2)
    assert said in err
    assert out == ""
    assert list(tmp_path.iterdir()) == []


@pytest.fixture(name="drawn", scope="module")
def _drawn() -> dict[str, Any]:
    arm, even = kinseek.load("ur5e"), maps.orientations(12)
    grid = maps.Grid((-1.0, 1.0, 0.5), (-1.0, 1.0, 0.5), (-0.5, 1.0, 0.5), even)
    rings = maps.Rings((0.8, 1.2, 0.2), (0.0, 0.4, 0.2), even)
    return {
        "grid": maps.reach(arm, grid),
        "rings": maps.reach(arm, rings, prove=True, depth=0, budget=50),
        "bases": maps.best_base(arm, arm.fk(arm.sample(2)), np.tile(np.eye(4), (3, 1, 1))),
    }


@pytest.mark.slow
def test_a_slice_shows_the_shares(drawn: dict[str, Any]) -> None:
    m = drawn["grid"]
    figure = plots.map_slice(m, z=0.25)
    image = figure.axes[0].images[0]
    share = maps.capability(m).sel(z=0.25).transpose("y", "x").values
    assert np.asarray(image.get_array()) == pytest.approx(share)
    assert image.get_extent() == pytest.approx([-1.0, 1.0, -1.0, 1.0])
    again = plots.map_slice(maps.capability(m), z=0.25).axes[0]
    np.testing.assert_array_equal(again.images[0].get_array(), image.get_array())
    assert again.get_title() == figure.axes[0].get_title()
    one = plots.map_slice(m, orientation=3, x=0.25).axes[0]
    assert {text.get_text().split(":")[0] for text in one.get_legend().get_texts()} <= {
        "reached",
        "no answer found",
    }
    rings = plots.map_slice(drawn["rings"], orientation=0).axes[0]
    assert rings.get_xlabel() == "radius [m]"


@pytest.mark.slow
def test_other_pictures_of_maps(drawn: dict[str, Any]) -> None:
    dots = plots.cloud(drawn["grid"], cut=False).axes[0].collections[0]
    shown = (maps.capability(drawn["grid"]) >= 0.05).sum()
    assert len(dots.get_offsets()) == int(shown)
    same = plots.cloud(maps.capability(drawn["grid"]), cut=False).axes[0].collections[0]
    np.testing.assert_array_equal(same.get_offsets(), dots.get_offsets())
    rings = plots.map_slice(maps.capability(drawn["rings"])).axes[0]
    assert rings.get_xlabel() == "radius [m]"
    lines = plots.volumes([drawn["rings"]]).axes[0].lines
    assert [float(line.get_ydata()[0]) for line in lines] == list(maps.volume(drawn["rings"]))[::-1]
    assert len(plots.bases(drawn["bases"]).axes[0].collections[0].get_offsets()) == 3


@pytest.mark.slow
def test_places_that_differ_in_yaw_alone_are_seen_apart() -> None:
    from matplotlib.quiver import Quiver

    arm = kinseek.load("ur5e")
    yaws = [-2.0, 0.0, 1.0]
    candidates = np.array([kinseek.pose([0.1 * (yaw > 0), 0, 0], rpy=[0, 0, yaw]) for yaw in yaws])
    ranked = maps.best_base(arm, arm.fk(arm.sample(2)), candidates)
    axes = plots.bases(ranked).axes[0]
    all_arrows, best = [each for each in axes.collections if isinstance(each, Quiver)]
    found = sorted(np.arctan2(all_arrows.V, all_arrows.U))
    assert found == pytest.approx(yaws)
    yaw = yaws[int(ranked["number"][0])]
    assert np.ravel([best.U, best.V]) == pytest.approx([np.cos(yaw), np.sin(yaw)])
    apart = candidates.copy()
    apart[:, 0, 3] = [0.0, 0.1, 0.2]
    axes = plots.bases(maps.best_base(arm, arm.fk(arm.sample(2)), apart)).axes[0]
    assert not any(isinstance(each, Quiver) for each in axes.collections)


@pytest.mark.slow
def test_misuse_of_pictures_is_told(drawn: dict[str, Any]) -> None:
    with pytest.raises(kinseek.InvalidUse, match="map_slice"):
        plots.cloud(drawn["rings"])
    with pytest.raises(kinseek.InvalidUse, match="already"):
        plots.map_slice(drawn["rings"], y=0.1)
    with pytest.raises(kinseek.InvalidUse, match="orientation must be"):
        plots.map_slice(drawn["grid"], orientation=99)
    with pytest.raises(kinseek.InvalidUse, match="the position of the plane"):
        plots.map_slice(drawn["grid"], w=0.1)
    with pytest.raises(kinseek.InvalidMap, match="this is not a map"):
        plots.map_slice(drawn["grid"]["reached"])
    with pytest.raises(kinseek.InvalidUse, match="no separate orientations: give the map itself"):
        plots.map_slice(maps.capability(drawn["grid"]), orientation=1)
    for where, words in (
        ({"z": np.nan}, "z must be a finite"),
        ({"z": "a"}, "z must"),
        ({"z": None}, "z must"),
    ):
        with pytest.raises(kinseek.InvalidUse, match=words):
            plots.map_slice(drawn["grid"], **where)
    for orientation in (1.5, "0", True):
        with pytest.raises(kinseek.InvalidUse, match="orientation must be a whole number"):
            plots.map_slice(drawn["grid"], orientation=orientation)  # type: ignore[arg-type]
    with pytest.raises(kinseek.InvalidUse, match=r"ranked must be a result of maps\.best_base, got Dataset"):
        plots.bases(drawn["grid"])
    with pytest.raises(kinseek.InvalidUse, match="at least one map"):
        plots.volumes([])


@pytest.mark.slow
@pytest.mark.parametrize("part", [{"x": slice(None, None, 2)}, {"orientation": slice(4, None)}, {"z": 0}])
def test_a_part_of_a_map_is_not_drawn_as_the_whole(drawn: dict[str, Any], part: dict[str, Any]) -> None:
    """Its cells were stretched over the whole, and orientations had the numbers of others."""
    some = drawn["grid"].isel(part)
    for draw in (plots.map_slice, plots.cloud):
        with pytest.raises(kinseek.InvalidMap, match=r"are not those of the map's grid"):
            draw(some)


def test_the_estimate_has_the_start_of_processes_in_it(monkeypatch: pytest.MonkeyPatch) -> None:
    from kinseek.maps import cost

    monkeypatch.setattr(cost, "_processes", lambda: 1000.0)
    arm = kinseek.load("ur5e")
    grid = maps.Grid((-1.0, 1.0, 0.5), (-1.0, 1.0, 0.5), (-0.5, 1.0, 0.5), maps.orientations(12))
    one, many = (maps.estimate(arm, grid, seconds=0.0, block=block) for block in (grid.size, grid.size // 4))
    cluster = maps.estimate(arm, grid, seconds=0.0, block=grid.size // 4, cores=2)
    assert max(one.start, cluster.start) < 500.0 < 1000.0 <= many.start
    assert many.duration >= many.start > 0.0
    assert "16.7 min" in str(many)


def test_an_estimate_with_proofs_takes_few_cells_if_they_take_long(monkeypatch: pytest.MonkeyPatch) -> None:
    """It computed nine rows of 64 cells, 94 s with a depth of 14."""
    from kinseek.maps import cost

    def slow(work: Any, scratch: Any, poses: Any, part: Any) -> None:
        computed.append(len(poses.reshape(-1, 16)))
        time.sleep(0.01 * computed[-1])

    computed = list[int]()
    monkeypatch.setattr(cost, "answered", slow)
    grid = maps.Grid((-1.0, 1.0, 0.5), (-1.0, 1.0, 0.5), (-0.5, 1.0, 0.5), maps.orientations(72))
    found = maps.estimate(kinseek.load("ur5e"), grid, seconds=0.1, prove=True, block=grid.size)
    assert max(computed) == 1
    assert found.tried == len(computed) - 2
    assert found.seconds == pytest.approx(0.01, rel=0.5)


def test_an_estimate_of_processes_asks_for_what_they_need(
    monkeypatch: pytest.MonkeyPatch, cli: CommandLine
) -> None:
    from kinseek.maps import cost

    cost._processes.cache_clear()
    monkeypatch.setitem(sys.modules, "zarr", None)
    heard = cli("map ur5e --step 0.05 --estimate", code=2).err
    assert "pip install 'kinseek[maps]'" in heard
