"""Read a mesh of a robot's file, for pictures and for collisions; `process` does it with limits of memory and time."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from kinseek.errors import InvalidRobot, reason
from kinseek.robots.files import without_links
from kinseek.support.forks import importing
from kinseek.support.interrupts import raise_of_handler

from . import collada, glb, obj, ply, stl
from .limits import LEAST_BODIES, Beside, Budget, Size, ending, utf8
from .polygons import Body, Looks

MOST_MESH = 64 * 2**20
"""Most bytes of one mesh's file."""


def mesh_parts(
    path: Path, most: int = MOST_MESH, *, budget: Budget | None = None, looks: bool = True
) -> list[Any]:
    """Read the triangles of a mesh file, one body each, in metres.

    Args:
        path: The file.
        most: Largest size of the file in bytes, and of the files of its materials and images together.
        budget: Remaining budget of all meshes of the robot; the size of this one is subtracted.
        looks: Read the files of materials and images, too?

    Raises:
        InvalidRobot: The file cannot be read, its format is not supported, or it would unpack to more than the limits or the
            budget allow.
    """
    kind = ending(path)
    budget = Budget(2 * most) if budget is None else budget
    text = budget.read(path, most)
    real = str(without_links(path))
    if real in budget.refused:
        raise InvalidRobot(budget.refused[real])
    try:
        return _parts(path, kind, text, Beside(path, most, budget), budget, looks)
    except InvalidRobot as error:
        budget.refused[real] = str(error)
        budget.bodies_left -= LEAST_BODIES
        raise


def _parts(path: Path, kind: str, text: bytes, beside: Beside, budget: Budget, looks: bool) -> list[Any]:
    """Check a mesh and read it, as `mesh_parts` does."""
    import_trimesh()

    def take(size: Size) -> None:
        least = 0 if size.tried else LEAST_BODIES
        budget.take(size._replace(bodies=max(size.bodies, least)))

    try:
        if kind in ("dae", "glb"):
            bodies, found = (glb if kind == "glb" else collada).read(text, take, looks)
            parts = _painted(bodies, _materials(found, beside))
            budget.take_images(parts)
        elif kind == "obj":
            bodies, libraries = obj.read(text, take, looks)
            parts = _painted(bodies, _materials_of_obj(libraries, beside) if looks else {})
            budget.take_images(parts)
        else:
            parts = _painted((ply if kind == "ply" else stl).read(text, take), {})
    except InvalidRobot as error:
        raise InvalidRobot(f"{str(path)!r}: {error}") from None
    except Exception as error:  # Mesh readers raise whatever their parsers raise.
        raise_of_handler(error)
        raise InvalidRobot(f"{str(path)!r} cannot be read: {reason(error)}") from None
    if not parts:
        raise InvalidRobot(f"{str(path)!r} holds no triangles")
    for part in parts:
        if part.faces.min() < 0 or part.faces.max() >= len(part.vertices):
            raise InvalidRobot(f"{str(path)!r}: a face refers to a vertex that does not exist")
        part.remove_unreferenced_vertices()
        if part.vertices.shape[1] != 3 or not np.isfinite(part.vertices).all():
            raise InvalidRobot(f"{str(path)!r}: a vertex is not of three finite numbers")
    return parts


def import_trimesh() -> Any:
    """Import trimesh before it is used: a forked child could not finish an import that another thread has begun.

    trimesh would import manifold3d, if it is installed, for operations that kinseek does not use. Wheels of manifold3d name
    the temporary folder of their build as the first place of their libraries: another user can put code there.

    Raises:
        ImportError: It is not installed.
    """
    with importing, _without("manifold3d"):
        import logging

        import trimesh
    # Without any handler, Python would print trimesh's log messages about files, with tracebacks.
    log = logging.getLogger("trimesh")
    if not log.handlers:
        log.addHandler(logging.NullHandler())
    return trimesh


@contextmanager
def _without(name: str) -> Iterator[None]:
    """Let Python find no module of a name, unless it is imported already."""
    known = name in sys.modules
    if not known:
        sys.modules[name] = None  # type: ignore[assignment]
    try:
        yield
    finally:
        if not known:
            sys.modules.pop(name, None)


def _painted(bodies: list[Body], materials: Mapping[str, Any]) -> list[Any]:
    """Give bodies their looks."""
    import trimesh

    parts = []
    for body in bodies:
        if not len(body.faces):
            continue
        vertices, faces, visual = body.vertices, body.faces, None
        material = materials.get(body.material)
        looks = [None if material is None else body.uv, body.normals, body.vertex_colours]
        looks = [each if each is None or _is_single(each) else None for each in looks]
        # Those of corners: a vertex may have several places in the image, normals and colours.
        if any(each is not None and each.ndim == 3 for each in looks):
            at_corners = (each if each is None or each.ndim == 3 else each[faces] for each in looks)
            looks = [None if each is None else each.reshape(-1, each.shape[-1]) for each in at_corners]
            vertices = vertices[faces].reshape(-1, 3)
            faces = np.arange(len(vertices)).reshape(-1, 3)
        uv, normals, vertex_colours = looks
        if material is not None:
            visual = trimesh.visual.TextureVisuals(uv=uv, material=material)
        colours = {} if visual else {"vertex_colors": vertex_colours, "face_colors": body.face_colours}
        parts.append(
            trimesh.Trimesh(vertices, faces, process=False, visual=visual, vertex_normals=normals, **colours)
        )
    return parts


def _is_single(look: Any) -> bool:
    """Return whether numbers fit into single precision, as for a page: one that does not would hide the whole mesh."""
    return bool((np.abs(look) <= np.finfo(np.float32).max).all())


def _materials_of_obj(libraries: list[str], beside: Beside) -> dict[str, Any]:
    """Return the materials of OBJ; those that cannot be read are left out."""
    import trimesh

    materials = dict[str, Any]()
    for name in dict.fromkeys(libraries):
        with suppress(InvalidRobot, TypeError):  # A statement ``name`` gives a material no name.
            found = trimesh.exchange.obj.parse_mtl(utf8(beside[name]), resolver=beside)
            materials |= {
                key: trimesh.visual.material.SimpleMaterial(**_look_of_obj(look))
                for key, look in found.items()
            }
    return materials


def _look_of_obj(look: Mapping[str, Any]) -> dict[str, Any]:
    """Return the arguments of trimesh's material that are of their kind.

    A colour may be one number, which is red, green and blue then (Wavefront, "Material Library Files", 1995).
    """
    given: dict[str, Any] = {"name": look["name"]}
    if not isinstance(image := look.get("image"), list):  # A statement ``image`` gives a list of words.
        given["image"] = image
    if isinstance(exponent := look.get("glossiness"), float):
        given["glossiness"] = exponent
    for key in ("ambient", "diffuse", "specular"):
        colour = look.get(key)
        colour = 3 * [colour] if isinstance(colour, float) else colour or []
        if len(colour) in (3, 4) and all(isinstance(each, float) for each in colour):
            given[key] = colour
    return given


def _materials(looks: Looks, beside: Beside) -> dict[str, Any]:
    """Return the materials of COLLADA or GLB; images that cannot be read are left out."""
    import trimesh

    materials, opened = dict[str, Any](), dict[str | bytes, Any]()
    for name, look in looks.items():
        given = dict(look)
        for key in [key for key in look if key.endswith("Texture")]:
            source = given.pop(key)
            if source not in opened:
                opened[source] = None
                with suppress(InvalidRobot):
                    opened[source] = beside.image(source)
            given |= {} if opened[source] is None else {key: opened[source]}
        materials[name] = trimesh.visual.material.PBRMaterial(**given)
    return materials
