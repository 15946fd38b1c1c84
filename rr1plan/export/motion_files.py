"""Motions from files of any kind, fitted to the joints of a scene.

.json                     a motion, trajectory or path written by rr1plan
.csv                      samples of a trajectory
.yaml, .yml               a ROS JointTrajectory
.bag, .mcap, .db3, folder a ROS bag with one JointTrajectory

All but bags may be compressed (.csv.gz).
"""

from __future__ import annotations

import pathlib
from collections.abc import Sequence

from rr1plan.checks import file_path
from rr1plan.errors import FormatError, InputError, UnknownNameError
from rr1plan.export.csv_files import load_csv
from rr1plan.export.plan_files import SavedMotion, read_plan_file
from rr1plan.export.ros_trajectories import (
    BAG_SUFFIXES,
    YAML_SUFFIXES,
    columns_by_name,
    holds_joint_trajectory,
    load_joint_trajectory,
    refuse_topic,
)
from rr1plan.files.file_access import content_suffix
from rr1plan.path import Path
from rr1plan.scene import Scene, scene_differences
from rr1plan.scene.joint_units import joint_units
from rr1plan.trajectory import Trajectory

SUFFIXES = (".json", ".csv", *YAML_SUFFIXES, *BAG_SUFFIXES)
_File = str | pathlib.Path


def read_motion(file: _File, scene: Scene | None = None, topic: str | None = None) -> SavedMotion:
    """Read a motion from a file of any kind.

    Args:
        file: The file, or a bag's folder.
        scene: A scene whose meshes are used if those that the file refers to are not next to it.
        topic: The topic of a bag (default: the only one that holds a JointTrajectory).

    Raises:
        FormatError: another kind of file, or one that is invalid for its kind.
        InputError: a topic, and the file is not a bag.
        UnknownNameError: the bag has no such topic.
        MissingPackageError: a bag, and `rosbags` is not installed (extra `ros`).
    """
    path, suffix = file_path(file), content_suffix(file)
    if suffix in (".json", ".csv"):
        refuse_topic(path, topic)
        return read_plan_file(path, scene) if suffix == ".json" else SavedMotion(trajectory=load_csv(path))
    if suffix in YAML_SUFFIXES or path.suffix.lower() in BAG_SUFFIXES or path.is_dir():
        return SavedMotion(trajectory=load_joint_trajectory(path, topic=topic))
    refuse_topic(path, topic)
    if not path.exists():
        raise FormatError("there is no such file", file)
    raise FormatError(
        f"has the suffix {path.suffix!r}, expected a motion: {', '.join(SUFFIXES)}, or a bag's folder", file
    )


def is_motion_file(file: _File) -> bool:
    """Whether a file is a motion, by its suffix, or for YAML by its content."""
    path, suffix = file_path(file), content_suffix(file)
    if suffix in YAML_SUFFIXES:
        return holds_joint_trajectory(path)
    return suffix in (".json", ".csv") or path.suffix.lower() in BAG_SUFFIXES or path.is_dir()


def fit_trajectory(trajectory: Trajectory, scene: Scene) -> Trajectory:
    """The trajectory with its columns named and ordered as in the scene; see `fit_joints`."""
    names, order = fit_joints(trajectory.joint_names, scene)
    if names == trajectory.joint_names:
        return trajectory
    return Trajectory(names, trajectory.breaks, trajectory.coefficients[:, :, order])


def fit_path(path: Path, scene: Scene) -> Path:
    """The path with its columns named and ordered as in the scene; see `fit_joints`."""
    names, order = fit_joints(path.joint_names, scene)
    return path if names == path.joint_names else Path(names, path.waypoints[:, order])


def fit_joints(joint_names: Sequence[str], scene: Scene) -> tuple[tuple[str, ...], list[int]]:
    """The scene's columns of a motion, and the index of each among the motion's columns.

    A column is named "arm/joint", "arm_joint" as in ROS programs, or "joint" if only one arm has such a joint.

    Raises:
        UnknownNameError: a joint that is not a planning joint of the scene.
        InputError: a locked joint, a name that occurs in several arms, or an arm with only some of its joints.
    """
    found: dict[str, int] = {}
    columns = scene.joint_names()
    by_name = columns_by_name(columns)
    locked = columns_by_name(f"{arm}/{joint}" for arm, one in scene.arms.items() for joint in one.robot.locked_joints)
    for i, name in enumerate(joint_names):
        fitting = [name] if name in columns else by_name.get(name, [])
        if len(fitting) > 1:
            raise InputError(f"several arms have a joint {name!r}; name it {' or '.join(map(repr, fitting))}")
        if not fitting:
            if name in locked:
                raise InputError(
                    f"joint {name!r} is locked in the scene, expected a column for each planning joint; leave its "
                    "column out, or load the robot with joints= that include it; a sequence with a gripper is "
                    "validated from its .json file, which has the stages"
                )
            raise UnknownNameError("joint", name, columns)
        column = fitting[0]
        if column in found:
            raise InputError(f"{name!r} and {joint_names[found[column]]!r} are both the joint {column!r}")
        found[column] = i
    arms = [arm for arm in scene.arms if any(column.split("/", 1)[0] == arm for column in found)]
    columns = scene.joint_names(arms) if arms else ()
    missing = [name for name in columns if name not in found]
    if missing:
        raise InputError(f"the motion has no column for {', '.join(missing)}: it must move all joints of an arm")
    return columns, [found[name] for name in columns]


def changes(saved: SavedMotion, scene: Scene) -> tuple[str, ...]:
    """Differences between the scene in which a motion was made, as far as its file contains it, and another one."""
    if saved.scene is not None:
        return scene_differences(saved.scene, scene)
    if saved.made_for is None or saved.made_for.sha256 == scene.content_hash:
        return ()
    made, now = saved.made_for.arms, scene.arms
    lines = [f"arm {name!r} is gone" for name in made if name not in now]
    lines += [f"arm {name!r} is new" for name in now if name not in made]
    lines += [
        f"arm {name!r} has another robot, or other limits, than the {made[name].robot!r} of the motion"
        for name in now
        if name in made and made[name].sha256 != now[name].robot.content_hash
    ]
    known = f"of the motion's scene {saved.made_for.scene!r} only the hash is known, and that of this scene differs"
    return (*lines, known)


def check_units(saved: SavedMotion, joint_names: Sequence[str], scene: Scene) -> None:
    """Reject a motion in meters for a revolute joint, or in radians for a prismatic one.

    Args:
        saved: The content of a file.
        joint_names: The names of its columns in the file.
        scene: The scene for which it is meant.

    Raises:
        InputError: units that do not fit, by name.
    """
    names, order = fit_joints(joint_names, scene)
    if saved.units is None:
        return
    for name, unit, i in zip(names, joint_units(names, scene), order, strict=True):
        if saved.units[i] != unit:
            raise InputError(
                f"the motion has the joint {joint_names[i]!r} in {saved.units[i]}, but {name!r} is in {unit}"
            )
