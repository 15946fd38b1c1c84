"""The right half of the figure: the square of two joint angles with the images of obstacles, tree and path."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgb
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray

from rr1plan.checks import Array
from rr1plan.path import edge_lengths
from rr1plan.playback.cspace.cspace_colors import (
    FAINT,
    GOAL,
    INK,
    LIMIT_COLOR,
    START,
    end_tints,
    ink_on,
    layer_colors,
    layer_patterns,
    pattern_cells,
)
from rr1plan.playback.cspace.cspace_grid import LIMITS, CSpaceGrid, joint_symbol, name_spots
from rr1plan.playback.cspace.cspace_lines import ObstacleName, along, gradient, write_name
from rr1plan.playback.search_trees import DrawnTree

if TYPE_CHECKING:
    from rr1plan.playback.cspace.cspace_query import CSpaceQuery

Mask = NDArray[np.bool_]

_STRIPE = 5
_FINEST = 1.6e-3  # longest piece of a path, as a share of the range of a joint
_FEWEST_PIXELS = 360  # fewest of a picture along each joint, for round dots in patterns
_BORDER = 0.03  # beyond the joint limits, of their range
# Fewer labels do not show a scale, and more would overlap.
_FEWEST_TICKS, _MOST_TICKS = 3, 9


def layer_image(grid: CSpaceGrid, tints: Mapping[int, str] | None = None) -> Array:
    """The layers as an image (rows: second joint upwards, columns: first joint), shape (k m, k n, 3).

    Layers and components have patterns in addition to colors; overlaps are striped. Of a coarse grid, each cell has k
    by k pixels.

    Args:
        grid: The grid.
        tints: Colors of components of free space, by number; others are white.
    """
    n, m = _pixels(grid.free).shape
    image = np.ones((n, m, 3))

    def fill(cells: Mask, color: str, pattern: int, ink: float = 1.0) -> None:
        image[cells] = to_rgb(color)
        image[cells & pattern_cells(pattern, (n, m))] = ink_on(color, ink)

    for k, (component, color) in enumerate((tints or {}).items()):
        fill(_pixels(grid.labels == component), color, k, FAINT)
    count = np.zeros((n, m), dtype=int)
    stripe = (np.add.outer(np.arange(n), np.arange(m)) // _STRIPE).astype(int)
    layers = {name: _pixels(mask) for name, mask in grid.layers.items()}
    total = sum((mask.astype(int) for mask in layers.values()), np.zeros((n, m), dtype=int))
    patterns = layer_patterns(grid)
    for (name, mask), color in zip(layers.items(), layer_colors(grid).values(), strict=True):
        fill(mask & (total == 1), color, patterns[name])
        # Overlaps have distinct stripes.
        image[mask & (total > 1) & ((stripe % np.maximum(total, 1)) == count)] = to_rgb(color)
        count += mask
    return np.asarray(image.transpose(1, 0, 2))


def _pixels(cells: Mask) -> Mask:
    """The pixels of cells, each of k by k pixels."""
    k = -(-_FEWEST_PIXELS // min(cells.shape))
    return cells.repeat(k, axis=0).repeat(k, axis=1)


def draw_torus(axes: Axes, cspace: CSpaceQuery, note: bool = True) -> dict[str, ObstacleName]:
    """Draw it; optionally with a note that explains its edges, for which narrow axes have no room.

    Returns:
        The names written on the images, by layer.
    """
    grid = cspace.grid
    spans = _spans(cspace)
    axes.set_title("configuration space", loc="left", color=INK)
    extent = (*grid.ranges[0], *grid.ranges[1])
    image = layer_image(grid, end_tints(cspace))
    if LIMITS in grid.layers:
        image[_pixels(grid.layers[LIMITS]).T] = to_rgb(LIMIT_COLOR)  # without the images of obstacles beyond the limits
    axes.imshow(
        image,
        origin="lower",
        extent=extent,
        interpolation="nearest",
        aspect="auto",
        zorder=0,
    )
    axes.set_box_aspect(1.0)
    axes.set_facecolor(LIMIT_COLOR)  # of the border; the image covers the rest
    axes.set(xlim=spans[0], ylim=spans[1])
    axes.tick_params(pad=6.5)  # both axes have a label in the lower left corner
    if cspace.drawn_tree is not None:
        _draw_tree(axes, cspace, cspace.drawn_tree)
    if cspace.path is not None:
        _draw_path(axes, cspace.path, grid)
    colors = layer_colors(grid)
    spots = name_spots(grid, _window(grid, spans))
    names = {name: write_name(axes, name, [np.array(spot)], colors[name]) for name, spot in spots.items()}
    _draw_ends(axes, cspace)
    _draw_seams(axes, grid, note)
    robot = grid.scene.arms[grid.arm].robot
    for k, (axis, name, turns) in enumerate(zip((axes.xaxis, axes.yaxis), grid.joint_names, grid.turns, strict=True)):
        axis.set_label_text(f"{joint_symbol(robot, name)} {name} [{'rad' if turns else 'm'}]")
        if turns:
            _pi_ticks(axis, *spans[k])
    return names


def drawn_layers(cspace: CSpaceQuery) -> list[str]:
    """Names of the layers that the picture shows, joint limits only if its note does not explain them."""
    grid = cspace.grid
    inside = ~grid.layers.get(LIMITS, np.zeros(grid.labels.shape, dtype=bool))
    drawn = [name for name, mask in grid.layers.items() if (mask & inside).any()]
    return [*drawn, LIMITS] if grid.periodic[0] != grid.periodic[1] else drawn


def _spans(cspace: CSpaceQuery) -> list[tuple[float, float]]:
    """Ranges of the picture's axes: a turn, or the joint limits and the ends of the query, with a border."""
    grid = cspace.grid
    robot = grid.scene.arms[grid.arm].robot
    ends = [q for q in (cspace.start, *cspace.goals) if q is not None and grid.holds(q)]
    spans = []
    for k, (name, closes) in enumerate(zip(grid.joint_names, grid.periodic, strict=True)):
        if closes:
            spans.append(grid.ranges[k])
            continue
        column = robot.joint_names.index(name)
        values = [robot.limits.lower[column], robot.limits.upper[column], *(q[k] for q in ends)]
        low, high = float(min(values)), float(max(values))
        border = _BORDER * (high - low)
        spans.append((low - border, high + border))
    return spans


def _window(grid: CSpaceGrid, spans: list[tuple[float, float]]) -> tuple[slice, slice]:
    """The cells with centers in the ranges of the axes."""
    first, second = (
        slice(int(np.searchsorted(centers, low)), int(np.searchsorted(centers, high)))
        for centers, (low, high) in zip(grid.axes, spans, strict=True)
    )
    return first, second


def wrapped_pieces(points: Array, grid: CSpaceGrid) -> list[Array]:
    """A polyline (k, 2) as pieces inside the picture, broken at the seams of the torus."""
    spans = np.array([high - low for low, high in grid.ranges])
    dense = along(points, max(2, int(np.ceil((np.abs(np.diff(points, axis=0)) / spans).sum() / _FINEST))))
    inside, turns = dense.copy(), np.zeros(dense.shape)
    for axis, closes in enumerate(grid.periodic):
        if closes:
            low, high = grid.ranges[axis]
            turns[:, axis] = np.floor((dense[:, axis] - low) / (high - low))
            inside[:, axis] -= turns[:, axis] * (high - low)
    cuts = np.flatnonzero(np.any(np.diff(turns, axis=0) != 0, axis=1)) + 1
    return [piece for piece in np.split(inside, cuts) if len(piece) > 1]


def _draw_tree(axes: Axes, cspace: CSpaceQuery, tree: DrawnTree) -> None:
    """The trees of start and goals, each in the color of its root; small trees have a dot at each vertex."""
    dense = len(tree.edges) > 800
    for side, color in enumerate((START, GOAL)):
        edges = tree.edges[tree.sides == side]
        lines = [piece for a, b in edges for piece in wrapped_pieces(tree.vertices[[a, b]], cspace.grid)]
        width, alpha = (0.7, 0.6) if dense else (1.4, 0.85)
        axes.add_collection(LineCollection(lines, colors=color, linewidths=width, alpha=alpha, zorder=2))
        dots = [piece[k] for piece in lines for k in (0, -1)]
        if dots and not dense:
            axes.plot(*np.array(dots).T, ".", color=color, markersize=4.5, zorder=2)


def _draw_path(axes: Axes, path: Array, grid: CSpaceGrid) -> None:
    length = edge_lengths(path).sum()
    done = 0.0
    for piece in wrapped_pieces(path, grid):
        own = float(edge_lengths(piece).sum())
        axes.add_collection(gradient(piece, 3.4, color="white", zorder=3))
        axes.add_collection(gradient(piece, 2.0, done / length, (done + own) / length, zorder=4))
        done += own


def _draw_ends(axes: Axes, cspace: CSpaceQuery) -> None:
    grid = cspace.grid

    def mark(q: Array, label: str, color: str, **style: Any) -> None:
        x, y = grid.wrapped(q)
        axes.plot(x, y, color=color, markeredgecolor="white", markeredgewidth=1.4, zorder=7, **style)
        # Left of points near the right edge and below those near the upper one: the label stays inside the picture.
        across, up = axes.transLimits.transform((x, y))
        side, rise = -1 if across > 0.97 - 0.022 * len(label) else 1, -18 if up > 0.93 else 8
        text = axes.annotate(
            label, (x, y), xytext=(11 * side, rise), textcoords="offset points", ha="right" if side < 0 else "left"
        )
        text.set(color=color, fontsize=13, fontweight="bold", zorder=8)
        text.set_path_effects([withStroke(linewidth=4, foreground="white")])

    inside = [(n, q) for n, q in zip(cspace.goal_names, cspace.goals, strict=True) if grid.holds(q)]
    for name, goal in inside:
        mark(goal, name, GOAL, marker="*", markersize=20)
    if cspace.start is not None and grid.holds(cspace.start):
        mark(cspace.start, "start", START, marker="o", markersize=12)


def _draw_seams(axes: Axes, grid: CSpaceGrid, note: bool) -> None:
    """Mark the edges of the picture that are identified."""
    for closes, sides in zip(grid.periodic, (("left", "right"), ("bottom", "top")), strict=True):
        for side in sides:
            axes.spines[side].set_linestyle((0, (5, 3)) if closes else "-")
            axes.spines[side].set_linewidth(1.4 if closes else 1.0)
    if note:
        meet = "dashed edges meet: the torus" if all(grid.periodic) else "dashed edges meet"
        text = meet if any(grid.periodic) else "gray: joint limits"
        axes.annotate(text, (1.0, 1.015), xycoords="axes fraction", ha="right", fontsize=12, color="#59616d")


def _pi_ticks(axis: Axis, low: float, high: float) -> None:
    """Ticks at multiples of π or of fractions of it; decimals in ranges that are too short for those."""
    eighths = 4
    while _count_multiples(eighths, low, high) > _MOST_TICKS:
        eighths *= 2
    while _count_multiples(eighths, low, high) < _FEWEST_TICKS and eighths > 1:
        eighths //= 2
    if _count_multiples(eighths, low, high) >= _FEWEST_TICKS:
        step = eighths * np.pi / 8
        ticks = np.arange(np.ceil(low / step - 1e-9), np.floor(high / step + 1e-9) + 1).astype(int) * eighths
        axis.set_ticks(ticks * np.pi / 8, [_pi_label(int(k)) for k in ticks])


def _count_multiples(eighths: int, low: float, high: float) -> int:
    step = eighths * np.pi / 8
    return int(np.floor(high / step + 1e-9) - np.ceil(low / step - 1e-9)) + 1


def _pi_label(eighths: int) -> str:
    """π/8, π/4, 3π/8, ..., π, 1.5π, 2π."""
    share = Fraction(abs(eighths), 8)
    if share == 0:
        return "0"
    if share.denominator == 1 or share > 1:
        text = "π" if share == 1 else f"{float(share):g}π"
    else:
        text = f"{'' if share.numerator == 1 else share.numerator}π/{share.denominator}"
    return text if eighths > 0 else f"−{text}"
