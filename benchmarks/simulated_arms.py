"""Simulated time for a second of computation, by the number of RR1: all of them follow a motion, contacts on.

    python benchmarks/simulated_arms.py [--arms 1 12 120 1000] [--spacings 0.8 3] [--threads 1 2]

At 0.8 m arms can meet their neighbors and are one model; at 3 m they cannot, and have models of their own. Each figure
is measured in a separate process, over at least a second of wall time.
"""

from __future__ import annotations

import argparse
import json
import math
import resource
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from shared import heading, make_parser, number, save, table, track

import rr1plan as rp

_DT = 0.002  # [s]
_FEWEST = 50  # steps
_SWING = 0.3  # [rad]


def main(argv: Sequence[str] | None = None) -> int:
    parser = make_parser(__doc__.splitlines()[0], "simulated_arms")
    parser.add_argument("--arms", type=int, nargs="+", default=(1, 12, 120, 250, 500, 1000), help="arms on a grid")
    parser.add_argument("--spacings", type=float, nargs="+", default=(0.8, 3.0), help="of the grid [m]")
    parser.add_argument("--threads", type=int, nargs="+", default=(1, 2), help="threads of the simulation")
    parser.add_argument("--seconds", type=float, default=1.0, help="wall time of a measurement")
    parser.add_argument("--child", help=argparse.SUPPRESS)
    args = parser.parse_args(argv)
    if args.child is not None:
        print(json.dumps(_measure(json.loads(args.child))))
        return 0
    common = {"seconds": args.seconds, "seed": args.seed}
    tasks = [
        {"arms": arms, "spacing": spacing, "threads": threads} | common
        for spacing in args.spacings
        for arms in args.arms
        for threads in args.threads
    ]
    results = [task | _ask(task) for task in track(tasks, "simulated arms")]
    text = "\n\n".join([heading("Simulated arms", {"time step": f"{1e3 * _DT:g} ms"}), _table(results)])
    save(args.out, "simulated_arms", {"results": results}, text)
    return 0


def _ask(task: Mapping[str, Any]) -> dict[str, Any]:
    """Measure in a new process; or the reason why that failed."""
    command = [sys.executable, str(Path(__file__).resolve()), "--child", json.dumps(dict(task))]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=3600.0)
    if done.returncode != 0:
        return {"failed": done.stderr.strip().splitlines()[-1]}
    answer: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return answer


def _measure(task: Mapping[str, Any]) -> dict[str, Any]:
    scene = _scene(task["arms"], task["spacing"])
    began = time.perf_counter()
    sim = rp.Simulation(scene, _DT, threads=task["threads"])
    built = time.perf_counter() - began
    trajectory = _swing(scene, task["seed"])
    sim.place(trajectory.joint_names, trajectory(0.0), trajectory(0.0, 1))
    follow = rp.JointTrajectoryController(trajectory.joint_names)
    sim.activate(follow)
    execution = follow.send(trajectory)
    sim.step(10)
    steps, wall, cpu = 0, time.perf_counter(), time.process_time()
    while steps < _FEWEST or (steps < 9000 and time.perf_counter() - wall < task["seconds"]):
        sim.step(10)
        steps += 10
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    return {
        "build": built,
        "models": len(sim.tiles),
        "wall": wall / steps,
        "cpu": cpu / steps,
        "error": float(execution.max_error.max()),
        "contacts": len(sim.contacts),
        "memory": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1e6 if sys.platform == "darwin" else 1e3),
    }


def _scene(count: int, spacing: float) -> rp.Scene:
    side = math.ceil(math.sqrt(count))
    places = (rp.transforms.pose([spacing * (i % side), spacing * (i // side), 0.0]) for i in range(count))
    robot = rp.load_robot("rr1")
    scene = rp.Scene(arms={f"r{i}": rp.Arm(robot, place) for i, place in enumerate(places)})
    return scene.with_obstacle("floor", rp.HalfSpace((0.0, 0.0, 1.0), -0.02))


def _swing(scene: rp.Scene, seed: int) -> rp.Trajectory:
    """All joints swing around the middle of their range, each with its own phase, for 20 s."""
    limits, rng = scene.limits(), np.random.default_rng(seed)
    middle = np.where(np.isfinite(limits.lower + limits.upper), 0.5 * (limits.lower + limits.upper), 0.0)
    swing = np.minimum(_SWING, 0.25 * (limits.upper - limits.lower))
    times = np.linspace(0.0, 20.0, 201)
    phase = 2.0 * times[:, None] + rng.uniform(0.0, 2.0 * np.pi, len(middle))
    q, qd = middle + swing * np.sin(phase), 2.0 * swing * np.cos(phase)
    return rp.Trajectory.from_samples(scene.joint_names(), times, q, qd)


def _table(results: Sequence[Mapping[str, Any]]) -> str:
    header = ["spacing [m]", "arms", "models", "threads", "step [us]", "CPU [us]", "real-time factor"]
    header += ["tracking error [rad]", "contacts", "build [s]", "memory [MB]"]
    rows = []
    for r in results:
        if "failed" in r:
            rows.append([number(r["spacing"]), r["arms"], "-", r["threads"], r["failed"], *["-"] * 6])
            continue
        times = (number(1e6 * r["wall"]), number(1e6 * r["cpu"]), number(_DT / r["wall"]))
        rest = (number(r["error"]), r["contacts"], number(r["build"]), number(r["memory"]))
        rows.append([number(r["spacing"]), r["arms"], r["models"], r["threads"], *times, *rest])
    return table(header, rows)


if __name__ == "__main__":
    sys.exit(main())
