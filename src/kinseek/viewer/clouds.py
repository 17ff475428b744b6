"""Point clouds around a goal: samples of the atlas, nodes of a search, the reachable region, boxes of a proof."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinseek.arm import Arm
from kinseek.errors import KinseekError
from kinseek.kernels.arm.division import NONE, SLIDE, TURN
from kinseek.kinds import POSE
from kinseek.problem import Problem, within_limits
from kinseek.robots.chain import SerialChain
from kinseek.robots.geometry import divide
from kinseek.robots.sampling import weyl
from kinseek.solvers.atlas.solver import Atlas
from kinseek.solvers.black_box.samples import Samples
from kinseek.support.transforms import inverse, square
from kinseek.support.turns import TURN as TURNS
from kinseek.trace import Pass

from .options import ViewerOptions

Array = NDArray[np.float64]

NEAREST = 400
"""Number of samples of the atlas that are shown."""

NODES, NODES_OF_SLOW = 2_000, 200
"""Maximum number of nodes of a pass that are shown, and for an arm whose FK may be slow; if there are more, this many spread
evenly among them."""

PLACES, PIECE, SOON = 6_000, 128, 0.1
"""Number of positions tried for the reachable region, largest number tried at a time, and time that this should take if the
FK of the arm may be slow [s]: nothing ends it earlier."""

BOXES = (30, 100, 300, 1_000, 3_000, 10_000, 30_000)
"""Numbers of examined boxes at which the remaining ones are shown."""


class Cloud(NamedTuple):
    """Points, and a number between 0 and 1 for the colour of each."""

    points: Array
    """Points, (k, 3) [m]."""
    shade: Array
    """Colour values, (k,)."""


class Reached(NamedTuple):
    """The part of the reachable region at one orientation that is known so far."""

    points: Array
    """Positions with a solution, (k, 3) [m]."""
    tried: int
    total: int


def completed(chain: SerialChain, q: Array, target: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Choose the first and the last joint so that the tip comes near a goal, as the atlas and the proofs divide them out.

    Args:
        chain: The arm.
        q: Joint values, (k, n), of which those of the joints between are used.
        target: Pose of the tip, (4, 4).

    Returns:
        Joint values, (k, n), inside the limits, and whether they were inside without correction, (k,).
    """
    division, q = divide(chain, POSE), np.array(q, dtype=float)
    head, last = square(inverse(chain.fixed[0])), square(inverse(chain.fixed[-1]))
    goal = head @ target @ last
    if division.head != NONE:
        q[:, 0] = 0.0
    if division.tail == TURN:
        q[:, -1] = 0.0
    axis = (head @ chain.forward(q) @ last)[:, :3, 3]
    if division.head == SLIDE:
        q[:, 0] = goal[2, 3] - axis[:, 2]
    elif division.head == TURN:
        q[:, 0] = np.arctan2(goal[1, 3], goal[0, 3]) - np.arctan2(axis[:, 1], axis[:, 0])
    if division.tail == TURN:
        turn = np.swapaxes((chain.forward(q) @ last)[:, :3, :3], 1, 2) @ (target @ last)[:3, :3]
        q[:, -1] = np.arctan2(turn[:, 1, 0] - turn[:, 0, 1], turn[:, 0, 0] + turn[:, 1, 1])
    inside = within_limits(chain, q)
    moved = inside - q
    moved -= np.where(chain.turns, TURNS * np.rint(moved / TURNS), 0.0)
    return inside, np.asarray((np.abs(moved) < 1e-9).all(axis=1))


def samples_around(arm: Arm, options: ViewerOptions) -> Cloud:
    """Return the tip positions of the atlas's samples nearest to a goal, shaded by tilt, (k up to `NEAREST`)."""
    index, target = arm.atlas, options.target
    if isinstance(index, Samples):
        poses, length = index.poses, index.length
    else:
        chain, division = arm.chain, divide(arm.chain, POSE)
        middle, first = index.sorted.middle, int(division.head != NONE)
        q = np.zeros((len(middle), chain.dof))
        q[:, first : first + middle.shape[1]] = middle
        q, fits = completed(chain, q, target)
        poses, length = chain.forward(q[fits]), division.length
    if set(options.free) >= {"rx", "ry", "rz"}:
        length = 0.0
    cosine = (np.einsum("kij,ij->k", poses[:, :3, :3], target[:3, :3]) - 1.0) / 2.0
    lean = np.arccos(np.clip(cosine, -1.0, 1.0))
    miss = np.linalg.norm(poses[:, :3, 3] - target[:3, 3], axis=1)
    nearest = np.argsort(miss + length * lean, kind="stable")[:NEAREST]
    return Cloud(poses[nearest, :3, 3], lean[nearest] / np.pi)


def visited(arm: Arm, one: Pass) -> Array:
    """Return the tip positions at the nodes of a pass, (k up to `NODES`, 3) [m]; without a grid, at its start."""
    if one.counts is None or one.lower is None or one.upper is None:
        return arm.fk(one.q[None] if one.start is None else np.stack([one.start, one.q]))[:, :3, 3]
    total = float(np.prod(one.counts.astype(float)))
    most = NODES if arm.axes is not None else NODES_OF_SLOW
    if total <= most:
        values = [one.values(i) for i in range(arm.dof)]
        q = np.stack(np.meshgrid(*values, indexing="ij"), axis=-1).reshape(-1, arm.dof)
    else:
        number = np.minimum((weyl(most, arm.dof) * one.counts).astype(int), one.counts - 1)
        step = (one.upper - one.lower) / np.maximum(one.counts - 1, 1)
        q = one.lower + number * step
    mechanism = arm.mechanism
    q = q if arm.axes is not None else within_limits(mechanism, q)
    places = arm.fk(q)[:, :3, 3]
    return np.asarray(places[np.isfinite(places).all(axis=1)])


def reachable(
    arm: Arm, options: ViewerOptions, stopped: Callable[[], bool], known: Reached | None = None
) -> Iterator[Reached]:
    """Try the goal's orientation at positions all over the arm's reach, piece by piece.

    A position is shown if a solution was found. A position that is not shown is not proved unreachable.

    Args:
        arm: The arm.
        options: Options with the orientation; free axes of the position do not count.
        stopped: Returns whether the result is no longer needed.
        known: Result to continue from.
    """
    low, high = surroundings(arm)
    places = low + np.random.default_rng(0).random((PLACES, 3)) * (high - low)
    found = np.zeros((0, 3)) if known is None else known.points
    # With a free position axis a solution may be elsewhere.
    goal = options.but(free=tuple(axis for axis in options.free if axis not in ("x", "y", "z"))).goal
    tried, size = 0 if known is None else known.tried, PIECE if arm.axes is not None else 1
    while tried < len(places) and not stopped():
        began, piece = time.monotonic(), places[tried : tried + size]
        targets = np.tile(options.target, (len(piece), 1, 1))
        targets[:, :3, 3] = piece
        solution = Atlas(threads=1).solve(Problem(arm.mechanism, goal.at(targets)))
        found, tried = np.concatenate([found, piece[solution.success]]), tried + len(piece)
        if arm.axes is None:
            size = min(2 * size, PIECE) if time.monotonic() - began < SOON else max(size // 2, 1)
        yield Reached(found, tried, len(places))


def surroundings(arm: Arm) -> tuple[Array, Array]:
    """Return the corners of a box that contains the tip, from samples, (3,) each [m]; flat for a planar arm."""
    places = arm.fk(arm.sample(4_000 if arm.mechanism.cheap else 500))[:, :3, 3]
    places = places[np.isfinite(places).all(axis=1)]
    low, high = places.min(axis=0), places.max(axis=0)
    more = np.where(high - low > 1e-9, 0.05 * (high - low), 0.0)
    return low - more, high + more


def boxes_left(arm: Arm, options: ViewerOptions, q: Array, examined: int) -> Cloud | str:
    """Return the tip positions at the centres of the boxes that a proof has not excluded yet, shaded by their bounds.

    Args:
        arm: The arm.
        options: Options with the missed goal.
        q: The best joint values known, (n,).
        examined: Number of examined boxes.

    Returns:
        The cloud, or the reason why there is none.
    """
    from kinseek.proof.boxes import enclosed

    if arm.axes is None:
        return "A proof needs the axes of an arm."
    try:
        options.goal.require_plain("the boxes of a proof are not shown for")
        left = enclosed(Problem(arm.mechanism, options.goal), q, 1e-3, examined, threads=1).left
    except KinseekError as error:
        return str(error)
    variables = left.shape[1] // 2
    if not variables or not len(left):
        return "No box is left: the nearest pose is known."
    middle = np.tile(q, (len(left), 1))
    middle[:, :variables] = left[:, :variables]
    q, _ = completed(arm.axes, middle, options.target)
    bound = left[:, -1]
    extent = float(np.ptp(bound))
    return Cloud(arm.fk(q)[:, :3, 3], (bound - bound.min()) / extent if extent > 0 else np.zeros(len(left)))


def same_question(one: ViewerOptions, other: ViewerOptions) -> bool:
    """Return whether both options have the same reachable region: the same orientation and the same free axes."""
    difference = np.abs(one.target[:3, :3] - other.target[:3, :3]).max()
    return one.free == other.free and bool(difference < 1e-9 or set(one.free) >= {"rx", "ry", "rz"})
