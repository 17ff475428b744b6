"""Map what a UR5e reaches: the capability map with the first joint divided out, and the best base for a task.

Run: python examples/15_map.py [PICTURE]
"""

import sys

import numpy as np

import kinseek
from kinseek import maps, plots

arm = kinseek.load("ur5e")

# A pose turned about the first axis is reached by the same joints but for the first: one plane of cells serves all around.
even = maps.orientations(144)
print(even)
rings = maps.Rings(radius=(0.0, 1.0, 0.1), height=(-0.8, 1.0, 0.1), orientations=even)
m = maps.reach(arm, rings, what=("reached",), block=rings.size)
share = maps.capability(m)
print(f"{rings.size:,} poses, {float((m.reached == 1).mean()):.0%} reached")
print(f"every orientation of the grid is reached at {int((share == 1).sum())} of {share.size} places")

# Read anywhere, turned about the first axis as well.
for yaw in (0.0, 2.0):
    T = kinseek.pose([0.5 * np.cos(yaw), 0.5 * np.sin(yaw), 0.3], rpy=[np.pi, 0.0, yaw])
    print(f"yaw {yaw}: the map says {int(maps.at(m, T)['reached'])}, ik says {arm.ik(T).success}")

# A shelf: six poses with the tool along x, and places on the floor for the base.
task = np.stack(
    [kinseek.pose([1.0, y, z], rpy=[0.0, np.pi / 2, 0.0]) for y in (-0.4, 0.0, 0.4) for z in (0.2, 0.6)]
)
places = [kinseek.pose([x, y, 0.0]) for x in np.linspace(0.0, 0.9, 10) for y in np.linspace(-0.6, 0.6, 13)]
ranked = maps.best_base(arm, task, places)
first = ranked.isel(candidate=0)
print(f"base at {first.base.values[:2, 3].round(2)} reaches {int(first.reached)} of {len(task)} poses,")
print(f"limit distance at least {float(first.worst):.2f}, which pose {int(first.limiting)} limits")

figure, axes = plots.plane(columns=2, size=(9.5, 4.4))
plots.map_slice(m, ax=axes[0])
plots.bases(ranked, ax=axes[1])
axes[1].plot(*task[:, :2, 3].T, "k+", markersize=9, label="poses")
axes[1].legend(frameon=False, loc="upper left", bbox_to_anchor=(0.0, -0.12), ncols=2)
print("wrote", plots.save(figure, sys.argv[1] if len(sys.argv) > 1 else "15_map.png"))
