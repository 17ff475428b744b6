"""What a map's store survives: half a block, a full disk, another arm, another version, a client that is gone."""

from __future__ import annotations

import contextlib
import errno
import gzip
import json
import math
import os
import pickle
import shutil
import subprocess
import sys
import traceback
import warnings
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import kinseek
from kinseek import maps
from kinseek.maps import block, make, run, store
from kinseek.maps.grid import BLOCK
from kinseek.maps.measures import MEASURES
from map_files import ARM, GRID, SMALL, files, marks

pytest.importorskip("xarray")
pytest.importorskip("zarr")
distributed = pytest.importorskip("distributed")
zstd = pytest.importorskip("numcodecs.zstd")
local_files = pytest.importorskip("kinseek.maps.local_files")


def one_by_one(work: Any, todo: Any, blocks: int, advance: Any, written: Any) -> None:
    for done, index in enumerate(todo):
        run._in_this_process(work, index, blocks - len(todo) + done, blocks, written)


@pytest.fixture(name="finished", scope="module")
def _finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The small map, which tests copy."""
    place = tmp_path_factory.mktemp("finished") / "map.zarr"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(run, "_in_processes", one_by_one)
        maps.reach(ARM, GRID, store=place, **SMALL)
    return place


@pytest.fixture(name="place")
def _place(tmp_path: Path, finished: Path) -> Path:
    """A copy of the small map."""
    return Path(shutil.copytree(finished, tmp_path / "map.zarr"))


def reach(place: Path | None, **options: Any) -> Any:
    """Make the small map, or go on with it."""
    return maps.reach(ARM, GRID, store=place, **SMALL | options)


@pytest.fixture(autouse=True)
def _here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Blocks are done in this process, one after the other, unless a client is given."""
    monkeypatch.setattr(run, "_in_processes", one_by_one)


FORKED = """
import os, signal, sys
import numpy as np
import kinseek
from kinseek import maps

place = sys.argv[1]
arm, grid = kinseek.load("scara4"), maps.Grid((-1, 1, 1), (-1, 1, 1), (-1, 1, 1), maps.orientations(4))
maps.reach(arm, grid, store=place)
dataset, T = maps.open(place), np.eye(4)
maps.at(dataset, T)
child = os.fork()
if not child:
    signal.alarm(20)
    maps.at(dataset, T)
    dataset.reached.values
    os._exit(0)
print(os.waitpid(child, 0)[1])
"""


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_a_child_forked_after_a_map_was_read_can_read_it(tmp_path: Path) -> None:
    command = [sys.executable, "-W", "ignore", "-c", FORKED, str(tmp_path / "map.zarr")]
    assert subprocess.run(command, capture_output=True, text=True, check=True).stdout == "0\n"


@pytest.mark.slow
def test_a_map_goes_on_where_it_stopped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = reach(tmp_path / "whole.zarr")
    computed = []

    def stops(work: Any, index: Any, real: Any = block.compute) -> Any:
        computed.append(index)
        if len(computed) == 5:
            raise OSError(errno.ENOSPC, "No space left on device")
        return real(work, index)

    monkeypatch.setattr(block, "compute", stops)
    with pytest.raises(
        kinseek.MapInterrupted, match=r"No space left on device; 4 of \d+ blocks are done"
    ) as told:
        reach(tmp_path / "part.zarr")
    assert told.value.done == 4
    part = maps.open(tmp_path / "part.zarr")
    known = part.reached.values >= 0
    assert 0.0 < known.mean() < 1.0
    assert (part.reached.values[known] == whole.reached.values[known]).all()
    before = marks(tmp_path / "part.zarr")
    reach(tmp_path / "part.zarr")
    after = marks(tmp_path / "part.zarr")
    assert {path: after[path] for path in before} == before
    assert len(set(computed)) == told.value.blocks == len(computed) - 1
    assert files(tmp_path / "part.zarr") == files(tmp_path / "whole.zarr")


def test_a_task_does_blocks_until_it_has_taken_long_enough(monkeypatch: pytest.MonkeyPatch) -> None:
    work = make.work_of(ARM, GRID, ("reached",), store=None, **make.options_of(SMALL))
    some: list[block.Index] = [(0, 0, 0, 0), (0, 0, 1, 0), (0, 1, 0, 0)]
    made, rest, error = run._in_turn(work, some)
    assert ([index for index, _ in made], rest, error) == (some, [], None)
    monkeypatch.setattr(run, "ENOUGH", 0.0)
    (first,), rest, error = run._in_turn(work, some)
    assert (first[0], rest, error) == (some[0], some[1:], None)
    assert (first[1]["reached"] == made[0][1]["reached"]).all()


def test_a_task_that_meets_a_full_disk_tells_what_it_has_done(monkeypatch: pytest.MonkeyPatch) -> None:
    work = make.work_of(ARM, GRID, ("reached",), store=None, **make.options_of(SMALL))
    full = OSError(errno.ENOSPC, "No space left on device")

    def second(work: Any, index: Any, real: Any = block.do) -> Any:
        if index[2]:
            raise full
        return real(work, index)

    monkeypatch.setattr(run, "do", second)
    made, rest, error = run._in_turn(work, [(0, 0, 0, 0), (0, 0, 1, 0), (0, 1, 0, 0)])
    assert [index for index, _ in made] == [(0, 0, 0, 0)]
    assert (rest, error) == ([(0, 0, 1, 0), (0, 1, 0, 0)], full)


def first_block(place: Path, name: str) -> Path:
    """One of the files with the values of an array."""
    return next(path for path in (place / name / "c").rglob("*") if path.is_file())


def cells_of(dataset: Any, index: tuple[int, ...]) -> tuple[slice, ...]:
    """The cells of a block."""
    chunks = dataset.attrs[store.DESCRIPTION]["chunks"]
    return tuple(slice(i * n, (i + 1) * n) for i, n in zip(index, chunks, strict=True))


def only_unknown(dataset: Any, index: tuple[int, ...]) -> bool:
    """Is nothing known of one block, and something of each cell of all others?"""
    expected = np.ones(dataset.reached.shape, bool)
    expected[cells_of(dataset, index)] = False
    return bool(((dataset.reached.values >= 0) == expected).all())


def test_a_half_written_block_is_made_anew(place: Path) -> None:
    good = files(place)
    chunk = first_block(place, "reached")
    chunk.write_bytes(chunk.read_bytes()[:7])
    (place / "blocks/done" / chunk.relative_to(place / "reached") / "0").unlink()
    reach(place)
    assert files(place) == good


def test_a_store_of_another_map_is_refused(place: Path) -> None:
    before = files(place)
    coarse = maps.Grid((-0.9, 0.9, 0.9), (-0.9, 0.9, 0.3), (-0.3, 0.9, 0.3), maps.orientations(24))
    others: list[tuple[kinseek.Arm, maps.Grid, dict[str, Any], str]] = [
        (kinseek.load("ur10e"), GRID, {}, "name is 'ur5e', requested 'ur10e'"),
        (ARM.with_limits({ARM.joint_names[1]: (-1.0, 1.0)}), GRID, {}, "arm is '.*', requested '.*'"),
        (ARM, coarse, {}, "grid is .* requested"),
        (ARM, GRID, {"position_tolerance": 1e-3}, "position_tolerance is 1e-06, requested 0.001"),
        (ARM, GRID, {"prove": True}, "prove is False"),
    ]
    for arm, grid, options, said in others:
        with pytest.raises(kinseek.InvalidMap, match=said):
            maps.reach(arm, grid, store=place, **{**SMALL, **options})
    assert files(place) == before


def test_a_store_of_a_goal_is_not_one_of_whole_poses(tmp_path: Path) -> None:
    """What the store had and the request had not was not compared, and more cells were reached."""
    maps.reach(ARM, TINY, store=tmp_path / "map", goal=kinseek.Goal.position([0, 0, 0]))
    with pytest.raises(kinseek.InvalidMap, match=r"another map: goal is .*, requested None"):
        maps.reach(ARM, TINY, store=tmp_path / "map")


def test_a_run_does_not_write_into_a_map_that_has_replaced_its_own(
    place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its values had the checksums of the other map."""
    shutil.rmtree(place / "blocks" / "done" / "c")
    begun = run.run

    def replaced(*given: Any) -> None:
        place.rename(place.with_name("moved"))
        monkeypatch.setattr(make, "run", begun)
        monkeypatch.setattr(run, "_in_processes", lambda *work: None)
        maps.reach(kinseek.load("ur10e"), GRID, store=place, **SMALL)
        monkeypatch.setattr(run, "_in_processes", one_by_one)
        begun(*given)

    monkeypatch.setattr(make, "run", replaced)
    with pytest.raises(kinseek.InvalidMap, match="another map has replaced the one in"):
        reach(place)
    assert not (place / "blocks" / "done" / "c").exists()


def test_a_map_that_is_removed_while_it_is_open_is_gone(place: Path) -> None:
    dataset = maps.open(place)
    shutil.rmtree(place)
    with pytest.raises(kinseek.InvalidMap, match="is gone"):
        dataset.load()


def test_a_store_of_another_version_is_refused(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("kinseek.maps.make.version", lambda: "9.9.9+feed")
    with pytest.raises(kinseek.InvalidMap, match=r"version is '.*', requested '9\.9\.9\+feed'"):
        reach(place)


def test_what_travels_is_small_and_blocks_are_as_large_as_they_may_be() -> None:
    wide = maps.Grid((-1, 1, 0.05), (-1, 1, 0.05), (-1, 1, 0.05), maps.orientations(4608))
    plain = make.work_of(ARM, wide, ("reached",), store=None, **make.DEFAULTS)
    assert len(pickle.dumps(plain)) < 10_000
    proved = make.work_of(ARM, wide, ("reached",), store=None, **make.options_of({"prove": True}))
    for work, most in ((plain, BLOCK), (proved, make.PROVED)):
        assert most / 2 < math.prod(work.chunks) <= most


def test_a_folder_that_is_no_map_is_refused(tmp_path: Path) -> None:
    (tmp_path / "letters").mkdir()
    (tmp_path / "letters" / "a.txt").write_text("dear")
    with pytest.raises(kinseek.InvalidMap, match="no map in"):
        reach(tmp_path / "letters")
    with pytest.raises(kinseek.InvalidMap, match="cannot be made"):
        reach(tmp_path / "letters" / "a.txt" / "map.zarr")
    assert [path.name for path in tmp_path.iterdir()] == ["letters"]


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="no user ids here")
def test_a_store_of_another_user_is_read_and_not_written(
    place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mine = os.geteuid()
    (place / "blocks/done/c/0/0/0/0/0").unlink()
    before = files(place)
    monkeypatch.setattr(os, "geteuid", lambda: mine + 1)
    with pytest.raises(kinseek.InvalidMap, match=f"belongs to user {mine}, and this is user {mine + 1}"):
        reach(place)
    assert files(place) == before
    assert only_unknown(maps.open(place), (0, 0, 0, 0))
    work = make.work_of(ARM, GRID, ("reached",), store=str(place), **make.options_of(SMALL))
    assert make.store_of(ARM, GRID, work, True).missing() == [(0, 0, 0, 0)]  # On a cluster.
    monkeypatch.undo()
    assert make.store_of(ARM, GRID, work).missing() == [(0, 0, 0, 0)]


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "getuid"), reason="no user ids here")
@pytest.mark.parametrize(
    ("inner", "bits"),
    [
        (".", 0o775),
        (".", 0o757),
        (".", 0o1777),
        ("reached", 0o775),
        ("reached/c/0", 0o757),
        ("blocks/done/c", 0o775),
    ],
)
def test_a_store_that_others_may_write_to_is_read_and_not_written(
    tmp_path: Path, place: Path, inner: str, bits: int
) -> None:
    """Another user could replace a folder in it by a link to a folder elsewhere, while blocks are written."""
    place = place.rename(tmp_path / "a map.zarr")
    (place / "blocks/done/c/0/0/0/0/0").unlink()
    before = files(place)
    (place / inner).chmod(bits)
    with pytest.raises(
        kinseek.InvalidMap, match=rf"others may write to .*\(mode {bits:o}\).*chmod -R go-w '.*/a map.zarr'"
    ):
        reach(place)
    assert files(place) == before
    assert only_unknown(maps.open(place), (0, 0, 0, 0))
    (place / inner).chmod(bits & ~0o1022)
    assert reach(place).attrs == maps.open(place).attrs


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "getuid"), reason="no user ids here")
@pytest.mark.parametrize("inner", [".", "reached", "blocks/done"])
def test_metadata_that_others_may_write_to_is_read_and_not_believed(
    tmp_path: Path, place: Path, inner: str
) -> None:
    (place / inner / "zarr.json").chmod(0o666)
    with pytest.raises(
        kinseek.InvalidMap, match=r"others may write to .*zarr\.json \(mode 666\).*chmod -R go-w"
    ):
        reach(place)
    assert (maps.open(place).reached.values >= 0).all()
    (place / inner / "zarr.json").rename(tmp_path / "zarr.json")
    (place / inner / "zarr.json").symlink_to(tmp_path / "zarr.json")
    with pytest.raises(kinseek.InvalidMap, match=r"holds a link, '.*zarr\.json'"):
        reach(place)


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root gives folders away")
def test_a_folder_of_another_user_in_a_store_is_refused(place: Path) -> None:
    os.chown(place / "reached" / "c", 65534, -1)
    (place / "reached" / "c").chmod(0)
    with pytest.raises(
        kinseek.InvalidMap, match=r"reached/c belongs to user 65534, and this is user 0.* a copy"
    ):
        reach(place)


def test_what_is_no_store_is_not_to_be_made_private() -> None:
    """The error advised to change the owner of the device."""
    with pytest.raises(kinseek.InvalidMap, match="no map in '/dev/null'"):
        reach(Path("/dev/null"))


def test_a_run_joins_another_that_makes_the_same_store_at_the_same_moment(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It ended with: cannot be made, directory not empty."""
    rename = os.rename

    def late(making: Path, path: Path) -> None:
        monkeypatch.setattr(os, "rename", rename)
        reach(tmp_path / "m.zarr")
        rename(making, path)

    monkeypatch.setattr(os, "rename", late)
    assert reach(tmp_path / "m.zarr").identical(reach(None))
    assert [path.name for path in tmp_path.iterdir()] == ["m.zarr"]


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "getuid"), reason="no permissions here")
@pytest.mark.parametrize("umask", [0o000, 0o002, 0o022, 0o077], ids=oct)
def test_others_may_not_write_to_a_new_store_whatever_the_umask(tmp_path: Path, umask: int) -> None:
    before = os.umask(umask)
    try:
        reach(tmp_path / "parent" / "map.zarr")
    finally:
        os.umask(before)
    place = tmp_path / "parent" / "map.zarr"
    folders = [place.parent, place, *(path for path in place.rglob("*") if path.is_dir())]
    assert {path.stat().st_mode & 0o777 for path in folders} == {0o755 & ~umask}
    assert place / "reached" / "c" / "0" / "0" / "0" in folders
    held = [path for path in place.rglob("*") if path.is_file()]
    assert {path.stat().st_mode & 0o777 for path in held} == {0o644 & ~umask}
    assert {place / "zarr.json", place / "reached" / "c" / "0" / "0" / "0" / "0"} <= {*held}
    reach(place)


@pytest.mark.slow
def test_blocks_are_not_written_through_links(tmp_path: Path, place: Path) -> None:
    victim = tmp_path / "victim"
    shutil.rmtree(place / "blocks" / "done" / "c")  # No block is done.
    shutil.rmtree(place / "reached" / "c" / "0")
    victim.mkdir()
    (place / "reached" / "c" / "0").symlink_to("../../../victim")
    with pytest.raises(kinseek.InvalidMap, match=r"holds a link, 'reached.c.0'"):
        reach(place)
    assert not any(victim.iterdir())
    (place / "reached" / "c" / "0").unlink()
    (tmp_path / "link.zarr").symlink_to("map.zarr")  # The user named this one.
    assert (reach(tmp_path / "link.zarr").reached.values >= 0).all()


class _Trap:
    """Makes a folder when it is unpickled."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def __reduce__(self) -> tuple[Any, tuple[str]]:
        return os.mkdir, (str(self.folder),)


@pytest.mark.parametrize(
    "kind", ["no zarr.json", "zarr.json of format 2", "arrays of format 2", "consolidated metadata"]
)
def test_a_map_from_elsewhere_is_not_unpickled(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # As numcodecs was before 0.16.6.
    monkeypatch.setattr("numcodecs.pickles.ALLOW_UNSAFE_PICKLE_DECODE", True, raising=False)
    place, sprung = tmp_path / "map.zarr", tmp_path / "sprung"
    written: dict[str, Any] = {"blocks/.zgroup": {"zarr_format": 2}}
    array = {
        **{"zarr_format": 2, "shape": [1], "chunks": [1], "dtype": "|O", "order": "C", "fill_value": ""},
        **{"compressor": None, "filters": [{"id": "vlen-utf8"}, {"id": "pickle"}]},
    }
    for name in ("blocks/done", "reached", "x"):
        written[f"{name}/.zarray"] = array
        written[f"{name}/.zattrs"] = {"_ARRAY_DIMENSIONS": ["x"]}
    told = {store.DESCRIPTION: {"variables": ["reached"]}}
    if kind == "no zarr.json":
        (place / "zarr.json").mkdir(parents=True)
        written |= {".zgroup": {"zarr_format": 2}, ".zattrs": told}
    else:
        root = {"zarr_format": 2, "node_type": "group", "attributes": told}
        if kind == "arrays of format 2":
            root |= {"zarr_format": 3}
            for name in ("blocks/done", "reached", "x"):
                written[f"{name}/zarr.json"] = {**array, "node_type": "array", "attributes": {}}
        if kind == "consolidated metadata":
            arrays = {"blocks": {"zarr_format": 2}, "blocks/done": array, "reached": array}
            inline = {"kind": "inline", "must_understand": False, "metadata": arrays}
            root |= {"zarr_format": 3, "consolidated_metadata": inline}
        written["zarr.json"] = root
    for name, content in written.items():
        path = place / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(content))
    for name in ("blocks/done", "reached", "x"):
        (place / name / "0").write_bytes(pickle.dumps(_Trap(sprung)))
    with pytest.raises(kinseek.InvalidMap, match="no map in"):
        maps.open(place)
    with pytest.raises(kinseek.InvalidMap, match="no map in"):
        reach(place)
    assert not sprung.exists()
    pickle.loads((place / "x" / "0").read_bytes())
    assert sprung.exists()


def put(way: list[Any], value: Any, told: Any) -> None:
    """Change one value of some JSON."""
    for key in way[:-1]:
        told = told[key]
    told[way[-1]] = value


def ask(place: Path) -> None:
    """Open a map and ask for all that it can say."""
    dataset = maps.open(place)
    assert "\x1b" not in repr(dataset)
    poses = np.array([kinseek.pose([0.3, 0.1, 0.2], rpy=[0, 1, 0]), kinseek.pose([9, 0, 0])])
    for some in (poses, poses[0], poses[:0]):
        maps.at(dataset, some)
    _ = maps.capability(dataset).values
    for question in (maps.volume, lambda of: maps.expand(of, TINY)):
        with contextlib.suppress(kinseek.InvalidMap):
            question(dataset)


TINY = maps.Grid((-0.6, 0.6, 0.6), (-0.6, 0.6, 0.6), (0, 0.6, 0.6), maps.orientations(8))
RINGS = maps.Rings((0, 0.6, 0.3), (0, 0.6, 0.6), maps.orientations(8))
PROVED: dict[str, Any] = {"prove": True, "depth": 1, "budget": 50}


@pytest.fixture(name="written", scope="module")
def _written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two small maps, of a grid with proofs and of rings."""
    place = tmp_path_factory.mktemp("maps")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(run, "_in_processes", one_by_one)
        maps.reach(ARM, TINY, store=place / "grid", **PROVED)
        maps.reach(ARM, RINGS, store=place / "rings")
    return place


@pytest.fixture(name="grid")
def _grid(tmp_path: Path, written: Path) -> Path:
    """A copy of the map of a grid."""
    return Path(shutil.copytree(written / "grid", tmp_path / "map"))


@pytest.fixture(name="rings")
def _rings(tmp_path: Path, written: Path) -> Path:
    """A copy of the map of rings."""
    return Path(shutil.copytree(written / "rings", tmp_path / "map"))


def rewrite(metadata: Path, change: Callable[[Any], None]) -> None:
    """Change a file of metadata."""
    told = json.loads(metadata.read_text())
    change(told)
    metadata.write_text(json.dumps(told))


def damaged(written: Path, kind: str, name: str, change: Callable[[Any], None]) -> None:
    """Ask a copy of a map for everything, of which one file of metadata is another."""
    place = written / "damaged"
    shutil.rmtree(place, ignore_errors=True)
    shutil.copytree(written / kind, place)
    rewrite(place / name, change)
    ask(place)


ROOT = "zarr.json"
BLOSC: dict[str, Any] = {
    "name": "blosc",
    "configuration": {"typesize": 1, "cname": "lz4", "clevel": 5, "shuffle": "shuffle", "blocksize": 0},
}
"""Its decoder ends the process for some damaged blocks."""
GZIP: dict[str, Any] = {"name": "gzip", "configuration": {"level": 1}}


@pytest.mark.parametrize(
    ("name", "where", "value"),
    [
        (ROOT, ["attributes", "kinseek"], "a map"),
        (ROOT, ["attributes", "kinseek"], {}),
        (ROOT, ["attributes", "kinseek", "variables"], 7),
        (ROOT, ["attributes", "kinseek", "variables"], [["reached"]]),
        (ROOT, ["attributes", "kinseek", "variables"], ["reached"] * 50_000),
        (ROOT, ["attributes", "kinseek", "variables"], ["turn_from", "turn_to"]),
        (ROOT, ["attributes", "kinseek", "grid"], None),
        (ROOT, ["attributes", "kinseek", "grid", "kind"], []),
        (ROOT, ["attributes", "kinseek", "grid", "orientations"], 10**12),
        (ROOT, ["attributes", "kinseek", "grid", "directions"], 10**7),
        (ROOT, ["attributes", "kinseek", "grid", "radius"], [0, 1e9, 1e-9]),
        (ROOT, ["attributes", "kinseek", "chunks"], [0, 1, 8]),
        (ROOT, ["attributes", "kinseek", "first_frame"], "here"),
        (ROOT, ["attributes", "kinseek", "first_turns"], 1e300),
        (ROOT, ["attributes"], []),
        (ROOT, ["padding"], "x" * 2**20),
        ("reached/zarr.json", ["zarr_format"], 2),
        ("reached/zarr.json", ["data_type"], "float64"),
        ("reached/zarr.json", ["shape"], [10**9, 10**9, 8]),
        ("reached/zarr.json", ["codecs"], [{"name": "evil"}]),
        ("reached/zarr.json", ["codecs"], [{"name": "numcodecs.pickle", "configuration": {}}]),
        ("reached/zarr.json", ["codecs"], [{"name": "bytes"}, BLOSC]),
        ("blocks/done/zarr.json", ["codecs"], [{"name": "bytes"}, BLOSC]),
        ("reached/zarr.json", ["codecs"], [{"name": "bytes"}, GZIP]),
        ("reached/zarr.json", ["codecs"], [{"name": "bytes"}, GZIP, {"name": "zstd"}]),
        ("reached/zarr.json", ["fill_value"], 1),
        ("blocks/done/zarr.json", ["shape"], [10**9, 1, 1]),
    ],
)
def test_a_hostile_map_is_refused(name: str, where: list[str], value: Any, written: Path) -> None:
    with pytest.raises(kinseek.InvalidMap):
        damaged(written, "rings", name, partial(put, where, value))


@pytest.mark.parametrize("name", ["reached", "blocks/done"])
@pytest.mark.parametrize("consolidated", [False, True])
def test_a_type_of_gigabytes_is_refused_before_a_value_of_it_is_made(
    name: str, consolidated: bool, written: Path
) -> None:
    """Zarr makes a value of a type when it reads of it, also of those that consolidated metadata name."""
    kind = {"name": "raw_bytes", "configuration": {"length_bytes": 2**31 - 1}}

    def change(told: dict[str, Any]) -> None:
        array = {**told, "data_type": kind, "fill_value": ""}
        told.clear()
        if consolidated:
            there = {"kind": "inline", "must_understand": False, "metadata": {"x": array}}
            told |= {"zarr_format": 3, "node_type": "group", "attributes": {}, "consolidated_metadata": there}
        else:
            told |= array

    with pytest.raises(kinseek.InvalidMap, match=r"describes (a type with parameters|other arrays)"):
        damaged(written, "rings", f"{name}/zarr.json", change)


def _twice(pack: Callable[[bytes], bytes], block: bytes) -> bytes:
    return pack(block) + pack(block)


def _skipped_first(block: bytes) -> bytes:
    return b"\x50\x2a\x4d\x18\x04\0\0\0" + b"skip" + bytes(zstd.compress(block))


@pytest.mark.parametrize(
    "pack", [zstd.compress, partial(_twice, zstd.compress), _skipped_first, gzip.compress, bytes]
)
def test_a_block_that_unpacks_to_more_than_a_block_is_refused_unread(
    pack: Callable[[bytes], bytes], rings: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(local_files, "MOST_BLOCK", 2**20)
    for path in (rings / "reached" / "c").rglob("*"):
        if path.is_file():
            path.write_bytes(pack(bytes(2**20 + 1 if pack is not bytes else 2**10)))
    with pytest.raises(kinseek.InvalidMap, match="does not unpack to at most 1,048,576 bytes"):
        ask(rings)


@pytest.mark.parametrize("name", [ROOT, "reached/zarr.json"])
def test_metadata_that_are_replaced_after_their_check_are_not_used(
    name: str, rings: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = maps.open(rings).load()
    check = store.Store.require_sound
    change = partial(put, ["codecs"], [{"name": "bytes"}, BLOSC])
    if name == ROOT:
        change = partial(put, ["attributes", "kinseek", "chunks"], [10**9] * 3)

    def then_replaced(*given: Any) -> None:
        check(*given)
        rewrite(rings / name, change)

    monkeypatch.setattr(store.Store, "require_sound", then_replaced)
    assert maps.open(rings).load().identical(before)


def test_a_hostile_map_is_not_gone_on_with(rings: Path) -> None:
    for where in (["shape"], ["chunk_grid", "configuration", "chunk_shape"]):
        rewrite(rings / "blocks" / "done" / "zarr.json", partial(put, where, [3 * 10**9, 1, 1]))
    shutil.rmtree(rings / "blocks" / "done" / "c")
    with pytest.raises(kinseek.InvalidMap, match="done"):
        maps.reach(ARM, RINGS, store=rings)


@pytest.mark.parametrize("place", ["~nobody-of-this-name/map", "a\0b", 5])
def test_a_store_that_is_no_path_is_refused(place: Any) -> None:
    for call in (maps.open, partial(maps.reach, ARM, TINY)):
        with pytest.raises(kinseek.InvalidMap, match="path of a folder"):
            call(**{"store": place})


@pytest.mark.parametrize("text", ["", None])
def test_a_map_with_damaged_metadata_is_refused_before_it_is_gone_on_with(
    text: str | None, rings: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.rmtree(rings / "blocks" / "done" / "c")  # Nothing is done.
    metadata = rings / "reached" / "zarr.json"
    if text is None:
        metadata.unlink()
    else:
        metadata.write_text(text)
    monkeypatch.setattr(make, "run", lambda *work: pytest.fail("blocks are computed"))
    with pytest.raises(kinseek.InvalidMap, match="cannot be read"):
        maps.reach(ARM, RINGS, store=rings)


@pytest.mark.parametrize("error", [KeyboardInterrupt, OSError(28, "No space left on device"), RuntimeError])
def test_a_store_that_is_not_finished_leaves_nothing(
    error: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*of: Any) -> None:
        raise error

    monkeypatch.setattr(os, "rename", fail)
    with pytest.raises((KeyboardInterrupt, kinseek.InvalidMap, RuntimeError)):
        maps.reach(ARM, TINY, store=tmp_path / "map")
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(os.name == "nt", reason="links need rights there")
def test_a_link_in_the_place_of_an_unfinished_store_opens_no_folder_of_the_user(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Who may write to the folder around a store may replace the store at any time."""
    import zarr

    home, shared, create = tmp_path / "home", tmp_path / "shared", zarr.create_group
    for folder in (home, home / "private", shared):
        folder.mkdir(mode=0o700)

    def create_and_exchange(files: Any, **options: Any) -> Any:
        group = create(files, **options)
        Path(files.root).rename(shared / "gone")
        Path(files.root).symlink_to(home)
        return group

    monkeypatch.setattr(zarr, "create_group", create_and_exchange)
    with contextlib.suppress(kinseek.InvalidMap):
        maps.reach(ARM, TINY, store=shared / "map")
    assert (home / "blocks").is_dir()
    assert [folder.stat().st_mode & 0o777 for folder in (home, home / "private")] == [0o700, 0o700]


def test_names_in_the_folder_of_a_map_are_not_printed(rings: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Zarr warns of folders that are none of its own, with their names as they are."""
    (rings / "\x1b]0;title\x07").mkdir()
    title = rings / "zarr.json"
    title.write_text(title.read_text().replace('"title": "What', '"title": "\\u001b]0;What'))
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        ask(rings)
        print(maps.open(rings))
    assert not told
    written_out = capfd.readouterr()
    assert "]0;What" in written_out.out
    assert "\x1b" not in written_out.out + written_out.err


@pytest.mark.parametrize(
    ("name", "key", "value"),
    [
        ("zarr.json", "zarr_format", "\x1b]0;title\x07"),
        ("reached/zarr.json", "chunk_grid", {"name": "\x1b]0;title\x07", "configuration": {}}),
    ],
    ids=["group", "array"],
)
def test_tracebacks_show_escapes(name: str, key: str, value: Any, grid: Path) -> None:
    """Python prints the errors that led to an error, too; those of Zarr quote metadata as they are."""
    rewrite(grid / name, partial(put, [key], value))
    with pytest.raises(kinseek.InvalidMap, match="title") as caught:
        maps.open(grid)
    assert "\x1b" not in "".join(traceback.format_exception(caught.value))


def test_a_block_that_cannot_be_decoded_is_said_to_be_so(grid: Path) -> None:
    first_block(grid, "cell").write_bytes(b"no block")
    dataset = maps.open(grid)
    for question in (maps.volume, lambda of: maps.at(of, np.eye(4)), lambda of: maps.expand(of, TINY)):
        with pytest.raises(kinseek.InvalidMap, match="cannot be read"):
            question(dataset)


def test_a_block_with_a_wrong_bit_gives_no_other_numbers(place: Path) -> None:
    dataset = maps.open(place)
    whole = dataset.reached.values
    block = max(
        (each for each in (place / "reached" / "c").rglob("*") if each.is_file()), key=os.path.getsize
    )
    index = tuple(map(int, block.relative_to(place / "reached" / "c").parts))
    content, wrong = block.read_bytes(), []
    there = whole[cells_of(dataset, index)]
    for bit in range(8 * len(content)):
        damaged = bytearray(content)
        damaged[bit // 8] ^= 1 << bit % 8
        block.write_bytes(damaged)
        with contextlib.suppress(kinseek.InvalidMap):
            wrong += [bit] if (dataset.reached.data.blocks[index].compute() != there).any() else []
    assert not wrong


QUESTIONS: list[Callable[[Any], Any]] = [
    lambda of: of.load(),
    lambda of: maps.at(of, maps.Grid.poses(TINY, [slice(None)] * 4)),
    lambda of: maps.capability(of).values,
    lambda of: maps.expand(of, TINY),
]


@pytest.mark.parametrize(
    ("kind", "name"),
    [
        *(("rings", name) for name in ("reached", "turn_from", "turn_to")),
        *(("grid", name) for name in ("cell", "empty_share", "whole_share")),
    ],
)
def test_a_finished_block_that_lacks_a_variable_is_not_read(
    kind: str, name: str, written: Path, tmp_path: Path
) -> None:
    """Its cells were not reached, or not known, or their volume was NaN; the block was never computed again."""
    place = Path(shutil.copytree(written / kind, tmp_path / "map"))
    shutil.rmtree(place / name / "c")
    for question in QUESTIONS[:3]:
        with pytest.raises(kinseek.InvalidMap, match=rf"/{name}/c/0.*' cannot be read.*Remove .*blocks/done"):
            maps.open(place)[[name]].load() if question is QUESTIONS[2] else question(maps.open(place))
    shutil.rmtree(place / "blocks" / "done" / "c")
    again = (
        maps.reach(ARM, RINGS, store=place)
        if kind == "rings"
        else maps.reach(ARM, TINY, store=place, **PROVED)
    )
    assert again.identical(maps.open(written / kind))


@pytest.mark.parametrize("name", ["reached", "branches", "dexterity", "turn_to", "cell", "whole_share"])
def test_a_value_that_was_changed_is_not_read(name: str, everything: Path, tmp_path: Path) -> None:
    import zarr

    place = shutil.copytree(everything, tmp_path / "map")
    array = zarr.open_array(place / name, mode="r+")
    array[0, 0, 0] = 1 if array[0, 0, 0] != 1 else 0  # Both are values of any variable.
    with pytest.raises(
        kinseek.InvalidMap, match=rf"{name}/c/0/0/0' cannot be read.*that were written.*Remove"
    ):
        maps.open(place)[name].load()


def test_blocks_that_are_exchanged_are_not_read(place: Path) -> None:
    one, two = (place / "reached" / "c" / index for index in ("0/0/0/0", "1/0/0/0"))
    block = one.read_bytes()
    one.write_bytes(two.read_bytes())
    two.write_bytes(block)
    with pytest.raises(kinseek.InvalidMap, match="not the values that were written"):
        maps.open(place).load()


@pytest.mark.parametrize(
    ("name", "value"),
    [
        *(("reached", value) for value in (-1, 2, 127)),
        ("branches", -1),
        ("dexterity", -1.0),
        *(("limit_distance", value) for value in (-0.1, 1.1)),
        *(("turn_from", value) for value in (-3.2, 3.2, np.inf)),
        *(("turn_to", value) for value in (-3.2, 9.5, np.inf)),
        *(("cell", value) for value in (-1, 3)),
        *(("empty_share", value) for value in (np.nan, -0.1, 1.1)),
        *(("whole_share", value) for value in (np.nan, -0.1, 1.1)),
    ],
)
def test_values_that_no_map_has_are_not_read(
    name: str, value: float, everything: Path, tmp_path: Path
) -> None:
    """Whoever makes a map may write anything to it, with its checksums."""
    place, index = shutil.copytree(everything, tmp_path / "map"), (0, 0, 0)
    good = maps.open(place).load()
    values = {str(each): good[each].values[cells_of(good, index)] for each in good.data_vars}
    values[name] = np.where(
        np.arange(values[name].size).reshape(values[name].shape) == 3, value, values[name]
    )
    store.Store.at(str(place)).write(index, values)
    with pytest.raises(kinseek.InvalidMap, match=r"computes no such values"):
        maps.open(place)[name].load()


@pytest.fixture(name="everything", scope="module")
def _everything(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A map of rings with all variables."""
    place = tmp_path_factory.mktemp("everything") / "map"
    maps.reach(kinseek.load("panda"), RINGS, [*MEASURES], store=place, **PROVED)
    return place


def test_a_block_of_another_map_is_not_taken_for_one_of_this(place: Path, tmp_path: Path) -> None:
    """As when the files of one map were copied over those of another one of the same grid."""
    other = tmp_path / "other.zarr"
    maps.reach(kinseek.load("ur10e"), GRID, store=other, **SMALL)
    shutil.rmtree(place / "blocks" / "done" / "c" / "0")
    shutil.rmtree(place / "reached" / "c" / "0")
    for name in ("reached", "blocks/done"):
        shutil.copytree(other / name / "c" / "0", place / name / "c" / "0")
    with pytest.raises(kinseek.InvalidMap, match="not the values that were written"):
        maps.open(place).load()


def test_a_description_in_which_one_number_is_another_is_refused(grid: Path) -> None:
    """Its cells were elsewhere."""
    rewrite(grid / ROOT, partial(put, ["attributes", "kinseek", "grid", "x"], [-0.5, 0.7, 0.6]))
    with pytest.raises(kinseek.InvalidMap, match="is damaged"):
        maps.open(grid)


def test_a_mark_that_cannot_be_decoded_is_said_to_be_so(grid: Path) -> None:
    first_block(grid, "blocks/done").write_bytes(b"no mark")
    with pytest.raises(
        kinseek.InvalidMap, match=r"the mark '.*blocks/done/c/.*' of a finished block cannot be read"
    ):
        maps.reach(ARM, TINY, store=grid, **PROVED)


def test_a_map_is_expanded_to_a_grid_alone(written: Path) -> None:
    with pytest.raises(kinseek.InvalidMap, match=r"grid must be a maps\.Grid, got NoneType"):
        maps.expand(maps.open(written / "rings"), None)  # type: ignore[arg-type]


@pytest.mark.parametrize("seconds", [None, -1.0, np.inf, "1"])
def test_a_sample_of_a_map_takes_seconds(seconds: Any) -> None:
    with pytest.raises(kinseek.InvalidMap, match="seconds must be a number from 0 to 1e"):
        maps.estimate(ARM, TINY, seconds=seconds)


NEIGHBOURS = ["{broken", "[]", '{"zarr_format": 3, "node_type": "\\u001b[31m"}']


@pytest.mark.slow
def test_what_lies_beside_the_arrays_is_not_read(written: Path, rings: Path) -> None:
    """Zarr opened all of it at once, and printed a traceback for each file when Python ended."""
    for number in range(300):
        (rings / f"other{number}").mkdir()
        (rings / f"other{number}" / "zarr.json").write_text(NEIGHBOURS[number % len(NEIGHBOURS)])
    read = "import sys; from kinseek import maps; print(sorted(maps.open(sys.argv[1]).variables))"
    ended = subprocess.run(
        [sys.executable, "-c", read, rings], check=False, capture_output=True, text=True, timeout=100
    )
    assert (ended.returncode, ended.stderr) == (0, "")
    assert ended.stdout == f"{sorted(map(str, maps.open(written / 'rings').variables))}\n"


def test_a_description_names_nothing_but_variables(grid: Path) -> None:
    """A file as large as the disk, below an array, was read as the metadata of a variable."""
    (grid / "blocks" / "other").mkdir()
    with (grid / "blocks" / "other" / "zarr.json").open("wb") as file:
        file.truncate(2**40)
    rewrite(grid / ROOT, lambda told: told["attributes"]["kinseek"]["variables"].append("blocks/other"))
    with pytest.raises(kinseek.InvalidMap, match="its variables are"):
        maps.open(grid)
    with pytest.raises(kinseek.InvalidMap, match="variables is"):
        reach(grid)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes here")
@pytest.mark.parametrize("replaced", ["pipe", "device", "large file"])
def test_metadata_that_are_replaced_while_they_are_read(
    replaced: str, grid: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Another user may own the folder, and change it after a look at it."""
    name = grid / "reached" / "zarr.json"

    def exchanged(path: Path, *more: Any, real: Any = Path.stat, **how: Any) -> os.stat_result:
        found: os.stat_result = real(path, *more, **how)
        if path == name:
            name.unlink()
            if replaced == "pipe":
                os.mkfifo(name)
            elif replaced == "device":
                name.symlink_to("/dev/zero")
            else:
                name.write_bytes(b" " * 2**21)
        return found

    monkeypatch.setattr(Path, "stat", exchanged)
    with pytest.raises(kinseek.InvalidMap, match="is not a regular file of at most 1,048,576 bytes"):
        maps.open(grid)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes here")
def test_a_pipe_among_the_metadata_is_not_opened(grid: Path) -> None:
    (grid / "reached" / "zarr.json").unlink()
    os.mkfifo(grid / "reached" / "zarr.json")
    with pytest.raises(kinseek.InvalidMap, match="is not a regular file"):
        maps.open(grid)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes here")
def test_files_of_a_store_are_checked_when_zarr_reads_them_without_asyncio(grid: Path) -> None:
    """Only its other method was checked, and this one waited for a writer of the pipe."""
    os.mkfifo(grid / "pipe")
    store = local_files.LocalFiles(grid, read_only=True)
    with pytest.raises(ValueError, match="'pipe' is not a regular file"):
        store.get_sync("pipe")
    assert store.get_sync("zarr.json").to_bytes() == (grid / "zarr.json").read_bytes()


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes here")
@pytest.mark.parametrize("replaced", ["pipe", "link to a device", "huge file"])
@pytest.mark.parametrize("name", ["cell", "blocks/done"])
def test_a_block_that_is_no_regular_file_is_not_read(name: str, replaced: str, grid: Path) -> None:
    block = first_block(grid, name)
    block.unlink()
    if replaced == "pipe":
        os.mkfifo(block)
    elif replaced == "link to a device":
        block.symlink_to("/dev/zero")
    else:
        with block.open("wb") as file:
            file.truncate(2**40)  # A sparse file, which takes no space on disk.
    dataset = maps.open(grid)
    read: dict[str, Callable[[], Any]] = {
        "cell": partial(maps.volume, dataset),
        "blocks/done": partial(maps.reach, ARM, TINY, store=grid, **PROVED),
    }
    with pytest.raises(kinseek.InvalidMap, match="is not a regular file of at most"):
        read[name]()


def as_a_pipe(place: Path) -> None:
    shutil.rmtree(place / "c")
    os.mkfifo(place / "c")


def as_texts(place: Path) -> None:
    text = {"data_type": "string", "fill_value": "", "codecs": [{"name": "vlen-utf8"}]}
    rewrite(place / "zarr.json", lambda told: told.update(text))
    next(path for path in (place / "c").rglob("*") if path.is_file()).write_bytes(b"\xff" * 4)


def as_nothing(place: Path) -> None:
    shutil.rmtree(place)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes here")
@pytest.mark.parametrize("change", [as_a_pipe, as_texts, as_nothing])
@pytest.mark.parametrize("name", ["x", "orientation", "rotation"])
def test_the_places_of_a_map_are_not_read(
    name: str, change: Callable[[Path], None], grid: Path, written: Path
) -> None:
    """xarray read arrays with the names of dimensions, whatever their type and codecs, when a map was opened."""
    change(grid / name)
    assert maps.open(grid).identical(maps.open(written / "grid"))


@pytest.mark.parametrize(
    "change",
    [
        lambda m: m.isel(x=slice(1, None)),
        lambda m: m.isel(x=0),
        lambda m: m.sortby("x", ascending=False),
        lambda m: m.isel(orientation=[0]),
    ],
)
def test_a_part_of_a_map_is_not_taken_for_the_whole(change: Callable[[Any], Any], grid: Path) -> None:
    """Its cells were counted from its own first one, so the values of other cells were returned."""
    part = change(maps.open(grid))
    with pytest.raises(kinseek.InvalidMap, match="the whole map"):
        maps.at(part, np.eye(4))
    with pytest.raises(kinseek.InvalidMap, match="the whole map"):
        maps.volume(part)


@pytest.fixture(name="client", scope="module")
def _client() -> Iterator[Any]:
    with distributed.Client(
        processes=False, n_workers=1, threads_per_worker=1, dashboard_address=":0"
    ) as client:
        yield client


@pytest.mark.slow
def test_a_client_gives_the_same_bits(tmp_path: Path, client: Any) -> None:
    reach(tmp_path / "here.zarr")
    reach(tmp_path / "there.zarr", client=client)
    assert files(tmp_path / "here.zarr") == files(tmp_path / "there.zarr")
    sent = maps.reach(ARM, GRID, client=client, **SMALL)
    assert (sent.reached.values == maps.open(tmp_path / "here.zarr").reached.values).all()


@pytest.mark.slow
def test_workers_with_another_version_are_refused_by_name(
    client: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    address = next(iter(client.scheduler_info()["workers"]))
    monkeypatch.setattr("kinseek.maps.make.version", lambda: "9.9.9+feed")
    with pytest.raises(kinseek.InvalidMap, match=rf"9\.9\.9\+feed.*{address} has {kinseek.__version__}"):
        maps.reach(ARM, GRID, client=client, store=tmp_path / "map.zarr", **SMALL)


@pytest.mark.slow
def test_a_full_disk_on_a_worker_is_told_in_a_sentence(
    client: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    whole = maps.reach(ARM, GRID, client=client, **SMALL)

    def full(*given: Any) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as while_full:
        while_full.setattr(store.Store, "write", full)
        with pytest.raises(kinseek.MapInterrupted, match="No space left on device; 0 of"):
            reach(tmp_path / "map.zarr", client=client)
    assert "Traceback" not in caplog.text
    again = reach(tmp_path / "map.zarr", client=client)
    assert (again.reached.values == whole.reached.values).all()


@pytest.mark.slow
def test_a_client_that_is_gone(client: Any) -> None:
    gone = distributed.Client(client.scheduler.address)
    gone.close()
    with pytest.raises(kinseek.InvalidMap, match="the client is closed"):
        maps.reach(ARM, GRID, client=gone, **SMALL)
