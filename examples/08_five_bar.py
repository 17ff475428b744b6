"""Use black-box kinematics for a parallel mechanism: two motors drive five bars, and both chains meet at the tip.

At some motor angles the bars do not meet. `fk` returns NaN there, and the option ``partial=True`` allows this. The search
avoids such angles, and no solution lies there.

Run: python examples/08_five_bar.py [PICTURE]
"""

import sys

import numpy as np
from numpy.typing import NDArray

import kinseek
from kinseek import Goal, plots

Array = NDArray[np.float64]

GROUND, NEAR, FAR = 0.20, 0.25, 0.30
"""Between the motors; from a motor to its elbow; from an elbow to the tip [m]."""


def elbows(q: Array) -> Array:
    """Both elbows, (k, 2) -> (k, 2, 2)."""
    centres = np.array([[-GROUND / 2, 0.0], [GROUND / 2, 0.0]])
    return np.asarray(centres + NEAR * np.stack([np.cos(q), np.sin(q)], axis=-1))


def fk(q: Array) -> Array:
    """The tip, on the outer side of the line through both elbows, its x axis along the right bar, (k, 2) -> (k, 4, 4)."""
    left, right = np.swapaxes(elbows(q), 0, 1)
    across = right - left
    width = np.linalg.norm(across, axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):  # NaN where two circles about the elbows do not cut.
        height = np.sqrt(FAR**2 - width**2 / 4)
        unit = across / width[:, None]
    tip = (left + right) / 2 + height[:, None] * np.stack([-unit[:, 1], unit[:, 0]], axis=1)
    x = (tip - right) / FAR
    T = np.tile(np.eye(4), (len(q), 1, 1))
    T[:, :2, 3] = tip
    T[:, :2, 0], T[:, 0, 1], T[:, 1, 1] = x, -x[:, 1], x[:, 0]
    T[np.isnan(tip).any(axis=1)] = np.nan
    return T


lower, upper = np.radians([-30.0, -60.0]), np.radians([240.0, 210.0])
linkage = kinseek.Arm.from_fk(
    fk, lower, upper, names=["left", "right"], kinds="revolute", partial=True, name="five bar"
)
print(linkage)
motors = np.random.default_rng(8).uniform(lower, upper, (10_000, 2))
print(f"  the bars meet at {1 - np.isnan(linkage.fk(motors)[:, 0, 0]).mean():.1%} of all motor angles")

# Reachable points are reached; the answer is checked with the distances that the bars dictate.
points = linkage.fk(motors[:400])[:, :3, 3]
points = points[~np.isnan(points).any(axis=1)]
solution = linkage.ik(Goal.position(points))
bars = np.linalg.norm(elbows(solution.q) - linkage.fk(solution.q)[:, None, :2, 3], axis=-1)
print(f"  {len(points)} points: {np.mean(solution.success):.1%} solved")
print(f"  bars too long or too short by at most {np.abs(bars - FAR).max():.0e} m")

# Beyond its reach it comes as near as it can, at angles where the bars do meet.
far = linkage.ik(Goal.position([0.9, 0.6, 0.0]))
print(f"  (0.9, 0.6) m: {far.status} {far.position_error:.3f} m away")
print(f"  fk there is defined: {not np.isnan(linkage.fk(far.q)).any()}")
print(f"  fk at motors 180° and 0°, where the elbows are too far apart: {linkage.fk([np.pi, 0.0])[:2, 3]}")

figure, (left, right) = plots.plane(2, size=(8.4, 3.9))
grid = np.stack(
    np.meshgrid(*(np.linspace(a, b, 160) for a, b in zip(lower, upper, strict=True)), indexing="ij"), axis=-1
)
meets = ~np.isnan(linkage.fk(grid)[..., 0, 3])
left.contourf(
    *np.degrees(np.moveaxis(grid, -1, 0)), meets, levels=[-0.5, 0.5, 1.5], colors=["#bbbbbb", "#dcebf7"]
)
left.set(xlabel="left motor [°]", ylabel="right motor [°]", title="Grey: the bars do not meet")
for i, place in enumerate([(-0.25, 0.35), (0.0, 0.5), (0.3, 0.3), (0.02, 0.36)]):
    found = linkage.ik(Goal.position([*place, 0.0]))
    print(f"  {place}: motors {np.degrees(found.q).round(1)}°, {found.status}")
    a, b = elbows(found.q)
    bars_drawn = [(-GROUND / 2, 0), a, linkage.fk(found.q)[:2, 3], b, (GROUND / 2, 0)]
    plots.draw_line(right, bars_drawn, color=plots.COLOURS[i], marker="o", linewidth=2.5)
    left.plot(*np.degrees(found.q), "o", color=plots.COLOURS[i])
right.set(xlabel="x [m]", ylabel="y [m]", title="Five bars at four places")
plots.same_scale(right)
print("wrote", plots.save(figure, sys.argv[1] if len(sys.argv) > 1 else "08_five_bar.png"))
