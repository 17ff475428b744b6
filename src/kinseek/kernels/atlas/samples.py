"""The atlas: samples of the middle joints, sorted by the pose of the hand.

Write the arm as ``A_1 J_1 K J_n A_tip`` with ``K = A_2 J_2 … A_n``, the pose of the last axis seen from the first. A
rotation about the first axis changes only the azimuth of K, and a rotation about the last axis only the rotation about
that axis. A slide along the first axis changes one coordinate. Without these a pose has four degrees of freedom in five
coordinates: radius and height of a point, and a direction. A k-d tree sorts the samples by these coordinates. A goal has
the same coordinates. Its nearest samples give q_2 … q_{n-1}, the azimuths give q_1, and the remaining rotation gives q_n.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np

from kinseek.kernels.arm.division import NONE, SLIDE, TURN, Division, nearest_copy
from kinseek.kernels.arm.forward import advance, advance_segment, identity
from kinseek.kernels.arm.trigonometry import rough_angle
from kinseek.kernels.arrays import Array, ChainArrays, Limits
from kinseek.kernels.entry import OUT
from kinseek.kernels.jit import entry, inlined

from .tree import Tree, make_tree, sort_tree

COORDINATES = 9
"""Largest number of coordinates of a pose, see `coordinates`: a point and two directions."""


class Atlas(NamedTuple):
    """Samples of the middle joints, in the order of the leaves of the tree."""

    tree: Tree
    middle: Annotated[Array, "s", "middle", OUT]
    """Joint values of the samples [rad] or [m], (k, middle joints)."""
    poses: Annotated[Array, "s", 3, 4, OUT]
    """K of the samples, (k, 3, 4), lengths in [m]."""
    inverse_head: Annotated[Array, 3, 4]
    """A_1⁻¹ if the first joint is divided out, else the identity, (3, 4)."""
    inverse_tip: Annotated[Array, 3, 4]
    """A_tip⁻¹ if the last joint is divided out, else the inverse of a tool that the samples exclude, (3, 4)."""


@inlined
def coordinates(K: Array, division: Division, out: Array) -> int:
    """Write the remaining coordinates of a pose, (3, 4), into `out`; return their number."""
    x, y, z = K[0, 3], K[1, 3], K[2, 3]
    cosine, sine, flat = 1.0, 0.0, division.length
    if division.head == TURN:
        r = math.sqrt(x * x + y * y)
        if r > 0.0:
            cosine, sine = x / r, y / r
        out[0], out[1] = r, z
        # Near the axis the azimuth has little effect: a small motion of the first joint compensates for it.
        flat = division.length * r / math.sqrt(r * r + division.length * division.length)
        used = 2
    elif division.head == SLIDE:
        out[0], out[1] = x, y
        used = 2
    else:
        out[0], out[1], out[2] = x, y, z
        used = 3
    for i in range(division.columns):
        c = 2 if division.tail == TURN else i
        out[used] = flat * (cosine * K[0, c] + sine * K[1, c])
        out[used + 1] = flat * (cosine * K[1, c] - sine * K[0, c])
        out[used + 2] = division.length * K[2, c]
        used += 3
    return used


def build_atlas(
    chain: ChainArrays,
    division: Division,
    middle: Array,
    first: int,
    inverse_head: Array,
    inverse_tip: Array,
) -> Atlas:
    """Compute K and its coordinates for every sample, and sort them; see `fill_atlas`."""
    count, used = len(middle), (3 if division.head == NONE else 2) + 3 * division.columns
    atlas = Atlas(
        make_tree(count, used), np.empty_like(middle), np.empty((count, 3, 4)), inverse_head, inverse_tip
    )
    fill_atlas(chain, division, middle, first, atlas)
    return atlas


@inlined
def within_limits(chain: ChainArrays, i: int, value: float) -> float:
    """Clamp a value of joint i to its limits, beyond which rounding may have moved it.

    Otherwise lanes that begin with an empty step would start elsewhere than lanes that begin at once.
    """
    inside: float = min(max(value, chain.lower[i]), chain.upper[i])
    return inside


@entry
def fill_atlas(
    chain: ChainArrays, division: Division, middle: Annotated[Array, "s", "middle"], first: int, atlas: Atlas
) -> None:
    """Compute K and its coordinates for every sample, and sort them.

    Args:
        chain: The arm.
        division: The joints that are divided out.
        middle: Samples of the middle joints, (k, middle joints), k = LEAF_SIZE · 2^depth.
        first: Index of the first middle variable.
        atlas: Allocated by the caller, see `kernels.grid` for the reason; receives all but the two inverses.
    """
    count, joints = len(middle), len(chain.leader)
    poses, features, q = np.empty((count, 3, 4)), np.empty((count, COORDINATES)), np.zeros(len(chain.lower))
    used, begin, end = 0, 0 if division.head == NONE else 1, joints - 1 if division.tail == TURN else joints
    for i in range(count):
        T = poses[i]
        identity(T)
        for j in range(middle.shape[1]):
            q[first + j] = within_limits(chain, first + j, middle[i, j])
        advance_segment(chain, begin, end, q, T)
        # K ends with the fixed transform before the last joint, or with that of the tip.
        advance(chain.fixed[end], True, 0.0, T)
        used = coordinates(T, division, features[i])
    order = np.empty(count, dtype=np.int64)
    sort_tree(features[:, :used], order, atlas.tree)
    for i in range(count):
        for j in range(middle.shape[1]):
            atlas.middle[i, j] = within_limits(chain, first + j, middle[order[i], j])
        for r in range(3):
            for c in range(4):
                atlas.poses[i, r, c] = poses[order[i], r, c]


class Divided(NamedTuple):
    """An atlas, the joints that are divided out of it, and where these may be."""

    atlas: Atlas
    division: Division
    limits: Limits
    margin: float
    """How far beyond its limits the first or the last joint of a promising sample may be [rad or m]."""


@inlined
def complete_seed(arm: Divided, G: Array, i: int, q: Array) -> bool:
    """Fill q, (n,), from sample i for a goal G in the frame of the first joint; return False if it is not promising.

    A sample is not promising if its first or last joint is beyond its limits by more than the margin. Within the
    margin the joint is clamped to the limit, because the sample is only near the solution.
    """
    atlas, division, lower, upper = arm.atlas, arm.division, arm.limits.lower, arm.limits.upper
    dof, K, margin = len(lower), atlas.poses[i], arm.margin
    first = 0 if division.head == NONE else 1
    for j in range(atlas.middle.shape[1]):
        q[first + j] = atlas.middle[i, j]
    cosine, sine = 1.0, 0.0
    if division.head == TURN:
        # The rotation about z that brings several vectors closest to others has the angle atan2(Σ cross, Σ dot).
        # Directions count like points at the distance `length` from the axis.
        dot, cross = K[0, 3] * G[0, 3] + K[1, 3] * G[1, 3], K[0, 3] * G[1, 3] - K[1, 3] * G[0, 3]
        weight = division.length * division.length
        for k in range(division.columns):
            c = 2 if division.tail == TURN else k
            dot += weight * (K[0, c] * G[0, c] + K[1, c] * G[1, c])
            cross += weight * (K[0, c] * G[1, c] - K[1, c] * G[0, c])
        q[0] = nearest_copy(rough_angle(cross, dot), lower[0], upper[0], 0.5 * (lower[0] + upper[0]))
        far = math.sqrt(dot * dot + cross * cross)
        if far > 0.0:
            cosine, sine = dot / far, cross / far
    elif division.head == SLIDE:
        q[0] = G[2, 3] - K[2, 3]
    if division.tail == TURN:
        # M = (J_1 K)ᵀ G: the rotation about z closest to it.
        gx, gy, gz = cosine * G[0, 0] + sine * G[1, 0], cosine * G[1, 0] - sine * G[0, 0], G[2, 0]
        along = K[0, 0] * gx + K[1, 0] * gy + K[2, 0] * gz
        across = K[0, 1] * gx + K[1, 1] * gy + K[2, 1] * gz
        gx, gy, gz = cosine * G[0, 1] + sine * G[1, 1], cosine * G[1, 1] - sine * G[0, 1], G[2, 1]
        along += K[0, 1] * gx + K[1, 1] * gy + K[2, 1] * gz
        across -= K[0, 0] * gx + K[1, 0] * gy + K[2, 0] * gz
        last = dof - 1
        q[last] = nearest_copy(
            rough_angle(across, along), lower[last], upper[last], 0.5 * (lower[last] + upper[last])
        )
    for j in (0, dof - 1):
        if q[j] < lower[j] - margin or q[j] > upper[j] + margin:
            return False
        q[j] = min(max(q[j], lower[j]), upper[j])
    return True
