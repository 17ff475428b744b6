"""Draw what a search does: the paper's Figures 1 to 3 from a real search, pass by pass, and searches side by side.

Run: python examples/09_trace.py [PICTURE.png] [tree | circles | breadths | windows | progress]
"""

import sys

import kinseek
from kinseek import plots

PICTURES = "tree", "circles", "breadths", "windows", "progress"
path = sys.argv[1] if len(sys.argv) > 1 else "09_trace.png"
which = sys.argv[2] if len(sys.argv) > 2 else "windows"
if which not in PICTURES or not path.endswith(".png"):
    sys.exit(f"Run: python examples/09_trace.py [PICTURE.png] [{' | '.join(PICTURES)}]")
arm = kinseek.load("planar2")
target = arm.fk([2.0, 1.1])


def search(breadth: int) -> kinseek.Solution:
    """Refine a grid around its best node, and keep what each pass does."""
    return arm.ik(target, solver=kinseek.DivideAndConquer(breadth=breadth), trace=True)


solution = search(breadth=2)
print(solution.trace)

if which == "tree":  # Fig. 1: a level for each joint, a leaf for each node of the first pass.
    figure = plots.tree(solution)
elif which == "circles":  # Fig. 2: what the first passes try for one joint.
    figure = plots.circles(solution)
elif which == "breadths":  # Fig. 3: what the second pass tries, with three breadths.
    figure = plots.breadths({f"Br = {breadth}": search(breadth) for breadth in (1, 2, 3)})
elif which == "windows":  # How the windows close in, over the error of every pair of joint values.
    figure = plots.windows(solution)
else:  # Searches side by side, on six joints.
    arm = kinseek.load("elbow6")
    target = arm.fk([0.3, -0.8, 1.1, 0.4, 0.9, -0.2])
    searches: dict[str, kinseek.Solver] = {
        "brute force, B = 8": kinseek.BruteForce(branching_factor=8),
        "divide and conquer, CB(1)": kinseek.DivideAndConquer(),
        "divide and conquer, CB(2)": kinseek.DivideAndConquer(breadth=2),
        "the same, beam of 16": kinseek.DivideAndConquer(breadth=2, beam=16),
        "blind search": kinseek.BlindSearch(),
        "coordinate descent": kinseek.CoordinateDescent(),
        "atlas": kinseek.Atlas(),
    }
    figure = plots.progress(
        {name: arm.ik(target, solver=solver, trace=True) for name, solver in searches.items()}
    )
print("wrote", plots.save(figure, path))
