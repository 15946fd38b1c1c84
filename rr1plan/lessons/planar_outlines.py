"""Flat scenes as data for a page: convex outlines with a radius, and pairs of elements."""

from __future__ import annotations

from typing import Any

import numpy as np

from rr1plan.checks import Array
from rr1plan.collision import CollisionChecker
from rr1plan.errors import InputError
from rr1plan.model.flat_arm import flat_arm
from rr1plan.playback.cspace.reach_outline import reach_of
from rr1plan.playback.outlines import silhouette
from rr1plan.scene import Scene
from rr1plan.shapes import Box, Capsule, Cylinder, Mesh, Shape, Sphere
from rr1plan.shapes.convex_hulls import is_own_hull

_UPRIGHT = 1e-6


def planar_data(checker: CollisionChecker) -> dict[str, Any]:
    """Outlines of all elements in the pairs of a checker, in the frames of links, and the pairs with their levers.

    Args:
        checker: Checker of a flat scene.

    Returns:
        "outlines": element -> list of {"points": [[x, y], ...], "radius"}, those of links in the frame of the link;
        "pairs": list of {"a", "b", "levers", "padding"}: levers [m/rad, or m/m] of each column of q.

    Raises:
        InputError: a shape without such an outline.
    """
    scene = checker.scene
    levers = checker.tables.pair_levers(checker.limits.travel)
    rows: dict[tuple[str, str], dict[str, Any]] = {}
    for owner, lever in zip(checker.solid_owner.tolist(), levers, strict=True):
        a, b = checker.pairs[owner]
        padding = float(checker.padding[owner])
        known = rows.setdefault((a, b), {"a": a, "b": b, "levers": lever.tolist(), "padding": padding})
        known["levers"] = np.maximum(known["levers"], lever).tolist()
    outlines: dict[str, list[dict[str, Any]]] = {}
    for name in dict.fromkeys(element for pair in rows for element in pair):
        if name in scene.obstacles:
            obstacle = scene.obstacles[name]
            parts = [(g.shape, obstacle.pose @ g.pose) for g in obstacle.geometries]
        else:
            arm, link = name.split("/", 1)
            parts = [(g.shape, g.pose) for g in scene.arms[arm].robot.link(link).collisions]
        outlines[name] = [_outline(name, shape, pose) for shape, pose in parts]
    return {"outlines": outlines, "pairs": list(rows.values())}


def view_data(scene: Scene) -> dict[str, object]:
    """The part of the plane that the tools of a scene of planar arms reach, and its height.

    Args:
        scene: A flat scene.

    Returns:
        "view": [[x, y], [x, y]], its lower left and upper right corner [m]; "height": z of the first tool [m].
    """
    arms = [(flat, arm.robot.limits) for arm in scene.arms.values() if (flat := flat_arm(arm)) is not None]
    circles = [reach_of(flat, limits) for flat, limits in arms]
    low = np.min([circle.center - circle.radius for circle in circles], axis=0)
    high = np.max([circle.center + circle.radius for circle in circles], axis=0)
    margin = 0.02 * (high - low)
    return {"view": [(low - margin).tolist(), (high + margin).tolist()], "height": arms[0][0].height}


def _outline(name: str, shape: Shape, pose: Array) -> dict[str, object]:
    """A shape seen from above: the hull of a few points, widened by a radius."""
    upright = bool(abs(pose[2, 2]) > 1.0 - _UPRIGHT)
    if isinstance(shape, Sphere) or (isinstance(shape, Cylinder) and upright):
        return {"points": [pose[:2, 3].tolist()], "radius": shape.radius}
    if isinstance(shape, Capsule):
        half = 0.5 * shape.length * pose[:2, 2]
        ends = [(pose[:2, 3] - half).tolist(), (pose[:2, 3] + half).tolist()]
        return {"points": ends, "radius": shape.radius}
    if isinstance(shape, Box) or (isinstance(shape, Mesh) and _is_upright_prism(shape, pose)):
        return {"points": silhouette(shape, pose).tolist(), "radius": 0.0}
    raise InputError(
        f"{name!r} has a {type(shape).__name__.lower()}, expected spheres, capsules, boxes, upright cylinders or "
        "polygons (polygon_prism)"
    )


def _is_upright_prism(mesh: Mesh, pose: Array) -> bool:
    """Whether a mesh is a convex polygon, extruded vertically."""
    vertices = mesh.vertices @ pose[:3, :3].T + pose[:3, 3]
    height = vertices[:, 2]
    low, high = (vertices[np.abs(height - end) < _UPRIGHT, :2] for end in (height.min(), height.max()))
    if len(low) != len(high) or len(low) + len(high) != len(vertices):
        return False
    gaps = np.linalg.norm(low[:, None] - high, axis=2)
    return bool(gaps.min(axis=0).max() < _UPRIGHT and gaps.min(axis=1).max() < _UPRIGHT) and is_own_hull(mesh)
