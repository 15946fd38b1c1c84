"""Simulated time for a second of computation while a tower of boat-like hulls of 256 triangles falls.

    python benchmarks/falling_tower.py [--boats 10 20 50 100 200 500] [--solvers newton cg] [--threads 1 2]

Boats of 0.60 x 0.31 x 0.48 m and 1 kg are stacked in columns, each a little tilted, and fall into a heap. Figures are
those of each two simulated seconds, in a separate process; the clock is the processor's with one thread.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull
from shared import heading, make_parser, number, save, table, track

import rr1plan as rp

_WINDOW = 2.0  # [s]
_COLUMNS = {10: 1, 20: 2, 50: 3, 100: 4, 200: 6, 500: 6}
_SIZE = np.array([0.60, 0.31, 0.48])  # [m]


def main(argv: Sequence[str] | None = None) -> int:
    parser = make_parser(__doc__.splitlines()[0], "falling_tower")
    parser.add_argument("--boats", type=int, nargs="+", default=(10, 20, 50, 100, 200, 500), help="boats in the tower")
    parser.add_argument("--solvers", nargs="+", default=("newton", "cg"), help="solvers of the simulation")
    parser.add_argument("--threads", type=int, nargs="+", default=(1,), help="threads of the simulation")
    parser.add_argument("--dt", type=float, default=0.004, help="time step [s]")
    parser.add_argument("--seconds", type=float, default=6.0, help="simulated time of a measurement")
    parser.add_argument("--child", help=argparse.SUPPRESS)
    args = parser.parse_args(argv)
    if args.child is not None:
        print(json.dumps(_measure(json.loads(args.child))))
        return 0
    common = {"dt": args.dt, "seconds": args.seconds, "seed": args.seed}
    tasks = [
        {"boats": boats, "solver": solver, "threads": threads} | common
        for boats in args.boats
        for solver in args.solvers
        for threads in args.threads
    ]
    results = [task | _ask(task) for task in track(tasks, "towers")]
    text = "\n\n".join([heading("Falling tower", {"time step": f"{1e3 * args.dt:g} ms"}), _table(results)])
    save(args.out, "falling_tower", {"results": results}, text)
    return 0


def _ask(task: Mapping[str, Any]) -> dict[str, Any]:
    command = [sys.executable, str(Path(__file__).resolve()), "--child", json.dumps(dict(task))]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=3600.0)
    answer: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return answer


def _measure(task: Mapping[str, Any]) -> dict[str, Any]:
    sim = rp.Simulation(_tower(task["boats"], task["seed"]), task["dt"], solver=task["solver"], threads=task["threads"])
    clock = time.process_time if task["threads"] == 1 else time.perf_counter
    factors, deepest = [], []
    while sim.time < task["seconds"] - 1e-9:
        depths: list[float] = []
        end = sim.on_step(lambda sim, kept=depths: kept.append(_depth(sim)))
        began = clock()
        sim.run(duration=_WINDOW)
        factors.append(_WINDOW / (clock() - began))
        deepest.append(max(depths))
        end()
    lowest = min(float((sim.body_pose(name) @ _CORNERS)[2].min()) for name in sim.body_names)
    return {
        "factors": factors,
        "deepest": deepest,
        "depth": _depth(sim),
        "lowest": lowest,
        "contacts": int(sim.data.ncon),
        "speed": max(float(np.abs(sim.body_velocity(name)[:3]).max()) for name in sim.body_names),
    }


def _depth(sim: rp.Simulation) -> float:
    """Deepest penetration at this instant [m]."""
    return max(0.0, -float(sim.data.contact.dist.min())) if sim.data.ncon else 0.0


def _tower(count: int, seed: int) -> rp.Scene:
    rng, columns = np.random.default_rng(seed), _COLUMNS.get(count, max(1, round((count / 14) ** 0.5)))
    boat = rp.Obstacle([rp.Geometry("boat", _boat(), np.eye(4))], mass=1.0)
    stack = rp.stack_bodies(boat, count, columns=(columns, columns), gap=0.03, prefix="boat", pose=[0, 0, 0.05])
    tilted = {
        name: replace(body, pose=body.pose @ rp.transforms.pose(rpy=rng.uniform(-0.1, 0.1, 3)))
        for name, body in stack.items()
    }
    return rp.Scene(name="tower").with_obstacle("floor", rp.HalfSpace()).with_obstacles(tilted)


def _boat(stations: int = 8, around: int = 16) -> rp.Mesh:
    """Half an ellipsoid under a flat deck, 130 vertices and 256 triangles."""
    along, across = np.pi * np.arange(1, stations + 1) / (stations + 1), np.pi * np.arange(around) / (around - 1)
    u, v = np.meshgrid(along, across, indexing="ij")
    points = np.stack([-np.cos(u), np.sin(u) * np.cos(v), -np.sin(u) * np.sin(v)], axis=-1).reshape(-1, 3)
    points = np.concatenate([points, [[1, 0, 0], [-1, 0, 0]]]) * _SIZE * [0.5, 0.5, 1.0]
    return rp.Mesh(points, ConvexHull(points).simplices)


_CORNERS = np.concatenate([_boat().vertices, np.ones((130, 1))], axis=1).T


def _table(results: Sequence[Mapping[str, Any]]) -> str:
    header = ["boats", "solver", "threads", "real-time factor", "deepest penetration [mm]", "at the end [mm]"]
    header += ["lowest point [mm]", "contacts", "fastest [m/s]"]
    rows = []
    for r in results:
        factors = " / ".join(number(factor) for factor in r["factors"])
        depths = " / ".join(number(1e3 * depth) for depth in r["deepest"])
        rest = (number(1e3 * r["depth"]), number(1e3 * r["lowest"]), r["contacts"], number(r["speed"]))
        rows.append([r["boats"], r["solver"], r["threads"], factors, depths, *rest])
    return table(header, rows)


if __name__ == "__main__":
    sys.exit(main())
