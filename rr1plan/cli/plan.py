"""`plan`, `validate` and `play`."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import rr1plan as rp
from rr1plan.cli.console import Console
from rr1plan.cli.many_arms_output import check_figures, many_values, save_figures, say_groups, say_many
from rr1plan.errors import InputError
from rr1plan.export.csv_files import csv_text, save_csv
from rr1plan.export.motion_files import is_motion_file
from rr1plan.files.file_access import check_writable
from rr1plan.motion_plan import MotionPlan
from rr1plan.pipeline import plan_motion
from rr1plan.planning import ProgressCallback
from rr1plan.progress_bar import Advance
from rr1plan.scene.model_library import (
    installed_robot_names,
    load_problems,
    load_scene_file,
    robot_names,
    scene_names,
)
from rr1plan.scene.problem import Problem
from rr1plan.scene.scene_toml import SceneFile

ROBOT_SUFFIXES = (".urdf", ".xacro")
"""Suffixes of files that hold a robot and no scene; MJCF files hold both."""


def plan(options: Namespace, console: Console) -> int:
    """Plan a motion, prove it, and write the requested files."""
    look = page_options(options)
    if options.no_shorten and options.planner == "cartesian":
        raise InputError("--no-shorten has no effect with --planner cartesian, whose paths are never shortened")
    check_outputs(options)
    check_scene_name(options.scene)
    with console.watch.stage("load the scene"), console.progress("loading the scene"):
        problem = question(options, load_scene_file(options.scene))
        if options.limits is not None:
            problem = with_limits(problem, options.limits)
    check_figures(options, problem)
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
            progress=told_to(advance),
        )
    if not motion.result.found:
        return _no_plan(motion, console)
    if "-" in (options.output, options.csv):
        console.leave_stdout()
    files: Mapping[str, str] = {}
    if not options.given.isdisjoint(("--output", "--csv", "--html", "--timeline", "--diagram")):
        with console.watch.stage("write the files"):
            files = _save(motion, options, look, console)
    motion = with_stages(motion, console.watch.seconds)
    console.say(str(motion))
    say_many(motion, console)
    for kind, file in files.items():
        console.say(f"{kind}: {file}")
    console.result({**summary(motion), **many_values(motion), "files": files})
    return 0 if motion.valid else 4


def with_stages(motion: MotionPlan, stages: Mapping[str, float]) -> MotionPlan:
    """The motion with the wall times of the command's stages added to those of planning."""
    first, last = ({n: s for n, s in stages.items() if (n == "write the files") is late} for late in (False, True))
    planning = {name: seconds for name, seconds in motion.seconds.items() if name != "imports"}
    return replace(motion, seconds={**first, **planning, **last})


def check_scene_name(name: str) -> None:
    """Reject robots, motions and recordings in place of a scene; the message names the commands that take them.

    Raises:
        InputError: not a scene.
    """
    file = Path(name)
    if name in scene_names():
        return
    if name in (*robot_names(), *installed_robot_names()) or file.suffix.lower() in ROBOT_SUFFIXES:
        raise InputError(
            f"{name} is a robot, expected a scene: a file with the lines [arms.NAME] and robot = {name!r}; to see the "
            f"robot: rr1plan view {name}"
        )
    if file.is_file() and file.suffix == ".jsonl":
        raise InputError(f"{name} is a recording, expected a scene; to see it: rr1plan mirror {name}")
    if file.is_file() and is_motion_file(name):
        raise InputError(
            f"{name} holds a motion, expected a scene; to see it: rr1plan view {name}, to check it: rr1plan validate "
            f"{name}"
        )


def question(options: Namespace, file: SceneFile) -> Problem:
    """The problem given by the options, or the scene's first query.

    Raises:
        InputError: a scene without queries and no goal.
    """
    if options.goal is None and options.position is None:
        problem = _chosen(options.scene, file.problems, options.query)
        return problem if options.start is None else rp.Problem(problem.scene, words(options.start), dict(problem.goal))
    arm = file.scene.only_arm(options.arm)
    if options.goal is not None:
        goal: Any = words(options.goal)
    else:
        goal = rp.PoseGoal(options.frame or "tool", options.position, options.quaternion)
    start = None if options.start is None else {arm: words(options.start)}
    return rp.Problem(file.scene, start, {arm: goal})


def named_query(scene: str, name: str | None) -> Problem:
    """A query of a scene by name, or its first.

    Raises:
        UnknownNameError: no query of that name.
        InputError: the scene has no queries.
    """
    return _chosen(scene, load_problems(scene), name)


def _chosen(scene: str, queries: Mapping[str, Problem], name: str | None) -> Problem:
    """The query of that name, or the first."""
    if not queries:
        raise InputError(f"scene {scene!r} has no queries; give a goal (option goal, option position)")
    if name is None:
        name = next(iter(queries))
    elif name not in queries:
        raise rp.UnknownNameError("query", name, queries)
    return queries[name]


def page_options(options: Namespace) -> rp.ViewOptions | None:
    """The view options of the command line; None if it gives none, so that no viewer is loaded.

    Raises:
        UnknownNameError: no such view.
        InputError: numbers that are neither angles nor a direction.
    """
    spheres = getattr(options, "spheres", False)
    if options.view is None and not spheres:
        return None
    view = None if options.view is None else words(options.view, "a view's name")
    return rp.ViewOptions(view=view, spheres=spheres)


def words(values: list[str], name: str = "a configuration's name") -> Any:
    """The values of an option: a name, or numbers.

    Raises:
        InputError: several words that are not numbers.
    """
    try:
        return [float(value) for value in values]
    except ValueError:
        if len(values) == 1:
            return values[0]
        raise InputError(f"{' '.join(values)!r} is neither {name} nor numbers") from None


def with_limits(problem: Problem, preset: str) -> Problem:
    """The problem with every arm under a limit preset of its robot."""
    scene = problem.scene
    for name, arm in scene.arms.items():
        scene = scene.with_robot(name, arm.robot.with_limits(preset))
    return rp.Problem(scene, problem.start, dict(problem.goal), arms=problem.arms)


_STAGES = {"set up": "preparing the scene", "shorten": "shortening", "retime": "retiming", "validate": "proving"}


def told_to(advance: Advance) -> ProgressCallback:
    """A planner's progress callback that advances a progress bar."""
    return lambda progress: advance(progress.fraction, _STAGES.get(progress.stage, ""))


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
        "duration": motion.trajectory.duration,
        "report": motion.report.to_dict(),
    }


def _no_plan(motion: MotionPlan, console: Console) -> int:
    if console.as_json:
        result = motion.result
        said = {"status": motion.status.value, "reason": result.reason, "planner": result.planner}
        console.result({**said, **many_values(motion)})
    else:
        console.error(str(motion), 3)
        if motion.many_arms is not None:
            say_groups(motion.many_arms, console)
    return 3


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
    files |= save_figures(motion, options, console)
    return files
