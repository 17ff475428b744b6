"""The rules that judge the paper's claims by the CSVs: every verdict comes from numbers, none is typed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from . import question_06
from .arms import ARMS
from .effort import Row, experiment
from .store import ExperimentError, Store
from .style import where

HOLDS = "**holds**"
IN_PART = "**holds in part**"
FAILS = "**does not hold**"
UNKNOWN = "**cannot be known**"

Verdict = tuple[str, str]
"""Our measurement in words and numbers, and the verdict."""


class Results:
    """The rows of every experiment, read when they are first asked for."""

    def __init__(self, folder: Path) -> None:
        """Look in this folder."""
        self.folder = folder
        self.read: dict[str, list[Row]] = {}

    def __call__(self, name: str, **wanted: Any) -> list[Row]:
        """Rows of one experiment whose columns have the wanted values."""
        if name not in self.read:
            store = Store(self.folder, name, experiment(name).COLUMNS)
            if not store.csv.exists():
                raise ExperimentError(
                    f"the tables need {store.csv.name}: run python -m experiments {name} first"
                )
            self.read[name] = store.rows()
        return where(self.read[name], **wanted)

    def one(self, name: str, column: str, **wanted: Any) -> float:
        """One number."""
        return float(self(name, **wanted)[0][column])


def mm(value: float) -> str:
    """A length in [mm], two significant digits, as words."""
    return f"{value:.2g} mm" if value < 100 else f"{value:.0f} mm"


def span(shares: list[float]) -> str:
    """The least and the largest share, in percent."""
    return f"{100 * min(shares):.0f} to {100 * max(shares):.0f}"


def judged(part: int, of: int) -> str:
    """All, some or none."""
    return HOLDS if part == of else IN_PART if part else FAILS


def claim_1(results: Results) -> Verdict:
    """Steps of the work per factor of three in B, and how often the best node is found."""
    nodes = [int(row["nodes_expanded"]) for row in results("figure_11", tree="dynamic")]
    steps = set(np.diff(nodes[1:]).tolist())
    times = [float(row["ms_per_point"]) for row in results("figure_11", tree="dynamic")]
    found = {m: [float(r["best_found"]) for r in results("claim_01", method=m)] for m in ("CB(1)", "CB(3)")}
    logarithmic = len(steps) == 1
    text = (
        f"time: each factor of 3 in B adds {'exactly ' if logarithmic else 'up to '}{max(steps):,} nodes; "
        f"from B = 9 to 3^16, 4.8 million times as many, ×{nodes[14] / nodes[0]:.2g} nodes and "
        f"×{times[14] / times[0]:.2g} time (the paper: ×7); best solution: found for "
        f"{span(found['CB(3)'])} % of the points with CB(3), {span(found['CB(1)'])} % with CB(1)"
    )
    return text, judged(int(logarithmic) + int(min(found["CB(3)"]) > 0.995), 2)


def claim_2(results: Results) -> Verdict:
    """Brute force's counter against the formula."""
    rows = results("figure_05", method="brute force")
    equal = sum(row["nodes_expanded"] == row["equation_1"] for row in rows)
    return f"counted nodes equal Eq. 1 on {equal} of {len(rows)} arms, to the last node", judged(
        equal, len(rows)
    )


def claim_3(results: Results) -> Verdict:
    """The count itself."""
    count = results.one("figure_05", "nodes_expanded", dof=4, method="brute force")
    return f"{count:,.0f} nodes", HOLDS if count > 1e7 else FAILS


def claim_4(results: Results) -> Verdict:
    """Growth from D = 3 to 32, in nodes and in time, CB(3)."""
    parts, growth = [], []
    for dof in (2, 3, 4):
        ends = [results("figure_06", dof=dof, breadth=3, divisions=d)[0] for d in (3, 32)]
        nodes = int(ends[1]["nodes_expanded"]) / int(ends[0]["nodes_expanded"])
        times = float(ends[1]["ms_per_point"]) / float(ends[0]["ms_per_point"])
        growth.append(nodes)
        parts.append(f"{dof} DOF ×{nodes:.3g} nodes, ×{times:.2g} time")
    return "from D = 3 to 32, CB(3): " + "; ".join(parts), judged(sum(g > 5 for g in growth), 3)


def claim_5(results: Results) -> Verdict:
    """The rank correlation of D and mean error in 3 … 32, and where the least error is."""
    rising, higher, best, parts = 0, 0, 0, []
    for breadth in (1, 2, 3):
        for dof in (2, 3, 4):
            rows = [r for r in results("figure_07", dof=dof, breadth=breadth) if int(r["divisions"]) <= 32]
            errors = np.array([float(row["position_mean_mm"]) for row in rows])
            ranks = np.argsort(np.argsort(errors)).astype(float)
            trend = float(np.corrcoef(np.arange(len(rows), dtype=float), ranks)[0, 1])
            rising += trend > 0.3
            higher += errors[-1] > errors[0]
            best += int(rows[int(errors.argmin())]["divisions"]) == 3
            if dof == 2:
                parts.append(f"{trend:+.2f} with CB({breadth})")
    text = (
        f"of 9 curves (3 arms × 3 breadths) {rising} rise throughout (rank correlation above 0.3), {higher} "
        f"are higher at D = 32 than at D = 3, and {best} are best at D = 3; two-link arm, "
        f"rank correlation of error and D: {', '.join(parts)}"
    )
    return text, HOLDS if rising == best == 9 else IN_PART if higher or best else FAILS


def claim_6(results: Results) -> Verdict:
    """The error at D = 4 over its larger neighbour, as built and at the weight where it stands out most."""
    rows = results("question_06")
    weights = sorted({float(row["position_weight"]) for row in rows})
    heights = {
        (dof, breadth, weight): question_06.spike(rows, dof, breadth, weight)
        for dof in (2, 3, 4)
        for breadth in question_06.BREADTHS
        for weight in weights
    }
    plain = max(heights[2, breadth, 1.0] for breadth in question_06.BREADTHS)
    dof2 = {key: value for key, value in heights.items() if key[0] == 2}
    top = max(dof2, key=lambda key: dof2[key])
    others = max(heights[dof, top[1], top[2]] for dof in (3, 4))
    text = (
        f"error at D = 4 over the larger of D = 3 and 5: at most {plain:.2f} with K_P = K_A; "
        f"{dof2[top]:.2f} with Br = {top[1]} and K_P / K_A = {top[2]:g} /m, where the other arms have at "
        f"most {others:.2f}"
    )
    if plain > 1.2:
        return text, HOLDS
    return text, IN_PART if dof2[top] > 1.2 else FAILS


def claim_7(results: Results) -> Verdict:
    """Errors and times of the two-link arm at D = 3, 32, 180 and 360."""
    good, parts = 0, []
    for breadth in (1, 2, 3):
        errors = [
            results.one("figure_07", "position_mean_mm", dof=2, breadth=breadth, divisions=d)
            for d in (32, 180, 360)
        ]
        times = [
            results.one("figure_06", "ms_per_point", dof=2, breadth=breadth, divisions=d) for d in (32, 360)
        ]
        good += errors[2] < errors[0] and errors[1] < errors[0] and times[1] > 3 * times[0]
        parts.append(
            f"CB({breadth}) {mm(errors[0])} → {mm(errors[1])} → {mm(errors[2])}, "
            f"time ×{times[1] / times[0]:.0f}"
        )
    return "D = 32 → 180 → 360: " + "; ".join(parts), judged(good, 3)


def claim_8(results: Results) -> Verdict:
    """CB(1) over the next worst, and the arms on which the others come near a millimetre."""
    ratios, near, of, parts = [], 0, 0, []
    for dof in ARMS:
        errors = {
            str(row["method"]): float(row["position_mean_mm"])
            for row in results("figure_08", dof=dof)
            if row["method"] != "tuned"
        }
        others = [value for method, value in errors.items() if method != "CB(1)"]
        ratios.append(errors["CB(1)"] / max(others))
        near += sum(value < 1.5 for value in others)
        of += len(others)
        parts.append(f"{dof} DOF {mm(errors['CB(1)'])} against {mm(min(others))} … {mm(max(others))}")
    text = (
        f"CB(1) against the others: {'; '.join(parts)}. {near} of {of} means of the others are below 1.5 mm; "
        f"CB(1) is {min(ratios):.2g} to {max(ratios):.2g} times worse than the worst of them"
    )
    return text, HOLDS if near == of and min(ratios) > 3 else IN_PART if min(ratios) > 1 else FAILS


def claim_9(results: Results) -> Verdict:
    """Ratios of nodes and of times on every arm."""
    fast, slow, parts = [], [], []
    for dof in ARMS:
        rows = {str(row["method"]): row for row in results("figure_09", dof=dof) if row["method"] != "tuned"}
        words = []
        for name in ("nodes_expanded", "ms_per_point"):
            values = {method: float(row[name]) for method, row in rows.items()}
            first = min(value for method, value in values.items() if method != "CB(1)") / values["CB(1)"]
            last = values["CB(3)"] / max(value for method, value in values.items() if method != "CB(3)")
            words.append(f"{first:.2g} and {last:.2g}")
            if name == "nodes_expanded":
                fast.append(first)
                slow.append(last)
        parts.append(f"{dof} DOF {words[0]} in nodes, {words[1]} in time")
    good = sum(value > 7 for value in fast) + sum(value > 10 for value in slow)
    return "next best over CB(1), and CB(3) over the next slowest: " + "; ".join(parts), judged(
        good, 2 * len(ARMS)
    )


def claim_10(results: Results) -> Verdict:
    """The two-link arm's error over the worst other arm, wrapping and not, CB(2) and CB(3)."""
    extreme, parts = {}, []
    for reading in ("wrap", "no wrap", "no wrap, window slides"):
        words = []
        for breadth in (2, 3):
            rows = results("question_10", reading=reading, breadth=breadth)
            errors = {int(row["dof"]): float(row["position_mean_mm"]) for row in rows}
            others = max(value for dof, value in errors.items() if dof != 2)
            extreme[reading, breadth] = errors[2] > 1.2 * others
            words.append(f"CB({breadth}) {mm(errors[2])} against at most {mm(others)} elsewhere")
        parts.append(f"{reading}: {', '.join(words)}")
    wide = results("question_10", reading="no wrap, window slides", dof=2, breadth=6)
    parts.append(f"and there Br = 6 has {mm(float(wide[0]['position_mean_mm']))}")
    wrap = all(extreme["wrap", breadth] for breadth in (2, 3))
    return "; ".join(parts), HOLDS if wrap else IN_PART if any(extreme.values()) else FAILS


def claim_11(results: Results) -> Verdict:
    """Digests of the joint values."""
    same = sum(
        results("figure_08", dof=dof, method="BT")[0]["q_digest"]
        == results("figure_08", dof=dof, method="DT + BT")[0]["q_digest"]
        for dof in ARMS
    )
    return f"the same bits for all points on {same} of {len(ARMS)} arms", judged(same, len(ARMS))


def crossover(results: Results, dof: int) -> float:
    """The B at which both trees have as many nodes, interpolated between powers of three."""
    trees = {
        tree: {
            int(r["branching_factor"]): float(r["nodes_created"])
            for r in results("figure_10", dof=dof, tree=tree)
        }
        for tree in ("static", "dynamic")
    }
    factors = sorted(set(trees["static"]) & set(trees["dynamic"]))
    gaps = [float(np.log(trees["static"][b] / trees["dynamic"][b])) for b in factors]
    return float(np.exp(np.interp(0.0, gaps, np.log(factors))))


def claim_12(results: Results) -> Verdict:
    """Where the curves of Figure 10 cross."""
    crossings = {dof: crossover(results, dof) for dof in ARMS}
    text = "the curves cross at B ≈ " + ", ".join(
        f"{value:,.0f} ({dof} DOF)" for dof, value in crossings.items()
    )
    near = sum(1e4 / 3 < value < 3e4 for value in crossings.values())
    return text, judged(near, len(ARMS))


def claim_13(results: Results) -> Verdict:
    """Time with the dynamic tree over time without, the tree being ready."""
    static = {
        row["branching_factor"]: float(row["ms_per_point"]) for row in results("figure_11", tree="static")
    }
    ratios = [
        float(row["ms_per_point"]) / static[row["branching_factor"]]
        for row in results("figure_11", tree="dynamic")
        if row["branching_factor"] in static
    ]
    low, middle, high = np.percentile(ratios, [25, 50, 75])
    text = f"time with DT over time without, 6 DOF: median {middle:.2f}, quartiles {low:.2f} to {high:.2f}; "
    text += "in compiled code a node made anew costs one multiplication, no more than looking it up"
    return text, HOLDS if low > 1.02 else FAILS


def claim_14(results: Results) -> Verdict:
    """Errors and times of the elbow arm."""
    methods = ("CB(3)", "DT + BT", "tuned")
    errors = {m: results.one("figure_08", "position_mean_mm", dof=6, method=m) for m in methods}
    times = {m: results.one("figure_09", "ms_per_point", dof=6, method=m) for m in methods}
    heavy = min(results("question_08", dof=6), key=lambda row: float(row["position_mean_mm"]))
    position, turn = float(heavy["position_mean_mm"]), float(heavy["orientation_mean_mrad"])
    text = "; ".join(f"{m} {mm(errors[m])} in {times[m]:.2g} ms" for m in methods)
    text += (
        f"; the best over weights and breadths: {heavy['method']} at K_P / K_A = "
        f"{heavy['position_weight']:g} /m, {mm(position)} and {turn:.2g} mrad"
    )
    if min(errors[m] for m in ("CB(3)", "DT + BT")) < 1:
        return text, HOLDS
    return text, IN_PART if float(heavy["position_mean_mm"]) < 1 or errors["tuned"] < 1 else FAILS


def claim_15(results: Results) -> Verdict:
    """Rank correlations, and points with one error high and the other low."""
    rows = results("claim_15")
    correlations = [float(row["rank_correlation"]) for row in rows]
    odd = sum(int(row["far_but_aligned"]) + int(row["near_but_turned"]) for row in rows)
    points = sum(int(row["points"]) for row in rows)
    worst = min(rows, key=lambda row: float(row["rank_correlation"]))
    text = (
        f"rank correlation over points from {min(correlations):+.2f} ({worst['dof']} DOF, {worst['method']}) "
        f"to {max(correlations):+.2f}; one error high (5 cm or 50 mrad) and the other low (5 mm or 5 mrad) "
        f"in {odd:,} of {points:,} points"
    )
    return text, HOLDS if odd == 0 else IN_PART if max(correlations) > 0.5 else FAILS


def claim_16(results: Results) -> Verdict:
    """Angles between arm and goal."""
    position = [float(row["angle_p95_deg"]) for row in results("claim_16", goal="position")]
    poses = [float(row["angle_mean_deg"]) for row in results("claim_16", goal="pose")]
    text = (
        f"position goals: 95 % within {max(position):.2g}° on every arm at every distance; whole poses with "
        f"K_P = K_A: mean angle {min(poses):.2g}° to {max(poses):.2g}°, for the hand's turn is weighed too"
    )
    if max(position) > 5:
        return text, FAILS
    return text, HOLDS if max(poses) < 5 else IN_PART


def claim_17(results: Results) -> Verdict:
    """What can be measured: ours."""
    row = results("claim_17", search="default")[0]
    text = (
        f"that program and computer are not to be had; kinseek's default answers {row['points']} points of "
        f"the Panda in {row['seconds']:.2g} s, {100 * float(row['solved']):.1f} % of them to 1 µm and 1 µrad"
    )
    return text, UNKNOWN
