"""Limits for mesh files: which formats are read, and how large their unpacked content may be.

`stl`, `obj` and `ply` read their formats. trimesh reads the others, and trusts the sizes that a file declares. So this
module adds up the declared sizes before trimesh reads the file: a few bytes must not become gigabytes.
"""

from __future__ import annotations

import codecs
import io
import json
import re
import struct
import zipfile
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from itertools import chain
from math import hypot, prod
from pathlib import Path
from typing import Any, NamedTuple
from xml.parsers import expat

import numpy as np

from kinseek.errors import InvalidRobot
from kinseek.support.forks import importing
from kinseek.support.interrupts import raise_of_handler

from .collada import (
    count_words,
    name_of,
    require_geometry,
    require_node,
    require_numbers_alone,
    require_one_namespace,
    require_units,
    shared_numbers,
)
from .files import file_bytes
from .polygons import at_most

ENDINGS = ("dae", "glb", "obj", "ply", "stl")
"""Extensions of the formats that are read, without the dot."""
MOST_BODIES = 10_000
"""Most bodies of one file: each takes some kilobytes, however few triangles it has."""
MOST_GROUPS = 1_000
"""Most materials of OBJ, each of which is a body."""
LEAST_BODIES = 4
"""Least number of bodies that a file counts as, in the budget of a robot: reading a file takes as long as some eight
bodies."""
MOST_REPEATED = 2**26
"""Most bytes of files that are read again because a robot refers to them more than once."""
MOST_STEPS = 100_000
"""Most steps from the nodes of a file to its root, added up."""
MOST_NAMES = 1_000
"""Most references of a mesh to other files; two references to one file count twice."""
MOST_PIXELS = 2**26
"""Most pixels of all images of one file together."""
MOST_COPIED = 2**27
"""Most pixels of the images of all bodies together: each body has a copy of its images."""
MOST_LINE = 2**16
"""Most bytes of a line of OBJ and PLY: no polygon needs more."""
MOST_JSON = 2**22
"""Most bytes of the description at the beginning of a GLB file."""
MOST_LINES = 2**22
"""Most lines of OBJ and text PLY, and vertices with normals of text STL. An empty line takes as much memory as a full
one."""
MOST_HEADER = 1_000
"""Most lines in the header of PLY."""
MOST_PROPERTIES = 256
"""Most properties in the header of PLY."""
MOST_VALUES = 3 * 2**22
"""Most values of text PLY, rows times properties, and most numbers in its rows."""
MOST_CORNERS = 3 * 2**22
"""Most triangle corners of COLLADA and GLB, with each instance counted, and of all meshes of a robot. Larger meshes can be
read as binary STL or PLY."""
MOST_TAGS = 2**20
"""Most tags of COLLADA."""
MOST_COLUMNS = 4
"""Most columns of a COLLADA source: positions, normals, texture coordinates and colours have no more."""
MOST_SHARED = 2**27
"""Most bytes of a GLB file that bodies may share, and most numbers of COLLADA; each body has its own copy in memory, or goes
through all of them."""
MOST_INPUTS = 32
"""Most inputs of a primitive of COLLADA; for each of them all indices are read."""

_COMPONENT = {5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4}
"""Bytes of one number of a GLB accessor, by its component type."""
_NUMBERS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
"""Numbers in one item of it, by its name."""
_FLOAT = 5126
"""The code of numbers with a point, of which positions are."""
_MODES = {0: "points", 1: "lines", 4: "triangles", 5: "a strip of triangles"}
"""Of GLB bodies: trimesh passes over others, and over the place of a node that has no other body."""
_UNSIGNED = (5121, 5123, 5125)
"""Codes of numbers that may be indices."""
_MOVES = {"translation", "rotation", "scale"}
"""What moves a node that has no matrix."""
_UNIT = 1e-3
"""How much the length of a quaternion may differ from 1, for rounding."""
_STRIP = 5
"""Mode of a GLB primitive in which every corner but two begins a triangle."""
_BINARY = 0x004E4942
"""The kind of a GLB chunk with numbers and images."""
_ONLY_LOOKS = ("KHR_materials_", "KHR_texture_", "EXT_texture_", "KHR_lights_")
"""How the names of GLB extensions begin that do not change shapes."""
_IMAGES_OF = (
    "image",
    "baseColorTexture",
    "emissiveTexture",
    "metallicRoughnessTexture",
    "normalTexture",
    "occlusionTexture",
)
"""Attributes of a trimesh material that hold images."""
_IMAGES = ("BMP", "GIF", "JPEG", "PNG", "TIFF", "WEBP")
"""Image formats that are decoded: other formats start programs, or are not used for textures."""


def utf8(text: bytes) -> bytes:
    """Return UTF-8 without a byte order mark, which would hide the first keyword; convert anything else from Latin-1."""
    try:
        text.decode()
    except UnicodeDecodeError:
        return text.decode("latin-1").encode()
    return text.removeprefix(codecs.BOM_UTF8)


def ending(path: Path) -> str:
    """Return the extension of a mesh file, without the dot.

    Raises:
        InvalidRobot: The extension is not supported.
    """
    found = path.suffix[1:].lower()
    if found not in ENDINGS:
        *first, last = (f".{each}" for each in ENDINGS)
        raise InvalidRobot(
            f"{str(path)!r} is not read as a mesh: the name must end in {', '.join(first)} or {last}"
        )
    return found


class Size(NamedTuple):
    """Size of a file's unpacked content."""

    bodies: int
    corners: int
    """Corners of triangles; lines and values of text formats count as corners. Zero for binary STL and PLY, whose bytes
    count."""
    triangles: int = 0
    """Number of triangles that the reader has to return, each instance counted: those that are shown, polygons divided."""


@dataclass
class Budget:
    """Remaining budget of all meshes of one robot, or of one file of obstacles."""

    bytes_left: int
    """Bytes of files: meshes, materials and images."""
    pixels_left: int = MOST_COPIED
    """Pixels of the images of all bodies."""
    bodies_left: int = MOST_BODIES
    """Number of bodies; a file counts as at least `LEAST_BODIES`."""
    corners_left: int = MOST_CORNERS
    repeated_left: int = MOST_REPEATED
    """Bytes of files that were read before."""
    seen: set[Path] = field(default_factory=set)
    """Files that were read."""
    refused: dict[Path, str] = field(default_factory=dict)
    """Meshes that were rejected, with the reason; they are not read again."""

    def read(self, path: Path, most: int) -> bytes:
        """Read a file of at most `most` bytes.

        Raises:
            InvalidRobot: The file cannot be read or is too large, or the budget is exhausted.
        """
        if min(self.bytes_left, self.repeated_left) >= 0:
            text = file_bytes(path, most)
            self.bytes_left -= len(text)
            real = path.resolve()
            self.repeated_left -= len(text) if real in self.seen else 0
            self.seen.add(real)
        if min(self.bytes_left, self.repeated_left) < 0:
            raise InvalidRobot(
                f"{str(path)!r} is not read: the files before it and this one are too large together"
            )
        return text

    def take(self, size: Size) -> None:
        """Subtract the unpacked size of a file, before it is unpacked.

        Raises:
            InvalidRobot: The budget is exhausted.
        """
        self.bodies_left -= size.bodies
        self.corners_left -= size.corners
        if min(self.bodies_left, self.corners_left) < 0:
            raise InvalidRobot("the meshes before it and this one have too many bodies or triangles together")

    def take_images(self, bodies: Iterable[Any]) -> None:
        """Subtract the pixels of the images of bodies; an image counts for each body that has it.

        Raises:
            InvalidRobot: The images have too many pixels.
        """
        pixels = sum(_pixels_of(getattr(each, "visual", None)) for each in bodies)
        at_most(pixels, self.pixels_left, "pixels in the images of its bodies")
        self.pixels_left -= pixels


def _pixels_of(visual: Any) -> int:
    """Return the number of pixels of a body's images, without decoding them."""
    images = (getattr(getattr(visual, "material", None), name, None) for name in _IMAGES_OF)
    return sum(prod(image.size) for image in images if image is not None)


class Beside:
    """Files that a mesh refers to, materials and images: in its folder or below, with the size limit of a mesh together."""

    def __init__(self, path: Path, most: int, budget: Budget) -> None:
        """Search beside this file, with at most `most` bytes and the rest of the budget."""
        self.file_name, self._budget = path.name, budget
        self._folder, self._left, self._pixels, self._names = path.parent.resolve(), most, 0, 0

    def get(self, name: str) -> bytes:
        """Read one of the files.

        Raises:
            InvalidRobot: The file is elsewhere, is not a regular file, or is too large; or there were too many references
                before.
        """
        self._names += 1
        at_most(self._names, MOST_NAMES, "names of other files")
        named = name.strip().replace("\\", "/")
        places = [(self._folder / each).resolve() for each in (named, named.rpartition("/")[2])]
        found = next((each for each in places if each.is_relative_to(self._folder) and each.is_file()), None)
        if found is None:
            raise InvalidRobot(f"{name!r} is neither in {str(self._folder)!r} nor in a folder below")
        text = self._budget.read(found, self._left)
        self._left -= len(text)
        pixels = _pixels(text)
        self._pixels += pixels
        at_most(self._pixels, MOST_PIXELS, "pixels in its images")
        if pixels:
            return text
        text = utf8(text)
        at_most(len(text.splitlines()), MOST_LINES, "lines")
        at_most(text.lower().count(b"newmtl"), MOST_BODIES, "materials")
        return text

    __getitem__ = get


def _pixels(text: bytes) -> int:
    """Return the number of pixels of an image, without decoding it; 0 for anything else.

    Raises:
        InvalidRobot: The image cannot be read, or its format is not supported because its reader does more than decode.
    """
    try:
        with importing:
            from PIL import Image, UnidentifiedImageError
    except ImportError:  # Without Pillow, trimesh reads no images.
        return 0
    try:
        with Image.open(io.BytesIO(text)) as image:
            known, count = image.format, prod(image.size)
    except UnidentifiedImageError:
        return 0
    except Exception as error:  # The image is too large for Pillow, or broken.
        raise_of_handler(error)
        raise InvalidRobot(f"an image cannot be read: {error}") from None
    if known not in _IMAGES:
        raise InvalidRobot(f"an image is {known}, expected one of {', '.join(_IMAGES)}")
    return count


def _glb(text: bytes) -> Size:
    """Add up the sizes of accessors, views, primitives and nodes, each of which may be referred to many times."""
    size = struct.unpack_from("<I", text, 12)[0]
    at_most(size, MOST_JSON, "bytes of JSON")
    document: dict[str, Any] = json.loads(text[20 : 20 + size].decode())
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
    bodies, weights, corners, triangles = [], [], [], []
    for mesh in document.get("meshes", []):
        parts = mesh["primitives"]
        if any("KHR_draco_mesh_compression" in part.get("extensions", {}) for part in parts):
            raise InvalidRobot("its meshes are compressed (Draco); write them without compression")
        named = [*chain.from_iterable(part["attributes"].values() for part in parts)]
        named += [part["indices"] for part in parts if "indices" in part]
        bodies.append(len(parts))
        weights.append(sum(bytes_of[accessor] for accessor in named))
        each_of = [
            (3 if part.get("mode") == _STRIP else 1)
            * accessors[part.get("indices", part["attributes"].get("POSITION"))]["count"]
            for part in parts
        ]
        corners.append(sum(each_of))
        triangles.append(
            sum(
                accessors[part.get("indices", part["attributes"].get("POSITION"))]["count"] // 3
                if part.get("mode", 4) == 4
                else max(count // 3 - 2, 0)
                if part["mode"] == _STRIP
                else 0
                for part, count in zip(parts, each_of, strict=True)
            )
        )
    _require_its_shape(document)
    glossy = "KHR_materials_pbrSpecularGlossiness"
    if images and any(glossy in each.get("extensions", {}) for each in document.get("materials", [])):
        raise InvalidRobot(
            "trimesh computes new images for its glossy materials; write them as metallic ones"
        )
    nodes = document.get("nodes", [])
    at_most(len(nodes) + sum(bodies) + len(images), MOST_BODIES, "nodes, bodies and images")
    named_as_child = [child for node in nodes for child in node.get("children", [])]
    roots = [root for scene in document.get("scenes", []) for root in scene.get("nodes", [])]
    at_most(_steps(nodes, roots), MOST_STEPS, "steps from its nodes to the root")
    meshes = [nodes[each]["mesh"] for each in [*named_as_child, *roots] if "mesh" in nodes[each]]
    shown = sum(bodies[mesh] for mesh in meshes)
    at_most(shown, MOST_BODIES, "bodies")
    shared = max(sum(weights), sum(weights[mesh] for mesh in meshes))
    at_most(shared, max(2 * len(text), MOST_SHARED), "bytes in its bodies")
    drawn = _drawn(sum(corners[mesh] for mesh in meshes), text)
    pixels = 0
    for image in images:
        view = views[image["bufferView"]]
        start = view.get("byteOffset", 0)
        pixels += _pixels(_buffer(text, 20 + size)[start : start + view["byteLength"]])
    at_most(pixels, MOST_PIXELS, "pixels in its images")
    in_scene = _shown(document, nodes)
    return Size(
        max(len(nodes), sum(bodies), shown),
        max(sum(corners), drawn),
        sum(triangles[nodes[each]["mesh"]] for each in in_scene if "mesh" in nodes[each]),
    )


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
        if "matrix" in node and (not _MOVES.isdisjoint(node) or node["matrix"][3::4] != [0, 0, 0, 1]):
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


def _drawn(corners: int, text: bytes) -> int:
    """Count corners; those beyond three per byte of the file count four times, since only instances create so many."""
    counted = corners + 3 * max(0, corners - 3 * len(text))
    at_most(counted, MOST_CORNERS, "corners of triangles, with those of instances counted four times")
    return counted


def _steps(nodes: list[Any], roots: list[int]) -> int:
    """Return the sum of the depths of all nodes: trimesh walks from the root to each of them."""
    total, depth, level, seen = 0, 0, set(roots), set(roots)
    while level:
        total += depth * len(level)
        depth += 1
        level = {child for each in level for child in nodes[each].get("children", [])} - seen
        seen |= level
    return total


def _buffer(text: bytes, place: int) -> bytes:
    """Return the first binary chunk of a GLB file, from the end of its description on."""
    while place + 8 <= len(text):
        size, kind = struct.unpack_from("<II", text, place)
        if kind == _BINARY:
            return text[place + 8 : place + 8 + size]
        place += 8 + size
    return b""


def _count(value: Any) -> int:
    if not isinstance(value, int) or value < 0:
        raise InvalidRobot(f"a count is {value!r}, expected a whole number from 0 on")
    return value


def _dae(text: bytes) -> Size:
    """Add up the sizes of geometries, which nodes may instantiate many times, and which may be instantiated themselves."""
    if zipfile.is_zipfile(io.BytesIO(text)):
        raise InvalidRobot("it is an archive; unpack it")
    _require_no_doctype(text)
    at_most(text.count(b"<"), MOST_TAGS, "tags")
    from lxml import etree

    root = etree.fromstring(text, etree.XMLParser(huge_tree=True, no_network=True))
    require_one_namespace(root)
    require_numbers_alone(root)
    etree.strip_tags(root, etree.Comment, etree.ProcessingInstruction)
    for each in root.iter("{*}vcount"):
        if re.fullmatch(r"[0-9 \t\r\n]*", each.text or "") is None:
            raise InvalidRobot("the numbers of corners of polygons are not whole numbers")
        if count_words(each.text):
            corners = float(np.fromstring(each.text, sep=" ").sum())
            at_most(int(min(corners, 2.0**62)), MOST_CORNERS, "corners of polygons")
    columns = max((len(each.findall("{*}param")) for each in root.iter("{*}accessor")), default=0)
    at_most(columns, MOST_COLUMNS, "columns in a source")
    named = [f"{{*}}{each}" for each in ("node", "geometry", "material", "effect", "image")]
    at_most(sum(1 for _ in root.iter(*named)), MOST_BODIES, "nodes, geometries, materials and images")
    require_units(root)
    inputs = max((len(each.findall("{*}input")) for each in root.iterfind(".//{*}mesh/*")), default=0)
    at_most(inputs, MOST_INPUTS, "inputs of one of its bodies")
    at_most(sum(map(shared_numbers, root.iter("{*}mesh"))), MOST_SHARED, "numbers that its bodies share")
    bodies, corners, triangles = _unfolded(root)
    at_most(bodies, MOST_BODIES, "nodes and bodies")
    return Size(bodies, _drawn(corners, text), triangles)


def _unfolded(root: Any) -> tuple[int, int, int]:
    """Check and count what the scenes of COLLADA show, with every instance counted.

    Returns:
        Number of nodes with bodies, and of triangle corners, of all scenes; and of triangles in the scene that is shown.
    """
    geometries: dict[str | None, list[Any]] = {}
    nodes: dict[str | None, list[Any]] = {}
    for each in root.iter("{*}geometry"):
        geometries.setdefault(each.get("id"), []).append(each)
    for each in root.iter("{*}node"):
        nodes.setdefault(each.get("id"), []).append(each)
    known: dict[Any, tuple[int, int, int] | None] = {}

    def size(element: Any) -> tuple[int, int, int]:
        if element not in known:
            known[element] = None
            known[element] = measured(element)
        found = known[element]
        if found is None:
            raise InvalidRobot("a node is an instance of itself")
        return found

    def measured(element: Any) -> tuple[int, int, int]:
        if name_of(element) == "geometry":
            corners = sum(count_words(each.text) for each in element.iter("{*}p"))
            return len(element.findall("{*}mesh/*")), corners, require_geometry(element)
        require_node(element)
        sizes = [(1, 0, 0)]
        for each in element:
            if name_of(each) == "node":
                sizes.append(size(each))
            elif name_of(each) in ("instance_node", "instance_geometry"):
                among = nodes if name_of(each) == "instance_node" else geometries
                sizes.append(size(_instance_of(each, among)))
        return added(sizes)

    def added(sizes: list[tuple[int, int, int]]) -> tuple[int, int, int]:
        return sum(each[0] for each in sizes), sum(each[1] for each in sizes), sum(each[2] for each in sizes)

    found = root.find("{*}scene/{*}instance_visual_scene")
    url = None if found is None else found.get("url")
    scenes = root.findall(".//{*}visual_scene")
    shown = [scene for scene in scenes if f"#{scene.get('id')}" == url]
    if len(shown) != 1:
        raise InvalidRobot(f"it shows the scene {url!r:.100}, expected one of its own")
    try:
        bodies, corners, _ = added([size(node) for scene in scenes for node in scene.iterfind("{*}node")])
        return bodies, corners, added([size(node) for node in shown[0].iterfind("{*}node")])[2]
    except RecursionError:
        raise InvalidRobot("its nodes are nested too deep") from None


def _instance_of(element: Any, among: dict[str | None, list[Any]]) -> Any:
    """Return what an element of COLLADA is an instance of."""
    url = element.get("url") or ""
    found = among.get(url[1:], []) if url.startswith("#") else []
    if len(found) != 1:
        raise InvalidRobot(
            f"it has an <{name_of(element)}> of {url!r:.100}, of which it has {len(found)}; expected 1, in the file itself"
        )
    return found[0]


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


CHECKS: Mapping[str, Callable[[bytes], Size]] = {
    "dae": _dae,
    "glb": _glb,
}
"""Checks of the formats that other libraries read, by extension."""
