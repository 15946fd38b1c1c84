"""The picture of a configuration space, for slides: workspace left, joint angles right."""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib import colormaps, rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Annulus, Circle, Patch, Polygon

from rr1plan.checks import Array
from rr1plan.formats.files import write_bytes
from rr1plan.playback.cspace_grid import LIMITS, CSpaceGrid
from rr1plan.playback.cspace_images import SELF
from rr1plan.playback.outlines import silhouette
from rr1plan.shapes import HalfSpace

if TYPE_CHECKING:
    from rr1plan.playback.configuration_space import CSpace

_PALETTE = ("#3b6fd4", "#d1495b", "#3f9b5f", "#8e63c7", "#e0a030", "#2fa7a0", "#b2673f", "#d26fb0")
_INK = "#22262b"
_SELF_COLOR = "#4a4f57"
_LIMIT_COLOR = "#c9ced6"
_START, _GOAL = "#111418", "#ff5a00"
_TINTS = ("#cfe0fb", "#cdeedb", "#fde3c8", "#e6dbf7")  # the page's colours of components
_STRIPE = 5
_STYLE = {"font.family": "DejaVu Sans", "font.size": 10.5, "svg.hashsalt": "rr1plan", "axes.edgecolor": _INK}


def layer_colors(grid: CSpaceGrid) -> dict[str, str]:
    """A colour for each layer: the obstacle's own, where it has one, else one of a palette."""
    colors: dict[str, str] = {}
    for index, name in enumerate(grid.layers):
        obstacle = grid.scene.obstacles.get(name)
        own = None if obstacle is None else next((g.color for g in obstacle.geometries if g.color is not None), None)
        if name == SELF:
            colors[name] = _SELF_COLOR
        elif name == LIMITS:
            colors[name] = _LIMIT_COLOR
        elif own is not None:
            colors[name] = "#{:02x}{:02x}{:02x}".format(*(round(255 * min(1.0, max(0.0, c))) for c in own[:3]))
        else:
            colors[name] = _PALETTE[index % len(_PALETTE)]
    return colors


def layer_image(grid: CSpaceGrid, tints: Mapping[int, str] | None = None) -> Array:
    """The layers as an image (rows: second joint upwards, columns: first joint), overlaps striped, (m, n, 3).

    Args:
        grid: The grid.
        tints: Colours of components of free space, by number; the others stay white.
    """
    n, m = grid.free.shape
    image = np.ones((n, m, 3))
    for component, color in (tints or {}).items():
        image[grid.labels == component] = to_rgb(color)
    count = np.zeros((n, m), dtype=int)
    stripe = (np.add.outer(np.arange(n), np.arange(m)) // _STRIPE).astype(int)
    total = sum((mask.astype(int) for mask in grid.layers.values()), np.zeros((n, m), dtype=int))
    for (_, mask), color in zip(grid.layers.items(), layer_colors(grid).values(), strict=True):
        turn = mask & ((stripe % np.maximum(total, 1)) == count)
        image[turn] = to_rgb(color)
        count += mask
    return np.asarray(image.transpose(1, 0, 2))


def draw(cspace: CSpace, width: float) -> Figure:
    """The whole picture as a matplotlib figure."""
    with rc_context(_STYLE):
        figure = Figure(figsize=(width, 0.56 * width), layout="constrained", facecolor="white")
        FigureCanvasAgg(figure)
        left, right = figure.subplots(1, 2)
        _workspace(left, cspace)
        _torus(right, cspace)
        handles = [
            Patch(facecolor=color, edgecolor="none", label=name) for name, color in layer_colors(cspace.grid).items()
        ]
        figure.legend(
            handles=handles, loc="outside lower center", ncols=min(8, len(handles)), frameon=False, handlelength=1.2
        )
        figure.suptitle(_title(cspace), fontsize=13, color=_INK)
    return figure


def save(cspace: CSpace, file: FilePath, kind: str, dpi: int) -> FilePath:
    """Write the picture as "png" or "svg", atomically."""
    buffer = io.BytesIO()
    with rc_context(_STYLE):
        metadata = {"Date": None} if kind == "svg" else {}
        draw(cspace, 13.0).savefig(buffer, format=kind, dpi=dpi, metadata=metadata)
    return write_bytes(file, buffer.getvalue())


def _title(cspace: CSpace) -> str:
    grid = cspace.grid
    parts = f"{grid.components} component{'s' if grid.components != 1 else ''} of free space"
    if cspace.proves_no_path:
        return f"{grid.scene.name}: no path exists, start and goal lie in different components ({parts})"
    if cspace.path is not None:
        return f"{grid.scene.name}: the same path in the workspace and in the configuration space ({parts})"
    return f"{grid.scene.name}: {parts}"


# ---- workspace ---------------------------------------------------------------------------


def _workspace(axes: Any, cspace: CSpace) -> None:
    grid = cspace.grid
    scene, arm = grid.scene, grid.scene.arms[grid.arm]
    axes.set_title("workspace", loc="left", fontsize=11, color=_INK)
    axes.set_aspect("equal")
    reach = _draw_annulus(axes, cspace)
    colors = layer_colors(grid)
    for name, obstacle in scene.obstacles.items():
        for g in obstacle.geometries:
            if not isinstance(g.shape, HalfSpace):
                corners = silhouette(g.shape, obstacle.pose @ g.pose)
                axes.add_patch(Polygon(corners, facecolor=colors.get(name, "#999999"), edgecolor="none", zorder=2))
                axes.annotate(name, corners.mean(axis=0), ha="center", va="center", color="white", fontsize=8, zorder=3)
    for q, color, alpha in _postures(cspace):
        _draw_arm(axes, grid, q, color, alpha)
    if cspace.path is not None:
        tips = np.array([_tool(grid, q) for q in _along(cspace.path, 200)])
        axes.add_collection(_gradient(tips, 2.2, zorder=6))
    centre = arm.base[:2, 3]
    span = 1.08 * max(reach, 1e-3)
    axes.set(xlim=(centre[0] - span, centre[0] + span), ylim=(centre[1] - span, centre[1] + span))
    axes.set(xlabel="x [m]", ylabel="y [m]")
    axes.spines[["top", "right"]].set_visible(False)


def _draw_annulus(axes: Any, cspace: CSpace) -> float:
    """The ring the tool can reach, from the grid's own configurations; returns its outer radius."""
    grid = cspace.grid
    base = grid.scene.arms[grid.arm].base[:2, 3]
    seconds = grid.axes[1][:: max(1, len(grid.axes[1]) // 180)]
    radii = [float(np.linalg.norm(_tool(grid, np.array([grid.axes[0][0], s])) - base)) for s in seconds]
    inner, outer = min(radii), max(radii)
    ring = Annulus(
        (float(base[0]), float(base[1])),
        outer,
        max(outer - inner, 1e-6),
        facecolor="#eef1f5",
        edgecolor="#c5ccd6",
        lw=0.8,
        zorder=0,
    )
    axes.add_patch(ring)
    return outer


def _postures(cspace: CSpace) -> list[tuple[Array, Any, float]]:
    """Configurations to draw the arm in, with colour and opacity: along the path, or start and goals."""
    if cspace.path is not None:
        return [
            (q, colormaps["plasma"](0.05 + 0.8 * k / 8), 0.9 if k in (0, 8) else 0.4)
            for k, q in enumerate(_along(cspace.path, 9))
        ]
    if cspace.start is None:
        return [(_posture(cspace.grid), _INK, 0.9)]
    shown = [(goal, _GOAL, 0.8) for goal in cspace.goals]
    return [*shown, (cspace.start, _START, 0.9)]


def _posture(grid: CSpaceGrid) -> Array:
    arm = grid.scene.arms[grid.arm]
    return np.array([arm.q[arm.robot.joint_names.index(name)] for name in grid.joint_names])


def _link_poses(grid: CSpaceGrid, q: Array) -> dict[str, Array]:
    arm = grid.scene.arms[grid.arm]
    full = np.array(arm.q)
    for name, value in zip(grid.joint_names, q, strict=True):
        full[arm.robot.joint_names.index(name)] = value
    return {link: arm.base @ T for link, T in arm.robot.link_poses(full).items()}


def _tool(grid: CSpaceGrid, q: Array) -> Array:
    return np.asarray(_link_poses(grid, q)[grid.scene.arms[grid.arm].robot.tool][:2, 3])


def _draw_arm(axes: Any, grid: CSpaceGrid, q: Array, color: Any, alpha: float) -> None:
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
            axes.add_patch(Circle((x, y), 0.012, color="white", alpha=alpha, zorder=5))


# ---- configuration space -----------------------------------------------------------------


def _torus(axes: Any, cspace: CSpace) -> None:
    grid = cspace.grid
    axes.set_title("configuration space", loc="left", fontsize=11, color=_INK)
    extent = [*_edges(grid.axes[0]), *_edges(grid.axes[1])]
    axes.imshow(
        layer_image(grid, _tints(cspace)),
        origin="lower",
        extent=extent,
        interpolation="nearest",
        aspect="auto",
        zorder=0,
    )
    axes.set_box_aspect(1.0)
    if cspace.tree is not None and len(cspace.tree.edges):
        lines = [piece for a, b in cspace.tree.edges for piece in wrapped_pieces(cspace.tree.vertices[[a, b]], grid)]
        axes.add_collection(LineCollection(lines, colors="#30363d", linewidths=0.5, alpha=0.55, zorder=2))
    if cspace.path is not None:
        _draw_path(axes, cspace.path, grid)
    _draw_ends(axes, cspace)
    _draw_seams(axes, grid)
    axes.set(xlim=extent[:2], ylim=extent[2:])
    axes.set(xlabel=f"{grid.joint_names[0]} [rad]", ylabel=f"{grid.joint_names[1]} [rad]")
    for which, values in zip((axes.xaxis, axes.yaxis), grid.axes, strict=True):
        _pi_ticks(which, *_edges(values))


def _tints(cspace: CSpace) -> dict[int, str]:
    """Where there is no path: the components that hold the start and the goals, each in a colour of its own."""
    if not cspace.proves_no_path or cspace.start is None:
        return {}
    ends = [cspace.grid.component_of(q) for q in (cspace.start, *cspace.goals)]
    return dict(zip((k for k in dict.fromkeys(ends) if k), _TINTS, strict=False))


def _edges(centres: Array) -> tuple[float, float]:
    half = 0.5 * float(centres[1] - centres[0])
    return float(centres[0]) - half, float(centres[-1]) + half


def wrapped_pieces(points: Array, grid: CSpaceGrid) -> list[Array]:
    """A polyline in angles (k, 2) as pieces inside the picture, broken at the seams of the torus."""
    dense = _along(points, max(2, int(np.ceil(np.abs(np.diff(points, axis=0)).sum() / 0.01))))
    inside, turns = dense.copy(), np.zeros(dense.shape)
    for axis, closes in enumerate(grid.periodic):
        if closes:
            low, high = _edges(grid.axes[axis])
            turns[:, axis] = np.floor((dense[:, axis] - low) / (high - low))
            inside[:, axis] -= turns[:, axis] * (high - low)
    cuts = np.flatnonzero(np.any(np.diff(turns, axis=0) != 0, axis=1)) + 1
    return [piece for piece in np.split(inside, cuts) if len(piece) > 1]


def _draw_path(axes: Any, path: Array, grid: CSpaceGrid) -> None:
    length = np.linalg.norm(np.diff(path, axis=0), axis=1).sum()
    done = 0.0
    for piece in wrapped_pieces(path, grid):
        own = float(np.linalg.norm(np.diff(piece, axis=0), axis=1).sum())
        axes.add_collection(_gradient(piece, 3.4, color="white", zorder=3))
        axes.add_collection(_gradient(piece, 2.0, done / length, (done + own) / length, zorder=4))
        done += own


def _gradient(
    points: Array, width: float, start: float = 0.0, end: float = 1.0, color: Any = None, zorder: int = 3
) -> Any:
    """A polyline coloured along its length, the same colours as the arm's postures."""
    segments = np.stack([points[:-1], points[1:]], axis=1)
    shades = colormaps["plasma"](0.05 + 0.8 * np.linspace(start, end, len(segments)))
    return LineCollection(
        list(segments), colors=shades if color is None else color, linewidths=width, capstyle="round", zorder=zorder
    )


def _draw_ends(axes: Any, cspace: CSpace) -> None:
    def mark(q: Array, label: str, **style: Any) -> None:
        i, j = cspace.grid.cell(q)
        x, y = cspace.grid.axes[0][i], cspace.grid.axes[1][j]
        axes.plot(x, y, **{"markersize": 10, "markeredgecolor": "white", "markeredgewidth": 1.2, "zorder": 6, **style})
        text = axes.annotate(label, (x, y), xytext=(9, 7), textcoords="offset points", fontsize=9, color=_INK, zorder=7)
        text.set_bbox({"facecolor": "white", "alpha": 0.85, "edgecolor": "none", "pad": 1.2})

    for k, goal in enumerate(cspace.goals, 1):
        mark(goal, "goal" if len(cspace.goals) == 1 else f"goal, elbow {k}", marker="*", color=_GOAL, markersize=16)
    if cspace.start is not None:
        mark(cspace.start, "start", marker="o", color=_START)


def _draw_seams(axes: Any, grid: CSpaceGrid) -> None:
    """Say which edges of the picture are the same place."""
    for axis, (closes, sides) in enumerate(zip(grid.periodic, (("left", "right"), ("bottom", "top")), strict=True)):
        for side in sides:
            axes.spines[side].set_linestyle((0, (5, 3)) if closes else "-")
            axes.spines[side].set_linewidth(1.4 if closes else 1.0)
        if closes:
            spot = (
                {"xy": (1.0, 1.015), "ha": "right"}
                if axis == 0
                else {"xy": (1.015, 0.5), "va": "center", "rotation": 90}
            )
            text = "dashed edges meet: the torus" if axis == 0 else ""
            axes.annotate(text, xycoords="axes fraction", fontsize=8, color="#6b7380", **spot)


def _pi_ticks(axis: Any, low: float, high: float) -> None:
    half_turns = np.arange(np.ceil(low / (np.pi / 2) - 1e-9), np.floor(high / (np.pi / 2) + 1e-9) + 1)
    names = {-2: "−π", -1: "−π/2", 0: "0", 1: "π/2", 2: "π"}
    axis.set_ticks(half_turns * np.pi / 2, [names.get(int(k), f"{k / 2:g}π") for k in half_turns])


def _along(points: Array, count: int) -> Array:
    """`count` points evenly along a polyline (k, 2), ends included."""
    if len(points) == 1:
        return np.repeat(points, count, axis=0)
    lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    where = np.linspace(0.0, lengths[-1], count)
    return np.column_stack([np.interp(where, lengths, points[:, k]) for k in range(points.shape[1])])
