"""Strict readers of OBJ, PLY and STL.

Sources: *Object Files (.obj)*, appendix B1 of the *Advanced Visualizer Manual*, Wavefront Technologies; Turk, *The PLY
Polygon File Format* (1994); *StereoLithography Interface Specification*, 3D Systems (1988).
"""

from __future__ import annotations

import re
import struct
from typing import NamedTuple

import numpy as np

from .shapes import NUMBER, Polygons, Unknown, floats, placed

LINE = re.compile("\r\n|\r|\n")
NO_SURFACE = {
    "vt",
    "vn",
    "vp",
    "l",
    "p",
    "g",
    "o",
    "s",
    "mtllib",
    "usemtl",
    "mg",
    "bevel",
    "c_interp",
    "d_interp",
    "lod",
    "maplib",
    "usemap",
}
NO_SURFACE |= {"shadow_obj", "trace_obj"}
CORNER = re.compile(r"([+-]?\d+)(/[+-]?\d+)?|([+-]?\d+)/([+-]?\d+)?/([+-]?\d+)", re.ASCII)


def decoded(text: bytes) -> str:
    """A text, with line ends of one kind."""
    try:
        found = text.decode("utf-8-sig")
    except UnicodeDecodeError:
        found = text.decode("latin-1")
    return LINE.sub("\n", found)


def words(line: str) -> list[str]:
    """The words of a line, between blanks of C."""
    return [each for each in re.split("[ \t\v\f\r]+", line) if each]


def obj_polygons(text: bytes) -> Polygons:
    """The polygons of a file of Wavefront."""
    told = decoded(text)
    if set(told) & set("\0\v\f"):
        raise Unknown("control character")
    if re.search(r"#[^\n]*\\\n", told) or re.search(r"[^ \t\n]\\\n[^ \t\n]", told):
        raise Unknown("a comment or a word that goes on")
    points, faces = list[list[float]](), list[list[tuple[int, int, int]]]()
    for line in told.replace("\\\n", " ").split("\n"):
        name, *rest = words(line.partition("#")[0]) or ["#"]
        if name == "v":
            values = floats(rest).tolist()
            if len(values) not in (3, 4, 6) or (len(values) == 4 and values[3] != 1):
                raise Unknown("vertex")
            points.append(values[:3])
        elif name == "f":
            faces.append([_corner(each, len(points)) for each in rest])
            if len(rest) < 3 or len({each[1:] for each in faces[-1]}) != 1:
                raise Unknown("face")
        elif name not in NO_SURFACE and name != "#":
            raise Unknown(f"statement {name}" if name.isascii() else "statement")
    return placed(np.array(points).reshape(-1, 3), [[each[0] for each in face] for face in faces])


def _corner(word: str, points: int) -> tuple[int, int, int]:
    """Index of a corner; does it have a texture, and a normal?"""
    if not CORNER.fullmatch(word):
        raise Unknown("corner")
    first, *others = word.split("/")
    index = int(first)
    if index == 0 or any(each and int(each) == 0 for each in others[:1]):
        raise Unknown("index 0")
    return (index - 1 if index > 0 else points + index), bool(others and others[0]), len(others) > 1


TYPES = {"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"}
TYPES |= {"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4"}
TYPES |= {"float": "f4", "double": "f8", "float32": "f4", "float64": "f8"}


class Property(NamedTuple):
    """One property of an element of PLY."""

    name: str
    type: str
    length: str
    """The type of the length, if it is a list."""


class Rows:
    """The values of a PLY file, one after the other."""

    def __init__(self, body: bytes, form: str) -> None:
        """Begin after the header."""
        self.order = {"binary_little_endian": "<", "binary_big_endian": ">"}.get(form, "")
        self.body, self.at = body, 0
        self.words = list[str]()
        if not self.order:
            if not body.isascii():
                raise Unknown("text")
            self.lines = decoded(body).split("\n")

    def begin(self) -> None:
        """Begin a row."""
        if not self.order:
            self.end()
            while self.lines and not self.words:
                self.words = words(self.lines.pop(0))

    def take(self, type_: str, shape: bool = True) -> float:
        """The next value; one without a shape may be any word."""
        if self.order:
            form = np.dtype(self.order + type_)
            if self.at + form.itemsize > len(self.body):
                raise Unknown("end of the file")
            found = np.frombuffer(self.body, form, 1, self.at)[0]
            self.at += form.itemsize
            return found.item()  # type: ignore[no-any-return]
        if not self.words:
            raise Unknown("end of a row")
        word = self.words.pop(0)
        if not shape:
            return 0.0
        if type_[0] == "f":
            return float(floats([word])[0]) if NUMBER.fullmatch(word) else np.nan
        value = float(floats([word])[0])
        limits = np.iinfo(type_)
        if value % 1 or not limits.min <= value <= limits.max:
            raise Unknown("value out of the range of its type")
        return value

    def end(self) -> None:
        """Nothing is left of a row."""
        if self.words:
            raise Unknown("more in a row")

    def finish(self) -> None:
        """Nothing is left of the file."""
        self.end()
        if self.body[self.at :].strip(b" \t\r\n") if self.order else any(map(words, self.lines)):
            raise Unknown("more in the file")


def ply_polygons(text: bytes) -> Polygons:
    """The polygons of a file of Stanford."""
    header = re.match(
        rb"ply[ \t\v\f\r]*?(\r\n|\n|\r)(.*?(\r\n|\n|\r))??end_header[ \t\v\f\r]*?\1", text, re.DOTALL
    )
    if not header:
        raise Unknown("header")
    formats, elements = list[str](), dict[str, tuple[int, list[Property]]]()
    for line in re.split("\r" if header[1] == b"\r" else "\n", (header[2] or b"").decode("latin-1"))[:-1]:
        match words(line):
            case ["comment" | "obj_info", *_]:
                pass
            case ["format", form, "1.0"] if not elements:
                formats.append(form)
            case ["element", name, many] if name not in elements and many.isdigit():
                elements[name] = int(many), []
            case ["property", "list", number, type_, name] if number in TYPES and type_ in TYPES and elements:
                [*elements.values()][-1][1].append(Property(name, TYPES[type_], TYPES[number]))
            case ["property", type_, name] if type_ in TYPES and elements:
                [*elements.values()][-1][1].append(Property(name, TYPES[type_], ""))
            case _:
                raise Unknown("line of the header")
    if len(formats) != 1 or formats[0] not in ("ascii", "binary_little_endian", "binary_big_endian"):
        raise Unknown("format")
    rows = Rows(text[header.end() :], formats[0])
    points, faces = list[list[float]](), list[list[int]]()
    for name, (rows_told, properties) in elements.items():
        names = [each.name for each in properties]
        corners = [each for each in properties if each.name in ("vertex_indices", "vertex_index")]
        if len(set(names)) != len(names) or name in ("tristrips", "trifans"):
            raise Unknown("names")
        if name == "face" and (len(corners) != 1 or not corners[0].length or corners[0].type[0] == "f"):
            raise Unknown("corners")
        if not properties and rows_told > 1_000_000:
            raise Unknown("rows of nothing")
        for _ in range(rows_told):
            row = dict[str, list[float]]()
            rows.begin()
            for each in properties:
                length = rows.take(each.length) if each.length else 1
                if length != int(length) or length < 0 or each.length[:1] == "f":
                    raise Unknown("length of a list")
                shape = (name == "vertex" and each.name in ("x", "y", "z")) or (
                    name == "face" and each in corners
                )
                row[each.name] = [rows.take(each.type, shape) for _ in range(int(length))]
            if name == "vertex":
                if any(each.length for each in properties) or not {"x", "y", "z"} <= {*row}:
                    raise Unknown("vertex")
                points.append([row[axis][0] for axis in "xyz"])
            elif name == "face":
                faces.append([int(index) for index in row[corners[0].name]])
    rows.finish()
    return placed(np.array(points).reshape(-1, 3), faces)


def stl_polygons(text: bytes) -> Polygons:
    """The triangles of a file of a stereolithograph."""
    if len(text) >= 84 and len(text) == 84 + 50 * struct.unpack_from("<I", text, 80)[0]:
        found = [np.frombuffer(text, "<f4", 9, at + 12).reshape(3, 3) for at in range(84, len(text), 50)]
        points = np.concatenate([np.zeros((0, 3)), *found])
        return placed(points, [list(range(k, k + 3)) for k in range(0, len(points), 3)])
    numbers, inside, tokens = list[float](), False, list[str]()
    for line in decoded(text).split("\n"):
        some = words(line.lower())
        while some:
            if tokens or some[0] not in ("solid", "endsolid"):
                tokens.append(some.pop(0))
                if not inside:
                    raise Unknown("outside of a solid")
                if len(tokens) == 21:
                    numbers += _facet(tokens)
                    tokens = []
            elif (some[0] == "solid") == inside or {"facet", "vertex", "endfacet", "outer"} & {*some[1:]}:
                raise Unknown("solid")
            else:  # The others are the words of its name.
                inside, some = not inside, []
    if inside or tokens:
        raise Unknown("end")
    return placed(
        np.array(numbers).reshape(-1, 3), [[k, k + 1, k + 2] for k in range(0, len(numbers) // 3, 3)]
    )


def _facet(tokens: list[str]) -> list[float]:
    """The numbers of three corners."""
    frame = [
        "facet",
        "normal",
        "*",
        "*",
        "*",
        "outer",
        "loop",
        "vertex",
        "*",
        "*",
        "*",
        "vertex",
        "*",
        "*",
        "*",
        "vertex",
        "*",
        "*",
        "*",
        "endloop",
        "endfacet",
    ]
    if any(told not in ("*", found) for told, found in zip(frame, tokens, strict=True)):
        raise Unknown("facet")
    return [value for at in (8, 12, 16) for value in floats(tokens[at : at + 3]).tolist()]
