"""Two 2R arms on given paths: their coordination diagram, schedules as curves in it, and planning both together."""

import rr1plan as rp
from rr1plan.lessons.path_schedules import can_get_out_of_the_way, fastest_curve, path_pair

scene = rp.load_scene("planar2r_pair")
paths = {
    "take turns": ([[1.2, -2.5], [0.0, -0.7], [-1.2, 2.5]], [[1.5, -2.2], [-0.3, -0.8], [-1.5, 2.2]]),
    "swap sides": ([[0.2, 0.0], [-0.2, 0.0]], [[0.2, 0.0], [-0.2, 0.0]]),
}
for name, (left, right) in paths.items():
    pair = path_pair(scene, ("left", left), ("right", right))
    print(f"{name}: {100 * pair.blocked_share:.0f} % of the diagram is blocked")
    for first in pair.arms:
        curve = fastest_curve(pair, first=first)
        print(f"  {first} first: {'no schedule' if curve is None else f'{curve.duration:.1f} s'}")

# Stretched arms swap sides: the arm that is planned first, alone, always blocks the other one.
pair = path_pair(scene, ("left", paths["swap sides"][0]), ("right", paths["swap sides"][1]))
for first in pair.arms:
    print(f"{first} first: the other one can avoid it: {can_get_out_of_the_way(scene, pair, first)}")
problem = rp.load_problems("planar2r_pair")["swap_sides"]
result = rp.RrtConnect().plan(problem, rng=0)
print(f"in all four joints: {result.status.value}, {len(result.path.waypoints)} waypoints")
motion = rp.plan_motion(problem, rng=0)
print(f"proven valid: {motion.report.valid}")

lesson = rp.lesson("two_arms")
print(lesson.save_html("08_two_arms.html"))
print(lesson.save_svg("08_two_arms.svg"))
