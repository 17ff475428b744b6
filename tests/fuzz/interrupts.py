"""Ctrl-C at any moment: every public call under SIGINT, in a process of its own.

Each call is made again and again until the signal comes, which is at a random moment; then it has to end with
KeyboardInterrupt within half a second, and the same call has to give the same bits as before.

Run: python -m tests.fuzz.interrupts [--moments 20] [--seed 0] [name of a call …]
"""

from __future__ import annotations

import argparse
import copy
import faulthandler
import json
import os
import pickle
import random
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import kinseek
from kinseek import Goal

MOST = 0.5
"""[s] within which Ctrl-C has to be heard."""

Array = NDArray[np.float64]
Call = Callable[[], Array]
"""What is made again and again; gives the joint values that it finds."""

Q = np.array([0.3, -1.0, 1.0, -0.5, 0.4, 0.2])


def _poses(arm: kinseek.Arm, count: int, far: int = 25) -> Array:
    """Poses to reach, every so many of them out of reach, (count, 4, 4)."""
    rng = np.random.default_rng(3)
    T = arm.fk(rng.uniform(arm.lower, arm.upper, (count, arm.dof)))
    T[::far, :3, 3] *= 2.0
    return T


def _ik(name: str = "ur5e", count: int = 0, far: bool = False, **options: Any) -> Callable[[], Call]:
    def make() -> Call:
        arm = kinseek.load(name)
        T = _poses(arm, count) if count else _poses(arm, 2)[0 if far else 1]
        return lambda: np.asarray(arm.ik(T, **options).q)

    return make


def _goal(goal: Callable[[Array], Goal], **options: Any) -> Callable[[], Call]:
    def make() -> Call:
        arm = kinseek.load("ur5e")
        asked = goal(_poses(arm, 2)[1])
        return lambda: np.asarray(arm.ik(asked, **options).q)

    return make


def _branches(name: str = "ur5e", count: int = 0, **options: Any) -> Callable[[], Call]:
    def make() -> Call:
        arm = kinseek.load(name)
        T = _poses(arm, count) if count else _poses(arm, 2)[1]
        return lambda: np.asarray(arm.branches(T, **options).q)

    return make


def _follow(name: str = "irb120", count: int = 2000) -> Callable[[], Call]:
    def make() -> Call:
        arm = kinseek.load(name)
        s = np.linspace(0.0, 1.0, count)[:, None]
        middle = (arm.lower + arm.upper) / 2
        T = arm.fk(middle + 0.3 * (arm.upper - middle) * np.sin(2 * np.pi * s + np.arange(arm.dof)))
        return lambda: np.asarray(arm.follow(T).q)

    return make


def _follow_proved() -> Call:
    """Poses that take long to be proved out of reach."""
    arm = kinseek.load("panda")
    T = np.array([kinseek.pose([x, 0.2, x], rpy=[0.3, 1.2, 0.5]) for x in np.linspace(0.6, 0.65, 6)])

    def call() -> NDArray[np.float64]:
        proof = arm.follow(T, prove=True).proof
        assert proof is not None
        return proof.out_of_reach.astype(float)

    return call


def _prove(**options: Any) -> Callable[[], Call]:
    def make() -> Call:
        arm = kinseek.load("ur5e")
        T = arm.fk(Q)
        T[:3, 3] *= 1.6
        return lambda: np.append(arm.prove(T, **options).q, arm.prove(T, **options).lower_bound)

    return make


def _function(**options: Any) -> Callable[[], Call]:
    def make() -> Call:
        arm = kinseek.load("ur5e")
        box = kinseek.Arm.from_fk(arm.fk, arm.lower, arm.upper)
        T = arm.fk(Q)
        return lambda: np.asarray(box.ik(T, **options).q)

    return make


def _first_call() -> Call:
    """Load an arm anew, and build its atlas."""
    T = kinseek.load("ur5e").fk(Q)
    return lambda: np.asarray(kinseek.load("ur5e").ik(T).q)


def _first_branches() -> Call:
    T = kinseek.load("ur5e").fk(Q)
    return lambda: np.asarray(kinseek.load("ur5e").branches(T).q)


def _first_samples() -> Call:
    arm = kinseek.load("ur5e")
    T = arm.fk(Q)

    def call() -> Array:
        return np.asarray(kinseek.Arm.from_fk(arm.fk, arm.lower, arm.upper).ik(T).q)

    return call


def _pickled() -> Call:
    arm = kinseek.load("ur5e")
    T = arm.fk(Q)
    return lambda: np.asarray(pickle.loads(pickle.dumps(arm)).ik(T).q)


def _copied() -> Call:
    arm = kinseek.load("ur5e")
    T = arm.fk(Q)
    return lambda: np.asarray(copy.deepcopy(arm).ik(T).q)


def _beside_a_thread() -> Call:
    """A thread that never ends makes the same call."""
    arm = kinseek.load("ur5e")
    T = _poses(arm, 50)

    def go_on() -> None:
        while True:
            arm.ik(T, threads=1)

    threading.Thread(target=go_on, daemon=True).start()
    return lambda: np.asarray(arm.ik(T, threads=2).q)


def _fk() -> Call:
    arm = kinseek.load("ur5e")
    q = np.random.default_rng(4).uniform(arm.lower, arm.upper, (100_000, arm.dof))
    return lambda: arm.fk(q)


def _planned() -> Call:
    """A motion around a board, with its proof and its shortcuts."""
    arm = kinseek.load("panda")
    scene = kinseek.Scene.of(arm, capsules=0.02)
    scene.add_box("board", size=(0.02, 0.6, 0.6), pose=kinseek.pose([0.45, 0.0, 0.3]))
    q = 0.5 * np.random.default_rng(1).uniform(arm.lower, arm.upper, (100, arm.dof))
    begin, *_, end = q[scene.free(q)]
    return lambda: np.asarray(scene.plan(begin, end).q)


def _timed(**options: Any) -> Callable[[], Call]:
    def make() -> Call:
        arm = kinseek.load("ur5e")
        q = Q + 0.3 * np.sin(np.linspace(0.0, 6.0, 100))[:, None]
        path = arm.follow(arm.fk(q), start=q[0])
        return lambda: path.timed(velocity=1.0, acceleration=3.0, **options).sample(0.01).q

    return make


def _fastest() -> Call:
    arm = kinseek.load("panda")
    T = arm.fk(np.linspace(0.4 * arm.lower + 0.6 * arm.upper, 0.5 * (arm.lower + arm.upper), 40))
    return lambda: np.asarray(arm.follow(T, cost="time", acceleration=5.0).q)


CALLS: dict[str, Callable[[], Call]] = {
    "fk": _fk,
    "ik": _ik(),
    "ik of a pose out of reach": _ik(far=True),
    "ik near": _ik(near=Q),
    "ik of a batch": _ik(count=3000),
    "ik of a batch on two threads": _ik(count=3000, threads=2),
    "ik of a batch on one thread": _ik(count=3000, threads=1),
    "ik of a batch near": _ik(count=300, near=Q),
    "ik of a position": _goal(lambda T: Goal.position(T[:3, 3])),
    "ik with ranges": _goal(lambda T: Goal.pose(T, free=("x", "rz"))),
    "ik preferred": _ik("panda", prefer="dexterity"),
    "Atlas": _ik(count=300, solver=kinseek.Atlas(threads=1)),
    "BruteForce": _ik(solver=kinseek.BruteForce(16)),
    "BruteForce, long": _ik("panda", solver=kinseek.BruteForce(20)),
    "DivideAndConquer": _ik(solver=kinseek.DivideAndConquer(breadth=3)),
    "DivideAndConquer of a batch": _ik(count=200, solver=kinseek.DivideAndConquer()),
    "DivideAndConquer, long": _ik(solver=kinseek.DivideAndConquer(breadth=12)),
    "SeparateChains": _ik(solver=kinseek.SeparateChains(breadth=2)),
    "SeparateChains of chains": _ik("elbow6", count=20, solver=kinseek.SeparateChains()),
    "BlindSearch": _ik("panda", solver=kinseek.BlindSearch()),
    "CoordinateDescent": _ik("panda", solver=kinseek.CoordinateDescent()),
    "Polished": _ik(solver=kinseek.Polished()),
    "branches": _branches(),
    "branches of a batch": _branches(count=200),
    "branches of an arm with joints to spare": _branches("panda"),
    "branches of a batch with joints to spare": _branches("panda", count=100),
    "branches proved": _branches(prove=True),
    "follow": _follow(),
    "follow with joints to spare": _follow("panda", 300),
    "follow proved": _follow_proved,
    "follow in windows": _follow(count=20_000),
    "follow in the least time": _fastest,
    "timed": _timed(),
    "timed with jerk": _timed(jerk=30.0),
    "prove": _prove(),
    "prove with a gap": _prove(gap=0.3, budget=20_000),
    "ik proved": _ik(far=True, prove=True),
    "ik of a function": _function(),
    "DivideAndConquer of a function": _function(solver=kinseek.DivideAndConquer(divisions=2)),
    "load and first ik": _first_call,
    "load and first branches": _first_branches,
    "first ik of a function": _first_samples,
    "pickle": _pickled,
    "copy": _copied,
    "ik beside a thread": _beside_a_thread,
}
if find_spec("coal") is not None:
    CALLS["plan in a scene"] = _planned
LONG = {"BruteForce, long", "DivideAndConquer, long"}
"""Searches of minutes: what they give is not waited for."""


def interrupted(call: Call, delay: float) -> float | None:
    """Make a call until SIGINT comes; return how long it took to be heard [s], None if it was not within five seconds."""
    sent: list[float] = []

    def send() -> None:
        time.sleep(delay)
        sent.append(time.perf_counter())
        os.kill(os.getpid(), signal.SIGINT)

    sender = threading.Thread(target=send)
    try:
        sender.start()
        end = time.perf_counter() + delay + 5.0
        while time.perf_counter() < end:
            call()
    except KeyboardInterrupt:
        heard = time.perf_counter()
        sender.join()
        return heard - sent[0]
    return None


def inside(name: str, moments: int, seed: int) -> dict[str, Any]:
    """Interrupt one call at random moments; say how often it was heard, how late at worst, and what was wrong."""
    faulthandler.enable()
    signal.signal(signal.SIGINT, signal.default_int_handler)  # A job in the background begins without it.
    rng, call = random.Random(f"{seed} {name}"), CALLS[name]()
    before, took = None, 0.5
    if name not in LONG:
        call()
        began = time.perf_counter()
        before = call()
        took = time.perf_counter() - began
    heard: list[float] = []
    wrong: list[str] = []
    for moment in range(moments):
        late = interrupted(call, rng.uniform(0.0, max(2.0 * took, 0.05)))
        if late is None:
            wrong.append(f"moment {moment}: not heard")
        else:
            heard.append(late)
        if before is not None and not np.array_equal(call(), before):
            wrong.append(f"moment {moment}: another answer than before")
    worst = max(heard, default=0.0)
    if worst > MOST:
        wrong.append(f"heard after {worst:.2f} s")
    return {"heard": len(heard), "worst": worst, "takes": took, "wrong": wrong}


def outside(names: list[str], moments: int, seed: int) -> dict[str, dict[str, Any]]:
    """Interrupt calls in a process of their own; a crash is what was wrong with the call that it came in."""
    reports: dict[str, dict[str, Any]] = {}
    left = list(names)
    while left:
        command = [
            sys.executable,
            __file__,
            "--inside",
            "--moments",
            str(moments),
            "--seed",
            str(seed),
            *left,
        ]
        path = os.pathsep.join(
            filter(None, [str(Path(kinseek.__file__).parents[1]), os.environ.get("PYTHONPATH")])
        )
        ended = subprocess.run(
            command, capture_output=True, text=True, check=False, env={**os.environ, "PYTHONPATH": path}
        )
        for line in ended.stdout.splitlines():
            name, report = json.loads(line)
            reports[name] = report
            left.remove(name)
        if ended.returncode and left:
            error = ended.stderr.strip()[-2000:]
            reports[left.pop(0)] = {"wrong": [f"ended with {ended.returncode}: {error}"]}
    return reports


def main() -> int:
    """Interrupt the calls named, or all; say what was wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", metavar="call")
    parser.add_argument("--moments", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--inside", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args()
    names, failures = given.names or list(CALLS), 0
    for name in names:
        if given.inside:
            print(json.dumps([name, inside(name, given.moments, given.seed)]), flush=True)
            continue
        report = outside([name], given.moments, given.seed)[name]
        said = (
            "; ".join(report["wrong"]) or f"heard {report['heard']} times, {report['worst']:.3f} s at worst"
        )
        print(f"{name}: {said}", flush=True)
        failures += bool(report["wrong"])
    return int(failures > 0)


if __name__ == "__main__":
    sys.exit(main())
