"""Maps of what is reached without hitting anything: against `Arm.ik` pose by pose, in this process and in others."""

from __future__ import annotations

import pickle
from copy import copy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import kinseek
from kinseek import InvalidMap, InvalidScene, Scene, maps
from kinseek.maps import block
from kinseek.maps.cells import EMPTY, REACHED
from kinseek.maps.run import run

pytest.importorskip("pinocchio")
pytest.importorskip("xarray")
pytest.importorskip("zarr")
pytest.importorskip("distributed")

ARM = kinseek.load("ur5e")
GRID = maps.Grid((-0.9, 0.9, 0.45), (-0.9, 0.9, 0.45), (-0.3, 0.9, 0.4), maps.orientations(24))


@pytest.fixture(scope="module")
def scene() -> Scene:
    scene = Scene.of(ARM, capsules=0.05)
    scene.add_box("table", (1.0, 1.6, 0.04), kinseek.pose([0.55, 0.0, -0.06]))
    scene.add_box("wall", (0.04, 1.6, 1.0), kinseek.pose([0.5, 0.0, 0.45]))
    return scene


@pytest.fixture(scope="module")
def free(scene: Scene) -> Any:
    """A map of two measures, made here: it is one block."""
    return maps.reach(ARM, GRID, ("reached", "branches"), scene=scene, clearance=0.01)


def poses() -> np.ndarray:
    return GRID.poses((slice(None),) * 4)


@pytest.mark.slow
def test_reached_is_what_has_a_free_answer(scene: Scene, free: Any) -> None:
    bare = maps.reach(ARM, GRID)
    reached, before = free.reached.values == 1, bare.reached.values == 1
    assert not (reached & ~before).any()
    lost = before & ~reached
    assert lost.sum() > 10
    T = poses()
    solution = ARM.ik(T[before], scene=scene, clearance=0.01)
    np.testing.assert_array_equal(solution.success, reached[before])
    counts = ARM.branches(T[before], scene=scene, clearance=0.01).counts
    np.testing.assert_array_equal(np.maximum(counts, reached[before]), free.branches.values[before])
    assert "free in the scene" in free.reached.attrs["comment"]


@pytest.mark.slow
def test_a_map_is_of_the_scene_as_it_was_when_it_began(
    scene: Scene, free: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Workers that started after a change by another thread computed cells of another scene."""
    changing = copy(scene)

    def changed(*args: Any) -> None:
        changing.remove("wall")
        run(*args)

    monkeypatch.setattr("kinseek.maps.make.run", changed)
    monkeypatch.setattr(block, "_scratches", {})  # What this process kept of that scene.
    found = maps.reach(ARM, GRID, ("reached", "branches"), scene=changing, clearance=0.01)
    np.testing.assert_array_equal(found.reached.values, free.reached.values)
    np.testing.assert_array_equal(found.branches.values, free.branches.values)
    assert found.attrs == free.attrs


@pytest.mark.slow
def test_a_scene_travels_as_over_a_wire(scene: Scene, free: Any) -> None:
    """What Dask sends comes back in memory that may not be written to."""
    options: Any = {**maps.make.DEFAULTS, "scene": scene, "clearance": 0.01}
    work = maps.make.work_of(ARM, GRID, ("reached", "branches"), store=None, **options)
    buffers: list[pickle.PickleBuffer] = []
    sent = pickle.dumps(work, protocol=5, buffer_callback=buffers.append)
    there = pickle.loads(sent, buffers=[bytes(buffer) for buffer in buffers])
    block._scratches.clear()
    values = block.compute(there, (0, 0, 0, 0))
    for name in ("reached", "branches"):
        np.testing.assert_array_equal(values[name], free[name].values)


@pytest.mark.slow
def test_whole_cells_in_a_scene(scene: Scene) -> None:
    small = maps.Grid((0.3, 1.8, 0.15), (0.0, 0.15, 0.15), (0.0, 0.15, 0.15), maps.orientations(12))
    bare = maps.reach(ARM, small, prove=True, depth=0, budget=300)
    there = maps.reach(ARM, small, prove=True, depth=0, budget=300, scene=scene)
    np.testing.assert_array_equal(there.cell.values == EMPTY, bare.cell.values == EMPTY)
    np.testing.assert_array_equal(there.empty_share.values[there.cell == EMPTY], 1.0)
    assert (bare.cell == EMPTY).any()
    np.testing.assert_array_equal(there.cell.values == REACHED, there.reached.values == 1)
    assert ((bare.cell == REACHED) & (there.cell != REACHED)).any()
    assert maps.volume(there).touched < maps.volume(bare).touched


def test_nothing_is_proved_to_be_reached_wholly_in_a_scene(scene: Scene) -> None:
    """That every pose of a ball has an answer is proved, and not that one of them is free."""
    fine = maps.Grid((0.1, 0.7, 0.02), (-0.3, 0.3, 0.02), (0.0, 0.6, 0.02), maps.orientations(500_000))
    part = tuple(slice(i, i + 1) for i in (19, 1, 17, 362_185))
    told = []
    for options in ({}, {"scene": scene}, {"scene": scene, "clearance": 0.01}):
        asked = maps.make.options_of({"prove": True, "depth": 4, "block": 2**20, **options})
        work = maps.make.work_of(ARM, fine, ("reached",), store=None, **asked)
        told.append(block.answered(work, block.scratch_of(work), fine.poses(part), part))
    assert [float(values["whole_share"].item()) for values in told] == [1.0, 0.0, 0.0]
    assert told[0]["cell"].item() == REACHED


def test_a_store_of_another_scene_is_refused(scene: Scene, tmp_path: Path) -> None:
    tiny = maps.Grid((0.3, 0.6, 0.3), (0.0, 0.3, 0.3), (0.2, 0.5, 0.3), maps.orientations(2))
    place = tmp_path / "map.zarr"
    maps.reach(ARM, tiny, store=place, scene=scene)
    maps.reach(ARM, tiny, store=place, scene=scene)
    other = Scene.of(ARM, capsules=0.05)
    other.add_box("table", (1.0, 1.6, 0.05), kinseek.pose([0.55, 0.0, -0.06]))
    for options in ({"scene": other}, {"scene": scene, "clearance": 0.01}, {}):
        with pytest.raises(InvalidMap, match=r"another map: (scene|clearance) "):
            maps.reach(ARM, tiny, store=place, **options)


def test_the_digest_is_of_what_answers_depend_on(scene: Scene) -> None:
    one = Scene.of(ARM, capsules=0.05)
    known = {one.digest}

    def is_new() -> bool:
        new = one.digest not in known
        known.add(one.digest)
        return new

    one.add_box("box", (0.1, 0.1, 0.1), kinseek.pose([1, 0, 0]))
    assert is_new()
    first = one.digest
    one.remove("box")
    assert not is_new()
    one.add_box("box", (0.1, 0.1, 0.2), kinseek.pose([1, 0, 0]))
    assert is_new()
    one.remove("box")
    one.add_box("box", (0.1, 0.1, 0.1), kinseek.pose([1, 0, 1e-9]))
    assert is_new()
    one.allow("box", "forearm_link")
    assert is_new()
    one.remove("box")
    one.add_box("box", (0.1, 0.1, 0.1), kinseek.pose([1, 0, 0]))
    assert one.digest == first == pickle.loads(pickle.dumps(one)).digest
    assert Scene.of(ARM, capsules=0.05, padding=0.01).digest != Scene.of(ARM, capsules=0.05).digest


def test_what_makes_no_map(scene: Scene) -> None:
    rings = maps.Rings((0.0, 1.0, 0.5), (0.0, 1.0, 0.5), maps.orientations(2))
    with pytest.raises(InvalidMap, match="obstacles do not; use a Grid"):
        maps.reach(ARM, rings, scene=scene)
    with pytest.raises(InvalidMap, match="give scene="):
        maps.reach(ARM, GRID, clearance=0.01)
    with pytest.raises(InvalidScene, match="this scene is of 'ur5e'"):
        maps.reach(kinseek.load("panda"), GRID, scene=scene)
    with pytest.raises(InvalidScene, match="clearance must be a length"):
        maps.reach(ARM, GRID, scene=scene, clearance=-1.0)
    with pytest.raises(InvalidScene, match=r"must be a kinseek\.Scene"):
        maps.reach(ARM, GRID, scene="cell.urdf")  # type: ignore[arg-type]
