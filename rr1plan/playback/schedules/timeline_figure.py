"""The figure of a time line: for each arm a row with motions and waits; arrows from the awaited arm; red conflicts."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.patheffects import withStroke

from rr1plan.checks import counted
from rr1plan.playback.arm_colors import arm_color
from rr1plan.playback.figure_files import Look, break_lines, drawing, look_of, shortened, style_of

if TYPE_CHECKING:
    from rr1plan.playback.schedules.timeline_rows import TimelineRows

_ROW, _TALLEST, _FRAME = 0.46, 11.0, 1.9  # height of a row, maximum of all rows, height of the frame [inch]
_MOST_NAMED = 40  # with more rows, names and arrows for waits are omitted
_MOST_WORDS = 6  # conflicts described in words
_BAR, _REST = 0.62, 0.16  # heights of bars in rows
_NAMES, _LETTER = 1.2, 0.11  # room for the names of arms, and for a letter of the description of a conflict [inch]
_NUMBER = 0.19  # least distance of the numbers of two conflicts [inch]


def draw(line: TimelineRows, width: float, dark: bool) -> Figure:
    """The time line as a matplotlib figure."""
    look = look_of(dark)
    with drawing(style_of(look)):
        rows = min(_TALLEST, _ROW * max(3, len(line.arms)))
        words = _words(line, width)
        figure = Figure(figsize=(width, rows + _FRAME + 0.24 * len(words)), layout="constrained", facecolor=look.paper)
        FigureCanvasAgg(figure)
        axes = figure.subplots()
        _draw_frame(axes, line, look)
        _draw_rows(axes, line, look)
        if len(line.arms) <= _MOST_NAMED:
            _draw_arrows(axes, line)
        _draw_conflicts(axes, line, look, _NUMBER / width)
        if words:
            _name_conflicts(axes, words, look)
        break_lines(figure.suptitle(_title(line), fontsize=16, color=look.ink, x=0.01, ha="left"), 0.98)
        figure.legend(handles=_legend(line, look), loc="outside lower left", ncols=5, frameon=False, fontsize=11.5)
    return figure


def _draw_frame(axes: Axes, line: TimelineRows, look: Look) -> None:
    """Axes, rows and names."""
    count = len(line.arms)
    axes.set_facecolor(look.paper)
    axes.set_xlim(line.start, line.start + (line.makespan * 1.02 or 1.0))
    axes.set_ylim(count - 0.4, -0.6)
    axes.set_xlabel("time [s]")
    for side in ("top", "right", "left"):
        axes.spines[side].set_visible(False)
    axes.tick_params(axis="y", length=0)
    names = [shortened(arm) for arm in line.arms]
    if count <= _MOST_NAMED:
        axes.set_yticks(range(count), names)
        for label in axes.get_yticklabels():
            label.set_color(look.ink)
    else:
        every = -(-count // 20)
        axes.set_yticks(range(0, count, every), names[::every])
    axes.grid(axis="x", color=look.faint, linewidth=1.0)
    axes.set_axisbelow(True)
    axes.axvline(line.start + line.makespan, color=look.ink, linewidth=1.2)


def _draw_rows(axes: Axes, line: TimelineRows, look: Look) -> None:
    """Bars while arms move, thin lines while they wait, ticks where they would have arrived without waiting."""
    for row, arm in enumerate(line.arms):
        color = arm_color(line.numbers[arm])
        spans = [(begin, end - begin) for begin, end in line.motions[arm]]
        axes.broken_barh(spans, (row - _BAR / 2, _BAR), facecolors=color, edgecolors=look.rim, linewidth=0.8)
        rests = [(w.begin, w.end - w.begin) for w in line.waits if w.arm == arm]
        pale = to_rgba(color, 0.45)
        axes.broken_barh(rests, (row - _REST / 2, _REST), facecolors=pale, edgecolors=look.rim, linewidth=0.8)
        alone = line.undelayed.get(arm)
        if alone is not None and line.motions[arm]:
            axes.plot(
                [line.start + alone] * 2, [row - 0.45, row + 0.45], color=look.ink, linewidth=1.6, solid_capstyle="butt"
            )


def _draw_arrows(axes: Axes, line: TimelineRows) -> None:
    """Draw an arrow from the awaited arm to the waiting one, at the time when the latter continues."""
    place = {arm: row for row, arm in enumerate(line.arms)}
    for wait in line.waits:
        for other in wait.others:
            if other not in place:
                continue
            color = arm_color(line.numbers[other])
            down = 1.0 if place[wait.arm] > place[other] else -1.0
            ends = (place[other], place[wait.arm] - down * _REST / 2)
            axes.annotate(
                "",
                xy=(wait.end, ends[1]),
                xytext=(wait.end, ends[0]),
                arrowprops={"arrowstyle": "-|>", "color": color, "linewidth": 1.8, "shrinkA": 0, "shrinkB": 0},
                zorder=4,
            )
            axes.plot([wait.end], [ends[0]], "o", color=color, markersize=6, markeredgecolor="white", zorder=5)


def _draw_conflicts(axes: Axes, line: TimelineRows, look: Look, spacing: float) -> None:
    """A cross in the rows of the arms in contact, connected by a line; numbers refer to the text below.

    Args:
        axes: Where to draw.
        line: The time line.
        look: Colors.
        spacing: Least distance of the numbers in a row, as a share of the time axis.
    """
    place = {arm: row for row, arm in enumerate(line.arms)}
    numbers: list[tuple[int, float, int]] = []  # row, time and number
    for number, (violation, arms) in enumerate(zip(line.conflicts, line.touching, strict=True), start=1):
        rows = sorted(place[arm] for arm in arms)
        if violation.time is None or not rows:
            continue
        times = [violation.time] * len(rows)
        axes.plot(times, rows, color=look.conflict, linewidth=2.2, zorder=6)
        axes.plot(times, rows, "X", color=look.conflict, markersize=12, markeredgecolor=look.paper, zorder=7)
        if number <= _MOST_WORDS:
            numbers.append((rows[0], violation.time, number))
    begin, end = axes.get_xlim()
    free_from: dict[int, float] = {}  # time from which a row has room for a number
    for row, time, number in sorted(numbers):
        at = max(time, free_from.get(row, time))
        free_from[row] = at + spacing * (end - begin)
        text = axes.annotate(
            str(number), (at, row), xytext=(0, 9), textcoords="offset points", ha="center",
            color=look.conflict, fontsize=12, fontweight="bold", zorder=8, clip_on=False,
        )  # fmt: skip
        text.set_path_effects([withStroke(linewidth=3, foreground=look.paper)])


def _words(line: TimelineRows, width: float) -> list[str]:
    """The lines that describe the conflicts, broken where the figure ends."""
    words: list[str] = []
    letters = max(20, int((width - _NAMES) / _LETTER))
    for number, violation in enumerate(line.conflicts[:_MOST_WORDS], start=1):
        words += textwrap.wrap(f"{number}  {violation.message}", letters, subsequent_indent="    ")
    if len(line.conflicts) > _MOST_WORDS:
        words.append(f"and {len(line.conflicts) - _MOST_WORDS} more")
    return words


def _name_conflicts(axes: Axes, words: list[str], look: Look) -> None:
    axes.annotate(
        "\n".join(words), (0.0, 0.0), xycoords="axes fraction", xytext=(0, -48), textcoords="offset points",
        va="top", fontsize=11.5, color=look.conflict, annotation_clip=False,
    )  # fmt: skip


def _legend(line: TimelineRows, look: Look) -> list[Artist]:
    handles: list[Artist] = [Patch(color=look.soft, label="moves")]
    if line.waits:
        handles.append(Line2D([], [], color=look.soft, alpha=0.6, linewidth=4, label="waits"))
    if any(wait.others for wait in line.waits) and len(line.arms) <= _MOST_NAMED:
        handles.append(
            Line2D([], [], color=look.soft, marker=">", markevery=[1], label="goes on after the arm with the dot")
        )
    if any(line.undelayed.values()):
        handles.append(
            Line2D(
                [],
                [],
                color=look.ink,
                marker="|",
                markersize=13,
                markeredgewidth=1.6,
                linestyle="",
                label="end of its path without waiting",
            )
        )
    if line.conflicts:
        handles.append(Line2D([], [], color=look.conflict, marker="X", linestyle="", markersize=10, label="arms touch"))
    return handles


def _title(line: TimelineRows) -> str:
    parts = [f"{line.name}: {counted(len(line.arms), 'arm')}", f"makespan {line.makespan:.2f} s"]
    if line.undelayed:
        slowest = max(line.undelayed.values())
        if slowest > 0.0:
            parts.append(f"{line.makespan / slowest:.2f} times the slowest path without waiting")
    if line.waits:
        parts.append(f"{line.waiting:.2f} s of waiting")
    if line.conflicts:
        parts.append(counted(len(line.conflicts), "conflict"))
    return ", ".join(parts)
