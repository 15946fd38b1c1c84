"""A straight line of the tool: inverse kinematics along it, no jumps, every edge certified."""

import numpy as np

import rr1plan as rp

scene = rp.load_scene("rr1_table")
kinematics = rp.Kinematics(scene)
start = scene.configuration()
T = kinematics.pose(start, "tool")
end = T[:3, 3] + [0.0, -0.10, 0.04]

problem = rp.Problem(scene, None, rp.PoseGoal("tool", end))
motion = rp.plan_motion(problem, planner="cartesian", rng=0)
print(motion)

line = end - T[:3, 3]
times = np.linspace(0.0, motion.trajectory.duration, 200)
tool = np.array([kinematics.pose(q, "tool")[:3, 3] for q in motion.trajectory(times)])
along = np.clip((tool - T[:3, 3]) @ line / (line @ line), 0.0, 1.0)
off = np.linalg.norm(tool - T[:3, 3] - along[:, None] * line, axis=1)
print(f"the timed motion leaves the line by {1e3 * off.max():.2f} mm at most")

too_far = rp.Problem(scene, None, rp.PoseGoal("tool", T[:3, 3] + [-1.0, 0.0, 0.0]))
result = rp.plan(too_far, planner="cartesian")
print(result.status, "-", result.reason)
