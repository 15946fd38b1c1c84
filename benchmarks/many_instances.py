"""Time and memory by the number of arms in a scene: RR1 on a grid with a spacing of 0.8 m.

    python benchmarks/many_instances.py [--arms 4 16 64 100 256 1000] [--columns plan motion referee edge]

Each figure is measured in a separate process. `plan`: the first query for one arm among static ones, up to the
timed trajectory; `motion`: likewise with its proof. Both are measured in a process that has planned for a single
arm before, and in a new one. `referee`: a motion of 1.5 s of all arms is proven. `edge`: a straight edge of all
arms is certified, on a grid and in a row, and its cost fitted to the arms and the pairs of arms that can meet.
"""

from __future__ import annotations

import argparse
import json
import math
import resource
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import nnls
from shared import heading, make_parser, number, pin_to_core, save, table, track

import rr1plan as rp
from rr1plan.checks import Array

_SPACING = 0.8  # [m]
_DURATION = 1.5  # of the motion that is proven [s]
# Past the hands of the neighboring arms, from one side to the other.
_START, _GOAL = (1.68, -0.37, 0.72, -1.53, 2.71, 0.2), (-1.96, 0.26, 0.9, -1.23, 2.75, -2.08)
_STEP = (0.5, 0.1, 0.3, 0.3, 0.3, 0.3)  # displacement of every joint, if all arms move [rad]
_COLUMNS = ("plan", "motion", "referee", "edge")
_COUNTS = (4, 16, 64, 100, 256, 1000)
_TIMED = 9  # edges are timed so often
# Target times [s].
_GOALS = {
    "plan": {4: 0.005, 16: 0.006, 64: 0.01, 100: 0.015, 256: 0.03, 1000: 0.1},
    "referee": {4: 0.02, 16: 0.1, 64: 0.5, 100: 1.0, 256: 3.0, 1000: 12.0},
}


def main(argv: Sequence[str] | None = None) -> int:
    args = _arguments(argv)
    pin_to_core(args.core)
    if args.child is not None:
        task = json.loads(args.child)
        print(json.dumps(_MEASURES[task["column"]](task) | {"memory": _memory()}))
        return 0
    tasks = _tasks(args)
    results = [task | _ask(task, args.limit) for task in track(tasks, "many arms")]
    facts = {"spacing": f"{_SPACING} m", "time limit of a process": f"{args.limit:g} s"}
    fit = _fit([r for r in results if r["column"] == "edge" and "seconds" in r])
    text = "\n\n".join([heading("Many arms in one scene", facts), *_tables(results, fit)])
    save(args.out, "many_instances", {"results": results, "fit": fit}, text)
    _draw(args.out / "many_instances.png", results, fit)
    return 0


def _arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = make_parser(__doc__.splitlines()[0], "many_instances")
    parser.add_argument("--arms", type=int, nargs="+", default=_COUNTS, help="how many arms stand in the scene")
    parser.add_argument("--columns", nargs="+", choices=_COLUMNS, default=_COLUMNS, help="what is measured")
    parser.add_argument("--most-moving", type=int, default=100, help="most arms that move in an edge")
    parser.add_argument("--limit", type=float, default=120.0, help="seconds after which a process is ended")
    parser.add_argument("--child", help=argparse.SUPPRESS)
    return parser.parse_args(argv)


# ---- processes -----------------------------------------------------------------------------------


def _tasks(args: argparse.Namespace) -> list[dict[str, Any]]:
    tasks: list[dict[str, Any]] = []
    for column in args.columns:
        for arms in sorted(args.arms):
            if column in ("plan", "motion"):
                tasks += [{"column": column, "arms": arms, "warm": warm} for warm in (True, False)]
            elif column == "referee":
                tasks.append({"column": column, "arms": arms})
            elif arms <= args.most_moving:
                tasks += [{"column": column, "arms": arms, "layout": layout} for layout in ("grid", "row")]
    return [task | {"seed": args.seed} for task in tasks]


def _ask(task: Mapping[str, Any], limit: float) -> dict[str, Any]:
    """The measurement of a separate process, or why it failed."""
    command = [sys.executable, str(Path(__file__).resolve()), "--child", json.dumps(dict(task))]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=limit)
    except subprocess.TimeoutExpired:
        return {"failed": f"> {limit:g} s"}
    if done.returncode != 0:
        return {"failed": "ended", "error": done.stderr[-2000:]}
    answer: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return answer


def _memory() -> float:
    """Peak memory of this process [MB]."""
    scale = 1e6 if sys.platform == "darwin" else 1e3
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / scale


def _scene(count: int, layout: str = "grid") -> rp.Scene:
    rows = max(k for k in range(1, math.isqrt(count) + 1) if count % k == 0) if layout == "grid" else 1
    return rp.place_grid(rp.load_robot("rr1"), rows, count // rows, spacing=_SPACING)


# ---- what is measured ----------------------------------------------------------------------------


def _time_plan(task: Mapping[str, Any]) -> dict[str, Any]:
    """The first query for one arm, without the proof."""
    return _time_question(task, lambda progress: progress.stage != "validate")


def _time_motion(task: Mapping[str, Any]) -> dict[str, Any]:
    """The first query for one arm, including the proof."""
    return _time_question(task, None)


def _time_question(task: Mapping[str, Any], progress: Callable[[Any], bool] | None) -> dict[str, Any]:
    if task["warm"]:
        alone = _scene(1)
        rp.plan_motion(_question(alone, next(iter(alone.arms))), rng=task["seed"])
    scene = _scene(task["arms"])
    problem = _question(scene, _middle(scene))
    answer = rp.plan_motion  # imported now
    begin = time.perf_counter()
    motion = answer(problem, rng=task["seed"], progress=progress)
    seconds = time.perf_counter() - begin
    found = motion.valid if progress is None else motion.seconds.get("retime", 0.0) > 0.0
    return {"seconds": seconds, "stages": dict(motion.seconds), "found": found}


def _question(scene: rp.Scene, arm: str) -> rp.Problem:
    return rp.Problem(scene, {arm: np.array(_START)}, {arm: np.array(_GOAL)})


def _middle(scene: rp.Scene) -> str:
    """The arm nearest to the center."""
    return min(scene.arms, key=lambda name: float(np.linalg.norm(scene.arms[name].base[:3, 3])))


def _time_referee(task: Mapping[str, Any]) -> dict[str, Any]:
    """The proof of a motion of all arms, in a process that has proven a motion of a single arm."""
    alone = _scene(1)
    rp.validate(_wave(alone, task["seed"]), alone)
    scene = _scene(task["arms"])
    motion = _wave(scene, task["seed"])
    times = []
    for _ in range(2):
        begin = time.perf_counter()
        report = rp.validate(motion, scene)
        times.append(time.perf_counter() - begin)
    return {"seconds": times[0], "again": times[1], "found": bool(report.certified)}


def _wave(scene: rp.Scene, seed: int) -> rp.Trajectory:
    """All arms move to one side, from rest to rest."""
    begin, end = _edge(scene, seed)
    step = (end - begin) / _DURATION ** np.arange(4)[:, None] * np.array([0.0, 0.0, 3.0, -2.0])[:, None]
    step[0] += begin
    return rp.Trajectory(scene.joint_names(), np.array([0.0, _DURATION]), step[None])


def _edge(scene: rp.Scene, seed: int) -> tuple[Array, Array]:
    """A straight edge of all arms, every joint to either side."""
    begin, rng = scene.configuration(), np.random.default_rng(seed)
    step = np.tile(_STEP, len(scene.arms)) * rng.choice([-1.0, 1.0], len(begin))
    return begin, np.clip(begin + step, scene.limits().lower, scene.limits().upper)


def _time_edge(task: Mapping[str, Any]) -> dict[str, Any]:
    """A certified edge of all arms, halved until it is free."""
    scene = _scene(task["arms"], task["layout"])
    begin = time.perf_counter()
    checker = rp.CollisionChecker(scene)
    checker.warm_up()
    made = time.perf_counter() - begin
    q0, q1 = _edge(scene, task["seed"])
    halved = 0
    while not checker.edge_is_free(q0, q1):
        q1, halved = 0.5 * (q0 + q1), halved + 1
    times, before = [], checker.counters.configurations
    for _ in range(_TIMED):
        begin = time.perf_counter()
        checker.edge_is_free(q0, q1)
        times.append(time.perf_counter() - begin)
    configurations = (checker.counters.configurations - before) / _TIMED
    owners = ({scene.owner(a), scene.owner(b)} for a, b in checker.pairs)
    near = {frozenset(both) for both in owners if len(both) == 2}
    return {
        "seconds": float(np.median(times)),
        "set up": made,
        "near": len(near),
        "halved": halved,
        "configurations": configurations,
        "found": True,
    }


_MEASURES = {"plan": _time_plan, "motion": _time_motion, "referee": _time_referee, "edge": _time_edge}


# ---- what came of it -----------------------------------------------------------------------------


def _fit(edges: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """Fit the cost of a configuration of an edge by a cost per arm and a cost per pair of arms that can touch [s].

    Relative errors are minimized, so that few arms count as much as many. The exponent is that of arms alone: 1 if cost
    is proportional to their number.
    """
    if len(edges) < 3:
        return {}
    cost = np.array([r["seconds"] / r["configurations"] for r in edges])
    counts = np.array([[r["arms"], r["near"]] for r in edges], dtype=np.float64)
    (arm, pair), _ = nnls(counts / cost[:, None], np.ones(len(cost)))
    off = counts @ [arm, pair] / cost - 1.0
    exponent = float(np.polyfit(np.log(counts[:, 0]), np.log(cost), 1)[0])
    return {"arm": float(arm), "pair": float(pair), "worst": float(np.abs(off).max()), "exponent": exponent}


def _tables(results: Sequence[Mapping[str, Any]], fit: Mapping[str, float]) -> list[str]:
    parts = []
    names = {
        ("plan", True): "first plan, without its proof",
        ("plan", False): "the same, first question of the process",
        ("motion", True): "first `plan_motion`",
        ("motion", False): "the same, first question of the process",
        ("referee", None): f"proof of {_DURATION} s of all arms",
    }
    counts = sorted({r["arms"] for r in results})
    for quantity, unit in (("seconds", "ms"), ("memory", "MB")):
        rows = []
        for (column, warm), name in names.items():
            own = {r["arms"]: r for r in results if r["column"] == column and r.get("warm") == warm}
            if own:
                scale = 1e3 if quantity == "seconds" else 1.0
                rows.append([name, *(_cell(own.get(n), quantity, scale) for n in counts)])
            if own and quantity == "seconds" and warm is not False and column in _GOALS:
                rows.append(["goal", *(number(1e3 * _GOALS[column].get(n, np.nan)) for n in counts)])
        if rows:
            parts.append(table([f"arms in the scene [{unit}]", *counts], rows))
    parts += _stage_table(results, counts)
    edges = [r for r in results if r["column"] == "edge"]
    if edges:
        header = ["edge of all arms", "arms", "pairs that can meet", "set up [ms]", "edge [us]", "a configuration [us]"]
        rows = [
            [
                r["layout"],
                r["arms"],
                r.get("near", "-"),
                _cell(r, "set up", 1e3),
                _cell(r, "seconds", 1e6),
                number(1e6 * r["seconds"] / r["configurations"]) if "seconds" in r else "-",
                _cell(r, "memory", 1.0),
            ]
            for r in edges
        ]
        parts.append(table([*header, "memory [MB]"], rows))
    if fit:
        parts.append(
            f"A configuration takes {1e6 * fit['arm']:.3g} us for each arm and {1e6 * fit['pair']:.3g} us for each "
            f"pair of arms that can meet; none of the figures is off by more than {100 * fit['worst']:.0f} %. "
            f"It grows with the arms to the power of {fit['exponent']:.2f}."
        )
    return parts


def _stage_table(results: Sequence[Mapping[str, Any]], counts: Sequence[int]) -> list[str]:
    """The stages of the first query, in a process that has answered one before."""
    column = "motion" if any(r["column"] == "motion" for r in results) else "plan"
    own = {r["arms"]: r["stages"] for r in results if r["column"] == column and r["warm"] and "stages" in r}
    stages = list(dict.fromkeys(stage for stages in own.values() for stage in stages if stage != "imports"))
    rows = [[s, *(number(1e3 * own[n][s]) if s in own.get(n, {}) else "-" for n in counts)] for s in stages]
    return [table(["stage [ms]", *counts], rows)] if rows else []


def _cell(result: Mapping[str, Any] | None, key: str, scale: float) -> str:
    if result is None:
        return "-"
    if "failed" in result:
        return str(result["failed"]) if key == "seconds" else "-"
    return number(scale * result[key]) + ("" if result["found"] or key != "seconds" else " (not proven)")


def _draw(file: Path, results: Sequence[Mapping[str, Any]], fit: Mapping[str, float]) -> None:
    """Write a picture (PNG): times over the arms with the targets, and the cost of an edge with its fit."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    figure, (left, right) = plt.subplots(1, 2, figsize=(13, 5.2), layout="constrained")
    lines = {("plan", True): "one arm plans", ("motion", True): "one arm plans, with the proof"}
    lines |= {("referee", None): "all arms: the proof"}
    for i, ((column, warm), name) in enumerate(lines.items()):
        own = [r for r in results if r["column"] == column and r.get("warm") == warm and "seconds" in r]
        if own:
            left.plot([r["arms"] for r in own], [1e3 * r["seconds"] for r in own], "o-", color=f"C{i}", label=name)
        if own and column in _GOALS:
            goal = {n: 1e3 * s for n, s in _GOALS[column].items()}
            left.plot(list(goal), list(goal.values()), ":", color=f"C{i}", label=f"{name}: goal")
    left.set(xscale="log", yscale="log", xlabel="arms in the scene", ylabel="time [ms]")
    left.set_title("First answer in a scene", loc="left", fontweight="bold")
    for mark, layout in (("o", "grid"), ("s", "row")):
        own = [r for r in results if r["column"] == "edge" and r["layout"] == layout and "seconds" in r]
        if own:
            counts = [r["arms"] for r in own]
            right.plot(counts, [1e6 * r["seconds"] / r["configurations"] for r in own], mark, label=f"in a {layout}")
            if fit:
                fitted = [1e6 * (fit["arm"] * r["arms"] + fit["pair"] * r["near"]) for r in own]
                right.plot(counts, fitted, "--", color="0.5", label=f"fit, in a {layout}")
    right.set(xscale="log", yscale="log", xlabel="arms that move", ylabel="a configuration of an edge [us]")
    right.set_title("A certified edge of all arms", loc="left", fontweight="bold")
    for axes in (left, right):
        axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
        axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
        axes.grid(alpha=0.3)
        if axes.has_data():
            axes.legend()
    file.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(file, dpi=130)
    plt.close(figure)


if __name__ == "__main__":
    sys.exit(main())
