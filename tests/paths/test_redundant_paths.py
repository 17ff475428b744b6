"""`Arm.follow` where joints are to spare: made paths that once broke, ranges as joints, a cost, threads."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from numpy.typing import NDArray

import kinseek
from benchmarks.paths.curves import curve
from kinseek import Goal
from kinseek.kernels.paths.viterbi import STRAIGHT, BranchEnds, Layer, Sideways, Turns, viterbi_step
from kinseek.paths.plan import Place, Ways, between_rows
from places import SHARED

Array = NDArray[np.float64]


def made(arm: kinseek.Arm, seed: int, count: int = 1000) -> Array:
    """A curve of joint values: four harmonics over 98 % of every range, (count, n)."""
    return curve(arm, count, seed, 0.98, harmonics=4)


def line(count: int) -> Array:
    places = np.linspace([0.4, -0.2, 0.4], [0.4, 0.2, 0.4], count)
    return np.array([kinseek.pose(row, rpy=[np.pi, 0, 0]) for row in places])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "seed"),
    [
        ("gen3", 0),  # The elbow passes straight: few answers are left there, and branches lead through.
        ("gen3", 7),  # Beside a straight elbow stand answers of the other bend that no self-motion leads to.
        ("iiwa14", 5),
        ("iiwa14", 9),
        (
            "iiwa14_srs",
            1,
        ),  # Two shoulder axes in line: what lies between rows of the plan cannot be filled in.
        ("iiwa14_srs", 9),
        ("xarm7", 0),
        ("rizon4", 9),
        ("ur10e_rail", 3),  # A slide, and joints with two turns each.
        ("ur10e_rail", 5),
    ],
)
def test_made_paths_past_singularities_are_followed(name: str, seed: int) -> None:
    file = SHARED / f"{name}.urdf"
    if name not in kinseek.robots.catalog_names() and not file.exists():
        pytest.skip(f"{name}.urdf is not here")
    arm = kinseek.load(str(file) if file.exists() else name)
    q = made(arm, seed)
    T, largest = arm.fk(q), np.abs(np.diff(q, axis=0)).max()
    path = arm.follow(T, max_step=1.5 * largest).require()
    turned = np.array([kind == "continuous" for kind in arm.chain.kinds])
    assert ((path.q >= arm.lower) & (path.q <= arm.upper) | turned).all()
    assert np.abs(arm.fk(path.q) - T).max() < 2e-6


@pytest.mark.slow
def test_a_dense_path_is_followed_with_small_steps() -> None:
    """From one pose to the next no joint may move as far as sampled solutions lie apart."""
    arm = kinseek.load("gen3")
    q = made(arm, 1, 4000)
    largest = float(np.abs(np.diff(q, axis=0)).max())
    assert largest < 0.015
    path = arm.follow(arm.fk(q), max_step=1.5 * largest)
    assert not len(path.breaks)
    assert path.success
    assert np.abs(np.diff(path.q, axis=0)).max() <= 1.5 * largest * (1 + 1e-9)


@pytest.mark.slow
def test_the_joints_go_no_farther_than_those_that_made_the_path() -> None:
    arm = kinseek.load("panda")
    q = made(arm, 1, 200)
    path = arm.follow(arm.fk(q)).require()
    assert path.length < 1.02 * np.linalg.norm(np.diff(q, axis=0), axis=1).sum()


@pytest.mark.slow
def test_a_cost_draws_the_path() -> None:
    arm = kinseek.load("panda")
    T = line(60)
    plain = arm.follow(T).require()
    middle = (arm.lower + arm.upper) / 2
    for j, sign in ((1, 1.0), (1, -1.0), (6, 1.0)):

        def cost(q: Array, j: int = j, sign: float = sign) -> Array:
            return np.asarray(sign * q[:, j])

        drawn = arm.follow(T, cost=cost).require()
        assert sign * drawn.q[:, j].mean() < sign * plain.q[:, j].mean() - 0.1
    near = arm.follow(T, cost=lambda q: ((q - middle) ** 2).sum(axis=1)).require()
    assert ((near.q - middle) ** 2).sum() < ((plain.q - middle) ** 2).sum()


def test_functions_see_the_joints_of_the_arm_alone() -> None:
    arm = kinseek.load("ur5e")
    seen: set[int] = set()

    def valid(q: Array) -> bool:
        seen.add(len(q))
        return bool(q[2] > 0)

    def cost(q: Array) -> Array:
        seen.add(q.shape[1])
        return np.asarray(q[:, 1])

    path = arm.follow(Goal.pose(line(30), free="rz"), valid=valid, cost=cost).require()
    assert seen == {6}
    assert (path.q[:, 2] > 0).all()


@pytest.mark.slow
def test_same_bits_whatever_the_threads() -> None:
    arm = kinseek.load("panda")
    T = arm.fk(made(arm, 3, 400))
    alone = arm.follow(T, max_step=0.13, threads=1)
    assert (arm.follow(T, max_step=0.13, threads=4).q == alone.q).all()


def test_few_rows_are_filled_in_without_a_corner() -> None:
    rows, x = np.array([0, 3, 4, 9]), np.arange(10.0)[:, None]
    straight = between_rows(rows, 2 * x[rows] + 1)
    assert np.abs(straight - (2 * x + 1)).max() < 1e-14
    curved = between_rows(rows, np.sin(x[rows] / 3))
    assert np.abs(curved[rows] - np.sin(x[rows] / 3)).max() < 1e-15
    assert np.abs(curved - np.sin(x / 3)).max() < 0.15
    assert np.abs(between_rows(np.array([0, 4]), x[[0, 4]]) - x[:5]).max() < 1e-15


def linked(poses: list[Array], ahead: float, longest: float, keep: bool) -> tuple[list[Place], int, float]:
    """The best way through answers of two joints that lead straight on by so much."""
    ways, before = Ways(1), None
    one, none, no_node = np.ones(2), np.zeros((0, 2)), np.zeros(0, dtype=np.int64)
    for q in poses:
        layer = Layer(
            q, np.ones_like(q), np.zeros(len(q), np.int64), np.zeros(len(q)), np.zeros(len(q), np.int64)
        )
        past = Layer(none, none, no_node, np.zeros(0), no_node) if before is None else before
        led = past.q + ahead
        moved = np.full_like(led, ahead)
        ends = BranchEnds(led, np.ones_like(led), np.full(len(led), 2 * ahead**2), moved, moved.copy())
        turns = Turns(-100 * one, 100 * one, np.full(2, STRAIGHT), np.ones(2, dtype=np.int64))
        viterbi_step(past, ends, layer, turns, Sideways(longest * one, 10 * one, one, 1.0), np.zeros(0))
        ways.add(layer)
        before = layer
    assert before is not None
    node = int(np.lexsort((before.sums, before.fault))[0])
    if keep:
        assert all(len(kept.nodes) < len(q) for kept, q in zip(ways.layers[:12], poses, strict=False))
    return ways.to(node), int(before.fault[node]), float(before.sums[node])


@pytest.mark.parametrize("seed", range(4))
def test_layers_are_linked_by_what_the_whole_step_costs(seed: int) -> None:
    rng = np.random.default_rng(seed)
    poses = [rng.uniform(0.0, 1.0, (4, 2)) + 0.1 * k for k in range(80)]
    places, breaks, cost = linked(poses, 0.1, 1e3, keep=True)
    sums = np.zeros(4)
    for before, after in itertools.pairwise(poses):
        sums = (sums[:, None] + ((after[None] - before[:, None]) ** 2).sum(axis=2)).min(axis=0)
    assert breaks == 0
    assert np.isclose(cost, sums.min(), rtol=1e-9)
    rows = np.array([place.q for place in places])
    assert np.isclose((np.diff(rows, axis=0) ** 2).sum(), cost, rtol=1e-9)
    # Far answers are reached by a break alone.
    poses[7] = poses[7] + 50.0
    places, breaks, _ = linked(poses, 0.1, 1e3, keep=False)
    assert breaks == 2
    assert [k for k, place in enumerate(places) if not place.joined] == [0, 7, 8]
