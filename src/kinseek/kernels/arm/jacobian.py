"""The geometric Jacobian of many configurations."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from kinseek.kernels.arrays import Array, ChainArrays
from kinseek.kernels.entry import OUT
from kinseek.kernels.jit import entry

from .forward import advance, identity


@entry
def add_jacobians(
    chain: ChainArrays, q: Annotated[Array, "k", "n"], result: Annotated[Array, "k", 6, "n", OUT]
) -> None:
    """Add the result of `jacobian_many` for q, (k, n), to `result`, (k, 6, n)."""
    joints = len(chain.leader)
    axes, T = np.empty((joints, 6)), np.empty((3, 4))
    for k in range(len(q)):
        identity(T)
        for m in range(joints):
            value = chain.multiplier[m] * q[k, chain.leader[m]] + chain.offset[m]
            advance(chain.fixed[m], chain.prismatic[m], value, T)
            for r in range(3):
                axes[m, r], axes[m, 3 + r] = T[r, 2], T[r, 3]
        advance(chain.fixed[joints], True, 0.0, T)
        for m in range(joints):
            i, scale = chain.leader[m], chain.multiplier[m]
            zx, zy, zz = axes[m, 0], axes[m, 1], axes[m, 2]
            px, py, pz = T[0, 3] - axes[m, 3], T[1, 3] - axes[m, 4], T[2, 3] - axes[m, 5]
            if chain.prismatic[m]:
                result[k, 0, i] += scale * zx
                result[k, 1, i] += scale * zy
                result[k, 2, i] += scale * zz
            else:
                result[k, 0, i] += scale * (zy * pz - zz * py)
                result[k, 1, i] += scale * (zz * px - zx * pz)
                result[k, 2, i] += scale * (zx * py - zy * px)
                result[k, 3, i] += scale * zx
                result[k, 4, i] += scale * zy
                result[k, 5, i] += scale * zz


def jacobian_many(chain: ChainArrays, q: Array) -> Array:
    """Velocity [m] and angular velocity [rad] of the tip, in the base, for each joint variable, (k, n) -> (k, 6, n)."""
    result = np.zeros((len(q), 6, len(chain.lower)))
    add_jacobians(chain, np.ascontiguousarray(q), result)
    return result
