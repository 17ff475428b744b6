"""Pictures of motions in time, against their limits."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinseek.errors import InvalidUse
from kinseek.timing.trajectory import Cap, Trajectory

from .figures import COLOURS, drawn, plane, text_of

Array = NDArray[np.float64]

TIMES = 2000
"""Number of times at which a trajectory is drawn."""

DASHES = ("-", "--", ":")
"""Lines of the joints: another one after every eighth joint, when all colours are used."""

THICK = 4.0
"""Width of a line where its limit caps the speed [pt]."""

MOST_NAMED = 2
"""Number of limits in the title, those that cap the speed for the longest time."""


class _Panel(NamedTuple):
    """Lines over time."""

    limit: str
    """The limit that caps the speed where a line is thick, as in `Cap`; empty for none."""
    label: str
    values: Array
    """A column for each line, (k, m)."""
    ends: tuple[float, ...]
    """The limits in the units of the values."""


@drawn
def trajectory(trajectory: Trajectory, *, size: tuple[float, float] | None = None) -> Any:
    """Draw joint values, velocities, accelerations and jerks over time as shares of their limits, and the speed of the tip.

    Each joint has its own scale: its limits are at -1 and 1 (dashed). The values of a continuous joint, which has no limits,
    are shares of half a turn. Where a limit caps the speed, as `Trajectory.bottleneck` says, its line is thick. Dotted lines
    mark the stops.

    Args:
        trajectory: The result of `Path.timed` or `Arm.move`.
        size: Size of the figure [inch].

    Returns:
        The Matplotlib figure. There is a panel for jerks if they are limited, and one for the tip if the arm has axes.

    Raises:
        InvalidUse: Not a trajectory, or one that takes no time.
        MissingExtra: Matplotlib is not installed.
    """
    if not isinstance(trajectory, Trajectory):
        raise InvalidUse(
            f"expected a trajectory of path.timed() or arm.move(), got {type(trajectory).__name__}"
        )
    if trajectory.duration == 0.0:
        raise InvalidUse("this trajectory takes no time: there is nothing to draw over time")
    t = np.linspace(0.0, trajectory.duration, TIMES)
    panels, names = _panels(trajectory, t), trajectory.mechanism.joint_names
    figure, axes = plane(rows=len(panels), size=size or (7.6, 0.8 + 1.35 * len(panels)))
    for ax, panel in zip(axes, panels, strict=True):
        _draw(ax, panel, t, [cap for cap in trajectory.bottleneck if cap.limit == panel.limit], names)
        for stop in trajectory.stops:
            ax.axvline(trajectory.pose_times[stop], color="black", linewidth=1.2, linestyle=":")
        ax.set_xlim(0.0, trajectory.duration)
        ax.tick_params(labelbottom=ax is axes[-1])
    axes[-1].set_xlabel("time [s]")
    figure.align_ylabels(axes)
    lines = axes[0].lines[: len(names)]
    figure.legend(lines, [text_of(name) for name in names], loc="outside right center", frameon=False)
    figure.suptitle(_report(trajectory), fontsize="medium")
    return figure


def _panels(trajectory: Trajectory, t: Array) -> list[_Panel]:
    arm, limits = trajectory.mechanism, trajectory.limits
    middle = np.where(arm.endless, 0.0, (arm.lower + arm.upper) / 2.0)
    half = np.where(arm.endless, np.pi, (arm.upper - arm.lower) / 2.0)
    panels = [
        _Panel(
            "", "joint / limit", (trajectory.q(t) - middle) / np.where(half > 0.0, half, 1.0), (-1.0, 1.0)
        ),
        _Panel("velocity", "velocity / limit", trajectory.velocity(t) / limits.velocity, (-1.0, 1.0)),
        _Panel(
            "acceleration",
            "acceleration\n/ limit",
            trajectory.acceleration(t) / limits.acceleration,
            (-1.0, 1.0),
        ),
    ]
    if limits.jerk is not None:
        panels.append(_Panel("jerk", "jerk / limit", trajectory.jerk(t) / limits.jerk, (-1.0, 1.0)))
    if arm.axes is not None:
        ends = () if limits.tool_speed is None else (limits.tool_speed,)
        panels.append(_Panel("tool_speed", "tip [m/s]", trajectory.tip_speed(t)[:, None], ends))
    return panels


def _draw(ax: Any, panel: _Panel, t: Array, caps: list[Cap], names: tuple[str, ...]) -> None:
    """Draw the lines of a panel, and thick lines where its limit caps the speed."""
    for i, values in enumerate(panel.values.T):
        colour = "black" if panel.limit == "tool_speed" else COLOURS[i % len(COLOURS)]
        ax.plot(t, values, color=colour, linestyle=DASHES[i // len(COLOURS) % len(DASHES)], linewidth=1.2)
        capped = np.zeros(len(t), dtype=np.bool_)
        for cap in caps:
            if cap.joint is None or names.index(cap.joint) == i:
                capped |= (t >= cap.begin) & (t <= cap.end)
        if capped.any():
            ax.plot(t, np.where(capped, values, np.nan), color=colour, linewidth=THICK, zorder=3)
    for end in panel.ends:
        ax.axhline(end, color="#666666", linewidth=1.0, linestyle="--")
    ax.set_ylabel(panel.label)
    ax.margins(y=0.12)


def _report(trajectory: Trajectory) -> str:
    """Describe the duration, and the limits that cap the speed for the longest time."""
    times: dict[str, float] = {}
    for cap in trajectory.bottleneck:
        limit = "tool speed" if cap.joint is None else f"{cap.limit} of {text_of(cap.joint)}"
        times[limit] = times.get(limit, 0.0) + cap.end - cap.begin
    longest = sorted(times, key=lambda limit: -times[limit])[:MOST_NAMED]
    shares = [f"{limit} {100.0 * times[limit] / trajectory.duration:.0f} %" for limit in longest]
    capped = f"\ncapped (thick) by {', '.join(shares)}" if shares else ""
    return f"{text_of(trajectory.mechanism.name)}, {trajectory.duration:.4g} s{capped}"
