"""Long paths: in windows they come out as they do at once, and take little memory."""

from __future__ import annotations

import tracemalloc
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import kinseek
from kinseek.paths import between, runs, windows
from test_paths import made

Array = NDArray[np.float64]


@pytest.fixture(name="short_windows")
def _short_windows(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Windows of 64 poses, for every path."""

    def switch() -> None:
        monkeypatch.setattr(windows, "LONG", 1)
        monkeypatch.setattr(windows, "WINDOW", 64)

    return switch


def pieces(arm: kinseek.Arm) -> Array:
    """A way with a jump in it, a stretch out of reach, and ends of windows at all kinds of places."""
    T = np.concatenate([arm.fk(made(arm, 250, 1)), arm.fk(made(arm, 230, 7))])
    T[300:310, 0, 3] += 5.0
    return np.asarray(T)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "asked"),
    [
        ("irb120", {}),
        ("ur5e", {}),
        ("ur5e", {"velocity": [1.0, 2.0, 3.0, 1.0, 2.0, 3.0]}),
        ("jaco2_6", {"weights": [1, 2, 3, 1, 2, 3], "max_step": 0.2}),
        ("irb120", {"times": np.cumsum(np.linspace(0.01, 0.05, 480))}),
        ("irb120", {"max_step": 1.5}),
    ],
)
def test_windows_give_the_same(name: str, asked: dict[str, Any], short_windows: Any) -> None:
    arm = kinseek.load(name)
    T = pieces(arm)
    whole = arm.follow(T, **asked)
    assert len(whole.breaks) >= 1
    assert whole.missed == ((300, 309),)
    short_windows()
    path = arm.follow(T, **asked)
    assert len(path.breaks) == len(whole.breaks)
    assert (path.reached == whole.reached).all()
    assert len(path.why) == len(whole.why)
    assert path.length == pytest.approx(whole.length, rel=1e-3)
    if (path.breaks == whole.breaks).all():
        # Next to a singularity two solutions that are a thousandth apart take the same time, and either may be chosen.
        near = np.linalg.svd(arm.jacobian(whole.q), compute_uv=False).min(axis=1) < 1e-3
        other = np.abs(path.q - whole.q).max(axis=1) * near
        assert (other < 0.01).all()
        assert path.length == pytest.approx(whole.length, abs=1e-7 + 2 * arm.dof * float(other.sum()))


@pytest.mark.parametrize("name", ["irb120", "ur5e", "gen3"])
def test_an_unbroken_way_is_the_same_to_rounding(name: str, short_windows: Any) -> None:
    arm = kinseek.load(name)
    arm = (
        arm.with_locked({"joint_3": 0.3}) if name == "gen3" else arm
    )  # Three of its joints turn without end.
    q = made(arm, 300, 5)
    whole = arm.follow(arm.fk(q), start=q[0]).require()
    short_windows()
    path = arm.follow(arm.fk(q), start=q[0], end=whole.q[-1] if name != "gen3" else None, threads=2).require()
    assert np.abs(path.q - whole.q).max() < 1e-8
    assert (path.q[0] == q[0]).all()


def test_what_stands_in_the_way_is_said_of_windows_as_well(short_windows: Any) -> None:
    two = kinseek.Arm.from_dh([(0.3, 0, 0, 0), (0.2, 0, 0, 0)], [-1, -2], [1, 2], name="two links")
    angles = np.linspace(-1.3, 1.3, 500)
    places = 0.4 * np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
    whole = two.follow(kinseek.Goal.position(places))
    short_windows()
    path = two.follow(kinseek.Goal.position(places))
    assert len(path.breaks) == len(whole.breaks) == 1
    assert "reaches its upper limit 1" in path.why[0] or "reaches its lower limit -1" in path.why[0]


@pytest.mark.slow
def test_joints_to_spare_are_followed_in_windows_too(monkeypatch: pytest.MonkeyPatch) -> None:
    arm = kinseek.load("panda")
    q = made(arm, 300, 5)
    T = arm.fk(q)
    monkeypatch.setattr(runs, "SAMPLED", 120)
    monkeypatch.setattr(runs, "LOOK_AHEAD", 40)
    for asked in ({}, {"start": q[0]}, {"end": q[-1]}, {"start": q[0], "end": q[-1]}):
        path = arm.follow(T, **asked)
        assert np.abs(arm.fk(path.q) - T).max() < 2e-6
        assert len(path.breaks) <= ("end" in asked and "start" in asked)
        assert path.largest_step.max() < 3 * np.abs(np.diff(q, axis=0)).max()
        assert (path.q[0] == q[0]).all() or "start" not in asked
        assert (path.q[-1] == q[-1]).all() or "end" not in asked


@pytest.mark.slow
def test_windows_keep_the_turns_of_endless_joints(monkeypatch: pytest.MonkeyPatch) -> None:
    arm = kinseek.load("gen3")
    q = made(arm, 300, 5, 1, 0.3)
    q[:, 0] += np.linspace(0.0, 15.0, 300)
    monkeypatch.setattr(runs, "SAMPLED", 120)
    monkeypatch.setattr(runs, "LOOK_AHEAD", 40)
    path = arm.follow(arm.fk(q), start=q[0]).require()
    # Another branch may stand elsewhere, but no turn is taken back where one window ends and the next begins.
    assert np.abs(np.diff(path.q[:, 0])).max() <= 0.3
    assert path.q[-1, 0] - q[0, 0] > 2 * np.pi


@pytest.mark.slow
def test_a_pose_takes_little_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(windows, "LONG", 4096)
    arm = kinseek.load("irb120")
    arm.follow(arm.fk(made(arm, 40, 0)))
    most = []
    for count in (5_000, 10_000):
        T = arm.fk(made(arm, count, 0))
        tracemalloc.start()
        try:
            path = arm.follow(T, threads=1)
            most.append(tracemalloc.get_traced_memory()[1])
            assert path.success
            tracemalloc.reset_peak()
            held = tracemalloc.get_traced_memory()[0]
            assert path.deviation.distance < 0.01
            assert tracemalloc.get_traced_memory()[1] - held < 2500 * between.AT_ONCE
        finally:
            tracemalloc.stop()
    assert (most[1] - most[0]) / 5_000 < 800  # bytes a pose; at once it takes 1,700.
