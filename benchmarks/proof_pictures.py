"""The pictures of docs/proof.md: boxes of a two-link arm, tightness of the bounds, cost against the gap and the joints.

python -m benchmarks.proof_pictures            # writes docs/proof_*.png
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from numpy.typing import NDArray

import kinseek
from kinseek import Goal, Problem
from kinseek.kernels.exclusion import ENDED, examine
from kinseek.solution import Solution
from kinseek.solvers.branch_and_bound import enclosed, excluded
from kinseek.solvers.questions import question, start_boxes

from .proof import unreachable

mpl.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.patches import Rectangle

Array = NDArray[np.float64]

DOCS = Path(__file__).parent.parent / "docs"


def undivided(problem: Problem) -> tuple[Any, Any, Any, Array]:
    """The question about both joints of a two-link arm: a position goal, nothing divided out."""
    form, wanted, roll = question(problem)
    fixed = form.fixed.copy()
    fixed[0] = problem.arrays.fixed[0]
    target = np.ascontiguousarray(problem.goal.targets[0])
    return (
        form._replace(fixed=fixed, head=0),
        wanted._replace(target=target),
        roll,
        start_boxes(problem.chain, False),
    )


def two_link_boxes(problem: Problem, largest: int) -> list[tuple[Array, bool]]:
    """Boxes in the order examined, as they are before they are cut: the box, (4,), and whether it was kept."""
    form, wanted, roll, boxes = undivided(problem)
    queue: list[Array] = [boxes[0]]
    seen: list[tuple[Array, bool]] = []
    while queue and len(seen) < largest:
        box = queue.pop(0)
        result = examine(form, wanted, roll, box[None].copy(), -1.0, 0)[0]
        kept = bool(result[0])
        seen.append((box, kept))
        if kept and box[2:].max() > 0.02:
            i = int(np.argmax(box[2:]))
            for side in (-0.5, 0.5):
                child = box.copy()
                child[2 + i] *= 0.5
                child[i] += side * box[2 + i]
                queue.append(child)
    return seen


def draw_boxes() -> None:
    """Pruned and kept boxes of a two-link arm: a point in reach, a point out of reach."""
    arm = kinseek.load("planar2")
    figure, axes = plt.subplots(1, 2, figsize=(10, 5))
    inside, outside = arm.fk([1.0, 1.2])[:3, 3], arm.fk([1.0, 0.0])[:3, 3] * 1.01
    for axis, point, title in zip(axes, (inside, outside), ("in reach", "1 % out of reach"), strict=True):
        seen = two_link_boxes(Problem(arm.chain, Goal.position(point)), 4000)
        smallest = {tuple(box) for box, kept in seen if kept and box[2:].max() <= 0.02}
        for box, kept in seen:
            if kept and tuple(box) not in smallest:
                continue
            colour = "#c33" if kept else plt.cm.Blues(0.15 + 0.6 * min(1.0, 0.05 / box[2:].max()))
            left, bottom = box[:2] - box[2:]
            axis.add_patch(
                Rectangle(
                    (left, bottom), 2 * box[2], 2 * box[3], facecolor=colour, edgecolor="white", linewidth=0.3
                )
            )
        axis.set(xlabel="q₁ [rad]", ylabel="q₂ [rad]", aspect="equal", title=f"{title}: {len(seen)} boxes")
        axis.autoscale_view()
    figure.suptitle(
        "Two-link arm, first-order test alone, nothing divided out. Blue: proved empty. Red: left."
    )
    figure.tight_layout()
    figure.savefig(DOCS / "proof_boxes.png", dpi=110)


def first_order_bound(form: Any, c: Array, h: Array, arm: kinseek.Arm) -> tuple[float, float]:
    """Bound of the tip's motion by radii at the centre, and by link sums, both for the box c ± h."""
    chain, T = arm.chain, np.eye(4)
    axes = []
    for k in range(len(chain.leader)):
        T = T @ np.vstack([chain.fixed[k], [0, 0, 0, 1]])
        axes.append((T[:3, 2].copy(), T[:3, 3].copy()))
        J = np.eye(4)
        cosine, sine = np.cos(c[k]), np.sin(c[k])
        J[:2, :2] = [[cosine, -sine], [sine, cosine]]
        T = T @ J
    p = (T @ np.vstack([chain.fixed[-1], [0, 0, 0, 1]]))[:3, 3]
    links = np.linalg.norm(chain.fixed[1:, :, 3], axis=1)
    here = sum(
        2 * np.sin(min(h[k], np.pi) / 2) * np.linalg.norm(np.cross(z, p - o)) for k, (z, o) in enumerate(axes)
    )
    return float(here), float(sum(h[k] * links[k:].sum() for k in range(len(axes))))


def draw_tightness() -> None:
    """True motion over bound, for boxes of all sizes."""
    rng = np.random.default_rng(0)
    figure, axes = plt.subplots(1, 2, figsize=(10, 4), sharey=True)
    for axis, name in zip(axes, ("ur5e", "panda"), strict=True):
        arm = kinseek.load(name)
        for column, label in ((0, "radii at the centre"), (1, "link sums")):
            sizes, ratios = [], []
            for _ in range(200):
                c = rng.uniform(arm.lower, arm.upper)
                h = np.full(arm.dof, 10 ** rng.uniform(-3, 0))
                corners = c + h * rng.choice([-1.0, 1.0], (300, arm.dof))
                moves = np.linalg.norm(arm.fk(corners)[:, :3, 3] - arm.fk(c)[:3, 3], axis=1).max()
                bound = first_order_bound(None, c, h, arm)[column]
                sizes.append(h[0])
                ratios.append(moves / bound)
            axis.semilogx(sizes, ratios, ".", label=label)
        axis.set(xlabel="half width of the box [rad]", title=name, ylim=(0, 1.05))
    axes[0].set_ylabel("largest motion of the tip / bound")
    axes[0].legend()
    figure.tight_layout()
    figure.savefig(DOCS / "proof_tightness.png", dpi=110)


def gate_left_open(arm: kinseek.Arm, count: int) -> list[tuple[Problem, Solution]]:
    """Goals out of reach that lengths and angles alone do not decide."""
    return [(p, a) for p, a in unreachable(arm, count) if excluded(p, 0).outcome != ENDED]


def draw_cost() -> None:
    """Boxes against the relative gap, and against the number of joints."""
    figure, axes = plt.subplots(1, 2, figsize=(10, 4))
    counts: dict[int, list[float]] = {}
    gaps = np.array([0.5, 0.3, 0.2, 0.1, 0.05, 0.02, 0.01, 0.005])
    for name in ("ur5e", "kr6r900", "so101"):
        problems = gate_left_open(kinseek.load(name), 40)[:8]
        boxes = [np.median([enclosed(p, a.q, g, 500_000).boxes for p, a in problems]) for g in gaps]
        axes[0].loglog(gaps, boxes, "o-", label=name)
    axes[0].loglog(gaps, 300 * gaps**-2.5, "--", color="grey", label="bounds of order 1: gap^(-n/2), n = 5")
    axes[0].set(
        xlabel="relative gap",
        ylabel="boxes, median",
        title="nearest pose",
        ylim=(1, 1e6),
    )
    axes[0].legend()
    names = (
        "planar2",
        "cylindrical3",
        "scara4",
        "so101",
        "m430ia2f",
        "ur5e",
        "puma560",
        "panda",
        "iiwa14",
        "xarm7",
    )
    for name in names:
        arm = kinseek.load(name)
        problems = gate_left_open(arm, 150)
        if not problems:
            continue
        count = float(np.median([excluded(p, 1_000_000).boxes for p, _ in problems]))
        counts[arm.dof] = [*counts.get(arm.dof, []), count]
        axes[1].semilogy(arm.dof, count, "o")
        axes[1].annotate(name, (arm.dof, count), fontsize=7, xytext=(4, 0), textcoords="offset points")
    # The first joint's azimuth and the last joint are divided out; the others are cut to half widths h that suffice.
    joints, h = np.arange(2, 8), np.pi / np.exp(np.mean(np.log(counts[6]))) ** 0.25
    axes[1].semilogy(
        joints, (np.pi / h) ** (joints - 2), "--", color="grey", label=f"(π/h)^(n-2), h = {h:.2f} rad"
    )
    axes[1].legend()
    axes[1].set(
        xlabel="joints",
        ylabel="boxes, median",
        title="proof that there is no answer",
        xlim=(1.5, 8),
    )
    figure.suptitle("Goals that lengths and angles alone leave open")
    figure.tight_layout()
    figure.savefig(DOCS / "proof_cost.png", dpi=110)


if __name__ == "__main__":
    draw_boxes()
    draw_tightness()
    draw_cost()
