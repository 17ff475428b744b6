"""Pictures of joint values along a path, with limits, steps and breaks."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinseek.arm import Arm
from kinseek.errors import InvalidUse
from kinseek.problem import as_joints

from .figures import COLOURS, drawn, plane, text_of
from .shown import axis_label, unit_of

Array = NDArray[np.float64]

MARKED = 200
"""Maximum number of rows with which each row is marked by a dot."""


@drawn
def joints(
    q: ArrayLike,
    arm: Arm,
    *,
    breaks: Sequence[int] = (),
    times: ArrayLike | None = None,
    size: tuple[float, float] | None = None,
) -> Any:
    """Draw joint values along a path, a panel per joint, between its limits (dashed), and mark the largest step per unit.

    A joint without limits has no dashed lines. Steps are plain differences of the values, so a jump by a full turn is a
    step.

    Args:
        q: Joint values row by row, (N, n), [rad] or [m].
        arm: The arm of these joints.
        breaks: Indices of the rows, from 1 to N - 1, to which no motion leads from the previous row. Lines are broken there,
            a dotted line marks the place, and the step is ignored.
        times: Times of the rows, (N,), [s], increasing; by default the indices of the rows.
        size: Size of the figure [inch].

    Returns:
        The Matplotlib figure.

    Raises:
        InvalidProblem: Joint values that do not fit the arm.
        InvalidUse: Fewer than two rows, invalid breaks, or times that do not fit or increase.
        MissingExtra: Matplotlib is not installed.
    """
    rows = as_joints(arm.mechanism, q)
    if rows.ndim != 2 or len(rows) < 2:
        raise InvalidUse(f"q must have shape (N, {arm.dof}) with N of at least 2, got {rows.shape}")
    where = _times(times, len(rows))
    cuts = _breaks(breaks, len(rows))
    largest = _largest_steps(rows, cuts, [unit_of(kind) for kind in arm.kinds])
    figure, axes = plane(rows=arm.dof, size=size or (6.6, 0.9 + 1.05 * arm.dof))
    panels = np.ravel(axes)
    pieces = np.split(np.arange(len(rows)), cuts)
    for i, ax in enumerate(panels):
        for piece in pieces:
            mark = "." if len(rows) <= MARKED else None
            ax.plot(where[piece], rows[piece, i], color=COLOURS[0], linewidth=1.5, marker=mark, markersize=4)
        if arm.kinds[i] != "continuous":
            for limit in (arm.lower[i], arm.upper[i]):
                ax.axhline(limit, color=COLOURS[1], linewidth=1.2, linestyle="--")
        for cut in cuts:
            ax.axvline((where[cut - 1] + where[cut]) / 2, color="black", linewidth=1.2, linestyle=":")
        if i in largest:
            row, joint_ = largest[i], rows[:, i]
            ax.plot(
                where[row - 1 : row + 1], joint_[row - 1 : row + 1], color=COLOURS[3], linewidth=4, zorder=3
            )
        ax.set_ylabel(axis_label(arm.joint_names[i], arm.kinds[i]), rotation=0, ha="right", va="center")
        ax.set_xlim(where[0], where[-1])
        ax.margins(y=0.12)
        ax.locator_params(axis="y", nbins=3)
        if i + 1 < arm.dof:
            ax.tick_params(labelbottom=False)
    panels[-1].set_xlabel("row" if times is None else "time [s]")
    figure.align_ylabels(panels)
    figure.suptitle(_report(rows, largest, arm, len(cuts)), fontsize="medium")
    return figure


def _report(rows: Array, largest: dict[int, int], arm: Arm, breaks: int) -> str:
    """Describe the largest steps, and the number of breaks."""
    report = []
    for joint, row in largest.items():
        step = abs(float(rows[row, joint] - rows[row - 1, joint]))
        unit = unit_of(arm.kinds[joint])
        report.append(f"{step:.3g} {unit}".rstrip() + f" of {text_of(arm.joint_names[joint])} to row {row}")
    steps = f"largest step (orange): {' and '.join(report)}" if report else "no step"
    return f"{len(rows):,} rows, {breaks} {'break' if breaks == 1 else 'breaks'}\n{steps}"


def _largest_steps(rows: Array, cuts: list[int], units: Sequence[str]) -> dict[int, int]:
    """Return for each unit the joint with the largest step, and the row that it leads to; breaks are ignored."""
    steps = np.abs(np.diff(rows, axis=0))
    steps[[cut - 1 for cut in cuts]] = -1.0
    largest = {}
    for unit in dict.fromkeys(units):
        these = [i for i, each in enumerate(units) if each == unit]
        row, which = np.unravel_index(int(np.argmax(steps[:, these])), (len(steps), len(these)))
        if steps[row, these[which]] >= 0.0:
            largest[these[which]] = int(row) + 1
    return largest


def _breaks(breaks: Sequence[int], count: int) -> list[int]:
    given = np.asarray(breaks)
    if given.size == 0:
        return []
    if given.ndim != 1 or given.dtype.kind not in "iu" or given.min() < 1 or given.max() >= count:
        raise InvalidUse(f"breaks must be numbers of rows from 1 to {count - 1}, got {breaks!r}")
    return sorted({int(each) for each in given})


def _times(times: ArrayLike | None, count: int) -> Array:
    if times is None:
        return np.arange(count, dtype=float)
    where = np.asarray(times, dtype=float)
    if where.shape != (count,) or not np.isfinite(where).all() or not (np.diff(where) > 0).all():
        raise InvalidUse(
            f"times must be {count} increasing numbers [s], one per row; got shape {where.shape}"
        )
    return where
