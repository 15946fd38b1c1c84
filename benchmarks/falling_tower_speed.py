"""Simulated time per second of computation while a tower of boat-shaped hulls of 256 triangles falls.

    python benchmarks/falling_tower_speed.py [--boats 10 20 50 100 200 500] [--solvers newton cg] [--threads 1 2]

The experiment `dynamic` of `rr1plan experiment`, with other solvers, threads and time steps.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from typing import Any

from shared import heading, make_parser, number, save, table, track

from rr1plan.experiments.measuring_process import measure


def main(argv: Sequence[str] | None = None) -> int:
    parser = make_parser(__doc__.splitlines()[0], "falling_tower_speed")
    parser.add_argument("--boats", type=int, nargs="+", default=(10, 20, 50, 100, 200, 500), help="boats in the tower")
    parser.add_argument("--solvers", nargs="+", default=("newton", "cg"), help="solvers of the simulation")
    parser.add_argument("--threads", type=int, nargs="+", default=(1,), help="threads of the simulation")
    parser.add_argument("--dt", type=float, default=0.008, help="time step [s]")
    parser.add_argument("--seconds", type=float, default=6.0, help="simulated time of a measurement")
    args = parser.parse_args(argv)
    common = {"dt": args.dt, "seconds": args.seconds, "seed": args.seed}
    tasks = [
        {"boats": boats, "solver": solver, "threads": threads} | common
        for boats in args.boats
        for solver in args.solvers
        for threads in args.threads
    ]
    results = [task | {"windows": measure("dynamic", task)} for task in track(tasks, "towers")]
    text = "\n\n".join([heading("Falling tower", {"time step": f"{1e3 * args.dt:g} ms"}), _table(results)])
    save(args.out, "falling_tower_speed", {"results": results}, text)
    return 0


def _table(results: Sequence[Mapping[str, Any]]) -> str:
    header = ["boats", "solver", "threads", "real-time factor", "deepest penetration [mm]", "at the end [mm]"]
    header += ["lowest point [mm]", "contacts", "fastest [m/s]"]
    rows = []
    for r in results:
        # With one thread, processor time is measured.
        clock = "cpu_real_time_factor" if r["threads"] == 1 else "real_time_factor"
        windows = r["windows"]
        each = (" / ".join(number(w[name]) for w in windows) for name in (clock, "penetration_mm"))
        end = (windows[-1][name] for name in ("penetration_at_end_mm", "lowest_point_mm", "contacts", "speed_m_s"))
        rows.append([r["boats"], r["solver"], r["threads"], *each, *map(number, end)])
    return table(header, rows)


if __name__ == "__main__":
    sys.exit(main())
