"""Two arms swap places: each on its own path, timed past each other in their coordination diagram."""

import rr1plan as rp

problem = rp.load_problems("rr1_pair")["change_places"]
motion = rp.plan_motion(problem, planner="many_arms", rng=0)
print(motion)

many = motion.many_arms
print(f"{many.makespan:.2f} s, {many.ratio:.2f} times the slowest arm alone")
if len(many.schedules) == 2:
    diagram = motion.coordination_diagram("left", "right")
    print(f"{100 * diagram.blocked_share:.0f} % of the diagram is blocked; the plan leads past it")
    print(diagram.save("19_diagram.png"), diagram.save("19_diagram.svg", axes="length"))
else:
    print("the arms move as one, in the joint space of both")

print(motion.timeline())
print(motion.save_html("19_two_arms_swap.html"), motion.save("19_two_arms_swap.json"))
