"""Dense poses from a few key poses: straight lines with one turn, smooth corners, and circular arcs.

Between two key poses the position moves on a straight line, and the orientation turns about one fixed axis. A displacement
from a key pose has six numbers, x: a translation, and a rotation vector in the frame of the key pose. Every section of a
path is a quadratic polynomial x(t) with t from 0 to 1. A straight section is linear. A blend around a key pose has the
constant acceleration that changes the velocity of the straight section before it into that of the section after it: a
quadratic Bézier curve whose middle control point is the key pose (linear functions with parabolic blends: Taylor 1979;
Craig 2005, Sec. 7.3).

If a rotation vector x changes at the rate x', the orientation turns at most as fast as |x'|. The length of the linear
function x'(t) is greatest at one of its ends. So after division into n equal steps of t, consecutive poses are at most
max(|x'(0)|, |x'(1)|) / n apart.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable
from numbers import Real
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .errors import InvalidGoal, InvalidProblem
from .kernels.arm.pose_error import LARGEST
from .poses import as_pose, one_pose, row_of
from .support.interrupts import in_chunks
from .support.shapes import Poses
from .support.transforms import angles_between, quaternion, rotations
from .support.validation import as_number

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

MOST_POSES = 1_000_000
"""Most poses that one call makes, 128 MB. More are probably a mistake in a unit."""
OPPOSITE = 1e-6
"""Angles closer to π than this count as π [rad]: rounding of matrices would decide the direction."""
STRAIGHT = 1e-6
"""Three points count as on one line if the triangle's height over its longest side is less than this part of the side."""


def interpolate(poses: Any, *, step: float, turn: float, blend: float = 0.0) -> Poses:
    """Insert poses between key poses, on straight lines with one turn about a fixed axis each.

    Without `blend` the result contains every key pose, with the same bits. Equal consecutive poses are taken once.

    Args:
        poses: Key poses, (N, 4, 4), or a list of anything that is a pose.
        step: Largest distance of consecutive positions [m]; `math.inf` for no limit.
        turn: Largest angle between consecutive orientations [rad]; `math.inf` for no limit.
        blend: Radius around each key pose but the first and the last in which the path leaves the straight lines, and passes
            the key pose on a smooth curve [m]. The direction of motion is then continuous, and so is the angular velocity
            of motion at constant speed. At most half of the distance to each neighbour.

    Returns:
        Poses from the first key pose to the last, (k, 4, 4).

    Raises:
        InvalidGoal: Not poses, none, or a half turn between two key poses, which has two shortest ways.
        InvalidProblem: `step` or `turn` is not above 0, `blend` is negative or too large, the path turns back where it is
            blended, or there would be more than a million poses.
    """
    given = as_pose(poses)
    if given.ndim != 3 or not len(given):
        raise InvalidGoal(f"key poses must have shape (N, 4, 4) with at least one pose, got {given.shape}")
    step, turn = _positive("step", step, "m"), _positive("turn", turn, "rad")
    radius = as_number("blend", blend, 0.0, LARGEST, InvalidProblem)
    first = np.flatnonzero(
        np.r_[True, (given[1:] != given[:-1]).any(axis=(1, 2))]
    )  # Of equal consecutive poses.
    keys = given[first]
    moves = _moves(keys, [f"key pose {i}" for i in first] if len(keys) < len(given) else None)
    sections = _blended(moves, radius, first) if radius > 0.0 and len(moves) > 1 else _straight(moves)
    counts = _counts(sections.speeds, step, turn)

    def made(which: Indices, t: Array) -> Array:
        powers = t[:, None] ** np.arange(3)
        x = np.einsum("kp,kpi->ki", powers, sections.polynomials[which])
        anchors = keys[sections.anchors[which]]
        return _displaced(anchors, anchors[:, :3, 3] + x[:, :3], x[:, 3:])

    result = _assembled(keys[0], counts, made)
    ends = np.cumsum(counts)
    result[ends[sections.to_next_key]] = keys[sections.anchors[sections.to_next_key] + 1]
    return result


def arc(start: Any, via: Any, end: Any, *, step: float, turn: float) -> Poses:
    """Insert poses on the circular arc through the positions of three poses.

    The orientation turns about one fixed axis from `start` to `via`, and about another one from `via` to `end`, each in
    proportion to the way along the arc. The result contains the three poses with the same bits.

    Args:
        start: First pose, (4, 4), or anything that is a pose.
        via: A pose on the way, (4, 4).
        end: Last pose, (4, 4).
        step: Largest distance of consecutive positions [m]; `math.inf` for no limit.
        turn: Largest angle between consecutive orientations [rad]; `math.inf` for no limit.

    Returns:
        Poses from `start` over `via` to `end`, (k, 4, 4).

    Raises:
        InvalidGoal: Not poses, positions on one line, or a half turn of the orientation, which has two shortest ways.
        InvalidProblem: `step` or `turn` is not above 0, or there would be more than a million poses.
    """
    names = ["start", "via", "end"]
    keys = np.stack([one_pose(each, name) for each, name in zip((start, via, end), names, strict=True)])
    step, turn = _positive("step", step, "m"), _positive("turn", turn, "rad")
    moves = _moves(keys, names)
    circle = _circle_through(keys[:, :3, 3])
    angles = np.diff(circle.angles)
    speeds = np.stack([circle.radius * angles, np.linalg.norm(moves[:, 3:], axis=1)], axis=1)
    counts = _counts(speeds, step, turn)

    def made(which: Indices, t: Array) -> Array:
        position = circle.at(circle.angles[which] + t * angles[which])
        return _displaced(keys[which], position, t[:, None] * moves[which, 3:])

    result = _assembled(keys[0], counts, made)
    result[np.cumsum(counts)] = keys[1:]
    return result


class _Sections(NamedTuple):
    """The sections of a path, in order; see the beginning of this module."""

    anchors: Indices
    """Index of the key pose that displacements start from, (s,)."""
    polynomials: Array
    """Coefficients of 1, t and t² of the displacements, (s, 3, 6), [m] and [rad]."""
    to_next_key: NDArray[np.bool_]
    """Which sections end at the key pose after their anchor, (s,)."""

    @property
    def speeds(self) -> Array:
        """Greatest derivative of position and orientation by t, (s, 2), [m] and [rad]."""
        at_start = self.polynomials[:, 1]
        at_end = at_start + 2.0 * self.polynomials[:, 2]
        both = np.stack([at_start, at_end]).reshape(2, -1, 2, 3)
        return np.asarray(np.linalg.norm(both, axis=-1).max(axis=0))


def _straight(moves: Array) -> _Sections:
    count = len(moves)
    polynomials = np.zeros((count, 3, 6))
    polynomials[:, 1] = moves
    return _Sections(np.arange(count), polynomials, np.ones(count, dtype=np.bool_))


def _blended(moves: Array, radius: float, names: Indices) -> _Sections:
    """Make the sections of a path with blends; `names` are the indices of the key poses that users know, (N,)."""
    count = len(moves)
    lengths = np.linalg.norm(moves[:, :3], axis=1)
    if (short := lengths * (1.0 + 1e-12) < 2.0 * radius).any():
        worst = int(np.argmax(short))
        raise InvalidProblem(
            f"blend must be at most half of the distance between consecutive key poses, got {radius:g} m: key poses "
            f"{names[worst]} and {names[worst + 1]} are {lengths[worst]:.6g} m apart"
        )
    along = moves[:, :3] / lengths[:, None]
    back = angles_between(along[:-1], along[1:]) > math.pi - OPPOSITE
    if back.any():
        raise InvalidProblem(
            f"blend needs a path that does not turn back, but it turns back at key pose {names[np.argmax(back) + 1]}: "
            f"expected a bend of less than a half turn"
        )
    # The parts of each move at which its straight section begins and ends.
    part = np.minimum(radius / lengths, 0.5)
    low, high = np.r_[0.0, part[1:]], np.r_[1.0 - part[:-1], 1.0]
    polynomials = np.zeros((2 * count - 1, 3, 6))
    polynomials[::2, 0], polynomials[::2, 1] = low[:, None] * moves, (high - low)[:, None] * moves
    # Around a key pose, x(t) = -(1 - t)² before + t² after.
    before, after = part[:-1, None] * moves[:-1], part[1:, None] * moves[1:]
    polynomials[1::2] = np.stack([-before, 2.0 * before, after - before], axis=1)
    anchors, to_next_key = np.arange(2 * count - 1) + 1, np.zeros(2 * count - 1, dtype=np.bool_)
    anchors //= 2
    to_next_key[-1] = True
    kept = np.ones(2 * count - 1, dtype=np.bool_)
    kept[::2] = high - low > 1e-12  # Where two blends meet, nothing is straight.
    return _Sections(anchors[kept], polynomials[kept], to_next_key[kept])


class _Circle(NamedTuple):
    start: Array
    """A point of the circle, (3,), [m]."""
    outward: Array
    """Unit vector from the centre to this point, (3,)."""
    along: Array
    """Unit tangent at this point, (3,)."""
    radius: float
    """[m]."""
    angles: Array
    """Angles of the three given points from the first one, increasing from 0 to at most 2π, (3,), [rad]."""

    def at(self, angles: Array) -> Array:
        """Positions at angles from the first point, (k,) -> (k, 3), [m]."""
        # 1 - cos φ as 2 sin² φ/2: on a circle much larger than the arc the difference would be rounding alone.
        inward = 2.0 * np.sin(angles / 2.0)[:, None] ** 2 * self.outward
        return np.asarray(self.start + self.radius * (np.sin(angles)[:, None] * self.along - inward))


def _circle_through(points: Array) -> _Circle:
    """Return the circle through three points, (3, 3), [m]."""
    a, b = points[1] - points[0], points[2] - points[0]
    normal = np.cross(a, b)
    longest = float(np.linalg.norm([a, b, b - a], axis=1).max())
    if np.linalg.norm(normal) <= STRAIGHT * longest**2:
        raise InvalidGoal(
            "start, via and end of an arc must be three points that are not on one line, got "
            f"{', '.join(row_of(each) for each in points)}; kinseek.interpolate moves on straight lines"
        )
    to_centre = np.cross((a @ a) * b - (b @ b) * a, normal) / (2.0 * normal @ normal)
    radius = float(np.linalg.norm(to_centre))
    outward = -to_centre / radius
    along = np.cross(normal / np.linalg.norm(normal), outward)
    from_centre = points - points[0] - to_centre
    angles = np.arctan2(from_centre @ along, from_centre @ outward)
    return _Circle(
        points[0], outward, along, radius, np.array([0.0, *(angles[1:] % (2.0 * math.pi)).tolist()])
    )


def _moves(keys: Array, names: list[str] | None) -> Array:
    """Displacements from each key pose to the next, (N, 4, 4) -> (N - 1, 6), [m] and [rad].

    Raises:
        InvalidGoal: One of them is a half turn; the message has the names of the key poses, by default their indices.
    """
    turns = np.swapaxes(keys[:-1, :3, :3], -1, -2) @ keys[1:, :3, :3]
    wxyz = quaternion(turns)  # Precise up to a half turn, unlike the antisymmetric part of a matrix.
    sine = np.linalg.norm(wxyz[:, 1:], axis=1)
    angles = 2.0 * np.arctan2(sine, wxyz[:, 0])
    if (half := angles > math.pi - OPPOSITE).any():
        i = int(np.argmax(half))
        pair = f"{names[i]} and {names[i + 1]}" if names else f"key poses {i} and {i + 1}"
        raise InvalidGoal(
            f"the turn between {pair} must be less than a half turn, got {angles[i]:.7g} rad: the shortest way is not "
            "determined; insert a pose that says which way to turn"
        )
    # For a small angle, sine is half of it; of two equal orientations both are 0.
    per_sine = np.divide(angles, sine, out=np.zeros_like(angles), where=sine > 0.0)
    return np.hstack([np.diff(keys[:, :3, 3], axis=0), per_sine[:, None] * wxyz[:, 1:]])


def _counts(speeds: Array, step: float, turn: float) -> Indices:
    """Numbers of steps in sections with given greatest speeds, (s, 2) -> (s,)."""
    with np.errstate(over="ignore"):
        # Rounding may not add a step: 0.3 / 0.1 is a little more than 3.
        steps = np.ceil(speeds / [step, turn] * (1.0 - 1e-12)).max(axis=1)
    steps = np.maximum(steps, 1.0)
    total = float(steps.sum()) + 1.0
    if total > MOST_POSES:
        raise InvalidProblem(
            f"step={step:g} m and turn={turn:g} rad make {total:,.0f} poses, expected at most {MOST_POSES:,}; choose larger "
            "ones, or make the path in parts"
        )
    return np.asarray(steps.astype(np.intp))


def _assembled(start: Array, counts: Indices, made: Callable[[Indices, Array], Array]) -> Poses:
    """Make the first pose, and those after each of `counts` steps of every section: ``made(section, t)``, (k,) each."""
    result = np.empty((int(counts.sum()) + 1, 4, 4))
    result[0] = start
    which = np.repeat(np.arange(len(counts)), counts)
    number = np.arange(1, len(result)) - np.repeat(np.cumsum(counts) - counts, counts)
    if len(which):
        result[1:] = in_chunks(made, which, number / counts[which])
    return result


def _displaced(anchors: Array, positions: Array, turns: Array) -> Array:
    """Return poses at `positions`, (k, 3), turned from `anchors`, (k, 4, 4), by rotation vectors in their frames, (k, 3)."""
    result = np.zeros((len(anchors), 4, 4))
    result[:, :3, :3] = anchors[:, :3, :3] @ rotations(turns)
    result[:, :3, 3], result[:, 3, 3] = positions, 1.0
    return result


def _positive(name: str, value: Any, unit: str) -> float:
    number = math.nan
    if isinstance(value, Real) and not isinstance(value, bool):
        with contextlib.suppress(OverflowError):  # A whole number of any length.
            number = float(value)
    if number > 0.0:
        return number
    raise InvalidProblem(f"{name} must be a number above 0 [{unit}], got {value!r:.200}")
