"""Colors of a configuration space, the same in the figure and on the page."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array
from rr1plan.playback.arm_colors import ARM_COLORS
from rr1plan.playback.cspace.cspace_grid import LIMITS, CSpaceGrid
from rr1plan.playback.cspace.cspace_raster import SELF

if TYPE_CHECKING:
    from rr1plan.playback.cspace.cspace_query import CSpaceQuery

INK = "#22262b"
# Of the start and its tree, of a goal and its tree; distinguishable without seeing red or green.
START, GOAL = "#2f66c8", "#14855a"
_PALETTE = ARM_COLORS[1:]  # the first is the color of the arm and its path
SELF_COLOR = "#4a4f57"
LIMIT_COLOR = "#c9ced6"
_TINTS = ("#cfe0fb", "#cdeedb", "#fde3c8", "#e6dbf7")  # the page's colors of components

HATCHES = (None, "..", "\\\\", "--", "||", "xx", "++")
"""Patterns of images and components, as matplotlib writes them; `pattern_cells` and the page draw the same."""
_LINE, _DOT = 0.15, 0.2  # shares of a tile
FAINT = 0.5  # of the ink, on free space, where trees and paths are drawn


def layer_colors(grid: CSpaceGrid) -> dict[str, str]:
    """A color for each layer: the obstacle's color if it has one, otherwise one of a palette."""
    colors: dict[str, str] = {}
    for index, name in enumerate(grid.layers):
        obstacle = grid.scene.obstacles.get(name)
        own = None if obstacle is None else next((g.color for g in obstacle.geometries if g.color is not None), None)
        if name == SELF:
            colors[name] = SELF_COLOR
        elif name == LIMITS:
            colors[name] = LIMIT_COLOR
        elif own is not None:
            colors[name] = "#{:02x}{:02x}{:02x}".format(*(round(255 * min(1.0, max(0.0, c))) for c in own[:3]))
        else:
            colors[name] = _PALETTE[index % len(_PALETTE)]
    return colors


def end_tints(cspace: CSpaceQuery) -> dict[int, str]:
    """Colors of the components that contain the start and the goals, for queries without a path."""
    if not cspace.proves_no_path or cspace.start is None:
        return {}
    ends = [cspace.grid.component_of(q) for q in (cspace.start, *cspace.goals)]
    return dict(zip((k for k in dict.fromkeys(ends) if k), _TINTS, strict=False))


def layer_patterns(grid: CSpaceGrid) -> dict[str, int]:
    """The pattern number of each layer: obstacles by their order; self-collision and joint limits are plain."""
    things = [name for name in grid.layers if name not in (SELF, LIMITS)]
    return {name: things.index(name) % len(HATCHES) if name in things else 0 for name in grid.layers}


def pattern_cells(pattern: int, shape: tuple[int, int]) -> NDArray[np.bool_]:
    """The cells of a picture (first joint, second joint) that a pattern covers with ink."""
    tile = max(6, shape[0] // 40)
    x, y = np.meshgrid(*((np.arange(count) % tile + 0.5) / tile for count in shape), indexing="ij")
    falls, rises = (x + y) % 1.0 < _LINE, (x - y) % 1.0 < _LINE
    across, up = y < _LINE, x < _LINE
    dots = np.hypot(x - 0.5, y - 0.5) < _DOT
    inked: NDArray[np.bool_] = (np.zeros_like(dots), dots, falls, across, up, falls | rises, across | up)[pattern]
    return inked


def ink_on(color: str, share: float = 1.0) -> Array:
    """The color of a pattern's ink on a background color, or of a share of that ink, shape (3,), 0 to 1."""
    rgb = _rgb(color)
    return rgb + share * (0.3 * (_rgb(INK) - rgb) if is_light(color) else 0.38 * (1.0 - rgb))


def is_light(color: str) -> bool:
    """Whether dark text is more readable than white text on a color."""
    return float(_rgb(color) @ [0.299, 0.587, 0.114]) > 150 / 255


def _rgb(color: str) -> Array:
    return np.array([int(color[i : i + 2], 16) for i in (1, 3, 5)]) / 255
