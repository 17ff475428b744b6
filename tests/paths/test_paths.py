"""`Arm.follow`: one motion through many poses, its breaks, and what it refuses."""

from __future__ import annotations

import contextlib
import itertools
import pickle
import tracemalloc
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import kinseek
from benchmarks.paths.curves import curve
from kinseek import Goal, InvalidGoal, InvalidProblem, InvalidSolver, NotReached, PathInterrupted, PathStatus
from kinseek.derivatives import freedom
from kinseek.kernels.paths.band import solve_band
from kinseek.kernels.paths.trace import ENDED, JOINED, TAKEN, part_ways
from kinseek.kernels.paths.viterbi import COPIED, DISTANCE, STRAIGHT, Layers, Rules, Steps, Turns, viterbi
from kinseek.paths import redundant
from kinseek.paths.branches import Follower, Loss
from kinseek.paths.joints import opened
from kinseek.problem import Problem
from kinseek.robots.joints import Joint, serial_chain
from kinseek.support.transforms import transform

Array = NDArray[np.float64]


def made(arm: kinseek.Arm, count: int, seed: int, harmonics: int = 2, share: float = 0.9) -> Array:
    """A smooth curve of joint values inside the limits, (count, n)."""
    return curve(arm, count, seed, share, harmonics=harmonics)


def line(begin: Array, end: Array, count: int) -> Array:
    """Poses of one orientation on a straight line."""
    return np.array([kinseek.pose(row, rpy=[np.pi, 0, 0]) for row in np.linspace(begin, end, count)])


@pytest.mark.parametrize("name", ["ur5e", "irb120", "jaco2_6", "so101", "panda"])
def test_made_paths_are_followed(name: str) -> None:
    arm = kinseek.load(name)
    q = made(arm, 300, 5)
    T = arm.fk(q)
    path = arm.follow(T).require()
    assert path.success
    assert path.status is PathStatus.CONTINUOUS
    assert not len(path.breaks)
    assert path.why == ()
    turned = np.array([kind == "continuous" for kind in arm.chain.kinds])
    assert ((path.q >= arm.lower) & (path.q <= arm.upper) | turned).all()
    assert np.abs(arm.fk(path.q) - T).max() < 2e-6
    assert np.abs(np.diff(path.q, axis=0)).max() <= 1.5 * np.abs(np.diff(q, axis=0)).max()
    assert (np.abs(np.diff(path.q, axis=0)).max(axis=0) == path.largest_step).all()
    assert path.deviation.distance < 0.02


def test_a_branch_beside_a_singularity_is_not_left_for_its_neighbour() -> None:
    # Two branches cross at pose 453, and come within 0.03 of each other: a step that lands on the other one is noticed.
    arm = kinseek.load("mpx3500")
    q = made(arm, 1000, 64, 4, 0.98)
    largest = float(np.abs(np.diff(q, axis=0)).max())
    part = q[416:482]
    path = arm.follow(arm.fk(part), max_step=1.5 * largest).require()
    assert path.largest_step.max() <= 1.5 * largest


@pytest.mark.slow
def test_memory_grows_by_two_kilobytes_a_pose_with_joints_to_spare() -> None:
    arm, peaks = kinseek.load("panda"), []
    for count in (1000, 3000):
        q = made(arm, count, 0, 4, 0.98)
        T, longest = arm.fk(q), 1.5 * float(np.abs(np.diff(q, axis=0)).max())
        arm.follow(T[:40], max_step=longest, threads=1)  # What the arm needs once.
        tracemalloc.start()
        arm.follow(T, max_step=longest, threads=1).require()
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] - peaks[0] < 2000 * 2000


def test_pairs_of_branches_that_vanish_are_not_looked_for() -> None:
    arm = kinseek.load("irb120")
    follower = Follower(Problem(arm.chain, Goal.pose(arm.fk(made(arm, 3, 0)))), np.full(6, 0.3))

    def lost(target: int, way: int, q: float, taken: bool = False) -> Loss:
        return Loss(target, way, np.full(6, q), taken)

    assert follower.vanish(1, [lost(1, 1, 0.0), lost(1, 1, 0.4)])
    assert follower.vanish(1, [lost(1, 1, 0.0), lost(1, 1, 0.4 + 2 * np.pi), lost(5, -1, 0.0)])
    assert follower.vanish(1, [lost(1, 1, q) for q in (0.0, 2.0, 1.8, 0.1)])
    assert not follower.vanish(1, [lost(1, 1, 0.0)])
    assert not follower.vanish(1, [lost(1, 1, 0.0), lost(1, 1, 1.5)])
    assert not follower.vanish(1, [lost(1, 1, 0.0), lost(1, 1, 0.4), lost(1, 1, 0.5)])
    assert not follower.vanish(1, [lost(1, 1, 0.0), lost(1, 1, 0.4, taken=True)])
    assert not follower.vanish(1, [lost(1, 1, 0.0), lost(1, 1, 0.4), lost(0, -1, 0.2)])
    assert not follower.vanish(1, [lost(1, 1, 0.0), lost(1, -1, 0.4)])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "seed", "part"), [("rizon4", 38, slice(264, 640)), ("gen3", 87, slice(None))]
)
def test_curves_of_answers_that_part_and_join_anew_between_two_poses_are_passed(
    name: str, seed: int, part: slice
) -> None:
    # The one needs a layer at every pose there, the other a way around a place that a plan took for passable as well.
    arm = kinseek.load(name)
    q = made(arm, 1000, seed, 4, 0.98)
    longest = 1.5 * float(np.abs(np.diff(q, axis=0)).max())
    path = arm.follow(arm.fk(q[part]), max_step=longest).require()
    assert path.largest_step.max() <= longest


def test_an_arm_whose_open_limits_seem_to_leave_a_joint_to_spare_is_followed() -> None:
    # Two parallel axes 3 mm apart: folded, with the hand beside them, they count as two; two kilometres off as one.
    z, y, far = (
        np.array([0.0, 0.0, 1.0]),
        np.array([0.0, 1.0, 0.0]),
        transform(np.eye(3), np.array([1e3, 0, 0])),
    )
    beside = transform(np.eye(3), np.array([3e-3, 0.0, 0.0]))
    joints = [
        Joint("a", "revolute", np.eye(4), z, -3.0, 3.0),
        Joint("b", "revolute", beside, z, -3.0, 3.0),
        Joint("c", "revolute", far, y, np.pi - 5e-4, np.pi + 5e-4),
    ]
    arm = kinseek.Arm(serial_chain(joints, far, name="folded", base="base", tip="tip"))
    problem = Problem(arm.chain, Goal.pose(np.eye(4)))
    assert freedom(problem) == 0
    assert freedom(Problem(opened(arm.chain), problem.goal)) == 1
    T = arm.fk(np.linspace([0.0, 0.0, np.pi], [1.0, 1.0, np.pi], 9))
    assert arm.follow(T).require().reached.all()


def test_what_no_step_of_the_joints_can_pass_is_planned_once(monkeypatch: pytest.MonkeyPatch) -> None:
    arm, plans, planned = kinseek.load("panda"), [], redundant._planned

    def counted(*given: Any) -> redundant.Draft:
        plans.append(given)
        return planned(*given)

    T = arm.fk(np.linspace(0.9 * arm.lower, 0.4 * arm.upper, 8))
    monkeypatch.setattr(redundant, "_planned", counted)
    path = arm.follow(T, max_step=1e-9)
    assert path.status is PathStatus.BROKEN
    assert len(path.breaks) == 7
    assert len(plans) == 1


def test_branches_end_where_they_come_upon_others() -> None:
    poses, turn = np.arange(6.0)[:, None], 2 * np.pi
    rows = np.zeros((6, 6, 2))
    # Known are one over all poses, and the end of one.
    rows[:, 0], rows[:, 1] = [7.0 + turn, 4.0], 50.0
    rows[:, 2], rows[:, 3], rows[:, 4] = np.hstack([poses, poses]), [3.0, 3.0], 50.0
    rows[:, 5] = np.hstack([0 * poses + 7.0, poses])
    spans, became = np.array([[0, 5], [5, 5], [0, 5], [0, 5], [0, 5], [0, 5]]), np.full(6, 9)
    part_ways(rows, 2, 1, np.array([1, 0]), spans, became)
    assert spans.tolist() == [[0, 5], [5, 5], [0, 5], [0, 2], [0, 4], [0, 3]]
    assert became.tolist() == [9, 9, ENDED, TAKEN, JOINED, TAKEN]
    rows[:, 2], spans = rows[:, 1], np.array([[0, 5], [0, 1], [0, 5]])
    part_ways(rows[:, :3].copy(), 2, -1, np.array([1, 0]), spans, became[:3])
    assert spans[2].tolist() == [2, 5]
    assert became[2] == JOINED


def brute(q: list[Array], longest: float) -> tuple[int, float]:
    """Fewest breaks, and then the least distance, by trying all ways."""
    best = (len(q), np.inf)
    for nodes in itertools.product(*[range(len(row)) for row in q]):
        rows = np.array([q[i][k] for i, k in enumerate(nodes)])
        steps = np.diff(rows, axis=0)
        broken = np.abs(steps).max(axis=1) > longest
        best = min(best, (int(broken.sum()), float(np.linalg.norm(steps[~broken], axis=1).sum())))
    return best


@pytest.mark.parametrize("seed", range(8))
def test_viterbi_agrees_with_trying_all_ways(seed: int) -> None:
    rng = np.random.default_rng(seed)
    q = rng.uniform(0.0, 7.0, (5, 2, 2))
    lower, upper = np.array([0.0, 0.0]), np.array([7.0, 9.0])
    turn = 2 * np.pi
    q[..., 1] %= turn
    every = []
    for rows in q:
        copies = [[row[0], row[1] + k * turn] for row in rows for k in range(2) if row[1] + k * turn <= 9.0]
        every.append(np.array(copies))
    path, told, nothing = np.zeros(5, dtype=np.int64), np.zeros(5), np.zeros((0, 0))
    turns = Turns(lower, upper, np.array([STRAIGHT, COPIED]), np.array([1, 2]))
    steps = Steps(np.array([[2.5, 2.5]]), np.ones(2), DISTANCE)
    rules = Rules(nothing, nothing.astype(bool), np.zeros((0, 3), dtype=np.int64), np.array([-1, -1]))
    breaks = viterbi(Layers(q, np.full(5, 2)), turns, steps, rules, path, told)
    fewest, least = brute(every, 2.5)
    assert breaks == fewest
    assert told[0] == pytest.approx(least)
    values = np.array([q[i, node // 2] + [0.0, turn * (node % 2)] for i, node in enumerate(path)])
    broken = np.abs(np.diff(values, axis=0)).max(axis=1) > 2.5
    assert broken.sum() == breaks
    assert (broken == (told[1:] > 0)).all()


def test_answers_at_the_ends_of_a_range_of_whole_turns_stay_inside_the_nodes() -> None:
    # Exactly at the lower end a joint with two copies has a third, for which there is no node.
    turn = 2 * np.pi
    q = np.zeros((4, 2, 1))
    q[:, 0, 0], q[:, 1, 0] = [-turn, -1e-10, -turn, -1e-10], -3.0
    path, told, nothing = np.zeros(4, dtype=np.int64), np.zeros(4), np.zeros((0, 0))
    turns = Turns(np.array([-turn]), np.array([turn]), np.array([COPIED]), np.array([2]))
    steps = Steps(np.array([[0.5]]), np.ones(1), DISTANCE)
    rules = Rules(nothing, nothing.astype(bool), np.zeros((0, 3), dtype=np.int64), np.array([-1, -1]))
    viterbi(Layers(q, np.full(4, 2)), turns, steps, rules, path, told)
    assert ((path >= 0) & (path < 4)).all()


@pytest.mark.parametrize(("turns", "refused"), [(20, False), (200, True)])
def test_limits_of_many_turns_on_many_joints_are_refused(turns: int, refused: bool) -> None:
    ends = np.array([np.pi * turns, np.pi * turns, 1.0])
    arm = kinseek.Arm.from_dh([[0.3, 0.0, 0.1, 0.0]] * 3, -ends, ends)
    poses = arm.fk(np.linspace([0.1, 0.2, 0.3], [0.2, 0.3, 0.4], 3))
    if not refused:
        assert arm.follow(Goal.position(poses[:, :3, 3])).success
        return
    with pytest.raises(InvalidProblem, match=r"occurs 40,000 times, expected at most 20,000"):
        arm.follow(Goal.position(poses[:, :3, 3]))


def test_the_band_is_solved() -> None:
    rng = np.random.default_rng(0)
    count, n = 6, 3
    blocks = np.array([8 * np.eye(n) + (lambda A: A @ A.T)(rng.normal(size=(n, n))) for _ in range(count)])
    coupling, right = rng.uniform(0.5, 2.0, size=(2, count, n))
    whole = np.zeros((count * n, count * n))
    for i in range(count):
        here = slice(i * n, i * n + n)
        whole[here, here] = blocks[i]
        if i:
            before = slice(i * n - n, i * n)
            whole[here, before] = whole[before, here] = -np.diag(coupling[i - 1])
    expected = np.linalg.solve(whole, right.ravel()).reshape(count, n)
    solve_band(blocks, coupling, right)
    assert np.allclose(right, expected, rtol=0, atol=1e-13)


def test_a_limit_that_breaks_a_path_is_named() -> None:
    arm = kinseek.load("ur5e")
    q = np.repeat([[0.3, -1.2, 1.5, -1.0, 1.4, 0.2]], 60, axis=0)
    q[:, 0] = np.linspace(-0.6, 0.6, 60)
    narrow = arm.with_limits({"shoulder_pan_joint": (-0.5, 0.5)})
    path = narrow.follow(arm.fk(q))
    assert path.status in (PathStatus.UNREACHABLE, PathStatus.BROKEN)
    assert path.why
    assert not path.success
    with pytest.raises(NotReached) as caught:
        path.require()
    assert caught.value.solution is path
    # Elbow up reaches the first places alone, elbow down the last: in between one of them meets the limit of the base.
    two = kinseek.Arm.from_dh([(0.3, 0, 0, 0), (0.2, 0, 0, 0)], [-1, -2], [1, 2], name="two links")
    angles = np.linspace(-1.3, 1.3, 120)
    places = 0.4 * np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
    path = two.follow(Goal.position(places))
    assert path.status is PathStatus.BROKEN
    assert len(path.breaks) == 1
    assert "reaches its upper limit 1" in path.why[0] or "reaches its lower limit -1" in path.why[0]


def test_breaks_are_as_few_as_with_all_branches_at_every_pose() -> None:
    arm = kinseek.load("irb120")
    for seed in range(3):
        T = arm.fk(made(arm, 60, seed, 4, 0.98))
        jump = arm.fk(made(arm, 30, seed + 50))
        T = np.concatenate([T, jump])
        path = arm.follow(T, max_step=0.4)
        layers = [np.asarray(arm.branches(row).q) for row in T]
        fewest = np.zeros(len(layers[0]))
        for before, after in itertools.pairwise(layers):
            far = np.abs(after[:, None] - before[None]).max(axis=-1) > 0.4
            fewest = (fewest[None] + far).min(axis=1)
        assert len(path.breaks) == fewest.min()
        assert (np.abs(np.diff(path.q, axis=0)).max(axis=1)[path.breaks] > 0.4).all()


def test_closed_circles_come_back() -> None:
    for name in ("ur5e", "panda"):
        arm, s = kinseek.load(name), np.linspace(0, 2 * np.pi, 80, endpoint=False)
        centre = [0.4, 0.1, 0.4]
        T = np.array(
            [
                kinseek.pose(np.add(centre, [0, 0.1 * np.cos(a), 0.1 * np.sin(a)]), rpy=[np.pi, 0, 0])
                for a in s
            ]
        )
        path = arm.follow(T, closed=True).require()
        assert np.abs(path.q[-1] - path.q[0]).max() < 0.1
        assert len(path.steps) == len(T)


def test_start_and_end_are_kept() -> None:
    for name in ("ur5e", "panda"):
        arm = kinseek.load(name)
        T = line(np.array([0.4, -0.2, 0.4]), np.array([0.4, 0.2, 0.4]), 60)
        for q0 in arm.branches(T[0], count=3).q:
            path = arm.follow(T, start=q0)
            assert np.abs(path.q[0] - q0).max() < 1e-9
        q1 = arm.ik(T[-1]).q
        assert np.abs(arm.follow(T, end=q1).q[-1] - q1).max() < 1e-9
    with pytest.raises(
        InvalidProblem, match=r"start does not reach the first pose: it is .* m and .* rad off"
    ):
        arm.follow(T, start=arm.ik(T[30]).q)
    with pytest.raises(InvalidProblem, match="start lies outside the limits"):
        arm.follow(T, start=np.full(arm.dof, 3.5))


@pytest.mark.parametrize("end", ["start", "end"])
def test_an_end_that_the_search_misses_by_rounding_is_reached(end: str) -> None:
    """The search missed its pose, so the path asked the user's `valid` for the reason; there was none."""
    arm, judged = kinseek.load("ur5e"), 0
    for seed in range(40):
        a, b = arm.sample(2, seed=seed)
        q = np.linspace(a, b, 200)[:5]
        goal = kinseek.Goal.pose(arm.fk(q), orientation_tolerance=1e-17)
        with contextlib.suppress(InvalidProblem):  # Its own FK misses by rounding, too.
            path = arm.follow(goal, **{end: q[-1] if end == "end" else q[0]})
            assert path.reached[-1 if end == "end" else 0]
            assert not any("valid" in reason for reason in path.why)
            judged += not arm.ik(goal).success[-1 if end == "end" else 0]
    assert judged


def test_a_start_at_the_ends_of_a_range_of_whole_turns() -> None:
    arm = kinseek.load("ur5e")
    for end in (arm.lower, arm.upper):
        q = np.repeat([[0.0, -1.0, 1.2, -0.8, 1.3, 0.0]], 30, axis=0)
        q[:, 5] = end[5]
        q[:, 5] -= np.sign(end[5]) * np.linspace(0.0, 0.5, 30)
        path = arm.follow(arm.fk(q), start=q[0], max_step=0.05).require()
        assert (path.q[0] == q[0]).all()
        assert np.abs(path.q - q).max() < 1e-6


@pytest.mark.parametrize("joints", [[5], [0], [3], [0, 5]])
@pytest.mark.parametrize("side", [-1, 1])
def test_joints_that_touch_the_end_of_a_range_of_whole_turns(joints: list[int], side: int) -> None:
    arm = kinseek.load("ur5e")
    for away in (0.4 * np.abs(np.linspace(-1, 1, 41)), np.zeros(41)):  # Once, and all the time.
        q = np.repeat([[0.3, -1.0, 1.2, -0.8, 1.3, 0.2]], 41, axis=0)
        q[:, joints] = side * (2 * np.pi - away[:, None])
        path = arm.follow(arm.fk(q), start=q[0], max_step=0.05).require()
        assert np.abs(path.q - q).max() < 1e-8
        assert ((path.q >= arm.lower) & (path.q <= arm.upper)).all()


@pytest.mark.slow
@pytest.mark.parametrize("locked", [{}, {"joint_3": 0.3}])
def test_a_start_keeps_the_turns_of_endless_joints(locked: dict[str, float]) -> None:
    arm = kinseek.load("gen3")
    arm = arm.with_locked(locked) if locked else arm
    q = made(arm, 40, 5, 1, 0.3)
    q[:, 0] += 20.0
    path = arm.follow(arm.fk(q), start=q[0]).require()
    assert (path.q[0] == q[0]).all()
    path = arm.follow(arm.fk(q), end=q[-1]).require()
    assert (path.q[-1] == q[-1]).all()
    other = (
        q[-1] - np.eye(arm.dof)[0] * 4 * np.pi
    )  # The same pose, turned; the motion keeps the turns of its start.
    path = arm.follow(arm.fk(q), start=q[0], end=other).require()
    assert (path.q[0] == q[0]).all()
    assert path.q[-1] == pytest.approx(q[-1])


def test_valid_is_asked_of_poses_and_between() -> None:
    arm = kinseek.load("ur5e")
    T = line(np.array([0.4, -0.3, 0.3]), np.array([0.4, 0.3, 0.3]), 40)
    free = arm.follow(T).require()
    asked: list[Array] = []

    def elsewhere(q: Array) -> bool:
        asked.append(q)
        return bool(abs(q[2] - free.q[20, 2]) > 0.3)

    path = arm.follow(T, valid=elsewhere)
    assert path.success
    assert all(elsewhere(q) for q in path.q)
    between = (path.q[1:] + path.q[:-1]) / 2
    assert any(np.abs(np.array(asked) - between[5]).max(axis=1) < 1e-12)
    refused = arm.follow(T, valid=lambda q: False)
    assert refused.status is PathStatus.BLOCKED
    assert "valid rejects" in refused.why[0]
    with pytest.raises(InvalidProblem, match="valid raised ZeroDivisionError"):
        arm.follow(T, valid=lambda q: 1 / 0)


def test_costs() -> None:
    arm = kinseek.load("ur5e")
    T = line(np.array([0.4, -0.3, 0.3]), np.array([0.4, 0.3, 0.3]), 40)
    up = arm.follow(T, cost=lambda q: q[:, 1])
    down = arm.follow(T, cost=lambda q: -q[:, 1])
    assert up.q[:, 1].sum() < down.q[:, 1].sum()
    quick = arm.follow(T, velocity=[0.01, 1, 1, 1, 1, 1])
    assert quick.largest_step[0] <= arm.follow(T).largest_step[0] + 1e-9
    with pytest.raises(InvalidProblem, match="velocity must be above 0"):
        arm.follow(T, velocity=0.0)


def test_times_bound_the_steps() -> None:
    arm = kinseek.load("ur5e")
    T = line(np.array([0.4, -0.3, 0.3]), np.array([0.4, 0.3, 0.3]), 40)
    need = float(arm.follow(T).largest_step.max())
    times = np.linspace(0.0, 1.0, 40)
    assert arm.follow(T, times=times, velocity=1.1 * need * 39).success
    slow = arm.follow(T, times=times, velocity=0.2 * need * 39)
    assert slow.status is PathStatus.BROKEN
    # A warning of NumPy is an error here.
    assert arm.follow(T[:2], times=[-1e308, 1e308], velocity=1.0).success
    with pytest.raises(InvalidProblem, match=r"times must increase: times\[3\]"):
        arm.follow(T, times=[0, 1, 2, 3, 3, *range(5, 40)], velocity=1.0)


def test_poses_out_of_reach_are_named() -> None:
    arm = kinseek.load("ur5e")
    T = line(np.array([0.5, 0.0, 0.3]), np.array([1.3, 0.0, 0.3]), 50)
    path = arm.follow(T)
    assert path.status is PathStatus.UNREACHABLE
    first = int(np.flatnonzero(~path.reached)[0])
    assert not path.reached[first:].any()
    assert f"poses {first} to 49 are out of reach" in path.why[0]
    assert ((path.q >= arm.lower) & (path.q <= arm.upper)).all()
    assert path.position_error[-1] > 0.1


def test_goals_with_freedom() -> None:
    arm = kinseek.load("ur5e")
    T = line(np.array([0.4, -0.3, 0.3]), np.array([0.4, 0.3, 0.3]), 60)
    fixed = arm.follow(T).require()
    for goal in (
        Goal.pose(T, free="rz"),
        Goal.pose(T, box={"rz": (-0.5, 0.5)}),
        Goal.pose(T, box={"z": (-0.05, 0.05)}),
        Goal.position(T[:, :3, 3]),
    ):
        path = arm.follow(goal).require()
        errors = goal.measure(path.problem.arrays, path.q)
        assert errors[:, :2].max() < 1e-6
        assert path.length < fixed.length * (1 + 1e-6)
    each = arm.follow([Goal.pose(row, free="rz") for row in T])
    assert (each.q == arm.follow(Goal.pose(T, free="rz")).q).all()
    with pytest.raises(InvalidGoal, match="goal 1 has"):
        arm.follow([Goal.pose(T[0]), Goal.pose(T[1], position_tolerance=1e-3)])
    with pytest.raises(InvalidGoal, match=r"got an array of shape \(4, 4\) at index 1; .* Goal\.pose\(T\)$"):
        arm.follow([Goal.pose(T[0]), T[1]])
    with pytest.raises(InvalidGoal, match=r"got a Goal of 2 targets at index 0"):
        arm.follow([Goal.pose(T[:2]), Goal.pose(T[2])])


RANGES: list[dict[str, Any]] = [
    {"free": "rz", "box": {"x": (-0.05, 0.05)}},
    {"free": "rz", "box": {"x": (-0.05, 0.05)}, "frame": "base"},
    {"box": {"rz": (-0.5, 0.5), "x": (-0.05, 0.05)}},
    {"box": {"rz": (-0.5, 0.5)}, "frame": "base"},
    {"free": ("rx", "ry", "rz"), "box": {"x": (-0.05, 0.05)}},
    {"free": ("rx", "ry", "rz"), "box": {"x": (-0.05, 0.05)}, "frame": "base"},
    {"free": "x"},
    {"free": "rz", "box": {"rx": (-0.3, 0.3), "ry": (-0.3, 0.3)}},
    {"box": {"rx": (-0.1, 0.3), "ry": (-0.3, 0.3), "rz": (-1, 1), "z": (0, 0.05)}},
    {"box": {"rx": (-0.3, 0.3), "ry": (-0.3, 0.3), "rz": (-0.3, 0.3)}, "frame": "base"},
]


@pytest.mark.slow
@pytest.mark.parametrize("asked", RANGES, ids=str)
def test_ranges_with_a_start_and_an_end(asked: dict[str, Any]) -> None:
    arm = kinseek.load("ur5e")
    T = np.array([kinseek.pose([0.4, y, 0.3], rpy=[np.pi, 0.3, 0.5]) for y in np.linspace(-0.3, 0.3, 60)])
    goal = Goal.pose(T, **asked)
    first, last = arm.ik(goal.at(T[0])).require().q, arm.ik(goal.at(T[-1])).require().q
    assert arm.follow(goal).success
    path = arm.follow(goal, start=first).require()
    assert (path.q[0] == first).all()
    errors = goal.measure(path.problem.arrays, path.q)
    assert errors[:, :2].max() < 1e-6
    path = arm.follow(goal, end=last).require()
    assert (path.q[-1] == last).all()
    path = arm.follow(goal, start=path.q[0], end=last).require()
    assert (path.q[-1] == last).all()
    with pytest.raises(InvalidProblem, match="start does not reach the first pose"):
        arm.follow(goal, start=arm.ik(kinseek.pose([0.3, 0.3, 0.3])).q)


@pytest.mark.parametrize(
    "ranges",
    [
        {"box": {"rx": (-0.3, 0.3), "ry": (-0.3, 0.3)}},
        {"box": {"rx": (0.1, 0.3), "ry": (-0.3, 0.3)}, "free": "rz"},
        {"box": {"rx": (0.1, 0.3), "rz": (0.5, 0.9), "x": (0.01, 0.02)}},
        {"free": "rz", "cone": 0.17},
        {"free": "rx", "cone": 0.5, "box": {"z": (-0.01, 0.05)}},
        {"free": "rz", "cone": 0.3, "frame": "base"},
    ],
)
def test_ranges_of_several_rotations_and_cones(ranges: dict[str, Any]) -> None:
    arm = kinseek.load("ur5e")
    goal = Goal.pose(line(np.array([0.4, -0.3, 0.3]), np.array([0.4, 0.3, 0.3]), 60), **ranges)
    path = arm.follow(goal).require()
    errors = goal.measure(path.problem.arrays, path.q)
    assert errors[:, :2].max() < 1e-6
    assert np.abs(np.diff(path.q, axis=0)).max() < 0.1


def test_a_cone_reaches_what_a_direction_does_not() -> None:
    arm = kinseek.load("ur5e")
    T = line(np.array([0.92, -0.1, 0.163]), np.array([0.92, 0.1, 0.163]), 30)
    assert not arm.follow(Goal.pose(T, free="rz")).success
    goal = Goal.pose(T, free="rz", cone=1.2)
    path = arm.follow(goal).require()
    tilt = np.arccos((arm.fk(path.q)[:, :3, 2] * T[:, :3, 2]).sum(axis=1))
    assert 0.1 < tilt.max() <= 1.2 + 1e-6


def test_ranges_whose_axes_change_are_refused() -> None:
    arm = kinseek.load("ur5e")
    T = np.array([kinseek.pose([0.4, a / 5, 0.3], rpy=[np.pi, a, 0.5]) for a in np.linspace(-0.3, 0.3, 20)])
    with pytest.raises(
        InvalidProblem, match="along axes of the tool need axes in the base that are the same"
    ):
        arm.follow(Goal.pose(T, free=("rx", "ry", "rz"), box={"x": (-0.05, 0.05)}))
    with pytest.raises(
        InvalidProblem, match="about axes of the base need axes in the tool that are the same"
    ):
        arm.follow(Goal.pose(T, box={"rz": (-0.5, 0.5)}, frame="base"))
    with pytest.raises(InvalidProblem, match="Give the ranges with frame='tool'"):
        arm.follow(Goal.pose(T, free="rz", frame="base"))
    with pytest.raises(InvalidProblem, match="too little is left of these"):
        arm.follow(Goal.pose(T, box={"rx": (-3.0, 0.0), "ry": (-3.0, 3.0), "rz": (1.0, 1.2)}))
    # About y they turn themselves: the axis stays.
    T = np.array([kinseek.pose([0.4, a / 5, 0.3], rpy=[np.pi, a, 0]) for a in np.linspace(-0.3, 0.3, 20)])
    assert arm.follow(Goal.pose(T, box={"ry": (-0.5, 0.5)}, frame="base")).success


def test_same_bits_whatever_the_threads() -> None:
    for name in ("irb120", "panda"):
        arm = kinseek.load(name)
        T = arm.fk(made(arm, 150, 1))
        assert (arm.follow(T, threads=1).q == arm.follow(T, threads=3).q).all()


def test_few_poses() -> None:
    arm = kinseek.load("ur5e")
    T = line(np.array([0.4, -0.3, 0.3]), np.array([0.4, 0.3, 0.3]), 3)
    assert len(arm.follow(T[:1])) == 1
    assert arm.follow(T[:1]).success
    assert arm.follow(np.stack([T[0], T[0]])).length == 0.0
    panda = kinseek.load("panda")
    assert panda.follow(T[:1]).success
    assert panda.follow(np.stack([T[0], T[0]])).length < 1e-6
    empty: list[Any] = [[], np.zeros((0, 4, 4)), iter(())]
    for nothing in empty:
        with pytest.raises(InvalidGoal, match="at least one pose"):
            arm.follow(nothing)
    with pytest.raises(InvalidGoal, match=r"shape \(4, 4\)"):
        arm.follow(T[0])
    with pytest.raises(InvalidGoal, match=r"Arm\.ik"):
        arm.follow(Goal.pose(T[0]))


def test_poses_metres_apart_are_said_to_be() -> None:
    arm = kinseek.load("ur5e")
    T = np.stack([kinseek.pose([0.5, 0.1, 0.3], rpy=[np.pi, 0, 0]), kinseek.pose([-0.5, -0.1, 0.3])])
    path = arm.follow(T, max_step=0.05)
    assert path.status is PathStatus.BROKEN
    assert "1.02 m and 3.14 rad apart" in path.why[0]


def test_a_row_that_is_no_number_is_named() -> None:
    arm = kinseek.load("ur5e")
    T = np.repeat(line(np.zeros(3), np.ones(3), 1), 50_000, axis=0)
    T[41_327, 0, 3] = np.nan
    with pytest.raises(InvalidGoal, match=r"41,?327"):
        arm.follow(T)


def test_what_came_before_an_error_is_kept() -> None:
    arm = kinseek.load("ur5e")
    T = line(np.array([0.4, -0.3, 0.3]), np.array([0.4, 0.3, 0.3]), 20)

    def poses() -> Iterator[Array]:
        yield from T[:12]
        raise OSError("the network is down")

    assert (arm.follow(iter(T)).q == arm.follow(T).q).all()
    with pytest.raises(PathInterrupted, match="after 12 poses: the network is down") as caught:
        arm.follow(poses())
    assert isinstance(caught.value.__cause__, OSError)
    assert caught.value.path.success
    assert len(caught.value.path) == 12
    assert len(pickle.loads(pickle.dumps(caught.value)).path) == 12


@pytest.mark.parametrize(
    ("asked", "error", "said"),
    [
        (
            {"times": [0.0, 1.0]},
            InvalidProblem,
            r"times must be 4 finite numbers \[s\], one per pose, got shape \(2,\)",
        ),
        ({"times": [0.0, 1.0, np.nan, 3.0]}, InvalidProblem, "times must be 4 finite numbers"),
        (
            {"times": [0.0, 2.0, 1.0, 3.0]},
            InvalidProblem,
            r"times must increase: times\[1\] = 2 s and times\[2\] = 1 s",
        ),
        ({"velocity": [1, 1, 0, 1, 1, 1]}, InvalidProblem, "velocity must be above 0 .* joint 'elbow_joint'"),
        ({"velocity": [1, 1]}, InvalidProblem, "velocity must be a number or 6 of them"),
        ({"max_step": -0.1}, InvalidProblem, "max_step must be above 0"),
        ({"weights": np.inf}, InvalidProblem, "weights must be above 0 and finite"),
        ({"start": np.zeros((2, 6))}, InvalidProblem, r"start must have shape \(6,\)"),
        ({"start": [np.nan] * 6}, InvalidProblem, "start contains NaN"),
        ({"end": np.zeros(6)}, InvalidProblem, "end does not reach the last pose: it is .* m and .* rad off"),
        (
            {"end": np.zeros(6), "closed": True},
            InvalidProblem,
            "closed path ends where it begins|end does not reach",
        ),
        ({"threads": 0}, InvalidSolver, "threads"),
        ({"threads": 1.5}, InvalidSolver, "threads"),
    ],
)
def test_what_does_not_fit_is_said(asked: dict[str, Any], error: type[Exception], said: str) -> None:
    arm = kinseek.load("ur5e")
    T = line(np.array([0.4, -0.3, 0.3]), np.array([0.4, 0.3, 0.3]), 4)
    with pytest.raises(error, match=said):
        arm.follow(T, **asked)


def test_functions_are_refused() -> None:
    T = line(np.array([0.4, -0.3, 0.3]), np.array([0.4, 0.3, 0.3]), 4)
    function = kinseek.Arm.from_fk(
        lambda q: kinseek.pose([q[0], q[1], 0.0]), [-1, -1], [1, 1], vectorized=False
    )
    with pytest.raises(InvalidProblem, match="has black-box kinematics"):
        function.follow(T)


def test_a_path_says_what_it_is() -> None:
    arm = kinseek.load("ur5e")
    T = line(np.array([0.5, 0.0, 0.3]), np.array([1.3, 0.0, 0.3]), 50)
    assert "50 poses, unreachable" in repr(arm.follow(T))
    assert not arm.follow(T[:5]).certified
