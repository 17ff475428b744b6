"""Follow a weld seam: 600 poses around a cylinder, with a torch that may turn about its axis and lean within limits.

Run: python examples/10_weld_seam.py [PICTURE]
"""

import sys

import numpy as np
from matplotlib import pyplot

import kinseek
from kinseek import plots

arm = kinseek.load("ur5e")

# The seam runs nearly once around a pipe that lies along y, 10 cm in radius; the torch points at the pipe's axis.
angles = np.linspace(-3.0, 3.0, 600)
seam = np.array(
    [
        kinseek.pose([0.45 + 0.1 * np.sin(a), 0.0, 0.35 + 0.1 * np.cos(a)], rpy=[np.pi, 0, 0])
        @ kinseek.pose([0, 0, 0], rpy=[0, a, 0])
        for a in angles
    ]
)
fixed = arm.follow(seam)
loose = arm.follow(kinseek.Goal.pose(seam, box={"rz": (-0.6, 0.6)}))
leaning = arm.follow(kinseek.Goal.pose(seam, box={"rz": (-0.6, 0.6), "rx": (-0.2, 0.2), "ry": (-0.2, 0.2)}))
for name, path in (
    ("torch as given", fixed),
    ("may turn by 0.6 rad", loose),
    ("and lean by 0.2 rad", leaning),
):
    print(f"{name:20} {path}")
    print(f"{'':20} {path.status}")
    print(
        f"{'':20} between poses {path.deviation.distance * 1e3:.4f} mm, {path.deviation.turn:.5f} rad off the line"
    )
    for reason in path.why:
        print(f"{'':20} {reason}")

figure, both = pyplot.subplots(2, 1, figsize=(6.4, 5.2), sharex=True, layout="constrained")
for j, joint in enumerate(arm.joint_names):
    both[0].plot(loose.q[:, j], color=plots.COLOURS[j], label=joint.removesuffix("_joint"))
    both[0].plot(fixed.q[:, j], color=plots.COLOURS[j], ls=":", lw=1)
for i in fixed.breaks:
    both[0].axvline(i + 0.5, color="k", lw=0.8)
both[0].set(ylabel="joints [rad]", title="A weld seam on a pipe: torch may turn; dotted: torch as given")
both[0].legend(ncols=3, fontsize=7)
both[1].plot(arm.manipulability(loose.q), label="may turn")
both[1].plot(arm.manipulability(fixed.q), ls=":", label="as given")
both[1].set(xlabel="pose", ylabel="manipulability", ylim=(0, None))
both[1].legend()
print("wrote", plots.save(figure, sys.argv[1] if len(sys.argv) > 1 else "10_weld_seam.png"))
