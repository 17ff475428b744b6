"""A pen on a sphere, held by an arm of five joints: it can point where it likes, and not turn about the pen as well.

Run: python examples/12_pen_on_a_sphere.py [PICTURE]
"""

import sys

import numpy as np

import kinseek
from kinseek import plots
from kinseek.plots.arms import pyplot

arm = kinseek.load("so101")

# A spiral on a sphere of 5 cm; the pen stands on the sphere, as far as it is asked to: within 20 degrees.
s = np.linspace(0, 1, 400)
turn, tilt = 6 * np.pi * s, 0.1 + 0.6 * s
out = np.stack([np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), np.cos(tilt)], axis=1)
places = np.array([0.25, 0.0, 0.05]) + 0.05 * out
straight = kinseek.Goal.position(places)
path = arm.follow(straight)
print("only the place:", path)
print("               ", path.status)

# Which way along the tool is the pen? The axis of the tip that points most downward where the arm starts.
tips = arm.fk(path.q)
axis = np.eye(3)[int(np.argmax(np.abs(tips[0, 2, :3])))]
axis = -axis * np.sign(tips[0, 2, :3] @ axis)
held = np.einsum("kij,j->ki", tips[:, :3, :3], axis)
leaning = np.degrees(np.arccos(np.clip(-(held * out).sum(axis=1), -1, 1)))
print(f"                the pen leans by {leaning.min():.0f} to {leaning.max():.0f} degrees there")

goals = [kinseek.Goal.pointing(p, -n, axis) for p, n in zip(places, out, strict=True)]
targets = np.array([goal.target for goal in goals])
pen = arm.follow(kinseek.Goal(targets, kind="pointing", tool_axis=tuple(axis)))
print("upright pen:   ", pen)
print("               ", pen.status)
for reason in pen.why[:4]:
    print("               ", reason)

figure, both = pyplot().subplots(2, 1, figsize=(6.4, 5.2), sharex=True, layout="constrained")
for j, joint in enumerate(arm.joint_names):
    both[0].plot(pen.q[:, j], color=plots.COLOURS[j], label=joint)
    both[0].plot(path.q[:, j], color=plots.COLOURS[j], ls=":", lw=1)
for i in pen.breaks:
    both[0].axvline(i + 0.5, color="k", lw=0.6)
both[0].set(ylabel="joints [rad], dotted: only the place", title="A pen on a sphere, five joints")
both[0].legend(ncols=3, fontsize=7)
both[1].semilogy(np.maximum(pen.orientation_error, 1e-9), label="orientation [rad]")
both[1].semilogy(np.maximum(pen.position_error, 1e-9), label="position [m]")
both[1].set(xlabel="pose", ylabel="error with an upright pen")
both[1].legend()
print("wrote", plots.save(figure, sys.argv[1] if len(sys.argv) > 1 else "12_pen_on_a_sphere.png"))
