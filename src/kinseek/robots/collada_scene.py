"""The scene of COLLADA files, and how large they are unpacked; trimesh reads them, with pycollada.

Nodes may have instances of geometries and of other nodes, any number of times. So this module adds up their sizes before
trimesh reads a file; `collada` says what is read of them.
"""

from __future__ import annotations

import io
import re
import zipfile
from typing import Any
from xml.parsers import expat

import numpy as np

from kinseek.errors import InvalidRobot

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
from .mesh_files import MOST_BODIES, MOST_CORNERS, MOST_SHARED, Size, drawn_corners
from .polygons import at_most

MOST_TAGS = 2**20
"""Most tags of a file."""


def measured(text: bytes) -> Size:
    """Return the size of the unpacked content of a file.

    Raises:
        InvalidRobot: It is too large, or the reader would ignore a part of it.
    """
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
    named = [f"{{*}}{each}" for each in ("node", "geometry", "material", "effect", "image")]
    at_most(sum(1 for _ in root.iter(*named)), MOST_BODIES, "nodes, geometries, materials and images")
    require_units(root)
    at_most(sum(map(shared_numbers, root.iter("{*}mesh"))), MOST_SHARED, "numbers that its bodies share")
    size = _unfolded(root)
    at_most(size.bodies, MOST_BODIES, "nodes and bodies")
    return size._replace(corners=drawn_corners(size.corners, text))


def _unfolded(root: Any) -> Size:
    """Check and count what all scenes show, with every instance counted; triangles are those of the scene that is shown."""
    geometries: dict[str | None, list[Any]] = {}
    nodes: dict[str | None, list[Any]] = {}
    for each in root.iter("{*}geometry"):
        geometries.setdefault(each.get("id"), []).append(each)
    for each in root.iter("{*}node"):
        nodes.setdefault(each.get("id"), []).append(each)
    known: dict[Any, Size | None] = {}

    def size(element: Any) -> Size:
        if element not in known:
            known[element] = None
            known[element] = unfolded(element)
        found = known[element]
        if found is None:
            raise InvalidRobot("a node is an instance of itself")
        return found

    def unfolded(element: Any) -> Size:
        if name_of(element) == "geometry":
            # Of its own bodies: a geometry may be in the <extra> of another one, which would count all below it again.
            corners = sum(count_words(each.text) for each in element.iterfind("{*}mesh/*/{*}p"))
            return Size(len(element.findall("{*}mesh/*")), corners, require_geometry(element))
        require_node(element)
        sizes = [Size(1, 0)]
        for each in element:
            if name_of(each) == "node":
                sizes.append(size(each))
            elif name_of(each) in ("instance_node", "instance_geometry"):
                among = nodes if name_of(each) == "instance_node" else geometries
                sizes.append(size(_instance_of(each, among)))
        return Size.of(sizes)

    urls = [each.get("url") for each in root.iterfind("{*}scene/{*}instance_visual_scene")]
    if len(urls) > 1:
        raise InvalidRobot(f"it shows {len(urls)} scenes, expected one")
    url = urls[0] if urls else None
    scenes = root.findall(".//{*}visual_scene")
    shown = [scene for scene in scenes if f"#{scene.get('id')}" == url]
    if len(shown) != 1:
        raise InvalidRobot(f"it shows the scene {url!r:.100}, expected one of its own")
    for each in shown[0]:  # Some readers read a scene as a node, with motions and bodies of its own.
        if name_of(each) not in ("node", "asset", "evaluate_scene", "extra"):
            raise InvalidRobot(f"its scene has <{name_of(each)}>, expected it in a <node>")
    try:
        held, seen = (
            Size.of([size(node) for scene in some for node in scene.iterfind("{*}node")])
            for some in (scenes, shown)
        )
        return held._replace(triangles=seen.triangles)
    except RecursionError:
        raise InvalidRobot("its nodes are nested too deep") from None


def _instance_of(element: Any, among: dict[str | None, list[Any]]) -> Any:
    """Return what an element of COLLADA is an instance of."""
    url = element.get("url") or ""
    # An empty one is also what the reader calls all geometries without an id.
    found = among.get(url[1:], []) if url.startswith("#") and url != "#" else []
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
