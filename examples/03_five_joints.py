"""Use an arm with five joints: it cannot reach most poses, so give it a position, or a position and a direction.

Run: python examples/03_five_joints.py [PICTURE]
"""

import sys

import numpy as np

import kinseek
from kinseek import Goal, plots

arm = kinseek.load("so101")
postures = np.random.default_rng(3).uniform(arm.lower, arm.upper, (1000, arm.dof))
reachable = arm.fk(postures)
places = reachable[:, :3, 3]

# A position leaves the orientation free.
print(f"{arm.name}, {arm.dof} joints, 1,000 reachable targets")
print(f"  positions              {np.mean(arm.ik(Goal.position(places)).success):.1%} solved")

# A direction of the tool is two numbers more, five in all: as many as there are joints.
pointed = [arm.ik(Goal.pointing(T[:3, 3], T[:3, 2])).success for T in reachable]
print(f"  tool axis along them   {np.mean(pointed):.1%} solved")

# A whole pose is six numbers. Those that the arm made are reached; any turned by a bit about the vertical are not.
print(f"  whole poses            {np.mean(arm.ik(reachable).success):.1%} solved")
turned = reachable.copy()
turned[:, :3, :3] = kinseek.pose([0, 0, 0], rpy=[0, 0, 0.5])[:3, :3] @ turned[:, :3, :3]
solution = arm.ik(turned)
print(f"  the same, yawed 0.5    {np.mean(solution.success):.1%} solved, the rest is as near as it can be:")
print(
    f"  median errors {np.median(solution.position_error):.3f} m, {np.median(solution.orientation_error):.2f} rad"
)

# The gripper straight down over a table: the tool's own axis is z, and the turn about it is free. Its file rounds the
# axes, so that straight down is missed by some 4e-6 rad: a tolerance of 1e-3 rad says that this does not matter.
figure, axes = plots.space()
for i, y in enumerate(np.linspace(-0.16, 0.16, 5)):
    goal = Goal.pointing([0.2, y, 0.05], direction=[0, 0, -1], orientation_tolerance=1e-3)
    solution = arm.ik(goal)
    print(f"  down at y = {y:5.2f} m: {solution.status}")
    plots.draw_arm(axes, arm, solution.q, plots.COLOURS[i])
    plots.draw_frame(axes, arm.fk(solution.q), 0.05)
plots.same_scale(axes)
plots.trim(figure, axes, "SO-101, the gripper down at five places")
print("wrote", plots.save(figure, sys.argv[1] if len(sys.argv) > 1 else "03_five_joints.png"))
