"""The comparison as one picture: planning times, and fraction of results with a contact."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from comparison import KINDS, WORDS, Run, quantile
from shared import mark_powers, number

_COLORS = ("#c8102e", "#1f4e79", "#6fa0cc", "#d98e04", "#4f8f5b", "#7d5a99", "#6b6b6b", "#2aa6a1")
# Line styles distinguish curves without colors.
_DASHES, _MARKS = ("-", "-", (0, (5, 1.5)), (0, (1, 1)), "-."), "osD^vP*X"
_INK, _FAINT = "#222222", "#8a8a8a"
_TINTS = {"raw": 0.35, "path": 0.65, "timed": 1.0}


def draw(file: Path, runs: Sequence[Run], title: str) -> None:
    """Write the picture (PNG): two distributions of times, and bars of the fraction with a contact."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    ran = [run for run in runs if not run.skipped]
    colors = {run.name: _COLORS[i % len(_COLORS)] for i, run in enumerate(ran)}
    style = {"font.size": 11, "axes.spines.top": False, "axes.spines.right": False, "axes.edgecolor": _FAINT}
    with plt.rc_context({**style, "text.color": _INK, "axes.labelcolor": _INK}):
        figure = plt.figure(figsize=(16, 6.6), layout="constrained")
        grid = figure.add_gridspec(1, 3, width_ratios=[1.0, 1.0, 0.95], wspace=0.04)
        first = figure.add_subplot(grid[0])
        second = figure.add_subplot(grid[1], sharex=first, sharey=first)
        figure.suptitle(title, fontsize=16, fontweight="bold", x=0.008, ha="left")
        _draw_times(first, ran, colors, "plan", "Time to a first path")
        _draw_times(second, ran, colors, "plan + shorten", "Time to a short path")
        _draw_touches(figure.add_subplot(grid[2]), ran, colors)
        figure.legend(
            *first.get_legend_handles_labels(),
            loc="outside lower left",
            title="median to a first path / to a short path",
            alignment="left",
            ncols=4,
            frameon=False,
        )
        file.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(file, dpi=150)
        plt.close(figure)


def _draw_times(axes: Any, runs: Sequence[Run], colors: dict[str, str], column: str, title: str) -> None:
    """Each planner's fraction of problems solved within a time, with the medians of both panels in its label."""
    for i, run in enumerate(runs):
        data = np.sort(run.times(column))
        data = data[np.isfinite(data)]
        if not len(data):
            continue
        share = np.arange(1, len(data) + 1) / len(run.answers)
        medians = [quantile(run.times(c), 0.5) for c in ("plan", "plan + shorten")]
        label = f"{run.name}: {' / '.join('-' if m is None else number(m) for m in medians)} ms"
        own = i == 0
        x, y = np.concatenate([data[:1], data]), 100 * np.concatenate([[0.0], share])
        line = {"color": colors[run.name], "linewidth": 3.2 if own else 1.8, "linestyle": _DASHES[i % len(_DASHES)]}
        axes.step(x, y, where="post", label=label, zorder=20 - i, **line)
    axes.axhline(50.0, color=_FAINT, linewidth=0.8, linestyle=(0, (2, 3)), zorder=0)
    axes.set(xscale="log", ylim=(0, 101.5), xlabel="CPU time [ms]", ylabel="problems solved [%]")
    axes.set_title(title, loc="left", fontweight="bold")
    mark_powers(axes)
    axes.grid(axis="x", which="major", color="#e6e6e6")
    axes.set_axisbelow(True)


def _draw_touches(axes: Any, runs: Sequence[Run], colors: dict[str, str]) -> None:
    """Three bars per planner: raw path, short path, timed motion."""
    height, most = 0.26, 1.0
    for i, run in enumerate(runs):
        for j, kind in enumerate(KINDS):
            touching, judged = run.touching(kind)
            place = i + (j - 1) * height
            share = 100 * touching / judged if judged else 0.0
            most = max(most, share)
            axes.barh(place, share, 0.88 * height, color=colors[run.name], alpha=_TINTS[kind])
            text = f"{share:.0f} %" if share == 0 or share >= 10 else f"{share:.1f} %"
            text = f"{text}  {WORDS[kind]}" if judged else f"no {WORDS[kind]}"
            strong = {"color": _INK, "fontweight": "bold"} if i == 0 else {"color": _INK if judged else _FAINT}
            axes.annotate(text, (share, place), (4, 0), textcoords="offset points", va="center", fontsize=9.5, **strong)
    axes.set_yticks(range(len(runs)), [run.name.replace(" + ", "\n+ ").replace(" at ", "\nat ") for run in runs])
    axes.tick_params(axis="y", length=0)
    for label, run in zip(axes.get_yticklabels(), runs, strict=True):
        label.set(color=colors[run.name], fontweight="bold")
    axes.set(xlim=(0, 1.4 * most), ylim=(len(runs) - 0.5, -0.5), xlabel="share of the results [%]")
    axes.set_xticks([tick for tick in axes.get_xticks() if tick <= 100])
    axes.set_title("In collision at a millimeter", loc="left", fontweight="bold")


def draw_race(file: Path, race: Mapping[str, Sequence[Mapping[str, float]]], budgets: Sequence[float]) -> None:
    """Write a picture (PNG) of the length of paths after each budget [ms], and of the fraction solved by then.

    The first planner is drawn as the baseline, the second as ours.
    """
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    style = {"font.size": 11, "axes.spines.top": False, "axes.spines.right": False, "axes.edgecolor": _FAINT}
    with plt.rc_context({**style, "text.color": _INK, "axes.labelcolor": _INK}):
        figure, (left, right) = plt.subplots(1, 2, figsize=(13, 5.6), layout="constrained")
        figure.suptitle("The length of a path after a while", fontsize=16, fontweight="bold", x=0.008, ha="left")
        baseline, *others = race
        colors = {baseline: _INK, **dict(zip(others, _COLORS, strict=False))}
        for i, (name, columns) in enumerate(race.items()):
            line = {"color": colors.get(name, _INK), "linewidth": 3.2 if i == 1 else 1.8, "zorder": 20 - i}
            line |= {"marker": _MARKS[i % len(_MARKS)], "linestyle": "--" if i == 0 else "-", "label": name}
            left.plot(
                budgets, [100 * (c["median"] - 1.0) if np.isfinite(c["median"]) else np.nan for c in columns], **line
            )
            right.plot(budgets, [100 * c["solved"] for c in columns], **line)
        left.set_title("Median length above the shortest known", loc="left", fontweight="bold")
        left.set(xscale="log", xlabel="budget [ms]", ylabel="longer by [%]")
        left.set_yscale("symlog", linthresh=1.0)
        left.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
        left.set_ylim(0.0, 1.3 * left.get_ylim()[1])
        right.set_title("Problems solved", loc="left", fontweight="bold")
        right.set(xscale="log", xlabel="budget [ms]", ylabel="solved [%]", ylim=(0, 103))
        for axes in (left, right):
            axes.set_xticks(budgets, [f"{b:g}" for b in budgets])
            axes.minorticks_off()
            axes.grid(axis="y", which="major", color="#e6e6e6")
            axes.set_axisbelow(True)
        figure.legend(*left.get_legend_handles_labels(), loc="outside right center", frameon=False)
        file.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(file, dpi=150)
        plt.close(figure)
