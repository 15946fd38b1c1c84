"""Figures of the experiments, with the numbers of the thesis where available."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from matplotlib import axes as mpl_axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.ticker import EngFormatter, FuncFormatter, LogLocator, MaxNLocator, NullFormatter

from rr1plan.experiments.measuring_process import Row
from rr1plan.experiments.thesis_figures import GAZEBO_FACTORS, TOWER_FACTORS
from rr1plan.playback.figure_files import drawing, look_of, style_of

_SIZE = (12.0, 4.8)  # [inch]
_OURS, _SECOND, _THESIS = "#1f6fb2", "#3aa17e", "#d9730d"
_MARKERS = {_OURS: "o", _SECOND: "s", _THESIS: "^"}  # for readers who do not distinguish the colors
_GAP = 0.1  # between the panels, as a share of their width
_LOOK = look_of(dark=False)
Panel = Callable[[mpl_axes.Axes, Sequence[Row]], None]


def _figure(left: Panel, right: Panel) -> Callable[[Sequence[Row]], Figure]:
    """A function that draws the rows of an experiment in two panels."""

    def draw(rows: Sequence[Row]) -> Figure:
        with drawing(style_of(_LOOK)):
            layout = ConstrainedLayoutEngine(wspace=_GAP)
            figure = Figure(figsize=_SIZE, layout=layout, facecolor=_LOOK.paper)
            FigureCanvasAgg(figure)
            for panel, plot in zip((left, right), figure.subplots(1, 2), strict=True):
                plot.grid(color=_LOOK.faint)
                plot.set_axisbelow(True)
                plot.spines[["top", "right"]].set_visible(False)
                panel(plot, rows)
        return figure

    return draw


def _line(plot: mpl_axes.Axes, points: Mapping[float, float], label: str, color: str, *, dashed: bool = False) -> None:
    style = "--" if dashed else "-"
    plot.plot(list(points), list(points.values()), style, marker=_MARKERS[color], color=color, label=label, linewidth=2)


def _values(rows: Sequence[Row], key: str, name: str) -> dict[float, float]:
    return {row[key]: row[name] for row in rows}


def _label(plot: mpl_axes.Axes, x: str, y: str, title: str) -> None:
    """Labels, title, legend, and plain numbers on the axes."""
    for axis in (plot.xaxis, plot.yaxis):
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:,.10g}"))
        if axis.get_scale() == "log":
            low, high = axis.get_view_interval()
            axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high < 1e3 * low else (1.0,)))
            axis.set_minor_formatter(NullFormatter())
        elif axis is plot.xaxis:  # numbers of boats or arms
            axis.set_major_locator(MaxNLocator(integer=True, steps=[1, 2, 5, 10]))
    plot.set(xlabel=x, ylabel=y, title=title)
    if plot.get_legend_handles_labels()[1]:
        plot.legend(frameon=False, fontsize=11)


def _from_zero(plot: mpl_axes.Axes) -> None:
    """Start the vertical axis at zero, with a margin above the largest value."""
    plot.set_ylim(0.0, 1.08 * plot.dataLim.y1 or 1.0)


def _factors(plot: mpl_axes.Axes, rows: Sequence[Row], key: str, thesis: Mapping[int, float], title: str) -> None:
    """Real-time factors over the number of boats or arms, including those of the thesis."""
    plot.set_xscale("log")
    plot.set_yscale("log")
    plot.axhline(1.0, color=_LOOK.soft, linewidth=1)
    # Above the line, where the curve of the thesis is lower or has ended, and ours is higher.
    plot.annotate(
        "real time",
        (0.75, 1.0),
        (0.0, 6.0),
        xycoords=plot.get_yaxis_transform(),
        textcoords="offset points",
        horizontalalignment="right",
        color=_LOOK.soft,
    )
    for name, label, color in (
        ("cpu_real_time_factor", "rr1plan, per CPU second", _SECOND),
        ("real_time_factor", "rr1plan, per second", _OURS),
    ):
        lowest: dict[float, float] = {}
        for row in rows:
            lowest[row[key]] = min(row[name], lowest.get(row[key], float("inf")))
        _line(plot, lowest, label, color)
    _line(plot, {float(n): factor for n, factor in thesis.items()}, "thesis: Gazebo", _THESIS, dashed=True)
    _label(plot, key, "real-time factor", title)


def _static_steps(plot: mpl_axes.Axes, rows: Sequence[Row]) -> None:
    _line(plot, _values(rows, "boats", "step_us"), "", _OURS)
    _from_zero(plot)
    _label(plot, "boats", "step, median [µs]", "Time of a step of 2 ms")


def _static_memory(plot: mpl_axes.Axes, rows: Sequence[Row]) -> None:
    _line(plot, _values(rows, "boats", "memory_mb"), "", _OURS)
    _from_zero(plot)
    _label(plot, "boats", "memory [MB]", f"Memory, {rows[0]['triangles']:,} triangles each")


def _tower_factors(plot: mpl_axes.Axes, rows: Sequence[Row]) -> None:
    _factors(plot, rows, "boats", TOWER_FACTORS, "Falling tower, slowest two seconds")


def _tower_penetration(plot: mpl_axes.Axes, rows: Sequence[Row]) -> None:
    plot.set_xscale("log")
    most: dict[float, float] = {}
    for row in rows:
        most[row["boats"]] = max(row["penetration_mm"], most.get(row["boats"], 0.0))
    _line(plot, most, "as it falls", _OURS)
    _line(plot, _values(rows, "boats", "penetration_at_end_mm"), "at the end", _SECOND)
    _from_zero(plot)
    _label(plot, "boats", "deepest penetration [mm]", "Boats are 480 mm high")


def _arm_factors(plot: mpl_axes.Axes, rows: Sequence[Row]) -> None:
    _factors(plot, rows, "arms", GAZEBO_FACTORS, "Arms that follow seven poses")


def _arm_errors(plot: mpl_axes.Axes, rows: Sequence[Row]) -> None:
    plot.set_xscale("log")
    _line(plot, {row["arms"]: 1e3 * row["tracking_error_rad"] for row in rows}, "", _OURS)
    _from_zero(plot)
    _label(plot, "arms", "largest tracking error [mrad]", "Tracking")


def _latencies(plot: mpl_axes.Axes, rows: Sequence[Row], what: str, title: str) -> None:
    plot.set_xscale("log")
    plot.set_yscale("log")
    _line(plot, _values(rows, "bytes", f"{what}_median_ms"), "median", _OURS)
    _line(plot, _values(rows, "bytes", f"{what}_p95_ms"), "95th percentile", _SECOND, dashed=True)
    _label(plot, "size of the message", "time [ms]", title)
    plot.xaxis.set_major_formatter(EngFormatter(unit="B"))


FIGURES: Mapping[str, Callable[[Sequence[Row]], Figure]] = {
    "static": _figure(_static_steps, _static_memory),
    "dynamic": _figure(_tower_factors, _tower_penetration),
    "multi": _figure(_arm_factors, _arm_errors),
    "latency": _figure(
        lambda plot, rows: _latencies(plot, rows, "latency", "Until it is parsed"),
        lambda plot, rows: _latencies(plot, rows, "round_trip", "Until it is acknowledged"),
    ),
}
