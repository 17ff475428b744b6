"""How many of 1,000 random reachable targets the beam reaches within 1 mm, on the paper's arms with one setting.

python -m benchmarks.reach [TARGETS]
"""

from __future__ import annotations

import time

import numpy as np

import kinseek
from kinseek import DivideAndConquer

from .command import at_least_one, command

SOLVER = DivideAndConquer(10**6, breadth="tuned", node_budget=5000, beam=64, children=2)


def main() -> None:
    """Print a row an arm, and the targets that were missed."""
    parser = command(__file__, __doc__)
    parser.add_argument(
        "targets", nargs="?", type=at_least_one, default=1000, help="an arm, 1,000 by default"
    )
    count = parser.parse_args().targets
    print(SOLVER)
    print(f"{'arm':14}{'within 1 mm':>12}{'mean [mm]':>12}{'worst [mm]':>12}{'ms a pose':>12}  missed q")
    for name in ("planar2", "cylindrical3", "scara4", "elbow6"):
        arm = kinseek.load(name)
        q = np.random.default_rng(2024).uniform(arm.lower, arm.upper, (count, arm.dof))
        targets = arm.fk(q)
        arm.ik(targets[0], solver=SOLVER)  # Compiles and tunes.
        start = time.perf_counter()
        solution = arm.ik(targets, solver=SOLVER)
        spent = (time.perf_counter() - start) / count
        error = solution.position_error
        missed = " ".join(np.array2string(each, precision=3) for each in q[error >= 1e-3])
        print(
            f"{name:14}{(error < 1e-3).mean():12.1%}{1e3 * error.mean():12.4f}{1e3 * error.max():12.3f}"
            f"{1e3 * spent:12.1f}  {missed}",
            flush=True,
        )


if __name__ == "__main__":
    main()
