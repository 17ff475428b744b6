"""What paths and motions in time need of a collision scene, whose room is not below theirs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol


class Obstacles(Protocol):
    """Methods of a scene that paths and motions in time use; `Scene` has them."""

    def free(self, q: Any, clearance: float = 0.0) -> Any:
        """See `Scene.free`."""

    def free_motion(
        self, q0: Any, q1: Any, clearance: float = 0.0, around: Any = None, thorough: bool = True
    ) -> Any:
        """See `Scene.free_motion`."""

    def free_samples(self, q0: Any, q1: Any, counts: Any, clearance: float = 0.0) -> Any:
        """See `Scene.free_samples`."""

    def hits_between(self, q0: Any, q1: Any, clearance: float = 0.0) -> Sequence[object]:
        """See `Scene.hits_between`."""

    def distance(self, q: Any) -> Any:
        """See `Scene.distance`."""

    def hits(self, q: Any, clearance: float = 0.0) -> Sequence[object]:
        """See `Scene.hits`."""
