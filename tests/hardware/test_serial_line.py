"""Commands over a pseudo-terminal, by pyserial: an emulated box at its other end, and what can happen on the way."""

from __future__ import annotations

import os
import select
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from types import TracebackType
from typing import Any

import pytest

import rr1plan as rp
from rr1plan.cli import BAD_INPUT, OK, run

serial, tty = pytest.importorskip("serial"), pytest.importorskip("tty")

Line = Callable[..., Any]
FRAME = 111


# Frames that the box is ahead of the program: a terminal takes hundreds, a real box sends one every 10 ms.
_AHEAD = 4


class Counted(serial.Serial):
    """A serial port that counts what is read from it, so that the box goes on at the program's pace."""

    bytes_read = 0
    box: BoxOnTerminal | None = None

    def read(self, size: int = 1) -> bytes:
        data: bytes = super().read(size)
        Counted.bytes_read += len(data)
        return data

    def reset_input_buffer(self) -> None:
        super().reset_input_buffer()
        if Counted.box is not None:
            Counted.bytes_read = Counted.box.written


@pytest.fixture(autouse=True)
def _counted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(serial, "Serial", Counted)


class BoxOnTerminal:
    """An emulated box on a pseudo-terminal: a thread forwards bytes until it is stopped.

    Args:
        line: The emulated serial line.
        change: Function of a frame of telemetry and its number from 0: the frame to send; None: the box falls silent.

    Attributes:
        name: The terminal's other end, the serial port.
        received: All received bytes.
        written: Number of sent bytes.
    """

    def __init__(self, line: Any, change: Callable[[bytes, int], bytes | None] = lambda frame, _: frame) -> None:
        self.line, self.change, self.received, self.written = line, change, b"", 0
        Counted.bytes_read, Counted.box = 0, self
        self.ours, theirs = os.openpty()
        self.name = os.ttyname(theirs)
        self._theirs = theirs
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._pass_on)

    def __enter__(self) -> BoxOnTerminal:
        os.set_blocking(self.ours, False)
        tty.setraw(self._theirs)
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stop.set()
        self._thread.join()
        os.close(self.ours)
        os.close(self._theirs)

    def _pass_on(self) -> None:
        number, waiting = 0, b""
        while not self._stop.is_set():
            ready, free, _ = select.select([self.ours], [self.ours], [], 0.01)
            if ready:
                data = os.read(self.ours, 4096)
                self.received += data
                self.line.write(data)
            if not waiting:
                frame = self.change(self.line.read(FRAME), number)
                number += 1
                if frame is None:
                    self._wait_for_the_end()
                    return
                waiting = frame
            if free and self.written - Counted.bytes_read < _AHEAD * FRAME:
                count = os.write(self.ours, waiting)
                self.written += count
                waiting = waiting[count:]
            else:
                time.sleep(1e-4)

    def _wait_for_the_end(self) -> None:
        while not self._stop.is_set():
            time.sleep(0.005)


def changed(frame: bytes, **values: Any) -> bytes:
    return replace(rp.Telemetry.decode(frame), **values).encode()


def send(plan: rp.CommandPlan, box: BoxOnTerminal, silence: float = 10.0) -> rp.Telemetry:
    port: Any = rp.open_serial_port(box.name)
    try:
        return rp.send_commands(plan, port, silence=silence)
    finally:
        port.close()


def test_all_commands_are_executed(plan: rp.CommandPlan, line: Line) -> None:
    with BoxOnTerminal(line()) as box:
        end = send(plan, box)
    assert box.received == b"".join(command.encode() for command in plan.commands)
    total = [sum(column) for column in zip(plan.start, *(c.steps for c in plan.commands), strict=True)]
    assert list(end.position) == total
    assert end.state == "idle"


def test_a_line_that_is_joined_in_the_middle_of_a_frame_is_read(plan: rp.CommandPlan, line: Line) -> None:
    with BoxOnTerminal(line(), lambda frame, n: frame[40:] if n == 0 else frame) as box:
        assert send(plan, box).state == "idle"


def test_a_line_that_stops_in_the_middle_of_a_frame_is_named(plan: rp.CommandPlan, line: Line) -> None:
    stopped: list[int] = []

    def change(frame: bytes, n: int) -> bytes | None:
        if rp.Telemetry.decode(frame).state == "active":
            stopped.append(n)
        return None if len(stopped) > 1 else frame[:64] if stopped else frame

    with (
        BoxOnTerminal(line(), change) as box,
        pytest.raises(rp.SerialLineError, match="it stopped after 64 of 111 bytes of a frame"),
    ):
        send(plan, box, 0.4)
    assert len(box.received) == 47


def test_garbage_is_named(plan: rp.CommandPlan, line: Line) -> None:
    def change(frame: bytes, n: int) -> bytes:
        active = rp.Telemetry.decode(frame).state == "active"
        return frame[:50] + b"\x00" + frame[50:] if active else frame

    with BoxOnTerminal(line(), change) as box, pytest.raises(rp.SerialLineError, match="garbage on the serial line"):
        send(plan, box)
    assert len(box.received) == 47
    with (
        BoxOnTerminal(line(), lambda frame, _: b"\xa5" * FRAME) as box,
        pytest.raises(rp.SerialLineError, match="no header in"),
    ):
        send(plan, box)
    assert box.received == b""


def test_a_joint_that_stalls_is_named(plan: rp.CommandPlan, line: Line) -> None:
    """Its steps are executed, and its encoder stays."""
    stopped = line().telemetry().encoders[4]

    def change(frame: bytes, _: int) -> bytes:
        encoders = list(rp.Telemetry.decode(frame).encoders)
        encoders[4] = stopped
        return changed(frame, encoders=tuple(encoders))

    with (
        BoxOnTerminal(line(), change) as box,
        pytest.raises(rp.StalledJointError, match=r"W1 \(wrist_joint\) stalled during command 1 of"),
    ):
        send(plan, box)
    assert len(box.received) == 47


def test_a_port_in_use_is_not_opened_twice() -> None:
    """Two programs on one port would each read a part of the telemetry."""
    ours, theirs = os.openpty()
    tty.setraw(theirs)
    name = os.ttyname(theirs)
    port: Any = rp.open_serial_port(name)
    with pytest.raises(rp.SerialLineError, match=f"serial port '{name}': another program has it open; ports"):
        rp.open_serial_port(name)
    port.close()
    again: Any = rp.open_serial_port(name)
    again.close()
    os.close(ours)
    os.close(theirs)


def test_a_box_that_is_unplugged_is_named(plan: rp.CommandPlan, line: Line) -> None:
    box = BoxOnTerminal(line())
    port = rp.open_serial_port(box.name)
    os.close(box.ours)
    os.close(box._theirs)
    with pytest.raises(rp.SerialLineError, match="the serial line failed while"):
        rp.send_commands(plan, port, silence=0.4)


# ---- limit switches ------------------------------------------------------------------------------


@pytest.fixture
def at_switch(plan: rp.CommandPlan, box: rp.ControlBox) -> Callable[[float], rp.EmulatedSerialLine]:
    """Makes a line to a box at the start of the plan, with a switch at a share of the first command of W1."""
    start = dict(zip(("S1", "S2", "E1", "E2", "W1", "W2", "G"), plan.start, strict=True))
    steps = plan.commands[0].steps[4]
    assert abs(steps) > 20

    def make(share: float) -> rp.EmulatedSerialLine:
        there = start["W1"] + round(share * steps)
        pressed = (there, there + 10_000) if steps > 0 else (there - 10_000, there)
        return rp.EmulatedSerialLine(box, start, switches={"W1 B": pressed, "S1 A": (-10_000_000, -9_000_000)})

    return make


def test_a_limit_switch_on_the_way_ends_the_sending(
    plan: rp.CommandPlan, at_switch: Callable[[float], rp.EmulatedSerialLine]
) -> None:
    with (
        BoxOnTerminal(at_switch(0.5)) as box,
        pytest.raises(rp.HardwareError, match=r"limit switches were hit during command 1 of .*: W1 B"),
    ):
        send(plan, box)
    assert len(box.received) == 47


def test_an_arm_at_a_limit_switch_gets_nothing(
    plan: rp.CommandPlan, at_switch: Callable[[float], rp.EmulatedSerialLine]
) -> None:
    with (
        BoxOnTerminal(at_switch(0.0)) as box,
        pytest.raises(rp.HardwareError, match="limit switches are hit: W1 B; nothing is sent"),
    ):
        send(plan, box)
    assert box.received == b""


def test_a_command_for_a_channel_that_is_not_in_use_does_not_hold_up_the_next_one(box: rp.ControlBox) -> None:
    line = rp.EmulatedSerialLine(rp.ControlBox({"S1": box.channels["S1"]}, box.tick))
    line.write(rp.BoxCommand((0, 0, 0, 0, 0, 0, 100)).encode())
    with pytest.raises(rp.InputError, match="steps for G, which is not in use"):
        line.read(FRAME)
    line.write(rp.BoxCommand((100, 0, 0, 0, 0, 0, 0)).encode())
    frames = [rp.Telemetry.decode(line.read(FRAME)) for _ in range(300)]
    assert frames[-1].position[0] == 100


def test_a_switch_that_is_passed_between_two_frames_is_reported_once(box: rp.ControlBox) -> None:
    line = rp.EmulatedSerialLine(box, switches={"G A": (40, 40)})
    line.write(rp.BoxCommand((0, 0, 0, 0, 0, 0, 300)).encode())
    frames = [rp.Telemetry.decode(line.read(FRAME)) for _ in range(150)]
    hits = [k for k, frame in enumerate(frames) if frame.limit_switches]
    assert hits
    assert all(frames[k].limit_switches == ("G A",) for k in hits)
    assert frames[hits[0] - 1].position[6] < 40 <= frames[hits[0]].position[6]
    assert frames[hits[-1] + 1].position[6] > 40
    assert len(hits) <= 2


@pytest.mark.parametrize(
    ("switches", "words"),
    [
        ({"S9 A": (0, 1)}, "unknown limit switch 'S9 A'"),
        ({"S1 A": (1, 0)}, "expected two step counters, the smaller one first"),
        ({"S1 A": (1,)}, "expected two step counters"),
        ({"S1 A": (0.5, 1)}, "switch S1 A"),
        ({"S1 A": 3}, "two step counters"),
    ],
)
def test_wrong_switches_are_refused(box: rp.ControlBox, switches: Any, words: str) -> None:
    with pytest.raises(rp.InputError, match=words):
        rp.EmulatedSerialLine(box, switches=switches)


# ---- the command -----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def files(
    motion: rp.MotionPlan, calibration: rp.Calibration, box: rp.ControlBox, tmp_path_factory: pytest.TempPathFactory
) -> list[str]:
    """A motion and the calibration of its arm, as words of a command."""
    folder = tmp_path_factory.mktemp("terminal")
    arm = calibration.save(folder / "arm.toml")
    rows = [
        f'{n} = {{ joint = "{c.joint}", fast_period = {c.fast_period}, ramp_steps = {c.ramp_steps}, '
        f"counts_per_step = {c.counts_per_step} }}"
        for n, c in box.channels.items()
    ]
    arm.write_text("\n".join([arm.read_text(), "[control_box]", f"tick = {box.tick}", "[control_box.channels]", *rows]))
    return [str(motion.save(folder / "motion.json", embed=True)), "--calibration", str(arm)]


def test_the_command_sends_over_a_serial_port(
    files: list[str], plan: rp.CommandPlan, line: Line, capsys: pytest.CaptureFixture[str]
) -> None:
    with BoxOnTerminal(line()) as box:
        assert run(["send", *files, "--port", box.name]) == OK
    assert box.received == b"".join(command.encode() for command in plan.commands)
    assert "sent: the control box has executed all commands" in capsys.readouterr().out


def test_the_command_names_what_went_wrong(
    files: list[str],
    at_switch: Callable[[float], rp.EmulatedSerialLine],
    line: Line,
    capsys: pytest.CaptureFixture[str],
) -> None:
    with BoxOnTerminal(at_switch(0.5)) as box:
        assert run(["send", *files, "--port", box.name]) == BAD_INPUT
    assert "limit switches were hit during command 1" in capsys.readouterr().err
    with BoxOnTerminal(line(), lambda frame, n: b"?" * FRAME) as box:
        assert run(["send", *files, "--port", box.name]) == BAD_INPUT
    assert "no header in" in capsys.readouterr().err


def test_telemetry_of_a_serial_port_is_mirrored(
    motion: rp.MotionPlan, calibration: rp.Calibration, box: rp.ControlBox, line: Line
) -> None:
    assert motion.trajectory is not None
    rest = rp.Trajectory.rest(motion.trajectory.joint_names, motion.trajectory(0.0), duration=5.0)
    sent: list[int] = []

    def change(frame: bytes, n: int) -> bytes | None:
        sent.append(n)
        return b"??" if n == 20 else frame if n < 40 else None

    terminal = BoxOnTerminal(line(), change)
    port: Any = rp.open_serial_port(terminal.name)  # before the first frame: opening drops what is there
    with terminal:
        with rp.Mirror(motion.scene, rest) as mirror:
            for item in rp.read_telemetry(port, calibration, box, silence=0.2):
                mirror.receive(item)
                # On a busy machine there may be silence before, too.
                if isinstance(item, rp.StreamError) and item.fault == "silence" and len(sent) > 40:
                    break
            report = mirror.report()
        port.close()
    assert report.messages >= 30
    assert report.faults["format"] == 1
    assert set(report.faults) == {"format", "silence"}
    assert not report.outside


def test_a_port_that_cannot_be_opened_is_named_beside_those_that_are_there() -> None:
    message = r"cannot open the serial port '/dev/none': No such file or directory; ports found: [/\w]"
    with pytest.raises(rp.SerialLineError, match=message):
        rp.open_serial_port("/dev/none")
    with pytest.raises(rp.InputError, match="name is None, expected text"):
        rp.open_serial_port(None)
