"""Servo at 500 Hz: a target pose comes every 2 ms, and the joint values keep the speed limits.

Then the hand moves on until its branch ends. The tracker reports the end in advance, with the reason, and it also reports
a branch that continues.

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

# The hand stays where it is and turns, until a joint has no turn left. Every 20 ms it is asked what comes within a second.
T, told = targets[-1], None
turn = kinseek.pose([0, 0, 0], rpy=[0, 0, 1.2 * period])
for k in range(6000):
    T = T @ turn
    answer = tracker.step(T)
    if k and k % 10 == 0 and tracker.foresee(1.0).status is not kinseek.TrackStatus.TRACKING:
        told = tracker.foresee(1.0)
        break
if told is not None:
    print(
        f"after {k * period:.2f} s: in {told.seconds:.2f} s {told.joint or 'the hand'} stops. {told.status}"
    )

# To the branch from which the hand goes on, and on: only when asked for.
branch = tracker.continuing(1.5)
if branch is not None:
    way = tracker.switch(branch)
    print(f"a branch that goes on is {len(way) * period:.2f} s away")
    for _ in way:
        answer = tracker.step(T)
    print(answer.status, tracker.step(T).status)

figure, both = pyplot.subplots(2, 1, figsize=(6.4, 4.6), sharex=True, layout="constrained")
for j, joint in enumerate(arm.joint_names):
    both[0].plot(s[1:], np.diff(q[:, j]) / period, color=plots.COLOURS[j], label=joint.removesuffix("_joint"))
both[0].axhline(1.5, color="k", lw=0.8)
both[0].axhline(-1.5, color="k", lw=0.8)
both[0].set(ylabel="speeds [rad/s]", title="Servoing at 500 Hz; the target jumps after 1 s")
figure.legend(loc="outside lower center", ncols=6, fontsize=7)
both[1].plot(s, 1e3 * np.array(errors))
both[1].set(xlabel="time [s]", ylabel="position error [mm]")
print("wrote", plots.save(figure, sys.argv[1] if len(sys.argv) > 1 else "13_servoing.png"))
