"""Scenes are values: adding an obstacle gives a new scene, and the old one is still there."""

import numpy as np

import rr1plan as rp

robot = rp.load_robot("rr1")
empty = rp.Scene(name="workbench").with_arm("arm", robot)

scene = (
    empty.with_obstacle("ground", rp.HalfSpace((0, 0, 1), 0.0), color=(0.85, 0.85, 0.83, 1))
    .with_obstacle("crate", rp.Box((0.16, 0.05, 0.32)), [-0.33, 0.15, 0.16], color=(0.29, 0.48, 0.65, 1))
    .with_obstacle("ball", rp.Sphere(0.05), [-0.30, -0.24, 0.05], color=(0.85, 0.70, 0.29, 1))
    .with_obstacle("post", rp.Capsule(0.03, 0.3), [-0.05, 0.45, 0.18])
)
# A scanned surface: each point is a small cube of an octree.
points = np.column_stack([np.full(200, -0.55), np.linspace(-0.3, 0.3, 200), np.linspace(0.1, 0.4, 200)])
scene = scene.with_obstacle("scan", rp.PointCloud(points, resolution=0.02))
print("obstacles:", ", ".join(scene.obstacles), "| before:", ", ".join(empty.obstacles) or "none")

checker = rp.CollisionChecker(scene)
print("home is free:", checker.is_free(robot.home))
nearest = checker.nearest(robot.home)
print(f"nearest: {' and '.join(nearest.pair)}, {1e3 * nearest.distance:.0f} mm apart")

# Keep 2 cm from everything, 5 cm from the ball.
careful = scene.with_padding(0.02).with_padding(0.05, "arm", "ball")
print(f"with padding, home is free: {rp.CollisionChecker(careful).is_free(robot.home)}")

# Pick the ball up: it becomes part of the arm, and may touch the fingers.
at_ball = scene.with_obstacle("ball", rp.Sphere(0.02), scene.link_poses()[f"arm/{robot.tool}"])
holding = at_ball.attach("ball", touch=[name for name in robot.link_names if "finger" in name or "hand" in name])
print("held:", ", ".join(holding.attachments), "| put down again:", "ball" in holding.detach("ball").obstacles)

print(rp.save_html("03_scenes.html", holding))
