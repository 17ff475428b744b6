"""Distance of two parts: proven bounds from both sides.

From below: a part lies in its outer spheres, in its core, and on one side of a plane through the corner that is farthest
in a direction. From above: inner spheres, and points that are in both parts, given by convex combinations of corners.
"""

from __future__ import annotations

import math

import numpy as np

from kinseek.kernels.arrays import Array
from kinseek.kernels.jit import inlined

from .model import CollisionModel, LaneState, centre, frame_of, place

FREE, TOUCH, DOUBT = 1, 0, 2

HEIGHTS, NUMBERS = 2.0**40, 22
"""Upper limit of integer heights, and the number of bits after them that hold a corner's index."""

WHOLE = 1.5 * 2.0**52
"""Added to a number below 2^51, it leaves the rounded integer in the last bits."""


@inlined
def way_into(model: CollisionModel, state: LaneState, a: int, b: int) -> None:
    """Write the transform from the frame of a's joint to the core of b, (12,), into ``state.spot``."""
    frame_of(state, model.joint[a])
    place(model, state, b)
    spot, into, T = state.spot, state.into[b], state.frame[model.joint[a]]
    for r in range(0, 12, 4):
        i0, i1, i2, i3 = into[r], into[r + 1], into[r + 2], into[r + 3]
        for c in range(4):
            spot[r + c] = i0 * T[c] + i1 * T[4 + c] + i2 * T[8 + c]
        spot[r + 3] += i3


@inlined
def near_core(spheres: Array, way: Array, half: Array, least: float) -> int:
    """Number of spheres, (4, s), at most `least` away from a core; counting vectorizes."""
    a0, a1, a2, a3, b0, b1, b2, b3 = way[0], way[1], way[2], way[3], way[4], way[5], way[6], way[7]
    c0, c1, c2, c3, hx, hy, hz = way[8], way[9], way[10], way[11], half[0], half[1], half[2]
    count = 0
    for s in range(spheres.shape[1]):
        x, y, z, reach = spheres[0, s], spheres[1, s], spheres[2, s], spheres[3, s] + least
        dx = max(abs(a0 * x + a1 * y + a2 * z + a3) - hx, 0.0)
        dy = max(abs(b0 * x + b1 * y + b2 * z + b3) - hy, 0.0)
        dz = max(abs(c0 * x + c1 * y + c2 * z + c3) - hz, 0.0)
        count += 1 if dx * dx + dy * dy + dz * dz <= reach * abs(reach) else 0
    return count


@inlined
def gap_to_core(spheres: Array, way: Array, half: Array) -> float:
    """Distance of the nearest sphere, (4, s), from a core: distance minus radius."""
    a0, a1, a2, a3, b0, b1, b2, b3 = way[0], way[1], way[2], way[3], way[4], way[5], way[6], way[7]
    c0, c1, c2, c3, hx, hy, hz = way[8], way[9], way[10], way[11], half[0], half[1], half[2]
    least = 1e300
    for s in range(spheres.shape[1]):
        x, y, z = spheres[0, s], spheres[1, s], spheres[2, s]
        dx = max(abs(a0 * x + a1 * y + a2 * z + a3) - hx, 0.0)
        dy = max(abs(b0 * x + b1 * y + b2 * z + b3) - hy, 0.0)
        dz = max(abs(c0 * x + c1 * y + c2 * z + c3) - hz, 0.0)
        least = min(least, math.sqrt(dx * dx + dy * dy + dz * dz) - spheres[3, s])
    return least


@inlined
def ball_gap(model: CollisionModel, state: LaneState, a: int, b: int) -> float:
    """Distance of the balls around two parts."""
    centre(model, state, a)
    centre(model, state, b)
    p, s = state.middle[a], state.middle[b]
    dx, dy, dz = p[0] - s[0], p[1] - s[1], p[2] - s[2]
    gap: float = math.sqrt(dx * dx + dy * dy + dz * dz) - model.ball[a, 3] - model.ball[b, 3]
    return gap


@inlined
def gap_below(model: CollisionModel, state: LaneState, a: int, b: int) -> float:
    """Lower bound of the distance of two parts, from outer spheres and cores."""
    way_into(model, state, a, b)
    one: float = gap_to_core(model.outer[a], state.spot, model.half[b]) - model.thick[b]
    way_into(model, state, b, a)
    other: float = gap_to_core(model.outer[b], state.spot, model.half[a]) - model.thick[a]
    return max(one, other)


@inlined
def depth_below(model: CollisionModel, state: LaneState, a: int, b: int) -> float:
    """Lower bound of the motion that separates two parts, by inner spheres of both; a negative bound has no meaning."""
    frame_of(state, model.joint[a])
    frame_of(state, model.joint[b])
    A, B, T, S = model.inner[a], model.inner[b], state.frame[model.joint[a]], state.frame[model.joint[b]]
    depth = -1e300
    for i in range(A.shape[1]):
        ax, ay, az = A[0, i], A[1, i], A[2, i]
        x = T[0] * ax + T[1] * ay + T[2] * az + T[3] - S[3]
        y = T[4] * ax + T[5] * ay + T[6] * az + T[7] - S[7]
        z = T[8] * ax + T[9] * ay + T[10] * az + T[11] - S[11]
        u, v, t = (
            S[0] * x + S[4] * y + S[8] * z,
            S[1] * x + S[5] * y + S[9] * z,
            S[2] * x + S[6] * y + S[10] * z,
        )
        for j in range(B.shape[1]):
            dx, dy, dz = u - B[0, j], v - B[1, j], t - B[2, j]
            depth = max(depth, A[3, i] + B[3, j] - math.sqrt(dx * dx + dy * dy + dz * dz))
    return depth


@inlined
def farthest(model: CollisionModel, state: LaneState, p: int, x: float, y: float, z: float, at: int) -> None:
    """Write the corner of a part that is farthest in a direction, in the base, into ``state.spot[at : at + 3]``."""
    if model.exact[p]:
        M, half, spot = state.into[p], model.half[p], state.spot
        a, b, c = (
            M[0] * x + M[1] * y + M[2] * z,
            M[4] * x + M[5] * y + M[6] * z,
            M[8] * x + M[9] * y + M[10] * z,
        )
        # A corner of the core in its frame, transformed to the base.
        u = (half[0] if a > 0.0 else -half[0]) - M[3]
        v = (half[1] if b > 0.0 else -half[1]) - M[7]
        t = (half[2] if c > 0.0 else -half[2]) - M[11]
        for r in range(3):
            spot[at + r] = M[r] * u + M[4 + r] * v + M[8 + r] * t
        return
    T, B = state.frame[model.joint[p]], model.ball[p]
    u = T[0] * x + T[4] * y + T[8] * z
    v = T[1] * x + T[5] * y + T[9] * z
    t = T[2] * x + T[6] * y + T[10] * z
    # Heights as integers below 2^40, followed by the corner's index: a loop without branches finds the largest. They are
    # rounded by less than 1e-11 of the part's size, which is far less than the rounding of the scene.
    size = max(abs(B[0]), abs(B[1]), abs(B[2])) + B[3]
    scale = HEIGHTS / (size * (abs(u) + abs(v) + abs(t)) + 1e-300)
    u, v, t = scale * u, scale * v, scale * t
    first, best = 3 * model.corner_at[p], np.int64(-(1 << 63))
    count = model.corner_at[p + 1] - model.corner_at[p]
    X, Y = model.corners[first : first + count], model.corners[first + count : first + 2 * count]
    Z = model.corners[first + 2 * count : first + 3 * count]
    for s in range(count):
        height = np.float64(u * X[s] + v * Y[s] + t * Z[s] + WHOLE)
        best = max(best, (height.view(np.int64) << NUMBERS) | s)
    i = best & ((1 << NUMBERS) - 1)
    cx, cy, cz = X[i], Y[i], Z[i]
    state.spot[at] = T[0] * cx + T[1] * cy + T[2] * cz + T[3]
    state.spot[at + 1] = T[4] * cx + T[5] * cy + T[6] * cz + T[7]
    state.spot[at + 2] = T[8] * cx + T[9] * cy + T[10] * cz + T[11]


@inlined
def lean(S: Array, share: Array, i: int, j: int, k: int) -> float:
    """Write the barycentric coordinates of a triangle's point nearest to the origin; return its squared distance.

    Ericson 2005, 5.1.5.
    """
    ax, ay, az = S[i, 0], S[i, 1], S[i, 2]
    bx, by, bz = S[j, 0] - ax, S[j, 1] - ay, S[j, 2] - az
    cx, cy, cz = S[k, 0] - ax, S[k, 1] - ay, S[k, 2] - az
    d1, d2 = -(bx * ax + by * ay + bz * az), -(cx * ax + cy * ay + cz * az)
    bb, bc, cc = bx * bx + by * by + bz * bz, bx * cx + by * cy + bz * cz, cx * cx + cy * cy + cz * cz
    d3, d4, d5, d6 = d1 - bb, d2 - bc, d1 - bc, d2 - cc
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    s, t = 0.0, 0.0
    if d1 <= 0.0 and d2 <= 0.0:
        s, t = 0.0, 0.0
    elif d3 >= 0.0 and d4 <= d3:
        s, t = 1.0, 0.0
    elif vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        s = d1 / max(d1 - d3, 1e-300)
    elif d6 >= 0.0 and d5 <= d6:
        s, t = 0.0, 1.0
    elif vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        t = d2 / max(d2 - d6, 1e-300)
    elif va <= 0.0 and d4 >= d3 and d5 >= d6:
        t = (d4 - d3) / max((d4 - d3) + (d5 - d6), 1e-300)
        s = 1.0 - t
    else:
        whole = 1.0 / max(va + vb + vc, 1e-300)
        s, t = vb * whole, vc * whole
    # Despite rounding, these are the coordinates of a point of the triangle.
    s = min(max(s, 0.0), 1.0)
    t = min(max(t, 0.0), 1.0 - s)
    for n in range(4):
        share[n] = 0.0
    share[i], share[j], share[k] = 1.0 - s - t, s, t
    x, y, z = ax + s * bx + t * cx, ay + s * by + t * cy, az + s * bz + t * cz
    square: float = x * x + y * y + z * z
    return square


@inlined
def turned(S: Array, i: int, j: int, k: int) -> float:
    """Six times the signed volume of the tetrahedron of a triangle and the origin."""
    x = S[j, 1] * S[k, 2] - S[j, 2] * S[k, 1]
    y = S[j, 2] * S[k, 0] - S[j, 0] * S[k, 2]
    z = S[j, 0] * S[k, 1] - S[j, 1] * S[k, 0]
    volume: float = S[i, 0] * x + S[i, 1] * y + S[i, 2] * z
    return volume


@inlined
def nearest_mixture(state: LaneState, count: int) -> int:
    """Write the convex combination of corners nearest to the origin into ``state.spot[6:9]``; drop unused corners.

    The last corner is the new one, and it has a positive weight: without it the previous point was the nearest.
    """
    S, share, spot = state.simplex, state.share, state.spot
    if count == 1:
        share[0] = 1.0
    elif count == 2:
        dx, dy, dz = S[1, 0] - S[0, 0], S[1, 1] - S[0, 1], S[1, 2] - S[0, 2]
        square = dx * dx + dy * dy + dz * dz
        t = -(dx * S[0, 0] + dy * S[0, 1] + dz * S[0, 2]) / max(square, 1e-300)
        share[1] = min(max(t, 0.0), 1.0)
        share[0] = 1.0 - share[1]
    elif count == 3:
        lean(S, share, 0, 1, 2)
    else:
        a, b = turned(S, 1, 3, 2), turned(S, 0, 2, 3)
        c, d = turned(S, 0, 3, 1), turned(S, 0, 1, 2)
        whole = a + b + c + d
        within = (a > 0.0 and b > 0.0 and c > 0.0 and d > 0.0) or (
            a < 0.0 and b < 0.0 and c < 0.0 and d < 0.0
        )
        if within:
            share[0], share[1], share[2], share[3] = a / whole, b / whole, c / whole, d / whole
        else:
            one, two, three = lean(S, share, 0, 1, 3), lean(S, share, 0, 2, 3), lean(S, share, 1, 2, 3)
            if one <= two and one <= three:
                lean(S, share, 0, 1, 3)
            elif two <= three:
                lean(S, share, 0, 2, 3)
    x, y, z, kept = 0.0, 0.0, 0.0, 0
    for n in range(count):
        part = share[n]
        if part > 0.0:
            sx, sy, sz = S[n, 0], S[n, 1], S[n, 2]
            x, y, z = x + part * sx, y + part * sy, z + part * sz
            S[kept, 0], S[kept, 1], S[kept, 2] = sx, sy, sz
            kept += 1
    spot[6], spot[7], spot[8] = x, y, z
    return kept


@inlined
def first_look(model: CollisionModel, state: LaneState, a: int, b: int) -> None:
    """Write the first direction in which to look for a plane into ``state.spot[6:9]``.

    It leads from b's core to the nearest of a few spheres around a.
    """
    way_into(model, state, a, b)
    way, S, half, into, spot = state.spot, model.rough[a], model.half[b], state.into[b], state.spot
    nearest, x, y, z = 1e300, 0.0, 0.0, 0.0
    for s in range(S.shape[1]):
        sx, sy, sz = S[0, s], S[1, s], S[2, s]
        u = way[0] * sx + way[1] * sy + way[2] * sz + way[3]
        v = way[4] * sx + way[5] * sy + way[6] * sz + way[7]
        t = way[8] * sx + way[9] * sy + way[10] * sz + way[11]
        u -= min(max(u, -half[0]), half[0])
        v -= min(max(v, -half[1]), half[1])
        t -= min(max(t, -half[2]), half[2])
        gap = math.sqrt(u * u + v * v + t * t) - S[3, s]
        if gap < nearest:
            nearest, x, y, z = gap, u, v, t
    for r in range(3):
        spot[6 + r] = into[r] * x + into[4 + r] * y + into[8 + r] * z


@inlined
def separating_plane(
    model: CollisionModel, state: LaneState, a: int, b: int, least: float, touch: float, steps: int
) -> int:
    """Look for a plane between two parts, or for a point in both; each verdict is proven, and there may be none.

    The differences of points of both parts form a convex body, whose distance from the origin is that of the parts.
    Corners of this body that are farthest towards the origin are collected, and their convex combination nearest to the
    origin gives the next direction (Gilbert, Johnson and Keerthi 1988). Each such corner gives a plane, and each
    combination gives two points of the parts.

    Args:
        model: The scene.
        state: The positions of its parts.
        a: One part.
        b: The other part.
        least: Distance above which they are free of each other.
        touch: Distance of two points below which they touch; it is valid if the hulls of the corners lie in the parts.
        steps: Largest number of steps.

    Returns:
        `FREE`, `TOUCH` or `DOUBT`. ``state.spot[9]`` and ``[10]`` receive the best lower and upper bounds of the distance
        of the thickened hulls.
    """
    spot, S, thick = state.spot, state.simplex, model.thick[a] + model.thick[b]
    first_look(model, state, a, b)
    place(model, state, a)  # As `first_look` does with b.
    x, y, z = spot[6], spot[7], spot[8]
    if x * x + y * y + z * z < 1e-18:
        centre(model, state, a)
        centre(model, state, b)
        p, s = state.middle[a], state.middle[b]
        x, y, z = p[0] - s[0], p[1] - s[1], p[2] - s[2]
    if x * x + y * y + z * z < 1e-18:
        x = 1.0
    below, above, count, verdict = -1e300, 1e300, 0, DOUBT
    for _ in range(steps):
        square = x * x + y * y + z * z
        farthest(model, state, a, -x, -y, -z, 0)
        farthest(model, state, b, x, y, z, 3)
        wx, wy, wz = spot[0] - spot[3], spot[1] - spot[4], spot[2] - spot[5]
        along = x * wx + y * wy + z * wz
        below = max(below, along / math.sqrt(square) - thick)
        if below > least:
            verdict = FREE
            break
        if count > 0 and square - along <= 1e-12 * square:
            break  # The combination is the nearest point, up to rounding.
        S[count, 0], S[count, 1], S[count, 2] = wx, wy, wz
        count = nearest_mixture(state, count + 1)
        x, y, z = spot[6], spot[7], spot[8]
        above = min(above, math.sqrt(x * x + y * y + z * z) - thick)
        if above < touch:
            verdict = TOUCH
            break
        if count == 4 or x * x + y * y + z * z < 1e-24:
            break  # The origin is inside, and only rounding is left; or the corners are in one plane.
    spot[9], spot[10] = below, above
    return verdict


@inlined
def quick_check(model: CollisionModel, state: LaneState, a: int, b: int, least: float, touch: float) -> int:
    """Test by spheres and cores alone whether two parts are farther apart than `least`, nearer than `touch`, or in doubt."""
    # A few spheres around one part against the core of the other; inner spheres if the core equals the part.
    if model.exact[b] or not model.exact[a]:
        way_into(model, state, a, b)
        if near_core(model.rough[a], state.spot, model.half[b], least + model.thick[b]) == 0:
            return FREE
        if (
            model.exact[b]
            and near_core(model.inner[a], state.spot, model.half[b], touch + model.thick[b]) > 0
        ):
            return TOUCH
    if model.exact[a] or not model.exact[b]:
        way_into(model, state, b, a)
        if near_core(model.rough[b], state.spot, model.half[a], least + model.thick[a]) == 0:
            return FREE
        if (
            model.exact[a]
            and near_core(model.inner[b], state.spot, model.half[a], touch + model.thick[a]) > 0
        ):
            return TOUCH
    return DOUBT


@inlined
def settle(
    model: CollisionModel, state: LaneState, a: int, b: int, least: float, touch: float, steps: int
) -> int:
    """Test the same by planes between the parts, or points in both."""
    i, j = model.within[a], model.within[b]
    same = i == a and j == b
    found = separating_plane(model, state, a, b, least, touch if same else -1e300, steps)
    if found == DOUBT and not same and i >= 0 and j >= 0:
        found = separating_plane(model, state, i, j, 1e300, touch, steps)
    return found
