"""A curve through joint values: cubic polynomials from pose to pose, with continuous first and second derivatives."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinseek.kernels.timing.spline import divide_pieces, spline_slopes

from . import bernstein

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

ENDS, EVEN = 4, 4.0
"""Most points that determine the slope at an end, which is that of the polynomial through them; and the largest ratio of the
distances between them: an extrapolation from close points to a far one swings out."""


class Curve(NamedTuple):
    """Joint values q(s) in m pieces, each a cubic polynomial."""

    knots: Array
    """Increasing ends of the pieces, (m + 1,)."""
    begins: Array
    """Joint values at the begin of each piece, (m, n), [rad] or [m]."""
    slopes: Array
    """Bernstein coefficients of dq/ds on each piece, (m, n, 3)."""

    @property
    def widths(self) -> Array:
        """Widths of the pieces, (m,)."""
        return np.diff(self.knots)

    @property
    def coefficients(self) -> Array:
        """Bernstein coefficients of q on each piece, (m, n, 4)."""
        inner = self.begins[..., None] + np.cumsum(self.slopes, axis=2) * self.widths[:, None, None] / 3.0
        return np.concatenate([self.begins[..., None], inner], axis=2)

    @property
    def values(self) -> Array:
        """Joint values at all knots, (m + 1, n)."""
        return np.concatenate([self.begins, self.coefficients[-1:, :, 3]])

    def rates(self, order: int) -> Array:
        """Return the Bernstein coefficients of a derivative with respect to s on each piece, (m, n, 4 - order)."""
        rates = self.slopes if order else self.coefficients
        for _ in range(order - 1):
            rates = bernstein.derivative(rates) / self.widths[:, None, None]
        return rates

    def at(self, s: Array, piece: Indices, order: int = 0) -> Array:
        """Return q, or a derivative with respect to s, at points, (k,), of given pieces, (k,), as (k, n)."""
        share = (s - self.knots[piece]) / self.widths[piece]
        return bernstein.value(self.rates(order)[piece], share[:, None])

    @property
    def deviation(self) -> Array:
        """How far each joint is at most from linear motion along each piece, (m, n), [rad] or [m]."""
        return deviation(self.coefficients)

    def divided(self, parts: int) -> Curve:
        """Return the same curve with each piece divided into equal parts."""
        if parts == 1:
            return self
        count, dof = self.begins.shape
        begins, slopes = np.empty((count, parts, dof)), np.empty((count, parts, dof, 3))
        divide_pieces(self.begins, self.slopes, self.widths, begins, slopes)
        knots = self.knots[:-1, None] + np.arange(parts) / parts * self.widths[:, None]
        return Curve(np.append(knots, self.knots[-1]), begins.reshape(-1, dof), slopes.reshape(-1, dof, 3))

    def cut(self, places: Array) -> Curve:
        """Return the same curve with more knots, (k,), increasing."""
        knots = np.union1d(self.knots, places[(places > self.knots[0]) & (places < self.knots[-1])])
        piece = np.clip(np.searchsorted(self.knots, knots[:-1], side="right") - 1, 0, len(self.begins) - 1)
        width = self.widths[piece]
        a, b = ((ends - self.knots[piece]) / width for ends in (knots[:-1], knots[1:]))
        d0, d1, d2 = np.moveaxis(self.slopes[piece], 2, 0)
        # The blossom at two arguments, see `kernels.timing.spline.divide_pieces`.
        ends = [((1 - s) * (1 - t), (1 - s) * t + s * (1 - t), s * t) for s, t in ((a, a), (a, b), (b, b))]
        slopes = [u[:, None] * d0 + v[:, None] * d1 + w[:, None] * d2 for u, v, w in ends]
        return Curve(knots, self.at(knots[:-1], piece), np.stack(slopes, axis=-1))


def deviation(coefficients: Array) -> Array:
    """Return how far cubic polynomials, (..., 4), are at most from linear ones between the same ends, (...)."""
    begin, inner1, inner2, end = np.moveaxis(coefficients, -1, 0)
    off = np.maximum(np.abs(inner1 - (2.0 * begin + end) / 3.0), np.abs(inner2 - (begin + 2.0 * end) / 3.0))
    # The two inner basis polynomials add up to 3 s (1 - s), at most 3/4.
    return np.asarray(0.75 * off)


def parameters(q: Array, speeds: Array) -> Array:
    """Return the lengths of polygons from the first of some joint values, (k, n), to each, (k,).

    Each joint is measured by its speed, (n,): so a length is about the time that the motion takes at full speed.
    """
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(q, axis=0) / speeds, axis=1))])


def spline(knots: Array, q: Array, lower: Array, upper: Array) -> tuple[Curve, Indices]:
    """Return the cubic spline through joint values.

    Where the spline would leave the limits of a joint, its slopes are reduced, and its second derivative is no longer
    continuous.

    Args:
        knots: Increasing, (k,), k >= 2.
        q: Joint values at the knots, (k, n).
        lower: Lower limits of the joints, (n,), -inf for none; q may lie outside by rounding.
        upper: Upper limits, (n,).

    Returns:
        The curve, and its inner points at which the second derivative jumps, (j,).
    """
    width = np.diff(knots)[:, None]
    below, above = 3.0 * np.maximum(q - lower, 0.0), 3.0 * np.maximum(upper - q, 0.0)
    # The inner coefficients of a piece, q + m width / 3 at its begin and q - m width / 3 at its end, stay inside the limits,
    # and with them the curve.
    most, least = np.full(q.shape, np.inf), np.full(q.shape, -np.inf)
    most[:-1], least[:-1] = above[:-1] / width, -below[:-1] / width
    most[1:], least[1:] = np.minimum(most[1:], below[1:] / width), np.maximum(least[1:], -above[1:] / width)
    slopes, ends = np.empty_like(q), [0, -1]
    slopes[ends] = _end_slope(knots, q), _end_slope(knots[::-1], q[::-1])
    slopes[ends] = np.clip(slopes[ends], least[ends], most[ends])
    spline_slopes(knots, q, slopes)
    kept = np.clip(slopes, least, most)
    begin, end = kept[:-1], kept[1:]
    # The mean of the coefficients is the mean slope.
    inner = 3.0 * np.diff(q, axis=0) / width - begin - end
    jumps = np.flatnonzero((kept != slopes)[1:-1].any(axis=1)) + 1
    return Curve(knots, q[:-1], np.stack([begin, inner, end], axis=-1)), jumps


def _end_slope(knots: Array, q: Array) -> Array:
    """Return the slope at the first point of the polynomial through the first points, (n,)."""
    near = knots[:ENDS] - knots[0]
    widths = np.diff(near)
    count = 2
    while count < len(near) and widths[:count].max() <= EVEN * widths[:count].min():
        count += 1
    return np.asarray(np.linalg.solve(np.vander(near[:count], increasing=True), q[:count])[1])


def joined(curves: list[Curve]) -> Curve:
    """Return curves that begin where the one before ends, as one."""
    knots = [curve.knots[:-1] for curve in curves] + [curves[-1].knots[-1:]]
    begins, slopes = ([curve[k] for curve in curves] for k in (1, 2))
    return Curve(np.concatenate(knots), np.concatenate(begins), np.concatenate(slopes))


def rest(q: Array) -> Curve:
    """Return the curve of an arm that stays where it is, (n,)."""
    return Curve(np.array([0.0, 1.0]), q[None], np.zeros((1, len(q), 3)))
