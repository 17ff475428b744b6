"""COLLADA files: the scene that a file shows; `collada` reads its geometries, and `collada_looks` its materials.

Source: Barnes and Levy Finch, *COLLADA – Digital Asset Schema Release 1.4.1*, Khronos Group (2008), chapter 5.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any, NamedTuple
from xml.parsers import expat

import numpy as np

from kinseek.errors import InvalidRobot
from kinseek.robots.xml_files import ENCODINGS
from kinseek.support.transforms import rotation

from .collada_geometry import TRIANGLES, bodies_of, children_of, corners_of, name_of, numbers_of, only
from .collada_looks import looks_of
from .limits import MOST_BODIES, Size, at_most, drawn_corners
from .polygons import Array, Body, Looks, placed
from .stl import NUMBER

_NAMESPACES = (
    "http://www.collada.org/2005/11/COLLADASchema",
    "http://www.collada.org/2008/03/COLLADASchema",
)
"""Of the versions 1.4 and 1.5."""
MOST_TAGS = 2**20
"""Most tags of a file."""
MOST_DEPTH = 100
"""Most nodes around a node."""

_MOTIONS = {"translate": 3, "rotate": 4, "scale": 3, "matrix": 16}
"""Elements that move a node, and how many numbers each has."""
_SHAPES = ("node", "instance_node", "instance_geometry")
_IN_NODES = (*_MOTIONS, *_SHAPES, "instance_camera", "instance_light", "asset", "extra")
"""Elements of nodes that are read, or that have no shape."""
_PATHS = re.compile(
    "COLLADA/(library_geometries/geometry|library_nodes(/node)+|library_visual_scenes/visual_scene(/node)*)"
)
"""Where elements are of which others are instances."""
_UNIT = 1e-4
"""How much the length of an axis may differ from 1, for rounding."""


def read(text: bytes, take: Callable[[Size], None], looks: bool) -> tuple[list[Body], Looks]:
    """Read the bodies of the scene that a file shows, in metres. Its upward axis is ignored, as by RViz and MoveIt.

    Args:
        text: The file.
        take: Takes the size of the bodies before they are read.
        looks: Read their looks, too?

    Raises:
        InvalidRobot: A part of the scene cannot be read, readers differ on it, or it is too large.
    """
    root = _root(text)
    scene = _Scene(_named(root))
    with np.errstate(over="ignore", invalid="ignore"):  # Who reads the file rejects what is not finite then.
        scene.add_all(root, np.diag([*[_unit(root)] * 3, 1.0]))
    at_most(scene.bodies, MOST_BODIES, "nodes and bodies")
    corners_by_geometry = {
        each: corners_of(each) for each in dict.fromkeys(each.geometry for each in scene.shown)
    }
    corners = drawn_corners(sum(corners_by_geometry[each.geometry] for each in scene.shown), text)
    take(Size(scene.bodies, corners))
    known = {each: bodies_of(each, scene.named, looks, take) for each in corners_by_geometry}
    bodies = [
        placed(body, each.matrix)._replace(material=each.materials.get(body.material, body.material))
        for each in scene.shown
        for body in known[each.geometry]
    ]
    return bodies, looks_of({body.material for body in bodies}, scene.named) if looks else {}


class _Shown(NamedTuple):
    """An instance of a geometry."""

    geometry: Any
    matrix: Array
    """Its place, (4, 4) [m]."""
    materials: dict[str, str]
    """Ids of materials, by the symbols that its primitives name."""


class _Node(NamedTuple):
    """What a node of the file says."""

    matrix: Array
    """Its place in what it is in, (4, 4)."""
    shapes: list[tuple[Any, dict[str, str]]]
    """Nodes and geometries in it, and the materials that it binds for a geometry."""


class _Scene:
    """The instances of geometries that a file shows."""

    def __init__(self, named: dict[str, list[Any]]) -> None:
        """Begin with none.

        Args:
            named: All elements by their ids.
        """
        self.named, self.shown = named, list[_Shown]()
        self.bodies = 0
        """Number of nodes and of parts of geometries, each counted as often as it is shown."""
        self._nodes = dict[Any, _Node]()
        self._sizes = dict[Any, int]()

    def add_all(self, root: Any, matrix: Array) -> None:
        """Add what the file shows, moved by a matrix."""
        who = "its <scene>"
        kinds = ("instance_visual_scene", "instance_physics_scene", "instance_kinematics_scene", "extra")
        instance = only(children_of(_only_child(root, "scene"), kinds, who), "instance_visual_scene", who)
        scene = self._target(instance, "visual_scene")
        # Some readers read it as a node, with motions and bodies of its own.
        for node in children_of(scene, ("node", "asset", "evaluate_scene", "extra"), "its <visual_scene>")[
            "node"
        ]:
            self._add(node, matrix, ())

    def _add(self, node: Any, matrix: Array, above: tuple[Any, ...]) -> None:
        """Add what a node shows, which is in other nodes that have a place together."""
        if node in above:
            raise InvalidRobot("a node is an instance of itself")
        at_most(len(above), MOST_DEPTH, "nodes in each other")
        self._count(1)
        if node not in self._nodes:  # It is read once, however many instances there are.
            self._nodes[node] = self._node(node)
        matrix = matrix @ self._nodes[node].matrix
        for each, materials in self._nodes[node].shapes:
            if name_of(each) == "node":
                self._add(each, matrix, (*above, node))
            else:
                self._count(max(1, self._size(each)))
                self.shown.append(_Shown(each, matrix, materials))

    def _node(self, node: Any) -> _Node:
        """Read a node, without what is in it."""
        who = f"the node {node.get('id') or node.get('name')!r:.100}"
        children_of(node, _IN_NODES, who)
        children = [(name_of(each), each) for each in node.iterchildren("*")]
        has_shape = any(name in _SHAPES for name, _ in children)
        matrix, shapes = np.eye(4), list[tuple[Any, dict[str, str]]]()
        for name, each in children:
            if name in _MOTIONS and has_shape:  # Lights and cameras often have odd motions.
                matrix = matrix @ _motion(name, numbers_of(each, who), who)
            elif name == "node":
                shapes.append((each, {}))
            elif name == "instance_node":
                children_of(each, ("extra",), f"{who}, in <instance_node>,")
                shapes.append((self._target(each, "node"), {}))
            elif name == "instance_geometry":
                shapes.append((self._target(each, "geometry"), _bound(each, who)))
        return _Node(matrix, shapes)

    def _size(self, geometry: Any) -> int:
        """Return the number of parts of a geometry."""
        if geometry not in self._sizes:
            self._sizes[geometry] = len(geometry.findall("{*}mesh/*"))
        return self._sizes[geometry]

    def _count(self, bodies: int) -> None:
        self.bodies += bodies
        at_most(self.bodies, MOST_BODIES, "nodes and bodies")

    def _target(self, element: Any, kind: str) -> Any:
        """Return what an element is an instance of."""
        url = element.get("url", "")
        found = self.named.get(url[1:], []) if url.startswith("#") else []
        if len(found) != 1 or name_of(found[0]) != kind:
            got = ", ".join(f"<{name_of(each)}>" for each in found) or "nothing"
            raise InvalidRobot(
                f"it has an <{name_of(element)}> of {url!r:.100}, which names {got:.200}; expected one <{kind}> of the file"
            )
        path = "/".join(map(name_of, [*reversed([*found[0].iterancestors()]), found[0]]))
        if _PATHS.fullmatch(path) is None:
            raise InvalidRobot(
                f"it has an <{name_of(element)}> of what is at {path:.200}, expected it in its library"
            )
        return found[0]


def _motion(name: str, numbers: Array, who: str) -> Array:
    """Return the matrix of an element that moves a node, (4, 4)."""
    if len(numbers) != _MOTIONS[name]:
        raise InvalidRobot(f"{who} has a <{name}> of {len(numbers)} numbers, expected {_MOTIONS[name]}")
    matrix = np.eye(4)
    if name == "matrix":
        matrix = numbers.reshape(4, 4)
        if matrix[3].tolist() != [0, 0, 0, 1]:
            raise InvalidRobot(
                f"{who} has a <matrix> whose last row is {matrix[3].tolist()}, expected 0, 0, 0, 1"
            )
    elif name == "translate":
        matrix[:3, 3] = numbers
    elif name == "scale":
        matrix[:3, :3] = np.diag(numbers)
    elif numbers[3]:
        length = np.linalg.norm(numbers[:3])
        if abs(length - 1) > _UNIT:  # Some readers stretch the body then.
            raise InvalidRobot(
                f"{who} has a <rotate> about {numbers[:3].tolist()}, expected an axis of length 1"
            )
        matrix[:3, :3] = rotation(numbers[:3] / length, np.radians(numbers[3]))
    return matrix


def _bound(instance: Any, who: str) -> dict[str, str]:
    """Return the ids of materials that an instance binds to symbols."""
    children_of(instance, ("bind_material", "extra"), f"{who}, in <instance_geometry>,")
    found = instance.iterfind("{*}bind_material/{*}technique_common/{*}instance_material")
    return {each.get("symbol", ""): each.get("target", "").removeprefix("#") for each in found}


def _root(text: bytes) -> Any:
    """Parse the XML."""
    _require_no_doctype(text)
    at_most(text.count(b"<"), MOST_TAGS, "tags")
    from lxml import etree

    root = etree.fromstring(text, etree.XMLParser(huge_tree=True, no_network=True))
    encoding = root.getroottree().docinfo.encoding or "UTF-8"
    if ENCODINGS.fullmatch(encoding) is None:
        raise InvalidRobot(f"the encoding {encoding!r:.100} is not read; write the file in UTF-8")
    if root.tag not in [f"{{{each}}}COLLADA" for each in _NAMESPACES]:
        raise InvalidRobot(
            f"it begins with {root.tag!r:.200}, expected <COLLADA> of {_NAMESPACES[0]} (or of version 1.5)"
        )
    for each in root.iterchildren("*"):
        if not re.fullmatch("asset|scene|extra|library_.*", name := name_of(each)):
            raise InvalidRobot(
                f"it has <{name}> beside its libraries, expected only <asset>, <scene>, <extra> and those"
            )
    return root


def _named(root: Any) -> dict[str, list[Any]]:
    """Return all elements with ids, by their ids.

    Raises:
        InvalidRobot: Readers differ on an element: it is outside of extensions and has another namespace or prefix than the
            root, or it is a shape in an extension.
    """
    own, left = root.tag.rpartition("}")[0], [root]
    shapes = {f"{own}}}{name}" for name in (*TRIANGLES, *_SHAPES)}
    found: dict[str, list[Any]] = {}
    while left:
        each = left.pop()
        if each.tag.rpartition("}")[0] != own or each.prefix != root.prefix:
            raise InvalidRobot(f"it has a <{name_of(each)}> of another namespace or prefix than its root")
        is_extension = name_of(each) in ("extra", "technique")
        for inner in (
            each.iter("*") if is_extension else (each,)
        ):  # Some readers find what is in extensions, too.
            found.setdefault(inner.get("id", ""), []).append(inner)
            if is_extension and inner.tag in shapes:
                raise InvalidRobot(f"it has a <{name_of(inner)}> in an extension, which some readers show")
        if not is_extension:
            left.extend(each.iterchildren("*"))
    found.pop("", None)
    return found


def _only_child(root: Any, name: str) -> Any:
    found = root.findall(f"{{*}}{name}")
    if len(found) != 1:
        raise InvalidRobot(f"it has {len(found)} <{name}> elements, expected one")
    return found[0]


def _unit(root: Any) -> float:
    """Return the unit of the file [m].

    Raises:
        InvalidRobot: It is not a number above 0, or a part of the file has another one.
    """
    words = [
        each.get("meter", "1").strip(" \t\r\n") for each in _only_child(root, "asset").iterfind("{*}unit")
    ]
    word = words[0] if words else "1"
    whole = float(word) if re.fullmatch(NUMBER, word.encode()) else 0.0
    if not 0 < whole < np.inf:
        raise InvalidRobot(f"its unit is {word!r:.100}, expected a number of metres above 0")
    for each in root.iter("{*}unit"):
        if (other := each.get("meter", "1").strip(" \t\r\n")) != word:
            raise InvalidRobot(
                f"a part of it has a unit of {other!r:.100} m, expected {word:.100} m as in the whole file"
            )
    return whole


class _Begun(Exception):
    """Raised at the first element."""


def _require_no_doctype(text: bytes) -> None:
    """Reject a document type: it may define entities that consist of entities, or of other files."""

    def refuse(*_: Any) -> None:
        raise InvalidRobot(
            "it has a document type (<!DOCTYPE …>), which COLLADA files do not need; take it out"
        )

    def stop(*_: Any) -> None:
        raise _Begun

    parser = expat.ParserCreate()
    parser.StartDoctypeDeclHandler, parser.StartElementHandler = refuse, stop
    try:
        parser.Parse(text, True)
    except _Begun:
        return
