"""Time of a new process for the import, the first plan, and the command line.

    python benchmarks/cold_start.py [--count 9]

Each figure is the time of whole processes from start to end, run alternately on one core. Files and Python's bytecode
have been read once before.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import time
from collections.abc import Sequence
from typing import Any

from shared import heading, make_parser, number, pin_to_core, save, spread, table, track

_IMPORT = "import rr1plan"
_PLAN = """
import json, time
stages, last = {{}}, time.perf_counter()
def lap(name):
    global last
    now = time.perf_counter()
    stages[name], last = now - last, now
import rr1plan as rp
lap("import rr1plan")
scene = rp.load_scene({scene!r})
lap("load the scene")
problem = next(iter(rp.load_problems({scene!r}).values()))
lap("load its queries")
import rr1plan.pipeline
lap("load the planner")
motion = rp.plan_motion(problem, rng=0)
lap("first plan")
rp.plan_motion(problem, rng=0)
lap("second plan")
assert motion.valid, motion
print(json.dumps(stages))
"""
# Only up to the first plan, without the second.
_FIRST = "import rr1plan as rp; assert rp.plan_motion(next(iter(rp.load_problems({scene!r}).values())), rng=0).valid"


def main(arguments: Sequence[str] | None = None) -> int:
    parser = make_parser(__doc__.splitlines()[0], "cold_start")
    parser.add_argument("--scene", default="rr1_table", help="a scene; its first query is planned")
    parser.add_argument("--count", type=int, default=9, help="processes for each figure")
    parser.add_argument("--warm-up", type=int, default=1, help="processes before the first that counts")
    args = parser.parse_args(arguments)
    pin_to_core(args.core)
    results = _measure(args)
    report = heading("Cold start", {"scene": args.scene, "processes for each figure": args.count})
    save(args.out, "cold_start", results, report + "\n\n" + _tables(results))
    return 0


def _measure(args: argparse.Namespace) -> dict[str, Any]:
    python = [sys.executable, "-c"]
    commands = {
        "an empty script": [*python, ""],
        "import rr1plan": [*python, _IMPORT],
        "import numpy, pinocchio, coal": [*python, "import numpy, pinocchio, coal"],
        "first plan, from Python": [*python, _FIRST.format(scene=args.scene)],
        "rr1plan plan": [sys.executable, "-m", "rr1plan", "plan", args.scene, "--seed", "0", "--json"],
        "rr1plan robots": [sys.executable, "-m", "rr1plan", "robots"],
    }
    stages = [*python, _PLAN.format(scene=args.scene)]
    for command in args.warm_up * [*commands.values(), stages]:
        _run(command)
    rounds = [
        {**{name: _run(command) for name, command in commands.items()}, "stages": _run(stages)}
        for _ in track(range(args.count), "fresh processes")
    ]
    return {
        "processes": {name: [r[name] for r in rounds] for name in commands},
        "stages": [json.loads(r["stages"]["said"]) for r in rounds],
    }


def _run(command: Sequence[str]) -> dict[str, Any]:
    """CPU and wall time of a process [s], from its start to its end, and its output."""
    # Cache bytecode, as on most machines, even if the environment forbids it.
    kept = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    done = subprocess.run(command, env=kept, capture_output=True, text=True, check=False)
    wall, after = time.perf_counter() - begin, resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode != 0:
        raise RuntimeError(f"{' '.join(command)[:200]} ended with {done.returncode}: {done.stderr[-2000:]}")
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return {"cpu": cpu, "wall": wall, "said": done.stdout}


def _tables(results: dict[str, Any]) -> str:
    rows = []
    for name, runs in results["processes"].items():
        row = [name]
        for key in ("cpu", "wall"):
            times = [run[key] for run in runs]
            row += map(number, (min(times), *(spread(times, 1.0)[k] for k in ("median", "max"))))
        rows.append(row)
    header = ["process", *(f"{clock} {k} [s]" for clock in ("CPU", "wall") for k in ("best", "median", "max"))]
    stages = [
        [name, *map(number, (1e3 * min(times), spread(times)["median"]))]
        for name in results["stages"][0]
        for times in [[run[name] for run in results["stages"]]]
    ]
    return "\n\n".join(
        [table(header, rows), table(["stage of one process", "wall best [ms]", "wall median [ms]"], stages)]
    )


if __name__ == "__main__":
    raise SystemExit(main())
