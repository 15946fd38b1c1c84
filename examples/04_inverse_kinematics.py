"""Inverse kinematics: all configurations that reach a pose, which of them are free, and a reason when there is none."""

import rr1plan as rp

scene = rp.load_scene("rr1_table")
kinematics = rp.Kinematics(scene)
checker = rp.CollisionChecker(scene)
q = scene.configuration()
tool = kinematics.pose(q, "tool")[:3, 3]
print(f"at home the tool is at {tool.round(3)} m, manipulability {kinematics.manipulability(q, 'tool'):.4f}")

# RR1 has no spherical wrist, so there is no closed form: many random starts find the distinct solutions. These
# two poses are given by one configuration each, and can be reached with the elbow or the wrist turned over as well.
for name, known in (("overhead", [-0.4, 0.1, 0.9, 0.3, 0.5, 1.6]), ("low", [-0.8, 0.1, -0.8, 0.3, 2.4, -1.0])):
    goal = rp.PoseGoal("tool", kinematics.pose(known, "tool"))
    found = rp.solve_ik(kinematics, goal, rng=0)
    print(f"{name}: {len(found.solutions)} solutions")
    for solution in found.solutions:
        contacts = checker.contacts(solution)
        print("  ", solution.round(2), f"{contacts[0].a} touches {contacts[0].b}" if contacts else "free")
    free = rp.solve_ik(kinematics, goal, accept=checker.is_free, rng=0)
    print(f"  free of collision: {len(free.solutions)}, rejected: {free.rejected}")

# A position alone leaves three degrees of freedom: the solutions are samples of a continuum.
anywhere = rp.PoseGoal("tool", [-0.30, 0.25, 0.20])
free = rp.solve_ik(kinematics, anywhere, accept=checker.is_free, rng=0)
print(f"{len(free.solutions)} free configurations reach [-0.30, 0.25, 0.20] m")

far = rp.solve_ik(kinematics, rp.PoseGoal("tool", [-2.0, 0.0, 0.3]), rng=0)
print("two meters away:", far.reason)
