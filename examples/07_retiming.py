"""Retiming: the same path under velocity and acceleration limits, with stops, and jerk-limited."""

import numpy as np

import rr1plan as rp

scene = rp.load_scene("rr1_table")
problem = rp.Problem(scene, start="home", goal=rp.PoseGoal("tool", [-0.30, 0.25, 0.20]))
motion = rp.plan_motion(problem, rng=0)
limits = scene.limits()

for method in ("blend", "stop", "ruckig"):
    trajectory = rp.retime(motion.path, scene, method=method, checker=rp.CollisionChecker(scene))
    times = np.linspace(trajectory.start_time, trajectory.end_time, 2000)
    velocity = (np.abs(trajectory(times, 1)) / limits.velocity).max()
    acceleration = (np.abs(trajectory(times, 2)) / limits.acceleration).max()
    report = rp.validate(trajectory, scene, problem, jerk_limits=method == "ruckig")
    print(
        f"{method:7s} {trajectory.duration:5.2f} s, uses {100 * velocity:3.0f} % of the velocity limit, "
        f"{100 * acceleration:3.0f} % of the acceleration limit, valid: {report.valid}"
    )

# The real arm is far slower than the simulated one: the preset has its limits.
arm = next(iter(scene.arms))
slow = scene.with_robot(arm, scene.arms[arm].robot.with_limits("hardware"))
print(f"on the real arm: {rp.retime(motion.path, slow, checker=rp.CollisionChecker(slow)).duration:.1f} s")
