"""Curves of a trajectory: position, velocity and acceleration of each joint over time, as SVG."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

import numpy as np

from rr1plan.playback.figure_files import PLAIN_TEXT, drawing
from rr1plan.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Safe for color-blind readers (Okabe and Ito 2008); further joints differ by line style.
_COLORS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#22262b")
_DASHES = ("-", "--", ":", "-.")
_INK, _FAINT = "#22262b", "#e3e7ec"
_SAMPLES = 600
_LEGEND = 14  # joints in the legend; with many arms it would be larger than the curves
_ROWS = {"position": "rad or m", "velocity": "rad/s or m/s", "acceleration": "rad/s² or m/s²"}


def trajectory_svg(trajectory: Trajectory) -> str:
    """The curves as SVG text for a page, which scrolls them if it is narrow; equal trajectories give equal text."""
    buffer = io.StringIO()
    with drawing({"font.family": "DejaVu Sans", "font.size": 10, **PLAIN_TEXT}):
        _figure(trajectory).savefig(buffer, format="svg", metadata={"Date": None})
    text = buffer.getvalue()
    return text[text.index("<svg") :].replace("<svg ", '<svg style="width:100%;min-width:640px;height:auto" ', 1)


def _figure(trajectory: Trajectory) -> Figure:
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.6, 6.0), layout="constrained", facecolor="white")
    FigureCanvasSVG(figure)
    axes = figure.subplots(3, 1, sharex=True)
    # Both ends of each piece, so that jumps of the acceleration are vertical.
    breaks = trajectory.breaks if len(trajectory.breaks) <= _SAMPLES else trajectory.breaks[[0, -1]]
    even = np.linspace(trajectory.breaks[0], trajectory.breaks[-1], _SAMPLES)
    times = np.unique(np.concatenate([even, breaks, np.nextafter(breaks[1:], -np.inf)]))
    for row, (axis, (name, unit)) in enumerate(zip(axes, _ROWS.items(), strict=True)):
        values = trajectory(times, row)
        for joint, label in enumerate(trajectory.joint_names):
            color, dash = _COLORS[joint % len(_COLORS)], _DASHES[joint // len(_COLORS) % len(_DASHES)]
            axis.plot(times, values[:, joint], color=color, linestyle=dash, linewidth=1.6, label=label)
        axis.set_ylabel(f"{name}\n[{unit}]", color=_INK)
        axis.grid(color=_FAINT)
        axis.spines[["top", "right"]].set_visible(False)
    axes[-1].set_xlabel("time [s]", color=_INK)
    axes[-1].set_xlim(times[0], max(times[-1], times[0] + 1e-9))
    if len(trajectory.joint_names) <= _LEGEND:
        handles, labels = axes[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside right upper", frameon=False)
    return figure
