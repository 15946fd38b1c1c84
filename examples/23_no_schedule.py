"""No schedule: if many arms have no plan, the result names the arms responsible, and the reason."""

import numpy as np

import rr1plan as rp

scene = rp.place_grid(rp.load_robot("rr1"), 1, 3, spacing=0.8)
between = rp.PoseGoal("tool", [0.0, 0.4, 0.3])
left, right = (np.array([turn, 0.0, 0.3, 0.0, 0.5, 0.0]) for turn in (-1.2, 1.9))

# Two tools are sent to the same place: the contact is reported before planning.
same = rp.Problem(scene, None, {"arm01": right, "arm02": between, "arm03": between})
print(rp.plan_motion(same, rng=0))

# One arm starts in a box.
where = scene.link_poses()["arm03/tool"][:3, 3]
boxed = scene.with_obstacle("box", rp.Box((0.1, 0.1, 0.1)), where)
print(rp.plan_motion(rp.Problem(boxed, None, {"arm01": right, "arm02": left, "arm03": left}), rng=0))

# A wall that one arm cannot get around: a joint value that it cannot pass proves that there is no path.
wall = scene.arms["arm02"].base @ rp.transforms.pose((-0.4, 0.0, 1.15))
walled = scene.with_obstacle("wall", rp.Box((0.6, 0.02, 1.8)), wall)
around = rp.Problem(walled, {"arm02": left}, {"arm01": right, "arm02": right, "arm03": left})
print(rp.plan_motion(around, rng=0, budget=rp.Budget(seconds=10)))

# Without that arm there is a plan.
others = rp.Problem(walled, {"arm02": left}, {"arm01": right, "arm02": left, "arm03": left})
print(repr(rp.plan_motion(others, rng=0).many_arms))
