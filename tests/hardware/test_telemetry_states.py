"""Telemetry as joint states: an emulated box reports the state of its arm, and faults of the line are named."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import replace
from itertools import islice
from typing import Any

import numpy as np
import pytest

import rr1plan as rp

Line = Callable[..., Any]


@pytest.mark.parametrize("unit", ["steps", "counts"])
def test_a_box_that_moves_is_mirrored(
    unit: str, line: Line, motion: rp.MotionPlan, plan: rp.CommandPlan, calibration: rp.Calibration, box: rp.ControlBox
) -> None:
    if unit == "counts":  # 2.5 of an encoder for each step
        joints = {n: rp.JointCalibration(j.sign, j.zero, 2.5 * j.scale) for n, j in calibration.joints.items()}
        calibration = replace(calibration, unit="counts", joints=joints)
    port = line()
    port.write(plan.commands[0].encode())
    with rp.Mirror(motion.scene) as mirror:
        for item in islice(rp.read_telemetry(port, calibration, box), 400):
            assert isinstance(item, rp.StateMessage)
            assert mirror.receive(item) is not None
        names = [f"rr1/{name}" for name in calibration.joints if name != "finger_joint"]
        counters = np.array(port.emulator.position)[:6] * (2.5 if unit == "counts" else 1.0)
        assert mirror.state is not None
        there = dict(zip(motion.scene.joint_names(), mirror.state.q, strict=True))
        np.testing.assert_allclose(
            [there[name] for name in names], calibration.positions(counters, list(calibration.joints)[:6]), atol=1e-3
        )
        assert mirror.report().messages == 400
        assert mirror.report().faults.get("order", 0) == 0
    assert list(port.emulator.position[:6]) != list(plan.start[:6])


def test_garbage_is_named_and_later_frames_are_read(
    line: Line, calibration: rp.Calibration, box: rp.ControlBox
) -> None:
    good = line()
    data = bytearray(good.read(5 * 111))
    data[2 * 111 : 2 * 111 + 4] = b"\xff\xff\xff\xff"
    rest = bytes(data)

    class Port:
        def read(self, size: int = 1, /) -> bytes:
            nonlocal rest
            part, rest = rest[:size], rest[size:]
            return part

        def write(self, data: bytes, /) -> int | None:
            raise AssertionError("nothing is written")

    kinds = []
    for item in rp.read_telemetry(Port(), calibration, box, silence=0.3):
        kinds.append(item.fault if isinstance(item, rp.StreamError) else "good")
        if kinds[-1] == "silence":
            break
        time.sleep(0.001)
    assert kinds == ["good", "good", "format", "good", "good", "silence"]


def test_a_port_that_fails_is_named(line: Line, calibration: rp.Calibration, box: rp.ControlBox) -> None:
    def unplugged(self: rp.EmulatedSerialLine, size: int = 1) -> bytes:
        raise OSError("device reports readiness to read but returned no data")

    with pytest.raises(rp.SerialLineError, match="the serial line failed while telemetry was read: device reports"):
        next(rp.read_telemetry(line(read=unplugged), calibration, box))


def test_a_slow_receiver_is_no_silence(line: Line, calibration: rp.Calibration, box: rp.ControlBox) -> None:
    for item in islice(rp.read_telemetry(line(), calibration, box, silence=0.25), 3):
        assert isinstance(item, rp.StateMessage)
        time.sleep(0.3)


def test_a_slow_receiver_of_an_error_is_no_silence(line: Line, calibration: rp.Calibration, box: rp.ControlBox) -> None:
    data = line().read(2 * 111)
    parts = [data[:111], b"\xff" * 111, b"", data[111:]]
    port = line(read=lambda self, size: parts.pop(0))
    kinds = []
    for item in islice(rp.read_telemetry(port, calibration, box, silence=0.3), 3):
        kinds.append(item.fault if isinstance(item, rp.StreamError) else "good")
        time.sleep(0.5)
    assert kinds == ["good", "format", "good"]


def test_ctrl_c_does_not_end_a_stream(line: Line, calibration: rp.Calibration, box: rp.ControlBox) -> None:
    data = line().read(2 * 111)
    parts = [data[:111], KeyboardInterrupt(), data[111:]]

    def read(self: rp.EmulatedSerialLine, size: int = 1) -> bytes:
        part = parts.pop(0)
        if isinstance(part, bytes):
            return part
        raise part

    stream = rp.read_telemetry(line(read=read), calibration, box)
    assert isinstance(next(stream), rp.StateMessage)
    with pytest.raises(KeyboardInterrupt):
        next(stream)
    assert isinstance(next(stream), rp.StateMessage)


def test_a_line_that_stops_in_a_frame_is_named(line: Line, calibration: rp.Calibration, box: rp.ControlBox) -> None:
    first = line().read(150)
    parts = [first[:111], first[111:]]
    port = line(read=lambda self, size: parts.pop(0) if parts else b"")
    found = list(islice(rp.read_telemetry(port, calibration, box, silence=0.3), 2))
    assert isinstance(found[0], rp.StateMessage)
    assert found[1] == rp.StreamError("silence", "no telemetry for 0.3 s, it stopped after 39 of 111 bytes of a frame")


def test_calibrations_that_say_nothing_of_the_box_are_refused(
    line: Line, calibration: rp.Calibration, box: rp.ControlBox, planar2r: rp.Robot
) -> None:
    for other, words in {
        "rad": (replace(calibration, unit="rad"), "readings in rad, expected steps"),
        "joints": (rp.Calibration.assumed(planar2r, 100.0, unit="steps"), "none of the joints of the box"),
    }.values():
        with pytest.raises(rp.InputError, match=words):
            rp.read_telemetry(line(), other, box)
    with pytest.raises(rp.InputError, match="port is of type int"):
        rp.read_telemetry(3, calibration, box)


def test_another_thread_ends_a_stream_without_frames(calibration: rp.Calibration, box: rp.ControlBox) -> None:
    class Silent:
        def read(self, size: int = 1, /) -> bytes:
            time.sleep(0.001)
            return b""

        def write(self, data: bytes, /) -> int | None:
            raise AssertionError("nothing is written")

    stream = rp.read_telemetry(Silent(), calibration, box, silence=1e30)
    closing = threading.Timer(0.05, stream.close)
    closing.start()
    assert list(stream) == []
    closing.join()
