"""The Panda problems of MotionBenchMaker: solved, clean, and how fast beside roboplan.

    python benchmarks/panda_problems.py PROBLEMS.json.gz --robot panda.urdf [--peer-env FOLDER]

Every problem goes through the whole line: RRT-Connect, shortening, retiming, the referee. The raw path,
the short path and the timed motion are then sampled so finely that no point of the robot moves more than
a millimetre, and every sample is asked of Coal and of python-fcl. With `--peer-env` roboplan answers the same
problems in the same run, and its paths are judged by the same samples.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from line import STAGES, Outcome, run_line, warm_up
from opinions import Opinions, Verdict
from peer import PEER, STEPS, ask_peer
from shared import (
    STAGE_HEADER,
    heading,
    make_parser,
    number,
    pin_to_core,
    save,
    save_distribution,
    spread,
    stage_rows,
    table,
    track,
)

import rr1plan as rp
from rr1plan.formats.motion_bench import read_problem_set

_KINDS = ("raw", "short", "timed")


def main(argv: Sequence[str] | None = None) -> int:
    args = _arguments(argv)
    pin_to_core(args.core)
    problems = read_problem_set(args.file, rp.load_robot(args.robot, srdf=args.srdf))
    names = list(problems)[:: args.every]
    warm_up()
    seeds = {name: args.seed + i for i, name in enumerate(problems)}
    outcomes = [
        run_line(n, problems[n], seeds[n], planner=args.planner, margin=args.margin) for n in track(names, "rr1plan")
    ]
    srdf = args.srdf or args.robot.with_suffix(".srdf")
    peers = ask_peer(args.peer_env, args.file, args.robot, srdf, names, args.seed + 1) if args.peer_env else []
    opinions = {name: Opinions(problems[name].scene) for name in names}
    verdicts = [_judge(o, opinions[o.name]) for o in track(outcomes, "1 mm samples")]
    for answer in track(peers, "1 mm samples of the peer") if peers else ():
        answer["touches"] = _judge_peer(answer, opinions[answer["name"]])
    facts = {"problems": len(names), "planner": args.planner, "seed": args.seed, "margin": f"{1e3 * args.margin:g} mm"}
    text = "\n\n".join(_report(facts, outcomes, verdicts, peers))
    save(args.out, "panda_problems", _data(facts, outcomes, verdicts, peers), text)
    _draw(args.out / "panda_problems.png", outcomes, peers)
    touching = sum(not v.free for found in verdicts for v in found.values())
    return 0 if touching == 0 and all(o.certified for o in outcomes) else 1


def _arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = make_parser("MotionBenchMaker's Panda problems", "panda_problems")
    parser.add_argument("file", type=Path, help="the problems (.json or .json.gz)")
    parser.add_argument("--robot", type=Path, required=True, help="the Panda's URDF")
    parser.add_argument("--srdf", type=Path, help="its SRDF (default: beside the URDF)")
    parser.add_argument("--every", type=int, default=1, help="take every n-th problem")
    parser.add_argument("--planner", default="rrt_connect", help="a name of planner_names()")
    parser.add_argument("--margin", type=float, default=0.002, help="distance to keep while planning [m]")
    parser.add_argument("--peer-env", type=Path, help=f"folder of a virtual environment with {PEER}; made when missing")
    return parser.parse_args(argv)


# ---- judging and telling ---------------------------------------------------------------------------


def _judge(out: Outcome, opinions: Opinions) -> dict[str, Verdict]:
    if out.raw is None or out.path is None or out.trajectory is None:
        return {}
    raw, short = opinions.judge_path(out.raw.waypoints), opinions.judge_path(out.path.waypoints)
    return {"raw": raw, "short": short, "timed": opinions.judge_trajectory(out.trajectory)}


def _judge_peer(answer: dict[str, Any], opinions: Opinions) -> dict[str, Any]:
    """First touches of its raw and its short path, by Coal and FCL."""
    if "raw" not in answer:
        return {}
    return {kind: opinions.judge_path(answer[key]).touches for kind, key in (("raw", "raw"), ("short", "path"))}


def _report(
    facts: dict[str, Any], outcomes: list[Outcome], verdicts: list[dict[str, Verdict]], peers: list[dict[str, Any]]
) -> list[str]:
    solved = [o for o in outcomes if o.solved]
    parts = [heading("MotionBenchMaker's Panda problems", facts)]
    certified = sum(o.certified for o in outcomes)
    rows = [
        ["solved", f"{len(solved)} / {len(outcomes)}"],
        ["certified by the referee", f"{certified} / {len(outcomes)}"],
    ]
    for kind in _KINDS:
        found = [v[kind] for v in verdicts if v]
        samples = sum(v.samples for v in found)
        for opinion in ("Coal", "FCL"):
            touching = sum(v.touches[opinion] is not None for v in found)
            rows.append([f"{kind}: in collision by {opinion} ({samples:,} samples)", f"{touching} / {len(found)}"])
    parts += [table(["what", "count"], rows), table(STAGE_HEADER, stage_rows([o.clock for o in solved], STAGES))]
    parts.append(table(["measure", "median", "p95", "max"], _measures(solved)))
    parts.append(
        table(["scene", "solved", "certified", "plan [ms]", "shorten [ms]", "validate [ms]"], _scenes(outcomes))
    )
    if peers:
        parts += [_comparison(solved, verdicts, peers), _ratio(solved, peers)]
    faults = [f"- {o.name}: {o.status} {o.reason} {_violations(o)}".rstrip() for o in outcomes if not o.certified]
    faults += [
        f"- {o.name} {k}: {v.touches}"
        for o, vs in zip(outcomes, verdicts, strict=True)
        for k, v in vs.items()
        if not v.free
    ]
    return [*parts, "\n".join(["What went wrong:", "", *faults])] if faults else parts


def _violations(out: Outcome) -> str:
    return "" if out.report is None else "; ".join(v.message for v in out.report.violations)


def _measures(solved: list[Outcome]) -> list[list[str]]:
    rows = []
    for name, values in (
        ("length of the raw path [rad]", [o.raw.length for o in solved if o.raw]),
        ("length of the short path [rad]", [o.path.length for o in solved if o.path]),
        ("duration [s]", [o.trajectory.duration for o in solved if o.trajectory]),
        ("clearance [mm]", [1e3 * float(o.report.margins["clearance"]) for o in solved if o.report and o.report.valid]),
    ):
        found = spread(values, 1.0)
        rows.append([name, *(number(found[k]) for k in ("median", "p95", "max"))])
    return rows


def _scenes(outcomes: list[Outcome]) -> list[list[str]]:
    rows = []
    for group in dict.fromkeys(o.name.rsplit("/", 1)[0] for o in outcomes):
        own = [o for o in outcomes if o.name.rsplit("/", 1)[0] == group]
        medians = [
            number(spread(o.clock.cpu[s] for o in own if s in o.clock.cpu)["median"])
            for s in ("plan", "shorten", "validate")
        ]
        rows.append([group, f"{sum(o.solved for o in own)}", f"{sum(o.certified for o in own)}", *medians])
    return rows


def _times(solved: list[Outcome]) -> dict[str, list[float]]:
    """Ours [s]: `plan` with the checker's building and without, and both with shortening."""
    search = [o.clock.cpu["plan"] for o in solved]
    plan = [o.clock.cpu["set up"] + o.clock.cpu["plan"] for o in solved]
    shorten = [o.clock.cpu["shorten"] for o in solved]
    return {
        "plan": plan,
        "both": [a + b for a, b in zip(plan, shorten, strict=True)],
        "search": search,
        "search both": [a + b for a, b in zip(search, shorten, strict=True)],
        "set up": [o.clock.cpu["set up"] for o in solved],
    }


def _peer_times(peers: list[dict[str, Any]], step: float) -> tuple[list[dict[str, Any]], list[float], list[float]]:
    done = [p for p in peers if p["step"] == step and "raw" in p]
    return done, [p["plan"] for p in done], [p["plan"] + p["shorten"] for p in done]


def _comparison(solved: list[Outcome], verdicts: list[dict[str, Verdict]], peers: list[dict[str, Any]]) -> str:
    times = _times(solved)
    header = ["planner", "solved", "set up", "plan median", "plan p95", "plan+shorten median", "plan+shorten p95"]
    header += ["length raw", "length short", "touch raw", "touch short"]
    found = [v for v in verdicts if v]
    touch = [f"{100 * np.mean([not v[k].free for v in found]):.1f} %" for k in ("raw", "short")]
    lengths = [
        number(np.median([_length(p.waypoints) for o in solved if (p := getattr(o, k))])) for k in ("raw", "path")
    ]
    rows = []
    for label, one, two, set_up in (
        ("rr1plan, set up included", "plan", "both", "-"),
        ("rr1plan, set up apart", "search", "search both", number(spread(times["set up"])["median"])),
    ):
        rows.append([label, str(len(solved)), set_up, *_two(times[one]), *_two(times[two]), *lengths, *touch])
    for step in STEPS:
        done, plan, both = _peer_times(peers, step)
        share = [f"{100 * np.mean([any(p['touches'][k].values()) for p in done]):.1f} %" for k in ("raw", "short")]
        own = [number(np.median([_length(p[k]) for p in done])) for k in ("raw", "path")]
        set_up = number(spread(p["set up"] for p in done)["median"])
        rows.append([f"{PEER} at {step} rad", str(len(done)), set_up, *_two(plan), *_two(both), *own, *share])
    return "CPU milliseconds, on the same core in the same run:\n\n" + table(header, rows)


def _two(seconds: list[float]) -> list[str]:
    found = spread(seconds)
    return [number(found["median"]), number(found["p95"])]


def _length(waypoints: Any) -> float:
    return float(np.linalg.norm(np.diff(np.array(waypoints), axis=0), axis=1).sum())


def _ratio(solved: list[Outcome], peers: list[dict[str, Any]]) -> str:
    """Our medians as multiples of the peer's at the step where its paths are clean."""
    times = _times(solved)
    _, plan, both = _peer_times(peers, STEPS[-1])
    ratios = [np.median(times[k]) / np.median(p) for k, p in (("plan", plan), ("both", both))]
    return f"Ratio of the medians to {PEER} at {STEPS[-1]} rad: plan {ratios[0]:.2f}, plan and shorten {ratios[1]:.2f}."


def _data(
    facts: dict[str, Any], outcomes: list[Outcome], verdicts: list[dict[str, Verdict]], peers: list[dict[str, Any]]
) -> dict[str, Any]:
    answers = []
    for out, found in zip(outcomes, verdicts, strict=True):
        judged = {k: {"samples": v.samples, "asked": v.asked, "touches": v.touches} for k, v in found.items()}
        answers.append(out.to_dict() | {"opinions": judged})
    peer = [{k: v for k, v in p.items() if k not in ("raw", "path")} for p in peers]
    return {"settings": facts, "problems": answers, "peer": {"package": PEER, "answers": peer} if peers else None}


def _draw(file: Path, outcomes: list[Outcome], peers: list[dict[str, Any]]) -> None:
    times = _times([o for o in outcomes if o.solved])
    curves = {"rr1plan: plan": times["plan"], "rr1plan: plan and shorten": times["both"]}
    for step in STEPS if peers else ():
        _, plan, both = _peer_times(peers, step)
        curves |= {f"roboplan at {step}: plan": plan, f"roboplan at {step}: plan and shorten": both}
    save_distribution(file, {k: [1e3 * s for s in v] for k, v in curves.items()}, "CPU time [ms]")


if __name__ == "__main__":
    sys.exit(main())
