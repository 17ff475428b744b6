"""Vectors and rigid transforms as values: inlined functions take and return them, and LLVM keeps them in registers.

Every function computes its components in the order of the formula it cites, so that lanes and single calls give the same
bits.
"""

from __future__ import annotations

import math
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
def row(T: Array, r: int) -> Vector:
    """The first three elements of row r of a table."""
    return Vector(T[r, 0], T[r, 1], T[r, 2])


@inlined
def write_row(v: Vector, T: Array, r: int) -> None:
    """Write a vector into the first three elements of row r of a table."""
    T[r, 0], T[r, 1], T[r, 2] = v.x, v.y, v.z


@inlined
def write_column(v: Vector, T: Array, c: int) -> None:
    """Write a vector into column c of a transform, (3, 4) or (4, 4)."""
    T[0, c], T[1, c], T[2, c] = v.x, v.y, v.z


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
def norm(v: Vector) -> float:
    """``|v|``."""
    return math.sqrt(dot(v, v))


class Matrix(NamedTuple):
    """A matrix (3, 3) by its columns, such as a rotation by its axes."""

    x: Vector
    y: Vector
    z: Vector


@inlined
def columns(T: Array) -> Matrix:
    """The first three columns of three rows, such as the rotation of a transform."""
    return Matrix(column(T, 0), column(T, 1), column(T, 2))


@inlined
def matrix_of(numbers: Array, first: int, width: int) -> Matrix:
    """The matrix whose rows begin at entries first, first + width and first + 2 · width of a flat array."""
    second, third = first + width, first + 2 * width
    return Matrix(
        Vector(numbers[first], numbers[second], numbers[third]),
        Vector(numbers[first + 1], numbers[second + 1], numbers[third + 1]),
        Vector(numbers[first + 2], numbers[second + 2], numbers[third + 2]),
    )


@inlined
def times(M: Matrix, v: Vector) -> Vector:
    """``M v``."""
    return Vector(
        M.x.x * v.x + M.y.x * v.y + M.z.x * v.z,
        M.x.y * v.x + M.y.y * v.y + M.z.y * v.z,
        M.x.z * v.x + M.y.z * v.y + M.z.z * v.z,
    )


@inlined
def transposed_times(M: Matrix, v: Vector) -> Vector:
    """``Mᵀ v``."""
    return Vector(dot(M.x, v), dot(M.y, v), dot(M.z, v))


@inlined
def matrix_product(A: Matrix, B: Matrix) -> Matrix:
    """``A B``."""
    return Matrix(times(A, B.x), times(A, B.y), times(A, B.z))


@inlined
def transposed_product(A: Matrix, B: Matrix) -> Matrix:
    """``Aᵀ B``."""
    return Matrix(transposed_times(A, B.x), transposed_times(A, B.y), transposed_times(A, B.z))


class Transform(NamedTuple):
    """A rigid transform."""

    R: Matrix
    p: Vector


@inlined
def transform_at(T: Array) -> Transform:
    """Read a transform, (3, 4) or (4, 4)."""
    return Transform(columns(T), column(T, 3))


@inlined
def write_transform(T: Transform, out: Array) -> None:
    """Write a transform into an array, (3, 4) or (4, 4)."""
    write_column(T.R.x, out, 0)
    write_column(T.R.y, out, 1)
    write_column(T.R.z, out, 2)
    write_column(T.p, out, 3)


@inlined
def apply(T: Transform, v: Vector) -> Vector:
    """``R v + p``."""
    return plus(times(T.R, v), T.p)


@inlined
def compose(A: Transform, B: Transform) -> Transform:
    """``A B``."""
    return Transform(matrix_product(A.R, B.R), apply(A, B.p))


@inlined
def relative(A: Transform, B: Transform) -> Transform:
    """``A⁻¹ B``."""
    return Transform(transposed_product(A.R, B.R), transposed_times(A.R, minus(B.p, A.p)))


@inlined
def inverse(T: Transform) -> Transform:
    """``T⁻¹``."""
    R = T.R
    rows = Matrix(Vector(R.x.x, R.y.x, R.z.x), Vector(R.x.y, R.y.y, R.z.y), Vector(R.x.z, R.y.z, R.z.z))
    return Transform(rows, scaled(-1.0, transposed_times(R, T.p)))


@inlined
def rotated(T: Array, v: Vector) -> Vector:
    """``R v`` for a transform, (3, 4)."""
    return times(columns(T), v)


@inlined
def rotated_back(T: Array, v: Vector) -> Vector:
    """``Rᵀ v`` for a transform, (3, 4)."""
    return transposed_times(columns(T), v)


@inlined
def transformed(T: Array, v: Vector) -> Vector:
    """``R v + p`` for a transform, (3, 4)."""
    return apply(transform_at(T), v)
