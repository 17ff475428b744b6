"""COLLADA: every body that a file shows is read, or the file is refused."""

from __future__ import annotations

import re
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from kinseek import InvalidRobot
from mesh_builders import INSTANCE, ONE, dae, dae_of, read, small_limits

pytest.importorskip("trimesh")


@pytest.fixture(autouse=True)
def _small(monkeypatch: pytest.MonkeyPatch) -> None:
    small_limits(monkeypatch)


PAINTED = """<library_images><image id="i"><init_from>a.png</init_from></image></library_images>
<library_effects><effect id="e"><profile_COMMON>
<newparam sid="su"><surface type="2D"><init_from>i</init_from></surface></newparam>
<newparam sid="sa"><sampler2D><source>su</source></sampler2D></newparam>
<technique sid="c"><phong><diffuse><texture texture="sa" texcoord="UV"/></diffuse></phong></technique>
</profile_COMMON></effect></library_effects>
<library_materials><material id="m"><instance_effect url="#e"/></material></library_materials>"""


MATERIALS = [f'<material id="m{i}"><instance_effect url="#e"/></material>' for i in range(200)]

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
            "'n' has <instance_controller>, expected only",
        ),
        (
            'url="#g"/></node></v',
            'url="#h"/></node></v',
            "<instance_geometry> of '#h', which names nothing; expected one <geometry>",
        ),
        (
            'url="#g"/></node></v',
            'url="b.dae#g"/></node></v',
            "<instance_geometry> of 'b.dae#g', which names nothing",
        ),
        (
            "</node></v",
            '<instance_node url="b.dae#x"/></node></v',
            "<instance_node> of 'b.dae#x', which names nothing",
        ),
        (
            '<instance_geometry url="#g"/></node></v',
            '<instance_node url="#n"/></node><node id="n"/></v',
            "of '#n', which names <node>, <node>; expected one <node>",
        ),
        ("<translate>2 0 0</translate>", "<skew>80 0 1 0 1 0 0</skew>", "the node 'm' has <skew>"),
        (
            "translate>2 0 0</translate",
            "lookat>2 0 0 2 0 -1 0 1 0</lookat",
            "the node 'm' has <lookat>, expected only",
        ),
        (
            "<translate>2 0 0<",
            "<translate>2 0<",
            "the node 'm' has a <translate> of 2 numbers, expected 3",
        ),
        (
            "<translate>2 0 0<",
            "<translate>2 0 x<",
            "the node 'm' has a <translate> of '2 0 x', whose words are not all finite numbers",
        ),
        *(
            ("<translate>2 0 0<", f"<translate>{words}<", "whose words are not all finite numbers")
            for words in ("2_0 0 0", "\u0662 0 0", "2\u00a00\u00a00")
        ),
        (
            "translate>2 0 0</translate",
            f"matrix>{'1 ' * 16}</matrix",
            r"last row is \[1.0, 1.0, 1.0, 1.0\], expected 0, 0",
        ),
        (
            "mesh>",
            "convex_mesh>",
            "the geometry 'g' has <convex_mesh>, expected only <asset>, <extra>, <mesh>",
        ),
        ("triangles", "linestrips", "the geometry 'g' has <linestrips>"),
        ("triangles", "polylist", "in <polylist>, has 0 <vcount>, expected one"),
        (
            "<p>0 1 2</p></triangles>",
            "<vcount>3 3</vcount><p>0 1 2</p></polylist>",
            "6 corners together, but <p> has 3",
        ),
        (
            "<p>0 1 2</p></triangles>",
            "<ph><p>0 1 2</p></ph></polygons>",
            "in <polygons>, has <ph>, expected only",
        ),
        ("<p>0 1 2</p>", "", "in <triangles>, has 0 <p>, expected one"),
        ("<p>0 1 2</p>", "<p>0 1</p>", "in <triangles>, has 2 corners in <p>, expected three for each"),
        ("<p>0 1 2</p>", "<p>0 1 3</p>", "in <triangles>: a face has the index 3, expected one from 0 to 2"),
        ("<p>0 1 2</p>", "<p>0 1 -1</p>", "words are not all whole numbers from 0 on"),
        (
            'offset="0"/><p>',
            'offset="0"/><input semantic="NORMAL" source="#gone" offset="0"/><p>',
            "of NORMAL from '#gone'",
        ),
        (
            'semantic="VERTEX"',
            'semantic="NORMAL"',
            "an <input> of NORMAL from '#v', expected VERTEX from <vertices>",
        ),
        (
            'offset="0"/><p>',
            'offset="1"/><input semantic="VERTEX" source="#v" offset="0"/><p>',
            "has two <input> of VERTEX, expected one",
        ),
        (
            "</mesh>",
            '</mesh><mesh><source id="s"/></mesh>',
            "has 2 <mesh>, expected one",
        ),
        ("</mesh>", "</mesh><convex_mesh/>", "has <convex_mesh>, expected only"),
        (
            "<scene>",
            '<scene><instance_visual_scene url="#scene"/></scene><scene>',
            "it has 2 <scene> elements, expected one",
        ),
        (
            '<input semantic="POSITION"',
            '<input semantic="POSITION" source="#s"/><input semantic="POSITION"',
            "a wrong or second <input> of POSITION in <vertices>",
        ),
        ("<vertices", '<vertices id="w"/><vertices', "has 2 <vertices>, expected one"),
        ("<vertices", '<source id="s"/><vertices', "has two parts with the id 's', expected one"),
        ("<asset>", "<asset/><asset>", "2 <asset> elements, expected one"),
        (
            "<translate>",
            '<translate xmlns="u">',
            "a <translate> of another namespace or prefix than its root",
        ),
        ("<mesh>", '<x:mesh xmlns:x="u"/><mesh>', "a <mesh> of another namespace or prefix than its root"),
        (
            '<vertices id="v">',
            '<source id="t"/><vertices id="v"><input semantic="VERTEX" source="#t"/>',
            "second <input> of VERTEX in <vertices>, expected POSITION",
        ),
        (
            'source="#v" offset="0"/><p>0 1 2</p></triangles>',
            'source="#v" offset="0"/><input semantic="NORMAL" source="#v" offset="1"/><vcount>3</vcount>'
            "<p>0 0 1 0 2 0</p></polylist>",
            "NORMAL from '#v', expected VERTEX from <vertices>, and others",
        ),
        (
            'source="#v" offset="0"',
            'source="#s" offset="0"',
            "VERTEX from '#s', expected VERTEX from <vertices>",
        ),
        (
            '<visual_scene id="scene">',
            '<visual_scene id="scene"><translate>9 0 0</translate>',
            "its <visual_scene> has <translate>, expected only",
        ),
        (
            '<visual_scene id="scene">',
            '<visual_scene id="scene"><instance_geometry url="#g"/>',
            "its <visual_scene> has <instance_geometry>, expected only",
        ),
        ('offset="0"', 'offset="x"', "the offset 'x', expected a whole number"),
        ('source="#s"', 'source="#t"', "an <input> of POSITION from '#t', which is not in its mesh"),
        ('stride="3"', 'stride="4"', "3 rows of 4 from the float 0 on, with 3 params; expected all floats"),
        (
            '<param name="X" type="float"/><param name="Y" type="float"/>\n<param name="Z"',
            '<param name="Z" type="float"/><param name="Y" type="float"/>\n<param name="X"',
            "the params \\['Z', 'Y', 'X'\\], expected X, Y, Z",
        ),
        (
            'accessor source="#f"',
            'accessor source="#h"',
            "values from '#h', expected its own <float_array>",
        ),
        (
            "0 0 0 1 0 0 0 1 0",
            "0 0 0 nan 0 0 0 1 0",
            "a <float_array> of '0 0 0 nan 0 0 0 1 0', whose words are not",
        ),
        (
            '<geometry id="g">',
            '<geometry id="g"><asset><unit meter="10"/></asset>',
            "a unit of '10' m, expected 1 m",
        ),
        (
            "<up_axis>",
            '<unit meter="1_0"/><up_axis>',
            "its unit is '1_0', expected a number of metres above 0",
        ),
        ("<up_axis>", '<unit meter="-1"/><up_axis>', "its unit is '-1', expected a number of metres above 0"),
        (
            'visual_scene url="#scene"',
            'visual_scene url="#other"',
            "of '#other', which names nothing; expected one <visual_scene>",
        ),
        ("<p>0 1 2<", "<p>0 1 2<!-- --> 2 1 0<", "has a <p> with a comment or an element in it"),
        ("</p>", "</p><p>2 1 0</p>", "in <triangles>, has 2 <p>, expected one"),
        (
            "<translate>2 0 0</translate>",
            "<rotate>0 0 2 90</rotate>",
            "expected an axis of length 1",
        ),
    ],
)
def test_what_the_reader_of_collada_would_pass_over_is_refused(
    old: str, new: str, why: str, tmp_path: Path
) -> None:
    """Bodies were left out, so that an arm was free inside of them."""
    assert old in SHOWN
    text = SHOWN.replace(old, new)
    for name in ("polylist", "polygons"):
        if f"</{name}>" in new:
            text = text.replace("<triangles", f"<{name}")
    with pytest.raises(InvalidRobot, match=why):
        read(tmp_path, "dae", text)


L_SHAPED = "0 0 0 2 0 0 2 1 0 1 1 0 1 2 0 0 2 0"


@pytest.mark.parametrize("kind", ["polylist", "polygons"])
@pytest.mark.parametrize("first", range(6))
def test_no_polygon_of_collada_is_filled_beyond_its_sides(first: int, kind: str, tmp_path: Path) -> None:
    """Diagonals from the first corner filled the notch of an L."""
    corners = " ".join(str((first + i) % 6) for i in range(6))
    counts = "<vcount>6</vcount>" if kind == "polylist" else ""
    text = dae_of(L_SHAPED, ONE.replace("triangles", kind).replace("<p>0 1 2", f"{counts}<p>{corners}"))
    assert sum(part.area for part in read(tmp_path, "dae", text)) == pytest.approx(3)


def test_a_polygon_of_collada_that_crosses_itself_is_refused(tmp_path: Path) -> None:
    text = dae_of("0 0 0 1 0 0 0 1 0 1 1 0", ONE.replace("triangles", "polygons").replace("0 1 2", "0 3 1 2"))
    with pytest.raises(InvalidRobot, match="a polygon of 4 corners crosses itself"):
        read(tmp_path, "dae", text)


@pytest.mark.parametrize(
    ("points", "count"),
    [
        # It goes around the first corner one and a quarter times.
        ("0 0 0 1 0 0 1 1 0 -1 1 0 -1.2 -1.2 0 1.4 -1.4 0 1.6 .1 0 1.5 1.5 0 0 1.8 0", 9),
        # A long line beside a small part, whose area is small.
        ("0 0 0 1 0 0 0 0 0 8e-4 4e-4 0 0 4e-4 0 8e-4 0 0", 6),
    ],
)
def test_a_polygon_that_crosses_itself_in_a_way_that_is_hard_to_see_is_refused(
    points: str, count: int, tmp_path: Path
) -> None:
    corners = " ".join(map(str, range(count)))
    text = dae_of(points, ONE.replace("triangles", "polygons").replace("0 1 2", corners))
    with pytest.raises(InvalidRobot, match="crosses itself"):
        read(tmp_path, "dae", text)


def test_a_source_of_collada_is_read_once_for_all_that_refer_to_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It was read for each polygon: 2,000 squares took 1.6 s, and four times as many sixteen times as long."""
    lengths = list[int]()
    own = np.fromstring

    def counted(text: str, *given: Any, **options: Any) -> Any:
        lengths.append(len(text))
        return own(text, *given, **options)

    monkeypatch.setattr("kinseek.meshes.collada_geometry.np.fromstring", counted)
    positions = " ".join(f"{i} 0 0 {i} 1 0" for i in range(51))
    corners = (f"{2 * i} {2 * i + 2} {2 * i + 3} {2 * i + 1}" for i in range(50))
    normals = '<input semantic="NORMAL" source="#s" offset="0"/><p>'
    square = ONE.replace("triangles", "polygons").replace("<p>", normals)
    text = dae_of(positions, "".join(square.replace("0 1 2", each) for each in corners))
    parts = read(tmp_path, "dae", text)
    assert sum(part.area for part in parts) == pytest.approx(50)
    assert lengths.count(len(positions)) == 2  # Once as positions, and once as normals.


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('<instance_geometry url="#g"/></node></v', '<instance_node url="#k"/>' * 200 + "</node></v"),
        ("</mesh>", '<polygons count="20000">' + "<p/>" * 20000 + "</polygons></mesh>"),
        (
            "<library_nodes>",
            f"<library_effects><effect id='e'><profile_COMMON>{'<newparam/>' * 80000}<technique><phong><diffuse>"
            "<texture texture='x'/></diffuse></phong></technique></profile_COMMON></effect></library_effects>"
            f"<library_materials>{''.join(MATERIALS)}</library_materials><library_nodes>",
        ),
        (
            "</vertices>",
            "".join(f'<input semantic="A{i}" source="#s"/>' for i in range(50000)) + "</vertices>",
        ),
    ],
    ids=["nodes", "polygons", "effects", "inputs"],
)
def test_what_collada_shows_often_is_read_once(
    old: str, new: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Files of a megabyte took minutes."""
    monkeypatch.undo()
    many = "".join(ONE.replace("count", f'material="m{i}" count') for i in range(200))
    text = SHOWN.replace(ONE, many if "newparam" in new or "A1" in new else ONE)
    shown = '<instance_geometry url="#g"/>' * (200 if "polygons" in new else 1)
    text = text.replace('<node id="n"><instance_geometry url="#g"/>', f'<node id="n">{shown}')
    node = f'<node id="k">{"<translate>0 0 0</translate>" * 5000}<instance_geometry url="#g"/></node>'
    text = text.replace("<library_nodes>", f"<library_nodes>{node}").replace(old, new)
    began = time.process_time()
    with suppress(InvalidRobot):
        read(tmp_path, "dae", text, 2**24)
    assert time.process_time() - began < 2.0


def test_an_instance_of_collada_without_a_name_is_refused(tmp_path: Path) -> None:
    """The reader showed the last geometry that has no id instead."""
    (geometry,) = re.findall("<geometry.*</geometry>", SHOWN, re.DOTALL)
    nameless = geometry.replace(' id="g"', "", 1)
    text = SHOWN.replace('id="g"', 'id=""').replace("#g", "#")
    text = text.replace("</library_geometries>", f"{nameless}</library_geometries>")
    with pytest.raises(InvalidRobot, match="<instance_geometry> of '#', which names nothing"):
        read(tmp_path, "dae", text)


@pytest.mark.parametrize(
    ("motions", "corner"),
    [
        ("<scale>1.000000001 1 1</scale>", [1.000000001, 0, 0]),
        ("<translate>1e-9 0 0</translate>", [1 + 1e-9, 0, 0]),
        ("<translate>1e8 0 0</translate><translate>-99999999 0 0</translate>", [2, 0, 0]),
        ("<rotate>0 0 1 1e-7</rotate>", [1, np.radians(1e-7), 0]),
        ("<rotate>0 0 0 0</rotate>", [1, 0, 0]),
        ("<translate>0 5 0</translate><rotate>0 0 1 90</rotate><scale>2 1 1</scale>", [0, 7, 0]),
        ("<matrix>0 -1 0 3 1 0 0 4 0 0 1 5 0 0 0 1</matrix>", [3, 5, 5]),
    ],
)
def test_motions_of_collada_are_exact(motions: str, corner: list[float], tmp_path: Path) -> None:
    """Readers in single precision lost what cancels, and motions next to none."""
    text = SHOWN.replace("<translate>2 0 0</translate>", motions)
    part = read(tmp_path, "dae", text)[1]
    np.testing.assert_allclose(part.vertices[part.faces][0, 1], corner, rtol=1e-15, atol=3e-16)


def test_a_unit_next_to_1_is_applied(tmp_path: Path) -> None:
    text = SHOWN.replace("<up_axis>", '<unit meter="1.000001"/><up_axis>')
    np.testing.assert_allclose(
        read(tmp_path, "dae", text)[1].bounds, [[2.000002, 0, 0], [3.000003, 1.000001, 0]], rtol=1e-15
    )


def test_a_mirrored_body_of_collada_keeps_its_outer_sides(tmp_path: Path) -> None:
    """Its triangles are turned around, with their normals."""
    upward = '<input semantic="NORMAL" source="#s" offset="1"/><p>0 0 1 0 2 0'
    text = dae_of("0 0 1 1 0 1 0 1 1", ONE.replace("<p>0 1 2", upward))
    text = text.replace('<node id="n">', '<node id="n"><scale>1 1 -1</scale>')
    (part,) = read(tmp_path, "dae", text)
    assert part.face_normals.tolist() == [[0, 0, -1]]
    assert part.vertex_normals.tolist() == [[0, 0, -1]] * 3


@pytest.mark.parametrize(
    ("kind", "corners", "triangles"),
    [
        ("tristrips", ["0 1 2 3", "4 3 2"], [[0, 1, 2], [2, 1, 3], [4, 3, 2]]),
        ("trifans", ["0 1 2 3", "4 3 2"], [[0, 1, 2], [0, 2, 3], [4, 3, 2]]),
    ],
)
def test_strips_and_fans_of_collada(
    kind: str, corners: list[str], triangles: list[list[int]], tmp_path: Path
) -> None:
    some = "".join(f"<p>{each}</p>" for each in corners)
    text = dae_of(
        "0 0 0 1 0 0 0 1 0 1 1 0 0 2 0",
        ONE + ONE.replace("triangles", kind).replace('count="1"', 'count="2"').replace("<p>0 1 2</p>", some),
    )
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [0, 2, 0]])
    found = read(tmp_path, "dae", text)[1]
    assert found.vertices[found.faces].tolist() == points[triangles].tolist()


def test_primitives_of_collada_keep_their_order(tmp_path: Path) -> None:
    """It separates surfaces of a scene that touch each other; those of one kind came first."""
    strip = ONE.replace("triangles", "tristrips").replace("<p>0 1 2</p>", "<p>1 2 0</p>")
    last = ONE.replace("<p>0 1 2</p>", "<p>2 0 1</p>")
    found = read(tmp_path, "dae", dae(ONE + strip + last))
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]])
    expected = [corners[[order]] for order in ([0, 1, 2], [1, 2, 0], [2, 0, 1])]
    np.testing.assert_array_equal([part.vertices[part.faces] for part in found], expected)


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        ('count="9"', 'count="6"', "has 9 floats; its counts say 6 floats"),
        ('count="3" s', 'count="2" s', "has 9 floats; its counts say 9 floats, and 2 rows of 3"),
        ('<triangles count="1"', '<triangles count="2"', "has the count 2, expected 1"),
        ('<triangles count="1"', "<triangles", "has a <triangles> with the count ''"),
        ('vertices id="v"', "vertices", "has <vertices> without an id"),
        ('vertices id="v"', 'vertices id="s"', "has two parts with the id 's'"),
        (
            'version="1.0"',
            'version="1.0" encoding="cp437"',
            "(Unsupported encoding: cp437|the encoding 'cp437' is not read)",
        ),
        (
            "library_geometries>",
            "library_materials>",
            "at COLLADA/library_materials/geometry, expected it in its library",
        ),
        (
            "<library_nodes>",
            '<node id="k"/><library_nodes>',
            "it has <node> beside its libraries, expected only",
        ),
        ("<library_nodes>", '<library_nodes><node id="s"/>', "refers to '#s', which the file has 2 times"),
        ("<library_nodes>", '<library_nodes><node id="f"/>', "refers to '#f', which the file has 2 times"),
        (
            "</source>",
            '<technique profile="P"><float_array id="f" count="9">0 0 0 9 0 0 0 9 0</float_array></technique></source>',
            "refers to '#f', which the file has 2 times",
        ),
        (
            'offset="0"/><p>',
            'offset="0"/><input semantic="POSITION" source="#s" offset="0"/><p>',
            "an <input> of POSITION from '#s', expected VERTEX from <vertices>",
        ),
        (
            '<instance_geometry url="#g"/></node></v',
            '<c:instance_geometry xmlns:c="http://www.collada.org/2005/11/COLLADASchema" url="#g"/></node></v',
            "a <instance_geometry> of another namespace or prefix than its root",
        ),
        (
            "</triangles>",
            f"</triangles><extra><technique>{ONE}</technique></extra>",
            "a <triangles> in an extension",
        ),
        ("COLLADA", "X3D", "X3D', expected <COLLADA> of http://www.collada.org/2005/11/COLLADASchema"),
        ("2005/11/", "2004/01/", "2004/01/COLLADASchema}COLLADA', expected <COLLADA> of"),
        ("<asset><up_axis>Z_UP</up_axis></asset>", "", "has 0 <asset> elements, expected one"),
        (
            '<node id="m"><translate>2 0 0</translate><instance_geometry url="#g"/>',
            '<node id="m"><instance_node url="#n"><translate>2 0 0</translate></instance_node>',
            "in <instance_node>, has <translate>, expected only <extra>",
        ),
        (
            "<library_nodes>",
            '<library_nodes><node id="g"/>',
            "names <node>, <geometry>; expected one <geometry>",
        ),
        (
            'offset="0"/><p>',
            'offset="0"/><vcount>3</vcount><p>',
            "in <triangles>, has <vcount>, expected only",
        ),
    ],
)
def test_collada_on_which_readers_differ_is_refused(old: str, new: str, why: str, tmp_path: Path) -> None:
    with pytest.raises(InvalidRobot, match=why):
        read(tmp_path, "dae", SHOWN.replace(old, new))


@pytest.mark.parametrize("kind", ["polygons", "tristrips", "trifans"])
def test_a_polygon_of_collada_with_fewer_than_3_corners_is_refused(kind: str, tmp_path: Path) -> None:
    """The blanks between its indices may be missing, and with them a triangle."""
    with pytest.raises(InvalidRobot, match=f"in <{kind}>.* 1 corners"):
        read(tmp_path, "dae", dae(ONE.replace("triangles", kind).replace("0 1 2", "12")))


def test_floats_of_collada_without_an_id_are_not_those_that_are_named_none(tmp_path: Path) -> None:
    """The floats of another mesh with this id are meant, but those of this mesh were read."""
    text = SHOWN.replace('<float_array id="f"', "<float_array").replace('source="#f"', 'source="#None"')
    text = text.replace("<library_nodes>", '<library_nodes><node id="None"/>')
    with pytest.raises(InvalidRobot, match="has <float_array> without an id"):
        read(tmp_path, "dae", text)


def test_looks_of_collada_that_are_broken_are_left_out(tmp_path: Path) -> None:
    """A body whose material was missing was lost."""
    bound = (
        '<instance_geometry url="#g"><bind_material><technique_common><instance_material symbol="a" target="#gone"/>'
        "</technique_common></bind_material></instance_geometry>"
    )
    broken = ONE.replace("<p>", '<input semantic="NORMAL" source="#s" offset="1"/><p>').replace(
        "0 1 2", "0 9 1 9 2 9"
    )
    parts = read(tmp_path, "dae", dae(broken, scene=f"<node>{bound}</node>"))
    assert [len(part.faces) for part in parts] == [1]
    assert not parts[0].visual.defined


def test_looks_of_collada(tmp_path: Path) -> None:
    image = pytest.importorskip("PIL.Image").new("RGB", (2, 3))
    image.save(tmp_path / "a b.png")
    source = (
        '<source id="t"><float_array id="u" count="6">0 0 0.5 1 1 0</float_array><technique_common><accessor source="#u" '
        'count="3" stride="2"><param name="S"/><param name="T"/></accessor></technique_common></source>'
    )
    shape = ONE.replace("<p>0 1 2", '<input semantic="TEXCOORD" source="#t" offset="1"/><p>0 2 1 1 2 0')
    bound = INSTANCE.replace(
        "/></node>",
        '><bind_material><technique_common><instance_material symbol="M" target="#m"/></technique_common></bind_material>'
        "</instance_geometry></node>",
    )
    text = dae(source + shape.replace("count", 'material="M" count') + ONE, scene=bound).decode()
    text = text.replace(
        "<library_geometries>", PAINTED.replace("a.png", "a%20b.png") + "<library_geometries>"
    )
    painted, plain = read(tmp_path, "dae", text)
    assert painted.visual.material.baseColorTexture.size == image.size
    assert painted.visual.uv[painted.faces[0]].tolist() == [[1, 0], [0.5, 1], [0, 0]]
    assert not plain.visual.defined
    coloured = text.replace('<texture texture="sa" texcoord="UV"/>', "<color>1 0.2 0 1</color>")
    assert read(tmp_path, "dae", coloured)[0].visual.material.baseColorFactor.tolist() == [255, 51, 0, 255]
    (tmp_path / "cut.png").write_bytes((tmp_path / "a b.png").read_bytes()[:-20])
    for name in ("gone.png", "cut.png"):
        unread = read(tmp_path, "dae", text.replace("a%20b.png", name))
        assert unread[0].visual.material.baseColorTexture is None


def test_colours_of_the_corners_of_collada(tmp_path: Path) -> None:
    colour = '<input semantic="COLOR" source="#s" offset="1"/><p>0 1 1 2 2 0'
    (part,) = read(tmp_path, "dae", dae(ONE.replace("<p>0 1 2", colour)))
    assert part.visual.vertex_colors[part.faces[0]].tolist() == [
        [255, 0, 0, 255],
        [0, 255, 0, 255],
        [0, 0, 0, 255],
    ]


def test_the_motion_of_a_light_of_collada_is_not_read(tmp_path: Path) -> None:
    """Robots were refused for the axis of a lamp that is not of length 1."""
    lamp = '<node><rotate>0.5 0.5 0 20</rotate><instance_light url="#l"/></node>'
    assert len(read(tmp_path, "dae", dae(scene=lamp + INSTANCE))) == 1


def test_collada_is_read_with_all_that_has_no_shape(tmp_path: Path) -> None:
    text = SHOWN.replace("<instance_geometry", '<instance_light url="#gone"/><extra/><instance_geometry', 1)
    text = text.replace("<up_axis>Z_UP", '<unit meter="0.5"/><up_axis>Y_UP')
    text = text.replace(
        "</mesh>",
        '<triangles count="0"><input semantic="VERTEX" source="#v" offset="0"/><p/></triangles></mesh>',
    )
    parts = read(tmp_path, "dae", text)
    assert [part.bounds.tolist() for part in parts] == [
        [[0, 0, 0], [0.5, 0.5, 0]],
        [[1, 0, 0], [1.5, 0.5, 0]],
    ]


@pytest.mark.parametrize("kind", ["triangles", "polylist", "polygons", "tristrips"])
def test_no_polygons_of_collada_need_no_numbers(kind: str, tmp_path: Path) -> None:
    none = f'<{kind} count="0"><input semantic="VERTEX" source="#v" offset="0"/></{kind}>'
    shown = read(tmp_path, "dae", SHOWN)
    parts = read(tmp_path, "dae", SHOWN.replace("</mesh>", f"{none}</mesh>"))
    assert [part.triangles.tolist() for part in parts] == [part.triangles.tolist() for part in shown]


@pytest.mark.parametrize("inside", ["<vcount>3</vcount>", "<p>0 1 2</p>"])
def test_polygons_of_collada_beside_a_count_of_0_are_refused(inside: str, tmp_path: Path) -> None:
    wrong = f'<polylist count="0"><input semantic="VERTEX" source="#v" offset="0"/>{inside}</polylist>'
    with pytest.raises(InvalidRobot, match="in <polylist>,"):
        read(tmp_path, "dae", SHOWN.replace("</mesh>", f"{wrong}</mesh>"))


def test_images_count_for_each_instance_of_collada(tmp_path: Path) -> None:
    pytest.importorskip("PIL.Image").new("1", (2**13, 2**13)).save(tmp_path / "a.png")
    bound = (
        '<instance_geometry url="#g"><bind_material><technique_common><instance_material symbol="M" target="#m"/>'
        "</technique_common></bind_material></instance_geometry>"
    )
    text = dae(ONE.replace('count="1"', 'count="1" material="M"'), scene=f"<node>{bound * 3}</node>")
    text = text.replace(b"<library_geometries>", PAINTED.encode() + b"<library_geometries>")
    with pytest.raises(InvalidRobot, match="201,326,592 pixels in the images of its bodies"):
        read(tmp_path, "dae", text)
