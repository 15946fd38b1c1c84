"""Three blocks are sorted by color into a row, as one sequence of picks."""

import numpy as np

import rr1plan as rp

COLORS = {"red": (0.85, 0.2, 0.2, 1.0), "green": (0.2, 0.65, 0.35, 1.0), "blue": (0.15, 0.45, 0.85, 1.0)}
SIZE = 0.04

scene = rp.Scene(name="blocks").with_arm("rr1", rp.load_robot("rr1"))
scene = scene.with_obstacle("table", rp.Box((0.9, 0.9, 0.04)), [-0.2, 0, -0.02], color=(0.79, 0.73, 0.62, 1.0))
scene = scene.allow("rr1/base_link", "table")
rng = np.random.default_rng(4)
for name, y in zip(("blue", "red", "green"), (0.06, 0.13, 0.2), strict=True):
    pose = rp.transforms.pose([rng.uniform(-0.3, -0.27), y, SIZE / 2], rpy=[0, 0, rng.uniform(-1, 1)])
    scene = scene.with_obstacle(name, rp.Box((SIZE, SIZE, SIZE)), pose, color=COLORS[name], mass=0.06)

segments = []
for k, name in enumerate(COLORS):
    place = rp.transforms.pose([-0.28, -0.06 - 0.08 * k, SIZE / 2])
    turned = [place @ rp.transforms.pose(rpy=[0, 0, quarter * np.pi / 2]) for quarter in range(4)]
    segments += rp.pick_and_place(scene, name, [rp.PoseGoal(name, T) for T in turned])
plan = rp.plan_sequence(rp.Sequence(scene, [*segments, rp.FreeMotion("home")]), rng=0)
print(f"{len(plan.stages)} stages, {plan.trajectory.duration:.1f} s: {plan.report!r}")

replay = rp.simulate_sequence(plan)
print(replay)
last = plan.trajectory.end_time
for name in COLORS:
    x, y, _ = plan.object_poses(name, [last])[0, :3, 3]
    print(f"{name} at [{x:.2f}, {y:.2f}], {1e3 * replay.objects[name].final_offset:.1f} mm off in the simulation")
print(plan.save_html("27_blocks.html", options=rp.ViewOptions(title="Three blocks")), plan.save("27_blocks.json"))
