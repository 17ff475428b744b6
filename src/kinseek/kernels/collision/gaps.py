"""Distance of two parts: proven bounds from both sides.

From below: a part lies in its outer spheres, in its core, and on one side of a plane through the corner that is farthest
in a direction. From above: inner spheres, and points that are in both parts, given by convex combinations of corners.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from kinseek.kernels.arm.vectors import (
    Transform,
    Vector,
    apply,
    column,
    compose,
    cross,
    dot,
    inverse,
    minus,
    norm,
    plus,
    row,
    scaled,
    times,
    transform_at,
    transposed_times,
)
from kinseek.kernels.arrays import Array
from kinseek.kernels.jit import inlined

from .model import CollisionModel, LaneState, Pair

FREE, TOUCH, DOUBT = 1, 0, 2

HEIGHTS, NUMBERS = 2.0**40, 22
"""Upper limit of integer heights, and the number of bits after them that hold a corner's index."""

WHOLE = 1.5 * 2.0**52
"""Added to a number below 2^51, it leaves the rounded integer in the last bits."""

SAME = 1e-18
"""Squared distance of two points [m²] below which the direction from one to the other is rounding."""


class Query(NamedTuple):
    """What is requested of two parts."""

    touch: float
    """Distance of two points below which the parts touch [m]."""
    free: float
    """Distance above which they are free of each other [m]."""
    steps: int
    """Largest number of steps to look for a plane between them, or for a point in both."""


@inlined
def padded(query: Query, pad: float) -> Query:
    """The query for two parts whose distance counts less by a padding."""
    return Query(query.touch + pad, query.free + pad, query.steps)


@inlined
def swapped(pair: Pair) -> Pair:
    """The same pair, b first."""
    return Pair(pair.b, pair.a, inverse(pair.way))


@inlined
def way_into_core(model: CollisionModel, pair: Pair) -> Transform:
    """Transform from the frame of a's joint to the core of b."""
    return compose(transform_at(model.into_core[pair.b]), pair.way)


@inlined
def from_box(v: Vector, half: Vector) -> Vector:
    """Vector to a point from the nearest point of a box with these half edges about the origin."""
    return Vector(
        v.x - min(max(v.x, -half.x), half.x),
        v.y - min(max(v.y, -half.y), half.y),
        v.z - min(max(v.z, -half.z), half.z),
    )


@inlined
def near_core(model: CollisionModel, spheres: Array, pair: Pair, least: float) -> int:
    """Number of a's spheres, (4, s), at most `least` away from the thickened core of b; counting vectorizes."""
    way, half, count = way_into_core(model, pair), row(model.half, pair.b), 0
    for s in range(spheres.shape[1]):
        offset = from_box(apply(way, column(spheres, s)), half)
        reach = spheres[3, s] + (least + model.thick[pair.b])
        # `reach` may be negative, and then nothing is near.
        count += 1 if dot(offset, offset) <= reach * abs(reach) else 0
    return count


@inlined
def gap_to_core(model: CollisionModel, pair: Pair) -> float:
    """Distance of a's outer spheres from the thickened core of b."""
    way, half = way_into_core(model, pair), row(model.half, pair.b)
    spheres, least = model.outer[pair.a], 1e300
    for s in range(spheres.shape[1]):
        least = min(least, norm(from_box(apply(way, column(spheres, s)), half)) - spheres[3, s])
    gap: float = least - model.thick[pair.b]
    return gap


@inlined
def gap_below(model: CollisionModel, pair: Pair) -> float:
    """Lower bound of the distance of two parts, from outer spheres and cores."""
    return max(gap_to_core(model, pair), gap_to_core(model, swapped(pair)))


@inlined
def between_centres(model: CollisionModel, pair: Pair) -> Vector:
    """Vector from the centre of the ball around b to that of a, in the frame of b's joint."""
    return minus(apply(pair.way, row(model.ball, pair.a)), row(model.ball, pair.b))


@inlined
def ball_gap(model: CollisionModel, pair: Pair) -> float:
    """Distance of the balls around two parts."""
    gap: float = norm(between_centres(model, pair)) - model.ball[pair.a, 3] - model.ball[pair.b, 3]
    return gap


@inlined
def depth_below(model: CollisionModel, pair: Pair) -> float:
    """Lower bound of the motion that separates two parts, by inner spheres of both; a negative bound has no meaning."""
    A, B, depth = model.inner[pair.a], model.inner[pair.b], -1e300
    for i in range(A.shape[1]):
        centre = apply(pair.way, column(A, i))
        for j in range(B.shape[1]):
            depth = max(depth, A[3, i] + B[3, j] - norm(minus(centre, column(B, j))))
    return depth


@inlined
def farthest(model: CollisionModel, p: int, direction: Vector) -> Vector:
    """The corner of a part that is farthest in a direction, both in the frame of its joint."""
    if model.exact[p]:
        into, half = transform_at(model.into_core[p]), row(model.half, p)
        along = times(into.R, direction)
        corner = Vector(
            half.x if along.x > 0.0 else -half.x,
            half.y if along.y > 0.0 else -half.y,
            half.z if along.z > 0.0 else -half.z,
        )
        return transposed_times(into.R, minus(corner, into.p))
    # Heights as integers below 2^40, followed by the corner's index: a loop without branches finds the largest. They are
    # rounded by less than 1e-11 of the part's size, which is far less than the rounding of the scene.
    B = model.ball[p]
    size = max(abs(B[0]), abs(B[1]), abs(B[2])) + B[3]
    length = abs(direction.x) + abs(direction.y) + abs(direction.z)
    u = scaled(HEIGHTS / (size * length + 1e-300), direction)
    first, last = model.corner_at[p], model.corner_at[p + 1]
    X, Y, Z = model.corners[0, first:last], model.corners[1, first:last], model.corners[2, first:last]
    best = np.int64(-(1 << 63))
    for s in range(len(X)):
        height = np.float64(u.x * X[s] + u.y * Y[s] + u.z * Z[s] + WHOLE)
        best = max(best, (height.view(np.int64) << NUMBERS) | s)
    i = best & ((1 << NUMBERS) - 1)
    return Vector(X[i], Y[i], Z[i])


class OnTriangle(NamedTuple):
    """A point of a triangle: the weights of its corners, and the squared distance from the origin."""

    a: float
    b: float
    c: float
    square: float


@inlined
def nearest_on_triangle(a: Vector, b: Vector, c: Vector) -> OnTriangle:
    """The point of a triangle that is nearest to the origin (Ericson 2005, 5.1.5)."""
    ab, ac = minus(b, a), minus(c, a)
    d1, d2 = -dot(ab, a), -dot(ac, a)
    bb, bc, cc = dot(ab, ab), dot(ab, ac), dot(ac, ac)
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
    point = plus(plus(a, scaled(s, ab)), scaled(t, ac))
    return OnTriangle(1.0 - s - t, s, t, dot(point, point))


@inlined
def volume(a: Vector, b: Vector, c: Vector) -> float:
    """Six times the signed volume of the tetrahedron of a triangle and the origin."""
    return dot(a, cross(b, c))


@inlined
def weigh(S: Array, weight: Array, count: int) -> None:
    """Write the weights of the convex combination of corners that is nearest to the origin.

    The last corner is the new one, and it has a positive weight: without it the previous point was the nearest.
    """
    p, q, r, s = row(S, 0), row(S, 1), row(S, 2), row(S, 3)
    if count == 1:
        weight[0] = 1.0
    elif count == 2:
        edge = minus(q, p)
        t = min(max(-dot(edge, p) / max(dot(edge, edge), 1e-300), 0.0), 1.0)
        weight[0], weight[1] = 1.0 - t, t
    elif count == 3:
        on = nearest_on_triangle(p, q, r)
        weight[0], weight[1], weight[2] = on.a, on.b, on.c
    else:
        a, b, c, d = volume(q, s, r), volume(p, r, s), volume(p, s, q), volume(p, q, r)
        if (a > 0.0 and b > 0.0 and c > 0.0 and d > 0.0) or (a < 0.0 and b < 0.0 and c < 0.0 and d < 0.0):
            whole = a + b + c + d  # The origin is inside.
            weight[0], weight[1], weight[2], weight[3] = a / whole, b / whole, c / whole, d / whole
            return
        one, two = nearest_on_triangle(p, q, s), nearest_on_triangle(p, r, s)
        three = nearest_on_triangle(q, r, s)
        if one.square <= two.square and one.square <= three.square:
            weight[0], weight[1], weight[2], weight[3] = one.a, one.b, 0.0, one.c
        elif two.square <= three.square:
            weight[0], weight[1], weight[2], weight[3] = two.a, 0.0, two.b, two.c
        else:
            weight[0], weight[1], weight[2], weight[3] = 0.0, three.a, three.b, three.c


@inlined
def nearest_mixture(state: LaneState, count: int) -> tuple[int, Vector]:
    """The convex combination of corners nearest to the origin; drop unused corners, and count the others."""
    S, weight = state.simplex, state.weight
    weigh(S, weight, count)
    point, kept = Vector(0.0, 0.0, 0.0), 0
    for n in range(count):
        if weight[n] > 0.0:
            corner = row(S, n)
            point = plus(point, scaled(weight[n], corner))
            S[kept, 0], S[kept, 1], S[kept, 2] = corner.x, corner.y, corner.z
            kept += 1
    return kept, point


@inlined
def first_direction(model: CollisionModel, pair: Pair) -> Vector:
    """The first direction in which to look for a plane, in the frame of b's joint.

    It leads from b's core to the nearest of a few spheres around a.
    """
    way, half, spheres = way_into_core(model, pair), row(model.half, pair.b), model.rough[pair.a]
    nearest, direction = 1e300, Vector(0.0, 0.0, 0.0)
    for s in range(spheres.shape[1]):
        offset = from_box(apply(way, column(spheres, s)), half)
        gap = norm(offset) - spheres[3, s]
        if gap < nearest:
            nearest, direction = gap, offset
    direction = transposed_times(transform_at(model.into_core[pair.b]).R, direction)
    if dot(direction, direction) < SAME:
        direction = between_centres(model, pair)
    return direction if dot(direction, direction) >= SAME else Vector(1.0, 0.0, 0.0)


class Separation(NamedTuple):
    """Whether two parts are apart, and proven bounds of the distance of their thickened hulls [m]."""

    verdict: int
    lower: float
    upper: float


@inlined
def separating_plane(model: CollisionModel, state: LaneState, pair: Pair, query: Query) -> Separation:
    """Look for a plane between two parts, or for a point in both; each verdict is proven, and there may be none.

    The differences of points of both parts form a convex body, whose distance from the origin is that of the parts.
    Corners of this body that are farthest towards the origin are collected, and their convex combination nearest to the
    origin gives the next direction (Gilbert, Johnson and Keerthi 1988). Each such corner gives a plane, and each
    combination gives two points of the parts. All vectors are in the frame of b's joint.

    The verdict is `FREE`, `TOUCH` or `DOUBT`; that they touch is valid if the hulls of the corners lie in the parts.
    """
    S, thick = state.simplex, model.thick[pair.a] + model.thick[pair.b]
    v = first_direction(model, pair)
    lower, upper, count = -1e300, 1e300, 0
    for _ in range(query.steps):
        towards = transposed_times(pair.way.R, scaled(-1.0, v))
        corner = minus(apply(pair.way, farthest(model, pair.a, towards)), farthest(model, pair.b, v))
        square, along = dot(v, v), dot(v, corner)
        # No corner of the difference is farther towards the origin, so all of it lies beyond the plane through this
        # one.
        lower = max(lower, along / math.sqrt(square) - thick)
        if lower > query.free:
            return Separation(FREE, lower, upper)
        if count > 0 and square - along <= 1e-12 * square:
            break  # The combination is the nearest point, up to rounding.
        S[count, 0], S[count, 1], S[count, 2] = corner.x, corner.y, corner.z
        count, v = nearest_mixture(state, count + 1)
        upper = min(upper, norm(v) - thick)
        if upper < query.touch:
            return Separation(TOUCH, lower, upper)
        if count == 4 or dot(v, v) < 1e-24:
            break  # The origin is inside, and only rounding is left; or the corners are in one plane.
    return Separation(DOUBT, lower, upper)


@inlined
def check_spheres(model: CollisionModel, pair: Pair, query: Query) -> int:
    """Test a few spheres around a against the core of b; its inner spheres too if the core equals the part."""
    if near_core(model, model.rough[pair.a], pair, query.free) == 0:
        return FREE
    if model.exact[pair.b] and near_core(model, model.inner[pair.a], pair, query.touch) > 0:
        return TOUCH
    return DOUBT


@inlined
def quick_check(model: CollisionModel, pair: Pair, query: Query) -> int:
    """Test by spheres and cores alone whether two parts are free of each other, touch, or are in doubt."""
    a, b, found = model.exact[pair.a], model.exact[pair.b], DOUBT
    if b or not a:
        found = check_spheres(model, pair, query)
    if found == DOUBT and (a or not b):
        found = check_spheres(model, swapped(pair), query)
    return found


@inlined
def separation(model: CollisionModel, state: LaneState, pair: Pair, query: Query) -> Separation:
    """Test the same by planes between the parts, or points in both; the bounds are those of the outer hulls."""
    i, j = model.within[pair.a], model.within[pair.b]
    same = i == pair.a and j == pair.b
    # A hull that is larger than its part can prove that the part is free, but not that it touches.
    apart = Query(query.touch if same else -1e300, query.free, query.steps)
    found = separating_plane(model, state, pair, apart)
    if found.verdict == DOUBT and not same and i >= 0 and j >= 0:
        # A hull inside the part can prove that the part touches, but not that it is free.
        inside = Query(query.touch, 1e300, query.steps)
        verdict = separating_plane(model, state, Pair(i, j, pair.way), inside).verdict
        found = Separation(verdict, found.lower, found.upper)
    return found
