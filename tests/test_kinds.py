"""A kind of goal is known in one place: elsewhere its numbers are read, and never its name."""

from __future__ import annotations

import ast
from pathlib import Path

import numpy as np
import pytest

import kinseek
from kinseek import Goal
from kinseek.kinds import KINDS, Kind

SOURCE = Path(kinseek.__file__).parent
KNOW = {"goal.py", "kinds.py", "unknown_arguments.py"}  # The last one has arguments of these names.


@pytest.mark.slow
def test_no_file_but_goal_and_kinds_has_a_table_of_kinds_or_asks_for_one_by_name() -> None:
    seen = 0
    for path in SOURCE.rglob("*.py"):
        if path.is_relative_to(SOURCE / "robots") or (path.parent == SOURCE and path.name in KNOW):
            continue
        seen += 1
        text = path.read_text()
        named = sum(f"{quote}{name}{quote}" in text for name in KINDS for quote in "\"'")
        if named < 2 and "goal.kind" not in text and "goal.form.name" not in text:
            continue  # Parsing takes longest.
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.Dict):
                keys = {key.value for key in node.keys if isinstance(key, ast.Constant)}
                assert len(keys & KINDS.keys()) < 2, f"{path}: {ast.unparse(node)}"
            if isinstance(node, ast.Compare | ast.Subscript | ast.match_case):
                asked = [
                    ast.unparse(each)
                    for each in ast.walk(node)
                    if getattr(each, "attr", "") in ("kind", "name")
                ]
                assert not any(each.endswith(("goal.kind", "goal.form.name")) for each in asked), (
                    path,
                    asked,
                )
    assert seen > 50


@pytest.mark.parametrize("kind", [kind for kind in KINDS.values() if not kind.ranges], ids=lambda k: k.name)
def test_the_weights_of_columns_make_their_chords_an_angle(kind: Kind) -> None:
    if not kind.columns:
        return
    for angle in (1e-4, np.pi):  # About y, so that x, which a direction compares, turns all the way.
        c, s = np.cos(angle), np.sin(angle)
        moved = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])[:, : kind.columns] - np.eye(3)[:, : kind.columns]
        chord = float(np.linalg.norm(moved))
        if angle == np.pi:
            assert chord == pytest.approx(kind.longest_chord, rel=1e-12)
        else:
            assert np.sqrt(kind.column_weight) * chord == pytest.approx(angle, rel=1e-6)


def test_a_goal_tells_what_it_leaves_open() -> None:
    T = np.eye(4)
    assert Goal.pose(T).free == ()
    assert Goal.position(np.zeros(3)).free == ("rx", "ry", "rz")
    assert Goal.pointing(np.zeros(3), [0, 0, 1.0], (0.1, -0.9, 0.2)).free == ("ry",)
    mixed = Goal.pose(T, free=("x", "rz"), box={"y": (-0.1, np.inf), "z": (0.0, 0.0)})
    assert mixed.free == ("x", "rz")
    assert mixed.within == {"y": (-0.1, np.inf)}
    assert "x free, y within [-0.1, inf], rz free" in repr(mixed)
    assert Goal.pose(T).within == {}


def test_goals_that_share_what_is_prepared_say_the_same() -> None:
    T, tool = np.eye(4), kinseek.pose([0.1, 0.0, 0.0], rotvec=[0.0, 0.0, 0.3])
    assert Goal.pose(T).prepared_as == Goal.pose(kinseek.pose([1.0, 2.0, 3.0], rotvec=[0, 0, 1])).prepared_as
    others = [
        Goal.pose(T),
        Goal.pose(T, tool=tool),
        Goal.position(np.zeros(3)),
        Goal.pointing(np.zeros(3), [1.0, 0.0, 0.0]),
        Goal.pointing(np.zeros(3), [1.0, 0.0, 0.0], (0.0, 1.0, 0.0)),
    ]
    assert len({goal.prepared_as for goal in others}) == len(others)
