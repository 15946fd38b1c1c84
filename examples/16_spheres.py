"""Bounding spheres, the first test of a certified search: few and tight, and proven to contain each link."""

import numpy as np

import rr1plan as rp

scene = rp.load_scene("rr1_table")
problem = rp.Problem(scene, start="home", goal=rp.PoseGoal("tool", [-0.30, 0.25, 0.20]))
motion = rp.plan_motion(problem, rng=0)

covers = rp.cover_with_spheres(scene)
for name, cover in covers.items():
    around, bodies, parts = (len(cover.at(level)[1]) for level in range(3))
    if around:  # the tool is a frame without a body
        print(f"{name}: {around} around the link, {bodies} around its bodies, {parts} that fill them")

# Corners of a box of the forearm, in the link's coordinates: each lies in some sphere, at every level.
box = next(g for g in scene.arm("rr1").robot.link("forearm_link").collisions if isinstance(g.shape, rp.Box))
corners = np.array(np.meshgrid(*([-0.5, 0.5],) * 3)).reshape(3, -1).T * np.array(box.shape.size)
corners = corners @ box.pose[:3, :3].T + box.pose[:3, 3]
for level in range(3):
    centers, radii = covers["rr1/forearm_link"].at(level)
    inside = np.linalg.norm(corners[:, None] - centers, axis=2) <= radii
    print(f"level {level}: {inside.any(axis=1).sum()} of 8 corners are inside")

print("page:", motion.save_html("16_spheres.html", options=rp.ViewOptions(spheres=True, title="Spheres that contain")))
motion.save("16_spheres.json")
