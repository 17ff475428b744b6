"""Black-box kinematics: a mechanism that is only known by a function from joint values to the pose of the tip.

Nothing else is assumed: no axes, no links, no derivative, not even that a joint value is an angle. Therefore every pose that
the function returns is checked. The error for an invalid pose contains the joint values.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NoReturn

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinseek.errors import FailedKinematics, InvalidRobot, suggest
from kinseek.kernels.arm.pose_error import LARGEST, first_loose
from kinseek.support.interrupts import raise_of_handler
from kinseek.support.lazy import lazy

from .mechanism import CONTINUOUS, PRISMATIC, REVOLUTE, Variables
from .named import in_order

Array = NDArray[np.float64]
Function = Callable[[Any], Any]

NUMBER = "number"
"""Kind of a joint value without a declared kind: a number between its limits, never wrapped by 2π."""

KINDS = (NUMBER, REVOLUTE, CONTINUOUS, PRISMATIC)

_RIGID = 1e-6
"""Tolerance for the difference of RᵀR from the identity, and of the last row from 0 0 0 1; single precision passes."""
_SAME = 1e-6
"""Tolerance for the difference between a row of a batch and the same row alone [m], and in rotation entries; single
precision passes."""
_MOST = 1e100
"""Largest joint value, in any unit: its square is still finite."""
_MOST_ROWS = 8192
"""Most rows in one call of the function, so that its temporaries fit into the caches."""


@dataclass(frozen=True, eq=False)
class BlackBox(Variables):
    """A mechanism known only by its forward kinematics. Create one with `black_box`, which checks everything."""

    name: str
    joint_names: tuple[str, ...]
    kinds: tuple[str, ...]
    """Kind of each variable: number, revolute, continuous or prismatic."""
    lower: Array
    """Lower limits, (n,), [rad], [m] or the function's own unit; a continuous joint is kept in [-π, π]."""
    upper: Array
    rates: Array
    """Limits of velocity, acceleration and jerk of each variable, (3, n), above 0; NaN if unknown."""
    function: Function
    """(k, n) -> (k, 4, 4) if `vectorized`, otherwise (n,) -> (4, 4); lengths in [m]."""
    vectorized: bool
    partial: bool
    """Whether the function may return NaN for joint values at which the mechanism cannot be assembled."""
    single: bool = False
    """Whether the function computes in single precision."""
    base: str = "base"
    tip: str = "tip"

    @property
    def axes(self) -> None:
        """None, since the axes are not known; see `Mechanism`."""
        return None

    @property
    def periodic(self) -> NDArray[np.bool_]:
        """Whether a full turn of each variable leaves the pose unchanged, (n,), according to its kind."""
        return self.turns

    @lazy
    def cheap(self) -> bool:
        """Whether one more row costs little, since no Python code runs for it."""
        return self.vectorized or _is_compiled(self.function)

    def limited(
        self, lower: Array, upper: Array, kinds: tuple[str, ...], rates: Array | None = None
    ) -> BlackBox:
        """Return the same mechanism with other limits, (n,), kinds that fit them, and if given other rates, (3, n)."""
        rates = self.rates if rates is None else rates
        return replace(self, lower=lower, upper=upper, kinds=kinds, rates=rates)

    def part(self, joints: tuple[int, ...], q: Array, tool: Array | None) -> BlackBox:
        """Return the same mechanism in which only some joints move; see `Mechanism`."""
        # The caller may change its array later.
        chosen, fixed_q = list(joints), q.copy()

        def poses(rows: Array) -> Array:
            full = np.repeat(fixed_q[None], len(rows), axis=0)
            full[:, chosen] = rows
            found = self.forward(full)
            return found if tool is None else found @ tool

        less = replace(
            self,
            joint_names=tuple(self.joint_names[i] for i in joints),
            kinds=tuple(self.kinds[i] for i in joints),
            lower=self.lower[chosen],
            upper=self.upper[chosen],
            rates=self.rates[:, chosen],
            function=poses,
            vectorized=True,
        )
        # It takes many rows; the cost of a row depends on the function behind it.
        less.__dict__["cheap"] = self.cheap
        return less

    def forward(self, q: Array) -> Array:
        """Return checked poses of the tip, (k, n) -> (k, 4, 4), lengths in [m]; NaN only if `partial` allows it.

        Raises:
            FailedKinematics: The function raises, or returns something other than a rigid transform; the error contains q.
        """
        result = np.empty((len(q), 4, 4))
        for begin in range(0, len(q), _MOST_ROWS):
            # The function gets a copy, so that it may write into it.
            rows = q[begin : begin + _MOST_ROWS].copy()
            result[begin : begin + len(rows)] = self._checked(
                self._evaluate(rows), q[begin : begin + len(rows)]
            )
        return result

    def _evaluate(self, rows: Array) -> Array:
        if not self.vectorized and not _is_compiled(self.function):
            return np.array([self._one(row) for row in rows])
        try:
            return self._many(rows)
        except Exception as error:
            raise_of_handler(error)
            self._blame(rows, error)

    def _many(self, rows: Array) -> Array:
        """Evaluate rows, (k, n), in one call; a compiled function of one row gets a compiled loop."""
        given = (self.function if self.vectorized else self._loop)(rows)
        try:
            matrix = np.asarray(given)
        except Exception as error:
            raise_of_handler(error)
            raise TypeError(f"not an array: {error}") from error
        if matrix.shape != (len(rows), 4, 4):
            hint = "; or does it take one joint vector? then say vectorized=False" if self.vectorized else ""
            self._fail(f"gave shape {matrix.shape}, expected ({len(rows)}, 4, 4){hint}", rows[0], len(rows))
        return self._real(matrix, rows[0])

    def _one(self, row: Array) -> Array:
        try:
            # A copy, as in `forward`: the function may write into it.
            matrix = np.asarray(self.function(row.copy()))
        except Exception as error:
            raise_of_handler(error)
            self._fail(f"raised {type(error).__name__}: {error}", row, cause=error)
        if matrix.shape != (4, 4):
            self._fail(f"gave shape {matrix.shape}, expected (4, 4)", row)
        return self._real(matrix, row)

    def _real(self, matrix: NDArray[Any], row: Array) -> Array:
        if matrix.dtype.kind not in "fiu":
            self._fail(f"gave an array of {matrix.dtype}, expected real numbers", row)
        return matrix.astype(np.float64, copy=False)

    @lazy
    def _loop(self) -> Function:
        return _compiled_loop(self.function)

    def _blame(self, rows: Array, error: Exception) -> NoReturn:
        """Find the row that made a call with many rows fail, by evaluating one at a time."""
        if isinstance(error, FailedKinematics):
            raise error
        for row in rows:
            try:
                self._many(row[None].copy())
            except FailedKinematics:
                raise
            except Exception as alone:
                raise_of_handler(alone)
                hint = (
                    "; or does it take one joint vector? then say vectorized=False"
                    if self._takes_one(row)
                    else ""
                )
                self._fail(f"raised {type(alone).__name__}: {alone}{hint}", row, cause=alone)
        self._fail(
            f"raised {type(error).__name__}: {error} for {len(rows)} rows at once, and for none of them alone",
            rows[0],
            len(rows),
            cause=error,
        )

    def _takes_one(self, row: Array) -> bool:
        """Return whether the function returns a pose for one row."""
        try:
            return self.vectorized and np.shape(self.function(row.copy())) == (4, 4)
        except Exception as error:
            raise_of_handler(error)
            return False

    def _checked(self, poses: Array, rows: Array) -> Array:
        poses = np.ascontiguousarray(poses)
        bad = first_loose(poses, _RIGID, self.partial)
        if bad < 0:
            return poses
        T, row = poses[bad], rows[bad]
        # The kernel says only which pose is wrong. The cases below find out what is wrong with it.
        if np.isnan(T).any():
            hint = "" if self.partial else "; if it cannot be put together there, say partial=True"
            self._fail(f"gave NaN{hint}", row)
        if not np.isfinite(T).all():
            self._fail("gave infinity", row)
        off = float(np.abs(T[:3, :3].T @ T[:3, :3] - np.eye(3)).max())
        if off > _RIGID:
            self._fail(f"gave no rotation: RᵀR differs from the identity by {off:.3g}", row)
        farthest = np.abs(T[:3, 3]).max()
        if farthest > LARGEST:
            self._fail(f"gave a position {farthest:g} m off, expected at most {LARGEST:g} m", row)
        if np.linalg.det(T[:3, :3]) < 0:
            self._fail("gave a reflection: the determinant of its rotation is -1", row)
        self._fail(f"gave the last row {T[3]}, expected [0, 0, 0, 1]", row)

    def _fail(self, what: str, row: Array, count: int = 1, cause: Exception | None = None) -> NoReturn:
        where = f"q = {np.array2string(row, separator=', ', max_line_width=10**6)}"
        where += f", the first of {count} rows" if count > 1 else ""
        raise FailedKinematics(f"fk of {self.name!r} {what}; at {where}", row.copy()) from cause

    def __reduce__(self) -> tuple[type[BlackBox], tuple[Any, ...]]:
        """Pickle only the fields: a compiled loop is built again."""
        return type(self), tuple(getattr(self, name) for name in self.__dataclass_fields__)


def black_box(
    function: Function,
    lower: ArrayLike | Mapping[str, float],
    upper: ArrayLike | Mapping[str, float],
    *,
    vectorized: bool = True,
    names: Sequence[str] | None = None,
    kinds: str | Sequence[str] | None = None,
    partial: bool = False,
    name: str = "black_box",
) -> BlackBox:
    """Check a function and its limits, and call it for the first time.

    Raises:
        InvalidRobot: Not a function, limits of different lengths, infinite or crossed limits, unknown kinds, or duplicate
            names.
        FailedKinematics: The function fails within the limits, or mixes up its rows.
    """
    if not callable(function):
        raise InvalidRobot(f"fk must be a function, got {type(function).__name__}")
    if names is None and isinstance(lower, Mapping):
        names = tuple(lower)
    listed: tuple[Any, ...] = () if names is None else _listed(names, "names")
    if all(isinstance(each, str) for each in listed):
        lower = in_order(lower, listed, "lower", InvalidRobot)
        upper = in_order(upper, listed, "upper", InvalidRobot)
    low, high = _limits(lower, "lower"), _limits(upper, "upper")
    if low.shape != high.shape:
        raise InvalidRobot(f"lower and upper must be equally long, got {len(low)} and {len(high)}")
    dof = len(low)
    called = tuple(f"joint{i + 1}" for i in range(dof)) if names is None else listed
    if len(called) != dof or not all(isinstance(each, str) for each in called) or len(set(called)) != dof:
        raise InvalidRobot(f"names must be {dof} different strings, one per joint, got {called}")
    kind_of = (
        (NUMBER,) * dof
        if kinds is None
        else (kinds,) * dof
        if isinstance(kinds, str)
        else _listed(kinds, "kinds")
    )
    if len(kind_of) != dof:
        raise InvalidRobot(f"kinds must be one word, or {dof}, one per joint; got {len(kind_of)}")
    for i, kind in enumerate(kind_of):
        if kind not in KINDS:
            raise InvalidRobot(f"joint {called[i]!r}: {suggest(str(kind), KINDS, 'kind')}")
        if kind == CONTINUOUS:
            low[i], high[i] = -np.pi, np.pi
        if not (np.isfinite(low[i]) and np.isfinite(high[i])):
            raise InvalidRobot(
                f"joint {called[i]!r}: limits must be finite, got [{low[i]}, {high[i]}]; "
                "a joint that turns without end has kind 'continuous'"
            )
        if max(abs(low[i]), abs(high[i])) > _MOST:
            raise InvalidRobot(
                f"joint {called[i]!r}: limits must be at most {_MOST:g}, got [{low[i]}, {high[i]}]: its square would "
                "overflow"
            )
        if low[i] > high[i]:
            raise InvalidRobot(f"joint {called[i]!r}: lower limit {low[i]} is above upper limit {high[i]}")
    rates = np.full((3, dof), np.nan)
    box = BlackBox(name, called, kind_of, low, high, rates, function, bool(vectorized), bool(partial))
    _require_own_rows(box)
    one = box.lower + (box.upper - box.lower) / 2
    given = np.asarray(function(one[None] if vectorized else one))
    return replace(box, single=given.dtype.itemsize < 8 and given.dtype.kind == "f")


def _require_own_rows(box: BlackBox) -> None:
    """Reject a function whose rows depend on each other."""
    shares = np.array([0.5, 0.25, 0.625])
    rows = box.lower + shares[:, None] * (box.upper - box.lower)
    together = box.forward(rows)
    if not box.vectorized:
        return
    alone = np.concatenate([box.forward(row[None]) for row in rows])
    off = np.abs(together - alone).max(axis=(1, 2))
    scale = max(1.0, float(np.nanmax(np.abs(alone), initial=0.0)))
    wrong = ~(off <= _SAME * scale) & ~(
        np.isnan(together).any(axis=(1, 2)) & np.isnan(alone).any(axis=(1, 2))
    )
    if wrong.any():
        i = int(np.argmax(wrong))
        row = np.array2string(rows[i], separator=", ", max_line_width=10**6)
        raise FailedKinematics(
            f"fk of {box.name!r} mixes up its rows: row {i} of 3 differs by {off[i]:.3g} from the same row alone, at "
            f"q = {row}",
            rows[i],
        )


def _listed(values: Any, name: str) -> tuple[Any, ...]:
    try:
        return tuple(values)
    except TypeError:
        raise InvalidRobot(f"{name} must be strings, one per joint, got {values!r:.80}") from None


def _limits(values: object, name: str) -> Array:
    try:
        numbers = np.array(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise InvalidRobot(f"{name} must be numbers, one per joint: {error}") from error
    if numbers.ndim != 1 or not len(numbers):
        raise InvalidRobot(f"{name} must have shape (n,), one number per joint, got shape {numbers.shape}")
    return numbers


def _is_compiled(function: Function) -> bool:
    if "numba" not in sys.modules:  # Then nothing was compiled with Numba.
        return False
    from numba.extending import is_jitted

    return bool(is_jitted(function))


def _compiled_loop(function: Function) -> Function:
    """Build a compiled loop over the rows of a compiled function of one row."""
    import numba

    @numba.njit(nogil=True)
    def rows_of(rows: Array) -> Array:
        result = np.empty((len(rows), 4, 4))
        for k in range(len(rows)):
            T = function(rows[k])
            if T.shape[0] != 4 or T.shape[1] != 4:
                raise ValueError("the result must have shape (4, 4)")
            for r in range(4):
                for c in range(4):
                    result[k, r, c] = T[r, c]
        return result

    return rows_of


__all__ = ["KINDS", "NUMBER", "PRISMATIC", "BlackBox", "black_box"]
