"""Breadth tuning by trial (the paper, Sec. 3.2): choose the joints with more breadth, and their breadths.

The paper examines the arm by hand and widens the joints that move the hand farthest. In measurements this is worse than a
breadth of 2 for all joints if the wrist keeps a breadth of 1 (docs/paper_questions.md, question 8): it widens the shoulder.
But breadth helps at joints whose errors other joints also hide, such as the elbow and the wrist of a SCARA arm. So this
module runs the search itself. It solves a fixed set of reachable probe targets. It widens the joint that lowers the mean
weighted error most per additional leaf, and continues while the window fits the budget.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from kinseek.kernels.arrays import Array, Indices
from kinseek.robots.chain import SerialChain
from kinseek.robots.sampling import weyl

Breadth = tuple[int, ...]

_PROBES = 128
_PATIENCE = 3
"""Rounds without a gain after which tuning ends: some joints only gain together. Not examined further."""


def probe_joints(chain: SerialChain) -> Array:
    """Return joint vectors spread over the limits, (k, n)."""
    return np.asarray(chain.lower + weyl(_PROBES, chain.dof) * (chain.upper - chain.lower))


class Walk(NamedTuple):
    """How a joint continues from a wrong cell of the first pass: whether it can reach every node of its grid.

    A window with k_j nodes to each side at a spacing of s_j moves the joint by at most k_j s_j nodes. So all later passes
    together move it by at most T = Σ k_j s_j. The spacings are ⌊B/D⌋, divided by D and rounded down until they are 1. For B
    = D^p and k in every pass T = k (D^(p-1) - 1) / (D - 1): a geometric series that *ends*, k / (D - 1) nodes short of the
    endless one, k B / (D (D - 1)). Lower bounds of T:

    - On a full turn to the opposite node: T ≥ ⌊B/2⌋.
    - Between limits, from a first node m to the farther one, if a window loses what is beyond a limit: T ≥ m and T ≥ B - 1 -
      m.
    - The same if a window slides inward at a limit. If the first later window, of spacing s and k to a side, begins beyond
      the lower limit, it slides to m mod s and ends 2 k s from there. This is (m mod s) + k s more than the k s of a window
      that starts at the limit. Later windows are smaller and do not slide again. So T + max(m, (m mod s) + k s) ≥ B - 1
      upward, and the same with B - 1 - m for m downward.

    No node on the way is left out: after a pass at most s_j - 1 ≤ D s_(j+1) + D - 2 nodes are left, and with this breadth
    the following passes reach farther.
    """

    spacings: Sequence[int]
    """Spacings of the later passes, in nodes."""
    size: int
    """B."""
    wraps: bool
    """Whether the joint has a full turn, so that its windows cross from one end to the other."""
    clips: bool
    """Whether a window of a joint with limits loses what is beyond a limit."""
    first: Indices
    """Nodes of the first pass."""

    def shortfall(self, sides: Sequence[int]) -> int:
        """Return by how many nodes the later passes may miss the farthest node; 0 if they reach it, or if there are none.

        Args:
            sides: Nodes to each side in each later pass.
        """
        if not self.spacings:
            return 0
        steps = [k * s for k, s in zip(sides, self.spacings, strict=True)]
        if self.wraps:
            return max(self.size // 2 - sum(steps), 0)
        beside = np.concatenate([self.first, self.size - 1 - self.first])
        if not self.clips:
            # A value beyond the range has the same effect as one far beyond it, and fits 64 bits.
            slid = beside % self.spacings[0] + min(steps[0], self.size)
            beside = np.maximum(beside, slid)
        return max(self.size - 1 - int(beside.min()) - sum(steps), 0)

    def breadth(self, divisions: int) -> int:
        """Return the smallest breadth in all later passes with which the search can reach every node."""
        passes, breadths = len(self.spacings), range(1, self.size + 1)

        def arrives(breadth: int) -> bool:
            return self.shortfall([divisions // 2 + breadth - 1] * passes) == 0

        return breadths[bisect_left(breadths, True, key=arrives)]


def window_leaves(breadth: Sequence[float], divisions: int) -> float:
    """Leaves of a later pass: Π (2(⌊D/2⌋ + Br_i) - 1)."""
    return float(np.prod([2.0 * (divisions // 2 + b) - 1 for b in breadth]))


def widen_by_trial(
    dof: int, leaves: Callable[[Breadth], float], most_leaves: int, mean_error: Callable[[Breadth], float]
) -> Breadth:
    """Widen joint after joint from breadth 1.

    Args:
        dof: Number of joints n.
        leaves: Leaves of a pass with a breadth.
        most_leaves: Budget for the leaves.
        mean_error: Mean error of a breadth on the probe targets.

    Returns:
        The best breadth that was tried, (n,).
    """
    breadth: Breadth = (1,) * dof
    best, stale = breadth, 0
    error = least = mean_error(breadth) if leaves(breadth) < most_leaves else 0.0
    while stale < _PATIENCE:
        wider = [tuple(b + (i == joint) for i, b in enumerate(breadth)) for joint in range(dof)]
        wider = [each for each in wider if leaves(each) <= most_leaves]
        if not wider or least == 0.0:
            break
        trials = [(mean_error(each), each) for each in wider]
        gains = [(e - error) / np.log(leaves(each) / leaves(breadth)) for e, each in trials]
        error, breadth = trials[int(np.argmin(gains))]
        stale += 1
        if error < 0.99 * least:
            best, least, stale = breadth, error, 0
    return best
