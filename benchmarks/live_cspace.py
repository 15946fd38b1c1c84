"""Time from the move of an obstacle to a drawn configuration space, in the 2R lesson, which follows drags.

    python benchmarks/live_cspace.py [--moves 300] [--resolution 360]

Each move puts one of the five discs somewhere else on a circle, as a drag does. The page, in headless Chromium,
computes the disc's image and the components of free space and draws them (`cells`); its worker plans a path with its
tree and the timed and proven motion, which the page then draws (`all`, without the 3-D view). Wall times are of the
page's clock. `all, CPU` is the processor time of the process that runs the page, with all of its threads, which other
processes do not lengthen; the browser counts it for groups of moves.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from shared import heading, make_parser, number, save, table

import rr1plan as rp
from rr1plan.errors import Rr1PlanError
from rr1plan.playback.viewer.page_capture import open_browser, wait_until

_STAGES = ("cells", "all")
_GROUP = 20  # moves between two readings of the processor time
_MOVES = """async (moves) => {
  const { lesson } = RR1, rows = [];
  for (const [name, x, y] of moves) {
    const began = performance.now(), planned = lesson.edits.moveObstacle(name, x, y), cells = performance.now() - began;
    await planned;
    rows.push({ cells, all: performance.now() - began, path: Boolean(lesson.answer && lesson.answer.track) });
  }
  return rows;
}"""


def main(argv: Sequence[str] | None = None) -> int:
    args = _arguments(argv)
    problem = next(iter(rp.load_problems(args.scene).values()))
    picture = rp.cspace(problem.scene, problem, resolution=args.resolution)
    rng = np.random.default_rng(args.seed)
    moves = make_moves(problem.scene, args.moves + args.warm_up, rng)
    try:
        with tempfile.TemporaryDirectory() as folder, open_browser((1440, 900)) as browser:
            file = picture.save_html(Path(folder) / "page.html", options=rp.ViewOptions(play=False))
            page = browser.new_page()
            page.goto(file.as_uri())
            wait_until(page, "Boolean(window.RR1 && RR1.lesson && RR1.lesson.live)")
            rows, cpu = measure(page, moves)
            cells = page.evaluate("RR1.lesson.chart.plot.size")
    except Rr1PlanError as error:
        print(f"live_cspace.py needs a Chromium and playwright: {error}", file=sys.stderr)
        return 1
    rows, cpu = rows[args.warm_up :], cpu[args.warm_up // _GROUP :]
    facts = {
        "scene": f"{args.scene}, {len(problem.scene.obstacles)} obstacles, {args.resolution} x {args.resolution} cells",
        "picture": f"{cells} x {cells} pixels",
        "moves": f"{len(rows)}, of which {sum(row['path'] for row in rows)} leave a path",
    }
    text = f"{heading('A configuration space that follows a drag', facts)}\n\n{_table(rows, cpu)}"
    save(args.out, "live_cspace", {"rows": rows, "cpu": cpu}, text)
    return 0


def _arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = make_parser(__doc__.splitlines()[0], "live_cspace")
    parser.add_argument("--moves", type=int, default=300, help="how often an obstacle is moved")
    parser.add_argument("--warm-up", type=int, default=100, help="moves before the first that counts")
    parser.add_argument("--resolution", type=int, default=360, help="cells along each axis")
    parser.add_argument("--scene", default="planar2r_path", help="a scene of a planar arm that ships with rr1plan")
    return parser.parse_args(argv)


def make_moves(scene: rp.Scene, count: int, rng: np.random.Generator) -> list[tuple[str, float, float]]:
    """Drags of twenty moves each: an obstacle and its positions on a small circle around its place in the scene."""
    moves: list[tuple[str, float, float]] = []
    names = list(scene.obstacles)
    while len(moves) < count:
        name = str(rng.choice(names))
        x, y = scene.obstacles[name].pose[:2, 3]
        angles, radius = rng.uniform(0.0, 2.0 * np.pi) + 0.1 * np.arange(20), rng.uniform(0.05, 0.25)
        moves += [(name, float(x + radius * np.cos(a)), float(y + radius * np.sin(a))) for a in angles]
    return moves[:count]


def measure(page: Any, moves: Sequence[tuple[str, float, float]]) -> tuple[list[dict[str, Any]], list[float]]:
    """Wall times of each move, and average processor times per move of each group [ms]."""
    session = page.context.browser.new_browser_cdp_session()

    def ticks() -> float:
        processes = session.send("SystemInfo.getProcessInfo")["processInfo"]
        return 1e3 * sum(float(process["cpuTime"]) for process in processes if process["type"] == "renderer")

    rows: list[dict[str, Any]] = []
    cpu = []
    for first in range(0, len(moves), _GROUP):
        before = ticks()
        group = page.evaluate(_MOVES, [list(move) for move in moves[first : first + _GROUP]])
        cpu.append((ticks() - before) / len(group))
        rows += group
    return rows, cpu


def _table(rows: Sequence[dict[str, Any]], cpu: Sequence[float]) -> str:
    lines = []
    for stage in _STAGES:
        values = np.array([row[stage] for row in rows])
        lines.append([stage, *(number(float(v)) for v in (values.min(), *np.percentile(values, [50, 95])))])
    lines.append(["all, CPU", *(number(float(v)) for v in (min(cpu), *np.percentile(cpu, [50, 95])))])
    return table(["stage", "least [ms]", "median [ms]", "p95 [ms]"], lines)


if __name__ == "__main__":
    sys.exit(main())
