"""Loading of motions from files, with validation in their scene or another."""

from __future__ import annotations

from pathlib import Path as FilePath

from rr1plan.checks import of_kind
from rr1plan.errors import FormatError, InputError
from rr1plan.export.motion_files import changes, check_units, fit_path, fit_trajectory, read_motion
from rr1plan.export.plan_files import SavedMotion
from rr1plan.motion_plan import MotionPlan
from rr1plan.path import Path
from rr1plan.planning import PlanResult, PlanStatus, ProgressCallback
from rr1plan.scene import Scene
from rr1plan.scene.problem import Problem
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
    """Read a motion from a file and validate it, in its scene or in another.

    The result is like that of `plan_motion`: a path, a trajectory, a report, `show` and `save_html`. The report is
    computed by `validate` (or `certify_path`, for a path without times); a report in the file is ignored.

    Args:
        file: A motion, trajectory or path file (.json), samples (.csv) or a ROS JointTrajectory (.yaml), also
            compressed (.csv.gz), or a ROS bag.
            Joints may be named as in the scene ("arm/joint"), as in ROS ("arm_joint"), or without the
            arm if the name is unique; in any order.
        scene: The scene for validation (default: the scene in the file). `changes` of the result lists the differences
            from the scene in which the motion was planned.
        topic: The topic of a bag (default: the only one with a JointTrajectory).
        torque_limits: Check torques too.
        jerk_limits: Check jerk limits too.
        progress: Called during the collision proof.

    Raises:
        FormatError: a truncated, modified or unsupported file, a file without a motion, or a motion that does not fit
            the scene: the message names unknown or missing joints.
        InputError: no scene given or in the file, or a topic for a file that is not a bag.
        UnknownNameError: the bag has no such topic.
        MissingPackageError: a bag, and `rosbags` is not installed (extra `ros`).
    """
    of_kind("scene", scene, Scene, optional=True)
    saved = read_motion(file, scene, topic)
    if saved.sequence is not None:
        raise FormatError("holds a sequence of stages, whose scenes differ; read it with load_sequence", file)
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
            assert path is not None, "a motion has a path or a trajectory"
            report = certify_path(path, where, progress=progress)
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
    """Content of a file, with columns in the order of a scene."""
    for part in (saved.trajectory, saved.path):
        if part is not None:
            check_units(saved, part.joint_names, scene)
    path = None if saved.path is None else fit_path(saved.path, scene)
    trajectory = None if saved.trajectory is None else fit_trajectory(saved.trajectory, scene)
    problem = saved.problem
    if problem is not None and problem.scene is not scene:
        problem = problem.in_scene(scene)
    return path, trajectory, problem
