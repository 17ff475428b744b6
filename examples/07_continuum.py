"""Use black-box kinematics for a continuum robot: three bending sections and no joints, only a function for the pose.

Every section bends to an arc of constant curvature (Webster and Jones 2010, *Design and Kinematic Modeling of Constant
Curvature Continuum Robots: A Review*, Int. J. Robotics Research 29(13), Sec. 3). An arc of length s that bends by the
angle θ towards the direction φ ends at (s/θ) · [(1 - cos θ) cos φ, (1 - cos θ) sin φ, sin θ], turned by θ about the axis
[-sin φ, cos φ, 0]. Here a section is given by u = θ cos φ and v = θ sin φ, which have no seam where it is straight.

Run: python examples/07_continuum.py [PICTURE]
"""

import sys
import time

import numpy as np
from numpy.typing import NDArray

import kinseek
from kinseek import plots

Array = NDArray[np.float64]

LENGTHS = (0.30, 0.25, 0.20)
"""Of the sections [m]."""


def arc(u: Array, v: Array, length: float) -> Array:
    """The far end of a section seen from its near end, (k,), (k,) -> (k, 4, 4)."""
    angle = np.hypot(u, v)
    safe = np.where(angle > 1e-6, angle, 1.0)
    rise = np.where(angle > 1e-6, np.sin(safe) / safe, 1 - angle**2 / 6)  # sin θ / θ
    side = np.where(angle > 1e-6, (1 - np.cos(safe)) / safe**2, 0.5 - angle**2 / 24)  # (1 - cos θ) / θ²
    T = np.zeros((len(u), 4, 4))
    T[:, 0, 0], T[:, 1, 1], T[:, 2, 2] = 1 - side * u * u, 1 - side * v * v, np.cos(angle)
    T[:, 0, 1] = T[:, 1, 0] = -side * u * v
    T[:, 0, 2], T[:, 2, 0], T[:, 1, 2], T[:, 2, 1] = rise * u, -rise * u, rise * v, -rise * v
    T[:, 0, 3], T[:, 1, 3], T[:, 2, 3] = length * side * u, length * side * v, length * rise
    T[:, 3, 3] = 1
    return T


def fk(q: Array) -> Array:
    """The tip of the third section, (k, 6) -> (k, 4, 4)."""
    T = arc(q[:, 0], q[:, 1], LENGTHS[0])
    for i in (1, 2):
        T = T @ arc(q[:, 2 * i], q[:, 2 * i + 1], LENGTHS[i])
    return T


def backbone(q: Array) -> Array:
    """Points along the robot, for the picture, (6,) -> (k, 3)."""
    points, base = [np.zeros((1, 3))], np.eye(4)
    for i, length in enumerate(LENGTHS):
        u, v = q[2 * i : 2 * i + 2]
        parts = np.linspace(0, 1, 25)[1:]
        along = np.array([arc(np.array([u * s]), np.array([v * s]), length * s)[0] for s in parts])
        points.append((base @ along)[:, :3, 3])
        base = base @ along[-1]
    return np.concatenate(points)


bend = np.full(6, 1.8)
names = [f"section{i + 1}_{letter}" for i in range(3) for letter in "uv"]
robot = kinseek.Arm.from_fk(fk, -bend, bend, names=names, name="continuum")
print(robot)

targets = robot.fk(np.random.default_rng(7).uniform(-bend, bend, (200, 6)))
robot.ik(targets[0])  # Takes the samples.
clock = time.perf_counter()
solution = robot.ik(targets)
print(f"  {robot.atlas}")
print(
    f"  200 random poses: {np.mean(solution.success):.1%} solved to 1e-6, {np.median(solution.evaluations):.0f} "
    f"poses asked for each, {(time.perf_counter() - clock) / 200 * 1e3:.1f} ms a pose"
)

# No joint of it turns about an axis. The search that needs axes finds that out by asking, and says so.
try:
    robot.ik(targets[0], solver=kinseek.CoordinateDescent())
except kinseek.InvalidSolver as error:
    print(" ", error)

# Round a ring with the tip along the ring's axis, as one looks into a pipe; each answer near the one before.
figure, axes = plots.space(elevation=18, azimuth=-55)
q = np.zeros(6)
for angle in np.linspace(0, 2 * np.pi, 8, endpoint=False):
    place = [0.25 * np.cos(angle), 0.25 * np.sin(angle), 0.55]
    ring = robot.ik(kinseek.Goal.pointing(place, direction=[0, 0, 1]), near=q)
    q = ring.q
    print(f"  {np.degrees(angle):4.0f}°: {ring.status}")
    line = backbone(q)
    for section in range(3):
        part = line[24 * section : 24 * section + 25]
        plots.draw_line(axes, part, color=plots.COLOURS[section], linewidth=3.5 - section)
    plots.draw_frame(axes, robot.fk(q), 0.06)
plots.same_scale(axes)
plots.trim(figure, axes, "Three constant-curvature sections, the tip upright on a ring")
print("wrote", plots.save(figure, sys.argv[1] if len(sys.argv) > 1 else "07_continuum.png"))
