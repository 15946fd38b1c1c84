"""Start and goal are free, and it is proven that no path connects them; a planner can only give up."""

import rr1plan as rp

arm = rp.planar_arm("RR", lengths=(1.0, 0.7))
scene = rp.Scene(name="two discs").with_arm("arm", arm)
for name, y in (("above", 0.6), ("below", -0.6)):
    scene = scene.with_obstacle(name, rp.Cylinder(0.15, 0.2), (0.0, y, 0.0))
problem = rp.Problem(scene, start=[0.0, 0.3], goal=rp.JointGoal([3.0, 0.3]))

checker = rp.CollisionChecker(scene)
print(f"start free: {checker.is_free([0.0, 0.3])}, goal free: {checker.is_free([3.0, 0.3])}")
picture = rp.cspace(scene, problem)
print(picture.verdict)
result = rp.RrtConnect(tree=True).plan(problem, budget=rp.Budget(iterations=2000), rng=0)
print(f"RRT-Connect: {result.status.value}, {len(result.tree.edges)} edges")

for name in scene.obstacles:
    rest = rp.Problem(scene.without_obstacle(name), problem.start, rp.JointGoal([3.0, 0.3]))
    print(f"without {name}: {rp.plan(rest, rng=0).status.value}")

lesson = rp.lesson("no_path", problem=problem)
print(lesson.save_html("04_no_path.html"))
print(lesson.save_svg("04_no_path.svg"))
