"""Sending commands to a control box: one at a time, each only if the arm is at the start of that command."""

from __future__ import annotations

import errno
import os
import time
from collections.abc import Iterator
from typing import Protocol, runtime_checkable

from rr1plan.checks import check_callback, check_text, counted, of_kind, positive_number
from rr1plan.errors import HardwareError, InputError, MissingPackageError, SerialLineError, StalledJointError
from rr1plan.hardware.box_emulator import EXCHANGE_TICKS
from rr1plan.hardware.command_plan import CommandPlan
from rr1plan.hardware.control_box_frames import (
    CHANNELS,
    TELEMETRY_BYTES,
    BoxCommand,
    Telemetry,
    TelemetryStream,
    wrapped_counts,
)
from rr1plan.progress import ProgressCallback, fraction_callback

BAUD = 115200
# Frames of telemetry within which a command has to begin, and by which it may exceed its emulated time.
_REACTION, _SPARE = 50, 200
# An encoder follows its motor within this share of the displacement plus this number of counts.
_ENCODER_SHARE, _ENCODER_COUNTS = 0.1, 20.0
_LEFT_OVER = (
    "which remains in the box's input buffer and would begin the next command: switch the box off and on before "
    "anything is sent"
)


@runtime_checkable
class SerialPort(Protocol):
    """The interface of a serial port: pyserial's, or any other object with these methods.

    A port that buffers telemetry between reads also needs pyserial's `reset_input_buffer()`, which discards it: the
    position of the arm is read anew before each command.
    """

    def read(self, size: int = 1, /) -> bytes:
        """At most `size` bytes; fewer after the port's own timeout."""
        ...

    def write(self, data: bytes, /) -> int | None:
        """Write bytes; the number of bytes written, or None for all."""
        ...


def open_serial_port(name: str) -> SerialPort:
    """Open a serial port with the box's settings, 115200 baud 8N1, with pyserial, for this program only.

    Two programs on one port would each read a part of the telemetry, and mix their commands.

    Args:
        name: Name of the port, e.g. "/dev/ttyACM0".

    Raises:
        InputError: the name is not text.
        MissingPackageError: pyserial is not installed (extra `serial`).
        SerialLineError: the port cannot be opened, or another program has it open.
    """
    check_text("name", name)
    try:
        import serial
        from serial.tools.list_ports import comports
    except ImportError as error:
        raise MissingPackageError("pyserial", "a serial port", "serial") from error
    try:
        port: SerialPort = serial.Serial(name, BAUD, timeout=0.1, write_timeout=1.0, exclusive=True)
    except (OSError, ValueError) as error:
        # The messages of pyserial repeat the name of the port and the number of the error.
        number = getattr(error, "errno", None)
        why = "another program has it open" if number == errno.EAGAIN else os.strerror(number) if number else error
        there = ", ".join(sorted(found.device for found in comports())) or "none"
        raise SerialLineError(f"cannot open the serial port {name!r}: {why}; ports found: {there}") from error
    return port


def send_commands(
    plan: CommandPlan,
    port: SerialPort,
    *,
    silence: float = 2.0,
    progress: ProgressCallback | None = None,
) -> Telemetry:
    """Send a certified plan to the control box, command by command, and watch the telemetry.

    Each command is sent only while the box is idle, no limit switch is hit and all step counters equal those at the
    start of the command, by telemetry that arrives directly before. After any error nothing more is sent; the arm
    finishes its current command.

    Args:
        plan: The plan.
        port: The serial port.
        silence: The longest time without telemetry [s].
        progress: Called after each command, and may take any time; False stops sending.

    Returns:
        The telemetry at the end.

    Raises:
        InputError: the plan is not certified, or the port has no `read` and `write`; nothing was sent.
        SerialLineError: the line stops, accepts only part of a command, or delivers garbage.
        StalledJointError: a joint does not execute its steps, or its encoder does not follow them.
        HardwareError: the arm is not at the start of the plan, a limit switch is hit, or the box moves by itself.
        CancelledError: `progress` returned False.
    """
    of_kind("plan", plan, CommandPlan)
    if not isinstance(port, SerialPort):
        raise InputError(f"port is of type {type(port).__name__}, expected an object with read and write")
    silence = positive_number("silence", silence)
    check_callback("progress", progress)
    report = fraction_callback("send", progress)
    if not plan.certified:
        raise InputError(f"the plan is not certified, nothing is sent: {'; '.join(plan.problems) or 'not checked'}")
    line = _Line(port, silence)
    expected = plan.start
    start = now = line.latest()
    _check_ready(now, expected, "the plan", "nothing")
    for number, (command, ticks) in enumerate(zip(plan.commands, plan.ticks.tolist(), strict=True), 1):
        name = f"command {number} of {len(plan.commands)}"
        if number > 1:
            # The arm may have moved while `progress` was called.
            _check_ready(line.latest(), expected, name, "nothing more")
        line.send(command, name)
        expected = tuple(a + b for a, b in zip(expected, command.steps, strict=True))
        begin, now = now, _follow(line, expected, ticks / EXCHANGE_TICKS, name)
        _check_encoders(plan, begin, now, f"stalled during {name}")
        # Each command may lose less than its tolerance.
        _check_encoders(plan, start, now, f"has lost steps by the end of {name}, counted from the start of the plan")
        if report is not None:
            report(number / len(plan.commands))
    return now


def read_bytes(port: SerialPort) -> bytes:
    """Some bytes from a serial port, possibly none.

    Raises:
        SerialLineError: the port fails.
    """
    try:
        return bytes(port.read(TELEMETRY_BYTES) or b"")  # None from a port that does not wait
    except Exception as error:  # of any kind of port
        raise SerialLineError(f"the serial line failed while telemetry was read: {error}") from error


class _Line:
    """The serial line: commands out, telemetry in."""

    def __init__(self, port: SerialPort, silence: float) -> None:
        self._port, self._silence = port, silence
        self._stream = TelemetryStream()

    def send(self, command: BoxCommand, name: str) -> None:
        """Write one frame in a single call."""
        frame = command.encode()
        try:
            written = self._port.write(frame)
        except Exception as error:  # of any kind of port
            raise SerialLineError(
                f"the serial line failed while {name} was written: {error}; it may have taken part of it, {_LEFT_OVER}"
            ) from error
        if written is not None and written != len(frame):
            raise SerialLineError(f"the serial line took {written} of the {len(frame)} bytes of {name}, {_LEFT_OVER}")

    def frames(self) -> Iterator[Telemetry]:
        """Telemetry, frame by frame, without end.

        Raises:
            SerialLineError: silence, garbage, or a port that fails.
        """
        last = time.monotonic()
        while True:
            heard = False
            for frame in self._stream.feed(read_bytes(self._port)):
                heard = True
                yield frame
            # Time spent by the receiver of a frame does not count as silence.
            if heard:
                last = time.monotonic()
            elif time.monotonic() - last > self._silence:
                raise SerialLineError(f"{self._stream.silent(self._silence)}: is the box on, and this its port?")

    def latest(self) -> Telemetry:
        """A frame sent after this call: the second one after the discarded input, of which the first may be a part."""
        forget = getattr(self._port, "reset_input_buffer", None)
        if callable(forget):
            try:
                forget()
            except Exception as error:  # of any kind of port
                raise SerialLineError(f"the serial line failed while its input was cleared: {error}") from error
        self._stream = TelemetryStream()
        frames = self.frames()
        next(frames)
        return next(frames)


def _check_ready(now: Telemetry, expected: tuple[int, ...], what: str, sent: str) -> None:
    """Raise an error if the arm is at another position, moving, or at a limit switch."""
    if now.limit_switches:
        raise HardwareError(f"limit switches are hit: {', '.join(now.limit_switches)}; {sent} is sent")
    if now.state != "idle" or any(now.remaining):
        raise HardwareError(f"the control box is {now.state}, not idle; {sent} is sent")
    for name, there, begin in zip(CHANNELS, now.position, expected, strict=True):
        if there != begin:
            raise HardwareError(
                f"{name} is at {counted(there, 'step')}, but {what} begins at {begin}; {sent} is sent: move the arm "
                "there, or plan from where it is"
            )


def _follow(line: _Line, expected: tuple[int, ...], emulated: float, name: str) -> Telemetry:
    """Telemetry until the steps of a command are executed and the box is idle.

    Args:
        line: The line.
        expected: Step counters at the end.
        emulated: Number of frames that the emulation took.
        name: The command, for messages.
    """
    begun = False
    for count, now in enumerate(line.frames()):
        begun = begun or now.state != "idle" or now.position == expected
        if now.limit_switches:
            raise HardwareError(f"limit switches were hit during {name}: {', '.join(now.limit_switches)}")
        if now.state == "idle" and now.position == expected:
            return now
        missing = [
            f"{channel} is at {there} of {goal} steps"
            for channel, there, goal in zip(CHANNELS, now.position, expected, strict=True)
            if there != goal
        ]
        if not begun and count > _REACTION:
            raise StalledJointError(f"the control box did not begin {name}: {'; '.join(missing)}")
        if begun and now.state == "idle":
            raise StalledJointError(f"the control box ended {name} early: {'; '.join(missing)}")
        if count > 1.5 * emulated + _SPARE:
            raise StalledJointError(f"{name} takes longer than {count} frames of telemetry: {'; '.join(missing)}")
    raise AssertionError("telemetry goes on for ever")


def _check_encoders(plan: CommandPlan, begin: Telemetry, now: Telemetry, fault: str) -> None:
    """Compare the displacements of encoders with the steps of their motors; an error says that a joint `fault`."""
    for index, channel in enumerate(CHANNELS):
        scale = plan.box.channels[channel].counts_per_step if channel in plan.box.channels else None
        if scale is None:
            continue
        steps = now.position[index] - begin.position[index]
        counts, wanted = wrapped_counts(now.encoders[index] - begin.encoders[index]), scale * steps
        if abs(counts - wanted) > _ENCODER_SHARE * abs(wanted) + _ENCODER_COUNTS:
            raise StalledJointError(
                f"{channel} ({plan.box.channels[channel].joint}) {fault}: its encoder moved by {counts} counts, "
                f"expected {wanted:.0f} for {counted(steps, 'step')}"
            )
