"""Files of meshes: the kinds that are read, and no more bytes of memory than a mesh of that size may have."""

from __future__ import annotations

import contextlib
import io
import json
import re
import struct
import subprocess
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import kinseek
from kinseek import InvalidRobot
from kinseek.robots import collada_scene, glb, mesh_files, obj, ply, stl
from kinseek.robots.mesh_files import ENDINGS, LEAST_BODIES, MOST_BODIES, Beside, Budget
from kinseek.robots.meshes import CHECKS, mesh_parts
from kinseek.robots.obj import MOST_GROUPS

trimesh = pytest.importorskip("trimesh")

MOST = 2**16
"""Bytes of a file in most of these tests, so that what is too much is small."""


@pytest.fixture(autouse=True)
def _small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Limits as those of files of that size would be."""
    limits = {
        "LINES": MOST // 16,
        "CORNERS": MOST // 5,
        "TAGS": MOST // 64,
        "SHARED": 2 * MOST,
    }
    for name, most in limits.items():
        for module in (mesh_files, collada_scene, glb, obj, ply, stl):
            monkeypatch.setattr(module, f"MOST_{name}", most, raising=False)


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


PAINTED = """<library_images><image id="i"><init_from>a.png</init_from></image></library_images>
<library_effects><effect id="e"><profile_COMMON>
<newparam sid="su"><surface type="2D"><init_from>i</init_from></surface></newparam>
<newparam sid="sa"><sampler2D><source>su</source></sampler2D></newparam>
<technique sid="c"><phong><diffuse><texture texture="sa" texcoord="UV"/></diffuse></phong></technique>
</profile_COMMON></effect></library_effects>
<library_materials><material id="m"><instance_effect url="#e"/></material></library_materials>"""


def ply_header(*lines: str, encoding: str = "binary_little_endian") -> bytes:
    return "\n".join(["ply", f"format {encoding} 1.0", *lines, "end_header\n"]).encode()


WORDS = (
    "# the mesh of a robot link, which a mainframe wrote in plain words so that its encoding is recognised"
)
SOLID = "solid a\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendsolid\n"


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


def one_glb(
    count: int = 3, view: int = 0, repeat: int = 1, nodes: int = 1, corners: int = 3, **more: Any
) -> bytes:
    data = np.resize(np.eye(3, dtype="<f4"), (corners, 3)).tobytes()
    return written_glb(
        data,
        bufferViews=[{"buffer": 0, "byteLength": view or len(data)}],
        accessors=[{"bufferView": 0, "componentType": 5126, "count": count or corners, "type": "VEC3"}],
        meshes=[{"primitives": [{"attributes": {"POSITION": 0}, **more}] * repeat}],
        nodes=[{"mesh": 0} for _ in range(nodes)],
        scenes=[{"nodes": [*range(nodes)]}],
    )


def archive() -> bytes:
    held = io.BytesIO()
    with zipfile.ZipFile(held, "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("a.obj", f"{TRIANGLE}f 1 2 3\n")
    return held.getvalue()


def chained(links: int) -> str:
    """Nodes, each with two instances of the next: twice as many bodies with every one."""
    inner = [f'<instance_node url="#c{i + 1}"/>' * 2 for i in range(links)] + [
        '<instance_geometry url="#g"/>'
    ]
    return "".join(f'<node id="c{i}">{each}</node>' for i, each in enumerate(inner))


SOUND: dict[str, Callable[[], bytes]] = {
    "a.stl": lambda: trimesh.creation.box((1, 1, 1)).export(file_type="stl"),
    "text.STL": lambda: trimesh.creation.box((1, 1, 1)).export(file_type="stl_ascii").encode(),
    "a.obj": f"{TRIANGLE}f 1 2 3\n".encode,
    "a.ply": lambda: trimesh.creation.box((1, 1, 1)).export(file_type="ply"),
    "text.ply": lambda: trimesh.creation.box((1, 1, 1)).export(file_type="ply", encoding="ascii"),
    "a.glb": one_glb,
    "instances.glb": lambda: one_glb(nodes=3),
    "a.dae": dae,
    "instances.dae": lambda: dae(nodes=chained(3), scene='<node id="n"><instance_node url="#c0"/></node>'),
    "polygons.dae": lambda: dae(
        '<polylist count="1"><input semantic="VERTEX" source="#v" offset="0"/><vcount>3</vcount><p>0 1 2</p></polylist>'
    ),
}


@pytest.mark.parametrize("name", SOUND)
def test_sound_files_are_read(name: str, tmp_path: Path) -> None:
    if name.endswith("dae"):
        pytest.importorskip("collada")
    (tmp_path / name).write_bytes(SOUND[name]())
    bodies = {"instances.glb": 3, "instances.dae": 8}.get(name, 1)
    assert len(mesh_parts(tmp_path / name, MOST)) == bodies


@pytest.mark.parametrize(
    "name", ["a.zip", "a.tar.gz", "a.bz2", "a.zae", "a.3mf", "a.gltf", "a.xyz", "a", "a.stl.zip"]
)
def test_other_kinds_are_refused(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(archive())
    with pytest.raises(InvalidRobot, match=r"must end in \.dae, \.glb, \.obj, \.ply or \.stl"):
        mesh_parts(tmp_path / name)


def test_no_kind_that_is_read_is_an_archive() -> None:
    from trimesh.exchange.load import compressed_loaders, mesh_loaders

    assert CHECKS.keys() <= mesh_loaders.keys()
    assert not set(ENDINGS) & compressed_loaders.keys()


BOMBS: dict[str, tuple[Callable[[], bytes], str]] = {
    "lines.obj": (lambda: TRIANGLE.encode() + b"f\n" * 8000, "lines"),
    "polygon.obj": (lambda: TRIANGLE.encode() + b"f" + b" 1" * 2**15, "bytes in a line"),
    "polygon_in_lines.obj": (
        lambda: TRIANGLE.encode() + b"f" + (b" 1" * 16 + b"\\\r\n") * 2500,
        "bytes in a line",
    ),
    "lines.ply": (
        lambda: b"ply\nformat ascii 1.0\nelement vertex 8000\nproperty float x\nend_header\n" + b"\n" * 8000,
        "lines",
    ),
    "header.ply": (lambda: ply_header(*(f"element {i} 0" for i in range(1000))), "within 1,000 lines"),
    "no_end.ply": (lambda: ply_header("comment")[:-12], "must end with end_header"),
    "long_line.ply": (lambda: ply_header("comment" + " " * 2**16 + "element a 0"), "bytes in a line"),
    "lists.ply": (
        lambda: ply_header("element a 1", *(f"property list uchar uchar p{i}" for i in range(300))),
        "properties in its header",
    ),
    "values.ply": (
        lambda: ply_header(
            "element vertex 200000",
            *(f"property int {name}" for name in ["x", "y", "z", *(f"p{i}" for i in range(97))]),
            "element face 1",
            "property list uchar int vertex_index",
            encoding="ascii",
        ),
        "values, expected",
    ),
    "list_of_vertices.ply": (
        lambda: ply_header("element vertex 1", "property list uint uchar x", "element face 0"),
        "vertices have lists",
    ),
    "negative.ply": (lambda: ply_header("element a -5", encoding="ascii"), "element a -5"),
    "mainframe.obj": (
        lambda: f"{WORDS * 12}\n{TRIANGLE * 2000}f 1 2 3\n".encode("cp037"),
        "bytes in a line",
    ),
    "mainframe.stl": (
        lambda: f"solid {WORDS * 12}\nendsolid\n{SOLID * 9}".encode("cp037"),
        "expected text that begins with 'solid' or, for the 2,728,626,496 triangles that it declares, 136,431,324,884 bytes",
    ),
    "edges.ply": (
        lambda: b"ply\nformat binary_little_endian 1.0\nelement edge 9\nproperty int vertex1\nend_header\n",
        "it has the elements .'edge'., expected vertex and face",
    ),
    "corners.stl": (lambda: b"solid a\n" + b"vertex 0 0 0\n" * 4500 + b"endsolid", "vertices and normals"),
    "materials.obj": (
        lambda: TRIANGLE.encode() + b"".join(b"usemtl %d\n" % i for i in range(MOST_GROUPS + 1)),
        " materials, expected",
    ),
    "continued.obj": (
        lambda: TRIANGLE.encode() + b"".join(b"usemtl \\\n%d\n" % i for i in range(MOST_GROUPS + 1)),
        " materials, expected",
    ),
    "accessor.glb": (lambda: one_glb(count=10**9), "bytes in its accessors"),
    "view.glb": (lambda: one_glb(view=10**9), "bytes in its views"),
    "negative.glb": (lambda: one_glb(count=-5), "a count is -5"),
    "primitives.glb": (lambda: one_glb(count=0, corners=300, repeat=60), "bytes in its bodies"),
    "instances.glb": (lambda: one_glb(count=0, corners=300, nodes=60), "bytes in its bodies"),
    "corners.glb": (lambda: one_glb(count=0, corners=14100), "corners of triangles"),
    "counted_four_times.glb": (
        lambda: one_glb(count=0, corners=119, nodes=91),
        "corners of triangles, with those of instances",
    ),
    "strip.glb": (lambda: one_glb(count=0, corners=1500, nodes=3, mode=5), "corners of triangles"),
    "many.glb": (lambda: one_glb(nodes=MOST_BODIES + 1), "nodes, bodies and images"),
    "draco.glb": (lambda: one_glb(extensions={"KHR_draco_mesh_compression": {}}), "Draco"),
    "archive.dae": (archive, "archive"),
    "appended.dae": (lambda: dae() + archive(), "archive"),
    "entities.dae": (
        lambda: dae(doctype='<!DOCTYPE c [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;">]>'),
        "document type",
    ),
    "wide.dae": (lambda: dae(doctype="<!DOCTYPE c>").decode().encode("utf-16"), "document type"),
    "polygon.dae": (
        lambda: dae(
            '<polylist count="1"><input semantic="VERTEX" source="#v" offset="0"/><vcount>2000000000</vcount>'
            "<p>0 1 2</p></polylist>"
        ),
        "corners of polygons",
    ),
    "doubled.dae": (
        lambda: dae(nodes=chained(40), scene='<node id="n"><instance_node url="#c0"/></node>'),
        "nodes and bodies",
    ),
    "itself.dae": (
        lambda: dae(scene='<node id="n"><instance_node url="#n"/><instance_node url="#n"/></node>'),
        "instance of itself",
    ),
    "large.dae": (
        lambda: dae(ONE.replace("0 1 2", "0 1 2 " * 1000), scene=INSTANCE.replace("/>", "/>" * 1) * 8),
        "corners of triangles",
    ),
    "deep.dae": (lambda: dae(scene="<node>" * 1900 + "</node>" * 1900), "nested|tags|cannot be read"),
    "columns.dae": (
        lambda: dae().replace(b'<param name="X"', b"<param/>" * 2 + b'<param name="X"'),
        "columns in a source",
    ),
    "tags.dae": (lambda: dae(scene="<x/>" * 3000), "tags"),
}


LONG = (
    "long_line.ply",
    "materials.obj",
    "many.glb",
    "polygon.obj",
    "polygon_in_lines.obj",
    "corners.glb",
)
"""Those of more bytes."""


@pytest.mark.parametrize("name", BOMBS)
def test_what_would_grow_is_refused(name: str, tmp_path: Path) -> None:
    if name.endswith("dae"):
        pytest.importorskip("collada")
    make, why = BOMBS[name]
    (tmp_path / name).write_bytes(make())
    most = 2**20 if name in LONG else MOST
    with pytest.raises(InvalidRobot, match=why) as caught:
        mesh_parts(tmp_path / name, most)
    assert name in str(caught.value)


SHOWN = dae(
    scene=INSTANCE + '<node id="m"><translate>2 0 0</translate><instance_geometry url="#g"/></node>'
).decode()
"""COLLADA with two bodies."""


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        (
            '<instance_geometry url="#g"/></node><node',
            '<instance_controller url="#c"/></node><node',
            "'n' has an <instance_con",
        ),
        (
            'url="#g"/></node></v',
            'url="#h"/></node></v',
            "<instance_geometry> of '#h', of which it has 0; expected 1",
        ),
        (
            'url="#g"/></node></v',
            'url="b.dae#g"/></node></v',
            "<instance_geometry> of 'b.dae#g', of which it has 0",
        ),
        (
            "</node></v",
            '<instance_node url="b.dae#x"/></node></v',
            "<instance_node> of 'b.dae#x', of which it has 0",
        ),
        (
            '<instance_geometry url="#g"/></node></v',
            '<instance_node url="#n"/></node><node id="n"/></v',
            "it has 2",
        ),
        ("<translate>2 0 0</translate>", "<skew>80 0 1 0 1 0 0</skew>", "the node 'm' has a <skew>"),
        (
            "translate>2 0 0</translate",
            "lookat>2 0 0 2 0 -1 0 1 0</lookat",
            "the node 'm' has a <lookat>, expected only",
        ),
        (
            "<translate>2 0 0<",
            "<translate>2 0<",
            "the node 'm' has a <translate> of '2 0', expected 3 finite",
        ),
        (
            "<translate>2 0 0<",
            "<translate>2 0 x<",
            "the node 'm' has a <translate> of '2 0 x', expected 3 finite",
        ),
        (
            "translate>2 0 0</translate",
            f"matrix>{'1 ' * 16}</matrix",
            r"last row is \[1.0, 1.0, 1.0, 1.0\], expected 0, 0",
        ),
        ("mesh>", "convex_mesh>", "the geometry 'g' has <convex_mesh>, expected a <mesh>"),
        ("triangles", "linestrips", "the geometry 'g' has a <linestrips>"),
        ("triangles", "polylist", "expected it to have one <vcount> and one <p>"),
        (
            "<p>0 1 2</p></triangles>",
            "<vcount>3 3</vcount><p>0 1 2</p></polylist>",
            "6 corners together, but <p> has 3",
        ),
        ("<p>0 1 2</p></triangles>", "<ph><p>0 1 2</p></ph></polygons>", "a <ph> in <polygons>"),
        ("<p>0 1 2</p>", "", "a <triangles> without <p>"),
        ("<p>0 1 2</p>", "<p>0 1</p>", "2 numbers in a <p> of <triangles>: some are missing"),
        ("<p>0 1 2</p>", "<p>0 1 3</p>", "the index 3 in a <triangles>, but its source 's' has 3 rows"),
        ("<p>0 1 2</p>", "<p>0 1 -1</p>", "words are not all whole numbers from 0 on"),
        (
            'offset="0"/><p>',
            'offset="0"/><input semantic="NORMAL" source="#gone" offset="0"/><p>',
            "of NORMAL from '#gone'",
        ),
        ('semantic="VERTEX"', 'semantic="NORMAL"', "without an <input> of VERTEX"),
        (
            '<input semantic="POSITION"',
            '<input semantic="POSITION" source="#s"/><input semantic="POSITION"',
            "two <input> of POSITION, expected one",
        ),
        ("<vertices", '<vertices id="w"/><vertices', "has 2 <vertices>, expected one"),
        ("<vertices", '<source id="s"/><vertices', "has two sources 's', expected one"),
        ("<asset>", "<asset/><asset>", "2 <asset> elements, expected one"),
        (
            "<translate>",
            '<translate xmlns="u">',
            "a <translate> of another namespace than its root",
        ),
        ("<mesh>", '<x:mesh xmlns:x="u"/><mesh>', "a <mesh> of another namespace than its root"),
        ('offset="0"', 'offset="x"', "the offset 'x', expected a whole number"),
        ('source="#s"', 'source="#t"', "an <input> of POSITION from '#t', which is not in its mesh"),
        ('stride="3"', 'stride="4"', "3 params, stride 4 and offset 0; expected 3, 3 and 0"),
        (
            '<param name="X" type="float"/><param name="Y" type="float"/>\n<param name="Z"',
            '<param name="Z" type="float"/><param name="Y" type="float"/>\n<param name="X"',
            "the params Z, Y, X; expected X, Y, Z",
        ),
        (
            'accessor source="#f"',
            'accessor source="#h"',
            "positions from '#h', expected the first <float_array>",
        ),
        ("0 0 0 1 0 0 0 1 0", "0 0 0 nan 0 0 0 1 0", "positions that are not all finite numbers"),
        (
            '<geometry id="g">',
            '<geometry id="g"><asset><unit meter="10"/></asset>',
            "a unit of '10' m, expected 1 m",
        ),
        ("<up_axis>", '<unit meter="-1"/><up_axis>', "its unit is '-1', expected a number of metres above 0"),
        (
            'visual_scene url="#scene"',
            'visual_scene url="#other"',
            "the scene '#other', expected one of its own",
        ),
        (
            '<instance_geometry url="#g"/></node></v',
            '<instance_geometry url="#g"><bind_material><technique_common><instance_material symbol="a" target="#gone"/>'
            "</technique_common></bind_material></instance_geometry></node></v",
            "2 triangles, of which 1 can be read. In COLLADA, look for materials that are missing",
        ),
    ],
)
def test_what_the_reader_of_collada_would_pass_over_is_refused(
    old: str, new: str, why: str, tmp_path: Path
) -> None:
    """Bodies were left out, so that an arm was free inside of them."""
    pytest.importorskip("collada")
    assert old in SHOWN
    text = SHOWN.replace(old, new)
    for name in ("polylist", "polygons"):
        if f"</{name}>" in new:
            text = text.replace("<triangles", f"<{name}")
    (tmp_path / "a.dae").write_text(text)
    with pytest.raises(InvalidRobot, match=why):
        mesh_parts(tmp_path / "a.dae")


L_SHAPED = "0 0 0 2 0 0 2 1 0 1 1 0 1 2 0 0 2 0"


@pytest.mark.parametrize("kind", ["polylist", "polygons"])
@pytest.mark.parametrize("first", range(6))
def test_no_polygon_of_collada_is_filled_beyond_its_sides(first: int, kind: str, tmp_path: Path) -> None:
    """The reader divides each polygon by the diagonals from its first corner, and filled the notch of an L."""
    pytest.importorskip("collada")
    corners = " ".join(str((first + i) % 6) for i in range(6))
    counts = "<vcount>6</vcount>" if kind == "polylist" else ""
    text = dae_of(L_SHAPED, ONE.replace("triangles", kind).replace("<p>0 1 2", f"{counts}<p>{corners}"))
    (tmp_path / "a.dae").write_text(text)
    if first in (0, 3):  # These corners see all others.
        assert sum(part.area for part in mesh_parts(tmp_path / "a.dae")) == pytest.approx(3)
        return
    with pytest.raises(
        InvalidRobot, match=f"has a <{kind}> with a polygon of 6 corners, not all of which its first"
    ):
        mesh_parts(tmp_path / "a.dae")


def test_a_polygon_of_collada_that_crosses_itself_is_refused(tmp_path: Path) -> None:
    pytest.importorskip("collada")
    text = dae_of("0 0 0 1 0 0 0 1 0 1 1 0", ONE.replace("triangles", "polygons").replace("0 1 2", "0 3 1 2"))
    (tmp_path / "a.dae").write_text(text)
    with pytest.raises(InvalidRobot, match="a polygon of 4 corners crosses itself"):
        mesh_parts(tmp_path / "a.dae")


def test_the_positions_of_collada_are_read_once_for_all_polygons(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They were read for each polygon: 2,000 squares took 1.6 s, and four times as many sixteen times as long."""
    pytest.importorskip("collada")
    squares, read = range(50), list[int]()
    own = np.fromstring

    def counted(text: str, *given: Any, **options: Any) -> Any:
        read.append(len(text))
        return own(text, *given, **options)

    monkeypatch.setattr("kinseek.robots.collada.np.fromstring", counted)
    positions = " ".join(f"{i} 0 0 {i} 1 0" for i in range(51))
    corners = "".join(f"<p>{2 * i} {2 * i + 2} {2 * i + 3} {2 * i + 1}</p>" for i in squares)
    (tmp_path / "a.dae").write_text(
        dae_of(positions, ONE.replace("triangles", "polygons").replace("<p>0 1 2</p>", corners))
    )
    assert sum(part.area for part in mesh_parts(tmp_path / "a.dae")) == pytest.approx(50)
    assert read.count(len(positions)) <= 2  # Once by the checks, and perhaps by the reader.


def test_a_body_of_collada_may_have_the_name_of_the_root(tmp_path: Path) -> None:
    """trimesh put a body named "world" at the origin, wherever its nodes are."""
    pytest.importorskip("collada")
    text = SHOWN.replace('id="g"', 'id="world"').replace("#g", "#world")
    text = text.replace('<node id="n">', '<node id="n"><translate>0 5 0</translate>')
    (tmp_path / "a.dae").write_text(text)
    bounds = [part.bounds.tolist() for part in mesh_parts(tmp_path / "a.dae")]
    assert bounds == [[[0, 5, 0], [1, 6, 0]], [[2, 0, 0], [3, 1, 0]]]


def test_a_scale_next_to_1_is_applied(tmp_path: Path) -> None:
    """trimesh replaced a transform within 1e-5 of a motion by this motion."""
    pytest.importorskip("collada")
    (tmp_path / "a.dae").write_text(
        SHOWN.replace("<translate>2 0 0</translate>", "<scale>1.000004 1 1</scale>")
    )
    assert mesh_parts(tmp_path / "a.dae")[1].extents[0] == pytest.approx(1.000004, abs=1e-7)


def test_collada_is_read_with_all_that_has_no_shape(tmp_path: Path) -> None:
    pytest.importorskip("collada")
    text = SHOWN.replace("<instance_geometry", '<instance_light url="#gone"/><extra/><instance_geometry', 1)
    text = text.replace("<up_axis>Z_UP", '<unit meter="0.5"/><up_axis>Y_UP')
    text = text.replace(
        "</mesh>",
        '<triangles count="0"><input semantic="VERTEX" source="#v" offset="0"/><p/></triangles></mesh>',
    )
    (tmp_path / "a.dae").write_text(text)
    parts = mesh_parts(tmp_path / "a.dae")
    assert [part.bounds.tolist() for part in parts] == [
        [[0, 0, 0], [0.5, 0.5, 0]],
        [[1, 0, 0], [1.5, 0.5, 0]],
    ]


def changed_glb(where: str, change: dict[str, Any]) -> bytes:
    """A file of one triangle, with a change to its first accessor, primitive, mesh or node, or to the whole."""
    part: dict[str, Any] = {"attributes": {"POSITION": 0}}
    mesh, node = {"primitives": [part]}, {"mesh": 0}
    accessor = {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}
    told: dict[str, Any] = {
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "accessors": [accessor],
        "meshes": [mesh],
        "nodes": [node],
        "scenes": [{"nodes": [0]}],
    }
    {"accessor": accessor, "part": part, "mesh": mesh, "node": node, "": told}[where].update(change)
    return written_glb(np.eye(3, dtype="<f4").tobytes(), **told)


@pytest.mark.parametrize(
    ("where", "change", "why"),
    [
        ("accessor", {"sparse": {"count": 1}}, "accessors are sparse, expected all their values"),
        (
            "accessor",
            {"componentType": 5122},
            r"component type 5122, normalized False; expected VEC3 of floats",
        ),
        ("accessor", {"componentType": 5122, "normalized": True}, r"component type 5122, normalized True"),
        ("accessor", {"normalized": True}, r"component type 5126, normalized True"),
        ("accessor", {"type": "VEC2"}, "positions are VEC2"),
        (
            "",
            {"extensionsRequired": ["KHR_mesh_quantization"]},
            "requires the extension 'KHR_mesh_quantization'",
        ),
        ("", {"extensionsRequired": ["EXT_meshopt_compression"]}, "requires the extension 'EXT_meshopt"),
        ("part", {"mode": 6}, r"a body of mode 6, expected .*4 \(triangles\)"),
        ("part", {"attributes": {}, "indices": 0}, "no positions"),
        ("mesh", {"weights": [0.0, 0.5]}, "morphed by weights"),
        ("node", {"weights": [1.0]}, "morphed by weights"),
        ("node", {"skin": 0}, "a node has a skin"),
        ("node", {"extensions": {"EXT_mesh_gpu_instancing": {"attributes": {}}}}, "a node has instances"),
        ("node", {"camera": 0}, "a node is a camera with bodies"),
    ],
)
def test_what_trimesh_would_pass_over_is_refused(
    where: str, change: dict[str, Any], why: str, tmp_path: Path
) -> None:
    """1 m became 32,767 m, and a peak of 10 m became 1 m, without a word."""
    (tmp_path / "a.glb").write_bytes(changed_glb(where, change))
    with pytest.raises(InvalidRobot, match=why):
        mesh_parts(tmp_path / "a.glb")


@pytest.mark.parametrize(
    ("where", "change"),
    [
        ("", {"extensionsRequired": ["KHR_materials_unlit", "KHR_texture_transform"]}),
        ("", {"extensionsUsed": ["KHR_mesh_quantization"]}),
        ("mesh", {"weights": [0.0, 0.0]}),
        ("part", {"mode": 5}),
    ],
)
def test_what_changes_no_shape_is_read(where: str, change: dict[str, Any], tmp_path: Path) -> None:
    (tmp_path / "a.glb").write_bytes(changed_glb(where, change))
    (part,) = mesh_parts(tmp_path / "a.glb")
    assert sorted(map(tuple, part.vertices.tolist())) == sorted(map(tuple, np.eye(3).tolist()))


@pytest.mark.slow
@pytest.mark.parametrize("name", [*SOUND, *BOMBS])
def test_a_file_that_is_cut_anywhere_is_read_or_refused(name: str, tmp_path: Path) -> None:
    if name.endswith("dae"):
        pytest.importorskip("collada")
    whole = SOUND[name]() if name in SOUND else BOMBS[name][0]()
    rng = np.random.default_rng(3)
    for end in [0, 1, 5, 19, 25, *rng.integers(0, len(whole), 5).tolist()]:
        (tmp_path / name).write_bytes(whole[:end])
        with contextlib.suppress(InvalidRobot):
            mesh_parts(tmp_path / name, MOST)


ROWS = [(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)]
SIDES = [(1, 2, 4, 3), (5, 7, 8, 6), (1, 5, 6, 2), (3, 4, 8, 7), (1, 3, 7, 5), (2, 6, 8, 4)]
"""Corners and sides of a cube, counted from 1 as in OBJ."""


def vertices_of(*numbers: int) -> str:
    return "".join("v {} {} {}\n".format(*ROWS[number - 1]) for number in numbers)


@pytest.mark.parametrize(
    "text",
    [
        "".join(f"{vertices_of(*side)}f -4 -3 -2 -1\n" for side in SIDES),
        "".join(f"{vertices_of(*side)}vn 0 0 1\nf -4//-1 -3//-1 \\\n-2//-1 -1//-1\n" for side in SIDES),
        "".join(
            f"{vertices_of(*side)}f {i} -3 {i + 2} -1\n"
            for side, i in zip(SIDES, range(1, 25, 4), strict=True)
        ),
        vertices_of(*range(1, 9))
        + "".join(
            f"{before}f{blank}{a} {b} {c} {d}\n"
            for (a, b, c, d), before, blank in zip(
                SIDES, ("", " ", "\t", "", "  ", ""), (" ", " ", " ", "\t", "  ", " "), strict=True
            )
        ),
    ],
    ids=["backwards", "with normals", "both", "blanks"],
)
def test_faces_of_obj_name_vertices_in_every_way(text: str, tmp_path: Path) -> None:
    """Faces that count back from their place all named the last four vertices; those after a blank were skipped."""
    (tmp_path / "a.obj").write_text(text)
    (part,) = mesh_parts(tmp_path / "a.obj")
    assert part.area == pytest.approx(6)
    assert np.array_equal(part.bounds, [[0, 0, 0], [1, 1, 1]])


CUBE = f"{vertices_of(*range(1, 9))}v 9 9 9\n" + "".join("f {} {} {} {}\n".format(*side) for side in SIDES)
"""A cube, and a vertex that no face names: if one before it is skipped, every face names the wrong ones."""


@pytest.mark.parametrize(
    "text",
    [f"\ufeff{CUBE}", f"# a comment\r{CUBE}", CUBE.replace("\n", "\r")],
    ids=["byte order mark", "another line end", "other line ends"],
)
def test_no_vertex_of_obj_is_skipped(text: str, tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_bytes(text.encode())
    (part,) = mesh_parts(tmp_path / "a.obj")
    assert part.area == pytest.approx(6)
    assert np.array_equal(part.bounds, [[0, 0, 0], [1, 1, 1]])


@pytest.mark.parametrize("character", ["\0", "\v", "\f"])
def test_what_ends_lines_of_obj_for_some_readers_is_refused(character: str, tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_bytes(f"# a comment{character}{CUBE}".encode())
    with pytest.raises(InvalidRobot, match="is a line end to some readers"):
        mesh_parts(tmp_path / "a.obj")


@pytest.mark.parametrize(
    ("face", "why"),
    [
        (
            "f 1 2 -4",
            "line 4: it has 'f 1 2 -4', expected indices from 1 on, or negative ones back from the last of 3 rows",
        ),
        ("f 0 1 2", "line 4: a face has the index 0, expected one from 1 to 6"),
        ("f 1 2 7", "line 4: a face has the index 7, expected one from 1 to 6"),
        ("f 1/-1 2/-1 3/-1", "negative ones back from the last of 0 rows before the face"),
        ("f 1/1 2/1 3/1", "line 4: a face has the texture 1, expected one up to 0"),
        (
            "f 1 2 3\nf -1 -2 -",
            "line 5: it has 'f -1 -2 -', expected at least 3 corners, all of the form v, v/vt",
        ),
        ("f 1 / 2 / 3", "line 4: it has 'f 1 / 2 / 3', expected at least 3 corners"),
        ("f 1 /2 3", "line 4: it has 'f 1 /2 3', expected at least 3 corners"),
        ("f 1//1 2 3", "expected at least 3 corners, all of the form"),
        (
            "vt 0 0\nf 1/1 2 3/1/1",
            "line 5: it has 'f 1/1 2 3/1/1', expected at least 3 corners, all of the form",
        ),
        ("f 1 2", "line 4: it has 'f 1 2', expected at least 3 corners"),
        ("f 1 2 1_0", "line 4: it has 'f 1 2 1_0'"),
    ],
)
def test_a_face_of_obj_without_a_vertex_is_refused(face: str, why: str, tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text(f"{TRIANGLE}{face}\n{TRIANGLE}")
    with pytest.raises(InvalidRobot, match=re.escape(why)):
        mesh_parts(tmp_path / "a.obj")


@pytest.mark.parametrize(
    ("element", "why"),
    [
        (
            "element tristrips 0\nproperty list int int vertex_indices",
            "it has tristrips, expected the element face",
        ),
        (
            "element face 0\nproperty list uchar int vertex_indices",
            "it has two elements 'face', expected one",
        ),
        (
            "element more 0\nproperty int a\nproperty int a",
            "its element 'more' has two properties 'a', expected one",
        ),
    ],
)
def test_faces_of_ply_beside_the_first_are_refused(element: str, why: str, tmp_path: Path) -> None:
    text = trimesh.creation.box((1, 1, 1)).export(file_type="ply", encoding="ascii").decode()
    (tmp_path / "a.ply").write_text(text.replace("end_header", f"{element}\nend_header"))
    with pytest.raises(InvalidRobot, match=why):
        mesh_parts(tmp_path / "a.ply")


@pytest.mark.parametrize("word", ["fo", "bzp", "surf"])
def test_surfaces_of_obj_that_are_no_faces_are_refused(word: str, tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text(f"{TRIANGLE}f 1 2 3\n{word} 1 2 3\n")
    with pytest.raises(
        InvalidRobot, match=f"line 5: it has '{word} 1 2 3', expected v, vt, f or a statement"
    ):
        mesh_parts(tmp_path / "a.obj")


def test_a_comment_of_ply_is_not_its_format(tmp_path: Path) -> None:
    """Numbers were read in the other order of bytes after a comment with the word "big"."""
    text = trimesh.creation.box((1, 1, 1)).export(file_type="ply")
    (tmp_path / "a.ply").write_bytes(text.replace(b"ply\n", b"ply\ncomment by BigTool\n", 1))
    (part,) = mesh_parts(tmp_path / "a.ply")
    assert np.array_equal(part.bounds, [[-0.5] * 3, [0.5] * 3])


FACET = "facet normal 0 0 1\nouter loop\nvertex {0} 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n"
POINTS = ["element vertex 4", *(f"property float {axis}" for axis in "xyz"), "element face 2"]
FACES = [*POINTS, "property list uchar int vertex_indices"]
PLACES = b"0 0 0\n1 0 0\n0 1 0\n0 0 1\n"
TEXT_FACES = ply_header(*FACES, encoding="ascii") + PLACES
"""Text PLY up to its two faces."""
BYTES = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], "<f4").tobytes()
BYTE_FACES = [*POINTS, "property list uchar uchar vertex_indices"]
LOST: dict[str, tuple[str, bytes, str]] = {
    "a name that ends a solid": (
        "stl",
        f"solid endsolid\n{FACET.format(0)}solid b\n{FACET.format(5)}endsolid\n".encode(),
        "line 9: it has 'solid b",
    ),
    "a facet in the line of a name": (
        "stl",
        f"solid a {' '.join(FACET.format(5).split())}\n{FACET.format(0)}endsolid\n".encode(),
        "line 1: it has 'solid a facet",
    ),
    "a solid in the line of an end": (
        "stl",
        f"solid a\n{FACET.format(0)}endsolid a solid b {' '.join(FACET.format(5).split())} endsolid\n".encode(),
        "line 9: it has 'endsolid a solid b",
    ),
    "a solid without an end": (
        "stl",
        f"solid a\n{FACET.format(0)}endsolid\nsolid b\n{FACET.format(5)}".encode(),
        "line 18: it has '', expected endsolid",
    ),
    "a facet of four": (
        "stl",
        f"solid a\n{(FACET.format(0) + 'vertex 0 0 0' + chr(10)) * 3}endsolid\n".encode(),
        "line 9: it has 'vertex 0 0 0",
    ),
    "text with NaN": (
        "stl",
        f"solid a\n{FACET.format(0)}{FACET.format('nan')}endsolid\n".encode(),
        "line 9: it has",
    ),
    "text with infinity": ("stl", f"solid a\n{FACET.format('1e999')}endsolid\n".encode(), "finite"),
    "a vertex of four numbers": (
        "stl",
        f"solid a\n{FACET.format(0)}{FACET.format('1 2')}endsolid\n".encode(),
        "line 9: it has 'facet normal",
    ),
    "bytes with NaN": (
        "stl",
        bytes(80)
        + struct.pack("<I", 2)
        + b"".join(bytes(12) + struct.pack("<9f", x, 0, 0, 1, 0, 0, 0, 1, 0) + bytes(2) for x in (0, np.nan)),
        "is not of three finite numbers",
    ),
    "NaN of OBJ": (
        "obj",
        b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv nan 0 1\nf 1 2 3\nf 1 2 4\n",
        "line 4: it has 'v nan 0 1'",
    ),
    "two coordinates": ("obj", b"v 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "line 1: it has 'v 0 0'"),
    "a weight": (
        "obj",
        b"v 0 0 0 2\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
        "expected 3 coordinates; and nothing else, a weight",
    ),
    "five numbers": ("obj", b"v 0 0 0 1 1\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "line 1: it has 'v 0 0 0 1 1'"),
    "a comment that may go on": (
        "obj",
        b"# a\\\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 2 2 2\nf 1 2 3\n",
        "line 1: it has '# a",
    ),
    "a word in two lines": ("obj", f"{TRIANGLE * 4}f 1 2 1\\\n1\n".encode(), "a blank before the backslash"),
    "a polygon that crosses itself": (
        "obj",
        b"v 0 0 0\nv 1 1 0\nv 1 0 0\nv 0 1 0\nf 1 2 3 4\n",
        "line 5: a polygon of 4 corners crosses itself",
    ),
    "a face in two lines": ("obj", f"{TRIANGLE}f 1 2 3\nf 1 \\ \n2 3\n".encode(), "line 5: it has 'f 1 "),
    "a curved surface": ("obj", f"{TRIANGLE}f 1 2 3\nsurf 0 1 0 1 1 2 3\n".encode(), "line 5: it has 'surf"),
    "a longer face of PLY": (
        "ply",
        TEXT_FACES + b"3 0 1 2 0\n4 0 1 3 2\n",
        "row 1 of its element 'face' does not have the numbers of one line",
    ),
    "too few faces of PLY": (
        "ply",
        TEXT_FACES + b"3 0 1 2\n",
        "it ends in the element 'face'",
    ),
    "two lists of corners": (
        "ply",
        ply_header(*FACES, "property list uchar int vertex_index", encoding="ascii")
        + PLACES
        + b"3 0 1 2 3 0 0 0\n" * 2,
        "must have one list of corners",
    ),
    "a missing byte": (
        "ply",
        ply_header(*BYTE_FACES) + BYTES + bytes([3, 0, 1, 2, 3, 0, 1]),
        "it ends in the element 'face'",
    ),
    "a byte more": (
        "ply",
        ply_header(*BYTE_FACES) + BYTES + bytes([3, 0, 1, 2, 3, 0, 1, 3, 3]),
        "more rows than its header",
    ),
    "a fraction": (
        "ply",
        TEXT_FACES + b"3 0 1 2\n3 0 1 2.5\n",
        "the number 2.5, expected a whole one",
    ),
    "a length with an underscore": (
        "ply",
        TEXT_FACES + b"3 0 1 2\n3 0 1 0_2\n",
        "row 6 is '3 0 1 0_2', expected numbers",
    ),
    "a comment between corners": (
        "dae",
        dae(ONE.replace("0 1 2", "0 1 2<!-- --> 2 1 0")),
        "has a <p> with a comment or an element in it",
    ),
    "triangles in two parts": (
        "dae",
        dae(ONE.replace("</p>", "</p><p>2 1 0</p>")),
        "with 2 <p>, expected one",
    ),
    "a longer axis": (
        "dae",
        dae(scene=INSTANCE.replace("<inst", "<rotate>0 0 2 90</rotate><inst")),
        "expected an axis of length 1",
    ),
    "a node with two parents": (
        "glb",
        one_glb().replace(b'"scenes": [{"nodes": [0]}]', b'"scenes":[{"nodes":[0,0]}]'),
        "expected each once",
    ),
}


@pytest.mark.parametrize("name", LOST)
def test_no_triangle_is_lost(name: str, tmp_path: Path) -> None:
    """trimesh read the rest of each of these files, or something else; a scene was free where the file has a wall."""
    kind, content, why = LOST[name]
    (tmp_path / f"a.{kind}").write_bytes(content)
    with pytest.raises(InvalidRobot, match=re.escape(why)):
        mesh_parts(tmp_path / f"a.{kind}", MOST)


@pytest.mark.parametrize("encoding", ["ascii", "binary_little_endian", "binary_big_endian"])
@pytest.mark.parametrize("corners", [3, 4])
def test_faces_of_ply_with_as_many_corners_are_read(corners: int, encoding: str, tmp_path: Path) -> None:
    header = ply_header(*FACES, "property uchar red", encoding=encoding)
    rows = [[corners, *range(corners), 7]] * 2
    order = ">" if "big" in encoding else "<"
    if encoding == "ascii":
        body = PLACES + "".join(f"{' '.join(map(str, row))}\n" for row in rows).encode()
    else:
        body = np.frombuffer(BYTES, "<f4").astype(f"{order}f4").tobytes()
        body += b"".join(struct.pack(f"{order}B{corners}iB", *row) for row in rows)
    (tmp_path / "a.ply").write_bytes(header + body)
    (part,) = mesh_parts(tmp_path / "a.ply", MOST)
    assert len(part.faces) == 2 * (corners - 2)


@pytest.mark.parametrize(("size", "scale"), [(1e-9, 1e9), (1e12, 1e-12)])
def test_vertices_are_not_moved_together_before_they_are_scaled(
    size: float, scale: float, tmp_path: Path
) -> None:
    """trimesh made one of all vertices within 1e-8, and of all beyond 9e10."""
    corners = size * np.array([[1, 1, 1], [2, 1, 1], [1, 2, 1]])
    text = "".join(f"vertex {x!r} {y!r} {z!r}\n" for x, y, z in corners.tolist())
    text = f"facet normal 0 0 1\nouter loop\n{text}endloop\nendfacet\n"
    (tmp_path / "a.stl").write_text(f"solid a\n{text}endsolid\nsolid b\n{text}endsolid\n")
    places = " ".join(map(str, corners.ravel()))
    (tmp_path / "a.dae").write_bytes(dae().replace(b"0 0 0 1 0 0 0 1 0", places.encode()))
    for name in ("a.stl", "a.dae"):
        for part in mesh_parts(tmp_path / name, MOST):
            np.testing.assert_allclose(scale * part.vertices[part.faces[0]], scale * corners, rtol=1e-6)


@pytest.mark.parametrize("units", ["0.001 * meters", "nan * meters"])
def test_words_of_the_author_of_glb_scale_nothing(units: str, tmp_path: Path) -> None:
    (tmp_path / "a.glb").write_bytes(changed_glb("mesh", {"extras": {"units": units}}))
    (part,) = mesh_parts(tmp_path / "a.glb")
    assert np.array_equal(np.ptp(part.vertices, axis=0), [1, 1, 1])


def test_materials_come_from_beside_and_from_nowhere_else(tmp_path: Path) -> None:
    folder = tmp_path / "meshes"
    (folder / "below").mkdir(parents=True)
    for place in (tmp_path, folder, folder / "below"):
        (place / "paint.mtl").write_text("newmtl red\nKd 1 0 0\n")

    def colour(library: str, most: int = MOST) -> tuple[int, ...] | None:
        (folder / "a.obj").write_text(f"mtllib {library}\n{TRIANGLE}usemtl red\nf 1 2 3\n")
        visual = mesh_parts(folder / "a.obj", most)[0].visual
        return tuple(visual.material.diffuse[:3]) if visual.kind == "texture" else None

    assert colour("paint.mtl") == colour("below/paint.mtl") == (255, 0, 0)
    (folder / "paint.mtl").unlink()
    assert colour("paint.mtl") is None
    assert colour("../paint.mtl") is None
    assert colour(str(tmp_path / "paint.mtl")) is None
    assert colour("/dev/zero") is None
    (folder / "paint.mtl").symlink_to(tmp_path / "paint.mtl")
    assert colour("paint.mtl") is None
    (folder / "paint.mtl").unlink()
    (folder / "paint.mtl").write_text("newmtl red\nKd 1 0 0\n" + "#" * MOST)
    assert colour("paint.mtl") is None
    assert colour("paint.mtl", 2 * MOST) == (255, 0, 0)
    (folder / "paint.mtl").write_text("newmtl red\nKd 1 0 0\n" + "\n" * (MOST // 16))
    assert colour("paint.mtl") is None


def test_text_that_is_not_utf8_is_latin1(tmp_path: Path) -> None:
    (tmp_path / "a.mtl").write_bytes("newmtl grün\nKd 1 0 0\n".encode("latin-1"))
    (tmp_path / "a.obj").write_bytes(f"mtllib a.mtl\n{TRIANGLE}usemtl grün\nf 1 2 3\n".encode("latin-1"))
    assert mesh_parts(tmp_path / "a.obj")[0].visual.material.name == "grün"


def test_no_more_names_of_other_files_are_looked_up_than_a_mesh_has(tmp_path: Path) -> None:
    (tmp_path / "a.png").write_bytes(b"#")
    beside = Beside(tmp_path / "a.obj", MOST, Budget(MOST))
    for _ in range(999):
        with pytest.raises(InvalidRobot, match="is neither in"):
            beside.get("none.png")
    assert beside.get("a.png")
    with pytest.raises(InvalidRobot, match="names of other files"):
        beside.get("a.png")


@pytest.mark.slow
def test_nothing_is_printed_of_what_is_missing(tmp_path: Path) -> None:
    text = SOUND["a.ply"]().replace(b"comment", b"comment TextureFile \xc2\x9bnone.png\ncomment", 1)
    assert b"TextureFile" in text
    (tmp_path / "a.ply").write_bytes(text)
    code = "from pathlib import Path\nfrom kinseek.robots.meshes import mesh_parts\nassert mesh_parts(Path('a.ply'))"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd=tmp_path, check=True
    )
    assert (done.stdout, done.stderr) == ("", "")


def test_images_are_pictures_of_a_sane_size(tmp_path: Path) -> None:
    image = pytest.importorskip("PIL.Image")
    (tmp_path / "a.obj").write_text(
        f"mtllib a.mtl\n{TRIANGLE}vt 0 0\nvt 1 0\nvt 0 1\nusemtl red\nf 1/1 2/2 3/3\n"
    )
    (tmp_path / "a.mtl").write_text("newmtl red\nmap_Kd a.png\n")
    image.new("1", (8, 8)).save(tmp_path / "a.png")
    assert mesh_parts(tmp_path / "a.obj")[0].visual.material.image.size == (8, 8)

    def pictured() -> bool:
        return mesh_parts(tmp_path / "a.obj")[0].visual.material.image is not None

    assert pictured()
    image.new("1", (2**13 + 1, 2**13)).save(tmp_path / "a.png")
    assert not pictured()
    image.new("RGB", (8, 8)).save(tmp_path / "a.png", format="EPS")  # Its reader calls Ghostscript.
    assert not pictured()


@pytest.mark.parametrize(
    ("size", "kind", "why"),
    [
        ((8, 8), "PNG", ""),
        ((2**13 + 1, 2**13), "PNG", "pixels in its images"),
        ((8, 8), "EPS", "an image is EPS"),
    ],
)
def test_images_inside_a_file_are_too(size: tuple[int, int], kind: str, why: str, tmp_path: Path) -> None:
    data, told = pictured_glb(size, kind)
    (tmp_path / "a.glb").write_bytes(written_glb(data, **told))
    with pytest.raises(InvalidRobot, match=why) if why else contextlib.nullcontext():
        assert mesh_parts(tmp_path / "a.glb")[0].visual.material.baseColorTexture.size == size
    told["images"] = [{"uri": "a.png"}]
    (tmp_path / "b.glb").write_bytes(written_glb(data, **told))
    with pytest.raises(InvalidRobot, match="in other files"):
        mesh_parts(tmp_path / "b.glb")


def test_images_count_for_each_body(tmp_path: Path) -> None:
    data, told = pictured_glb((2**13, 2**13))
    told |= {"nodes": [{"mesh": 0}] * 3, "scenes": [{"nodes": [0, 1, 2]}]}
    (tmp_path / "a.glb").write_bytes(written_glb(data, **told))
    with pytest.raises(InvalidRobot, match="201,326,592 pixels in the images of its bodies"):
        mesh_parts(tmp_path / "a.glb")
    data, small = pictured_glb((8, 8))
    (tmp_path / "a.glb").write_bytes(
        written_glb(data, **small | {each: told[each] for each in ("nodes", "scenes")})
    )
    budget = Budget(MOST, 3 * 64)
    assert len(mesh_parts(tmp_path / "a.glb", budget=budget)) == 3
    assert budget.pixels_left == 0
    with pytest.raises(InvalidRobot, match="192 pixels in the images of its bodies, expected at most 0"):
        mesh_parts(tmp_path / "a.glb", budget=budget)


def test_images_count_for_each_instance_of_collada(tmp_path: Path) -> None:
    pytest.importorskip("collada")
    pytest.importorskip("PIL.Image").new("1", (2**13, 2**13)).save(tmp_path / "a.png")
    bound = (
        '<instance_geometry url="#g"><bind_material><technique_common><instance_material symbol="M" target="#m"/>'
        "</technique_common></bind_material></instance_geometry>"
    )
    text = dae(ONE.replace('count="1"', 'count="1" material="M"'), scene=f"<node>{bound * 3}</node>")
    (tmp_path / "a.dae").write_bytes(
        text.replace(b"<library_geometries>", PAINTED.encode() + b"<library_geometries>")
    )
    with pytest.raises(InvalidRobot, match="201,326,592 pixels in the images of its bodies"):
        mesh_parts(tmp_path / "a.dae")


def test_materials_for_which_images_are_computed_are_refused(tmp_path: Path) -> None:
    data, told = pictured_glb((8, 8))
    told["materials"] = [
        {"extensions": {"KHR_materials_pbrSpecularGlossiness": {"diffuseTexture": {"index": 0}}}}
    ]
    (tmp_path / "a.glb").write_bytes(written_glb(data, **told))
    with pytest.raises(InvalidRobot, match="computes new images"):
        mesh_parts(tmp_path / "a.glb")


def pictured_glb(size: tuple[int, int], kind: str = "PNG") -> tuple[bytes, dict[str, Any]]:
    """Numbers and description of a file with one triangle and one image."""
    held = io.BytesIO()
    pytest.importorskip("PIL.Image").new("RGB" if kind == "EPS" else "1", size).save(held, format=kind)
    corners, picture = np.eye(3, dtype="<f4").tobytes(), held.getvalue()
    return corners + picture, {
        "bufferViews": [
            {"buffer": 0, "byteLength": 36},
            {"buffer": 0, "byteOffset": 36, "byteLength": len(picture)},
        ],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
        "images": [{"bufferView": 1, "mimeType": "image/png"}],
        "textures": [{"source": 0}],
        "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "material": 0}]}],
        "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
    }


def test_the_meshes_of_a_robot_share_one_budget(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from kinseek.viewer import meshes

    pytest.importorskip("PIL.Image").new("1", (8, 8)).save(tmp_path / "a.png")
    (tmp_path / "a.mtl").write_text("newmtl red\nmap_Kd a.png\n")
    (tmp_path / "a.obj").write_text(
        f"mtllib a.mtl\n{TRIANGLE}vt 0 0\nvt 1 0\nvt 0 1\nusemtl red\nf 1/1 2/2 3/3\n"
    )
    visual = '<visual><geometry><mesh filename="a.obj"/></geometry></visual>'
    (tmp_path / "arm.urdf").write_text(
        f'<robot name="r"><link name="a">{visual * 3}</link><link name="b"/>'
        '<joint name="j" type="continuous"><parent link="a"/><child link="b"/></joint></robot>'
    )
    chain = kinseek.load(tmp_path / "arm.urdf").chain
    once = sum((tmp_path / f"a.{each}").stat().st_size for each in ("obj", "mtl", "png"))

    def shown(budget: Budget) -> tuple[int, list[str]]:
        monkeypatch.setattr(meshes, "Budget", lambda *_, **__: budget)
        found = meshes.meshes_of(chain)
        return sum(len(link.parts) for link in found.links), found.missing

    assert shown(Budget(3 * once, 3 * 64)) == (3, [])
    count, (missing,) = shown(Budget(MOST, 3 * 64 - 1))
    assert count == 2
    assert "pixels in the images of its bodies" in missing
    count, (missing,) = shown(Budget(2 * once, 3 * 64))
    assert count == 2
    assert "too large together" in missing
    count, (missing,) = shown(Budget(MOST, repeated_left=once))
    assert count == 2
    assert "too large together" in missing
    assert shown(Budget(MOST, bodies_left=3 * LEAST_BODIES)) == (3, [])
    for spent in (Budget(MOST, bodies_left=3 * LEAST_BODIES - 1), Budget(MOST, corners_left=3 * 10 - 1)):
        count, (missing,) = shown(spent)
        assert count == 2
        assert "too many bodies or triangles together" in missing


def robot_of(folder: Path, *geometries: str, tag: str = "visual") -> Path:
    """An arm of one joint with so many shapes."""
    shapes = "".join(f"<{tag}><geometry>{each}</geometry></{tag}>" for each in geometries)
    path = folder / "arm.urdf"
    path.write_text(
        f'<robot name="r"><link name="a">{shapes}</link><link name="b"/>'
        '<joint name="j" type="continuous"><parent link="a"/><child link="b"/></joint></robot>'
    )
    return path


@pytest.mark.slow
def test_a_robot_that_names_a_large_mesh_many_times(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """126 kB that unpack to 9 million corners took 0.4 s each time that they were named, also beyond all limits."""
    from kinseek.viewer import meshes

    read = list[int]()

    def counted(*given: Any, real: Any = trimesh.load_scene, **how: Any) -> Any:
        read.append(1)
        return real(*given, **how)

    def counted_too(*given: Any, real: Any = obj.read) -> Any:
        read.append(1)
        return real(*given)

    monkeypatch.setattr(trimesh, "load_scene", counted)
    monkeypatch.setattr(obj, "read", counted_too)
    (tmp_path / "large.glb").write_bytes(one_glb(nodes=1000, corners=12))
    (tmp_path / "broken.obj").write_text("v 0 0 0\n")
    chain = kinseek.load(robot_of(tmp_path, *['<mesh filename="large.glb"/>'] * 50)).chain
    found = meshes.meshes_of(chain)
    assert (len(read), len(found.missing)) == (10, 40)
    assert "too many bodies" in found.missing[0]
    most = sum(len(part.faces) for part in found.links[0].parts) // 10 + 1
    monkeypatch.setattr(meshes, "MOST_FACES", most)
    read.clear()
    found = meshes.meshes_of(chain)
    assert (len(read), len(found.missing)) == (2, 49)
    assert f"more than {most:,} triangles" in found.missing[-1]
    read.clear()
    chain = kinseek.load(robot_of(tmp_path, *['<mesh filename="broken.obj"/>'] * 50)).chain
    found = meshes.meshes_of(chain)
    assert (len(read), len(found.missing), len(set(found.missing))) == (1, 50, 1)
    boxes = robot_of(tmp_path, *['<box size="1 1 1"/>'] * 52)
    monkeypatch.setattr(meshes, "Budget", lambda _: Budget(MOST, bodies_left=50))
    monkeypatch.setattr(meshes, "MOST_FACES", 12 * MOST_BODIES)
    found = meshes.meshes_of(kinseek.load(boxes).chain)
    assert (len(found.links[0].parts), len(found.missing)) == (50, 2)


def test_the_meshes_of_a_scene_share_one_budget(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("pinocchio")
    from kinseek import Scene
    from kinseek.collision import bodies
    from kinseek.errors import InvalidScene

    box = trimesh.creation.box((1, 1, 1)).export(file_type="stl")
    (tmp_path / "a.stl").write_bytes(box)
    same = robot_of(tmp_path, *['<mesh filename="a.stl"/>'] * 3, tag="collision")
    (body,) = bodies.arm_bodies(kinseek.load(same).chain, {}, None, None, {}, False).bodies
    assert len({id(part.shape) for part in body.parts}) == 1
    scaled = [f'<mesh filename="a.stl" scale="1 1 {scale}"/>' for scale in (1, 2, 3)]
    for most, again, said in (
        (3, 2, None),
        (2, 2, "too large together"),
        (3, 1, "too large together"),
        (0, 9, "too many bodies"),
    ):
        left = {"repeated_left": again * len(box)} | ({} if most else {"bodies_left": 3 * LEAST_BODIES - 1})
        monkeypatch.setattr(
            bodies, "Budget", lambda _, most=most, left=left: Budget((most or 9) * len(box), **left)
        )
        arm = kinseek.load(robot_of(tmp_path, *scaled, tag="collision"))
        if said is None:
            assert Scene.of(arm).bodies == ("a",)
            continue
        with pytest.raises(InvalidScene, match=f"collision element 3: .*{said}"):
            Scene.of(arm)
        scene = Scene.of(arm, missing="skip")
        assert said in scene.notes[0]
        (tmp_path / "cell.urdf").write_text(
            robot_of(tmp_path, *scaled, tag="collision").read_text().replace("continuous", "fixed")
        )
        with pytest.raises(InvalidScene, match=said):
            scene.add_file(tmp_path / "cell.urdf", prefix="cell ")


def test_scenes_and_the_viewer_refuse_the_same_files(tmp_path: Path) -> None:
    pytest.importorskip("pinocchio")
    from kinseek.collision import Mesh
    from kinseek.errors import InvalidScene
    from kinseek.viewer.meshes import meshes_of

    (tmp_path / "a.zip").write_bytes(archive())
    with pytest.raises(InvalidScene, match=r"must end in \.dae"):
        Mesh.read(tmp_path / "a.zip")
    (tmp_path / "arm.urdf").write_text(
        '<robot name="r"><link name="a"><visual><geometry><mesh filename="a.zip"/></geometry></visual></link>'
        '<link name="b"/><joint name="j" type="continuous"><parent link="a"/><child link="b"/></joint></robot>'
    )
    (missing,) = meshes_of(kinseek.load(tmp_path / "arm.urdf").chain).missing
    assert "must end in .dae" in missing


def test_a_long_chain_of_nodes_is_refused(tmp_path: Path) -> None:
    """trimesh walks from the root to each node: 2,000 in a row took 24 s."""
    data = np.eye(3, dtype="<f4").tobytes()
    told: dict[str, Any] = {
        "bufferViews": [{"buffer": 0, "byteLength": len(data)}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "scenes": [{"nodes": [0]}],
    }
    for count, bad in ((20, False), (2000, True)):
        nodes = [{"children": [i + 1], "mesh": 0} for i in range(count)] + [{"mesh": 0}]
        path = tmp_path / f"{count}.glb"
        path.write_bytes(written_glb(data, nodes=nodes, **told))
        if bad:
            with pytest.raises(InvalidRobot, match="steps from its nodes to the root"):
                mesh_parts(path)
        else:
            assert len(mesh_parts(path)) == count + 1
