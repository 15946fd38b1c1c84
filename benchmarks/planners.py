"""Every planner but the Cartesian one on every query of the shipped scenes: success, time, cost.

    python benchmarks/planners.py [--seconds 2]

Planners that stop at their first path are timed until it is found. Optimizing planners use the whole budget: the tables
list the time of their first path and the final cost. The cost is the length of the
path before shortening, as a multiple of the shortest path found for that query by any planner.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from shared import heading, make_parser, number, pin_to_core, save, save_distribution, spread, table, track

import rr1plan as rp
from rr1plan.planners import planner_table


@dataclass(frozen=True)
class Run:
    """One planner on one query with one seed."""

    planner: str
    query: str
    seed: int
    status: str
    first: float  # wall time to the first path [s]
    cpu: float  # CPU time of the whole call [s]
    length: float

    @property
    def solved(self) -> bool:
        """Whether it found a path."""
        return bool(np.isfinite(self.length))


def main(argv: Sequence[str] | None = None) -> int:
    args = _arguments(argv)
    pin_to_core(args.core)
    queries = {f"{scene}/{name}": p for scene in args.scenes for name, p in rp.load_problems(scene).items()}
    queries = dict(list(queries.items())[:: args.every])
    rp.plan(next(iter(queries.values())), rng=0)  # loads modules and kernels
    work = [(p, q, args.seed + s) for p in args.planners for q in queries for s in range(args.repeats)]
    runs = [
        _run(planner, query, queries[query], seed, args.seconds) for planner, query, seed in track(work, "planners")
    ]
    facts = {"queries": len(queries), "seeds": args.repeats, "budget": f"{args.seconds:g} s", "first seed": args.seed}
    text = "\n\n".join([heading("Planners on the queries of the shipped scenes", facts), *_tables(runs)])
    save(args.out, "planners", {"settings": facts, "runs": [vars(r) | {"solved": r.solved} for r in runs]}, text)
    curves = {p: [1e3 * r.first if r.solved else np.inf for r in runs if r.planner == p] for p in args.planners}
    save_distribution(args.out / "planners.png", curves, "time to the first path [ms]")
    return 0


def _arguments(argv: Sequence[str] | None) -> Any:
    parser = make_parser("All planners on the queries of the shipped scenes", "planners")
    names = [row.name for row in planner_table() if row.name != "cartesian"]
    parser.add_argument("--planners", nargs="+", default=names, help="names of planners")
    parser.add_argument("--scenes", nargs="+", default=_scenes(), help="scenes whose queries are planned")
    parser.add_argument("--seconds", type=float, default=2.0, help="budget of each run [s of wall time]")
    parser.add_argument("--repeats", type=int, default=1, help="seeds for each query")
    parser.add_argument("--every", type=int, default=1, help="take every n-th query")
    return parser.parse_args(argv)


def _scenes() -> list[str]:
    """All shipped scenes except the one without a path and those with many arms."""
    without = ("planar2r_no_path", "rr1_ring", "rr1_shared_bin", "rr1_twelve")
    return [name for name in rp.scene_names() if name not in without]


def _run(planner: str, query: str, problem: rp.Problem, seed: int, seconds: float) -> Run:
    began = time.process_time()
    result = rp.plan(problem, planner=planner, budget=rp.Budget(seconds=seconds), rng=seed)
    cpu = time.process_time() - began
    first = result.cost_history[0][0] if result.cost_history else np.inf
    length = np.inf if result.path is None else result.path.length
    return Run(planner, query, seed, result.status.value, first, cpu, length)


def _tables(runs: Sequence[Run]) -> list[str]:
    best: dict[str, float] = {}
    for r in runs:
        best[r.query] = min(best.get(r.query, np.inf), r.length)
    optimizing = {row.name: row.optimizing for row in planner_table()}
    header = [
        "planner",
        "improves",
        "solved",
        "first path median [ms]",
        "p95 [ms]",
        "CPU median [ms]",
        "cost median",
        "p95",
    ]
    rows = []
    for planner in dict.fromkeys(r.planner for r in runs):
        own = [r for r in runs if r.planner == planner]
        done = [r for r in own if r.solved]
        first, cpu = spread(r.first for r in done), spread(r.cpu for r in done)
        cost = spread((r.length / best[r.query] for r in done), 1.0)
        figures = [first["median"], first["p95"], cpu["median"], cost["median"], cost["p95"]]
        share = f"{len(done)} / {len(own)}"
        rows.append([planner, "yes" if optimizing[planner] else "no", share, *map(number, figures)])
    return [table(header, rows), _unsolved(runs)]


def _unsolved(runs: Sequence[Run]) -> str:
    """Planners that failed, by query."""
    lines = []
    for query in dict.fromkeys(r.query for r in runs):
        own = [r for r in runs if r.query == query]
        failed = list(dict.fromkeys(r.planner for r in own if not r.solved))
        if failed:
            lines.append(f"- {query}: {', '.join(failed)}")
    return "\n".join(["Without a path within the budget:", "", *(lines or ["none."])])


if __name__ == "__main__":
    sys.exit(main())
