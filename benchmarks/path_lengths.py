"""Path length after 10, 100 and 1000 ms: the anytime planner and OMPL's optimizing planners.

    python benchmarks/path_lengths.py [PROBLEMS.json.gz --robot panda.urdf]

All planners use the same certified edges; only the search differs. The baseline is RRT-Connect with one round of
shortcuts, without a budget. Budgets are CPU time: planners read a clock of the process's CPU time. Lengths
are multiples of the shortest length found for a problem by any planner, infinite without a path, also in the
median. Problems whose straight line is free are omitted.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from picture import draw_race
from shared import heading, make_parser, number, pin_to_core, save, table, track

import rr1plan as rp
from rr1plan.collision.checker_pool import checker_from_pool
from rr1plan.planners import planner_table
from rr1plan.scene.motion_bench import problem_set_joints, read_problem_set

_BASELINE = "rrt_connect + shorten"


@dataclass(frozen=True)
class Run:
    """One planner on one problem with one seed and budget."""

    planner: str
    problem: str
    seed: int
    budget: float  # [s]
    length: float  # inf: no path in time


def main(argv: Sequence[str] | None = None) -> int:
    args = _arguments(argv)
    pin_to_core(args.core)
    problems = _problems(args)
    budgets = sorted(ms / 1e3 for ms in args.milliseconds)
    names = [_BASELINE, *args.planners]
    for name in names:
        _solve(name, next(iter(problems.values())), 0, budgets[0])  # loads modules and kernels
    work = [(name, problem, args.seed + s) for problem in problems for s in range(args.repeats) for name in names]
    runs: list[Run] = []
    for name, problem, seed in track(work, "path lengths"):
        with _cpu_clock():
            runs += _run(name, problem, problems[problem], seed, budgets)
    facts = {"problems": len(problems), "seeds": args.repeats, "first seed": args.seed}
    race = {name: summarise([r for r in runs if r.planner == name], _shortest(runs), budgets) for name in names}
    text = "\n\n".join([heading("The length of a path after a while", facts), describe(race, budgets)])
    save(args.out, "path_lengths", {"settings": facts, "race": race, "runs": [vars(r) for r in runs]}, text)
    draw_race(args.out / "path_lengths.png", race, [1e3 * b for b in budgets])
    return 0


def _arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = make_parser("How short a path is after a while", "path_lengths")
    parser.add_argument("file", type=Path, nargs="?", help="MotionBenchMaker problems (.json or .json.gz)")
    parser.add_argument("--robot", type=Path, help="their robot's URDF")
    parser.add_argument("--srdf", type=Path, help="their robot's SRDF (default: beside the URDF)")
    names = [row.name for row in planner_table() if row.optimizing]
    parser.add_argument("--planners", nargs="+", default=names, help="names of planners")
    parser.add_argument("--scenes", nargs="*", default=_scenes(), help="shipped scenes whose queries are planned")
    parser.add_argument("--milliseconds", type=float, nargs="+", default=[10.0, 100.0, 1000.0], help="budgets")
    parser.add_argument("--repeats", type=int, default=1, help="seeds for each problem")
    parser.add_argument("--every", type=int, default=1, help="take every n-th query of the scenes")
    parser.add_argument("--every-problem", type=int, default=1, help="take every n-th problem of the file")
    return parser.parse_args(argv)


def _scenes() -> list[str]:
    """Shipped scenes with a feasible query for one or two arms."""
    without = ("planar2r_no_path", "rr1_ring", "rr1_shared_bin", "rr1_twelve")
    return [name for name in rp.scene_names() if name not in without]


def _problems(args: argparse.Namespace) -> dict[str, rp.Problem]:
    """Problems by name, without those whose straight line is free."""
    found = {f"{scene}/{name}": p for scene in args.scenes for name, p in rp.load_problems(scene).items()}
    found = dict(list(found.items())[:: args.every])
    if args.file is not None:
        if args.robot is None:
            raise rp.InputError("a file of problems needs --robot, the URDF of their robot")
        srdf = args.srdf or args.robot.with_suffix(".srdf")
        file = read_problem_set(args.file, rp.load_robot(args.robot, srdf=srdf, joints=problem_set_joints(args.file)))
        found |= dict(list(file.items())[:: args.every_problem])
    return {name: p for name, p in found.items() if not _is_straight(p)}


def _is_straight(problem: rp.Problem) -> bool:
    result = rp.plan(problem, rng=0)
    return result.path is not None and len(result.path) <= 2


@contextmanager
def _cpu_clock() -> Iterator[None]:
    """Planners read the CPU time of this process as their clock."""
    clock = time.perf_counter
    time.perf_counter = time.process_time
    try:
        yield
    finally:
        time.perf_counter = clock


def _run(name: str, problem: str, question: rp.Problem, seed: int, budgets: Sequence[float]) -> list[Run]:
    """One call per budget; the baseline is run once, without a budget."""
    if name != _BASELINE:
        return [Run(name, problem, seed, b, _solve(name, question, seed, b)) for b in budgets]
    began = time.perf_counter()
    length = _solve(name, question, seed, budgets[-1])
    took = time.perf_counter() - began
    return [Run(name, problem, seed, b, length if took <= b else np.inf) for b in budgets]


def _solve(name: str, problem: rp.Problem, seed: int, seconds: float) -> float:
    """Length of the path [rad]."""
    if name != _BASELINE:
        result = rp.plan(problem, planner=name, budget=rp.Budget(seconds=seconds), rng=seed)
        return np.inf if result.path is None else result.path.length
    result = rp.plan(problem, planner="rrt_connect", budget=rp.Budget(seconds=seconds), rng=seed)
    if result.path is None:
        return np.inf
    with checker_from_pool(problem.scene, problem.arms) as motion:
        return rp.shorten(result.path, problem.scene, checker=motion, rng=seed).length


def _shortest(runs: Sequence[Run]) -> dict[str, float]:
    """The shortest length found by any planner, by problem."""
    best: dict[str, float] = {}
    for r in runs:
        best[r.problem] = min(best.get(r.problem, np.inf), r.length)
    return best


def summarise(runs: Sequence[Run], best: Mapping[str, float], budgets: Sequence[float]) -> list[dict[str, float]]:
    """For each budget, fraction solved, and median and 90th percentile of length as multiples of the shortest."""
    rows = []
    for budget in budgets:
        lengths = np.sort(
            [r.length / best[r.problem] for r in runs if r.budget == budget and np.isfinite(best[r.problem])]
        )
        median, most = (float(lengths[int(share * (len(lengths) - 1))]) for share in (0.5, 0.9))
        rows.append({"solved": float(np.isfinite(lengths).mean()), "median": median, "p90": most})
    return rows


def describe(race: Mapping[str, Sequence[Mapping[str, float]]], budgets: Sequence[float]) -> str:
    """A row for each planner."""
    header = ["planner"]
    for budget in budgets:
        header += [f"{1e3 * budget:g} ms: solved", "median", "p90"]
    rows = []
    for name, columns in race.items():
        cells: list[Any] = [name]
        for column in columns:
            cells += [f"{100 * column['solved']:.0f} %", _times(column["median"]), _times(column["p90"])]
        rows.append(cells)
    return table(header, rows)


def _times(value: float) -> str:
    return f"{value:.3f}" if value < 10.0 else number(value)


if __name__ == "__main__":
    sys.exit(main())
