"""Paths around obstacles: how much longer does `follow` take in a scene than without one, and is what it returns free?

Every path that is returned is checked by MuJoCo, with the same shapes and pairs, its own forward kinematics and its own
collisions, at 20 points of each step between two reached poses, except for breaks. It is *confirmed* if there is no contact.
Times are processor times of one thread, the least of up to five runs, without the preparation of the scene. If bodies
interrupt all ways, the time is that of several plans, of which the last ones have a layer at each pose near the breaks.

    python -m benchmarks.paths.scenes --cppflow cppflow --jrl jrl  # writes benchmarks/paths/scenes.md
    python -m benchmarks.paths.scenes panda --quick                # printed and not written

`cppflow` and `jrl` are clones of jstmn/cppflow and jstmn/jrl; without them their part is left out.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import kinseek
from benchmarks.command import command
from benchmarks.outside import Outside
from benchmarks.page import Page, Row
from benchmarks.targets import Array
from benchmarks.timing import cpu

from . import cppflow
from .curves import POSES, curve

SHORT, CAPSULES, BODIES = 301, 0.03, 20
"""Poses of a line or circle, the radius of the capsules that stand for links [m], and the bodies of each scene."""

BALLS, AROUND = 8, 0.25
"""Balls beside a random curve, and how far they are from points of it [m]."""

FINER = 20
"""Points of a step that MuJoCo checks."""

REPEATS, LONG = 5, 1.0
"""Runs of which the shortest time counts, and seconds after which no further run begins."""

ARMS = ("ur5e", "irb120", "panda", "iiwa14", "gen3")


class Task(NamedTuple):
    """Poses to follow, and how."""

    goal: Any
    options: dict[str, Any]


class Outcome(NamedTuple):
    """A path in a scene."""

    path: kinseek.Path
    seconds: float
    confirmed: bool


def line(arm: kinseek.Arm, redundant: bool) -> Task:
    """A straight line beside the arm, of four tenths of its reach; with a free turn of the tool for six joints."""
    y = np.linspace(-0.2, 0.2, SHORT)
    return _task(arm, np.column_stack([0.42 + 0.0 * y, y, 0.25 + 0.0 * y]), redundant, {})


def circle(arm: kinseek.Arm, redundant: bool) -> Task:
    """A closed circle in front of the arm."""
    s = np.linspace(0, 2 * np.pi, SHORT)[:-1]
    places = np.column_stack([0.42 + 0.1 * np.cos(s), 0.1 * np.sin(s), 0.25 + 0.0 * s])
    return _task(arm, places, redundant, {"closed": True})


def _task(arm: kinseek.Arm, places: Array, redundant: bool, options: dict[str, Any]) -> Task:
    """Poses at places, (N, 3), relative to the length of the arm, with the tool downward."""
    poses = np.array([kinseek.pose(place * arm.chain.length, rpy=[np.pi, 0, 0]) for place in places])
    return Task(_goal(arm, poses, redundant), options)


def _goal(arm: kinseek.Arm, poses: Array, redundant: bool) -> kinseek.Goal:
    free = redundant and arm.dof == 6
    return kinseek.Goal.pose(poses, free="rz") if free else kinseek.Goal.pose(poses)


def far(scene: kinseek.Scene, arm: kinseek.Arm, q: Array, bodies: int) -> None:
    """Boxes on a ring around the arm, out of its reach."""
    reach = arm.chain.length
    for k, angle in enumerate(np.linspace(0, 2 * np.pi, bodies, endpoint=False)):
        place = 1.6 * reach * np.array([np.cos(angle), np.sin(angle), 0.0])
        scene.add_box(f"far {k}", (0.1, 0.1, 0.4), kinseek.pose(place))


def near(scene: kinseek.Scene, arm: kinseek.Arm, q: Array, bodies: int) -> None:
    """Four balls a centimetre or more beside the path without a scene, and the rest out of reach."""
    rng = np.random.default_rng(3)
    far(scene, arm, q, bodies - 4)
    for k in range(4):
        link = arm.fk(q[rng.integers(len(q))], link=arm.joint_names[rng.integers(2, arm.dof)])[:3, 3]
        way = rng.normal(size=3)
        for away in np.arange(0.06, 1.0, 0.02):
            scene.add_sphere(f"near {k}", 0.04, kinseek.pose(link + away * way / np.linalg.norm(way)))
            if scene.free(q, 0.01).all():
                break
            scene.remove(f"near {k}")


def elbow(scene: kinseek.Scene, arm: kinseek.Arm, q: Array, bodies: int) -> None:
    """A ball at the elbow of the path without a scene, the rest out of reach."""
    far(scene, arm, q, bodies - 1)
    place = arm.fk(q[len(q) // 2], link=arm.joint_names[min(3, arm.dof - 4)])[:3, 3]
    scene.add_sphere("ball", 0.06, kinseek.pose(place))


def blocked(scene: kinseek.Scene, arm: kinseek.Arm, q: Array, bodies: int) -> None:
    """A crate around a few poses of the path, the rest out of reach."""
    far(scene, arm, q, bodies - 1)
    place = arm.fk(q[len(q) // 3])[:3, 3]
    scene.add_box("crate", (0.02, 0.02, 0.02), kinseek.pose(place))


PLACED: dict[str, Callable[[kinseek.Scene, kinseek.Arm, Array, int], None]] = {
    "far": far,
    "near": near,
    "at the elbow": elbow,
    "at some poses": blocked,
}
TASKS = {"line": line, "closed circle": circle}


def placed(options: argparse.Namespace) -> Iterator[Row]:
    """Lines and circles: a row for each arm and path, with the ratio for each place of the bodies."""
    for name in options.arms:
        arm = kinseek.load(name)
        for what, make in TASKS.items():
            for redundant in (False, True) if arm.dof == 6 else (True,):
                task = make(arm, redundant)
                plain, seconds = least(arm, task)
                row: Row = {
                    "arm": arm.name,
                    "path": what + (", free turn" if redundant and arm.dof == 6 else ""),
                    ">without, ms": f"{seconds * 1e3:.1f}",
                }
                confirmed = True
                for where, place in PLACED.items():
                    scene = kinseek.Scene.of(arm, capsules=CAPSULES)
                    place(scene, arm, plain.q, BODIES)
                    found = outcome(arm, task, scene, plain.q)
                    row[f">{where}"] = f"{found.seconds / seconds:.1f}{_said(found.path)}"
                    confirmed &= found.confirmed
                yield row | {"confirmed": "all" if confirmed else "**no**"}


def _said(path: kinseek.Path) -> str:
    """What a path could not do, in a few characters; nothing if it is continuous."""
    missed, breaks = int((~path.reached).sum()), len(path.breaks)
    return (f", {missed} missed" if missed else "") + (f", {breaks} breaks" if breaks else "")


def random_curves(options: argparse.Namespace) -> Iterator[Row]:
    """Curves of joint values with balls beside them and on them."""
    for name in options.arms:
        arm = kinseek.load(name)
        for seed in range(options.curves):
            q = curve(arm, POSES, seed) * 0.6
            task = Task(_goal(arm, arm.fk(q), True), {})
            scene = kinseek.Scene.of(arm, capsules=CAPSULES)
            far(scene, arm, q, BODIES - BALLS)
            for k in range(BALLS):
                rng = np.random.default_rng(k + 10 * seed)
                place = arm.fk(q[rng.integers(POSES)])[:3, 3] + rng.normal(0.0, AROUND, 3)
                scene.add_sphere(f"ball {k}", 0.04, kinseek.pose(place))
                if scene.free(q).mean() < 0.5:
                    scene.remove(f"ball {k}")
            plain, seconds = least(arm, task)
            found = outcome(arm, task, scene, q)
            yield {
                "arm": arm.name + (", free turn" if arm.dof == 6 else ""),
                ">seed": seed,
                ">curve free": f"{scene.free(q).mean():.0%}",
                ">path without a scene free": f"{scene.free(plain.q).mean():.0%}",
                ">without, ms": f"{seconds * 1e3:.0f}",
                ">ratio": f"{found.seconds / seconds:.1f}",
                ">missed": int((~found.path.reached).sum()),
                ">breaks": len(found.path.breaks),
                ">length, ratio": f"{found.path.length / plain.length:.2f}",
                "confirmed": "yes" if found.confirmed else "**no**",
            }


def problems(options: argparse.Namespace) -> Iterator[Row]:
    """The problems of CppFlow, by its rules."""
    for name in cppflow.PROBLEMS[: 3 if options.quick else None]:
        arm, poses, scene, boxes = cppflow.read(options.cppflow, options.jrl, name)
        steps = np.array(
            [cppflow.PRISMATIC if kind == "prismatic" else cppflow.REVOLUTE for kind in arm.kinds]
        )
        task = Task(poses, {"max_step": steps * (1 - 1e-9)})
        plain, seconds = least(arm, task)
        found = outcome(arm, task, scene, plain.q)
        yield {
            "problem": name,
            ">poses": len(poses),
            ">boxes": boxes,
            ">path without a scene free": f"{scene.free(plain.q).mean():.0%}",
            ">without, ms": f"{seconds * 1e3:.0f}",
            ">in the scene, ms": f"{found.seconds * 1e3:.0f}",
            ">ratio": f"{found.seconds / seconds:.1f}",
            "valid": "yes" if cppflow.is_valid(arm, poses, found.path.q, steps) else "**no**",
            "confirmed": "yes" if found.confirmed else "**no**",
            ">length, rad or m": f"{found.path.length:.2f}",
        }


def outcome(arm: kinseek.Arm, task: Task, scene: kinseek.Scene, q: Array) -> Outcome:
    """Follow the poses of a task in a scene, and check the path."""
    scene.free(q[:1])  # What the scene needs once.
    path, seconds = least(arm, task, scene=scene)
    rows = np.concatenate([path.q, path.q[:1]]) if path.closed else path.q
    reached = np.concatenate([path.reached, path.reached[:1]]) if path.closed else path.reached
    steps = np.setdiff1d(np.flatnonzero(reached[:-1] & reached[1:]), path.breaks)
    way = np.diff(rows, axis=0)[steps]
    if path.closed:  # Continuous joints may close the path after full turns.
        turns = arm.chain.turns & ~(np.isfinite(arm.lower) & np.isfinite(arm.upper))
        way = np.where(turns, (way + np.pi) % (2 * np.pi) - np.pi, way)
    share = np.arange(FINER + 1)[:, None, None] / FINER
    points = (rows[steps] + share * way).reshape(-1, arm.dof)
    touching = np.concatenate([points, path.q[path.reached]])
    return Outcome(path, seconds, not Outside(scene, arm).depths(touching).any())


def least(arm: kinseek.Arm, task: Task, **options: Any) -> tuple[kinseek.Path, float]:
    """Return the path of a task and the least CPU time of some runs that make it [s]; of one if it takes long."""
    options = task.options | options | {"threads": 1}
    path = arm.follow(task.goal, **options)
    times: list[float] = []
    while len(times) < REPEATS and sum(times) < LONG:
        seconds, path = cpu(lambda: arm.follow(task.goal, **options))
        times.append(seconds)
    return path, min(times)


def main() -> None:
    """Measure, and write the page."""
    parser = command(
        __file__, __doc__, arms=ARMS, page="paths/scenes.md", curves=(3, 1, "curves of each arm")
    )
    parser.add_argument("--cppflow", type=Path, help="a clone of jstmn/cppflow")
    parser.add_argument("--jrl", type=Path, help="a clone of jstmn/jrl")
    options = parser.options()
    page = Page("Paths around obstacles", "benchmarks.paths.scenes", __doc__)
    with page.section("Lines and circles"):
        page.say(
            f"Paths of {SHORT} poses in front of the arm, in scenes with {BODIES} bodies. The columns from *far* on are the",
            "time in the scene divided by the time without; *missed* poses have no free solution. *Far* bodies are out of",
            "reach, *near* ones one to three centimetres beside the path; *at the elbow* a ball blocks the path that is",
            "followed without a scene, and *at some poses* a small crate encloses a part of the path.",
        )
        page.rows(placed(options))
    with page.section("Random curves"):
        page.say(
            f"Curves of {POSES} poses, with {BALLS} balls beside and on them, so that there may be no continuous path, and",
            f"{BODIES - BALLS} boxes out of reach.",
        )
        page.rows(random_curves(options))
    if options.cppflow is not None and options.jrl is not None:
        with page.section("CppFlow"):
            page.say(*(cppflow.__doc__ or "").strip().splitlines()[2:])
            page.rows(problems(options))
    page.end(options)


if __name__ == "__main__":
    main()
