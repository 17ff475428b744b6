"""Mesh files for tests, and how they are read."""

from __future__ import annotations

import io
import json
import struct
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from kinseek.meshes import collada, collada_geometry, glb, limits, obj, ply, stl
from kinseek.meshes.parts import mesh_parts
from robot_files import TURNING, link, robot, write

MOST = 2**16
"""Bytes of a file in most of these tests, so that what is too much is small."""


def small_limits(monkeypatch: pytest.MonkeyPatch) -> None:
    """Set limits as those of files of `MOST` bytes would be."""
    smaller = {"LINES": MOST // 16, "CORNERS": MOST // 5, "TAGS": MOST // 64}
    for name, most in smaller.items():
        for module in (limits, collada, collada_geometry, glb, obj, ply, stl):
            monkeypatch.setattr(module, f"MOST_{name}", most, raising=False)


def read(folder: Path, kind: str, content: str | bytes, most: int = MOST) -> list[Any]:
    """Bodies of a file with this content."""
    return mesh_parts(write(folder, f"a.{kind}", content), most)


TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"
DAE = """<?xml version="1.0"?>{doctype}
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1"><asset><up_axis>Z_UP</up_axis></asset>
<library_geometries><geometry id="g"><mesh><source id="s"><float_array id="f" count="9">0 0 0 1 0 0 0 1 0</float_array>
<technique_common><accessor source="#f" count="3" stride="3"><param name="X" type="float"/><param name="Y" type="float"/>
<param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#s"/></vertices>{shapes}</mesh></geometry></library_geometries>
<library_nodes>{nodes}</library_nodes>
<library_visual_scenes><visual_scene id="scene">{scene}</visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#scene"/></scene></COLLADA>"""
ONE = '<triangles count="1"><input semantic="VERTEX" source="#v" offset="0"/><p>0 1 2</p></triangles>'
INSTANCE = '<node id="n"><instance_geometry url="#g"/></node>'


def ply_header(*lines: str, encoding: str = "binary_little_endian") -> bytes:
    return "\n".join(["ply", f"format {encoding} 1.0", *lines, "end_header\n"]).encode()


def dae(shapes: str = ONE, nodes: str = "", scene: str = INSTANCE, doctype: str = "") -> bytes:
    return DAE.format(shapes=shapes, nodes=nodes, scene=scene, doctype=doctype).encode()


def dae_of(positions: str, shapes: str) -> str:
    """A file with other positions than those of `DAE`."""
    count = len(positions.split())
    text = dae(shapes).decode().replace('count="9">0 0 0 1 0 0 0 1 0<', f'count="{count}">{positions}<')
    return text.replace('count="3" s', f'count="{count // 3}" s')


def written_glb(data: bytes, **told: Any) -> bytes:
    text = json.dumps({"asset": {"version": "2.0"}, "buffers": [{"byteLength": len(data)}], **told}).encode()
    text += b" " * (-len(text) % 4)
    chunks = (
        struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(data), 0x004E4942) + data
    )
    return struct.pack("<III", 0x46546C67, 2, 12 + len(chunks)) + chunks


def glb_parts(corners: int = 3, view: int = 0) -> dict[str, Any]:
    """Description of a file of one body with as many corners, in a view of so many bytes."""
    return {
        "bufferViews": [{"buffer": 0, "byteLength": view or 12 * corners}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": corners, "type": "VEC3"}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
    }


def one_glb(
    count: int = 3, view: int = 0, repeat: int = 1, nodes: int = 1, corners: int = 3, **more: Any
) -> bytes:
    told = glb_parts(corners, view)
    told["accessors"][0]["count"] = count or corners
    told["meshes"] = [{"primitives": [{"attributes": {"POSITION": 0}, **more}] * repeat}]
    told |= {"nodes": [{"mesh": 0}] * nodes, "scenes": [{"nodes": [*range(nodes)]}]}
    return written_glb(np.resize(np.eye(3, dtype="<f4"), (corners, 3)).tobytes(), **told)


def noted_glb(notes: dict[str, Any], parts: int = 1, nodes: int = 1) -> bytes:
    """A file of triangles, with additions to the description of its mesh."""
    told = glb_parts()
    told["meshes"] = [{"primitives": told["meshes"][0]["primitives"] * parts, **notes}]
    told |= {"nodes": [{"mesh": 0}] * nodes, "scenes": [{"nodes": [*range(nodes)]}]}
    return written_glb(np.eye(3, dtype="<f4").tobytes(), **told)


def archive() -> bytes:
    held = io.BytesIO()
    with zipfile.ZipFile(held, "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("a.obj", f"{TRIANGLE}f 1 2 3\n")
    return held.getvalue()


def changed_glb(where: str, change: dict[str, Any]) -> bytes:
    """A file of one triangle, with a change to its first accessor, primitive, mesh or node, or to the whole."""
    told = glb_parts()
    (accessor,), (mesh,), (node,) = told["accessors"], told["meshes"], told["nodes"]
    part = mesh["primitives"][0]
    {"accessor": accessor, "part": part, "mesh": mesh, "node": node, "": told}[where].update(change)
    return written_glb(np.eye(3, dtype="<f4").tobytes(), **told)


def pictured_glb(size: tuple[int, int], kind: str = "PNG", mode: str = "1") -> tuple[bytes, dict[str, Any]]:
    """Numbers and description of a file with one triangle and one image."""
    held = io.BytesIO()
    pytest.importorskip("PIL.Image").new("RGB" if kind == "EPS" else mode, size).save(held, format=kind)
    corners, picture = np.eye(3, dtype="<f4").tobytes(), held.getvalue()
    told = glb_parts()
    told["bufferViews"].append({"buffer": 0, "byteOffset": 36, "byteLength": len(picture)})
    told["meshes"][0]["primitives"][0]["material"] = 0
    return corners + picture, told | {
        "images": [{"bufferView": 1, "mimeType": "image/png"}],
        "textures": [{"source": 0}],
        "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
    }


def robot_of(folder: Path, *geometries: str, tag: str = "visual") -> Path:
    """An arm of one joint with so many shapes."""
    shapes = "".join(f"<{tag}><geometry>{each}</geometry></{tag}>" for each in geometries)
    return write(folder, "arm.urdf", robot(link("a", shapes), TURNING, links="b"))
