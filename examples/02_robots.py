"""Robots: the shipped ones, limit presets, grippers, and any URDF of your own."""

from pathlib import Path

import numpy as np

import rr1plan as rp

print("shipped:", ", ".join(rp.robot_names()))

robot = rp.load_robot("rr1")
print(f"{robot.name}: joints {', '.join(robot.joint_names)}; tool {robot.tool}")
for preset in robot.presets:
    print(f"  {preset}: at most {robot.with_limits(preset).limits.velocity.round(3)} rad/s")

# The gripper is locked, not planned for: open it and the collision shapes follow.
print("fingers open at", dict(robot.with_locked_joints("open").locked_joints))

# A robot of your own: the reader is strict, and reports what is wrong and where.
Path("two_links.urdf").write_text("""
<robot name="two_links">
  <link name="base"/>
  <link name="upper">
    <inertial><origin xyz="0.2 0 0"/><mass value="0.8"/>
      <inertia ixx="3e-4" iyy="0.011" izz="0.011" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><origin xyz="0.2 0 0"/><geometry><box size="0.4 0.05 0.05"/></geometry></collision>
  </link>
  <link name="tip">
    <inertial><origin xyz="0.1 0 0"/><mass value="0.3"/>
      <inertia ixx="8e-5" iyy="0.001" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><origin xyz="0.1 0 0"/><geometry><box size="0.2 0.04 0.04"/></geometry></collision>
  </link>
  <link name="tool"/>
  <joint name="shoulder" type="revolute">
    <parent link="base"/><child link="upper"/><axis xyz="0 0 1"/>
    <limit lower="-2" upper="2" velocity="1" effort="10"/>
  </joint>
  <joint name="elbow" type="revolute">
    <parent link="upper"/><child link="tip"/><origin xyz="0.4 0 0"/><axis xyz="0 0 1"/>
    <limit lower="-2.5" upper="2.5" velocity="2" effort="5"/>
  </joint>
  <joint name="flange" type="fixed"><parent link="tip"/><child link="tool"/><origin xyz="0.2 0 0"/></joint>
</robot>
""")
own = rp.load_robot("two_links.urdf")
print(f"{own.name}: {own.nq} joints, {own.tool} at {own.link_poses(np.zeros(2))['tool'][:3, 3]} m when straight")

Path("broken.urdf").write_text(Path("two_links.urdf").read_text().replace("0.4 0.05 0.05", "0.4 nan 0.05"))
try:
    rp.load_robot("broken.urdf")
except rp.FormatError as error:
    print("refused:", error)
