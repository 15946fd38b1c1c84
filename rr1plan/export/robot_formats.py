"""Motions for other programs: a ROS 2 bag for a joint trajectory controller, and MJCF.

The bag is written without ROS. A controller rejects a trajectory whose times do not strictly increase or that does not
end at rest, so points are whole nanoseconds apart and the last velocity is exactly zero.
"""

from __future__ import annotations

import os
import sqlite3
import tempfile
from collections.abc import Mapping
from pathlib import Path as FilePath
from typing import Any, Literal

import numpy as np

from rr1plan.checks import file_path, known_name, of_kind
from rr1plan.errors import InputError, MissingPackageError
from rr1plan.export.ros_trajectories import Duration, JointTrajectoryMessage, sampled_message
from rr1plan.files.file_access import check_writable, write_text
from rr1plan.robot import Robot
from rr1plan.scene import Scene
from rr1plan.trajectory import Trajectory

Storage = Literal["mcap", "sqlite3"]
_STORAGE = {"mcap": "MCAP", "sqlite3": "SQLITE3"}
TRAJECTORY_TOPIC = "/joint_trajectory"
STATE_TOPIC = "/joint_states"


def save_rosbag(
    folder: str | FilePath,
    trajectory: Trajectory,
    *,
    dt: float = 0.01,
    lead: float = 0.0,
    rename: Mapping[str, str] | None = None,
    storage: Storage = "mcap",
) -> FilePath:
    """Write a ROS 2 bag: one JointTrajectory, and JointState messages along it.

    Args:
        folder: The bag, a folder that does not exist yet, whose name does not end in .bag as that of ROS 1 bags.
        trajectory: A motion that ends at rest. Points have the fields that `save_joint_trajectory` writes, so that a
            controller that interpolates between them keeps the limits of the motion.
        dt: Longest time between points [s]; there is one at each break of the motion, too.
        lead: Time from the start of the controller to the first point [s]; above zero it blends in from the arm's
            position.
        rename: ROS names of columns. Default: without the arm's name if there is one arm, else "arm_joint".
        storage: "mcap", or "sqlite3" for ROS distributions before Iron.

    Returns:
        The folder.

    Raises:
        MissingPackageError: `rosbags` is not installed (extra `ros`).
        UnknownNameError: a name to rename that is not a column, or another storage.
        InputError: the folder exists, cannot be created or ends in .bag, an invalid time, a motion that does not end at
            rest.
    """
    target = file_path(folder)
    known_name("storage", storage, _STORAGE)
    message = sampled_message(trajectory, dt, lead, rename)
    if os.path.lexists(target):
        raise InputError(f"{target} exists already, a bag is written to a new folder")
    if target.suffix == ".bag":
        raise InputError(f"cannot save {str(target)!r}: readers take it for a ROS 1 bag; leave out .bag")
    check_writable(target)
    try:
        with tempfile.TemporaryDirectory(dir=target.parent, prefix=".rr1plan.", ignore_cleanup_errors=True) as folder:
            bag = FilePath(folder) / target.name
            _write_bag(bag, message, storage)
            bag.replace(target)
    except (OSError, sqlite3.Error) as error:
        raise InputError(f"cannot write {target}: {getattr(error, 'strerror', None) or error}") from error
    return target


def _write_bag(folder: FilePath, message: JointTrajectoryMessage, storage: Storage) -> None:
    try:
        from rosbags.rosbag2 import StoragePlugin, Writer
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise MissingPackageError("rosbags", "writing a ROS 2 bag", "ros") from error
    store = get_typestore(Stores.ROS2_JAZZY)
    stamped = list(zip(message.stamps, _states(store, message), strict=True))
    with Writer(folder, version=9, storage_plugin=StoragePlugin[_STORAGE[storage]]) as writer:
        for topic, kind, messages in (
            (TRAJECTORY_TOPIC, "trajectory_msgs/msg/JointTrajectory", [(Duration(), _trajectory(store, message))]),
            (STATE_TOPIC, "sensor_msgs/msg/JointState", stamped),
        ):
            connection = writer.add_connection(topic, kind, typestore=store)
            for stamp, content in messages:
                writer.write(connection, stamp.nanoseconds, store.serialize_cdr(content, kind))


def _header(store: Any, stamp: Duration) -> Any:
    time = store.types["builtin_interfaces/msg/Time"](stamp.sec, stamp.nanosec)
    return store.types["std_msgs/msg/Header"](time, "")


def _trajectory(store: Any, message: JointTrajectoryMessage) -> Any:
    duration = store.types["builtin_interfaces/msg/Duration"]
    point = store.types["trajectory_msgs/msg/JointTrajectoryPoint"]
    points = [
        point(*map(np.array, (p.positions, p.velocities, p.accelerations)), np.zeros(0), duration(t.sec, t.nanosec))
        for p, t in zip(message.points, message.stamps, strict=True)
    ]
    kind = store.types["trajectory_msgs/msg/JointTrajectory"]
    return kind(_header(store, Duration()), message.joint_names, points)


def _states(store: Any, message: JointTrajectoryMessage) -> list[Any]:
    state, names = store.types["sensor_msgs/msg/JointState"], message.joint_names
    return [
        state(_header(store, stamp), names, np.array(p.positions), np.array(p.velocities), np.zeros(0))
        for p, stamp in zip(message.points, message.stamps, strict=True)
    ]


def save_mjcf(file: str | FilePath, scene: Scene) -> FilePath:
    """Write the scene's MuJoCo model as MJCF, with the servos that `simulate` uses.

    In addition, joints have their position limits, and mimic joints the equality constraint that couples them to their
    leaders. MJCF has no limits of velocity, acceleration and jerk: `load_robot` assumes them when it reads the file. It
    has no named configurations of one arm, no tool, and, in this file, no visual shapes. Numbers have six digits.

    Args:
        file: The file, whose name ends in .xml or .mjcf.
        scene: The scene; in the file, arms are at zero, and their configurations are a keyframe "configuration", in
            which the servos hold them.

    Returns:
        The file.

    Raises:
        InputError: not a scene, another suffix, or a file that cannot be written.
    """
    from rr1plan.playback.simulation.mujoco_model import build_mujoco

    of_kind("scene", scene, Scene)
    path = check_writable(file, ".xml", ".mjcf")
    world = build_mujoco(scene)
    joints = {joint.name: joint for joint in world.spec.joints}
    for name, arm in scene.arms.items():
        _add_ranges(world.spec, joints, name, arm.robot)
    return write_text(path, world.to_xml())


def _add_ranges(spec: Any, joints: Mapping[str, Any], arm: str, robot: Robot) -> None:
    """Add the position limits of a robot's joints and the couplings of its mimic joints to an `MjSpec`.

    Args:
        spec: The model.
        joints: Its joints by name; `spec.joint` searches all of them.
        arm: The robot's name in the scene.
        robot: The robot.
    """
    import mujoco

    for joint in robot.limited_joints:
        if joint.kind == "fixed":
            continue
        lower, upper = joint.lower, joint.upper
        if lower < upper and np.isfinite(upper - lower):
            written = joints[f"{arm}/{joint.name}"]
            written.limited = mujoco.mjtLimited.mjLIMITED_TRUE
            angular = joint.kind != "prismatic" and spec.compiler.degree
            written.range = np.degrees([lower, upper]) if angular else [lower, upper]
        if joint.mimic is not None:
            equality = spec.add_equality(type=mujoco.mjtEq.mjEQ_JOINT, objtype=mujoco.mjtObj.mjOBJ_JOINT)
            equality.name1, equality.name2 = f"{arm}/{joint.name}", f"{arm}/{joint.mimic.joint}"
            equality.data[:5] = [joint.mimic.offset, joint.mimic.multiplier, 0.0, 0.0, 0.0]
