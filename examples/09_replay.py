"""Replay in MuJoCo: how well do servos follow, which elements touch, how large are the motor torques?"""

import rr1plan as rp

for preset in ("sim", "hardware"):
    scene = rp.load_scene("rr1_table")
    arm = next(iter(scene.arms))
    scene = scene.with_robot(arm, scene.arms[arm].robot.with_limits(preset))
    problem = rp.Problem(scene, start="home", goal=rp.PoseGoal("tool", [-0.30, 0.25, 0.20]))
    motion = rp.plan_motion(problem, rng=0)
    replay = rp.simulate(motion.trajectory, scene, hold=0.2)
    print(f"{preset} limits, {motion.trajectory.duration:.1f} s")
    print(replay)

kinematic = rp.simulate(motion.trajectory, scene, mode="kinematic")
print(kinematic)
