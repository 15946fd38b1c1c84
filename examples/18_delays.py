"""Four RR1 that are late: who waits for whom, an execution with delays, and a new goal for an arm on its way."""

import numpy as np

import rr1plan as rp

problem = rp.ring_swap(rp.load_robot("rr1"), 4, radius=0.5, rng=1)
result = rp.plan_many_arms(problem, rng=0)
graph = rp.plan_graph(result)
print(graph)
for dependency in graph.dependencies[:3]:
    print(dependency)
print(rp.save_plan_graph("18_delays.json", graph, result.trajectory, problem.scene, problem))

# One starts late, one is 30 % slower, and a person stops one for a second: the others wait where necessary.
delays = {
    "arm01": rp.ArmDelay(start=0.3),
    "arm02": rp.ArmDelay(slowdown=0.3),
    "arm04": rp.ArmDelay(pauses=[(0.2, 1.0)]),
}
late = rp.execute_plan(graph, problem.scene, delays)
print(f"planned {result.makespan:.2f} s, with delays {late.makespan:.2f} s")
print("waiting for others:", ", ".join(f"{arm} {seconds:.2f} s" for arm, seconds in late.waiting.items()))
report = rp.validate(late.trajectory, problem.scene, problem)
replay = rp.simulate(late.trajectory, problem.scene)
print(report, replay, sep="\n")

# With 0.2 s between arms that share space, no arm has to wait at run time if no start is later than that.
tolerant = rp.execute_plan(graph, problem.scene, gap=0.2)
print(f"{tolerant.makespan:.2f} s with a skew tolerance of {tolerant.graph.skew_tolerance:.2f} s")

# At 0.4 s the fourth arm gets the goal "home"; nothing changes before 0.7 s.
added = rp.add_motion(result, "arm04", "home", at=0.4, freeze=0.3, budget=rp.Budget(seconds=5.0), rng=0)
print(added)
assert added, added.reason
speed = np.abs(added.plan.velocity("arm04", 0.7)).max()
print(f"at 0.7 s it has {speed:.2f} rad/s, it is there after {added.arrival:.2f} s:", added.report)
line = rp.timeline(late.trajectory, problem.scene, report=report, waits=late.waits)
rp.save_html(
    "18_delays.html",
    problem.scene,
    trajectory=late.trajectory,
    problem=problem,
    report=report,
    replay=replay,
    options=rp.ViewOptions(title="Four RR1 that are late", panels=[line.panel()]),
)
