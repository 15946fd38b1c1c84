"""Motions of 2 to 100 RR1 on one clock: how many problems are solved, how soon, and how short the motions are.

    python benchmarks/many_arms.py [--sets ring grid shelf] [--arms 2 4 8 16 32 64 100] [--seeds 5]

`ring`: the tool of each arm has to get where that of its neighbor was, around a plank; `grid`: random queries
over the full range of the joints at several spacings; `shelf`: two arms before a shelf. Each problem is a process that
has planned for two arms before. A plan counts when the referee certifies it; with `--step`, Coal looks for
contacts at instants besides.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from shared import heading, make_parser, number, pin_to_core, save, table, track

import rr1plan as rp
from rr1plan.multi import dual_arm_shelf, plan_many_arms, random_grid, ring_swap

# The farthest that RR1's tool gets from its shoulder, and from the axis of its shoulder [m].
_REACH, _HORIZONTAL_REACH = 0.85, 0.64
_SPACINGS = (0.94 * _REACH, 0.94 * _HORIZONTAL_REACH)
_RADII = {2: 0.38, 8: 0.6}  # of rings; the others 0.5 [m]
_RINGS = (2, 3, 4, 6, 8)
_SETS = ("ring", "grid", "shelf")


def main(argv: Sequence[str] | None = None) -> int:
    parser = make_parser(__doc__.splitlines()[0], "many_arms")
    parser.add_argument("--sets", nargs="+", choices=_SETS, default=_SETS, help="which problems")
    parser.add_argument("--arms", type=int, nargs="+", default=(2, 4, 8, 16, 32, 64, 100), help="arms on the grid")
    parser.add_argument("--rings", type=int, nargs="+", default=_RINGS, help="arms in the ring")
    parser.add_argument("--spacings", type=float, nargs="+", default=_SPACINGS, help="of the grid [m]")
    parser.add_argument("--seeds", type=int, default=5, help="problems of each kind")
    parser.add_argument("--limit", type=float, default=60.0, help="budget of a plan [s]")
    parser.add_argument("--step", type=float, default=0.0, help="time between Coal's looks [s]; 0: none")
    parser.add_argument("--child", help=argparse.SUPPRESS)
    args = parser.parse_args(argv)
    pin_to_core(args.core)
    if args.child is not None:
        print(json.dumps(_measure(json.loads(args.child))))
        return 0
    results = [task | _ask(task) for task in track(_tasks(args), "many arms")]
    results = [result for result in results if "skipped" not in result]
    cells = _cells(results)
    facts = {"seeds": args.seeds, "limit": f"{args.limit:g} s"}
    text = "\n\n".join([heading("Motions of many arms", facts), _table(cells), _failures(results)])
    save(args.out, "many_arms", {"results": results, "cells": cells}, text)
    return 0


def _tasks(args: argparse.Namespace) -> list[dict[str, Any]]:
    kinds: list[dict[str, Any]] = []
    if "ring" in args.sets:
        kinds += [{"set": "ring", "arms": n, "size": _RADII.get(n, 0.5)} for n in args.rings]
    if "grid" in args.sets:
        kinds += [{"set": "grid", "arms": n, "size": size} for size in args.spacings for n in args.arms]
    if "shelf" in args.sets:
        kinds.append({"set": "shelf", "arms": 2, "size": 0.6})
    common = {"limit": args.limit, "step": args.step}
    return [kind | common | {"seed": args.seed + seed} for kind in kinds for seed in range(args.seeds)]


def _ask(task: Mapping[str, Any]) -> dict[str, Any]:
    """Measure one problem in a new process; or the reason why that failed."""
    command = [sys.executable, str(Path(__file__).resolve()), "--child", json.dumps(dict(task))]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=600.0 + 2.0 * task["limit"])
    except subprocess.TimeoutExpired:
        return {"failed": "no answer", "solved": False}
    if done.returncode != 0:
        return {"failed": done.stderr.strip().splitlines()[-1], "solved": False}
    answer: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return answer


def _problem(task: Mapping[str, Any]) -> rp.Problem:
    robot = rp.load_robot("rr1")
    if task["set"] == "ring":
        return ring_swap(robot, task["arms"], task["size"], rng=task["seed"])
    if task["set"] == "shelf":
        return dual_arm_shelf(robot, task["size"], task["seed"])
    return random_grid(robot, task["arms"], task["size"], task["seed"])


def _measure(task: Mapping[str, Any]) -> dict[str, Any]:
    try:
        problem = _problem(task)
    except rp.InputError as error:
        return {"skipped": str(error)}
    warm = plan_many_arms(random_grid(rp.load_robot("rr1"), 2, 0.7, 0), rng=0)
    if warm.trajectory is not None:
        rp.validate(warm.trajectory, random_grid(rp.load_robot("rr1"), 2, 0.7, 0).scene)
    begin, cpu = time.perf_counter(), time.process_time()
    result = plan_many_arms(problem, rng=task["seed"], budget=rp.Budget(seconds=task["limit"]))
    seconds, cpu = time.perf_counter() - begin, time.process_time() - cpu
    answer: dict[str, Any] = {"seconds": seconds, "cpu": cpu, "solved": False, "memory": _memory()}
    answer["stages"] = [group.stage for group in result.groups]
    if result.trajectory is None:
        return answer | {"failed": result.reason}
    begin = time.perf_counter()
    report = rp.validate(result.trajectory, problem.scene, problem)
    answer |= {
        "solved": bool(report.certified),
        "referee": time.perf_counter() - begin,
        "makespan": result.makespan,
        "ratio": result.ratio,
        "length": result.path_length,
        "waiting": result.waiting,
        "memory": _memory(),
    }
    if task["step"] > 0.0:
        checker = rp.CollisionChecker(problem.scene, problem.arms)
        instants = result.trajectory.sample(task["step"])[1]
        answer |= {"looks": len(instants), "contacts": sum(not checker.is_free_slowly(q) for q in instants)}
    return answer


def _memory() -> float:
    """The most memory that this process has had [MB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1e6 if sys.platform == "darwin" else 1e3)


def _cells(results: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Figures of each kind of problem, medians over those that were solved."""
    cells: dict[tuple[str, float, int], list[Mapping[str, Any]]] = {}
    for result in results:
        cells.setdefault((result["set"], result["size"], result["arms"]), []).append(result)
    rows = []
    for (name, size, arms), group in cells.items():
        solved = [r for r in group if r["solved"]]
        row: dict[str, Any] = {"set": name, "size": size, "arms": arms, "problems": len(group), "solved": len(solved)}
        for key in ("seconds", "cpu", "referee", "ratio", "makespan", "waiting", "memory"):
            row[key] = float(np.median([r[key] for r in solved])) if solved else float("nan")
        row["slowest"] = max((r["seconds"] for r in solved), default=float("nan"))
        row["contacts"] = sum(r.get("contacts", 0) for r in solved)
        stages = [stage for r in solved for stage in r["stages"]]
        row["stages"] = {stage: stages.count(stage) for stage in dict.fromkeys(stages)}
        rows.append(row)
    return rows


def _table(cells: Sequence[Mapping[str, Any]]) -> str:
    header = ["problems", "size [m]", "arms", "solved", "median [s]", "CPU [s]", "slowest [s]", "referee [s]"]
    header += ["makespan / bound", "makespan [s]", "waiting [s]", "memory [MB]", "groups solved by"]
    rows = []
    for c in cells:
        share = f"{c['solved']} of {c['problems']}"
        stages = ", ".join(f"{stage} {count}" for stage, count in c["stages"].items()) or "-"
        keys = ("seconds", "cpu", "slowest", "referee", "ratio", "makespan", "waiting", "memory")
        rows.append([c["set"], number(c["size"]), c["arms"], share, *(number(c[key]) for key in keys), stages])
    return table(header, rows)


def _failures(results: Sequence[Mapping[str, Any]]) -> str:
    lines = [
        f"- {r['set']} of {r['arms']} at {r['size']:.2f} m, seed {r['seed']}: {r.get('failed', 'not certified')}"
        for r in results
        if not r["solved"]
    ]
    return "\n".join(["Not solved:", *lines]) if lines else "All solved."


if __name__ == "__main__":
    sys.exit(main())
