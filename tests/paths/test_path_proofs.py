"""`Arm.follow(..., prove=True)`: what is proved of a path is true, and what is false is not proved."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import kinseek
from kinseek import Goal
from kinseek.derivatives import constraint_jacobian
from kinseek.kernels.arm.jacobian import jacobian_many
from kinseek.kernels.paths.steps import INSIDE, LEAVES, OUTSIDE, SOMEWHERE, UNPROVED
from kinseek.paths import missed
from kinseek.paths.certify import prove_rows
from kinseek.paths.impossible import Search
from kinseek.paths.missed import judge_missed
from kinseek.problem import Problem
from kinseek.proof.boxes import excluded
from kinseek.proof.branch_and_bound import prove
from kinseek.support.transforms import rotation_vectors, rotations

Array = NDArray[np.float64]

TURN = 2 * np.pi


def made(arm: kinseek.Arm, count: int, seed: int, share: float = 0.4) -> Array:
    """A smooth curve of joint values, four harmonics, inside a share of the limits, (count, n)."""
    rng, s, q = np.random.default_rng(seed), np.linspace(0.0, 1.0, count), np.zeros((count, arm.dof))
    for h in range(1, 5):
        a, b = rng.normal(size=(2, arm.dof))
        q += (np.cos(TURN * h * s)[:, None] * a + np.sin(TURN * h * s)[:, None] * b) / h
    low, high = q.min(axis=0), q.max(axis=0)
    half = np.minimum((arm.upper - arm.lower) / 2, np.pi)
    middle = (arm.lower + arm.upper) / 2 + (1 - share) * half * rng.uniform(-1, 1, arm.dof)
    return np.asarray(middle + share * half * (2 * (q - low) / (high - low) - 1))


def off_singular(arm: kinseek.Arm, q: Array) -> Array:
    """Least singular value of the Jacobian beside the largest, (k,)."""
    problem = Problem(arm.chain, Goal.pose(np.eye(4)))
    values = np.linalg.svd(constraint_jacobian(problem, q), compute_uv=False)
    return np.asarray(values[:, -1] / values[:, 0])


def calm(arm: kinseek.Arm, count: int, seed: int) -> Array:
    """A made curve that stays off singularities."""
    for k in range(1000):
        q = made(arm, count, 1000 * seed + k, 0.4 * 0.99**k)
        if off_singular(arm, q).min() > 0.05:
            return q
    raise AssertionError("no such curve")


def proved(arm: kinseek.Arm, q: Array, T: Array, keep: bool = True) -> NDArray[np.int64]:
    """What is proved of each step."""
    return prove_rows(Problem(arm.chain, Goal.pose(T)), q, np.arange(len(q) - 1), keep=keep).state


def straight(begin: Array, end: Array, s: float) -> Array:
    """The hand's pose on the straight way."""
    T = begin.copy()
    T[:3, 3] += s * (end[:3, 3] - begin[:3, 3])
    turn = rotation_vectors((end[:3, :3] @ begin[:3, :3].T)[None])
    T[:3, :3] = rotations(s * turn)[0] @ begin[:3, :3]
    return T


def walk(
    arm: kinseek.Arm, q: Array, begin: Array, end: Array, parts: int, hold: Array | None = None
) -> Array:
    """Go along a step in many small parts by Newton's method alone, (parts + 1, n); no limit is asked for."""
    rows = [q]
    for k in range(1, parts + 1):
        T = straight(begin, end, k / parts)
        q = rows[-1].copy()
        for _ in range(30):
            now = arm.fk(q)
            off = np.r_[T[:3, 3] - now[:3, 3], rotation_vectors((T[:3, :3] @ now[:3, :3].T)[None])[0]]
            if np.abs(off).max() < 1e-12:
                break
            q += np.linalg.pinv(jacobian_many(arm.chain.arrays, q[None])[0]) @ off
        assert np.abs(off).max() < 1e-11
        rows.append(q)
    return np.array(rows)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ur5e", "puma560", "irb120", "jaco2_6", "panda", "iiwa14"])
def test_paths_off_singularities_are_certified(name: str) -> None:
    arm = kinseek.load(name)
    T = arm.fk(calm(arm, 300, 1))
    path = arm.follow(T, prove=True).require()
    # With joints to spare a path may touch a limit, where the straight way leads out of it.
    assert path.proved.mean() > (0.98 if arm.dof > 6 else 0.99)
    assert path.certified == path.proved.all()
    assert path.proof is not None
    within = path.proof.within
    assert within[np.isfinite(within)].max() < 1e-4
    assert (np.isfinite(within[1:]) | np.isfinite(within[:-1])).all() or arm.dof > 6
    assert path.impossible == ()
    plain = arm.follow(T)
    assert (plain.q == path.q).all()
    assert not plain.certified
    assert not plain.proved.any()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ur5e", "puma560", "kr6r900"])
def test_steps_that_are_proved_are_walked_without_a_jump(name: str) -> None:
    arm = kinseek.load(name)
    q = made(arm, 400, 3, 0.9)  # It comes near singularities.
    T = arm.fk(q)
    state = proved(arm, q, T)
    assert (state == INSIDE).mean() > 0.5
    near = np.argsort(off_singular(arm, q[:-1]) + 10.0 * (state != INSIDE))[:8]
    spread = np.flatnonzero(state == INSIDE)[::40]
    for i in np.union1d(near, spread):
        assert state[i] == INSIDE
        rows = walk(arm, q[i], T[i], T[i + 1], 60)
        assert np.abs(rows[-1] - q[i + 1]).max() < 1e-6
        assert ((rows >= arm.lower) & (rows <= arm.upper)).all()
        assert np.abs(np.diff(rows, axis=0)).max() < 0.1


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ur5e", "puma560", "irb120", "kr6r900"])
def test_no_planted_jump_is_certified(name: str) -> None:
    arm = kinseek.load(name)
    planted = within = 0
    for seed in range(4):
        q = made(arm, 400, seed, 0.8)
        T = arm.fk(q)
        nearest = np.argsort(off_singular(arm, q))[:25]
        for i in np.union1d(nearest, np.arange(20, 400, 40)):
            if not 0 < i < len(q) - 1:
                continue
            others = arm.branches(T[i]).q
            steps = others - q[i]
            steps -= TURN * np.round(steps / TURN)
            for step in steps[np.abs(steps).max(axis=1) > 1e-5]:
                jumped = q[i - 1 : i + 2].copy()
                jumped[1] += step
                state = proved(arm, jumped, T[i - 1 : i + 2], keep=False)
                assert (state == UNPROVED).any()
                planted += 1
                within += np.abs(step).max() < 0.3
    assert planted > 40
    assert within > 0 or name == "puma560"


def test_a_jump_back_to_the_next_pose_is_not_certified_either() -> None:
    arm = kinseek.load("ur5e")
    q = calm(arm, 300, 2)[:60]
    T = arm.fk(q)
    others = arm.branches(T[30]).q
    gaps = np.abs(np.sin((others - q[30]) / 2)).max(axis=1)
    other = others[np.argmin(np.where(gaps > 1e-3, gaps, np.inf))]
    jumped = np.concatenate([q[:30], arm.follow(T[30:], start=other).q])
    state = proved(arm, jumped, T)
    assert state[29] == UNPROVED
    assert (np.delete(state, 29) == INSIDE).mean() > 0.9


def limited(arm: kinseek.Arm, joint: int, upper: float) -> kinseek.Arm:
    """The same arm with another upper limit of one joint."""
    high = arm.upper.copy()
    high[joint] = upper
    return kinseek.Arm(arm.chain.limited(arm.lower, high, arm.chain.kinds))


def test_a_limit_that_is_crossed_between_two_poses_is_seen() -> None:
    arm = kinseek.load("ur5e")
    # Past the shoulder: the elbow bends most in the middle of the way.
    T = np.array([kinseek.pose([0.35, y, 0.2], rpy=[np.pi, 0, 0]) for y in (-0.15, 0.15)])
    rows = walk(arm, arm.ik(T[0]).require().q, T[0], T[1], 200)
    over = rows.max(axis=0) - np.maximum(rows[0], rows[-1])
    joint = int(np.argmax(over))
    assert over[joint] > 0.01
    top, ends = rows[:, joint].max(), max(rows[0, joint], rows[-1, joint])
    both = rows[[0, -1]]
    assert proved(arm, both, T)[0] == INSIDE
    assert proved(limited(arm, joint, top + 0.05), both, T)[0] == INSIDE
    for share in (0.01, 0.5, 0.9):
        narrow = limited(arm, joint, ends + share * (top - ends))
        assert ((both <= narrow.upper) & (both >= narrow.lower)).all()
        assert proved(narrow, both, T)[0] in (UNPROVED, LEAVES)
        assert proved(narrow, both, T, keep=False)[0] in (SOMEWHERE, OUTSIDE)
    assert proved(limited(arm, joint, ends + 0.5 * (top - ends)), both, T, keep=False)[0] == OUTSIDE


@pytest.mark.parametrize("name", ["ur5e", "irb120", "puma560"])
def test_a_step_through_a_singularity_is_not_certified(name: str) -> None:
    arm = kinseek.load(name)
    rng = np.random.default_rng(5)
    wrist = 4
    for _ in range(10):
        q = rng.uniform(0.3, 0.7, arm.dof) * (arm.upper - arm.lower) + arm.lower
        q[wrist] = 0.0
        step = 0.03 * rng.normal(size=arm.dof)
        step[wrist] = rng.choice([-1, 1]) * rng.uniform(0.005, 0.05)
        rows = np.array([q - 0.4 * step, q + 0.6 * step])
        assert proved(arm, rows, arm.fk(rows), keep=False)[0] == UNPROVED


def test_missed_poses_are_proved_out_of_reach() -> None:
    arm = kinseek.load("ur5e")
    T = np.array([kinseek.pose([x, 0.1, 0.3], rpy=[np.pi, 0, 0]) for x in np.linspace(0.5, 1.2, 60)])
    path = arm.follow(T, prove=True)
    assert path.proof is not None
    assert path.proof.out_of_reach.any()
    assert not (path.proof.out_of_reach & path.reached).any()
    first = int(np.flatnonzero(~path.reached)[0])
    assert any(f"poses {first} to 59 are proved out of reach" in each for each in path.why)
    assert not path.certified
    assert path.proved[: first - 1].mean() > 0.9
    assert not path.proved[first - 1 :].any()


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["pose", "position", "pointing"])
def test_no_pose_that_can_be_reached_is_proved_out_of_reach_with_its_neighbours(kind: str) -> None:
    arm = kinseek.load("irb120")
    T = arm.fk(made(arm, 60, 7, 0.9))
    moved = (np.arange(60) >= 20) & (np.arange(60) < 40)
    T[moved, :3, 3] *= 1.0 + np.sin(np.linspace(0.0, np.pi, 20))[:, None]  # Out of reach and back.
    p = T[:, :3, 3]
    goal = Goal.pose(T) if kind == "pose" else Goal.position(p)
    goal = Goal.pointing(p, T[0, :3, 2], [0, 0, 1.0]) if kind == "pointing" else goal
    path = arm.follow(T[:2])
    # All are said to be missed, by joint values that are nowhere near: so they are asked about together, too.
    far = np.tile(arm.ik(T[30]).q, (60, 1))
    told = judge_missed(
        replace(path, q=far, problem=Problem(arm.chain, goal)), np.ones(60, dtype=np.bool_), 1
    )
    reached = arm.ik(goal).success
    assert reached[~moved].all() or kind == "pointing"
    assert not (told.out_of_reach & reached).any()
    assert told.in_reach[reached].all()
    assert told.out_of_reach.sum() > 5


@pytest.mark.slow
def test_a_long_stretch_is_proved_out_of_reach_by_few_questions(monkeypatch: pytest.MonkeyPatch) -> None:
    arm, asked = kinseek.load("ur5e"), [0]
    T = np.array([kinseek.pose([x, -0.1, 0.1], rpy=[np.pi, 0, 0]) for x in np.linspace(-0.3, 0.3, 200)])

    def counted(function: Any) -> Any:
        def call(*given: Any, **named: Any) -> Any:
            asked[0] += named.get("budget", 1) > 0 and given[1:] != (0,)
            return function(*given, **named)

        return call

    monkeypatch.setattr("kinseek.paths.missed.excluded", counted(excluded))
    monkeypatch.setattr("kinseek.paths.missed.prove", counted(prove))
    path = arm.follow(T, prove=True)
    assert path.proof is not None
    assert path.proof.out_of_reach.sum() > 50
    assert (path.proof.out_of_reach == ~path.reached).all()
    assert asked[0] < 0.5 * path.proof.out_of_reach.sum()


@pytest.mark.slow
def test_what_the_budget_leaves_open_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    arm = kinseek.load("ur5e")
    T = np.array([kinseek.pose([x, -0.1, 0.1], rpy=[np.pi, 0, 0]) for x in np.linspace(-0.4, 0.4, 30)])
    whole = arm.follow(T, prove=True).proof
    assert whole is not None
    assert whole.out_of_reach.any()
    assert not whole.undecided.any()
    monkeypatch.setattr(missed, "MOST", 300)
    monkeypatch.setattr(missed, "EACH", 0)
    path = arm.follow(T, prove=True)
    assert path.proof is not None
    assert path.proof.undecided.any()
    assert ((path.proof.undecided | path.proof.out_of_reach) == whole.out_of_reach).all()
    assert any(
        "not proved out of reach: the work that a path may spend on proofs did not suffice; arm.prove does"
        in each
        for each in path.why
    )
    T[:, :3, 3] += [0.0, 0.0, 2.0]


def test_missed_poses_of_goals_with_ranges_are_proved_out_of_reach() -> None:
    arm = kinseek.load("ur5e")
    T = np.array([kinseek.pose([x, -0.1, 0.4], rpy=[np.pi, 0, 0]) for x in np.linspace(0.5, 1.5, 11)])
    for ranges in ({"free": "rz", "cone": 0.3}, {"box": {"rx": (-0.2, 0.2), "rz": (-0.3, 0.1)}}):
        path = arm.follow(Goal.pose(T, **ranges), prove=True)
        assert path.proof is not None
        assert path.proof.out_of_reach.any()
        assert not (path.proof.out_of_reach & path.reached).any()
        assert path.proof.out_of_reach[-3:].all()


def around(arm: kinseek.Arm, radius: float, count: int, height: float = 0.5) -> Array:
    """Once around the base, the tool pointing outward."""
    poses = []
    for angle in np.linspace(0.0, TURN, count):
        out = np.array([np.cos(angle), np.sin(angle), 0.0])
        T = np.eye(4)
        T[:3, :3] = np.stack([np.cross([0.0, 0.0, 1.0], out), [0.0, 0.0, 1.0], out], axis=1)
        T[:3, 3] = radius * out + [0.0, 0.0, height]
        poses.append(T)
    return np.array(poses)


def test_that_no_motion_leads_on_is_proved() -> None:
    arm = kinseek.load("irb120")
    T = around(arm, 0.55, 160)
    path = arm.follow(T, prove=True)
    assert len(path.breaks)
    assert path.impossible
    assert all(0 <= i < j < len(T) for i, j in path.impossible)
    assert all(a[1] <= b[0] for a, b in zip(path.impossible[:-1], path.impossible[1:], strict=True))
    # So many breaks are needed, and there are as many.
    assert len(path.impossible) <= len(path.breaks)
    for i, j in path.impossible:
        assert ((path.breaks >= i) & (path.breaks < j)).any()
        assert f"proved: no continuous motion inside the limits leads from pose {i} to pose {j}" in path.why
    # With limits that are wide enough the same is possible, and nothing is proved.
    wide = kinseek.Arm(arm.chain.limited(arm.lower - 4.0, arm.upper + 4.0, arm.chain.kinds))
    assert arm.follow(T[:40], prove=True).impossible == ()
    assert wide.follow(T, prove=True).impossible == ()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["puma560", "irb120", "kr6r900"])
def test_nothing_is_impossible_that_was_done(name: str) -> None:
    arm = kinseek.load(name)
    for seed in range(2):
        q = made(arm, 400, seed, 0.9)[200:300]
        T = arm.fk(q)
        state = proved(arm, q, T)
        for i, j in Search(Problem(arm.chain, Goal.pose(T))).intervals(0, 99):
            assert (state[i:j] != INSIDE).any()
        done = np.flatnonzero(state == INSIDE)
        first = int(done[0])
        last = first + int(np.argmin(np.append(state[first:] == INSIDE, False)))
        assert Search(Problem(arm.chain, Goal.pose(T))).intervals(first, last) == []


def test_closed_paths_and_full_turns() -> None:
    arm = kinseek.load("jaco2_6")
    q = arm.ik(kinseek.pose([0.35, 0.1, 0.4], rpy=[np.pi / 2, 0.3, 0.2])).require().q
    angle = np.linspace(0, TURN, 120, endpoint=False)
    T = np.repeat(arm.fk(q)[None], 120, axis=0)
    T[:, 0, 3] += 0.06 * (np.cos(angle) - 1)
    T[:, 2, 3] += 0.06 * np.sin(angle)
    path = arm.follow(T, closed=True, prove=True).require()
    assert path.proved.shape == (120,)
    assert path.certified
    # The tool turns once about itself: the last joint of this arm has no limits.
    spun = np.repeat(arm.fk(q)[None], 100, axis=0)
    for k in range(100):
        spun[k, :3, :3] = spun[0, :3, :3] @ rotations(np.array([[0.0, 0.0, TURN * k / 100]]))[0]
    path = arm.follow(spun, closed=True, prove=True).require()
    assert path.certified


def test_free_axes_and_directions_are_proved() -> None:
    arm = kinseek.load("ur5e")
    T = np.array([kinseek.pose([0.4, y, 0.3], rpy=[np.pi, 0, 0]) for y in np.linspace(-0.2, 0.2, 60)])
    assert arm.follow(Goal.pose(T, free="rz"), prove=True).require().certified
    assert arm.follow(Goal.pose(T, free=["z", "rz"]), prove=True).require().proved.mean() > 0.9
    pointing = Goal.pointing(T[:, :3, 3], [0, 0, -1.0], [0, 0, 1.0])
    assert arm.follow(pointing, prove=True).require().certified
    assert arm.follow(Goal.position(T[:, :3, 3]), prove=True).require().certified


def test_bad_steps_prove_nothing() -> None:
    arm = kinseek.load("puma560")
    q = calm(arm, 300, 4)[:20]
    T = arm.fk(q)
    assert (proved(arm, q, T) == INSIDE).all()
    assert arm.follow(T[:1], prove=True).certified
    still = np.repeat(q[:1], 3, axis=0)
    assert (proved(arm, still, np.repeat(T[:1], 3, axis=0)) == INSIDE).all()
    # Joint values that do not reach the poses.
    off = q + 1e-3
    state = prove_rows(
        Problem(arm.chain, Goal.pose(T)), off, np.arange(19), keep=True, rims=np.full(20, 1e-6)
    )
    assert (state.state == UNPROVED).all()
    # Half a turn between two poses tells no way.
    turned = T[:2].copy()
    turned[1, :3, :3] = turned[0, :3, :3] @ rotations(np.array([[0.0, 0.0, np.pi]]))[0]
    rows = np.array([q[0], arm.ik(turned[1]).q])
    assert proved(arm, rows, turned)[0] == UNPROVED
