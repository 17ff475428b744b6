"""GLB: what the specification says about shapes is read, or the file is refused."""

from __future__ import annotations

import json
import struct
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from kinseek import InvalidRobot
from kinseek.meshes import glb
from kinseek.meshes.limits import Size
from kinseek.meshes.parts import mesh_parts
from kinseek.support.transforms import rotation
from mesh_builders import changed_glb, glb_parts, one_glb, pictured_glb, written_glb

pytest.importorskip("trimesh")

Array = NDArray[Any]

CORNERS = np.arange(15, dtype="<f4").reshape(5, 3) ** 2
"""Five vertices."""


def read(text: bytes, looks: bool = False) -> list[Any]:
    return glb.read(text, list[Size]().append, looks)[0]


def triangles(text: bytes) -> Array:
    return np.concatenate([body.vertices[body.faces] for body in read(text)])


def with_indices(numbers: list[int], kind: str = "<u2", mode: int = 4, **view: Any) -> bytes:
    """A body of `CORNERS` with indices."""
    code = {"<u1": 5121, "<u2": 5123, "<u4": 5125}[kind]
    told, indices = glb_parts(5), np.array(numbers, kind).tobytes()
    told["bufferViews"].append({"buffer": 0, "byteOffset": 60, "byteLength": len(indices), **view})
    told["accessors"].append(
        {"bufferView": 1, "componentType": code, "count": len(numbers), "type": "SCALAR"}
    )
    told["meshes"][0]["primitives"][0] |= {"indices": 1, "mode": mode}
    return written_glb(CORNERS.tobytes() + indices, **told)


def with_nodes(*nodes: dict[str, Any], roots: tuple[int, ...] = (0,), **more: Any) -> bytes:
    """A triangle in nodes."""
    told = glb_parts() | {"nodes": [*nodes], "scenes": [{"nodes": [*roots]}]} | more
    return written_glb(np.eye(3, dtype="<f4").tobytes(), **told)


def chunked(*chunks: tuple[int, bytes], version: int = 2, more: int = 0) -> bytes:
    """A file of chunks, each of a kind, that says that it is longer by some bytes."""
    text = b"".join(struct.pack("<II", len(each), kind) + each for kind, each in chunks)
    return struct.pack("<III", 0x46546C67, version, 12 + len(text) + more) + text


JSON, BINARY = 0x4E4F534A, 0x004E4942
TOLD = json.dumps({"asset": {"version": "2.0"}, "buffers": [{"byteLength": 36}], **glb_parts()}).encode()
DATA = np.eye(3, dtype="<f4").tobytes()


@pytest.mark.parametrize("kind", ["<u1", "<u2", "<u4"])
@pytest.mark.parametrize(
    ("mode", "corners"),
    [
        (4, [(0, 2, 1), (4, 3, 0)]),
        (5, [(0, 2, 1), (2, 4, 1), (1, 4, 3), (4, 0, 3)]),
        (6, [(2, 1, 0), (1, 4, 0), (4, 3, 0), (3, 0, 0)]),
    ],
)
def test_triangles_strips_and_fans(mode: int, corners: list[tuple[int, ...]], kind: str) -> None:
    """The order of the corners is that of the equations of section 3.7.2.1; fans were refused."""
    numbers = [0, 2, 1, 4, 3, 0]
    text = with_indices(numbers, kind, mode)
    assert np.array_equal(triangles(text), CORNERS[corners].astype(np.float64))
    (body,) = read(text)
    assert body.vertices.dtype == np.float64


def test_positions_without_indices_are_corners_one_after_the_other() -> None:
    data = CORNERS.tobytes()
    for mode, corners in ((5, [(0, 1, 2), (1, 3, 2), (2, 3, 4)]), (6, [(1, 2, 0), (2, 3, 0), (3, 4, 0)])):
        told = glb_parts(5)
        told["meshes"][0]["primitives"][0]["mode"] = mode
        assert np.array_equal(triangles(written_glb(data, **told)), CORNERS[corners])


@pytest.mark.parametrize("mode", [0, 1, 2, 3])
def test_points_and_lines_have_no_surface(mode: int) -> None:
    told = glb_parts()
    told["meshes"][0]["primitives"].append({"attributes": {}, "mode": mode})
    assert len(triangles(written_glb(DATA, **told))) == 1


def test_numbers_lie_at_offsets_with_other_bytes_between_them() -> None:
    rows = np.full((3, 20), 0xFF, np.uint8)
    rows[:, :12] = CORNERS[:3].view(np.uint8)
    told = glb_parts()
    told["bufferViews"] = [{"buffer": 0, "byteOffset": 4, "byteLength": 60, "byteStride": 20}]
    told["accessors"][0]["byteOffset"] = 4
    # The last element ends with its numbers, not with its stride.
    assert np.array_equal(
        triangles(
            written_glb(
                bytes(8) + rows.tobytes()[:56],
                **told
                | {"bufferViews": [{"buffer": 0, "byteOffset": 4, "byteLength": 56, "byteStride": 20}]},
            )
        ),
        CORNERS[None, :3],
    )
    assert np.array_equal(triangles(written_glb(bytes(8) + rows.tobytes(), **told)), CORNERS[None, :3])


def test_motions_are_applied_exactly() -> None:
    """trimesh left out motions of less than 1e-8, and scales within 1e-5 of 1."""
    turn = [0.0, 0.0, 5e-10, 1.0]
    (small,) = triangles(with_nodes({"mesh": 0, "rotation": turn, "translation": [1e-9, 0, 0]}))
    assert np.allclose(small[0], [1 + 1e-9, 1e-9, 0], rtol=0, atol=1e-16)
    (scaled,) = triangles(with_nodes({"mesh": 0, "scale": [1 + 1e-12, 1, 1 - 1e-6]}))
    assert np.array_equal(scaled, np.diag([1 + 1e-12, 1, 1 - 1e-6]))
    (moved,) = triangles(
        with_nodes({"mesh": 0, "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 1e-15, 2, 3, 1]})
    )
    assert np.array_equal(moved, np.eye(3) + np.array([1e-15, 2, 3]))


def test_motions_are_scaled_turned_and_moved_in_this_order() -> None:
    half = np.sqrt(0.5)
    inner = {"mesh": 0, "scale": [2, 3, 4], "rotation": [half, 0, 0, half], "translation": [5, 6, 7]}
    outer = {"children": [1], "rotation": [0, 0, half * 1.00005, half * 1.00005], "translation": [1, 0, 0]}
    (found,) = triangles(with_nodes(outer, inner))
    expected = np.diag([2.0, 3.0, 4.0]) @ rotation(np.array([1.0, 0, 0]), np.pi / 2).T + [5, 6, 7]
    expected = expected @ rotation(np.array([0, 0, 1.0]), np.pi / 2).T + [1, 0, 0]
    # A length within the tolerance does not stretch the body.
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-14)


def test_mirrored_bodies_keep_their_outer_side_outside() -> None:
    told = glb_parts(5)
    told["accessors"].append(told["accessors"][0])
    told["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] = 1
    told["nodes"] = [{"mesh": 0}, {"mesh": 0, "scale": [-1, 1, 1]}]
    told["scenes"] = [{"nodes": [0, 1]}]
    told["meshes"][0]["primitives"][0]["mode"] = 5
    one, other = read(written_glb(CORNERS.tobytes(), **told), looks=True)
    mirror = np.array([-1.0, 1.0, 1.0])
    assert np.array_equal(other.vertices[other.faces], (one.vertices[one.faces] * mirror)[:, ::-1])
    np.testing.assert_allclose(other.normals, one.normals * mirror, atol=1e-12)


@pytest.mark.parametrize("size", [1e-200, 1e200])
def test_mirrored_bodies_of_any_size_keep_their_outer_side_outside(size: float) -> None:
    """The determinant of their motion lost its sign when it was too small, and normals their direction."""
    told = glb_parts() | {"nodes": [{"mesh": 0, "scale": [-size, size, size]}]}
    told["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] = 0
    (body,) = read(written_glb(DATA, **told), looks=True)
    mirror = np.array([-1.0, 1.0, 1.0])
    assert np.array_equal(body.vertices[body.faces][0], (size * np.eye(3) * mirror)[::-1])
    np.testing.assert_allclose(body.normals, np.eye(3) * mirror, atol=1e-12)


def test_vertices_that_no_triangle_has_may_be_anything(tmp_path: Path) -> None:
    corners = CORNERS.copy()
    corners[3], corners[1, 0] = np.nan, np.inf
    text = with_indices([0, 2, 4]).replace(CORNERS.tobytes(), corners.tobytes())
    (tmp_path / "a.glb").write_bytes(text)
    (part,) = mesh_parts(tmp_path / "a.glb")
    assert np.array_equal(part.vertices, corners[[0, 2, 4]])
    (tmp_path / "a.glb").write_bytes(with_indices([0, 2, 3]).replace(CORNERS.tobytes(), corners.tobytes()))
    with pytest.raises(InvalidRobot, match="not of three finite numbers"):
        mesh_parts(tmp_path / "a.glb")


def test_bodies_that_share_positions_have_their_own_only() -> None:
    """Each body had all of them, up to gigabytes."""
    (body,) = read(with_indices([4, 2, 0]))
    assert body.vertices.shape == (3, 3)
    assert np.array_equal(body.vertices[body.faces], CORNERS[[[4, 2, 0]]])


def test_bodies_that_share_many_positions_take_a_time_that_does_not_grow_with_them() -> None:
    """Each of them counted all positions: a file of 60 MB took minutes."""
    told = glb_parts(5 * 10**6)
    told["bufferViews"].append({"buffer": 0, "byteOffset": 60 * 10**6, "byteLength": 12})
    told["accessors"].append({"bufferView": 1, "componentType": 5125, "count": 3, "type": "SCALAR"})
    told["meshes"][0]["primitives"] = [{"attributes": {"POSITION": 0}, "indices": 1}] * 2000
    text = written_glb(bytes(60 * 10**6) + np.array([0, 1, 999_999], "<u4").tobytes(), **told)
    began = time.perf_counter()
    assert len(read(text)) == 2000
    assert time.perf_counter() - began < 4.0


@pytest.mark.parametrize("broken", [{"count": [0] * 300_000}, {"type": [0] * 300_000}])
def test_a_broken_accessor_that_many_bodies_name_takes_little_time(broken: dict[str, Any]) -> None:
    """Its error showed the beginning of it, but all of it was written first: a file of 3 MB took minutes."""
    told = glb_parts()
    told["accessors"].append(told["accessors"][0] | broken)
    told["meshes"][0]["primitives"] = [{"attributes": {"POSITION": 0, "NORMAL": 1, "COLOR_0": 1}}] * 200
    text = written_glb(np.eye(3, dtype="<f4").tobytes(), **told)
    began = time.process_time()
    assert len(read(text, looks=True)) == 200
    assert time.process_time() - began < 1.0


def test_a_long_chain_of_nodes_is_read() -> None:
    """trimesh walked from the root to each node: this took minutes."""
    nodes = [{"mesh": 0, "children": [i + 1], "translation": [1, 0, 0]} for i in range(5000)]
    found = triangles(with_nodes(*nodes, {"mesh": 0}))
    assert np.array_equal(found[-1], np.eye(3) + np.array([5000, 0, 0]))
    with pytest.raises(InvalidRobot, match="10,001 nodes"):
        read(with_nodes(*[{"children": [i + 1]} for i in range(10_000)], {}))


def test_a_camera_hides_nothing() -> None:
    """trimesh passed over the bodies of a node that is a camera, and over the nodes below it."""
    text = with_nodes(
        {"mesh": 0, "camera": 0, "children": [1]}, {"mesh": 0}, cameras=[{"type": "perspective"}]
    )
    assert len(triangles(text)) == 2


def test_other_scenes_are_not_shown() -> None:
    """The bodies of nodes that are not shown are not read, and need not be right."""
    odd = {"mesh": 0, "skin": 0}
    assert len(triangles(with_nodes({"mesh": 0}, odd))) == 1
    assert len(triangles(with_nodes(odd, {"mesh": 0}, scenes=[{"nodes": [0]}, {"nodes": [1]}], scene=1))) == 1
    text = with_nodes({"mesh": 0}, scenes=[])
    assert glb.read(text, list[Size]().append, True) == ([], {})


def test_other_chunks_are_ignored() -> None:
    text = chunked((JSON, TOLD), (BINARY, DATA), (0x12345678, b"abcd"), (0, b""))
    assert np.array_equal(triangles(text), [np.eye(3)])


def json_with(text: str) -> bytes:
    """A file whose description has another text in the place of its first node."""
    return chunked((JSON, TOLD.replace(b'{"mesh": 0}', text.encode())), (BINARY, DATA))


def extended(where: str, name: str) -> bytes:
    return changed_glb(where, {"extensions": {name: {}}})


def in_view(**change: Any) -> bytes:
    return changed_glb("", {"bufferViews": [{"buffer": 0, "byteLength": 36, **change}]})


REFUSED = {
    "cut": (chunked((JSON, TOLD), (BINARY, DATA))[:-1], "and a length of"),
    "longer": (chunked((JSON, TOLD), (BINARY, DATA)) + b"\0\0\0\0", "and a length of"),
    "a length that is wrong": (chunked((JSON, TOLD), (BINARY, DATA), more=4), "and a length of"),
    "version 1": (chunked((JSON, TOLD), (BINARY, DATA), version=1), "expected 'glTF', version 2"),
    "no JSON": (chunked((BINARY, DATA)), "expected JSON first"),
    "JSON last": (chunked((BINARY, DATA), (JSON, TOLD)), "expected JSON first"),
    "two JSON": (chunked((JSON, TOLD), (JSON, TOLD)), "expected JSON first"),
    "bytes too late": (chunked((JSON, TOLD), (7, b""), (BINARY, DATA)), "chunk 3 is of the kind 0x4e4942"),
    "bytes twice": (chunked((JSON, TOLD), (BINARY, DATA), (BINARY, DATA)), "one binary chunk only"),
    "many chunks": (chunked((JSON, TOLD), (BINARY, DATA), *[(7, b"")] * 1000), "1,001 chunks"),
    "a chunk that is too long": (
        chunked((JSON, TOLD), (BINARY, DATA)).replace(
            struct.pack("<II", 36, BINARY), struct.pack("<II", 40, BINARY)
        ),
        "goes beyond",
    ),
    "bytes after the last chunk": (chunked((JSON, TOLD), more=4) + bytes(4), "goes beyond its"),
    "Latin-1": (
        json_with('{"mesh": 0, "name": "é"}').replace("é".encode(), b"\xe9 "),
        "cannot be read: 'utf-8'",
    ),
    "a byte order mark": (chunked((JSON, b"\xef\xbb\xbf" + TOLD), (BINARY, DATA)), "cannot be read"),
    "deep": (chunked((JSON, b"[" * 100_000), (BINARY, DATA)), "cannot be read"),
    "a list": (chunked((JSON, b"[1]"), (BINARY, DATA)), "its JSON is [1], expected an object"),
    "an infinity": (json_with('{"mesh": 0, "translation": [1e999, 0, 0]}'), "expected 3 finite numbers"),
    "glTF 1": (changed_glb("", {"asset": {"version": "1.0"}}), "of version '1.0'"),
    "no version": (changed_glb("", {"asset": {}}), "of version None"),
    "a later version": (changed_glb("", {"asset": {"version": "2.1", "minVersion": "2.1"}}), "from '2.1' on"),
    "a scene that is missing": (changed_glb("", {"scene": 1}), "element 1 of 'scenes', of which it has 1"),
    "no scenes": (changed_glb("", {"scenes": [], "scene": 0}), "element 0 of 'scenes', of which it has 0"),
    "a node that is missing": (with_nodes({"children": [7]}), "element 7 of 'nodes'"),
    "a node in itself": (with_nodes({"children": [0]}), "expected each once"),
    "nodes in each other": (with_nodes({"children": [1]}, {"children": [0]}), "expected each once"),
    "two parents": (with_nodes({"children": [2]}, {"children": [2]}, {"mesh": 0}), "expected each once"),
    "a shown node in another": (with_nodes({"mesh": 0}, {"children": [0]}), "expected each once"),
    "children": (with_nodes({"mesh": 0, "children": {}}), "'children' is {}, expected a list"),
    "a mesh that is missing": (with_nodes({"mesh": 1}), "element 1 of 'meshes'"),
    "a node that is a number": (with_nodes(5), "element 0 of 'nodes' is 5"),  # type: ignore[arg-type]
    "attributes": (changed_glb("part", {"attributes": [0]}), "'attributes' is [0], expected an object"),
    "place": (
        with_nodes({"mesh": 0}, extensions={"CESIUM_RTC": {"center": [1, 2, 3]}}),
        "a place of its own",
    ),
    "scenes": (with_nodes({"mesh": 0}, scenes=[{"nodes": [0]}] * 2), "2 scenes and names none"),
    "no primitives": (with_nodes({"mesh": 0}, meshes=[{"primitive": []}]), "a mesh has no primitives"),
    "empty primitives": (with_nodes({"mesh": 0}, meshes=[{"primitives": []}]), "a mesh has no primitives"),
    "weights": (changed_glb("mesh", {"weights": ["0"]}), "morphed"),
    "extensions": (changed_glb("part", {"extensions": []}), "'extensions' is []"),
    "visibility": (extended("node", "KHR_node_visibility"), "a node has a visibility (KHR_node_visibility)"),
    "levels": (extended("node", "MSFT_lod"), "a node has levels of detail (MSFT_lod)"),
    "articulations": (extended("node", "AGI_articulations"), "a node has articulations"),
    "compressed": (
        in_view(extensions={"EXT_meshopt_compression": {}}),
        "'EXT_meshopt_compression', expected none",
    ),
    "of a video": (extended("accessor", "MPEG_accessor_timed"), "'MPEG_accessor_timed', expected none"),
    "another file": (changed_glb("", {"buffers": [{"byteLength": 36, "uri": "a.bin"}]}), "in other files"),
    "another buffer": (in_view(buffer=1), "in other files or buffers"),
    "a buffer beyond its chunk": (
        changed_glb("", {"buffers": [{"byteLength": 40}]}),
        "36 are in the binary chunk",
    ),
    "no bytes": (chunked((JSON, TOLD)), "0 are in the binary chunk"),
    "a view beyond its buffer": (in_view(byteOffset=4), "the bytes from 4 to 40 of 36"),
    "an accessor beyond its view": (changed_glb("accessor", {"byteOffset": 4}), "an accessor has 3 elements"),
    "no elements": (changed_glb("accessor", {"count": 0}), "expected at least one"),
    "no view": (
        written_glb(
            DATA, **glb_parts() | {"accessors": [{"componentType": 5126, "count": 3, "type": "VEC3"}]}
        ),
        "'bufferView' is None",
    ),
    "an odd place": (changed_glb("accessor", {"byteOffset": 2, "count": 2}), "expected multiples of 4"),
    "a small stride": (in_view(byteStride=8), "a byteStride of 8, expected 12 to 252"),
    "a large stride": (in_view(byteStride=256), "a byteStride of 256"),
    "an odd stride": (in_view(byteStride=14), "expected multiples of 4"),
    "indices with spaces": (with_indices([0, 1, 2], byteStride=4), "a byteStride of 4, expected 2"),
    "an index": (with_indices([0, 1, 5]), "the index 5, expected one from 0 to 4"),
    "the index that begins a new strip": (with_indices([0, 1, 65535], mode=5), "the index 65535"),
    "four corners": (with_indices([0, 1, 2, 3]), "a body has 4 corners"),
    "two corners": (with_indices([0, 1], mode=5), "a body has 2 corners"),
    "a strip without corners": (with_indices([], mode=5), "expected at least one"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_read_is_refused(name: str) -> None:
    text, why = REFUSED[name]
    with pytest.raises(InvalidRobot) as caught:
        read(text)
    assert why in str(caught.value)


def test_the_largest_index_of_its_type_is_refused_though_it_exists() -> None:
    """In some readers it begins a new strip, in others it is a vertex."""
    told = glb_parts(256)
    told["bufferViews"].append({"buffer": 0, "byteOffset": 256 * 12, "byteLength": 3})
    told["accessors"].append({"bufferView": 1, "componentType": 5121, "count": 3, "type": "SCALAR"})
    told["meshes"][0]["primitives"][0]["indices"] = 1
    with pytest.raises(InvalidRobot, match="the index 255, expected one from 0 to 254"):
        read(written_glb(np.zeros((256, 3), "<f4").tobytes() + bytes([0, 1, 255]), **told))


def test_sizes_are_told_before_anything_is_read() -> None:
    """A strip has three corners for each of its triangles; nodes count as bodies."""

    class Stop(Exception):
        pass

    def stop(size: Size) -> None:
        sizes.append(size)
        raise Stop

    sizes = list[Size]()
    for text in (
        one_glb(corners=5, count=5, mode=5),
        one_glb(nodes=7),
        with_nodes({"mesh": 0, "children": [1]}, {}),
    ):
        with pytest.raises(Stop):
            glb.read(text, stop, True)
    assert sizes == [Size(1, 9), Size(7, 21), Size(2, 3)]


def looks_of(change: dict[str, Any], material: dict[str, Any]) -> tuple[Any, dict[str, Any]]:
    """The body and the material of a file of a picture, with changes to its attributes."""
    data, told = pictured_glb((8, 8))
    extra = np.array([[0, 0.25], [1, 0], [0.5, 1]], "<f4").tobytes() + bytes(range(0, 120, 10))
    data += bytes(-len(data) % 4)
    told["bufferViews"] += [
        {"buffer": 0, "byteOffset": len(data), "byteLength": 24},
        {"buffer": 0, "byteOffset": len(data) + 24, "byteLength": 12, "byteStride": 4},
    ]
    told["accessors"] += [
        {"bufferView": 2, "componentType": 5126, "count": 3, "type": "VEC2"},
        {"bufferView": 3, "componentType": 5121, "count": 3, "type": "VEC2", "normalized": True},
        {"bufferView": 3, "componentType": 5121, "count": 3, "type": "VEC4", "normalized": True},
    ]
    told["meshes"][0]["primitives"][0]["attributes"] |= change
    told["materials"][0] |= material
    (body,), looks = glb.read(written_glb(data + extra, **told), list[Size]().append, True)
    return body, looks["0"]


def test_places_in_pictures_and_colours_are_read() -> None:
    body, look = looks_of({"TEXCOORD_0": 1, "COLOR_0": 3}, {})
    assert np.array_equal(body.uv, np.array([[0, 0.75], [1, 1], [0.5, 0]]))  # Upwards, as trimesh counts.
    assert np.array_equal(body.vertex_colours, np.arange(0, 120, 10).reshape(3, 4))
    assert look["baseColorTexture"].startswith(b"\x89PNG")
    body, _ = looks_of({"TEXCOORD_0": 2}, {})
    np.testing.assert_allclose(body.uv, [[0, 245 / 255], [40 / 255, 205 / 255], [80 / 255, 165 / 255]])


def test_materials_are_read() -> None:
    pbr: dict[str, Any] = {
        "baseColorFactor": [0.1, 0.2, 0.3, 0.4],
        "metallicFactor": 0.5,
        "roughnessFactor": 1,
    }
    same = {"alphaMode": "MASK", "alphaCutoff": 0.25, "doubleSided": True}
    _, look = looks_of({}, {"pbrMetallicRoughness": pbr, "emissiveFactor": [1, 0, 0.5], "name": "a", **same})
    assert {key: value for key, value in look.items() if key in same} == same
    assert np.array_equal(look["baseColorFactor"], pbr["baseColorFactor"])
    assert np.array_equal(look["emissiveFactor"], [1, 0, 0.5])
    assert (look["metallicFactor"], look["roughnessFactor"]) == (0.5, 1.0)


@pytest.mark.parametrize(
    ("change", "material"),
    [
        ({"TEXCOORD_0": 9, "COLOR_0": -1, "NORMAL": None}, {}),
        ({"TEXCOORD_0": 3, "COLOR_0": 1, "NORMAL": 1}, {}),
        ({}, {"pbrMetallicRoughness": [], "alphaMode": {}, "doubleSided": 1, "emissiveFactor": [2, 0, 0]}),
        ({}, {"pbrMetallicRoughness": {"baseColorFactor": ["a"] * 4, "metallicFactor": [1]}}),
        ({}, {"normalTexture": {"index": 5}, "occlusionTexture": {"index": True}, "emissiveTexture": 3}),
        ({}, {"normalTexture": {"index": 0, "texCoord": 1}}),
    ],
)
def test_looks_that_cannot_be_read_are_left_out(change: dict[str, Any], material: dict[str, Any]) -> None:
    body, look = looks_of(change, material)
    assert body.uv is body.vertex_colours is body.normals is None
    assert look.keys() <= {"baseColorTexture"}
    assert body.vertices.shape == (3, 3)


def test_colours_and_normals_of_one_body(tmp_path: Path) -> None:
    """The colours of vertices had lost their vertices when each corner had got a normal of its own."""
    told = glb_parts()
    told["bufferViews"].append({"buffer": 0, "byteOffset": 36, "byteLength": 12})
    told["accessors"].append(
        {"bufferView": 1, "componentType": 5121, "count": 3, "type": "VEC4", "normalized": True}
    )
    told["meshes"][0]["primitives"][0] = {"attributes": {"POSITION": 0, "NORMAL": 0, "COLOR_0": 1}, "mode": 6}
    (tmp_path / "a.glb").write_bytes(written_glb(DATA + bytes(range(100, 112)), **told))
    (part,) = mesh_parts(tmp_path / "a.glb")
    assert np.array_equal(part.vertices[part.faces], np.eye(3)[[[1, 2, 0]]])
    assert np.array_equal(part.vertex_normals[part.faces], np.eye(3)[[[1, 2, 0]]])
    expected = np.arange(100, 112).reshape(3, 4)[[[1, 2, 0]]]
    assert np.array_equal(part.visual.vertex_colors[part.faces], expected)


def test_looks_are_not_read_for_collisions() -> None:
    told = glb_parts()
    told["meshes"][0]["primitives"][0] |= {"attributes": {"POSITION": 0, "NORMAL": 0}, "material": 0}
    told["materials"] = [{"doubleSided": True}]
    bodies, looks = glb.read(written_glb(DATA, **told), list[Size]().append, False)
    assert (bodies[0].normals, bodies[0].material, looks) == (None, "", {})
