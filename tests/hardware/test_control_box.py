"""Frames of the control box and its part of a calibration file: exact, and rejected with a reason if wrong."""

from __future__ import annotations

import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.files.toml_writer import to_toml
from rr1plan.hardware.control_box_frames import COMMAND_BYTES, HEADER, TELEMETRY_BYTES, TelemetryStream


def a_frame(**changes: object) -> rp.Telemetry:
    values = {"serial_number": "0002", "state": "active", "limit_switches": ("S1 A", "G B")}
    values |= {"encoders": tuple(range(7)), "remaining": (-3, 0, 4, 0, 0, 0, 9), "position": (1, -2, 3, -4, 5, -6, 7)}
    return rp.Telemetry(**{**values, **changes})


# ---- frames ----------------------------------------------------------------------------------------


def test_a_command_has_the_bytes_of_the_protocol() -> None:
    frame = rp.BoxCommand((256, -1, 0, 0, 0, 0, 2**31 - 1), "low").encode()
    assert len(frame) == COMMAND_BYTES == 47
    assert frame[:15] == b"RR1-rev.2-robot"
    assert frame[15:27] == bytes.fromhex("02000000 00010000 ffffffff".replace(" ", ""))
    assert frame[-4:] == b"\xff\xff\xff\x7f"
    assert rp.BoxCommand.decode(frame) == rp.BoxCommand((256, -1, 0, 0, 0, 0, 2**31 - 1), "low")


def test_telemetry_counts_executed_steps_against_the_command() -> None:
    frame = a_frame().encode()
    assert len(frame) == TELEMETRY_BYTES == 111
    fields = struct.unpack("<15s4sII21i", frame)
    assert fields[:4] == (b"RR1-rev.2-robot", b"0002", 2, 1 | 1 << 13)
    assert fields[4:11] == tuple(range(7))
    assert fields[-7:] == (-1, 2, -3, 4, -5, 6, -7)
    assert rp.Telemetry.decode(frame) == a_frame()


@pytest.mark.parametrize(
    ("frame", "words"),
    [
        (b"", "a command is 0 bytes, expected 47 bytes"),
        ("text", "a command is a str"),
        (b"x" * 47, "begins with b'xxxxxxxxxxxxxxx'"),
        (HEADER + struct.pack("<8i", 3, *[0] * 7), r"safety level 3, expected 1 \(high\) or 2 \(low\)"),
    ],
)
def test_a_frame_that_is_no_command_is_refused(frame: bytes, words: str) -> None:
    with pytest.raises(rp.InputError, match=words):
        rp.BoxCommand.decode(frame)


@pytest.mark.parametrize(
    ("steps", "words"),
    [
        ((1, 2), "steps has 2 numbers, expected 7"),
        ((0.5, 0, 0, 0, 0, 0, 0), "steps of S1 is 0.5"),
        ((0, 0, 0, 0, 0, 0, 2**31), "steps of G is 2147483648"),
        (None, "steps is None"),
    ],
)
def test_a_command_of_wrong_steps_is_refused(steps: tuple[int, ...], words: str) -> None:
    with pytest.raises(rp.InputError, match=words):
        rp.BoxCommand(steps)
    with pytest.raises(rp.UnknownNameError, match="unknown safety level 'none'"):
        rp.BoxCommand((0,) * 7, "none")


def test_a_stream_is_joined_in_the_middle_and_cut_anywhere() -> None:
    frames = [a_frame(encoders=(k,) * 7) for k in range(6)]
    data = b"".join(frame.encode() for frame in frames)[40:]
    for size in (1, 7, 110, 111, 500):
        stream = TelemetryStream()
        found = [frame for k in range(0, len(data), size) for frame in stream.feed(data[k : k + size])]
        assert found == frames[1:]


def test_garbage_in_a_stream_is_an_error() -> None:
    stream = TelemetryStream()
    assert len(list(stream.feed(a_frame().encode()))) == 1
    with pytest.raises(rp.SerialLineError, match="garbage on the serial line: telemetry begins with"):
        list(stream.feed(b"\x00" + a_frame().encode()))
    wrong = bytearray(a_frame().encode())
    wrong[19] = 77
    with pytest.raises(rp.SerialLineError, match="state 77"):
        list(TelemetryStream().feed(bytes(wrong)))
    with pytest.raises(rp.SerialLineError, match="no header in 300 bytes"):
        list(TelemetryStream().feed(b"\x55" * 300))


# ---- files -----------------------------------------------------------------------------------------


def box_table(box: rp.ControlBox) -> dict[str, object]:
    fields = ("joint", "fast_period", "ramp_steps", "counts_per_step")
    channels = {name: {key: getattr(channel, key) for key in fields} for name, channel in box.channels.items()}
    return {"control_box": {"tick": box.tick, "channels": channels}}


def test_one_file_holds_calibration_and_control_box(
    calibration: rp.Calibration, box: rp.ControlBox, tmp_path: Path
) -> None:
    file = calibration.save(tmp_path / "arm.toml")
    file.write_text(file.read_text() + "\n" + to_toml(box_table(box)))
    read = rp.load_control_box(file)
    assert (dict(read.channels), read.tick) == (dict(box.channels), box.tick)
    assert dict(rp.load_calibration(file).joints) == dict(calibration.joints)


def test_a_new_calibration_keeps_the_control_box_of_the_file(
    calibration: rp.Calibration, box: rp.ControlBox, tmp_path: Path
) -> None:
    file = calibration.save(tmp_path / "arm.toml")
    file.write_text(file.read_text() + "\n" + to_toml(box_table(box)))
    replace(calibration, date="today").save(file)
    assert rp.load_calibration(file).date == "today"
    assert dict(rp.load_control_box(file).channels) == dict(box.channels)
    other = replace(calibration, robot="other").save(file)
    with pytest.raises(rp.FormatError, match="has no table 'control_box'"):
        rp.load_control_box(other)
    file.write_text("control_box = [")
    assert dict(rp.load_calibration(calibration.save(file)).joints) == dict(calibration.joints)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("version = 1", "version = 2", "arm.toml:2: version: is version 2, expected 1"),
        ('"rr1plan calibration"', '"another"', "format: expected 'rr1plan calibration'"),
        ("tick = 0.000602", "tick = 0", "tick is 0.0, expected a number above zero"),
        ("tick = 0.000602", "tick = 5", "tick is 5 s, expected at most 1 s"),
        ("tick = 0.000602", "tock = 1", "has no 'tick'"),
        ("S2 = {", "S9 = {", "unknown channel 'S9'"),
        ("ramp_steps = 64", "ramp_steps = 0", "ramp_steps is 0"),
        ("ramp_steps = 64", "ramp_steps = 1.5", "expected a whole number, got 1.5"),
        ("ramp_steps = 64", "ramp_step = 64", "has no 'ramp_steps'"),
        ("fast_period = 3.0", "fast_period = 0.5", "fast_period is 0.5 ticks"),
        ("counts_per_step = 2.5", "counts_per_step = -1e9", "counts_per_step is -1e.09, expected at most"),
        ('"elbow_joint"', '"wrist_joint"', "expected distinct joints"),
    ],
)
def test_a_wrong_control_box_is_refused_by_name(
    box: rp.ControlBox, tmp_path: Path, old: str, new: str, words: str
) -> None:
    text = to_toml({"format": "rr1plan calibration", "version": 1, **box_table(box)})
    assert old in text
    file = tmp_path / "arm.toml"
    file.write_text(text.replace(old, new))
    with pytest.raises(rp.InputError, match=words):
        rp.load_control_box(file)


def test_a_file_without_a_control_box_is_refused(calibration: rp.Calibration, tmp_path: Path) -> None:
    with pytest.raises(rp.FormatError, match="has no table 'control_box'"):
        rp.load_control_box(calibration.save(tmp_path / "arm.toml"))


def test_counters_of_the_emulator_are_positions_by_the_calibration(
    plan: rp.CommandPlan, calibration: rp.Calibration
) -> None:
    start = calibration.positions(plan.start[:6], [name.split("/")[1] for name in plan.path.joint_names])
    np.testing.assert_allclose(plan.path.waypoints[0], start)
