"""A hundred arms on a grid, all between random configurations at once: planned in seconds, proven in 0.1 s."""

import rr1plan as rp

problem = rp.random_grid(rp.load_robot("rr1"), 100, spacing=0.8, rng=0)
print(f"{len(problem.arms)} arms, {problem.nq} joints")

motion = rp.plan_motion(problem, rng=0, budget=rp.Budget(seconds=60))
print(motion.report)
many = motion.many_arms
print(f"planned in {motion.seconds['plan']:.2f} s, proven in {motion.seconds['validate']:.2f} s")
quality = many.quality
print(f"makespan {quality.makespan:.2f} s, {quality.ratio:.2f} times the slowest arm alone")
print(f"{quality.waiting:.2f} s of waiting")
for stage in dict.fromkeys(group.stage for group in many.groups):
    sizes = [len(group.arms) for group in many.groups if group.stage == stage]
    print(f"  {stage}: {len(sizes)} groups with {sum(sizes)} arms, the largest of {max(sizes)}")

print(motion.timeline().save("22_time_line.png"))
print(motion.save_html("22_hundred_on_a_grid.html", options=rp.ViewOptions(title="A hundred RR1 at once")))
motion.save("22_hundred_on_a_grid.json")
