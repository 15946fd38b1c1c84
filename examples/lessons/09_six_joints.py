"""Six joints: slices that change, the solutions of one pose, self-motion, and the free share of the space."""

import numpy as np

import rr1plan as rp
from rr1plan.lessons.free_share import free_share
from rr1plan.lessons.inverse_solutions import inverse_solutions, self_motion

scene = rp.load_scene("rr1_table")
joints = ("shoulder_joint", "elbow_joint")
for wrist in (0.6, 1.6, 2.5):
    placed = scene.with_configuration("rr1", [0.2, 0.1, -0.4, -1.4, wrist, 0.0])
    grid = rp.cspace(placed, joints=joints, resolution=90).grid
    print(
        f"slice with the wrist at {np.degrees(wrist):.0f}°: {100 * grid.free.mean():.0f} % free, "
        f"{grid.components} components"
    )

solutions = inverse_solutions(scene, "rr1", [0.21, 0.12, -0.43, -1.45, 2.19, -2.34])
inside = [s for s in solutions if s.within_limits]
print(f"{len(solutions)} solutions, {len(inside)} within the limits, {sum(s.is_valid for s in inside)} free")
tools = [rp.Kinematics(scene).pose(s.q) for s in solutions]
print(f"the tool moves by {max(np.abs(T - tools[0]).max() for T in tools):.0e} between them")

checker = rp.CollisionChecker(scene)
for axis in "zyx":
    curve = self_motion(scene, "rr1", [-0.719, -0.057, -0.386, -0.358, 0.639, -0.315], axis=axis)
    moved = int((np.ptp(curve, axis=0) > 1e-6).sum())
    free = np.mean([checker.is_free(q) for q in curve])
    print(f"around {axis}: {len(curve)} configurations, {moved} joints move, {100 * free:.0f} % free")

for samples in (100, 1_000, 10_000):
    print(free_share(checker, samples, rng=0))

lesson = rp.lesson("six_joints")
print(lesson.save_html("09_six_joints.html"))
print(lesson.save_svg("09_six_joints.svg"))
