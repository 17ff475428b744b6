"""What paths and motions in time need of a collision scene, whose room is not below theirs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Protocol

from kinseek.errors import InvalidScene, KinseekError


class Obstacles(Protocol):
    """Methods of a scene that paths and motions in time use; `Scene` has them."""

    @property
    def state(self) -> object:
        """See `Scene.state`."""

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


@contextmanager
def unchanged(scene: Obstacles | None, call: str) -> Iterator[None]:
    """Refuse what a call finds, a result or an error, if another thread changes the scene that it asks many times.

    Args:
        scene: The scene, or None.
        call: Name of the call.

    Raises:
        InvalidScene: It was changed: parts of the result may be right for one state only.
    """
    state = None if scene is None else scene.state
    try:
        yield
    except KinseekError:
        _require_same(scene, state, call)
        raise
    _require_same(scene, state, call)


def _require_same(scene: Obstacles | None, state: object, call: str) -> None:
    if scene is not None and scene.state is not state:
        raise InvalidScene(
            f"another thread changed the scene during {call}; give {call} a copy of it, copy.copy(scene)"
        ) from None
