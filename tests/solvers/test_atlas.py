"""The atlas through the front door: same bits, near, out of reach, odd arms, odd goals, threads."""

from __future__ import annotations

import gc
import threading
import tracemalloc
import weakref
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from numpy.typing import NDArray

import kinseek
from benchmarks.targets import plain_fk, pose_errors, random_joints
from kinseek.kernels.atlas.one_goal import solve_plain
from kinseek.kernels.atlas.tree import BESIDE, LEAF_SIZE
from kinseek.kinds import POSE
from kinseek.robots.joints import Joint, serial_chain
from kinseek.solvers.atlas.index import AtlasIndex, atlas_of
from kinseek.support.transforms import rotation, transform
from reference import errors, weighted_error

Array = NDArray[np.float64]

ARMS = ("panda", "ur5e", "ur10e_rail", "atlas_torso_arm", "scara_synth")

ROUNDING = 1e-13


def targets_of(arm: kinseek.Arm, count: int, seed: int = 1) -> Array:
    return plain_fk(arm.chain, random_joints(arm.chain, count, seed))


# The same bits


@pytest.mark.slow
@pytest.mark.parametrize("name", ARMS)
def test_a_batch_has_the_same_bits_however_it_is_solved(name: str) -> None:
    arm = kinseek.load(name)
    targets = targets_of(arm, 3001)
    whole = arm.ik(targets, threads=1)
    for threads in (2, 8, None):
        np.testing.assert_array_equal(arm.ik(targets, threads=threads).q, whole.q)
    order = np.random.default_rng(2).permutation(len(targets))
    shuffled = arm.ik(targets[order])
    np.testing.assert_array_equal(shuffled.q, whole.q[order])
    np.testing.assert_array_equal(shuffled.evaluations, whole.evaluations[order])
    pieces = [arm.ik(targets[a:b]).q for a, b in ((0, 1), (1, 8), (8, 1500), (1500, 1500), (1500, 3001))]
    np.testing.assert_array_equal(np.concatenate(pieces), whole.q)
    np.testing.assert_array_equal(arm.ik(targets.reshape(1, 3001, 4, 4)).q[0], whole.q)


@pytest.mark.parametrize("name", ARMS)
def test_one_by_one_takes_the_branch_that_a_batch_takes(name: str) -> None:
    arm = kinseek.load(name)
    targets = targets_of(arm, 2000)
    batch = arm.ik(targets)
    alone = [arm.ik(target) for target in targets]
    apart = np.array([np.abs(one.q - q).max() for one, q in zip(alone, batch.q, strict=True)])
    assert np.mean(apart < 1e-4) >= 0.999
    assert all(one.success for one in alone)
    away, angle = pose_errors(plain_fk(arm.chain, np.array([one.q for one in alone])), targets)
    assert max(away.max(), angle.max()) <= 1e-6 + ROUNDING


@pytest.mark.parametrize("name", ["baxter_left", "yumi_left", "jaco2_6"])
def test_one_by_one_has_the_bits_of_a_batch_where_a_sample_lies_at_a_limit(name: str) -> None:
    # Rounding leads some samples of these beyond a limit, and walks that meet limits keep the last bit of their start.
    arm = kinseek.load(name)
    index = arm.atlas
    assert isinstance(index, AtlasIndex)
    middle = index.sorted.middle
    assert (middle >= arm.chain.lower[1:-1]).all()
    assert (middle <= arm.chain.upper[1:-1]).all()
    targets = targets_of(arm, 2000)
    np.testing.assert_array_equal(np.array([arm.ik(target).q for target in targets]), arm.ik(targets).q)


def test_a_goal_object_and_a_bare_pose_have_the_same_bits() -> None:
    arm = kinseek.load("panda")
    for target in targets_of(arm, 50):
        np.testing.assert_array_equal(arm.ik(kinseek.Goal.pose(target)).q, arm.ik(target).q)


# Near


@pytest.mark.parametrize("name", ["panda", "ur5e", "gen3", "scara_synth"])
def test_near_stays_near(name: str) -> None:
    arm, rng = kinseek.load(name), np.random.default_rng(3)
    q = random_joints(arm.chain, 300, 3)
    start = q + rng.uniform(-0.05, 0.05, q.shape)  # May lie outside the limits.
    solution = arm.ik(plain_fk(arm.chain, q), near=start)
    assert solution.success.all()
    free = np.array(arm.chain.kinds) == "continuous"  # These have no limits, and come within half a turn.
    low, high = np.where(free, start - np.pi, arm.lower), np.where(free, start + np.pi, arm.upper)
    assert ((solution.q >= low) & (solution.q <= high)).all()
    gap, made = turned(arm, solution.q - start), turned(arm, q - start)
    assert np.mean(np.linalg.norm(gap, axis=1) <= 1.1 * np.linalg.norm(made, axis=1) + 1e-4) >= 0.98


def turned(arm: kinseek.Arm, gap: Array) -> Array:
    """Differences of joint values, continuous joints the short way round."""
    free = np.array(arm.chain.kinds) == "continuous"
    return np.where(free, (gap + np.pi) % (2 * np.pi) - np.pi, gap)


def test_near_is_never_farther_than_without() -> None:
    arm = kinseek.load("ur5e")
    q, near = random_joints(arm.chain, 300, 4), random_joints(arm.chain, 300, 5)
    targets = plain_fk(arm.chain, q)
    close, any_one = arm.ik(targets, near=near), arm.ik(targets)
    far = np.linalg.norm(any_one.q - near, axis=1)
    assert (np.linalg.norm(close.q - near, axis=1) <= far + 1e-3).mean() >= 0.99


def test_near_far_outside_the_limits_is_allowed() -> None:
    arm = kinseek.load("panda")
    target = targets_of(arm, 1)[0]
    for near in (arm.upper + 40.0, arm.lower - 1e3, np.full(arm.dof, 1e6)):
        solution = arm.ik(target, near=near)
        assert solution.success
        assert ((solution.q >= arm.lower) & (solution.q <= arm.upper)).all()


def test_near_measures_continuous_joints_the_short_way_round() -> None:
    arm = kinseek.load("gen3")
    free = np.array(arm.chain.kinds) == "continuous"
    assert free.any()
    q = np.clip(np.where(free, 3.1, 0.4), arm.lower, arm.upper)
    start = np.where(free, -3.1, q)
    solution = arm.ik(arm.fk(q), near=start)
    assert solution.success
    gap = turned(arm, solution.q - start)
    assert np.linalg.norm(gap) <= 1.1 * np.linalg.norm(turned(arm, q - start))


def test_near_on_wide_limits_takes_the_turn_that_is_asked_for() -> None:
    arm = kinseek.load("ur5e")
    q = np.array([0.3, -1.2, 1.4, -0.8, 1.1, 0.2])
    for turns in (-1, 0):
        wanted = q + 2 * np.pi * np.array([turns, 0, 0, 0, 0, turns])
        np.testing.assert_allclose(arm.ik(arm.fk(q), near=wanted).q, wanted, atol=1e-5)


def test_near_of_a_batch_is_near_of_each() -> None:
    arm = kinseek.load("panda")
    targets, near = targets_of(arm, 40), random_joints(arm.chain, 40, 6)
    batch = arm.ik(targets, near=near, threads=2)
    for i in range(40):
        np.testing.assert_array_equal(batch.q[i], arm.ik(targets[i], near=near[i]).q)
    same = arm.ik(targets, near=near[0])
    np.testing.assert_array_equal(same.q[0], batch.q[0])


# Out of reach


def far_targets(arm: kinseek.Arm, count: int, seed: int) -> Array:
    """Poses 1 to 2 times as far from the base as the arm is long."""
    rng = np.random.default_rng(seed)
    targets = targets_of(arm, count, seed)
    length = np.linalg.norm(arm.chain.fixed[:, :, 3], axis=1).sum()
    out = rng.normal(size=(count, 3))
    targets[:, :3, 3] = (
        rng.uniform(1.0, 2.0, (count, 1)) * length * out / np.linalg.norm(out, axis=1)[:, None]
    )
    return targets


def test_the_first_pose_out_of_reach_of_an_arm_is_answered_as_every_other() -> None:
    for near in (None, np.zeros(6)):
        arm = kinseek.load("elbow6")
        reached, far = targets_of(arm, 2)
        far[:3, 3] = 5.0
        arm.ik(reached)
        first = arm.ik(far, near=near)
        assert solve_plain(atlas_of(arm.chain).address, far, np.empty(6))[3] > 0
        again = arm.ik(far, near=near)
        np.testing.assert_array_equal(first.q, again.q)
        assert (first.success, first.evaluations) == (again.success, again.evaluations)


@pytest.mark.parametrize("name", ["panda", "ur5e", "irb120", "scara4"])
def test_out_of_reach_gives_the_best_effort_in_bounded_work(name: str) -> None:
    arm = kinseek.load(name)
    targets = far_targets(arm, 40, 7)
    solution = arm.ik(targets)
    assert not solution.success.any()
    assert all(status is kinseek.Status.BEST_EFFORT for status in solution.status)
    assert solution.evaluations.max() <= 5000
    assert ((solution.q >= arm.lower) & (solution.q <= arm.upper)).all()
    for T, target, position, orientation, weighted in zip(
        plain_fk(arm.chain, solution.q),
        targets,
        solution.position_error,
        solution.orientation_error,
        solution.weighted_error,
        strict=True,
    ):
        goal = kinseek.Goal.pose(target)
        assert (position, orientation) == pytest.approx(errors(T, goal), abs=1e-9)
        assert weighted == pytest.approx(weighted_error(T, goal), abs=1e-9)
    with pytest.raises(kinseek.NotReached, match="40 of 40"):
        solution.require()


@pytest.mark.slow
@pytest.mark.parametrize("weights", [(1.0, 1.0), (10.0, 0.1), (0.1, 10.0)])
@pytest.mark.parametrize("name", ["panda", "ur5e"])
def test_out_of_reach_is_no_worse_than_restarts(name: str, weights: tuple[float, float]) -> None:
    arm, rng = kinseek.load(name), np.random.default_rng(8)
    descent = kinseek.CoordinateDescent()
    for target in far_targets(arm, 3, 9):
        goal = kinseek.Goal.pose(target, position_weight=weights[0], orientation_weight=weights[1])
        starts = rng.uniform(arm.lower, arm.upper, (10, arm.dof))
        best = min(arm.ik(goal, near=start, solver=descent).weighted_error for start in starts)
        assert arm.ik(goal).weighted_error <= best * (1 + 1e-6) + 1e-9


# Odd goals


@pytest.mark.parametrize("name", ["panda", "puma560", "ur5e", "elbow6", "scara4", "planar2", "ur10e_rail"])
def test_goals_in_odd_places_are_solved_or_honestly_not(name: str) -> None:
    arm = kinseek.load(name)
    length = float(np.linalg.norm(arm.chain.fixed[:, :, 3], axis=1).sum())
    first = arm.chain.fixed[0]
    turns = [np.eye(3), np.diag([1.0, -1.0, -1.0]), rotation(np.array([0.0, 1.0, 0.0]), np.pi / 2)[:3, :3]]
    places = [
        np.zeros(3),
        first[:, 3],
        first[:, 3] + 0.3 * length * first[:, 2],
        first[:, 3] + length * first[:, 0],
    ]
    targets = np.array([transform(turn, place) for turn in turns for place in places])
    solution = arm.ik(targets)
    away, angle = pose_errors(plain_fk(arm.chain, solution.q), targets)
    np.testing.assert_allclose(solution.position_error, away, atol=1e-12)
    # Near π the plain formula is rough.
    np.testing.assert_allclose(solution.orientation_error, angle, atol=1e-7)
    np.testing.assert_array_equal(
        solution.success, (solution.position_error <= 1e-6) & (solution.orientation_error <= 1e-6)
    )


def test_a_reachable_pose_on_the_first_axis_is_solved() -> None:
    arm = kinseek.load("elbow6")
    axis, point = arm.chain.fixed[0, :, 2], arm.chain.fixed[0, :, 3]
    goal = kinseek.Goal.position(point + 0.25 * np.linalg.norm(arm.chain.fixed[:, :, 3], axis=1).sum() * axis)
    found = arm.ik(goal)
    assert found.success
    solution = arm.ik(arm.fk(found.q))  # r = 0 exactly but for rounding, and reachable.
    assert solution.success


@pytest.mark.parametrize("name", ["planar2", "elbow6", "panda", "ur5e", "irb120"])
def test_stretched_and_folded_arms_are_solved(name: str) -> None:
    arm = kinseek.load(name)
    for q in (
        np.zeros(arm.dof),
        arm.lower,
        arm.upper,
        np.full(arm.dof, np.pi / 2),
        np.full(arm.dof, -np.pi / 2),
    ):
        assert arm.ik(arm.fk(np.clip(q, arm.lower, arm.upper))).success


@pytest.mark.parametrize(
    "q",
    [
        [2.9668, 2.0942, -2.9668, 2.0942, -0.119131, -1.909218, 3.0541],
        [2.9668, -2.0942, 1.570796, 1.570796, 0.0, -2.0942, 0.0],
    ],
)
def test_poses_that_only_a_flip_of_the_best_reaches_are_solved(q: list[float]) -> None:
    arm = kinseek.load("iiwa14")
    assert arm.ik(arm.fk(q)).success


@pytest.mark.parametrize("name", ["panda", "ur5e", "ur10e_rail"])
@pytest.mark.parametrize("kind", ["position", "pointing"])
def test_partial_goals(name: str, kind: str) -> None:
    arm = kinseek.load(name)
    targets = targets_of(arm, 100)
    for T in targets:
        goal = (
            kinseek.Goal.position(T[:3, 3])
            if kind == "position"
            else kinseek.Goal.pointing(T[:3, 3], T[:3, 1], tool_axis=(0.0, 1.0, 0.0))
        )
        solution = arm.ik(goal)
        assert solution.success
        assert max(errors(plain_fk(arm.chain, solution.q[None])[0], goal)) <= 1e-6 + ROUNDING


def test_an_empty_batch_gives_empty_arrays() -> None:
    arm = kinseek.load("panda")
    for shape in ((0,), (3, 0)):
        solution = arm.ik(np.empty((*shape, 4, 4)))
        assert solution.q.shape == (*shape, 7)
        assert solution.success.shape == solution.position_error.shape == solution.evaluations.shape == shape
        assert solution.success.dtype == bool
        solution.require()
        assert arm.ik(np.empty((*shape, 4, 4)), near=np.zeros(7)).q.shape == (*shape, 7)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_bad_number_in_a_batch_names_its_index(bad: float) -> None:
    arm = kinseek.load("panda")
    targets = np.repeat(targets_of(arm, 1), 100_000, axis=0)
    targets[77_123, 1, 3] = bad
    with pytest.raises(kinseek.InvalidGoal, match=r"index 77123\b"):
        arm.ik(targets)
    with pytest.raises(kinseek.InvalidGoal, match="NaN"):
        arm.ik(targets[77_123])


@pytest.mark.slow
@pytest.mark.parametrize("tolerance", [1e-3, 1e-9, 1e-12, 0.0])
@pytest.mark.parametrize("name", ["panda", "ur5e", "ur10e_rail"])
def test_a_tolerance_is_met_or_reported_as_missed(name: str, tolerance: float) -> None:
    arm = kinseek.load(name)
    targets = targets_of(arm, 200)
    goal = kinseek.Goal.pose(targets, position_tolerance=tolerance, orientation_tolerance=tolerance)
    solution = arm.ik(goal)
    away, angle = pose_errors(plain_fk(arm.chain, solution.q), targets)
    worst = np.maximum(away, angle)
    assert (worst[solution.success] <= tolerance + 3e-15 * (1 + np.abs(targets).max())).all()
    if tolerance > 1e-10:
        assert solution.success.all()
    elif tolerance > 0:
        assert solution.success.mean() >= 0.99
    assert (worst <= max(tolerance, 1e-6)).all()


# Odd arms


def random_arm(kinds: str, seed: int, limit: float | None = None, follower: str = "") -> kinseek.Arm:
    """Build an arm of turning (R), endless (C) and sliding (P) joints about any axis, with a follower first or last."""
    rng = np.random.default_rng(seed)
    names = {"R": "revolute", "C": "continuous", "P": "prismatic"}

    def somewhere() -> Array:
        axis = rng.normal(size=3)
        return transform(rotation(axis / np.linalg.norm(axis), rng.uniform(-3, 3)), rng.uniform(-0.3, 0.3, 3))

    joints = []
    for i, kind in enumerate(kinds):
        axis = rng.normal(size=3)
        low, high = (-0.4, 0.5) if kind == "P" else (-rng.uniform(0.5, 3), rng.uniform(0.5, 3))
        if limit is not None and kind == "R":
            low, high = -limit, limit
        joints.append(Joint(f"j{i}", names[kind], somewhere(), axis / np.linalg.norm(axis), low, high))
    if follower:
        leader = "j0" if follower == "first" else f"j{len(kinds) - 1}"
        mimic = Joint("m", "revolute", somewhere(), np.array([0.0, 0.0, 1.0]), -9.0, 9.0, leader, -0.5, 0.1)
        joints.insert(0 if follower == "first" else len(joints), mimic)
    return kinseek.Arm(serial_chain(joints, somewhere(), name=f"{kinds}{follower}", base="base", tip="tip"))


ODD_ARMS = [
    *(random_arm("R" * n, n) for n in range(1, 21)),
    *(random_arm("P" * n, 30 + n) for n in range(1, 5)),
    *(
        random_arm(kinds, 40)
        for kinds in ("PRRRRR", "RRRRRP", "PRRRRRP", "PP" + "R" * 5, "RRPRR", "PRP", "C", "CCCCCC", "RCRCRCR")
    ),
    *(random_arm("R" * 6, 50, follower=where) for where in ("first", "last")),
    *(random_arm("R" * n, 60, follower=where) for n in (1, 3, 7) for where in ("first", "last")),
    *(random_arm("R" * n, 70 + n, limit=turns * np.pi) for n in (3, 6, 7) for turns in (2, 4)),
]


@pytest.mark.slow
@pytest.mark.parametrize("arm", ODD_ARMS, ids=lambda arm: arm.name)
def test_odd_arms_reach_what_they_can(arm: kinseek.Arm) -> None:
    q = random_joints(arm.chain, 200, 21)
    targets = plain_fk(arm.chain, q)
    solution = arm.ik(targets)
    away, angle = pose_errors(plain_fk(arm.chain, solution.q), targets)
    assert ((solution.q >= arm.lower) & (solution.q <= arm.upper)).all()
    assert (np.maximum(away, angle)[solution.success] <= 1e-6 + ROUNDING).all()
    assert solution.success.all(), np.flatnonzero(~solution.success)
    near = arm.ik(targets[:20], near=q[:20])
    np.testing.assert_allclose(near.q, q[:20], atol=1e-4)


def test_an_arm_that_cannot_move_at_all() -> None:
    arm = kinseek.Arm.from_dh([[0.3, 0.0, 0.1, 0.0]] * 3, [0.5, 0.0, -1.0], [0.5, 0.0, -1.0])
    solution = arm.ik(arm.fk([0.5, 0.0, -1.0]))
    assert solution.success
    np.testing.assert_array_equal(solution.q, [0.5, 0.0, -1.0])


# The atlas as an object


def test_the_atlas_is_built_once_and_knows_its_cost() -> None:
    arm = kinseek.load("panda")
    atlas = arm.atlas
    assert isinstance(atlas, AtlasIndex)
    assert arm.atlas is atlas
    assert 0 < atlas.memory <= 10e6
    assert atlas.build_time > 0
    assert "samples" in repr(atlas)


def test_the_atlas_is_dropped_with_the_arm() -> None:
    arm = kinseek.load("panda")
    arm.ik(arm.fk(np.full(7, 0.1)))
    arm.ik(kinseek.Goal.position([0.3, 0.2, 0.5]))
    atlas, chain = weakref.ref(arm.atlas), weakref.ref(arm.chain)
    del arm
    gc.collect()
    assert chain() is None
    assert atlas() is None


def test_threads_share_an_arm() -> None:
    arm = kinseek.load("panda")
    targets = targets_of(arm, 600)
    with ThreadPoolExecutor(4) as pool:  # The first calls race to build the atlas.
        alone = list(pool.map(lambda target: arm.ik(target).q, targets))
    calm = kinseek.load("panda")
    np.testing.assert_array_equal(alone, [calm.ik(target).q for target in targets])
    results: list[Array] = []
    threads = [threading.Thread(target=lambda: results.append(arm.ik(targets).q)) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    np.testing.assert_array_equal(results[0], results[1])


@pytest.mark.slow
def test_calls_leave_nothing_behind() -> None:
    arm = kinseek.load("panda")
    targets, near = targets_of(arm, 100), np.zeros(7)

    def work(rounds: int) -> None:
        for _ in range(rounds):
            for target in targets:
                arm.ik(target)
        arm.ik(targets)
        arm.ik(targets[0], near=near)

    work(10)
    tracemalloc.start()
    try:
        before = tracemalloc.get_traced_memory()[0]
        work(200)
        gc.collect()
        grown = tracemalloc.get_traced_memory()[0] - before
    finally:
        tracemalloc.stop()
    assert grown < 20_000


def test_a_progress_bar_changes_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("rich")
    arm = kinseek.load("panda")
    targets = targets_of(arm, 2500)
    np.testing.assert_array_equal(arm.ik(targets, progress=True, threads=2).q, arm.ik(targets).q)
    said = capsys.readouterr()
    assert "2500/2500" in said.err
    assert said.out == ""
    arm.ik(targets)
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize("samples", [8, 100, 1000])
def test_a_small_atlas_works_too(samples: int) -> None:
    arm = kinseek.load("ur5e")
    solution = arm.ik(targets_of(arm, 200), solver=kinseek.Atlas(samples=samples))
    assert solution.success.mean() >= 0.99


@pytest.mark.parametrize("name", ["ur5e", "scara4"])
@pytest.mark.parametrize("samples", [8, 16, 64, 1024, 4096])
def test_every_leaf_lists_those_with_the_nearest_centres(name: str, samples: int) -> None:
    chain = kinseek.load(name).chain
    tree = AtlasIndex(chain, POSE, chain.arrays, samples).sorted.tree
    centres = np.zeros(tree.points.shape[:2])
    for j in range(LEAF_SIZE):
        centres += tree.points[:, :, j] / LEAF_SIZE
    for leaf, listed in enumerate(tree.beside):
        far = ((centres - centres[leaf]) ** 2).sum(axis=1)
        far[leaf] = -1.0
        some = min(BESIDE, len(far))
        np.testing.assert_allclose(far[listed[:some]], np.sort(far)[:some], rtol=1e-9)
        assert len(set(listed[:some].tolist())) == some
        assert (listed[some:] == -1).all()
