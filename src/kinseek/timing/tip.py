"""Bounds of the motion of the tip along a curve, from the lengths of the arm.

A joint turns the rest of the arm about its axis, so each derivative of the tip's position p with respect to joint values is
a product of axes with the vector from the axis of the outermost of these joints to the tip. This vector is not longer than
the lever of that joint. With R(a, b) = Σ r[max(i, j)] a[i] b[j] for the levers r and bounds a, b of |q'|, |q''|, ...::

    |p''| <= Σ r q'' + R(q', q')        |p'''| <= Σ r q''' + 3 R(q', q'') + R(q', q') Σ q'

"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinseek.kernels.arm.forward import forward_many
from kinseek.kernels.arm.jacobian import jacobian_many
from kinseek.robots.chain import SerialChain, with_tool
from kinseek.robots.mechanism import Mechanism

from .curve import Curve

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

MOST_PARTS = 2**12
"""Largest number of parts of a piece for which the distance of the tip from a line is bounded."""

INNER = 4
"""Parts of a piece at whose ends the speed of the tip is computed."""

SAME_SLOPE = 1e-6
"""Relative difference of the slopes of two pieces, up to which rounding explains it."""

NOTHING = 1e-12
"""Distances below this are not bounded more closely [m]."""

CLOSE = 0.5
"""A bound of the distance is at most 1 / (1 - CLOSE) times the true one."""


def chain_to_tip(arm: Mechanism, tool: Array | None) -> SerialChain | None:
    """Return the arm up to its tip, or to a tool at it, (4, 4); None for black-box kinematics."""
    return arm.axes if arm.axes is None or tool is None else with_tool(arm.axes, tool)


def levers(chain: SerialChain) -> Array:
    """Return how far a unit of motion of each physical joint moves the tip at most, (m,), [m] or 1; never increasing."""
    ends = np.abs(chain.multiplier * np.stack([chain.lower, chain.upper])[:, chain.leader] + chain.offset)
    slides = np.where(chain.prismatic, ends.max(axis=0), 0.0)
    beyond = np.linalg.norm(chain.fixed[1:, :, 3], axis=1) + np.append(slides[1:], 0.0)
    lengths = np.cumsum(beyond[::-1])[::-1]
    lever = np.where(chain.prismatic, 1.0, lengths)
    return np.asarray(np.maximum.accumulate(lever[::-1])[::-1])


class TipBounds:
    """Bounds of the second and third derivative of the tip's position on pieces of a curve, (m,) each."""

    def __init__(self, chain: SerialChain, curve: Curve) -> None:
        """Bound the derivatives of the physical joints, and with them those of the tip."""
        lever = levers(chain)
        scale = np.abs(chain.multiplier)
        first, second, third = (
            scale * np.abs(curve.rates(order)).max(axis=2)[:, chain.leader] for order in (1, 2, 3)
        )
        turned = _pairs(lever, first, first)
        self.second = second @ lever + turned
        """Bound of |p''|, (m,)."""
        self.third = third @ lever + 3.0 * _pairs(lever, first, second) + turned * first.sum(axis=1)
        """Bound of |p'''|, (m,)."""


def _pairs(lever: Array, a: Array, b: Array) -> Array:
    """Return R(a, b) of rows a and b, (m, joints) each, (m,)."""
    inside_a, inside_b = np.cumsum(a, axis=1) - a, np.cumsum(b, axis=1) - b
    return np.asarray((a * inside_b + inside_a * b + a * b) @ lever)


def speed_bounds(chain: SerialChain, curve: Curve) -> tuple[Array, Array]:
    """Bound the squared speed of the tip, |p'|², on each piece by a linear function.

    Returns:
        Its values at the ends of the pieces, (m, 2); and |p'|² itself at all knots, (m + 1,).
    """
    fine = curve.divided(INNER)
    rate = np.concatenate([fine.slopes[:, :, 0], fine.slopes[-1:, :, 2]])
    velocity = np.einsum("kij,kj->ki", jacobian_many(chain.arrays, fine.values)[:, :3], rate)
    square = (velocity**2).sum(axis=1)
    knots, bounds, width = square[::INNER], TipBounds(chain, curve), curve.widths / INNER
    begins, ends = knots[:-1], knots[1:].copy()
    # At a stop the direction of motion changes, and the piece before it ends with another one.
    turns = np.abs(curve.slopes[1:, :, 0] - curve.slopes[:-1, :, 2]).max(axis=1)
    stops = np.flatnonzero(turns > SAME_SLOPE * np.abs(curve.slopes).max())
    before = np.einsum(
        "kij,kj->ki", jacobian_many(chain.arrays, curve.begins[stops + 1])[:, :3], curve.slopes[stops, :, 2]
    )
    ends[stops] = (before**2).sum(axis=1)
    # Between two points linear interpolation deviates by at most h²/8 of the second derivative, 2 |p''|² + 2 p' p'''.
    inner = np.arange(INNER) / INNER
    above = square[:-1].reshape(-1, INNER) - begins[:, None] - inner * (ends - begins)[:, None]
    speed = np.sqrt(square[:-1].reshape(-1, INNER).max(axis=1)) + INNER * width * bounds.second
    over = above.max(axis=1) + width**2 / 4.0 * (bounds.second**2 + speed * bounds.third)
    return np.stack([begins + over, ends + over], axis=1), knots


def line_distance(chain: SerialChain, curve: Curve, poses: Indices) -> Array:
    """Bound the distance of the tip from the straight lines between some knots, for each piece of a curve, (m,), [m].

    The distance is measured at points of the piece; between them it differs by at most ``h²/8`` of a bound of the second
    derivative, as the distance from a line segment is convex. Pieces that might have the largest distance are divided.

    Args:
        chain: The arm up to its tip.
        curve: The curve.
        poses: The knots, increasing, from the first to the last, (k,).
    """
    count, coefficients = len(curve.widths), curve.coefficients
    rest = TipBounds(chain, curve).second * curve.widths**2 / 8.0
    ends = _positions(chain, curve.values[poses])
    line = np.searchsorted(poses, np.arange(count), side="right") - 1
    origin, along = ends[line], ends[line + 1] - ends[line]
    length = np.maximum((along**2).sum(axis=1), 1e-300)
    lowest, bound, parts, active = np.zeros(count), np.full(count, np.inf), 1, np.arange(count)
    while len(active) and parts <= MOST_PARTS:
        points = _positions(chain, _on_pieces(coefficients[active], np.arange(parts + 1) / parts))
        away = points - origin[active, None]
        share = np.clip((away * along[active, None]).sum(axis=2) / length[active, None], 0.0, 1.0)
        distance = np.linalg.norm(away - share[..., None] * along[active, None], axis=2)
        lowest[active] = distance.max(axis=1)
        bound[active] = lowest[active] + rest[active] / parts**2
        # Only pieces matter whose bound exceeds the largest distance by too much.
        active = np.flatnonzero(bound * CLOSE > max(lowest.max(), NOTHING))
        parts *= 4
    return bound


def _on_pieces(coefficients: Array, shares: Array) -> Array:
    """Return points of pieces, (k, n, 4), at the same fractions, (l,), of each, (k, l, n)."""
    s = shares[:, None]
    basis = np.concatenate([(1 - s) ** 3, 3 * s * (1 - s) ** 2, 3 * s**2 * (1 - s), s**3], axis=1)
    return np.asarray(np.einsum("lc,knc->kln", basis, coefficients))


def _positions(chain: SerialChain, q: Array) -> Array:
    """Return the positions of the tip at q, (..., n), as (..., 3), [m]."""
    flat = np.ascontiguousarray(q.reshape(-1, q.shape[-1]))
    return forward_many(chain.arrays, flat)[:, :3, 3].reshape(*q.shape[:-1], 3)
