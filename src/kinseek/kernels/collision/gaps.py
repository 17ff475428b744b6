"""How far two parts are apart: bounds from both sides, each of them a proof.

From below: every shape lies in its outer spheres, in its core, and on one side of each plane that its farthest corner in a
direction lies in. From above: inner spheres, and points that are in a part for sure.
"""

from __future__ import annotations

import math

from kinseek.kernels.arrays import Array
from kinseek.kernels.jit import hidden

from .cell import LANES, Cell, Here, place

FREE, TOUCH, DOUBT = 1, 0, 2


@hidden
def beyond_core(into: Array, half: Array, x: float, y: float, z: float) -> float:
    """Distance of a point from a core."""
    dx = max(abs(into[0] * x + into[1] * y + into[2] * z + into[3]) - half[0], 0.0)
    dy = max(abs(into[4] * x + into[5] * y + into[6] * z + into[7]) - half[1], 0.0)
    dz = max(abs(into[8] * x + into[9] * y + into[10] * z + into[11]) - half[2], 0.0)
    return math.sqrt(dx * dx + dy * dy + dz * dz)


@hidden
def spheres_to_core(spheres: Array, into: Array, half: Array) -> float:
    """The nearest of some spheres, (4, s), to a core: distance less radius."""
    least = 1e300
    for s in range(spheres.shape[1]):
        apart = beyond_core(into, half, spheres[0, s], spheres[1, s], spheres[2, s]) - spheres[3, s]
        least = min(least, apart)
    return least


@hidden
def clear_of_core(spheres: Array, into: Array, half: Array, least: float) -> float:
    """Above 0 where all spheres, (4, s), are farther than `least` from a core: squares, not lengths."""
    lowest = 1e300
    for s in range(spheres.shape[1]):
        x, y, z, reach = spheres[0, s], spheres[1, s], spheres[2, s], spheres[3, s] + least
        dx = max(abs(into[0] * x + into[1] * y + into[2] * z + into[3]) - half[0], 0.0)
        dy = max(abs(into[4] * x + into[5] * y + into[6] * z + into[7]) - half[1], 0.0)
        dz = max(abs(into[8] * x + into[9] * y + into[10] * z + into[11]) - half[2], 0.0)
        lowest = min(lowest, dx * dx + dy * dy + dz * dz - reach * reach)
    return lowest


@hidden
def is_clear(cell: Cell, here: Here, a: int, b: int, least: float) -> bool:
    """Are two parts farther apart than `least`, which is not below 0, by the spheres of one and the core of the other?"""
    place(cell, here, a)
    place(cell, here, b)
    if clear_of_core(here.outer[a], here.into[b], cell.half[b], least + cell.thick[b]) > 0.0:
        return True
    return clear_of_core(here.outer[b], here.into[a], cell.half[a], least + cell.thick[a]) > 0.0


@hidden
def spheres_to_spheres(one: Array, other: Array) -> float:
    """The nearest two spheres of two parts: distance less radii."""
    least = 1e300
    for s in range(one.shape[1]):
        x, y, z, r = one[0, s], one[1, s], one[2, s], one[3, s]
        for t in range(other.shape[1]):
            dx, dy, dz = other[0, t] - x, other[1, t] - y, other[2, t] - z
            least = min(least, math.sqrt(dx * dx + dy * dy + dz * dz) - r - other[3, t])
    return least


@hidden
def gap_below(cell: Cell, here: Here, a: int, b: int) -> float:
    """No two points of two parts are closer than this, by the spheres of each and the core of the other."""
    place(cell, here, a)
    place(cell, here, b)
    one: float = spheres_to_core(here.outer[a], here.into[b], cell.half[b]) - cell.thick[b]
    other: float = spheres_to_core(here.outer[b], here.into[a], cell.half[a]) - cell.thick[a]
    return max(one, other)


@hidden
def gap_above(cell: Cell, here: Here, a: int, b: int) -> float:
    """Two points of two parts are as near as this, by what is inside of them; below 0 they touch."""
    gap: float
    if cell.exact[b]:
        gap = spheres_to_core(here.inner[a], here.into[b], cell.half[b]) - cell.thick[b]
    elif cell.exact[a]:
        gap = spheres_to_core(here.inner[b], here.into[a], cell.half[a]) - cell.thick[a]
    else:
        gap = spheres_to_spheres(here.inner[a], here.inner[b])
    return gap


@hidden
def farthest(cell: Cell, here: Here, p: int, x: float, y: float, z: float, at: int, w: int) -> None:
    """The corner of a part that lies farthest in a direction, in the base, into ``here.spot[at : at + 3]``."""
    T, C, best, where = here.frames[cell.joint[p]], cell.corners, here.best, here.where
    u = T[0] * x + T[4] * y + T[8] * z
    v = T[1] * x + T[5] * y + T[9] * z
    t = T[2] * x + T[6] * y + T[10] * z
    first, last = cell.corner_at[p], cell.corner_at[p + 1]
    for l in range(w):
        best[l], where[l] = -1e300, 0.0
    for s in range(first, last, LANES):
        row = float(s)
        for l in range(w):
            along = u * C[0, s + l] + v * C[1, s + l] + t * C[2, s + l]
            more = along > best[l]
            best[l] = along if more else best[l]
            where[l] = row if more else where[l]
    top = 0
    for l in range(1, w):
        if best[l] > best[top]:
            top = l
    i = int(where[top]) + top
    cx, cy, cz = C[0, i], C[1, i], C[2, i]
    here.spot[at] = T[0] * cx + T[1] * cy + T[2] * cz + T[3]
    here.spot[at + 1] = T[4] * cx + T[5] * cy + T[6] * cz + T[7]
    here.spot[at + 2] = T[8] * cx + T[9] * cy + T[10] * cz + T[11]


@hidden
def inside_by(cell: Cell, here: Here, p: int, x: float, y: float, z: float) -> float:
    """How deep a point is inside a part with flat sides, above 0; else below 0, or what says nothing."""
    T = here.frames[cell.joint[p]]
    dx, dy, dz = x - T[3], y - T[7], z - T[11]
    u = T[0] * dx + T[4] * dy + T[8] * dz
    v = T[1] * dx + T[5] * dy + T[9] * dz
    t = T[2] * dx + T[6] * dy + T[10] * dz
    first, last = cell.plane_at[p], cell.plane_at[p + 1]
    beyond = -1e300 if last > first else 1e300
    for f in range(first, last):
        beyond = max(
            beyond, cell.planes[0, f] * u + cell.planes[1, f] * v + cell.planes[2, f] * t + cell.planes[3, f]
        )
    return -beyond


@hidden
def straddle(cell: Cell, here: Here, a: int, b: int, least: float, touch: float, steps: int, w: int) -> int:
    """Look for a plane between two parts, or for a point of one that is in the other.

    The difference of two convex bodies is one; Gilbert (1966) goes from a point of it to the nearest on the way to its
    corner that lies farthest towards the origin. Every such corner gives a plane, and every point two of the bodies.

    Args:
        cell: The scene.
        here: Where its parts are.
        a: One part; it must be known where both are.
        b: The other.
        least: They are free of each other when they are farther apart than this.
        touch: They touch when they are nearer than this.
        steps: At most.
        w: `LANES`.

    Returns:
        `FREE`, `TOUCH` or `DOUBT`; in ``here.spot[9]`` and ``[10]`` the best bounds on their distance from below and above.
    """
    spot, thick = here.spot, cell.thick[a] + cell.thick[b]
    both = cell.solid[a] and cell.solid[b]
    ia, ib = here.into[a], here.into[b]
    # Points of the parts, or of what they lie in: middles of the cores.
    ax, ay, az = -core_row(ia, 0), -core_row(ia, 1), -core_row(ia, 2)
    bx, by, bz = -core_row(ib, 0), -core_row(ib, 1), -core_row(ib, 2)
    below, above = -1e300, 1e300
    verdict = DOUBT
    for step in range(steps):
        x, y, z = ax - bx, ay - by, az - bz
        square = x * x + y * y + z * z
        length = math.sqrt(square)
        if both:
            # A point of one part is in the other, or near to it.
            near = length - thick
            if cell.exact[b]:
                near = min(near, beyond_core(ib, cell.half[b], ax, ay, az) - thick)
            if cell.exact[a]:
                near = min(near, beyond_core(ia, cell.half[a], bx, by, bz) - thick)
            if step % 3 == 2 and not cell.exact[a] and not cell.exact[b]:
                near = min(near, -inside_by(cell, here, a, bx, by, bz), -inside_by(cell, here, b, ax, ay, az))
            above = min(above, near)
            if near < touch:
                verdict = TOUCH
                break
        if length < 1e-12:
            break
        farthest(cell, here, a, -x, -y, -z, 0, w)
        farthest(cell, here, b, x, y, z, 3, w)
        wx, wy, wz = spot[0] - spot[3], spot[1] - spot[4], spot[2] - spot[5]
        along = x * wx + y * wy + z * wz
        below = max(below, along / length - thick)
        if below > least:
            verdict = FREE
            break
        dx, dy, dz = wx - x, wy - y, wz - z
        way = dx * dx + dy * dy + dz * dz
        if square - along <= 1e-12 * square or way == 0.0:
            break
        t = min((square - along) / way, 1.0)
        ax, ay, az = ax + t * (spot[0] - ax), ay + t * (spot[1] - ay), az + t * (spot[2] - az)
        bx, by, bz = bx + t * (spot[3] - bx), by + t * (spot[4] - by), bz + t * (spot[5] - bz)
    spot[9], spot[10] = below, above
    return verdict


@hidden
def core_row(into: Array, c: int) -> float:
    """One coordinate, less its sign, of the middle of a core in the base."""
    row: float = into[c] * into[3] + into[4 + c] * into[7] + into[8 + c] * into[11]
    return row


@hidden
def settle(cell: Cell, here: Here, a: int, b: int, least: float, touch: float, steps: int, w: int) -> int:
    """Are two parts farther apart than `least`, nearer than `touch`, or in doubt?"""
    if is_clear(cell, here, a, b, least):
        return FREE
    if gap_above(cell, here, a, b) < touch:
        return TOUCH
    return straddle(cell, here, a, b, least, touch, steps, w)
