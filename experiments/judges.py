"""The paper's claims, and the rules that judge them by the CSVs: every verdict comes from numbers, none is typed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from . import question_06, question_10_exchanged
from .arms import ARMS
from .effort import Row
from .fraction import BUILT
from .question_08 import TUNED
from .store import ExperimentError, Store
from .style import where

HOLDS = "**holds**"
IN_PART = "**holds in part**"
FAILS = "**does not hold**"

Verdict = tuple[str, str]
"""Our measurement in words and numbers, and the verdict."""


class Results:
    """The rows of every experiment, read on first access."""

    def __init__(self, folder: Path) -> None:
        """Look in this folder."""
        self.folder = folder
        self.read: dict[str, list[Row]] = {}

    def __call__(self, name: str, **wanted: Any) -> list[Row]:
        """Rows of one experiment whose columns have the wanted values."""
        if name not in self.read:
            store = Store(self.folder, name)
            if not store.csv.exists():
                raise ExperimentError(
                    f"the tables need {store.csv.name}: run python -m experiments {name} first"
                )
            self.read[name] = store.rows()
        return where(self.read[name], **wanted)

    def one(self, name: str, column: str, **wanted: Any) -> float:
        """One number."""
        return float(self(name, **wanted)[0][column])


@dataclass(frozen=True)
class Claim:
    """A sentence of the paper and the rule that judges it."""

    number: int
    section: str
    sentence: str
    source: str
    """Experiments whose rows judge it."""
    reversal: str
    """What would change the verdict. A test changes the rows in this way."""
    judge: Callable[[Results], Verdict]


CLAIMS: list[Claim] = []
"""Every claim, in order."""


def claim(
    section: str, sentence: str, source: str, reversal: str
) -> Callable[[Callable[[Results], Verdict]], Callable[[Results], Verdict]]:
    """Make a rule that of the next claim; see `Claim`."""

    def added(judge: Callable[[Results], Verdict]) -> Callable[[Results], Verdict]:
        CLAIMS.append(Claim(len(CLAIMS) + 1, section, sentence, source, reversal, judge))
        return judge

    return added


def mm(value: float) -> str:
    """A length in [mm], two significant digits, as words."""
    return f"{value:.2g} mm" if value < 100 else f"{value:.0f} mm"


def span(shares: list[float]) -> str:
    """The least and the largest share, in percent."""
    return f"{100 * min(shares):.0f} to {100 * max(shares):.0f}"


def judged(part: int, of: int) -> str:
    """All, some or none."""
    return HOLDS if part == of else IN_PART if part else FAILS


@claim(
    "abstract, 4.2",
    "finds the best solution, in logarithmic time",
    "figure_11, claim_01",
    "holds if CB(3) finds the best node for 99.5 % of the points on every grid; fails if it does not and the nodes "
    "of a pass grow with B",
)
def claim_1(results: Results) -> Verdict:
    """Steps of the work per factor of three in B, and how often the best node is found."""
    nodes = [row["nodes_expanded"] for row in results("figure_11", tree="dynamic")]
    steps = set(np.diff(nodes[1:]).tolist())
    times = [row["ms_per_point"] for row in results("figure_11", tree="dynamic")]
    found = {m: [r["best_found"] for r in results("claim_01", method=m)] for m in ("CB(1)", "CB(3)")}
    logarithmic = len(steps) == 1
    slope, fixed = np.polyfit(nodes, times, 1)
    text = (
        f"nodes: each factor of 3 in B adds {'exactly ' if logarithmic else 'up to '}{max(steps):,}; "
        f"from B = 9 to 3^16, 4.8 million times as many, ×{nodes[14] / nodes[0]:.2g} nodes (the paper: ×7 in time; "
        f"from B = 27 it is ×{nodes[15] / nodes[1]:.2g} nodes); ×{times[14] / times[0]:.2g} compiled time, because at "
        f"B = 9 {100 * fixed / (fixed + slope * nodes[0]):.0f} % of it is the call itself; best solution: found for "
        f"{span(found['CB(3)'])} % of the points with CB(3), {span(found['CB(1)'])} % with CB(1)"
    )
    return text, judged(int(logarithmic) + int(min(found["CB(3)"]) > 0.995), 2)


@claim(
    "3.1",
    "Eq. 1 is the number of nodes that brute force expands",
    "figure_05",
    "holds in part if one count differs by one node, fails if all do",
)
def claim_2(results: Results) -> Verdict:
    """Brute force's counter against the formula."""
    rows = results("figure_05", method="brute force")
    equal = sum(row["nodes_expanded"] == row["equation_1"] for row in rows)
    return f"counted nodes equal Eq. 1 on {equal} of {len(rows)} arms, to the last node", judged(
        equal, len(rows)
    )


@claim(
    "4.2",
    "brute force on 4 DOF at B = 60 expands over 10 million nodes",
    "figure_05",
    "fails at 10 million or fewer",
)
def claim_3(results: Results) -> Verdict:
    """The count itself."""
    count = results.one("figure_05", "nodes_expanded", dof=4, method="brute force")
    return f"{count:,.0f} nodes", HOLDS if count > 1e7 else FAILS


@claim(
    "4.2",
    "time rises steeply with D and with DOF",
    "figure_06",
    "in part if the nodes of one arm grow five times or less from D = 3 to 32, or less than those of a smaller arm",
)
def claim_4(results: Results) -> Verdict:
    """Growth from D = 3 to 32, in nodes and in time, CB(3)."""
    parts, growth = [], []
    for dof in (2, 3, 4):
        ends = [results("figure_06", dof=dof, breadth=3, divisions=d)[0] for d in (3, 32)]
        nodes = int(ends[1]["nodes_expanded"]) / int(ends[0]["nodes_expanded"])
        times = float(ends[1]["ms_per_point"]) / float(ends[0]["ms_per_point"])
        growth.append(nodes)
        parts.append(f"{dof} DOF ×{nodes:.3g} nodes, ×{times:.2g} time")
    steep = sum(g > 5 for g in growth) + sum(np.diff(growth) > 0)
    return "from D = 3 to 32, CB(3): " + "; ".join(parts), judged(int(steep), 5)


RUN_BY_THE_PAPER = {2: 32, 3: 16, 4: 8}
"""Largest D by DOF: the text says that the larger arms have fewer points. Where they end is our guess."""


@claim(
    "4.2",
    "the error tends to rise with D in 3 … 32; D = 3 is best",
    "figure_07, question_05",
    "holds if for one breadth the error rises on all three arms, and no D is better than 3 on any of them, both beyond "
    "the intervals; fails if fewer than half of these six conditions are met",
)
def claim_5(results: Results) -> Verdict:
    """Two conditions on three arms, for the breadth that suits the paper best, beyond 95 % intervals."""
    met: dict[int, int] = {}
    parts = []
    for breadth in (1, 2, 3):
        met[breadth], words = 0, []
        for dof, last in RUN_BY_THE_PAPER.items():
            rows = [r for r in results("figure_07", dof=dof, breadth=breadth) if r["divisions"] <= last]
            rises = surely_less(rows[0], rows[-1])
            best = not any(surely_less(row, rows[0]) for row in rows[1:])
            met[breadth] += rises + best
            ends = [row["position_mean_mm"] for row in (rows[0], rows[-1])]
            words.append(f"{mm(ends[0])} → {mm(ends[1])}{' (D = 3 is best)' if best else ''}")
        parts.append(f"CB({breadth}): {', '.join(words)}")
    top = max(met, key=lambda breadth: met[breadth])
    text = (
        "from D = 3 to 32 on 2 DOF, to 16 on 3 DOF, to 8 on 4 DOF, in this order. "
        + "; ".join(parts)
        + f". Of six conditions (rises, and no D "
        f"surely better than 3, on each arm) {met[top]} are met with CB({top}), the breadth that meets most"
    )
    return text, HOLDS if met[top] == 6 else IN_PART if met[top] >= 3 else FAILS


def surely_less(small: Row, large: Row) -> bool:
    """Is a mean error less than another, their 95 % intervals apart?"""
    highest = small["position_mean_mm"] + 1.96 * small["position_standard_error_mm"]
    lowest = large["position_mean_mm"] - 1.96 * large["position_standard_error_mm"]
    return bool(highest < lowest)


SPIKE = 1.2
"""The error at D = 4 is a spike if it is so many times the larger one of its neighbours."""


@claim(
    "4.2, 5",
    "a spike at D = 4, for 2 DOF alone",
    "question_06",
    "holds if with K_P = K_A the error at D = 4 is 1.2 times that of its neighbours on this arm and on no other; fails "
    "if, under every weight that gives this arm a spike, another arm has one too",
)
def claim_6(results: Results) -> Verdict:
    """The error at D = 4 over its larger neighbour: on the two-link arm a spike, and on the others none."""
    rows = results("question_06")
    heights = {
        (breadth, weight): {dof: question_06.spike(rows, dof, breadth, weight) for dof in (2, 3, 4)}
        for breadth in question_06.BREADTHS
        for weight in sorted({row["position_weight"] for row in rows})
    }
    alone = {
        key: value[2]
        for key, value in heights.items()
        if value[2] > SPIKE and max(value[3], value[4]) < SPIKE
    }
    plain = max(value[2] for (_, weight), value in heights.items() if weight == 1)
    top = max(alone or {key: value[2] for key, value in heights.items()}, key=lambda key: heights[key][2])
    text = (
        f"error at D = 4 over the larger of D = 3 and 5: at most {plain:.2f} with K_P = K_A; "
        f"{heights[top][2]:.2f} with Br = {top[0]} and K_P / K_A = {top[1]:g} /m, where the other arms have at "
        f"most {max(heights[top][3], heights[top][4]):.2f}"
    )
    if any(weight == 1 for _, weight in alone):
        return text, HOLDS
    return text, IN_PART if alone else FAILS


@claim(
    "4.2",
    "at D = 180 and 360 the error falls and the time rises much",
    "figure_06, figure_07",
    "in part if for one breadth the error at D = 360 is not below that at 32, or takes less than three times as long",
)
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


@claim(
    "4.2",
    "CB(1) is worst by far, the others are near or below 1 mm",
    "figure_08, question_08",
    "holds if all others are below 1.5 mm and CB(1) is three times worse on every arm; fails if CB(1) is not the worst "
    "on one arm",
)
def claim_8(results: Results) -> Verdict:
    """CB(1) over the next worst, and the arms on which the others come near a millimetre."""
    ratios, near, of, parts = [], 0, 0, []
    for dof in ARMS:
        errors = {
            row["method"]: row["position_mean_mm"]
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


@claim(
    "4.2",
    "CB(1) is fastest by nearly ten times, CB(3) slowest by ten or more",
    "figure_09",
    "holds if CB(1) is fastest and CB(3) slowest on every arm, and each of the two factors is met on one arm (the paper "
    "does not say on which); fails if none of these four conditions is met",
)
def claim_9(results: Results) -> Verdict:
    """Ratios of nodes and of times on every arm: two orders, and two factors that the paper asks of no arm in particular."""
    fast, slow, parts = [], [], []
    for dof in ARMS:
        rows = {row["method"]: row for row in results("figure_09", dof=dof) if row["method"] != "tuned"}
        words = []
        for name in ("nodes_expanded", "ms_per_point"):
            values = {method: row[name] for method, row in rows.items()}
            first = min(value for method, value in values.items() if method != "CB(1)") / values["CB(1)"]
            last = values["CB(3)"] / max(value for method, value in values.items() if method != "CB(3)")
            words.append(f"{first:.2g} and {last:.2g}")
            if name == "nodes_expanded":
                fast.append(first)
                slow.append(last)
        parts.append(f"{dof} DOF {words[0]} in nodes, {words[1]} in time")
    text = "the next fastest divided by CB(1), and CB(3) divided by the next slowest: " + "; ".join(parts)
    text += (
        f". In nodes CB(1) is first on {sum(value > 1 for value in fast)} and CB(3) last on "
        f"{sum(value > 1 for value in slow)} of {len(ARMS)} arms; the factors (7 and 10 or more) are met on "
        f"{sum(value > 7 for value in fast)} and {sum(value >= 10 for value in slow)} of them"
    )
    return text, judged(sum((min(fast) > 1, min(slow) > 1, max(fast) > 7, max(slow) >= 10)), 4)


@claim(
    "4.2, 5",
    "CB(2) and CB(3) show extreme errors at 2 DOF",
    "question_10, question_10_exchanged",
    "holds if under one reading CB(2) and CB(3) have extreme errors on two joints, and errors below 1.5 mm on the other "
    "arms; fails if they have extreme errors on two joints under no reading",
)
def claim_10(results: Results) -> Verdict:
    """The two-link arm's error over the worst other arm, wrapping and not; and are the others near a millimetre?"""
    extreme, near, parts = {}, {}, []
    for reading in ("wrap", "no wrap", "no wrap, window slides"):
        words = []
        for breadth in (2, 3):
            rows = results("question_10", reading=reading, breadth=breadth)
            errors = {row["dof"]: row["position_mean_mm"] for row in rows}
            others = max(value for dof, value in errors.items() if dof != 2)
            extreme[reading, breadth] = errors[2] > 1.2 * others
            near[reading, breadth] = others < 1.5
            words.append(f"CB({breadth}) {mm(errors[2])} against at most {mm(others)} elsewhere")
        parts.append(f"{reading}: {', '.join(words)}")
    wide = results("question_10", reading="no wrap, window slides", dof=2, breadth=6)
    parts.append(f"and there Br = 6 has {mm(float(wide[0]['position_mean_mm']))}")
    words = []
    for breadth in (2, 3):
        exchanged = results.one(
            "question_10_exchanged",
            "position_mean_mm",
            lengths=question_10_exchanged.EXCHANGED,
            position_weight=1.0,
            breadth=breadth,
            divisions=3,
        )
        rows = results("question_10", reading="wrap", breadth=breadth)
        others = max(row["position_mean_mm"] for row in rows if row["dof"] != 2)
        extreme["exchanged", breadth], near["exchanged", breadth] = exchanged > 1.2 * others, others < 1.5
        words.append(f"CB({breadth}) {mm(exchanged)}")
    parts.append(f"wrap, the two lengths exchanged: {', '.join(words)}")
    printed = {key[0] for key in extreme if all(extreme[key[0], b] and near[key[0], b] for b in (2, 3))}
    parts.append(
        f"{len(printed)} of 4 readings have the two-link arm extreme and the others below 1.5 mm, as the paper's figure has"
    )
    alone = {key[0] for key in extreme if all(extreme[key[0], b] for b in (2, 3))}
    return "; ".join(parts), HOLDS if printed else IN_PART if alone else FAILS


@claim(
    "4.2",
    "BT and DT + BT give the same answers",
    "figure_08",
    "in part if one arm's answers differ in a bit",
)
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
        tree: {r["branching_factor"]: r["nodes_created"] for r in results("figure_10", dof=dof, tree=tree)}
        for tree in ("static", "dynamic")
    }
    factors = sorted(set(trees["static"]) & set(trees["dynamic"]))
    gaps = [float(np.log(trees["static"][b] / trees["dynamic"][b])) for b in factors]
    return float(np.exp(np.interp(0.0, gaps, np.log(factors))))


@claim(
    "4.2",
    "DT creates fewer nodes above B ≈ 10,000, more below",
    "figure_10",
    "holds if the curves of all four arms cross between 3,300 and 30,000, fails if none does",
)
def claim_12(results: Results) -> Verdict:
    """Where the curves of Figure 10 cross."""
    crossings = {dof: crossover(results, dof) for dof in ARMS}
    text = "the curves cross at B ≈ " + ", ".join(
        f"{value:,.0f} ({dof} DOF)" for dof, value in crossings.items()
    )
    near = sum(1e4 / 3 < value < 3e4 for value in crossings.values())
    return text, judged(near, len(ARMS))


@claim(
    "4.2",
    "without DT it is slightly faster",
    "objects, figure_11",
    "in part if the lower quartile of the ratios falls to 1.02, fails if the median does",
)
def claim_13(results: Results) -> Verdict:
    """Time with the dynamic tree over time without, the tree being ready: of Python objects, as the paper's were."""
    ratios = paired(results, "objects, DT", "objects")
    bare = paired(results, "numbers", "objects")
    static = {row["branching_factor"]: row["ms_per_point"] for row in results("figure_11", tree="static")}
    compiled = [
        row["ms_per_point"] / static[row["branching_factor"]]
        for row in results("figure_11", tree="dynamic")
        if row["branching_factor"] in static
    ]
    low, middle, high = np.percentile(ratios, [25, 50, 75])
    text = (
        f"time with DT over time without, node objects in plain Python: median {middle:.2f}, quartiles {low:.2f} to "
        f"{high:.2f}; bare numbers need {np.median(bare):.2f} of the objects' time; compiled: {np.median(compiled):.2f}, "
        f"because there making a node costs one multiplication"
    )
    return text, HOLDS if low > 1.02 else IN_PART if middle > 1.02 else FAILS


def paired(results: Results, program: str, base: str) -> list[float]:
    """Time of one program over that of another, for every search that both have run."""
    keys = ("dof", "method", "branching_factor")
    times = {tuple(row[key] for key in keys): row["ms_per_point"] for row in results("objects", program=base)}
    rows = {tuple(row[key] for key in keys): row for row in results("objects", program=program)}
    return [float(rows[key]["ms_per_point"]) / times[key] for key in rows if key in times]


@claim(
    "5",
    "6 DOF below 1 mm on average, in under 2 s",
    "figure_08, figure_09, question_08, objects",
    "holds if CB(3) or DT + BT is below both limits at K_P = K_A; fails if no weight and breadth gives an error below "
    "1 mm, or if all that do take 2 s a point",
)
def claim_14(results: Results) -> Verdict:
    """Errors and times of the elbow arm: one solver must have both. The paper has breadths up to 3."""
    methods = ("CB(3)", "DT + BT", "tuned")
    errors = {m: results.one("figure_08", "position_mean_mm", dof=6, method=m) for m in methods}
    rows = {m: results("figure_09", dof=6, method=m)[0] for m in methods}
    times = {m: float(rows[m]["ms_per_point"]) for m in methods}
    # The same kernel on more nodes; and node objects in plain Python.
    compiled = times["CB(3)"] / float(rows["CB(3)"]["nodes_expanded"])
    node = results.one(
        "objects", "us_per_node", dof=6, method="BT", branching_factor=7200, program="objects, DT"
    )

    def words(row: Row) -> str:
        nodes = row["nodes_expanded"]
        return (
            f"{row['method']} at K_P / K_A = {row['position_weight']:g} /m, {mm(row['position_mean_mm'])} and "
            f"{row['orientation_mean_mrad']:.2g} mrad, in {compiled * nodes:.2g} ms compiled and "
            f"{1e-6 * node * nodes:.2g} s with node objects in plain Python"
        )

    question = results("question_08", dof=6)
    paper = [row for row in question if max(map(int, str(row["breadths"]).replace(TUNED, "9").split())) <= 3]
    least = min(paper, key=lambda row: row["position_mean_mm"])
    good = [row for row in question if row["position_mean_mm"] < 1]
    straight = min(good or question, key=lambda row: row["orientation_mean_mrad"])
    text = "; ".join(f"{m} {mm(errors[m])} in {times[m]:.2g} ms" for m in methods)
    text += (
        f"; over all weights the least position error with breadths up to 3: {words(least)}; of those below 1 mm the least "
        f"orientation error: {words(straight)}"
    )
    if any(errors[m] < 1 and times[m] < 2000 for m in ("CB(3)", "DT + BT")):
        return text, HOLDS
    quick = any(compiled * row["nodes_expanded"] < 2000 for row in good)
    return text, IN_PART if quick or (errors["tuned"] < 1 and times["tuned"] < 2000) else FAILS


@claim(
    "4.2",
    "no case of a high position error with a low orientation error, or vice versa",
    "claim_15",
    "holds if no point has one error high and the other low",
)
def claim_15(results: Results) -> Verdict:
    """Rank correlations, and points with one error high and the other low."""
    rows = results("claim_15")
    correlations = [row["rank_correlation"] for row in rows]
    odd = sum(row["far_but_aligned"] + row["near_but_turned"] for row in rows)
    points = sum(row["points"] for row in rows)
    worst = min(rows, key=lambda row: row["rank_correlation"])
    text = (
        f"rank correlation over points from {min(correlations):+.2f} ({worst['dof']} DOF, {worst['method']}) "
        f"to {max(correlations):+.2f}; one error high (5 cm or 50 mrad) and the other low (5 mm or 5 mrad) "
        f"in {odd:,} of {points:,} points"
    )
    text += f"; median correlation {np.median(correlations):+.2f}"
    return text, FAILS if odd else HOLDS


@claim(
    "2.1",
    "an unreachable goal makes the arm point towards it",
    "claim_16",
    "holds if the mean angle is below 5° for whole poses too; fails if positions are not within 5°",
)
def claim_16(results: Results) -> Verdict:
    """Angles between arm and goal."""
    position = [row["angle_p95_deg"] for row in results("claim_16", goal="position")]
    poses = [row["angle_mean_deg"] for row in results("claim_16", goal="pose")]
    text = (
        f"position goals: 95 % within {max(position):.2g}° on every arm at every distance; whole poses with "
        f"K_P = K_A: mean angle {min(poses):.2g}° to {max(poses):.2g}°, because the orientation of the hand counts too"
    )
    if max(position) > 5:
        return text, FAILS
    return text, HOLDS if max(poses) < 5 else IN_PART


@claim(
    "5",
    "one or two orders of magnitude slower than twists and exponentials (500 points of a 7-DOF arm in 10 s)",
    "objects, claim_17",
    "holds if the ratio lies between 10 and 100, fails if the search is as fast or a thousand times slower",
)
def claim_17(results: Results) -> Verdict:
    """The search in plain Python over twists and exponentials in NumPy, on one seven-joint arm."""
    row = results("claim_17", search="default")[0]
    search = results.one("objects", "ms_per_point", dof=7, method="BT", program="objects, DT")
    twists = results.one("objects", "ms_per_point", dof=7, program="twists, NumPy")
    ratio = search / twists
    text = (
        f"the paper's program and computer are not available. Twists and exponentials in NumPy: {0.5 * twists:.2g} s for "
        f"500 points; DaC + DT + BT with node objects on the same arm {search / 1e3:.2g} s a point, {ratio:,.0f} times as "
        f"much; kinseek's default answers {row['points']} points of the Panda in {row['seconds']:.2g} s, "
        f"{100 * row['solved']:.1f} % of them to 1 µm and 1 µrad"
    )
    return text, HOLDS if 10 <= ratio <= 100 else IN_PART if 1 < ratio <= 1000 else FAILS


@claim(
    "2.1",
    "a larger branching factor gives greater precision",
    "claim_18",
    "holds if divide and conquer gains from B = 810 to a million on every arm; fails if brute force gains nothing in "
    "one step",
)
def claim_18(results: Results) -> Verdict:
    """Does every larger B lower the mean error, in brute force and in divide and conquer?"""
    fell = of = 0
    for dof in ARMS:
        errors = [row["position_mean_mm"] for row in results("claim_18", dof=dof, method="brute force")]
        fell, of = fell + int(sum(np.diff(errors) < 0)), of + max(len(errors) - 1, 0)
    gains = {}
    for dof in ARMS:
        for method in ("CB(1)", "CB(2)", "CB(3)", "BT"):
            errors = [
                results.one("claim_18", "position_mean_mm", dof=dof, method=method, branching_factor=size)
                for size in (810, 1_000_000)
            ]
            gains[dof, method] = errors[0] / errors[1]
    gain = sum(value > 1.1 for value in gains.values())
    text = (
        f"brute force: the mean error fell in {fell} of {of} steps to a larger B; divide and conquer, from B = 810 to a "
        f"million: fell by more than a tenth for {gain} of {len(gains)} arms and breadths, ×{max(gains.values()):.2g} at "
        f"most; BT on six joints ×{gains[6, 'BT']:.2f}, because its errors come from wrong first cells and not from the grid"
    )
    return text, HOLDS if fell == of and gain == len(gains) else IN_PART if fell == of else FAILS


@claim(
    "2.1",
    "breadth-first search is not possible; nodes with only some joints set make no sense",
    "claim_19",
    "holds if breadth first finds the best node of no grid",
)
def claim_19(results: Results) -> Verdict:
    """Breadth first on the same grid; and bounds that judge a node before all joints are set."""
    rows = results("claim_19", order="breadth first")
    found = sum(row["same_best"] == 1.0 for row in rows)
    shares = [
        row["nodes_expanded"]
        / results.one(
            "claim_19",
            "nodes_expanded",
            order="breadth first",
            dof=row["dof"],
            branching_factor=row["branching_factor"],
        )
        for row in results("claim_19", order="breadth first, bounds")
    ]
    held = max(row["most_held"] for row in rows)
    text = (
        f"breadth first finds the best node of {found} of {len(rows)} grids, with as many nodes as depth first, but "
        f"holds up to {held:,} at once; bounds judge nodes with only some joints set: with them {span(shares)} % of the "
        f"nodes are enough, for the same answer"
    )
    return text, FAILS if found == len(rows) else IN_PART if found else HOLDS


@claim(
    "4.2",
    "brute force on 2 DOF can handle B = 720 in a few seconds",
    "objects",
    "in part if node objects take ten seconds; fails if bare numbers take ten seconds too",
)
def claim_20(results: Results) -> Verdict:
    """Brute force in plain Python at B = 720 on two joints."""
    programs = ("objects", "numbers", "kernels")
    seconds = {
        p: results.one(
            "objects", "ms_per_point", dof=2, method="brute force", branching_factor=720, program=p
        )
        / 1e3
        for p in programs
    }
    four = results.one("objects", "ms_per_point", dof=4, method="brute force", program="objects") / 1e3
    text = "; ".join(f"{program} {seconds[program]:.2g} s" for program in programs)
    text += f" a point; and four joints at B = 60 with objects {four:.0f} s (the paper: several minutes)"
    return text, HOLDS if seconds["objects"] < 10 else IN_PART if seconds["numbers"] < 10 else FAILS


@claim(
    "1",
    "Blind Search only works very close to its start",
    "claim_21",
    "holds if with fixed changes more than a tenth of the starts anywhere are stuck, and five times as many as of the "
    "near ones, on every arm; in part if on one arm",
)
def claim_21(results: Results) -> Verdict:
    """Who is stuck: starts near and anywhere, with fixed changes that are small against 5 cm, and with shrinking ones."""
    parts, worse = [], 0
    for changes in ("fixed 0.01", "shrinking from 0.1"):
        shares, errors = [], []
        for dof in ARMS:
            close, anywhere = (
                results("claim_21", dof=dof, changes=changes, start_within=within)[0]
                for within in (0.1, 10.0)
            )
            shares.append((close["stuck"], anywhere["stuck"]))
            errors.append(anywhere["position_median_mm"])
        if changes == "fixed 0.01":
            worse = sum(far > 0.1 and far > 5 * near for near, far in shares)
        parts.append(
            f"{changes}: at most {100 * max(near for near, _ in shares):.2g} % of the starts within 0.1 of a solution and "
            f"at most {100 * max(far for _, far in shares):.2g} % of the starts anywhere, median error {mm(min(errors))} to "
            f"{mm(max(errors))}"
        )
    text = (
        "stuck more than 5 cm off, by changes: "
        + "; ".join(parts)
        + (
            f"; with fixed changes more than a tenth of the starts anywhere are stuck, and five times as many as of the "
            f"near ones, on {worse} of {len(ARMS)} arms"
        )
    )
    return text, judged(worse, len(ARMS))


@claim(
    "5",
    "DaC can be improved by breaking up the arm into separate chains, in certain cases",
    "separate",
    "in part if for one arm and breadth one of the two errors, or the evaluations, are above those of the whole arm; "
    "fails if this is so for every arm and breadth",
)
def claim_22(results: Results) -> Verdict:
    """Whole arm against chains, each searched once as the paper has it, for every breadth of its arms that can be split."""
    split = [name for name in ARMS.values() if results("separate", arm=name)[0]["second"]]
    pairs = [
        (row, results("separate", search="whole arm", arm=row["arm"], breadth=row["breadth"])[0])
        for row in results("separate", search="chains, once")
        if row["arm"] in split
    ]
    better = sum(all(row[name] <= whole[name] for name in _CHAINS) for row, whole in pairs)
    parts = []
    for row, whole in pairs:
        if row["breadth"] != 4:
            continue
        again = results("separate", search="chains", arm=row["arm"], breadth=4)[0]
        three = (whole, row, again)
        share = row["evaluations_mean"] / whole["evaluations_mean"]
        more = again["evaluations_mean"] / whole["evaluations_mean"]
        places = " → ".join(mm(each["position_mean_mm"]) for each in three)
        turns = " → ".join(f"{each['orientation_mean_mrad']:.2g}" for each in three)
        parts.append(
            f"{row['dof']} DOF {places} and {turns} mrad for {100 * share:.2g} and {100 * more:.2g} % of the evaluations"
        )
    whole_arms = ", ".join(f"{dof} DOF" for dof, name in ARMS.items() if name not in split)
    text = (
        f"errors of the whole arm → chain after chain → and again where an error is left, with CB(4): {'; '.join(parts)}. "
        f"Both errors and the evaluations of chain after chain are no larger in {better} of {len(pairs)} arms and breadths; "
        f"no split: {whole_arms}"
    )
    return text, judged(better, len(pairs))


@claim(
    "3.2",
    "Br needs to be a whole number",
    "fraction",
    "holds if no half lies between its whole breadths; in part if some do not",
)
def claim_23(results: Results) -> Verdict:
    """A breadth between two whole ones as `DivideAndConquer` has it: is it between them in work, and of use?"""
    between, of, parts = 0, 0, []
    for dof in ARMS:
        rows = {row["breadth"]: row for row in results("fraction", dof=dof, mixture=BUILT)}
        works = {b: row["evaluations_mean"] for b, row in rows.items()}
        errors = {b: row["position_mean_mm"] for b, row in rows.items()}
        for low in (1.0, 2.0):
            half = low + 0.5
            of += 1
            between += works[low] < works[half] < works[low + 1] and errors[half] < errors[low]
        parts.append(
            f"{dof} DOF "
            + " → ".join(f"{mm(errors[b])} in {works[b]:,.0f}" for b in (1.0, 1.5, 2.0, 2.5, 3.0))
        )
    text = (
        f"mean errors and evaluations with breadths 1 → 1.5 → 2 → 2.5 → 3, a fraction being the mean over the passes: "
        f"{'; '.join(parts)}. {between} of {of} halves cost less than the next whole breadth and err less than the one below"
    )
    return text, HOLDS if not between else FAILS if between == of else IN_PART


_CHAINS = ("position_mean_mm", "orientation_mean_mrad", "evaluations_mean")
