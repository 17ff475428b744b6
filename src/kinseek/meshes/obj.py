"""OBJ files: polygons in text, with materials in other files."""

from __future__ import annotations

import re
from array import array
from collections.abc import Callable, Iterator

import numpy as np

from kinseek.errors import InvalidRobot

from .limits import MOST_CORNERS, MOST_LINE, MOST_LINES, Size, at_most, require_line_ends, utf8
from .polygons import Array, Body, Indices, triangulated
from .stl import NUMBER

MOST_GROUPS = 1_000
"""Most materials of a file, each of which is a body."""

_INDEX = rb"-?[0-9]{1,18}"
_ROW = rb"%%s((?:[ \t]+%s){%%s})[ \t]*(?:#.*)?" % NUMBER
_FORMS = (rb"I", rb"I/I", rb"I//I", rb"I/I/I")
_WIDTHS = (1, 2, 2, 3)
"""Indices of a corner in each form."""
_TEXTURED = (2, 4)
"""Forms with a texture, counted from 1."""
_FACE = re.compile(
    rb"f(?:%s)[ \t]*(?:#.*)?"
    % b"|".join(rb"((?:[ \t]+%s){3,})" % form.replace(b"I", _INDEX) for form in _FORMS)
)
_VERTEX, _TEXTURE = re.compile(_ROW % (b"v", b"3,6")), re.compile(_ROW % (b"vt", b"1,3"))
_VERTICES = "3 coordinates; and nothing else, a weight of 1 or 3 numbers of a colour"
_FACES = "at least 3 corners, all of the form v, v/vt, v//vn or v/vt/vn"
_NO_SHAPE = (
    b"# vn vp p l g s o usemtl usemap mtllib maplib mg bevel c_interp d_interp lod shadow_obj trace_obj ctech stech"
).split()
"""Statements without triangles; `vp` are parameters of curves and surfaces, which are rejected themselves."""


def read(text: bytes, take: Callable[[Size], None], looks: bool = True) -> tuple[list[Body], list[str]]:
    """Read the polygons, one body for each material, and the names of the files of materials.

    Without looks there is one body, in the order of the file, which separates surfaces that touch each other.

    Raises:
        InvalidRobot: A statement is not known, has another form, or is ambiguous; or the file is too large.

    Source: "Object Files (.obj)", appendix B1 of the Advanced Visualizer manual, Wavefront (1995).
    """
    text = utf8(text).replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    lines = text.count(b"\n") + 1
    at_most(lines, MOST_LINES, "lines")
    require_line_ends(text)
    used = len(set(re.findall(rb"^[ \t]*usemtl[^\n]*", text.replace(b"\\\n", b" "), re.MULTILINE)))
    at_most(used, MOST_GROUPS, "materials")
    take(Size(used, lines))
    vertices, widths, textures = array("d"), array("b"), array("d")
    corners, corner_textures, sizes, places, paints = (array("q") for _ in range(5))
    names, libraries, paint = {"": 0}, list[str](), 0
    for number, line in _statements(text):
        word = line.split(None, 1)[0]
        if word == b"v":
            values = _matched(_VERTEX, number, line, _VERTICES)[1].split()
            vertices.extend(map(float, values))
            widths.append(len(values))
            if len(values) == 5 or (len(values) == 4 and vertices[-1] != 1):
                raise _error(number, line, _VERTICES)
        elif word == b"f":
            face = _matched(_FACE, number, line, _FACES)
            form = face.lastindex or 1
            indices = [*map(int, face[form].replace(b"/", b" ").split())]
            step = _WIDTHS[form - 1]
            own, other = indices[::step], indices[1::step] if form in _TEXTURED else []
            if b"-" in face[form] or 0 in other:  # 0 stands for no texture here.
                own = _absolute(own, len(widths), number, line)
                other = _absolute(other, len(textures) // 2, number, line)
            corners.extend(own)
            corner_textures.extend(other or [0] * len(own))
            sizes.append(len(own))
            places.append(number)
            paints.append(paint)
            at_most(len(corners), MOST_CORNERS, "corners of polygons")
        elif word == b"vt":
            textures.extend(
                map(float, [*_matched(_TEXTURE, number, line, "1 to 3 numbers")[1].split(), b"0"][:2])
            )
        elif word in (b"usemtl", b"mtllib"):
            name = line[len(word) :].decode().strip()
            if word == b"mtllib":
                libraries.append(name)
            else:
                paint = names.setdefault(name, len(names))
        elif word not in _NO_SHAPE and not word.startswith(b"#"):
            raise _error(
                number,
                line,
                "v, vt, f or a statement without a surface; write surfaces as faces, in one file",
            )
    rows, colours = _rows(np.frombuffer(vertices), np.frombuffer(widths, np.int8).astype(np.int64))
    vertex, texture = (np.frombuffer(each, np.int64) - 1 for each in (corners, corner_textures))
    counts, uv = np.frombuffer(sizes, np.int64), np.frombuffer(textures).reshape(-1, 2)
    triangles, owners = triangulated(
        rows,
        vertex,
        counts,
        lambda face: f"line {places[face]}",
        take,
        first=1,
    )
    if len(wrong := np.flatnonzero(texture >= len(uv))):
        which = int(np.searchsorted(np.cumsum(counts), wrong[0], side="right"))
        raise InvalidRobot(
            f"line {places[which]}: a face has the texture {texture[wrong[0]] + 1}, expected one up to {len(uv)}"
        )
    paint_of, known, bodies = np.frombuffer(paints, np.int64)[owners] * looks, [*names], list[Body]()
    order = np.argsort(paint_of, kind="stable")
    for same in np.split(order, np.flatnonzero(np.diff(paint_of[order])) + 1) if len(order) else []:
        part = triangles[same]
        kept, faces = np.unique(vertex[part], return_inverse=True)
        bodies.append(
            Body(
                rows[kept],
                faces.reshape(-1, 3),
                None if colours is None else colours[kept],
                material=known[paint_of[same[0]]],
                uv=uv[texture[part]] if texture[part].min() >= 0 else None,
            )
        )
    return bodies, libraries


def _rows(numbers: Array, widths: Indices) -> tuple[Array, Array | None]:
    """Return the coordinates of vertices, (n, 3), and their colours if all have one."""
    if (widths == 6).all():
        return numbers.reshape(-1, 6)[:, :3], numbers.reshape(-1, 6)[:, 3:]
    starts = np.cumsum(widths) - widths
    return numbers[starts[:, None] + np.arange(3)], None


def _absolute(indices: list[int], count: int, number: int, line: bytes) -> list[int]:
    """Count from 1 on also what counts back from the last row before the face."""
    found = [index if index >= 0 else count + 1 + index for index in indices]
    if min(found, default=1) < 1:
        raise _error(
            number,
            line,
            f"indices from 1 on, or negative ones back from the last of {count:,} rows before the face",
        )
    return found


def _matched(pattern: re.Pattern[bytes], number: int, line: bytes, expected: str) -> re.Match[bytes]:
    found = pattern.fullmatch(line)
    if found is None:
        raise _error(number, line, expected)
    return found


def _error(number: int, line: bytes, expected: str) -> InvalidRobot:
    return InvalidRobot(f"line {number}: it has {line.decode(errors='replace')!r:.100}, expected {expected}")


def _statements(text: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield the lines that are not blank, with their numbers; a line that ends with a backslash goes on in the next one."""
    # Joined at their end: copying or searching what has begun for each line would take the square of their number.
    begun, has_comment = bytearray(), False
    for number, each in enumerate(text.split(b"\n"), 1):
        if begun and not (begun[-1:].isspace() or each[:1].isspace()):
            raise _error(number, bytes(begun) + b"\\", "a blank before the backslash or after it")
        begun += each
        has_comment = has_comment or b"#" in each
        at_most(len(begun), MOST_LINE, "bytes in a line")
        if each.endswith(b"\\"):
            if has_comment:
                raise _error(
                    number,
                    bytes(begun),
                    "a comment without a backslash at its end: readers differ on the next line",
                )
            del begun[-1]
        else:
            line = bytes(begun).strip()
            begun.clear()
            has_comment = False
            if line:
                yield number, line
    if begun:
        raise InvalidRobot("its last line ends with a backslash, expected another line")
