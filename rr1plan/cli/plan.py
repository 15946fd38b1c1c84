"""`plan` for a motion in a scene."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Mapping
from dataclasses import replace

import rr1plan as rp
from rr1plan.checks import millimeters
from rr1plan.cli.console import Console, progress_callback
from rr1plan.cli.exit_codes import INVALID_PLAN, NO_PLAN, OK
from rr1plan.cli.many_arms_output import (
    check_many_arms_options,
    draw_figures,
    kept_margin,
    many_values,
    say_groups,
    say_many,
)
from rr1plan.cli.scene_options import check_scene_name, chosen_problem, page_options, with_limits
from rr1plan.errors import InputError
from rr1plan.export.csv_files import csv_text, save_csv
from rr1plan.files.file_access import check_writable
from rr1plan.motion_plan import MotionPlan
from rr1plan.pipeline import plan_motion
from rr1plan.scene.model_library import load_scene_file


def plan(options: Namespace, console: Console) -> int:
    """Plan a motion, prove it, and write the requested files."""
    look = page_options(options)
    if options.no_shorten and options.planner == "cartesian":
        raise InputError("--no-shorten has no effect with --planner cartesian, whose paths are never shortened")
    check_outputs(options)
    check_scene_name(options.scene)
    with console.watch.stage("load the scene"), console.progress("loading the scene"):
        problem = chosen_problem(options, load_scene_file(options.scene))
        if options.limits is not None:
            problem = with_limits(problem, options.limits)
    check_many_arms_options(options, problem)
    budget = rp.Budget(options.seconds, options.iterations)
    with console.progress("planning") as advance:
        motion = plan_motion(
            problem,
            planner=options.planner,
            retiming=options.retiming,
            shorten=not options.no_shorten,
            margin=options.margin,
            torque_limits=options.torque_limits,
            budget=budget,
            rng=options.seed,
            progress=progress_callback(advance),
        )
    if not motion.result.found:
        return report_no_plan(motion, console)
    if "-" in (options.output, options.csv):
        console.leave_stdout()
    files: Mapping[str, str] = {}
    if not options.given.isdisjoint(("--output", "--csv", "--html", "--timeline", "--diagram")):
        with console.watch.stage("write the files"):
            files = _save(motion, options, look, console)
    motion = with_stages(motion, console.watch.seconds)
    console.say(str(motion))
    if options.margin is not None and (kept := kept_margin(motion)) < options.margin:
        wanted = millimeters(options.margin, 4)
        console.say(f"margin: {millimeters(kept)} kept, not {wanted}, because there is too little room")
    say_many(motion, console)
    for kind, file in files.items():
        console.say(f"{kind}: {file}")
    console.result({**summary(motion), **many_values(motion), "files": files})
    return OK if motion.valid else INVALID_PLAN


def with_stages(motion: MotionPlan, stages: Mapping[str, float]) -> MotionPlan:
    """The motion with the wall times of the command's stages added to those of planning."""
    first, last = ({n: s for n, s in stages.items() if (n == "write the files") is late} for late in (False, True))
    planning = {name: seconds for name, seconds in motion.seconds.items() if name != "imports"}
    return replace(motion, seconds={**first, **planning, **last})


def summary(motion: MotionPlan) -> dict[str, object]:
    """A motion plan as plain values, for JSON."""
    result, many = motion.result, motion.many_arms
    paths = [motion.path] if many is None else list(many.paths.values())
    return {
        "status": motion.status.value,
        "reason": result.reason,
        "planner": result.planner,
        "seed": result.seed,
        "seconds": dict(motion.seconds),
        "waypoints": sum(map(len, paths)),
        "length": sum(path.length for path in paths),
        "margin": motion.margin if many is None else None,
        "duration": motion.trajectory.duration,
        "report": motion.report.to_dict(),
    }


def report_no_plan(motion: MotionPlan, console: Console) -> int:
    """Print why there is no plan, and return the exit code."""
    if console.as_json:
        result = motion.result
        said = {"status": motion.status.value, "reason": result.reason, "planner": result.planner}
        console.result({**said, **many_values(motion)})
    else:
        console.error(str(motion), NO_PLAN)
        if motion.many_arms is not None:
            say_groups(motion.many_arms, console)
    return NO_PLAN


def check_outputs(options: Namespace) -> None:
    """Reject outputs that cannot be written, before any work; standard output takes only one output."""
    taken = [name for name in ("--output", "--csv") if getattr(options, name[2:]) == "-"]
    if options.json and taken:
        raise InputError(f"--json and {taken[0]} - both write to standard output; name a file for one of them")
    if options.embed and options.output == "-":
        raise InputError("--embed has no effect with --output -, which always holds all meshes")
    for name, suffix in (("output", ".json"), ("csv", ".csv"), ("html", ".html")):
        if getattr(options, name) not in (None, "-"):
            check_writable(getattr(options, name), suffix)
    for file in filter(None, (options.timeline, options.diagram)):
        check_writable(file)


def _save(motion: MotionPlan, options: Namespace, look: rp.ViewOptions | None, console: Console) -> Mapping[str, str]:
    files = {}
    if options.output == "-":
        console.write(motion.to_json())
    elif options.output is not None:
        files["motion"] = str(motion.save(options.output, embed=options.embed))
    if options.csv == "-":
        console.write(csv_text(motion.trajectory))
    elif options.csv is not None:
        files["csv"] = str(save_csv(options.csv, motion.trajectory))
    if options.html is not None:
        files["page"] = str(motion.save_html(options.html, options=look))
    files |= draw_figures(motion, options, console)
    return files
