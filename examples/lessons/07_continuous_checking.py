"""Edges near a thin plate: what checks at fixed steps miss, and what distances prove."""

import numpy as np

import rr1plan as rp
from rr1plan.lessons.edge_intervals import advance_edge, halve_edge, is_proven_free, sample_edge

arm = rp.planar_arm("RR", lengths=(1.0, 0.7))
scene = rp.Scene(name="my plate").with_arm("arm", arm)
scene = scene.with_obstacle("plate", rp.Box((0.4, 0.004, 0.1)), (1.72, 0.1, 0.0))
checker = rp.CollisionChecker(scene)

edges = {"through": ([-0.9, 0.3], [0.7, 0.3]), "past": ([-0.9, 1.1], [0.9, 1.1]), "far": ([-2.2, -0.4], [-0.8, -1.6])}
for name, (begin, end) in edges.items():
    for step in (12.0, 3.0):
        samples = sample_edge(checker, begin, end, np.radians(step))
        print(f"{name}, step of {step:g}°: {len(samples.free)} samples, {'free' if samples.passes else 'in contact'}")
    halved, advanced = halve_edge(checker, begin, end), advance_edge(checker, begin, end)
    print(f"{name}, halving: {'free' if is_proven_free(halved) else 'in contact'}, distances: {len(halved)}")
    print(f"{name}, advancing: {'free' if is_proven_free(advanced) else 'in contact'}, distances: {len(advanced)}")
    assert checker.edge_is_free(begin, end) == is_proven_free(halved) == is_proven_free(advanced)

longest = max((i for i in halve_edge(checker, *edges["past"]) if i.verdict == "free"), key=lambda i: i.end - i.begin)
print(f"the longest interval proven: {longest.end - longest.begin:.3f} of the edge, by {longest.distance:.2f} m")

lesson = rp.lesson("continuous_checking", problem=rp.Problem(scene, [-0.9, 1.1], rp.JointGoal([0.9, 1.1])))
print(lesson.save_html("07_continuous_checking.html"))
print(lesson.save_svg("07_continuous_checking.svg"))
