"""Motions for other programs: what is written reads back equal."""

from __future__ import annotations

import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest

import rr1plan as rp
from rr1plan.errors import InputError, MissingPackageError, UnknownNameError
from rr1plan.export.robot_formats import STATE_TOPIC, TRAJECTORY_TOPIC, save_mjcf, save_rosbag


@pytest.fixture(scope="module")
def motion() -> rp.Trajectory:
    coefficients = np.zeros((1, 6, 2))
    coefficients[0, 3:] = np.outer([10, -15, 6], [1.0, -0.5])
    return rp.Trajectory(("arm/a", "arm/b"), np.array([0.0, 1.0]), coefficients)


def _read(folder: Path) -> dict[str, list]:
    pytest.importorskip("rosbags", reason="the extra `ros` is not installed")
    from rosbags.rosbag2 import Reader
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    messages: dict[str, list] = {}
    with Reader(folder) as reader:
        for connection, stamp, raw in reader.messages():
            messages.setdefault(connection.topic, []).append((stamp, store.deserialize_cdr(raw, connection.msgtype)))
    return messages


def test_a_bag_reads_back_equal(motion: rp.Trajectory, tmp_path: Path) -> None:
    pytest.importorskip("rosbags", reason="the extra `ros` is not installed")
    folder = save_rosbag(tmp_path / "bag", motion, dt=0.03, lead=0.5)
    messages = _read(folder)
    (_, message), *more = messages[TRAJECTORY_TOPIC]
    assert not more
    assert message.joint_names == ["a", "b"]
    times = motion.sample_times(0.03)
    stamps = np.array([p.time_from_start.sec + 1e-9 * p.time_from_start.nanosec for p in message.points])
    np.testing.assert_allclose(stamps, times + 0.5, atol=1e-9)
    assert (np.diff(stamps) > 0).all()
    for name, derivative in (("positions", 0), ("velocities", 1), ("accelerations", 2)):
        rows = np.array([getattr(p, name) for p in message.points])
        np.testing.assert_allclose(rows, motion(times, derivative), atol=1e-12)
    assert (message.points[-1].velocities == 0.0).all()
    states = messages[STATE_TOPIC]
    assert len(states) == len(times)
    np.testing.assert_array_equal([s.position for _, s in states], [p.positions for p in message.points])
    assert sorted(p.name for p in tmp_path.iterdir()) == ["bag"]


def test_names_may_be_changed_and_arms_are_told_apart(motion: rp.Trajectory, tmp_path: Path) -> None:
    pytest.importorskip("rosbags", reason="the extra `ros` is not installed")
    other = rp.Trajectory(("right/a",), motion.breaks, motion.coefficients[:, :, :1])
    both = rp.Trajectory.merge(motion, other)
    folder = save_rosbag(tmp_path / "two", both, rename={"arm/a": "shoulder"})
    assert _read(folder)[TRAJECTORY_TOPIC][0][1].joint_names == ["shoulder", "arm_b", "right_a"]


def test_a_bag_that_cannot_be_written_leaves_nothing(
    motion: rp.Trajectory, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("rosbags", reason="the extra `ros` is not installed")
    link = tmp_path / "link"
    link.symlink_to("gone")
    with pytest.raises(InputError, match="link exists already"):
        save_rosbag(link, motion)
    link.unlink()

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("rosbags.rosbag2.Writer.write", full)
    with pytest.raises(InputError, match=r"cannot write .*bag: No space left on device"):
        save_rosbag(tmp_path / "bag", motion)
    assert not list(tmp_path.iterdir())


def test_bad_arguments_are_named(motion: rp.Trajectory, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "there").mkdir()
    with pytest.raises(InputError, match="exists already"):
        save_rosbag(tmp_path / "there", motion)
    with pytest.raises(InputError, match=r"cannot write .*where: there is no folder .*no$"):
        save_rosbag(tmp_path / "no" / "where", motion)
    with pytest.raises(InputError, match="dt is 0"):
        save_rosbag(tmp_path / "bag", motion, dt=0.0)
    with pytest.raises(InputError, match="lead is -1"):
        save_rosbag(tmp_path / "bag", motion, lead=-1.0)
    with pytest.raises(UnknownNameError, match="column 'a'"):
        save_rosbag(tmp_path / "bag", motion, rename={"a": "b"})
    with pytest.raises(InputError, match="not distinct"):
        save_rosbag(tmp_path / "bag", motion, rename={"arm/a": "b"})
    monkeypatch.setitem(sys.modules, "rosbags.rosbag2", None)
    with pytest.raises(MissingPackageError, match=r"rr1plan\[ros\]"):
        save_rosbag(tmp_path / "bag", motion)
    assert [p.name for p in tmp_path.iterdir()] == ["there"]


def test_mjcf_is_the_model_that_simulate_uses(rr1_table: rp.Scene, tmp_path: Path) -> None:
    file = save_mjcf(tmp_path / "scene.xml", rr1_table)
    model = mujoco.MjModel.from_xml_path(str(file))
    from rr1plan.playback.simulation.mujoco_model import build_mujoco

    ours = build_mujoco(rr1_table).model
    assert (model.nq, model.nbody, model.ngeom, model.nu) == (ours.nq, ours.nbody, ours.ngeom, ours.nu)
    np.testing.assert_allclose(model.body_mass, ours.body_mass, rtol=1e-5, atol=1e-8)
    np.testing.assert_allclose(model.key_qpos, ours.key_qpos, atol=1e-6)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    assert data.ncon == 0
    start = data.qpos.copy()
    mujoco.mj_step(model, data, 250)
    np.testing.assert_allclose(data.qpos, start, atol=3e-3)  # held by servos without feed-forward


FLAT = """<robot name="flat"><link name="base"/><link name="plate"><inertial><mass value="0.3"/>
<inertia ixx="1.234564e-3" iyy="2.345674e-3" izz="3.580236e-3" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j" type="revolute"><parent link="base"/><child link="plate"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" velocity="1" effort="1"/></joint></robot>"""


def test_moments_of_a_flat_body_are_valid_after_rounding(tmp_path: Path) -> None:
    (tmp_path / "flat.urdf").write_text(FLAT)
    scene = rp.Scene().with_arm("arm", rp.load_robot(tmp_path / "flat.urdf"))
    model = mujoco.MjModel.from_xml_path(str(save_mjcf(tmp_path / "flat.xml", scene)))
    moments = sorted(model.body("arm/plate").inertia.tolist())
    np.testing.assert_allclose(moments, [1.234564e-3, 2.345674e-3, 3.580236e-3], rtol=1e-4)
