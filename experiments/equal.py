"""All searches at equal evaluations: each gets the same number of forward kinematics and spends no more."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

import kinseek

from .arms import ARMS, BRANCHING_FACTOR, DIVISIONS, error_columns, random_goals, spacings
from .effort import Effort, Row
from .style import NAMES, canvas, finish, lines, where

SEARCHES = (
    "brute force, largest B",
    "DaC, widest CB",
    "DaC + CB(1), widest beam",
    "DaC + CB(2), widest beam",
    "blind search, from the middle",
    "coordinate descent, from the middle",
    "beam, then descent",
    "default of arm.ik",
)
_PASSES = len(spacings(BRANCHING_FACTOR, DIVISIONS))


def cases(effort: Effort) -> list[Row]:
    """Every search with every budget."""
    budgets = effort.pick((1000, 10_000, 100_000, 1_000_000), (1000,))
    return [
        {"dof": dof, "arm": arm, "search": search, "budget": budget}
        for dof, arm in ARMS.items()
        if dof in effort.pick((2, 3, 4, 6), (2,))
        for search in SEARCHES
        for budget in budgets
    ]


def leaves(dof: int, breadth: int, beam: int) -> int:
    """Evaluations of divide and conquer at most."""
    return int(DIVISIONS**dof + (_PASSES - 1) * beam * (2 * (DIVISIONS // 2 + breadth) - 1) ** dof)


def largest(fits: Callable[[int], bool]) -> int:
    """The largest whole number up to a million that fits, at least one."""
    low, high = 1, 10**6
    while low < high:
        middle = (low + high + 1) // 2
        low, high = (middle, high) if fits(middle) else (low, middle - 1)
    return low


def solver_of(search: str, dof: int, budget: int) -> tuple[kinseek.Solver, int]:
    """A search as large as its budget allows, and the parameter that was chosen."""
    breadth = largest(lambda b: leaves(dof, b, 1) <= budget)
    beam = {b: largest(lambda k, b=b: leaves(dof, b, k) <= budget) for b in (1, 2)}  # type: ignore[misc]
    size = largest(lambda b: b**dof <= budget)
    made: dict[str, tuple[kinseek.Solver, int]] = {
        SEARCHES[0]: (kinseek.BruteForce(size), size),
        SEARCHES[1]: (kinseek.DivideAndConquer(BRANCHING_FACTOR, DIVISIONS, breadth), breadth),
        SEARCHES[2]: (
            kinseek.DivideAndConquer(BRANCHING_FACTOR, DIVISIONS, 1, beam=min(beam[1], 256)),
            min(beam[1], 256),
        ),
        SEARCHES[3]: (
            kinseek.DivideAndConquer(BRANCHING_FACTOR, DIVISIONS, 2, beam=min(beam[2], 256)),
            min(beam[2], 256),
        ),
        SEARCHES[4]: (kinseek.BlindSearch(most_steps=100_000), 0),
        SEARCHES[5]: (kinseek.CoordinateDescent(), 0),
        SEARCHES[6]: (kinseek.Polished(), 0),
        SEARCHES[7]: (kinseek.Atlas(threads=1), 0),
    }
    return made[search]


def measure(case: Row, effort: Effort) -> Row:
    """Errors; the search also gets the budget, so that none exceeds it."""
    arm, search, budget = kinseek.load(case["arm"]), case["search"], case["budget"]
    points = effort.pick(200 if budget < 10**5 else 40, 2)
    solver, parameter = solver_of(search, arm.dof, budget)
    goal = kinseek.Goal.pose(random_goals(arm, points, effort.seed))
    solution = solver.solve(kinseek.Problem(arm.chain, goal, budget=budget))
    return {
        "parameter": parameter,
        "points": points,
        "evaluations_mean": float(np.mean(solution.evaluations)),
        "evaluations_max": int(np.max(solution.evaluations)),
        **error_columns(solution.position_error, solution.orientation_error),
    }


def draw(rows: Sequence[Row], path: Path) -> None:
    """Mean above, median below, against the budget."""
    figure, axes = canvas(2, 4, (13, 7.6), sharex=True, sharey="row")
    panels = ("position_mean_mm", "position_median_mm")
    for place, dof in enumerate(ARMS):
        for line, name in zip(axes, panels, strict=True):
            some = [{**row, name: max(row[name], 1e-7)} for row in where(rows, dof=dof)]
            lines(line[place], some, "budget", name, "search", SEARCHES)
            line[place].set(xscale="log", yscale="log")
            line[place].axhline(1, color="#777777", linewidth=1)
        axes[0, place].set_title(NAMES[dof])
        axes[1, place].set_xlabel("FK evaluations allowed per point")
    axes[0, 0].set_ylabel("mean position error [mm]")
    axes[1, 0].set_ylabel("median position error [mm]")
    finish(figure, axes[0, 0], path, "All searches at equal evaluations (lower edge: 1e-7 mm or less)", 4)
