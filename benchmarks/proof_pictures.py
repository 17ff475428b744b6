"""The pictures of the pages on proofs: tightness of bounds, cost against gap and joints.

python -m benchmarks.proof_pictures            # writes docs/proof_*.png, and the numbers of boxes to proof_cost.csv
python -m benchmarks.proof_pictures --redraw   # the same pictures, with the cost from the CSV
"""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

import kinseek
from kinseek import Problem, plots
from kinseek.kernels.proof.progress import ENDED
from kinseek.proof.boxes import enclosed, excluded
from kinseek.solution import Solution

from .command import ROOT, command, writes
from .proof import unreachable
from .targets import Array

Row = dict[str, str]

DOCS = ROOT / "docs"
ROWS = ROOT / "benchmarks" / "proof_cost.csv"

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


def first_order_bounds(arm: kinseek.Arm, c: Array, h: Array) -> tuple[float, float]:
    """Bounds of the tip's motion in the box c ± h, (n,), by radii at the centre and by link sums [m]."""
    # The first three rows of the Jacobian of a turning joint are the cross product of its axis and the way to the tip.
    radii = np.linalg.norm(arm.jacobian(c)[:3], axis=0)
    links = np.linalg.norm(arm.chain.fixed[1:, :, 3], axis=1)
    here = (2 * np.sin(np.minimum(h, np.pi) / 2) * radii).sum()
    return float(here), float((h * np.cumsum(links[::-1])[::-1]).sum())


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
                sizes.append(h[0])
                ratios.append(moves / first_order_bounds(arm, c, h)[column])
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
    last, left_of = (0, 0.0), False
    for row in proofs:
        place = int(row["joints"]), float(row["boxes"])
        right.semilogy(*place, "o", color=plots.COLOURS[0])
        # A name stands on that side of its dot where the curve is not, or across from the name that it would cover.
        covers = last[0] == place[0] and place[1] < 1.5 * last[1]
        left_of = not left_of if covers else place[1] > curve[place[0] - 2]
        look = {"ha": "right" if left_of else "left", "va": "center", "textcoords": "offset points"}
        right.annotate(row["arm"], place, xytext=(-6 if left_of else 6, 0), **look)
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
    draw_tightness(options.folder)
    draw_cost(read_rows(options.rows), options.folder)
    print(f"wrote {options.folder / 'proof_tightness.png'} and proof_cost.png")


def read_rows(path: Path) -> list[Row]:
    """The boxes counted."""
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


if __name__ == "__main__":
    main()
