"""Execution of plans of many RR1: random delays, and new goals while the arms move.

    python benchmarks/delays.py [--sets ring grid] [--executions 1000] [--conveyors 4 6 8] [--goals 60]

Executions: plans of rings and grids are executed with arms that start up to 0.3 s late, are up to 30 % slower and may
pause; the referee certifies each, and MuJoCo replays it and counts contacts. Conveyor: arms in two rows along a belt
each get a new goal every 1 to 3 s by `add_motion`, alternately over the belt and elsewhere; finally the whole motion is
certified and replayed.
"""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np
from shared import heading, make_parser, number, pin_to_core, save, spread, table, track

import rr1plan as rp

_SKEW, _SLOWDOWN, _PAUSE = 0.3, 0.3, 0.5  # most [s], share, most [s]
_RINGS, _GRIDS = ((3, 0.5), (4, 0.5), (8, 0.6)), ((8, 0.55), (16, 0.6))
_PITCH, _AISLE = 0.6, 0.9  # of arms along the belt, and between the rows [m]
_INTERVAL = (1.0, 3.0)  # between goals of one arm [s]


def main(argv: Sequence[str] | None = None) -> int:
    parser = make_parser(__doc__.splitlines()[0], "delays")
    parser.add_argument("--sets", nargs="*", choices=("ring", "grid"), default=("ring", "grid"), help="which plans")
    parser.add_argument("--executions", type=int, default=1000, help="executions of all plans together")
    parser.add_argument("--seeds", type=int, default=4, help="plans of each kind")
    parser.add_argument("--conveyors", type=int, nargs="*", default=(4, 6, 8), help="arms along a belt")
    parser.add_argument("--goals", type=int, default=60, help="new goals on each belt")
    parser.add_argument("--limit", type=float, default=0.5, help="budget of a new goal [s]")
    args = parser.parse_args(argv)
    pin_to_core(args.core)
    plans = [(n, size, "ring") for n, size in _RINGS if "ring" in args.sets]
    plans += [(n, size, "grid") for n, size in _GRIDS if "grid" in args.sets]
    tasks = [(*plan, args.seed + seed) for plan in plans for seed in range(args.seeds)]
    each = math.ceil(args.executions / max(1, len(tasks)))
    executions = [_execute(*task, each) for task in track(tasks, "delays")]
    executions = [answer for answer in executions if answer]
    belts = [_convey(count, args.goals, args.limit, args.seed) for count in track(args.conveyors, "conveyor")]
    facts = {"start skew": f"{_SKEW} s", "slowdown": f"{100 * _SLOWDOWN:.0f} %", "limit": f"{args.limit:g} s"}
    text = [heading("Plans that run", facts), _execution_table(executions), _belt_table(belts)]
    save(args.out, "delays", {"executions": executions, "conveyors": belts}, "\n\n".join(text))
    return 0


def _execute(count: int, size: float, kind: str, seed: int, executions: int) -> dict[str, Any]:
    """Execute one plan with random delays; nothing if there is no such problem."""
    robot = rp.load_robot("rr1")
    try:
        problem = (
            rp.ring_swap(robot, count, size, rng=seed) if kind == "ring" else rp.random_grid(robot, count, size, seed)
        )
    except rp.InputError:
        return {}
    result = rp.plan_many_arms(problem, rng=seed, budget=rp.Budget(seconds=60.0))
    if not result:
        return {}
    graph = rp.plan_graph(result)
    rng = np.random.default_rng(seed)
    answer: dict[str, Any] = {"set": kind, "arms": count, "seed": seed, "dependencies": len(graph.dependencies)}
    answer |= {"makespan": result.makespan, "skew_tolerance": min(graph.skew_tolerance, 1e9)}
    answer["on_time"] = rp.execute_plan(graph, problem.scene).makespan
    spaced = rp.execute_plan(graph, problem.scene, gap=_SKEW)
    answer |= {"gap_makespan": spaced.makespan, "gap_tolerance": min(spaced.graph.skew_tolerance, 1e9)}
    rejected = contacts = 0
    seconds, makespans = [], []
    for _ in range(executions):
        delays = {arm: _random_delay(rng) for arm in graph.arms}
        began = time.process_time()
        done = rp.execute_plan(graph, problem.scene, delays)
        seconds.append(time.process_time() - began)
        makespans.append(done.makespan)
        rejected += not rp.validate(done.trajectory, problem.scene, problem, clearance=False).certified
        contacts += len(rp.simulate(done.trajectory, problem.scene).contacts)
    return answer | {
        "executions": executions,
        "rejected": rejected,
        "contacts": contacts,
        "delayed": float(np.median(makespans)),
        "seconds": float(np.median(seconds)),
    }


def _random_delay(rng: np.random.Generator) -> rp.ArmDelay:
    pauses = [(rng.uniform(0.0, 1.5), rng.uniform(0.0, _PAUSE))] if rng.random() < 0.3 else []
    return rp.ArmDelay(rng.uniform(0.0, _SKEW), rng.uniform(0.0, _SLOWDOWN), pauses)


def _convey(count: int, goals: int, limit: float, seed: int) -> dict[str, Any]:
    """Give the arms along a belt new goals."""
    robot, rng = rp.load_robot("rr1"), np.random.default_rng(seed)
    rows = [(k // 2 * _PITCH, (-0.5, 0.5)[k % 2] * _AISLE) for k in range(count)]
    scene = rp.Scene(name="conveyor")
    for k, (along, across) in enumerate(rows, start=1):
        yaw = math.pi / 2.0 if across > 0.0 else -math.pi / 2.0  # the front of RR1 is -x
        scene = scene.with_arm(f"arm{k}", robot, rp.transforms.pose((along, across, 0.0), rpy=(0.0, 0.0, yaw)))
    belt = rp.Box((count * 0.5 * _PITCH + 0.5, 0.3, 0.05))
    scene = scene.with_obstacle("belt", belt, (0.25 * count * _PITCH - 0.3, 0.0, 0.05))
    start = {arm: scene.arms[arm].q for arm in scene.arms}
    plan = rp.RunningPlan.of(rp.plan_many_arms(rp.Problem(scene, start, start), rng=seed))
    over_belt = dict.fromkeys(plan.arms, True)
    due = {arm: rng.uniform(0.0, _INTERVAL[1]) for arm in plan.arms}
    wall, cpu, stages, moving = [], [], Counter[str](), 0
    refused: Counter[str] = Counter()
    for k in range(goals):
        arm = min(due, key=lambda name: due[name])
        now = due[arm]
        due[arm] = now + rng.uniform(*_INTERVAL)
        q = _goal(scene, arm, over_belt[arm], rng)
        over_belt[arm] = not over_belt[arm]
        began, work = time.perf_counter(), time.process_time()
        added = rp.add_motion(plan, arm, rp.JointGoal(q), at=now, freeze=limit, budget=rp.Budget(seconds=limit), rng=k)
        wall.append(time.perf_counter() - began)
        cpu.append(time.process_time() - work)
        moving += bool(np.abs(plan.velocity(arm, now + limit)).max() > 1e-6)
        stages[added.stage or "none"] += 1
        if not added:
            refused[added.reason.split(";")[0]] += 1
        plan = added.plan
    report = rp.validate(plan.trajectory, scene)
    return {
        "arms": count,
        "goals": goals,
        "stages": dict(stages),
        "refused": dict(refused),
        "moving": moving,
        "wall": spread(wall),
        "cpu": spread(cpu),
        "certified": bool(report.certified),
        "contacts": len(rp.simulate(plan.trajectory, scene).contacts),
        "duration": plan.trajectory.duration,
    }


def _goal(scene: rp.Scene, arm: str, over_belt: bool, rng: np.random.Generator) -> np.ndarray:
    """A configuration free of the belt, with the tool over the belt or on the arm's side of it."""
    placed = scene.arms[arm]
    checker, limits = rp.CollisionChecker(rp.Scene({arm: placed}, scene.obstacles)), placed.robot.limits
    while True:
        q = rng.uniform(limits.lower, limits.upper)
        tool = placed.base @ placed.robot.link_poses(q)[placed.robot.tool]
        near = abs(tool[1, 3]) < 0.15 if over_belt else abs(tool[1, 3]) > 0.25 and tool[1, 3] * placed.base[1, 3] > 0.0
        if near and 0.1 < tool[2, 3] < 0.6 and checker.clearance(q, 0.01) > 0.005:
            return q


def _execution_table(answers: Sequence[dict[str, Any]]) -> str:
    head = ["plan", "arms", "dependencies", "executions", "not certified", "contacts", "plan [s]", "on time", "delayed"]
    head += ["gap 0.3 s", "tolerance [s]", "CPU [ms]"]
    counts = ("set", "arms", "dependencies", "executions", "rejected", "contacts")
    times = ("makespan", "on_time", "delayed", "gap_makespan", "gap_tolerance")
    rows = [[*(a[k] for k in counts), *(number(a[k]) for k in times), number(1e3 * a["seconds"])] for a in answers]
    return table(head, rows)


def _belt_table(belts: Sequence[dict[str, Any]]) -> str:
    head = ["arms", "goals", "moving", "wait", "detour", "yield", "none", "wall p95 [ms]", "CPU p95 [ms]", "contacts"]
    stages = ("wait", "detour", "yield", "none")
    rows = [
        [
            *(b["arms"], b["goals"], b["moving"], *(b["stages"].get(k, 0) for k in stages)),
            *(number(b["wall"]["p95"]), number(b["cpu"]["p95"]), b["contacts"] if b["certified"] else "not certified"),
        ]
        for b in belts
    ]
    return table(head, rows)


if __name__ == "__main__":
    raise SystemExit(main())
