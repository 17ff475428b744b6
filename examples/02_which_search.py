"""Compare the searches: every search gets the same reachable targets, and a table shows how many it reaches.

Run: python examples/02_which_search.py [ARM] [TARGETS]
"""

import sys
import time

import numpy as np

import kinseek

arm = kinseek.load(sys.argv[1] if len(sys.argv) > 1 else "elbow6")
count = int(sys.argv[2]) if len(sys.argv) > 2 else 20

postures = np.random.default_rng(1).uniform(arm.lower, arm.upper, (count, arm.dof))
targets = arm.fk(postures)

searches: dict[str, kinseek.Solver] = {
    "atlas, the default": kinseek.Atlas(),
    "brute force, B = 8": kinseek.BruteForce(branching_factor=8),
    "divide and conquer, CB(1)": kinseek.DivideAndConquer(breadth=1),
    "divide and conquer, CB(2)": kinseek.DivideAndConquer(breadth=2),
    "divide and conquer, CB(2), beam 16": kinseek.DivideAndConquer(breadth=2, beam=16, children=2),
    "separate chains, CB(2)": kinseek.SeparateChains(breadth=2),
    "divide and conquer, then descent": kinseek.Polished(),
    "blind search": kinseek.BlindSearch(),
    "coordinate descent": kinseek.CoordinateDescent(),
}

print(f"{count} reachable poses of {arm.name}; local searches start in the middle of every range")
print(
    f"{'search':36}{'reached':>8}{'to 1 mm':>9}{'median error':>15}{'FK evaluations':>16}{'time a pose':>13}"
)
for name, search in searches.items():
    arm.ik(targets[0], solver=search)  # Compiles, or loads what an earlier run has compiled.
    clock = time.perf_counter()
    solution = arm.ik(targets, solver=search)
    milliseconds = (time.perf_counter() - clock) / count * 1000
    print(
        f"{name:36}{np.sum(solution.success):8}{np.sum(solution.position_error <= 1e-3):9}"
        f"{np.median(solution.position_error) * 1000:12.2g} mm{np.mean(solution.evaluations):16,.0f}"
        f"{milliseconds:10.3g} ms"
    )
