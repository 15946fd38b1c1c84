"""Kinematics of a 2R arm: DH parameters, both elbows, the Jacobian and the manipulability of the tool."""

import numpy as np

import rr1plan as rp

robot = rp.planar_arm("RR", lengths=(1.0, 0.7))
scene = rp.Scene(name="my arm").with_arm("arm", robot, q=(0.5, 0.9))
kinematics, q = rp.Kinematics(scene), np.array([0.5, 0.9])

table = rp.dh_table(robot)
print(table)
for k, frame in enumerate(table.frames(q)):
    print(f"frame {k} at {np.round(frame[:2, 3], 3)}")
assert np.allclose(table.pose(q), kinematics.pose(q))

point = kinematics.pose(q)[:3, 3]
for solution in rp.solve_ik(kinematics, rp.PoseGoal("tool", point), rng=0).solutions:
    print(f"elbow {'left' if solution[1] < 0 else 'right'}: {np.degrees(solution).round(1)} degrees")

for bend in (0.0, 0.3, 0.9, np.pi / 2, 3.0):
    jacobian = kinematics.jacobian([0.5, bend])[:2]  # rows: velocity of the tool along x and y
    longest, shortest = np.linalg.svd(jacobian, compute_uv=False)
    print(f"bend {bend:.2f} rad: half axes {longest:.3f} and {shortest:.3f}, |det J| {longest * shortest:.3f}")

lesson = rp.lesson("kinematics", scene)
print(lesson.save_html("03_kinematics.html"))
print(lesson.save_svg("03_kinematics.svg"))
