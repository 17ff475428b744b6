"""Use a mimic joint: the second boom of a crane slides out as far as the first. Five axes, four joint values.

Run: python examples/06_mimic.py [PICTURE]
"""

import sys
import tempfile
from pathlib import Path

import numpy as np

import kinseek
from kinseek import Goal, plots

URDF = """
<robot name="crane">
  <link name="ground"/> <link name="post"/> <link name="boom"/> <link name="stage1"/> <link name="stage2"/>
  <link name="wrist"/> <link name="hook"/>
  <joint name="slew" type="revolute">
    <parent link="ground"/> <child link="post"/> <origin xyz="0 0 0.6"/> <axis xyz="0 0 1"/>
    <limit lower="-3" upper="3" effort="1" velocity="1"/>
  </joint>
  <joint name="lift" type="revolute">
    <parent link="post"/> <child link="boom"/> <origin xyz="0.1 0 0.2"/> <axis xyz="0 -1 0"/>
    <limit lower="-0.3" upper="1.3" effort="1" velocity="1"/>
  </joint>
  <joint name="extend" type="prismatic">
    <parent link="boom"/> <child link="stage1"/> <origin xyz="0.8 0 0"/> <axis xyz="1 0 0"/>
    <limit lower="0" upper="0.7" effort="1" velocity="1"/>
  </joint>
  <joint name="follow" type="prismatic">
    <parent link="stage1"/> <child link="stage2"/> <origin xyz="0.1 0 0"/> <axis xyz="1 0 0"/>
    <limit lower="0" upper="0.6" effort="1" velocity="1"/> <mimic joint="extend" multiplier="1.0" offset="0"/>
  </joint>
  <joint name="tilt" type="revolute">
    <parent link="stage2"/> <child link="wrist"/> <origin xyz="0.1 0 0"/> <axis xyz="0 -1 0"/>
    <limit lower="-2.2" upper="2.2" effort="1" velocity="1"/>
  </joint>
  <joint name="tool" type="fixed"> <parent link="wrist"/> <child link="hook"/> <origin xyz="0.3 0 0"/> </joint>
</robot>
"""

with tempfile.TemporaryDirectory() as folder:
    path = Path(folder) / "crane.urdf"
    path.write_text(URDF, encoding="utf-8")
    arm = kinseek.load(path)

print(arm)
print(f"  variables: {', '.join(arm.joint_names)}; joints that move: {len(arm.chain.leader)}")
print(f"  'extend' may go to {arm.upper[2]} m, not 0.7: its follower would hit its own limit")

# The hook over a truck, hanging straight down: its x axis is what points.
figure, axes = plots.space(elevation=14, azimuth=-62)
for i, (x, z) in enumerate([(1.1, 0.4), (1.6, 0.8), (2.1, 1.4), (1.8, 1.6)]):
    goal = Goal.pointing([x, -0.3 + 0.2 * i, z], direction=[0, 0, -1], tool_axis=(1, 0, 0))
    solution = arm.ik(goal)
    print(f"  at ({x}, {z}) m: both stages out by {solution.q[2]:.3f} m. {solution.status}")
    plots.draw_arm(axes, arm, solution.q, plots.COLOURS[i])

# Every pose the crane can take is found again, as for an arm without followers.
postures = np.random.default_rng(6).uniform(arm.lower, arm.upper, (1000, arm.dof))
print(f"  1,000 random poses: {np.mean(arm.ik(arm.fk(postures)).success):.1%} solved")
plots.same_scale(axes)
plots.trim(figure, axes, "A crane with a mimic joint")
print("wrote", plots.save(figure, sys.argv[1] if len(sys.argv) > 1 else "06_mimic.png"))
