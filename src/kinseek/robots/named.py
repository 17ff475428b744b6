"""Joint values by name: read a mapping or a ROS JointState into the order of an arm, and convert back to a mapping."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinseek.errors import suggest

Array = NDArray[np.float64]


def in_order(values: Any, names: Sequence[str], what: str, error: Callable[[str], Exception]) -> Any:
    """Bring values that are given by joint name into the order of an arm; return everything else unchanged.

    Args:
        values: A mapping from joint names to numbers or to arrays, (...), that broadcast; or an object with ``name`` and
            ``position``, e.g. a ROS JointState, whose joints of other robots are ignored.
        names: Names of the joints, from base to tip, n of them.
        what: Name of the values, for messages.
        error: Creates the exception from a message.

    Returns:
        Array (..., n), or `values`.

    Raises:
        error: A mapping has an unknown joint name, joints are missing, or their values do not broadcast.
    """
    if not isinstance(values, Mapping):
        if not (hasattr(values, "name") and hasattr(values, "position")):
            return values
        values = _of_message(values, what, error)
        values = {name: value for name, value in values.items() if name in names}
    for name in values:
        if name not in names:
            raise error(f"{what}: {suggest(str(name), names, 'joint')}")
    if missing := [name for name in names if name not in values]:
        given = ", ".join(values) or "none"
        raise error(f"{what}: no value for joint {', '.join(map(repr, missing))}; given: {given}")
    try:
        columns = np.broadcast_arrays(*[np.asarray(values[name], dtype=np.float64) for name in names])
    except (TypeError, ValueError, OverflowError) as reason:
        raise error(f"{what}: values of joints must be numbers, or arrays that broadcast: {reason}") from None
    return np.stack(columns, axis=-1)


def _of_message(message: Any, what: str, error: Callable[[str], Exception]) -> Mapping[str, Any]:
    try:
        names, positions = list(message.name), list(message.position)
    except TypeError as reason:
        raise error(f"{what}: name and position must be lists: {reason}") from None
    if len(names) != len(positions):
        raise error(
            f"{what}: {len(names)} names and {len(positions)} positions, expected the same number of both"
        )
    return dict(zip(names, positions, strict=True))


def by_name(names: Sequence[str], q: Array) -> dict[str, Any]:
    """Return a mapping from each joint name to its value, a float, or its values, (...), for joint values, (..., n)."""
    columns = np.moveaxis(q, -1, 0)
    return dict(zip(names, columns.tolist() if q.ndim == 1 else columns.copy(), strict=True))
