"""Plan beside another arm: where the UR5e stands decides which path the Panda takes, and whether there is one.

Run: python examples/16_two_arms.py [PICTURE]
"""

import sys

import numpy as np

import kinseek
from kinseek import plots
from kinseek.collision import Box

arm, other = kinseek.load("panda"), kinseek.load("ur5e")

# Each arm has a scene of its own. In that of the Panda the UR5e is an obstacle that faces it, with all that it carries.
gripper = Box((0.2, 0.06, 0.12))
others = kinseek.Scene.of(other, capsules=0.05)
others.attach("gripper", gripper, to="tool0", pose=kinseek.pose([0.0, 0.0, 0.06]))
scene = kinseek.Scene.of(arm, capsules=0.06)
scene.add_box("table", (1.5, 1.2, 0.04), kinseek.pose([0.5, 0.0, -0.08]))
facing = kinseek.pose([1.05, 0.0, 0.0], rpy=[0.0, 0.0, np.pi])
rest = np.array([0.0, -1.9, 2.2, -1.9, -1.57, 0.0])
scene.add_arm("UR5e", others, rest, pose=facing)
print(scene)

# The Panda lays a bead along the table, while the UR5e holds something above it.
bead = np.array([kinseek.pose([0.42, y, 0.12], rpy=[np.pi, 0.0, 0.0]) for y in np.linspace(-0.35, 0.35, 150)])
elbow_up = [0.0, -0.8, 0.0, -2.4, 0.0, 1.6, 0.8]
start = arm.ik(bead[0], near=elbow_up).q
plain = arm.follow(bead, start=start).require()


def holding(x: float, z: float) -> np.ndarray:
    """Where the UR5e stands when its gripper is above the table at x, z in the base of the Panda."""
    hand = np.linalg.inv(facing) @ kinseek.pose([x, 0.0, z], rpy=[np.pi, 0.0, np.pi])
    return other.ik(hand, scene=others, near=rest).require().q


stations = {"at rest": rest, "high": holding(0.35, 0.5), "low": holding(0.4, 0.35)}
taken = {}
for name, q in stations.items():
    scene.move("UR5e", q)  # Nothing is built anew.
    hits = int((~scene.free(plain.q, 0.01)).sum())
    taken[name] = path = arm.follow(bead, scene=scene, clearance=0.01)
    print(f"  UR5e {name:8} the plain path comes too near at {hits:2} of {len(bead)} poses; {path}")
    for why in path.why:
        print(f"{'':16} {why}")

# A picture: the UR5e holds high, the way the Panda takes then, and as a ghost the way it would have taken.
q = stations["high"]
scene.move("UR5e", q)
worst = int(np.argmin(scene.distance(plain.q)))
figure, axes = plots.space(elevation=22, azimuth=-120)
corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
top = corners[[1, 3, 7, 5, 1]] * (1.5, 1.2, 0.04) + [0.5, 0.0, -0.08]
plots.draw_line(axes, top, color="0.6", linewidth=1)
plots.draw_line(axes, bead[:, :3, 3], color="0.2", linewidth=2)
plots.draw_arm(axes, arm, plain.q[worst], plots.COLOURS[1], linewidth=3, alpha=0.4)
plots.draw_arm(axes, arm, taken["high"].q[worst], plots.COLOURS[0], linewidth=4)
links = [(facing @ other.fk(q, link=link))[:3, 3] for link in (*other.joint_names, other.tip)]
plots.draw_line(axes, [facing[:3, 3], *links], color=plots.COLOURS[2], linewidth=4)
hand = facing @ other.fk(q) @ kinseek.pose([0.0, 0.0, 0.06])
box = corners * np.asarray(gripper.size) @ hand[:3, :3].T + hand[:3, 3]
for a, b in [(i, i | bit) for i in range(8) for bit in (1, 2, 4) if not i & bit]:
    plots.draw_line(axes, box[[a, b]], color=plots.COLOURS[2], linewidth=1)
plots.same_scale(axes)
plots.trim(figure, axes, "The UR5e is in the way, and the elbow goes round")
print("wrote", plots.save(figure, sys.argv[1] if len(sys.argv) > 1 else "16_two_arms.png"))
