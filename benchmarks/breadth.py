"""Tuned against constant breadth (the paper's BT and CB) with the same budget of leaves in a window.

For each of the paper's arms and each constant breadth, tuning may use as many leaves as the window of the constant breadth
has.
python -m benchmarks.breadth [TARGETS]
"""

from __future__ import annotations

import numpy as np

import kinseek
from kinseek import DivideAndConquer, Goal, Problem

from .command import at_least_one, command

CASES = {"planar2": (1, 2, 3, 5), "cylindrical3": (1, 2, 3), "scara4": (1, 2, 3), "elbow6": (1, 2)}


def main() -> None:
    """Print a row an arm and budget: mean position error [mm], mean weighted error, nodes expanded."""
    parser = command(__file__, __doc__)
    parser.add_argument("targets", nargs="?", type=at_least_one, default=500, help="an arm, 500 by default")
    count = parser.parse_args().targets
    print(f"{'arm':14}{'leaves':>8}{'breadth':>22}{'mean [mm]':>12}{'mean error':>12}{'nodes':>10}")
    for name, breadths in CASES.items():
        arm = kinseek.load(name)
        q = np.random.default_rng(99).uniform(arm.lower, arm.upper, (count, arm.dof))
        targets = arm.fk(q)
        for breadth in breadths:
            leaves = (2 * (1 + breadth) - 1) ** arm.dof
            budget = max(leaves, 3**arm.dof + 1)
            for solver in (
                DivideAndConquer(breadth=breadth),
                DivideAndConquer(breadth="tuned", node_budget=budget),
            ):
                shown = solver.breadths(Problem(arm.chain, Goal.pose(targets[0])))
                solution = arm.ik(targets, solver=solver)
                print(
                    f"{name:14}{leaves:8}{solver.breadth!s:>6}{shown!s:>22}"
                    f"{1e3 * solution.position_error.mean():12.3f}{solution.weighted_error.mean():12.5f}"
                    f"{solution.nodes_expanded.mean():10.0f}",
                    flush=True,
                )


if __name__ == "__main__":
    main()
