"""Sending commands: only checked ones, to an arm at the start of its plan; every fault is named."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

import rr1plan as rp
from rr1plan.hardware.command_sender import SerialPort

Line = Callable[..., Any]


def test_all_commands_are_executed(plan: rp.CommandPlan, line: Line) -> None:
    made, shares = line(), []
    end = rp.send_commands(plan, made, progress=lambda progress: shares.append(progress.fraction))
    total = [sum(column) for column in zip(plan.start, *(c.steps for c in plan.commands), strict=True)]
    assert list(end.position) == total
    assert end.state == "idle"
    assert shares == pytest.approx([(k + 1) / len(plan.commands) for k in range(len(plan.commands))])


class Recording:
    """A port that counts what is written to it.

    Args:
        line: The line behind it.
        change: Function of the read bytes and the number of the read: the bytes to return.
    """

    def __init__(self, line: Any, change: Callable[[bytes, int], bytes] = lambda data, _: data) -> None:
        self.line, self.change, self.written, self.reads = line, change, b"", 0

    def read(self, size: int = 1) -> bytes:
        self.reads += 1
        return self.change(self.line.read(size), self.reads)

    def write(self, data: bytes) -> int:
        self.written += data
        return self.line.write(data)


def test_what_is_not_certified_is_not_sent(plan: rp.CommandPlan, line: Line) -> None:
    port = Recording(line())
    refused = replace(plan, path_report=replace(plan.path_report, checked=("position",)))
    with pytest.raises(rp.InputError, match="the plan is not certified, nothing is sent"):
        rp.send_commands(refused, port)
    assert port.written == b""
    assert port.reads == 0


def test_an_arm_that_is_elsewhere_gets_nothing(plan: rp.CommandPlan, line: Line) -> None:
    made = line()
    made.emulator.joints["W1"].position += 3
    port = Recording(made)
    with pytest.raises(rp.HardwareError, match=r"W1 is at \d+ steps, but the plan begins at \d+; nothing is sent"):
        rp.send_commands(plan, port)
    assert port.written == b""


def test_a_box_that_moves_gets_nothing(plan: rp.CommandPlan, line: Line) -> None:
    made = line()
    made.emulator.command(rp.BoxCommand((0, 0, 0, 0, 0, 0, 50)))
    port = Recording(made)
    with pytest.raises(rp.HardwareError, match="the control box is active, not idle"):
        rp.send_commands(plan, port)
    assert port.written == b""


def changed(telemetry: bytes, **values: Any) -> bytes:
    return replace(rp.Telemetry.decode(telemetry), **values).encode()


def test_a_limit_switch_ends_the_sending(plan: rp.CommandPlan, line: Line) -> None:
    port = Recording(line(), lambda data, n: changed(data, limit_switches=("S2 B",)))
    with pytest.raises(rp.HardwareError, match="limit switches are hit: S2 B; nothing is sent"):
        rp.send_commands(plan, port)
    assert port.written == b""
    port = Recording(line(), lambda data, n: changed(data, limit_switches=("S2 B",)) if n > 20 else data)
    with pytest.raises(rp.HardwareError, match="limit switches were hit during command 1 of"):
        rp.send_commands(plan, port)
    assert len(port.written) == 47


def test_silence_and_a_frame_that_stops_in_the_middle_are_named(plan: rp.CommandPlan, line: Line) -> None:
    port = Recording(line(), lambda data, n: b"")
    with pytest.raises(rp.SerialLineError, match=r"no telemetry for 0.05 s: is the box on, and this its port\?"):
        rp.send_commands(plan, port, silence=0.05)
    assert port.written == b""
    port = Recording(line(), lambda data, n: data if n < 30 else data[:64] if n == 30 else b"")
    with pytest.raises(rp.SerialLineError, match="it stopped after 64 of 111 bytes of a frame"):
        rp.send_commands(plan, port, silence=0.05)
    assert len(port.written) == 47


def test_garbage_ends_the_sending(plan: rp.CommandPlan, line: Line) -> None:
    port = Recording(line(), lambda data, n: data[:50] + b"\x00" + data[50:] if n == 10 else data)
    with pytest.raises(rp.SerialLineError, match="garbage on the serial line"):
        rp.send_commands(plan, port)
    assert len(port.written) == 47
    port = Recording(line(), lambda data, n: b"\xa5" * len(data))
    with pytest.raises(rp.SerialLineError, match="no header in"):
        rp.send_commands(plan, port)
    assert port.written == b""


def test_a_line_that_takes_part_of_a_command_must_not_be_used_again(plan: rp.CommandPlan, line: Line) -> None:
    made = line()
    whole = made.write
    made.write = lambda data: whole(data[:23])
    with pytest.raises(
        rp.SerialLineError, match=r"took 23 of the 47 bytes of command 1 of .*: switch the box off and on"
    ):
        rp.send_commands(plan, made)


@pytest.mark.parametrize("verb", ["read", "write"])
def test_a_port_that_fails_is_named(plan: rp.CommandPlan, line: Line, verb: str) -> None:
    def fail(self: Any, _: Any) -> Any:
        raise OSError("device disconnected")

    words = {"read": "read: device disconnected", "write": "written: device disconnected; it may have taken part of it"}
    with pytest.raises(rp.SerialLineError, match=f"while .* {words[verb]}"):
        rp.send_commands(plan, line(**{verb: fail}))


def test_a_joint_that_stalls_is_named(plan: rp.CommandPlan, line: Line) -> None:
    """Its steps are executed, and its encoder stops."""
    stopped = rp.Telemetry.decode(line().telemetry().encode()).encoders[4]

    def change(data: bytes, _: int) -> bytes:
        encoders = list(rp.Telemetry.decode(data).encoders)
        encoders[4] = stopped + 5
        return changed(data, encoders=tuple(encoders))

    port = Recording(line(), change)
    with pytest.raises(
        rp.StalledJointError, match=r"W1 \(wrist_joint\) stalled during command 1 of .*moved by 0 counts"
    ):
        rp.send_commands(plan, port)
    assert len(port.written) == 47


def test_counters_of_encoders_may_overflow(plan: rp.CommandPlan, line: Line) -> None:
    made = line()
    offset = 2**31 - 1 - made.telemetry().encoders[4]

    def change(data: bytes, _: int) -> bytes:
        encoders = list(rp.Telemetry.decode(data).encoders)
        encoders[4] = (encoders[4] + offset + 2**31) % 2**32 - 2**31
        return changed(data, encoders=tuple(encoders))

    ended = rp.send_commands(plan, Recording(made, change))
    assert ended.state == "idle"
    box = rp.ControlBox({"S1": rp.BoxChannel("base_joint", 10.0, 100, 1e4)}, 1e-4)
    far = rp.EmulatedSerialLine(box, {"S1": 214_749}).telemetry()
    assert rp.Telemetry.decode(far.encode()).encoders[0] == 2_147_490_000 - 2**32


def test_a_joint_whose_steps_stop_is_named(plan: rp.CommandPlan, line: Line) -> None:
    made = line()
    made.emulator.joints["E1"].advance = lambda ticks: ([], None)
    port = Recording(made)
    with pytest.raises(rp.StalledJointError, match=r"command 1 of .* takes longer than \d+ frames .*E1 is at -?\d+ of"):
        rp.send_commands(plan, port)
    assert len(port.written) == 47


def test_a_command_that_does_not_begin_or_ends_early_is_named(plan: rp.CommandPlan, line: Line) -> None:
    deaf = line()
    deaf.write = len
    with pytest.raises(rp.StalledJointError, match="the control box did not begin command 1"):
        rp.send_commands(plan, deaf)
    hasty = Recording(line(), lambda data, n: changed(data, state="idle") if n > 20 else data)
    with pytest.raises(rp.StalledJointError, match=r"the control box ended command 1 of .* early"):
        rp.send_commands(plan, hasty)


def test_a_callback_ends_the_sending_after_a_command(plan: rp.CommandPlan, line: Line) -> None:
    port = Recording(line())
    with pytest.raises(rp.CancelledError):
        rp.send_commands(plan, port, progress=lambda progress: False)
    assert len(port.written) == 47


def test_an_arm_that_moves_while_a_callback_waits_gets_nothing_more(plan: rp.CommandPlan, line: Line) -> None:
    """The telemetry of that time is in the buffers of the system, or lost."""
    made = line()

    def move(_: rp.Progress) -> None:
        made.emulator.joints["W1"].position += 3

    port = Recording(made)
    with pytest.raises(rp.HardwareError, match=r"W1 is at -?\d+ steps, but command 2 of \d+ begins at .* more is sent"):
        rp.send_commands(plan, port, progress=move)
    assert port.written == plan.commands[0].encode()


def test_encoders_are_compared_across_the_time_of_a_callback(plan: rp.CommandPlan, line: Line) -> None:
    """An arm that is pushed does not count steps."""
    made, telemetry, pushed = line(), rp.EmulatedSerialLine.telemetry, [0]
    made.telemetry = lambda: replace(now := telemetry(made), encoders=tuple(e + pushed[0] for e in now.encoders))
    with pytest.raises(rp.StalledJointError, match="during command 2 of"):
        rp.send_commands(plan, made, progress=lambda _: pushed.__setitem__(0, 10_000))


def test_steps_that_are_lost_little_by_little_are_named(plan: rp.CommandPlan, line: Line) -> None:
    """In each command fewer than the tolerance."""
    made, telemetry, ended = line(), rp.EmulatedSerialLine.telemetry, itertools.count()
    lost = [0]
    made.telemetry = lambda: replace(now := telemetry(made), encoders=tuple(e + lost[0] for e in now.encoders))
    with pytest.raises(rp.StalledJointError, match="has lost steps by the end of command 3 of 4, counted from"):
        rp.send_commands(plan, made, progress=lambda _: lost.__setitem__(0, 19 * (1 + next(ended))))


def test_a_port_that_does_not_wait_is_read(plan: rp.CommandPlan, line: Line) -> None:
    """It returns None if there is nothing to read."""
    made, waits = line(), itertools.cycle([True, False])
    read = made.read
    made.read = lambda size: read(size) if next(waits) else None
    assert rp.send_commands(plan, made).state == "idle"


def test_a_garbled_frame_moves_the_emulated_arm_as_it_would_the_real_one(line: Line) -> None:
    """23 bytes stay in the buffer; the next command is read behind them, as other steps."""
    made = line()
    made.write(rp.BoxCommand((100, 0, 0, 0, 0, 0, 0)).encode()[:23])
    made.read(111)
    before = made.emulator.position
    made.write(rp.BoxCommand((0, 0, 0, 0, 0, 0, 0)).encode())
    made.read(30000)
    moved = [b - a for a, b in zip(before, made.emulator.position, strict=True)]
    assert moved[0] == 100
    assert not any(moved[1:])


def test_what_is_no_port_is_refused(plan: rp.CommandPlan) -> None:
    with pytest.raises(rp.InputError, match="port is of type int, expected an object with read and write"):
        rp.send_commands(plan, 3)
    assert issubclass(rp.EmulatedSerialLine, SerialPort)


def test_pyserial_is_asked_for_by_name(monkeypatch: pytest.MonkeyPatch) -> None:
    import sys

    monkeypatch.setitem(sys.modules, "serial", None)
    with pytest.raises(rp.MissingPackageError, match=r"rr1plan\[serial\]"):
        rp.open_serial_port("/dev/ttyACM0")
