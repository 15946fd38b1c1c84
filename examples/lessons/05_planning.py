"""Six planners on one query, step by step: examined and rejected edges, and path lengths."""

import numpy as np

import rr1plan as rp

problem = rp.load_problems("planar2r_path")["over_the_seam"]
checker = rp.CollisionChecker(problem.scene)
records = [
    rp.search_lattice(problem, weight=0.0),
    rp.search_lattice(problem),
    rp.grow_rrt(problem, rng=1),
    rp.grow_rrt_connect(problem, rng=1),
    rp.grow_rrt_star(problem, rng=1),
    rp.grow_prm(problem, rng=1),
]
for record in records:
    assert checker.path_is_free(record.path)
    print(
        f"{record.planner:12} {len(record.vertices):4} vertices, {record.edges_checked[-1]:4} edges checked, "
        f"{record.count('refused'):3} rejected, path {record.cost:.2f} rad"
    )

# The first steps of RRT, event by event.
for number, step in enumerate(records[2].steps[:4]):
    print(number, ", ".join(event.kind for event in step))

# One run proves nothing: the effect of the step, over ten seeds.
for step in (0.15, 0.3, 0.6, 1.2):
    runs = [rp.grow_rrt(problem, step=step, rng=seed) for seed in range(10)]
    edges, cost = np.median([[run.edges_checked[-1], run.cost] for run in runs], axis=0)
    print(f"step {step:4.2f} rad: {edges:5.0f} edges checked, path {cost:.2f} rad (medians)")

lesson = rp.lesson("planning")
print(lesson.save_html("05_planning.html"))
print(lesson.save_svg("05_planning.svg"))
