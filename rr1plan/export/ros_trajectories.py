"""Trajectories of ROS programs: a `trajectory_msgs/JointTrajectory` in a YAML file or in a bag.

The interpolation of a joint trajectory controller depends on the fields of the points: straight lines for positions
only, cubics with velocities, quintics with accelerations. `Trajectory.from_samples` does the same. Written messages
have the fields that keep the limits of the motion between points, see `trajectory_samples`.
"""

from __future__ import annotations

import pathlib
from collections.abc import Generator, Iterable, Iterator, Mapping
from itertools import chain, islice
from typing import Annotated, Any

import msgspec
import numpy as np
import yaml

from rr1plan.checks import (
    Array,
    check_text,
    counted,
    file_path,
    finite_number,
    known_name,
    of_kind,
    positive_number,
    shown,
)
from rr1plan.errors import FormatError, InputError, MissingPackageError, reason_of
from rr1plan.export.trajectory_samples import sample_within_limits
from rr1plan.files.documents import collection_paused, read_yaml_documents
from rr1plan.files.file_access import check_writable, content_suffix, write_text
from rr1plan.trajectory import Trajectory

BAG_SUFFIXES = (".bag", ".mcap", ".db3")
YAML_SUFFIXES = (".yaml", ".yml")
_MESSAGE = "trajectory_msgs/msg/JointTrajectory"
# Messages that contain a JointTrajectory, by the name of the field.
_WRAPPERS = ("joint_trajectory", "trajectory", "goal")
_File = str | pathlib.Path
_INTERRUPTED = "; if its recording was interrupted, try `ros2 bag reindex` or `mcap recover`"
_NANO = 1_000_000_000
_LONGEST_LEAD = 1e6  # [s]
_LATEST = 1e11  # [s], 3000 years
_Whole = Annotated[int, msgspec.Meta(ge=1 - 2**63, le=2**63 - 1)]
# Most names in a message, and most characters of each.
_MOST_NAMES, _LONGEST_NAME = 10, 80


class Duration(msgspec.Struct, forbid_unknown_fields=True):
    """A duration in ROS 2's fields or ROS 1's."""

    sec: _Whole = 0
    nanosec: _Whole = 0
    secs: _Whole = 0
    nsecs: _Whole = 0

    @property
    def nanoseconds(self) -> int:
        """The duration [ns]."""
        return (self.sec + self.secs) * _NANO + self.nanosec + self.nsecs


class JointTrajectoryPoint(msgspec.Struct, forbid_unknown_fields=True):
    """A `trajectory_msgs/JointTrajectoryPoint`."""

    positions: list[float]
    time_from_start: Duration | float
    velocities: list[float] = []
    accelerations: list[float] = []
    effort: list[float] = []


class JointTrajectoryMessage(msgspec.Struct, forbid_unknown_fields=True):
    """A `trajectory_msgs/JointTrajectory`."""

    joint_names: list[str]
    points: list[JointTrajectoryPoint]
    header: Any = None

    @property
    def stamps(self) -> list[Duration]:
        """Times from the start of all points; plain seconds are rounded to nanoseconds.

        Raises:
            InputError: one is not finite or too large.
        """
        return [_as_duration(point.time_from_start) for point in self.points]


def _as_duration(time: Duration | float) -> Duration:
    if isinstance(time, Duration):
        return time
    if abs(finite_number("time_from_start", time)) > _LATEST:
        raise InputError(f"time_from_start is {time:g} s, expected within ±{_LATEST:g} s")
    nanoseconds = round(time * _NANO)
    return Duration(sec=nanoseconds // _NANO, nanosec=nanoseconds % _NANO)


def load_joint_trajectory(file: _File, *, topic: str | None = None) -> Trajectory:
    """Read the one JointTrajectory of a YAML file or a bag.

    Args:
        file: A .yaml or .yml file, also compressed (.yaml.gz), as `ros2 topic echo` prints the message (alone, or in a
            RobotTrajectory or an action's goal); or a bag of ROS 1 or 2 (a .bag file, a folder, or the .mcap or .db3
            file in it).
        topic: The topic of a bag (default: the only one that holds such messages).

    Returns:
        The trajectory, with the joint names of the message.

    Raises:
        FormatError: another kind of file, several messages, or points with different fields.
        UnknownNameError: the bag has no such topic.
        MissingPackageError: a bag, and `rosbags` is not installed (extra `ros`).
    """
    message = read_joint_trajectory(file, topic)
    try:
        return _trajectory(message)
    except InputError as error:
        raise FormatError(str(error), file) from error


def read_joint_trajectory(file: _File, topic: str | None = None) -> JointTrajectoryMessage:
    """The one JointTrajectory of a YAML file or a bag, with any kind of points; see `load_joint_trajectory`."""
    path = file_path(file)
    if content_suffix(path) in YAML_SUFFIXES:
        refuse_topic(path, topic)
        return _from_yaml(path)
    if path.is_file() and path.suffix.lower() not in BAG_SUFFIXES:
        known = ", ".join((*YAML_SUFFIXES, *BAG_SUFFIXES))
        raise FormatError(f"has the suffix {path.suffix!r}, expected one of {known}, or a bag's folder", path)
    return _from_bag(path, topic)


def save_joint_trajectory(
    file: _File,
    trajectory: Trajectory,
    *,
    dt: float = 0.01,
    lead: float = 0.0,
    rename: Mapping[str, str] | None = None,
) -> pathlib.Path:
    """Write a `trajectory_msgs/JointTrajectory` as YAML for `ros2 topic pub`.

    To publish it: `ros2 topic pub --once /arm_controller/joint_trajectory trajectory_msgs/msg/JointTrajectory
    "$(cat motion.yaml)"`. On Linux an argument has at most 128 kB, 4 s of six joints with the default `dt`; for larger
    files use `--yaml-file motion.yaml` (ROS Kilted and later) or a longer `dt`.

    Args:
        file: The file, .yaml or .yml.
        trajectory: A trajectory that ends at rest. Points have positions, velocities unless these jump, and
            accelerations unless velocities or accelerations jump.
        dt: Longest time between points [s]; there is one at each break, too.
        lead: Time from the start of the controller to the first point [s]; above zero it blends in from the arm's
            position.
        rename: ROS names of columns. Default: without the arm's name if there is one arm, else "arm_joint".

    Returns:
        The file.

    Raises:
        UnknownNameError: a name to rename that is no column.
        InputError: the trajectory jumps or does not end at rest, more than a million points, a ROS name that is empty,
            repeated or not text, another suffix, the file cannot be written.
    """
    path = check_writable(file, *YAML_SUFFIXES)
    message = sampled_message(trajectory, dt, lead, rename)
    points = [
        {name: getattr(point, name) for name in ("positions", "velocities", "accelerations") if getattr(point, name)}
        | {"time_from_start": {"sec": stamp.sec, "nanosec": stamp.nanosec}}
        for point, stamp in zip(message.points, message.stamps, strict=True)
    ]
    header = {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}
    content = {"header": header, "joint_names": message.joint_names, "points": points}
    dumper = yaml.CSafeDumper if yaml.__with_libyaml__ else yaml.SafeDumper
    with collection_paused():
        text = yaml.dump(content, Dumper=dumper, sort_keys=False, default_flow_style=None, width=2**31 - 1)
    return write_text(path, text)


def sampled_message(
    trajectory: Trajectory, dt: float, lead: float, rename: Mapping[str, str] | None
) -> JointTrajectoryMessage:
    """A trajectory as points that a controller accepts: times in whole nanoseconds, no velocity at the end.

    Args:
        trajectory: A trajectory that ends at rest.
        dt: Longest time between points [s].
        lead: Time of the first point [s].
        rename: ROS names of columns.

    Raises:
        UnknownNameError: a name to rename that is no column.
        InputError: the trajectory jumps or does not end at rest, an invalid time, or a ROS name that is empty, repeated
            or not text.
    """
    of_kind("trajectory", trajectory, Trajectory)
    dt = positive_number("dt", dt)
    if not 0.0 <= finite_number("lead", lead) <= _LONGEST_LEAD:
        raise InputError(f"lead is {lead}, expected a time from 0 to {_LONGEST_LEAD:g} s")
    names = _ros_names(trajectory, rename)
    times, positions, velocities, accelerations = sample_within_limits(trajectory, dt, tick=1.0 / _NANO)
    stamps = (np.round(times * _NANO).astype(np.int64) + round(lead * _NANO)).tolist()
    none: list[list[float]] = [[]] * len(stamps)
    rates = (none if rows is None else rows.tolist() for rows in (velocities, accelerations))
    points = [
        JointTrajectoryPoint(q, Duration(sec=t // _NANO, nanosec=t % _NANO), v, a)
        for t, q, v, a in zip(stamps, positions.tolist(), *rates, strict=True)
    ]
    return JointTrajectoryMessage(names, points)


def _ros_names(trajectory: Trajectory, rename: Mapping[str, str] | None) -> list[str]:
    of_kind("rename", rename, Mapping, optional=True)
    for column, name in (rename or {}).items():
        check_text(f"the ROS name of {known_name('column', column, trajectory.joint_names)!r}", name)
        if not name:
            raise InputError(f"the ROS name of {column!r} is empty, expected a name")
    alone = len(trajectory.arms) == 1
    default = {n: n.split("/", 1)[-1] if alone else n.replace("/", "_") for n in trajectory.joint_names}
    names = list({**default, **(rename or {})}.values())
    if len(set(names)) != len(names):
        raise InputError(f"the ROS names {names} are not distinct")
    return names


def columns_by_name(columns: Iterable[str]) -> dict[str, list[str]]:
    """The columns that each name in a file or message may mean: "arm/joint", "arm_joint" or "joint"."""
    found: dict[str, list[str]] = {}
    for column in columns:
        for name in dict.fromkeys((column, column.replace("/", "_"), column.split("/", 1)[1])):
            found.setdefault(name, []).append(column)
    return found


def refuse_topic(file: _File, topic: str | None) -> None:
    """Reject the name of a topic for a file that is not a bag.

    Raises:
        InputError: there is one.
    """
    if topic is not None:
        raise InputError(f"topic is {shown(topic)}, but {file} is not a bag and has no topics (option topic)")


def holds_joint_trajectory(file: _File) -> bool:
    """Whether a YAML file contains a JointTrajectory rather than, e.g., a scene."""
    try:
        documents = read_yaml_documents(file)
    except FormatError:
        return False
    return bool(documents) and "joint_names" in _unwrapped(documents[0])


def _from_yaml(file: pathlib.Path) -> JointTrajectoryMessage:
    documents = read_yaml_documents(file)
    if len(documents) != 1:
        raise FormatError(f"holds {len(documents)} messages, expected one JointTrajectory", file)
    return _converted(_unwrapped(documents[0]), file)


def _unwrapped(data: object) -> dict[object, object]:
    """The JointTrajectory inside its enclosing messages; {} if there is none."""
    for _ in range(4):
        if isinstance(data, list) and len(data) == 1:
            data = data[0]
        if not isinstance(data, dict) or "joint_names" in data:
            break
        inner = [key for key in _WRAPPERS if key in data]
        if not inner:
            break
        data = data[inner[0]]
    return data if isinstance(data, dict) else {}


def _converted(data: Any, file: pathlib.Path) -> JointTrajectoryMessage:
    if "joint_names" not in data:
        raise FormatError(f"holds no {_MESSAGE}: expected the keys joint_names and points", file)
    try:
        return msgspec.convert(data, JointTrajectoryMessage)
    except msgspec.ValidationError as error:
        raise FormatError(f"is not a {_MESSAGE}: {error}", file) from error


def _from_bag(file: pathlib.Path, topic: str | None) -> JointTrajectoryMessage:
    messages = list(bag_messages(file, _MESSAGE, topic))
    if len(messages) != 1:
        raise FormatError(f"has {len(messages)} messages, expected one {_MESSAGE}", file)
    _, message = messages[0]
    data = {
        "joint_names": list(message.joint_names),
        "points": [
            {
                **{n: getattr(p, n).tolist() for n in ("positions", "velocities", "accelerations", "effort")},
                "time_from_start": {n: getattr(p.time_from_start, n) for n in ("sec", "nanosec")},
            }
            for p in message.points
        ],
    }
    return _converted(data, file)


def read_joint_states(
    file: _File, *, topic: str | None = None
) -> Generator[tuple[float, tuple[str, ...], Array], None, None]:
    """The `sensor_msgs/JointState` messages of a bag: time [s], names and positions.

    Times are the stamps of the headers, or those at which messages were recorded if the sender does not set stamps.

    Args:
        file: As in `load_joint_trajectory`.
        topic: As in `load_joint_trajectory`.

    Raises:
        FormatError: it cannot be read, has no such messages, or has them on several topics.
        UnknownNameError: the bag has no such topic.
        MissingPackageError: `rosbags` is not installed (extra `ros`).
    """
    messages = bag_messages(file_path(file), "sensor_msgs/msg/JointState", topic)
    first = list(islice(messages, 2))  # now, so that the caller of this function gets the errors
    # The first message of a simulation may have the time zero.
    unstamped = all(_nanoseconds(message.header.stamp) == 0 for _, message in first)
    return (
        (
            1e-9 * (recorded if unstamped else _nanoseconds(message.header.stamp)),
            tuple(message.name),
            np.array(message.position, dtype=np.float64),
        )
        for recorded, message in chain(first, messages)
    )


def _nanoseconds(stamp: Any) -> int:
    return int(stamp.sec) * _NANO + int(stamp.nanosec)


def bag_messages(file: pathlib.Path, kind: str, topic: str | None) -> Iterator[tuple[int, Any]]:
    """The messages of one type on one topic of a bag, in order, each with the time at which it was recorded [ns].

    Args:
        file: As in `load_joint_trajectory`.
        kind: The type, such as "sensor_msgs/msg/JointState".
        topic: The topic (default: the only one that holds such messages).

    Raises:
        FormatError: it cannot be read, has no such messages, or has them on several topics.
        UnknownNameError: the bag has no such topic.
        MissingPackageError: `rosbags` is not installed (extra `ros`).
    """
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise MissingPackageError("rosbags", "reading a ROS bag", "ros") from error
    # The database of a ROS 2 bag is read via its folder, which describes it and may have such a suffix, too.
    bag = file.parent if file.suffix.lower() in (".mcap", ".db3") and not file.is_dir() else file
    _check_regular(file, bag)
    try:
        with AnyReader([bag], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
            for connection, recorded, data in reader.messages(connections=_connections(reader, kind, topic, file)):
                yield recorded, reader.deserialize(data, connection.msgtype)
    except InputError:
        raise
    except Exception as error:  # rosbags raises errors of any type
        raise FormatError(f"cannot be read as a ROS bag: {reason_of(error)}{_INTERRUPTED}", file) from error


def _check_regular(file: pathlib.Path, bag: pathlib.Path) -> None:
    """Reject a missing bag, or one that contains a FIFO or a device, on which reading would block."""
    try:
        parts = [file, *(bag.iterdir() if bag.is_dir() else ())]
        odd = [part for part in parts if part.exists() and not part.is_file() and not part.is_dir()]
        there = file.exists()
    except OSError as error:
        raise FormatError(f"cannot be read: {error.strerror}", file) from error
    if odd:
        raise FormatError(f"holds {odd[0].name}, expected regular files", file)
    if not there:
        raise FormatError("there is no such file", file)
    if bag.is_dir() and bag.suffix == ".bag":
        raise FormatError("is a folder, expected a file of ROS 1; rename a bag of ROS 2 so that it has no .bag", file)
    if bag.is_dir() and not (bag / "metadata.yaml").exists():
        missing = f"there is no metadata.yaml in the folder {bag}, expected one: a ROS 2 bag is its whole folder"
        raise FormatError(missing + _INTERRUPTED, file)


def _connections(reader: Any, kind: str, topic: str | None, file: pathlib.Path) -> list[Any]:
    """The connections of a bag's topic."""
    connections = [c for c in reader.connections if c.msgtype == kind]
    topics = sorted({c.topic for c in connections})
    if not topics:
        kinds = _listed(sorted({c.msgtype for c in reader.connections})) or "nothing"
        raise FormatError(f"holds no {kind}, only {kinds}", file)
    if topic is None and len(topics) > 1:
        raise FormatError(f"has several topics with a {kind}: {_listed(topics)}; say which one with option topic", file)
    return [c for c in connections if c.topic == (topics[0] if topic is None else known_name("topic", topic, topics))]


def _listed(names: list[str]) -> str:
    """Names of a bag, which may be long and many."""
    return ", ".join(name[:_LONGEST_NAME] for name in names[:_MOST_NAMES]) + (", ..." if names[_MOST_NAMES:] else "")


def _trajectory(message: JointTrajectoryMessage) -> Trajectory:
    points = message.points
    if not points:
        raise InputError("the message has no points, expected at least one")
    times = [t if isinstance(t := p.time_from_start, float) else 1e-9 * t.nanoseconds for p in points]
    rows = []
    for name in ("positions", "velocities", "accelerations"):
        values = [getattr(p, name) for p in points]
        if any(values) != all(values):
            raise InputError(f"some points have {name}, point {[bool(v) for v in values].index(False)} has none")
        bad = next((i for i, v in enumerate(values) if v and len(v) != len(message.joint_names)), None)
        if bad is not None:
            numbers = counted(len(values[bad]), "number")
            raise InputError(f"point {bad} has {numbers} in {name}, expected {len(message.joint_names)}")
        rows.append(values if any(values) else None)
    q, qd, qdd = rows
    if q is None:
        raise InputError("the points have no positions")
    return Trajectory.from_samples(message.joint_names, times, q, qd, qdd)
