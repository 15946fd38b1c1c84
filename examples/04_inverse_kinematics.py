"""Inverse kinematics: all the ways to reach a pose, and words when there is none."""

import rr1plan as rp

scene = rp.load_scene("rr1_table")
arm = next(iter(scene.arms))
kinematics = rp.Kinematics(scene)
checker = rp.CollisionChecker(scene)
q = scene.configuration()
T_world_tool = kinematics.pose(q, "tool")
print("tool at", T_world_tool[:3, 3].round(4), "| manipulability", round(kinematics.manipulability(q, "tool"), 5))

# RR1 has no spherical wrist, so there is no closed form: many starts find all distinct solutions.
goal = rp.PoseGoal("tool", T_world_tool)
found = rp.solve_ik(kinematics, goal, rng=0)
for solution in found.solutions:
    state = "free" if checker.is_free(solution) else "in collision"
    print("  ", solution.round(3), state)

# Only collision-free ones, for a position with any orientation.
anywhere = rp.PoseGoal("tool", [-0.30, 0.25, 0.20])
free = rp.solve_ik(kinematics, anywhere, accept=checker.is_free, rng=0)
print(f"{len(free.solutions)} free configurations reach [-0.30, 0.25, 0.20] m")

far = rp.solve_ik(kinematics, rp.PoseGoal("tool", [-2.0, 0.0, 0.3]), rng=0)
print("two metres away:", far.reason)
