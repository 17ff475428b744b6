"""Answers on the other side of a singularity at which the axes of two joints fall together.

Where the joint between two others brings their axes into one line, as the middle joint of a wrist does, answers to a pose
lie on two sheets that touch there alone: where that joint stands on either side of its singular value. With several joints
to spare these places are so thin that no sample lies in one, and a way sideways that keeps to a sheet never comes to the
other, though a motion may pass straight through. So answers near such a place are mirrored: their twins lie on the other
sheet.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from kinseek.kernels.arrays import Array
from kinseek.robots.chain import SerialChain
from kinseek.robots.geometry import arm_length
from kinseek.structure.axes import lean
from kinseek.transforms import rotation

ONE_LINE = 1e-3
"""Axes fall together where they are no farther apart than this part of the arm's length, and lean no more than this
[rad]."""

NEAR = 0.5
"""Answers with the joint no farther than this from its singular value [rad] are mirrored. By trial on a path of ten joints
that was followed after seven plans then, with less than half as much after ten, and without at none."""


class Fold(NamedTuple):
    """Where two axes fall together."""

    joint: int
    """The variable of the joint between them."""
    value: float
    """Where it stands then [rad]."""


def folds_of(chain: SerialChain) -> list[Fold]:
    """All such places of an arm inside its limits, but for joints that share a variable."""
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
            if inside and leaning <= ONE_LINE and apart <= ONE_LINE * arm_length(chain):
                found.append(Fold(i, value))
    return found


def mirrored(q: Array, folds: list[Fold]) -> Array:
    """Twins of the answers near a fold, (k, n) -> (m, n); they have to be brought onto the pose."""
    made = [q[:0]]
    for fold in folds:
        off = q[:, fold.joint] - fold.value
        off -= 2.0 * math.pi * np.round(off / (2.0 * math.pi))
        some = np.abs(off) < NEAR
        twins = q[some].copy()
        twins[:, fold.joint] -= 2.0 * off[some]
        made.append(twins)
    return np.concatenate(made)
