"""How far the joints may move from joint values until two bodies may touch."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .assembly import Assembly
from .broad import Broad
from .motion import FINEST

Array = NDArray[np.float64]


class Margins:
    """Lower bounds of the distances of all checked pairs, and how much each joint can reduce them.

    It belongs to one state of a scene: when bodies are added, removed or moved, the scene has other margins.
    """

    def __init__(self, made: Assembly, broad: Broad) -> None:
        """Take the engine and the bounds of a scene."""
        self._made, self.broad = made, broad

    def levers(self, low: Array, high: Array) -> Array:
        """Return the largest motion of a point of one body relative to the other body by each joint of the arm.

        Args:
            low: Least joint values, (n,).
            high: Largest ones, (n,); a slide that is farther out moves the hand faster.

        Returns:
            Lengths for each pair, (pairs, n), [m/rad] or [m/m].
        """
        each = np.eye(self._made.chain.dof)
        least, most = (np.tile(values, (len(each), 1)) for values in (low, high))
        return np.ascontiguousarray(self._made.speeds.of(least, most, each).T)

    def distances(self, q: Array) -> Array:
        """Return lower bounds of the distances of the pairs at q, (n,), as (pairs,) [m]; below 0 they have no meaning."""
        return np.asarray(self.broad.bounds(q[None])[0]) - FINEST

    def distance(self, q: Array, pair: int) -> float:
        """Return the distance of one pair at q, (n,), less a little for rounding [m]."""
        engine = self._made.engine
        with engine.lock:
            engine.place(q)
            return float(engine.near_pair(pair).distance) - FINEST

    def names(self, pair: int) -> tuple[str, str]:
        """Return the names of the two bodies of a pair."""
        return self._made.owners[pair]
