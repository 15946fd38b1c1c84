"""Planners: one function for all of them; the cost of their paths, and improvement until the budget ends."""

import rr1plan as rp

# From below the rack of a crowded workbench to above it: the straight line is not free.
problem = rp.load_problems("rr1_cluttered")["low_to_high"]

for name in ("rrt_connect", "lbkpiece1", "prm", "bit_star", "anytime"):
    result = rp.plan(problem, planner=name, budget=rp.Budget(seconds=1.0), rng=1)
    length = "-" if result.path is None else f"{result.path.length:.2f} rad"
    print(f"{name:18s} {result.status:8s} {result.seconds:6.2f} s  length {length}")
    if len(result.cost_history) > 1:
        print("   improved:", ", ".join(f"{cost:.2f} at {t:.2f} s" for t, cost in result.cost_history[:6]))

# A seed and a budget of iterations give the same path, to the byte.
repeat = [rp.plan(problem, rng=7, budget=rp.Budget(float("inf"), iterations=5000)) for _ in range(2)]
print(
    "repeats to the byte:",
    repeat[0].path_or_raise().waypoints.tobytes() == repeat[1].path_or_raise().waypoints.tobytes(),
)

# "No answer" is a value with a reason in it.
blocked = rp.Problem(problem.scene, None, rp.PoseGoal("tool", [-3.0, 0.0, 0.2]))
result = rp.plan(blocked)
print(result.status, "-", result.reason)
