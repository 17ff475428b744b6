"""Build a serial arm from a table of Denavit-Hartenberg parameters.

A row is ``(a, alpha, d, theta)``, lengths in [m] and angles in [rad], or a mapping with these four names.

    standard            A_i = Rz(theta) Tz(d) Tx(a) Rx(alpha)
    modified (Craig)    A_i = Rx(alpha) Tx(a) Rz(theta) Tz(d)

In the modified convention row i holds Craig's ``a_{i-1}, alpha_{i-1}, d_i, theta_i``. The joint variable is added to theta
for a revolute joint, and to d for a prismatic one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from kinseek.errors import InvalidGoal, InvalidRobot, suggest
from kinseek.kernels.arm.pose_error import LARGEST
from kinseek.poses import one_pose
from kinseek.support.transforms import rotation, transform
from kinseek.support.validation import as_float_array

from .chain import Array, Frame, SerialChain
from .joints import Joint, serial_chain
from .mechanism import CONTINUOUS, PRISMATIC, REVOLUTE
from .named import in_order

_COLUMNS = ("a", "alpha", "d", "theta")
_X, _Z = np.eye(3)[0], np.eye(3)[2]

Row = Sequence[float] | Mapping[str, float]


def read_dh(
    rows: Sequence[Row] | Array,
    lower: ArrayLike | Mapping[str, float],
    upper: ArrayLike | Mapping[str, float],
    *,
    convention: str = "standard",
    kinds: str | None = None,
    names: Sequence[str] | None = None,
    base: Any = None,
    tool: Any = None,
    name: str = "dh arm",
) -> SerialChain:
    """Build the arm that a table of Denavit-Hartenberg parameters describes.

    Args:
        rows: The table, (n, 4), or n mappings; see the module's docstring.
        lower: Lower limits, (n,) or by name of joint, [rad] or [m]; a revolute joint with two infinite limits is continuous.
        upper: Upper limits, in the same form.
        convention: ``"standard"`` or ``"modified"``.
        kinds: One letter per joint, R or P, such as ``"RRPR"``; the default is R for all.
        names: Names of the joints; the default is ``joint1``, ``joint2``, …
        base: Pose of the first row's frame in the base, (4, 4), or an object with a pose, lengths in [m]; the default is the
            identity.
        tool: Pose of the tip in the last row's frame, in the same form.
        name: Name of the arm.

    The frames of the rows are called ``link1``, ``link2``, …, the base ``base`` and the tip ``tool``.

    Raises:
        InvalidRobot: A wrong shape or length, a number that is not finite, an unknown convention or kind.
    """
    if convention not in ("standard", "modified"):
        raise InvalidRobot(suggest(str(convention), ("standard", "modified"), "DH convention"))
    table = _table(rows)
    count = len(table)
    letters = "R" * count if kinds is None else kinds
    if not isinstance(letters, str):
        raise InvalidRobot(f"kinds must have one letter per joint, such as 'RRP', got {kinds!r:.80}")
    if unknown := sorted(set(letters) - set("RP")):
        raise InvalidRobot(
            f"unknown joint kind {unknown[0]!r} in kinds={letters!r}. Valid: R (turns), P (slides)"
        )
    names = [f"joint{i + 1}" for i in range(count)] if names is None else _names(names)
    for what, values in (("kinds", letters), ("names", names)):
        if len(values) != count:
            raise InvalidRobot(f"{what} has {len(values)} entries, expected {count}: one per DH row")
    lowers, uppers = (
        _limits(in_order(limits, names, f"{what} limits", InvalidRobot), what, count)
        for limits, what in ((lower, "lower"), (upper, "upper"))
    )

    joints, links, pose = [], [], _rigid(base, "base")
    for i, (a, alpha, d, theta) in enumerate(table):
        along_x = transform(rotation(_X, alpha), (a, 0.0, 0.0))
        along_z = transform(rotation(_Z, theta), (0.0, 0.0, d))
        # The variable moves along or about the same z axis as d and theta, so it may come before or after them.
        origin, pose = (
            (pose, along_z @ along_x) if convention == "standard" else (pose @ along_x @ along_z, np.eye(4))
        )
        joints.append(
            Joint(names[i], _kind(letters[i], lowers[i], uppers[i]), origin, _Z, lowers[i], uppers[i])
        )
        links.append((f"link{i + 1}", Frame(i + 1, pose)))
    return serial_chain(
        joints,
        pose @ _rigid(tool, "tool"),
        name=name,
        base="base",
        tip="tool",
        source=f"{convention} DH table",
        links=links,
    )


def _kind(letter: str, lower: float, upper: float) -> str:
    if letter == "P":
        return PRISMATIC
    return CONTINUOUS if lower == -np.inf and upper == np.inf else REVOLUTE


def _listed(values: Any) -> list[Any] | None:
    try:
        return list(values)
    except TypeError:
        return None


def _names(names: Sequence[str]) -> list[str]:
    listed = _listed(names)
    if listed is None or not all(isinstance(name, str) for name in listed):
        raise InvalidRobot(f"names must be strings, one per joint, got {names!r:.80}")
    return listed


def _table(rows: Sequence[Row] | Array) -> Array:
    given = _listed(rows)
    if given is None:
        raise InvalidRobot(f"the DH table must be rows of 4 numbers, one per joint, got {rows!r:.80}")
    listed = []
    for i, row in enumerate(given):
        numbers: object = row
        if isinstance(row, Mapping):
            if set(row) != set(_COLUMNS):
                raise InvalidRobot(
                    f"DH row {i}: expected the names {', '.join(_COLUMNS)}, got {', '.join(map(str, row))}"
                )
            numbers = [row[column] for column in _COLUMNS]
        values = np.atleast_1d(_numbers(numbers, f"DH row {i}"))
        if values.shape != (len(_COLUMNS),):
            got = f"{len(values)} values" if values.ndim == 1 else f"an array of shape {values.shape}"
            raise InvalidRobot(f"DH row {i}: {got}, expected 4: {', '.join(_COLUMNS)} in [m] and [rad]")
        listed.append(values)
    if not listed:
        raise InvalidRobot("the DH table is empty, expected one row per joint")
    table = np.array(listed)
    if not np.isfinite(table).all():
        raise InvalidRobot(
            f"DH row {int(np.argmin(np.isfinite(table).all(axis=1)))}: contains NaN or infinity"
        )
    if (farthest := float(np.abs(table).max())) > LARGEST:
        raise InvalidRobot(
            f"DH row {int(np.argmax(np.abs(table).max(axis=1)))}: expected lengths [m] and angles [rad] of at most "
            f"{LARGEST:g}, got {farthest:g}: farther off, rounding of positions comes close to 1e-6 m"
        )
    return table


def _limits(values: ArrayLike, what: str, count: int) -> list[float]:
    limits = _numbers(values, f"{what} limits")
    if limits.shape != (count,):
        raise InvalidRobot(f"{what} limits: expected shape ({count},), one per DH row, got {limits.shape}")
    if np.isnan(limits).any():
        raise InvalidRobot(f"{what} limits: contain NaN")
    return [float(value) for value in limits]


def _rigid(pose: Any, what: str) -> Array:
    if pose is None:
        return np.eye(4)
    try:
        return one_pose(pose, f"{what} pose")
    except InvalidGoal as error:
        raise InvalidRobot(str(error)) from None


def _numbers(values: object, what: str) -> Array:
    try:
        return as_float_array(values)
    except (TypeError, ValueError, OverflowError) as error:
        raise InvalidRobot(f"{what}: expected numbers: {error}") from error
