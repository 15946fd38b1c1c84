"""Telemetry of a control box as a stream of joint states, for a `Mirror`."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator

from rr1plan.calibration.joint_calibration import Calibration
from rr1plan.checks import of_kind, positive_number
from rr1plan.errors import InputError, SerialLineError
from rr1plan.hardware.command_sender import SerialPort, read_bytes
from rr1plan.hardware.control_box import ControlBox
from rr1plan.hardware.control_box_frames import CHANNELS, Telemetry, TelemetryStream
from rr1plan.mirror.joint_states import StateMessage, StateStream, StreamError

# Messages of frames that arrive together get times at this interval [s].
_SPACING = 1e-6


def read_telemetry(port: SerialPort, calibration: Calibration, box: ControlBox, *, silence: float = 1.0) -> StateStream:
    """The joint states reported by a control box, from step counters or encoders.

    Frames have no time stamp; a message gets the time of its arrival. Nothing is written to the port.

    Args:
        port: The serial port, from `open_serial_port`, or an `EmulatedSerialLine`.
        calibration: Calibration of its joints; in "steps" it applies to the step counters, in "counts" to the encoders.
        box: The control box, which assigns channels to joints.
        silence: Interval without frames [s] after which a `StreamError` is reported, repeatedly.

    Returns:
        Messages of the calibrated joints, and errors in place of garbage and silence, until the stream is closed; the
        port stays open. If the port itself fails, as when its cable is pulled out, the stream raises a
        `SerialLineError`.

    Raises:
        InputError: a value other than a port, a calibration in radians, or one without any joint of the box.
    """
    of_kind("port", port, SerialPort)
    of_kind("calibration", calibration, Calibration)
    of_kind("box", box, ControlBox)
    positive_number("silence", silence)
    if calibration.unit == "rad":
        raise InputError("the calibration has readings in rad, expected steps of motors or counts of encoders")
    columns = [CHANNELS.index(name) for name, channel in box.channels.items() if channel.joint in calibration.joints]
    if not columns:
        raise InputError(f"the calibration has none of the joints of the box: {', '.join(calibration.joints)}")
    names = tuple(box.channels[CHANNELS[column]].joint for column in columns)

    def message(frame: Telemetry, now: float) -> StateMessage:
        counts = frame.position if calibration.unit == "steps" else frame.encoders
        positions = calibration.positions([counts[column] for column in columns], names)
        return StateMessage(now, names, positions, now)

    closed = threading.Event()
    return StateStream(_TelemetryStates(port, message, silence, closed), closed.set)


class _TelemetryStates(Iterator[StateMessage | StreamError]):
    """Messages of the arriving frames until the stream is closed. Ctrl-C does not end them, as it would a generator."""

    def __init__(
        self,
        port: SerialPort,
        message: Callable[[Telemetry, float], StateMessage],
        silence: float,
        closed: threading.Event,
    ) -> None:
        self._port, self._message, self._silence, self._closed = port, message, silence, closed
        self._stream = TelemetryStream()
        self._frames: Iterator[Telemetry] = iter(())
        self._time = 0.0  # of the latest message
        self._silent_since = self._returned = time.monotonic()

    def __next__(self) -> StateMessage | StreamError:
        # Time spent by the receiver of an item does not count as silence.
        self._silent_since += time.monotonic() - self._returned
        try:
            while not self._closed.is_set():
                item = self._next_item()
                if item is not None:
                    return item
                self._frames = self._stream.feed(read_bytes(self._port))
            raise StopIteration
        finally:
            self._returned = time.monotonic()

    def _next_item(self) -> StateMessage | StreamError | None:
        """The next item of the bytes so far; None if there is none."""
        now = time.monotonic()
        try:
            frame = next(self._frames, None)
        except SerialLineError as error:
            # Resynchronize at the next header.
            self._stream, self._frames = TelemetryStream(), iter(())
            return StreamError("format", str(error))
        if frame is not None:
            self._silent_since, self._time = now, max(now, self._time + _SPACING)
            return self._message(frame, self._time)
        if now - self._silent_since <= self._silence:
            return None
        self._silent_since = now
        return StreamError("silence", self._stream.silent(self._silence))
