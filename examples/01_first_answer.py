"""Solve one pose: load an arm, give it a pose, and check the errors of the solution.

Run: python examples/01_first_answer.py
"""

import numpy as np

import kinseek

arm = kinseek.load("panda")
target = kinseek.pose([0.4, 0.1, 0.5], rpy=[np.pi, 0.0, 0.0])
solution = arm.ik(target)

print(arm)
for name, value, lower, upper in zip(arm.joint_names, solution.q, arm.lower, arm.upper, strict=True):
    print(f"  {name}  {value:8.4f} rad   in [{lower:.4f}, {upper:.4f}]")
print(solution.status)
print(f"  position error     {solution.position_error:.1e} m")
print(f"  orientation error  {solution.orientation_error:.1e} rad")

# The errors are those of plain forward kinematics; anyone can check them.
reached = arm.fk(solution.q)
print(f"  checked            {np.linalg.norm(reached[:3, 3] - target[:3, 3]):.1e} m")

# Out of reach: no exception, but the nearest pose that was found, and a status that says so.
far = arm.ik(kinseek.pose([3.0, 0.0, 0.5], rpy=[np.pi, 0.0, 0.0]))
print(far.status)
print(f"  position error     {far.position_error:.2f} m")
