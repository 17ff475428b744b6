"""Maps whose files are damaged: each answer is that of the undamaged map, or unknown, or an error.

    python -m tests.fuzz.maps --count 2000 --seed 0 [--show 7]

Who places a robot by a map relies on its numbers. Files of small maps are damaged at random: wrong bits, lost and exchanged
files, other metadata, other values. `--show I` tells what case I damages. A map may end as `equal`, as `unknown` (blocks
without a mark), or as `refused`. Findings: `DIFFERENT` (other numbers), `SLOW`, `LARGE` and `RAISED`.
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import os
import resource
import shutil
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from random import Random
from typing import Any, NamedTuple
from unittest import mock

import numpy as np

import kinseek
from kinseek import maps
from kinseek.errors import InvalidMap, KinseekError
from kinseek.maps import run
from kinseek.maps.measures import MEASURES
from kinseek.maps.store import DESCRIPTION
from kinseek.maps.variables import VARIABLES

MOST_SECONDS = 5.0
MOST_MEMORY = 2**28
"""By which asking one of these small maps may raise the largest memory of the process, in bytes."""
FINE = ("equal", "unknown", "refused")
CONTINUED = 0.3
"""Share of the cases in which the map is continued, too."""

GRID = maps.Grid((-0.6, 0.6, 0.6), (-0.6, 0.6, 0.6), (0, 0.6, 0.6), maps.orientations(8))
RINGS = maps.Rings((0, 1.8, 0.6), (0, 1.2, 0.6), maps.orientations(8))
PROVED: dict[str, Any] = {"prove": True, "depth": 1, "budget": 50}
ARM = kinseek.load("ur5e")
POSES = np.concatenate(
    [
        ARM.fk(np.random.default_rng(0).uniform(-2, 2, (60, ARM.dof))),
        GRID.poses([slice(None)] * 4).reshape(-1, 4, 4),
    ]
)


class Kind(NamedTuple):
    """What makes a map."""

    arm: kinseek.Arm
    grid: maps.Grid | maps.Rings
    options: dict[str, Any]

    def made(self, place: Path, **more: Any) -> Any:
        """The map in a store, begun or continued in this process."""
        with mock.patch.object(run, "_in_processes", one_by_one):
            return maps.reach(self.arm, self.grid, [*MEASURES], store=place, block=16, **self.options, **more)


def one_by_one(work: Any, todo: Any, blocks: int, advance: Any, written: Any) -> None:
    for index in todo:
        run._in_this_process(work, index, 0, blocks, written)


KINDS = {
    "grid": Kind(ARM, GRID, {}),
    "proved": Kind(ARM, GRID, PROVED),
    "rings": Kind(kinseek.load("panda"), RINGS, PROVED),
}

VALUES: list[Any] = [
    *(None, True, -1, 0, 1, 0.5, 2**31, 2**63, 10**30, 1e308, math.nan, math.inf, [10**9] * 4, [None], ["x"]),
    *("", "x", "../..", "\x1b]0;title\x07", "pickle", "big", "datetime64[ns]", [], {}, {"a": 1}),
]
"""What is put in the place of a value of metadata."""


def files_in(place: Path) -> list[Path]:
    return sorted(path for path in place.rglob("*") if path.is_file())


def any_file(random: Random, place: Path) -> Path:
    """A file: metadata, a mark or values, each as often."""
    kinds: dict[str, list[Path]] = {}
    for path in files_in(place):
        kind = "metadata" if path.name == "zarr.json" else path.relative_to(place).parts[0]
        kinds.setdefault(kind, []).append(path)
    return random.choice(kinds[random.choice(sorted(kinds))]) if kinds else place / "nothing"


def change_bytes(random: Random, place: Path) -> str:
    """Change the content of a file."""
    path = any_file(random, place)
    if not path.is_file():
        return "nothing is left"
    content = bytearray(path.read_bytes())
    how = random.choice(("bit", "bits", "cut", "longer", "zeros", "empty"))
    if how in ("bit", "bits"):
        for _ in range(1 if how == "bit" else random.randint(2, 20)):
            at = random.randrange(max(len(content), 1))
            content[at : at + 1] = bytes(each ^ (1 << random.randrange(8)) for each in content[at : at + 1])
    elif how == "cut":
        del content[random.randrange(max(len(content), 1)) :]
    elif how == "longer":
        content += random.randbytes(random.randint(1, 30))
    else:
        content = bytearray(len(content) if how == "zeros" else 0)
    path.write_bytes(content)
    return f"{how} of {path.relative_to(place)}"


def lose(random: Random, place: Path) -> str:
    """Remove a file or a folder, or put something else there."""
    path = any_file(random, place)
    for _ in range(random.choice((0, 0, 0, 1, 2, 3))):
        path = path.parent if path.parent != place else path
    if not path.exists():
        return "nothing is left"
    shutil.rmtree(path) if path.is_dir() else path.unlink()
    how = random.choice(("nothing", "nothing", "folder", "pipe", "link"))
    if how == "folder":
        path.mkdir()
    elif how == "pipe":
        os.mkfifo(path)
    elif how == "link":
        path.symlink_to("nowhere")
    return f"{how} instead of {path.relative_to(place)}"


def exchange(random: Random, place: Path) -> str:
    """Copy a file to the place of another one."""
    there = files_in(place)
    if len(there) < 2:
        return "nothing is left"
    one, two = random.sample(there, 2)
    two.write_bytes(one.read_bytes())
    return f"{one.relative_to(place)} in the place of {two.relative_to(place)}"


def change_metadata(random: Random, place: Path) -> str:
    """Change a value of metadata."""
    metadata = [path for path in files_in(place) if path.name == "zarr.json"]  # Not pipes, which would wait.
    path = random.choice(metadata or [place / "nothing"])
    try:
        told = json.loads(path.read_text())
        way = random.choice(list(ways(told)))
    except (OSError, ValueError, IndexError):
        return "nothing is left"
    node = told
    for key in way[:-1]:
        node = node[key]
    if random.random() < 0.2:
        del node[way[-1]]
    elif isinstance(node[way[-1]], int | float) and random.random() < 0.5:
        node[way[-1]] *= random.choice((0, -1, 0.5, 2, 1.25))
    else:
        node[way[-1]] = random.choice(VALUES)
    path.write_text(json.dumps(told))
    return f"{'/'.join(map(str, way))} of {path.relative_to(place)}"


def ways(node: Any, *way: Any) -> Iterator[tuple[Any, ...]]:
    """Keys and numbers that lead to each value in some JSON."""
    for key in list(node) if isinstance(node, dict) else range(len(node)) if isinstance(node, list) else ():
        yield (*way, key)
        yield from ways(node[key], *way, key)


def change_value(random: Random, place: Path) -> str:
    """Write a value that no cell has, with Zarr."""
    import zarr

    name = random.choice([*VARIABLES])
    if any(path.is_fifo() for path in (place / name).rglob("*")):
        return "nothing is written: Zarr would wait for a pipe"
    try:
        array = zarr.open_array(place / name, mode="r+")
        cell = tuple(random.randrange(n) for n in array.shape)
        array[cell] = value = random.choice((0, 1, 2, -1, 99, 0.5))
    except Exception as error:  # Of files that were damaged before.
        return f"nothing is written: {error!r:.100}"
    return f"{name} is {value} at {cell}"


def mix(random: Random, place: Path) -> str:
    """Put blocks of another map, with their marks, in the place of some."""
    other = place.parent / "other"
    blocks = [path.relative_to(other / "reached") for path in files_in(other / "reached/c")]
    some = random.sample(blocks, random.randint(1, len(blocks)))
    for path in files_in(other):
        if any(str(block) in str(path) for block in some):
            shutil.copy(path, place / path.relative_to(other))
    return f"{len(some)} blocks of another map"


DAMAGES: list[Callable[[Random, Path], str]] = [
    change_bytes,
    lose,
    exchange,
    change_metadata,
    change_value,
    mix,
]


def damaged(number: int, seed: int, folder: Path) -> tuple[str, Path, str]:
    """The map of this number, always the same: its kind, its store in the folder, and what is damaged."""
    random = Random(f"{seed}:{number}")
    kind, place = [*KINDS][number % len(KINDS)], folder / "map"
    for name, source in (("map", f"{kind} whole"), ("other", f"{kind} other")):
        shutil.rmtree(folder / name, ignore_errors=True)
        shutil.copytree(folder / source, folder / name)
    told = []
    for _ in range(random.choice((1, 1, 1, 2, 3))):
        try:
            told.append(random.choice(DAMAGES)(random, place))
        except OSError as error:  # It was damaged before.
            told.append(f"nothing: {error!r:.100}")
    return kind, place, "; ".join(told)


def prepare(folder: Path) -> dict[str, Any]:
    """Make the maps that are damaged, and others of the same cells, in a folder; the undamaged ones, loaded."""
    whole = {}
    for name, kind in KINDS.items():
        whole[name] = kind.made(folder / f"{name} whole").load()
        kind.made(folder / f"{name} other", patience=500)
    return whole


def answers(dataset: Any) -> dict[str, Any]:
    """All that a map tells of some poses and of the whole, or the errors."""
    questions: dict[str, Callable[[], Any]] = {
        "at": lambda: list(maps.at(dataset, POSES).values()),
        "capability": lambda: [maps.capability(dataset).values],
        "volume": lambda: [np.array(maps.volume(dataset, what)) for what in ("poses", "positions")],
        "expand": lambda: [each.values for each in maps.expand(dataset, GRID).variables.values()],
    }
    told = {}
    for name, question in questions.items():
        try:
            told[name] = question()
        except InvalidMap as error:
            told[name] = error
    return told


def ending(kind: str, place: Path, whole: Any, continued: bool) -> str:
    """How asking a damaged map ends."""
    try:
        dataset = maps.open(place)
    except InvalidMap:
        return continuing(kind, place, whole) if continued else "refused"
    lazy, loaded, lost = answers(dataset), dataset, []
    for name in whole.data_vars:
        try:
            loaded = loaded.assign({name: dataset[name].load()})
        except InvalidMap:
            lost.append(name)
            loaded = loaded.assign({name: whole[name]})  # No answer that needs it may be another one.
    found = compared(loaded.drop_vars(lost), whole.drop_vars(lost))
    if found not in FINE:
        return found
    for name, right in answers(loaded).items():
        if not (isinstance(lazy[name], InvalidMap) or same(lazy[name], right)):
            return f"DIFFERENT {name}"
    if continued:
        return continuing(kind, place, whole)
    return "refused" if lost else found


def continuing(kind: str, place: Path, whole: Any) -> str:
    """How continuing a damaged map ends."""
    try:
        again = compared(KINDS[kind].made(place).load(), whole)
    except KinseekError:
        return "refused"
    return again if again == "equal" else f"DIFFERENT {again} after it was continued"


def same(one: Any, other: Any) -> bool:
    """Are two lists of arrays the same?"""
    return not isinstance(other, InvalidMap) and all(
        a.dtype == b.dtype and np.array_equal(a, b, equal_nan=a.dtype.kind == "f")
        for a, b in zip(one, other, strict=True)
    )


def compared(dataset: Any, whole: Any) -> str:
    """Is each block of a map that of another one, or unknown?"""
    description = whole.attrs[DESCRIPTION]
    names, chunks = [*whole.data_vars], description["chunks"]
    if dataset.attrs[DESCRIPTION] != description or {*dataset.variables} != {*whole.variables}:
        return "DIFFERENT description"
    for name, each in whole.variables.items():
        if dataset[name].attrs != each.attrs or dataset[name].dims != each.dims:
            return f"DIFFERENT attributes of {name}"
        if name not in names and not same([dataset[name].values], [each.values]):
            return f"DIFFERENT {name}"
    unknown = 0
    for first in itertools.product(
        *(range(0, n, k) for n, k in zip(description["shape"], chunks, strict=True))
    ):
        part = tuple(slice(i, i + k) for i, k in zip(first, chunks, strict=True))
        block, right = ([each[name].values[part] for name in names] for each in (dataset, whole))
        nothing = [np.full_like(each, np.nan if each.dtype.kind == "f" else -1) for each in right]
        if same(block, nothing):
            unknown += 1
        elif not same(block, right):
            return f"DIFFERENT block at {first}"
    return "unknown" if unknown else "equal"


def judged(number: int, seed: int, folder: Path, whole: dict[str, Any]) -> tuple[str, str]:
    """What of a map is damaged, and how asking it ends."""
    kind, place, told = damaged(number, seed, folder)
    continued = Random(f"{seed}:{number}:").random() < CONTINUED
    began, memory = time.process_time(), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    try:
        found = ending(kind, place, whole[kind], continued)
    except Exception as error:  # A finding, whatever it is.
        return told, f"RAISED {error!r}"
    if time.process_time() - began > MOST_SECONDS:
        return told, "SLOW"
    if (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - memory) * 1024 > MOST_MEMORY:
        return told, "LARGE"
    return told, found


def endings(numbers: range, seed: int) -> Iterator[tuple[int, str, str]]:
    """Of each case: its number, what of its map is damaged, and how asking it ended."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        whole = prepare(folder)
        for number in numbers:
            yield number, *judged(number, seed, folder, whole)


def main() -> int:
    """Run the command that stands at the head of this file."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--count", type=int, default=2_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--show", type=int)
    chosen = parser.parse_args()
    numbers = range(chosen.count) if chosen.show is None else range(chosen.show, chosen.show + 1)
    counts: Counter[str] = Counter()
    for number, told, found in endings(numbers, chosen.seed):
        counts[found.split()[0]] += 1
        if found not in FINE or chosen.show is not None:
            print(f"case {number}, {told}: {found}", flush=True)
    print(f"{len(numbers)} maps: {dict(sorted(counts.items()))}")
    return int(any(name not in FINE for name in counts))


if __name__ == "__main__":
    sys.exit(main())
