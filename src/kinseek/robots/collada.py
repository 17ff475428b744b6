"""What kinseek reads of COLLADA files; anything else that may change a shape is rejected.

The reader behind trimesh skips bodies, and motions of nodes, that it does not understand or that are broken, and raises no
error.
"""

from __future__ import annotations

import re
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinseek.errors import InvalidRobot
from kinseek.support.lazy import Lazy, lazy

from .polygons import triangulated
from .stl import NUMBER

_NUMBERS = {"translate": 3, "rotate": 4, "scale": 3, "matrix": 16}
"""Elements that move a node, and how many numbers each has."""
_IN_NODES = {
    *_NUMBERS,
    *("node", "instance_node", "instance_geometry", "instance_camera", "instance_light", "asset", "extra"),
}
"""Elements of nodes that are read, or that have no shape."""
_UNIT = 1e-4
"""How much the length of an axis may differ from 1, for rounding."""
_TRIANGLES = ("triangles", "tristrips", "trifans", "polylist", "polygons")
"""Elements of meshes that become bodies."""
_IN_MESHES = {*_TRIANGLES, "lines", "source", "vertices", "extra"}
"""Elements of meshes that are read, or that have no shape."""


def name_of(element: Any) -> str:
    """Return the name of an element, without its namespace."""
    return str(element.tag).rpartition("}")[2]


def count_words(text: str | None) -> int:
    """Return the number of words, without creating them."""
    blank = np.frombuffer(f" {text or ''}".encode(), dtype=np.uint8) <= ord(" ")
    return int((blank[:-1] & ~blank[1:]).sum())


def shared_numbers(mesh: Any) -> int:
    """Return how many numbers of sources all bodies of a mesh have together, if each has all of them."""
    bodies = sum(name_of(each) in _TRIANGLES for each in mesh.iterchildren("*"))
    return bodies * sum(count_words(each.text) for each in mesh.iterfind("{*}source/{*}float_array"))


def require_units(root: Any) -> None:
    """Check that the file has one unit, a length.

    Raises:
        InvalidRobot: It is not a number above 0, or a part of the file has another one.
    """
    if (assets := len(root.findall("{*}asset"))) > 1:
        raise InvalidRobot(f"it has {assets} <asset> elements, expected one: only the first one is read")
    units = [each.get("meter", "1") for each in root.iterfind("{*}asset/{*}unit")]
    whole = _number(units[0]) if units else 1.0
    if not 0 < whole < np.inf:
        raise InvalidRobot(f"its unit is {units[0]!r:.100}, expected a number of metres above 0")
    for each in root.iter("{*}unit"):
        if _number(each.get("meter", "1")) != whole:
            raise InvalidRobot(
                f"a part of it has a unit of {each.get('meter')!r:.100} m, expected {whole:g} m as in the whole file; "
                "write it with one unit"
            )


def require_one_namespace(root: Any) -> None:
    """Check that all elements outside of extensions are of the namespace of the root.

    Raises:
        InvalidRobot: They are not; the reader ignores others, and readers that know no namespaces do not.
    """
    own, left = root.tag.rpartition("}")[0], [root]
    while left:
        each = left.pop()
        if each.tag.rpartition("}")[0] != own:
            raise InvalidRobot(f"it has a <{name_of(each)}> of another namespace than its root")
        if name_of(each) not in ("extra", "technique"):
            left.extend(each.iterchildren("*"))


def require_numbers_alone(root: Any) -> None:
    """Check that elements of numbers have nothing else in them.

    Raises:
        InvalidRobot: They have; the reader ignores what follows a comment.
    """
    for each in root.iter(*(f"{{*}}{name}" for name in ("p", "vcount", "float_array", *_NUMBERS))):
        if len(each):
            raise InvalidRobot(
                f"it has a <{name_of(each)}> with a comment or an element in it, expected numbers alone"
            )


def require_node(node: Any) -> None:
    """Check that all elements of a node are read.

    Raises:
        InvalidRobot: One of them is not, or does not have as many numbers as it needs.
    """
    who = f"the node {node.get('id') or node.get('name')!r:.100}"
    for each in node:
        name = name_of(each)
        if name == "instance_controller":
            raise InvalidRobot(
                f"{who} has an <instance_controller>, a body that is skinned or morphed; expected its final shape: "
                "apply it, and write an <instance_geometry>"
            )
        if name not in _IN_NODES:
            raise InvalidRobot(f"{who} has a <{name}>, expected only {_listed(_IN_NODES)}")
        if name not in _NUMBERS:
            continue
        # Of bytes: only the blanks of ASCII divide numbers for the reader.
        numbers = np.array([_number(word.decode()) for word in (each.text or "").encode().split()])
        if len(numbers) != _NUMBERS[name] or not np.isfinite(numbers).all():
            raise InvalidRobot(
                f"{who} has a <{name}> of {each.text!r:.100}, expected {_NUMBERS[name]} finite numbers"
            )
        # The reader takes the axis as it is, and turns and stretches for one that is longer.
        if name == "rotate" and numbers[3] and abs(np.linalg.norm(numbers[:3]) - 1) > _UNIT:
            raise InvalidRobot(
                f"{who} has a <rotate> about {numbers[:3].tolist()}, expected an axis of length 1"
            )
        if name == "matrix" and numbers[12:].tolist() != [0, 0, 0, 1]:
            raise InvalidRobot(
                f"{who} has a <matrix> whose last row is {numbers[12:].tolist()}, expected 0, 0, 0, 1"
            )


def require_geometry(geometry: Any) -> int:
    """Check that all triangles of a geometry are read.

    Returns:
        Number of triangles that the reader makes of it.

    Raises:
        InvalidRobot: It has elements that are not read, or refers to what is not there.
    """
    who = f"the geometry {geometry.get('id')!r:.100}"
    mesh = geometry.find("{*}mesh")
    if mesh is None:
        kinds = ", ".join(f"<{name_of(each)}>" for each in geometry) or "nothing"
        raise InvalidRobot(f"{who} has {kinds}, expected a <mesh>")
    for each in geometry:
        if each is not mesh and name_of(each) not in ("asset", "extra"):
            raise InvalidRobot(
                f"{who} has a <{name_of(each)}> beside its first <mesh>, expected one <mesh> alone"
            )
    for each in mesh:
        if name_of(each) not in _IN_MESHES:
            raise InvalidRobot(f"{who} has a <{name_of(each)}>, expected only {_listed(_IN_MESHES)}")
    sources: dict[str, _Source] = {}
    for each in mesh.iterfind("{*}source"):
        if (url := f"#{each.get('id')}") in sources:
            raise InvalidRobot(f"{who} has two sources {each.get('id')!r:.100}, expected one")
        sources[url] = _Source(each)
    if (several := len(mesh.findall("{*}vertices"))) > 1:
        raise InvalidRobot(f"{who} has {several} <vertices>, expected one")
    for vertices in mesh.iterfind("{*}vertices"):
        for each in vertices.iterfind("{*}input"):
            source = _source_of(each, sources, who)
            if each.get("semantic") == "VERTEX":  # The reader takes this for the positions.
                raise InvalidRobot(f"{who} has an <input> of VERTEX in <vertices>, expected POSITION")
            if each.get("semantic") == "POSITION" and f"#{vertices.get('id')}" in sources:
                raise InvalidRobot(f"{who} has two <input> of POSITION, expected one")
            if each.get("semantic") == "POSITION":
                _require_positions(source, who)
                sources[f"#{vertices.get('id')}"] = _Source(source.element, is_of_vertices=True)
    return sum(_triangles(part, sources, who) for part in mesh if name_of(part) in _TRIANGLES)


class _Source(Lazy):
    """An array of a mesh. Each of its polygons may refer to it, so what is read of it is read once."""

    def __init__(self, element: Any, is_of_vertices: bool = False) -> None:
        self.element, self.floats = element, element.find("{*}float_array")
        self.is_of_vertices = is_of_vertices

    @lazy
    def rows(self) -> int | None:
        """Number of rows; None if it has no floats."""
        columns = len(self.element.findall("{*}technique_common/{*}accessor/{*}param"))
        return None if self.floats is None or not columns else count_words(self.floats.text) // columns

    @lazy
    def positions(self) -> NDArray[np.float64]:
        """Rows of three floats, (k, 3)."""
        numbers = np.fromstring(self.floats.text, sep=" ")
        return numbers[: len(numbers) // 3 * 3].reshape(-1, 3)


def _triangles(part: Any, sources: dict[str, _Source], who: str) -> int:
    """Check a primitive, and return the number of its triangles."""
    name = name_of(part)
    for each in part:
        if name_of(each) not in ("input", "p", "vcount", "extra"):  # Such as <ph>, a polygon with holes.
            raise InvalidRobot(
                f"{who} has a <{name_of(each)}> in <{name}>, expected only polygons without holes, <p>"
            )
    inputs = part.findall("{*}input")
    found = [(_offset(each, who), _source_of(each, sources, who)) for each in inputs]
    if (count := sum(each.get("semantic") == "VERTEX" for each in inputs)) != 1:
        raise InvalidRobot(f"{who} has a <{name}> with {count} <input> of VERTEX, expected one")
    for each, (_, source) in zip(inputs, found, strict=True):
        # The reader ignores other inputs from <vertices>, with their offsets, and the stride and offset of other positions.
        if (each.get("semantic") == "VERTEX") != source.is_of_vertices:
            raise InvalidRobot(
                f"{who} has an <input> of {each.get('semantic')} from {each.get('source')!r:.100}, expected VERTEX, and "
                "nothing else, from its <vertices>"
            )
    parts = part.findall("{*}p")
    if not parts and name != "polygons":
        raise InvalidRobot(f"{who} has a <{name}> without <p>")
    if name == "triangles" and len(parts) > 1:
        raise InvalidRobot(f"{who} has <triangles> with {len(parts)} <p>, expected one")
    if name == "polylist" and (len(parts), len(part.findall("{*}vcount"))) != (1, 1):
        raise InvalidRobot(f"{who} has a <polylist>, expected it to have one <vcount> and one <p>")
    width = max(offset for offset, _ in found) + 1
    place, positions = next(
        one for one, each in zip(found, inputs, strict=True) if each.get("semantic") == "VERTEX"
    )
    triangles, corners_of_all, sizes_of_all = 0, [], []
    for each in parts:
        indices = _indices(each, who)
        if len(indices) % (3 * width if name == "triangles" else width):
            raise InvalidRobot(f"{who} has {len(indices)} numbers in a <p> of <{name}>: some are missing")
        corners = len(indices) // width
        if name == "polylist":
            counts = _indices(part.find("{*}vcount"), who)
            if counts.sum() != corners:
                raise InvalidRobot(
                    f"{who} has polygons of {counts.sum():.0f} corners together, but <p> has {corners}"
                )
            triangles += int(np.maximum(counts - 2, 0).sum())
            sizes = counts.astype(np.int64)
        else:
            triangles += corners // 3 if name == "triangles" else max(corners - 2, 0)
            sizes = np.array([corners] if name == "polygons" else [], dtype=np.int64)
        for offset, source in found:
            largest = indices[offset::width].max(initial=-1)
            if source.rows is not None and largest >= source.rows:
                raise InvalidRobot(
                    f"{who} has the index {largest:.0f} in a <{name}>, but its source "
                    f"{source.element.get('id')!r:.100} has {source.rows} rows"
                )
        corners_of_all.append(indices[place::width].astype(np.int64))
        sizes_of_all.append(sizes)
    if parts:
        _require_fans(
            positions, np.concatenate(corners_of_all), np.concatenate(sizes_of_all), f"{who} has a <{name}>"
        )
    return triangles


def _require_fans(source: _Source, corners: NDArray[np.int64], sizes: NDArray[np.int64], what: str) -> None:
    """Check that the diagonals of polygons from their first corner lie inside: the reader divides all polygons by these.

    Args:
        source: The positions.
        corners: Vertices of all polygons, one after the other.
        sizes: Number of corners of each polygon.
        what: What has the polygons, for errors.

    Raises:
        InvalidRobot: A polygon has other diagonals, or crosses itself.
    """
    large = sizes > 3
    if source.floats is None or not large.any():
        return
    corners, sizes = corners[np.repeat(large, sizes)], sizes[large]
    triangles, owners = triangulated(source.positions, corners, sizes, lambda number: what)
    wrong = np.flatnonzero(triangles[:, 0] != (np.cumsum(sizes) - sizes)[owners])
    if len(wrong):
        raise InvalidRobot(
            f"{what} with a polygon of {sizes[owners[wrong[0]]]} corners, not all of which its first corner sees; write it "
            "as triangles"
        )


def _source_of(element: Any, sources: dict[str, _Source], who: str) -> _Source:
    url = element.get("source")
    if url not in sources:
        raise InvalidRobot(
            f"{who} has an <input> of {element.get('semantic')} from {url!r:.100}, which is not in its mesh"
        )
    return sources[url]


def _offset(element: Any, who: str) -> int:
    text = element.get("offset", "")
    if re.fullmatch("[0-9]{1,3}", text) is None:
        raise InvalidRobot(f"{who} has an <input> with the offset {text!r:.100}, expected a whole number")
    return int(text)


def _indices(element: Any, who: str) -> NDArray[np.float64]:
    if re.fullmatch(r"[0-9 \t\r\n]*", element.text or "") is None:
        raise InvalidRobot(
            f"{who} has a <{name_of(element)}> whose words are not all whole numbers from 0 on"
        )
    return np.fromstring(element.text, sep=" ") if count_words(element.text) else np.zeros(0)


def _require_positions(source: _Source, who: str) -> None:
    """Check that positions are rows of three numbers, without any between them: the reader ignores stride and offset."""
    floats, accessor = source.floats, source.element.find("{*}technique_common/{*}accessor")
    if floats is None or accessor is None:
        raise InvalidRobot(f"{who} has positions without a <float_array> and an <accessor>")
    if re.fullmatch(r"[0-9eE+\-. \t\r\n]*", floats.text or "") is None:
        raise InvalidRobot(f"{who} has positions that are not all finite numbers")
    params = [each.get("name") for each in accessor.findall("{*}param")]
    got = len(params), accessor.get("stride", "1"), accessor.get("offset", "0")
    if got != (3, "3", "0"):
        raise InvalidRobot(
            "{} has positions with {} params, stride {} and offset {}; expected 3, 3 and 0".format(who, *got)
        )
    if sorted(map(str, params)) == ["X", "Y", "Z"] != params:
        raise InvalidRobot(f"{who} has positions with the params {', '.join(params)}; expected X, Y, Z")
    if accessor.get("source") != f"#{floats.get('id')}":
        raise InvalidRobot(
            f"{who} has positions from {accessor.get('source')!r:.100}, expected the first <float_array> of their source"
        )


def _number(text: str) -> float:
    """Return a number; NaN for what Python alone reads as one, such as ``1_000`` or other digits than those of ASCII."""
    return float(text) if re.fullmatch(NUMBER, text.strip(" \t\r\n").encode()) else float("nan")


def _listed(names: set[str]) -> str:
    return ", ".join(f"<{each}>" for each in sorted(names))
