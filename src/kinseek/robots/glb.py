"""What kinseek reads of GLB files, and how large they are unpacked; trimesh reads them.

trimesh trusts the sizes that a file declares, and passes over what it does not know. So this module adds up the declared
sizes of accessors, views, primitives and nodes, each of which may be referred to many times, and rejects what would be lost.
"""

from __future__ import annotations

import json
import struct
from math import hypot, isfinite
from typing import Any

from kinseek.errors import InvalidRobot

from .mesh_files import MOST_BODIES, MOST_PIXELS, MOST_SHARED, Size, drawn_corners, pixels_of_image
from .polygons import at_most

MOST_JSON = 2**22
"""Most bytes of the description at the beginning of a file."""

_COMPONENT = {5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4}
"""Bytes of one number of an accessor, by its component type."""
_NUMBERS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
"""Numbers in one item of it, by its name."""
_FLOAT = 5126
"""The code of numbers with a point, of which positions are."""
_TRIANGLES, _STRIP = 4, 5
_MODES = {0: "points", 1: "lines", _TRIANGLES: "triangles", _STRIP: "a strip of triangles"}
"""Of bodies: trimesh passes over others, and over the place of a node that has no other body."""
_UNSIGNED = (5121, 5123, 5125)
"""Codes of numbers that may be indices."""
_MOVES = {"translation": 3, "rotation": 4, "scale": 3, "matrix": 16}
"""What moves a node, and how many numbers it has."""
_UNIT = 1e-3
"""How much the length of a quaternion may differ from 1, for rounding."""
_BINARY = 0x004E4942
"""The kind of a chunk with numbers and images."""
_ONLY_LOOKS = ("KHR_materials_", "KHR_texture_", "EXT_texture_", "KHR_lights_")
"""How the names of extensions begin that do not change shapes."""


def measured(text: bytes) -> Size:
    """Return the size of a file unpacked.

    Raises:
        InvalidRobot: It is too large, or trimesh would pass over a part of it.
    """
    length = struct.unpack_from("<I", text, 12)[0]
    at_most(length, MOST_JSON, "bytes of JSON")
    document: dict[str, Any] = json.loads(text[20 : 20 + length].decode(), object_pairs_hook=_once)
    _require_whole(document)
    views, images = document.get("bufferViews", []), document.get("images", [])
    if any("uri" in each for each in [*document.get("buffers", []), *images]) or any(
        each["buffer"] != 0 for each in views
    ):
        raise InvalidRobot("parts of it are in other files or buffers; write it as one file with one buffer")
    accessors = document.get("accessors", [])
    bytes_of = [
        _count(each["count"]) * _COMPONENT[each["componentType"]] * _NUMBERS[each["type"]]
        for each in accessors
    ]
    at_most(sum(bytes_of), 2 * len(text), "bytes in its accessors")
    at_most(sum(_count(each["byteLength"]) for each in views), 2 * len(text), "bytes in its views")
    parts_of = [mesh["primitives"] for mesh in document.get("meshes", [])]
    if any("KHR_draco_mesh_compression" in part.get("extensions", {}) for mesh in parts_of for part in mesh):
        raise InvalidRobot("its meshes are compressed (Draco); write them without compression")
    weights = [sum(bytes_of[each] for part in parts for each in _accessors(part)) for parts in parts_of]
    sizes = [Size.of([_size(part, accessors) for part in parts]) for parts in parts_of]
    _require_its_shape(document)
    glossy = "KHR_materials_pbrSpecularGlossiness"
    if images and any(glossy in each.get("extensions", {}) for each in document.get("materials", [])):
        raise InvalidRobot(
            "trimesh computes new images for its glossy materials; write them as metallic ones"
        )
    nodes, held = document.get("nodes", []), Size.of(sizes)
    at_most(len(nodes) + held.bodies + len(images), MOST_BODIES, "nodes, bodies and images")
    children = [child for node in nodes for child in node.get("children", [])]
    roots = [root for scene in document.get("scenes", []) for root in scene.get("nodes", [])]
    meshes = [nodes[each]["mesh"] for each in [*children, *roots] if "mesh" in nodes[each]]
    shown = Size.of([sizes[mesh] for mesh in meshes])
    at_most(shown.bodies, MOST_BODIES, "bodies")
    shared = max(sum(weights), sum(weights[mesh] for mesh in meshes))
    at_most(shared, max(2 * len(text), MOST_SHARED), "bytes in its bodies")
    corners = max(held.corners, drawn_corners(shown.corners, text))
    pictures = [views[each["bufferView"]] for each in images]
    at_most(sum(each["byteLength"] for each in pictures), 2 * len(text), "bytes in its images")
    content = _content(text, 20 + length)
    at_most(sum(_pixels(content, each) for each in pictures), MOST_PIXELS, "pixels in its images")
    return Size(
        max(len(nodes), held.bodies, shown.bodies),
        corners,
        sum(
            sizes[nodes[each]["mesh"]].triangles for each in _shown(document, nodes) if "mesh" in nodes[each]
        ),
    )


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return an object of JSON; readers differ on a name that it has twice: some use the first value, some the last one."""
    found = dict(pairs)
    if len(found) < len(pairs):
        raise InvalidRobot("an object of its JSON has a name twice; readers differ on its value")
    return found


def _require_whole(document: dict[str, Any]) -> None:
    """Check the numbers of bodies and their places; Python would count negative ones from the end, and true as 1.

    Raises:
        InvalidRobot: One of them is not a whole number from 0 on.
    """
    primitives = [part for mesh in document.get("meshes", []) for part in mesh["primitives"]]
    for some, names in (
        ([document], ("scene",)),
        (document.get("accessors", []), ("bufferView", "byteOffset", "componentType", "count")),
        (document.get("bufferViews", []), ("buffer", "byteOffset", "byteLength", "byteStride")),
        (primitives, ("indices", "mode")),
        ([part["attributes"] for part in primitives], ("POSITION",)),
        (document.get("nodes", []), ("mesh",)),
    ):
        for each in some:
            for name in names:
                if name in each:
                    _count(each[name])
    for one in [*document.get("nodes", []), *document.get("scenes", [])]:
        for index in [*one.get("children", []), *one.get("nodes", [])]:
            _count(index)


def _accessors(part: dict[str, Any]) -> list[int]:
    """Return the accessors of a primitive."""
    return [*part["attributes"].values(), *([part["indices"]] if "indices" in part else [])]


def _size(part: dict[str, Any], accessors: list[Any]) -> Size:
    """Return the size of a primitive; every corner of a strip but two begins a triangle."""
    count = accessors[part.get("indices", part["attributes"].get("POSITION"))]["count"]
    mode = part.get("mode", _TRIANGLES)
    if mode == _STRIP:
        return Size(1, 3 * count, max(count - 2, 0))
    return Size(1, count, count // 3 if mode == _TRIANGLES else 0)


def _shown(document: dict[str, Any], nodes: list[Any]) -> list[int]:
    """Return the nodes of the scene of a GLB file that is shown; a node with two parents is rejected."""
    scenes = document.get("scenes", [])
    found = list(scenes[document.get("scene", 0)].get("nodes", [])) if scenes else []
    for each in found:  # It grows meanwhile.
        found += nodes[each].get("children", [])
        if len(found) > len(nodes):
            break
    if len(set(found)) < len(found):
        raise InvalidRobot("a node is in two nodes, or twice in the scene, expected each once; copy the node")
    return found


def _require_its_shape(document: dict[str, Any]) -> None:
    """Refuse what trimesh passes over without a word though it changes the shape of a GLB file, or the place of a body."""
    for name in document.get("extensionsRequired", []):
        if not name.startswith(_ONLY_LOOKS):
            raise InvalidRobot(
                f"it requires the extension {name!r:.100}, expected none but those of materials, images and lights; "
                "write it without"
            )
    accessors = document.get("accessors", [])
    if any("sparse" in each for each in accessors):
        raise InvalidRobot("its accessors are sparse, expected all their values; write them as a whole")
    for mesh in document.get("meshes", []):
        for part in mesh["primitives"]:
            mode = part.get("mode", 4)
            if mode not in _MODES:
                raise InvalidRobot(
                    f"it has a body of mode {mode!r:.100}, expected "
                    + ", ".join(f"{code} ({name})" for code, name in _MODES.items())
                )
            if "POSITION" not in part["attributes"]:
                raise InvalidRobot("a body has no positions")
            if "indices" in part and (kind := accessors[part["indices"]]["componentType"]) not in _UNSIGNED:
                raise InvalidRobot(
                    f"its indices are of component type {kind!r:.100}, expected whole numbers from 0 on"
                )
            position = accessors[part["attributes"]["POSITION"]]
            got = position["type"], position["componentType"], position.get("normalized", False)
            if got != ("VEC3", _FLOAT, False):
                raise InvalidRobot(
                    "its positions are {}, component type {}, normalized {}; expected VEC3 of floats "
                    "({}), not normalized: write it without quantization".format(*got, _FLOAT)
                )
    for each in [*document.get("meshes", []), *document.get("nodes", [])]:
        if any(each.get("weights", [])):
            raise InvalidRobot(
                "its bodies are morphed by weights, expected their final shape; apply the weights"
            )
    for node in document.get("nodes", []):
        for name, size in _MOVES.items():
            numbers = node.get(name, [0] * size)
            if len(numbers) != size or not all(type(x) in (int, float) and isfinite(x) for x in numbers):
                raise InvalidRobot(f"a node has the {name} {numbers!r:.100}, expected {size} finite numbers")
        if "matrix" in node and (len(_MOVES.keys() & node) > 1 or node["matrix"][3::4] != [0, 0, 0, 1]):
            raise InvalidRobot(
                "a node has a matrix whose last row is not 0, 0, 0, 1, or a matrix and another motion; readers differ on "
                "both"
            )
        if abs(hypot(*node.get("rotation", [1.0])) - 1.0) > _UNIT:
            raise InvalidRobot(
                "a node has a rotation that is not a quaternion of length 1; readers differ on it"
            )
        if "skin" in node:
            raise InvalidRobot("a node has a skin, expected a shape without one; apply it, and take it out")
        if "EXT_mesh_gpu_instancing" in node.get("extensions", {}):
            raise InvalidRobot(
                "a node has instances (EXT_mesh_gpu_instancing), expected a node for each; write it without"
            )
        if "camera" in node and ("mesh" in node or "children" in node):
            raise InvalidRobot("a node is a camera with bodies or nodes below it; take the camera out")


def _content(text: bytes, place: int) -> memoryview:
    """Return the binary chunk, which is somewhere after the description."""
    found: memoryview | None = None
    while place + 8 <= len(text):
        size, kind = struct.unpack_from("<II", text, place)
        if kind == _BINARY:
            if found is not None:
                raise InvalidRobot(
                    "it has two binary chunks, expected one; readers differ on which one they use"
                )
            found = memoryview(text)[place + 8 : place + 8 + size]
        place += 8 + size
    return memoryview(b"") if found is None else found


def _pixels(content: memoryview, view: dict[str, Any]) -> int:
    """Return the number of pixels of an image."""
    start = view.get("byteOffset", 0)
    return pixels_of_image(bytes(content[start : start + view["byteLength"]]))


def _count(value: Any) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or value < 0:
        raise InvalidRobot(f"a count or an index is {value!r:.100}, expected a whole number from 0 on")
    return value
