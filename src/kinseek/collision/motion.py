"""Motions between two q that are free all along: proved by how far a point can move, not by a number of samples.

Conservative advancement (Mirtich 1996): a pair of bodies that is a distance d apart at one moment of a motion cannot touch
before one of them has moved by d as the other sees it. How fast any point of it can move follows from the lengths of the
links. So every moment looked at covers an interval around itself, and the motion is free when the intervals of every pair
cover it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinseek.robots.chain import SerialChain

from .engine import TOUCH, Engine, Solid

Array = NDArray[np.float64]

FINEST = 1e-5
"""A motion on which bodies come this near to touching, or to the clearance, is not called free [m]."""

_MOST = 20_000
"""Moments looked at, at most; a motion that needs more is not called free."""


def speeds(chain: SerialChain, engine: Engine, q0: Array, q1: Array) -> Array:
    """How far any point of one part of each pair moves at most, as the other sees it, from q0 to q1, (pairs,) [m]."""
    ends = np.stack([chain.multiplier * q[chain.leader] + chain.offset for q in (q0, q1)])
    travel = np.abs(ends[1] - ends[0])
    slides = np.where(chain.prismatic, np.abs(ends).max(axis=0), 0.0)
    lengths = np.linalg.norm(chain.fixed[:-1, :, 3], axis=1) + slides
    before = np.concatenate([[0.0], np.cumsum(lengths)])
    """Way from the base to the frame of each joint, along the links at their longest."""
    out = np.empty(len(engine.pairs))
    for n, (i, j) in enumerate(engine.pairs):
        first, last = sorted((engine.solids[i], engine.solids[j]), key=lambda solid: solid.joint)
        moving = np.arange(first.joint, last.joint)
        reach = before[last.joint] - before[moving + 1] + _radius(last)
        out[n] = (travel[moving] * np.where(chain.prismatic[moving], 1.0, reach)).sum()
    return out


def is_free_motion(chain: SerialChain, engine: Engine, q0: Array, q1: Array, clearance: float) -> bool:
    """Is every q on the straight way from q0 to q1 free? See `Scene.free_motion`."""
    if not engine.free(np.stack([q0, q1]), clearance).all():
        return False
    if not engine.pairs:
        return True
    rates, least = speeds(chain, engine, q0, q1), clearance + FINEST
    moments, half, left = np.array([0.5]), 0.5, np.tile(rates > 0.0, (1, 1))
    looked = 0
    while len(moments):
        looked += len(moments)
        if looked > _MOST:
            return False
        q = q0 + moments[:, None] * (q1 - q0)
        left &= engine.bounds(q) - least <= rates * half
        for row in np.flatnonzero(left.any(axis=1)):
            engine.place(q[row])
            for n in np.flatnonzero(left[row]):
                distance = engine.near_pair(int(n)).distance
                if distance <= least:
                    return False
                left[row, n] = distance - least <= rates[n] * half
        on = left.any(axis=1)
        half /= 2
        moments = np.concatenate([moments[on] - half, moments[on] + half])
        left = np.concatenate([left[on], left[on]])
    return True


def _radius(solid: Solid) -> float:
    """No point of a part is farther from the frame of the joint that carries it [m]."""
    corners = solid.shape.corners @ solid.pose[:3, :3].T + solid.pose[:3, 3]
    return float(np.linalg.norm(corners, axis=1).max()) + solid.shape.thickness + solid.padding + TOUCH
