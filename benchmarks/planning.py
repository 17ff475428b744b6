"""Planning around obstacles: MotionBenchMaker's problems for a Panda, solved, proved, and confirmed by MuJoCo.

The data are those of the repository KavrakiLab/vamp (Apache-2.0), in its folder ``resources/panda``: 100 problems in each of
seven kinds of scenes (Chamzas et al. 2022, *MotionBenchMaker*), and the arm with the hulls of its meshes. It is not part of
this repository; clone that one, and give the folder.

A problem counts as solved if `Scene.plan` returns a continuous path within the time limit, as proved if `Scene.free_motion`
is true for every motion of it, and as confirmed if MuJoCo, with the same shapes and pairs, its own forward kinematics and
its own collisions, finds no contact at ten thousand points along it. *First check* is the first `Scene.free` of each scene,
not part of the time of the plan. Two problems end beyond the limit of a joint in the file, -0.0698 rad, which is therefore
raised to 0.02.

Finished parts are stored in `build/benchmarks`, so an interrupted run continues with the missing ones. The page is written
when all parts are finished. Peers get environments of their own. VAMP has only a source distribution, whose build downloads
other files; if that is not possible, put a wheel into a folder and set `UV_FIND_LINKS` to it.

    python -m benchmarks.planning vamp/resources/panda                # writes benchmarks/planning.md
    python -m benchmarks.planning vamp/resources/panda --only peers   # this part anew, and the page if the others are there
    python -m benchmarks.planning vamp/resources/panda --quick        # a few problems of each kind, printed and not written
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import kinseek

from .command import ROOT, command
from .field.adapters import path_of
from .outside import Outside
from .page import Page, Row, in_parts
from .problems import Cell, Task, length, points, tasks
from .targets import Array
from .workers.environments import environment
from .workers.planners import PLANNERS
from .workers.process import Gone, Raised, Worker, releases

SECONDS = 20.0
"""Time limit of a plan [s]."""

POINTS = 10_000
"""Along each path."""

LONGER = 1.1
"""Paths that are longer than VAMP's by this factor are counted."""


SETTINGS = """\
kinseek and OMPL check the hulls of the collision meshes. VAMP checks 59 spheres instead, and capsules instead of
cylinders (boxes in the scenes *box*); *kinseek, spheres* plans with the same shapes. VAMP has its settings for this arm,
its fixed sequence of samples and its simplification. OMPL's RRT-Connect and its simplification have the default settings
and a fixed seed, and call a scene of kinseek from Python: `scene.free` at the default distance of 1% of the extent of the
space, or `scene.free_motion`, which proves motions. Times are wall times in Python of search and simplification, without
making the scene. VAMP and OMPL run on one thread; `Scene.plan` uses every core for large batches."""
"""How the planners are called, as the page says it."""

COLUMNS = f"""\
*Free* counts paths along which MuJoCo finds no contact at {POINTS:,} points, by the shapes that the planner checks and by
the hulls; *deepest* is the deepest contact with the hulls. Where the hulls reach beyond the spheres, a path that is free
by the spheres may touch. Except for link 6, the meshes have at least 99.9% of the volume of their hulls, so most of these
contacts are contacts of the meshes. Lengths are Euclidean. */ VAMP's* is the median ratio of the lengths over the problems
that both solve, *both free* over those where both paths are free by the hulls, and *above {LONGER:g}* the share of larger
ratios among the former."""
"""What the columns mean, as the page says it."""


class Result(NamedTuple):
    """What came of a problem."""

    first: float
    """Time of the first check of the scene [s]."""
    seconds: float
    """Time of the plan [s]."""
    timed: float
    """Time of `Path.timed` [s]."""
    solved: bool
    proved: bool
    confirmed: bool
    length: float
    """[rad]"""


def solve(arm: kinseek.Arm, scene: kinseek.Scene, task: Task, pose: bool) -> Result:
    """Plan, and check the path."""
    began = time.perf_counter()
    scene.free(task.q0)
    first = time.perf_counter()
    path = scene.plan(task.q0, arm.fk(task.q1) if pose else task.q1, time_limit=SECONDS)
    planned = time.perf_counter()
    if not path.success:
        return Result(first - began, planned - first, np.nan, False, False, False, np.nan)
    path.timed(acceleration=8.0)
    timed = time.perf_counter()
    proved = bool(np.all(scene.free_motion(path.q[:-1], path.q[1:])))
    confirmed = not Outside(scene, arm).depths(points(path.q, POINTS)).any()
    times = first - began, planned - first, timed - planned
    return Result(*times, True, proved, confirmed, length(path.q))


def rows(results: dict[str, list[Result]]) -> Iterator[Row]:
    """A row for each kind of scene, and one for all."""
    everything = [result for each in results.values() for result in each]
    for kind, each in [*results.items(), ("**all**", everything)]:
        first, seconds, timed = (
            1e3 * np.array([getattr(one, name) for one in each]) for name in ("first", "seconds", "timed")
        )
        lengths = np.array([one.length for one in each])
        yield {
            "scene": kind,
            ">problems": len(each),
            ">solved": sum(one.solved for one in each),
            ">proved": sum(one.proved for one in each),
            ">confirmed": sum(one.confirmed for one in each),
            ">first check ms": f"{np.median(first):.1f}",
            ">plan ms, median": f"{np.median(seconds):.1f}",
            ">p95": f"{np.quantile(seconds, 0.95):.0f}",
            ">largest": f"{seconds.max():.0f}",
            ">length rad, median": f"{np.nanmedian(lengths):.2f}",
            ">mean": f"{np.nanmean(lengths):.2f}",
            ">`timed` ms, median": f"{np.nanmedian(timed):.0f}",
        }


def chosen(options: argparse.Namespace, problems: int) -> list[Task]:
    """The first problems of each kind."""
    return [task for task in tasks(options.folder) if task.number <= problems]


def goals(title: str, pose: bool) -> Callable[[Page, argparse.Namespace], None]:
    """The part of the page with one kind of goals."""

    def measure(page: Page, options: argparse.Namespace) -> None:
        every, cell = chosen(options, options.problems), Cell.read(options.folder)
        ends = np.concatenate([[task.q0, task.q1] for task in every])
        assert ((ends >= cell.arm.lower) & (ends <= cell.arm.upper)).all()
        with page.section(title):
            results: dict[str, list[Result]] = {}
            for task in every:
                result = solve(cell.arm, cell.filled(task), task, pose)
                results.setdefault(task.kind, []).append(result)
                if not result.confirmed:
                    print(task.kind, task.number, result, flush=True)
            page.rows(rows(results))

    return measure


class Found(NamedTuple):
    """A path beside those of other planners; NaN if none was found."""

    seconds: float
    """Of the plan, its simplification included [s]."""
    length: float
    """[rad]"""
    own: float
    """How deep the deepest contact is along it by the shapes that the planner checks [m]."""
    hulls: float
    """The same by the hulls of the meshes."""


Plan = Callable[[Task], tuple[float, Array | None]]
"""From a problem to the time that it took [s] and the rows of the path, (N, n)."""


class Planner(NamedTuple):
    """A planner, and the model of the arm that it checks."""

    plan: Plan
    cell: Cell


def ours(cell: Cell) -> Plan:
    """`Scene.plan` in this process."""

    def plan(task: Task) -> tuple[float, Array | None]:
        scene = cell.filled(task)
        scene.free(task.q0)
        began = time.perf_counter()
        try:
            path = scene.plan(task.q0, task.q1, time_limit=SECONDS)
        except kinseek.InvalidProblem:  # An end is in collision by these shapes.
            return time.perf_counter() - began, None
        return time.perf_counter() - began, path.q if path.success else None

    return plan


def theirs(peer: str, folder: Path, worker: Worker) -> Plan:
    """A peer in its own process."""

    def plan(task: Task) -> tuple[float, Array | None]:
        asked = {"peer": peer, "folder": str(folder), "kind": task.kind, "number": task.number}
        try:
            reply = worker.ask("plan", 5.0 * SECONDS, **asked, q0=task.q0, q1=task.q1, objects=task.objects)
        except Raised as why:
            print(peer, task.kind, task.number, why, flush=True)
            return np.nan, None
        return reply[0], None if reply[1] is None else np.array(reply[1])

    return plan


def judged(planner: Planner, hulls: Cell, task: Task) -> Found:
    """Let a planner solve a problem, and MuJoCo look at many points along its path."""
    seconds, q = planner.plan(task)
    if q is None:
        return Found(seconds, np.nan, np.nan, np.nan)
    assert np.abs(q[[0, -1]] - [task.q0, task.q1]).max() < 1e-5, "another problem was solved"
    along = points(q, POINTS)
    deepest = {
        cell.spheres: float(Outside(cell.filled(task), cell.arm).depths(along).max())
        for cell in (planner.cell, hulls)
    }
    return Found(seconds, length(q), deepest[planner.cell.spheres], deepest[hulls.spheres])


def started(peer: str, folder: Path, log: Path) -> tuple[Worker, str] | str:
    """A peer's process, ready for problems, and its release; or why there is none."""
    python = environment(path_of(PLANNERS[peer].requirements))
    if isinstance(python, str):
        return python
    worker = Worker(python, "benchmarks.workers.planners", log, source=ROOT / "src")
    try:
        return worker, worker.ask("prepare", 120, peer=peer, folder=str(folder))
    except (Raised, Gone) as why:
        worker.close()
        return str(why)


def by_turns(planners: Mapping[str, Planner], hulls: Cell, every: list[Task]) -> dict[str, list[Found] | str]:
    """Let all planners solve a problem before the next one; a planner whose process ends gets the reason instead."""
    found: dict[str, list[Found]] = {name: [] for name in planners}
    gone: dict[str, str] = {}
    for task in every:
        for name in [name for name in planners if name not in gone]:
            try:
                found[name].append(judged(planners[name], hulls, task))
            except Gone as why:
                gone[name] = f"{task.kind} {task.number}: {why}"
        print(task.kind, task.number, flush=True)
    return found | gone


def peers(page: Page, options: argparse.Namespace) -> None:
    """Measure kinseek and the peers by turns."""
    folder, every = options.folder.resolve(), chosen(options, options.beside)
    hulls, spheres = Cell.read(folder), Cell.read(folder, spheres=True)
    planners = {
        "**kinseek**": Planner(ours(hulls), hulls),
        "**kinseek**, spheres": Planner(ours(spheres), spheres),
    }
    versions, missing = dict[str, str](), dict[str, str]()
    with ExitStack() as stack, page.section("Beside VAMP and OMPL"):
        logs = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        for number, (peer, entry) in enumerate(PLANNERS.items()):
            ready = started(peer, folder, logs / f"{number}.txt")
            if isinstance(ready, str):
                missing[peer] = ready
                continue
            worker, versions[peer.partition(",")[0]] = ready
            stack.callback(worker.close)
            planners[peer] = Planner(theirs(peer, folder, worker), spheres if entry.spheres else hulls)
        found = by_turns(planners, hulls, every) | missing
        page.say(
            f"The first {options.beside} problems of each kind with goals given as joint values. Every planner solves a",
            "problem before the next one begins.",
        )
        page.say(SETTINGS)
        page.say(COLUMNS)
        page.rows(beside(found))
        page.say(releases(versions))
        page.say("The same ratio for each kind of scene:")
        page.rows(by_kind(found, [task.kind for task in every]))


REFERENCE = "VAMP"
"""With the paths of which all others are compared."""


def ratios(found: Mapping[str, list[Found] | str], name: str) -> tuple[Array, NDArray[np.bool_]]:
    """Lengths of a planner's paths divided by VAMP's, (N,), NaN where one is missing, and where both are free."""
    own, other = found[name], found[REFERENCE]
    if isinstance(own, str) or isinstance(other, str):
        return np.zeros(0), np.zeros(0, dtype=np.bool_)
    share = np.array([a.length / b.length for a, b in zip(own, other, strict=True)])
    return share, np.array([a.hulls == 0.0 and b.hulls == 0.0 for a, b in zip(own, other, strict=True)])


def _of(values: Array | NDArray[np.bool_], figure: Callable[[Any], Any], form: str) -> str:
    """A figure of some values, of which some may be NaN, as a cell."""
    return format(float(figure(values)), form) if np.isfinite(values).any() else "–"


def beside(found: Mapping[str, list[Found] | str]) -> Iterator[Row]:
    """A row for each planner; without figures, and with the reason, for one that could not be measured."""
    for name, each in found.items():
        known = [] if isinstance(each, str) else each
        solved = [one for one in known if np.isfinite(one.length)]
        times = 1e3 * np.array([one.seconds for one in known])
        lengths = np.array([one.length for one in solved])
        share, free = ratios(found, name)
        figures: Row = {
            ">problems": len(known),
            ">solved": len(solved),
            ">free, its shapes": sum(one.own == 0.0 for one in solved),
            ">free, hulls": sum(one.hulls == 0.0 for one in solved),
            ">deepest mm": f"{1e3 * max((one.hulls for one in solved), default=0.0):.1f}",
            ">ms, median": _of(times, np.nanmedian, ".2f"),
            ">p95": _of(times, partial(np.nanquantile, q=0.95), ".1f"),
            ">largest": _of(times, np.nanmax, ".0f"),
            ">length rad, median": _of(lengths, np.nanmedian, ".2f"),
            ">mean": _of(lengths, np.nanmean, ".2f"),
            ">/ VAMP's": _of(share, np.nanmedian, ".3f"),
            ">both free": _of(share[free], np.nanmedian, ".3f"),
            f">above {LONGER:g}": _of(share[np.isfinite(share)] > LONGER, np.mean, ".0%"),
        }
        cells: Row = figures if known else dict.fromkeys(figures, "–")
        yield {"planner": name} | cells | {"": each if isinstance(each, str) else ""}


def by_kind(found: Mapping[str, list[Found] | str], kinds: list[str]) -> Iterator[Row]:
    """Median ratios to VAMP's lengths, for each kind of scene."""
    where = np.array(kinds)
    for kind in dict.fromkeys(kinds):
        row: Row = {"scene": kind}
        for name, each in found.items():
            share, _ = ratios(found, name)
            if name != REFERENCE and not isinstance(each, str):
                row[f">{name}"] = _of(share[where == kind], np.nanmedian, ".3f") if len(share) else "–"
        yield row


PARTS = {
    "values": goals("Goals given as joint values", False),
    "poses": goals("Goals given as poses", True),
    "peers": peers,
}


def main() -> None:
    """Measure, and write the page."""
    parser = command(
        __file__,
        __doc__,
        page="planning.md",
        problems=(100, 4, "problems of each kind"),
        beside=(20, 2, "problems of each kind beside peers"),
    )
    parser.add_argument("folder", type=Path, help="resources/panda of a clone of KavrakiLab/vamp")
    parser.add_argument("--only", nargs="*", choices=PARTS, default=(), help="parts; all of them by default")
    in_parts("Planning", "benchmarks.planning", __doc__, PARTS, parser.options())


if __name__ == "__main__":
    main()
