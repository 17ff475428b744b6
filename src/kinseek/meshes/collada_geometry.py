"""The shapes of COLLADA: every triangle of a geometry is read, or the file is rejected.

Source: Barnes and Levy Finch, *COLLADA – Digital Asset Schema Release 1.4.1*, Khronos Group (2008), chapter 5.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection
from contextlib import suppress
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from kinseek.errors import InvalidRobot

from .limits import MOST_CORNERS, Size, at_most
from .polygons import Array, Body, Indices, triangulated
from .stl import NUMBER

_BLANK = r"[ \t\r\n]"
_NUMBERS = re.compile(f"{_BLANK}*+(?:{NUMBER.decode()}(?:{_BLANK}++|\\Z))*+")
_WHOLE_NUMBERS = re.compile(f"(?:[0-9]|{_BLANK})*+")
TRIANGLES = ("triangles", "tristrips", "trifans", "polylist", "polygons")
"""Elements of meshes that have a surface."""
_STRIPS = ("tristrips", "trifans")
_IN_MESHES = (*TRIANGLES, "source", "vertices", "lines", "extra")
"""Elements of meshes that are read, or that have no surface."""


def name_of(element: Any) -> str:
    """Return the name of an element, without its namespace."""
    return str(element.tag).rpartition("}")[2]


def children_of(element: Any, known: Collection[str], who: str) -> dict[str, list[Any]]:
    """Return the elements in an element, by their names.

    Raises:
        InvalidRobot: One of them is not known.
    """
    found: dict[str, list[Any]] = {name: [] for name in known}
    for each in element.iterchildren("*"):
        if (name := name_of(each)) not in found:
            raise InvalidRobot(f"{who} has <{name}>, expected only {_listed(known)}")
        found[name].append(each)
    return found


def only(found: dict[str, list[Any]], name: str, who: str) -> Any:
    """Return the only element of a name.

    Raises:
        InvalidRobot: There is none, or there are several.
    """
    if len(found[name]) != 1:
        raise InvalidRobot(f"{who} has {len(found[name])} <{name}>, expected one")
    return found[name][0]


def count_words(text: str | None) -> int:
    """Return the number of words, without creating them."""
    blank = np.frombuffer(f" {text or ''}".encode(), dtype=np.uint8) <= ord(" ")
    return int((blank[:-1] & ~blank[1:]).sum())


def numbers_of(element: Any, who: str, form: re.Pattern[str] = _NUMBERS) -> Array:
    """Return the numbers that an element consists of.

    Raises:
        InvalidRobot: It has anything else, such as a comment or NaN, or too many numbers.
    """
    name, text = name_of(element), element.text or ""
    if len(element):
        raise InvalidRobot(f"{who} has a <{name}> with a comment or an element in it, expected numbers alone")
    at_most(count_words(text), 3 * MOST_CORNERS, f"numbers in a <{name}>")
    found = np.fromstring(text, sep=" ") if form.fullmatch(text) and text.strip() else np.zeros(0)
    if len(found) != count_words(text) or not np.isfinite(found).all():
        what = "finite numbers" if form is _NUMBERS else "whole numbers from 0 on"
        raise InvalidRobot(f"{who} has a <{name}> of {text[:60]!r}, whose words are not all {what}")
    return found


def _indices(element: Any, who: str) -> Indices:
    """Return the whole numbers that an element consists of; what is larger than any index becomes 2⁶²."""
    return np.minimum(numbers_of(element, who, _WHOLE_NUMBERS), 2.0**62).astype(np.int64)


def _whole(element: Any, name: str, who: str, default: str = "") -> int:
    """Return an attribute that is a whole number."""
    text = element.get(name, default)
    if re.fullmatch("[0-9]{1,9}", text) is None:
        raise InvalidRobot(
            f"{who} has a <{name_of(element)}> with the {name} {text!r:.100}, expected a whole number"
        )
    return int(text)


def corners_of(geometry: Any) -> int:
    """Return an upper bound of the number of corners of a geometry's triangles, without reading them."""
    return sum(
        (3 if name_of(each.getparent()) in _STRIPS else 1) * count_words(each.text)
        for each in geometry.iterfind("{*}mesh/*/{*}p")
    )


def bodies_of(
    geometry: Any, named: dict[str, list[Any]], looks: bool, take: Callable[[Size], object]
) -> list[Body]:
    """Read a geometry; each of its primitives is a body, whose material is a symbol that instances bind.

    Args:
        geometry: The element.
        named: All elements of the file by their ids.
        looks: Read normals, colours and coordinates in images, too? Those that are broken are left out.
        take: See `triangulated`.

    Raises:
        InvalidRobot: It is no mesh, or not all of its triangles can be read.
    """
    who = f"the geometry {geometry.get('id')!r:.100}"
    found = children_of(
        only(children_of(geometry, ("mesh", "asset", "extra"), who), "mesh", who), _IN_MESHES, who
    )
    vertices, at_vertices = _vertices(only(found, "vertices", who), who)
    mesh = _Mesh(who, {}, vertices, at_vertices, looks, {})
    for each in found["source"]:
        if (url := _reference_to(each, who)) in (vertices, *mesh.sources):
            raise InvalidRobot(f"{who} has two parts with the id {url[1:]!r:.100}, expected one")
        mesh.sources[url] = each
    if (url := mesh.at_vertices["POSITION"]) not in mesh.sources:
        raise InvalidRobot(f"{who} has an <input> of POSITION from {url!r:.100}, which is not in its mesh")
    accessors = mesh.sources[url].iterfind("{*}technique_common/{*}accessor")
    for each in (url, vertices, *(accessor.get("source", "") for accessor in accessors)):
        # Some readers look for an id in the file, others in the mesh.
        if (count := len(named.get(each[1:], []))) > 1:
            raise InvalidRobot(
                f"{who} refers to {each!r:.100}, which the file has {count} times, expected once"
            )
    # In the order of the file, which separates surfaces that touch each other.
    order = geometry.iterfind("{*}mesh/*")
    primitives = [_primitive(each, mesh) for each in order if name_of(each) in TRIANGLES]
    if not primitives:
        return []
    return _divided(primitives, _rows(mesh.sources[url], who, ["X", "Y", "Z"]), mesh, take)


class _Mesh(NamedTuple):
    """What the primitives of a mesh share."""

    who: str
    sources: dict[str, Any]
    """Elements by the reference to them."""
    vertices: str
    """The reference to ``<vertices>``."""
    at_vertices: dict[str, str]
    """References to the sources of the vertices, by their semantic."""
    looks: bool
    known: dict[str, Array | None]
    """Rows of sources for looks that were read; None for those that are broken."""


class _Primitive(NamedTuple):
    """Polygons of one element."""

    name: str
    material: str
    inputs: dict[str, tuple[str, int]]
    """Reference to the source, and the column of its indices, by semantic."""
    rows: Indices
    """Indices of all corners, one after the other, (k, columns)."""
    sizes: Indices
    """Number of corners of each polygon."""


def _vertices(element: Any, who: str) -> tuple[str, dict[str, str]]:
    """Return the reference to the vertices, and the references to their sources by semantic."""
    found = dict[str, str]()
    for each in children_of(element, ("input", "extra"), f"{who}, in <vertices>,")["input"]:
        semantic = each.get("semantic", "")
        if semantic in found or semantic == "VERTEX":
            raise InvalidRobot(
                f"{who} has a wrong or second <input> of {semantic} in <vertices>, expected POSITION"
            )
        found[semantic] = each.get("source", "")
    if "POSITION" not in found:
        raise InvalidRobot(f"{who} has <vertices> without an <input> of POSITION")
    return _reference_to(element, who), found


def _reference_to(element: Any, who: str) -> str:
    if not (name := element.get("id")):
        raise InvalidRobot(f"{who} has <{name_of(element)}> without an id")
    return f"#{name}"


def _rows(source: Any, who: str, names: list[str] | None = None) -> Array:
    """Return the rows of a source, (n, columns).

    Raises:
        InvalidRobot: It has no floats, does not have as many as it says, or its columns have other names.
    """
    who = f"{who}, in the source {source.get('id')!r:.100},"
    found = children_of(source, ("float_array", "technique_common", "technique", "asset"), who)
    floats, common = only(found, "float_array", who), only(found, "technique_common", who)
    accessor = only(children_of(common, ("accessor",), who), "accessor", who)
    params = [each.get("name") for each in children_of(accessor, ("param",), who)["param"]]
    if names is not None and params != names:
        raise InvalidRobot(f"{who} has the params {params!r:.100}, expected {', '.join(names)}")
    if accessor.get("source") != _reference_to(floats, who):
        raise InvalidRobot(
            f"{who} has values from {accessor.get('source')!r:.100}, expected its own <float_array>"
        )
    values = numbers_of(floats, who)
    count, stride = _whole(accessor, "count", who), _whole(accessor, "stride", who, "1")
    told, offset = _whole(floats, "count", who), _whole(accessor, "offset", who, "0")
    if (told, stride, offset, count * stride) != (len(values), len(params), 0, len(values)):
        raise InvalidRobot(
            f"{who} has {len(values)} floats; its counts say {told} floats, and {count} rows of {stride} from the float "
            f"{offset} on, with {len(params)} params; expected all floats in rows, and a param for each column"
        )
    return values.reshape(count, stride)


def _primitive(element: Any, mesh: _Mesh) -> _Primitive:
    """Read the indices of a primitive."""
    name, who = name_of(element), f"{mesh.who}, in <{name_of(element)}>,"
    known = ("input", "p", "extra", *(["vcount"] if name == "polylist" else []))
    found = children_of(element, known, who)  # Not <ph>, a polygon with holes.
    inputs, width = _inputs(found["input"], mesh, who)
    parts = [_table(each, width, who) for each in found["p"]]
    count = len(parts)
    if not (found["p"] or found.get("vcount") or _whole(element, "count", who)):
        name = "polygons"  # None of them: the lists of their numbers may be left out.
    if name in ("triangles", "polylist"):
        only(found, "p", who)
    if name == "polylist":
        sizes = _indices(only(found, "vcount", who), who)
        count = len(sizes)
        if float(sizes.astype(float).sum()) != len(parts[0]):
            raise InvalidRobot(
                f"{who} has polygons of {sizes.sum()} corners together, but <p> has {len(parts[0])}"
            )
    elif name == "polygons":
        sizes = np.array([len(each) for each in parts], dtype=np.int64)
    else:
        if name == "triangles" and len(parts[0]) % 3:
            raise InvalidRobot(f"{who} has {len(parts[0])} corners in <p>, expected three for each triangle")
        if name in _STRIPS and min(map(len, parts), default=3) < 3:
            raise InvalidRobot(f"{who} has {min(map(len, parts))} corners in a <p>, expected at least 3")
        parts = [each[_corners_of_triangles(name, len(each))] for each in parts]
        sizes = np.full(sum(map(len, parts)) // 3, 3)
        count = len(sizes) if name == "triangles" else count
    if (told := _whole(element, "count", who)) != count:
        raise InvalidRobot(f"{who} has the count {told}, expected {count}, as many as it holds")
    rows = np.concatenate(parts) if parts else np.zeros((0, width), dtype=np.int64)
    return _Primitive(name, element.get("material", ""), inputs, rows, sizes)


def _inputs(elements: list[Any], mesh: _Mesh, who: str) -> tuple[dict[str, tuple[str, int]], int]:
    """Return the inputs of a primitive by semantic, see `_Primitive`, and how many indices each corner has."""
    inputs = dict[str, tuple[str, int]]()
    width = 0
    for each in elements:
        semantic, url, offset = each.get("semantic", ""), each.get("source", ""), _whole(each, "offset", who)
        is_vertex = semantic == "VERTEX"
        if (
            is_vertex != (url == mesh.vertices)
            or not (is_vertex or url in mesh.sources)
            or semantic == "POSITION"
        ):
            raise InvalidRobot(
                f"{who} has an <input> of {semantic} from {url!r:.100}, expected VERTEX from <vertices>, and others "
                "(not POSITION) from sources of its mesh"
            )
        if semantic == "VERTEX" and semantic in inputs:
            raise InvalidRobot(f"{who} has two <input> of VERTEX, expected one")
        inputs.setdefault(semantic, (url, offset))
        width = max(width, offset + 1)
    if "VERTEX" not in inputs:
        raise InvalidRobot(f"{who} has no <input> of VERTEX")
    return inputs, width


def _table(element: Any, width: int, who: str) -> Indices:
    """Return the indices of ``<p>``, a row for each corner."""
    found = _indices(element, who)
    if len(found) % width:
        raise InvalidRobot(f"{who} has a <p> of {len(found)} numbers, expected {width} for each corner")
    return found.reshape(-1, width)


def _corners_of_triangles(name: str, count: int) -> Indices:
    """Return which of `count` corners the triangles of a set, a strip or a fan have, one triangle after the other."""
    if name == "triangles":
        return np.arange(count)
    i = np.arange(count - 2)
    if name == "trifans":
        return np.stack([0 * i, i + 1, i + 2], axis=1).ravel()
    odd = i % 2  # Every other triangle of a strip is turned around.
    return np.stack([i + odd, i + 1 - odd, i + 2], axis=1).ravel()


def _divided(
    primitives: list[_Primitive], positions: Array, mesh: _Mesh, take: Callable[[Size], object]
) -> list[Body]:
    """Divide the polygons of all primitives into triangles, and return a body for each primitive."""
    sizes = np.concatenate([each.sizes for each in primitives])
    ends = np.cumsum([len(each.sizes) for each in primitives])
    corners = np.concatenate([each.rows[:, each.inputs["VERTEX"][1]] for each in primitives])

    def place(number: int) -> str:
        return f"{mesh.who}, in <{primitives[int(np.searchsorted(ends, number, side='right'))].name}>"

    triangles, owners = triangulated(positions, corners, sizes, place, take)
    bodies, first = list[Body](), 0
    for each, part in zip(primitives, np.split(triangles, np.searchsorted(owners, ends[:-1])), strict=True):
        kept, faces = np.unique(corners[part], return_inverse=True)
        body = Body(positions[kept], faces.reshape(-1, 3), material=each.material)
        if mesh.looks:
            look = partial(_attribute, mesh, each, part - first)
            body = body._replace(
                normals=look("NORMAL", 3), uv=look("TEXCOORD", 2), vertex_colours=look("COLOR", 3)
            )
        bodies.append(body)
        first += len(each.rows)
    return bodies


def _attribute(
    mesh: _Mesh, primitive: _Primitive, triangles: Indices, semantic: str, width: int
) -> Array | None:
    """Return what the corners of triangles have of a semantic, (m, 3, columns); None if it is missing or broken."""
    at_vertex = mesh.at_vertices.get(semantic, ""), primitive.inputs["VERTEX"][1]
    url, column = primitive.inputs.get(semantic, at_vertex)
    if url not in mesh.known:
        mesh.known[url] = None
        with suppress(InvalidRobot, KeyError):
            mesh.known[url] = _rows(mesh.sources[url], mesh.who)
    rows, places = mesh.known[url], primitive.rows[triangles, column]
    if rows is None or rows.shape[1] < width or places.max(initial=0) >= len(rows):
        return None
    return np.asarray(rows[places][:, :, : 4 if semantic == "COLOR" else width])


def _listed(names: Collection[str]) -> str:
    return ", ".join(f"<{each}>" for each in sorted(names))
