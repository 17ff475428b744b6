"""Random mesh files, valid and mutated: kinseek reads the shape that a strict reader reads, or refuses.

    python -m tests.fuzz.meshes --count 20000 --seed 0 [--kind dae]

A body that is lost, moved or scaled without a word hides a collision. The files are COLLADA, GLB, OBJ, PLY and STL in turns;
`--show I` prints file I. `tests/fuzz/judges` has the strict readers, one for each format. A file may end as `equal`, as
`refused`, or as `harmless` for a reason of a short list. Findings: `DIFFERENT` (another shape), `TURNED` (triangles of the
other orientation), `ALONE` (kinseek reads what the judge does not know), `VALID REFUSED` (a file without mutations), `SLOW`,
`LARGE` and `RAISED`.
"""

from __future__ import annotations

import argparse
import resource
import sys
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from random import Random

import numpy as np
from numpy.typing import NDArray

from kinseek.errors import InvalidRobot
from kinseek.meshes.parts import mesh_parts

from .judges import JUDGES, Polygons, Unknown
from .mesh_makers import MAKERS

Array = NDArray[np.float64]

TOLERANCE = 1e-9
"""Of the largest coordinate: products of motions are rounded."""
FLAT = 1e-4
"""Of the size of a polygon: how far its triangles may reach out of it. docs/security.md allows as much."""
MOST_SECONDS = 5.0
MOST_MEMORY = 2**28
"""By which reading one of these small files may raise the largest memory of the process, in bytes."""
FINE = ("equal", "refused", "harmless")
HARMLESS = {
    "overflow": "A coordinate beyond 1e308 m in one order of products may be below it in another; scenes take 1e6 m.",
    "flat motion": "A body that its node makes flat has no inner side, and rounding decides which side is the outer one.",
}
"""What a judge does not know, though any reading of it is right."""


def case(number: int, seed: int, kinds: Sequence[str]) -> tuple[str, int, bytes]:
    """The file of this number, always the same: its kind, how often it was mutated, and its text."""
    random = Random(f"{seed}:{number}")
    kind, mutations = kinds[number % len(kinds)], random.choice((0, 1, 1, 1, 2, 3))
    return kind, mutations, MAKERS[kind](random, mutations)


def judged(path: Path, kind: str, mutations: int) -> str:
    """How reading a file ends, and why."""
    began, memory = time.process_time(), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            parts = [part.vertices[part.faces] for part in mesh_parts(path)]
        ours, why = np.concatenate([np.zeros((0, 3, 3)), *parts]), ""
    except InvalidRobot as error:
        ours, why = None, str(error)
    except Exception as error:  # A finding, whatever it is.
        return f"RAISED {error!r}"
    if time.process_time() - began > MOST_SECONDS:
        return "SLOW"
    if (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - memory) * 1024 > MOST_MEMORY:
        return "LARGE"
    if ours is None and mutations:
        return "refused"
    try:
        theirs = JUDGES[kind](path.read_bytes())
    except Unknown as error:
        if ours is None:
            return "refused"
        return "harmless" if str(error) in HARMLESS else f"ALONE {error}"
    return f"VALID REFUSED {why}" if ours is None else compared(ours, theirs)


def compared(ours: Array, theirs: Polygons, tolerance: float = TOLERANCE) -> str:
    """Are triangles, (k, 3, 3), those of polygons, in any order, each divided from any corner that sees the others?"""
    points = np.concatenate([np.zeros((0, 3)), ours.reshape(-1, 3), *theirs])
    if not np.isfinite(points).all():
        return "DIFFERENT"
    near = tolerance * np.abs(points).max(initial=0)
    names = [int(np.argmax((np.abs(points - each) <= near).all(axis=1))) for each in points]
    count = 3 * len(ours)
    left = Counter(turned(names[k : k + 3]) for k in range(0, count, 3))
    polygons = list[tuple[list[int], Array]]()
    for each in theirs:
        polygons.append((names[count : count + len(each)], each))
        count += len(each)
    if fits(left, sorted(polygons, key=lambda each: len(each[0]))):
        return "equal"
    either = Counter[tuple[int, ...]]()
    for triangle, many in left.items():
        either[turned(sorted(triangle))] += many
    return "TURNED" if fits(either, polygons, oriented=False) else "DIFFERENT"


def turned(triangle: Sequence[int]) -> tuple[int, ...]:
    """The corners, from the smallest."""
    first = min(range(3), key=lambda k: (triangle[k], triangle[(k + 1) % 3], triangle[(k + 2) % 3]))
    return tuple(triangle[(first + k) % 3] for k in range(3))


def fits(
    left: Counter[tuple[int, ...]], polygons: list[tuple[list[int], Array]], oriented: bool = True
) -> bool:
    """Is there a division of each polygon, so that all triangles together are these?"""
    if not polygons:
        return not left.total()
    (names, corners), others = polygons[0], polygons[1:]
    for first in range(len(names) if len(names) > 3 else 1):
        if len(names) > 3 and not sees(corners, first):
            continue
        ring = names[first:] + names[:first]
        triangles = Counter(
            turned(some if oriented else sorted(some))
            for k in range(1, len(ring) - 1)
            for some in ([ring[0], ring[k], ring[k + 1]],)
        )
        if triangles <= left and fits(left - triangles, others, oriented):
            return True
    return False


def sees(corners: Array, first: int) -> bool:
    """Do the triangles from this corner have the orientation of the polygon? One that is not flat has no inside."""
    ring = np.roll(corners, -first, axis=0) - corners[first]
    size = np.abs(ring).max()
    if not size or np.linalg.svd(ring / size, compute_uv=False)[2] > FLAT**2:
        return True
    across = np.cross(ring[1:-1] / size, ring[2:] / size)
    whole = across.sum(axis=0)
    length = float(np.linalg.norm(whole))
    return not length or bool((across @ whole / length >= -FLAT).all())


def endings(count: int, seed: int, kinds: Sequence[str] = (*MAKERS,)) -> Iterator[tuple[int, str, str]]:
    """Of each case: its number, its kind, and how reading it ended."""
    with tempfile.TemporaryDirectory() as folder:
        for number in range(count):
            kind, mutations, text = case(number, seed, kinds)
            path = Path(folder) / f"a.{kind}"
            path.write_bytes(text)
            yield number, kind, judged(path, kind, mutations)


def main() -> int:
    """Run the command that stands at the head of this file."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--count", type=int, default=20_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--kind", choices=[*MAKERS], help="only files of this kind")
    parser.add_argument("--show", type=int)
    chosen = parser.parse_args()
    kinds = [chosen.kind] if chosen.kind else [*MAKERS]
    if chosen.show is not None:
        sys.stdout.buffer.write(case(chosen.show, chosen.seed, kinds)[2])
        return 0
    counts: Counter[str] = Counter()
    for number, kind, ending in endings(chosen.count, chosen.seed, kinds):
        counts[f"{kind} {' '.join(each for each in ending.split() if each.isupper()) or ending}"] += 1
        if ending not in FINE:
            print(f"case {number}, {kind}: {ending}", flush=True)
    print(f"{chosen.count} files: {dict(sorted(counts.items()))}")
    return int(any(not name.endswith(FINE) for name in counts))


if __name__ == "__main__":
    sys.exit(main())
