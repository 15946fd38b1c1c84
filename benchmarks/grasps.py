"""Pick-and-place by friction: is a random object grasped, carried and placed as planned?

    python benchmarks/grasps.py [--count 100] [--kinds box cylinder]

For each seed a box or an upright cylinder of random size, mass and friction stands on a table before an RR1, and is to
be put down elsewhere, turned as the planner likes. The sequence is planned, certified stage by stage, and replayed in
MuJoCo, where the object is a loose body that two fingers hold by contact and friction alone. It counts as carried if it
is always within 1 cm of its planned position, and as placed if it ends within 5 mm and 5 degrees.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import numpy as np
from shared import heading, make_parser, number, pin_to_core, save, spread, table, track

import rr1plan as rp

_RADII, _ANGLES = (0.27, 0.35), (-1.0, 1.0)  # where things are, from the arm's front [m], [rad]
_WIDTHS, _HEIGHTS = (0.02, 0.045), (0.03, 0.08)  # [m]
_MASSES, _FRICTIONS = (0.02, 0.3), (0.5, 1.0)  # [kg]
_APART = 0.12  # least distance between both places [m]
_NEAR, _UPRIGHT = 0.005, np.radians(5.0)


def main(argv: Sequence[str] | None = None) -> int:
    parser = make_parser(__doc__.splitlines()[0], "grasps")
    parser.add_argument("--count", type=int, default=100, help="seeds")
    parser.add_argument(
        "--kinds", nargs="+", choices=("box", "cylinder"), default=("box", "cylinder"), help="objects, in turns"
    )
    args = parser.parse_args(argv)
    pin_to_core(args.core)
    seeds = range(args.seed, args.seed + args.count)
    results = [_run(args.kinds[seed % len(args.kinds)], seed) for seed in track(seeds, "grasps")]
    facts = {
        "seeds": args.count,
        "mass": f"{_MASSES[0]} to {_MASSES[1]} kg",
        "friction": f"{_FRICTIONS[0]} to {_FRICTIONS[1]}",
    }
    text = "\n\n".join([heading("Objects carried by friction", facts), _table(results), _failures(results)])
    save(args.out, "grasps", {"results": results}, text)
    return 0


def _run(kind: str, seed: int) -> dict[str, Any]:
    """Plan and replay one pick-and-place."""
    rng = np.random.default_rng(seed)
    scene, place = _problem(kind, rng)
    began = time.process_time()
    segments = [*rp.pick_and_place(scene, "thing", place), rp.FreeMotion("home")]
    plan = rp.plan_sequence(rp.Sequence(scene, segments), rng=seed)
    answer: dict[str, Any] = {"kind": kind, "seed": seed, "seconds": time.process_time() - began}
    answer |= {"found": plan.found, "certified": bool(plan), "reason": plan.reason}
    if not plan.found:
        return answer
    replay = rp.simulate_sequence(plan)
    thing = replay.objects["thing"]
    placed = thing.final_offset <= _NEAR and thing.angle <= _UPRIGHT
    answer |= {"duration": plan.trajectory.duration, "carried": bool(replay), "placed": bool(placed)}
    answer |= {"max_offset": thing.max_offset, "final_offset": thing.final_offset, "angle": thing.angle}
    answer |= {"max_error": replay.max_error, "contacts": len(replay.contacts)}
    answer["real_time_factor"] = replay.replay.real_time_factor
    return answer


def _problem(kind: str, rng: np.random.Generator) -> tuple[rp.Scene, list[float]]:
    """A scene with an object on a table, and the object's goal."""
    width, depth = rng.uniform(*_WIDTHS, 2)
    height = rng.uniform(*_HEIGHTS)
    shape: rp.Shape = rp.Box((width, depth, height)) if kind == "box" else rp.Cylinder(width / 2, height)
    start, end = np.zeros(2), np.zeros(2)
    while np.linalg.norm(end - start) < _APART:
        start, end = (_somewhere(rng) for _ in range(2))
    scene = rp.Scene(name="grasp").with_arm("arm", rp.load_robot("rr1"))
    scene = scene.with_obstacle("table", rp.Box((1.2, 1.2, 0.04)), [-0.2, 0.0, -0.02]).allow("arm/base_link", "table")
    pose = rp.transforms.pose([*start, height / 2], rpy=[0.0, 0.0, rng.uniform(-np.pi, np.pi)])
    scene = scene.with_obstacle("thing", shape, pose, mass=rng.uniform(*_MASSES), friction=rng.uniform(*_FRICTIONS))
    return scene, [*end.tolist(), height / 2]


def _somewhere(rng: np.random.Generator) -> np.ndarray:
    radius, angle = rng.uniform(*_RADII), rng.uniform(*_ANGLES)
    return np.array([-radius * np.cos(angle), radius * np.sin(angle)])


def _table(results: list[dict[str, Any]]) -> str:
    rows = []
    for kind in sorted({result["kind"] for result in results}):
        own = [result for result in results if result["kind"] == kind]
        found = [result for result in own if result["found"]]
        offsets = spread(result["final_offset"] for result in found)
        most = spread(result["max_offset"] for result in found)
        seconds = spread(result["seconds"] for result in own)
        counts = [sum(bool(result.get(key)) for result in own) for key in ("found", "certified", "carried", "placed")]
        rows.append(
            [
                kind,
                len(own),
                *counts,
                *(
                    number(v)
                    for v in (most["max"], offsets["median"], offsets["max"], seconds["median"], seconds["p95"])
                ),
            ]
        )
    header = [
        "object",
        "seeds",
        "found",
        "certified",
        "carried",
        "placed",
        "off on the way, at most [mm]",
        "off in the end [mm]",
        "at most [mm]",
        "planning [ms]",
        "p95 [ms]",
    ]
    return table(header, rows)


def _failures(results: list[dict[str, Any]]) -> str:
    """Failures, by seed."""
    bad = [result for result in results if not (result["certified"] and result.get("carried") and result.get("placed"))]
    lines = [f"- {r['kind']} {r['seed']}: {r['reason'] or _outcome(r)}" for r in bad]
    return "\n".join(["All of them were carried and placed."] if not lines else ["Not carried or placed:", *lines])


def _outcome(result: dict[str, Any]) -> str:
    off = f"{1e3 * result['max_offset']:.1f} mm off on the way, {1e3 * result['final_offset']:.1f} mm in the end"
    return f"certified {result['certified']}, {off}, {result['contacts']} contacts, error {result['max_error']:.2g}"


if __name__ == "__main__":
    raise SystemExit(main())
