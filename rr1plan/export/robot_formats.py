"""Motions for other programs: a ROS 2 bag with what a joint trajectory controller takes, and MJCF.

The bag is written without ROS. A controller refuses a trajectory whose times do not strictly increase
or that does not end at rest, so points are whole nanoseconds apart and the last velocity is exactly zero.
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Mapping
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from rr1plan.checks import file_path, finite_number, known_name, of_kind, positive_number
from rr1plan.errors import InputError, MissingPackageError
from rr1plan.files.file_access import write_text
from rr1plan.scene import Scene
from rr1plan.trajectory import Trajectory

_NANO = 1_000_000_000
TRAJECTORY_TOPIC = "/joint_trajectory"
STATE_TOPIC = "/joint_states"


def save_rosbag(
    folder: str | FilePath,
    trajectory: Trajectory,
    *,
    dt: float = 0.01,
    lead: float = 0.0,
    rename: Mapping[str, str] | None = None,
) -> FilePath:
    """Write a ROS 2 bag (MCAP): one JointTrajectory, and JointState messages along it.

    Args:
        folder: The bag, a folder that does not exist yet.
        trajectory: The motion. Every point has position, velocity and acceleration, so that a controller
            interpolates with quintic polynomials.
        dt: Time between points [s].
        lead: Time from the start of the controller to the first point [s]; above zero it blends in from
            where the arm is.
        rename: ROS names of columns. Default: without the arm's name when there is one arm, else "arm_joint".

    Returns:
        The folder.

    Raises:
        MissingPackageError: `rosbags` is not installed (extra `ros`).
        UnknownNameError: a name to rename that is not a column.
        InputError: the folder exists or cannot be made, a time that makes no sense.
    """
    target = file_path(folder)
    of_kind("trajectory", trajectory, Trajectory)
    dt = positive_number("dt", dt)
    if finite_number("lead", lead) < 0.0:
        raise InputError(f"lead is {lead}, expected a time >= 0")
    if target.exists():
        raise InputError(f"{target} exists already, a bag is written to a new folder")
    names = _ros_names(trajectory, rename)
    try:
        workplace = FilePath(tempfile.mkdtemp(dir=target.parent, prefix=".rr1plan."))
    except OSError as error:
        raise InputError(f"cannot write {target}: {error.strerror}") from error
    try:
        _write_bag(workplace / target.name, trajectory, names, dt, lead)
        (workplace / target.name).replace(target)
    finally:
        shutil.rmtree(workplace, ignore_errors=True)
    return target


def _ros_names(trajectory: Trajectory, rename: Mapping[str, str] | None) -> list[str]:
    for name in rename or {}:
        known_name("column", name, trajectory.joint_names)
    alone = len(trajectory.arms) == 1
    default = {n: n.split("/", 1)[1] if alone else n.replace("/", "_") for n in trajectory.joint_names}
    names = list({**default, **(rename or {})}.values())
    if len(set(names)) != len(names):
        raise InputError(f"the ROS names {names} are not distinct")
    return names


def _write_bag(folder: FilePath, trajectory: Trajectory, names: list[str], dt: float, lead: float) -> None:
    try:
        from rosbags.rosbag2 import StoragePlugin, Writer
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise MissingPackageError("rosbags", "writing a ROS 2 bag", "ros") from error
    store = get_typestore(Stores.ROS2_JAZZY)
    times = trajectory.sample_times(dt)
    stamps = np.round((times - times[0] + lead) * _NANO).astype(np.int64)
    rows = [trajectory(times, k) for k in range(3)]
    rows[1][-1] = 0.0
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for topic, kind, messages in (
            (TRAJECTORY_TOPIC, "trajectory_msgs/msg/JointTrajectory", [(0, _trajectory(store, names, stamps, rows))]),
            (STATE_TOPIC, "sensor_msgs/msg/JointState", _states(store, names, stamps, rows)),
        ):
            connection = writer.add_connection(topic, kind, typestore=store)
            for stamp, message in messages:
                writer.write(connection, int(stamp), store.serialize_cdr(message, kind))


def _header(store: Any, stamp: int) -> Any:
    time = store.types["builtin_interfaces/msg/Time"](int(stamp // _NANO), int(stamp % _NANO))
    return store.types["std_msgs/msg/Header"](time, "")


def _trajectory(store: Any, names: list[str], stamps: Any, rows: list[Any]) -> Any:
    duration = store.types["builtin_interfaces/msg/Duration"]
    point = store.types["trajectory_msgs/msg/JointTrajectoryPoint"]
    points = [
        point(rows[0][k], rows[1][k], rows[2][k], np.zeros(0), duration(int(t // _NANO), int(t % _NANO)))
        for k, t in enumerate(stamps)
    ]
    return store.types["trajectory_msgs/msg/JointTrajectory"](_header(store, 0), names, points)


def _states(store: Any, names: list[str], stamps: Any, rows: list[Any]) -> list[tuple[int, Any]]:
    state = store.types["sensor_msgs/msg/JointState"]
    return [
        (int(t), state(_header(store, int(t)), names, rows[0][k], rows[1][k], np.zeros(0)))
        for k, t in enumerate(stamps)
    ]


def save_mjcf(file: str | FilePath, scene: Scene) -> FilePath:
    """Write the scene's MuJoCo model as MJCF, with the servos that `simulate` uses.

    Args:
        file: The file.
        scene: The scene; arms stand at zero in the file, their configurations are a keyframe "configuration".

    Returns:
        The file.
    """
    from rr1plan.playback.simulation.mujoco_model import build_mujoco

    of_kind("scene", scene, Scene)
    world = build_mujoco(scene)
    return write_text(file, world.spec.to_xml())
