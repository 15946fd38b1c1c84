"""The report of experiments: tables and figures next to those of the thesis, as Markdown and as one HTML page."""

from __future__ import annotations

import base64
import html
import os
import platform
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from importlib.metadata import version
from pathlib import Path

from rr1plan.experiments.experiment_figures import FIGURES
from rr1plan.experiments.measuring_process import Row
from rr1plan.experiments.thesis_figures import GAZEBO_FACTORS, HARDWARE, TOWER_FACTORS, UNITY_FRAMES
from rr1plan.files.file_access import is_regular, read_text, write_text
from rr1plan.playback.figure_files import save_figure

_CPU_INFO = Path("/proc/cpuinfo")
_META = '<meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">'
_STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; color: #22262b; background: #ffffff;
       max-width: 1100px; margin: 2rem auto; padding: 0 1rem; }
table { border-collapse: collapse; display: block; overflow-x: auto; }
th, td { padding: 0.3rem 0.7rem; text-align: right; border-bottom: 1px solid #e9edf1; vertical-align: bottom; }
td { font-variant-numeric: tabular-nums; }
th, td { font-size: 14px; }
th { border-bottom: 2px solid #667080; }
img { max-width: 100%; margin: 1rem 0; }
.machine { color: #667080; }
.failed { color: #d1003f; }
"""


@dataclass(frozen=True)
class _Section:
    """How an experiment is presented.

    Args:
        title: Heading.
        text: Description of the measurement.
        columns: Headers by the name of the value.
        thesis: Values of the thesis by header, and by the number in the first column.
    """

    title: str
    text: str
    columns: Mapping[str, str]
    thesis: Mapping[str, Mapping[int, float]]


_SECTIONS = {
    "static": _Section(
        "Static scene",
        "One RR1 follows the seven poses next to stationary boats that share one mesh. Contacts are on; steps of "
        "2 ms. The measurements of the thesis in such a scene are not available as numbers.",
        {
            "boats": "boats",
            "triangles": "triangles of each",
            "step_us": "step, median [µs]",
            "real_time_factor": "real-time factor",
            "cpu_real_time_factor": "per CPU second",
            "build_s": "build [s]",
            "memory_mb": "memory [MB]",
        },
        {},
    ),
    "dynamic": _Section(
        "Falling tower",
        "Loose boats of 1 kg, each a hull of 256 triangles, stacked in columns and slightly tilted, fall into"
        ' a heap; steps of 8 ms, `Simulation(solver="cg")`, one thread. Penetrations are the deepest of any '
        "contact; the lowest point is that of all boats when the window ends, the floor is at 0. The thesis: "
        "Gazebo, Table 6.5, where 1 is the maximum.",
        {
            "boats": "boats",
            "from_s": "from [s]",
            "to_s": "to [s]",
            "real_time_factor": "real-time factor",
            "cpu_real_time_factor": "per CPU second",
            "penetration_mm": "penetration [mm]",
            "penetration_at_end_mm": "at the end [mm]",
            "lowest_point_mm": "lowest point [mm]",
            "contacts": "contacts",
        },
        {"thesis: Gazebo": TOWER_FACTORS},
    ),
    "multi": _Section(
        "Many arms",
        "RR1 arms on a grid of 1 m follow the seven poses, 4 s for each move; one controller and one clock, contacts "
        "between arms and with the floor on, steps of 2 ms, one thread. The thesis: real-time factor of Gazebo, which "
        "started at most twelve, and frames per second of Unity, which drew arms but did not simulate contacts; both "
        "from its raw data, because labels of the printed Table 6.6 are off by a column. (`benchmarks/page_frames.py` "
        "measures frames of our page.)",
        {
            "arms": "arms",
            "real_time_factor": "real-time factor",
            "cpu_real_time_factor": "per CPU second",
            "step_us": "step, median [µs]",
            "cpu_us": "CPU [µs]",
            "tracking_error_rad": "tracking error [rad]",
            "contacts": "contacts",
            "start_skew_s": "start skew [s]",
            "memory_mb": "memory [MB]",
        },
        {"thesis: Gazebo": GAZEBO_FACTORS, "thesis: Unity [frames/s]": UNITY_FRAMES},
    ),
    "latency": _Section(
        "Messages from planner to viewer",
        "A live viewer sends messages over its websocket to a client on this machine instead of the page; the client "
        "parses and acknowledges each message before the next one is sent. Latency ends when the message is parsed, "
        "the round trip when the acknowledgment is back. Figure 6.6 of the thesis is not available as numbers.",
        {
            "bytes": "size [bytes]",
            "latency_median_ms": "latency, median [ms]",
            "latency_p95_ms": "95th percentile [ms]",
            "round_trip_median_ms": "round trip, median [ms]",
            "round_trip_p95_ms": "95th percentile [ms]",
        },
        {},
    ),
}


def save_report(folder: Path, results: Mapping[str, Sequence[Row]], failures: Sequence[str]) -> list[Path]:
    """Write figures, `experiments.md` and `experiments.html`, which embeds the figures.

    Args:
        folder: Folder for the files.
        results: Rows by experiment.
        failures: Measurements that failed.

    Returns:
        The files.
    """
    measured = {name: rows for name, rows in results.items() if rows}
    figures = {
        name: save_figure(folder / f"{name}.png", partial(FIGURES[name], rows)) for name, rows in measured.items()
    }
    machine = _machine()
    lines, body = (
        ["# Experiments", "", machine, ""],
        [f"<h1>Experiments</h1><p class=machine>{html.escape(machine)}</p>"],
    )
    for name, rows in measured.items():
        section, file = _SECTIONS[name], figures[name]
        header, cells = _table(section, rows)
        lines += [f"## {section.title}", "", section.text, "", f"![{section.title}]({file.name})", ""]
        lines += _row(header), _row(["---:"] * len(header)), *(_row(row) for row in cells), ""
        picture = base64.b64encode(file.read_bytes()).decode()
        body.append(f"<h2>{section.title}</h2><p>{html.escape(section.text).replace('`', '')}</p>")
        body.append(f'<img alt="{section.title}" src="data:image/png;base64,{picture}">')
        body.append(f"<table><tr>{_html_cells('th', header)}</tr>")
        body += [f"<tr>{_html_cells('td', row)}</tr>" for row in cells] + ["</table>"]
    if failures:
        lines += ["## Not measured", "", *(f"- {text}" for text in failures), ""]
        items = "".join(f"<li>{html.escape(text)}</li>" for text in failures)
        body.append(f"<h2>Not measured</h2><ul class=failed>{items}</ul>")
    head = f"{_META}<title>Experiments</title><style>{_STYLE}</style>"
    page = f'<!doctype html><html lang="en"><head>{head}</head><body>{"".join(body)}</body></html>\n'
    report = [write_text(folder / "experiments.md", "\n".join(lines)), write_text(folder / "experiments.html", page)]
    return [*figures.values(), *report]


def _table(section: _Section, rows: Sequence[Row]) -> tuple[list[str], list[list[str]]]:
    """Header and cells: our values, and those of the thesis for the same number of boats or arms."""
    key = next(iter(section.columns))
    cells = []
    for row in rows:
        own = [_number(row[name]) for name in section.columns]
        cells.append(own + [_number(known.get(int(row[key]))) for known in section.thesis.values()])
    return [*section.columns.values(), *section.thesis], cells


def _number(value: float | None) -> str:
    """Three significant digits; whole numbers unchanged."""
    if value is None or value != value:
        return "-"
    if value == int(value):
        return f"{int(value):,}"
    return f"{value:,.0f}" if abs(value) >= 100 else f"{value:.3g}"


def _row(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _html_cells(tag: str, cells: Sequence[str]) -> str:
    return "".join(f"<{tag}>{html.escape(cell)}</{tag}>" for cell in cells)


def _machine() -> str:
    """The machine and software of the measurements, and the hardware of the thesis."""
    load = f", load {os.getloadavg()[0]:.1f} when they ended" if hasattr(os, "getloadavg") else ""
    packages = f"Python {platform.python_version()}, MuJoCo {version('mujoco')}"
    return (
        f"Measured on {_processor()}, {os.cpu_count()} cores{load}; {packages}; {time.strftime('%Y-%m-%d')}. "
        f"Figures of the thesis: {HARDWARE}. The real-time factor is simulated time per time on the clock, "
        "and per processor time, which other programs affect less."
    )


def _processor() -> str:
    lines = read_text(_CPU_INFO).splitlines() if is_regular(_CPU_INFO) else []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()
