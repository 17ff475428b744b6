"""A search for joint values that runs beside the loop of a tracker: it takes some milliseconds if a pose is out of reach."""

from __future__ import annotations

from threading import Thread

import numpy as np
from numpy.typing import NDArray

from kinseek.kernels.atlas.near import solve_goal
from kinseek.solvers.atlas.index import AtlasIndex

Array = NDArray[np.float64]


class Search:
    """The solution of a pose that is nearest to joint values, found in a thread; kernels release the GIL."""

    def __init__(self, index: AtlasIndex, tolerances: Array, target: Array, near: Array) -> None:
        """Begin; the target is (3, 4), as kernels take it, and the joint values are (n,)."""
        self._q: Array | None = None

        def run() -> None:
            q = np.empty(len(near))
            *_, success = solve_goal(index.address, tolerances, target, near, True, q)
            self._q = q if success else None

        self._thread = Thread(target=run, daemon=True)
        self._thread.start()

    def result(self) -> Array | None:
        """Wait for the solution and return it, (n,); None if there is none."""
        self._thread.join()
        return self._q
