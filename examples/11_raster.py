"""Follow a raster over a plate: 11 rows of a spray gun, which may turn freely about its own axis.

Run: python examples/11_raster.py [PICTURE]
"""

import sys
import time

import numpy as np
from matplotlib import pyplot

import kinseek
from kinseek import plots

arm = kinseek.load("panda")

# There and back over a plate of 0.3 m by 0.2 m, 2,000 poses, straight down.
rows = []
for k, y in enumerate(np.linspace(-0.1, 0.1, 11)):
    x = np.linspace(0.35, 0.65, 180)
    rows += [[each, y, 0.3] for each in (x if k % 2 == 0 else x[::-1])]
raster = np.array([kinseek.pose(row, rpy=[np.pi, 0, 0]) for row in rows])
arm.follow(raster[:10])  # What the arm needs once.
for name, goal in (
    ("every turn given", kinseek.Goal.pose(raster)),
    ("turn about the tool free", kinseek.Goal.pose(raster, free="rz")),
):
    began = time.perf_counter()
    path = arm.follow(goal)
    took = time.perf_counter() - began
    print(f"{name:25} {path}")
    print(f"{'':25} {took:.2f} s for {len(path)} poses, largest step {path.largest_step.max():.4f} rad")
    print(f"{'':25} errors at most {path.position_error.max():.1e} m, {path.orientation_error.max():.1e} rad")
path.require()

figure, axes = pyplot.subplots(figsize=(6.4, 3.6), layout="constrained")
middle, half = (arm.lower + arm.upper) / 2, (arm.upper - arm.lower) / 2
for j, joint in enumerate(arm.joint_names):
    axes.plot((path.q[:, j] - middle[j]) / half[j], color=plots.COLOURS[j], label=joint)
axes.axhline(1, color="k", lw=0.8)
axes.axhline(-1, color="k", lw=0.8)
axes.set(
    xlabel="pose", ylabel="joints, limits at ±1", title="A raster of 11 rows, the turn about the tool free"
)
figure.legend(ncols=4, fontsize=7, loc="outside lower center")
print("wrote", plots.save(figure, sys.argv[1] if len(sys.argv) > 1 else "11_raster.png"))
