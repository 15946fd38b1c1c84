"""`demo` and `view`: a motion, a scene or a robot in the browser or as files."""

from __future__ import annotations

from argparse import Namespace
from dataclasses import replace
from pathlib import Path

import rr1plan as rp
from rr1plan.checks import counted, known_name
from rr1plan.cli.console import Console, milliseconds, progress_callback
from rr1plan.cli.exit_codes import INVALID_PLAN, OK
from rr1plan.cli.picture_files import check_files, write_files
from rr1plan.cli.plan import report_no_plan, summary
from rr1plan.cli.saved_motions import saved_motion, say_changes
from rr1plan.cli.scene_options import (
    ROBOT_SUFFIXES,
    check_file_exists,
    check_scene_name,
    named_query,
    page_options,
    refuse_sequence,
)
from rr1plan.cli.served_page import live_options, serve
from rr1plan.cli.standard_input import STANDARD_INPUT
from rr1plan.errors import InputError, NoPlanError
from rr1plan.export.csv_files import save_csv
from rr1plan.export.motion_files import is_motion_file
from rr1plan.export.plan_files import save_trajectory
from rr1plan.files.file_access import make_folder
from rr1plan.motion_plan import MotionPlan
from rr1plan.pipeline import plan_motion
from rr1plan.scene.model_library import (
    installed_robot_names,
    load_robot,
    load_scene,
    robot_names,
    scene_names,
)

# Durations are printed to this digit [s].
_MILLISECOND = 1e-3
# What the files of a demo contain.
_CONTENTS = {
    "page": "the page that plays it, offline",
    "motion": "the motion",
    "trajectory": "the trajectory",
    "csv": "the trajectory as a table",
}


def demo(options: Namespace, console: Console) -> int:
    """From a problem to a certified, replayed, visible motion, with a report of the steps and their times."""
    look, watch = page_options(options), console.watch
    check_scene_name(options.scene)
    with watch.stage("load the scene"), console.progress("loading the scene"):
        problem = named_query(options.scene, options.query)
    folder = make_folder(options.output, "motion.json")
    scene = problem.scene
    console.say("rr1plan demo")
    console.say(f"  scene {scene.name}: {', '.join(scene.arms)} among {counted(len(scene.obstacles), 'obstacle')}")
    with watch.stage("plan, shorten, retime, validate"), console.progress("planning") as advance:
        motion = plan_motion(problem, rng=options.seed, progress=progress_callback(advance))
    if not motion.result.found:
        return report_no_plan(motion, console)
    console.say(f"  {str(motion).replace(chr(10), chr(10) + '  ')}")
    with watch.stage("replay in MuJoCo"), console.progress("replaying") as advance:
        replay = rp.simulate(motion.trajectory, scene, progress=progress_callback(advance))
    console.say(f"  {str(replay).replace(chr(10), chr(10) + '  ')}")
    with watch.stage("write the files"):
        files = {
            "page": motion.save_html(folder / "motion.html", options=look),
            "motion": motion.save(folder / "motion.json"),
            "trajectory": save_trajectory(folder / "trajectory.json", motion.trajectory, scene),
            "csv": save_csv(folder / "trajectory.csv", motion.trajectory),
        }
    console.say("how long each step took")
    steps = {**watch.seconds}
    inner = "".join(f"\n      {name}: {milliseconds(seconds)}" for name, seconds in motion.seconds.items())
    for name, seconds in steps.items():
        console.say(f"  {name}: {milliseconds(seconds)}{inner if name.startswith('plan') else ''}")
    console.say("wrote")
    for kind, file in files.items():
        console.say(f"  {_CONTENTS[kind]}: {file}")
    console.result(
        {**summary(motion), "replay": replay.to_dict(), "steps": steps, "files": {k: str(v) for k, v in files.items()}}
    )
    return OK if motion.valid and replay else INVALID_PLAN


def view(options: Namespace, console: Console) -> int:
    """A scene or a saved motion in the browser, or as files."""
    look, in_files = page_options(options), check_files(options)
    scene, motion = _what(options, console)
    if options.time is not None:
        _check_time(options, motion)
    if options.compare is not None:
        other = _other(motion, options, console)
        look = replace(look or rp.ViewOptions(), compare=other, side_by_side=options.side_by_side)
    if in_files:
        write_files(scene, motion, options, look, console)
        return OK
    look = live_options(options, look)
    return serve(rp.show(scene, options=look) if motion is None else motion.show(options=look), options, console)


def _check_time(options: Namespace, motion: MotionPlan | rp.SequencePlan | None) -> None:
    """Reject a moment that the motion does not have."""
    if motion is None:
        raise InputError(f"--time has no effect: {options.what} is not a motion")
    try:
        trajectory = motion.trajectory
    except NoPlanError:
        return  # a path: its page plays it at a constant speed
    if not trajectory.start_time <= options.time <= trajectory.end_time + _MILLISECOND:
        raise InputError(
            f"--time is {options.time:g} s, expected {trajectory.start_time:g} to {trajectory.end_time:.3f}, the times "
            "of the motion"
        )


def _other(
    motion: MotionPlan | rp.SequencePlan | None, options: Namespace, console: Console
) -> dict[str, rp.Trajectory]:
    """The motion to compare, by the name of its file, in the scene of the main motion."""
    if motion is None:
        raise InputError(f"{options.what} is not a motion; --compare takes a motion beside another motion")
    other = saved_motion(options.compare, options, console, scene=motion.scene)
    try:
        return {Path(options.compare).stem: other.trajectory}
    except NoPlanError as error:
        raise InputError(f"{error}; only a motion with times can be compared") from error


def _what(options: Namespace, console: Console) -> tuple[rp.Scene, MotionPlan | rp.SequencePlan | None]:
    """A scene, or one of a robot alone, and a motion in it if the name is that of a motion file."""
    is_motion = options.what == STANDARD_INPUT or is_motion_file(options.what)
    is_scene = options.what in scene_names() or not is_motion
    if is_scene and options.topic is not None:
        raise InputError(f"{options.what} is not a motion file; --topic names the topic of a bag")
    if is_scene and options.what not in scene_names():
        refuse_sequence(options.what)
    if is_scene and options.scene is None:
        with console.progress(f"loading {options.what}"):
            return _scene_or_robot(options.what), None
    if is_scene:
        raise InputError(f"{options.what} is not a motion file; --scene names the scene of a motion")
    motion = saved_motion(options.what, options, console)
    say_changes(motion, console)
    return motion.scene, motion


def _scene_or_robot(what: str) -> rp.Scene:
    """A scene by name or from a file; of a robot, a scene with the robot alone."""
    known = (*scene_names(), *robot_names(), *installed_robot_names())
    file = Path(what)
    if what not in known:
        check_file_exists(what)
        if not file.exists():
            known_name("scene or robot", what, known)
    if what in scene_names() or (what not in known and file.suffix.lower() not in ROBOT_SUFFIXES):
        return load_scene(what)
    robot = load_robot(what)
    return rp.Scene(name=robot.name).with_arm("robot", robot)
