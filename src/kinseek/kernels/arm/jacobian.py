"""The geometric Jacobian of many configurations."""

from __future__ import annotations

import numpy as np

from kinseek.kernels.arrays import Array, ChainArrays
from kinseek.kernels.jit import kernel

from .forward import advance, identity


@kernel
def jacobian_many(chain: ChainArrays, q: Array) -> Array:
    """Velocity [m] and angular velocity [rad] of the tip, in the base, for each joint variable, (k, n) -> (k, 6, n)."""
    count, dof, joints = len(q), len(chain.lower), len(chain.leader)
    result, axes, T = np.zeros((count, 6, dof)), np.empty((joints, 6)), np.empty((3, 4))
    for k in range(count):
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
    return result
