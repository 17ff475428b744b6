"""Poses as a table: the columns, and the conversion of rows to transforms."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping

import numpy as np
from numpy.typing import NDArray

from kinseek.errors import InvalidGoal, suggest
from kinseek.goal import Goal
from kinseek.poses import as_pose

from .goals import silent_pose, suspect_degrees

Array = NDArray[np.float64]

POSITION = ("x", "y", "z")
"""Columns of a position [m]."""
ROTATIONS = {
    "quat_wxyz": ("qw", "qx", "qy", "qz"),
    "rpy": ("roll", "pitch", "yaw"),
    "rotvec": ("rotvec_x", "rotvec_y", "rotvec_z"),
    "axes": ("nx", "ny", "nz", "tx", "ty", "tz"),
}
"""Columns of each form of a rotation beside a position; angles in [rad]. Those of axes are the directions of the z axis
(normal) and of the x axis (tangent), of any length."""
MATRIX = tuple(f"m{row}{column}" for row in range(4) for column in range(4))
"""Columns of a whole transform, row by row, as an alternative."""

TIME = "t"
"""Column of the time of each pose of a path [s]."""

_TURNS = " or ".join(", ".join(names) for names in ROTATIONS.values())
VALID = f"{', '.join(POSITION)} with {_TURNS}; or {MATRIX[0]} … {MATRIX[-1]}"
"""All valid columns, for messages."""


def poses_of(columns: Mapping[str, Array], where: str, position_only: bool, deg: bool) -> Array:
    """Make transforms, (N, 4, 4), from the columns of a table.

    Args:
        columns: Values of each name, (N,), lengths in [m].
        where: The file, for messages.
        position_only: Is a rotation unnecessary?
        deg: Are angles in degrees?

    Raises:
        InvalidGoal: Unknown, missing or too many columns, no rows, or a row that is not a pose; the message names it.
    """
    turn = kind_of_rotation(columns, where, position_only)
    names = _columns_of(turn)
    table = np.stack([columns[name] for name in names], axis=1)
    refuse_empty(len(table), where)
    for row, column in np.argwhere(~np.isfinite(table)):
        raise InvalidGoal(f"{where}: row {row + 1:,}: {names[column]} is {table[row, column]}")
    if turn == "matrix":
        return rigid(table.reshape(-1, 4, 4), where)
    suspect_degrees({turn: table[:, 3:]}, deg, f"{where}: {', '.join(ROTATIONS.get(turn, ()))}")

    def made(rows: Array) -> Array:
        if turn == "axes":
            return silent_pose(rows[..., :3], {"z_axis": rows[..., 3:6], "x_axis": rows[..., 6:]}, deg)
        return silent_pose(rows[..., :3], {turn: rows[..., 3:]} if turn else {}, deg)

    return _row_by_row(made, table, where)


def rigid(matrices: Array, where: str) -> Array:
    """Check that every matrix, (N, 4, 4), is a rigid transform.

    Raises:
        InvalidGoal: One is not; the message names its row.
    """
    refuse_empty(len(matrices), where)
    return _row_by_row(as_pose, matrices, where)


def refuse_empty(rows: int, where: str) -> None:
    """Reject a table without rows.

    Raises:
        InvalidGoal: It has no rows.
    """
    if rows == 0:
        raise InvalidGoal(f"{where} holds no poses: it has no rows")


def kind_of_rotation(columns: Collection[str], where: str, position_only: bool) -> str:
    """How rotations are given: a key of `ROTATIONS`, ``"matrix"``, or nothing where only the position counts.

    Raises:
        InvalidGoal: Unknown, missing or too many columns.
    """
    known = {name for names in (POSITION, MATRIX, *ROTATIONS.values()) for name in names}
    for name in columns:
        if name not in known:
            raise InvalidGoal(f"{where}: {suggest(name, known, 'column', VALID)}")
    begun = [kind for kind, names in (*ROTATIONS.items(), ("matrix", MATRIX)) if set(names) & set(columns)]
    if len(begun) > 1 or ("matrix" in begun and set(POSITION) & set(columns)):
        raise InvalidGoal(
            f"{where}: columns give the pose in more than one way: {', '.join(columns)}. Valid: {VALID}"
        )
    if not begun and not position_only:
        raise InvalidGoal(
            f"{where}: columns of a rotation are missing; got {', '.join(columns)}. Valid: {VALID}"
        )
    turn = begun[0] if begun else ""
    if missing := [name for name in _columns_of(turn) if name not in columns]:
        raise InvalidGoal(
            f"{where}: missing column {', '.join(missing)}; got {', '.join(columns)}. Valid: {VALID}"
        )
    return turn


def _columns_of(turn: str) -> tuple[str, ...]:
    """Return the columns of a pose whose rotation is given as `kind_of_rotation` says."""
    return MATRIX if turn == "matrix" else (*POSITION, *ROTATIONS.get(turn, ()))


def _row_by_row(make: Callable[[Array], Array], rows: Array, where: str) -> Array:
    """Make poses of all rows at once; if that fails, find the first row that causes it by bisection."""

    def checked(some: Array) -> Array:
        poses = make(some)
        Goal.position(poses[..., :3, 3])  # Which must not be too far away.
        return poses

    try:
        return checked(rows)
    except InvalidGoal:
        low, high = 0, len(rows)
        while high - low > 1:
            middle = (low + high) // 2
            try:
                checked(rows[low:middle])
                low = middle
            except InvalidGoal:
                high = middle
        try:
            checked(rows[low])  # Not as a batch, whose indices the message would name, too.
        except InvalidGoal as error:
            raise InvalidGoal(f"{where}: row {low + 1:,}: {error}") from None
        raise
