"""Twelve RR1 on a grid and four in a ring: every second one of the grid moves, all are shown and replayed together."""

import numpy as np

import rr1plan as rp

TURN = np.array([0.5, 0.1, 0.3, 0.4, 0.2, 0.5])

robot = rp.load_robot("rr1")
ring = rp.place_ring(robot, 4, radius=0.6)
print("ring:", ", ".join(ring.arms))

scene = rp.load_scene("rr1_twelve")
moves = {}
for arm in list(scene.arms)[::2]:
    problem = rp.Problem(scene, "home", {arm: scene.arms[arm].q + TURN})
    motion = rp.plan_motion(problem, rng=0)
    moves[arm] = motion.trajectory
together = rp.Trajectory.merge(*moves.values())
print(f"{len(scene.arms)} arms; {len(moves)} move, {len(together.joint_names)} joints, {together.duration:.2f} s")

# Each was planned while the others rest; the referee decides whether they may move at once.
report = rp.validate(together, scene)
print(report)
print(rp.simulate(together, scene))
print(rp.save_html("11_many_arms.html", scene, trajectory=together, report=report))
print(rp.save_motion("11_many_arms.json", scene, trajectory=together, report=report))
