"""The workspace of a 2R arm, and the number of solutions in it: a lesson about your own arm, and its numbers."""

import numpy as np

import rr1plan as rp

arm = rp.planar_arm("RR", lengths=(1.0, 0.8), limits=[(-2.5, 2.5), (-2.3, 2.3)])
scene = rp.Scene(name="my arm").with_arm("arm", arm)
scene = scene.with_obstacle("disc", rp.Cylinder(0.15, 0.2), (1.0, -0.7, 0.0))
scene = scene.with_obstacle("corner", rp.polygon_prism([(-0.6, 0.9), (-0.2, 0.9), (-0.2, 1.0), (-0.6, 1.3)]))

kinematics, checker = rp.Kinematics(scene), rp.CollisionChecker(scene)
far, near = (np.linalg.norm(kinematics.pose([0.0, bend], "tool")[:2, 3]) for bend in (0.0, 2.3))
print(f"the tool is {near:.2f} to {far:.2f} m from the base")

for x, y in ((1.3, 0.6), (1.2, -0.9), (-0.9, -0.9), (0.4, 0.3)):
    solutions = rp.solve_ik(kinematics, rp.PoseGoal("tool", [x, y, 0.0]), rng=0).solutions
    free = [q for q in solutions if checker.is_free(q)]
    print(f"({x:+.1f}, {y:+.1f}): {len(solutions)} within the limits, {len(free)} free")

lesson = rp.lesson("workspace", scene)
print(lesson.save_html("01_workspace.html"))
print(lesson.save_svg("01_workspace.svg"))
