"""Answers in a scene: free by an outside check, and blocked only where every answer hits something."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import kinseek
from cells import write_arm
from kinseek import InvalidProblem, InvalidScene, Scene, Status

pytest.importorskip("pinocchio")


@pytest.fixture(scope="module")
def ur5e() -> kinseek.Arm:
    return kinseek.load("ur5e")


@pytest.fixture
def cell(ur5e: kinseek.Arm) -> Scene:
    """A table to the front, a pole beside it, a shelf behind."""
    scene = Scene.of(ur5e, capsules=0.05)
    scene.add_box("table", (0.8, 1.2, 0.04), kinseek.pose([0.6, 0.0, -0.1]))
    scene.add_capsule("pole", 0.03, 1.0, kinseek.pose([0.45, 0.3, 0.4]))
    scene.add_box("shelf", (0.6, 0.8, 0.03), kinseek.pose([-0.4, -0.3, 0.5]))
    return scene


def targets(arm: kinseek.Arm, count: int, seed: int) -> np.ndarray:
    return arm.fk(arm.sample(count, seed=seed))


def test_the_answer_is_the_first_free_branch(ur5e: kinseek.Arm, cell: Scene) -> None:
    seen = {Status.SOLVED: 0, Status.BLOCKED: 0}
    skipped = 0
    for target in targets(ur5e, 60, seed=3):
        every = ur5e.branches(target)
        free = cell.free(every.q)
        solution = ur5e.ik(target, scene=cell)
        seen[solution.status] += 1
        assert solution.success == free.any()
        only = ur5e.branches(target, scene=cell)
        assert np.array_equal(only.q, every.q[free])
        assert only.rejected == (~free).sum()
        if solution.success:
            assert np.array_equal(solution.q, every.q[np.argmax(free)])
            assert solution.contacts == ()
            skipped += solution.blocked > 0
        else:
            assert solution.blocked == len(every)
            assert solution.position_error <= 1e-3  # It reaches the target, and hits something there.
            assert solution.contacts[0].depth == pytest.approx(-cell.distance(every.q).max(), abs=1e-9)
            assert {(c.a, c.b) for c in solution.contacts} == {(c.a, c.b) for c in cell.hits(solution.q)}
            with pytest.raises(kinseek.NotReached, match=r"the arm hits something in .*: .* deep"):
                solution.require()
    assert min(*seen.values(), skipped) > 2


def test_a_clearance_is_kept(ur5e: kinseek.Arm, cell: Scene) -> None:
    narrower = 0
    assert ur5e.ik(np.empty((0, 4, 4)), scene=cell, clearance=0.03).q.shape == (0, 6)
    for target in targets(ur5e, 30, seed=4):
        solution = ur5e.ik(target, scene=cell, clearance=0.03)
        narrower += solution.success != ur5e.ik(target, scene=cell).success
        if solution.success:
            assert cell.distance(solution.q) > 0.03
    assert narrower > 0


def test_batches_are_answered_as_one_by_one(ur5e: kinseek.Arm, cell: Scene) -> None:
    goals = targets(ur5e, 12, seed=5).reshape(3, 4, 4, 4)
    batch = ur5e.ik(goals, scene=cell, clearance=0.01)
    assert batch.q.shape == (3, 4, 6)
    for i in range(3):
        for j in range(4):
            one = ur5e.ik(goals[i, j], scene=cell, clearance=0.01)
            assert np.array_equal(batch.q[i, j], one.q)
            assert batch.status[i, j] is one.status is batch[i][j].status
            assert batch[i][j].contacts == one.contacts == batch.contacts[i, j]


def test_targets_that_are_no_poses_can_be_skipped(ur5e: kinseek.Arm, cell: Scene) -> None:
    goals = targets(ur5e, 60, seed=3)
    goals[2] = np.nan
    some = ur5e.ik(goals, scene=cell, bad="skip")
    every = ur5e.ik(np.delete(goals, 2, axis=0), scene=cell)
    assert some.status[2] is Status.INVALID
    assert some.contacts[2] == ()
    assert np.array_equal(np.delete(some.q, 2, axis=0), every.q)
    assert list(np.delete(some.contacts, 2)) == list(every.contacts)
    assert (every.status == Status.BLOCKED).any()


def test_preferences_hold_among_free_answers(ur5e: kinseek.Arm, cell: Scene) -> None:
    tried = 0
    for target in targets(ur5e, 20, seed=6):
        free = ur5e.branches(target, order="dexterity", scene=cell)
        near = ur5e.branches(target, near=np.full(6, 0.3), scene=cell)
        if not len(free):
            continue
        tried += 1
        assert np.allclose(ur5e.ik(target, scene=cell, prefer="dexterity").q, free[0])
        assert np.array_equal(ur5e.ik(target, scene=cell, near=np.full(6, 0.3)).q, near[0])
    assert tried > 5


def test_valid_is_asked_of_free_answers_alone(ur5e: kinseek.Arm, cell: Scene) -> None:
    asked = []

    def never(q: np.ndarray) -> bool:
        asked.append(q)
        return False

    for target in targets(ur5e, 20, seed=7):
        free = ur5e.branches(target, scene=cell)
        asked.clear()
        solution = ur5e.ik(target, scene=cell, valid=never)
        assert not solution.success
        assert cell.free(np.array(asked)).all() if asked else not len(free)
        assert solution.status is (Status.REJECTED if len(free) else Status.BLOCKED)
        assert solution.rejected == len(free)
        if len(free):
            assert np.array_equal(solution.q, free[0])


def test_out_of_reach_is_no_matter_of_the_scene(ur5e: kinseek.Arm, cell: Scene) -> None:
    solution = ur5e.ik(kinseek.pose([1.5, 0, 0]), scene=cell)
    assert (solution.status, solution.blocked, solution.contacts) == (Status.BEST_EFFORT, 0, ())
    assert ur5e.ik(kinseek.pose([1.5, 0, 0]), scene=cell, prove=True).status is Status.PROVED_UNREACHABLE


@pytest.mark.slow
def test_no_free_branch_is_proved_where_the_branches_are_complete(ur5e: kinseek.Arm, cell: Scene) -> None:
    T = targets(ur5e, 60, seed=3)
    plain = ur5e.ik(T, scene=cell)
    proved = ur5e.ik(T, scene=cell, prove=True)
    was = plain.status == Status.BLOCKED
    assert was.sum() >= 3
    assert (proved.status[was] == Status.PROVED_BLOCKED).all()
    assert (proved.status[~was] == plain.status[~was]).all()
    assert np.array_equal(proved.proved_blocked, was)
    for target, one in zip(T[was], proved[was], strict=True):
        assert one.status is Status.PROVED_BLOCKED
        assert one.contacts
        every = ur5e.branches(target, scene=cell, prove=True)
        assert every.complete
        assert len(every) == 0
        assert every.rejected > 0
        assert every.proved_blocked
        assert "proved blocked" in repr(every)
    both = ur5e.branches(T[:20], scene=cell, prove=True)
    assert [one.proved_blocked for one in both] == was[:20].tolist()
    assert not ur5e.branches(T[np.argmin(was)], scene=cell, prove=True).proved_blocked


@pytest.mark.slow
def test_nothing_is_proved_blocked_that_may_be_free(ur5e: kinseek.Arm) -> None:
    """A ball that the tool touches by less than the tolerances reach: the answer hits, one beside it does not."""
    scene = Scene.of(ur5e, capsules=0.05)
    target = kinseek.pose([0.5, 0.1, 0.4], rpy=[np.pi, 0, 0])
    goal = kinseek.Goal.pose(target, position_tolerance=1e-4, orientation_tolerance=1e-3)
    scene.attach("tool", kinseek.collision.Sphere(0.02), to="tool0", pose=kinseek.pose([0, 0, 0.1]))
    seen = []
    for depth in (1e-5, 0.02):
        scene.add_sphere("ball", 0.05, kinseek.pose([0.5, 0.1, 0.4 - 0.1 - 0.07 + depth]))
        solution = ur5e.ik(goal, scene=scene, prove=True)
        assert not solution.success
        branches: Any = ur5e.branches(goal, scene=scene, prove=True)
        assert branches.proved_blocked == solution.proved_blocked
        seen.append(solution.status)
        scene.remove("ball")
    assert seen == [Status.BLOCKED, Status.PROVED_BLOCKED]
    far = ur5e.with_limits({ur5e.joint_names[0]: (-0.1, 0.1)})
    assert far.ik(kinseek.pose([1.5, 0, 0]), scene=scene, prove=True).status is Status.PROVED_UNREACHABLE


@pytest.mark.slow
def test_a_box_of_joint_values_that_surely_hits_does_so_everywhere(ur5e: kinseek.Arm, cell: Scene) -> None:
    rng, sure = np.random.default_rng(5), 0
    for q in ur5e.sample(300, seed=12):
        reach = rng.uniform(0.0, 0.05, 6)
        clearance = float(rng.choice([0.0, 0.03]))
        if cell.hits_around(q, reach, clearance):
            sure += 1
            assert not cell.free(q + rng.uniform(-reach, reach, (200, 6)), clearance).any()
            corners = q + reach * np.array(np.meshgrid(*[[-1, 1]] * 6)).reshape(6, -1).T
            assert not cell.free(corners, clearance).any()
    assert sure > 20
    assert not cell.hits_around(q, np.full(6, np.inf))


@pytest.mark.slow
def test_spare_joints_are_used_to_get_free() -> None:
    arm = kinseek.load("iiwa14")
    scene = Scene.of(arm, capsules=0.06)
    for i, x in enumerate((-0.35, 0.35)):
        scene.add_box(f"wall{i}", (0.05, 1.5, 1.2), kinseek.pose([x, 0.0, 0.6]))
    q = arm.sample(300, seed=8)
    blocked = 0
    for target in arm.fk(q[scene.free(q)][:30]):  # There is a free answer to each of these.
        solution = arm.ik(target, scene=scene)
        assert solution.success
        assert scene.free(solution.q)
        assert np.allclose(arm.fk(solution.q), target, atol=1e-3)
        blocked += solution.blocked > 0
    assert blocked > 3


def test_scenes_are_of_one_arm(ur5e: kinseek.Arm, cell: Scene, tmp_path: Path) -> None:
    target = kinseek.pose([0.4, 0.1, 0.4])
    for other in (kinseek.load("ur10e"), kinseek.load("panda"), ur5e.with_locked({ur5e.joint_names[0]: 0.0})):
        with pytest.raises(InvalidScene, match="this scene is of 'ur5e'"):
            other.ik(target, scene=cell)
        with pytest.raises(InvalidScene, match="this scene is of 'ur5e'"):
            other.branches(target, scene=cell)
    tool = ur5e.with_tool(kinseek.pose([0, 0, 0.1])).with_limits({ur5e.joint_names[0]: (-1.0, 1.0)})
    assert tool.ik(target, scene=cell).status in (Status.SOLVED, Status.BLOCKED)
    with pytest.raises(InvalidScene, match=r"must be a kinseek\.Scene, got Arm"):
        ur5e.ik(target, scene=ur5e)  # type: ignore[call-overload]
    for ask in (ur5e.ik, ur5e.branches):
        with pytest.raises(InvalidProblem, match="give scene="):
            ask(target, clearance=0.01)
        with pytest.raises(InvalidScene, match="clearance must be a length"):
            ask(target, scene=cell, clearance=-1.0)
    with pytest.raises(InvalidProblem, match="solver= cannot be combined"):
        ur5e.ik(target, scene=cell, solver=kinseek.Atlas())
    with pytest.raises(InvalidProblem, match="did you mean 'limits'"):
        ur5e.ik(target, scene=cell, prefer="limit")  # type: ignore[call-overload]


@pytest.mark.slow
def test_limits_may_be_narrower_than_the_scenes(tmp_path: Path) -> None:
    arm = kinseek.load(write_arm(tmp_path), tip="tip")
    scene = Scene.of(arm, [tmp_path / "packages"])
    target = arm.fk([0.3, 0.4, 0.5, 0.05, 0.3, 0.2])
    narrow = arm.with_limits({"j1": (0.0, 1.0)})
    assert narrow.ik(target, scene=scene).success
    assert scene.free(narrow.ik(target, scene=scene).q)
