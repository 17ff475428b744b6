"""A strict reader of the shapes of GLB.

Source: *glTF 2.0 Specification*, Khronos Group (2021), chapters 3 and 4.
"""

from __future__ import annotations

import json
import math
import struct
from typing import Any

import numpy as np

from .shapes import UNIT, Array, Polygons, Unknown, fan, placed, strip, without_overflow

FORMS = {5121: "<u1", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
LOOKS = ("KHR_materials_", "KHR_texture_", "KHR_lights_", "EXT_texture_")
"""How the names of extensions begin that change no shape."""


def chunks(text: bytes) -> tuple[bytes, bytes]:
    """JSON and bytes of a file."""
    if len(text) < 20 or struct.unpack_from("<4sII", text) != (b"glTF", 2, len(text)):
        raise Unknown("header")
    found, at = list[tuple[bytes, bytes]](), 12
    while at < len(text):
        if at + 8 > len(text):
            raise Unknown("half a chunk")
        length, kind = struct.unpack_from("<I4s", text, at)
        if at + 8 + length > len(text):
            raise Unknown("chunk beyond the file")
        found.append((kind, text[at + 8 : at + 8 + length]))
        at += 8 + length
    kinds = [kind for kind, _ in found]
    if kinds[0] != b"JSON" or kinds.count(b"JSON") > 1 or kinds.count(b"BIN\0") > 1:
        raise Unknown("chunks")
    if b"BIN\0" in kinds[2:]:
        raise Unknown("place of the bytes")
    return found[0][1], found[1][1] if kinds[1:2] == [b"BIN\0"] else b""


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    if len({name for name, _ in pairs}) != len(pairs):
        raise Unknown("a name twice")
    return dict(pairs)


def _constant(_: str) -> None:
    raise Unknown("constant")


def whole(value: object, below: float = math.inf) -> int:
    """A count or an index."""
    if type(value) is not int or not 0 <= value < below:
        raise Unknown("index")
    return value


def numbers(value: object, count: int) -> Array:
    """A list of numbers."""
    if (
        type(value) is not list
        or len(value) != count
        or any(type(each) not in (int, float) for each in value)
    ):
        raise Unknown("list of numbers")
    try:
        found = np.array(value, float)
    except OverflowError as error:
        raise Unknown("number out of range") from error
    if not np.isfinite(found).all():
        raise Unknown("not finite")
    return found


class Reader:
    """One file."""

    def __init__(self, text: bytes) -> None:
        """Parse it."""
        told, self.bytes = chunks(text)
        try:
            self.tree = json.loads(told.decode("utf-8"), object_pairs_hook=_object, parse_constant=_constant)
        except (ValueError, RecursionError) as error:
            raise Unknown("no JSON") from error
        if type(self.tree) is not dict:
            raise Unknown("no object")
        asset = self.tree.get("asset")
        if (
            type(asset) is not dict
            or asset.get("version") != "2.0"
            or asset.get("minVersion", "2.0") != "2.0"
        ):
            raise Unknown("version")
        for each in self.all("extensionsRequired"):
            if type(each) is not str or not each.startswith(LOOKS):
                raise Unknown("extension that is required")

    def all(self, name: str) -> list[Any]:
        """A list at the top."""
        found = self.tree.get(name, [])
        if type(found) is not list:
            raise Unknown(name)
        return found

    def one(self, name: str, index: object) -> dict[str, Any]:
        """An object of such a list; those that nothing refers to may be anything."""
        found = self.all(name)[whole(index, len(self.all(name)))]
        if type(found) is not dict:
            raise Unknown(name)
        return found

    def accessor(self, index: object, kind: str, forms: tuple[int, ...]) -> Array:
        """The rows of an accessor."""
        found = self.one("accessors", index)
        form, count = found.get("componentType"), whole(found.get("count"))
        if found.get("type") != kind or type(form) is not int or form not in forms:
            raise Unknown("type of an accessor")
        if "sparse" in found or found.get("normalized", False) is not False:
            raise Unknown("sparse or normalized")
        wide = 3 if kind == "VEC3" else 1
        size = wide * np.dtype(FORMS[form]).itemsize
        first = whole(found.get("byteOffset", 0))
        if "bufferView" not in found:
            raise Unknown("accessor without view")
        view = self.one("bufferViews", found["bufferView"])
        buffer = self.one("buffers", view.get("buffer"))
        if view["buffer"] or "uri" in buffer:
            raise Unknown("other buffer")
        begin, length = whole(view.get("byteOffset", 0)), whole(view.get("byteLength"))
        stride = whole(view.get("byteStride", size))
        if stride < size or (kind == "SCALAR" and "byteStride" in view):
            raise Unknown("stride")
        held = whole(buffer.get("byteLength"))
        if held > len(self.bytes) or begin + length > held:
            raise Unknown("view beyond its buffer")
        if count < 1 or first + (count - 1) * stride + size > length:
            raise Unknown("accessor beyond its view")
        rows = [begin + first + k * stride for k in range(count)]
        return np.array([np.frombuffer(self.bytes, FORMS[form], wide, each) for each in rows], float)

    def mesh(self, mesh: dict[str, Any]) -> Polygons:
        """All triangles of a mesh."""
        found, parts = Polygons(), mesh.get("primitives")
        if type(parts) is not list or not parts or mesh.get("weights"):
            raise Unknown("primitives")
        for part in parts:
            if type(part) is not dict or type(part.get("attributes")) is not dict:
                raise Unknown("primitive")
            mode = whole(part.get("mode", 4), 7)
            if mode < 4:
                continue
            points = self.accessor(part["attributes"].get("POSITION"), "VEC3", (5126,))
            corners = list(range(len(points)))
            if "indices" in part:
                indices = self.accessor(part["indices"], "SCALAR", (5121, 5123, 5125))
                corners = indices[:, 0].astype(int).tolist()
            if len(corners) < 3 or (mode == 4 and len(corners) % 3):
                raise Unknown("number of corners")
            if mode == 4:
                triangles = [corners[k : k + 3] for k in range(0, len(corners), 3)]
            else:
                triangles = strip(corners) if mode == 5 else fan(corners)
            found += placed(points, triangles)
        return found

    def polygons(self) -> Polygons:
        """All of the scene that is shown."""
        scenes, nodes = self.all("scenes"), self.all("nodes")
        if "scene" not in self.tree and (not scenes or scenes != scenes[:1] * len(scenes)):
            raise Unknown("no scene is chosen")
        scene = self.one("scenes", self.tree.get("scene", 0))
        parents = [0] * len(nodes)
        for node in nodes:
            children = node.get("children") if type(node) is dict else ()
            for child in children if type(children) is list else ():
                if type(child) is int and 0 <= child < len(
                    nodes
                ):  # Those of nodes that are shown are checked below.
                    parents[child] += 1
        if max(parents, default=0) > 1:
            raise Unknown("two parents")
        roots = self.indices(scene, "nodes")
        if any(parents[root] for root in roots) or len(set(roots)) != len(roots):
            raise Unknown("roots of a scene")
        found = Polygons()
        waiting = [(root, np.eye(4)) for root in roots]
        while waiting:
            index, place = waiting.pop()
            node = self.one("nodes", index)
            place = place @ motion(node)
            waiting += [(child, place) for child in self.indices(node, "children")]
            if "mesh" in node:
                extensions = node.get("extensions", {})
                if (
                    "skin" in node
                    or node.get("weights")
                    or type(extensions) is not dict
                    or "EXT_mesh_gpu_instancing" in extensions
                ):
                    raise Unknown("skin or instances")
                stretched = np.linalg.det(place[:3, :3])
                if abs(stretched) <= 1e-14 * np.abs(place[:3, :3]).max(initial=0) ** 3:
                    raise Unknown("flat motion")
                mirrored = stretched < 0
                for each in self.mesh(self.one("meshes", node["mesh"])):
                    moved = each @ place[:3, :3].T + place[:3, 3]
                    found.append(moved[::-1] if mirrored else moved)
        return found

    def indices(self, object_: dict[str, Any], name: str) -> list[int]:
        """A list of indices of nodes."""
        found = object_.get(name, [])
        if type(found) is not list:
            raise Unknown(name)
        return [whole(each, len(self.all("nodes"))) for each in found]


def motion(node: dict[str, Any]) -> Array:
    """The transform of a node, (4, 4)."""
    parts = {"translation", "rotation", "scale"} & {*node}
    if "matrix" in node:
        found = numbers(node["matrix"], 16).reshape(4, 4).T
        if parts or found[3].tolist() != [0, 0, 0, 1]:
            raise Unknown("matrix")
        return found
    x, y, z, w = numbers(node.get("rotation", [0, 0, 0, 1]), 4)
    length = math.hypot(x, y, z, w)
    if abs(length - 1) > UNIT:
        raise Unknown("quaternion")
    x, y, z, w = (each / length for each in (x, y, z, w))
    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    turn = np.eye(3) + 2 * w * skew + 2 * skew @ skew
    found = np.eye(4)
    found[:3, :3] = turn * numbers(node.get("scale", [1, 1, 1]), 3)
    found[:3, 3] = numbers(node.get("translation", [0, 0, 0]), 3)
    return found


def polygons(text: bytes) -> Polygons:
    """The triangles of a file."""
    return without_overflow(lambda: Reader(text).polygons())
