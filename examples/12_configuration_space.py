"""The configuration space of the 2R arm: the picture with which every course on planning begins."""

import rr1plan as rp

for name in ("planar2r_path", "planar2r_no_path"):
    problem = next(iter(rp.load_problems(name).values()))
    # Short edges show how the tree grew; by default edges are longer and fewer.
    planner = rp.RrtConnect(range=0.15, tree=True)
    result = planner.plan(problem, budget=rp.Budget(iterations=1500), rng=14)
    picture = rp.cspace(problem.scene, problem, result=result)
    print(f"{name}: the planner says {result.status}")
    print(picture)
    print(picture.save_png(f"12_{name}.png"))
    print(picture.save_svg(f"12_{name}.svg"))
    print(picture.save_html(f"12_{name}.html"))
