"""Calibrations: conversion of encoder or motor readings to joint positions, with uncertainty, and their files.

The position of a joint is `zero + sign * reading / scale`. A file is TOML:

    format = "rr1plan calibration"
    version = 1
    robot = "rr1"
    date = "2026-11-23"
    source = "20 poses, pointer of 100 mm, laser tracker"

    [units]
    position = "rad"    # of zero; scale is readings per this unit
    reading = "steps"   # "steps", "counts" or "rad"

    [joints.shoulder_joint]
    sign = 1
    zero = 0.0123
    zero_std = 0.0007
    scale = 802.14
    scale_std = 0.6
    position_unit = "rad"    # "m" for joints that slide; optional

A standard deviation of `inf` means that the value is assumed, not measured.
"""

from __future__ import annotations

import math
import pathlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rr1plan.checks import (
    Array,
    Value,
    check_text,
    finite_array,
    finite_number,
    items_of,
    known_name,
    number_array,
    of_kind,
    positive_number,
    read_only,
    shape_of,
    shown,
)
from rr1plan.errors import FormatError, InputError
from rr1plan.files.checked_tables import Table
from rr1plan.files.documents import read_toml
from rr1plan.files.file_access import check_writable, write_text
from rr1plan.files.toml_writer import to_toml
from rr1plan.robot import Robot

READING_UNITS = ("steps", "counts", "rad")
_FORMAT, _VERSION = "rr1plan calibration", 1
_MAX_BYTES = 1024 * 1024
# The unit of the positions of a joint whose kind is not known, in texts.
_EITHER = "rad or m"


@dataclass(frozen=True)
class JointCalibration:
    """Conversion of one joint's readings to its position: zero + sign * reading / scale.

    Args:
        sign: 1 if readings grow with the position, -1 if they fall.
        zero: Position at a reading of zero [rad or m].
        scale: Change of the reading per unit of the position [steps/rad, counts/rad, ...], above zero.
        zero_std: Standard deviation of the zero [rad or m]; inf for a value that is assumed.
        scale_std: Standard deviation of the scale, in its unit; inf for a value that is assumed.
        position_unit: Unit of positions, "rad" or "m"; "" if it is not known.

    Raises:
        InputError: another sign, a value that is not finite, a scale that is not positive, a negative standard
            deviation, another unit.
    """

    sign: int
    zero: float
    scale: float
    zero_std: float = math.inf
    scale_std: float = math.inf
    position_unit: str = ""

    def __post_init__(self) -> None:
        if not isinstance(self.sign, int | np.integer) or isinstance(self.sign, bool) or abs(self.sign) != 1:
            raise InputError(f"sign is {shown(self.sign)}, expected 1 or -1")
        object.__setattr__(self, "sign", int(self.sign))
        object.__setattr__(self, "zero", finite_number("zero", self.zero))
        object.__setattr__(self, "scale", positive_number("scale", self.scale))
        for name in ("zero_std", "scale_std"):
            object.__setattr__(self, name, _deviation(name, getattr(self, name)))
        if self.position_unit != "":
            known_name("position_unit", self.position_unit, ("rad", "m"))


def _deviation(name: str, value: object) -> float:
    number = number_array(name, value, "a number")
    if number.shape != () or not number >= 0.0:
        raise InputError(f"{name} is {shown(value)}, expected a number >= 0 (inf: unknown)")
    return float(number)


@dataclass(frozen=True, eq=False, repr=False)
class CalibrationFit(Value):
    """How a calibration was estimated.

    Args:
        residuals: Distance of each measured position from the predicted one [m], shape (m,).
        outliers: Rows of measurements that were excluded.
        noise: Standard deviation of a measured coordinate, from the residuals without outliers [m].
        undetermined: Values that the poses do not determine, by joint: any of "sign", "zero" and "scale".
        T_measured_base: Pose of the base in the frame of the measurements, shape (4, 4).
    """

    residuals: Array
    outliers: tuple[int, ...]
    noise: float
    undetermined: Mapping[str, tuple[str, ...]]
    T_measured_base: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "undetermined", MappingProxyType(dict(self.undetermined)))
        for name in ("residuals", "T_measured_base"):
            object.__setattr__(self, name, read_only(np.array(getattr(self, name), dtype=np.float64)))

    def __str__(self) -> str:
        text = f"{len(self.residuals)} measurements, noise {1e3 * self.noise:.2f} mm per coordinate"
        for row in self.outliers:
            text += f"\nleft out: row {row}, {1e3 * self.residuals[row]:.1f} mm off"
        for name, values in self.undetermined.items():
            text += f"\nnot determined by these poses: {' and '.join(values)} of {name}"
        return text


@dataclass(frozen=True)
class ZeroShift:
    """Change of the zero of a joint since an earlier calibration.

    Args:
        joint: The joint.
        shift: Later zero minus earlier zero [rad or m].
        std: Standard deviation of the shift [rad or m].
        unit: Unit of both, "rad" or "m"; "" if it is not known.
    """

    joint: str
    shift: float
    std: float
    unit: str = ""

    @property
    def significance(self) -> float:
        """The shift in standard deviations; 0 if one of the zeros is unknown."""
        return abs(self.shift) / self.std if self.std > 0.0 else math.inf if self.shift else 0.0

    def __str__(self) -> str:
        return f"{self.joint}: {self.shift:+.4f} {self.unit or _EITHER} ({self.significance:.1f} standard deviations)"


@dataclass(frozen=True, eq=False, repr=False)
class Calibration(Value):
    """Calibrations of the joints of one robot; `calibrate` estimates them, `load_calibration` reads them.

    Args:
        robot: Name of the robot.
        joints: The calibrated joints, by name.
        unit: Unit of readings: "steps" of motors, "counts" of encoders, or "rad" (m for joints that slide).
        date: Date of the measurement, any text.
        source: Method of the measurement, any text.
        fit: Data of the estimation; None for a calibration from a file.

    Raises:
        InputError: no joints, another unit, a value of another type.
    """

    robot: str
    joints: Mapping[str, JointCalibration]
    unit: str = "rad"
    date: str = ""
    source: str = ""
    fit: CalibrationFit | None = None

    def __post_init__(self) -> None:
        for name in ("robot", "date", "source"):
            check_text(name, getattr(self, name))
        of_kind("joints", self.joints, Mapping)
        for name, joint in self.joints.items():
            check_text("a joint's name", name)
            of_kind(f"joint {name!r}", joint, JointCalibration)
        if not self.joints:
            raise InputError("joints is empty, expected at least one calibrated joint")
        known_name("unit", self.unit, READING_UNITS)
        of_kind("fit", self.fit, CalibrationFit, optional=True)
        object.__setattr__(self, "joints", MappingProxyType(dict(self.joints)))

    @staticmethod
    def assumed(robot: Robot, scale: float | Mapping[str, float] = 1.0, *, unit: str = "rad") -> Calibration:
        """Nominal initial values: positive signs, zeros at zero, and given scales, all of unknown accuracy.

        Args:
            robot: The robot.
            scale: Readings per radian or meter, one number or one by joint name; negative ones give negative signs.
            unit: Unit of readings.

        Raises:
            InputError: a scale that is zero, not finite or missing, another unit.
            UnknownNameError: a scale for a joint that the robot does not plan for.
        """
        of_kind("robot", robot, Robot)
        scales = dict(scale) if isinstance(scale, Mapping) else dict.fromkeys(robot.joint_names, scale)
        for name in scales:
            known_name("joint", name, robot.joint_names)
        joints = {}
        for name in robot.joint_names:
            if name not in scales:
                raise InputError(f"scale has no entry for joint {name!r}")
            value = finite_number(f"scale of {name!r}", scales[name])
            sign = -1 if value < 0.0 else 1
            joints[name] = JointCalibration(sign, 0.0, abs(value), position_unit=robot.joint(name).unit)
        return Calibration(robot.name, joints, unit, source="assumed")

    def __str__(self) -> str:
        units = dict.fromkeys(self._reading_unit(joint) for joint in self.joints.values())
        rows = [f"{self.robot}: readings in {' or '.join(units)}{', ' + self.source if self.source else ''}"]
        for name, joint in self.joints.items():
            unit = joint.position_unit or _EITHER
            zero = f"zero {joint.zero:+9.5f} ± {joint.zero_std:.5f} {unit}"
            scale = f"scale {joint.scale:.6g} ± {joint.scale_std:.2g} {self._reading_unit(joint)} per {unit}"
            rows.append(f"  {name:<18} sign {joint.sign:+d}  {zero}  {scale}")
        return "\n".join(rows + ([str(self.fit)] if self.fit else []))

    def _reading_unit(self, joint: JointCalibration) -> str:
        """The unit of a joint's readings; those of joints that slide are in m if the unit is "rad"."""
        return joint.position_unit or self.unit if self.unit == "rad" else self.unit

    # ---- conversion --------------------------------------------------------------------

    def positions(self, readings: ArrayLike, joint_names: Sequence[str] | None = None) -> Array:
        """Joint positions from readings.

        Args:
            readings: Readings, shape (n,) or (m, n).
            joint_names: Joints of the columns (default: all, in the order of `joints`).

        Returns:
            Positions [rad or m], same shape.

        Raises:
            InputError: wrong shape or not finite.
            UnknownNameError: a joint that is not calibrated.
        """
        zeros, slopes = self._columns(joint_names)
        return np.asarray(zeros + self._rows("readings", readings, len(zeros)) * slopes)

    def readings(self, positions: ArrayLike, joint_names: Sequence[str] | None = None) -> Array:
        """Readings at joint positions, not rounded; the inverse of `positions`.

        Args:
            positions: Positions [rad or m], shape (n,) or (m, n).
            joint_names: Joints of the columns (default: all, in the order of `joints`).

        Returns:
            Readings, same shape.

        Raises:
            InputError: wrong shape or not finite.
            UnknownNameError: a joint that is not calibrated.
        """
        zeros, slopes = self._columns(joint_names)
        return np.asarray((self._rows("positions", positions, len(zeros)) - zeros) / slopes)

    def _columns(self, joint_names: Sequence[str] | None) -> tuple[Array, Array]:
        """Zeros and signed positions per reading of some joints, each (n,)."""
        names = tuple(self.joints) if joint_names is None else items_of("joint_names", joint_names, "names")
        joints = [self.joints[known_name("calibrated joint", name, self.joints)] for name in names]
        return np.array([j.zero for j in joints]), np.array([j.sign / j.scale for j in joints])

    @staticmethod
    def _rows(name: str, values: ArrayLike, count: int) -> Array:
        return finite_array(name, values, (count,) if len(shape_of(values)) == 1 else (None, count))

    def zero_shifts(self, earlier: Calibration) -> tuple[ZeroShift, ...]:
        """Changes of zeros since an earlier calibration, most significant first.

        A zero that differs by more than about four standard deviations has changed: a belt has slipped, or an encoder
        was zeroed elsewhere.

        Raises:
            InputError: a calibration of another robot, of other joints, or of a joint in another unit.
        """
        of_kind("earlier", earlier, Calibration)
        if earlier.robot != self.robot or set(earlier.joints) != set(self.joints):
            raise InputError(f"the earlier calibration is of {earlier.robot!r} with {', '.join(earlier.joints)}")
        for name, joint in self.joints.items():
            units = {joint.position_unit, earlier.joints[name].position_unit} - {""}
            if len(units) > 1:
                raise InputError(f"joint {name!r} is calibrated in {joint.position_unit}, earlier in another unit")
        shifts = [
            ZeroShift(name, joint.zero - old.zero, math.hypot(joint.zero_std, old.zero_std), joint.position_unit)
            for name, joint in self.joints.items()
            for old in [earlier.joints[name]]
        ]
        return tuple(sorted(shifts, key=lambda found: -found.significance))

    # ---- files -------------------------------------------------------------------------

    def save(self, file: str | pathlib.Path) -> pathlib.Path:
        """Write a TOML file and return its path; numbers read back to the last bit.

        A table `control_box` stays in a calibration file of the same robot that is replaced.

        Raises:
            InputError: another suffix, or the file cannot be written.
        """
        check_writable(file, ".toml")
        data: dict[str, Any] = {"format": _FORMAT, "version": _VERSION, "robot": self.robot}
        data |= {"date": self.date, "source": self.source}
        data["units"] = {"position": "rad", "reading": self.unit}
        data["joints"] = {name: _row(joint) for name, joint in self.joints.items()}
        data |= _control_box(file, self.robot)
        return write_text(file, f"# position = zero + sign * reading / scale\n{to_toml(data)}")


def check_position_units(calibration: Calibration, robot: Robot) -> None:
    """Raise if positions of a joint are in another unit than those of the robot's joint.

    Raises:
        InputError: a joint that turns, calibrated in meters, or one that slides, calibrated in radians.
    """
    units = {joint.name: joint.unit for joint in robot.joints}
    for name, joint in calibration.joints.items():
        unit = units.get(name, joint.position_unit)
        if joint.position_unit not in ("", unit):
            raise InputError(
                f"joint {name!r} is calibrated in {joint.position_unit}, robot {robot.name!r} moves it in {unit}; "
                "calibrate the joint of this robot"
            )


def _control_box(file: str | pathlib.Path, robot: str) -> dict[str, Any]:
    """The table `control_box` of a calibration file of a robot; {} if there is no such file or table."""
    try:
        kept = read_toml(file, _MAX_BYTES).entries
    except FormatError:
        return {}
    ours = kept.get("format") == _FORMAT and kept.get("robot") == robot and "control_box" in kept
    return {"control_box": kept["control_box"]} if ours else {}


def _row(joint: JointCalibration) -> dict[str, Any]:
    row = {key: getattr(joint, key) for key in ("sign", "zero", "zero_std", "scale", "scale_std")}
    return row | ({"position_unit": joint.position_unit} if joint.position_unit else {})


def load_calibration(file: str | pathlib.Path) -> Calibration:
    """Read a calibration file; see `Calibration.save`.

    Args:
        file: The file (.toml).

    Raises:
        FormatError: the file cannot be read, is not a calibration, is of a newer version, or has an impossible value.
    """
    table = read_calibration_table(file)
    units, joints = table.table("units"), table.table("joints")
    if units.string("position") != "rad":
        raise units.error(f"is {units.raw('position')!r}, expected 'rad' (meters for joints that slide)", "position")
    robot, unit = table.string("robot"), units.string("reading")
    date, source = table.string("date", ""), table.string("source", "")
    rows = {name: _joint(joints.table(name)) for name in joints.names()}
    table.raw("control_box")  # read by `load_control_box`
    for part in (units, table):
        part.finish()
    with table.blame():
        return Calibration(robot, rows, unit, date, source)


def read_calibration_table(file: str | pathlib.Path) -> Table:
    """The outermost table of a calibration file, with its format and version checked.

    Raises:
        FormatError: the file cannot be read, is not a calibration, or is of a newer version.
    """
    table = read_toml(file, _MAX_BYTES)
    if table.string("format") != _FORMAT:
        raise table.error(f"expected {_FORMAT!r}", "format")
    if table.number("version") != _VERSION:
        raise table.error(f"is version {table.raw('version')}, expected {_VERSION}", "version")
    return table


def _joint(row: Table) -> JointCalibration:
    sign = row.number("sign")
    values: dict[str, Any] = {key: row.number(key) for key in ("zero", "scale")}
    values |= {key: row.raw(key, math.inf) for key in ("zero_std", "scale_std")}
    values["position_unit"] = row.string("position_unit", "")
    row.finish()
    with row.blame():
        return JointCalibration(int(sign) if sign == round(sign) else 0, **values)
