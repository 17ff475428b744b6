"""Beyond the paper: more searches on the same arms and points, with medians, percentiles and error bars."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

import kinseek

from .arms import (
    ARMS,
    BRANCHING_FACTOR,
    BY_HAND,
    Array,
    errors,
    random_goals,
    random_joints,
    timed,
)
from .effort import Effort, Row
from .style import NAMES, canvas, save, where

THRESHOLD = 0.05
"""Weighted error at which the early-stopping brute force is content."""


def _dac(breadth: int | tuple[int, ...] | str, **options: int) -> kinseek.DivideAndConquer:
    return kinseek.DivideAndConquer(BRANCHING_FACTOR, 3, breadth, **options)  # type: ignore[arg-type]


SEARCHES = (
    "DaC + CB(1)",
    "DaC + CB(2)",
    "DaC + CB(3)",
    "DaC + BT by hand",
    "DaC + tuned",
    "DaC + CB(1), beam 64",
    "DaC + CB(2), beam 16",
    "coordinate descent",
    "beam, then descent",
    "default of arm.ik",
    "blind search, near",
    "blind search, far",
    "brute force",
    "brute, stop early",
    "brute, stop, shuffled",
    "brute, stop, even",
)


def solver_of(search: str, dof: int) -> kinseek.Solver:
    """Build a search from its name."""
    made: dict[str, kinseek.Solver] = {
        "DaC + CB(1)": _dac(1),
        "DaC + CB(2)": _dac(2),
        "DaC + CB(3)": _dac(3),
        "DaC + BT by hand": _dac(BY_HAND[dof]),
        "DaC + tuned": _dac("tuned"),
        "DaC + CB(1), beam 64": _dac(1, beam=64),
        "DaC + CB(2), beam 16": _dac(2, beam=16),
        "coordinate descent": kinseek.CoordinateDescent(),
        "beam, then descent": kinseek.Polished(),
        "default of arm.ik": kinseek.Atlas(threads=1),
        "blind search, near": kinseek.BlindSearch(),
        "blind search, far": kinseek.BlindSearch(),
        "brute force": kinseek.BruteForce(60),
        "brute, stop early": kinseek.BruteForce(60, stop_below=THRESHOLD),
        "brute, stop, shuffled": kinseek.BruteForce(60, stop_below=THRESHOLD, order="random"),
        "brute, stop, even": kinseek.BruteForce(60, stop_below=THRESHOLD, order="low-discrepancy"),
    }
    return made[search]


def cases(effort: Effort) -> list[Row]:
    """Every search on every arm; brute force where its grid can be walked."""
    last = effort.pick(4, 3)
    return [
        {"dof": dof, "arm": arm, "search": search}
        for dof, arm in ARMS.items()
        for search in SEARCHES
        if dof <= last or not search.startswith("brute")
    ]


def measure(case: Row, effort: Effort) -> Row:
    """Errors, work and time of a batch."""
    search, arm = case["search"], kinseek.load(case["arm"])
    points = effort.pick(200 if search.startswith("brute") and arm.dof == 4 else 1000, 3)
    goals = random_goals(arm, points, effort.seed)
    solver = solver_of(search, arm.dof)
    if search.startswith("blind"):
        import time

        begin = time.process_time()
        solution = arm.ik(goals, near=_starts(arm, search, points, effort.seed), solver=solver)
        seconds = time.process_time() - begin
    else:
        solution, seconds = timed(arm, goals, solver)
    low, high = _bootstrap(1e3 * solution.position_error)
    return {
        **errors(solution),
        "mean_low_mm": low,
        "mean_high_mm": high,
        "below_1_mm": float((solution.position_error < 1e-3).mean()),
        "evaluations_mean": float(solution.evaluations.mean()),
        "ms_per_point": 1e3 * seconds / points,
    }


def _starts(arm: kinseek.Arm, search: str, points: int, seed: int) -> Array:
    """Starts of the blind search: the answer moved by up to 0.1 rad or m a joint; or anywhere."""
    if search.endswith("near"):
        noise = np.random.default_rng([seed, arm.dof, 1]).uniform(-0.1, 0.1, (points, arm.dof))
        return np.asarray(random_joints(arm, points, seed) + noise)
    return random_joints(arm, points, seed + 1)


def _bootstrap(errors: Array, draws: int = 1000) -> tuple[float, float]:
    """The middle 95 % of the means of resampled errors."""
    rng = np.random.default_rng(0)
    means = errors[rng.integers(0, len(errors), (draws, len(errors)))].mean(axis=1)
    return float(np.percentile(means, 2.5)), float(np.percentile(means, 97.5))


def draw(rows: Sequence[Row], path: Path) -> None:
    """For every arm and search: median, mean with its 95 % interval, 95th percentile; and the work, below."""
    figure, axes = canvas(2, 4, (13, 8.6), sharey=True)
    for over, under, dof in zip(axes[0], axes[1], ARMS, strict=True):
        for row in where(rows, dof=dof):
            place = -SEARCHES.index(row["search"])
            low, mean, high = (
                _shown(row[name]) for name in ("mean_low_mm", "position_mean_mm", "mean_high_mm")
            )
            median, worst = _shown(row["position_median_mm"]), _shown(row["position_p95_mm"])
            over.plot([median, worst], [place, place], color="#999999", linewidth=1, zorder=1)
            over.plot(median, place, "o", color="#000000", label="median", clip_on=False)
            over.plot(worst, place, "|", color="#000000", markersize=9, label="95th percentile")
            over.plot(
                [low, high],
                [place, place],
                color="#c23b00",
                linewidth=4,
                alpha=0.6,
                label="mean, 95 % interval",
            )
            over.plot(mean, place, "D", color="#c23b00", markersize=4, clip_on=False)
            under.plot(row["evaluations_mean"], place, "s", color="#0072b2", clip_on=False)
        over.set(xscale="log", title=NAMES[dof], xlabel="position error [mm]", xlim=(1e-7, 2e3))
        over.axvline(1, color="#777777", linewidth=1, label="1 mm")
        absent = [-n for n, search in enumerate(SEARCHES) if not where(rows, dof=dof, search=search)]
        if absent:
            over.text(1e-4, sum(absent) / len(absent), "not run:\ntoo many nodes", ha="center", va="center")
        under.set(xscale="log", xlabel="FK evaluations per point", xlim=(1, 1e8))
    for axis in axes[:, 0]:
        axis.set_yticks([-n for n in range(len(SEARCHES))], SEARCHES)
    handles, labels = axes[0, 0].get_legend_handles_labels()
    unique = dict(zip(labels, handles, strict=True))
    figure.legend(unique.values(), unique.keys(), loc="outside lower center", ncols=4)
    figure.suptitle("Beyond the paper: errors (above; left edge: 1e-7 mm or less) and work (below)")
    save(figure, path)


def _shown(value: object) -> float:
    return max(float(str(value)), 1.2e-7)
