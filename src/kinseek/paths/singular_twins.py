"""Solutions on the other side of a singularity at which the axes of two joints coincide.

The joint between two others can bring their axes into one line, like the middle joint of a wrist. The solutions of a pose
then lie on two sheets, one for each side of the singular value of this joint, which touch only at that value. With several
redundant joints these places are so thin that no sample lies in one. A sideways motion that stays on one sheet never reaches
the other, though a motion may pass straight through. So solutions near such a place are mirrored: their twins lie on the
other sheet.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from kinseek.kernels.arrays import Array
from kinseek.robots.chain import SerialChain
from kinseek.structure.axes import lean
from kinseek.support.transforms import rotation

ONE_LINE = 1e-3
"""Axes coincide if their distance is at most this fraction of the arm's length, and their angle at most this [rad]. Not
examined further."""

NEAR = 0.5
"""Solutions with the joint no farther than this from its singular value [rad] are mirrored. Tried on one path of ten
joints: it was followed after seven plans with this value, after ten with less than half of it, and by no plan without
mirroring. The program of this trial is not in the repository."""


class Fold(NamedTuple):
    """A joint value at which two axes coincide."""

    joint: int
    """The variable of the joint between them."""
    value: float
    """Its singular value [rad]."""


def folds_of(chain: SerialChain) -> list[Fold]:
    """Return all folds of an arm inside its limits, except for joints that share a variable."""
    found, alone = [], np.bincount(chain.leader, minlength=chain.dof) == 1
    for k in range(1, len(chain.leader) - 1):
        i = int(chain.leader[k])
        if chain.prismatic[k - 1 : k + 2].any() or not alone[i]:
            continue
        before, after = chain.fixed[k], chain.fixed[k + 1]
        a, b, _ = lean(before, after)
        top = math.atan2(b, a)
        for v in (top, top + math.pi):
            turn = before[:, :3] @ rotation(np.array([0.0, 0.0, 1.0]), v)
            leaning = float(np.hypot(*(turn @ after[:, 2])[:2]))
            apart = float(np.hypot(*(turn @ after[:, 3] + before[:, 3])[:2]))
            value = (v - float(chain.offset[k])) / float(chain.multiplier[k])
            value += 2.0 * math.pi * math.ceil((float(chain.lower[i]) - value) / (2.0 * math.pi))
            inside = chain.lower[i] + ONE_LINE < value < chain.upper[i] - ONE_LINE
            if inside and leaning <= ONE_LINE and apart <= ONE_LINE * chain.length:
                found.append(Fold(i, value))
    return found


def mirrored(q: Array, folds: list[Fold]) -> Array:
    """Return twins of the solutions near a fold, (k, n) -> (m, n); these still have to be projected onto the pose."""
    made = [q[:0]]
    for fold in folds:
        off = q[:, fold.joint] - fold.value
        off -= 2.0 * math.pi * np.round(off / (2.0 * math.pi))
        some = np.abs(off) < NEAR
        twins = q[some].copy()
        twins[:, fold.joint] -= 2.0 * off[some]
        made.append(twins)
    return np.concatenate(made)
