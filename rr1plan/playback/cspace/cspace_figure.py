"""The picture of a configuration space, for slides: workspace left, joint angles right."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from rr1plan.checks import counted
from rr1plan.playback.cspace.cspace_colors import (
    GOAL,
    HATCHES,
    INK,
    LIMIT_COLOR,
    START,
    end_tints,
    ink_on,
    layer_colors,
    layer_patterns,
)
from rr1plan.playback.cspace.cspace_grid import LIMITS
from rr1plan.playback.cspace.cspace_lines import ObstacleName, place_names
from rr1plan.playback.cspace.cspace_torus import draw_torus, drawn_layers
from rr1plan.playback.cspace.cspace_verdict import headline
from rr1plan.playback.cspace.cspace_workspace import draw_workspace
from rr1plan.playback.figure_files import PLAIN_TEXT, break_lines, drawing, keep_tick_sizes, shortened

if TYPE_CHECKING:
    from rr1plan.playback.cspace.cspace_query import CSpaceQuery

# Text that is readable from the last row when the picture fills a slide.
STYLE = {
    **PLAIN_TEXT,
    "font.family": "DejaVu Sans",
    "font.size": 14,
    "axes.titlesize": 15,
    "axes.labelsize": 14,
    "axes.edgecolor": INK,
    "hatch.linewidth": 1.6,
    "axes.formatter.limits": (-3, 6),  # labels of millimeters would overlap
}
_MOST_COLUMNS = 5  # of the legend
_MOST_PASSES = 20  # of the layout


def draw(cspace: CSpaceQuery, width: float) -> Figure:
    """The whole picture as a matplotlib figure."""
    with drawing(STYLE):
        figure = Figure(figsize=(width, 0.56 * width), layout="constrained", facecolor="white")
        FigureCanvasAgg(figure)
        left, right = figure.subplots(1, 2)
        obstacles, images = draw_workspace(left, cspace), draw_torus(right, cspace)
        keep_tick_sizes(figure)
        drawn, shown = drawn_layers(cspace), set(obstacles)
        break_lines(figure.suptitle(_title(cspace), fontsize=16, color=INK), 0.99)
        while True:
            # Layers without a name on their image are in the legend, and so are obstacles without any name.
            unnamed = {name for name in drawn if name not in images} | (shown - set(obstacles) - set(images))
            handles = _legend(cspace, unnamed)
            if handles:
                _add_legend(figure, handles)
            _settle(figure)
            before = len(obstacles) + len(images)
            obstacles, images = place_names(left, obstacles), place_names(right, images)
            if len(obstacles) + len(images) == before:
                return figure
            # Names without room move to the legend, which changes the layout.
            for legend in list(figure.legends):
                legend.remove()


def _add_legend(figure: Figure, handles: list[Artist]) -> None:
    """Put a legend below the axes, in as many columns of equal length as fit into the figure's width."""
    for most in range(_MOST_COLUMNS, 0, -1):
        rows = -(-len(handles) // most)
        columns = -(-len(handles) // rows)
        legend = figure.legend(handles=handles, loc="outside lower center", ncols=columns, frameon=False)
        if most == 1 or legend.get_window_extent().width <= figure.bbox.width:
            return
        legend.remove()


def _settle(figure: Figure) -> None:
    """Lay out the figure until its axes no longer move.

    Constrained layout measures the text around axes of a fixed aspect before their size is final, and after its two
    passes titles and legends may still overlap them.
    """
    engine = figure.get_layout_engine()
    assert engine is not None
    with warnings.catch_warnings():
        # Matplotlib repeats its warning about figures without room when they are drawn.
        warnings.simplefilter("ignore", UserWarning)
        for _ in range(_MOST_PASSES):
            before = [axes.get_position(original=True).bounds for axes in figure.axes]
            engine.execute(figure)
            if np.allclose(before, [axes.get_position(original=True).bounds for axes in figure.axes], atol=1e-4):
                return


def fit_names(figure: Figure, names: Mapping[Axes, Mapping[str, ObstacleName]]) -> None:
    """Lay out a figure, and remove the names of obstacles for which its axes have no room."""
    _settle(figure)
    for axes, own in names.items():
        place_names(axes, own)


def swatch(color: str, pattern: int, **options: Any) -> Patch:
    """The legend symbol of a layer or a component."""
    return Patch(facecolor=color, edgecolor=ink_on(color), hatch=HATCHES[pattern], **options)


def _legend(cspace: CSpaceQuery, unnamed: set[str]) -> list[Artist]:
    """The symbols of layers without a name, of trees and of components."""
    colors, patterns = {**layer_colors(cspace.grid), LIMITS: LIMIT_COLOR}, layer_patterns(cspace.grid)
    handles: list[Artist] = [
        swatch(color, patterns.get(name, 0), label=shortened(name)) for name, color in colors.items() if name in unnamed
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
