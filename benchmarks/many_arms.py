"""Motions of 2 to 100 arms on one clock: problems solved, planning times, and durations of the motions.

    python benchmarks/many_arms.py [--sets ring grid shelf] [--arms 2 4 8 16 32 64 100] [--seeds 5]
    python benchmarks/many_arms.py --sets ring --planners many_arms prioritized ompl_rrt_connect srmp --peers FOLDER
    python benchmarks/many_arms.py --robot panda.urdf --front 1 0 0 --reach 0.855 --sets ring opposite grid

`ring`: the tool of each arm has to reach the start of its neighbor's tool, around a plank; `opposite`: that of the arm
across; `crowd`: from one random point in a ring around a box to another, with goals given as joint values; `grid`:
random queries over the full range of the joints at several spacings; `shelf`: two arms before a shelf; `conveyor`: arms
on both sides of a belt; each tool moves along it into the reach of the next arms. Each problem is solved in a process
that has solved another one of two arms before.

`many_arms` is `plan_many_arms`; `prioritized` schedules one arm after the other on its own path, the slowest first,
and gives up if that fails; any name of `planner_names()` plans all arms as one; `srmp` is SRMP's xECBS in a separate
process, with the same convex hulls. A motion counts if the referee certifies it (`refused`: found, but not certified),
SRMP's if the straight lines between its configurations are certified free; with `--step`, Coal also checks sampled
instants. Success over the spacing of grids and times over the number of arms are drawn, with a power of that number
fitted to the medians.
"""

from __future__ import annotations

import argparse
import gc
import json
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import peers
from plain import write_robot
from shared import heading, make_parser, number, pin_to_core, save, table, track

import rr1plan as rp
from rr1plan import conveyor_line, dual_arm_shelf, plan_many_arms, random_grid, ring_swap
from rr1plan.multi.agents import Agent
from rr1plan.multi.paths.path_pool import PathPool
from rr1plan.multi.portfolio import merged_trajectory
from rr1plan.multi.scenarios.endpoint_sampling import ToolBox, front_of, sample_configurations, tool_in_box
from rr1plan.multi.stopwatch import Stopwatch
from rr1plan.multi.timing.diagram_cache import DiagramCache
from rr1plan.multi.timing.safe_intervals import blocked_times, earliest_schedule
from rr1plan.multi.timing.schedule import Schedule
from rr1plan.scene.placement import place_ring

# Largest distance of RR1's tool from its shoulder, and from the axis of its shoulder [m].
_REACH, _HORIZONTAL_REACH = 0.85, 0.64
# Spacing of the grid, and radii of rings by the number of arms, as multiples of the reach.
_SPACINGS = (0.94, round(0.94 * _HORIZONTAL_REACH / _REACH, 3))
_RADII = {2: 0.45, 8: 0.7, 10: 0.85}
_RADIUS = 0.59  # of other rings
_SHELF = 0.7
_CROWD, _CROWDED = 0.76, 0.8  # radius of a crowded ring over the reach, and of its points over that radius
_RINGS = (2, 3, 4, 6, 8, 10)
_SETS = ("ring", "opposite", "crowd", "grid", "shelf", "conveyor")
_OWN = ("many_arms", "prioritized", "srmp")
_LATE = 0.95  # quantile of times
_LATTICE = 0.05  # largest distance of the end of SRMP's motion from the goal [rad]
_SRMP = peers.Peer("SRMP 0.2.1", "srmp", ("srmp==0.2.1",), "srmp_worker.py", note="xECBS on Coal, its other defaults")


def main(argv: Sequence[str] | None = None) -> int:
    parser = _parser()
    args = parser.parse_args(argv)
    pin_to_core(args.core)
    if args.child is not None:
        print(json.dumps(_measure(json.loads(args.child))))
        return 0
    known = (*_OWN, *rp.planner_names())
    unknown = [name for name in args.planners if name not in known]
    if unknown:
        parser.error(f"no planner {', '.join(unknown)}; there are {', '.join(known)}")
    notes, python = [], None
    if "srmp" in args.planners:
        try:
            python = peers.interpreter(_SRMP, args.peers, {})
        except peers.PeerMissing as missing:
            args.planners = [name for name in args.planners if name != "srmp"]
            notes.append(f"SRMP is left out: {missing}.")
    results = [task | _ask(task, python) for task in track(_tasks(args), "many arms")]
    left_out = {f"{r['set']} of {r['arms']} at {r['size']:.2f} m: {r['skipped']}" for r in results if "skipped" in r}
    notes += (
        ["\n".join(["Left out, no such problem:", *(f"- {text}" for text in sorted(left_out))])] if left_out else []
    )
    results = [result for result in results if "skipped" not in result]
    cells = _cells(results)
    fits = _fits(cells)
    facts = {"robot": args.robot, "reach": f"{args.reach:g} m", "seeds": args.seeds, "limit": f"{args.limit:g} s"}
    facts |= {"improvement": f"{args.improvement:g} s"} if args.improvement else {}
    parts = [heading("Motions of many arms", facts), *notes, _table(cells), _describe(fits), _failures(results)]
    save(args.out, "many_arms", {"results": results, "cells": cells, "fits": fits}, "\n\n".join(filter(None, parts)))
    _draw_success(args.out / "many_arms_success.png", cells, args.reach)
    _draw_times(args.out / "many_arms_times.png", cells, fits)
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = make_parser(__doc__.splitlines()[0], "many_arms")
    parser.add_argument("--sets", nargs="+", choices=_SETS, default=("ring", "grid", "shelf"), help="which problems")
    parser.add_argument("--arms", type=int, nargs="+", default=(2, 4, 8, 16, 32, 64, 100), help="arms on the grid")
    parser.add_argument("--rings", type=int, nargs="+", default=_RINGS, help="arms in the ring")
    parser.add_argument("--conveyors", type=int, nargs="+", default=(4, 8, 16), help="arms along the conveyor")
    parser.add_argument("--spacings", type=float, nargs="+", default=_SPACINGS, help="of the grid, over the reach")
    parser.add_argument("--radii", type=float, nargs="+", help="of rings, over the reach (default: by their arms)")
    parser.add_argument("--seeds", type=int, default=5, help="problems of each kind")
    parser.add_argument("--limit", type=float, default=60.0, help="budget of a plan [s]")
    parser.add_argument(
        "--improvement", type=float, default=0.0, help="time for making plans shorter, within --limit [s]"
    )
    parser.add_argument("--step", type=float, default=0.0, help="time between Coal's looks [s]; 0: none")
    parser.add_argument("--robot", default="rr1", help="a robot's name or its URDF")
    parser.add_argument("--reach", type=float, default=_REACH, help="of its tool [m]")
    parser.add_argument(
        "--front", type=float, nargs=3, help="where its front is in the frame of its base (default: -x)"
    )
    parser.add_argument("--planners", nargs="+", default=("many_arms",), help="which planners, see above")
    parser.add_argument("--peers", type=Path, help="folder of virtual environments, where SRMP is installed if missing")
    parser.add_argument("--child", help=argparse.SUPPRESS)
    return parser


def _tasks(args: argparse.Namespace) -> list[dict[str, Any]]:
    kinds: list[dict[str, Any]] = []
    for name in ("ring", "opposite", "crowd"):
        for n in args.rings if name in args.sets else ():
            radii = args.radii or [_CROWD if name == "crowd" else _RADII.get(n, _RADIUS)]
            # With two arms, the neighbor is the arm across.
            kinds += [{"set": name, "arms": n, "share": share} for share in radii if name != "opposite" or n > 3]
    if "grid" in args.sets:
        kinds += [{"set": "grid", "arms": n, "share": share} for share in args.spacings for n in args.arms]
    if "shelf" in args.sets:
        kinds.append({"set": "shelf", "arms": 2, "share": _SHELF})
    if "conveyor" in args.sets:
        kinds += [{"set": "conveyor", "arms": n, "share": 0.0} for n in args.conveyors]
    common = {
        "limit": args.limit,
        "improvement": args.improvement,
        "step": args.step,
        "robot": args.robot,
        "front": args.front,
    }
    return [
        kind | common | {"size": kind["share"] * args.reach, "planner": planner, "seed": args.seed + seed}
        for kind in kinds
        for planner in args.planners
        for seed in range(args.seeds)
    ]


def _ask(task: Mapping[str, Any], python: Path | None) -> dict[str, Any]:
    """Measure one problem in a new process. Returns the result, or why it failed."""
    command = [sys.executable, str(Path(__file__).resolve()), "--child", json.dumps({**task, "python": str(python)})]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=600.0 + 4.0 * task["limit"])
    except subprocess.TimeoutExpired:
        return {"failed": "no answer", "solved": False}
    if done.returncode != 0:
        return {"failed": done.stderr.strip().splitlines()[-1], "solved": False}
    answer: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return answer


def _problem(task: Mapping[str, Any], robot: rp.Robot) -> rp.Problem:
    front = None if task["front"] is None else np.array(task["front"])
    if task["set"] == "grid":
        return random_grid(robot, task["arms"], task["size"], task["seed"])
    if task["set"] == "shelf":
        return dual_arm_shelf(robot, task["size"], task["seed"], front=front)
    if task["set"] == "conveyor":
        return conveyor_line(robot, task["arms"], task["seed"])
    if task["set"] == "crowd":
        return _crowd(robot, task["arms"], task["size"], task["seed"], front)
    step = 1 if task["set"] == "ring" else task["arms"] // 2
    return ring_swap(robot, task["arms"], task["size"], step, task["seed"], front=front)


def _crowd(robot: rp.Robot, count: int, radius: float, seed: int, front: np.ndarray | None) -> rp.Problem:
    """Arms in a ring around a box on a table; each tool goes from one random point inside the ring to another."""
    far, high, side = _CROWDED * radius, 1.1 * radius, 0.4 * radius
    scene = rp.Scene(name=f"crowded ring of {count}")
    scene = scene.with_obstacle("table", rp.HalfSpace((0.0, 0.0, 1.0), -0.01))
    scene = scene.with_obstacle("box", rp.Box((side, side, side)), (0.0, 0.0, 0.5 * side))
    scene = place_ring(robot, count, radius, front=front_of(robot, front), scene=scene)
    inside = ToolBox(np.eye(4), (-far, -far, 0.15 * radius), (far, far, high))
    draws = {arm: tool_in_box(scene, arm, inside) for arm in scene.arms}
    rng = np.random.default_rng(seed)
    return rp.Problem(scene, sample_configurations(scene, rng, draws), sample_configurations(scene, rng, draws))


# ---- a problem in a process --------------------------------------------------------------------


def _measure(task: Mapping[str, Any]) -> dict[str, Any]:
    robot = rp.load_robot(task["robot"])
    try:
        problem = _problem(task, robot)
    except rp.InputError as error:
        return {"skipped": str(error)}
    if task["planner"] == "srmp":
        return _measure_srmp(task, problem)
    plan = _PLANNERS.get(task["planner"], _plan_as_one)
    warm = _first_problem(task, robot)
    found = plan(warm, task | {"limit": 5.0, "improvement": 0.0})["trajectory"]
    if found is not None:
        rp.validate(found, warm.scene)
    gc.collect()  # what the first problem left behind takes tens of milliseconds
    begin, cpu = time.perf_counter(), time.process_time()
    answer = plan(problem, task)
    seconds, cpu = time.perf_counter() - begin, time.process_time() - cpu
    trajectory = answer.pop("trajectory")
    answer = {"seconds": seconds, "cpu": cpu, "solved": False, "stages": [], "memory": _memory()} | answer
    if trajectory is None:
        return answer
    begin = time.perf_counter()
    report = rp.validate(trajectory, problem.scene, problem)
    answer |= {"solved": bool(report.certified), "referee": time.perf_counter() - begin, "memory": _memory()}
    if not report.certified:
        answer["failed"] = "the referee does not certify it"
    if task["step"] > 0.0:
        checker = rp.CollisionChecker(problem.scene, problem.arms)
        instants = trajectory.sample(task["step"])[1]
        answer |= {"looks": len(instants), "contacts": sum(not checker.is_free_slowly(q) for q in instants)}
    return answer


def _first_problem(task: Mapping[str, Any], robot: rp.Robot) -> rp.Problem:
    """A problem of the same kind for two arms: the first call of a process takes longer, and is not measured."""
    try:
        return _problem(task | {"arms": 2, "seed": task["seed"] + 1000}, robot)
    except rp.InputError:
        return random_grid(robot, 2, 2.0 * (task["size"] or _REACH), 0)


def _plan_many(problem: rp.Problem, task: Mapping[str, Any]) -> dict[str, Any]:
    budget, more = rp.Budget(seconds=task["limit"]), task["improvement"]
    improvement = rp.Budget(seconds=more) if more > 0.0 else None
    result = plan_many_arms(problem, rng=task["seed"], budget=budget, improvement=improvement)
    answer: dict[str, Any] = {"trajectory": result.trajectory, "stages": [group.stage for group in result.groups]}
    if result.trajectory is None:
        return answer | {"failed": result.reason}
    quality = result.quality
    figures = {"makespan": quality.makespan, "ratio": quality.ratio, "waiting": quality.waiting}
    return answer | figures | {"length": quality.path_length, "first_ratio": result.first.ratio}


def _plan_prioritized(problem: rp.Problem, task: Mapping[str, Any]) -> dict[str, Any]:
    """Each arm on its own path, the slowest first, given the schedules of the arms before it."""
    watch, rng, diagrams = Stopwatch(task["limit"]), np.random.default_rng(task["seed"]), DiagramCache()
    pools = [PathPool(Agent(problem, [arm]), 0.0, rng, watch) for arm in problem.arms]
    for pool in pools:
        path, reason = pool.add({}, patient=True)
        if path is None:
            return {"trajectory": None, "failed": reason}
    done: list[Schedule] = []
    paths = sorted((pool.paths[0] for pool in pools), key=lambda path: -path.fastest)
    for path in paths:
        met = [(diagrams.diagram(path, other.path), other.occupancy) for other in done]
        schedule = earliest_schedule(path, blocked_times(path, [(d, o) for d, o in met if d is not None]))
        if schedule is None or not watch.goes_on():
            return {"trajectory": None, "failed": f"no schedule for {path.agent.arms[0]}"}
        done.append(schedule)
    makespan, alone = max(s.arrival for s in done), paths[0].fastest
    figures = {"makespan": makespan, "ratio": makespan / alone, "waiting": sum(s.waiting for s in done)}
    return {"trajectory": merged_trajectory(problem, done), "length": sum(s.length for s in done)} | figures


def _plan_as_one(problem: rp.Problem, task: Mapping[str, Any]) -> dict[str, Any]:
    """All arms in their joint space, shortened and timed, by the planner of the task."""
    budget = rp.Budget(seconds=task["limit"])
    motion = rp.plan_motion(problem, planner=task["planner"], budget=budget, rng=task["seed"])
    if not motion.found:
        return {"trajectory": None, "failed": motion.result.reason}
    nan = float("nan")
    figures = {"makespan": motion.trajectory.duration, "ratio": nan, "waiting": nan}
    figures["length"] = _length_of_arms(problem, motion.path.waypoints)
    return {"trajectory": motion.trajectory} | figures


def _length_of_arms(problem: rp.Problem, waypoints: np.ndarray) -> float:
    """Sum of the lengths of the arms' paths [rad], as in `PlanQuality`."""
    first_columns = np.cumsum([problem.scene.arms[arm].robot.nq for arm in problem.arms])[:-1]
    steps = np.split(np.diff(waypoints, axis=0), first_columns, axis=1)
    return float(sum(np.linalg.norm(own, axis=1).sum() for own in steps))


_PLANNERS = {"many_arms": _plan_many, "prioritized": _plan_prioritized}


def _measure_srmp(task: Mapping[str, Any], problem: rp.Problem) -> dict[str, Any]:
    """SRMP's result, which counts if straight lines between its configurations are certified free."""
    with tempfile.TemporaryDirectory() as folder:
        question = _describe_many(problem, Path(folder))
        with peers.running(_SRMP, Path(task["python"]), task["limit"]) as worker:
            begin = time.perf_counter()
            answer = worker.ask(question | {"name": "problem", "seed": task["seed"]}, 2.0 * task["limit"] + 60.0)
            seconds = time.perf_counter() - begin
    spent = sum(answer["seconds"].values())
    figures: dict[str, Any] = {"seconds": seconds, "cpu": spent, "solved": False, "stages": [], "memory": float("nan")}
    if "raw" not in answer:
        return figures | {"failed": answer.get("failure", "no path")}
    points = np.array(answer["raw"])
    goal = np.concatenate([problem.goal[arm][0].q for arm in problem.arms])
    ends = [np.abs(points[0] - problem.start).max(), np.abs(points[-1] - goal).max()]
    if max(ends) > _LATTICE:
        return figures | {"failed": f"its ends are off by {max(ends):.3g} rad"}
    # It ends at a lattice point; the straight line from there to the goal has to be free, too.
    points = np.concatenate([problem.start[None], points, goal[None]])
    checker, begin = rp.CollisionChecker(problem.scene, problem.arms), time.perf_counter()
    free = checker.path_is_free(points)
    nan = float("nan")
    figures |= {"solved": free, "referee": time.perf_counter() - begin, "makespan": nan, "ratio": nan, "waiting": nan}
    return figures if free else figures | {"failed": "arms touch between its configurations"}


def _describe_many(problem: rp.Problem, folder: Path) -> dict[str, Any]:
    """A problem of many equal arms for a peer; obstacles are boxes."""
    scene = problem.scene
    first = scene.arms[problem.arms[0]].robot
    checked = {frozenset(pair) for pair in scene.checked_pairs}
    links = [f"{problem.arms[0]}/{link.name}" for link in first.links if link.collisions]
    unchecked = [[a.split("/", 1)[1], b.split("/", 1)[1]] for a, b in combinations(links, 2) if {a, b} not in checked]
    starts = scene.split(problem.start, problem.arms)
    arms = [
        {
            "name": arm,
            "base": scene.arms[arm].base.tolist(),
            "start": starts[arm].tolist(),
            "goal": problem.goal[arm][0].q.tolist(),
        }
        for arm in problem.arms
    ]
    obstacles = [
        {"name": f"{name}.{i}", "kind": "box", "size": list(g.shape.size), "pose": (thing.pose @ g.pose).tolist()}
        for name, thing in scene.obstacles.items()
        for i, g in enumerate(thing.geometries)
    ]
    return {"robot": write_robot(first, unchecked, folder), "arms": arms, "obstacles": obstacles}


def _memory() -> float:
    """Peak memory of this process [MB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1e6 if sys.platform == "darwin" else 1e3)


# ---- figures -----------------------------------------------------------------------------------


def _cells(results: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Figures of each kind of problem and planner; medians are over solved problems."""
    cells: dict[tuple[str, str, float, int], list[Mapping[str, Any]]] = {}
    for result in results:
        cells.setdefault((result["planner"], result["set"], result["size"], result["arms"]), []).append(result)
    rows = []
    for (planner, name, size, arms), group in cells.items():
        solved = [r for r in group if r["solved"]]
        row: dict[str, Any] = {"planner": planner, "set": name, "size": size, "share": group[0]["share"]}
        row |= {"arms": arms, "problems": len(group), "solved": len(solved)}
        for key in ("seconds", "cpu", "referee", "first_ratio", "ratio", "makespan", "waiting", "memory"):
            row[key] = float(np.median([r.get(key, np.nan) for r in solved])) if solved else float("nan")
        for key, name in (("seconds", "late"), ("cpu", "late_cpu")):
            row[name] = float(np.quantile([r[key] for r in solved], _LATE)) if solved else float("nan")
        row["refused"] = sum("referee" in r and not r["solved"] for r in group)
        row["contacts"] = sum(r.get("contacts", 0) for r in solved)
        stages = [stage for r in solved for stage in r["stages"]]
        row["stages"] = {stage: stages.count(stage) for stage in dict.fromkeys(stages)}
        rows.append(row)
    return rows


def _fits(cells: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Exponent of the growth of the median CPU time with the number of arms, for each planner and kind of problem."""
    found = []
    for planner, name, share in dict.fromkeys((c["planner"], c["set"], _kind(c)) for c in cells):
        own = [c for c in cells if (c["planner"], c["set"], _kind(c)) == (planner, name, share) and c["solved"]]
        if len(own) < 3:
            continue
        slope, offset = np.polyfit(np.log([c["arms"] for c in own]), np.log([c["cpu"] for c in own]), 1)
        fit = {"planner": planner, "set": name, "share": share, "power": float(slope)}
        found.append(fit | {"seconds_of_one": float(np.exp(offset))})
    return found


def _kind(cell: Mapping[str, Any]) -> float:
    """The parameter of a set besides the number of arms: the spacing of a grid."""
    return float(cell["share"]) if cell["set"] == "grid" else 0.0


def _label(cell: Mapping[str, Any]) -> str:
    at = f" at {_kind(cell):.2f}" if _kind(cell) else ""
    return f"{cell['planner']}, {cell['set']}{at}"


def _describe(fits: Sequence[Mapping[str, Any]]) -> str:
    lines = [
        f"- {_label(fit)}: {number(1e3 * fit['seconds_of_one'])} ms times the number of arms to the power of "
        f"{fit['power']:.2f}"
        for fit in fits
    ]
    return "\n".join(["Growth of the median CPU time:", *lines]) if lines else ""


def _table(cells: Sequence[Mapping[str, Any]]) -> str:
    header = ["planner", "problems", "size [m]", "arms", "solved", "refused", "contacts"]
    header += ["median [s]", "p95 [s]", "CPU [s]", "p95 CPU [s]"]
    header += [
        "referee [s]",
        "first plan / bound",
        "makespan / bound",
        "makespan [s]",
        "waiting [s]",
        "memory [MB]",
        "groups solved by",
    ]
    rows = []
    for c in cells:
        share = f"{c['solved']} of {c['problems']}"
        stages = ", ".join(f"{stage} {count}" for stage, count in c["stages"].items()) or "-"
        keys = (
            "seconds",
            "late",
            "cpu",
            "late_cpu",
            "referee",
            "first_ratio",
            "ratio",
            "makespan",
            "waiting",
            "memory",
        )
        figures = [number(c[key]) for key in keys]
        rows.append(
            [c["planner"], c["set"], number(c["size"]), c["arms"], share, c["refused"], c["contacts"], *figures, stages]
        )
    return table(header, rows)


def _failures(results: Sequence[Mapping[str, Any]]) -> str:
    lines = [
        f"- {r['planner']}, {r['set']} of {r['arms']} at {r['size']:.2f} m, seed {r['seed']}: "
        f"{r.get('failed', 'not certified')}"
        for r in results
        if not r["solved"]
    ]
    return "\n".join(["Not solved:", *lines]) if lines else "All solved."


def _draw_success(file: Path, cells: Sequence[Mapping[str, Any]], reach: float) -> None:
    """Fraction of problems solved over spacing or radius, one curve per planner and number of arms."""
    curves = dict.fromkeys((c["planner"], c["set"], c["arms"]) for c in cells if c["set"] not in ("shelf", "conveyor"))
    figure, axes = _axes()
    for planner, name, arms in curves:
        own = [c for c in cells if (c["planner"], c["set"], c["arms"]) == (planner, name, arms)]
        own.sort(key=lambda c: c["share"])
        label = f"{planner}, {name} of {arms}"
        axes.plot([c["share"] for c in own], [c["solved"] / c["problems"] for c in own], marker="o", label=label)
    axes.set(xlabel=f"spacing or radius over the reach ({reach:g} m)", ylabel="share solved", ylim=(-0.02, 1.02))
    _finish(figure, axes, file)


def _draw_times(file: Path, cells: Sequence[Mapping[str, Any]], fits: Sequence[Mapping[str, Any]]) -> None:
    """Median times over the number of arms, and the fits."""
    figure, axes = _axes()
    for label in dict.fromkeys(_label(c) for c in cells if c["set"] != "shelf"):
        own = sorted((c for c in cells if _label(c) == label and c["solved"]), key=lambda c: int(c["arms"]))
        line = axes.plot([c["arms"] for c in own], [c["cpu"] for c in own], "o", label=label)[0]
        for fit in fits:
            if _label(fit) == label:
                arms = np.array([own[0]["arms"], own[-1]["arms"]])
                axes.plot(arms, fit["seconds_of_one"] * arms ** fit["power"], color=line.get_color(), lw=1)
    axes.set(xscale="log", yscale="log", xlabel="arms", ylabel="median CPU time [s]")
    _finish(figure, axes, file)


def _axes() -> tuple[Any, Any]:
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    return plt.subplots(figsize=(8, 4.5), layout="constrained")


def _finish(figure: Any, axes: Any, file: Path) -> None:
    from matplotlib import pyplot as plt

    axes.grid(alpha=0.3)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(fontsize=8)
    figure.savefig(file, dpi=130)
    plt.close(figure)


if __name__ == "__main__":
    sys.exit(main())
