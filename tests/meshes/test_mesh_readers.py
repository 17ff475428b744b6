"""Readers of OBJ, STL and PLY: what is written is read, and other readers agree."""

from __future__ import annotations

import itertools
import os
import struct
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from kinseek import InvalidRobot
from kinseek.meshes import obj, ply, stl
from kinseek.meshes.parts import mesh_parts
from kinseek.meshes.polygons import triangulated
from mesh_builders import ply_header

trimesh = pytest.importorskip("trimesh")

Array = NDArray[Any]
Polygons = tuple[Array, list[list[int]]]


def sorted_triangles(corners: Array) -> Array:
    """Triangles, (n, 3, 3), each from its smallest corner on, in one order."""
    turned = [min(t[i:] + t[:i] for i in range(3)) for t in np.asarray(corners, dtype=np.float64).tolist()]
    return np.array(sorted(turned)).reshape(-1, 3, 3)


def read(kind: str, text: bytes) -> Array:
    """Triangles of all bodies."""
    sizes = list[Any]()
    bodies = (
        obj.read(text, sizes.append)[0]
        if kind == "obj"
        else {"ply": ply, "stl": stl}[kind].read(text, sizes.append)
    )
    assert len(sizes) == 1
    return np.concatenate([body.vertices[body.faces] for body in bodies])


def fans(vertices: Array, faces: list[list[int]]) -> Array:
    return np.array(
        [[vertices[f[0]], vertices[f[i]], vertices[f[i + 1]]] for f in faces for i in range(1, len(f) - 1)]
    )


@st.composite
def polygons(draw: st.DrawFn, most: int = 12) -> Polygons:
    """Regular polygons of different sizes, each in a plane of its own; the triangles of each are a fan."""
    vertices, faces = list[list[float]](), list[list[int]]()
    for _ in range(draw(st.integers(1, 6))):
        size, tilt = draw(st.integers(3, most)), draw(st.floats(-3, 3))
        place = draw(st.tuples(*[st.floats(-1e3, 1e3, width=32)] * 3))
        begin = len(vertices)
        for angle in np.arange(size) * 2 * np.pi / size:
            point = [np.cos(angle), np.sin(angle) * np.cos(tilt), np.sin(angle) * np.sin(tilt)]
            vertices.append(np.float32(np.add(point, place)).astype(float).tolist())
        faces.append([*range(begin, begin + size)])
    return np.array(vertices), draw(st.permutations(faces))


@pytest.mark.slow
@given(polygons(), st.data())
def test_obj_is_read_in_every_form(mesh: Polygons, data: st.DataObject) -> None:
    vertices, faces = mesh
    draw = data.draw
    end = draw(st.sampled_from(["\n", "\r\n", "\r"]))
    lines = [
        "# made by hand",
        "mtllib none.mtl",
        "vt 0 0",
        "vt 1 0 0",
        "vn 0 0 1",
        "o thing",
        "g a b",
        "s off",
    ]
    for row in vertices.tolist():
        numbers = " ".join(map(repr, row))
        lines.append(
            draw(
                st.sampled_from(["v {}", " v\t{} ", "v {} 1", "v {} 0.5 1 0", "v {} # comment", "v \\\n{}"])
            ).format(numbers)
        )
    for face in faces:
        form = draw(st.sampled_from(["{}", "{}/1", "{}/-1", "{}//1", "{}/2/1", "{}/-2/-1"]))
        indices = [index - len(vertices) if draw(st.booleans()) else index + 1 for index in face]
        gaps = [draw(st.sampled_from([" ", "  ", "\t", " \\\n"])) for _ in face]
        lines.append(
            "f" + "".join(gap + form.format(index) for gap, index in zip(gaps, indices, strict=True))
        )
        lines += draw(
            st.lists(st.sampled_from(["", "l 1 2", "p 1", "usemtl Red#1", "# f 1 2 3", "s 1"]), max_size=2)
        )
    text = "\n".join(lines).replace("\n", end).encode()
    assert np.array_equal(sorted_triangles(read("obj", text)), sorted_triangles(fans(vertices, faces)))
    # For scenes they are in the order of the file.
    (body,), _ = obj.read(text, lambda size: None, looks=False)
    assert np.array_equal(body.vertices[body.faces], fans(vertices, faces))


TYPES = {
    "char": "b",
    "uchar": "B",
    "short": "h",
    "ushort": "H",
    "int": "i",
    "uint": "I",
    "int32": "i",
    "uint8": "B",
}


@given(polygons(), st.data())
def test_ply_is_read_in_every_form(mesh: Polygons, data: st.DataObject) -> None:
    vertices, faces = mesh
    draw = data.draw
    form = draw(st.sampled_from(["ascii", "binary_little_endian", "binary_big_endian"]))
    order = ">" if "big" in form else "<"
    number, length, index = (
        draw(st.sampled_from(kinds)) for kinds in (["float", "double"], [*TYPES], [*TYPES])
    )
    name, extra = draw(st.sampled_from(["vertex_index", "vertex_indices"])), draw(st.booleans())
    header = ["ply", f"format {form} 1.0", "comment big end_header", f"element vertex {len(vertices)}"]
    header += [f"property {number} {axis}" for axis in "zxy"] + ["property uchar red"] * extra
    others = [["element edge 2", "property int a", "property list uchar short b"]] if extra else [[]]
    header += others[0] + ["obj_info nothing", f"element face {len(faces)}"]
    header += ["property list uchar float weights"] * extra + [
        f"property list {length} {index} {name}",
        "end_header\n",
    ]
    code = "f" if number == "float" else "d"
    rows = [(f"{code * 3}{'B' * extra}", (z, x, y, *[7] * extra)) for x, y, z in vertices.tolist()]
    rows += [("iB", (5, 0)), ("iBhh", (6, 2, -1, 3))] if extra else []
    for face in faces:
        prefix = ("Bf", (1, 0.5)) if extra else ("", ())
        rows.append((f"{prefix[0]}{TYPES[length]}{len(face)}{TYPES[index]}", (*prefix[1], len(face), *face)))
    if form == "ascii":
        body = "".join(" ".join(map(repr, row)) + "\n" for _, row in rows).encode()
    else:
        body = b"".join(struct.pack(order + kinds, *row) for kinds, row in rows)
    text = "\n".join(header).encode() + body
    assert np.array_equal(read("ply", text), fans(vertices, faces))
    with pytest.raises(InvalidRobot):
        read("ply", text.rstrip().rpartition(b" ")[0] if form == "ascii" else text[:-1])


@given(polygons(most=3), st.data())
def test_stl_is_read_in_every_form(mesh: Polygons, data: st.DataObject) -> None:
    vertices, faces = mesh
    corners = vertices[np.array(faces)]
    draw = data.draw
    rows = np.zeros(len(faces), stl._TRIANGLE)
    rows["corners"] = corners
    binary = b"solid of bytes".ljust(80) + struct.pack("<I", len(faces)) + rows.tobytes()
    assert np.array_equal(read("stl", binary), corners)
    with pytest.raises(InvalidRobot, match="expected"):
        read("stl", binary + b"\n")
    lines = ["solid a name"]
    for corner in corners.tolist():
        if draw(st.booleans()):
            lines += ["endsolid", "", "SOLID"]
        lines.append("facet normal " + draw(st.sampled_from(["0 0 1", "nan nan nan", "-1.#IND 0 0"])))
        lines.append("outer loop")
        lines += [f"  vertex {x!r} {y!r} {z:.17e}" for x, y, z in corner]
        lines += ["endloop", "endfacet"]
    text = draw(st.sampled_from(["\n", "\r\n", "\r"])).join([*lines, "endsolid a name"]).encode()
    assert np.array_equal(read("stl", text), corners)


POINTS = np.array([[np.cos(a), np.sin(a), 0.0] for a in np.arange(12) * np.pi / 6])


def test_faces_of_different_forms_do_not_shift_others() -> None:
    """A reader divided the numbers of all faces by those of the first one."""
    faces = [[*range(12)], [0, 1, 2, 3], [0, 2, 4, 6, 8, 10]]
    text = "".join("v {} {} {}\n".format(*row) for row in POINTS.tolist()) + "vt 0 0\nvn 0 0 1\n"
    for face, form in zip(faces, ("{}", "{}/1/1", "{}/1"), strict=True):
        text += "f " + " ".join(form.format(index + 1) for index in face) + "\n"
    assert np.array_equal(sorted_triangles(read("obj", text.encode())), sorted_triangles(fans(POINTS, faces)))


def test_rows_of_vertices_may_differ() -> None:
    """A reader took every third number, so that a colour became a vertex."""
    text = b"v 0 0 0 1\nv 1 0 0 0.1 0.2 0.3\nv 0 1 0\nf 1 2 3\n"
    assert read("obj", text).tolist() == [[[0, 0, 0], [1, 0, 0], [0, 1, 0]]]


@pytest.mark.parametrize(
    ("kind", "begin"),
    [("stl", b"solid\nfacet normal 0 0 1 outer loop vertex "), ("obj", b"v "), ("obj", b"vt ")],
)
def test_long_numbers_take_time_in_proportion(kind: str, begin: bytes) -> None:
    start = time.perf_counter()
    for digits in (b"1" * 20_000 + b"x", b"." + b"1" * 20_000 + b"x", b"1e" + b"1" * 20_000 + b"x"):
        with pytest.raises(InvalidRobot, match="expected"):
            read(kind, begin + digits + b" 0 0\n")
    assert time.perf_counter() - start < 2  # It was a minute for each.


def test_wrong_length_of_bytes_is_named_after_the_word_solid() -> None:
    binary = b"solid of bytes".ljust(80) + struct.pack("<I", 1) + bytes(50)
    with pytest.raises(
        InvalidRobot, match=r"has 136 bytes, expected .* 1 triangles that it declares, 134 bytes"
    ):
        read("stl", binary + b"\0\0")


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_errors_of_text_stl_count_each_line_once(end: str) -> None:
    text = "solid\nfacet normal 0 0 1\nouter loop\n" + 3 * "vertex 0 0 0\n" + "endloop\nendfacet\nfacet bad\n"
    with pytest.raises(InvalidRobot, match=r"^line 9: "):
        read("stl", text.replace("\n", end).encode())


def square_header(encoding: str, faces: int, lists: int = 0) -> bytes:
    """A header of four vertices, of faces, and of more lists beside the corners of each."""
    vertices = ["element vertex 4", *(f"property char {axis}" for axis in "xyz")]
    names = ["vertex_index", *(f"a{i}" for i in range(lists))]
    properties = (f"property list uchar uchar {name}" for name in names)
    return ply_header(*vertices, f"element face {faces}", *properties, encoding=encoding)


SQUARE = bytes([0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0])


def test_lists_of_ply_have_limits() -> None:
    """A list takes one byte of a file, and as long as many numbers."""
    rows = 20_000
    text = square_header("binary_little_endian", rows, 250) + SQUARE
    text += b"\3\0\1\2\1\0".ljust(255, b"\0") + (rows - 1) * b"\3\0\1\2".ljust(254, b"\0")
    with pytest.raises(InvalidRobot, match="values and lists in rows of different lengths"):
        read("ply", text)
    text = square_header("ascii", 1) + b"0 0 0\n1 0 0\n1 1 0\n0 1 0\n" + b"40000" + 40_000 * b" 1" + b"\n"
    with pytest.raises(InvalidRobot, match="bytes in a row"):
        read("ply", text)


def test_the_lists_of_all_elements_of_ply_have_one_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("kinseek.meshes.ply.MOST_LINES", 5)
    rows = b"\0\1\7\0"
    head = square_header("binary_little_endian", 1).decode().partition("end_header\n")[0]
    for names in ("a", "ab"):
        more = "".join(f"element {name} 3\nproperty list uchar uchar q\n" for name in names)
        text = f"{head}{more}end_header\n".encode() + SQUARE + b"\3\0\1\2" + len(names) * rows
        if names == "a":
            assert len(read("ply", text)) == 1
        else:
            with pytest.raises(InvalidRobot, match=r"^6 values and lists in rows of different lengths"):
                read("ply", text)


@pytest.mark.parametrize("number", ["0.5", "128", "-129"])
def test_coordinates_of_ply_have_the_declared_type(number: str) -> None:
    with pytest.raises(InvalidRobot, match="expected a whole one of type int8"):
        read("ply", square_header("ascii", 1) + f"0 0 0\n{number} 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n".encode())


@pytest.mark.filterwarnings("error")
def test_infinite_corners_of_polygons_are_named() -> None:
    with pytest.raises(InvalidRobot, match="line 5: a vertex is not of three finite numbers"):
        read("obj", b"v 0 0 0\nv 1e400 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n")


def test_rows_of_ply_in_one_line_are_named() -> None:
    with pytest.raises(
        InvalidRobot, match=r"row 1 of its element 'vertex' does not have the numbers of one line"
    ):
        read("ply", square_header("ascii", 1) + b"0 0 0 1 0 0 1 1 0\n0 1 0\n4 0 1 2 3\n")


U = [(0, 0), (3, 0), (3, 3), (2, 3), (2, 1), (1, 1), (1, 3), (0, 3)]
CORNER = [(2, 0), (2, 1), (1, 1), (1, 2), (0, 2), (0, 0)]
DART = [(1, 0), (0, 3), (-1, 0), (0, 1)]
STAR = [(np.cos(a), np.sin(a)) for a in np.arange(5) * 4 * np.pi / 5]
BOW = [(0, 0), (1, 1), (1, 0), (0, 1)]


@pytest.mark.parametrize(
    ("shape", "area"), [(CORNER, 3.0), (DART, 2.0), (U, None), (STAR, None), (BOW, None)]
)
def test_no_triangle_reaches_out_of_its_polygon(shape: list[tuple[float, float]], area: float | None) -> None:
    flat = np.array([(x, y, 0.0) for x, y in shape])
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    for first in range(len(flat)):
        for points in (
            np.roll(flat, first, 0),
            np.roll(flat, first, 0)[::-1],
            np.roll(flat, first, 0) @ turn,
        ):
            vertices = np.concatenate([points, [[9, 9, 9]]])
            given_sizes = np.array([len(flat), len(flat)])
            corners = np.tile(np.arange(len(flat)), 2)
            if area is None:
                with pytest.raises(
                    InvalidRobot, match=r"face 0: a polygon of \d corners crosses itself, or no corner"
                ):
                    triangulated(vertices, corners, given_sizes, "face {}".format, len)
                continue
            triangles, owners = triangulated(vertices, corners, given_sizes, "face {}".format, len)
            u, v = (vertices[corners[triangles]][:, k] - vertices[corners[triangles]][:, 0] for k in (1, 2))
            assert np.linalg.norm(np.cross(u, v), axis=1)[owners == 1].sum() / 2 == pytest.approx(area)


def test_many_small_dents_are_one_large_dent() -> None:
    """Each of the triangles from the first corner to a long falling edge reaches out by little."""
    way = np.linspace(0, 1, 1500)
    edge = np.stack([1 + way, -0.2 * way, 0 * way], axis=1)
    points = np.concatenate([[(0, 0, 0)], edge, [(2, 3, 0), (0, 3, 0)]])
    triangles, _ = triangulated(points, np.arange(len(points)), np.array([len(points)]), str, len)
    u, v = (points[triangles][:, k] - points[triangles][:, 0] for k in (1, 2))
    assert np.linalg.norm(np.cross(u, v), axis=1).sum() / 2 == pytest.approx(6.1, rel=1e-3)


def test_rounded_points_of_straight_edges_are_no_dents() -> None:
    rng = np.random.default_rng(2)
    ends = np.array([(0, 0, 0), (0.1, 0, 0), (0.1, 0.1, 0), (0, 0.1, 0), (0, 0, 0)])
    part = np.arange(20)[:, None] / 20
    square = np.concatenate([a + (b - a) * part for a, b in itertools.pairwise(ends)])
    for _ in range(20):
        points = np.round(square @ np.linalg.qr(rng.normal(size=(3, 3)))[0], 6)
        triangles, _ = triangulated(points, np.arange(80), np.array([80]), str, len)
        u, v = (points[triangles][:, k] - points[triangles][:, 0] for k in (1, 2))
        assert np.linalg.norm(np.cross(u, v), axis=1).sum() / 2 == pytest.approx(0.01, rel=1e-3)


@pytest.mark.parametrize("scale", [1e-300, 1e-90, 1e90, 1e307])
def test_size_does_not_change_the_triangles_of_a_polygon(scale: float) -> None:
    points = np.array([(x, y, 0.0) for x, y in DART])
    corners, sizes = np.arange(4), np.array([4])
    expected = triangulated(points, corners, sizes, str, len)[0]
    assert np.array_equal(triangulated(points * scale, corners, sizes, str, len)[0], expected)


def test_polygons_that_are_not_convex_take_seconds_at_most() -> None:
    comb = np.array([(i, 2.0 if i % 4 in (0, 1) else 0.5 + i % 3, 0) for i in range(5000)])
    with pytest.raises(InvalidRobot, match="corners of polygons that are not convex"):
        triangulated(comb, np.arange(5000), np.array([5000]), str, len)


def test_looks_stay_with_their_triangles(tmp_path: Path) -> None:
    (tmp_path / "a.mtl").write_text("newmtl red\nKd 1 0 0\nnewmtl blue\nKd 0 0 1\n")
    text = "mtllib a.mtl\n" + "".join("v {} {} {}\n".format(*row) for row in POINTS.tolist())
    (tmp_path / "a.obj").write_text(
        f"{text}f 1 2 3\nusemtl red\nf 4 5 6 7\nusemtl blue\nf 8 9 10\nusemtl red\nf 10 11 12\n"
    )
    plain, red, blue = mesh_parts(tmp_path / "a.obj")
    assert [len(part.faces) for part in (plain, red, blue)] == [1, 3, 1]
    assert not plain.visual.defined
    assert [part.visual.material.diffuse[:3].tolist() for part in (red, blue)] == [[255, 0, 0], [0, 0, 255]]
    header = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
    colour = "".join(f"property uchar {each}\n" for each in ("red", "green", "blue"))
    rows = "0 0 0{}\n1 0 0{}\n1 1 0{}\n0 1 0{}\n"
    face = "element face 1\nproperty list uchar int vertex_index\n"
    (tmp_path / "v.ply").write_text(
        f"{header}{colour}{face}end_header\n{rows.replace('{}', ' 9 8 7')}4 0 1 2 3\n"
    )
    (tmp_path / "f.ply").write_text(
        f"{header}{face}{colour}end_header\n{rows.replace('{}', '')}4 0 1 2 3 9 8 7\n"
    )
    assert mesh_parts(tmp_path / "v.ply")[0].visual.vertex_colors.tolist() == [[9, 8, 7, 255]] * 4
    assert mesh_parts(tmp_path / "f.ply")[0].visual.face_colors.tolist() == [[9, 8, 7, 255]] * 2


def files() -> list[Path]:
    """Mesh files of the installed packages, and below the folders in ``KINSEEK_MESHES``."""
    folders = [
        Path(np.__file__).parents[1],
        *map(Path, filter(None, os.environ.get("KINSEEK_MESHES", "").split(os.pathsep))),
    ]
    found = {
        path.read_bytes(): path
        for each in folders
        for path in sorted(each.rglob("*"))
        if path.suffix.lower() in (".stl", ".obj", ".ply")
        and path.is_file()
        and b"\0" not in path.name.encode()
    }
    return sorted(
        path for text, path in found.items() if path.suffix.lower() == ".stl" or b"\0" not in text[:99]
    )


@pytest.mark.slow
def test_trimesh_reads_the_same_triangles_of_real_files() -> None:
    paths = files()
    if not paths:
        pytest.skip("no installed package has meshes; KINSEEK_MESHES names folders of them")
    for path in paths:
        with path.open("rb") as file:
            scene = trimesh.load_scene(file, file_type=path.suffix[1:].lower(), process=False)
        other = np.concatenate([part.triangles for part in scene.dump() if isinstance(part, trimesh.Trimesh)])
        own = np.concatenate([part.vertices[part.faces] for part in mesh_parts(path)])
        np.testing.assert_allclose(
            sorted_triangles(own), sorted_triangles(other), rtol=1e-12, err_msg=str(path)
        )


@given(polygons(most=4), st.sampled_from(["obj", "ply", "stl"]), st.booleans())
def test_what_trimesh_writes_is_read(mesh: Polygons, kind: str, is_text: bool) -> None:
    made = trimesh.Trimesh(mesh[0], [face[:3] for face in mesh[1]], process=False)
    how = {"ply": {"encoding": "ascii" if is_text else "binary"}}.get(kind, {})
    text = made.export(file_type="stl_ascii" if kind == "stl" and is_text else kind, **how)
    own = read(kind, text.encode() if isinstance(text, str) else text)
    np.testing.assert_allclose(own, made.triangles, atol=1e-3)


IMPORTING = """
import logging, sys
from pathlib import Path
from kinseek.support.forks import importing
from kinseek.meshes.parts import mesh_parts

class Seen:
    def find_spec(self, name, path, target=None):
        if name == "trimesh":
            held.append(importing._is_owned())

held = []
sys.meta_path.insert(0, Seen())
mesh_parts(Path(sys.argv[1]))
assert held == [True], held
assert logging.getLogger("trimesh").handlers
"""


def test_trimesh_is_imported_where_a_fork_waits_for_it(tmp_path: Path) -> None:
    (tmp_path / "one.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    command = [sys.executable, "-c", IMPORTING, str(tmp_path / "one.obj")]
    assert subprocess.run(command, check=False, capture_output=True, text=True).stderr == ""
