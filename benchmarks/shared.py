"""Common code of all benchmarks: one core, clocks, the machine's name, tables, files, progress."""

from __future__ import annotations

import argparse
import json
import os
import platform
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from rr1plan.kernels.planner_kernels import LIBRARY

console = Console(stderr=True)
_PACKAGES = ("rr1plan", "numpy", "pin", "coal", "ompl", "mujoco", "python-fcl")


def make_parser(description: str, out: str) -> argparse.ArgumentParser:
    """A parser with the options of every benchmark."""
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.ArgumentDefaultsHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("benchmarks/results") / out, help="folder for the results")
    parser.add_argument("--core", type=int, default=-1, help="the core to run on (-1: the last one there is)")
    parser.add_argument("--seed", type=int, default=0, help="seed of everything random")
    return parser


def pin_to_core(core: int) -> int:
    """Pin this process and its children to one core. Returns the number of the core."""
    if not hasattr(os, "sched_setaffinity"):
        return -1
    allowed = sorted(os.sched_getaffinity(0))
    core = core if core in allowed else allowed[-1]
    os.sched_setaffinity(0, {core})
    return core


def machine() -> dict[str, Any]:
    """The machine of this run."""
    return {
        "processor": _processor(),
        "cores": os.cpu_count(),
        "load": round(os.getloadavg()[0], 2) if hasattr(os, "getloadavg") else None,
        "system": platform.platform(),
        "python": platform.python_version(),
        "packages": {name: _version(name) for name in _PACKAGES},
        "kernels": LIBRARY.variants[0] if LIBRARY.variants else None,
        "date": time.strftime("%Y-%m-%d %H:%M"),
    }


def _processor() -> str:
    info = Path("/proc/cpuinfo")
    lines = info.read_text(encoding="utf-8").splitlines() if info.is_file() else []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"


# ---- clocks ------------------------------------------------------------------------------------


@dataclass
class Clock:
    """CPU and wall time of named stages [s]; repeated stages add up."""

    cpu: dict[str, float] = field(default_factory=dict)
    wall: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Time the body of the `with` statement."""
        cpu, wall = time.process_time(), time.perf_counter()
        try:
            yield
        finally:
            self.cpu[name] = self.cpu.get(name, 0.0) + time.process_time() - cpu
            self.wall[name] = self.wall.get(name, 0.0) + time.perf_counter() - wall


def spread(values: Iterable[float], scale: float = 1e3) -> dict[str, float]:
    """Median, 95th percentile, largest and mean, scaled (seconds become milliseconds)."""
    data = np.array(list(values), dtype=np.float64) * scale
    if len(data) == 0:
        return {"median": float("nan"), "p95": float("nan"), "max": float("nan"), "mean": float("nan"), "n": 0}
    return {
        "median": float(np.median(data)),
        "p95": float(np.percentile(data, 95)),
        "max": float(data.max()),
        "mean": float(data.mean()),
        "n": len(data),
    }


def stage_rows(clocks: Sequence[Clock], stages: Sequence[str]) -> list[list[str]]:
    """A row for each stage: CPU median, p95, max and wall median [ms]."""
    rows = []
    for stage in stages:
        cpu = spread(c.cpu[stage] for c in clocks if stage in c.cpu)
        wall = spread(c.wall[stage] for c in clocks if stage in c.wall)
        rows.append([stage, *(number(cpu[k]) for k in ("median", "p95", "max")), number(wall["median"])])
    return rows


STAGE_HEADER = ["stage", "CPU median [ms]", "CPU p95 [ms]", "CPU max [ms]", "wall median [ms]"]


# ---- results -----------------------------------------------------------------------------------


def number(value: float) -> str:
    """Three significant digits, for any magnitude."""
    if not np.isfinite(value):
        return "-"
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:.3g}"


def table(header: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """A table in Markdown, the first column aligned left and the others right."""
    lines = [list(map(str, header)), *[list(map(str, row)) for row in rows]]
    widths = [max(len(line[i]) for line in lines) for i in range(len(header))]
    rule = ["-" * widths[0], *["-" * (w - 1) + ":" for w in widths[1:]]]
    cells = [
        [c.ljust(w) if i == 0 else c.rjust(w) for i, (c, w) in enumerate(zip(x, widths, strict=True))] for x in lines
    ]
    return "\n".join("| " + " | ".join(line) + " |" for line in [cells[0], rule, *cells[1:]])


def heading(title: str, facts: Mapping[str, Any]) -> str:
    """Title, machine and settings of a report in Markdown."""
    m = machine()
    packages = ", ".join(f"{k} {v}" for k, v in m["packages"].items())
    lines = [f"# {title}", "", f"{m['processor']}, {m['cores']} cores, one used; load {m['load']}; {m['date']}.  "]
    lines += [f"{m['system']}, Python {m['python']}; {packages}; kernels {m['kernels']}.  "]
    return "\n".join([*lines, "; ".join(f"{k} {v}" for k, v in facts.items()) + "."])


def save(folder: Path, name: str, data: Mapping[str, Any], text: str) -> None:
    """Write `name`.json and `name`.md into a folder, and print the latter."""
    folder.mkdir(parents=True, exist_ok=True)
    whole = {"machine": machine(), **data}
    (folder / f"{name}.json").write_text(json.dumps(whole, indent=1, default=_plain) + "\n", encoding="utf-8")
    (folder / f"{name}.md").write_text(text.rstrip() + "\n", encoding="utf-8")
    print(text)
    console.print(f"written to {folder}/{name}.json and .md", highlight=False)


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} in the results")


def save_distribution(file: Path, curves: Mapping[str, Sequence[float]], label: str, goal: float | None = None) -> None:
    """Draw cumulative distributions of the values, one curve per name."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(figsize=(8, 4.5), layout="constrained")
    for name, values in curves.items():
        data = np.sort(np.array(values, dtype=np.float64))
        axes.step(data, np.arange(1, len(data) + 1) / max(1, len(data)), where="post", label=name)
    if goal is not None:
        axes.axvline(goal, color="0.6", linestyle=":")
    axes.set(xscale="log", xlabel=label, ylabel="share of the problems", ylim=(0, 1.01))
    mark_powers(axes)
    axes.grid(alpha=0.3)
    axes.legend(loc="lower right")
    file.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(file, dpi=130)
    plt.close(figure)


def mark_powers(axes: Any) -> None:
    """Marks of a logarithmic axis at 1, 2 and 5 of each power of ten, in plain numbers."""
    from matplotlib.ticker import LogLocator, NullFormatter

    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0), numticks=12))
    axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.xaxis.set_minor_formatter(NullFormatter())


def track(items: Sequence[Any], what: str) -> Iterator[Any]:
    """The items, with a progress bar."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, TimeRemainingColumn(), console=console) as bar:
        task = bar.add_task(what, total=len(items))
        for item in items:
            yield item
            bar.advance(task)
