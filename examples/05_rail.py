"""Use an arm on a rail: seven joints for six numbers give a whole curve of solutions, of which you choose one.

Run: python examples/05_rail.py [PICTURE]
"""

import sys

import numpy as np

import kinseek
from kinseek import plots

arm = kinseek.load("ur10e_rail")
print(arm)
print(f"  {arm.joint_names[0]} slides from {arm.lower[0]} to {arm.upper[0]} m")

# A weld along a beam 3.6 m long, the tool straight down.
places = np.linspace(-1.8, 1.8, 7).round(2) + 0.0
poses = np.array([kinseek.pose([x, 0.75, 0.3], rpy=[np.pi, 0, 0]) for x in places])
alone = kinseek.load("ur10e")
# Where the rail carries the arm at 0.
first = arm.fk(np.zeros(arm.dof)) @ np.linalg.inv(alone.fk(np.zeros(6)))
print(
    f"  with the rail {arm.ik(poses).success.sum()} of {len(poses)}, standing in the middle of it "
    f"{alone.ik(np.linalg.inv(first) @ poses).success.sum()} of {len(poses)}"
)

# Each answer near the one before: then the joints move on, and do not jump.
figure, axes = plots.space(elevation=28, azimuth=60)
q, jumps = np.array([-1.5, 1.0, -1.5, 1.8, -1.9, -1.5, 0.0]), []
for i, T in enumerate(poses):
    solution = arm.ik(T, near=q).require()
    if i:
        jumps.append(np.abs(solution.q - q).max())
    q = solution.q
    print(f"  x = {places[i]:5.2f} m  rail at {q[0]:6.3f} m  {solution.status}")
    plots.draw_arm(axes, arm, q, plots.COLOURS[i % 8], linewidth=2)
    plots.draw_frame(axes, T, 0.15)
print(f"  largest step of a joint between neighbours {max(jumps):.2f}")
plots.same_scale(axes)
plots.trim(figure, axes, "UR10e on a rail of 3 m")
print("wrote", plots.save(figure, sys.argv[1] if len(sys.argv) > 1 else "05_rail.png"))
