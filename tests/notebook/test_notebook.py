"""What notebooks show: well-formed, escaped, inside its frame, of every kind of result."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

import kinseek
from kinseek import Goal

UR5E = kinseek.load("ur5e")
TARGETS = UR5E.fk(UR5E.sample(30, seed=2))
FAR = kinseek.pose([0.9, 0.4, 0.5], rpy=[3.1, 0.0, 0.0])
SPOILT = np.where(np.arange(30)[:, None, None] == 2, np.nan, TARGETS)
EVIL = "<script>alert('1')</script>&"
FUNCTION = kinseek.Arm.from_fk(
    UR5E.fk, UR5E.lower, UR5E.upper, names=[EVIL, "b", "c", "d", "e", "f"], kinds="revolute", name=EVIL
)


def cell() -> kinseek.Scene:
    pytest.importorskip("coal")
    scene = kinseek.Scene.of(UR5E, capsules=0.05)
    scene.add_box(EVIL, (0.3, 0.3, 0.02), UR5E.fk(np.zeros(6)))
    scene.add_sphere("ball", 0.1, kinseek.pose([-0.5, 0.5, 0.2]))
    scene.attach(
        "part", kinseek.collision.Box((0.05, 0.05, 0.05)), to="tool0", pose=kinseek.pose([0, 0, 0.1])
    )
    scene.add_arm(
        "other", kinseek.Scene.of(kinseek.load("planar2"), capsules=0.05), [0, 0], kinseek.pose([2, 0, 0])
    )
    return scene


SHOWN: dict[str, Callable[[], Any]] = {
    "arm": lambda: UR5E,
    "rail": lambda: kinseek.load("ur10e_rail"),
    "endless": lambda: kinseek.load("jaco2_6"),
    "planar": lambda: kinseek.load("planar2"),
    "function": lambda: FUNCTION,
    "answer": lambda: UR5E.ik(TARGETS[0]),
    "answer of a function": lambda: FUNCTION.ik(TARGETS[0]),
    "out of reach": lambda: UR5E.ik(FAR),
    "invalid": lambda: UR5E.ik(SPOILT[2], bad="skip"),
    "position": lambda: UR5E.ik(Goal.position([0.4, 0.2, 0.3])),
    "direction": lambda: UR5E.ik(Goal.pointing([0.4, 0.2, 0.3], [0, 0, -1])),
    "free axis": lambda: UR5E.ik(Goal.pose(TARGETS[0], free="rz", box={"z": (0, 0.1)})),
    "tool": lambda: UR5E.ik(Goal.pose(TARGETS[0], tool=kinseek.pose([0, 0.1, 0.2]))),
    "batch": lambda: UR5E.ik(SPOILT, bad="skip"),
    "batch of batches": lambda: UR5E.ik(TARGETS.reshape(5, 6, 4, 4)),
    "empty batch": lambda: UR5E.ik(np.zeros((0, 4, 4))),
    "branches": lambda: UR5E.branches(TARGETS[0]),
    "no branches": lambda: UR5E.branches(FAR),
    "branches of many": lambda: UR5E.branches(TARGETS[:12]),
    "witness": lambda: UR5E.prove(TARGETS[0]),
    "proof": lambda: UR5E.prove(FAR),
    "scene": cell,
}


def html(thing: Any) -> str:
    text = thing._repr_html_()
    assert isinstance(text, str)
    return text


@pytest.mark.parametrize("name", SHOWN)
def test_what_is_shown_is_well_formed_and_inside_its_frame(name: str) -> None:
    text = html(SHOWN[name]())
    root = ElementTree.fromstring(f"<page>{text}</page>")
    assert "nan" not in text.replace("<td>nan</td>", "").lower()
    for svg in root.iter("{http://www.w3.org/2000/svg}svg"):
        width, height = float(svg.attrib["width"]), float(svg.attrib["height"])
        drawn = [
            *svg.iter("{http://www.w3.org/2000/svg}polyline"),
            *svg.iter("{http://www.w3.org/2000/svg}polygon"),
        ]
        for line in drawn:
            points = np.array([[float(x) for x in pair.split(",")] for pair in line.attrib["points"].split()])
            assert (points >= 0).all()
            assert (points <= [width, height]).all()


def test_of_every_text_nothing_is_markup() -> None:
    for text in (html(FUNCTION), html(FUNCTION.ik(TARGETS[0])), html(FUNCTION.ik(TARGETS[:2]))):
        assert "<script" not in text
        assert "&lt;script&gt;alert(&#x27;1&#x27;)&lt;/script&gt;&amp;" in text


def test_an_answer_tells_its_values_and_its_errors() -> None:
    solution = UR5E.ik(TARGETS[0])
    text = html(solution)
    assert "Solved: both errors are within their tolerances." in text
    for name, value in solution.joints.items():
        assert f"<td>{name}</td><td>{value:.4f}</td><td>{np.rad2deg(value):.2f}</td>" in text
    assert f"{solution.position_error:.2g} m of 1e-06 m" in text
    assert text.count("<svg") == UR5E.dof + 1
    assert "currentColor" in text


def test_of_many_the_first_are_shown() -> None:
    text = html(UR5E.ik(SPOILT, bad="skip"))
    assert "Solution(29 of 30 solved, 1 invalid" in text
    assert "and 20 more targets" in text
    assert text.count("<td>SOLVED</td>") == 9
    assert "<td>INVALID</td><td>nan</td>" in text
    assert "<td>0, 3</td>" in html(UR5E.ik(TARGETS.reshape(5, 6, 4, 4)))
    assert "and 2 more goals" in html(UR5E.branches(TARGETS[:12]))


def test_all_branches_are_drawn_and_only_what_counts_of_a_target() -> None:
    branches = UR5E.branches(TARGETS[0])
    faint = html(branches).count('stroke-width="2.5"')
    assert faint == len(branches) - 1
    axes = {
        name: html(SHOWN[name]()).count('stroke-dasharray="3 2"')
        for name in ("position", "direction", "answer")
    }
    assert axes == {"position": 0, "direction": 1, "answer": 3}


def test_a_scene_shows_its_bodies_and_what_touches_in_the_middle_of_the_limits() -> None:
    scene = cell()
    text = html(scene)
    for row in (("ball", "obstacle", "sphere", ""), ("part", "carried", "box", "")):
        assert "".join(f"<td>{cell}</td>" for cell in row) in text
    assert "<td>other arm</td><td>capsule</td>" in text
    assert "<script" not in text
    assert (
        "&lt;script&gt;alert(&#x27;1&#x27;)&lt;/script&gt;&amp;</td><td>obstacle</td><td>box</td><td>touches</td>"
        in text
    )
    touching = {name for one in scene.hits(np.zeros(6)) for name in (one.a, one.b)}
    assert text.count("<td>touches</td>") == len(touching)
    assert text.count('<polygon points="') - text.count('fill="#e5484d"') == len(
        {name for name in scene.bodies if name not in touching}
        - set(kinseek.Scene.of(UR5E, capsules=0.05).bodies)
    )


def test_the_outline_of_a_shape_is_the_convex_hull_of_what_is_seen() -> None:
    from scipy.spatial import ConvexHull

    from kinseek.notebook.picture import _half_hull

    points = np.random.default_rng(0).integers(0, 30, (200, 2)).astype(float)
    seen = sorted({(float(x), float(y)) for x, y in points})
    outline = [*_half_hull(seen), *_half_hull(seen[::-1])]
    assert sorted(outline) == sorted(map(tuple, points[ConvexHull(points).vertices].tolist()))
