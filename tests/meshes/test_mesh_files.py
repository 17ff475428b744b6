"""Limits of mesh files: no more bytes of memory, bodies, images and files than meshes of that size may have."""

from __future__ import annotations

import codecs
import contextlib
import os
import pickle
import struct
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import kinseek
from kinseek import InvalidRobot
from kinseek.meshes import glb, limits, obj
from kinseek.meshes.limits import (
    ENDINGS,
    LEAST_BODIES,
    MOST_BODIES,
    MOST_HINTS,
    Beside,
    Budget,
    pixels_of_image,
)
from kinseek.meshes.obj import MOST_GROUPS
from kinseek.meshes.parts import MOST_MESH, mesh_parts
from kinseek.meshes.process import MeshReader
from mesh_builders import (
    INSTANCE,
    MOST,
    ONE,
    TRIANGLE,
    archive,
    dae,
    dae_of,
    one_glb,
    pictured_glb,
    ply_header,
    read,
    robot_of,
    small_limits,
    written_glb,
)

trimesh = pytest.importorskip("trimesh")


@pytest.fixture(autouse=True)
def _small(monkeypatch: pytest.MonkeyPatch) -> None:
    small_limits(monkeypatch)


WORDS = (
    "# the mesh of a robot link, which a mainframe wrote in plain words so that its encoding is recognised"
)
SOLID = "solid a\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendsolid\n"


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
    from trimesh.exchange.load import compressed_loaders

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
    "corners.stl": (
        lambda: b"solid a\n" + b"vertex 0 0 0\n" * 4500 + b"endsolid",
        "vertices, normals and solids",
    ),
    "solids.stl": (lambda: b"solid\nendsolid\n" * 2100, "vertices, normals and solids"),
    "materials.obj": (
        lambda: TRIANGLE.encode() + b"".join(b"usemtl %d\n" % i for i in range(MOST_GROUPS + 1)),
        " materials, expected",
    ),
    "continued.obj": (
        lambda: TRIANGLE.encode() + b"".join(b"usemtl \\\n%d\n" % i for i in range(MOST_GROUPS + 1)),
        " materials, expected",
    ),
    "accessor.glb": (lambda: one_glb(count=10**9), "an accessor has 1,000,000,000 elements"),
    "view.glb": (lambda: one_glb(view=10**9), "the bytes from 0 to 1,000,000,000 of 36 bytes"),
    "negative.glb": (lambda: one_glb(count=-5), "'count' is -5"),
    "primitives.glb": (lambda: one_glb(count=0, corners=300, repeat=60), "counted four times"),
    "instances.glb": (lambda: one_glb(count=0, corners=300, nodes=60), "counted four times"),
    "corners.glb": (lambda: one_glb(count=0, corners=14100), "corners of triangles"),
    "counted_four_times.glb": (
        lambda: one_glb(count=0, corners=120, nodes=91),
        "corners of triangles, with those of instances",
    ),
    "strip.glb": (lambda: one_glb(count=0, corners=1500, nodes=3, mode=5), "corners of triangles"),
    "many.glb": (lambda: one_glb(nodes=MOST_BODIES + 1), "10,001 nodes"),
    "draco.glb": (lambda: one_glb(extensions={"KHR_draco_mesh_compression": {}}), "Draco"),
    "archive.dae": (archive, "cannot be read"),
    "appended.dae": (lambda: dae() + archive(), "cannot be read: Extra content"),
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
        "polygons of 2000000000 corners together, but <p> has 3",
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
    "tags.dae": (lambda: dae(scene="<x/>" * 3000), "tags"),
}


@pytest.mark.parametrize(
    ("faces", "corners", "why"),
    [(5, 3, ""), (6, 3, "9 rows, expected at most 8"), (2, 9, "18 corners of polygons, expected at most 16")],
)
def test_rows_of_ply_are_limited_before_they_take_memory(
    faces: int, corners: int, why: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """16 MB of rows of a few bytes took 460 MB."""
    monkeypatch.setattr("kinseek.meshes.ply.MOST_ROWS", 8)
    axes = [f"property uchar {axis}" for axis in "xyz"]
    header = ply_header(
        "element vertex 3", *axes, f"element face {faces}", "property list uchar uchar vertex_indices"
    )
    text = header + bytes([0, 0, 0, 1, 0, 0, 0, 1, 0]) + bytes([corners, 0, 1, *[2] * (corners - 2)]) * faces
    with pytest.raises(InvalidRobot, match=why) if why else contextlib.nullcontext():
        (part,) = read(tmp_path, "ply", text)
        assert len(part.faces) == faces


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
    make, why = BOMBS[name]
    (tmp_path / name).write_bytes(make())
    most = 2**20 if name in LONG else MOST
    with pytest.raises(InvalidRobot, match=why) as caught:
        mesh_parts(tmp_path / name, most)
    assert name in str(caught.value)


@pytest.mark.slow
@pytest.mark.parametrize("name", [*SOUND, *BOMBS])
def test_a_file_that_is_cut_anywhere_is_read_or_refused(name: str, tmp_path: Path) -> None:
    whole = SOUND[name]() if name in SOUND else BOMBS[name][0]()
    rng = np.random.default_rng(3)
    for end in [0, 1, 5, 19, 25, *rng.integers(0, len(whole), 5).tolist()]:
        (tmp_path / name).write_bytes(whole[:end])
        with contextlib.suppress(InvalidRobot):
            mesh_parts(tmp_path / name, MOST)


def test_a_mesh_is_read_without_materials_of_an_impossible_name(tmp_path: Path) -> None:
    assert read(tmp_path, "obj", f"mtllib {'x' * 300}.mtl\n{TRIANGLE}f 1 2 3\n")


def test_a_polygon_takes_no_gigabytes(tmp_path: Path) -> None:
    """One of 16 million corners, in a binary PLY file of as many bytes, took 6 GB."""
    header = ply_header(
        "element vertex 3",
        *(f"property char {axis}" for axis in "xyz"),
        "element face 1",
        "property list uint uchar vertex_index",
    )
    count = 2**20 + 1
    rows = bytes([0, 0, 0, 1, 0, 0, 0, 1, 0]) + struct.pack("<I", count) + bytes(count - 2) + b"\1\2"
    with pytest.raises(InvalidRobot, match="1,048,577 corners of one polygon"):
        read(tmp_path, "ply", header + rows, MOST_MESH)


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
    assert colour(str(folder / "below" / "paint.mtl")) == (255, 0, 0)
    assert (
        colour(f"/{folder}/below/paint.mtl") is None
    )  # Windows would connect to the first of these folders.
    assert colour("/dev/zero") is None
    (folder / "paint.mtl").symlink_to(tmp_path / "paint.mtl")
    assert colour("paint.mtl") is None
    (folder / "paint.mtl").unlink()
    (folder / "paint.mtl").write_text("newmtl red\nKd 1 0 0\n" + "#" * MOST)
    assert colour("paint.mtl") is None
    assert colour("paint.mtl", 2 * MOST) == (255, 0, 0)
    for end in ("\n", "\r", "\v", "\x1e", "\x85", "\u2028"):  # Those of `str.splitlines`.
        (folder / "paint.mtl").write_text("newmtl red\nKd 1 0 0\n" + end * (MOST // 16), newline="")
        assert colour("paint.mtl", 4 * MOST) is None


def test_materials_are_read_once_and_count_together(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A file of 100 kB that was named 500 times took half a minute."""
    for name in ("a.mtl", "b.mtl", "c.mtl"):
        (tmp_path / name).write_text("".join(f"newmtl {i}\n" for i in range(MOST // 16 // 3 + 1)))
    (tmp_path / "a.obj").write_text("mtllib a.mtl\n" * 500 + f"{TRIANGLE}usemtl 1\nf 1 2 3\n")
    read = list[str]()
    get = Beside.get

    def reading(beside: Beside, name: str) -> bytes:
        read.append(name)
        return get(beside, name)

    monkeypatch.setattr(Beside, "__getitem__", reading)
    assert mesh_parts(tmp_path / "a.obj")[0].visual.kind == "texture"
    assert read == ["a.mtl"]
    beside = Beside(tmp_path / "a.obj", MOST_MESH, Budget(MOST_MESH))
    assert beside["a.mtl"]
    assert beside["b.mtl"]
    for name in ("c.mtl", "a.mtl"):
        with pytest.raises(InvalidRobot, match="lines of materials"):
            beside[name]


@pytest.mark.skipif(os.open not in os.supports_dir_fd, reason="folders cannot be opened here")
@pytest.mark.parametrize("swapped", ["paint.mtl", "below"])
def test_materials_come_from_nowhere_else_even_if_a_link_takes_their_place(
    swapped: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The owner of the folder can make the link after the path was examined, and before the file is opened."""
    folder, elsewhere = tmp_path / "meshes", tmp_path / "elsewhere"
    for place in (folder / "below", elsewhere / "below"):
        place.mkdir(parents=True)
        for each in (place.parent, place):
            (each / "paint.mtl").write_text("newmtl red\nKd 1 0 0\n")
    name = "paint.mtl" if swapped == "paint.mtl" else "below/paint.mtl"
    beside = Beside(folder / "a.obj", MOST, Budget(MOST))
    assert beside[name].startswith(b"newmtl")
    read = Budget.read

    def after_the_swap(*given: Any) -> bytes:
        (folder / swapped).rename(folder / "away")
        (folder / swapped).symlink_to(elsewhere / swapped)
        return read(*given)

    monkeypatch.setattr(Budget, "read", after_the_swap)
    with pytest.raises(InvalidRobot, match="cannot read"):
        beside[name]


@pytest.mark.parametrize(
    ("statement", "colour"),
    [
        ("Kd 0.4", (102, 102, 102)),
        ("Kd 1 0", None),
        ("Kd 1 0 0 0 0", None),
        ("diffuse 1 0 0", None),
        ("Ns 1 2", None),
        ("glossiness 1", None),
        ("image a.png", None),
        ("self 1", None),
    ],
)
def test_a_material_of_obj_that_is_broken_changes_no_shape(
    statement: str, colour: tuple[int, ...] | None, tmp_path: Path
) -> None:
    (tmp_path / "a.mtl").write_text(f"newmtl red\n{statement}\n")
    (tmp_path / "a.obj").write_text(f"mtllib a.mtl\n{TRIANGLE}usemtl red\nf 1 2 3\n")
    (part,) = mesh_parts(tmp_path / "a.obj")
    assert part.faces.tolist() == [[0, 1, 2]]
    assert colour is None or tuple(part.visual.material.diffuse[:3]) == colour


def test_a_material_of_obj_without_a_name_is_left_out(tmp_path: Path) -> None:
    (tmp_path / "a.mtl").write_text("newmtl red\nname blue\n")
    (tmp_path / "a.obj").write_text(f"mtllib a.mtl\n{TRIANGLE}usemtl red\nf 1 2 3\n")
    (part,) = mesh_parts(tmp_path / "a.obj")
    assert part.visual.kind != "texture"


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
    code = "from pathlib import Path\nfrom kinseek.meshes.parts import mesh_parts\nassert mesh_parts(Path('a.ply'))"
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
    (tmp_path / "a.png").write_bytes(codecs.BOM_UTF8 + (tmp_path / "a.png").read_bytes())
    assert not pictured()


def test_places_in_an_image_that_no_page_can_read_are_left_out(tmp_path: Path) -> None:
    """JSON with Infinity hid the mesh in the page."""
    image = pytest.importorskip("PIL.Image")
    (tmp_path / "a.mtl").write_text("newmtl red\nmap_Kd a.png\n")
    image.new("1", (8, 8)).save(tmp_path / "a.png")
    for place, fits in (("1 0", True), ("1e39 0", False), ("1e999 0", False)):
        (tmp_path / "a.obj").write_text(
            f"mtllib a.mtl\n{TRIANGLE}vt 0 0\nvt {place}\nvt 0 1\nusemtl red\nf 1/1 2/2 3/3\n"
        )
        (part,) = mesh_parts(tmp_path / "a.obj")
        assert (part.visual.uv is not None) == fits
        assert len(part.faces) == 1


def test_an_image_in_a_file_counts_as_often_as_it_is_named(tmp_path: Path) -> None:
    """213 kB of 9,900 references to an image with many parts took 90 s, and filled 5.7 GiB."""
    data, told = pictured_glb((200, 200), "BMP")
    told |= {"images": told["images"] * 3, "textures": [{"source": i} for i in range(3)]}
    told["materials"] = [{key: {"index": i} for i, key in enumerate(["normalTexture", "occlusionTexture"])}]
    assert len(read(tmp_path, "glb", written_glb(data, **told))) == 1
    told["materials"][0]["emissiveTexture"] = {"index": 2}
    with pytest.raises(InvalidRobot, match="bytes in its images"):
        read(tmp_path, "glb", written_glb(data, **told))


def test_images_inside_a_file_are_too(tmp_path: Path) -> None:
    def image_of(size: tuple[int, int], kind: str = "PNG", **more: Any) -> Any:
        data, told = pictured_glb(size, kind)
        return read(tmp_path, "glb", written_glb(data, **told | more))[0].visual.material.baseColorTexture

    assert image_of((8, 8)).size == (8, 8)
    with pytest.raises(InvalidRobot, match="pixels in its images"):
        image_of((2**13 + 1, 2**13))
    assert image_of((8, 8), "EPS") is None
    assert image_of((8, 8), images=[{"uri": "a.png"}]) is None
    assert image_of((8, 8), images=[]) is None
    assert image_of((8, 8), textures={}) is None


def test_images_of_other_formats_are_not_opened() -> None:
    """Pillow decodes an ICO image when it opens it: this one names a PNG that is not there."""
    pytest.importorskip("PIL.Image")
    icon = struct.pack("<HHHBBBBHHII", 0, 1, 1, 8, 8, 0, 0, 1, 32, 8, 22) + b"\x89PNG\r\n\x1a\n"
    with pytest.raises(InvalidRobot, match="an image is ICO"):
        pixels_of_image(icon)


def test_images_count_for_each_body(tmp_path: Path) -> None:
    data, told = pictured_glb((2**13, 2**13))
    told |= {"nodes": [{"mesh": 0}] * 3, "scenes": [{"nodes": [0, 1, 2]}]}
    with pytest.raises(InvalidRobot, match="201,326,592 pixels in the images of its bodies"):
        read(tmp_path, "glb", written_glb(data, **told))
    data, small = pictured_glb((8, 8))
    (tmp_path / "a.glb").write_bytes(
        written_glb(data, **small | {each: told[each] for each in ("nodes", "scenes")})
    )
    budget = Budget(MOST, 3 * 64)
    assert len(mesh_parts(tmp_path / "a.glb", budget=budget)) == 3
    assert budget.pixels_left == 0
    with pytest.raises(InvalidRobot, match="192 pixels in the images of its bodies, expected at most 0"):
        mesh_parts(tmp_path / "a.glb", budget=budget)


def test_the_meshes_of_a_robot_share_one_budget(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from kinseek.viewer import meshes

    pytest.importorskip("PIL.Image").new("1", (8, 8)).save(tmp_path / "a.png")
    (tmp_path / "a.mtl").write_text("newmtl red\nmap_Kd a.png\n")
    (tmp_path / "a.obj").write_text(
        f"mtllib a.mtl\n{TRIANGLE}vt 0 0\nvt 1 0\nvt 0 1\nusemtl red\nf 1/1 2/2 3/3\n"
    )
    chain = kinseek.load(robot_of(tmp_path, *['<mesh filename="a.obj"/>'] * 3)).chain
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


DART = "2 0 0", "1 1 0", "0 0 0", "1 3 0"
"""Corners of a polygon that the diagonals from its second and last corner divide."""


@pytest.mark.parametrize(
    ("kind", "content"),
    [
        ("obj", "".join(f"v {each}\n" for each in DART) + "f 1 2 3 4\n"),
        (
            "ply",
            ply_header(
                "element vertex 4",
                *(f"property float {axis}" for axis in "xyz"),
                "element face 1",
                "property list uchar int vertex_indices",
                encoding="ascii",
            ).decode()
            + "\n".join([*DART, "4 0 1 2 3\n"]),
        ),
        (
            "dae",
            dae_of(
                " ".join(DART),
                '<polylist count="1"><input semantic="VERTEX" source="#v" offset="0"/><vcount>4</vcount><p>0 1 2 3</p>'
                "</polylist>",
            ),
        ),
    ],
)
def test_polygons_that_are_not_convex_count_together(kind: str, content: str, tmp_path: Path) -> None:
    """45 kB of them took 8 s each time that the file was read, which a URDF of 150 kB may do 1,400 times."""
    path, budget = tmp_path / f"a.{kind}", Budget(MOST, tried_left=8)
    path.write_text(content)
    for _ in range(2):
        assert sum(len(part.faces) for part in mesh_parts(path, MOST, budget=budget)) == 2
    with pytest.raises(InvalidRobot, match="too many corners in polygons that are not convex"):
        mesh_parts(path, MOST, budget=budget)


@pytest.mark.slow
def test_a_robot_that_names_a_large_mesh_many_times(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """126 kB that unpack to 9 million corners took 0.4 s each time that they were named, also beyond all limits."""
    from kinseek.viewer import meshes

    read = list[int]()

    def counted(*given: Any, real: Any) -> Any:
        read.append(1)
        return real(*given)

    def in_this_process(reader: MeshReader, path: Path, most: int) -> Any:
        return reader.budget, pickle.dumps(mesh_parts(path, most, budget=reader.budget))

    monkeypatch.setattr(MeshReader, "_ask", in_this_process)
    for module in (glb, obj):
        monkeypatch.setattr(module, "read", partial(counted, real=module.read))
    (tmp_path / "large.glb").write_bytes(one_glb(nodes=1000, corners=12))
    (tmp_path / "broken.obj").write_text("v 0 0 0\n")
    chain = kinseek.load(robot_of(tmp_path, *['<mesh filename="large.glb"/>'] * 50)).chain
    found = meshes.meshes_of(chain)
    assert (len(read), len(found.missing)) == (11, 40)
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
            limits, "Budget", lambda _, most=most, left=left: Budget((most or 9) * len(box), **left)
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
    (missing,) = meshes_of(kinseek.load(robot_of(tmp_path, '<mesh filename="a.zip"/>')).chain).missing
    assert "must end in .dae" in missing


WITHOUT_MANIFOLD = """
import sys

import kinseek
from kinseek.collision import Mesh
from kinseek.viewer.meshes import meshes_of

if "viewer" in sys.argv:
    assert not meshes_of(kinseek.load("arm.urdf").chain).missing
else:
    assert len(Mesh.read("a.stl").faces) == 12
print("trimesh" in sys.modules)
import manifold3d
"""


@pytest.mark.parametrize("who", ["viewer", "scene"])
def test_trimesh_does_not_import_manifold3d(who: str, tmp_path: Path) -> None:
    """Its wheels look for libraries in a folder below /tmp, where another user can put them."""
    trimesh.creation.box((1.0, 1.0, 1.0)).export(tmp_path / "a.stl")
    robot_of(tmp_path, '<mesh filename="a.stl"/>')
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "manifold3d.py").write_text("print('imported')\n", encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-P", "-c", WITHOUT_MANIFOLD, who],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(tmp_path / "other")},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout == "True\nimported\n"


def test_few_missing_files_get_a_hint_and_broken_ones_count(tmp_path: Path) -> None:
    """A hint takes up to a fifth of a second, and a thousand broken files took half a minute."""
    (tmp_path / "part.stl").write_bytes(b"")
    budget = Budget(2**20)
    said = []
    for _ in range(MOST_HINTS + 1):
        with pytest.raises(InvalidRobot) as caught:
            mesh_parts(tmp_path / "parts.stl", budget=budget)
        said.append("did you mean" in str(caught.value))
    assert said == [True] * MOST_HINTS + [False]
    (tmp_path / "broken.obj").write_text("what\n")
    before = budget.bodies_left
    with pytest.raises(InvalidRobot):
        mesh_parts(tmp_path / "broken.obj", budget=budget)
    assert budget.bodies_left <= before - LEAST_BODIES
