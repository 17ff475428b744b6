"""GLB files: the bodies of the scene that a file shows; `glb_file` reads numbers, and `glb_looks` materials.

Whatever the specification says about shapes is done, or refused with an error that names it.

Source: *glTF 2.0 Specification*, Khronos Group (2021), to whose sections the numbers refer.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from math import hypot
from typing import NamedTuple

import numpy as np

from kinseek.errors import InvalidRobot
from kinseek.support.transforms import from_quaternion

from .glb_file import GlbFile, Json, Numbers, entry, listed, whole
from .glb_looks import looks_of, painted
from .limits import MOST_BODIES, Size, at_most, drawn_corners
from .polygons import Array, Body, Indices, Looks, placed

_NO_SURFACE, _TRIANGLES, _STRIP, _FAN = (0, 1, 2, 3), 4, 5, 6
"""Modes of primitives; the first four are points and lines."""
_FLOAT, _UNSIGNED = 5126, (5121, 5123, 5125)
"""Component types of positions, and of indices."""
_MOVES = {"translation": 3, "rotation": 4, "scale": 3, "matrix": 16}
"""What moves a node, and how many numbers it has."""
_UNIT = 1e-4
"""How much the length of a quaternion may differ from 1, for rounding."""
_ONLY_LOOKS = ("KHR_materials_", "KHR_texture_", "EXT_texture_", "KHR_lights_")
"""How the names of extensions begin that do not change shapes."""
_OF_SHAPES = {
    "AGI_articulations": "articulations",
    "CESIUM_RTC": "a place of its own",
    "EXT_mesh_gpu_instancing": "instances",
    "KHR_draco_mesh_compression": "compressed numbers (Draco)",
    "KHR_node_visibility": "a visibility",
    "MSFT_lod": "levels of detail",
}
"""Extensions of files, nodes, meshes and primitives, with which readers that know them show another shape than others."""


def read(text: bytes, take: Callable[[Size], None], looks: bool) -> tuple[list[Body], Looks]:
    """Read the bodies of the scene that a file shows, in metres.

    A file without scenes shows nothing, since it is a library of meshes (3.5.1). Animations are ignored.

    Args:
        text: The file.
        take: Is given the size of the bodies before they are read.
        looks: Read their looks, too?

    Raises:
        InvalidRobot: A part of the scene cannot be read, readers differ on it, or it is too large.
    """
    file = GlbFile(text)
    _require_known_extensions(file)
    nodes = _shown(file)
    shown = [(whole(node, "mesh"), matrix) for node, matrix in nodes if "mesh" in node]
    parts = {mesh: _parts(file.element("meshes", mesh), file) for mesh in {mesh for mesh, _ in shown}}
    sizes = {mesh: Size.of([Size(1, 3 * part.triangles) for part in found]) for mesh, found in parts.items()}
    size = Size.of([sizes[mesh] for mesh, _ in shown])
    at_most(size.bodies, MOST_BODIES, "bodies")
    take(Size(max(len(nodes), size.bodies), drawn_corners(size.corners, text)))
    bodies = {mesh: [_body(part, file, looks) for part in found] for mesh, found in parts.items()}
    found = [placed(body, matrix) for mesh, matrix in shown for body in bodies[mesh]]
    return found, looks_of(file, {body.material for body in found}, len(text)) if looks else {}


class _Part(NamedTuple):
    """A primitive with triangles."""

    described: Json
    mode: int
    positions: Numbers
    """(n, 3)"""
    indices: Numbers | None
    """(m,); without them, each position is a corner."""

    @property
    def corners(self) -> int:
        """Number of corners that are named, one after the other."""
        return len(self.positions if self.indices is None else self.indices)

    @property
    def triangles(self) -> int:
        """Number of triangles: every corner of a strip or a fan but two begins one."""
        return self.corners // 3 if self.mode == _TRIANGLES else self.corners - 2


def _require_known_extensions(file: GlbFile) -> None:
    """Refuse extensions that the file cannot be read without, except those of looks (3.12)."""
    _require_no_extension(file.document, "the file")
    for name in listed(file.document, "extensionsRequired"):
        if not isinstance(name, str) or not name.startswith(_ONLY_LOOKS):
            raise InvalidRobot(
                f"it requires the extension {name!r:.100}, expected none but those of materials, images and lights; "
                "write it without"
            )


def _require_no_extension(element: Json, who: str) -> None:
    for name in sorted(_OF_SHAPES.keys() & entry(element, "extensions")):
        raise InvalidRobot(f"{who} has {_OF_SHAPES[name]} ({name}), expected none; write it without")


def _require_no_weights(element: Json) -> None:
    """Refuse morphed bodies: weights of 0 leave them as they are (3.7.2.2)."""
    if any(isinstance(each, bool) or each != 0 for each in listed(element, "weights")):
        raise InvalidRobot("its bodies are morphed by weights, expected their final shape; apply the weights")


def _shown(file: GlbFile) -> list[tuple[Json, Array]]:
    """Return the nodes of the scene, with the place of each, (4, 4) (3.5).

    A file with one scene need not name it. Each node is in one other node at most.
    """
    scenes = len(listed(file.document, "scenes"))
    if "scene" not in file.document and scenes > 1:
        raise InvalidRobot(f"it has {scenes} scenes and names none, expected the number of one in 'scene'")
    if not scenes and "scene" not in file.document:
        return []
    count = len(listed(file.document, "nodes"))
    roots = _indices(file.element("scenes", whole(file.document, "scene", 0)), "nodes")
    children = [_indices(file.element("nodes", index), "children") for index in range(count)]
    named = [*roots, *(child for each in children for child in each)]
    if len(set(named)) < len(named):
        raise InvalidRobot(
            "a node is in two nodes, or in a node and the scene, or twice in one, expected each once; copy the node"
        )
    left = [(root, np.eye(4)) for root in reversed(roots)]
    found = list[tuple[Json, Array]]()
    with np.errstate(over="ignore", invalid="ignore"):  # Who reads the file rejects what is not finite then.
        while left:
            index, above = left.pop()
            at_most(len(found) + 1, MOST_BODIES, "nodes")
            node = file.element("nodes", index)
            matrix = above @ _matrix(node)
            found.append((node, matrix))
            left += [(child, matrix) for child in reversed(children[index])]
    return found


def _indices(owner: Json, name: str) -> list[int]:
    return [whole({name: each}, name) for each in listed(owner, name)]


def _matrix(node: Json) -> Array:
    """Return the matrix that moves a node, (4, 4): its own, or T·R·S (3.5.3).

    Raises:
        InvalidRobot: It is none; or something else than a matrix changes the shape of the node, too.
    """
    _require_no_extension(node, "a node")
    _require_no_weights(node)
    if "skin" in node:
        raise InvalidRobot("a node has a skin, expected a shape without one; apply it, and take it out")
    moves = {name: _moving(node, name) for name in _MOVES if name in node}
    matrix = np.eye(4)
    if "matrix" in moves:
        matrix = moves["matrix"].reshape(4, 4, order="F")
        if len(moves) > 1 or matrix[3].tolist() != [0, 0, 0, 1]:
            raise InvalidRobot(
                "a node has a matrix whose last row is not 0, 0, 0, 1, or a matrix and another motion; readers differ on "
                "both"
            )
        return matrix
    x, y, z, w = moves.get("rotation", matrix[3])
    if abs(hypot(x, y, z, w) - 1.0) > _UNIT:
        raise InvalidRobot("a node has a rotation that is not a quaternion of length 1; readers differ on it")
    matrix[:3, :3] = from_quaternion(np.array([w, x, y, z])) * moves.get("scale", np.ones(3))
    matrix[:3, 3] = moves.get("translation", np.zeros(3))
    return matrix


def _moving(node: Json, name: str) -> Array:
    numbers, most = node[name], sys.float_info.max
    if (
        not isinstance(numbers, list)
        or len(numbers) != _MOVES[name]
        or not all(type(x) in (int, float) and -most <= x <= most for x in numbers)
    ):
        raise InvalidRobot(f"a node has the {name} {numbers!r:.100}, expected {_MOVES[name]} finite numbers")
    return np.array(numbers, np.float64)


def _parts(mesh: Json, file: GlbFile) -> list[_Part]:
    """Return the primitives of a mesh that have triangles."""
    _require_no_extension(mesh, "a mesh")
    _require_no_weights(mesh)
    if not listed(mesh, "primitives"):
        raise InvalidRobot("a mesh has no primitives")
    primitives = [entry({"primitives": each}, "primitives") for each in listed(mesh, "primitives")]
    at_most(len(primitives), MOST_BODIES, "bodies")
    return [_part(each, file) for each in primitives if whole(each, "mode", _TRIANGLES) not in _NO_SURFACE]


def _part(described: Json, file: GlbFile) -> _Part:
    """Check a primitive (3.7.2.1)."""
    mode = whole(described, "mode", _TRIANGLES)
    if mode not in (_TRIANGLES, _STRIP, _FAN):
        raise InvalidRobot(
            f"it has a body of mode {mode}, expected 0 to 3 (points and lines), {_TRIANGLES} (triangles), "
            f"{_STRIP} (a strip) or {_FAN} (a fan)"
        )
    _require_no_extension(described, "a body")
    attributes = entry(described, "attributes")
    if "POSITION" not in attributes:
        raise InvalidRobot("a body has no positions")
    accessor = file.element("accessors", whole(attributes, "POSITION"))
    got = accessor.get("type"), accessor.get("componentType"), accessor.get("normalized", False)
    if got[:2] != ("VEC3", _FLOAT) or got[2] is not False:
        raise InvalidRobot(
            "its positions are {!s:.100}, component type {!s:.100}, normalized {!s:.100}; expected VEC3 of floats ({}), not "
            "normalized: write it without quantization".format(*got, _FLOAT)
        )
    part = _Part(described, mode, file.numbers(accessor), _indices_of(described, file))
    if part.corners < 3 or (mode == _TRIANGLES and part.corners % 3):
        raise InvalidRobot(
            f"a body has {part.corners:,} corners, expected at least 3, and 3 for each of its triangles"
        )
    return part


def _indices_of(described: Json, file: GlbFile) -> Numbers | None:
    """Return the indices of a primitive, if it has some, (n,)."""
    if "indices" not in described:
        return None
    accessor = file.element("accessors", whole(described, "indices"))
    got = accessor.get("type"), accessor.get("componentType"), accessor.get("normalized", False)
    if got[0] != "SCALAR" or got[1] not in _UNSIGNED or got[2] is not False:
        raise InvalidRobot(
            "its indices are of component type {1!s:.100}, {0!s:.100}, normalized {2!s:.100}; expected SCALAR of whole "
            "numbers from 0 on, not normalized".format(*got)
        )
    numbers: Numbers = file.numbers(accessor, tight=True)[:, 0]
    return numbers


def _body(part: _Part, file: GlbFile, looks: bool) -> Body:
    """Return the triangles of a primitive. Corners that no triangle has may have any number."""
    count = len(part.positions)
    if part.indices is None:
        corners = np.arange(count)
    else:
        # The largest number of a type begins a new strip in some readers.
        most = min(count, np.iinfo(part.indices.dtype).max) - 1
        if (largest := int(part.indices.max())) > most:
            raise InvalidRobot(
                f"a body has the index {largest}, expected one from 0 to {most}: a vertex that does not exist"
            )
        corners = part.indices.astype(np.int64)
    faces = corners.reshape(-1, 3) if part.mode == _TRIANGLES else corners[_turns(part)]
    if faces.size < count:  # Bodies may share positions: each has those of its own only.
        used, own = np.unique(faces, return_inverse=True)
    else:
        used, own = np.arange(count), faces
    body = Body(part.positions[used].astype(np.float64), own.reshape(-1, 3))
    return painted(body, used, part.described, file) if looks else body


def _turns(part: _Part) -> Indices:
    """Return which corners of a strip or a fan form its triangles, (n, 3) (3.7.2.1)."""
    i = np.arange(part.triangles)
    if part.mode == _STRIP:
        return np.stack([i, i + 1 + i % 2, i + 2 - i % 2], axis=1)
    return np.stack([i + 1, i + 2, 0 * i], axis=1)
