"""Inverse kinematics: time and success, compared with closed-loop inverse kinematics on Pinocchio.

    python benchmarks/ik_comparison.py [--robot panda.urdf ur5.urdf] [--poses 300]

Poses of the tool at random free configurations, so that each has a solution. "One solution" is `solve_ik`, and the
method of Pinocchio's example written plainly in Python, from the same starts: the robot's home, then random ones. Its
steps are damped Newton steps of a given length, clipped to the limits. Every solution is measured by Pinocchio. "Goals"
is what a planner needs: up to eight distinct configurations, within limits and collision-free.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from shared import heading, make_parser, number, pin_to_core, save, spread, table, track

import rr1plan as rp
from rr1plan.checks import Array
from rr1plan.collision.checker_pool import checker_from_pool
from rr1plan.model import Kinematics
from rr1plan.planners.goal_configurations import GoalSearch
from rr1plan.scene.problem import PoseGoal, Problem

_STARTS = 200
_STEPS, _LENGTH, _DAMPING = 100, 0.5, 1e-6


@dataclass
class Found:
    """Results of one method on all poses of a robot: CPU seconds, and the number of solutions within tolerances."""

    seconds: list[float] = field(default_factory=list)
    counts: list[int] = field(default_factory=list)

    def cells(self) -> list[str]:
        """Fraction solved; median, 95th percentile and longest time [ms]."""
        times = spread(self.seconds)
        solved = np.mean(np.array(self.counts) > 0)
        return [f"{100 * solved:.4g} %", " / ".join(number(times[k]) for k in ("median", "p95", "max"))]


def main(argv: Sequence[str] | None = None) -> int:
    parser = make_parser("Inverse kinematics", "ik_comparison")
    parser.add_argument("--robot", nargs="*", default=[], help="URDF files, or names of shipped robots, besides rr1")
    parser.add_argument("--poses", type=int, default=300, help="poses of each robot")
    parser.add_argument("--plain", type=int, default=100, help="how many of them are shown to the plain method")
    args = parser.parse_args(argv)
    pin_to_core(args.core)
    rows, results = [], []
    for name in ("rr1", *args.robot):
        robot = _load(name)
        ours, plain, goals, wrong = _ask(robot, args)
        per_pose = number(float(np.mean(goals.counts)))
        rows.append([robot.name, robot.nq, *ours.cells(), *plain.cells(), *goals.cells(), per_pose])
        kept = {"ours": ours, "plain": plain, "goals": goals}
        results.append({"robot": robot.name, "wrong": wrong, **{k: vars(v) for k, v in kept.items()}})
    header = [
        *("robot", "joints", "one solution: solved", "CPU [ms]", "plain: solved", "CPU [ms]"),
        *("goals: solved", "CPU [ms]", "goals per pose"),
    ]
    wrong = sum(r["wrong"] for r in results)
    facts = {"poses": args.poses, "of them for the plain method": args.plain, "seed": args.seed, "wrong": wrong}
    text = f"{heading('Inverse kinematics', facts)}\n\nCPU: median / p95 / max.\n\n{table(header, rows)}"
    save(args.out, "ik_comparison", {"robots": results}, text)
    return 0 if wrong == 0 else 1


def _load(name: str) -> rp.Robot:
    file = Path(name)
    if not file.is_file():
        return rp.load_robot(name)
    srdf = file.with_suffix(".srdf")
    return rp.load_robot(file, srdf=srdf if srdf.is_file() else None)


def _ask(robot: rp.Robot, args: argparse.Namespace) -> tuple[Found, Found, Found, int]:
    """All poses of a robot: one solution by us and by the plain method, all goals, and number of wrong solutions."""
    kinematics, scene = Kinematics(robot), rp.Scene({"arm": rp.Arm(robot)})
    rng = np.random.default_rng(args.seed)
    ours, plain, goals, wrong = Found(), Found(), Found(), 0
    with checker_from_pool(scene) as motion:
        ends = [_free(robot, motion.is_free, rng) for _ in range(2 * args.poses + 2)]
        _solve(kinematics, PoseGoal("tool", kinematics.pose(ends[0])), 0)
        GoalSearch(Problem(scene, ends[0], PoseGoal("tool", kinematics.pose(ends[1]))), motion, 0).find()
        for i in track(range(args.poses), robot.name):
            start, end = ends[2 * i + 2], ends[2 * i + 3]
            goal = PoseGoal("tool", kinematics.pose(end))
            solutions = _clock(ours, _solve, kinematics, goal, i)
            problem = Problem(scene, start, goal)
            free = _clock(goals, lambda p, seed: GoalSearch(p, motion, seed).find().configurations, problem, i)
            wrong += sum(not _reaches(kinematics, goal, q) for q in [*solutions, *free])
            wrong += sum(not motion.is_free(q) for q in free)
            if i < args.plain:
                solutions = _clock(plain, solve_plainly, kinematics, goal, i)
                wrong += sum(not _reaches(kinematics, goal, q) for q in solutions)
    return ours, plain, goals, wrong


def _clock(found: Found, method: Any, *arguments: Any) -> Array:
    begin = time.process_time()
    solutions = np.asarray(method(*arguments))
    found.seconds.append(time.process_time() - begin)
    found.counts.append(len(solutions))
    return solutions


def _solve(kinematics: Kinematics, goal: PoseGoal, seed: int) -> Array:
    return rp.solve_ik(kinematics, goal, rng=seed, max_solutions=1, attempts=_STARTS).solutions


def solve_plainly(kinematics: Kinematics, goal: PoseGoal, seed: int) -> list[Array]:
    """The first solution of closed-loop inverse kinematics, in a list; empty if no start leads to one."""
    model, index = kinematics.scene_model, kinematics.scene_model.frame_id(kinematics.frame("tool"))
    data, limits = model.model.createData(), model.limits
    wanted, rng = pin.SE3(goal.rotation, goal.position), np.random.default_rng(seed)
    lower, upper = _box(limits.lower, limits.upper)
    for start in range(_STARTS):
        q = kinematics.scene.arms["arm"].q.copy() if start == 0 else rng.uniform(lower, upper)
        for _ in range(_STEPS):
            pin.computeJointJacobians(model.model, data, model.full(q))
            placed = pin.updateFramePlacement(model.model, data, index)
            between = placed.actInv(wanted)
            error = pin.log6(between).vector
            if np.linalg.norm(error[:3]) < 0.5e-4 and np.linalg.norm(error[3:]) < 0.5e-3:
                return [q]
            J = pin.getFrameJacobian(model.model, data, index, pin.ReferenceFrame.LOCAL) @ model.selection
            J = -pin.Jlog6(between.inverse()) @ J
            step = -J.T @ np.linalg.solve(J @ J.T + _DAMPING * np.eye(6), error)
            q = np.clip(q + _LENGTH * step, limits.lower, limits.upper)
    return []


def _reaches(kinematics: Kinematics, goal: PoseGoal, q: Array) -> bool:
    """Whether q is within the limits and the goal's tolerances, by Pinocchio."""
    T, limits = kinematics.pose(q), kinematics.scene_model.limits
    turn = pin.log3(T[:3, :3] @ goal.rotation.T)
    within = bool(((q >= limits.lower) & (q <= limits.upper)).all())
    near = np.linalg.norm(T[:3, 3] - goal.position) <= goal.position_tolerance
    return within and bool(near) and float(np.linalg.norm(turn)) <= goal.orientation_tolerance


def _free(robot: rp.Robot, is_free: Any, rng: np.random.Generator) -> Array:
    lower, upper = _box(robot.limits.lower, robot.limits.upper)
    while True:
        q = rng.uniform(lower, upper)
        if is_free(q):
            return q


def _box(lower: Array, upper: Array) -> tuple[Array, Array]:
    return np.where(np.isfinite(lower), lower, -np.pi), np.where(np.isfinite(upper), upper, np.pi)


if __name__ == "__main__":
    sys.exit(main())
