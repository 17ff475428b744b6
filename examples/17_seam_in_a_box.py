"""Weld inside a box without collisions: 300 poses of a torch along the edge at the back, and no link touches a wall.

Run: python examples/17_seam_in_a_box.py [PICTURE]
"""

import sys

import numpy as np

import kinseek
from kinseek import plots
from kinseek.collision import Capsule

# The end of the wire is 22 cm before the flange, bent by half a right angle, as torches are.
neck = kinseek.pose([0.0, 0.0, 0.14])
wire = neck @ kinseek.pose([0.0, 0.0, 0.0], rpy=[0.0, np.pi / 4, 0.0]) @ kinseek.pose([0.0, 0.0, 0.11])
arm = kinseek.load("ur5e").with_tool(wire)

walls = {
    "floor": ((0.4, 0.8, 0.01), [0.65, 0.0, 0.1]),
    "roof": ((0.4, 0.8, 0.01), [0.65, 0.0, 0.6]),
    "back": ((0.01, 0.8, 0.5), [0.85, 0.0, 0.35]),
    "left": ((0.4, 0.01, 0.5), [0.65, 0.4, 0.35]),
    "right": ((0.4, 0.01, 0.5), [0.65, -0.4, 0.35]),
}
scene = kinseek.Scene.of(arm, capsules=0.045)
for name, (size, place) in walls.items():
    scene.add_box(name, size, kinseek.pose(place))
scene.attach("torch", Capsule(0.018, 0.12), to="tool0", pose=kinseek.pose([0.0, 0.0, 0.07]))
nozzle = neck @ kinseek.pose([0.0, 0.0, 0.0], rpy=[0.0, np.pi / 4, 0.0]) @ kinseek.pose([0.0, 0.0, 0.04])
scene.attach("nozzle", Capsule(0.01, 0.08), to="tool0", pose=nozzle, touches=["torch"])
print(scene)

# Along the edge of floor and back, the wire 8 mm off both, half-way between them; the torch may turn about the wire.
aim = kinseek.pose([0.0, 0.0, 0.0], rpy=[0.0, 3 * np.pi / 4, 0.0])
seam = np.array([kinseek.pose([0.837, y, 0.113]) @ aim for y in np.linspace(-0.25, 0.25, 300)])
goal = kinseek.Goal.pose(seam, free="rz")
plain = arm.follow(goal)
free = arm.follow(goal, scene=scene, clearance=0.002)
for name, path in (("without the box", plain), ("inside the box", free)):
    hits = ~scene.free(path.q)
    print(f"{name:16} {path}: hits a wall at {hits.sum()} of {len(seam)} poses")
    for why in path.why:
        print(f"{'':16} {why}")
assert scene.free_motion(free.q[:-1], free.q[1:], 0.002).all()  # Of the whole way, not of samples.
print("nearest on the way:", f"{scene.distance(free.q).min() * 1e3:.1f} mm")

figure, axes = plots.space(elevation=18, azimuth=-118)
plots.arm(arm, [free.q[150], plain.q[150]], scene=scene, ax=axes)
plots.draw_line(axes, seam[:, :3, 3], color="0.1", linewidth=2)
plots.trim(figure, axes, "A seam at the back of a box")
print("wrote", plots.save(figure, sys.argv[1] if len(sys.argv) > 1 else "17_seam_in_a_box.png"))
