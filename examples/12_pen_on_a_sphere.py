"""Draw on a sphere with five joints: a place and a direction of the pen need all five.

Run: python examples/12_pen_on_a_sphere.py [PICTURE]
"""

import sys

import numpy as np
from matplotlib import pyplot

import kinseek
from kinseek import plots

arm = kinseek.load("so101")
pen = (0.0, -1.0, 0.0)  # Across the hand: along it, the arm could point within one plane alone.
centre, radius = np.array([0.245, -0.345, -0.008]), 0.04


def spiral(tilt: float) -> kinseek.Goal:
    """The pen stands upright on a spiral around the top of the sphere, as far down as `tilt` [rad]."""
    s = np.linspace(0, 1, 500)
    turn, down = 6 * np.pi * s, 0.05 + (tilt - 0.05) * s
    out = np.stack([np.sin(down) * np.cos(turn), np.sin(down) * np.sin(turn), np.cos(down)], axis=1)
    each = [kinseek.Goal.pointing(centre + radius * n, -n, pen).target for n in out]
    return kinseek.Goal(np.array(each), kind="pointing", tool_axis=pen)


path = arm.follow(spiral(0.35)).require()
print("down to 0.35 rad:", path)
print("  largest steps", np.array2string(path.largest_step, precision=4), "rad")
print(f"  between poses {path.deviation.distance * 1e3:.4f} mm off the line")
far = arm.follow(spiral(1.2))
print("down to 1.2 rad:", far)
print(" ", far.status)
for reason in far.why[:3]:
    print(" ", reason)
reached = int(np.flatnonzero(~far.reached)[0])
print(f"  the first {reached} poses are reached")

figure, both = pyplot.subplots(2, 1, figsize=(6.4, 5.2), sharex=True, layout="constrained")
for j, joint in enumerate(arm.joint_names):
    both[0].plot(path.q[:, j], color=plots.COLOURS[j], label=joint)
    both[1].plot(far.q[:, j], color=plots.COLOURS[j])
for i in np.flatnonzero(~far.reached):
    both[1].axvspan(i - 0.5, i + 0.5, color="0.9", lw=0)
for i in far.breaks:
    both[1].axvline(i + 0.5, color="k", lw=0.6)
both[0].set(ylabel="joints [rad]", title="A pen on a sphere, five joints: down to 0.35 rad")
both[0].legend(ncols=3, fontsize=7)
both[1].set(xlabel="pose", ylabel="joints [rad]", title="down to 1.2 rad; grey: out of reach")
print("wrote", plots.save(figure, sys.argv[1] if len(sys.argv) > 1 else "12_pen_on_a_sphere.png"))
