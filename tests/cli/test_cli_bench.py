"""``kinseek bench``: what it says is measured and judged, and peers are given the right arm."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

import kinseek
from kinseek.cli import bench
from kinseek.cli.peers import PEERS, Peer, Unsuitable
from kinseek.cli.program import run

ARMS = ("ur5e", "scara4", "gen3")


@pytest.mark.slow
@pytest.mark.parametrize("peer", PEERS, ids=lambda peer: peer.module)
@pytest.mark.parametrize("name", ARMS)
def test_peers_solve_the_arm_that_is_meant(peer: Peer, name: str) -> None:
    if not peer.installed:
        pytest.skip(f"{peer.package} is not installed")
    arm = kinseek.load(name)
    row = bench._peer(peer, arm, arm.fk(arm.sample(10)), 5.0)
    if peer.module == "eaik" and name != "ur5e":
        assert row.why_not == "it needs six revolute joints"
        return
    assert row.why_not == ""
    assert row.good is not None
    assert row.good >= (0.3 if peer.module == "ikpy" else 0.9)  # ikpy begins once, in the middle.


def peer_of(solve: Any) -> Peer:
    return Peer("none", "numpy", "no such package", lambda arm: solve)


def test_wrong_answers_count_for_nothing() -> None:
    arm = kinseek.load("ur5e")
    q = arm.sample(20)
    targets = arm.fk(q)
    turned = q.copy()
    turned[:, 0] += 4 * np.pi  # The pose is right, the limits are not.
    goal_spec = iter(range(1000))

    def wrong(T: Any) -> Any:
        k = int(np.abs(targets - T).sum(axis=(1, 2)).argmin())
        return (None, turned[k], q[k] + 1e-5, np.full(6, np.nan), q[k])[next(goal_spec) % 5]

    row = bench._peer(peer_of(wrong), arm, targets, 5.0)
    assert (row.good, row.poses) == (0.2, 20)


def test_a_peer_that_fails_is_one_line() -> None:
    def broken(T: Any) -> Any:
        raise ZeroDivisionError("by nothing")

    def unsuitable(arm: Any) -> Any:
        raise Unsuitable("too few joints")

    arm = kinseek.load("planar2")
    targets = arm.fk(arm.sample(3))
    assert bench._peer(peer_of(broken), arm, targets, 1.0).why_not == "failed: ZeroDivisionError: by nothing"
    row = bench._peer(Peer("none", "numpy", "no such package", unsuitable), arm, targets, 1.0)
    assert row.why_not == "too few joints"


def test_the_rows(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    missing = Peer("missing", "no_such_module", "no such package", lambda arm: lambda T: None)
    arm = kinseek.load("ur5e")
    rows = {row.what: row for row in bench.measure(arm, 30, 1.0, [missing])}
    assert len(rows) == 6
    assert all(row.who == "kinseek" for row in rows.values())
    assert [row.good for row in rows.values()] == [1.0, 1.0, 1.0, 1.0, None, 1.0]
    assert all(row.median is not None and row.median > 0 for row in rows.values())
    monkeypatch.setattr("kinseek.cli.bench.PEERS", ())
    assert run(["bench", "planar2", "--poses", "5", "--seconds", "0.01", "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["arm"] == "planar2"
    assert facts["rows"][0]["poses"] <= 5


def test_time_is_kept() -> None:
    times, answers = bench._timed(lambda k: sum(range(20_000)), 1_000_000, 0.05)
    assert 1 <= len(times) == len(answers) < 100_000
