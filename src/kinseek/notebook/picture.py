"""An arm as inline SVG, seen from the side and above, with lines in the text colour, legible on light and dark pages."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinseek.robots.chain import SerialChain, joint_points

Array = NDArray[np.float64]

_WIDTH, _HEIGHT, _MARGIN = 260.0, 240.0, 30.0
_AZIMUTH, _ELEVATION = np.deg2rad(-55.0), np.deg2rad(22.0)
_VIEW = np.array(
    [
        [-np.sin(_AZIMUTH), np.cos(_AZIMUTH), 0.0],
        [np.cos(_AZIMUTH) * np.sin(_ELEVATION), np.sin(_AZIMUTH) * np.sin(_ELEVATION), -np.cos(_ELEVATION)],
    ]
)
"""Projection from metres to the picture: to the right, and down."""
_AXES = ("#e5484d", "#2f9e62", "#3b82f6")
"""Colours of x, y and z: red, green and blue with contrast to white and black."""
_ROUND_LENGTHS = (1.0, 2.0, 5.0)


class Target(NamedTuple):
    """Target position of the tip, and the constrained axes of its orientation."""

    position: Array
    """Position [m], (3,)."""
    axes: Sequence[tuple[int, Array]]
    """The constrained axes: their indices and directions, (3,)."""


class Outline(NamedTuple):
    """A convex shape of a body."""

    corners: Array
    """Points whose hull is drawn, (k, 3) [m]."""
    hit: bool
    """Does the arm hit it?"""


def draw(
    chain: SerialChain,
    rows: Array,
    tool: Array | None = None,
    target: Target | None = None,
    bodies: Sequence[Outline] = (),
) -> str:
    """Draw an arm at joint values, the first of them solid and the others faint, with its shadow on the floor.

    Args:
        chain: The arm.
        rows: Joint values, (k, n), k at least 1, [rad] or [m].
        tool: T_tip_tool, (4, 4), lengths in [m].
        target: Target of the tip.
        bodies: Shapes around it.
    """
    arms = [joint_points(chain, q) for q in rows]
    tips = chain.forward(np.ascontiguousarray(rows))
    if tool is not None:
        tips = tips @ tool
        arms = [np.concatenate([points, tip[None, :3, 3]]) for points, tip in zip(arms, tips, strict=True)]
    around = [body.corners for body in bodies]
    every = np.concatenate([*arms, *around] if target is None else [*arms, *around, target.position[None]])
    floor = float(min(every[:, 2].min(), 0.0))
    tile = _tile(every, floor)
    drawing = _Drawing(np.concatenate([every, tile]))
    axis_length = 22.0 / drawing.scale
    parts = [drawing.line(tile, 'stroke-width="0.8" opacity="0.35"')]
    for body in bodies:
        style = f'fill="{_AXES[0]}" stroke="{_AXES[0]}"' if body.hit else 'fill="currentColor"'
        parts.append(drawing.hull(body.corners, f'{style} fill-opacity="0.12" stroke-opacity="0.5"'))
    for points in reversed(arms[1:]):
        parts.append(drawing.line(points, 'stroke-width="2.5" opacity="0.3"'))
    parts.append(drawing.line(_on(arms[0], floor), 'stroke-width="5" opacity="0.13"'))
    parts.append(drawing.line(arms[0], 'stroke-width="4.5" opacity="0.8"'))
    parts += [drawing.dot(point, 3.4) for point in arms[0][1:-1]]
    parts += [drawing.arrow(tips[0, :3, 3], tips[0, :3, i] * axis_length, _AXES[i], "") for i in range(3)]
    if target is not None:
        parts.append(
            drawing.line(
                np.stack([tips[0, :3, 3], target.position]), 'stroke-width="1" stroke-dasharray="2 3"'
            )
        )
        parts += [
            drawing.arrow(target.position, axis * 1.5 * axis_length, _AXES[i], ' stroke-dasharray="3 2"')
            for i, axis in target.axes
        ]
        parts.append(drawing.ring(target.position))
    parts.append(drawing.rule())
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{_WIDTH:.0f}" height="{_HEIGHT:.0f}" role="img" '
        f'viewBox="0 0 {_WIDTH:.0f} {_HEIGHT:.0f}" fill="none" stroke="currentColor" stroke-linecap="round" '
        f'stroke-linejoin="round"><title>An arm and where its tip is</title>{"".join(parts)}</svg>'
    )


class _Drawing:
    """The drawing area, scaled to points in metres that must all fit."""

    def __init__(self, points: Array) -> None:
        flat = points @ _VIEW.T
        low, high = flat.min(axis=0), flat.max(axis=0)
        room = np.array([_WIDTH, _HEIGHT - 14.0]) - 2 * _MARGIN
        self.scale = float((room / np.maximum(high - low, 1e-9)).min())
        self.shift = np.array([_WIDTH, _HEIGHT - 14.0]) / 2 - self.scale * (low + high) / 2

    def at(self, points: Array) -> Array:
        return np.asarray(points @ _VIEW.T * self.scale + self.shift)

    def line(self, points: Array, style: str) -> str:
        drawn = " ".join(f"{x:.1f},{y:.1f}" for x, y in self.at(points))
        return f'<polyline points="{drawn}" {style}/>'

    def hull(self, corners: Array, style: str) -> str:
        """Draw the convex hull of what is seen of points."""
        seen = sorted({(float(x), float(y)) for x, y in self.at(corners).round(1)})
        outline = [*_half_hull(seen), *_half_hull(seen[::-1])]
        drawn = " ".join(f"{x:.1f},{y:.1f}" for x, y in outline)
        return f'<polygon points="{drawn}" stroke-width="1" {style}/>'

    def dot(self, point: Array, radius: float) -> str:
        x, y = self.at(point)
        return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{radius}" fill="currentColor" stroke="none"/>'

    def ring(self, point: Array) -> str:
        x, y = self.at(point)
        return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="5.5" stroke-width="1.3"/>'

    def arrow(self, start: Array, along: Array, colour: str, style: str) -> str:
        (a, b), (c, d) = self.at(start), self.at(start + along)
        return (
            f'<line x1="{a:.1f}" y1="{b:.1f}" x2="{c:.1f}" y2="{d:.1f}" stroke="{colour}" '
            f'stroke-width="2.2"{style}/>'
        )

    def rule(self) -> str:
        """Draw a scale bar of a round length with its label."""
        length = max(
            factor * 10.0**power
            for power in range(-9, 9)
            for factor in _ROUND_LENGTHS
            if factor * 10.0**power * self.scale <= _WIDTH / 3 or (power, factor) == (-9, 1.0)
        )
        y, end = _HEIGHT - 8.0, 10.0 + length * self.scale
        words = f"{length:g} m" if length >= 0.1 else f"{length * 1000:g} mm"
        return (
            f'<path d="M10 {y - 3:.0f}v3H{end:.1f}v-3" stroke-width="1" opacity="0.6"/>'
            f'<text x="{end + 5:.1f}" y="{y + 2:.0f}" font-size="10" fill="currentColor" stroke="none" opacity="0.7">'
            f"{words}</text>"
        )


def _half_hull(points: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return one side of the convex hull of sorted points, without its last one (*Andrew 1979*, monotone chain)."""
    side: list[tuple[float, float]] = []
    for x, y in points:
        while len(side) > 1:
            (a, b), (c, d) = side[-2:]
            if (c - a) * (y - b) - (d - b) * (x - a) > 0.0:
                break
            side.pop()
        side.append((x, y))
    return side[:-1]


def _tile(points: Array, floor: float) -> Array:
    """Return the corners of a part of the floor below all points, with some margin, (5, 3)."""
    room = 0.08 * float(np.ptp(points, axis=0).max()) + 1e-9
    (a, b), (c, d) = points[:, :2].min(axis=0) - room, points[:, :2].max(axis=0) + room
    return np.array([[a, b, floor], [c, b, floor], [c, d, floor], [a, d, floor], [a, b, floor]])


def _on(points: Array, floor: float) -> Array:
    shadow = points.copy()
    shadow[:, 2] = floor
    return shadow
