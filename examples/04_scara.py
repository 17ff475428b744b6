"""Place parts with a SCARA arm: four joints, one of which slides, put parts down flat and in any turn, never tilted.

Run: python examples/04_scara.py [PICTURE]
"""

import sys

import numpy as np

import kinseek
from kinseek import plots

arm = kinseek.load("scara4")
print(arm)
print("  joint kinds:", ", ".join(arm.chain.kinds))

# Pick in one place, put down in others, each time with another turn about the vertical.
picks = {
    "above": kinseek.pose([0.45, 0.35, -0.02], rpy=[0, 0, 0.0]),
    "pick": kinseek.pose([0.45, 0.35, -0.20], rpy=[0, 0, 0.0]),
    "turn": kinseek.pose([0.10, 0.60, -0.05], rpy=[0, 0, np.pi / 2]),
    "place": kinseek.pose([-0.35, 0.40, -0.22], rpy=[0, 0, np.pi]),
}
figure, axes = plots.space()
before = (arm.lower + arm.upper) / 2
for (name, T), color in zip(picks.items(), plots.COLOURS, strict=False):
    solution = arm.ik(T, near=before).require()
    before = solution.q
    print(
        f"  {name:6} q = {np.array2string(solution.q, precision=3, suppress_small=True)}  {solution.status}"
    )
    plots.draw_arm(axes, arm, solution.q, color, label=name)
    plots.draw_frame(axes, T, 0.12)

# A tilted part is out of reach of this arm, wherever it lies. The answer says so, and how near it comes.
tilted = arm.ik(kinseek.pose([0.45, 0.35, -0.20], rpy=[0.3, 0, 0]))
print(
    f"  tilted by 0.3 rad: {tilted.status} {tilted.position_error:.1e} m, {tilted.orientation_error:.3f} rad"
)

# That nothing comes nearer can even be proved.
print(" ", arm.prove(kinseek.pose([0.45, 0.35, -0.20], rpy=[0.3, 0, 0])).verdict)
plots.same_scale(axes)
axes.legend()
plots.trim(figure, axes, "SCARA: pick and place")
print("wrote", plots.save(figure, sys.argv[1] if len(sys.argv) > 1 else "04_scara.png"))
