"""Give a path its time: splines from stop to stop, each run as fast as the limits allow."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinseek.errors import InvalidProblem
from kinseek.robots.chain import SerialChain
from kinseek.robots.mechanism import Mechanism, no_axes
from kinseek.support.validation import as_number

from . import curve as curves
from . import law as laws
from .curve import Curve, parameters, spline
from .limits import LARGEST, Limits
from .obstacles import Obstacles
from .profile import fastest, in_intervals
from .tip import chain_to_tip, levers
from .trajectory import Trajectory

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Flags = NDArray[np.bool_]


COARSE = 65
"""Poses through which a spline from stop to stop goes at least."""

LEAST = 1e-12
"""Smallest tolerance, in place of 0."""

CLOSE = 1e-6
"""How near poses are that count as one, if the motion between poses farther from each other is not free [rad or m]."""

EXACT = 1e-9
"""How far the joints of black-box kinematics may pass the poses [rad or m]: how this moves the tip is not known."""


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
    tolerances: tuple[float, float]
    """How far the tip may pass the poses, [m] and [rad]."""

    @property
    def ends(self) -> tuple[Array, Array]:
        """Limits of the joints, (n,) each; infinite for continuous joints."""
        endless = self.arm.endless
        return np.where(endless, -np.inf, self.arm.lower), np.where(endless, np.inf, self.arm.upper)


def weights_of(chain: SerialChain | None, way: Way) -> Array:
    """Return how much of the tolerances a unit of motion of each joint uses up at most, (n, 2): position and orientation."""
    if chain is None:
        return np.full((way.arm.dof, 1), 1.0 / EXACT)
    reach, turn = np.zeros(way.arm.dof), np.zeros(way.arm.dof)
    scale = np.abs(chain.multiplier)
    np.add.at(reach, chain.leader, scale * levers(chain))
    np.add.at(turn, chain.leader, np.where(chain.prismatic, 0.0, scale))
    return np.asarray(np.stack([reach, turn], axis=1) / np.maximum(way.tolerances, LEAST))


def timed(way: Way, limits: Limits, tip_speeds: tuple[float, float]) -> Trajectory:
    """Run through joint values as fast as limits allow, see `Path.timed`.

    Args:
        way: The joint values.
        limits: The limits.
        tip_speeds: Speeds of the tip at the start and at the end [m/s].

    Raises:
        InvalidProblem: The speed at an end cannot be kept; or the tip has no axes but a speed; or the motion across a break
            is not free of collision; or a step, or the only joint values, are not any more.
    """
    chain = chain_to_tip(way.arm, way.tool)
    if chain is None and (limits.tool_speed is not None or any(tip_speeds)):
        raise InvalidProblem(no_axes(way.arm, "the speed of the tip is computed from axes and links"))
    for name, speed in zip(("start_velocity", "end_velocity"), tip_speeds, strict=True):
        as_number(name, speed, 0.0, LARGEST, InvalidProblem)
    places = parameters(way.q, limits.velocity)
    # Poses with nearly equal joint values are passed at the same time: the way between them has no direction.
    # |dq| w <= |dq / v| |w v| (Cauchy and Schwarz), so that they differ by less than the tolerances.
    weights = weights_of(chain, way)
    apart = float(1.0 / np.linalg.norm(weights * limits.velocity[:, None], axis=0).max())
    scaled, fastest_joint = way.q / limits.velocity, float(limits.velocity.max())
    apart = max(apart, EXACT / fastest_joint)
    rows = spaced(places, scaled, way.breaks, apart)
    if len(rows) == 1:
        if way.scene is not None and not way.scene.free(way.q[0], way.clearance):
            raise InvalidProblem(
                "the path does not move, and its joint values are not free of collision. If the scene has changed since the "
                "path was planned, plan it again"
            )
        nowhere = np.zeros(0, dtype=np.int64)
        return Trajectory(
            way.arm, limits, nowhere, way.tool, curves.rest(way.q[0]), laws.rest(), 0.0 * places
        )
    every = spaced(places, scaled, way.breaks, min(apart, CLOSE / fastest_joint))
    runs, stops = _free_curves(way, weights, (places, rows, every), limits)
    total = sum(len(run.widths) for run in runs)
    divided = [in_intervals(run, total, limits) for run in runs]
    law, curve = _law(chain, divided, limits, tip_speeds), curves.joined(divided)
    return Trajectory(way.arm, limits, stops, way.tool, curve, law, np.clip(places, 0.0, curve.knots[-1]))


def _free_curves(
    way: Way, weights: Array, poses: tuple[Array, Indices, Indices], limits: Limits
) -> tuple[list[Curve], Indices]:
    """Return splines from stop to stop, proved free in the scene, and the inner poses with stops, (k,).

    Steps whose spline is not free become straight, until all splines are. A straight step must be one of the path, so poses
    that are nearly equal are kept if one of them is blocked.

    Args:
        way: The joint values.
        weights: See `weights_of`, (n, 2).
        poses: Positions of the poses on the curve, (N,); those that are not nearly equal to the one before, (m,); and those
            that are not even nearer to it, (k,).
        limits: The limits.

    Raises:
        InvalidProblem: A step that is straight from the beginning is not free; or one of the path is not free any more.
    """
    places, rows, every = poses
    s, q, ends_of_joints = places[rows], way.q[rows], way.ends
    # Would a straight step pass by poses of the path?
    passed_by = np.searchsorted(every, rows[1:]) > np.searchsorted(every, rows[:-1], side="right")
    straight = np.isin(rows[1:], way.breaks + 1)
    if len(blocked := _blocked(way, q, np.flatnonzero(straight))):
        if passed_by[blocked].any():
            return _free_curves(way, weights, (places, every, every), limits)
        raise InvalidProblem(
            f"at the break after pose {rows[blocked[0]]} the linear motion of the joints is not free of collision, so the "
            f"path has no motion in time"
        )
    stops, whole = np.zeros(len(rows), dtype=np.bool_), np.zeros(len(rows), dtype=np.bool_)
    while True:
        stops[:-1] |= straight
        stops[1:] |= straight
        stops[0] = stops[-1] = True
        at = np.flatnonzero(stops)
        found, knots = [], []
        for i, j in pairwise(at):
            kept, curve, jumps = thinned(
                s[i : j + 1], q[i : j + 1], whole[i : j + 1], weights, ends_of_joints
            )
            found.append(curve)
            knots.append(i + kept)
            if limits.jerk is not None:
                # Where the second derivative jumps, the jerk is finite only at rest.
                stops[i + kept[jumps]] = True
        if stops.sum() > len(at):
            continue
        stops[0] = stops[-1] = False
        if way.scene is None:
            return found, rows[stops]
        begins, ends = np.concatenate([k[:-1] for k in knots]), np.concatenate([k[1:] for k in knots])
        curved = ~((ends == begins + 1) & straight[begins])
        around = np.concatenate([curve.deviation for curve in found])[curved]
        free = np.asarray(way.scene.free_motion(q[begins[curved]], q[ends[curved]], way.clearance, around))
        if free.all():
            if len(blocked := _blocked(way, q, begins[~curved])):
                raise InvalidProblem(
                    f"the step from pose {rows[blocked[0]]} to pose {rows[blocked[0] + 1]} is not free of collision, so the "
                    f"path has no motion in time. If the scene has changed since the path was planned, plan it again"
                )
            return found, rows[stops]
        for i, j in zip(begins[curved][~free], ends[curved][~free], strict=True):
            if j == i + 1 and passed_by[i]:
                return _free_curves(way, weights, (places, every, every), limits)
            # First the spline passes all poses of the piece, then the motion is linear.
            straight[i] |= j == i + 1
            whole[i : j + 1] = True


def _blocked(way: Way, q: Array, steps: Indices) -> Indices:
    """Return the steps on which linear motion from one row of q, (m, n), to the next is not free of collision."""
    if way.scene is None or not len(steps):
        return steps[:0]
    free: Flags = np.asarray(way.scene.free_motion(q[steps], q[steps + 1], way.clearance))
    return steps[~free]


def spaced(places: Array, scaled: Array, breaks: Indices, apart: float) -> Indices:
    """Return the poses that are more than a distance behind the one returned before, and the first one after each break.

    Those that come back to within half this distance of the one returned before are not returned: the motion to them would
    have no direction. The last pose before a break, and that of the path, take the place of the one that is returned last,
    which is as near to them. A break between poses that are nearly equal is none.

    Args:
        places: Positions of the poses, not decreasing, (N,).
        scaled: Their joint values, (N, n), in units in which the positions are lengths.
        breaks: Poses before breaks, (k,).
        apart: The distance.
    """
    steps = np.linalg.norm(np.diff(scaled, axis=0), axis=1)
    if (steps > apart).all():
        return np.arange(len(places))
    ends = breaks[steps[breaks] > apart].tolist()
    rows = list[int]()
    for first, last in zip([0, *(end + 1 for end in ends)], [*ends, len(places) - 1], strict=True):
        kept, ahead = [first], first
        while True:
            ahead = int(np.searchsorted(places[: last + 1], places[kept[-1]] + apart, side="right"))
            while ahead <= last and _distance(scaled, kept[-1], ahead) <= apart / 2:
                ahead += 1
            if ahead > last:
                break
            kept.append(ahead)
        if len(kept) > 1:
            kept.pop()
            if _distance(scaled, kept[-1], last) > apart / 2:
                kept.append(last)
        rows += kept
    return np.array(rows)


def _distance(rows: Array, i: int, j: int) -> float:
    """Return the distance of two rows, (N, n)."""
    return float(np.linalg.norm(rows[i] - rows[j]))


def thinned(
    s: Array, q: Array, whole: Flags, weights: Array, limits: tuple[Array, Array]
) -> tuple[Indices, Curve, Indices]:
    """Choose the poses through which a spline has to go to pass all others within the tolerances.

    Joint values contain rounding errors, which would make the spline curved if it passed many close poses exactly. The poses
    are chosen from coarse to fine: where the spline misses some by too much, the one in the middle is added.

    Args:
        s: Positions of the poses, increasing, (k,), k >= 2.
        q: Their joint values, (k, n).
        whole: Whether the spline has to go through each pose exactly, (k,).
        weights: See `weights_of`, (n, 2).
        limits: Limits of the joints, (n,) each.

    Returns:
        The poses, (m,), the spline, and those of the poses at which its second derivative jumps, (j,).
    """
    last = len(s) - 1
    kept = whole.copy()
    kept[np.clip(np.searchsorted(s, np.linspace(s[0], s[-1], COARSE)), 0, last)] = True
    kept[[0, last]] = True
    while True:
        knots = np.flatnonzero(kept)
        curve, jumps = spline(s[knots], q[knots], *limits)
        left = np.flatnonzero(~kept)
        piece = np.searchsorted(knots, left) - 1
        off = np.abs(curve.at(s[left], piece) - q[left])
        missed = (off @ weights > 1.0).any(axis=1)
        if not missed.any():
            return knots, curve, jumps
        for k in np.unique(piece[missed]):
            kept[(knots[k] + knots[k + 1]) // 2] = True


def _law(
    chain: SerialChain | None, runs: list[Curve], limits: Limits, tip_speeds: tuple[float, float]
) -> laws.Law:
    """Return the law of the fastest motion along curves, from rest to rest but for the first start and the last end."""
    last = len(runs) - 1
    return laws.joined(
        [
            fastest(
                run,
                limits,
                chain,
                (tip_speeds[0] if i == 0 else 0.0, tip_speeds[1] if i == last else 0.0),
            )
            for i, run in enumerate(runs)
        ]
    )
