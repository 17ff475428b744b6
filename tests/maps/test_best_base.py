"""The ranking of base placements, against the same ranking by plain calls of the arm."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import kinseek
from kinseek import Goal, InvalidMap, maps

pytest.importorskip("xarray")

Array = NDArray[np.float64]

UR5E = kinseek.load("ur5e")
TASK = UR5E.fk(UR5E.sample(40, seed=2))
PLACES = np.array(
    [
        kinseek.pose([x, y, 0.0], rpy=[0.0, 0.0, yaw])
        for x in (-0.2, 0.2)
        for y in (-0.2, 0.2)
        for yaw in (0.0, 1.5)  # The first joint turns twice, so a yaw changes nothing but the last bits.
    ]
)


def limit_distance(arm: kinseek.Arm, q: Array) -> Array:
    """As documented: of the joint that is nearest to a limit, in halves of its range, modulo full turns."""
    middle, half = (arm.upper + arm.lower) / 2, (arm.upper - arm.lower) / 2
    off = np.abs(q - middle)
    turns = np.abs((q - middle + np.pi) % (2 * np.pi) - np.pi)
    return np.asarray(1.0 - (np.where(half >= np.pi, turns, off) / half).max(axis=-1))


def qualities(arm: kinseek.Arm, q: Array) -> dict[str, Array]:
    d, w = limit_distance(arm, q), np.asarray(arm.manipulability(q))
    return {"limit_distance": d, "dexterity": w, "both": d * w}


def brute_force(poses: Array, places: Array, by: str) -> list[tuple[int, float, int]]:
    """Number, worst quality and number of poses reached for all placements, the best first."""
    rows = []
    for number, place in enumerate(places):
        best = []
        for T in np.linalg.inv(place) @ poses:
            q = UR5E.branches(T).q
            best.append(qualities(UR5E, q)[by].max() if len(q) else -np.inf)
        found = np.isfinite(best)
        rows.append((-int(found.sum()), -float(np.array(best)[found].min()), number))
    return [(number, -worst, -missed) for missed, worst, number in sorted(rows)]


@pytest.mark.parametrize("by", ["limit_distance", "dexterity", "both"])
def test_the_ranking_is_that_of_brute_force(by: str) -> None:
    ranked = maps.best_base(UR5E, TASK, PLACES, by)
    expected = brute_force(TASK, PLACES, by)
    assert ranked.worst.values == pytest.approx([row[1] for row in expected], abs=1e-6)
    assert ranked.reached.values.tolist() == [row[2] for row in expected]
    of = {number: (reached, round(worst, 6)) for number, worst, reached in expected}
    assert [of[number] for number in ranked.number.values] == [of[row[0]] for row in expected]
    assert (ranked.breaks == 0).all()
    assert (ranked.examined == len(TASK)).all()
    assert len(set(ranked.reached.values.tolist())) > 1  # Not only ties.


@pytest.fixture(name="short_blocks")
def _short_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Candidates are given up after a third of the poses that they are judged at otherwise."""
    for name in ("FIRST", "PIECE"):
        monkeypatch.setattr(f"kinseek.maps.base.{name}", getattr(maps.base, name) // 3)


@pytest.mark.slow
@pytest.mark.usefixtures("short_blocks")
@pytest.mark.parametrize("top", [1, 3])
def test_the_best_are_the_same_though_others_are_given_up(top: int) -> None:
    task = UR5E.fk(UR5E.sample(1000, seed=4))
    task[:, :3, 3] *= 0.6  # So that many placements reach most poses.
    places = [kinseek.pose([x, y, 0.0]) for x in (-0.6, -0.1, 0.1, 0.6) for y in (-0.5, 0.0)]
    whole = maps.best_base(UR5E, task, places, "both")
    some = maps.best_base(UR5E, task, places, "both", top=top)
    assert some.number.values[:top].tolist() == whole.number.values[:top].tolist()
    for name in ("reached", "worst", "limiting", "examined"):
        assert some[name].values[:top].tolist() == whole[name].values[:top].tolist()
    assert int(some.examined.sum()) < 0.85 * len(task) * len(places)
    assert int(some.examined.min()) < len(task)


def test_equal_placements_keep_their_order() -> None:
    places = np.repeat(PLACES[:2], 3, axis=0)
    for top in (None, 2):
        numbers = maps.best_base(UR5E, TASK, places, top=top).number.values
        assert numbers[:2].tolist() in ([0, 1], [3, 4])


@pytest.mark.slow
@pytest.mark.usefixtures("short_blocks")
def test_the_ranking_does_not_depend_on_the_number_of_threads() -> None:
    task = UR5E.fk(UR5E.sample(500, seed=5))
    one, four = (maps.best_base(UR5E, task, PLACES, "both", top=2, threads=n) for n in (1, 4))
    assert one.identical(four)
    path = kinseek.interpolate(TASK[:3], step=0.05, turn=0.1)
    one, four = (maps.best_base(UR5E, path, PLACES[:3], path=True, threads=n) for n in (1, 4))
    assert one.identical(four)


def test_goals_keep_their_tool_their_free_axes_and_their_tolerances() -> None:
    tool = kinseek.pose([0.0, 0.05, 0.1], rpy=[0.3, 0.0, 0.0])
    goal = Goal.pose(TASK[:12], free="rz", tool=tool, position_tolerance=1e-4)
    ranked = maps.best_base(UR5E, goal, PLACES[:4])
    for number, reached in zip(ranked.number.values, ranked.reached.values, strict=True):
        alone = Goal.pose(TASK[:12], free="rz", tool=tool, base=PLACES[number])
        assert reached == UR5E.ik(alone).success.sum()


def test_ranges_are_in_the_frame_of_the_task() -> None:
    """A range along the x axis of the task is one along another axis of a base that is turned."""
    T = np.array([kinseek.pose([1.1, 0.0, 0.3], rpy=[0.0, np.pi / 2, 0.0])])
    goal = Goal.pose(T, box={"x": (-0.5, 0.0)}, frame="base")
    places = [kinseek.pose([0, 0, 0], rpy=[0, 0, yaw]) for yaw in (0.0, 1.0)]
    assert maps.best_base(UR5E, goal, places).reached.values.tolist() == [1, 1]
    assert maps.best_base(UR5E, T, places).reached.values.tolist() == [0, 0]
    across = Goal.pose(T, box={"y": (-0.5, 0.5)}, frame="base")
    assert maps.best_base(UR5E, across, places).reached.values.tolist() == [0, 0]


def test_a_cone_reaches_more_than_the_direction_alone() -> None:
    far = [kinseek.pose([x, 0.0, 0.3], rpy=[0.0, np.pi / 2, 0.0]) for x in (0.5, 0.95, 0.97)]
    strict = maps.best_base(UR5E, Goal.pose(far, free="rz"), [np.eye(4)])
    wide = maps.best_base(UR5E, Goal.pose(far, free="rz", cone=1.2), [np.eye(4)])
    assert int(wide.reached[0]) >= int(strict.reached[0])
    goal = Goal.pose(far, free="rz", cone=1.2)
    assert int(wide.reached[0]) == UR5E.ik(goal).success.sum()


@pytest.mark.slow
def test_a_path_is_ranked_by_missed_poses_then_by_breaks_then_by_quality() -> None:
    arm = kinseek.load("kr6r900")
    around = np.linspace(-2.9, 2.9, 60)
    seam = np.array(
        [kinseek.pose([0.5 * np.cos(a), 0.5 * np.sin(a), 0.2], rpy=[np.pi, 0, a]) for a in around]
    )
    places = np.array([kinseek.pose([x, 0.0, 0.0]) for x in (-0.8, 0.0, 0.2, 0.3)])
    ranked = maps.best_base(arm, seam, places, "both", path=True)
    rows = []
    for number, place in enumerate(places):
        path = arm.follow(np.linalg.inv(place) @ seam)
        quality = qualities(arm, path.q)["both"][path.reached].min()
        rows.append((int((~path.reached).sum()), len(path.breaks), -float(quality), number))
    rows.sort()
    assert ranked.number.values.tolist() == [row[3] for row in rows]
    assert ranked.breaks.values.tolist() == [row[1] for row in rows]
    assert ranked.worst.values == pytest.approx([-row[2] for row in rows], abs=1e-4)
    assert len({row[0] for row in rows}) > 1
    assert len({row[1] for row in rows}) > 1


@pytest.mark.slow
def test_obstacles_stay_where_they_are_when_the_base_moves() -> None:
    pytest.importorskip("pinocchio")
    scene = kinseek.Scene.of(UR5E, capsules=0.05)
    scene.add_box("wall", (0.02, 2.0, 2.0), kinseek.pose([0.3, 0.0, 0.3]))
    before = scene.free(UR5E.sample(200))
    poses = np.array(
        [kinseek.pose([0.5, y, z], rpy=[0, np.pi / 2, 0]) for y in (-0.2, 0.2) for z in (0.2, 0.5)]
    )
    places = np.array(
        [kinseek.pose([0.0, 0.0, 0.0]), kinseek.pose([0.9, 0.0, 0.0], rpy=[0, 0, np.pi]), np.eye(4)]
    )
    free = maps.best_base(UR5E, poses, places)
    walled = maps.best_base(UR5E, poses, places, scene=scene, clearance=0.01)
    assert int(free.reached.min()) == len(poses)
    by_number = dict(zip(walled.number.values.tolist(), walled.reached.values.tolist(), strict=True))
    assert by_number[1] == len(poses)  # Beyond the wall, on the side of the poses.
    assert by_number[0] == by_number[2] < len(poses)
    # By hand: a scene in which the wall stands where that base sees it.
    for number, reached in by_number.items():
        own = kinseek.Scene.of(UR5E, capsules=0.05)
        own.add_box("wall", (0.02, 2.0, 2.0), np.linalg.inv(places[number]) @ kinseek.pose([0.3, 0.0, 0.3]))
        targets = np.linalg.inv(places[number]) @ poses
        assert reached == UR5E.ik(targets, scene=own, clearance=0.01).success.sum()
    assert (scene.free(UR5E.sample(200)) == before).all()  # The caller's scene is left as it was.
    followed = maps.best_base(UR5E, poses[[0, 1]], places, path=True, scene=scene)
    assert int(followed.number[0]) == 1


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"by": "speed"}, "by must be one of limit_distance, dexterity, both, got 'speed'"),
        ({"top": 0}, "top must be"),
        ({"top": 2, "path": True}, "top= is for poses, path=True for a path"),
        ({"clearance": 0.1}, "clearance= needs a scene"),
    ],
)
def test_misuse_is_an_error(options: Any, said: str) -> None:
    with pytest.raises(InvalidMap, match=said):
        maps.best_base(UR5E, TASK, PLACES, **options)


def test_a_goal_with_a_base_is_an_error() -> None:
    with pytest.raises(InvalidMap, match="has a base="):
        maps.best_base(UR5E, Goal.pose(TASK, base=PLACES[1]), PLACES)
    with pytest.raises(kinseek.InvalidUse, match="no argument 'timeout'"):
        maps.best_base(UR5E, TASK, PLACES, timeout=1.0)  # type: ignore[arg-type]
    with pytest.raises(kinseek.InvalidScene, match="scene must be"):
        maps.best_base(UR5E, TASK, PLACES, scene="cell")  # type: ignore[arg-type]
