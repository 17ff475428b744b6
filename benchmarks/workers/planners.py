"""One planner that solves MotionBenchMaker's problems for a Panda beside `Scene.plan`, in its own environment.

Served by `benchmarks.workers.serve`. VAMP has its own checks, with the spheres that are compiled into it; OMPL has none, and
checks by calls of a scene of kinseek. Both have the settings that they come with.
"""

from __future__ import annotations

import importlib
import time
from collections.abc import Callable
from functools import cache, partial
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

Plan = Callable[[str, int, Any, Any, Any], tuple[float, Any]]
"""Kind and number of a problem, its begin and its end, (7,), and its objects, to the time [s], and a path or None."""

LIMIT = 20.0
"""Time limit of OMPL's search, and of its simplification [s]; VAMP has none, but a number of iterations."""

SEED = 1
"""Of OMPL's random numbers."""


def matrix(values: dict[str, Any]) -> Array:
    """A pose of a scene file, with x, y, z, w, as a matrix, (4, 4)."""
    x, y, z, w = np.array(values["orientation"]) / np.linalg.norm(values["orientation"])
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    pose = np.eye(4)
    pose[:3, :3] += 2.0 * (w * cross + cross @ cross)
    pose[:3, 3] = values["position"]
    return pose


def euler(turn: Array) -> list[float]:
    """Angles about the fixed axes x, y and z, in this order, of a rotation matrix, (3, 3) [rad]."""
    across = np.hypot(turn[0, 0], turn[1, 0])
    if across < 1e-9:
        return [float(np.arctan2(-turn[1, 2], turn[1, 1])), float(np.arctan2(-turn[2, 0], across)), 0.0]
    first, last = np.arctan2(turn[2, 1], turn[2, 2]), np.arctan2(turn[1, 0], turn[0, 0])
    return [float(first), float(np.arctan2(-turn[2, 0], across)), float(last)]


def described(kind: str, objects: list[dict[str, Any]]) -> dict[str, Any]:
    """The objects of a problem in the words of `vamp.problem_dict_to_vamp`."""
    problem: dict[str, Any] = {"problem": kind, "sphere": [], "cylinder": [], "box": []}
    for thing in objects:
        (shape,), (place,) = thing["primitives"], thing["primitive_poses"]
        pose = (matrix(thing["pose"]) if "pose" in thing else np.eye(4)) @ matrix(place)
        sizes = shape["dimensions"]
        if shape["type"] == "box":
            size: dict[str, Any] = {"half_extents": [each / 2.0 for each in sizes]}
        else:
            size = {"radius": sizes[-1]} | ({"length": sizes[0]} if shape["type"] == "cylinder" else {})
        where = {"position": pose[:3, 3].tolist(), "orientation_euler_xyz": euler(pose[:3, :3])}
        problem[shape["type"]].append({"name": thing["id"], **where, **size})
    return problem


def vamp(folder: str) -> Plan:
    """Its RRT-Connect and its simplification, with its settings for this arm and its fixed sequence of samples."""
    module = importlib.import_module("vamp")
    robot, search, settings, simplification = module.configure_robot_and_planner_with_kwargs("panda", "rrtc")
    samples = robot.halton()

    def plan(kind: str, number: int, q0: Any, q1: Any, objects: Any) -> tuple[float, Any]:
        environment = module.problem_dict_to_vamp(described(kind, objects))
        samples.reset()
        began = time.perf_counter()
        found = search(q0, [q1], environment, settings, samples)
        if not found.solved:
            return time.perf_counter() - began, None
        path = robot.simplify(found.path, environment, simplification, samples).path
        seconds = time.perf_counter() - began
        return seconds, np.array(path.numpy(), dtype=np.float64)

    return plan


def ompl(folder: str, motions: bool) -> Plan:
    """Its RRT-Connect and its simplification, with default settings; a scene checks joint values, or whole motions."""
    base, geometric, util = (
        importlib.import_module(f"ompl.{name}") for name in ("base", "geometric", "util")
    )
    util.setLogLevel(util.LogLevel.LOG_ERROR)
    util.RNG.setSeed(SEED)
    problems = importlib.import_module("benchmarks.problems")
    cell = problems.Cell.read(Path(folder))
    dof = cell.arm.dof

    class Motions(base.MotionValidator):  # type: ignore[name-defined, misc]
        """Motions are free if the scene proves it."""

        def __init__(self, information: Any, scene: Any) -> None:
            super().__init__(information)
            self._scene = scene

        def checkMotion(self, a: Any, b: Any) -> bool:  # noqa: N802
            """As OMPL calls it."""
            return bool(self._scene.free_motion(values(a), values(b)))

    def values(state: Any) -> list[float]:
        return [state[i] for i in range(dof)]

    def plan(kind: str, number: int, q0: Any, q1: Any, objects: Any) -> tuple[float, Any]:
        scene = cell.filled(problems.Task(kind, number, q0, q1, objects))
        scene.free(q0)
        began = time.perf_counter()
        space, bounds = base.RealVectorStateSpace(dof), base.RealVectorBounds(dof)
        for i in range(dof):
            bounds.setLow(i, float(cell.arm.lower[i]))
            bounds.setHigh(i, float(cell.arm.upper[i]))
        space.setBounds(bounds)
        setup = geometric.SimpleSetup(space)
        setup.setStateValidityChecker(lambda state: bool(scene.free(values(state))))
        information = setup.getSpaceInformation()
        if motions:
            information.setMotionValidator(Motions(information, scene))
        begin, end = space.allocState(), space.allocState()
        for i in range(dof):
            begin[i], end[i] = q0[i], q1[i]
        setup.setStartAndGoalStates(begin, end)
        setup.setPlanner(geometric.RRTConnect(information))
        setup.solve(LIMIT)
        if not setup.haveExactSolutionPath():
            return time.perf_counter() - began, None
        setup.simplifySolution(LIMIT)
        path = setup.getSolutionPath()
        seconds = time.perf_counter() - began
        return seconds, np.array([values(path.getState(i)) for i in range(path.getStateCount())])

    return plan


class Entry(NamedTuple):
    """A planner that is measured."""

    requirements: str
    """Their name, without .txt."""
    distribution: str
    spheres: bool
    """Whether it checks VAMP's spheres; otherwise the hulls."""
    make: Callable[[str], Plan]
    """From the folder of the data."""


PLANNERS = {
    "VAMP": Entry("vamp", "vamp-planner", True, vamp),
    "OMPL, `scene.free`": Entry("ompl", "ompl", False, partial(ompl, motions=False)),
    "OMPL, `scene.free_motion`": Entry("ompl", "ompl", False, partial(ompl, motions=True)),
}


@cache
def _made(peer: str, folder: str) -> Plan:
    return PLANNERS[peer].make(folder)


def prepare(peer: str, folder: str) -> str:
    """Read what the problems share; the release of the peer."""
    _made(peer, folder)
    return version(PLANNERS[peer].distribution)


def plan(peer: str, folder: str, kind: str, number: int, q0: Any, q1: Any, objects: Any) -> tuple[float, Any]:
    """Solve a problem; the time [s], and the rows of the path, (N, 7), or None."""
    return _made(peer, folder)(kind, number, q0, q1, objects)
