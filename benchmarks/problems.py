"""MotionBenchMaker's problems for a Panda, and the scenes in which they are solved.

The data are the folder ``resources/panda`` of the repository KavrakiLab/vamp (Apache-2.0): 100 problems in each of seven
kinds of scenes (Chamzas et al. 2022, *MotionBenchMaker*), the arm with the hulls of its meshes, and the arm with the spheres
that VAMP checks in their place.
"""

from __future__ import annotations

import copy
import re
import tarfile
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml  # type: ignore[import-untyped]

import kinseek

from .targets import Array

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


class Cell(NamedTuple):
    """A model of the arm, and its scene without the objects of a problem."""

    arm: kinseek.Arm
    scene: kinseek.Scene
    spheres: bool

    @classmethod
    def read(cls, folder: Path, spheres: bool = False) -> Cell:
        """Read the arm with the hulls of its meshes, or with VAMP's spheres."""
        file = folder / ("panda_spherized.urdf" if spheres else "panda.urdf")
        arm = kinseek.load(file.read_text(encoding="utf-8").replace(*WIDER), tip="panda_hand")
        meshes = {} if spheres else {"meshes": folder / "meshes"}
        return cls(arm, kinseek.Scene.of(arm, meshes=meshes, srdf=folder / "panda.srdf"), spheres)

    def filled(self, task: Task) -> kinseek.Scene:
        """The scene with the objects of a problem; beside spheres, cylinders are what VAMP makes of them."""
        scene = copy.copy(self.scene)
        for thing in task.objects:
            (shape,), (place,) = thing["primitives"], thing["primitive_poses"]
            base = _pose(thing["pose"]) if "pose" in thing else np.eye(4)
            pose, sizes = base @ _pose(place), shape["dimensions"]
            if shape["type"] == "box":
                scene.add_box(thing["id"], sizes, pose)
            elif shape["type"] == "sphere":
                scene.add_sphere(thing["id"], sizes[0], pose)
            elif not self.spheres:
                scene.add_cylinder(thing["id"], sizes[1], sizes[0], pose)
            elif task.kind == "box":
                scene.add_box(thing["id"], [2.0 * sizes[1], 2.0 * sizes[1], sizes[0]], pose)
            else:
                scene.add_capsule(thing["id"], sizes[1], sizes[0], pose)
        return scene


def _pose(values: dict[str, Any]) -> Array:
    return np.asarray(kinseek.pose(values["position"], quat_xyzw=values["orientation"]))


def points(q: Array, count: int) -> Array:
    """Joint values at even distances along a path, (N, n) -> (count, n), the first and the last included."""
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(q, axis=0), axis=1))])
    places = np.linspace(0.0, along[-1], count)
    return np.stack([np.interp(places, along, row) for row in q.T], axis=1)


def length(q: Array) -> float:
    """Length of a path, (N, n) [rad]."""
    return float(np.linalg.norm(np.diff(q, axis=0), axis=1).sum())
