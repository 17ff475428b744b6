"""Vectors and rigid transforms as values: inlined functions take and return them, and LLVM keeps them in registers.

Every function computes its components in the order of the formula it cites, so that lanes and single calls give the same
bits.
"""

from __future__ import annotations

from typing import NamedTuple

from kinseek.kernels.arrays import Array
from kinseek.kernels.jit import inlined


class Vector(NamedTuple):
    """A vector of three components."""

    x: float
    y: float
    z: float


class Twist(NamedTuple):
    """A motion, or a weighted error, of a pose: six components."""

    linear: Vector
    angular: Vector


@inlined
def vector_at(numbers: Array, first: int) -> Vector:
    """Read the vector at entries first … first+2 of a flat array."""
    return Vector(numbers[first], numbers[first + 1], numbers[first + 2])


@inlined
def column(T: Array, c: int) -> Vector:
    """Column c of a transform, (3, 4) or (4, 4): an axis, or the position for c = 3."""
    return Vector(T[0, c], T[1, c], T[2, c])


@inlined
def dot(a: Vector, b: Vector) -> float:
    """``a · b``."""
    return a.x * b.x + a.y * b.y + a.z * b.z


@inlined
def cross(a: Vector, b: Vector) -> Vector:
    """``a x b``."""
    return Vector(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x)


@inlined
def plus(a: Vector, b: Vector) -> Vector:
    """``a + b``."""
    return Vector(a.x + b.x, a.y + b.y, a.z + b.z)


@inlined
def minus(a: Vector, b: Vector) -> Vector:
    """``a - b``."""
    return Vector(a.x - b.x, a.y - b.y, a.z - b.z)


@inlined
def scaled(factor: float, v: Vector) -> Vector:
    """``factor · v``."""
    return Vector(factor * v.x, factor * v.y, factor * v.z)


@inlined
def twist_dot(a: Twist, b: Twist) -> float:
    """Sum of the products of all six components."""
    return dot(a.linear, b.linear) + dot(a.angular, b.angular)


@inlined
def rotate(axis: Vector, cosine: float, sine: float, v: Vector) -> Vector:
    """Rotate v about a unit axis by the angle with this cosine and sine (Rodrigues 1840)."""
    along = dot(axis, v) * (1.0 - cosine)
    return Vector(
        cosine * v.x + sine * (axis.y * v.z - axis.z * v.y) + along * axis.x,
        cosine * v.y + sine * (axis.z * v.x - axis.x * v.z) + along * axis.y,
        cosine * v.z + sine * (axis.x * v.y - axis.y * v.x) + along * axis.z,
    )


@inlined
def rotated(T: Array, v: Vector) -> Vector:
    """``R v`` for the rotation R of a transform, (3, 4)."""
    return Vector(
        T[0, 0] * v.x + T[0, 1] * v.y + T[0, 2] * v.z,
        T[1, 0] * v.x + T[1, 1] * v.y + T[1, 2] * v.z,
        T[2, 0] * v.x + T[2, 1] * v.y + T[2, 2] * v.z,
    )


@inlined
def rotated_back(T: Array, v: Vector) -> Vector:
    """``Rᵀ v`` for the rotation R of a transform, (3, 4)."""
    return Vector(
        T[0, 0] * v.x + T[1, 0] * v.y + T[2, 0] * v.z,
        T[0, 1] * v.x + T[1, 1] * v.y + T[2, 1] * v.z,
        T[0, 2] * v.x + T[1, 2] * v.y + T[2, 2] * v.z,
    )


@inlined
def transformed(T: Array, v: Vector) -> Vector:
    """``R v + p`` for a transform, (3, 4)."""
    return plus(rotated(T, v), column(T, 3))
