"""The two pictures of docs/atlas.md: the samples in the space of hand positions, and the path of one query.

python -m benchmarks.atlas_pictures        # writes docs/pictures/atlas_samples.png and atlas_query.png
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import kinseek
from kinseek import plots
from kinseek.kernels.arm.division import Division
from kinseek.kernels.arm.links import links_of
from kinseek.kernels.arrays import Limits
from kinseek.kernels.atlas import lanes as eight
from kinseek.kernels.atlas import samples as atlas
from kinseek.kernels.atlas import tree as neighbours
from kinseek.kernels.atlas.descent import DAMPING, LONGEST
from kinseek.kernels.atlas.lanes import LANES, Lanes
from kinseek.kernels.atlas.samples import Atlas, Divided, build_atlas
from kinseek.kernels.atlas.seeds import MARGIN
from kinseek.kernels.atlas.tree import LEAF_SIZE, MOST_LEVELS, Neighbours
from kinseek.kernels.jit import exposed
from kinseek.kinds import POSE
from kinseek.robots.geometry import divide, open_limits
from kinseek.robots.sampling import middle_samples
from kinseek.solvers.atlas.index import SAMPLES
from kinseek.support.transforms import inverse

from .command import PICTURES, command, writes

Array = NDArray[np.float64]

ARM = "ur5e"

lanes_forward, lanes_residual = exposed(eight.lanes_forward), exposed(eight.lanes_residual)
lanes_jacobian, lanes_hold = exposed(eight.lanes_jacobian), exposed(eight.lanes_hold)
lanes_gram, lanes_solve = exposed(eight.lanes_gram), exposed(eight.lanes_solve)
lanes_move = exposed(eight.lanes_move)
complete_seed, coordinates = exposed(atlas.complete_seed), exposed(atlas.coordinates)
nearest = exposed(neighbours.nearest)

STEPS = 8


class Query:
    """An atlas of an arm, and one goal looked up and refined with every step kept."""

    def __init__(self, arm: kinseek.Arm, target: Array) -> None:
        """Look up and refine."""
        self.arm, chain = arm, arm.chain
        self.division: Division = divide(chain, POSE)
        middle, first = middle_samples(chain, self.division, SAMPLES)
        head, tip = inverse(chain.fixed[0]), inverse(chain.fixed[-1])
        self.atlas: Atlas = build_atlas(chain.arrays, self.division, middle, first, head.copy(), tip.copy())
        self.samples = self.seen(self.atlas.poses)
        square = [np.vstack([A, [0.0, 0.0, 0.0, 1.0]]) for A in (head, tip)]
        self.frames = square[0], square[1]
        G = np.ascontiguousarray((square[0] @ target @ square[1])[:3])
        self.goal = self.seen(G[None])[0]
        point, distance, index = np.empty(9), np.empty(64), np.empty(64, dtype=np.int64)
        used = coordinates(G, self.division, point)
        stack, bound = np.empty(MOST_LEVELS, dtype=np.int64), np.empty(MOST_LEVELS)
        room = Neighbours(distance, index, stack, bound, np.empty(LEAF_SIZE))
        found = nearest(self.atlas.tree, point[:used], 64, room)
        divided = Divided(self.atlas, self.division, Limits(chain.lower, chain.upper), MARGIN)
        seeds: list[Array] = []
        for i in index[:found]:
            q = np.empty(arm.dof)
            if len(seeds) < LANES and complete_seed(divided, G, i, q):
                seeds.append(q)
        self.walk(np.array(seeds), target)

    def seen(self, poses: Array) -> Array:
        """Radius, height [m] and how far the last axis leans from the first [deg], of poses (k, 3, 4), (k, 3)."""
        lean = np.degrees(np.arccos(np.clip(poses[:, 2, 2], -1, 1)))
        return np.stack([np.hypot(poses[:, 0, 3], poses[:, 1, 3]), poses[:, 2, 3], lean], axis=1)

    def walk(self, seeds: Array, target: Array) -> None:
        """Refine the seeds, (LANES, n), and keep joint values, errors and hand coordinates of every step."""
        chain, n = self.arm.chain, self.arm.dof
        lower, upper = open_limits(chain)
        length, links, W = self.division.length, links_of(chain.arrays), LANES
        lanes = Lanes(
            q=np.ascontiguousarray(seeds.T),
            target=np.repeat(target[:3, :, None], W, axis=2),
            pose=np.zeros((3, 4, W)),
            axes=np.zeros((len(chain.leader), 6, W)),
            jacobian=np.zeros((n, 6, W)),
            gram=np.zeros((21, W)),
            residual=np.zeros((6, W)),
            step=np.zeros((n, W)),
            share=np.zeros(W),
            before=np.zeros(W),
            stubborn=np.zeros(W),
            error=np.zeros((4, W)),
            weight=np.repeat([[1.0 / length], [1.0]], W, axis=1),
        )
        errors, points = [], []
        for step in range(STEPS + 1):
            if step:
                lanes_jacobian(chain.leader, links, lanes, 0.0, W)
                lanes_hold(lower, upper, lanes, W)
                lanes_gram(DAMPING, np.full(W, 1e-11), lanes, W)
                lanes_solve(lanes, W)
                lanes_move(lower, upper, LONGEST, lanes, W)
            lanes_forward(chain.leader, links, lanes, W)
            lanes_residual(lanes, np.full(3, 0.5), W)
            errors.append(np.sqrt(lanes.error[0]))
            poses = np.tile(np.eye(4), (W, 1, 1))
            poses[:, :3] = np.moveaxis(lanes.pose, 2, 0)
            points.append(self.seen((self.frames[0] @ poses @ self.frames[1])[:, :3]))
        self.errors, self.points = np.array(errors), np.array(points)


def draw_samples(query: Query, folder: Path) -> None:
    """Radius and height of every sample, coloured by the lean of the last axis, and by the branch of the tree."""
    from matplotlib.colors import to_rgb

    figure, (left, right) = plots.plane(2, size=(9.4, 6.0))
    r, z, lean = query.samples.T
    dots = left.scatter(r, z, c=lean, s=4, cmap="viridis", vmin=0, vmax=180, linewidths=0)
    figure.colorbar(dots, ax=left, label="lean of the last axis from the first [deg]")
    # Neighbours in the tree are the full and the pale shade of one colour, which every eye can tell apart.
    full = np.array([to_rgb(colour) for colour in plots.COLOURS])
    shades = np.stack([full, 0.4 * full + 0.6], axis=1).reshape(-1, 3)
    right.scatter(r, z, c=shades[np.arange(len(r)) * 16 // len(r)], s=4, linewidths=0)
    for axes in (left, right):
        axes.set(xlabel="radius r from the first axis [m]", ylabel="height z along it [m]", aspect="equal")
        axes.set_xlim(0, None)
    left.set_title(f"{query.arm.name}: {len(r):,} samples of the middle joints", fontsize=10)
    right.set_title("The same in the order of the tree: its first 16 branches", fontsize=10)
    plots.save(figure, folder / "atlas_samples.png", dpi=130)


def draw_query(query: Query, folder: Path) -> None:
    """Left: the neighbourhood of the goal and every lane's way. Right: errors step by step."""
    from matplotlib import colormaps

    figure, (left, right) = plots.plane(2, size=(10.0, 4.9))
    colours = colormaps["viridis"](np.linspace(0, 0.9, LANES))
    left.scatter(query.samples[:, 0], query.samples[:, 1], s=6, color="0.65", linewidths=0, label="samples")
    for lane in range(LANES):
        way = query.points[:, lane]
        left.plot(way[:, 0], way[:, 1], "-", color=colours[lane], lw=1.2)
        left.plot(
            way[0, 0],
            way[0, 1],
            "o",
            color=colours[lane],
            ms=6,
            label="nearest samples" if lane == 0 else None,
        )
        right.semilogy(np.maximum(query.errors[:, lane], 1e-17), "o-", color=colours[lane], ms=4, lw=1.2)
    left.plot(*query.goal[:2], "*", color="crimson", ms=11, label="goal", zorder=5)
    spread = 1.6 * np.abs(query.points[:, :, :2] - query.goal[:2]).max()
    left.set(
        xlim=(query.goal[0] - spread, query.goal[0] + spread),
        ylim=(query.goal[1] - spread, query.goal[1] + spread),
        xlabel="radius r [m]",
        ylabel="height z [m]",
        aspect="equal",
    )
    left.set_title("The goal, its nearest samples, and their ways", fontsize=10)
    figure.legend(loc="outside lower center", ncols=3, markerscale=1.7, borderpad=0.8)
    right.axhline(1e-6, color="crimson", lw=1, ls="--")
    right.text(STEPS, 1.6e-6, "1e-6 m", color="crimson", ha="right")
    right.set(
        xlabel="damped Newton steps", ylabel="distance of the hand from the goal [m]", xticks=range(STEPS + 1)
    )
    right.set_title("Eight refinements side by side", fontsize=10)
    plots.save(figure, folder / "atlas_query.png", dpi=130)


def main() -> None:
    """Draw both."""
    parser = command(__file__, __doc__)
    writes(parser, "--folder", PICTURES, "folder for the pictures")
    folder = parser.parse_args().folder
    arm = kinseek.load(ARM)
    query = Query(arm, arm.fk(np.array([0.4, -1.1, 1.3, -0.9, 1.2, 0.5])))
    draw_samples(query, folder)
    draw_query(query, folder)
    print(f"wrote {folder / 'atlas_samples.png'} and atlas_query.png")


if __name__ == "__main__":
    main()
