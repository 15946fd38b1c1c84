"""Eight RR1 in a ring swap places: one problem, a path for each arm, one clock, certified in continuous time."""

import rr1plan as rp

problem = rp.ring_swap(rp.load_robot("rr1"), 8, radius=0.6, rng=0)
motion = rp.plan_motion(problem, rng=0)  # "many_arms" is the default from three arms on
print(motion)

many = motion.many_arms
for group in many.groups:
    print(f"{len(group.arms)} arms that can meet, scheduled by {group.stage}")
print(f"all arrive after {many.makespan:.2f} s, the slowest arm alone after {many.quality.slowest_alone:.2f} s")
print(f"the arms wait {many.quality.waiting:.2f} s in all")

print(rp.simulate(motion.trajectory, problem.scene))
print(motion.save_html("17_swap_places.html"), motion.save("17_swap_places.json"))
