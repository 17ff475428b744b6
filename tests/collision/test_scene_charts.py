"""What is known of parts by the joints between them alone: charts, and how far an arm reaches."""

from __future__ import annotations

import threading

import numpy as np
import pytest

import kinseek
from kinseek import Scene
from kinseek.collision import Sphere
from kinseek.collision.charts import _inside
from kinseek.collision.engine import Engine
from kinseek.collision.share import share
from kinseek.kernels.collision.model import ROWS

pytest.importorskip("coal")


def column(engine: Engine, name: str) -> np.ndarray:
    """An array of the cell that the first pass goes by."""
    return np.asarray(engine.broad._arrays[ROWS.first[name]])


def engine_of(arm: kinseek.Arm) -> Engine:
    """The arm, with capsules along its links, and some boxes."""
    scene = Scene.of(arm, capsules=0.05)

    rng = np.random.default_rng(2)
    for number in range(8):
        place = rng.uniform(-0.9, 0.9, 3)
        scene.add_box(
            f"box{number}", rng.uniform(0.05, 0.3, 3), kinseek.pose(place, rpy=rng.uniform(-3, 3, 3))
        )
    return scene._engine


@pytest.mark.slow
def test_what_charts_tell_is_so() -> None:
    links = [[0.4, 0, 0, 0.2], [0.3, 0, 0, 0.4], [0.35, 0.1, 0, 0.1], [0.3, 0, 0, 0.8]]
    arm = kinseek.Arm.from_dh(links, [-3] * 4, [3] * 4)
    engine = engine_of(arm)
    meetings, pairs, charts = (column(engine, each) for each in ("meeting", "pair", "chart_of"))
    cells, axes, chain = column(engine, "chart"), column(engine, "chart_axes"), arm.chain
    below = column(engine, "below")
    assert (charts >= 0).any()
    q = np.concatenate([arm.sample(150, seed=3), np.random.default_rng(4).uniform(-9, 9, (150, arm.dof))])
    distances = np.array([[near.distance for near in engine.near(one)] for one in q])
    turns = (chain.multiplier * q[:, chain.leader] + chain.offset) / (2 * np.pi)
    told = {"free": 0, "touch": 0, "open": 0, "closer": 0}
    for m in np.flatnonzero(charts >= 0):
        j, k, rows, columns, first = axes[charts[m]]
        row, column_ = (
            ((turns[:, joint] % 1) * count).astype(int) for joint, count in ((j, rows), (k, columns))
        )
        known, coarse = cells[first + row * columns + column_], cells[first + row * columns + column_] == 0
        for i in np.flatnonzero(coarse):
            at, level, turn = first + row[i] * columns + column_[i], 1, turns[i] % 1
            while below[at]:
                level *= 4 if j == k else 2
                one, other = (int(turn[joint] * count * level) for joint, count in ((j, rows), (k, columns)))
                at = first + below[at] + (other % 4 if j == k else one % 2 * 2 + other % 2)
            known[i] = cells[at]
            told["closer"] += known[i] != 0
        nearest = distances[:, pairs[meetings[m, 2] : meetings[m, 3], 2]].min(axis=1)
        assert (nearest[known > 0] >= known[known > 0] - 2e-6).all()
        assert (nearest[known < 0] <= 1e-6).all()
        told["free"] += int((known > 0).sum())
        told["touch"] += int((known < 0).sum())
        told["open"] += int((known[:150] == 0).sum())
    assert min(told["free"], told["touch"]) > 20
    assert told["closer"] > 0
    assert told["open"] < 0.3 * 150 * (charts >= 0).sum()


@pytest.mark.slow
def test_what_is_out_of_reach_is_never_near() -> None:
    arm = kinseek.load("panda")
    engine = engine_of(arm)
    meetings, pairs, apart = (column(engine, each) for each in ("meeting", "pair", "apart"))
    inside = column(engine, "apart_inside")
    assert (np.diff(inside) >= 0).all()
    assert (inside >= apart).all()
    far = np.flatnonzero(apart > 0)
    assert 5 < len(far) < len(apart)
    q = np.random.default_rng(5).uniform(-4, 4, (200, arm.dof))
    distances = np.array([[near.distance for near in engine.near(one)] for one in q])
    for m in far:
        assert distances[:, pairs[meetings[m, 2] : meetings[m, 3], 2]].min() >= apart[m] - 2e-6


@pytest.mark.slow
def test_what_limits_keep_apart_is_never_near_inside_them() -> None:
    links = [[0.4, 0, 0, 0.2], [0.3, 0, 0, 0.4], [0.35, 0.1, 0, 0.1], [0.3, 0, 0, 0.8]]
    arm = kinseek.Arm.from_dh(links, [-0.5] * 4, [0.5] * 4)
    engine = engine_of(arm)
    meetings, pairs, apart = (column(engine, each) for each in ("meeting", "pair", "apart"))
    inside = column(engine, "apart_inside")
    only_inside = np.flatnonzero((inside > 0) & (apart <= 0))
    assert len(only_inside)
    q = np.concatenate([arm.sample(200, seed=6), np.random.default_rng(7).uniform(-4, 4, (200, arm.dof))])
    near = np.array([[near.distance for near in engine.near(one)] for one in q])
    for m in only_inside:
        nearest = near[:, pairs[meetings[m, 2] : meetings[m, 3], 2]].min(axis=1)
        assert nearest[:200].min() >= inside[m] - 2e-6
    # Beyond the limits nothing is taken for granted.
    assert (engine.free(q, 0.0) == engine.exactly_free(q, 0.0)).all()


def test_a_chart_that_is_divided_to_the_end_has_all_its_cells() -> None:
    """The undecided cells of the last level have no children; behind the chart are other charts, or foreign memory."""
    arm = kinseek.Arm.from_dh([[0.4, 0, 0, 0]] * 3, [-3] * 3, [3] * 3)
    scene = Scene.of(arm, capsules=0.02, samples=100)
    scene.attach("held", Sphere(0.036), "link2", kinseek.pose([-0.158, 0.181, 0.049]))
    engine = scene._engine
    axes, below = column(engine, "chart_axes"), column(engine, "below")
    ends = [*axes[1:, 4], len(below)]
    assert len(axes) == 3
    for first, end in zip(axes[:, 4], ends, strict=True):
        assert below[first:end].max() + 4 <= end - first
    q = np.linspace(2.4, 2.6, 2001)[:, None] * [0, 1, 0] + [0, 0, 1]
    apart = engine.exactly_free(q, 0.0)
    assert 0 < apart.sum() < len(q)
    np.testing.assert_array_equal(scene.free(q), apart)
    assert not scene.free_motion(q[:-1], q[1:])[~(apart[:-1] & apart[1:])].any()


def test_parts_of_a_turn_that_are_inside_limits() -> None:
    assert _inside(8, (-0.1, 0.9)).tolist() == [0, 1, 7]
    assert _inside(8, (3.0, 3.3)).tolist() == [3, 4]
    assert _inside(4, (-np.inf, np.inf)).tolist() == [0, 1, 2, 3]
    assert _inside(4, (-3.0, 3.0)).tolist() == [0, 1, 2, 3]


@pytest.mark.parametrize("threads", [1, 3])
def test_every_piece_is_done_once_and_what_fails_is_raised(threads: int) -> None:
    done: list[int] = []
    share(done.append, range(50), threads)
    assert sorted(done) == list(range(50))

    def fail(piece: int) -> None:
        if piece == 7:
            raise ValueError("seven")

    before = threading.active_count()
    with pytest.raises(ValueError, match="seven"):
        share(fail, range(50), threads)
    assert threading.active_count() == before
