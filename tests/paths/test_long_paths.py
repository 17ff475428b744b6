"""Long paths: those of redundant arms are planned in windows, and all take little memory."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

import kinseek
from kinseek.paths import between, runs
from test_paths import made


@pytest.mark.slow
def test_redundant_arms_are_followed_in_windows(monkeypatch: pytest.MonkeyPatch) -> None:
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
def test_a_pose_takes_little_memory() -> None:
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
    assert (most[1] - most[0]) / 5_000 < 2_000  # bytes a pose
