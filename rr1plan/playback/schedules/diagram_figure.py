"""The figure of a coordination diagram: blocked cells, the curve of the plan, and waits as straight lines."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib import axes as mpl_axes
from matplotlib.artist import Artist
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PatchCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle

from rr1plan.checks import Array
from rr1plan.playback.arm_colors import arm_color
from rr1plan.playback.figure_files import Look, break_lines, drawing, look_of, style_of

if TYPE_CHECKING:
    from rr1plan.playback.schedules.pair_schedule import Axes, PairSchedule

_BAND = 0.035  # width of the bands of starts and goals, as a share of the axis
_HEIGHT = 0.98  # of the figure, relative to its width
_STILL = 1e-9
_SHORTEST = 1e-3  # shorter rests, some of which are rounding, are not waits, as in time lines [s]
_TICKS = 8  # approximate number of time labels at the curve
_CLOSE = 0.05  # smallest distance between time labels, as a share of the picture


def draw(diagram: PairSchedule, axes: Axes, width: float, dark: bool) -> Figure:
    """The diagram as a matplotlib figure."""
    look = look_of(dark)
    with drawing(style_of(look)):
        figure = Figure(figsize=(width, _HEIGHT * width), layout="constrained", facecolor=look.paper)
        FigureCanvasAgg(figure)
        plot = figure.subplots()
        _draw_cells(plot, diagram, axes, look)
        _draw_curve(plot, diagram, axes, look)
        _draw_axes(plot, diagram, axes, look)
        figure.legend(
            handles=_legend(diagram, look),
            loc="outside lower center",
            ncols=3,
            handlelength=1.6,
            frameon=False,
            fontsize=11.5,
        )
    return figure


def _extent(scale: Array) -> tuple[float, float]:
    """The length of an axis, and the width of its bands."""
    whole = float(scale[-1]) or 1.0
    return whole, _BAND * whole


def _edges(scale: Array) -> Array:
    """Borders of all cells on an axis: of segments, and of the bands of start and goal."""
    whole, band = _extent(scale)
    inner = scale if len(scale) > 1 else np.array([0.0, whole])
    return np.concatenate([[-band], inner, [whole + band]])


def _draw_cells(plot: mpl_axes.Axes, diagram: PairSchedule, axes: Axes, look: Look) -> None:
    """Bands of starts and goals, and blocked cells; an arm that does not move has one column across the picture."""
    one, two = diagram.scales(axes)
    cells = diagram.blocked != 0
    for k, scale in enumerate((one, two)):
        if len(scale) == 1:
            cells = np.insert(cells, 1, cells.take(0, axis=k), axis=k)
    (width, across), (height, up) = _extent(one), _extent(two)
    for x in (-across, width):
        plot.add_patch(Rectangle((x, -up), across, height + 2 * up, facecolor=look.faint, linewidth=0.0, zorder=1))
    for y in (-up, height):
        plot.add_patch(Rectangle((-across, y), width + 2 * across, up, facecolor=look.faint, linewidth=0.0, zorder=1))
    right, top = _edges(one), _edges(two)
    runs = []
    for column, blocked in enumerate(cells):
        ends = np.flatnonzero(np.diff(blocked.astype(np.int8), prepend=0, append=0)).reshape(-1, 2)
        runs += [
            Rectangle((right[column], top[i]), right[column + 1] - right[column], top[j] - top[i]) for i, j in ends
        ]
    plot.add_collection(PatchCollection(runs, facecolor=look.blocked, edgecolor=look.blocked, linewidth=0.4, zorder=2))
    plot.add_patch(Rectangle((0.0, 0.0), width, height, fill=False, edgecolor=look.soft, linewidth=1.0, zorder=3))


def _draw_curve(plot: mpl_axes.Axes, diagram: PairSchedule, axes: Axes, look: Look) -> None:
    """The plan from lower left to upper right: both move, or one of them waits."""
    points, times = diagram.curve(axes), diagram.times
    plot.plot(points[:, 0], points[:, 1], color=look.paper, linewidth=5.0, zorder=4, solid_capstyle="round")
    plot.plot(points[:, 0], points[:, 1], color=look.ink, linewidth=2.6, zorder=5, solid_capstyle="round")
    for arm in range(2):
        color = arm_color(diagram.numbers[arm])
        for first, last in _waits(points, times, arm):
            span = points[first : last + 1]
            if np.ptp(span, axis=0).max() > 0.0:
                plot.plot(span[:, 0], span[:, 1], color=color, linewidth=6.0, zorder=6, solid_capstyle="butt")
            else:  # both wait for other arms
                plot.plot(span[:1, 0], span[:1, 1], "D", color=color, markersize=(13, 8)[arm], zorder=6 + arm)
    _draw_times(plot, points, times, look)
    for end in points[[0, -1]]:
        plot.plot(*end, "o", color=look.paper, markeredgecolor=look.ink, markeredgewidth=2.4, markersize=12, zorder=9)


def _waits(points: Array, times: Array, arm: int) -> list[tuple[int, int]]:
    """The rests of an arm before its arrival: first and last index of each."""
    own = points[:, arm]
    rests = (np.abs(np.diff(own)) <= _STILL) & (np.diff(times) > 0.0)
    later = np.logical_and.accumulate(rests[::-1])[::-1]  # at rest until the end
    edges = np.flatnonzero(np.diff((rests & ~later).astype(np.int8), prepend=0, append=0))
    runs = edges.reshape(-1, 2).tolist()
    return [(first, last) for first, last in runs if times[last] - times[first] >= _SHORTEST]


def _draw_times(plot: mpl_axes.Axes, points: Array, times: Array, look: Look) -> None:
    """Dots on the curve at round times, which make speeds visible."""
    step = _round_step(float(times[-1]) / _TICKS)
    before, size = points[0], np.ptp(points, axis=0)
    for time in np.arange(step, times[-1] - 0.3 * step, step):
        place = np.array([np.interp(time, times, points[:, k]) for k in range(2)])
        if (np.abs(place - before) <= _CLOSE * size).all() or (np.abs(points[-1] - place) <= _CLOSE * size).all():
            continue
        before = place
        plot.plot(
            *place, "o", color=look.ink, markersize=5.5, markeredgecolor=look.paper, markeredgewidth=1.0, zorder=8
        )
        plot.annotate(
            f"{time:g} s", tuple(place), xytext=(9, -13), textcoords="offset points", fontsize=10, color=look.ink,
            zorder=8, bbox={"boxstyle": "round,pad=0.1", "facecolor": look.paper, "edgecolor": "none", "alpha": 0.7},
        )  # fmt: skip


def _round_step(least: float) -> float:
    """The next larger round number: 1, 2 or 5 times a power of ten."""
    if least <= 0.0:
        return 1.0
    power = 10.0 ** np.floor(np.log10(least))
    return float(next(power * k for k in (1, 2, 5, 10) if power * k >= least))


def _draw_axes(plot: mpl_axes.Axes, diagram: PairSchedule, axes: Axes, look: Look) -> None:
    one, two = diagram.scales(axes)
    (width, across), (height, up) = _extent(one), _extent(two)
    plot.set_facecolor(look.paper)
    plot.set_xlim(-across, width + across)
    plot.set_ylim(-up, height + up)
    words = "{} on its path [s without waiting]" if axes == "time" else "path of {} [{}]"
    along, beside = map(words.format, diagram.names, diagram.units)
    labels = plot.set_xlabel(along), plot.set_ylabel(beside)
    for scale, axis in ((one, plot.xaxis), (two, plot.yaxis)):
        if not scale[-1]:  # this arm does not move: the axis has a length only to be visible
            axis.set_ticks([0.0])
    for side, arm in (("bottom", 0), ("left", 1)):
        plot.spines[side].set(edgecolor=arm_color(diagram.numbers[arm]), linewidth=6.0)
    for side in ("top", "right"):
        plot.spines[side].set_visible(False)
    title = plot.set_title(f"{diagram.names[0]} and {diagram.names[1]}, {diagram.times[-1]:.2f} s", loc="left")
    for text in (*labels, title):
        break_lines(text, 0.84)


def _legend(diagram: PairSchedule, look: Look) -> list[Artist]:
    handles: list[Artist] = [
        Patch(color=look.blocked, label="not proven free"),
        Line2D([], [], color=look.ink, linewidth=2.6, label="the plan"),
    ]
    for arm in range(2):
        waits = _waits(diagram.curve(), diagram.times, arm)
        seconds = sum(diagram.times[last] - diagram.times[first] for first, last in waits)
        if waits:
            color = arm_color(diagram.numbers[arm])
            handles.append(
                Line2D([], [], color=color, linewidth=6.0, label=f"{diagram.names[arm]} waits, {seconds:.2f} s")
            )
    handles.append(Patch(color=look.faint, label="at the start or goal"))
    return handles
