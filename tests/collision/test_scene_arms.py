"""Several arms in one scene: the others stand where they are told, and are moved without building anything anew."""

from __future__ import annotations

import copy
import pickle
import re
from typing import Any

import numpy as np
import pytest

import kinseek
from kinseek import InvalidProblem, InvalidScene, Scene
from kinseek.collision import Box, assembly
from kinseek.collision.broad import Broad

pytest.importorskip("pinocchio")


@pytest.fixture(scope="module")
def arms() -> tuple[kinseek.Arm, kinseek.Arm]:
    return kinseek.load("ur5e"), kinseek.load("panda")


def scene_of(arm: kinseek.Arm, tip: str) -> Scene:
    scene = Scene.of(arm, capsules=0.05)
    scene.attach("tool", Box((0.05, 0.05, 0.2)), to=tip, pose=kinseek.pose([0, 0, 0.1]))
    scene.add_box("own table", (1, 1, 0.1), kinseek.pose([0, 0, -0.2]))
    return scene


@pytest.mark.slow
def test_the_other_arm_is_where_its_own_kinematics_has_it(arms: tuple[kinseek.Arm, kinseek.Arm]) -> None:
    arm, other = arms
    theirs, base = scene_of(other, other.tip), kinseek.pose([0.7, 0.1, 0.0], rpy=[0, 0, 3.0])
    scene = scene_of(arm, "tool0")
    q, home = other.sample(10, seed=1), np.zeros(other.dof)
    scene.add_arm("left", theirs, home, pose=base)
    assert "left/tool" in scene.bodies
    assert "left/own table" not in scene.bodies  # What stands around it is no part of it.
    assert all(
        not pair.counts for pair in scene.pairs if pair.a.startswith("left/") and pair.b.startswith("left/")
    )
    ours = arm.sample(300, seed=2)
    before = scene.free(ours)
    seen = set()
    for row in q:
        engine = scene._engine
        scene.move("left", row)
        assert scene._engine is engine
        # By hand: every link as a body that stands where forward kinematics of that link puts it.
        by_hand = scene_of(arm, "tool0")
        for body in theirs._bodies.values():
            if body.is_link or body.frame.joints:
                (part,) = body.parts
                link = body.name if body.is_link else other.tip
                own = theirs._links[link]
                pose = base @ other.fk(row, link=link) @ np.linalg.inv(own.pose) @ body.frame.pose @ part.pose
                by_hand.add(f"left {body.name}", part.shape, pose)
        assert np.array_equal(scene.free(ours), by_hand.free(ours))
        assert np.allclose(scene.distance(ours[:20]), by_hand.distance(ours[:20]), atol=2e-6)
        assert np.array_equal(
            scene.free_motion(ours[:40], ours[1:41]), by_hand.free_motion(ours[:40], ours[1:41])
        )
        seen.add(tuple(scene.free(ours)))
    assert len(seen) > 3
    scene.move("left", dict(zip(other.joint_names, home.tolist(), strict=True)))
    assert np.array_equal(scene.free(ours), before)


@pytest.mark.slow
def test_answers_and_paths_keep_off_the_other_arm(arms: tuple[kinseek.Arm, kinseek.Arm]) -> None:
    arm, other = arms
    scene = Scene.of(arm, capsules=0.05)
    T = np.array([kinseek.pose([0.5, y, 0.3], rpy=[np.pi, 0, 0]) for y in np.linspace(-0.3, 0.3, 40)])
    facing = kinseek.pose([1.1, 0.0, 0.0], rpy=[0, 0, np.pi])
    ready = np.array([0.0, -0.8, 0.0, -2.4, 0.0, 1.6, 0.8])
    scene.add_arm("right", Scene.of(other, capsules=0.05), ready, facing)
    assert arm.follow(T, scene=scene, clearance=0.01).success
    reaching = other.ik(np.linalg.inv(facing) @ T[20]).require().q
    scene.move("right", reaching)  # Its hand is where the path goes.
    blocked = arm.follow(T, scene=scene)
    assert not blocked.reached[20]
    assert "and right/" in blocked.why[0]
    assert arm.ik(T[20], scene=scene).contacts[0].b.startswith("right/")
    scene.move("right", ready)
    assert arm.follow(T, scene=scene, clearance=0.01).success


def test_copies_and_pickles_stand_for_themselves(arms: tuple[kinseek.Arm, kinseek.Arm]) -> None:
    arm, _ = arms
    scene = Scene.of(arm, capsules=0.05)
    scene.add_arm("twin", Scene.of(arm, capsules=0.05), np.zeros(6), kinseek.pose([0.6, 0, 0]))
    q = arm.sample(60, seed=3)
    before = scene.distance(q)
    for other in (copy.copy(scene), pickle.loads(pickle.dumps(scene))):
        other.move("twin", [0.0, -1.5, 0.0, 0.0, 0.0, 0.0])
        assert not np.array_equal(other.distance(q), before)
        assert np.array_equal(scene.distance(q), before)
    scene.remove("twin")
    assert not any(body.startswith("twin/") for body in scene.bodies)
    assert np.array_equal(scene.distance(q), Scene.of(arm, capsules=0.05).distance(q))
    scene.add_arm("twin", Scene.of(arm, capsules=0.05), np.zeros(6), kinseek.pose([0.6, 0, 0]))
    assert np.array_equal(scene.distance(q), before)


def test_what_does_not_fit_is_told(arms: tuple[kinseek.Arm, kinseek.Arm]) -> None:
    arm, other = arms
    scene, theirs = Scene.of(arm, capsules=0.05), Scene.of(other, capsules=0.05)
    with pytest.raises(InvalidScene, match=r"expected the kinseek\.Scene of the other arm, got Arm"):
        scene.add_arm("left", other, np.zeros(7))  # type: ignore[arg-type]
    with pytest.raises(InvalidProblem):
        scene.add_arm("left", theirs, np.zeros(6))
    with pytest.raises(InvalidProblem, match=r"expected one q of shape \(7,\)"):
        scene.add_arm("left", theirs, np.zeros((2, 7)))
    assert not any("/" in body for body in scene.bodies)
    scene.add_arm("left", theirs, np.zeros(7))
    taken = "'left' is an arm of the scene already"
    with pytest.raises(InvalidScene, match=taken):
        scene.add_arm("left", theirs, np.zeros(7))
    with pytest.raises(InvalidScene, match=taken):
        scene.add_box("left", (1, 1, 1))
    body = next(body for body in scene.bodies if body.startswith("left/"))
    with pytest.raises(InvalidScene, match=re.escape("remove('left') removes the whole arm")):
        scene.remove(body)
    with pytest.raises(InvalidScene, match="left"):
        scene.move("lift", np.zeros(7))
    with pytest.raises(InvalidProblem):
        scene.move("left", np.zeros(3))


SLIDING = """<robot name="two"><link name="base"/><link name="a">
<collision><origin xyz="0 0 0" rpy="0 0 0.2"/><geometry><cylinder radius="0.3" length="0.6"/></geometry></collision>
<collision><origin xyz="0 1.5 0" rpy="0 0 0.2"/><geometry><cylinder radius="0.3" length="0.6"/></geometry></collision></link>
<joint name="s" type="prismatic"><parent link="base"/><child link="a"/><axis xyz="0 1 0"/>
<limit lower="-3" upper="3" velocity="1" effort="1"/></joint></robot>"""
TURNING = """<robot name="one"><link name="base"/><link name="l">
<collision><origin xyz="0.5 0 0"/><geometry><box size="0.9 0.1 0.1"/></geometry></collision></link>
<joint name="j" type="revolute"><parent link="base"/><child link="l"/><axis xyz="0 0 1"/>
<limit lower="-3" upper="3" velocity="1" effort="1"/></joint></robot>"""


def test_an_arm_that_moves_during_a_question_is_here_or_there(monkeypatch: pytest.MonkeyPatch) -> None:
    """One link touched before the move and another one after it, and the question found neither."""
    arm = kinseek.load(TURNING)
    scene = Scene.of(arm)
    scene.add_arm("o", Scene.of(kinseek.load(SLIDING)), [0.0], pose=kinseek.pose([1.2500005, 0.0, 0.0]))
    whole, moved = Broad.sort_out, list[float]()

    def interrupted(*args: Any) -> Any:
        found = whole(*args)
        if not moved:
            moved.append(-1.5)
            scene.move("o", moved)
        return found

    monkeypatch.setattr(Broad, "sort_out", interrupted)
    assert not scene.free(np.zeros(1))
    assert moved
    assert not scene.free(np.zeros(1))


def test_a_scene_is_not_that_of_an_arm_that_slides_where_its_arm_turns() -> None:
    turning = kinseek.load(TURNING)
    sliding = kinseek.load(TURNING.replace("revolute", "prismatic"))
    scene = Scene.of(turning)
    assert scene.fits(turning.mechanism)
    with pytest.raises(InvalidScene, match="this scene is of 'one'"):
        sliding.ik(sliding.fk([1.0]), scene=scene)


def test_what_is_attached_to_the_base_of_another_arm_comes_with_it() -> None:
    """Only what a joint moves came with it, so a box at the base was free."""
    arm, other = kinseek.load(TURNING), kinseek.load(TURNING)
    theirs = Scene.of(other)
    theirs.attach("pole", Box((0.1, 0.1, 1.0)), "base")
    theirs.add_box("table", (0.1, 0.1, 0.1), kinseek.pose([5.0, 0.0, 0.0]))
    scene = Scene.of(arm)
    scene.add_arm(
        "o",
        theirs,
        [0.0],
        pose=kinseek.pose([0.5, 0.0, 0.0], rpy=[0.0, 0.0, np.pi]) @ kinseek.pose([0, 0, 0.3]),
    )
    assert scene.bodies == ("l", "o/l", "o/pole")
    assert ("l", "o/pole") in {(contact.a, contact.b) for contact in scene.hits([0.0])}
    still = arm.move([0.0], [0.001], 1.0, 1.0)
    assert scene.free_until(still, {"o": other.move([0.0], [0.001], 1.0, 1.0)}) == 0.0
    other_way = Scene.of(other)
    other_way.attach("pole", Box((0.1, 0.1, 1.0)), "base")
    other_way.add_arm("o", Scene.of(arm), [0.0], pose=kinseek.pose([0.5, 0.0, 0.3], rpy=[0.0, 0.0, np.pi]))
    assert (
        other_way.free_until(other.move([2.0], [2.001], 1.0, 1.0), {"o": arm.move([0.0], [0.001], 1.0, 1.0)})
        == 0.0
    )


def test_links_that_all_touch_each_other_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """150 links with spheres of 100 m took 324 s."""
    sphere = '<collision><geometry><sphere radius="100"/></geometry></collision>'
    links = "".join(f'<link name="l{i}">{sphere}</link>' for i in range(6))
    joints = "".join(
        f'<joint name="j{i}" type="continuous"><parent link="l{i}"/><child link="l{i + 1}"/><origin xyz="0 0 0.1"/></joint>'
        for i in range(5)
    )
    arm = kinseek.load(f'<robot name="r">{links}{joints}</robot>')
    with pytest.warns(kinseek.UnitWarning):
        Scene.of(arm, samples=100)
    monkeypatch.setattr(assembly, "MOST_PAIRS", 9)
    with pytest.raises(InvalidScene, match="10 pairs of shapes have to be checked, expected at most 9"):
        Scene.of(arm, samples=100)
    monkeypatch.undo()
    monkeypatch.setattr(assembly, "MOST_TOUCHES", 500)
    with pytest.raises(
        InvalidScene, match="more than 5 pairs of links touch at all of 100 random joint values"
    ):
        Scene.of(arm, samples=100)
