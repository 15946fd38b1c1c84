"""Time of a certified straight edge: by spheres first, by the exact kernel alone, and among arms that move.

    python benchmarks/edges.py [PROBLEMS.json.gz --robot panda.urdf] [--every 30]
    python benchmarks/edges.py --moving

Random edges from random free configurations, 0.2 to 1.5 rad long, certified by one call; the exact kernel gets a call
for each. Answers are compared. With `--moving` they are edges in space and time, of the RR1 in the middle of nine on a
grid, 1 to 8 of which follow random trajectories; each edge is one call from Python and lasts 0.1 to 1 s.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

import rr1plan as rp
from rr1plan.collision import CollisionChecker, TimedChecker
from rr1plan.collision.edge_kernel import FREE, EdgeKernel
from rr1plan.collision.tables.edge_tables import build_edge_tables
from rr1plan.scene.motion_bench import problem_set_joints, read_problem_set

_TOLERANCE = 1e-6


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("file", type=Path, nargs="?", help="MotionBenchMaker problems (.json or .json.gz)")
    parser.add_argument("--robot", type=Path, help="their robot's URDF")
    parser.add_argument("--every", type=int, default=30, help="take every n-th problem")
    parser.add_argument("--edges", type=int, default=1000, help="edges of each scene")
    parser.add_argument("--moving", action="store_true", help="edges among moving arms instead")
    parser.add_argument("--spacing", type=float, default=0.8, help="of the grid of moving arms [m]")
    args = parser.parse_args()
    if args.moving:
        return _among_moving_arms(args)
    print("| scene | configuration [us] | edge [us] | exact alone [us] | free | left to the exact kernel |")
    print("|---|---|---|---|---|---|")
    agree = True
    for name, scene in _scenes(args):
        checker = CollisionChecker(scene)
        begins, ends = _edges(checker, args.edges)
        tables = build_edge_tables(checker.geometry, checker.fixed, checker.solid_padding, _TOLERANCE)
        kernel = EdgeKernel(tables, checker.exact_kernel, checker.nq)
        free = kernel.certify_edges(begins, ends) == FREE
        # Counted in one round, including the configurations of the exact kernel.
        done = kernel.counters
        lines = np.stack([begins, ends - begins], axis=1)
        exact = _certify_exactly(kernel, lines) == FREE
        agree &= bool((free == exact).all())
        quick = _clock(kernel.certify_edges, begins, ends)
        slow = _clock(_certify_exactly, kernel, lines)
        per = [1e6 * quick / done.configurations, *(1e6 * t / args.edges for t in (quick, slow))]
        times = " | ".join(f"{t:.3g}" for t in per)
        print(f"| {name} | {times} | {100 * exact.mean():.0f} % | {100 * done.exact_edges / args.edges:.1f} % |")
    print("all results agree" if agree else "RESULTS DIFFER")
    return 0 if agree else 1


def _among_moving_arms(args: argparse.Namespace) -> int:
    scene = rp.place_grid(rp.load_robot("rr1"), 3, 3, spacing=args.spacing)
    arms = list(scene.arms)
    middle = arms.pop(4)
    rng = np.random.default_rng(0)
    motions = {arm: _random_motion(scene, arm, rng) for arm in arms}
    begins, ends = _edges(CollisionChecker(scene.without_arm(arms[0]), [middle]), args.edges)
    times = rng.uniform(0.0, 3.0, (args.edges, 1)) + np.array([0.0, 1.0]) * rng.uniform(0.1, 1.0, (args.edges, 1))
    edges = list(zip(begins, ends, *times.T.tolist(), strict=True))
    print("| moving neighbors | ready [ms] | free edge [us] | blocked edge [us] | free |")
    print("|---|---|---|---|---|")
    for count in (0, 1, 2, 4, 8):
        # All others are out of the way.
        bare = scene
        for arm in arms[count:]:
            bare = bare.without_arm(arm)
        near = {arm: motions[arm] for arm in arms[:count]}
        begin = time.process_time()
        timed = TimedChecker(CollisionChecker(bare, [middle]), near)
        timed.edge_is_free(*edges[0])
        ready = 1e3 * (time.process_time() - begin)
        free = np.array([timed.edge_is_free(*edge) for edge in edges])
        taken = [
            1e6 * _clock(lambda t=timed, c=chosen: [t.edge_is_free(*edges[i]) for i in c]) / max(1, len(chosen))
            for chosen in (np.flatnonzero(free), np.flatnonzero(~free))
        ]
        print(f"| {count} | {ready:.2g} | {taken[0]:.3g} | {taken[1]:.3g} | {100 * free.mean():.0f} % |")
    return 0


def _random_motion(scene: rp.Scene, arm: str, rng: np.random.Generator) -> rp.Trajectory:
    """A motion of 4 s through eight random configurations."""
    limits = scene.limits([arm])
    q = rng.uniform(np.maximum(limits.lower, -2.0), np.minimum(limits.upper, 2.0), (8, len(limits.lower)))
    return rp.Trajectory.from_samples(scene.joint_names([arm]), np.linspace(0.0, 4.0, 8), q, np.zeros_like(q))


def _scenes(args: argparse.Namespace) -> Iterator[tuple[str, rp.Scene]]:
    for name in ("rr1_cluttered", "rr1_pair"):
        yield name, rp.load_scene(name)
    if args.file is not None:
        joints = problem_set_joints(args.file)
        robot = rp.load_robot(args.robot, srdf=args.robot.with_suffix(".srdf"), joints=joints)
        problems = read_problem_set(args.file, robot)
        for name in list(problems)[:: args.every]:
            yield name, problems[name].scene


def _edges(checker: CollisionChecker, count: int) -> tuple[np.ndarray, np.ndarray]:
    rng, begins = np.random.default_rng(0), []
    low, high = np.maximum(checker.limits.lower, -3.0), np.minimum(checker.limits.upper, 3.0)
    while len(begins) < count:
        q = rng.uniform(low, high)
        if checker.is_free(q):
            begins.append(q)
    steps = rng.normal(size=(count, checker.nq))
    steps *= rng.uniform(0.2, 1.5, (count, 1)) / np.linalg.norm(steps, axis=1)[:, None]
    return np.array(begins), np.clip(begins + steps, checker.limits.lower, checker.limits.upper)


def _certify_exactly(kernel: EdgeKernel, lines: np.ndarray) -> np.ndarray:
    """The exact kernel's statuses of straight edges, their coefficients of shape (n, 2, nq)."""
    return np.array([kernel.certify_curve(line, 1.0)[0] for line in lines])


def _clock(function: Callable[..., Any], *arguments: Any) -> float:
    """CPU time of the best of five [s]."""
    best = np.inf
    for _ in range(5):
        begin = time.process_time()
        function(*arguments)
        best = min(best, time.process_time() - begin)
    return best


if __name__ == "__main__":
    raise SystemExit(main())
