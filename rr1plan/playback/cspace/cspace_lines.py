"""Lines and names of the figure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.patheffects import withStroke
from matplotlib.text import Text

from rr1plan.checks import Array
from rr1plan.path import edge_lengths
from rr1plan.playback.cspace.cspace_colors import INK, is_light

_GAP = 2.0  # around a name [px]
_WIDEST = 0.4  # longest name, as a share of the width of the axes; longer ones would cover other obstacles


class ObstacleName(NamedTuple):
    """The name of an obstacle in the figure.

    Args:
        text: The text, at the first of its spots.
        spots: Where it may be, best first, each (2,).
    """

    text: Text
    spots: tuple[Array, ...]


def along(points: Array, count: int) -> Array:
    """`count` points evenly along a polyline (k, 2), ends included."""
    if len(points) == 1:
        return np.repeat(points, count, axis=0)
    lengths = np.concatenate([[0.0], np.cumsum(edge_lengths(points))])
    where = np.linspace(0.0, lengths[-1], count)
    return np.column_stack([np.interp(where, lengths, points[:, k]) for k in range(points.shape[1])])


def gradient(
    points: Array, width: float, start: float = 0.0, end: float = 1.0, color: Any = None, zorder: int = 3
) -> Any:
    """A polyline colored along its length, with the same colors as the arm's configurations."""
    segments = np.stack([points[:-1], points[1:]], axis=1)
    shades = colormaps["plasma"](0.05 + 0.8 * np.linspace(start, end, len(segments)))
    return LineCollection(
        list(segments), colors=shades if color is None else color, linewidths=width, capstyle="round", zorder=zorder
    )


def write_name(axes: Axes, name: str, spots: Sequence[Array], color: str) -> ObstacleName:
    """Write an obstacle's name on it, or on its image, so that colors need not be distinguished."""
    ink, rim = (INK, "white") if is_light(color) else ("white", color)
    x, y = spots[0]
    text = axes.text(x, y, name, ha="center", va="center", color=ink, fontsize=12, zorder=5, in_layout=False)
    text.set_path_effects([withStroke(linewidth=3, foreground=rim)])
    return ObstacleName(text, tuple(spots))


def place_names(axes: Axes, names: Mapping[str, ObstacleName]) -> dict[str, ObstacleName]:
    """Move names to spots inside the axes where they overlap no other text; remove long ones, and those without a spot.

    Args:
        axes: The axes, in their final position.
        names: Their names, by obstacle.

    Returns:
        The names that are left.
    """
    axes.apply_aspect()
    frame = axes.get_window_extent()
    low, high = np.array(frame.min), np.array(frame.max)
    texts = [name.text for name in names.values()]
    taken = [text.get_window_extent() for text in axes.texts if text not in texts]
    left = {}
    for key, name in names.items():
        for spot in name.spots:
            name.text.set_position((spot[0], spot[1]))
            box = name.text.get_window_extent().padded(_GAP)
            # A text that crosses the edge of the axes is moved inside.
            shift = np.maximum(low - np.array(box.min), 0.0) + np.minimum(high - np.array(box.max), 0.0)
            box = box.translated(*shift)
            pixel = axes.transData.transform(spot)
            fits = box.width <= _WIDEST * frame.width and frame.contains(*pixel)
            if fits and not box.count_overlaps(taken):
                x, y = axes.transData.inverted().transform(pixel + shift)
                name.text.set_position((x, y))
                taken.append(box)
                left[key] = name
                break
        else:
            name.text.remove()
    return left
