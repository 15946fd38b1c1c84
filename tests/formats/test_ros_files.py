"""Trajectories of ROS programs: read as a controller would execute them, or rejected with a reason."""

from __future__ import annotations

import gc
import os
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
import yaml

import rr1plan as rp
from rr1plan.cli import BAD_INPUT, run
from rr1plan.errors import FormatError, InputError, UnknownNameError
from rr1plan.export.robot_formats import TRAJECTORY_TOPIC, save_rosbag
from rr1plan.export.ros_trajectories import load_joint_trajectory

_POINTS = [
    {"positions": [0.0, 1.0], "time_from_start": {"sec": 0, "nanosec": 0}},
    {"positions": [0.5, 2.0], "time_from_start": {"sec": 1, "nanosec": 500_000_000}},
]


def message(points: object = _POINTS, **fields: object) -> dict[str, object]:
    return {"joint_names": ["shoulder", "elbow"], "points": points, **fields}


def written(folder: Path, data: object) -> Path:
    file = folder / "motion.yaml"
    file.write_text(data if isinstance(data, str) else yaml.safe_dump(data))
    return file


@pytest.mark.parametrize(
    "wrap",
    [
        lambda m: m,
        lambda m: {"header": {"frame_id": ""}, **m},
        lambda m: {"joint_trajectory": m, "multi_dof_joint_trajectory": {}},
        lambda m: {"goal": {"trajectory": m}},
        lambda m: {"model_id": "arm", "trajectory": [{"joint_trajectory": m}]},
        lambda m: yaml.safe_dump(m) + "---\n",
    ],
)
def test_a_yaml_message_is_read_alone_or_in_what_holds_it(tmp_path: Path, wrap) -> None:
    read = load_joint_trajectory(written(tmp_path, wrap(message())))
    assert read.joint_names == ("shoulder", "elbow")
    assert read.degree == 1
    np.testing.assert_array_equal(read.breaks, [0.0, 1.5])
    np.testing.assert_allclose(read(0.75), [0.25, 1.5])


def test_a_motion_of_one_joint_without_an_arm_is_written_as_it_was_read(tmp_path: Path) -> None:
    axis = rp.Trajectory.from_samples(["rail"], [0.0, 1.0], [[0.0], [0.3]], [[0.0], [0.0]])
    read = rp.load_joint_trajectory(rp.save_joint_trajectory(tmp_path / "rail.yaml", axis))
    assert read.joint_names == ("rail",)
    assert read.duration == axis.duration


@pytest.mark.parametrize(("carried", "degree"), [(("velocities",), 3), (("velocities", "accelerations"), 5)])
def test_what_points_carry_decides_what_lies_between_them(
    tmp_path: Path, carried: tuple[str, ...], degree: int
) -> None:
    points = [{**p, **{name: [0.1, -0.2] for name in carried}, "effort": []} for p in _POINTS]
    read = load_joint_trajectory(written(tmp_path, message(points)))
    assert read.degree == degree
    np.testing.assert_allclose(read(1.5, 1), [0.1, -0.2])


def test_times_of_ros_1_and_plain_seconds_are_read(tmp_path: Path) -> None:
    for time in ({"secs": 1, "nsecs": 500_000_000}, 1.5):
        read = load_joint_trajectory(written(tmp_path, message([_POINTS[0], {**_POINTS[1], "time_from_start": time}])))
        assert read.end_time == 1.5


@pytest.mark.parametrize("number", ["1e-05", "1.0e-05", "+1.e-5", ".1e-04", "1E-5"])
def test_exponents_are_read_as_other_programs_print_them(tmp_path: Path, number: str) -> None:
    """YAML 1.1 requires a point and a sign, YAML 1.2 neither; `rostopic echo` and yaml-cpp print 1e-05."""
    text = f"joint_names: [1e5x]\npoints:\n- {{positions: [{number}], time_from_start: {{secs: 0, nsecs: 0}}}}\n"
    read = load_joint_trajectory(written(tmp_path, text))
    assert read.joint_names == ("1e5x",)
    assert read(0.0).tolist() == [1e-5]


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ("a: [", "is not YAML"),
        ("a: [1\nb: 3\n", r"yaml:2: is not YAML: while parsing a flow .* \(at line 2, column 2\): ': 3'$"),
        ("[" * 3000 + "]" * 3000, "nested deeper than 100"),
        ("2020-99-99", "is not YAML"),
        ("", "holds 0 messages"),
        ("a: 1\n---\na: 2\n", "holds 2 messages"),
        ("points: []\njoint_names: [a]\njoint_names: [b]\n", r"3: .*the key 'joint_names' twice in one mapping"),
        ({"fixed_frame": "map"}, "holds no trajectory_msgs"),
        ([1, 2], "holds no trajectory_msgs"),
        (message(extra=1), "unknown field `extra`"),
        (message([]), "no points"),
        (message(3), r"Expected `array`.*\$\.points"),
        (message([{**_POINTS[0], "time_from_start": {"sec": 10**400}}]), r"time_from_start\.sec"),
        (message([{"time_from_start": 0}]), "missing required field `positions`"),
        (message([{**_POINTS[0], "positions": [1.0]}]), "point 0 has 1 number in positions, expected 2"),
        (message([{**_POINTS[0], "positions": ["a", 1.0]}]), r"points\[0\]\.positions\[0\]"),
        (message([{**_POINTS[0], "positions": [float("nan"), 1.0]}]), "nan"),
        (message([{**_POINTS[0], "velocities": [0.0, 0.0]}, _POINTS[1]]), "point 1 has none"),
        (message([_POINTS[1], _POINTS[0]]), "do not strictly increase"),
        (message([{**_POINTS[0], "accelerations": [0.0, 0.0]}]), "accelerations without velocities"),
    ],
)
def test_a_wrong_yaml_message_is_refused_by_name(tmp_path: Path, data: object, words: str) -> None:
    with pytest.raises(FormatError, match=words) as caught:
        load_joint_trajectory(written(tmp_path, data))
    assert "motion.yaml" in str(caught.value)


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> tuple[rp.Trajectory, Path]:
    pytest.importorskip("rosbags", reason="the extra `ros` is not installed")
    coefficients = np.zeros((1, 6, 2))
    coefficients[0, 3:] = np.outer([10, -15, 6], [1.0, -0.5])
    motion = rp.Trajectory(("arm/a", "arm/b"), np.array([0.0, 1.0]), coefficients)
    return motion, save_rosbag(tmp_path_factory.mktemp("bag") / "bag", motion, dt=0.1)


def test_a_bag_that_was_written_reads_back_the_same_motion(bag: tuple[rp.Trajectory, Path]) -> None:
    motion, folder = bag
    for file in (folder, next(folder.glob("*.mcap"))):
        read = load_joint_trajectory(file)
        assert read.joint_names == ("a", "b")
        assert read.degree == 5
        times = np.linspace(0.0, 1.0, 57)
        np.testing.assert_allclose(read(times), motion(times), atol=1e-9)
    assert load_joint_trajectory(folder, topic=TRAJECTORY_TOPIC).degree == 5


def test_the_message_about_a_damaged_bag_is_short(bag: tuple[rp.Trajectory, Path], tmp_path: Path) -> None:
    folder = Path(shutil.copytree(bag[1], tmp_path / "bag"))
    metadata = folder / "metadata.yaml"
    metadata.write_text(metadata.read_text().replace("name: ", "name: [" + "x" * 5000))
    with pytest.raises(FormatError, match="cannot be read as a ROS bag") as caught:
        load_joint_trajectory(folder)
    assert len(str(caught.value)) < 600 + len(str(folder))


def test_a_bag_whose_folder_is_named_like_its_database_is_read(bag: tuple[rp.Trajectory, Path], tmp_path: Path) -> None:
    motion, _ = bag
    folder = save_rosbag(tmp_path / "motion.mcap", motion)
    for file in (folder, next(folder.glob("*.mcap"))):
        assert load_joint_trajectory(file).joint_names == ("a", "b")


def test_a_ros_2_bag_is_not_named_like_one_of_ros_1(bag: tuple[rp.Trajectory, Path], tmp_path: Path) -> None:
    motion, folder = bag
    with pytest.raises(InputError, match=r"motion\.bag'.* ROS 1 bag; leave out \.bag"):
        save_rosbag(tmp_path / "motion.bag", motion)
    assert not list(tmp_path.iterdir())
    named = shutil.copytree(folder, tmp_path / "other.bag")
    with pytest.raises(FormatError, match=r"other\.bag: is a folder, expected a file of ROS 1; rename"):
        load_joint_trajectory(named)


@pytest.fixture(scope="module")
def ros1_bag(bag: tuple[rp.Trajectory, Path]) -> Callable[..., Path]:
    """Writes a bag of ROS 1 whose points carry the given number of derivatives."""
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    motion, folder = bag
    store = get_typestore(Stores.ROS1_NOETIC)
    names = ("JointTrajectory", "JointTrajectoryPoint")
    trajectory, point = (store.types[f"trajectory_msgs/msg/{name}"] for name in names)
    duration, time = (store.types[f"builtin_interfaces/msg/{name}"] for name in ("Duration", "Time"))
    header = store.types["std_msgs/msg/Header"](0, time(0, 0), "")

    def write(
        name: str, derivatives: int, topics: tuple[str, ...] = ("/command",), joints: Sequence[str] = ("a", "b")
    ) -> Path:
        file, none = folder.parent / name, np.zeros(0)
        points = []
        for t in np.linspace(0.0, 1.0, 11):
            rows = [motion(t, k) if k <= derivatives else none for k in range(3)]
            points.append(point(*rows, none, duration(int(t), round((t % 1.0) * 1e9))))
        with Writer(file) as writer:
            for topic in topics:
                connection = writer.add_connection(topic, trajectory.__msgtype__, typestore=store)
                data = store.serialize_ros1(trajectory(header, list(joints), points), trajectory.__msgtype__)
                writer.write(connection, 10**9, data)
        return file

    return write


@pytest.mark.parametrize(("derivatives", "degree"), [(0, 1), (1, 3), (2, 5)])
def test_a_bag_of_ros_1_is_read(
    ros1_bag: Callable[..., Path], bag: tuple[rp.Trajectory, Path], derivatives: int, degree: int
) -> None:
    read = load_joint_trajectory(ros1_bag(f"{derivatives}.bag", derivatives))
    assert read.joint_names == ("a", "b")
    assert read.degree == degree
    times = np.linspace(0.0, 1.0, 11)
    for k in range(derivatives + 1):
        np.testing.assert_allclose(read(times[1:-1], k)[:, 0], bag[0](times[1:-1], k)[:, 0], atol=1e-7)


def test_one_of_several_topics_is_chosen(ros1_bag: Callable[..., Path], capsys: pytest.CaptureFixture[str]) -> None:
    file = ros1_bag("two.bag", 2, ("/one", "/two"), ["joint1", "joint2"])
    with pytest.raises(FormatError, match=r"several topics .*: /one, /two; say which one with option topic"):
        load_joint_trajectory(file)
    assert load_joint_trajectory(file, topic="/two").degree == 5
    scene = file.with_name("scene.toml")
    scene.write_text('[arms.arm]\nrobot = "planar2r"\n')
    motion = rp.load_motion(file, rp.load_scene(scene), topic="/two")
    assert motion.trajectory.joint_names == ("arm/joint1", "arm/joint2")
    for command in ("validate", "play", "view"):
        page = ["--html", str(file.with_name("a.html"))] if command == "view" else []
        assert run([command, str(file), "--scene", str(scene), *page]) == BAD_INPUT
        assert "/one, /two; say which one with --topic" in capsys.readouterr().err
        assert run([command, str(file), "--scene", str(scene), "--topic", "/two", *page]) != BAD_INPUT
        assert capsys.readouterr().err == ""
        assert run([command, "rr1_table", "--topic", "/two"]) == BAD_INPUT
        capsys.readouterr()
    with pytest.raises(InputError, match=r"a\.csv is not a bag and has no topics"):
        rp.load_motion("a.csv", topic="/one")


def test_a_file_that_is_neither_yaml_nor_a_bag_is_told_by_its_ending(tmp_path: Path) -> None:
    (tmp_path / "m.csv").write_text("t,q:a\n")
    with pytest.raises(rp.FormatError, match=r"suffix '.csv', expected one of .yaml, .yml, .bag"):
        load_joint_trajectory(tmp_path / "m.csv")


def test_wrong_bags_and_topics_are_refused_by_name(bag: tuple[rp.Trajectory, Path], tmp_path: Path) -> None:
    with pytest.raises(UnknownNameError, match=TRAJECTORY_TOPIC):
        load_joint_trajectory(bag[1], topic="/joint_trajectoryy")
    (tmp_path / "broken.bag").write_bytes(b"#ROSBAG V2.0\n" + b"x" * 100)
    (tmp_path / "empty").mkdir()
    with pytest.raises(FormatError, match=r"broken\.bag: cannot be read as a ROS bag.* if its recording was"):
        load_joint_trajectory(tmp_path / "broken.bag")
    (tmp_path / "alone.mcap").write_bytes(b"")
    for name, folder in (("empty", tmp_path / "empty"), ("alone.mcap", tmp_path)):
        words = f"{name}: there is no metadata.yaml in the folder {folder}.* was interrupted, try `ros2 bag reindex`"
        with pytest.raises(FormatError, match=words):
            load_joint_trajectory(tmp_path / name)
    for name in ("none.mcap", "none.bag"):
        with pytest.raises(FormatError, match="no such file"):
            load_joint_trajectory(tmp_path / name)
    os.mkfifo(tmp_path / "pipe.bag")
    os.mkfifo(tmp_path / "empty" / "metadata.yaml")
    (tmp_path / "loop.bag").symlink_to("loop.bag")
    for name in ("pipe.bag", "empty", "loop.bag"):
        with pytest.raises(FormatError, match=f"{name}: (holds .*regular files|cannot be read|there is no such)"):
            load_joint_trajectory(tmp_path / name)
    with pytest.raises(InputError, match="not a bag and has no topics"):
        load_joint_trajectory(written(tmp_path, message()), topic="/a")


def test_long_messages_are_written_and_read_without_garbage_collection(tmp_path: Path) -> None:
    """It would take most of the time of files with millions of numbers."""
    motion = rp.Trajectory(("arm/x",), [0.0, 30.0], [[[0.0], [0.0], [3.0 / 900.0], [-2.0 / 27000.0]]])
    began: list[int] = []
    gc.collect()
    gc.callbacks.append(lambda phase, info: began.append(info["generation"]) if phase == "start" else None)
    try:
        file = rp.save_joint_trajectory(tmp_path / "long.yaml", motion, dt=0.01)
        assert len(load_joint_trajectory(file).breaks) == 3001
    finally:
        gc.callbacks.pop()
    assert len(began) < 100
    (tmp_path / "cut.yaml").write_text("points: [1, {")
    with pytest.raises(FormatError):
        load_joint_trajectory(tmp_path / "cut.yaml")
    assert gc.isenabled()
