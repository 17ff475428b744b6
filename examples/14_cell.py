"""Find a branch without collisions: a UR5e beside a shelf and a camera pole, and the way to the first free branch.

Run: python examples/14_cell.py [PICTURE]
"""

import sys

import numpy as np

import kinseek
from kinseek import plots
from kinseek.collision import Box, Capsule

arm = kinseek.load("ur5e")

# The bundled file has links and joints only, so capsules stand in for the links; a URDF with geometry needs none.
scene = kinseek.Scene.of(arm, capsules=0.05)
boxes = {
    "table": ((1.0, 1.6, 0.04), [0.55, 0.0, -0.06]),
    "shelf floor": ((0.35, 0.8, 0.02), [0.75, 0.0, 0.15]),
    "shelf roof": ((0.35, 0.8, 0.02), [0.75, 0.0, 0.6]),
    "shelf left": ((0.35, 0.02, 0.47), [0.75, 0.4, 0.375]),
    "shelf right": ((0.35, 0.02, 0.47), [0.75, -0.4, 0.375]),
}
for name, (size, place) in boxes.items():
    scene.add_box(name, size, kinseek.pose(place))
scene.add_capsule("camera pole", 0.03, 0.8, kinseek.pose([0.35, 0.35, 0.4]))
scene.attach("gripper", Capsule(0.03, 0.08), to="tool0", pose=kinseek.pose([0.0, 0.0, 0.06]))
scene.attach(
    "part", Box((0.06, 0.06, 0.06)), to="tool0", pose=kinseek.pose([0.0, 0.0, 0.16]), touches=["gripper"]
)
print(scene)

# Into the shelf: the tool along x, the part 16 cm before the flange.
targets = [
    kinseek.pose([0.52, y, z], rpy=[0.0, np.pi / 2, 0.0]) for y in (-0.2, 0.0, 0.2) for z in (0.3, 0.45)
]
home = (
    arm.ik(kinseek.pose([0.28, -0.1, 0.4], rpy=[0.0, np.pi / 2, 0.0]), scene=scene, clearance=0.02)
    .require()
    .q
)
near = scene.nearest(home)
print(f"home: {near.a} and {near.b} are nearest, {near.distance:.3f} m apart")
for T in targets:
    every, solution = arm.branches(T), arm.ik(T, scene=scene, clearance=0.01, near=home)
    way = solution.success and scene.free_motion(home, solution.q)
    print(
        f"  y {T[1, 3]:5.2f} z {T[2, 3]:.2f}: {len(every)} branches, {scene.free(every.q, 0.01).sum()} free; "
        f"{solution.status.name}; straight from home: {'free' if way else 'not free'}"
    )
deep = arm.ik(kinseek.pose([0.55, 0.0, 0.17], rpy=[0.0, np.pi / 2, 0.0]), scene=scene)
print("  too low:", deep.status, *deep.contacts)

# A picture: the free answer solid, one that hits something as a ghost; what it hits is red.
T = targets[0]
free = arm.ik(T, scene=scene, clearance=0.01, near=home).require().q
hit = next(q for q in arm.branches(T) if not scene.free(q))
print("the ghost hits:", *scene.hits(hit))
figure, axes = plots.space(elevation=22, azimuth=-125)
plots.arm(arm, [free, hit], goal=T, scene=scene, ax=axes)
plots.trim(figure, axes, "UR5e: a branch that is free, and one that is not")
print("wrote", plots.save(figure, sys.argv[1] if len(sys.argv) > 1 else "14_cell.png"))
