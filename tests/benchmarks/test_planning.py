"""The benchmark of planning: problems are read and handed to peers as they are, and the judge sees what touches."""

from __future__ import annotations

import io
import tarfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml  # type: ignore[import-untyped]

import kinseek
from benchmarks.problems import JOINTS, Cell, Task, length, points, tasks
from benchmarks.workers.planners import described
from benchmarks.workers.process import Gone

pytest.importorskip("mujoco")
pytest.importorskip("pinocchio")

from benchmarks import planning
from benchmarks.planning import Found, Plan, Planner, beside, by_kind, by_turns, judged

TURNS = np.array(
    [
        [0.1, 0.2, 0.3, 0.9],
        [0.5, -0.5, 0.5, 0.5],
        [0.0, np.sqrt(0.5), 0.0, np.sqrt(0.5)],
        [0.0, 0.0, 0.0, 1.0],
    ]
)
"""x, y, z, w, of length 1 but for the first; after the second and the third, x and z turn about one line."""

OBJECTS: list[dict[str, Any]] = [
    {
        "id": f"{kind}{number}",
        "primitives": [{"type": kind, "dimensions": sizes}],
        "primitive_poses": [{"position": [0.1, 0.2, 0.3], "orientation": turn.tolist()}],
        "pose": {"position": [0.4, -0.1, 0.7], "orientation": TURNS[number - 1].tolist()},
    }
    for number, turn in enumerate(TURNS)
    for kind, sizes in (("box", [0.1, 0.2, 0.3]), ("cylinder", [0.4, 0.05]), ("sphere", [0.06]))
]


def test_problems_are_read_with_their_joints_by_name(tmp_path: Path) -> None:
    q = np.arange(1.0, 8.0)
    request = {
        "start_state": {
            "joint_state": {"name": ["finger", *JOINTS[::-1]], "position": [9.0, *q[::-1].tolist()]}
        },
        "goal_constraints": [
            {
                "joint_constraints": [
                    {"joint_name": name, "position": -v}
                    for name, v in zip(JOINTS[::-1], q[::-1].tolist(), strict=True)
                ]
            }
        ],
    }
    texts = {"request": request, "scene": {"world": {"collision_objects": OBJECTS}}}
    with tarfile.open(tmp_path / "problems.tar.bz2", "w:bz2") as archive:
        for what, values in texts.items():
            text = yaml.safe_dump(values).encode()
            info = tarfile.TarInfo(f"problems/box_panda/{what}0007.yaml")
            info.size = len(text)
            archive.addfile(info, io.BytesIO(text))
    (task,) = tasks(tmp_path)
    assert (task.kind, task.number, task.objects) == ("box", 7, OBJECTS)
    np.testing.assert_array_equal([task.q0, task.q1], [q, -q])


def test_objects_are_handed_over_where_they_are() -> None:
    rotation = pytest.importorskip("scipy.spatial.transform").Rotation
    problem = described("cage", OBJECTS)
    assert problem["problem"] == "cage"
    for thing in OBJECTS:
        (shape,), (place,) = thing["primitives"], thing["primitive_poses"]
        poses = [kinseek.pose(at["position"], quat_xyzw=at["orientation"]) for at in (thing["pose"], place)]
        pose = poses[0] @ poses[1]
        (given,) = (one for one in problem[shape["type"]] if one["name"] == thing["id"])
        turn = rotation.from_euler("xyz", given["orientation_euler_xyz"]).as_matrix()
        np.testing.assert_allclose(turn, pose[:3, :3], atol=1e-12)
        np.testing.assert_allclose(given["position"], pose[:3, 3], atol=1e-12)
    assert problem["box"][0]["half_extents"] == [0.05, 0.1, 0.15]
    assert (problem["cylinder"][0]["length"], problem["cylinder"][0]["radius"]) == (0.4, 0.05)
    assert problem["sphere"][0]["radius"] == 0.06


def test_points_are_even_along_the_whole_path() -> None:
    q = np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 0.0], [3.0, 1.0]])
    assert length(q) == 4.0
    np.testing.assert_allclose(points(q, 5), [[0, 0], [1, 0], [2, 0], [3, 0], [3, 1]], atol=1e-12)


class Wall(Cell):
    """A cell in which every problem has a thin wall in front of the arm."""

    def filled(self, task: Task) -> kinseek.Scene:
        scene = super().filled(task)
        scene.add_box("wall", (0.002, 0.4, 0.4), kinseek.pose([-0.7, 0.0, 0.0]))
        return scene


def cells() -> tuple[Cell, Cell]:
    """One with the wall, and one that does not know of it, as if its shapes were smaller."""
    arm = kinseek.load("planar2")
    scene = kinseek.Scene.of(arm, capsules=0.01)
    return Wall(arm, scene, False), Cell(arm, scene, True)


def fixed(*rows: list[float]) -> Plan:
    """A planner that returns these rows."""
    return lambda task: (0.5, np.array(rows) if rows else None)


TASK = Task("box", 1, np.array([1.5, 0.3]), np.array([4.5, 0.3]), [])


def test_a_path_through_a_thin_wall_is_not_free_by_the_judge_whatever_its_planner_checks() -> None:
    hulls, spheres = cells()
    rows = [TASK.q0.tolist(), TASK.q1.tolist()]
    assert hulls.filled(TASK).free(rows).all(), "only between the rows"
    found = judged(Planner(fixed(*rows), spheres), hulls, TASK)
    assert (found.seconds, found.length, found.own) == (0.5, 3.0, 0.0)
    assert found.hulls > 1e-4
    assert judged(Planner(fixed(*rows), hulls), hulls, TASK).own == found.hulls
    around = judged(Planner(fixed(rows[0], [1.5, 2.5], [4.5, 2.5], rows[1]), hulls), hulls, TASK)
    assert (around.own, around.hulls) == (0.0, 0.0)
    assert np.isnan(judged(Planner(fixed(), hulls), hulls, TASK)[1:]).all()
    with pytest.raises(AssertionError, match="another problem"):
        judged(Planner(fixed(rows[0], [4.4, 0.3]), hulls), hulls, TASK)


def test_a_planner_whose_process_ends_is_a_row_that_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    hulls, _ = cells()

    def ends(task: Task) -> tuple[float, None]:
        raise Gone("hangs: nothing for 100 s")

    planners = {"VAMP": Planner(fixed(), hulls), "other": Planner(ends, hulls)}
    found = by_turns(planners, hulls, [TASK, TASK]) | {"third": "could not be installed: why"}
    assert found["other"] == "box 1: hangs: nothing for 100 s"
    rows = {str(row["planner"]): row for row in beside(found)}
    assert (rows["VAMP"][">problems"], rows["VAMP"][">solved"], rows["VAMP"][">/ VAMP's"]) == (2, 0, "–")
    assert (rows["other"][">solved"], rows["third"][">solved"]) == ("–", "–")
    assert rows["third"][""] == "could not be installed: why"
    monkeypatch.setattr(planning, "environment", lambda requirements: "could not be installed: why")
    assert planning.started("VAMP", Path(), Path()) == "could not be installed: why"


def test_ratios_are_of_the_same_problem_and_count_what_both_solve() -> None:
    nan = np.nan
    found: dict[str, list[Found] | str] = {
        "ours": [
            Found(0.1, 2.0, 0, 0),
            Found(0.2, 9.0, 0, 0),
            Found(0.3, nan, nan, nan),
            Found(0.4, 3.3, 0, 0),
        ],
        "VAMP": [
            Found(0.1, 4.0, 0, 0.01),
            Found(0.2, nan, nan, nan),
            Found(0.3, 1.0, 0, 0),
            Found(0.4, 3.0, 0, 0),
        ],
        "gone": "ends with 1",
    }
    ours, vamp, gone = beside(found)
    assert (ours[">solved"], ours[">free, hulls"], ours[">deepest mm"]) == (3, 3, "0.0")
    assert (vamp[">solved"], vamp[">free, hulls"], vamp[">deepest mm"]) == (3, 2, "10.0")
    assert (ours[">/ VAMP's"], ours[">both free"], ours[">above 1.1"]) == ("0.800", "1.100", "0%")
    assert (vamp[">/ VAMP's"], vamp[">above 1.1"]) == ("1.000", "0%")
    assert (ours[">ms, median"], ours[">p95"], ours[">largest"]) == ("250.00", "385.0", "400")
    assert gone[""] == "ends with 1"
    assert list(by_kind(found, ["box", "box", "cage", "cage"])) == [
        {"scene": "box", ">ours": "0.500"},
        {"scene": "cage", ">ours": "1.100"},
    ]
    alone = {"ours": found["ours"], "VAMP": "could not be installed"}
    assert next(beside(alone))[">/ VAMP's"] == "–"
    assert list(by_kind(alone, ["box"] * 4)) == [{"scene": "box", ">ours": "–"}]
