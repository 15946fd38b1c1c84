"""Time until a problem of many arms without a solution is refused, with the reason.

    python benchmarks/no_solution.py [--robot rr1] [--reach 0.85] [--arms 4 16 64 100] [--seeds 5]

Arms on a grid, each with a random start and goal. One of them has a goal outside its joint limits (`limits`) or out of
reach (`reach`), its start in a box (`box`), or the starts or goals of two neighbors touch (`starts`, `goals`), although
each of them alone is free. Every problem has a new scene, in a process that has planned for two such arms before.
"""

from __future__ import annotations

import gc
import pickle
import sys
import time
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from shared import heading, make_parser, number, pin_to_core, save, spread, table, track

import rr1plan as rp
from rr1plan.checks import Array
from rr1plan.planning import PlanStatus

_SPACING = 0.94  # of the grid, over the reach
_GOAL = 0.05  # target of the median [s]
_BOX = 0.1  # edge of the box [m]
_Questions = Mapping[str, tuple[Callable[[rp.Problem, np.random.Generator], rp.Problem], PlanStatus]]


def main(argv: Sequence[str] | None = None) -> int:
    parser = make_parser(__doc__.splitlines()[0], "no_solution")
    parser.add_argument("--robot", default="rr1", help="a robot's name or its URDF")
    parser.add_argument("--reach", type=float, default=0.85, help="of its tool [m]")
    parser.add_argument("--arms", type=int, nargs="+", default=(4, 16, 64, 100), help="arms on the grid")
    parser.add_argument("--seeds", type=int, default=5, help="problems of each kind")
    args = parser.parse_args(argv)
    pin_to_core(args.core)
    robot = rp.load_robot(args.robot)
    spacing = _SPACING * args.reach
    rp.plan_many_arms(rp.random_grid(robot, 2, spacing, args.seed), rng=args.seed)
    kinds = [(count, kind) for count in args.arms for kind in _QUESTIONS]
    results, rows = {}, []
    for count, kind in track(kinds, "problems"):
        times = [_time(robot, count, spacing, kind, args.seed + i) for i in range(args.seeds)]
        results[f"{kind}, {count} arms"] = spread(times)
        rows.append([kind, str(count), *(number(1e3 * t) for t in (np.median(times), max(times)))])
    facts = {"robot": args.robot, "reach": f"{args.reach} m", "spacing": f"{spacing:.3g} m", "seeds": args.seeds}
    text = table(["kind", "arms", "median [ms]", "longest [ms]"], rows)
    save(
        args.out,
        "no_solution",
        {"results": results, "goal": _GOAL},
        "\n\n".join([heading("Problems of many arms without a solution", facts), text]),
    )
    return 0


def _time(robot: rp.Robot, count: int, spacing: float, kind: str, seed: int) -> float:
    """CPU time of one refusal [s]."""
    change, status = _QUESTIONS[kind]
    problem = change(rp.random_grid(robot, count, spacing, seed), np.random.default_rng(seed))
    problem = pickle.loads(pickle.dumps(problem))  # without what its scene keeps
    gc.collect()
    begin = time.process_time()
    result = rp.plan_many_arms(problem, rng=seed)
    seconds = time.process_time() - begin
    if result.status is not status:
        raise RuntimeError(f"{kind}, {count} arms, seed {seed}: {result.status}, expected {status}: {result.reason}")
    return seconds


# ---- problems ----------------------------------------------------------------------------------


def _neighbors(problem: rp.Problem) -> tuple[str, str]:
    """An arm in the middle of the grid, and the one that stands nearest to it."""
    bases = {name: problem.scene.arms[name].base[:3, 3] for name in problem.arms}
    middle = problem.arms[len(bases) // 2]
    here = bases.pop(middle)
    return middle, min(bases, key=lambda name: float(np.linalg.norm(bases[name] - here)))


def _changed(
    problem: rp.Problem,
    *,
    start: Mapping[str, Array] | None = None,
    goal: Mapping[str, object] | None = None,
    scene: rp.Scene | None = None,
) -> rp.Problem:
    """The problem with other starts and goals of some arms, or in another scene."""
    starts = problem.scene.split(problem.start, problem.arms)
    goals = dict(problem.goal) | dict(goal or {})
    return rp.Problem(scene or problem.scene, starts | dict(start or {}), goals, arms=problem.arms)


def _beyond_limits(problem: rp.Problem, rng: np.random.Generator) -> rp.Problem:
    arm = _neighbors(problem)[0]
    return _changed(problem, goal={arm: problem.scene.arms[arm].robot.limits.upper + 1.0})


def _out_of_reach(problem: rp.Problem, rng: np.random.Generator) -> rp.Problem:
    return _changed(problem, goal={_neighbors(problem)[0]: rp.PoseGoal("tool", (100.0, 0.0, 0.0))})


def _in_a_box(problem: rp.Problem, rng: np.random.Generator) -> rp.Problem:
    arm = _neighbors(problem)[0]
    starts = problem.scene.split(problem.start, problem.arms)
    tool = f"{arm}/{problem.scene.arms[arm].robot.tool}"
    there = problem.scene.with_configuration(arm, starts[arm]).link_poses()[tool]
    return _changed(problem, scene=problem.scene.with_obstacle("box", rp.Box((_BOX, _BOX, _BOX)), there))


def _starts_touch(problem: rp.Problem, rng: np.random.Generator) -> rp.Problem:
    return _changed(problem, start=_touching(problem, rng))


def _goals_touch(problem: rp.Problem, rng: np.random.Generator) -> rp.Problem:
    return _changed(problem, goal=_touching(problem, rng))


def _touching(problem: rp.Problem, rng: np.random.Generator) -> dict[str, Array]:
    """Random configurations of two neighbors in contact with each other and with nothing else."""
    both = _neighbors(problem)
    scene = rp.Scene({name: problem.scene.arms[name] for name in both})
    alone = {name: rp.CollisionChecker(scene.without_arm(other)) for name, other in zip(both, both[::-1], strict=True)}
    together = rp.CollisionChecker(scene)
    while True:
        drawn = {}
        for name, checker in alone.items():
            limits = checker.limits
            drawn[name] = rng.uniform(np.maximum(limits.lower, -np.pi), np.minimum(limits.upper, np.pi))
        are_free = all(alone[name].is_free(q) for name, q in drawn.items())
        if are_free and together.contacts(np.concatenate([*drawn.values()])):
            return drawn


_QUESTIONS: _Questions = {
    "limits": (_beyond_limits, PlanStatus.INVALID_GOAL),
    "reach": (_out_of_reach, PlanStatus.INFEASIBLE),
    "box": (_in_a_box, PlanStatus.INVALID_START),
    "starts": (_starts_touch, PlanStatus.INVALID_START),
    "goals": (_goals_touch, PlanStatus.INVALID_GOAL),
}


if __name__ == "__main__":
    sys.exit(main())
