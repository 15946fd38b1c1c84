"""Colors of a configuration space, the same in the figure and on the page."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rr1plan.playback.cspace.cspace_grid import LIMITS, CSpaceGrid
from rr1plan.playback.cspace.cspace_raster import SELF

if TYPE_CHECKING:
    from rr1plan.playback.cspace.cspace_query import CSpaceQuery

INK = "#22262b"
# Of the start and its tree, of a goal and its tree; both are told apart without seeing red or green.
START, GOAL = "#2f66c8", "#14855a"
_PALETTE = ("#3b6fd4", "#d1495b", "#3f9b5f", "#8e63c7", "#e0a030", "#2fa7a0", "#b2673f", "#d26fb0")
SELF_COLOR = "#4a4f57"
_LIMIT_COLOR = "#c9ced6"
_TINTS = ("#cfe0fb", "#cdeedb", "#fde3c8", "#e6dbf7")  # the page's colors of components


def layer_colors(grid: CSpaceGrid) -> dict[str, str]:
    """A color for each layer: the obstacle's own, where it has one, else one of a palette."""
    colors: dict[str, str] = {}
    for index, name in enumerate(grid.layers):
        obstacle = grid.scene.obstacles.get(name)
        own = None if obstacle is None else next((g.color for g in obstacle.geometries if g.color is not None), None)
        if name == SELF:
            colors[name] = SELF_COLOR
        elif name == LIMITS:
            colors[name] = _LIMIT_COLOR
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


def is_light(color: str) -> bool:
    """Whether dark letters are read better on a color than white ones."""
    red, green, blue = (int(color[i : i + 2], 16) for i in (1, 3, 5))
    return 0.299 * red + 0.587 * green + 0.114 * blue > 150
