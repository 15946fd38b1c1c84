"""Ten arms in a ring: who moves when, who waits for whom, and what goes wrong if nobody waits."""

import rr1plan as rp

problem = rp.load_problems("rr1_ring")["swap"]
motion = rp.plan_motion(problem, planner="many_arms", rng=0, budget=rp.Budget(seconds=30))
print(motion)
print(motion.timeline())
print(motion.save_html("21_ten_in_a_ring.html"), motion.save("21_ten_in_a_ring.json"))

# In the plan the arms slow down for each other. Here they keep the same order, but go as fast as they can and wait.
executed = rp.execute_plan(rp.plan_graph(motion.many_arms), problem.scene)
print(f"planned {motion.many_arms.makespan:.2f} s, in this order {executed.makespan:.2f} s")
line = rp.timeline(executed.trajectory, problem.scene, waits=executed.waits)
print(line)
print(line.save("21_time_line.png"), line.save("21_time_line.svg", dark=True))
waits = [wait for wait in executed.waits if wait.others]
if waits:
    longest = max(waits, key=lambda wait: wait.end - wait.begin)
    print(motion.coordination_diagram(longest.arm, longest.others[0]).save("21_diagram.png"))

# All at once: each arm on its path, but planned as if it were alone. The referee finds every contact.
parts = []
for arm, goal in problem.goal.items():
    start = problem.scene.split(problem.start, problem.arms)[arm]
    others = problem.scene
    for name in problem.arms:
        others = others if name == arm else others.without_arm(name)
    parts.append(rp.plan_motion(rp.Problem(others, {arm: start}, {arm: goal}), rng=0).trajectory)
careless = rp.Trajectory.merge(*parts)
report = rp.validate(careless, problem.scene, problem)
print("nobody waits:", f"{careless.duration:.2f} s,", repr(report))
bad = rp.timeline(careless, problem.scene, report=report)
print(bad.save("21_nobody_waits.png"))
page = rp.ViewOptions(title="Nobody waits", panels=[bad.panel()])
print(rp.save_html("21_nobody_waits.html", problem.scene, trajectory=careless, report=report, options=page))
