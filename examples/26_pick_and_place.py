"""A block is picked up and put down: one sequence, one trajectory, one proof, one replay with grasps by friction."""

import rr1plan as rp

scene = (
    rp.Scene(name="pick and place")
    .with_arm("rr1", rp.load_robot("rr1"))
    .with_obstacle("table", rp.Box((0.9, 0.9, 0.04)), [-0.2, 0, -0.02], color=(0.79, 0.73, 0.62, 1.0))
    .with_obstacle("wall", rp.Box((0.16, 0.02, 0.22)), [-0.32, 0.02, 0.11], color=(0.58, 0.65, 0.74, 1.0))
    .with_obstacle("block", rp.Box((0.04, 0.04, 0.06)), [-0.28, 0.15, 0.03], color=(0.15, 0.45, 0.85, 1.0), mass=0.15)
    .allow("rr1/base_link", "table")
)

# Several grasps from above, and any angle at the new place: the planner takes a pair for which all segments succeed.
print(f"{len(rp.top_grasps(scene, 'block'))} grasps from above")
segments = [*rp.pick_and_place(scene, "block", [-0.28, -0.15, 0.03]), rp.Pause(0.2), rp.FreeMotion("home")]
plan = rp.plan_sequence(rp.Sequence(scene, segments), rng=0)
print(plan)
for event in plan.events:
    print(f"at {event.begin:.2f} s: {event.label}")

# In MuJoCo the block is a loose body, held by contact and friction alone.
replay = rp.simulate_sequence(plan)
print(replay)

# The same file, in the same cell and in one with an obstacle in the way of the block.
plan.save("26_pick_and_place.json")
print("read again:", repr(rp.load_sequence("26_pick_and_place.json")))
carried = plan.object_poses("block", [plan.stages[6].end])[0]
later = scene.with_obstacle("late_ball", rp.Sphere(0.01), carried[:3, 3] - [0, 0, 0.035])
changed = rp.load_sequence("26_pick_and_place.json", later)
print("with a ball:", changed.report.violations[0].message)

# If a segment is infeasible, the plan names it and the reason.
hopeless = rp.plan_sequence(rp.Sequence(scene, rp.pick_and_place(scene, "block", [-0.9, 0, 0.03])), rng=0)
print("too far:", hopeless)
print(plan.save_html("26_pick_and_place.html"))
