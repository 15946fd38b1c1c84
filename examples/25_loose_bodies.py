"""Loose bodies: an arm knocks a tower of blocks over, a ball is thrown in during the run, and a page plays it."""

import numpy as np

import rr1plan as rp

block = rp.Obstacle([rp.Geometry("block", rp.Box((0.07, 0.07, 0.05)), np.eye(4), (0.86, 0.55, 0.25, 1))], mass=0.1)
tower = rp.stack_bodies(block, 8, gap=0.0, pose=[-0.36, 0.0, 0.0], prefix="block")
scene = (
    rp.Scene(name="A tower falls")
    .with_arm("rr1", rp.load_robot("rr1"))
    .with_obstacle("table", rp.Box((1.6, 1.6, 0.04)), [0, 0, -0.02])
)
scene = scene.with_obstacle("floor", rp.HalfSpace(offset=-0.7)).with_obstacles(tower)
for name in tower:  # a planner would avoid the tower, but here the arm should hit it
    scene = scene.allow("rr1", name)

names, still = scene.joint_names(), np.zeros((2, 6))
ends = np.outer([-1.2, 1.2], np.eye(6)[0])
swing = rp.Trajectory.from_samples(names, [0.0, 1.5], ends, still, still)

sim = rp.Simulation(scene)
sim.place(names, ends[0])
arm = rp.JointTrajectoryController(names)
sim.activate(arm)
with rp.Recorder(sim) as recorder:
    sim.run(duration=0.5)
    height = sim.body_pose("block08")[2, 3]
    print(f"the tower stands, its top block at {height:.4f} m (drawn at {tower['block08'].pose[2, 3]:.4f} m)")
    execution = arm.send(swing)
    sim.run(duration=0.4)
    ball = rp.Obstacle([rp.Geometry("ball", rp.Sphere(0.05), np.eye(4), (0.2, 0.45, 0.8, 1))], mass=0.3, friction=0.5)
    sim.update_scene(sim.scene.with_obstacles({"ball": ball}))  # the initial scene does not change
    sim.place_body("ball", [-0.5, -0.6, 0.3], [0.0, 2.0, 1.5, 0.0, 0.0, 0.0])
    sim.run(duration=2.6)
print(f"{execution}, at most {execution.max_error.max():.1e} rad off while it pushed")
lying = sum(sim.body_pose(name)[2, 3] < 0.06 for name in tower)
print(
    f"{lying} of {len(tower)} blocks lie on the table or below; deepest penetration {1e3 * sim.max_penetration:.1f} mm"
)
print(f"forbidden contacts: {[contact.pair for contact in sim.contacts]}; {sim.real_time_factor:.0f} times real time")
rp.save_html("25_loose_bodies.html", sim.scene, replay=recorder.replay())

sim.reset()
print(
    f"again at {sim.time:g} s with {len(sim.body_names)} bodies, the top one at {sim.body_pose('block08')[2, 3]:.4f} m"
)
