"""Simulated time per second of computation, by the number of RR1: all follow seven poses, contacts on.

    python benchmarks/simulated_arms_speed.py [--arms 1 12 120 1000] [--spacings 0.8 3] [--threads 1 2]

The experiment `multi` of `rr1plan experiment`, with other spacings and threads. At 0.8 m arms can meet their neighbors
and are one model; at 3 m they cannot, and have separate models. For comparison, MuJoCo alone steps as many arms
without shapes and controllers.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from statistics import median
from typing import Any

import mujoco
from shared import heading, make_parser, number, save, table, track

from rr1plan.errors import Rr1PlanError
from rr1plan.experiments.measuring_process import measure
from rr1plan.playback.simulation.mujoco_model import build_mujoco
from rr1plan.scene import Arm, Scene
from rr1plan.scene.model_library import load_robot

_DT = 0.002  # [s]
# Arms of a model and steps of a call where MuJoCo is measured alone, and how often.
_ARMS, _STEPS, _REPEATS = 100, 25, 15

# What never acts without shapes, and MuJoCo looks for in each step.
_BITS = mujoco.mjtDisableBit
_NEVER = int(_BITS.mjDSBL_CONTACT | _BITS.mjDSBL_CONSTRAINT | _BITS.mjDSBL_SPRING | _BITS.mjDSBL_DAMPER)


def main(argv: Sequence[str] | None = None) -> int:
    parser = make_parser(__doc__.splitlines()[0], "simulated_arms_speed")
    parser.add_argument("--arms", type=int, nargs="+", default=(1, 12, 120, 250, 500, 1000), help="arms on a grid")
    parser.add_argument("--spacings", type=float, nargs="+", default=(0.8, 3.0), help="of the grid [m]")
    parser.add_argument("--threads", type=int, nargs="+", default=(1, 2), help="threads of the simulation")
    parser.add_argument("--seconds", type=float, default=4.0, help="simulated time of a measurement")
    args = parser.parse_args(argv)
    common = {"dt": _DT, "seconds": args.seconds}
    tasks = [
        {"arms": arms, "spacing": spacing, "threads": threads} | common
        for spacing in args.spacings
        for arms in args.arms
        for threads in args.threads
    ]
    alone = {(arms, threads): _alone(arms, threads) for arms in args.arms for threads in args.threads}
    results = [
        task | {"alone": alone[task["arms"], task["threads"]]} | _measure(task)
        for task in track(tasks, "simulated arms")
    ]
    text = "\n\n".join([heading("Simulated arms", {"time step": f"{1e3 * _DT:g} ms"}), _table(results)])
    save(args.out, "simulated_arms_speed", {"results": results}, text)
    return 0


def _measure(task: Mapping[str, Any]) -> Mapping[str, Any]:
    """The measurements, or why they failed."""
    try:
        return measure("multi", task)[0]
    except Rr1PlanError as error:
        return {"failed": str(error)}


def _alone(arms: int, threads: int) -> float:
    """Simulated time per second of MuJoCo alone."""
    most = min(_ARMS, -(-arms // threads))
    robot, counts = load_robot("rr1"), [min(most, arms - first) for first in range(0, arms, most)]
    robot = replace(robot, links=tuple(replace(link, collisions=(), visuals=()) for link in robot.links))
    scenes = {count: Scene(arms={f"r{i}": Arm(robot) for i in range(count)}) for count in set(counts)}
    models = {count: build_mujoco(scene, timestep=_DT).model for count, scene in scenes.items()}
    for model in models.values():
        model.opt.disableflags |= _NEVER
    worlds = [(models[count], mujoco.MjData(models[count])) for count in counts]

    def step(worker: int) -> None:
        for model, data in worlds[worker::threads]:
            mujoco.mj_step(model, data, _STEPS)

    times = []
    with ThreadPoolExecutor(threads) as pool:
        for _ in range(_REPEATS):
            began = time.perf_counter()
            list(pool.map(step, range(threads)))
            times.append((time.perf_counter() - began) / _STEPS)
    return _DT / median(times)


def _table(results: Sequence[Mapping[str, Any]]) -> str:
    header = [
        "spacing [m]",
        "arms",
        "models",
        "threads",
        "step [us]",
        "CPU [us]",
        "real-time factor",
        "of MuJoCo alone",
    ]
    header += ["tracking error [rad]", "contacts", "build [s]", "memory [MB]"]
    rows = []
    for r in results:
        if "failed" in r:
            rows.append([number(r["spacing"]), r["arms"], "-", r["threads"], r["failed"], *["-"] * 7])
            continue
        times = (number(r[name]) for name in ("step_us", "cpu_us", "real_time_factor", "alone"))
        rest = (number(r["tracking_error_rad"]), r["contacts"], number(r["build_s"]), number(r["memory_mb"]))
        rows.append([number(r["spacing"]), r["arms"], r["models"], r["threads"], *times, *rest])
    return table(header, rows)


if __name__ == "__main__":
    sys.exit(main())
