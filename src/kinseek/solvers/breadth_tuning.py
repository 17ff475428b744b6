"""Breadth tuning by trial (the paper, Sec. 3.2): which joints deserve more breadth, and how much.

The paper examines the arm by hand and widens the joints that move the hand farthest. Measured, that is worse
than the same breadth for all: it widens the shoulder, while the breadth that pays is at the joints whose
errors others hide, such as the elbow and the wrist of a SCARA arm. So this module asks the search itself. It
solves a fixed set of reachable probe targets, widens the joint that lowers the mean weighted error most for
the leaves it costs, and goes on while the window fits the budget.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from fractions import Fraction

import numpy as np

from kinseek.kernels.arrays import Array
from kinseek.robots.chain import SerialChain
from kinseek.robots.sampling import weyl

Breadth = tuple[int, ...]

_PROBES = 128
_PATIENCE = 3
"""Rounds that may bring no gain before tuning ends: joints that need each other gain only together."""


def probe_joints(chain: SerialChain) -> Array:
    """Joint vectors spread over the limits, (k, n)."""
    return np.asarray(chain.lower + weyl(_PROBES, chain.dof) * (chain.upper - chain.lower))


def breadth_to_reach(divisions: int, wraps: bool, clips: bool, offset: Fraction) -> int:
    """The smallest breadth of a joint with which a search can walk back from any wrong cell of the first pass.

    Later passes reach k = ⌊D/2⌋ + Br - 1 nodes to a side, at spacings R/D², R/D³ and so on of a range R: a joint may still
    go k R / (D (D - 1)). How far it may have to go, to within the rounding of spacings to whole nodes:

    - Half of a full turn, R/2: k ≥ D (D - 1) / 2.
    - From the first node f R/D beside one limit, f ≤ 1/2, to the other limit, where a window loses what is beyond a limit:
      k ≥ (D - 1) (D - f).
    - The same where a window slides inward at a limit. In the pass after the first it then begins at the limit, or r of a
      spacing beside it, and ends 2 k + r spacings from there: k ≥ (D - 1) (D² - r) / (2 D - 1). In the middles of D cells
      r is 0 for an even D and 1/2 for an odd one.

    Args:
        divisions: The paper's D.
        wraps: Is the joint one with a full turn, whose windows cross from one end to the other?
        clips: Does a window of one with limits lose what is beyond a limit?
        offset: Where in their cells the first nodes stand, 0 to 1.
    """
    D, beside = divisions, (offset, 1 - offset)
    k = Fraction(D * (D - 1), 2)
    if not wraps and clips:
        k = (D - 1) * (D - min(beside))
    elif not wraps:
        k = (D - 1) * (D * D - min(f * D % 1 for f in beside)) / (2 * D - 1)
    return max(math.ceil(k) - D // 2 + 1, 1)


def window_leaves(breadth: Breadth, divisions: int) -> float:
    """Leaves of a later pass: Π (2(⌊D/2⌋ + Br_i) - 1)."""
    return float(np.prod([2.0 * (divisions // 2 + b) - 1 for b in breadth]))


def widen_by_trial(
    dof: int, leaves: Callable[[Breadth], float], most_leaves: int, mean_error: Callable[[Breadth], float]
) -> Breadth:
    """Widen joint after joint from breadth 1.

    Args:
        dof: Number of joints n.
        leaves: What a breadth costs a pass.
        most_leaves: The budget for that.
        mean_error: How well a breadth does on the probe targets.

    Returns:
        The breadth that did best on the way, (n,).
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
