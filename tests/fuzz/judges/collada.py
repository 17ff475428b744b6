"""A strict reader of the shapes of COLLADA.

Source: Barnes and Levy Finch, *COLLADA – Digital Asset Schema Release 1.4.1*, Khronos Group and Sony Computer Entertainment
(2008), chapter 5. The upward axis is ignored, as docs/collisions.md says.
"""

from __future__ import annotations

import math
import re
from itertools import pairwise
from typing import Any

import numpy as np
from lxml import etree

from .shapes import (
    NUMBER,
    UNIT,
    WHOLE,
    Array,
    Polygons,
    Unknown,
    fan,
    floats,
    integers,
    placed,
    strip,
    without_overflow,
)

BLANKS = " \t\r\n"
SPACES = ("http://www.collada.org/2005/11/COLLADASchema", "http://www.collada.org/2008/03/COLLADASchema")
LIBRARIES = tuple(
    f"library_{each}"
    for each in [
        "animations",
        "animation_clips",
        "cameras",
        "controllers",
        "geometries",
        "effects",
        "force_fields",
        "images",
        "lights",
        "materials",
        "nodes",
        "physics_materials",
        "physics_models",
        "physics_scenes",
        "visual_scenes",
    ]
)
MOTIONS = {"translate": 3, "rotate": 4, "scale": 3, "matrix": 16}
SURFACES = ("triangles", "tristrips", "trifans", "polylist", "polygons")
ARRAYS = ("IDREF_array", "Name_array", "bool_array", "float_array", "int_array")
DEEP = 120
"""Most nodes in nodes."""


def words(element: Any) -> list[str]:
    """The words of an element that has no others in it."""
    if len(element):
        raise Unknown(f"children of {kind_of(element)}")
    return [each for each in re.split(f"[{BLANKS}]+", element.text or "") if each]


def attribute(element: Any, name: str) -> str:
    """An attribute without the blanks around it; all that are asked for here have such a type."""
    return str(element.get(name, "")).strip(BLANKS)


def whole(element: Any, name: str, default: str = "") -> int:
    """An attribute that counts."""
    found = attribute(element, name) if name in element.attrib else default
    if not WHOLE.fullmatch(found) or int(found) < 0:
        raise Unknown(f"{name} of {kind_of(element)}")
    return int(found)


def kind_of(element: Any) -> str:
    """The name of an element without its namespace, for messages."""
    return str(element.tag).rpartition("}")[2]


class Reader:
    """One file."""

    def __init__(self, text: bytes) -> None:
        """Parse it, and find all names."""
        if b"<!DOCTYPE" in text:
            raise Unknown("document type")
        try:
            self.root = etree.fromstring(text, etree.XMLParser(remove_comments=True, remove_pis=True))
        except (etree.XMLSyntaxError, ValueError) as error:
            raise Unknown("no XML") from error
        self.space = etree.QName(self.root).namespace
        if self.space not in SPACES or self.kind(self.root) != "COLLADA":
            raise Unknown("root")
        self.named: dict[str, list[Any]] = {}
        for each in self.root.iter():
            self.named.setdefault(attribute(each, "id"), []).append(each)

    def kind(self, element: Any) -> str:
        """The name of an element of the namespace of the file."""
        name = etree.QName(element)
        if name.namespace != self.space:
            raise Unknown(f"namespace of {name.localname}")
        return str(name.localname)

    def children(self, element: Any, *known: str) -> list[tuple[str, Any]]:
        """All children, with their names, which are known."""
        found = [(self.kind(each), each) for each in element]
        for name, _ in found:
            if name not in (*known, "extra"):
                raise Unknown(f"{name} in {kind_of(element)}")
        return [(name, each) for name, each in found if name != "extra"]

    def some(self, element: Any, name: str, *others: str) -> list[Any]:
        """All children of this name."""
        return [each for kind, each in self.children(element, name, *others) if kind == name]

    def only(self, element: Any, name: str, *others: str) -> Any:
        """The only child of this name."""
        found = self.some(element, name, *others)
        if len(found) != 1:
            raise Unknown(f"{len(found)} {name} in {kind_of(element)}")
        return found[0]

    def target(self, element: Any, name: str, kind: str) -> Any:
        """What an attribute refers to."""
        url = attribute(element, name)
        found = self.named.get(url[1:], []) if len(url) > 1 and url[0] == "#" else []
        if len(found) != 1 or self.kind(found[0]) != kind:
            raise Unknown(f"reference to {kind}")
        if any(kind_of(each) in ("extra", "technique") for each in found[0].iterancestors()):
            raise Unknown("reference into an extension")
        return found[0]

    def metres(self) -> float:
        """The unit of the whole file [m]."""
        asset = self.only(self.root, "asset", "scene", *LIBRARIES)
        units = list[float]()
        for each in self.root.iter(f"{{{self.space}}}unit"):
            around = [kind_of(other) for other in each.iterancestors()]
            if around[0] != "asset" or {"extra", "technique"} & {*around}:
                continue
            word = attribute(each, "meter") if "meter" in each.attrib else "1"
            if not NUMBER.fullmatch(word) or not 0 < float(word) < math.inf:
                raise Unknown("unit")
            units.append(float(word))
        own = any(kind_of(each) == "unit" for each in asset)
        if len(set(units)) > 1 or (units and not own):
            raise Unknown("several units")
        return units[0] if units else 1.0

    def polygons(self) -> Polygons:
        """All of the scene that is shown."""
        metres = self.metres()
        scene = self.only(self.root, "scene", "asset", *LIBRARIES)
        instance = self.only(scene, "instance_visual_scene", "instance_physics_scene")
        found = Polygons()
        visual = self.target(instance, "url", "visual_scene")
        for node in self.some(visual, "node", "asset", "evaluate_scene"):
            found += self.bodies(node, 0)
        return [metres * each for each in found]

    def bodies(self, node: Any, depth: int) -> Polygons:
        """All of a node and of those below it, in the coordinates around it."""
        if depth > DEEP:
            raise Unknown("depth")
        found = Polygons()
        ignored = ("asset", "instance_camera", "instance_light")
        parts = self.children(node, "node", "instance_node", "instance_geometry", *MOTIONS, *ignored)
        for name, each in parts:
            if name == "node":
                found += self.bodies(each, depth + 1)
            elif name == "instance_node":
                self.children(each)
                found += self.bodies(self.target(each, "url", "node"), depth + 1)
            elif name == "instance_geometry":
                self.children(each, "bind_material")
                found += self.geometry(self.target(each, "url", "geometry"))
        if not found:  # Its motions move nothing.
            return found
        place = np.eye(4)
        for name, each in parts:
            if name in MOTIONS:
                place = place @ motion(name, floats(words(each)))
        stretched = np.linalg.det(place[:3, :3])
        if abs(stretched) <= 1e-14 * np.abs(place[:3, :3]).max() ** 3:
            raise Unknown("flat motion")
        # As in GLB: the outer side of a mirrored body stays the outer side.
        order = -1 if stretched < 0 else 1
        return [polygon[::order] @ place[:3, :3].T + place[:3, 3] for polygon in found]

    def source(self, source: Any) -> Array:
        """Rows of a source with X, Y and Z, (k, 3)."""
        around = ("asset", "technique", *ARRAYS)
        accessor = self.only(self.only(source, "technique_common", *around), "accessor")
        array = self.target(accessor, "source", "float_array")
        data = floats(words(array))
        if whole(array, "count") != len(data):
            raise Unknown("count of float_array")
        params = self.some(accessor, "param")
        named = [k for k, each in enumerate(params) if attribute(each, "name")]
        if [attribute(params[k], "name") for k in named] != ["X", "Y", "Z"]:
            raise Unknown("names of coordinates")
        stride, first = whole(accessor, "stride", "1"), whole(accessor, "offset", "0")
        count = whole(accessor, "count")
        if stride < len(params):
            raise Unknown("stride")
        if first + count * stride > len(data):
            raise Unknown("accessor beyond its array")
        return np.array([data[first + row * stride :][named] for row in range(count)]).reshape(-1, 3)

    def geometry(self, geometry: Any) -> Polygons:
        """All of a geometry."""
        mesh = self.only(geometry, "mesh", "asset")
        ignored = ("source", "lines", "linestrips")
        vertices = self.only(mesh, "vertices", *ignored, *SURFACES)
        places = [each for each in self.some(vertices, "input") if attribute(each, "semantic") == "POSITION"]
        if len(places) != 1:
            raise Unknown(f"{len(places)} POSITION")
        points, found = self.source(self.target(places[0], "source", "source")), list[list[int]]()
        for name, each in self.children(mesh, "vertices", *ignored, *SURFACES):
            if name in SURFACES:
                found += self.corners(name, each, vertices)
        return placed(points, found)

    def corners(self, name: str, part: Any, vertices: Any) -> list[list[int]]:
        """Indices of the polygons of a primitive."""
        vcount = ["vcount"] if name == "polylist" else []
        inputs = self.some(part, "input", "p", *vcount)
        width = max((whole(each, "offset") + 1 for each in inputs), default=1)
        at = [whole(each, "offset") for each in inputs if attribute(each, "semantic") == "VERTEX"]
        if len(at) != 1 or any(attribute(each, "semantic") == "POSITION" for each in inputs):
            raise Unknown("inputs of a primitive")
        for each in inputs:
            if (
                attribute(each, "semantic") == "VERTEX"
                and self.target(each, "source", "vertices") is not vertices
            ):
                raise Unknown("vertices of another mesh")
        lists = [integers(words(each)) for each in self.some(part, "p", "input", *vcount)]
        if any(len(each) % width for each in lists):
            raise Unknown("length of p")
        if any(min(each, default=0) < 0 for each in lists):
            raise Unknown("negative index")
        found = [each[at[0] :: width] for each in lists]
        if name in ("triangles", "polylist"):
            if len(found) > 1:
                raise Unknown("several lists")
            flat = found[0] if found else []
            if name == "triangles":
                sizes = [3] * -(-len(flat) // 3)
            else:
                told = self.some(part, "vcount", "input", "p")
                if len(told) > 1:
                    raise Unknown("several vcount")
                sizes = integers(words(told[0])) if told else []
            if sum(sizes) != len(flat) or min(sizes, default=0) < 0:
                raise Unknown("sizes of polygons")
            starts = np.cumsum([0, *sizes]).tolist()
            found = [flat[a:b] for a, b in pairwise(starts)]
        if whole(part, "count") != len(found):
            raise Unknown("count of a primitive")
        if name in ("tristrips", "trifans"):
            divide = strip if name == "tristrips" else fan
            return [triangle for each in found for triangle in divide(each)]
        return found


def motion(name: str, numbers: Array) -> Array:
    """The transform of an element of a node, (4, 4)."""
    if len(numbers) != MOTIONS[name] or not np.isfinite(numbers).all():
        raise Unknown(f"numbers of {name}")
    if name == "matrix":
        if numbers[12:].tolist() != [0, 0, 0, 1]:
            raise Unknown("last row")
        return numbers.reshape(4, 4)
    found = np.eye(4)
    if name == "translate":
        found[:3, 3] = numbers
    elif name == "scale":
        found[:3, :3] = np.diag(numbers)
    else:
        axis, angle = numbers[:3], math.radians(numbers[3])
        length = math.hypot(*axis)
        if abs(length - 1) > UNIT:
            raise Unknown("length of an axis")
        x, y, z = axis / length
        skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        found[:3, :3] = np.eye(3) + math.sin(angle) * skew + (1 - math.cos(angle)) * skew @ skew
    return found


def polygons(text: bytes) -> Polygons:
    """The polygons of a file."""
    return without_overflow(lambda: Reader(text).polygons())
