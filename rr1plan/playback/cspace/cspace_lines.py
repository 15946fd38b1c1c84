"""Lines and names of the figure."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.patheffects import withStroke

from rr1plan.checks import Array
from rr1plan.playback.cspace.cspace_colors import INK, is_light


def along(points: Array, count: int) -> Array:
    """`count` points evenly along a polyline (k, 2), ends included."""
    if len(points) == 1:
        return np.repeat(points, count, axis=0)
    lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
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


def write_name(axes: Axes, name: str, at: Any, color: str) -> None:
    """Write an obstacle's name on it, or on its image, so that colors need not be distinguished."""
    ink, rim = (INK, "white") if is_light(color) else ("white", color)
    text = axes.annotate(name, at, ha="center", va="center", color=ink, fontsize=12, zorder=5)
    text.set_path_effects([withStroke(linewidth=3, foreground=rim)])
