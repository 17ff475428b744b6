"""Give a path its time: splines from stop to stop, each run as fast as the limits allow."""

from __future__ import annotations

from itertools import pairwise
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from kinseek.errors import InvalidProblem
from kinseek.robots.chain import SerialChain, with_tool
from kinseek.robots.mechanism import Mechanism, no_axes
from kinseek.support.validation import as_number

from . import curve as curves
from . import law as laws
from .curve import Curve, spline
from .limits import Limits
from .profile import fastest, parts_for
from .trajectory import Trajectory

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Flags = NDArray[np.bool_]


class Obstacles(Protocol):
    """The method of a scene that a motion uses."""

    def free_motion(self, q0: Any, q1: Any, clearance: float = 0.0, around: Any = None) -> Any:
        """See `Scene.free_motion`."""


class Way(NamedTuple):
    """The joint values of a path."""

    arm: Mechanism
    tool: Array | None
    """Pose of the tool at the tip, (4, 4)."""
    q: Array
    """(N, n), [rad] or [m]"""
    breaks: Indices
    """Steps from pose i to pose i + 1 on which the joints move linearly, from rest to rest, (k,)."""
    scene: Obstacles | None
    clearance: float
    """Minimum distance of bodies in the scene [m]."""

    @property
    def chain(self) -> SerialChain | None:
        """The arm up to the tip or the tool; None for black-box kinematics."""
        axes = self.arm.axes
        return axes if axes is None or self.tool is None else with_tool(axes, self.tool)

    @property
    def ends(self) -> tuple[Array, Array]:
        """Limits of the joints, (n,) each; infinite for continuous joints."""
        endless = self.arm.endless
        return np.where(endless, -np.inf, self.arm.lower), np.where(endless, np.inf, self.arm.upper)


def timed(way: Way, limits: Limits, tip_speeds: tuple[float, float]) -> Trajectory:
    """Run through joint values as fast as limits allow, see `Path.timed`.

    Args:
        way: The joint values.
        limits: The limits.
        tip_speeds: Speeds of the tip at the start and at the end [m/s].

    Raises:
        InvalidProblem: The speed at an end cannot be kept; or the tip has no axes but a speed; or the motion across a break
            is not free of collision.
    """
    if way.chain is None and (limits.tool_speed is not None or any(tip_speeds)):
        raise InvalidProblem(no_axes(way.arm, "the speed of the tip is computed from axes and links"))
    for name, speed in zip(("start_velocity", "end_velocity"), tip_speeds, strict=True):
        as_number(name, speed, 0.0, np.inf, InvalidProblem)
    # Poses with equal joint values are passed at the same time.
    moves = (np.diff(way.q, axis=0) != 0.0).any(axis=1)
    knots = np.concatenate([[0], np.cumsum(moves)])
    rows = np.ascontiguousarray(way.q[np.concatenate([[True], moves])])
    straight = np.zeros(max(len(rows) - 1, 0), dtype=np.bool_)
    way = way._replace(breaks=way.breaks[moves[way.breaks]])
    straight[knots[way.breaks]] = True
    if not len(straight):
        curve, law, stops, ends = curves.rest(rows[0]), laws.rest(), straight, np.zeros(1, dtype=np.int64)
    else:
        runs, stops = _free_curves(way, rows, straight, limits)
        parts = [parts_for(len(run.widths), len(straight), limits) for run in runs]
        divided = [run.divided(k) for run, k in zip(runs, parts, strict=True)]
        law, curve = _law(way, divided, limits, tip_speeds), curves.joined(divided)
        ends = np.cumsum(np.concatenate([[0], np.repeat(parts, [len(run.widths) for run in runs])]))
    inner = np.searchsorted(knots, np.flatnonzero(stops), side="left")
    return Trajectory(way.arm, limits, law.times[ends][knots], inner, way.tool, curve, law, ends[knots])


def _free_curves(way: Way, rows: Array, straight: Flags, limits: Limits) -> tuple[list[Curve], Flags]:
    """Return splines from stop to stop, proved free in the scene, and flags of the inner points with stops, (k,).

    Steps whose spline is not free become straight, until all splines are.

    Raises:
        InvalidProblem: A step that is straight from the beginning is not free.
    """
    if way.scene is not None and straight.any():
        steps = np.flatnonzero(straight)
        free = np.asarray(way.scene.free_motion(rows[steps], rows[steps + 1], way.clearance))
        if not free.all():
            raise InvalidProblem(
                f"at the break after pose {way.breaks[np.flatnonzero(~free)[0]]} the linear motion of the joints is not "
                f"free of collision, so the path has no motion in time"
            )
    stops = np.zeros(len(rows), dtype=np.bool_)
    while True:
        stops[:-1] |= straight
        stops[1:] |= straight
        stops[0] = stops[-1] = True
        at = np.flatnonzero(stops)
        found = [spline(rows[i : j + 1], limits.velocity, *way.ends) for i, j in pairwise(at)]
        jumps = np.concatenate([i + jump for i, (_, jump) in zip(at, found, strict=False)])
        if limits.jerk is not None and len(jumps):
            # Where the second derivative jumps, the jerk is finite only at rest.
            stops[jumps] = True
            continue
        runs = [curve for curve, _ in found]
        stops[0] = stops[-1] = False
        if way.scene is None:
            return runs, stops
        curved = np.flatnonzero(~straight)
        around = np.concatenate([run.deviation for run in runs])[curved]
        free = np.asarray(way.scene.free_motion(rows[curved], rows[curved + 1], way.clearance, around))
        if free.all():
            return runs, stops
        straight[curved[~free]] = True


def _law(way: Way, runs: list[Curve], limits: Limits, tip_speeds: tuple[float, float]) -> laws.Law:
    """Return the law of the fastest motion along curves, from rest to rest but for the first start and the last end."""
    last = len(runs) - 1
    return laws.joined(
        [
            fastest(
                run,
                limits,
                way.chain,
                (tip_speeds[0] if i == 0 else 0.0, tip_speeds[1] if i == last else 0.0),
            )
            for i, run in enumerate(runs)
        ]
    )
