"""Success, collisions and times of rr1plan and its peers on the same problems.

    python benchmarks/panda_problems.py PROBLEMS.json.gz --robot panda.urdf [--peers FOLDER]
    python benchmarks/panda_problems.py --scene rr1_table rr1_shelf [--peers FOLDER]

Problems are MotionBenchMaker's, or the queries of scenes that ship with rr1plan. Every problem runs through all stages
of rr1plan (RRT-Connect, shortening, retiming, the referee), and with `--peers` through every other planner that can be
installed with pip, each in a separate environment in that folder, on the same core, with the same convex
hulls. Each problem is planned several times, with different seeds: a planner's first query in a scene has cold
caches, later ones do not, and all of them count. Each path is shortened, timed and validated before the next
query; with `--order paths` a problem's paths are planned and shortened one after the other, and then its motions
timed and validated. The raw path, the short path and the timed motion of the first run are sampled so finely that no
point of the robot moves more than a millimeter, and every sample is checked by Coal and python-fcl.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import peers
from comparison import KINDS, Run, compare, excess
from line import STAGES, Outcome, find_margin, find_path, run_line, time_motion, warm_up
from picture import draw
from plain import describe_changes, describe_problem, settle
from shared import STAGE_HEADER, heading, make_parser, number, pin_to_core, save, spread, stage_rows, table, track

import rr1plan as rp
from rr1plan.scene.motion_bench import problem_set_joints, read_problem_set

_STEP = 0.002  # step of the samples for speed and acceleration [s]
_REFERENCE = peers.PEERS[0].name
# By the problem's name and the kind of motion that was judged.
_Verdicts = Mapping[str, Mapping[str, rp.SecondOpinion]]
_CHECKERS = ("Coal", "FCL")


def main(argv: Sequence[str] | None = None) -> int:
    parser = _parser()
    args = parser.parse_args(argv)
    pin_to_core(args.core)
    try:
        problems = _problems(args)
    except rp.Rr1PlanError as error:
        parser.error(str(error))
    chosen, seeds = _ask_again(problems, args)
    firsts = {name: problem for name, problem in chosen.items() if name in problems}
    warm_up()
    settings = {"planner": args.planner, "margin": args.margin, "seconds": args.seconds}
    first = next(iter(chosen))
    run_line(first, chosen[first], seeds[first], **settings)  # not counted, as for the peers
    outcomes = [
        out
        for problem in track(list(firsts.values()), "rr1plan")
        for out in _run(problem, {n: seeds[n] for n, q in chosen.items() if q is problem}, args.order, settings)
    ]
    others = _ask_peers(args, chosen, seeds)
    judged = [o for o in outcomes if o.name in firsts]
    # The first query in a scene builds its tables.
    clocks = [(o.name, o.clock.cpu) for o in outcomes]
    clocks += [(answer["name"], answer["seconds"]) for run in others for answer in run.answers]
    for name, seconds in clocks:
        if name not in firsts:
            seconds.pop("set up", None)
    verdicts = {o.name: _judge(o, firsts[o.name].scene) for o in track(judged, "rr1plan at a millimeter")}
    for run in others:
        answers = [answer for answer in run.solved if answer["name"] in firsts]
        for answer in track(answers, f"{run.name} at a millimeter") if answers else ():
            answer |= _judge_peer(answer, chosen[answer["name"]].scene)
    runs = [_own_run(args.planner, chosen, outcomes, verdicts), *others]
    facts = {
        "problems": len(firsts),
        "asked": len(chosen),
        "seed": args.seed,
        "order": args.order,
        "margin": f"{1e3 * args.margin:g} mm",
    }
    text = "\n\n".join(_report(facts, runs, outcomes, verdicts))
    save(args.out, "panda_problems", _data(facts, runs, outcomes, verdicts), text)
    draw(args.out / "panda_problems.png", runs, f"{len(firsts)} {_title(args)}, one core")
    touching = sum(not v.free for found in verdicts.values() for v in found.values())
    return 0 if touching == 0 and all(o.certified for o in outcomes) else 1


def _parser() -> argparse.ArgumentParser:
    parser = make_parser("the same problems for rr1plan and its peers", "panda_problems")
    parser.add_argument("file", type=Path, nargs="?", help="MotionBenchMaker's problems (.json or .json.gz)")
    parser.add_argument("--robot", type=Path, help="their robot's URDF")
    parser.add_argument("--srdf", type=Path, help="its SRDF (default: beside the URDF)")
    parser.add_argument("--scene", nargs="+", default=[], help="shipped scenes of one arm, in place of a file")
    parser.add_argument("--every", type=int, default=1, help="take every n-th problem")
    parser.add_argument("--seeds", type=int, default=5, help="number of runs of each problem")
    parser.add_argument("--order", choices=("each", "paths"), default="each", help="prove each motion, or paths first")
    parser.add_argument("--planner", default="rrt_connect", help="a name of planner_names()")
    parser.add_argument("--margin", type=float, default=0.002, help="distance to keep while planning [m]")
    parser.add_argument("--seconds", type=float, default=30.0, help="longest search of any planner [s]")
    parser.add_argument("--peers", type=Path, help="folder of the peers' virtual environments; made when missing")
    names = list(dict.fromkeys(peer.environment for peer in peers.PEERS))
    parser.add_argument("--only", nargs="+", choices=names, default=names, help="the peers to ask")
    parser.add_argument(
        "--python",
        action="append",
        default=[],
        type=_interpreter,
        metavar="PEER=PATH",
        help="an interpreter that can import a peer, in place of one in the folder; may be repeated",
    )
    return parser


def _interpreter(text: str) -> tuple[str, Path]:
    name, _, path = text.partition("=")
    if name not in {peer.environment for peer in peers.PEERS} or not path:
        raise argparse.ArgumentTypeError(f"{text!r}, expected a peer's name, = and the path of a Python")
    return name, Path(path)


def _problems(args: argparse.Namespace) -> Mapping[str, rp.Problem]:
    if (args.file is None) == (not args.scene):
        raise rp.InputError("expected either a file of problems or --scene")
    if args.scene:
        queries = {scene: rp.load_problems(scene) for scene in args.scene}
        return {f"{s}/{name}": settle(query, args.seed) for s, own in queries.items() for name, query in own.items()}
    if args.robot is None:
        raise rp.InputError("a file of problems needs --robot, the URDF of their robot")
    robot = rp.load_robot(args.robot, srdf=args.srdf, joints=problem_set_joints(args.file))
    return read_problem_set(args.file, robot)


def _ask_again(
    problems: Mapping[str, rp.Problem], args: argparse.Namespace
) -> tuple[dict[str, rp.Problem], dict[str, int]]:
    """Every n-th problem, repeated under separate names, and their seeds."""
    chosen, seeds = {}, {}
    for i, (name, problem) in enumerate(problems.items()):
        if i % args.every == 0:
            for k in range(args.seeds):
                asked = f"{name}, again {k}" if k else name
                chosen[asked], seeds[asked] = problem, args.seed + i + k * len(problems)
    return chosen, seeds


def _title(args: argparse.Namespace) -> str:
    return "problems of MotionBenchMaker" if args.file else f"queries of {', '.join(args.scene)}"


def _run(problem: rp.Problem, seeds: Mapping[str, int], order: str, settings: Mapping[str, Any]) -> list[Outcome]:
    """A problem's results: each proven before the next, or all paths and then all motions."""
    if order == "each":
        return [run_line(name, problem, seed, **settings) for name, seed in seeds.items()]
    outcomes = [Outcome(name) for name in seeds]
    settings = {**settings, "margin": find_margin(outcomes[0], problem, settings["margin"])}
    answered = [find_path(out, problem, seeds[out.name], **settings) for out in outcomes]
    for out, roomy in zip(outcomes, answered, strict=True):
        time_motion(out, problem, roomy)
    return outcomes


# ---- peers and judging -----------------------------------------------------------------------------


def _ask_peers(args: argparse.Namespace, problems: Mapping[str, rp.Problem], seeds: Mapping[str, int]) -> list[Run]:
    """Every peer's results, or the reason why it has none."""
    given = dict(args.python)
    if args.peers is None and not given:
        return []
    runs = []
    changes = dict.fromkeys(filter(None, map(describe_changes, problems.values())))
    with tempfile.TemporaryDirectory() as folder:
        for peer in peers.PEERS:
            if peer.environment not in args.only:
                continue
            note = "; ".join([peer.note, *changes])
            try:
                descriptions = [
                    {"name": name, "seed": 1 + seeds[name], **describe_problem(problem, Path(folder))}
                    for name, problem in problems.items()
                ]
                python = peers.interpreter(peer, args.peers, given)
                runs.append(Run(peer.name, peers.ask(peer, python, descriptions, args.seconds), note))
            except (peers.PeerMissing, rp.InputError) as error:
                runs.append(Run(peer.name, [], note, skipped=str(error)))
    return runs


def _judge(out: Outcome, scene: rp.Scene) -> dict[str, rp.SecondOpinion]:
    if out.raw is None or out.path is None or out.trajectory is None:
        return {}
    motions = {"raw": out.raw, "path": out.path, "timed": out.trajectory}
    return {kind: rp.second_opinion(motion, scene, checkers=_CHECKERS) for kind, motion in motions.items()}


def _touches(opinion: rp.SecondOpinion) -> dict[str, tuple[str, str, float] | None]:
    """The first contact that each checker finds: two elements and a time, or None."""
    firsts = {name: opinion.first_contact(name) for name in opinion.checkers}
    return {name: None if first is None else (*first.pair, first.first) for name, first in firsts.items()}


def _judge_peer(answer: dict[str, Any], scene: rp.Scene) -> dict[str, Any]:
    """First contacts of its paths and timed samples by Coal and FCL, and how far it exceeds its limits."""
    paths = {kind: rp.Path(scene.joint_names(), answer[kind]) for kind in KINDS if kind in answer}
    judged: dict[str, Any] = {
        "touches": {kind: _touches(rp.second_opinion(p, scene, checkers=_CHECKERS)) for kind, p in paths.items()}
    }
    if "timed" in answer:
        judged["excess"] = excess(answer["timed"], answer["step"], scene.limits())
    return judged


def _own_run(planner: str, problems: Mapping[str, rp.Problem], outcomes: list[Outcome], verdicts: _Verdicts) -> Run:
    name = "rr1plan" if planner == "rrt_connect" else f"rr1plan {planner}"
    answers = [_answer(out, verdicts.get(out.name, {}), problems[out.name].scene.limits()) for out in outcomes]
    return Run(name, answers, "every edge certified; set up builds its checker for a new scene")


def _answer(out: Outcome, verdicts: Mapping[str, rp.SecondOpinion], limits: rp.Limits) -> dict[str, Any]:
    """rr1plan's result in the form of the comparison."""
    answer: dict[str, Any] = {"name": out.name, "seconds": out.clock.cpu}
    if out.raw is None or out.path is None:
        return answer | {"failure": out.reason}
    answer |= {"raw": out.raw.waypoints, "path": out.path.waypoints}
    if out.trajectory is not None:
        samples = out.trajectory(np.arange(0.0, out.trajectory.duration, _STEP))
        answer |= {"duration": out.trajectory.duration, "excess": excess(samples, _STEP, limits)}
    return answer | {"touches": {kind: _touches(found) for kind, found in verdicts.items()}}


# ---- telling ---------------------------------------------------------------------------------------


def _report(facts: dict[str, Any], runs: list[Run], outcomes: list[Outcome], verdicts: _Verdicts) -> list[str]:
    solved = [o for o in outcomes if o.solved]
    first, later = ([o.clock for o in solved if (o.name in verdicts) == is_first] for is_first in (True, False))
    parts = [heading("The same problems for rr1plan and its peers", facts), *compare(runs, _REFERENCE)]
    parts += ["## rr1plan in detail", _counts(outcomes, verdicts)]
    parts += ["A scene's first question:", table(STAGE_HEADER, stage_rows(first, STAGES))]
    if later:
        parts += ["Those after it:", table(STAGE_HEADER, stage_rows(later, STAGES[1:]))]
    clearances = [1e3 * float(o.report.margins["clearance"]) for o in solved if o.report and o.report.valid]
    parts.append(f"Least clearance of a timed motion: median {number(spread(clearances, 1.0)['median'])} mm.")
    faults = [f"- {o.name}: {o.status} {o.reason} {_violations(o)}".rstrip() for o in outcomes if not o.certified]
    faults += [
        f"- {o.name} {k}: {_touches(v)}" for o in outcomes for k, v in verdicts.get(o.name, {}).items() if not v.free
    ]
    return [*parts, "\n".join(["What went wrong:", "", *faults])] if faults else parts


def _counts(outcomes: list[Outcome], verdicts: _Verdicts) -> str:
    rows = [
        ["solved", f"{sum(o.solved for o in outcomes)} / {len(outcomes)}"],
        ["certified by the referee", f"{sum(o.certified for o in outcomes)} / {len(outcomes)}"],
    ]
    for kind in KINDS:
        found = [v[kind] for v in verdicts.values() if v]
        samples = sum(v.samples for v in found)
        for opinion in _CHECKERS:
            touching = sum(v.first_contact(opinion) is not None for v in found)
            rows.append([f"{kind}: in collision by {opinion} ({samples:,} samples)", f"{touching} / {len(found)}"])
    return table(["what", "count"], rows)


def _data(facts: dict[str, Any], runs: list[Run], outcomes: list[Outcome], verdicts: _Verdicts) -> dict[str, Any]:
    problems = [
        out.to_dict()
        | {"opinions": {k: {"samples": v.samples, "asked": v.queries} for k, v in verdicts.get(out.name, {}).items()}}
        for out in outcomes
    ]
    return {"settings": facts, "problems": problems, "runs": [run.to_dict() for run in runs]}


def _violations(out: Outcome) -> str:
    return "" if out.report is None else "; ".join(v.message for v in out.report.violations)


if __name__ == "__main__":
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        sys.exit(130)
