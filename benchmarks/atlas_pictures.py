"""The two pictures of docs/atlas.md: the samples in the space of hand positions, and the path of one query.

python -m benchmarks.atlas_pictures        # writes docs/pictures/atlas_samples.png and atlas_query.png
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

import kinseek
from kinseek import plots
from kinseek.kernels.atlas.descent import DAMPING
from kinseek.kernels.atlas.lanes import LANES
from kinseek.kernels.atlas.memory import LAYOUT
from kinseek.kernels.atlas.one_goal import search_within
from kinseek.solvers.atlas.index import PLAIN, atlas_of
from kinseek.solvers.atlas.tracing import filled_lanes
from kinseek.support.transforms import inverse, square

from .command import PICTURES, command, writes
from .targets import Array

ARM, VALUES = "ur5e", (0.4, -1.1, 1.3, -0.9, 1.2, 0.5)
"""The arm, and joint values of the pose that is looked up."""

STEPS = 8


class Query(NamedTuple):
    """One goal looked up in the atlas of an arm and refined, every step kept; points are as `seen` gives them."""

    arm: kinseek.Arm
    samples: Array
    """(k, 3)"""
    goal: Array
    """(3,)"""
    points: Array
    """Of each step and lane, (STEPS + 1, LANES, 3)."""
    errors: Array
    """Distances of the hand from the goal, (STEPS + 1, LANES) [m]."""


def query(arm: kinseek.Arm, target: Array) -> Query:
    """Look up a pose, (4, 4), and refine the nearest samples."""
    chain, index = arm.chain, atlas_of(arm.chain)
    sizes = {"dof": arm.dof, "joints": len(chain.leader)}
    memory, q = np.zeros(LAYOUT.count.of(**sizes)), np.empty(arm.dof)
    search_within(index.handle, PLAIN, memory, np.ascontiguousarray(target[:3]), 0.0, q, LANES)
    poses = walk(arm, np.array(filled_lanes(memory, **sizes)), target)
    head, tip = (square(inverse(chain.fixed[end])) for end in (0, -1))
    errors = np.linalg.norm(poses[..., :3, 3] - target[:3, 3], axis=-1)
    return Query(arm, seen(index.sorted.poses), seen(head @ target @ tip), seen(head @ poses @ tip), errors)


def walk(arm: kinseek.Arm, q: Array, target: Array) -> Array:
    """Poses of damped steps (Chan and Lawrence 1988) from joint values, (k, n), as (STEPS + 1, k, 4, 4)."""
    poses = [arm.fk(q)]
    while len(poses) <= STEPS:
        turn = Rotation.from_matrix(target[:3, :3] @ np.swapaxes(poses[-1][:, :3, :3], 1, 2)).as_rotvec()
        off = np.concatenate([target[:3, 3] - poses[-1][:, :3, 3], turn], axis=1)[:, :, None]
        J = arm.jacobian(q)
        damping = DAMPING * (off**2).sum(axis=1, keepdims=True) + 1e-11
        back = np.swapaxes(J, 1, 2)
        q = q + (back @ np.linalg.solve(J @ back + damping * np.eye(6), off))[:, :, 0]
        poses.append(arm.fk(q))
    return np.array(poses)


def seen(poses: Array) -> Array:
    """Radius, height [m] and how far the last axis leans from the first [deg], of poses (..., 3 or 4, 4), (..., 3)."""
    lean = np.degrees(np.arccos(np.clip(poses[..., 2, 2], -1, 1)))
    return np.stack([np.hypot(poses[..., 0, 3], poses[..., 1, 3]), poses[..., 2, 3], lean], axis=-1)


def draw_samples(found: Query, folder: Path) -> None:
    """Radius and height of every sample, coloured by the lean of the last axis, and by the branch of the tree."""
    from matplotlib.colors import to_rgb

    figure, (left, right) = plots.plane(2, size=(9.4, 6.0))
    r, z, lean = found.samples.T
    dots = left.scatter(r, z, c=lean, s=4, cmap="viridis", vmin=0, vmax=180, linewidths=0)
    figure.colorbar(dots, ax=left, label="lean of the last axis from the first [deg]")
    # Neighbours in the tree are the full and the pale shade of one colour, which every eye can tell apart.
    full = np.array([to_rgb(colour) for colour in plots.COLOURS])
    shades = np.stack([full, 0.4 * full + 0.6], axis=1).reshape(-1, 3)
    right.scatter(r, z, c=shades[np.arange(len(r)) * 16 // len(r)], s=4, linewidths=0)
    for axes in (left, right):
        axes.set(xlabel="radius r from the first axis [m]", ylabel="height z along it [m]", aspect="equal")
        axes.set_xlim(0, None)
    left.set_title(f"{found.arm.name}: {len(r):,} samples of the middle joints", fontsize=10)
    right.set_title("The same in the order of the tree: its first 16 branches", fontsize=10)
    plots.save(figure, folder / "atlas_samples.png", dpi=130)


def draw_query(found: Query, folder: Path) -> None:
    """Left: the neighbourhood of the goal and every lane's way. Right: errors step by step."""
    from matplotlib import colormaps

    figure, (left, right) = plots.plane(2, size=(10.0, 4.9))
    lanes = found.points.shape[1]
    left.scatter(found.samples[:, 0], found.samples[:, 1], s=6, color="0.65", linewidths=0, label="samples")
    for lane, colour in enumerate(colormaps["viridis"](np.linspace(0, 0.9, lanes))):
        way = found.points[:, lane]
        left.plot(way[:, 0], way[:, 1], "-", color=colour, lw=1.2)
        label = None if lane else "nearest samples"
        left.plot(way[0, 0], way[0, 1], "o", color=colour, ms=6, label=label)
        right.semilogy(np.maximum(found.errors[:, lane], 1e-17), "o-", color=colour, ms=4, lw=1.2)
    x, y = found.goal[:2]
    left.plot(x, y, "*", color="crimson", ms=11, label="goal", zorder=5)
    spread = 1.6 * np.abs(found.points[:, :, :2] - found.goal[:2]).max()
    left.set(xlim=(x - spread, x + spread), ylim=(y - spread, y + spread), aspect="equal")
    left.set(xlabel="radius r [m]", ylabel="height z [m]")
    left.set_title("The goal, its nearest samples, and their ways", fontsize=10)
    figure.legend(loc="outside lower center", ncols=3, markerscale=1.7, borderpad=0.8)
    right.axhline(1e-6, color="crimson", lw=1, ls="--")
    right.text(STEPS, 1.6e-6, "1e-6 m", color="crimson", ha="right")
    right.set(xlabel="damped Newton steps", xticks=range(STEPS + 1))
    right.set_ylabel("distance of the hand from the goal [m]")
    right.set_title("Refinements side by side", fontsize=10)
    plots.save(figure, folder / "atlas_query.png", dpi=130)


def main() -> None:
    """Draw both."""
    parser = command(__file__, __doc__)
    writes(parser, "--folder", PICTURES, "folder for the pictures")
    folder = parser.parse_args().folder
    arm = kinseek.load(ARM)
    found = query(arm, arm.fk(VALUES))
    draw_samples(found, folder)
    draw_query(found, folder)
    print(f"wrote {folder / 'atlas_samples.png'} and atlas_query.png")


if __name__ == "__main__":
    main()
