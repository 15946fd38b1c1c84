"""The left half of the figure: the arm among its obstacles, and the path of its tool."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.patches import Circle, PathPatch, Polygon
from matplotlib.path import Path
from matplotlib.transforms import Bbox

from rr1plan.checks import Array
from rr1plan.model.flat_arm import flat_arm
from rr1plan.playback.cspace.cspace_cells import Mask, widest_spot
from rr1plan.playback.cspace.cspace_colors import (
    GOAL,
    HATCHES,
    INK,
    START,
    ink_on,
    layer_colors,
    layer_patterns,
)
from rr1plan.playback.cspace.cspace_grid import CSpaceGrid, whole_configurations
from rr1plan.playback.cspace.cspace_lines import ObstacleName, along, gradient, write_name
from rr1plan.playback.cspace.reach_outline import reach_of
from rr1plan.playback.outlines import silhouette
from rr1plan.robot import Geometry
from rr1plan.robot.bounding_boxes import bounding_box
from rr1plan.scene import Scene
from rr1plan.shapes import HalfSpace, PointCloud

if TYPE_CHECKING:
    from rr1plan.playback.cspace.cspace_query import CSpaceQuery


_SAMPLES = 120  # along each axis, of the map in which room for names is sought
_GRAY = "#999999"  # of obstacles without an image
_NAME_GAP = 0.05  # between an obstacle's edge and the middle of a name beside it, as a share of half the view
_HALF_NAME = (9, 4)  # half the width and the height of a short name [samples]


def draw_workspace(axes: Axes, cspace: CSpaceQuery) -> dict[str, ObstacleName]:
    """Draw it.

    Returns:
        The names written on obstacles, by obstacle, for each that is visible.
    """
    grid = cspace.grid
    axes.set_title("workspace", loc="left", color=INK)
    axes.set_aspect("equal")
    center, radius = _draw_reach(axes, cspace)
    colors, patterns = layer_colors(grid), layer_patterns(grid)
    pieces = _pieces(grid.scene)
    for name, corners in pieces:
        color = colors.get(name, _GRAY)
        hatch: dict[str, Any] = {"edgecolor": ink_on(color), "linewidth": 0.0, "hatch": HATCHES[patterns.get(name, 0)]}
        # A hairline edge closes the seams between the pieces of an obstacle.
        axes.add_patch(Polygon(corners, facecolor=color, edgecolor=color, linewidth=0.3, zorder=2))
        axes.add_patch(Polygon(corners, facecolor="none", zorder=2, **hatch))
    for q, color, alpha in _configurations(cspace):
        _draw_arm(axes, grid, q, color, alpha, radius)
    if cspace.path is not None:
        tips = np.array([_tool(grid, q) for q in along(cspace.path, 200)])
        axes.add_collection(gradient(tips, 2.2, zorder=6))
    span = 1.08 * (radius or 1.0)
    axes.set(xlim=(center[0] - span, center[0] + span), ylim=(center[1] - span, center[1] + span))
    axes.set(xlabel="x [m]", ylabel="y [m]")
    axes.spines[["top", "right"]].set_visible(False)
    arms = [corners for q, *_ in _configurations(cspace) for corners in _arm_outlines(grid, q)]
    spots = _name_spots(pieces, arms, center, span)
    return {name: write_name(axes, name, spots[name], colors.get(name, _GRAY)) for name in spots}


def _pieces(scene: Scene) -> list[tuple[str, Array]]:
    """Names of obstacles and outlines of their geometries, the upper ones last, as seen from above."""
    pieces = [
        (_top(g, obstacle.pose), name, silhouette(g.shape, obstacle.pose @ g.pose))
        for name, obstacle in scene.obstacles.items()
        for g in obstacle.geometries
        if not isinstance(g.shape, HalfSpace)
    ]
    return [(name, corners) for _, name, corners in sorted(pieces, key=lambda piece: piece[0])]


def _top(geometry: Geometry, pose: Array) -> float:
    if isinstance(geometry.shape, PointCloud):
        T = pose @ geometry.pose
        return float((geometry.shape.points @ T[2, :3] + T[2, 3]).max())
    return float(bounding_box((geometry,), pose)[1, 2])


def _name_spots(
    pieces: Sequence[tuple[str, Array]], arms: Sequence[Array], center: Array, span: float
) -> dict[str, list[Array]]:
    """For each obstacle that is visible in the view, the upper ones first, where its name may be, best first.

    In its middle if nothing covers that; in the middle of its widest open part; below and above it. A name on an
    obstacle thinner than the samples would hide it, and is written there only if there is no room beside it.
    """
    x, y = (c + span * (2.0 * (np.arange(_SAMPLES) + 0.5) / _SAMPLES - 1.0) for c in center)
    points = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    # The uppermost obstacle at each point; -2 where the arm covers it.
    names = list(dict.fromkeys(name for name, _ in pieces))
    index = np.full(len(points), -1)
    for name, corners in pieces:
        index[_inside(corners, points)] = names.index(name)
    for corners in arms:
        index[_inside(corners, points)] = -2
    uppermost = index.reshape(_SAMPLES, _SAMPLES)
    view = Bbox([center - span, center + span])
    spots: dict[str, list[Array]] = {}
    for k, name in reversed(list(enumerate(names))):
        outlines = [corners for other, corners in pieces if other == name]
        if not any(_is_visible(i, pieces, view) for i, (other, _) in enumerate(pieces) if other == name):
            continue
        open_part: Mask = uppermost == k
        middle = np.mean([corners.mean(axis=0) for corners in outlines], axis=0)
        i, j = np.clip(((middle - center) / span + 1.0) / 2.0 * _SAMPLES, 0, _SAMPLES - 1).astype(int)
        column, row, room = widest_spot(open_part, (False, False), _HALF_NAME)
        widest = np.array([x[column], y[row]])
        corners = np.clip(np.concatenate(outlines), view.min, view.max)
        low, high = corners.min(axis=0), corners.max(axis=0)
        across = 0.5 * (low[0] + high[0])
        beside = [np.array([across, low[1] - _NAME_GAP * span]), np.array([across, high[1] + _NAME_GAP * span])]
        if not room:
            spots[name] = [*beside, middle]
        elif view.contains(*middle) and open_part[i, j]:
            spots[name] = [middle, widest, *beside]
        else:
            spots[name] = [widest, *beside]
    return spots


def _inside(corners: Array, points: Array) -> Mask:
    return np.asarray(Path(corners).contains_points(points))


def _is_visible(index: int, pieces: Sequence[tuple[str, Array]], view: Bbox) -> bool:
    """Whether a piece is in the view and no piece above covers it, all of which are convex."""
    corners = pieces[index][1]
    shown = Path(np.concatenate([corners, corners[:1]])).intersects_bbox(view)
    return shown and not any(_inside(above, corners).all() for _, above in pieces[index + 1 :])


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
    points = [_tool(grid, np.array([a, b])) for a in values[0] for b in values[1]]
    points += [corner for q, *_ in _configurations(cspace) for corners in _arm_outlines(grid, q) for corner in corners]
    return base, float(np.linalg.norm(np.array(points) - base, axis=1).max())


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
    return {link: arm.base @ T for link, T in arm.robot.link_poses(whole_configurations(grid, q)).items()}


def _tool(grid: CSpaceGrid, q: Array) -> Array:
    return np.asarray(_link_poses(grid, q)[grid.scene.arms[grid.arm].robot.tool][:2, 3])


def _arm_outlines(grid: CSpaceGrid, q: Array) -> list[Array]:
    poses = _link_poses(grid, q)
    return [
        silhouette(g.shape, poses[link.name] @ g.pose)
        for link in grid.scene.arms[grid.arm].robot.links
        for g in link.collisions or link.visuals
        if not isinstance(g.shape, HalfSpace)
    ]


def _draw_arm(axes: Axes, grid: CSpaceGrid, q: Array, color: Any, alpha: float, radius: float) -> None:
    for corners in _arm_outlines(grid, q):
        axes.add_patch(Polygon(corners, facecolor=color, edgecolor="none", alpha=alpha, zorder=4))
    poses = _link_poses(grid, q)
    for joint in grid.scene.arms[grid.arm].robot.joints:
        if joint.kind != "fixed":
            x, y = (float(c) for c in poses[joint.child][:2, 3])
            axes.add_patch(Circle((x, y), 0.007 * radius, color="white", alpha=alpha, zorder=5))
