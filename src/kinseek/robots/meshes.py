"""Read the meshes of a robot's file, for pictures and for collisions; `packages` finds the files."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinseek.errors import InvalidRobot
from kinseek.forks import importing
from kinseek.interrupts import raise_of_handler
from kinseek.kernels.arm.pose_error import LARGEST
from kinseek.transforms import rotation, transform

from .mesh_files import LEAST_BODIES, Beside, Budget, ending, readable, require_mesh

Array = NDArray[np.float64]

MOST_MESH = 64 * 2**20
"""Most bytes of one mesh's file."""


def mesh_parts(path: Path, most: int = MOST_MESH, *, budget: Budget | None = None) -> list[Any]:
    """Read the triangles of a mesh file, one body each, in metres.

    Args:
        path: The file.
        most: Largest size of the file in bytes, and of the files of its materials and images together.
        budget: Remaining budget of all meshes of the robot; the size of this one is subtracted.

    Raises:
        InvalidRobot: The file cannot be read, its format is not supported, or it would unpack to more than the limits or the
            budget allow.
    """
    kind = ending(path)
    budget = Budget(2 * most) if budget is None else budget
    text = budget.read(path, most)
    real = path.resolve()
    if real in budget.refused:
        raise InvalidRobot(budget.refused[real])
    try:
        return _parts(path, kind, readable(kind, text), most, budget)
    except InvalidRobot as error:
        budget.refused[real] = str(error)
        raise


def _parts(path: Path, kind: str, text: bytes, most: int, budget: Budget) -> list[Any]:
    """Check a mesh and read it, as `mesh_parts` does."""
    with importing:
        import logging

        import trimesh

    # Without any handler, Python would print trimesh's log message about a missing material, with a traceback.
    log = logging.getLogger("trimesh")
    if not log.handlers:
        log.addHandler(logging.NullHandler())
    size = require_mesh(path, text)
    budget.take(size._replace(bodies=max(size.bodies, LEAST_BODIES)))
    try:
        load = trimesh.exchange.load.mesh_loaders[kind]
        found = load(file_obj=io.BytesIO(text), file_type=kind, resolver=Beside(path, most, budget))
        # Otherwise trimesh leaves out triangles with NaN, and makes one of vertices within 1e-8 before they are scaled.
        for each in found["geometry"].values() if "geometry" in found else [found]:
            each["process"] = False
        # Frames have the names of bodies: one with the name of the root, "world", would lose its place.
        for number, edge in enumerate(found["graph"] if kind == "dae" else []):
            edge["frame_to"] = number
        scene = trimesh.load_scene(found)
        scene.graph.repair_rigid = None  # Otherwise scales within 1e-5 of 1 are left out.
        bodies = budget.copy(scene)
    except Exception as error:  # Mesh readers raise whatever their parsers raise.
        raise_of_handler(error)
        raise InvalidRobot(f"{str(path)!r} cannot be read: {error or type(error).__name__}") from None
    parts = [part for part in bodies if isinstance(part, trimesh.Trimesh) and len(part.faces)]
    read = sum(len(part.faces) for part in parts)
    if read != size.triangles:
        raise InvalidRobot(
            f"{str(path)!r} has {size.triangles:,} triangles, of which {read:,} can be read. In COLLADA, look for materials "
            "that are missing, sources with another number of columns, and instances of nodes in other nodes"
            if kind == "dae"
            else f"{str(path)!r} has {size.triangles:,} triangles, of which {read:,} can be read; write it anew"
        )
    if not parts:
        raise InvalidRobot(f"{str(path)!r} holds no triangles")
    for part in parts:
        if part.faces.min() < 0 or part.faces.max() >= len(part.vertices):
            raise InvalidRobot(f"{str(path)!r}: a face refers to a vertex that does not exist")
        part.remove_unreferenced_vertices()
        if part.vertices.shape[1] != 3 or not np.isfinite(part.vertices).all():
            raise InvalidRobot(f"{str(path)!r}: a vertex is not of three finite numbers")
    # COLLADA declares its unit in metres, and the reader does not apply it. In GLB, metadata is free text of the author.
    for part in parts if kind == "dae" else []:
        word = str(part.metadata.get("units", "")).partition(" * meters")
        if word[1]:
            part.apply_scale(float(word[0]))
    return parts


def origin_of(element: Any) -> Array:
    """The <origin> of a visual or joint, (4, 4): ``Rz(yaw) Ry(pitch) Rx(roll)``, lengths in [m].

    Raises:
        InvalidRobot: It holds no finite numbers, or lies too far off.
    """
    origin = element.find("origin")
    if origin is None:
        return np.eye(4)
    turn = np.eye(3)
    for axis, angle in zip(np.eye(3), numbers_of(origin.get("rpy"), 3, 0.0), strict=True):
        turn = rotation(axis, float(angle)) @ turn
    place = numbers_of(origin.get("xyz"), 3, 0.0)
    if (farthest := float(np.abs(place).max())) > LARGEST:
        raise InvalidRobot(f"an origin must lie within {LARGEST:g} m along each axis, got {farthest:g} m")
    return transform(turn, place)


def numbers_of(text: str | None, count: int, default: float | None = None) -> Array:
    """Return the `count` finite numbers of an attribute.

    Raises:
        InvalidRobot: The attribute has another count of numbers, or is missing without a default.
    """
    if text is None and default is not None:
        return np.full(count, default)
    try:
        # Python alone would accept 1_000.
        values = np.array([float(part.replace("_", "?")) for part in (text or "").split()])
    except ValueError:
        values = np.array([np.nan])
    if len(values) != count or not np.isfinite(values).all():
        raise InvalidRobot(f"expected {count} finite number{'s' if count > 1 else ''}, got {text!r}")
    return values
