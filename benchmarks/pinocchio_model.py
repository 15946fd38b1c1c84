"""A robot and obstacles for the workers that check collisions with Pinocchio and Coal."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio as pin

SHAPES = {"box": coal.Box, "cylinder": coal.Cylinder, "sphere": coal.Sphere}


def load_model(robot: dict[str, Any]) -> tuple[Any, Any]:
    """Pinocchio's model and its collision geometry: convex hulls, and the pairs that the SRDF enables."""
    urdf = Path(robot["urdf"])
    model = pin.buildModelFromUrdf(str(urdf))
    bodies = pin.buildGeomFromUrdf(model, str(urdf), pin.GeometryType.COLLISION, package_dirs=[str(urdf.parent)])
    if list(model.names)[1:] != robot["joints"]:
        raise ValueError(f"joints are {list(model.names)[1:]}, expected {robot['joints']}")
    for body in bodies.geometryObjects:
        if isinstance(body.geometry, coal.BVHModelBase):
            body.geometry.buildConvexHull(True, "Qt")
            body.geometry = body.geometry.convex
    bodies.addAllCollisionPairs()
    pin.removeCollisionPairs(model, bodies, robot["srdf"])
    return model, bodies


def with_obstacles(model: Any, bodies: Any, problem: dict[str, Any]) -> Any:
    """The geometry with a problem's obstacles, each checked against the links that it must not touch."""
    whole = bodies.copy()
    free = set(map(tuple, problem["may_touch"]))
    links = [model.frames[body.parentFrame].name for body in bodies.geometryObjects]
    for obstacle in problem["obstacles"]:
        T = np.array(obstacle["pose"])
        shape = SHAPES[obstacle["kind"]](*obstacle["size"])
        index = whole.addGeometryObject(pin.GeometryObject(obstacle["name"], 0, pin.SE3(T[:3, :3], T[:3, 3]), shape))
        for i, link in enumerate(links):
            if (link, obstacle["name"]) not in free:
                whole.addCollisionPair(pin.CollisionPair(i, index))
    return whole
