"""Pictures of the atlas of an arm: its sorted samples, and those among which a pose is looked up."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinseek.arm import Arm
from kinseek.errors import InvalidUse
from kinseek.goal import Goal
from kinseek.kernels.arm.division import TURN, Division
from kinseek.kernels.atlas.tree import LEAF_SIZE, Tree
from kinseek.kinds import POSE
from kinseek.robots.geometry import divide
from kinseek.solvers.atlas.index import AtlasIndex, atlas_of
from kinseek.support.transforms import square

from .figures import COLOURS, drawn, plane, text_of

Array = NDArray[np.float64]

GREY, NEIGHBOURS, OWN = "0.8", COLOURS[0], COLOURS[1]


@drawn
def samples(arm: Arm, pose: ArrayLike, *, size: tuple[float, float] = (9.4, 5.0)) -> Any:
    """Draw the samples of an arm's atlas in tip space, and the leaf of its tree that contains a pose.

    The first joint and the last one are divided out. The remaining coordinates of a pose are the distance of the last axis
    from the first, its height along it, and its direction. The left side shows every sample, the right side the samples
    around the pose. An arrow is a sample, along its direction as far as it lies in the plane. Samples of the leaf that
    contains the pose are red, those of neighbouring leaves that are also searched are blue.

    Args:
        arm: An arm with axes whose first and last joints are revolute and not coupled with others.
        pose: A pose, (4, 4).
        size: Size of the figure [inch].

    Returns:
        The Matplotlib figure.

    Raises:
        InvalidGoal: Not a pose.
        InvalidProblem: An arm with black-box kinematics.
        InvalidUse: A batch of poses, or an arm whose first and last joint cannot be divided out.
        MissingExtra: Matplotlib is not installed.
    """
    goal = Goal.pose(pose)
    if goal.shape:
        raise InvalidUse(f"one pose is looked up, got a batch of shape {goal.shape}; choose one")
    index, division = atlas_of(arm.chain), divide(arm.chain, POSE)
    if division.head != TURN or division.tail != TURN:
        raise InvalidUse(
            f"the picture needs an arm whose first and last joint turn and move no other joint; {arm.name!r} is not "
            "such an arm"
        )
    tree = index.sorted.tree
    query = coordinates(_seen(index, goal.targets[0]), division)[0]
    every = coordinates(index.sorted.poses, division)
    leaf = leaf_of(tree, query)
    own = np.arange(leaf * LEAF_SIZE, (leaf + 1) * LEAF_SIZE)
    beside = tree.beside[leaf]
    near = (beside[(beside >= 0) & (beside != leaf)][:, None] * LEAF_SIZE + np.arange(LEAF_SIZE)).ravel()
    figure, (left, right) = plane(2, size=size)
    left.hexbin(every[:, 0], every[:, 1], gridsize=60, mincnt=1, bins="log", cmap="Greys", linewidths=0.1)
    _arrows(right, np.delete(every, np.concatenate([own, near]), axis=0), color=GREY, width=0.003)
    _arrows(
        right,
        every[near],
        color=NEIGHBOURS,
        width=0.004,
        label=f"{len(near)} samples of the leaves beside it",
    )
    _arrows(right, every[own], color=OWN, width=0.006, label=f"{LEAF_SIZE} samples of the pose's leaf")
    _arrows(right, query[None], color="black", width=0.008)
    for axes in (left, right):
        axes.plot(*query[:2], "*", color="black", markersize=11, label="the pose", linestyle="none")
        axes.set(xlabel="radius from the first axis [m]", ylabel="height along it [m]", aspect="equal")
    far = np.abs(every[:, :2] - query[:2]).max(axis=1)
    least = 0.05 * division.length  # All samples may coincide: with two joints there is none in the middle.
    around = float(np.percentile(far[near], 70)) if len(near) else 0.0
    spread = 1.15 * max(least, float(far[own].max()), around)
    right.set(xlim=query[0] + spread * np.array([-1, 1]), ylim=query[1] + spread * np.array([-1, 1]))
    left.add_patch(_square(query[:2], spread))
    left.set_title(f"{text_of(arm.name)}: {index.samples:,} samples, darker where there are more")
    right.set_title("in the frame, with the directions of the last axis")
    handles, labels = right.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, frameon=False)
    return figure


def coordinates(K: Array, division: Division) -> Array:
    """Return the coordinates of poses, (k, 3, 4), with both joints divided out, (k, 5).

    They are as in `kernels.atlas.samples.coordinates`.
    """
    r = np.hypot(K[:, 0, 3], K[:, 1, 3])
    cosine, sine = np.where(r > 0, K[:, :2, 3].T / np.maximum(r, 1e-300), [[1.0], [0.0]])
    flat = division.length * r / np.hypot(r, division.length)
    x, y, z = K[:, :, 2].T
    columns = [
        r,
        K[:, 2, 3],
        flat * (cosine * x + sine * y),
        flat * (cosine * y - sine * x),
        division.length * z,
    ]
    return np.stack(columns, axis=1)


def leaf_of(tree: Tree, point: Array) -> int:
    """Return the leaf that contains a point, (5,)."""
    node, inner = 0, len(tree.points) - 1
    while node < inner:
        node = 2 * node + (1 if point[tree.axis[node]] < tree.split[node] else 2)
    return node - inner


def _seen(index: AtlasIndex, target: Array) -> Array:
    """Convert a pose, (3, 4), to the form of the stored samples, (1, 3, 4)."""
    sorted_ = index.sorted
    whole = square(sorted_.inverse_head) @ square(target) @ square(sorted_.inverse_tip)
    return np.asarray(whole[None, :3])


def _arrows(axes: Any, points: Array, **look: Any) -> None:
    """Draw an arrow at every point, along its direction in the plane of radius and height."""
    unit = np.linalg.norm(points[:, 2:], axis=1)[:, None]
    along = points[:, [2, 4]] / np.maximum(unit, 1e-300)
    axes.quiver(*points[:, :2].T, *along.T, angles="xy", scale=18.0, pivot="tail", **look)


def _square(centre: Array, half: float) -> Any:
    from matplotlib.patches import Rectangle

    corner = float(centre[0] - half), float(centre[1] - half)
    return Rectangle(corner, 2 * half, 2 * half, fill=False, edgecolor="black", linewidth=1.2)
