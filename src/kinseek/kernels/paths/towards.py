"""A pose on the way from one pose to another, and moved by a twist."""

from __future__ import annotations

from typing import Annotated

from kinseek.kernels.arm.range_error import rotation_vector
from kinseek.kernels.arm.trigonometry import sine_cosine
from kinseek.kernels.arm.vectors import (
    Matrix,
    Vector,
    column,
    columns,
    minus,
    norm,
    plus,
    rotate,
    row,
    scaled,
    times,
    vector_at,
    write_column,
)
from kinseek.kernels.arrays import Array
from kinseek.kernels.entry import OUT
from kinseek.kernels.jit import entry, inlined


@inlined
def at_most(v: Vector, length: float) -> Vector:
    """A vector, shortened to a length if it is longer."""
    size = norm(v)
    return v if size <= length else scaled(length / size, v)


@inlined
def turned(v: Vector, M: Matrix) -> Matrix:
    """``exp([v]) M``: a matrix turned by a rotation vector."""
    angle = norm(v)
    if angle == 0.0:
        return M
    axis = scaled(1.0 / angle, v)
    sine, cosine = sine_cosine(angle)
    return Matrix(
        rotate(axis, cosine, sine, M.x), rotate(axis, cosine, sine, M.y), rotate(axis, cosine, sine, M.z)
    )


@entry
def move_towards(
    hand: Annotated[Array, 4, 4],
    target: Annotated[Array, 4, 4],
    most: Annotated[Array, 2],
    share: float,
    twist: Annotated[Array, 6],
    moved: Annotated[Array, 4, 4, OUT],
) -> None:
    """Write the pose of a hand after a part of the way to a target, and then a twist.

    Args:
        hand: Pose, (4, 4).
        target: Pose, (4, 4).
        most: The way is cut off after this distance [m] and this rotation [rad].
        share: The part of that way, in positions and in rotation vectors.
        twist: Displacement and rotation vector about the hand, in axes of the base, (6,) [m], [rad].
        moved: Receives the pose, (4, 4).
    """
    to = columns(target)
    # The columns of ``R_target R_handᵀ``: products with the rows of R_hand.
    between = Matrix(times(to, row(hand, 0)), times(to, row(hand, 1)), times(to, row(hand, 2)))
    ahead = at_most(minus(column(target, 3), column(hand, 3)), most[0])
    turn = at_most(rotation_vector(between), most[1])
    shift = plus(scaled(share, ahead), vector_at(twist, 0))
    R = turned(vector_at(twist, 3), turned(scaled(share, turn), columns(hand)))
    write_column(R.x, moved, 0)
    write_column(R.y, moved, 1)
    write_column(R.z, moved, 2)
    write_column(plus(column(hand, 3), shift), moved, 3)
    moved[3, 0], moved[3, 1], moved[3, 2], moved[3, 3] = 0.0, 0.0, 0.0, 1.0
