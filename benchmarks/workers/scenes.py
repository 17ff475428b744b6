"""One peer that checks a Panda against itself and capsules around it, in its own environment.

Served by `benchmarks.workers.serve`. Imports NumPy and the peer, nothing of kinseek. Each has its own model of the arm: VAMP
spheres that are compiled in, the fingers a little farther open than the file's can be; PyRoki a capsule around the meshes of
each link.
"""

from __future__ import annotations

import importlib
import os
from collections.abc import Callable
from importlib.metadata import version
from typing import Any

import numpy as np

from benchmarks.timing import least

from .serve import Refused

Check = tuple[Callable[[Any], Any], Callable[[Any], Any]]
"""Joint values, (7,), to free or not; and of many, (k, 7)."""


def vamp(scene: Any) -> Check:
    """Its spheres, eight joint values side by side; from Python it takes one at a time."""
    module = importlib.import_module("vamp")
    if list(module.panda.joint_names()) != [str(name) for name in scene["joints"]]:
        raise Refused("its spheres are those of the Panda")
    environment = module.Environment()
    for begin, end, radius in zip(scene["begins"], scene["ends"], scene["radii"], strict=True):
        # By middle and Euler angles: its other way to make one, by two ends, ends the process in release 0.6.4.
        length = np.linalg.norm(end - begin)
        x, y, z = (end - begin) / length
        turn = [float(np.arcsin(-y)), float(np.arctan2(x, z)), 0.0]
        capsule = module.Cylinder(((begin + end) / 2).tolist(), turn, float(radius), float(length))
        ends = np.array([[capsule.x1, capsule.y1, capsule.z1], [capsule.x2, capsule.y2, capsule.z2]])
        if min(np.abs(ends - [begin, end]).max(), np.abs(ends - [end, begin]).max()) > 1e-5:
            raise Refused("a capsule of it lies elsewhere")
        environment.add_capsule(capsule)
    validate = module.panda.validate

    def one(q: Any) -> bool:
        return bool(validate(q, environment))

    return one, lambda many: [one(q) for q in many]


def pyroki(scene: Any) -> Check:
    """Signed distances of all pairs, compiled by JAX for the processor, on one core."""
    os.environ["XLA_FLAGS"] = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"
    os.environ["JAX_PLATFORMS"] = "cpu"
    jax, yourdfpy = importlib.import_module("jax"), importlib.import_module("yourdfpy")
    module, geometry = importlib.import_module("pyroki"), importlib.import_module("pyroki.collision")
    folder = str(scene["folder"])
    urdf = yourdfpy.URDF.load(
        str(scene["urdf"]),
        filename_handler=lambda fname, **_: fname.replace("package:/", folder),
        load_collision_meshes=True,
    )
    robot = module.Robot.from_urdf(urdf)
    ignored = tuple((str(a), str(b)) for a, b in scene["ignored"])
    model = geometry.RobotCollision.from_urdf(urdf, user_ignore_pairs=ignored)
    # A capsule of its lies along z; this turn brings z onto the way from one end to the other.
    way = scene["ends"] - scene["begins"]
    length = np.linalg.norm(way, axis=1)
    wxyz = np.stack([way[:, 2] + length, -way[:, 1], way[:, 0], np.zeros(len(way))], axis=1)
    world = geometry.Capsule.from_radius_height(
        radius=scene["radii"],
        height=length,
        position=(scene["begins"] + scene["ends"]) / 2,
        wxyz=wxyz / np.linalg.norm(wxyz, axis=1, keepdims=True),
    )
    places = [list(robot.joints.actuated_names).index(str(name)) for name in scene["joints"]]
    rest = np.full(robot.joints.num_actuated_joints, float(scene["fingers"]))

    # The base stands where it stands, and what has no geometry is a capsule without a size.
    solid = np.asarray(model.coll.size)[:, 0] > 0
    solid &= np.array(model.link_names) != str(scene["base"])

    def distance(cfg: Any) -> Any:
        own = model.compute_self_collision_distance(robot, cfg)
        others = model.compute_world_collision_distance(robot, cfg, world)
        return jax.numpy.minimum(own.min(), others[solid].min())

    single, batch = jax.jit(distance), jax.jit(jax.vmap(distance))

    def full(q: Any) -> Any:
        cfg = np.broadcast_to(rest, (*np.shape(q)[:-1], len(rest))).copy()
        cfg[..., places] = q
        return cfg

    def one(q: Any) -> bool:
        return bool(single(full(q)) > 0)

    return one, lambda many: np.asarray(batch(full(many))) > 0


CHECKERS: dict[str, tuple[str, str, Callable[[Any], Check]]] = {
    "VAMP": ("vamp", "vamp-planner", vamp),
    "PyRoki": ("pyroki", "pyroki", pyroki),
}
"""Of each the name of its requirements, its distribution, and what makes it."""


def check(peer: str, scene: dict[str, Any]) -> dict[str, Any]:
    """Check every q of a scene; what is free, and what one and one of a batch take [µs]."""
    _, distribution, make = CHECKERS[peer]
    scene = {name: np.array(value) for name, value in scene.items()}
    one, many = make(scene)
    q = scene["q"].astype(np.float32)  # As both of them compute.
    few = q[: max(len(q) // 10, 1)]
    free = np.asarray(many(q))
    single, batch = least(lambda: [one(each) for each in few]), least(lambda: many(q))
    times = {"single": single / len(few) * 1e6, "batch": batch / len(q) * 1e6}
    return times | {"free": free, "version": version(distribution)}
