"""Two arms at once, with the same types and functions: one path with more columns, one clock."""

import rr1plan as rp

problem = next(iter(rp.load_problems("rr1_pair").values()))
scene = problem.scene
print(f"{', '.join(problem.arms)} move: {problem.nq} joints")

motion = rp.plan_motion(problem, rng=0)
print(motion)

# Split the trajectory by arm, on the common clock, and merge it again.
parts = [motion.trajectory.select(arm) for arm in problem.arms]
assert rp.Trajectory.merge(*parts).allclose(motion.trajectory)
for arm, part in zip(problem.arms, parts, strict=True):
    print(f"  {arm}: {part.duration:.2f} s, {len(part.joint_names)} joints")

print(rp.simulate(motion.trajectory, scene))
print(motion.save_html("10_two_arms.html"), motion.save("10_two_arms.json"))
