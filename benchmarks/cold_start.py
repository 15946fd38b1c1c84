"""How long a fresh process takes until it is of use: import, first plan, the command line, and the first time ever.

    python benchmarks/cold_start.py [--count 9] [--no-compile]

Each figure is of processes of their own, one after the other on one core. Python's and numba's caches are in a folder
of their own: empty for the first time ever, warm for all others. With --no-compile they are those of everyday.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
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
assert motion.solved, motion
print(json.dumps(stages))
"""
# Only up to the result of the first plan, without the second.
_FIRST = "import rr1plan as rp; assert rp.plan_motion(next(iter(rp.load_problems({scene!r}).values())), rng=0).solved"


def main(arguments: Sequence[str] | None = None) -> int:
    parser = make_parser(__doc__.splitlines()[0], "cold_start")
    parser.add_argument("--scene", default="rr1_table", help="a scene; its first query is planned")
    parser.add_argument("--count", type=int, default=9, help="processes for each figure")
    parser.add_argument("--no-compile", action="store_true", help="not the first time ever; with the caches there are")
    args = parser.parse_args(arguments)
    pin_to_core(args.core)
    with tempfile.TemporaryDirectory() as folder:
        results = _measure(args, None if args.no_compile else folder)
    report = heading("Cold start", {"scene": args.scene, "processes for each figure": args.count})
    save(args.out, "cold_start", results, report + "\n\n" + _tables(results))
    return 0


def _measure(args: argparse.Namespace, folder: str | None) -> dict[str, Any]:
    python = [sys.executable, "-c"]
    commands = {
        "an empty script": [*python, ""],
        "import rr1plan": [*python, _IMPORT],
        "import numba, pinocchio, coal": [*python, "import numba, pinocchio, coal"],
        "first plan, from Python": [*python, _FIRST.format(scene=args.scene)],
        "rr1plan plan": [sys.executable, "-m", "rr1plan", "plan", args.scene, "--seed", "0", "--json"],
        "rr1plan robots": [sys.executable, "-m", "rr1plan", "robots"],
    }
    first = None
    if folder is not None:
        first = {"first plan ever": _run(commands["first plan, from Python"], folder)}
        first["rr1plan doctor --warm after it"] = _run([sys.executable, "-m", "rr1plan", "doctor", "--warm"], folder)
    stages = [*python, _PLAN.format(scene=args.scene)]
    for command in [*commands.values(), stages] if folder is not None else []:
        _run(command, folder)
    rounds = [
        {**{name: _run(command, folder) for name, command in commands.items()}, "stages": _run(stages, folder)}
        for _ in track(range(args.count), "fresh processes")
    ]
    return {
        "once": first,
        "processes": {name: [r[name] for r in rounds] for name in commands},
        "stages": [json.loads(r["stages"]["said"]) for r in rounds],
    }


def _run(command: Sequence[str], folder: str | None) -> dict[str, Any]:
    """CPU and wall time of a process with caches in a folder [s], from its start to its end, and what it said."""
    changes = {"PYTHONPYCACHEPREFIX": f"{folder}/python", "NUMBA_CACHE_DIR": f"{folder}/numba"} if folder else {}
    kept = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    done = subprocess.run(command, env={**kept, **changes}, capture_output=True, text=True, check=False)
    wall, after = time.perf_counter() - begin, resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode != 0:
        raise RuntimeError(f"{' '.join(command)[:200]} ended with {done.returncode}: {done.stderr[-2000:]}")
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return {"cpu": cpu, "wall": wall, "said": done.stdout}


def _tables(results: dict[str, Any]) -> str:
    rows = []
    for name, runs in results["processes"].items():
        cpu, wall = (spread((r[key] for r in runs), 1.0) for key in ("cpu", "wall"))
        rows.append([name, *(number(s[k]) for s in (cpu, wall) for k in ("median", "max"))])
    parts = [table(["process", "CPU median [s]", "CPU max [s]", "wall median [s]", "wall max [s]"], rows)]
    names = results["stages"][0]
    medians = [[name, number(spread(s[name] for s in results["stages"])["median"])] for name in names]
    parts.append(table(["stage of one process", "wall median [ms]"], medians))
    if results["once"]:
        once = [[name, number(run["cpu"]), number(run["wall"])] for name, run in results["once"].items()]
        parts.append(table(["with empty caches", "CPU [s]", "wall [s]"], once))
    return "\n\n".join(parts)


if __name__ == "__main__":
    raise SystemExit(main())
