"""Motions from files, judged by the referee: in the scene they were made in, or in another."""

from __future__ import annotations

from pathlib import Path as FilePath

from rr1plan.checks import of_kind
from rr1plan.errors import FormatError, InputError
from rr1plan.formats.motion_files import changes, check_units, fit_path, fit_trajectory, read_motion
from rr1plan.formats.plan_files import SavedMotion
from rr1plan.path import Path
from rr1plan.pipeline import MotionPlan
from rr1plan.planning import PlanResult, PlanStatus, ProgressCallback
from rr1plan.problem import Problem
from rr1plan.report import Report
from rr1plan.scene import Scene
from rr1plan.trajectory import Trajectory
from rr1plan.validation import certify_path, validate


def load_motion(
    file: str | FilePath,
    scene: Scene | None = None,
    *,
    topic: str | None = None,
    torque_limits: bool = False,
    jerk_limits: bool = False,
    progress: ProgressCallback | None = None,
) -> MotionPlan:
    """Read a motion from a file and have the referee judge it, in its own scene or in another.

    What comes back is what `plan_motion` gives: a path, a trajectory, a report, `show` and `save_html`. The report is
    made now, by `validate` (or `certify_path`, for a path without times): a verdict in the file is not taken over.

    Args:
        file: A motion, trajectory or path file (.json), samples (.csv), a ROS JointTrajectory (.yaml), or a ROS bag.
            Joints may be named as the scene has them ("arm/joint"), as ROS programs do ("arm_joint"), or without the
            arm where only one has such a joint; in any order.
        scene: Where to judge it (default: the scene that the file holds). `changes` of the result lists what differs
            from the scene that the motion was made in.
        topic: The topic of a bag (default: the only one that holds a JointTrajectory).
        torque_limits: Check torques too.
        jerk_limits: Check jerk limits too.
        progress: Called while the collision certificate is worked out.

    Raises:
        FormatError: cut off, altered, of another kind, a file without a motion, or a motion that cannot be meant for
            the scene: joints that the scene does not have or that the file lacks, by name.
        InputError: no scene, neither in the file nor given; or a topic, and the file is no bag.
        UnknownNameError: the bag has no such topic.
        MissingPackageError: a bag, and `rosbags` is not installed (extra `ros`).
    """
    of_kind("scene", scene, Scene, optional=True)
    saved = read_motion(file, scene, topic)
    where = saved.scene if scene is None else scene
    if where is None:
        made_for = "" if saved.made_for is None else f"; it was made for {saved.made_for.scene!r}"
        raise InputError(f"{file} holds a motion without its scene; give the scene too (option scene){made_for}")
    if saved.path is None and saved.trajectory is None:
        raise FormatError("holds a scene, but neither a path nor a trajectory", file)
    try:
        path, trajectory, problem = _fitted(saved, where)
    except InputError as error:
        raise FormatError(f"cannot be a motion of the scene {where.name!r}: {error}", file) from error
    try:
        if trajectory is None:
            report = _certified(path, where, progress)
        else:
            report = validate(
                trajectory, where, problem, torque_limits=torque_limits, jerk_limits=jerk_limits, progress=progress
            )
    except InputError as error:
        if scene is not None:
            raise
        raise FormatError(f"cannot be judged in its own scene: {error}", file) from error
    lacks = f"{file} holds no path" if path is None else f"{file} holds no trajectory" if trajectory is None else ""
    result = PlanResult(PlanStatus.FOUND, path, lacks)
    different = changes(saved, where)
    return MotionPlan(problem, result, {}, 0.0, path, trajectory, report, different, where)


def _fitted(saved: SavedMotion, scene: Scene) -> tuple[Path | None, Trajectory | None, Problem | None]:
    """What a file holds, with the columns of a scene."""
    for part in (saved.trajectory, saved.path):
        if part is not None:
            check_units(saved, part.joint_names, scene)
    path = None if saved.path is None else fit_path(saved.path, scene)
    trajectory = None if saved.trajectory is None else fit_trajectory(saved.trajectory, scene)
    problem = saved.problem
    if problem is not None and problem.scene is not scene:
        problem = problem.in_scene(scene)
    return path, trajectory, problem


def _certified(path: Path | None, scene: Scene, progress: ProgressCallback | None) -> Report:
    assert path is not None, "a motion has a path or a trajectory"
    return certify_path(path, scene, progress=progress)
