"""Time from the drop of an obstacle to a proven motion: pages with their own planner, compared with the program.

    python benchmarks/page_planning.py [--drags 200] [--drops 100] [--scene rr1_cluttered]

Each drag moves one obstacle and plans between two random configurations that are free afterwards. The page, in headless
Chromium, moves the obstacle in its tables, plans, shortens, retimes, and proves the motion with the referee
(`planner.js`). The program does the same with a changed scene and `plan_motion`, so its collision tables are built
again, and its referee also finds smallest clearances. Both use the same seeds, and the motions are compared bit by bit.
Drags for which either finds no motion within the budget of iterations are counted, not timed. Times are wall times, but
the program's `all` is CPU time, which other processes do not affect.

Drops are the same from a user's perspective: the mouse drags an obstacle by its handle and releases it, with "Plan on
drop" enabled. Times are from the timestamp of the event until the page plans, until the proven motion plays, and until
its first picture has been drawn.
"""

from __future__ import annotations

import argparse
import math
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from time import perf_counter, process_time
from typing import Any

import numpy as np
from shared import heading, make_parser, number, save, spread, table, track

import rr1plan as rp
from rr1plan.collision import CollisionChecker
from rr1plan.errors import Rr1PlanError
from rr1plan.kernels.wasm_core import core_module
from rr1plan.playback.viewer.page_capture import open_browser
from rr1plan.validation.wasm_referee import referee_module

_ITERATIONS = 900
_SHIFT = (0.12, 0.12, 0.04)  # standard deviation of a drag [m]
_STAGES = ("move", "plan", "shorten", "retime", "certify", "all")
_FIXED = ("floor", "ground", "bench", "table")
# Moves an obstacle and plans; times in seconds, and the ends of the pieces of the motion.
_DRAG = """([name, pose, start, goal, seed, iterations]) => {
  const began = performance.now();
  RR1.planner.moveObstacle(name, pose);
  const moved = performance.now();
  const found = RR1.planner.plan(start, goal, { seed, iterations, seconds: 1e3 });
  const ended = performance.now();
  const seconds = { move: (moved - began) / 1e3, ...found.seconds, all: (ended - began) / 1e3 };
  return { seconds, certified: found.certified, breaks: found.track ? [...found.track.breaks.values] : [] };
}"""

# Records for each drop when the page started to plan, played a proven motion, and had drawn its first picture [ms].
_WATCH = """() => {
  const { editing, stage } = RR1, plan = editing.plan.bind(editing), draw = stage.draw.bind(stage);
  window.drop = null;
  editing.planOnDrop = true;
  editing.plan = async () => {
    const drop = { began: performance.now(), plays: null, ended: false };
    window.drop = drop;
    const answer = await plan();
    if (answer && answer.certified && RR1.playing) drop.plays = performance.now();
    drop.ended = true;
    return answer;
  };
  window.addEventListener("pointerup", (event) => { if (window.drop) window.drop.dropped ??= event.timeStamp; });
  stage.draw = () => {
    draw();
    if (window.drop && window.drop.plays && RR1.player.fraction > 0) window.drop.drawn ??= performance.now();
  };
}"""
_ASK = """([name, start, goal]) => {
  const { editing } = RR1;
  window.drop = null;
  RR1.pause();
  editing.setEnd("start", Float64Array.from(start));
  editing.setEnd("goal", Float64Array.from(goal));
  editing.open();
  editing.select({ kind: "obstacle", arm: -1, name, element: name });
}"""
# The records of a drop, once the first picture has been drawn; after five seconds in any case.
_SEEN = """() => new Promise((resolve) => {
  const end = performance.now() + 5e3;
  const look = () => {
    const { drop } = window, done = drop && drop.ended && (!drop.plays || drop.drawn);
    if (done || performance.now() > end) resolve(drop); else requestAnimationFrame(look);
  };
  look();
})"""
_DROPS = {"began": "the page plans", "plays": "a proven motion plays", "drawn": "its first picture is drawn"}

Drag = tuple[str, rp.Scene, np.ndarray, np.ndarray]


def main(argv: Sequence[str] | None = None) -> int:
    args = _arguments(argv)
    scene = rp.load_scene(args.scene)
    drags = make_drags(scene, args.drags + args.warm_up, np.random.default_rng(args.seed))
    results = []
    try:
        with tempfile.TemporaryDirectory() as folder, open_browser((640, 480)) as browser:
            file, plain = (Path(folder) / name for name in ("page.html", "plain.html"))
            rp.save_html(file, scene)
            rp.save_html(plain, scene, options=rp.ViewOptions(planner=False))
            page = browser.new_page()
            page.goto(file.as_uri())
            page.wait_for_function("() => window.RR1 && RR1.planner")
            for seed, drag in enumerate(track(drags, "drags")):
                results.append(measure(page, drag, seed))
            page.close()
            drops = measure_drops(browser.new_page(), file, drags[: args.drops], np.random.default_rng(args.seed))
            sizes = {"page": file.stat().st_size, "page without it": plain.stat().st_size}
    except Rr1PlanError as error:
        print(f"page_planning.py needs a Chromium and playwright: {error}", file=sys.stderr)
        return 1
    sizes |= {"core.wasm": len(core_module()), "referee.wasm": len(referee_module())}
    results = results[args.warm_up :]
    timed = [row for row in results if row["page"]["certified"] and row["program"]["certified"]]
    facts = {
        "scene": f"{args.scene}, {len(scene.obstacles)} obstacles",
        "drags": f"{len(results)}, of which {len(timed)} have a motion",
        "motions equal to the last bit": sum(row["equal"] for row in timed),
        "drops by the mouse": f"{args.drops}, of which {len(drops)} have a motion",
        "sizes [kB]": ", ".join(f"{name} {number(size / 1e3)}" for name, size in sizes.items()),
    }
    text = f"{heading('Planning in a page', facts)}\n\n{_table(timed)}\n\n{_drop_table(drops)}"
    save(args.out, "page_planning", {"results": results, "drops": drops, "sizes": sizes}, text)
    return 0


def _arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = make_parser(__doc__.splitlines()[0], "page_planning")
    parser.add_argument("--drags", type=int, default=200, help="how many obstacles are dropped")
    parser.add_argument("--drops", type=int, default=100, help="how many of them by a mouse, seen by a person")
    parser.add_argument("--warm-up", type=int, default=40, help="drags before the first that counts")
    parser.add_argument("--scene", default="rr1_cluttered", help="a scene that ships with rr1plan")
    return parser.parse_args(argv)


def make_drags(scene: rp.Scene, count: int, rng: np.random.Generator) -> list[Drag]:
    """Obstacles, the scene after each is dropped, and two configurations that are free in that scene."""
    loose, drags = [name for name in scene.obstacles if name not in _FIXED], []
    lower, upper = (np.clip(row, -math.pi, math.pi) for row in (scene.limits().lower, scene.limits().upper))
    first = dict(scene.obstacles)
    while len(drags) < count:
        name = str(rng.choice(loose))
        T = first[name].pose.copy()
        T[:3, 3] += rng.normal(size=3) * _SHIFT
        dropped = scene.with_obstacle_at(name, T)
        checker, free = CollisionChecker(dropped), []
        for _ in range(1000):
            q = rng.uniform(lower, upper)
            if checker.is_free(q):
                free.append(q)
            if len(free) == 2:
                scene = dropped
                drags.append((name, scene, free[0], free[1]))
                break
    return drags


def measure(page: Any, drag: Drag, seed: int) -> dict[str, Any]:
    """Times of the page and the program for a drag [s], and whether their motions are equal."""
    name, scene, start, goal = drag
    T = scene.obstacles[name].pose
    found = page.evaluate(_DRAG, [name, T.T.ravel().tolist(), start.tolist(), goal.tolist(), seed, _ITERATIONS])
    began, cpu = perf_counter(), process_time()
    # As after a drag: nothing of the changed scene is cached yet.
    changed = scene.with_obstacle_at(name, T)
    moved = perf_counter()
    problem = rp.Problem(changed, start, goal)
    motion = rp.plan_motion(problem, budget=rp.Budget(math.inf, _ITERATIONS), rng=seed)
    cpu = process_time() - cpu
    stages = {"certify" if stage == "validate" else stage: taken for stage, taken in motion.seconds.items()}
    stages["move"] = moved - began + stages.pop("set up", 0.0)
    breaks = motion.trajectory.breaks.tolist() if motion.found else []
    program = {"seconds": stages | {"all": cpu}, "certified": motion.valid}
    equal = breaks == found.pop("breaks")
    return {"obstacle": name, "page": found, "program": program, "equal": equal}


def measure_drops(page: Any, file: Path, drags: Sequence[Drag], rng: np.random.Generator) -> list[dict[str, float]]:
    """Times from the release of an obstacle until the page plans, plays a proven motion, and has drawn it [s]."""
    page.set_viewport_size({"width": 1280, "height": 800})
    page.goto(file.as_uri())
    page.wait_for_function("() => window.RR1 && RR1.planner")
    page.evaluate(_WATCH)
    times = []
    for name, _, start, goal in track(drags, "drops"):
        page.evaluate(_ASK, [name, start.tolist(), goal.tolist()])
        page.wait_for_timeout(50)
        handle = page.locator(".handle.move").bounding_box()
        if handle is None:  # hidden by a card or the edge of the window
            continue
        x, y = handle["x"] + handle["width"] / 2, handle["y"] + handle["height"] / 2
        page.mouse.move(x, y)
        page.mouse.down()
        right, down = rng.uniform(-60.0, 60.0, 2).tolist()
        page.mouse.move(x + right, y + down, steps=4)
        page.wait_for_timeout(100)
        page.mouse.up()
        found = page.evaluate(_SEEN)
        if found and found["plays"] and "drawn" in found:
            times.append({stage: (found[stage] - found["dropped"]) / 1e3 for stage in _DROPS})
    return times


def _drop_table(drops: Sequence[dict[str, float]]) -> str:
    rows = []
    for stage, text in _DROPS.items():
        times = [row[stage] for row in drops]
        of = spread(times)
        rows.append([text, number(1e3 * min(times, default=math.nan)), number(of["median"]), number(of["p95"])])
    return table(["from the drop by the mouse until", "best [ms]", "median [ms]", "p95 [ms]"], rows)


def _table(results: Sequence[dict[str, Any]]) -> str:
    rows = []
    for stage in _STAGES:
        times = [spread(row[side]["seconds"].get(stage, 0.0) for row in results) for side in ("page", "program")]
        rows.append([stage, *(number(of[key]) for of in times for key in ("median", "p95"))])
    header = ["stage", "page median [ms]", "page p95 [ms]", "program median [ms]", "program p95 [ms]"]
    return table(header, rows)


if __name__ == "__main__":
    raise SystemExit(main())
