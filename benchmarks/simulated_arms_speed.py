"""Simulated time for a second of computation, by the number of RR1: all of them follow seven poses, contacts on.

    python benchmarks/simulated_arms_speed.py [--arms 1 12 120 1000] [--spacings 0.8 3] [--threads 1 2]

The experiment `multi` of `rr1plan experiment`, with other spacings and threads. At 0.8 m arms can meet their neighbors
and are one model; at 3 m they cannot, and have separate models.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from typing import Any

from shared import heading, make_parser, number, save, table, track

from rr1plan.errors import Rr1PlanError
from rr1plan.experiments.measuring_process import measure

_DT = 0.002  # [s]


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
    results = [task | _measure(task) for task in track(tasks, "simulated arms")]
    text = "\n\n".join([heading("Simulated arms", {"time step": f"{1e3 * _DT:g} ms"}), _table(results)])
    save(args.out, "simulated_arms_speed", {"results": results}, text)
    return 0


def _measure(task: Mapping[str, Any]) -> Mapping[str, Any]:
    """What was measured, or the reason why that failed."""
    try:
        return measure("multi", task)[0]
    except Rr1PlanError as error:
        return {"failed": str(error)}


def _table(results: Sequence[Mapping[str, Any]]) -> str:
    header = ["spacing [m]", "arms", "models", "threads", "step [us]", "CPU [us]", "real-time factor"]
    header += ["tracking error [rad]", "contacts", "build [s]", "memory [MB]"]
    rows = []
    for r in results:
        if "failed" in r:
            rows.append([number(r["spacing"]), r["arms"], "-", r["threads"], r["failed"], *["-"] * 6])
            continue
        times = (number(r[name]) for name in ("step_us", "cpu_us", "real_time_factor"))
        rest = (number(r["tracking_error_rad"]), r["contacts"], number(r["build_s"]), number(r["memory_mb"]))
        rows.append([number(r["spacing"]), r["arms"], r["models"], r["threads"], *times, *rest])
    return table(header, rows)


if __name__ == "__main__":
    sys.exit(main())
