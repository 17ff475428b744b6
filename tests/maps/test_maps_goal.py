"""Maps of goals that leave axes free: judged by `Arm.ik` at each cell, and by the geometry of a tilt."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import kinseek
from kinseek import Goal, InvalidMap, maps
from kinseek.maps.search import reached

pytest.importorskip("xarray")

TOOL = kinseek.pose([0.0, 0.0, 0.15])
GOALS = {
    "cone": Goal.pose(np.eye(4), free="rz", cone=0.4),
    "direction": Goal.pose(np.eye(4), free="rz"),
    "tool": Goal.pose(np.eye(4), tool=TOOL),
    "ranges": Goal.pose(np.eye(4), box={"rx": (-0.2, 0.2), "z": (-0.05, 0.05)}, tool=TOOL),
}


GRID = maps.Grid((0.2, 1.0, 0.2), (-0.1, 0.1, 0.1), (0.0, 0.6, 0.2), maps.orientations(12))
MEASURES = ("reached", "dexterity", "limit_distance")


@pytest.mark.parametrize("goal", GOALS.values(), ids=GOALS)
def test_a_cell_is_reached_if_the_goal_is(goal: Goal) -> None:
    arm = kinseek.load("ur5e")
    found = maps.reach(arm, GRID, goal=goal)
    poses = GRID.poses(tuple(slice(None) for _ in GRID.shape))
    wanted = arm.ik(goal.at(poses.reshape(-1, 4, 4))).success.reshape(poses.shape[:-2])
    np.testing.assert_array_equal(found.reached.values == 1, wanted)
    assert 0 < wanted.sum() < wanted.size


def test_a_wider_goal_reaches_more() -> None:
    arm, counts = kinseek.load("ur5e"), []
    for goal in (None, GOALS["direction"], GOALS["cone"]):
        counts.append(int((maps.reach(arm, GRID, goal=goal).reached.values == 1).sum()))
    assert counts[0] <= counts[1] < counts[2]


def test_other_measures_and_scenes_take_goals(tmp_path: Path) -> None:
    arm = kinseek.load("ur5e")
    scene, store = kinseek.Scene.of(arm, capsules=0.04), tmp_path / "map"
    found = maps.reach(arm, GRID, MEASURES, goal=GOALS["cone"], scene=scene, store=store)
    some = found.reached.values == 1
    assert some.any()
    assert (found.dexterity.values[some] > 0).all()
    with pytest.raises(InvalidMap, match="another map: goal"):
        maps.reach(arm, GRID, MEASURES, goal=GOALS["direction"], scene=scene, store=store)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"goal": "cone"}, "goal must be a Goal with one target"),
        ({"goal": Goal.pose(np.eye(4)[None])}, "goal must be a Goal with one target"),
        ({"goal": Goal.pose(np.eye(4), base=TOOL)}, "without base="),
        ({"goal": GOALS["cone"], "prove": True}, "cannot be combined with prove=True"),
        ({"goal": GOALS["cone"], "position_tolerance": 1e-3}, "give the tolerances to the goal"),
    ],
)
def test_goals_that_make_no_map_are_refused(options: dict[str, Any], words: str) -> None:
    with pytest.raises(InvalidMap, match=words):
        maps.reach(kinseek.load("ur5e"), GRID, **options)


def test_no_pose_is_reached_without_a_solution() -> None:
    arm = kinseek.load("ur5e")
    far = kinseek.pose([[2.0, 0.0, 0.0], [0.4, 0.1, 0.3]], rpy=[np.pi, 0.0, 0.0])
    assert reached(arm, GOALS["cone"].at(far)).tolist() == [False, True]


def test_maps_plots_and_viewer_need_no_import_of_their_own() -> None:
    code = "import kinseek; print(kinseek.maps.reach.__name__, kinseek.viewer.show.__name__, kinseek.plots.__name__)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.split() == ["reach", "show", "kinseek.plots"]
