"""Benchmark of kinseek and of the installed peers on this machine.

Poses are those of random postures inside the limits. Every call is timed from Python, one pose after the other, up to a time
limit. Results are checked afterwards by kinseek's plain forward kinematics.
"""

from __future__ import annotations

import os
import platform
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinseek.arm import Arm
from kinseek.proof.certificate import Verdict

from .peers import PEERS, Peer, Unsuitable

Array = NDArray[np.float64]

STRICT = 1e-6
"""Largest errors of a solution that counts as reached, [m] and [rad]."""
_WARM = 20
"""Number of calls before timing starts."""
_SLACK = 1e-9
"""Tolerance for rounding of a solution's joint values outside the limits."""


@dataclass(frozen=True)
class Row:
    """A line of the table."""

    what: str
    who: str
    median: float | None = None
    """Median time per pose [µs]."""
    slow: float | None = None
    """99th percentile of the times [µs]; None for a batch."""
    good: float | None = None
    """Fraction of the poses that was reached, or proved to be out of reach."""
    poses: int = 0
    why_not: str = ""
    """Why nothing was measured."""


def measure(arm: Arm, poses: int, seconds: float, peers: Sequence[Peer] = PEERS) -> Iterator[Row]:
    """Measure one line after the other.

    Args:
        arm: An arm with axes.
        poses: Number of poses.
        seconds: Time after which no further call is made for the same line [s].
        peers: Other libraries; those that are not installed are left out.
    """
    q = arm.sample(poses, seed=1)
    targets, near = (
        arm.fk(q),
        np.clip(q + np.random.default_rng(2).normal(0.0, 0.05, q.shape), arm.lower, arm.upper),
    )
    ours = "kinseek"
    yield _each("one pose", ours, lambda k: arm.ik(targets[k]).q, arm, targets, seconds)
    for peer in peers:
        if peer.installed:
            yield _peer(peer, arm, targets, seconds)
    yield _each("near a start", ours, lambda k: arm.ik(targets[k], near=near[k]).q, arm, targets, seconds)
    yield _batch(arm, targets, seconds)
    yield _branches(arm, targets, seconds)
    far = _out_of_reach(arm, targets)
    times, _ = _timed(lambda k: arm.ik(far[k]), poses, seconds)
    yield Row("unreachable", ours, *_figures(times), None, len(times))
    times, proofs = _timed(lambda k: arm.prove(far[k]).verdict, poses, seconds)
    proved = np.mean([verdict is Verdict.UNREACHABLE for verdict in proofs])
    yield Row("unreachable, proof", ours, *_figures(times), float(proved), len(times))


def reached(arm: Arm, q: Array, targets: Array) -> NDArray[np.bool_]:
    """Return which joint values, (k, n), reach their poses, (k, 4, 4), inside the limits; NaN reaches nothing."""
    found = np.asarray(np.isfinite(q).all(axis=1))
    T = arm.fk(np.where(found.reshape(-1, 1), q, arm.lower))
    away = np.linalg.norm(T[:, :3, 3] - targets[:, :3, 3], axis=1)
    R = np.swapaxes(T[:, :3, :3], 1, 2) @ targets[:, :3, :3]
    sine = np.stack([R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]], axis=1)
    angle = np.arctan2(np.linalg.norm(sine, axis=1), np.trace(R, axis1=1, axis2=2) - 1.0)
    limited = np.array([kind != "continuous" for kind in arm.kinds])
    inside = (((q >= arm.lower - _SLACK) & (q <= arm.upper + _SLACK)) | ~limited).all(axis=1)
    return np.asarray(found & inside & (away <= STRICT) & (angle <= STRICT))


def machine() -> str:
    """Return processor, number of usable cores, system and versions in one line."""
    name, info = platform.processor() or platform.machine(), Path("/proc/cpuinfo")
    if info.is_file():
        lines = info.read_text(encoding="utf-8").splitlines()
        name = next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), name)
    load = f"load {os.getloadavg()[0]:.1f}, " if hasattr(os, "getloadavg") else ""
    return f"{name}, {_cores()} cores, {load}{platform.system()}, Python {platform.python_version()}, NumPy {np.__version__}"


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _timed(call: Callable[[int], Any], count: int, seconds: float) -> tuple[Array, list[Any]]:
    """Return the times of calls [µs] and their results, for up to `seconds`."""
    for k in range(min(_WARM, count)):
        call(k)
    times, solutions, clock = [], [], time.perf_counter_ns
    end = clock() + int(seconds * 1e9)
    for k in range(count):
        began = clock()
        solutions.append(call(k))
        now = clock()
        times.append((now - began) / 1e3)
        if now > end:
            break
    return np.array(times), solutions


def _figures(times: Array) -> tuple[float, float]:
    return float(np.median(times)), float(np.quantile(times, 0.99))


def _each(
    what: str, who: str, solve: Callable[[int], Array | None], arm: Arm, targets: Array, seconds: float
) -> Row:
    times, solutions = _timed(solve, len(targets), seconds)
    nothing = np.full(arm.dof, np.nan)
    q = np.array([nothing if q_or_none is None else q_or_none for q_or_none in solutions])
    return Row(what, who, *_figures(times), float(reached(arm, q, targets[: len(q)]).mean()), len(times))


def _peer(peer: Peer, arm: Arm, targets: Array, seconds: float) -> Row:
    what = "one pose"
    try:
        who = f"{peer.name} {version(peer.package)}"
    except PackageNotFoundError:
        who = peer.name
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # Warnings of the peer.
            solve = peer.make(arm)
            return _each(what, who, lambda k: solve(targets[k]), arm, targets, seconds)
    except Unsuitable as error:
        return Row(what, who, why_not=str(error))
    except Exception as error:  # Other libraries may raise anything.
        return Row(what, who, why_not=f"failed: {type(error).__name__}: {error}")


def _batch(arm: Arm, targets: Array, seconds: float) -> Row:
    times, solutions = _timed(lambda _: arm.ik(targets).q, 5, seconds)
    per_pose = float(np.median(times)) / len(targets)
    good = reached(arm, solutions[0], targets).mean()
    return Row(f"batch, {_cores()} threads", "kinseek", per_pose, None, float(good), len(targets))


def _branches(arm: Arm, targets: Array, seconds: float) -> Row:
    times, found = _timed(lambda k: arm.branches(targets[k]).q, len(targets), seconds)
    pairs = zip(found, targets[: len(found)], strict=True)
    good = [len(q) > 0 and bool(reached(arm, q, np.repeat(T[None], len(q), 0)).all()) for q, T in pairs]
    return Row("every answer", "kinseek", *_figures(times), float(np.mean(good)), len(times))


def _out_of_reach(arm: Arm, targets: Array) -> Array:
    """Move the poses away from the base until they are certainly out of reach."""
    rng, far = np.random.default_rng(3), targets.copy()
    ways = rng.normal(size=(len(far), 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    far[:, :3, 3] = ways * arm.chain.reach * rng.uniform(1.05, 1.5, (len(far), 1))
    return far
