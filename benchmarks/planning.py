"""Planning around obstacles: MotionBenchMaker's problems for a Panda, solved, proved, and confirmed by MuJoCo.

The data are those of the repository KavrakiLab/vamp (Apache-2.0), in its folder ``resources/panda``: 100 problems in each of
seven kinds of scenes (Chamzas et al. 2022, *MotionBenchMaker*), and the arm with the hulls of its meshes. It is not part of
this repository; clone that one, and give the folder.

A problem counts as solved if `Scene.plan` returns a continuous path within the time limit, as proved if `Scene.free_motion`
is true for every motion of it, and as confirmed if MuJoCo, with the same shapes and pairs, its own forward kinematics and
its own collisions, finds no contact at ten thousand points along it. *First check* is the first `Scene.free` of each scene,
not part of the time of the plan. Two problems end beyond the limit of a joint in the file, -0.0698 rad, which is therefore
raised to 0.02.

    python -m benchmarks.planning vamp/resources/panda           # writes benchmarks/planning.md
    python -m benchmarks.planning vamp/resources/panda --quick   # a few problems of each kind, printed and not written
"""

from __future__ import annotations

import copy
import re
import tarfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml  # type: ignore[import-untyped]
from numpy.typing import NDArray

import kinseek

from .command import command
from .outside import Outside
from .page import Page, Row

Array = NDArray[np.float64]

SECONDS = 20.0
"""Time limit of a plan [s]."""

POINTS = 10_000
"""Along each path."""

WIDER = ('soft_upper_limit="-0.0698"', 'soft_upper_limit="0.02"')
"""The limit of the fourth joint in the file, and one inside which all problems end [rad]."""

JOINTS = [f"panda_joint{number}" for number in range(1, 8)]


class Task(NamedTuple):
    """A problem of MotionBenchMaker."""

    kind: str
    number: int
    q0: Array
    q1: Array
    objects: list[dict[str, Any]]


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


def tasks(folder: Path) -> list[Task]:
    """Read all problems."""
    texts: dict[tuple[str, int, str], str] = {}
    with tarfile.open(folder / "problems.tar.bz2") as archive:
        for member in archive:
            found = re.fullmatch(r"problems/(\w+)_panda/(scene|request)(\d+)\.yaml", member.name)
            stream = archive.extractfile(member)
            if found is not None and stream is not None:
                texts[found[1], int(found[3]), found[2]] = stream.read().decode()
    return [_task(texts, kind, number) for kind, number, what in sorted(texts) if what == "scene"]


def _task(texts: dict[tuple[str, int, str], str], kind: str, number: int) -> Task:
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    request, scene = (yaml.load(texts[kind, number, what], loader) for what in ("request", "scene"))
    state = request["start_state"]["joint_state"]
    begin = dict(zip(state["name"], state["position"], strict=True))
    constraints = request["goal_constraints"][0]["joint_constraints"]
    end = {each["joint_name"]: each["position"] for each in constraints}
    q0, q1 = (np.array([values[joint] for joint in JOINTS], dtype=np.float64) for values in (begin, end))
    return Task(kind, number, q0, q1, scene["world"]["collision_objects"])


def filled(scene: kinseek.Scene, task: Task) -> kinseek.Scene:
    """The scene with the objects of a problem."""
    scene = copy.copy(scene)
    for thing in task.objects:
        (shape,), (place,) = thing["primitives"], thing["primitive_poses"]
        base = _pose(thing["pose"]) if "pose" in thing else np.eye(4)
        pose, sizes = base @ _pose(place), shape["dimensions"]
        if shape["type"] == "box":
            scene.add_box(thing["id"], sizes, pose)
        elif shape["type"] == "cylinder":
            scene.add_cylinder(thing["id"], sizes[1], sizes[0], pose)
        else:
            scene.add_sphere(thing["id"], sizes[0], pose)
    return scene


def _pose(values: dict[str, Any]) -> Array:
    return np.asarray(kinseek.pose(values["position"], quat_xyzw=values["orientation"]))


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
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path.q, axis=0), axis=1))])
    places = np.linspace(0.0, along[-1], POINTS)
    q = np.stack([np.interp(places, along, row) for row in path.q.T], axis=1)
    confirmed = not Outside(scene, arm).depths(q).any()
    return Result(first - began, planned - first, timed - planned, True, proved, confirmed, float(along[-1]))


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


def main() -> None:
    """Measure, and write the page."""
    parser = command(__file__, __doc__, page="planning.md", problems=(100, 4, "problems of each kind"))
    parser.add_argument("folder", type=Path, help="resources/panda of a clone of KavrakiLab/vamp")
    options = parser.options()
    folder: Path = options.folder
    every = [task for task in tasks(folder) if task.number <= options.problems]
    arm = kinseek.load((folder / "panda.urdf").read_text().replace(*WIDER), tip="panda_hand")
    ends = np.concatenate([[task.q0, task.q1] for task in every])
    assert ((ends >= arm.lower) & (ends <= arm.upper)).all()
    base = kinseek.Scene.of(arm, meshes={"meshes": folder / "meshes"}, srdf=folder / "panda.srdf")
    page = Page("Planning", "benchmarks.planning", __doc__)
    for title, pose in (("Goals given as joint values", False), ("Goals given as poses", True)):
        with page.section(title):
            results: dict[str, list[Result]] = {}
            for task in every:
                result = solve(arm, filled(base, task), task, pose)
                results.setdefault(task.kind, []).append(result)
                if not result.confirmed:
                    print(task.kind, task.number, result, flush=True)
            page.rows(rows(results))
    page.end(options)


if __name__ == "__main__":
    main()
