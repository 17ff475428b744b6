"""Servoing at 500 Hz: a pose comes every 2 ms, and joint values go out that are never too fast.

Run: python examples/13_servoing.py [PICTURE]
"""

import sys
import time

import numpy as np
from matplotlib import pyplot

import kinseek
from kinseek import plots

arm = kinseek.load("ur5e")
speed = np.full(arm.dof, 1.5)
period = 0.002

# A circle of 10 cm in 2 s; after 1 s the target jumps 10 cm ahead, as a camera that lost its mark does.
s = np.arange(0, 2.5, period)
angle = np.pi * s
x, y, z = 0.45, 0.1, 0.35
targets = [
    kinseek.pose([x + 0.1 * (t > 1.0), y + 0.1 * np.cos(a), z + 0.1 * np.sin(a)], rpy=[np.pi, 0, 0])
    for t, a in zip(s, angle, strict=True)
]
tracker = arm.track(arm.ik(targets[0]).q, period=period, velocity=speed)
tracker.step(targets[0])
rows, errors, took, statuses = [], [], [], []
for T in targets:
    began = time.perf_counter()
    answer = tracker.step(T)
    took.append(time.perf_counter() - began)
    rows.append(answer.q)
    errors.append(answer.position_error)
    statuses.append(answer.status)
q = np.array(rows)
fastest = np.abs(np.diff(q, axis=0)).max() / period
print(
    f"{len(q)} steps, median {np.median(took) * 1e6:.1f} µs, 99 % within {np.percentile(took, 99) * 1e6:.1f} µs"
)
print(f"fastest joint {fastest:.6f} rad/s, allowed 1.5")
for status in kinseek.TrackStatus:
    print(f"{statuses.count(status):5} steps: {status}")
print("ahead:", tracker.foresee(0.5))

# To another branch of the arm and on: only when asked for.
way = tracker.switch()
print(f"the nearest other branch is {len(way) * period:.2f} s away")
for _ in way:
    answer = tracker.step(targets[-1])
print(answer.status, tracker.step(targets[-1]).status)

figure, both = pyplot.subplots(2, 1, figsize=(6.4, 4.6), sharex=True, layout="constrained")
for j, joint in enumerate(arm.joint_names):
    both[0].plot(s[1:], np.diff(q[:, j]) / period, color=plots.COLOURS[j], label=joint.removesuffix("_joint"))
both[0].axhline(1.5, color="k", lw=0.8)
both[0].axhline(-1.5, color="k", lw=0.8)
both[0].set(ylabel="speeds [rad/s]", title="Servoing at 500 Hz; the target jumps after 1 s")
both[0].legend(ncols=3, fontsize=7)
both[1].plot(s, 1e3 * np.array(errors))
both[1].set(xlabel="time [s]", ylabel="position error [mm]")
print("wrote", plots.save(figure, sys.argv[1] if len(sys.argv) > 1 else "13_servoing.png"))
