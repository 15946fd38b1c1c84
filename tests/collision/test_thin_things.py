"""Plates, needles and specks of a millimeter in the path of fast arms: no edge passes through them."""

from __future__ import annotations

import numpy as np
import pytest

from rr1plan.collision import CollisionChecker
from rr1plan.scene import Scene
from rr1plan.scene.model_library import load_robot
from rr1plan.shapes import Box, Capsule, Cylinder, Mesh, Sphere
from rr1plan.transforms import pose

THIN = {
    "plate": Box((0.001, 0.15, 0.15)),
    "needle": Cylinder(0.0005, 0.2),
    "wire": Capsule(0.0005, 0.2),
    "speck": Sphere(0.0005),
}


def points_inside(scene, q, rng):
    """A point well inside each body of the arm, in the world, by numpy."""
    poses, out = scene.link_poses({"arm": q}), []
    for link in scene.arms["arm"].robot.links[1:]:
        for part in link.collisions:
            inside = part.shape.vertices.mean(axis=0) if isinstance(part.shape, Mesh) else np.zeros(3)
            out.append((poses[f"arm/{link.name}"] @ part.pose @ [*inside, 1.0])[:3])
    return out[int(rng.integers(len(out)))]


@pytest.mark.parametrize("thin", THIN)
@pytest.mark.parametrize("name", ["six", "odd", "rr1"])
def test_no_edge_passes_through_something_thin(name, thin, request):
    """It is in the path of one of the arm's bodies for an instant; both ends of the edge are free of it."""
    robot = load_robot("rr1") if name == "rr1" else request.getfixturevalue(name)
    rng = np.random.default_rng(sorted(THIN).index(thin))
    bare = Scene().with_arm("arm", robot)
    alone = CollisionChecker(bare)
    low, high = np.maximum(alone.limits.lower, -2.5), np.minimum(alone.limits.upper, 2.5)
    crossed = 0
    for _ in range(150):
        q0, q1 = rng.uniform(low, high, (2, alone.nq))
        if not alone.edge_is_free(q0, q1):
            continue
        q = q0 + rng.uniform(0.2, 0.8) * (q1 - q0)
        place = pose(points_inside(bare, q, rng), quaternion=rng.normal(size=4))
        there = CollisionChecker(bare.with_obstacle("thin", THIN[thin], place))
        if there.static_is_free and there.is_free(q0) and there.is_free(q1):
            crossed += 1
            assert not there.edge_is_free(q0, q1)
            assert not there.edge_is_free_slowly(q0, q1)
    assert crossed > 5
