"""A hand-over through a window: two arms on both sides of a wall bring their tools together in it."""

import numpy as np

import rr1plan as rp

robot = rp.load_robot("rr1")
for width in (0.20, 0.15, 0.12, 0.10):
    problem = rp.handover_window(robot, width, rng=0)
    motion = rp.plan_motion(problem, planner="many_arms", rng=0)
    poses = problem.scene.link_poses(problem.scene.split(motion.trajectory(motion.trajectory.end_time), problem.arms))
    tools = [poses[f"{arm}/{problem.scene.arms[arm].robot.tool}"][:3, 3] for arm in problem.arms]
    distance = np.linalg.norm(tools[0] - tools[1])
    print(f"{100 * width:.0f} cm: {motion.report!r}, {motion.many_arms.ratio:.2f} times the slowest arm alone")
    print(f"  the tools meet {100 * distance:.1f} cm apart; clearance {motion.report.margins['clearance']}")

# Save the narrowest window as a scene file, for `rr1plan plan 20_hand_over.toml --planner many_arms`.
print(rp.save_scene("20_hand_over.toml", problem.scene, problems={"meet": problem}))
print(motion.save_html("20_hand_over.html"), motion.save("20_hand_over.json"))
