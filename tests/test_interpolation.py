"""Dense poses from key poses: as dense as requested, through the key poses, on smooth corners and on arcs."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

import kinseek
from kinseek import InvalidGoal, InvalidProblem, interpolation

Array = NDArray[np.float64]

SEEDS = st.integers(0, 2**31)
STEPS, TURNS = st.floats(0.004, 2.0), st.floats(0.02, 4.0)


def at(points: Any, **rotation: Any) -> Array:
    return kinseek.pose(np.asarray(points, dtype=float), **rotation)


def random_poses(seed: int, count: int) -> Array:
    rng = np.random.default_rng(seed)
    # Half turns between two of them have a probability of zero, and are an error.
    return kinseek.pose(
        rng.normal(scale=0.3, size=(count, 3)), rotation=Rotation.random(count, random_state=seed)
    )


def distances(poses: Array) -> Array:
    return np.asarray(np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1))


def turns(poses: Array) -> Array:
    R = Rotation.from_matrix(poses[:, :3, :3])
    return np.asarray((R[:-1].inv() * R[1:]).magnitude())


def assert_dense(poses: Array, step: float, turn: float) -> None:
    assert distances(poses).max(initial=0.0) <= step * (1 + 1e-11) + 1e-15
    assert turns(poses).max(initial=0.0) <= turn * (1 + 1e-11) + 1e-14
    np.testing.assert_allclose(
        poses[:, :3, :3] @ np.swapaxes(poses[:, :3, :3], -1, -2),
        np.tile(np.eye(3), (len(poses), 1, 1)),
        atol=3e-15,
    )
    assert (poses[:, 3] == [0.0, 0.0, 0.0, 1.0]).all()


@given(seed=SEEDS, count=st.integers(1, 6), step=STEPS, turn=TURNS)
def test_poses_are_as_dense_as_requested_and_go_through_the_key_poses(
    seed: int, count: int, step: float, turn: float
) -> None:
    keys = random_poses(seed, count)
    poses = kinseek.interpolate(keys, step=step, turn=turn)
    assert_dense(poses, step, turn)
    places = [int(np.flatnonzero((poses == key).all(axis=(1, 2)))[0]) for key in keys]
    assert places[0] == 0
    assert places[-1] == len(poses) - 1
    for i, (a, b) in enumerate(itertools.pairwise(places)):
        assert a < b
        # No more poses than needed: the larger of both numbers of steps.
        needed = max(
            np.linalg.norm(keys[i + 1, :3, 3] - keys[i, :3, 3]) / step, turns(keys[i : i + 2])[0] / turn
        )
        assert b - a == max(math.ceil(needed - 1e-9), 1) or abs(needed - round(needed)) < 1e-8
        # A straight line and one turn, evenly: as SciPy's Slerp.
        share = np.linspace(0.0, 1.0, b - a + 1)
        slerp = Slerp([0.0, 1.0], Rotation.from_matrix(keys[i : i + 2, :3, :3]))(share)
        np.testing.assert_allclose(poses[a : b + 1, :3, :3], slerp.as_matrix(), atol=1e-13)
        line = keys[i, :3, 3] + share[:, None] * (keys[i + 1, :3, 3] - keys[i, :3, 3])
        np.testing.assert_allclose(poses[a : b + 1, :3, 3], line, atol=1e-15)


def test_a_turn_in_place_is_that_of_pinocchio() -> None:
    # SE3.Interpolate moves on a screw: without translation, and for pure translations, it is the same motion.
    pinocchio = pytest.importorskip("pinocchio")
    a, b = random_poses(4, 2)
    b[:3, 3] = a[:3, 3]
    poses = kinseek.interpolate([a, b], step=0.01, turn=0.01)
    for share, T in zip(np.linspace(0.0, 1.0, len(poses)), poses, strict=True):
        expected = pinocchio.SE3.Interpolate(pinocchio.SE3(a), pinocchio.SE3(b), share).homogeneous
        np.testing.assert_allclose(T, expected, atol=1e-13)


@pytest.mark.parametrize("off", [1e-12, 1e-8, 1e-3, math.pi - 1e-3, math.pi - 2e-6])
def test_angles_near_zero_and_near_a_half_turn(off: float) -> None:
    axis = np.array([0.48, -0.6, 0.64])
    keys = at([0, 0, 0], rotvec=[[0.0, 0.0, 0.0], off * axis])
    poses = kinseek.interpolate(keys, step=0.1, turn=off / 7)
    expected = at([0, 0, 0], rotvec=np.linspace(0.0, off, 8)[:, None] * axis)
    np.testing.assert_allclose(poses, expected, atol=1e-14)


@given(seed=SEEDS, count=st.integers(3, 6), share=st.floats(0.01, 1.0), step=STEPS, turn=TURNS)
def test_a_blended_path_is_dense_near_the_lines_and_begins_and_ends_at_the_key_poses(
    seed: int, count: int, share: float, step: float, turn: float
) -> None:
    keys = random_poses(seed, count)
    blend = share * distances(keys).min() / 2
    poses = kinseek.interpolate(keys, step=step, turn=turn, blend=blend)
    assert_dense(poses, step, turn)
    np.testing.assert_array_equal(poses[[0, -1]], keys[[0, -1]])
    # A path is inside the triangles of its corners: it leaves the lines by at most half of the blend.
    along = np.diff(keys[:, :3, 3], axis=0)
    away = poses[:, None, :3, 3] - keys[None, :-1, :3, 3]
    part = np.clip((away * along).sum(-1) / (along**2).sum(-1), 0.0, 1.0)
    assert np.linalg.norm(away - part[..., None] * along, axis=-1).min(axis=1).max() <= 0.5 * blend + 1e-12
    # The same way back: nothing depends on the direction.
    back = kinseek.interpolate(keys[::-1], step=step, turn=turn, blend=blend)
    np.testing.assert_allclose(back[::-1], poses, atol=1e-12)


@given(seed=SEEDS, share=st.floats(0.05, 1.0))
def test_the_direction_of_a_blended_path_is_continuous(seed: int, share: float) -> None:
    keys = random_poses(seed, 4)
    blend = share * distances(keys).min() / 2

    def greatest_bend(radius: float, step: float) -> float:
        chords = np.diff(kinseek.interpolate(keys, step=step, turn=math.inf, blend=radius)[:, :3, 3], axis=0)
        cosine = (chords[1:] * chords[:-1]).sum(axis=1)
        return float(np.arctan2(np.linalg.norm(np.cross(chords[1:], chords[:-1]), axis=1), cosine).max())

    assert greatest_bend(0.0, blend / 100) == pytest.approx(corners(keys).max(), abs=1e-6)
    # The tangent of a parabola turns fastest in its middle: by 2 tan(corner / 2) per unit of t. There are 2 `steps` in it.
    for steps in (100, 1000):
        assert greatest_bend(blend, blend / steps) <= math.tan(corners(keys).max() / 2) / steps + 1e-6


def corners(keys: Array) -> Array:
    along = np.diff(keys[:, :3, 3], axis=0)
    along /= np.linalg.norm(along, axis=1)[:, None]
    return np.asarray(np.arccos(np.clip((along[1:] * along[:-1]).sum(axis=1), -1.0, 1.0)))


def test_the_orientation_of_a_blend_turns_without_a_jump_of_its_velocity() -> None:
    keys = at([[0, 0, 0], [1, 0, 0], [1, 1, 0]], rotvec=[[0, 0, 0], [1, 0, 0], [1, 1, 0]])

    def greatest_change(blend: float, step: float) -> float:
        poses = kinseek.interpolate(keys, step=step, turn=math.inf, blend=blend)
        R = Rotation.from_matrix(poses[:, :3, :3])
        return float(np.linalg.norm(np.diff((R[1:] * R[:-1].inv()).as_rotvec(), axis=0), axis=1).max() / step)

    # Change of the angular velocity per metre: with a blend it goes to zero with the step, else it does not.
    assert greatest_change(0.0, 1 / 500) == pytest.approx(greatest_change(0.0, 1 / 2000), rel=0.01)
    assert greatest_change(0.25, 1 / 2000) < 0.3 * greatest_change(0.25, 1 / 500) < 0.02


def test_blends_that_meet_leave_no_line() -> None:
    keys = at([[0, 0, 0], [1, 0, 0], [1, 1, 0], [2, 1, 0]])
    poses = kinseek.interpolate(keys, step=0.01, turn=1.0, blend=0.5)
    assert_dense(poses, 0.01, 1.0)
    np.testing.assert_allclose(np.abs(poses[:, :3, 3] - [1.0, 0.5, 0.0]).max(axis=1).min(), 0.0, atol=1e-15)
    # The middle of a parabola is halfway between the corner and the middle of its chord.
    np.testing.assert_allclose(
        np.abs(poses[:, :3, 3] - [0.875, 0.125, 0.0]).max(axis=1).min(), 0.0, atol=1e-12
    )


def test_what_needs_no_pose_in_between() -> None:
    T = random_poses(1, 3)
    np.testing.assert_array_equal(kinseek.interpolate([T[0]], step=1, turn=1), T[:1])
    np.testing.assert_array_equal(kinseek.interpolate(T[[0, 0, 0]], step=1e-9, turn=1e-9), T[:1])
    np.testing.assert_array_equal(kinseek.interpolate(T[[0, 1, 1, 2]], step=math.inf, turn=math.inf), T)
    np.testing.assert_array_equal(kinseek.interpolate(T[:2], step=math.inf, turn=math.inf, blend=0.2), T[:2])
    with_twins = kinseek.interpolate(T[[0, 0, 1, 1, 2]], step=0.01, turn=0.1, blend=0.01)
    np.testing.assert_array_equal(with_twins, kinseek.interpolate(T, step=0.01, turn=0.1, blend=0.01))
    # Rounding adds no step: 0.3 / 0.1 is a little more than 3.
    assert len(kinseek.interpolate(at([[0, 0, 0], [0.1 * 3, 0, 0]]), step=0.1, turn=1)) == 4


def test_key_poses_may_be_anything_that_is_a_pose() -> None:
    message = SimpleNamespace(
        position=SimpleNamespace(x=1, y=2, z=3), orientation=SimpleNamespace(x=0, y=0, z=0, w=1)
    )
    poses = kinseek.interpolate([np.eye(4), message], step=1.0, turn=1.0)
    assert poses.shape == (5, 4, 4)
    np.testing.assert_array_equal(poses[-1], at([1, 2, 3]))


ROW = at([[0, 0, 0], [0.1, 0, 0], [0.1, 0.1, 0.0]])
NOTHING: Any = None
WRONG: dict[str, tuple[Callable[[], Any], type[Exception], str]] = {
    "no pose": (
        lambda: kinseek.interpolate(np.zeros((0, 4, 4)), step=1, turn=1),
        InvalidGoal,
        r"at least one pose, got \(0, 4",
    ),
    "one matrix": (
        lambda: kinseek.interpolate(np.eye(4), step=1, turn=1),
        InvalidGoal,
        r"shape \(N, 4, 4\).* got \(4, 4\)",
    ),
    "NaN": (lambda: kinseek.interpolate(ROW * np.nan, step=1, turn=1), InvalidGoal, "NaN"),
    "step 0": (
        lambda: kinseek.interpolate(ROW, step=0, turn=1),
        InvalidProblem,
        r"step must be a number above 0 \[m\], got 0",
    ),
    "step NaN": (
        lambda: kinseek.interpolate(ROW, step=math.nan, turn=1),
        InvalidProblem,
        "step must be a number above 0",
    ),
    "turn below 0": (
        lambda: kinseek.interpolate(ROW, step=1, turn=-1),
        InvalidProblem,
        r"turn .* above 0 \[rad\], got -1",
    ),
    "turn None": (
        lambda: kinseek.interpolate(ROW, step=1, turn=NOTHING),
        InvalidProblem,
        "turn must be a number",
    ),
    "step too long": (
        lambda: kinseek.interpolate(ROW, step=10**400, turn=1),
        InvalidProblem,
        "step must be a number",
    ),
    "too many": (
        lambda: kinseek.interpolate(ROW, step=1e-7, turn=1),
        InvalidProblem,
        "make 2,000,001 poses, expected at most 1,000,000",
    ),
    "very many": (lambda: kinseek.interpolate(ROW, step=5e-324, turn=1), InvalidProblem, "make inf poses"),
    "blend below 0": (
        lambda: kinseek.interpolate(ROW, step=1, turn=1, blend=-1),
        InvalidProblem,
        "blend must be a number from 0",
    ),
    "blend NaN": (
        lambda: kinseek.interpolate(ROW, step=1, turn=1, blend=math.nan),
        InvalidProblem,
        "blend must be a number",
    ),
    "blend too large": (
        lambda: kinseek.interpolate(
            ROW[[0, 0, 1, 2]] * [[[1, 1, 1, 1], [1, 1, 1, 0.9], [1, 1, 1, 1], [1, 1, 1, 1]]],
            step=1,
            turn=1,
            blend=0.05,
        ),
        InvalidProblem,
        r"at most half of the distance .* got 0.05 m: key poses 2 and 3 are 0.09 m apart",
    ),
    "blend in place": (
        lambda: kinseek.interpolate(
            [np.eye(4), at([0, 0, 0], rpy=[1, 0, 0]), ROW[1]], step=1, turn=1, blend=0.01
        ),
        InvalidProblem,
        "key poses 0 and 1 are 0 m apart",
    ),
    "back": (
        lambda: kinseek.interpolate(ROW[[0, 1, 0]], step=1, turn=1, blend=0.01),
        InvalidProblem,
        "turns back at key pose 1",
    ),
    "half turn": (
        lambda: kinseek.interpolate([np.eye(4), np.diag([1.0, -1.0, -1.0, 1.0])], step=1, turn=1),
        InvalidGoal,
        "between key poses 0 and 1 must be less than a half turn, got 3.14159",
    ),
    "arc on a line": (
        lambda: kinseek.arc(ROW[0], ROW[1], at([0.3, 1e-8, 0]), step=1, turn=1),
        InvalidGoal,
        r"not on one line, got \[0, 0, 0\], \[0.1, 0, 0\]",
    ),
    "arc of two points": (
        lambda: kinseek.arc(ROW[0], ROW[1], ROW[0], step=1, turn=1),
        InvalidGoal,
        "not on one line",
    ),
    "arc of one point": (
        lambda: kinseek.arc(ROW[0], ROW[0], ROW[0], step=1, turn=1),
        InvalidGoal,
        "not on one line",
    ),
    "arc of no pose": (lambda: kinseek.arc(ROW[0], "there", ROW[0], step=1, turn=1), InvalidGoal, "^via: "),
    "arc, half turn": (
        lambda: kinseek.arc(ROW[0], ROW[1] @ np.diag([1.0, -1.0, -1.0, 1.0]), ROW[2], step=1, turn=1),
        InvalidGoal,
        "between start and via must be less than a half turn",
    ),
    "arc, turn": (lambda: kinseek.arc(*ROW, step=1, turn=0), InvalidProblem, "turn must be a number above 0"),
    "arc, too many": (
        lambda: kinseek.arc(*ROW, step=1e-9, turn=1),
        InvalidProblem,
        "expected at most 1,000,000",
    ),
}


@pytest.mark.parametrize(("call", "error", "said"), WRONG.values(), ids=WRONG)
def test_what_makes_no_path_is_refused(call: Callable[[], Any], error: type[Exception], said: str) -> None:
    with pytest.raises(error, match=said):
        call()


@given(seed=SEEDS, step=STEPS, turn=TURNS)
def test_an_arc_is_on_the_circle_and_as_dense_as_requested(seed: int, step: float, turn: float) -> None:
    rng = np.random.default_rng(seed)
    radius, whole = rng.uniform(0.05, 1.0), rng.uniform(0.1, 6.2)
    part = rng.uniform(0.05, 0.95) * whole
    frame = random_poses(seed, 1)[0]
    angles = np.array([0.0, part, whole])
    local = radius * np.stack([np.cos(angles), np.sin(angles), np.zeros(3)], axis=1)
    keys = random_poses(seed + 1, 3)
    keys[:, :3, 3] = local @ frame[:3, :3].T + frame[:3, 3]
    poses = kinseek.arc(*keys, step=step, turn=turn)
    assert_dense(poses, step, turn)
    np.testing.assert_array_equal(poses[[0, -1]], keys[[0, 2]])
    (middle,) = np.flatnonzero((poses == keys[1]).all(axis=(1, 2)))
    seen = (poses[:, :3, 3] - frame[:3, 3]) @ frame[:3, :3]
    np.testing.assert_allclose(np.hypot(seen[:, 0], seen[:, 1]), radius, atol=1e-9)
    np.testing.assert_allclose(seen[:, 2], 0.0, atol=1e-9)
    for a, b, i in ((0, int(middle), 0), (int(middle), len(poses) - 1, 1)):
        share = np.linspace(0.0, 1.0, b - a + 1)
        slerp = Slerp([0.0, 1.0], Rotation.from_matrix(keys[i : i + 2, :3, :3]))(share)
        np.testing.assert_allclose(poses[a : b + 1, :3, :3], slerp.as_matrix(), atol=1e-13)
        expected = angles[i] + share * (angles[i + 1] - angles[i])
        on_circle = radius * np.stack([np.cos(expected), np.sin(expected)], axis=1)
        np.testing.assert_allclose(seen[a : b + 1, :2], on_circle, atol=1e-9)


def test_a_flat_arc_is_nearly_a_line() -> None:
    points = at([[0, 0, 0], [0.5, 2e-6, 0], [1, 0, 0]])
    poses = kinseek.arc(*points, step=0.001, turn=1.0)
    x = poses[:, 0, 3]
    np.testing.assert_allclose(poses[:, 1, 3], 8e-6 * x * (1 - x), atol=1e-15)
    assert_dense(poses, 0.001, 1.0)


def test_long_paths_are_made_in_pieces(monkeypatch: pytest.MonkeyPatch) -> None:
    poses = kinseek.interpolate(ROW, step=1e-5, turn=1.0, blend=0.01)
    assert len(poses) > 2**14
    assert_dense(poses, 1e-5, 1.0)
    monkeypatch.setattr(interpolation, "in_chunks", lambda work, *rows: work(*rows))
    np.testing.assert_array_equal(poses, kinseek.interpolate(ROW, step=1e-5, turn=1.0, blend=0.01))


def test_follow_takes_the_poses() -> None:
    arm = kinseek.load("ur5e")
    keys = at([[0.4, -0.2, 0.3], [0.4, 0.2, 0.3], [0.5, 0.2, 0.3]], rpy=[math.pi, 0, 0])
    path = arm.follow(kinseek.interpolate(keys, step=0.005, turn=0.02, blend=0.03))
    assert path.success
    assert np.abs(path.steps).max() < 0.1
