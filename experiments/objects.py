"""Numbers without objects (Sec. 5): the same search with node objects, with bare numbers, and compiled."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import kinseek
from benchmarks.timing import peak

from . import plain, twists
from .arms import ARMS, BRANCHING_FACTOR, BY_HAND, DIVISIONS, Array, random_goals, timed
from .effort import Effort, Row
from .style import LOOKS, canvas, column, save, where

KERNELS = {"kernels": "static", "kernels, DT": "dynamic"}
TWISTS = "twists, NumPy"
BREADTHS = {**BY_HAND, 7: (3, 3, 3, 1, 1, 1, 1)}
_POWERS = (9, 27, 81, 729, 19_683, 177_147)
_FAR_POWERS = (3**16, 3**17)
_SHOWN = ("objects", "objects, DT", "numbers", "numbers, frames carried", "kernels")


def cases(effort: Effort) -> list[Row]:
    """Heuristics at B = 7200, breadth tuning against B, brute force, and seven joints against twists."""
    asked: list[tuple[int, str, int]] = []
    methods = effort.pick(("CB(1)", "CB(2)", "BT"), ("CB(1)",))
    asked += [
        (dof, method, BRANCHING_FACTOR) for dof in effort.pick((2, 3, 4, 6), (2, 6)) for method in methods
    ]
    asked += effort.pick([(6, "CB(3)", BRANCHING_FACTOR), (7, "BT", BRANCHING_FACTOR)], [])
    asked += [(6, "BT", size) for size in effort.pick(_POWERS + _FAR_POWERS, (9,))]
    asked += effort.pick(
        [(2, "brute force", 720), (3, "brute force", 60), (4, "brute force", 60)], [(2, "brute force", 20)]
    )
    listed: list[Row] = []
    for dof, method, size in asked:
        programs = [*plain.PROGRAMS, *KERNELS]
        if size in _FAR_POWERS:
            # Hundreds of millions of node objects would fill the memory.
            programs = ["objects, DT", "numbers", "numbers, frames carried", "kernels, DT"]
        elif method == "brute force":
            programs = ["objects", "numbers", "numbers, frames carried", "kernels"]
        listed += [_case(dof, method, size, program) for program in programs]
    return [*listed, _case(7, "Newton", 1, TWISTS)]


def _case(dof: int, method: str, size: int, program: str) -> Row:
    return {"dof": dof, "method": method, "branching_factor": size, "program": program}


def arm_of(dof: int) -> kinseek.Arm:
    """The arm of `plain.ARMS`, for kinseek."""
    if dof in ARMS:
        return kinseek.load(ARMS[dof])
    quarter = np.pi / 2
    lengths, turns = (0.25, 0, 0.5, 0, 0.25, 0, 0), (-1, 1, -1, 1, -1, 1, 0)
    rows = [[0, turn * quarter, length, 0] for turn, length in zip(turns, lengths, strict=True)]
    return kinseek.Arm.from_dh(rows, [0.0] * 7, [2 * np.pi] * 7)


def measure(case: Row, effort: Effort) -> Row:
    """Time a program, count its nodes, and compare its answers with those of the kernels."""
    dof, method, size = case["dof"], case["method"], case["branching_factor"]
    if case["program"] == TWISTS:
        return _measure_twists(dof, effort)
    arm, brute = arm_of(dof), method == "brute force"
    breadths = BREADTHS[dof] if method == "BT" else (1 if brute else int(method[3]),) * dof
    grid = plain.Grid(plain.ARMS[dof], size, size if brute else DIVISIONS, breadths)
    goals = random_goals(arm, 100 if case["program"] in KERNELS else effort.pick(20, 1), effort.seed)
    tree = KERNELS.get(case["program"], "dynamic")
    solver: kinseek.Solver = kinseek.DivideAndConquer(size, DIVISIONS, breadths, tree)
    if brute:
        solver = kinseek.BruteForce(size)
    first = arm.ik(goals[0], solver=solver)
    nodes = int(first.nodes_expanded)
    points = int(np.clip(effort.pick(100_000, 1) // nodes, 1, len(goals)))
    if case["program"] in KERNELS:
        points = 1 if nodes > 10**6 else effort.pick(100, 3)
        return _measure_kernels(arm, goals[:points], solver)
    program = plain.PROGRAMS[case["program"]]
    answers, seconds, ready, made = _run(program, grid, goals[:points], 1 if nodes * points > 200_000 else 3)
    kernel = arm.ik(goals[:points], solver=solver).weighted_error
    errors = [
        plain.error_of(plain.pose_of(grid.arm, q), frame_of(goal))
        for q, goal in zip(answers, goals[:points], strict=True)
    ]
    return {
        "points": points,
        "nodes_expanded": made.expanded // points,
        "nodes_kernel": nodes,
        "nodes_created": made.created if grid_is_kept(made) else made.created // points,
        # Equal errors: where two nodes tie, rounding decides between them, and all later passes differ in a bit.
        "same_answers": float((np.abs(np.array(errors) - kernel) < 1e-9).mean()),
        "ms_per_point": 1e3 * seconds / points,
        "us_per_node": 1e6 * seconds / made.expanded,
        "preparation_ms": 1e3 * ready,
        "bytes_held": peak(lambda: _some(program, grid, goals[0])),
    }


def grid_is_kept(made: plain.ObjectSearch | plain.NumberSearch) -> bool:
    """Did it make all nodes beforehand, once for all points?"""
    return isinstance(made, plain.ObjectSearch) and not made.dynamic


def frame_of(pose: Array) -> plain.Frame:
    """A pose, (4, 4), as the twelve numbers of a plain frame."""
    return tuple(map(float, np.concatenate([pose[:3, 3], pose[:3, :3].T.ravel()])))


def _run(
    program: Callable[..., Any], grid: plain.Grid, goals: Array, times: int
) -> tuple[list[Any], float, float, Any]:
    """Answers, the shortest CPU time for all goals and for the tree [s], and the program as it was left."""
    frames, best, ready = [frame_of(goal) for goal in goals], np.inf, np.inf
    for _ in range(times):
        start = time.process_time()
        made = program(grid)
        prepared = time.process_time()
        answers = [made.solve(frame) for frame in frames]
        best, ready = min(best, time.process_time() - prepared), min(ready, prepared - start)
    return answers, best, ready, made


def _some(program: Callable[..., Any], grid: plain.Grid, goal: Array) -> object:
    """A search that ends where it holds no more than it has held before."""
    made = program(grid, 5000)
    with contextlib.suppress(plain.Enough):
        made.solve(frame_of(goal))
    return made


def _measure_kernels(arm: kinseek.Arm, goals: Array, solver: kinseek.Solver) -> Row:
    solution, seconds = timed(arm, goals, solver)
    nodes, points = int(solution.nodes_expanded.max()), len(goals)
    return {
        "points": points,
        "nodes_expanded": nodes,
        "nodes_kernel": nodes,
        "nodes_created": int(solution.nodes_created.max()),
        "same_answers": 1.0,
        "ms_per_point": 1e3 * seconds / points,
        "us_per_node": 1e6 * seconds / points / nodes,
        "preparation_ms": 0.0,
        "bytes_held": peak(lambda: arm.ik(goals[0], solver=solver)),
    }


def _measure_twists(dof: int, effort: Effort) -> Row:
    """Newton's steps on the same arm; `same_answers` is the share of poses brought within 1e-6."""
    points, arm = effort.pick(100, 2), plain.ARMS[dof]
    goals, rng = random_goals(arm_of(dof), points, effort.seed), np.random.default_rng(effort.seed)
    start = time.process_time()
    answers = [twists.solve(arm, goal, rng) for goal in goals]
    seconds = time.process_time() - start
    return {
        "points": points,
        "nodes_expanded": 0,
        "nodes_kernel": 0,
        "nodes_created": 0,
        "same_answers": sum(answer is not None for answer in answers) / points,
        "ms_per_point": 1e3 * seconds / points,
        "us_per_node": 0.0,
        "preparation_ms": 0.0,
        "bytes_held": peak(lambda: twists.solve(arm, goals[0], rng)),
    }


def draw(rows: Sequence[Row], path: Path) -> None:
    """Time a node, what objects cost, memory against B, and Figure 11 in plain Python."""
    figure, axes = canvas(2, 2, (13, 9))
    for look, program in zip(LOOKS, _SHOWN, strict=False):
        some = [
            row
            for row in where(rows, branching_factor=BRANCHING_FACTOR, program=program)
            if row["method"] != "CB(3)"
        ]
        best = {row["dof"]: row for row in some}
        if best:
            values = [row["us_per_node"] for row in best.values()]
            axes[0, 0].plot(list(best), values, label=program, **look)
    axes[0, 0].set(
        yscale="log", xlabel="DOF", ylabel="CPU time per node [µs]", title="the same nodes, B = 7200"
    )
    _draw_ratios(axes[0, 1], rows)
    _draw_growth(axes[1, 0], rows)
    for look, program in zip(LOOKS, ("objects", "objects, DT", "numbers", "kernels"), strict=False):
        some = sorted(
            where(rows, dof=6, method="BT", program=program), key=lambda row: row["branching_factor"]
        )
        sizes = column(some, "branching_factor")
        axes[1, 1].plot(sizes, [row["bytes_held"] / 2**20 for row in some], label=program, **look)
    axes[1, 1].axhline(4096, color="#777777", linewidth=1)
    axes[1, 1].text(9, 4500, "4 GB, the paper's laptop", color="#555555", va="bottom")
    axes[1, 1].set(
        xscale="log",
        yscale="log",
        xlabel="B, branching factor",
        ylabel="memory held [MiB]",
        title="6 DOF, BT",
    )
    axes[1, 1].set_ylim(1e-3, 2e4)
    for axis in axes.flat:
        axis.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    figure.suptitle("Numbers without objects (Sec. 5): one search, kept in four ways")
    save(figure, path)


def _draw_ratios(axis: Any, rows: Sequence[Row]) -> None:
    pairs = (("objects, DT", "objects"), ("numbers", "objects"), ("numbers, frames carried", "objects"))
    ticks: dict[str, int] = {}
    for look, (program, base) in zip(LOOKS[1:], pairs, strict=False):
        places, ratios = [], []
        for row in where(rows, program=program, branching_factor=BRANCHING_FACTOR):
            over = where(
                rows, program=base, **{key: row[key] for key in ("dof", "method", "branching_factor")}
            )
            if over:
                name = f"{row['dof']} DOF {row['method']}"
                places.append(ticks.setdefault(name, len(ticks)))
                ratios.append(row["ms_per_point"] / float(over[0]["ms_per_point"]))
        axis.plot(places, ratios, label=program, **{**look, "linestyle": "none"})
    axis.axhline(1, color="#000000", linewidth=1)
    axis.set(ylabel="time over that of node objects, tree ready", ylim=(0, 1.8), title="what an object costs")
    axis.set_xticks(list(ticks.values()), list(ticks), rotation=90, ha="center")


def _draw_growth(axis: Any, rows: Sequence[Row]) -> None:
    for look, program in zip(LOOKS[1:], ("objects, DT", "numbers", "kernels, DT"), strict=False):
        some = sorted(
            (
                row
                for row in where(rows, dof=6, method="BT", program=program)
                if row["branching_factor"] != BRANCHING_FACTOR
            ),
            key=lambda row: row["branching_factor"],
        )
        if some:
            first = float(some[0]["ms_per_point"])
            values = [row["ms_per_point"] / first for row in some]
            axis.plot(column(some, "branching_factor"), values, label=f"time, {program}", **look)
    some = sorted(
        where(rows, dof=6, method="BT", program="kernels, DT"), key=lambda row: row["branching_factor"]
    )
    nodes = [row["nodes_expanded"] for row in some]
    axis.plot(
        column(some, "branching_factor"),
        [n / nodes[0] for n in nodes],
        color="#999999",
        linewidth=4,
        alpha=0.5,
        label="nodes",
        zorder=0,
    )
    axis.set(
        xscale="log",
        xlabel="B, branching factor",
        ylabel="over B = 9",
        title="Fig. 11 in plain Python: 6 DOF, BT",
        ylim=(0, None),
    )
