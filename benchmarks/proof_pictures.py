"""The pictures of the pages on proofs: boxes of a two-link arm, tightness of bounds, cost against gap and joints.

python -m benchmarks.proof_pictures            # writes docs/proof_*.png, and the numbers of boxes to proof_cost.csv
python -m benchmarks.proof_pictures --redraw   # the same pictures, with the cost from the CSV
"""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import kinseek
from kinseek import Goal, Problem, plots
from kinseek.kernels.proof.box import Form, ProofGoal
from kinseek.kernels.proof.last_joint import LastJoint
from kinseek.kernels.proof.progress import ENDED
from kinseek.proof.boxes import enclosed, excluded
from kinseek.proof.reduce import question, start_boxes
from kinseek.proof.single_boxes import examine
from kinseek.solution import Solution

from .command import ROOT, command, writes
from .proof import unreachable

Array = NDArray[np.float64]
Row = dict[str, str]

DOCS = ROOT / "docs"
ROWS = ROOT / "benchmarks" / "proof_cost.csv"

SMALLEST = 0.02
"""Half width [rad] below which a box of the two-link arm is left as it is."""

LEFT = plots.COLOURS[1]

GAPS = (0.5, 0.3, 0.2, 0.1, 0.05, 0.02, 0.01, 0.005)
ENCLOSED = ("ur5e", "kr6r900", "so101")
PROVED = (
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


def undivided(problem: Problem) -> tuple[tuple[Form, ProofGoal, LastJoint], Array]:
    """The question about both joints of a two-link arm: a position goal, nothing divided out; and its first box, (4,)."""
    form, proof_goal, roll = question(problem)
    fixed = form.fixed.copy()
    fixed[0] = problem.arrays.fixed[0]
    target = np.ascontiguousarray(problem.goal.targets[0])
    asked = form._replace(fixed=fixed, head=0), proof_goal._replace(target=target), roll
    return asked, start_boxes(problem.chain, False)[0]


def two_link_boxes(problem: Problem, largest: int) -> list[tuple[Array, bool]]:
    """Boxes in the order examined, as they are before they are cut: the box, (4,), and whether it was kept."""
    asked, box = undivided(problem)
    queue: list[Array] = [box]
    seen: list[tuple[Array, bool]] = []
    while queue and len(seen) < largest:
        box = queue.pop(0)
        kept = not np.isnan(examine(problem, asked, box[None], passes=0).left).any()
        seen.append((box, kept))
        if kept and box[2:].max() > SMALLEST:
            i = int(np.argmax(box[2:]))
            for side in (-0.5, 0.5):
                child = box.copy()
                child[2 + i] *= 0.5
                child[i] += side * box[2 + i]
                queue.append(child)
    return seen


def draw_boxes(folder: Path) -> None:
    """Pruned and kept boxes of a two-link arm: a point in reach, a point out of reach; below, where boxes are left."""
    from matplotlib.patches import Rectangle

    arm = kinseek.load("planar2")
    figure, axes = plots.plane(2, size=(8.4, 9.2), rows=2)
    inside, outside = arm.fk([1.0, 1.2])[:3, 3], arm.fk([1.0, 0.0])[:3, 3] * 1.01
    for (over, under), point, title in zip(
        axes.T, (inside, outside), ("in reach", "1 % out of reach"), strict=True
    ):
        seen = two_link_boxes(Problem(arm.chain, Goal.position(point)), 4000)
        left = np.array([box for box, kept in seen if kept and box[2:].max() <= SMALLEST])
        draw_cells(over, seen, left, far=True)
        draw_cells(under, seen, left, far=False)
        over.set(
            title=f"{title}: {len(seen)} boxes, {len(left)} left", xlim=(0, 2 * np.pi), ylim=(0, 2 * np.pi)
        )
        near = left[np.abs(left[:, :2] - left[0, :2]).max(axis=1) < 0.5]  # The other answer's are not shown.
        half = 0.3
        x, y = np.clip(near[:, :2].mean(axis=0), half, 2 * np.pi - half)
        under.set(title="inside the black frame", xlim=(x - half, x + half), ylim=(y - half, y + half))
        over.add_patch(Rectangle((x - half, y - half), 2 * half, 2 * half, fill=False, edgecolor="black"))
    for axis in axes.flat:
        axis.grid(False)
        axis.set(xlabel="q₁ [rad]", ylabel="q₂ [rad]", aspect="equal")
    figure.suptitle(
        "Two-link arm, first-order test alone, nothing divided out.\nBlue: proved empty. Red: left."
    )
    plots.save(figure, folder / "proof_boxes.png")


def draw_cells(axis: Any, seen: list[tuple[Array, bool]], left: Array, far: bool) -> None:
    """Draw the boxes proved empty in blue, darker where they are smaller, and those left, (k, 4), in red.

    Seen from `far` those left are few pixels wide: there they get an edge in their own colour.
    """
    from matplotlib import colormaps
    from matplotlib.patches import Rectangle

    def cell(box: Array, **look: Any) -> None:
        axis.add_patch(Rectangle(tuple(box[:2] - box[2:]), 2 * box[2], 2 * box[3], **look))

    for box, kept in seen:
        if not kept:
            shade = 0.1 + 0.4 * min(1.0, 0.05 / box[2:].max())
            cell(box, facecolor=colormaps["Blues"](shade), edgecolor="white", linewidth=0.4)
    for box in left:
        cell(box, facecolor=LEFT, edgecolor=LEFT if far else "white", linewidth=1.2 if far else 0.4)


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


def draw_tightness(folder: Path) -> None:
    """True motion over bound, for boxes of all sizes."""
    rng = np.random.default_rng(0)
    figure, axes = plots.plane(2, size=(8.4, 4.2))
    for axis, name in zip(axes, ("ur5e", "panda"), strict=True):
        arm = kinseek.load(name)
        for column, label, marker in ((0, "radii at the centre", "o"), (1, "link sums", "x")):
            sizes, ratios = [], []
            for _ in range(200):
                c = rng.uniform(arm.lower, arm.upper)
                h = np.full(arm.dof, 10 ** rng.uniform(-3, 0))
                corners = c + h * rng.choice([-1.0, 1.0], (300, arm.dof))
                moves = np.linalg.norm(arm.fk(corners)[:, :3, 3] - arm.fk(c)[:3, 3], axis=1).max()
                bound = first_order_bound(None, c, h, arm)[column]
                sizes.append(h[0])
                ratios.append(moves / bound)
            axis.semilogx(sizes, ratios, marker, color=plots.COLOURS[column], markersize=4, label=label)
        axis.set(xlabel="half width of the box [rad]", title=name, ylim=(0, 1.05))
    axes[0].set_ylabel("largest motion of the tip / bound")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    plots.save(figure, folder / "proof_tightness.png")


def gate_left_open(arm: kinseek.Arm, count: int) -> list[tuple[Problem, Solution]]:
    """Goals out of reach that lengths and angles alone do not decide."""
    return [(p, a) for p, a in unreachable(arm, count) if excluded(p, 0).outcome != ENDED]


def cost_rows() -> list[Row]:
    """Boxes [median of some goals] against the relative gap, and those of a proof; the same on every machine."""
    rows = []
    for name in ENCLOSED:
        arm = kinseek.load(name)
        problems = gate_left_open(arm, 40)[:8]
        for gap in GAPS:
            boxes = [enclosed(p, a.q, gap, 500_000).boxes for p, a in problems]
            rows.append(cost_row(arm, str(gap), boxes))
    for name in PROVED:
        arm = kinseek.load(name)
        problems = gate_left_open(arm, 150)
        if problems:
            rows.append(cost_row(arm, "", [excluded(p, 1_000_000).boxes for p, _ in problems]))
    return rows


def cost_row(arm: kinseek.Arm, gap: str, boxes: list[int]) -> Row:
    """One row; a proof has no gap."""
    row = {
        "arm": arm.name,
        "joints": arm.dof,
        "gap": gap,
        "goals": len(boxes),
        "boxes": float(np.median(boxes)),
    }
    print(", ".join(f"{key} {value}" for key, value in row.items()), flush=True)
    return {key: str(value) for key, value in row.items()}


def draw_cost(rows: list[Row], folder: Path) -> None:
    """Boxes against the relative gap, and against the number of joints."""
    figure, (left, right) = plots.plane(2, size=(9.6, 4.6))
    gaps = np.array(GAPS)
    for name, color, marker in zip(ENCLOSED, plots.COLOURS, "osv", strict=False):
        some = [row for row in rows if row["gap"] and row["arm"] == name]
        where = [float(row["gap"]) for row in some], [float(row["boxes"]) for row in some]
        left.loglog(*where, marker=marker, color=color, label=name)
    left.loglog(gaps, 300 * gaps**-2.5, "--", color="grey", label="bounds of order 1:\ngap^(-n/2), n = 5")
    left.set(xlabel="relative gap", ylabel="boxes, median", title="nearest pose", ylim=(1, 1e6))
    left.legend(loc="lower left")
    proofs = sorted((row for row in rows if not row["gap"]), key=lambda row: float(row["boxes"]))
    counts: dict[int, list[float]] = {}
    for row in proofs:
        counts.setdefault(int(row["joints"]), []).append(float(row["boxes"]))
    # The first joint's azimuth and the last joint are divided out; the others are cut to half widths h that suffice.
    joints, h = np.arange(2, 8), np.pi / np.exp(np.mean(np.log(counts[6]))) ** 0.25
    curve = (np.pi / h) ** (joints - 2)
    right.semilogy(joints, curve, "--", color="grey", label=f"(π/h)^(n-2), h = {h:.2f} rad")
    last, side = (0, 0.0), ""
    for row in proofs:
        place = int(row["joints"]), float(row["boxes"])
        right.semilogy(*place, "o", color=plots.COLOURS[0])
        # A name stands on that side of its dot where the curve is not, or across from the name that it would cover.
        if last[0] == place[0] and place[1] < 1.5 * last[1]:
            side = "left" if side == "right" else "right"
        else:
            side = "right" if place[1] > curve[place[0] - 2] else "left"
        right.annotate(
            row["arm"],
            place,
            xytext=(-6 if side == "right" else 6, 0),
            textcoords="offset points",
            ha=side,
            va="center",
        )
        last = place
    decided = [name for name in PROVED if name not in {row["arm"] for row in proofs}]
    note = f" ({', '.join(decided)}: no goal is left open)" if decided else ""
    right.legend(loc="upper left")
    right.set(
        xlabel="joints" + note,
        ylabel="boxes, median",
        title="proof that there is no answer",
        xlim=(1.5, 7.9),
        ylim=(0.5, 1e6),
    )
    figure.suptitle("Goals that lengths and angles alone leave open")
    plots.save(figure, folder / "proof_cost.png")


def main() -> None:
    """Measure and draw."""
    parser = command(__file__, __doc__)
    parser.add_argument(
        "--redraw", action="store_true", help="do not count boxes again; take them from the CSV"
    )
    writes(parser, "--folder", DOCS, "folder for the pictures")
    writes(parser, "--rows", ROWS, "CSV of the boxes counted")
    options = parser.parse_args()
    if not options.redraw:
        rows = cost_rows()
        with options.rows.open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, rows[0], lineterminator="\n")
            writer.writeheader()
            writer.writerows(rows)
    draw_boxes(options.folder)
    draw_tightness(options.folder)
    draw_cost(read_rows(options.rows), options.folder)
    print(f"wrote {options.folder / 'proof_boxes.png'}, proof_tightness.png and proof_cost.png")


def read_rows(path: Path) -> list[Row]:
    """The boxes counted."""
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


if __name__ == "__main__":
    main()
