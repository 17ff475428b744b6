"""COLLADA: every body that a file shows is read, or the file is refused."""

from __future__ import annotations

import re
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
        *(
            ("<translate>2 0 0<", f"<translate>{words}<", "expected 3 finite numbers")
            for words in ("2_0 0 0", "\u0662 0 0", "2\u00a00\u00a00")
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
        ('semantic="VERTEX"', 'semantic="NORMAL"', "0 <input> of VERTEX, expected one"),
        (
            'offset="0"/><p>',
            'offset="1"/><input semantic="VERTEX" source="#v" offset="0"/><p>',
            "2 <input> of VERTEX, expected one",
        ),
        (
            "</mesh>",
            '</mesh><mesh><source id="s"/></mesh>',
            "has a <mesh> beside its first <mesh>, expected one",
        ),
        ("</mesh>", "</mesh><convex_mesh/>", "has a <convex_mesh> beside its first <mesh>"),
        ("<scene>", '<scene><instance_visual_scene url="#scene"/></scene><scene>', "it shows 2 scenes"),
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
        (
            '<vertices id="v">',
            '<source id="t"/><vertices id="v"><input semantic="VERTEX" source="#t"/>',
            "an <input> of VERTEX in <vertices>, expected POSITION",
        ),
        (
            'source="#v" offset="0"/><p>0 1 2</p></triangles>',
            'source="#v" offset="0"/><input semantic="NORMAL" source="#v" offset="1"/><vcount>3</vcount>'
            "<p>0 0 1 0 2 0</p></polylist>",
            "NORMAL from '#v', expected VERTEX, and nothing else, from its <vertices>",
        ),
        (
            'source="#v" offset="0"',
            'source="#s" offset="0"',
            "VERTEX from '#s', expected VERTEX, and nothing else, from its <vertices>",
        ),
        (
            '<visual_scene id="scene">',
            '<visual_scene id="scene"><translate>9 0 0</translate>',
            "its scene has <translate>, expected it in a <node>",
        ),
        (
            '<visual_scene id="scene">',
            '<visual_scene id="scene"><instance_geometry url="#g"/>',
            "its scene has <instance_geometry>, expected it in a <node>",
        ),
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
        (
            "<up_axis>",
            '<unit meter="1_0"/><up_axis>',
            "its unit is '1_0', expected a number of metres above 0",
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
        ("<p>0 1 2<", "<p>0 1 2<!-- --> 2 1 0<", "has a <p> with a comment or an element in it"),
        ("</p>", "</p><p>2 1 0</p>", "with 2 <p>, expected one"),
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
    """The reader divides each polygon by the diagonals from its first corner, and filled the notch of an L."""
    corners = " ".join(str((first + i) % 6) for i in range(6))
    counts = "<vcount>6</vcount>" if kind == "polylist" else ""
    text = dae_of(L_SHAPED, ONE.replace("triangles", kind).replace("<p>0 1 2", f"{counts}<p>{corners}"))
    if first in (0, 3):  # These corners see all others.
        assert sum(part.area for part in read(tmp_path, "dae", text)) == pytest.approx(3)
        return
    with pytest.raises(
        InvalidRobot, match=f"has a <{kind}> with a polygon of 6 corners, not all of which its first"
    ):
        read(tmp_path, "dae", text)


def test_a_polygon_of_collada_that_crosses_itself_is_refused(tmp_path: Path) -> None:
    text = dae_of("0 0 0 1 0 0 0 1 0 1 1 0", ONE.replace("triangles", "polygons").replace("0 1 2", "0 3 1 2"))
    with pytest.raises(InvalidRobot, match="a polygon of 4 corners crosses itself"):
        read(tmp_path, "dae", text)


def test_the_positions_of_collada_are_read_once_for_all_polygons(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They were read for each polygon: 2,000 squares took 1.6 s, and four times as many sixteen times as long."""
    squares, lengths = range(50), list[int]()
    own = np.fromstring

    def counted(text: str, *given: Any, **options: Any) -> Any:
        lengths.append(len(text))
        return own(text, *given, **options)

    monkeypatch.setattr("kinseek.robots.collada.np.fromstring", counted)
    positions = " ".join(f"{i} 0 0 {i} 1 0" for i in range(51))
    corners = "".join(f"<p>{2 * i} {2 * i + 2} {2 * i + 3} {2 * i + 1}</p>" for i in squares)
    text = dae_of(positions, ONE.replace("triangles", "polygons").replace("<p>0 1 2</p>", corners))
    assert sum(part.area for part in read(tmp_path, "dae", text)) == pytest.approx(50)
    assert lengths.count(len(positions)) <= 2  # Once by the checks, and perhaps by the reader.


def test_an_instance_of_collada_without_a_name_is_refused(tmp_path: Path) -> None:
    """The reader showed the last geometry that has no id instead."""
    (geometry,) = re.findall("<geometry.*</geometry>", SHOWN, re.DOTALL)
    nameless = geometry.replace(' id="g"', "", 1)
    text = SHOWN.replace('id="g"', 'id=""').replace("#g", "#")
    text = text.replace("</library_geometries>", f"{nameless}</library_geometries>")
    with pytest.raises(InvalidRobot, match="<instance_geometry> of '#', of which it has 0"):
        read(tmp_path, "dae", text)


def test_a_body_of_collada_may_have_the_name_of_the_root(tmp_path: Path) -> None:
    """trimesh put a body named "world" at the origin, wherever its nodes are."""
    text = SHOWN.replace('id="g"', 'id="world"').replace("#g", "#world")
    text = text.replace('<node id="n">', '<node id="n"><translate>0 5 0</translate>')
    bounds = [part.bounds.tolist() for part in read(tmp_path, "dae", text)]
    assert bounds == [[[0, 5, 0], [1, 6, 0]], [[2, 0, 0], [3, 1, 0]]]


def test_a_scale_next_to_1_is_applied(tmp_path: Path) -> None:
    """trimesh replaced a transform within 1e-5 of a motion by this motion."""
    text = SHOWN.replace("<translate>2 0 0</translate>", "<scale>1.000004 1 1</scale>")
    assert read(tmp_path, "dae", text)[1].extents[0] == pytest.approx(1.000004, abs=1e-7)


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
