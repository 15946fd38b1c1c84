"""The left half of the figure: the arm among its obstacles, and the path of its tool."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.patches import Circle, PathPatch, Polygon
from matplotlib.path import Path

from rr1plan.checks import Array
from rr1plan.model.flat_arm import flat_arm
from rr1plan.playback.cspace.cspace_colors import (
    GOAL,
    HATCHES,
    INK,
    START,
    ink_on,
    layer_colors,
    layer_patterns,
)
from rr1plan.playback.cspace.cspace_grid import CSpaceGrid
from rr1plan.playback.cspace.cspace_lines import along, gradient, write_name
from rr1plan.playback.cspace.reach_outline import reach_of
from rr1plan.playback.outlines import silhouette
from rr1plan.shapes import HalfSpace

if TYPE_CHECKING:
    from rr1plan.playback.cspace.cspace_query import CSpaceQuery


def draw_workspace(axes: Axes, cspace: CSpaceQuery) -> None:
    """Draw it."""
    grid = cspace.grid
    scene = grid.scene
    axes.set_title("workspace", loc="left", color=INK)
    axes.set_aspect("equal")
    center, radius = _draw_reach(axes, cspace)
    colors, patterns = layer_colors(grid), layer_patterns(grid)
    for name, obstacle in scene.obstacles.items():
        color, centers = colors.get(name, "#999999"), []
        hatch: dict[str, Any] = {"edgecolor": ink_on(color), "linewidth": 0.0, "hatch": HATCHES[patterns.get(name, 0)]}
        for g in obstacle.geometries:
            if not isinstance(g.shape, HalfSpace):
                corners = silhouette(g.shape, obstacle.pose @ g.pose)
                # A hairline edge closes the seams between the pieces of an obstacle.
                axes.add_patch(Polygon(corners, facecolor=color, edgecolor=color, linewidth=0.3, zorder=2))
                axes.add_patch(Polygon(corners, facecolor="none", zorder=2, **hatch))
                centers.append(corners.mean(axis=0))
        if centers:
            write_name(axes, name, np.mean(centers, axis=0), color)
    for q, color, alpha in _configurations(cspace):
        _draw_arm(axes, grid, q, color, alpha, radius)
    if cspace.path is not None:
        tips = np.array([_tool(grid, q) for q in along(cspace.path, 200)])
        axes.add_collection(gradient(tips, 2.2, zorder=6))
    span = 1.08 * (radius or 1.0)
    axes.set(xlim=(center[0] - span, center[0] + span), ylim=(center[1] - span, center[1] + span))
    axes.set(xlabel="x [m]", ylabel="y [m]")
    axes.spines[["top", "right"]].set_visible(False)


def _draw_reach(axes: Axes, cspace: CSpaceQuery) -> tuple[Array, float]:
    """Draw the reach of a planar arm; returns center and radius of the view."""
    grid = cspace.grid
    arm = grid.scene.arms[grid.arm]
    flat = flat_arm(arm) if arm.robot.joint_names == grid.joint_names else None
    if flat is not None:
        reach = reach_of(flat, arm.robot.limits)
        outline = Path.make_compound_path(*(Path(np.concatenate([rim, rim[:1]])) for rim in reach.rims))
        axes.add_patch(PathPatch(outline, facecolor="#eef1f5", edgecolor="#c5ccd6", linewidth=0.8, zorder=0))
        return reach.center, reach.radius
    base = arm.base[:2, 3]
    values = [axis[:: max(1, len(axis) // 24)] for axis in grid.axes]
    tools = [_tool(grid, np.array([a, b])) - base for a in values[0] for b in values[1]]
    return base, float(np.linalg.norm(tools, axis=1).max())


def _configurations(cspace: CSpaceQuery) -> list[tuple[Array, Any, float]]:
    """Configurations to draw the arm in, with color and opacity: along the path, or start and goals."""
    if cspace.path is not None:
        return [
            (q, colormaps["plasma"](0.05 + 0.8 * k / 8), 0.9 if k in (0, 8) else 0.4)
            for k, q in enumerate(along(cspace.path, 9))
        ]
    if cspace.start is None:
        arm = cspace.grid.scene.arms[cspace.grid.arm]
        q = np.array([arm.q[arm.robot.joint_names.index(name)] for name in cspace.grid.joint_names])
        return [(q, INK, 0.9)]
    shown = [(goal, GOAL, 0.8) for goal in cspace.goals]
    return [*shown, (cspace.start, START, 0.9)]


def _link_poses(grid: CSpaceGrid, q: Array) -> dict[str, Array]:
    arm = grid.scene.arms[grid.arm]
    full = np.array(arm.q)
    for name, value in zip(grid.joint_names, q, strict=True):
        full[arm.robot.joint_names.index(name)] = value
    return {link: arm.base @ T for link, T in arm.robot.link_poses(full).items()}


def _tool(grid: CSpaceGrid, q: Array) -> Array:
    return np.asarray(_link_poses(grid, q)[grid.scene.arms[grid.arm].robot.tool][:2, 3])


def _draw_arm(axes: Axes, grid: CSpaceGrid, q: Array, color: Any, alpha: float, radius: float) -> None:
    robot = grid.scene.arms[grid.arm].robot
    poses = _link_poses(grid, q)
    for link in robot.links:
        for g in link.collisions or link.visuals:
            if not isinstance(g.shape, HalfSpace):
                corners = silhouette(g.shape, poses[link.name] @ g.pose)
                axes.add_patch(Polygon(corners, facecolor=color, edgecolor="none", alpha=alpha, zorder=4))
    for joint in robot.joints:
        if joint.kind != "fixed":
            x, y = (float(c) for c in poses[joint.child][:2, 3])
            axes.add_patch(Circle((x, y), 0.007 * radius, color="white", alpha=alpha, zorder=5))
