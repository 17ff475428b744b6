"""Reachable targets, and a judge that shares nothing with the library: plain NumPy forward kinematics.

No solver judges its own results, and no target is made by a kernel.
"""

from __future__ import annotations

import os
import platform
from importlib.metadata import version
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kinseek.robots.chain import SerialChain

Array = NDArray[np.float64]

STRICT = 1e-6
"""[m] and [rad]"""


def plain_fk(chain: SerialChain, q: Array) -> Array:
    """``A_1 J_1 … A_m J_m A_tip`` of many joint vectors, (k, n) -> (k, 4, 4), in NumPy alone."""
    turn = np.broadcast_to(np.eye(3), (len(q), 3, 3))
    place = np.zeros((len(q), 3))
    for k in range(len(chain.prismatic)):
        place = place + turn @ chain.fixed[k, :, 3]
        turn = turn @ chain.fixed[k, :, :3]
        value = chain.multiplier[k] * q[:, chain.leader[k]] + chain.offset[k]
        if chain.prismatic[k]:
            place = place + turn[:, :, 2] * value[:, None]
        else:
            c, s = np.cos(value), np.sin(value)
            J = np.zeros((len(q), 3, 3))
            J[:, 0, 0], J[:, 0, 1], J[:, 1, 0], J[:, 1, 1], J[:, 2, 2] = c, -s, s, c, 1.0
            turn = turn @ J
    T = np.zeros((len(q), 4, 4))
    T[:, :3, 3] = place + turn @ chain.fixed[-1, :, 3]
    T[:, :3, :3] = turn @ chain.fixed[-1, :, :3]
    T[:, 3, 3] = 1.0
    return T


def pose_errors(T: Array, targets: Array) -> tuple[Array, Array]:
    """Distances [m] and angles [rad] between poses, (k, 4, 4), accurate for small angles."""
    away = np.linalg.norm(T[:, :3, 3] - targets[:, :3, 3], axis=1)
    R = np.swapaxes(T[:, :3, :3], 1, 2) @ targets[:, :3, :3]
    sine = np.stack([R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]], axis=1)
    return away, np.arctan2(np.linalg.norm(sine, axis=1), np.trace(R, axis1=1, axis2=2) - 1.0)


def strict(chain: SerialChain, q: Array, targets: Array, slack: float = 0.0) -> NDArray[np.bool_]:
    """Which joint vectors, (k, n), reach their targets, (k, 4, 4), inside the limits, or outside by at most `slack`."""
    away, angle = pose_errors(plain_fk(chain, np.nan_to_num(q)), targets)
    inside = ((q >= chain.lower - slack) & (q <= chain.upper + slack)).all(axis=1)
    return np.asarray(inside & (away <= STRICT) & (angle <= STRICT))


def random_joints(chain: SerialChain, count: int, seed: int) -> Array:
    """Joint vectors uniform inside the limits, (count, n)."""
    return np.random.default_rng(seed).uniform(chain.lower, chain.upper, (count, chain.dof))


def singular_joints(chain: SerialChain, count: int, seed: int) -> Array:
    """Joint vectors near singularities and limits: each joint one of {0, lower, upper, ±π/2, random}, (count, n)."""
    rng = np.random.default_rng(seed)
    pick = rng.integers(0, 6, (count, chain.dof))
    loose = rng.uniform(chain.lower, chain.upper, (count, chain.dof))
    low, high = np.broadcast_to(chain.lower, pick.shape), np.broadcast_to(chain.upper, pick.shape)
    half = np.full(pick.shape, np.pi / 2)
    chosen = np.choose(pick, [np.zeros(pick.shape), low, high, half, -half, loose])
    return np.asarray(np.clip(chosen, chain.lower, chain.upper))


def processor() -> str:
    """Name of the processor, as the system gives it."""
    name = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.is_file():
        lines = info.read_text(encoding="utf-8").splitlines()
        name = next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), name)
    return name


def machine() -> str:
    """One line that every table starts with: processor, cores that this process may use, system, versions."""
    packages = ", ".join(f"{name} {version(name)}" for name in ("kinseek", "numba", "numpy"))
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    python = f"{platform.system()}, Python {platform.python_version()}"
    return f"{processor()}, {cores} cores; {python}, {packages}"


def load() -> str:
    """Load of the machine over the last fifteen minutes, if the system reports it."""
    return f"{os.getloadavg()[2]:.1f}" if hasattr(os, "getloadavg") else "unknown"
