"""The referee: an independent check of a timed motion, which names what is wrong and says what it did not check."""

import rr1plan as rp

scene = rp.load_scene("rr1_table")
problem = rp.Problem(scene, start="home", goal=rp.PoseGoal("tool", [-0.30, 0.25, 0.20]))
motion = rp.plan_motion(problem, rng=0)
print(rp.validate(motion.trajectory, scene, problem), "\n")

# Somebody plays it twice as fast ...
print(rp.validate(motion.trajectory.stretched(0.5), scene, problem), "\n")

# ... or puts a ball in the way after it was planned.
arm = next(iter(scene.arms))
halfway = motion.trajectory(0.5 * motion.trajectory.duration)
where = scene.with_configuration(arm, halfway).link_poses()[f"{arm}/tool"][:3, 3]
print(rp.validate(motion.trajectory, scene.with_obstacle("late_ball", rp.Sphere(0.03), where), problem))
