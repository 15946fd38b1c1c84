"""`validate` and `play`: check or replay a saved motion, in its own scene or in another."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path
from typing import Any

import rr1plan as rp
from rr1plan.cli.console import Console, milliseconds, progress_callback
from rr1plan.cli.exit_codes import INVALID_PLAN, OK
from rr1plan.cli.picture_files import check_page, check_video, write_replay
from rr1plan.cli.scene_options import check_file_exists, check_scene_name, refuse_sequence
from rr1plan.cli.standard_input import STANDARD_INPUT, readable_file
from rr1plan.errors import InputError, NoPlanError
from rr1plan.motion_plan import MotionPlan
from rr1plan.scene.model_library import load_scene, scene_names
from rr1plan.sequences.sequence_files import holds_sequence, load_sequence
from rr1plan.sequences.sequence_plan import SequencePlan


def validate(options: Namespace, console: Console) -> int:
    """Check a saved motion with the referee."""
    checks = {"torque_limits": options.torque_limits, "jerk_limits": options.jerk_limits}
    motion = saved_motion(options.motion, options, console, checks)
    say_changes(motion, console)
    console.say(str(motion.report))
    console.result({**motion.report.to_dict(), **about(motion)})
    return OK if motion.report.valid else INVALID_PLAN


def play(options: Namespace, console: Console) -> int:
    """Replay a saved motion in MuJoCo."""
    from rr1plan.playback.simulation.simulation import LONGEST_STEP

    if options.html is not None:
        check_page(options.html)
    if options.video is not None:
        check_video(options.video)
    motion = saved_motion(options.motion, options, console)
    try:
        trajectory = motion.trajectory
    except NoPlanError as error:
        raise InputError(f"{error}; only a motion with times can be replayed") from error
    say_changes(motion, console)
    if isinstance(motion, SequencePlan) and options.mode != "dynamic":
        raise InputError("a sequence is replayed with --mode dynamic only, where fingers hold objects")
    if options.mode == "dynamic" and options.timestep > LONGEST_STEP:
        raise InputError(f"--timestep is {options.timestep:g} s, expected at most {LONGEST_STEP:g} s")
    replay: rp.Replay | rp.SequenceReplay
    with console.progress("replaying") as advance:
        if isinstance(motion, SequencePlan):
            replay = rp.simulate_sequence(motion, dt=options.timestep, progress=progress_callback(advance))
        else:
            replay = rp.simulate(
                trajectory, motion.scene, mode=options.mode, dt=options.timestep, progress=progress_callback(advance)
            )
    console.say(str(replay))
    said = replay.to_dict()
    console.say(f"  it took {milliseconds(said['wall_seconds'])}")
    files = write_replay(motion, replay, options, console)
    console.result({**said, **about(motion), "files": files})
    return OK if replay else INVALID_PLAN


def saved_motion(
    file: str,
    options: Namespace,
    console: Console,
    checks: dict[str, bool] | None = None,
    scene: rp.Scene | None = None,
) -> MotionPlan | SequencePlan:
    """A motion or a sequence from a file of any kind, or from standard input ("-").

    It is validated in a given scene, that of the options, or its own.

    Raises:
        InputError: a scene or a sequence without a motion; the message names the command that makes one.
    """
    with console.progress("loading the scene"):
        if scene is None and options.scene is not None:
            check_scene_name(options.scene)
            scene = load_scene(options.scene)
    if file != STANDARD_INPUT:
        check_file_exists(file)
    refuse_sequence(file)
    path = Path(file)
    if path.suffix.lower() == ".toml" or (file in scene_names() and not path.exists()):
        raise InputError(f"{file} is a scene, expected a motion; to make one: rr1plan plan {file} --output motion.json")
    checks = checks or {}
    with readable_file(file) as there, console.progress("checking") as advance:
        if options.topic is None and holds_sequence(there):
            return load_sequence(there, scene, **checks, progress=progress_callback(advance))
        return rp.load_motion(there, scene, topic=options.topic, **checks, progress=progress_callback(advance))


def single_motion(file: str, options: Namespace, console: Console, use: str) -> tuple[MotionPlan, rp.Trajectory]:
    """A motion from a file with its trajectory, for uses in which the scene must not change during the motion.

    Args:
        file: The file.
        options: As for `saved_motion`.
        console: Console for progress.
        use: The use that requires a single motion, "sent" or "mirrored".

    Raises:
        InputError: a sequence, or a motion without times.
    """
    motion = saved_motion(file, options, console)
    if not isinstance(motion, MotionPlan):
        raise InputError(f"{file} holds a sequence, whose scene changes on the way; only single motions can be {use}")
    try:
        trajectory = motion.trajectory
    except NoPlanError as error:
        raise InputError(f"{error}; only a motion with times can be {use}") from error
    say_changes(motion, console)
    return motion, trajectory


def say_changes(motion: MotionPlan | SequencePlan, console: Console) -> None:
    """Print the scene of a motion, its parts, and the differences from the scene in which it was made."""
    name = motion.scene.name
    where = "the scene" if name == rp.Scene.name else f"the scene {name}"
    console.say(f"in {where}: {motion.size()}")
    if motion.changes:
        console.say("the scene differs from the one that the motion was made in:")
    for change in motion.changes:
        console.say(f"  {change}")


def about(motion: MotionPlan | SequencePlan) -> dict[str, Any]:
    """The information of `say_changes` as plain values, for JSON."""
    return {"scene": motion.scene.name, "changes": list(motion.changes)}
