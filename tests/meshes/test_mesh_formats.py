"""OBJ, PLY, STL and GLB: every triangle of a file is read, or the file is refused."""

from __future__ import annotations

import re
import struct
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from kinseek import InvalidRobot
from kinseek.meshes import obj
from mesh_builders import TRIANGLE, changed_glb, dae, one_glb, ply_header, read, small_limits

trimesh = pytest.importorskip("trimesh")


@pytest.fixture(autouse=True)
def _small(monkeypatch: pytest.MonkeyPatch) -> None:
    small_limits(monkeypatch)


ROWS = [(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)]
SIDES = [(1, 2, 4, 3), (5, 7, 8, 6), (1, 5, 6, 2), (3, 4, 8, 7), (1, 3, 7, 5), (2, 6, 8, 4)]
"""Corners and sides of a cube, counted from 1 as in OBJ."""


def vertices_of(*numbers: int) -> str:
    return "".join("v {} {} {}\n".format(*ROWS[number - 1]) for number in numbers)


CUBE = f"{vertices_of(*range(1, 9))}v 9 9 9\n" + "".join("f {} {} {} {}\n".format(*side) for side in SIDES)
"""A cube, and a vertex that no face names: if one before it is skipped, every face names the wrong ones."""


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
        f"\ufeff{CUBE}",
        f"# a comment\r{CUBE}",
        CUBE.replace("\n", "\r"),
    ],
    ids=[
        "backwards",
        "with normals",
        "both",
        "blanks",
        "byte order mark",
        "another line end",
        "other line ends",
    ],
)
def test_faces_of_obj_name_vertices_in_every_way(text: str, tmp_path: Path) -> None:
    """Faces that count back from their place all named the last four vertices; those after a blank were skipped."""
    (part,) = read(tmp_path, "obj", text)
    assert part.area == pytest.approx(6)
    assert np.array_equal(part.bounds, [[0, 0, 0], [1, 1, 1]])


def test_lines_that_go_on_take_a_time_that_grows_with_the_file() -> None:
    """Each blank line that went on was searched with all before it: 13 MB took more than a minute."""
    began = time.perf_counter()
    assert list(obj._statements((b" \\\n" * 65_000 + b"\n") * 8 + b"g a")) == [(8 * 65_001 + 1, b"g a")]
    assert time.perf_counter() - began < 4.0


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("line", ["# c \\", "v 9 9 9 # c \\", "v 9 9 \\{} 9 # c \\"])
def test_a_comment_of_obj_that_goes_on_is_refused(line: str, end: str, tmp_path: Path) -> None:
    """The backslash may be a part of the comment, or hide the vertex in the next line."""
    text = TRIANGLE.replace("\n", end) + line.format(end) + f"{end}v 5 5 5{end}f 1 2 3{end}"
    with pytest.raises(InvalidRobot, match="a comment without a backslash at its end: readers differ"):
        read(tmp_path, "obj", text)


def test_a_comment_of_ply_is_not_its_format(tmp_path: Path) -> None:
    """Numbers were read in the other order of bytes after a comment with the word "big"."""
    text = trimesh.creation.box((1, 1, 1)).export(file_type="ply")
    (part,) = read(tmp_path, "ply", text.replace(b"ply\n", b"ply\ncomment by BigTool\n", 1))
    assert np.array_equal(part.bounds, [[-0.5] * 3, [0.5] * 3])


@pytest.mark.parametrize("encoding", ["ascii", "binary"])
def test_a_line_end_of_some_readers_in_a_line_of_ply_is_refused(encoding: str, tmp_path: Path) -> None:
    """A property could be hidden in another line."""
    text = trimesh.creation.box((1, 1, 1)).export(file_type="ply", encoding=encoding)
    for old, new in ((b"property float x", b"property\rfloat x"), (b"ply\n", b"ply\ncomment a\r b\n")):
        assert old in text
        with pytest.raises(InvalidRobot, match=r"the character '\\r', which is a line end to some readers"):
            read(tmp_path, "ply", text.replace(old, new, 1))
    (part,) = read(tmp_path, "ply", text.replace(b"ply\n", b"ply\r\n", 1))
    assert len(part.faces) == 12


FACET = "facet normal 0 0 1\nouter loop\nvertex {0} 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n"
POINTS = ["element vertex 4", *(f"property float {axis}" for axis in "xyz"), "element face 2"]
FACES = [*POINTS, "property list uchar int vertex_indices"]
PLACES = b"0 0 0\n1 0 0\n0 1 0\n0 0 1\n"
TEXT_FACES = ply_header(*FACES, encoding="ascii") + PLACES
"""Text PLY up to its two faces."""
BYTES = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], "<f4").tobytes()
BYTE_FACES = [*POINTS, "property list uchar uchar vertex_indices"]
TEXT_BOX = trimesh.creation.box((1, 1, 1)).export(file_type="ply", encoding="ascii").decode()
WRONG_FACES = [
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
]
WRONG_ELEMENTS = [
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
]
"""Of PLY, beside its faces."""
WRONG_PARTS: list[tuple[str, dict[str, Any], str]] = [
    ("accessor", {"sparse": {"count": 1}}, "accessors are sparse, expected all their values"),
    (
        "accessor",
        {"componentType": 5122},
        "component type 5122, normalized False; expected VEC3 of floats",
    ),
    ("accessor", {"componentType": 5122, "normalized": True}, "component type 5122, normalized True"),
    ("accessor", {"normalized": True}, "component type 5126, normalized True"),
    ("accessor", {"type": "VEC2"}, "positions are VEC2"),
    (
        "",
        {"extensionsRequired": ["KHR_mesh_quantization"]},
        "requires the extension 'KHR_mesh_quantization'",
    ),
    ("", {"extensionsRequired": ["EXT_meshopt_compression"]}, "requires the extension 'EXT_meshopt"),
    ("part", {"mode": 7}, "a body of mode 7, expected 0 to 3 (points and lines), 4 (triangles)"),
    ("part", {"attributes": {}, "indices": 0}, "no positions"),
    ("mesh", {"weights": [0.0, 0.5]}, "morphed by weights"),
    ("node", {"weights": [1.0]}, "morphed by weights"),
    ("node", {"rotation": [0, 0, 2, 2]}, "not a quaternion of length 1"),
    ("node", {"matrix": [*np.eye(4).ravel()[:15], 2.0]}, "a matrix whose last row is not 0, 0, 0, 1"),
    ("node", {"matrix": [*np.eye(4).ravel()], "scale": [1, 1, 1]}, "a matrix and another motion"),
    ("part", {"indices": 0}, "its indices are of component type 5126"),
    ("node", {"skin": 0}, "a node has a skin"),
    ("node", {"extensions": {"EXT_mesh_gpu_instancing": {"attributes": {}}}}, "a node has instances"),
    *(
        ("node", {"translation": wrong}, "expected 3 finite numbers")
        for wrong in ([None, 0, 0], ["NaN", 0, 0], [10**400, 0, 0], [True, 0, 0], [0, 0])
    ),
    ("node", {"translation": [float("nan"), 0, 0]}, "it has NaN, expected finite numbers"),
    (
        "",
        {"nodes": [{"children": [1]}, {"mesh": 0, "translation": [None, 5, 0]}]},
        "expected 3 finite numbers",
    ),
]
"""What other readers pass over: 1 m became 32,767 m, and a peak of 10 m became 1 m, without a word."""
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
    "a node with two parents": (
        "glb",
        one_glb().replace(b'"scenes": [{"nodes": [0]}]', b'"scenes":[{"nodes":[0,0]}]'),
        "expected each once",
    ),
    "a place that a node of GLB has twice": (
        "glb",
        changed_glb("node", {"translation": [0, 0, 0], "translatiom": [9, 0, 0]}).replace(b"tiom", b"tion"),
        "has a name twice",
    ),
    "a number of GLB that Python counts from the end": (
        "glb",
        changed_glb("", {"scenes": [{"nodes": [0]}, {"nodes": []}], "scene": -2}),
        "'scene' is -2, expected a whole number",
    ),
    "a place of GLB before the beginning": (
        "glb",
        changed_glb("accessor", {"byteOffset": -1}),
        "'byteOffset' is -1, expected a whole number",
    ),
    "a mesh of GLB that is true": (
        "glb",
        changed_glb("node", {"mesh": False}),
        "'mesh' is False, expected a whole number",
    ),
    **{
        f"a line end for some readers: {end!r}": (
            "obj",
            f"# a comment{end}{CUBE}".encode(),
            "is a line end to some readers",
        )
        for end in "\0\v\f"
    },
    **{face: ("obj", f"{TRIANGLE}{face}\n{TRIANGLE}".encode(), why) for face, why in WRONG_FACES},
    **{
        f"a surface that is no face: {word}": (
            "obj",
            f"{TRIANGLE}f 1 2 3\n{word} 1 2 3\n".encode(),
            f"line 5: it has '{word} 1 2 3', expected v, vt, f or a statement",
        )
        for word in ("fo", "bzp", "surf")
    },
    **{
        element: ("ply", TEXT_BOX.replace("end_header", f"{element}\nend_header").encode(), why)
        for element, why in WRONG_ELEMENTS
    },
    **{
        f"{where} of GLB: {change}": ("glb", changed_glb(where, change), why)
        for where, change, why in WRONG_PARTS
    },
}


@pytest.mark.parametrize("name", LOST)
def test_no_triangle_is_lost(name: str, tmp_path: Path) -> None:
    """trimesh read the rest of each of these files, or something else; a scene was free where the file has a wall."""
    kind, content, why = LOST[name]
    with pytest.raises(InvalidRobot, match=re.escape(why)):
        read(tmp_path, kind, content)


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
    (part,) = read(tmp_path, "glb", changed_glb(where, change))
    assert sorted(map(tuple, part.vertices.tolist())) == sorted(map(tuple, np.eye(3).tolist()))


def test_unsigned_coordinates_of_ply_keep_their_sign(tmp_path: Path) -> None:
    places = (f"property uint64 {axis}" for axis in "xyz")
    header = ply_header("element vertex 3", *places, "element face 1", "property list uchar int vertex_index")
    rows = struct.pack("<9QB3i", 2**63, 0, 0, 1, 0, 0, 0, 1, 0, 3, 0, 1, 2)
    (part,) = read(tmp_path, "ply", header + rows)
    assert part.vertices.max() == 2.0**63
    assert part.vertices.min() == 0.0


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
    (part,) = read(tmp_path, "ply", header + body)
    assert len(part.faces) == 2 * (corners - 2)


@pytest.mark.parametrize(("size", "scale"), [(1e-9, 1e9), (1e12, 1e-12)])
def test_vertices_are_not_moved_together_before_they_are_scaled(
    size: float, scale: float, tmp_path: Path
) -> None:
    """trimesh made one of all vertices within 1e-8, and of all beyond 9e10."""
    corners = size * np.array([[1, 1, 1], [2, 1, 1], [1, 2, 1]])
    text = "".join(f"vertex {x!r} {y!r} {z!r}\n" for x, y, z in corners.tolist())
    text = f"facet normal 0 0 1\nouter loop\n{text}endloop\nendfacet\n"
    places = " ".join(map(str, corners.ravel()))
    for kind, content in (
        ("stl", f"solid a\n{text}endsolid\nsolid b\n{text}endsolid\n".encode()),
        ("dae", dae().replace(b"0 0 0 1 0 0 0 1 0", places.encode())),
    ):
        for part in read(tmp_path, kind, content):
            np.testing.assert_allclose(scale * part.vertices[part.faces[0]], scale * corners, rtol=1e-6)


@pytest.mark.parametrize("units", ["0.001 * meters", "nan * meters"])
def test_words_of_the_author_of_glb_scale_nothing(units: str, tmp_path: Path) -> None:
    (part,) = read(tmp_path, "glb", changed_glb("mesh", {"extras": {"units": units}}))
    assert np.array_equal(np.ptp(part.vertices, axis=0), [1, 1, 1])
