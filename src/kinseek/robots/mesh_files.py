"""Limits for mesh files: which formats are read, and how large their unpacked content may be.

trimesh chooses a reader by the extension of a file, archives among them, and trusts the sizes that a file declares. So this
module lists the extensions, and adds up the declared sizes before trimesh reads the file: a few bytes must not become
gigabytes.
"""

from __future__ import annotations

import codecs
import io
import json
import re
import struct
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import chain
from math import prod
from pathlib import Path
from typing import Any, NamedTuple
from xml.parsers import expat

import numpy as np

from kinseek.errors import InvalidRobot
from kinseek.forks import importing
from kinseek.interrupts import raise_of_handler

from .collada import (
    count_words,
    name_of,
    require_geometry,
    require_node,
    require_numbers_alone,
    require_units,
)
from .files import file_bytes

MOST_BODIES = 10_000
"""Most bodies of one file: each takes some kilobytes, however few triangles it has."""
MOST_GROUPS = 1_000
"""Most solids of text STL and materials of OBJ: trimesh counts up from 1 to find a free name for each."""
LEAST_BODIES = 4
"""Least number of bodies that a file counts as, in the budget of a robot: reading a file takes as long as some eight
bodies."""
MOST_REPEATED = 2**26
"""Most bytes of files that are read again because a robot refers to them more than once."""
MOST_STEPS = 100_000
"""Most steps from the nodes of a file to its root, added up."""
MOST_MASKED = 2**30
"""Largest product of lines and materials of OBJ: each body has a mask over all vertices."""
MOST_NAMES = 1_000
"""Most references of a mesh to other files; two references to one file count twice."""
MOST_PIXELS = 2**26
"""Most pixels of all images of one file together."""
MOST_COPIED = 2**27
"""Most pixels of the images of all bodies together: each body has a copy of its images."""
MOST_LINE = 2**16
"""Most bytes of a line of OBJ: no valid polygon needs more."""
MOST_JSON = 2**22
"""Most bytes of the description at the beginning of a GLB file."""
MOST_LINES = 2**22
"""Most lines of OBJ and text PLY, and vertices with normals of text STL. An empty line takes as much memory as a full one,
up to 400 bytes."""
MOST_HEADER = 1_000
"""Most lines in the header of PLY."""
MOST_PROPERTIES = 256
"""Most properties in the header of PLY: 1,000 lists take trimesh ten seconds, whatever they contain."""
MOST_VALUES = 3 * 2**22
"""Most values of text PLY, rows times properties: trimesh may create an array of some 130 bytes for each."""
MOST_CORNERS = 3 * 2**22
"""Most triangle corners of COLLADA and GLB, with each instance counted, and of all meshes of a robot. Larger meshes can be
read as binary STL or PLY."""
MOST_TAGS = 2**20
"""Most tags of COLLADA."""
MOST_COLUMNS = 4
"""Most columns of a COLLADA source: positions, normals, texture coordinates and colours have no more."""
MOST_SHARED = 2**27
"""Most bytes of a GLB file that bodies may share; each body has its own copy in memory."""

_LINE_ENDS = (
    *(bytes([each]) for each in b"\n\r\v\f\x1c\x1d\x1e"),
    b"\xc2\x85",
    b"\xe2\x80\xa8",
    b"\xe2\x80\xa9",
)
"""Line ends of `str.splitlines`, in UTF-8."""
_LINE_START = re.compile(rb"^[ \t]*(vt|vn|v|f|usemtl)[ \t]+", re.MULTILINE)
"""Beginning of a line of OBJ that is read, with its keyword."""
_FACE = re.compile(rb"^f [^\n]*", re.MULTILINE)
"""A face of OBJ."""
_NO_FACE = re.compile(rb"^f(?:[ \t]+[^ \t\n]+){0,2}[ \t]*$", re.MULTILINE)
"""A face of OBJ with fewer than three corners."""
_NO_TRIANGLES = re.compile(rb"^[ \t]*(surf|call|fo|bzp|cdp|bsp)[ \t]", re.MULTILINE)
"""A line of OBJ that is a surface of another kind, or that includes another file."""
_BREAK = re.compile(rb"[\0\v\f]")
"""A character of OBJ that ends a line for some readers and not for trimesh, which would skip a vertex after it."""
_FACET = re.compile(rb"^[ \t]*facet\b", re.MULTILINE)
"""Beginning of a triangle of text STL, in lower case."""
_NO_INDEX = re.compile(rb"^f[^\n]*?[ \t/](-[0-9]*|0+|(?<=[ \t])/[^ \t\n]*)(?=[ \t\r\n/]|\Z)", re.MULTILINE)
"""A face of OBJ with an index that does not count from 1 on, or a corner without one, up to that."""
_COMPONENT = {5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4}
"""Bytes of one number of a GLB accessor, by its component type."""
_NUMBERS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
"""Numbers in one item of it, by its name."""
_FLOAT = 5126
"""The code of numbers with a point, of which positions are."""
_PLY_TYPES = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
    **{"int64": "i8", "uint64": "u8", "float16": "f2"},
}
"""Types of numbers in PLY."""
_MODES = {0: "points", 1: "lines", 4: "triangles", 5: "a strip of triangles"}
"""Of GLB bodies: trimesh passes over others, and over the place of a node that has no other body."""
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


def require_mesh(path: Path, text: bytes) -> Size:
    """Check that a file is a mesh, and that its unpacked content is not much larger than the file.

    Returns:
        Size of the unpacked content.

    Raises:
        InvalidRobot: The extension is not supported, or the file has too many bodies, lines, corners or bytes.
    """
    try:
        return CHECKS[ending(path)](text)
    except InvalidRobot as error:
        raise InvalidRobot(f"{str(path)!r}: {error}") from None
    except Exception as error:  # A broken file may cause any exception in the checks.
        raise_of_handler(error)
        raise InvalidRobot(f"{str(path)!r} cannot be read: {error or type(error).__name__}") from None


def readable(kind: str, text: bytes) -> bytes:
    """Convert a text format such that the checks and trimesh read the same characters.

    Text becomes UTF-8: trimesh guesses any other encoding, also one in which no byte has the value of an ASCII line end. In
    OBJ, each line begins with its keyword and one space, otherwise trimesh skips it; and indices are absolute.
    """
    if kind == "obj":
        return _absolute(_LINE_START.sub(rb"\1 ", _joined(_utf8(text))))
    return _utf8(text) if kind == "stl" and not _is_binary_stl(text) else text


def _joined(text: bytes) -> bytes:
    """End all lines of OBJ alike, and join those that end with a backslash to the next one."""
    return text.replace(b"\r\n", b"\n").replace(b"\r", b"\n").replace(b"\\\n", b"")


def _absolute(text: bytes) -> bytes:
    """Replace negative indices of OBJ, which count back from the last vertex before the face: trimesh counts from the end.

    Indices that name no vertex before the face stay as they are, for `_obj` to reject.
    """
    if _NO_INDEX.search(text) is None:
        return text
    before = {b"v": 0, b"vt": 0, b"vn": 0}

    def absolute(corner: bytes) -> bytes:
        indices = corner.split(b"/")
        for place, (index, count) in enumerate(zip(indices, before.values(), strict=False)):
            if re.fullmatch(rb"-[0-9]{1,18}", index) and 0 < -int(index) <= count:
                indices[place] = b"%d" % (count + 1 + int(index))
        return b"/".join(indices)

    lines = text.split(b"\n")
    for number, line in enumerate(lines):
        word = line.partition(b" ")[0]
        if word in before:
            before[word] += 1
        elif word == b"f":
            lines[number] = b" ".join(map(absolute, line.split()))
    return b"\n".join(lines)


def _utf8(text: bytes) -> bytes:
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
    if found not in CHECKS:
        *first, last = (f".{each}" for each in sorted(CHECKS))
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

    def copy(self, scene: Any) -> list[Any]:
        """Create the bodies of a scene, each with a copy of its images.

        Raises:
            InvalidRobot: The images have too many pixels.
        """
        shown = [scene.geometry[scene.graph[node][1]] for node in scene.graph.nodes_geometry]
        pixels = sum(_pixels_of(getattr(each, "visual", None)) for each in shown)
        _at_most(pixels, self.pixels_left, "pixels in the images of its bodies")
        self.pixels_left -= pixels
        bodies: list[Any] = scene.dump()
        return bodies


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
        _at_most(self._names, MOST_NAMES, "names of other files")
        named = name.strip().replace("\\", "/")
        places = [(self._folder / each).resolve() for each in (named, named.rpartition("/")[2])]
        found = next((each for each in places if each.is_relative_to(self._folder) and each.is_file()), None)
        if found is None:
            raise InvalidRobot(f"{name!r} is neither in {str(self._folder)!r} nor in a folder below")
        text = self._budget.read(found, self._left)
        self._left -= len(text)
        pixels = _pixels(text)
        self._pixels += pixels
        _at_most(self._pixels, MOST_PIXELS, "pixels in its images")
        if pixels:
            return text
        text = _utf8(text)
        _at_most(_lines(text), MOST_LINES, "lines")
        _at_most(text.lower().count(b"newmtl"), MOST_BODIES, "materials")
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


def _at_most(count: int, most: int, noun: str) -> None:
    if count > most:
        raise InvalidRobot(f"{count:,} {noun}, expected at most {most:,}: a mesh of an arm is smaller")


def _stl(text: bytes) -> Size:
    if _is_binary_stl(text):
        return Size(1, 0, (len(text) - 84) // 50)
    lower = text.lower()
    solids, vertices = lower.count(b"endsolid"), lower.count(b"vertex")
    lines = vertices + lower.count(b"normal")
    _at_most(solids, MOST_GROUPS, "solids")
    _at_most(lines, MOST_LINES, "vertices and normals")
    facets = sum(1 for _ in _FACET.finditer(lower))
    if vertices % 3 or facets not in (0, vertices // 3):
        raise InvalidRobot(f"it has {vertices:,} vertices in {facets:,} facets, expected three in each")
    return Size(solids, lines, vertices // 3)


def _is_binary_stl(text: bytes) -> bool:
    """Return whether a file has the length that it declares; otherwise trimesh reads it as text."""
    return len(text) >= 84 and len(text) == 84 + 50 * struct.unpack_from("<I", text, 80)[0]


def _obj(text: bytes) -> Size:
    lines = _lines(text)
    _at_most(lines, MOST_LINES, "lines")
    joined = _joined(text) + b"\n"
    if found := _BREAK.search(joined):
        raise InvalidRobot(
            f"it has the character {found[0].decode()!r}, which is a line end to some readers; end lines with '\\n'"
        )
    whole = np.frombuffer(joined, dtype=np.uint8)
    _at_most(int(np.diff(np.flatnonzero(whole == ord("\n")), prepend=-1).max()), MOST_LINE, "bytes in a line")
    materials = len(set(re.findall(rb"usemtl[^\n]*", joined)))
    _at_most(materials, MOST_GROUPS, "materials")
    _at_most(lines * materials, MOST_MASKED, "lines times materials")
    if found := _NO_INDEX.search(joined):
        raise InvalidRobot(
            f"a face has the index {found[1].decode()}, expected one from 1 on, or a negative one that counts back from the "
            f"last vertex before the face: {found[0].decode(errors='replace')!r:.100}"
        )
    if found := _NO_FACE.search(joined):
        raise InvalidRobot(f"a face has fewer than three corners: {found[0].decode(errors='replace')!r:.100}")
    if found := _NO_TRIANGLES.search(joined):
        raise InvalidRobot(
            f"it has a line {found[1].decode()!r}, which is not read; write surfaces as faces, in one file"
        )
    faces = _FACE.findall(joined)
    words = count_words(b"\n".join(faces).decode("latin-1"))
    return Size(
        materials, lines, words - 3 * len(faces)
    )  # Each line has a keyword, and two triangles fewer than corners.


def _ply(text: bytes) -> Size:
    """Check the header word by word, as trimesh reads it, and reject declarations that trimesh would trust."""
    (_, form, *header), begin = _ply_header(text)
    if form[0] != "format":  # trimesh takes the second line as the format, whatever it is.
        raise InvalidRobot(f"its second line is {' '.join(form)!r:.100}, expected the format")
    is_text = "ascii" in " ".join(form).lower()
    if is_text:
        _at_most(_lines(text), MOST_LINES, "lines")
    elements = dict[str, _Element]()
    name, properties, values = "", 0, 0
    for words in header:
        if "element" in words[0]:
            if len(words) != 3 or re.fullmatch("[0-9]{1,18}", words[2]) is None:
                raise InvalidRobot(
                    f"its header has {' '.join(words)!r}, expected an element with a name and a count"
                )
            name = words[1]
            if name == "edge":
                raise InvalidRobot("it has edges that belong to no triangle; remove them")
            if name in ("tristrips", "trifans"):
                raise InvalidRobot(f"it has {name}, expected the element face; write each triangle as a face")
            if name in elements:
                raise InvalidRobot(f"it has two elements {name!r:.100}, expected one; write them as one")
            elements[name] = _Element(int(words[2]), [])
        elif "property" in words[0]:
            if not elements:
                raise InvalidRobot("its header has a property before the first element")
            properties, values = properties + 1, values + elements[name].rows
            if name == "vertex" and "list" in words[1]:  # trimesh copies it for each corner of a triangle.
                raise InvalidRobot("its vertices have lists; remove them")
            if words[-1] in (other[-1] for other in elements[name].properties):
                raise InvalidRobot(
                    f"its element {name!r:.100} has two properties {words[-1]!r:.100}, expected one"
                )
            elements[name].properties.append(words[1:])
    _at_most(properties, MOST_PROPERTIES, "properties in its header")
    if not is_text:
        return Size(1, 0, _triangles_of_bytes(text, begin, elements, "big" in " ".join(form).lower()))
    _at_most(values, MOST_VALUES, "values")
    triangles = _triangles_of_lines(text[begin:].decode().splitlines(), elements)
    return Size(1, max(values, _lines(text)), triangles)


class _Element(NamedTuple):
    """An element of PLY."""

    rows: int
    properties: list[list[str]]
    """Words of each: the type and the name; or ``list``, the types of the count and of the numbers, and the name."""

    def corners(self) -> int:
        """Return which property is the corners of faces.

        Raises:
            InvalidRobot: None is, or several are.
        """
        named = [
            n for n, words in enumerate(self.properties) if words[-1] in ("vertex_index", "vertex_indices")
        ]
        named = named or ([0] if len(self.properties) == 1 else [])
        if len(named) != 1 or self.properties[named[0]][0] != "list":
            raise InvalidRobot("its faces must have one list of corners, vertex_index or vertex_indices")
        return named[0]


def _triangles_of_lines(lines: list[str], elements: Mapping[str, _Element]) -> int:
    """Count the triangles of text PLY, and check that each face has as many numbers as it says.

    trimesh takes the number of corners from the first face if all lines have as many words, and ignores that lines are
    missing at the end.
    """
    begin, triangles = 0, 0
    for name, element in elements.items():
        rows = lines[begin : begin + element.rows]
        if len(rows) < element.rows:
            raise InvalidRobot(
                f"it has {len(rows):,} lines of the element {name!r:.100}, expected {element.rows:,}"
            )
        begin += element.rows
        if name != "face" or not rows:
            continue
        which, lists = element.corners(), [words[0] == "list" for words in element.properties]
        for row in rows:
            words, at = row.split(), 0
            for number, is_list in enumerate(lists):
                size = int(words[at]) if is_list else 0
                if number == which:
                    triangles += _triangles_of_face(size)
                at += 1 + size
            if at != len(words):
                raise InvalidRobot(f"a face has {len(words)} numbers, expected {at}: {row!r:.100}")
    return triangles


def _triangles_of_bytes(text: bytes, begin: int, elements: Mapping[str, _Element], is_big: bool) -> int:
    """Count the triangles of binary PLY, and check that the lists of an element are as long as in its first row.

    trimesh takes the lengths from the first row.
    """
    triangles, order = 0, ">" if is_big else "<"
    for name, element in elements.items():
        if not element.rows:
            continue
        fields = list[tuple[str, Any]]()
        sizes = dict[int, int]()
        for number, (*types, _) in enumerate(element.properties):
            if types[0] == "list":
                place = begin + np.dtype(fields).itemsize
                fields.append((f"count {number}", order + _PLY_TYPES[types[1]]))
                sizes[number] = int(np.frombuffer(text, fields[-1][1], 1, place)[0])
                fields.append((str(number), f"V{sizes[number] * np.dtype(_PLY_TYPES[types[2]]).itemsize}"))
            else:
                fields.append((str(number), order + _PLY_TYPES[types[0]]))
        kind = np.dtype(fields)
        rows = np.frombuffer(text, kind, element.rows, begin)
        begin += element.rows * kind.itemsize
        if any((rows[f"count {number}"] != size).any() for number, size in sizes.items()):
            raise InvalidRobot(
                f"the lists of its element {name!r:.100} have different lengths; write each face as triangles"
            )
        if name == "face":
            triangles += element.rows * _triangles_of_face(sizes[element.corners()])
    return triangles


def _triangles_of_face(corners: int) -> int:
    if corners < 3:
        raise InvalidRobot(f"a face has {corners} corners, expected at least 3")
    return corners - 2


def _ply_header(text: bytes) -> tuple[list[list[str]], int]:
    """Return the words of each line of the header, without its end, and where that ends."""
    file, header = io.BytesIO(text), list[list[str]]()
    while len(header) < MOST_HEADER:
        line = file.readline(MOST_LINE + 1)
        _at_most(len(line), MOST_LINE, "bytes in a line of its header")
        words = line.decode().split()
        if not words:
            break
        if "end_header" in words and len(header) > 1:
            return header, file.tell()
        header.append(words)
    raise InvalidRobot(
        f"its header must end with end_header, within {MOST_HEADER:,} lines and without an empty one"
    )


def _lines(text: bytes) -> int:
    return sum(map(text.count, _LINE_ENDS)) - text.count(b"\r\n") + 1


def _glb(text: bytes) -> Size:
    """Add up the sizes of accessors, views, primitives and nodes, each of which may be referred to many times."""
    size = struct.unpack_from("<I", text, 12)[0]
    _at_most(size, MOST_JSON, "bytes of JSON")
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
    _at_most(sum(bytes_of), 2 * len(text), "bytes in its accessors")
    _at_most(sum(_count(each["byteLength"]) for each in views), 2 * len(text), "bytes in its views")
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
    _at_most(len(nodes) + sum(bodies) + len(images), MOST_BODIES, "nodes, bodies and images")
    named_as_child = [child for node in nodes for child in node.get("children", [])]
    roots = [root for scene in document.get("scenes", []) for root in scene.get("nodes", [])]
    _at_most(_steps(nodes, roots), MOST_STEPS, "steps from its nodes to the root")
    meshes = [nodes[each]["mesh"] for each in [*named_as_child, *roots] if "mesh" in nodes[each]]
    shown = sum(bodies[mesh] for mesh in meshes)
    _at_most(shown, MOST_BODIES, "bodies")
    shared = max(sum(weights), sum(weights[mesh] for mesh in meshes))
    _at_most(shared, max(2 * len(text), MOST_SHARED), "bytes in its bodies")
    drawn = _drawn(sum(corners[mesh] for mesh in meshes), text)
    pixels = 0
    for image in images:
        view = views[image["bufferView"]]
        start = view.get("byteOffset", 0)
        pixels += _pixels(_buffer(text, 20 + size)[start : start + view["byteLength"]])
    _at_most(pixels, MOST_PIXELS, "pixels in its images")
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
    _at_most(counted, MOST_CORNERS, "corners of triangles, with those of instances counted four times")
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
    _at_most(text.count(b"<"), MOST_TAGS, "tags")
    from lxml import etree

    root = etree.fromstring(text, etree.XMLParser(huge_tree=True, no_network=True))
    require_numbers_alone(root)
    etree.strip_tags(root, etree.Comment, etree.ProcessingInstruction)
    for each in root.iter("{*}vcount"):
        if re.fullmatch(r"[0-9 \t\r\n]*", each.text or "") is None:
            raise InvalidRobot("the numbers of corners of polygons are not whole numbers")
        if count_words(each.text):
            corners = float(np.fromstring(each.text, sep=" ").sum())
            _at_most(int(min(corners, 2.0**62)), MOST_CORNERS, "corners of polygons")
    columns = max((len(each.findall("{*}param")) for each in root.iter("{*}accessor")), default=0)
    _at_most(columns, MOST_COLUMNS, "columns in a source")
    named = [f"{{*}}{each}" for each in ("node", "geometry", "material", "effect", "image")]
    _at_most(sum(1 for _ in root.iter(*named)), MOST_BODIES, "nodes, geometries, materials and images")
    require_units(root)
    bodies, corners, triangles = _unfolded(root)
    _at_most(bodies, MOST_BODIES, "nodes and bodies")
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
    "obj": _obj,
    "ply": _ply,
    "stl": _stl,
}
"""Checks of the supported formats, by extension."""
