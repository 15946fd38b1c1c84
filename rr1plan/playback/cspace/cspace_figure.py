"""The picture of a configuration space, for slides: workspace left, joint angles right."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from matplotlib import rc_context
from matplotlib.artist import Artist
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from rr1plan.checks import counted
from rr1plan.playback.cspace.cspace_colors import (
    GOAL,
    HATCHES,
    INK,
    START,
    end_tints,
    ink_on,
    layer_colors,
    layer_patterns,
)
from rr1plan.playback.cspace.cspace_torus import draw_torus
from rr1plan.playback.cspace.cspace_verdict import headline
from rr1plan.playback.cspace.cspace_workspace import draw_workspace

if TYPE_CHECKING:
    from rr1plan.playback.cspace.cspace_query import CSpaceQuery

# Text that is readable from the last row when the picture fills a slide.
STYLE = {
    "font.family": "DejaVu Sans",
    "font.size": 14,
    "axes.titlesize": 15,
    "axes.labelsize": 14,
    "axes.edgecolor": INK,
    "hatch.linewidth": 1.6,
}


def draw(cspace: CSpaceQuery, width: float) -> Figure:
    """The whole picture as a matplotlib figure."""
    with rc_context(STYLE):
        figure = Figure(figsize=(width, 0.56 * width), layout="constrained", facecolor="white")
        FigureCanvasAgg(figure)
        left, right = figure.subplots(1, 2)
        draw_workspace(left, cspace)
        draw_torus(right, cspace)
        handles = _legend(cspace)
        if handles:
            figure.legend(handles=handles, loc="outside lower center", ncols=min(5, len(handles)), frameon=False)
        figure.suptitle(_title(cspace), fontsize=16, color=INK)
    return figure


def swatch(color: str, pattern: int, **options: Any) -> Patch:
    """The legend symbol of a layer or a component."""
    return Patch(facecolor=color, edgecolor=ink_on(color), hatch=HATCHES[pattern], **options)


def _legend(cspace: CSpaceQuery) -> list[Artist]:
    named = cspace.grid.name_spots()
    colors, patterns = layer_colors(cspace.grid), layer_patterns(cspace.grid)
    handles: list[Artist] = [
        swatch(color, patterns[name], label=name) for name, color in colors.items() if name not in named
    ]
    tree = cspace.drawn_tree
    if tree is not None:
        thinned = "" if len(tree.edges) == tree.explored else ", thinned"
        handles += [Line2D([], [], color=START, label=f"tree of the start{thinned}")]
        handles += [Line2D([], [], color=GOAL, label=f"tree of the goal{thinned}")] * bool(cspace.goals)
    tints = end_tints(cspace)
    if cspace.start is not None and tints:
        start = cspace.grid.component_of(cspace.start)
        handles += [
            swatch(color, k, label=f"joined to the {'start' if part == start else 'goal'}")
            for k, (part, color) in enumerate(tints.items())
        ]
    return handles


def _title(cspace: CSpaceQuery) -> str:
    grid = cspace.grid
    parts = f"{counted(grid.components, 'component')} of free space"
    answer = headline(cspace)
    return f"{grid.scene.name}: {answer} ({parts})" if answer else f"{grid.scene.name}: {parts}"
