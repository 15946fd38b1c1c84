"""Calibrations as values and as files: exact round trips, named errors."""

from __future__ import annotations

import math
import pickle
from pathlib import Path

import numpy as np
import pytest

import rr1plan as rp


@pytest.fixture
def calibration(rr1: rp.Robot) -> rp.Calibration:
    steps = rp.Calibration.assumed(rr1, {name: 800.0 + i for i, name in enumerate(rr1.joint_names)}, unit="steps")
    joints = dict(steps.joints) | {"elbow_joint": rp.JointCalibration(-1, 0.1, 1547.0 / 3.0, 1e-3, 0.7)}
    return rp.Calibration("rr1", joints, "steps", "2026-11-23", 'by "hand"')


def test_a_file_reads_back_exactly(calibration: rp.Calibration, tmp_path: Path) -> None:
    again = rp.load_calibration(calibration.save(tmp_path / "c.toml"))
    assert again.joints == calibration.joints
    assert (again.robot, again.unit, again.date, again.source) == ("rr1", "steps", "2026-11-23", 'by "hand"')
    with pytest.raises(rp.InputError, match=r"c.json', expected a name that ends in \.toml"):
        calibration.save(tmp_path / "c.json")
    assert (tmp_path / "c.toml").read_text().startswith("# position = zero + sign * reading / scale\n")
    assert pickle.loads(pickle.dumps(again)).joints == calibration.joints


def test_readings_and_positions_are_inverse(calibration: rp.Calibration) -> None:
    positions = np.random.default_rng(0).uniform(-1, 1, (5, 6))
    readings = calibration.readings(positions)
    np.testing.assert_allclose(calibration.positions(readings), positions, atol=1e-12)
    np.testing.assert_allclose(readings[:, 2], -(positions[:, 2] - 0.1) * 1547.0 / 3.0)
    one = calibration.readings([0.2], ["elbow_joint"])
    np.testing.assert_allclose(one, -0.1 * 1547.0 / 3.0)
    with pytest.raises(rp.UnknownNameError, match="calibrated joint 'finger_joint'"):
        calibration.positions([0.0], ["finger_joint"])


def test_negative_scales_are_negative_signs(planar2r: rp.Robot) -> None:
    names = planar2r.joint_names
    found = rp.Calibration.assumed(planar2r, dict(zip(names, (-4.0, 5.0), strict=True)))
    assert [(joint.sign, joint.scale) for joint in found.joints.values()] == [(-1, 4.0), (1, 5.0)]
    assert all(math.isinf(joint.zero_std) for joint in found.joints.values())


@pytest.mark.parametrize(
    ("old", "new", "words"),
    {
        "another file": ('"rr1plan calibration"', '"rr1plan motion"', "expected 'rr1plan calibration'"),
        "newer": ("version = 1", "version = 2", "is version 2, expected 1"),
        "degrees": ('position = "rad"', 'position = "deg"', "units.position: is 'deg', expected 'rad'"),
        "unit": ('reading = "steps"', 'reading = "stepps"', "unknown unit 'stepps'"),
        "sign": ("sign = -1", "sign = 0", "joints.elbow_joint: sign is 0, expected 1 or -1"),
        "half a sign": ("sign = -1", "sign = 0.5", "joints.elbow_joint: sign is 0, expected 1 or -1"),
        "scale": ("scale = 800.0", "scale = -800.0", "shoulder_joint: scale is -800.0, expected a number above zero"),
        "std": ("zero_std = 0.001", 'zero_std = "small"', "zero_std is not a number: 'small'"),
        "nan": ("zero = 0.1", "zero = nan", "elbow_joint.zero: expected a finite number, got nan"),
        "key": ("zero = 0.1", "zeroo = 0.1", "has no 'zero', which is required"),
    }.values(),
)
def test_bad_files_are_refused_by_the_name_of_the_entry(
    calibration: rp.Calibration, tmp_path: Path, old: str, new: str, words: str
) -> None:
    file = calibration.save(tmp_path / "c.toml")
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new, 1))
    with pytest.raises(rp.FormatError, match=words.replace(".", r"\.")):
        rp.load_calibration(file)


def test_units_fit_joints_that_turn_and_joints_that_slide() -> None:
    """If the kind of a joint is not known, a slide of 0.1 m must not be printed as 5.73 degrees."""
    before, after = (
        rp.Calibration("slide", {"rail": rp.JointCalibration(1, zero, 1000.0, 0.001, 2.0)}, "counts")
        for zero in (0.1, 0.12)
    )
    assert "zero  +0.10000 ± 0.00100 rad or m  scale 1000 ± 2 counts per rad or m" in str(before)
    assert str(after.zero_shifts(before)[0]) == "rail: +0.0200 rad or m (14.1 standard deviations)"


def test_units_of_joints_are_known_if_the_robot_is(tmp_path: Path) -> None:
    robot = rp.planar_arm("RP")
    found = rp.Calibration.assumed(robot, 100.0, unit="steps")
    again = rp.load_calibration(found.save(tmp_path / "c.toml"))
    assert again.joints == found.joints
    turns, slides = str(again).splitlines()[1:]
    assert "± inf rad " in turns
    assert turns.endswith("steps per rad")
    assert "± inf m " in slides
    assert slides.endswith("steps per m")
    assert [shift.unit for shift in again.zero_shifts(found)] == ["rad", "m"]
    head, turns, slides = str(rp.Calibration.assumed(robot)).splitlines()
    assert head == "planar_rp: readings in rad or m, assumed"
    assert turns.endswith("rad per rad")
    assert slides.endswith("m per m")
    with pytest.raises(rp.InputError, match="unknown position_unit 'deg'"):
        rp.JointCalibration(1, 0.0, 1.0, position_unit="deg")


def test_other_arms_have_no_shifts(calibration: rp.Calibration, planar2r: rp.Robot) -> None:
    assert [shift.significance for shift in calibration.zero_shifts(calibration)] == [0.0] * 6
    with pytest.raises(rp.InputError, match="the earlier calibration is of 'planar2r'"):
        calibration.zero_shifts(rp.Calibration.assumed(planar2r))


def test_units_of_positions_are_those_of_the_robots_joints(rr1: rp.Robot) -> None:
    right = rp.Calibration.assumed(rr1)
    wrong = rp.Calibration(
        "rr1", dict(right.joints) | {"elbow_joint": rp.JointCalibration(1, 0.0, 1.0, position_unit="m")}
    )
    q = np.zeros((20, 6))
    with pytest.raises(rp.InputError, match="'elbow_joint' is calibrated in m, robot 'rr1' moves it in rad"):
        rp.calibrate(rr1, q, np.zeros((20, 3)), start=wrong)
    with pytest.raises(rp.InputError, match="'elbow_joint' is calibrated in m, earlier in another unit"):
        wrong.zero_shifts(right)
    unknown = rp.Calibration("rr1", dict(right.joints) | {"elbow_joint": rp.JointCalibration(1, 0.0, 1.0)})
    assert len(unknown.zero_shifts(right)) == 6
