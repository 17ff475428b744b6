"""Proofs end when their time is up or somebody interrupts, and come to the same whatever pieces they run in."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import kinseek
from kinseek import Goal, Problem, Verdict
from kinseek.kernels.entry import ENTRIES
from kinseek.proof.branch_and_bound import prove
from kinseek.proof.root_isolation import isolate, prove_complete
from kinseek.solution import Solution, conclude
from kinseek.support.deadline import Deadline

pytestmark = pytest.mark.slow

ENDLESS_BUDGET = 10**12


def hard() -> Problem:
    """A pose of the Panda with no tolerance at all: no answer is exact, and boxes along its self-motion never end."""
    arm = kinseek.load("panda")
    T = arm.fk((arm.lower + arm.upper) / 2 + 0.1)
    return Problem(arm.chain, Goal.pose(T, position_tolerance=0.0, orientation_tolerance=0.0))


def far() -> Problem:
    """Out of the Panda's reach, as is shown soon; by how much, to nine digits, is never."""
    arm = kinseek.load("panda")
    T = arm.fk((arm.lower + arm.upper) / 2 + 0.1)
    T[:3, 3] = [0.6, 0.4, 0.8]
    return Problem(arm.chain, Goal.pose(T))


def answer(problem: Problem) -> Solution:
    """A poor one, so that nobody asks the atlas."""
    return conclude(problem, problem.chain.lower[None], np.zeros((1, 3), dtype=np.int64))


def proof_of(problem: Problem, **options: Any) -> kinseek.Certificate:
    return prove(problem, solution=answer(problem), **options)


def wide() -> Problem:
    """A pose of an arm of six joints with wide tolerances: its answers have no neighbourhoods, its boxes do not end."""
    arm = kinseek.load("jaco2_6")
    T = arm.fk((arm.lower + arm.upper) / 2 + 0.3)
    return Problem(arm.chain, Goal.pose(T, position_tolerance=0.02, orientation_tolerance=0.05))


def same(one: kinseek.Certificate, other: kinseek.Certificate) -> bool:
    figures = [
        (each.verdict, each.lower_bound, each.upper_bound, each.boxes, each.largest_box, each.q.tobytes())
        for each in (one, other)
    ]
    return figures[0] == figures[1]


@pytest.mark.parametrize("gap", [None, 0.02])
@pytest.mark.parametrize("name", ["planar2", "ur5e", "panda"])
def test_pieces_change_nothing(name: str, gap: float | None, monkeypatch: pytest.MonkeyPatch) -> None:
    """The kernels come back after any number of boxes and go on as if they had not."""
    arm, rng = kinseek.load(name), np.random.default_rng(3)
    for q in rng.uniform(arm.lower, arm.upper, (3, arm.dof)):
        T = arm.fk(q)
        T[:3, 3] *= 1.3
        problem = Problem(arm.chain, Goal.pose(T))
        whole = proof_of(problem, gap=gap, budget=30_000)
        for chunk in (1, 37 * 49):
            monkeypatch.setattr("kinseek.proof.boxes.CHUNK", chunk)
            budget = 30_000 if chunk > 1 else 500
            reference = whole if chunk > 1 else None
            pieces = proof_of(problem, gap=gap, budget=budget)
            monkeypatch.undo()
            assert same(pieces, reference or proof_of(problem, gap=gap, budget=budget))
            assert not pieces.out_of_time


@pytest.mark.parametrize("chunk", [1, 1000])
def test_pieces_change_no_isolation(chunk: int, monkeypatch: pytest.MonkeyPatch) -> None:
    arm, rng = kinseek.load("ur5e"), np.random.default_rng(4)
    for T in arm.fk(rng.uniform(arm.lower, arm.upper, (2, 6))):
        problem = Problem(arm.chain, Goal.pose(T))
        whole = isolate(problem, budget=3000)
        monkeypatch.setattr("kinseek.proof.boxes.CHUNK", chunk)
        pieces = isolate(problem, budget=3000)
        monkeypatch.undo()
        assert (pieces.complete, pieces.boxes, pieces.undecided) == (
            whole.complete,
            whole.boxes,
            whole.undecided,
        )
        np.testing.assert_array_equal(pieces.q, whole.q)
        np.testing.assert_array_equal(pieces.distance, whole.distance)
        np.testing.assert_array_equal(pieces.given, whole.given)


def test_rooms_too_small_are_enlarged(monkeypatch: pytest.MonkeyPatch) -> None:
    """A stack without room for one more box comes back, is made larger, and goes on."""
    problem = far()
    whole, found = proof_of(problem, gap=0.01, budget=3000), isolate(wide(), budget=3000)

    def cramped(boxes: NDArray[np.float64]) -> NDArray[np.float64]:
        more = np.empty((len(boxes) + 1, boxes.shape[1]))
        more[: len(boxes)] = boxes
        return more

    monkeypatch.setattr("kinseek.proof.boxes.roomy", cramped)
    assert same(proof_of(problem, gap=0.01, budget=3000), whole)
    again = isolate(wide(), budget=3000)
    assert (again.boxes, again.undecided) == (found.boxes, found.undecided)


@pytest.mark.parametrize(
    ("problem", "gap", "verdict"), [(hard(), None, Verdict.UNDECIDED), (far(), 1e-9, Verdict.UNREACHABLE)]
)
@pytest.mark.parametrize("threads", [1, None])
def test_a_proof_ends_when_its_time_is_up(
    problem: Problem, gap: float | None, verdict: Verdict, threads: int | None
) -> None:
    proof_of(problem, gap=0.5, budget=10)
    known = proof_of(problem, gap=0.3, budget=20_000)
    begin = time.monotonic()
    proof = proof_of(problem, gap=gap, budget=ENDLESS_BUDGET, deadline=Deadline(0.4), threads=threads)
    took = time.monotonic() - begin
    assert took < 3.0  # Half a second and less where nothing else runs.
    assert proof.out_of_time
    assert "time was up" in str(proof)
    assert proof.verdict is verdict
    assert 0.0 <= proof.lower_bound <= known.upper_bound
    assert proof.upper_bound >= known.lower_bound
    assert proof.boxes > 0
    chain = problem.chain
    assert ((chain.lower <= proof.q) & (proof.q <= chain.upper)).all()
    judged = conclude(problem, proof.q[None], np.zeros((1, 3), dtype=np.int64))
    assert proof.upper_bound == pytest.approx(judged.weighted_error, abs=1e-14)


def test_no_time_at_all_gives_valid_bounds() -> None:
    for gap in (None, 0.1):
        proof = proof_of(hard(), gap=gap, budget=ENDLESS_BUDGET, deadline=Deadline(1e-9))
        assert proof.out_of_time
        assert proof.lower_bound <= proof.upper_bound
        assert proof.verdict is Verdict.UNDECIDED


def test_time_to_spare_changes_nothing() -> None:
    arm = kinseek.load("ur5e")
    T = arm.fk(np.full(6, 0.5))
    T[:3, 3] *= 1.4
    problem = Problem(arm.chain, Goal.pose(T))
    assert same(proof_of(problem, gap=0.1), proof_of(problem, gap=0.1, deadline=Deadline(1000.0)))
    found = proof_of(replace(problem, goal=Goal.pose(arm.fk(np.full(6, 0.5)))), deadline=Deadline(1e-9))
    assert found.verdict is Verdict.REACHABLE
    assert not found.out_of_time


def test_an_isolation_ends_when_its_time_is_up() -> None:
    isolate(wide(), budget=10)
    begin = time.monotonic()
    ended = isolate(wide(), budget=ENDLESS_BUDGET, deadline=Deadline(0.3))
    assert time.monotonic() - begin < 3.0
    assert ended.out_of_time
    assert not ended.complete
    assert ended.undecided > 0
    q, complete = prove_complete(wide(), ended.q, budget=ENDLESS_BUDGET, deadline=Deadline(0.1))
    assert not complete
    assert len(q) >= len(ended.q)


INTERRUPTED = """
import os, signal, sys, time
signal.signal(signal.SIGALRM, signal.default_int_handler)
from kinseek.proof.root_isolation import isolate
from kinseek.proof.boxes import enclosed
from test_proof_time import ENDLESS_BUDGET, far, hard, proof_of, wide

what, moments = sys.argv[1], [float(each) for each in sys.argv[2:]]
never, outside, many = hard(), far(), wide()
calls = {
    "exclude": lambda budget: proof_of(never, budget=budget),
    "enclose": lambda budget: enclosed(outside, outside.chain.lower, 1e-9, budget, threads=1)[1:6],
    "isolate": lambda budget: isolate(many, budget=budget),
    "small": lambda budget: [proof_of(outside, gap=0.5, budget=20) for _ in range(budget // 10)],
}
call = calls[what]
call(100)
before = str(call(100))
for moment in moments:
    signal.setitimer(signal.ITIMER_REAL, moment)
    begin = time.monotonic()
    try:
        call(ENDLESS_BUDGET)
    except KeyboardInterrupt:
        took = time.monotonic() - begin - moment
        assert took < 0.5 * max(1.0, 2.0 * os.getloadavg()[0] / os.cpu_count()), took
    else:
        raise AssertionError("it was not interrupted")
    assert str(call(100)) == before
print("well")
"""


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="no timers that interrupt")
@pytest.mark.parametrize("what", ["exclude", "enclose", "isolate", "small"])
def test_interrupts_at_any_moment(what: str) -> None:
    """Five of them: KeyboardInterrupt at once, no crash, and the same answers as before."""
    moments = np.random.default_rng(5).uniform(0.001, 0.3, 5)
    run = subprocess.run(
        [sys.executable, "-c", INTERRUPTED, what, *map(str, moments)],
        env={
            **os.environ,
            "PYTHONPATH": os.pathsep.join([os.path.dirname(__file__), *filter(None, sys.path)]),
        },
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert run.stdout.strip() == "well", (run.returncode, run.stderr)


def test_kernels_hand_back_numbers() -> None:
    """What is built by calling a Python class, as a bundle is, may be interrupted: then there is nothing to hand back."""
    assert {leaf.shape for entry in ENTRIES.values() for leaf in entry.returns} == {()}
