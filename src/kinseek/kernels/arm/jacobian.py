"""The geometric Jacobian of many configurations.

A revolute joint with axis z and origin o moves the tip at p by ``(z x (p - o), z)``, a prismatic one by ``(z, 0)``
(Siciliano et al. 2009, equation 3.30).
"""

from __future__ import annotations

from typing import Annotated

import numpy as np

from kinseek.kernels.arrays import Array, ChainArrays
from kinseek.kernels.entry import OUT
from kinseek.kernels.jit import entry

from .forward import advance, advance_segment, identity
from .vectors import Vector, column, cross, minus, row


@entry
def add_jacobians(
    chain: ChainArrays, q: Annotated[Array, "k", "n"], result: Annotated[Array, "k", 6, "n", OUT]
) -> None:
    """Add the result of `jacobian_many` for q, (k, n), to `result`, (k, 6, n)."""
    joints = len(chain.leader)
    axes, origins, T = np.empty((joints, 3)), np.empty((joints, 3)), np.empty((3, 4))
    for k in range(len(q)):
        identity(T)
        for m in range(joints):
            advance_segment(chain, m, m + 1, q[k], T)
            for r in range(3):
                # A rotation about the axis leaves the axis and the points on it where they are, so T may include it
                # already.
                axes[m, r], origins[m, r] = T[r, 2], T[r, 3]
        advance(chain.fixed[joints], True, 0.0, T)
        for m in range(joints):
            J, i, scale, axis = result[k], chain.leader[m], chain.multiplier[m], row(axes, m)
            if chain.prismatic[m]:
                linear, angular = axis, Vector(0.0, 0.0, 0.0)
            else:
                linear, angular = cross(axis, minus(column(T, 3), row(origins, m))), axis
            J[0, i] += scale * linear.x
            J[1, i] += scale * linear.y
            J[2, i] += scale * linear.z
            J[3, i] += scale * angular.x
            J[4, i] += scale * angular.y
            J[5, i] += scale * angular.z


def jacobian_many(chain: ChainArrays, q: Array) -> Array:
    """Velocity [m] and angular velocity [rad] of the tip, in the base, for each joint variable, (k, n) -> (k, 6, n)."""
    result = np.zeros((len(q), 6, len(chain.lower)))
    add_jacobians(chain, np.ascontiguousarray(q), result)
    return result
