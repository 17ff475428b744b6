"""Maps: what a pose costs, plain and with the first joint divided out; workers; whole cells proved; what a map gets wrong.

Times are CPU times of one process, where nothing else is said. "Sampled" is a map as research scripts make it: cells that
poses of random joint values lie in, for as long as the map of the same grid took; test poses are judged by EAIK.

    python -m benchmarks.maps                       # writes maps.md; some ten minutes
    python -m benchmarks.maps --poses 20000 --cells 60 --tests 3000 --workers 1 --output /dev/stdout
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import kinseek
from kinseek import maps
from kinseek.maps.cells import EMPTY, REACHED, judged
from kinseek.maps.search import reached, ruled_out

from .command import at_least_one, command, writes
from .page import Page

Array = NDArray[np.float64]

HERE = Path(__file__).resolve().parent

ARMS = ("ur5e", "panda", "irb120")

WIDTH, COUNT = 0.1, 576
"""Of the cells [m], and orientations."""


def cpu(work: Callable[..., Any], *given: Any) -> tuple[float, Any]:
    """CPU time [s], and what came of it."""
    began = time.process_time()
    result = work(*given)
    return time.process_time() - began, result


def grid_around(arm: kinseek.Arm, width: float = WIDTH, count: int = COUNT) -> maps.Grid:
    """A cube of cells as far as the arm reaches."""
    half = float(np.ceil(arm.chain.reach / width) * width)
    return maps.Grid(
        (-half, half, width), (-half, half, width), (-half, half, width), maps.orientations(count)
    )


def drawn(grid: maps.Grid | maps.Rings, number: int, seed: int = 0) -> NDArray[np.int64]:
    """Cells drawn from all of a grid, (number, dimensions)."""
    return np.random.default_rng(seed).integers(grid.shape, size=(number, len(grid.shape)))


def poses_of(grid: maps.Grid | maps.Rings, cells: NDArray[np.int64]) -> Array:
    """Middles of cells, (k, 4, 4)."""
    T = np.tile(np.eye(4), (len(cells), 1, 1))
    T[:, :3, :3] = grid.orientations.matrices[cells[:, -1]]
    rows = (0, 2) if isinstance(grid, maps.Rings) else (0, 1, 2)
    for k, row in enumerate(rows):
        T[:, row, 3] = grid.places[k][cells[:, k]]
    return T


def by_default(arm: kinseek.Arm, T: Array) -> NDArray[np.bool_]:
    """What `arm.ik` says of poses, (k, 4, 4)."""
    return np.asarray(arm.ik(T, threads=1).success)


def proved(
    arm: kinseek.Arm, rings: maps.Rings, cells: NDArray[np.int64], depth: int, budget: int
) -> NDArray[np.int64]:
    """What is known of whole cells, (k,)."""
    return np.array([judged(arm, rings, tuple(map(int, cell)), depth, budget)[0] for cell in cells])


def costs(page: Page, poses: int) -> None:
    """What a pose costs, and how many there are with the first joint divided out."""
    rows = []
    for name in ARMS:
        arm = kinseek.load(name)
        grid = grid_around(arm)
        T = poses_of(grid, drawn(grid, poses))
        goal = kinseek.Goal.pose(T)
        reached(arm, kinseek.Goal.pose(T[:8]))  # Builds the atlas.
        gate, closed = cpu(ruled_out, arm, goal)
        mixed, found = cpu(reached, arm, goal)
        some = kinseek.Goal.pose(T[found])
        alone, _ = cpu(reached, arm, some)
        few = T[: max(poses // 10, 1)]
        full, by_ik = cpu(by_default, arm, few)
        lost = int((by_ik & ~found[: len(few)]).sum())
        half = grid.x[1]
        rings = maps.Rings((0.0, half, WIDTH), (-half, half, WIDTH), grid.orientations)
        rows.append(
            [
                name,
                f"{found.mean():.1%}",
                f"{closed.mean() / max(1.0 - found.mean(), 1e-9):.1%}",
                f"{gate / poses * 1e6:.2f}",
                f"{alone / max(found.sum(), 1) * 1e6:.2f}",
                f"{mixed / poses * 1e6:.1f}",
                f"{full / len(few) * 1e6:.1f}",
                f"{lost} of {by_ik.sum()}",
                f"{grid.size / rings.size:.0f}",
            ]
        )
    page.head("What a pose costs")
    page.say(
        f"{poses:,} cells drawn from a cube as wide as the arm reaches, {WIDTH * 100:.0f} cm and {COUNT} orientations. The",
        "last column is by how much the rings about the first axis are fewer than the boxes of the same width.",
    )
    page.table(
        "arm | >reached | >of the others by the gate | >gate, µs | >reached ones, µs | >all, µs | >`arm.ik`, µs | "
        ">lost to `arm.ik` | >fewer rings",
        rows,
    )


def workers(page: Page, most: int) -> None:
    """Wall time of one map by processes of a local Dask cluster, beside the work alone."""
    import distributed
    from distributed.deploy.subprocess import SubprocessCluster

    arm = kinseek.load("ur5e")
    grid = grid_around(arm, 0.2)
    began = time.perf_counter()
    maps.reach(arm, grid, block=grid.size)
    alone = time.perf_counter() - began
    rows = [["no Dask, one block", f"{alone:.1f}", ""]]
    first = alone
    for count in range(1, most + 1):
        options: dict[str, Any] = {"n_workers": count, "threads_per_worker": 1, "dashboard_address": ":0"}
        connect: Any = distributed.Client
        with SubprocessCluster(**options) as cluster, connect(cluster) as client:
            client.wait_for_workers(count)
            warm = maps.Grid((0.0, 0.4, 0.1), (0.0, 0.4, 0.1), (0.0, 0.4, 0.1), grid.orientations)
            maps.reach(arm, warm, client=client, block=2000)
            with tempfile.TemporaryDirectory() as folder:
                began = time.perf_counter()
                maps.reach(arm, grid, client=client, store=Path(folder) / "map.zarr")
                took = time.perf_counter() - began
        first = took if count == 1 else first
        rows.append([f"{count} worker{'s' * (count > 1)}", f"{took:.1f}", f"{first / took:.2f}"])
    page.head(f"Workers: {grid.size:,} poses of the UR5e, blocks of the default size, to a store")
    page.table("who | >wall time, s | >times one worker", rows)


def proofs(page: Page, number: int) -> None:
    """What whole cells cost, and what is left undecided."""
    rows = []
    for name in ARMS:
        arm = kinseek.load(name)
        for width, count in ((0.1, 576), (0.05, 4608), (0.05, 36864)):
            half = float(np.ceil(arm.chain.reach / 0.1) * 0.1)
            rings = maps.Rings((0.0, half, width), (-half, half, width), maps.orientations(count))
            work = maps.make.work_of(arm, rings, ("reached",), **maps.make.DEFAULTS, store=None)
            desk = maps.block.desk_of(work)
            cells = drawn(rings, number)
            found = reached(desk.arm, kinseek.Goal.pose(poses_of(rings, cells)))
            for depth, budget in ((0, 300), (0, 10_000), (2, 10_000)):
                took, known = cpu(proved, desk.arm, rings, cells[~found], depth, budget)
                undecided = (len(known) - (known == EMPTY).sum() - (known == REACHED).sum()) / number
                rows.append(
                    [
                        name,
                        f"{width * 100:.0f} cm, {rings.orientations.covering_radius:.2f} rad",
                        f"{depth}, {budget:,}",
                        f"{took / number * 1e3:.2f}",
                        f"{(found.sum() + (known == REACHED).sum()) / number:.1%}",
                        f"{(known == EMPTY).sum() / number:.1%}",
                        f"{undecided:.1%}",
                        f"{rings.size * took / number / 3600:.2g}",
                    ]
                )
    page.head("Whole cells proved, the first joint divided out")
    page.say(
        f"{number} cells drawn from the rings of each arm; core-hours of all cells are worked out from their mean."
    )
    page.table(
        "arm | cells | depth, budget | >ms a cell | >reached somewhere | >proved empty | >undecided | >core-hours of all",
        rows,
    )


def wrong(page: Page, tests: int) -> None:
    """How much of random poses our map and a sampled one get wrong, both ways, and what a question costs."""
    from .branches import eaik

    arm = kinseek.load("ur5e")
    grid = grid_around(arm, 0.2, 576)
    began = time.process_time()
    ours = maps.reach(arm, grid, block=grid.size)
    spent = time.process_time() - began
    sampled, vectors = np.zeros(grid.shape, dtype=bool), 0
    began = time.process_time()
    while time.process_time() - began < spent:
        cells = grid.cells_of(arm.fk(arm.sample(20_000, seed=vectors)))
        inside = np.all([cell >= 0 for cell in cells], axis=0)
        sampled[tuple(cell[inside] for cell in cells)] = True
        vectors += 20_000
    rng = np.random.default_rng(7)
    T = np.tile(np.eye(4), (tests, 1, 1))
    ends = np.array([grid.x, grid.y, grid.z])[:, :2]
    T[:, :3, 3] = rng.uniform(ends[:, 0], ends[:, 1], (tests, 3))
    turns = rng.normal(size=(tests, 4))
    for k, turn in enumerate(turns):
        T[k, :3, :3] = kinseek.pose([0.0, 0.0, 0.0], quat_wxyz=turn / np.linalg.norm(turn))[:3, :3]
    judge = eaik(arm)
    truth = np.array([len(judge(pose)) > 0 for pose in T])
    asked, read = cpu(lambda: maps.at(ours, T))
    values = {
        "kinseek": read["reached"] == 1,
        f"sampled, {vectors:,} joint vectors": sampled[grid.cells_of(T)],
    }
    page.head(f"What a map gets wrong: {tests:,} random poses, judged by EAIK")
    page.say(
        f"UR5e, cells of 20 cm and 576 orientations, {spent:.1f} s each; one question to ours: {asked / tests * 1e6:.2f} µs."
    )
    page.table(
        "map | >wrong | >reached, the map says no | >not reached, the map says yes",
        [
            [
                name,
                f"{(said != truth).mean():.1%}",
                f"{(truth & ~said).mean():.1%}",
                f"{(~truth & said).mean():.1%}",
            ]
            for name, said in values.items()
        ],
    )


def main() -> None:
    """Measure and write the page."""
    parser = command(__file__, __doc__)
    parser.add_argument(
        "--poses", type=at_least_one, default=1_000_000, help="of the first table, for each arm"
    )
    parser.add_argument("--workers", type=at_least_one, default=2, help="processes at most")
    parser.add_argument("--cells", type=at_least_one, default=400, help="that are proved, for each line")
    parser.add_argument("--tests", type=at_least_one, default=100_000, help="poses that EAIK judges")
    parts = {"costs": costs, "workers": workers, "proofs": proofs, "wrong": wrong}
    parser.add_argument("--only", choices=parts, help="one part of the page; all of it unless given")
    writes(parser, "--output", HERE / "maps.md", "the page")
    options = parser.parse_args()
    page = Page("Maps", "benchmarks.maps")
    numbers = (options.poses, options.workers, options.cells, options.tests)
    for (name, part), number in zip(parts.items(), numbers, strict=True):
        if options.only in (None, name):
            part(page, number)
    page.write(options.output)


if __name__ == "__main__":
    main()
