"""Messages name what a joint trajectory controller rejects; trajectories written here are accepted."""

from __future__ import annotations

import copy
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import rr1plan as rp

_JOINTS = ["shoulder", "elbow"]


def accepted() -> dict[str, Any]:
    """A message that every controller of these joints accepts."""
    points = [
        {"positions": [0.1 * k, 0.0], "velocities": [0.0, 0.0], "time_from_start": {"sec": k, "nanosec": 0}}
        for k in range(3)
    ]
    return {"joint_names": list(_JOINTS), "points": points}


def objections(folder: Path, change: Callable[[dict[str, Any]], None], **options: Any) -> tuple[str, ...]:
    message = copy.deepcopy(accepted())
    change(message)
    file = folder / "message.yaml"
    file.write_text(yaml.safe_dump(message))
    return rp.check_joint_trajectory(file, _JOINTS, **options)


def test_what_the_rules_allow_is_accepted(tmp_path: Path) -> None:
    assert objections(tmp_path, lambda m: None) == ()
    assert objections(tmp_path, lambda m: m["joint_names"].reverse()) == ()
    # Velocities may be left out, of the last point alone too.
    assert objections(tmp_path, lambda m: [p.pop("velocities") for p in m["points"]]) == ()
    assert objections(tmp_path, lambda m: m["points"][-1].pop("velocities")) == ()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda m: m["joint_names"].clear(), "the message names no joints"),
        (lambda m: m["joint_names"].__setitem__(0, "hip"), "joint 'hip' is none of the controller's: shoulder, elbow"),
        (lambda m: m["joint_names"].__setitem__(0, "elbow"), "joint 'elbow' is named 2 times"),
        (lambda m: m["joint_names"].pop(), "joints are missing: elbow; the controller takes partial goals only if"),
        (lambda m: m["points"].clear(), "the message has no points"),
        (
            lambda m: m["points"][1]["positions"].pop(),
            "point 1 has 1 number in positions, expected 2: one for each joint",
        ),
        (lambda m: m["points"][1].__setitem__("positions", []), "point 1 has 0 numbers in positions, expected 2"),
        (lambda m: m["points"][2].__setitem__("velocities", [0.0]), "point 2 has 1 number in velocities, expected 2"),
        (
            lambda m: m["points"][0].__setitem__("accelerations", [0.0] * 3),
            "point 0 has 3 numbers in accelerations, expected 2",
        ),
        (
            lambda m: m["points"][0]["positions"].__setitem__(1, float("nan")),
            "point 0 has positions .* number 1 is nan",
        ),
        (lambda m: m["points"][0].__setitem__("effort", [1.0, 1.0]), "point 0 has efforts"),
        (
            lambda m: m["points"][2].__setitem__("time_from_start", {"sec": 1}),
            "point 2 is due at 1.000000000 s, point 1",
        ),
        (
            lambda m: m["points"][1].__setitem__("time_from_start", {"sec": 5}),
            "times do not strictly increase: point 2",
        ),
        (
            lambda m: m["points"][2].__setitem__("time_from_start", {"sec": 2**31}),
            "point 2 has a time_from_start with sec 2147483648, which does not fit into 32 bits",
        ),
        (lambda m: m["points"][2].__setitem__("time_from_start", 3e9), "with sec 3000000000, which does not fit"),
        (
            lambda m: m["points"][2].__setitem__("time_from_start", {"sec": 2, "nanosec": 10**9}),
            "point 2 has a time_from_start with nanosec 1000000000, expected 0 to 999999999",
        ),
        (
            lambda m: m["points"][2].__setitem__("time_from_start", {"secs": 3, "nsecs": -1}),
            "point 2 has a time_from_start with nsecs -1, expected 0 to 999999999",
        ),
        (lambda m: m["points"][0].__setitem__("time_from_start", -0.5), "the first point is due -0.5 s from the start"),
        (lambda m: m["points"][2].__setitem__("time_from_start", float("inf")), "time_from_start is inf"),
        (lambda m: m["points"][2].__setitem__("time_from_start", 1e300), "time_from_start is 1e.300 s, expected"),
        (
            lambda m: m["points"][2]["velocities"].__setitem__(1, 1e-5),
            "'elbow' has the velocity 1e-05 at the last point",
        ),
    ],
)
def test_what_a_rule_forbids_is_named(tmp_path: Path, change: Callable[[dict[str, Any]], None], words: str) -> None:
    found = objections(tmp_path, change)
    assert any(re.search(words, objection) for objection in found), found


def test_two_rules_depend_on_the_controller(tmp_path: Path) -> None:
    def partial(message: dict[str, Any]) -> None:
        message["joint_names"].pop()
        for point in message["points"]:
            point["positions"].pop()
            point["velocities"].pop()

    assert objections(tmp_path, partial) != ()
    assert objections(tmp_path, partial, allow_partial_joints=True) == ()

    def moving(message: dict[str, Any]) -> None:
        message["points"][-1]["velocities"][0] = 0.5

    assert objections(tmp_path, moving) != ()
    assert objections(tmp_path, moving, allow_final_velocity=True) == ()


@pytest.fixture(scope="module")
def motion() -> rp.Trajectory:
    coefficients = np.zeros((1, 6, 2))
    coefficients[0, 3:] = np.outer([10, -15, 6], [1.0, -0.5])
    return rp.Trajectory(("arm/shoulder", "arm/elbow"), np.array([0.0, 1.0]), coefficients)


def test_what_is_written_is_accepted_and_reads_back_the_same_motion(motion: rp.Trajectory, tmp_path: Path) -> None:
    file = rp.save_joint_trajectory(tmp_path / "motion.yaml", motion, dt=0.07, lead=0.5)
    assert rp.check_joint_trajectory(file, _JOINTS) == ()
    assert rp.check_joint_trajectory(motion, _JOINTS) == ()
    read = rp.load_joint_trajectory(file)
    assert read.joint_names == tuple(_JOINTS)
    times = np.linspace(0.0, 1.0, 31)
    np.testing.assert_allclose(read(times + 0.5), motion(times), atol=1e-6)
    # Every number is one for YAML 1.1, which ros2 topic pub reads: small ones too.
    data = yaml.safe_load(rp.save_joint_trajectory(file, motion, dt=0.005).read_text())
    numbers = [v for p in data["points"] for n in ("positions", "velocities", "accelerations") for v in p[n]]
    assert all(isinstance(value, float) for value in numbers)
    assert min(abs(value) for value in numbers if value) < 1e-5
    assert data["points"][-1]["velocities"] == [0.0, 0.0]


def test_what_is_written_is_accepted_from_bags_of_both_kinds(motion: rp.Trajectory, tmp_path: Path) -> None:
    pytest.importorskip("rosbags", reason="the extra `ros` is not installed")
    for storage, suffix in (("mcap", ".mcap"), ("sqlite3", ".db3")):
        folder = rp.save_rosbag(tmp_path / storage, motion, storage=storage)
        assert any(file.suffix == suffix for file in folder.iterdir())
        assert rp.check_joint_trajectory(folder, _JOINTS) == ()
        np.testing.assert_allclose(rp.load_joint_trajectory(folder)(0.3), motion(0.3), atol=1e-9)


@pytest.mark.parametrize(
    ("name", "words"),
    [(5, "is 5, expected text"), (None, "is None, expected text"), ("", "is empty, expected a name")],
)
def test_a_ros_name_that_cannot_be_read_is_not_written(
    motion: rp.Trajectory, tmp_path: Path, name: Any, words: str
) -> None:
    column = motion.joint_names[0]
    with pytest.raises(rp.InputError, match=f"the ROS name of '{column}' {words}"):
        rp.save_joint_trajectory(tmp_path / "motion.yaml", motion, rename={column: name})
    assert not (tmp_path / "motion.yaml").exists()


def test_a_motion_that_does_not_end_at_rest_is_not_written(motion: rp.Trajectory, tmp_path: Path) -> None:
    half = motion.cut(0.0, 0.5)
    for save in (rp.save_joint_trajectory, rp.save_rosbag, rp.check_joint_trajectory):
        with pytest.raises(rp.InputError, match="does not end at rest: 'arm/shoulder' has the speed"):
            save(*([tmp_path / "half.yaml", half] if save is not rp.check_joint_trajectory else [half]))
    with pytest.raises(rp.InputError, match=r"expected a name that ends in \.yaml or \.yml"):
        rp.save_joint_trajectory(tmp_path / "motion.txt", motion)
    assert list(tmp_path.iterdir()) == []
