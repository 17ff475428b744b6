"""MuJoCo's verdicts on a scene: the same shapes and pairs, its own forward kinematics and collisions.

An independent check of what kinseek reports as free. Every pair that counts is named to MuJoCo, so that its own rules skip
none.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import mujoco
import numpy as np

import kinseek
from kinseek.collision import Box, Capsule, Cylinder, Mesh, Points, Sphere
from kinseek.collision.engine import Solid

from .targets import Array


class Outside:
    """A scene without padding as MuJoCo has it."""

    def __init__(self, scene: kinseek.Scene, arm: kinseek.Arm) -> None:
        """Build the model, joint by joint along the arm's own fixed transforms."""
        chain, engine = arm.chain, scene._engine
        self._chain = chain
        spec = mujoco.MjSpec()
        frames = [spec.worldbody]
        for k, slides in enumerate(chain.prismatic):
            place, turn = _placed(np.vstack([chain.fixed[k], [0, 0, 0, 1]]))
            frames.append(frames[-1].add_body(pos=place, quat=turn, mass=1.0, inertia=[1.0, 1.0, 1.0]))
            kind = mujoco.mjtJoint.mjJNT_SLIDE if slides else mujoco.mjtJoint.mjJNT_HINGE
            frames[-1].add_joint(type=kind, axis=[0, 0, 1])
        names: list[list[str]] = []
        for number, solid in enumerate(engine.solids):
            assert not solid.padding
            names.append([])
            for part, form in enumerate(_forms(spec, solid, f"mesh{number}")):
                names[-1].append(f"geom{number}.{part}")
                frames[solid.joint].add_geom(name=names[-1][-1], contype=0, conaffinity=0, **form)
        for i, j in engine.pairs:
            for one in names[i]:
                for other in names[j]:
                    spec.add_pair(geomname1=one, geomname2=other)
        self._model = spec.compile()
        self._data = mujoco.MjData(self._model)

    def depths(self, q: Array) -> Array:
        """How deep the deepest pair is at each q, (k, n) -> (k,) [m]; 0 where none touches."""
        out = np.zeros(len(q))
        for i, values in enumerate(self._chain.multiplier * q[:, self._chain.leader] + self._chain.offset):
            self._data.qpos[:] = values
            mujoco.mj_kinematics(self._model, self._data)
            mujoco.mj_collision(self._model, self._data)
            if self._data.ncon:
                out[i] = max(0.0, -float(self._data.contact.dist.min()))
        return out


def _placed(pose: Array) -> tuple[list[float], list[float]]:
    turn = np.zeros(4)
    mujoco.mju_mat2Quat(turn, np.ascontiguousarray(pose[:3, :3]).ravel())
    return pose[:3, 3].tolist(), turn.tolist()


def _forms(spec: Any, solid: Solid, name: str) -> Iterator[dict[str, Any]]:
    """What MuJoCo calls the shape of one part."""
    shape, kinds = solid.shape, mujoco.mjtGeom
    place, turn = _placed(solid.pose)
    if isinstance(shape, Points):
        for point in np.asarray(shape.cloud):
            at = (solid.pose[:3, :3] @ point + solid.pose[:3, 3]).tolist()
            yield {"type": kinds.mjGEOM_SPHERE, "size": [shape.radius, 0, 0], "pos": at}
        return
    form: dict[str, Any] = {"pos": place, "quat": turn}
    if isinstance(shape, Sphere):
        yield form | {"type": kinds.mjGEOM_SPHERE, "size": [shape.radius, 0, 0]}
    elif isinstance(shape, Capsule | Cylinder):
        kind = kinds.mjGEOM_CAPSULE if isinstance(shape, Capsule) else kinds.mjGEOM_CYLINDER
        yield form | {"type": kind, "size": [shape.radius, shape.length / 2, 0]}
    else:
        # A box goes in as the hull of its corners: MuJoCo's own capsule and box are not seen to touch where the middle line
        # of the capsule goes right through a thin box.
        assert isinstance(shape, Box) or (isinstance(shape, Mesh) and shape.hull)
        spec.add_mesh(name=name, uservert=np.asarray(shape.corners).ravel().tolist())
        yield form | {"type": kinds.mjGEOM_MESH, "meshname": name}
