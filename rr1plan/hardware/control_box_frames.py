"""Frames of the serial protocol of RR1's control box, revision 2, all little-endian.

A command has 47 bytes: the header "RR1-rev.2-robot", the safety level and seven relative numbers of steps. Telemetry
has 111 bytes: header, serial number, state, limit switches, seven encoder counts, seven numbers of remaining steps and
seven counters of executed steps.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Literal

from rr1plan.checks import counted, items_of, known_name, whole_number
from rr1plan.errors import InputError, SerialLineError

CHANNELS = ("S1", "S2", "E1", "E2", "W1", "W2", "G")
# Limit switches, in the order of their bits.
SWITCHES = tuple(f"{channel} {side}" for channel in CHANNELS for side in "AB")
HEADER = b"RR1-rev.2-robot"
COMMAND_BYTES, TELEMETRY_BYTES = 47, 111
# At safety level "high" the box ignores a joint with more steps than this.
MOST_STEPS_SAFELY = 1024
Safety = Literal["high", "low"]
_SAFETY = {"high": 1, "low": 2}
_STATES = {1: "idle", 2: "active", 3: "starting batch"}
_COMMAND, _TELEMETRY = struct.Struct("<15si7i"), struct.Struct("<15s4sII7i7i7i")
_MOST = 2**31 - 1


@dataclass(frozen=True)
class BoxCommand:
    """One motion of all joints from rest to rest.

    Args:
        steps: Relative steps of S1, S2, E1, E2, W1, W2 and G.
        safety: "high": the box ignores joints with more than 1024 steps; "low": it does not.

    Raises:
        InputError: not seven whole numbers of 32 bits, or another safety level.
    """

    steps: tuple[int, ...]
    safety: Safety = "high"

    def __post_init__(self) -> None:
        values = items_of("steps", self.steps, "numbers")
        if len(values) != len(CHANNELS):
            raise InputError(
                f"steps has {counted(len(values), 'number')}, expected 7: one for each of {', '.join(CHANNELS)}"
            )
        steps = tuple(whole_number(f"steps of {n}", v, -_MOST, _MOST) for n, v in zip(CHANNELS, values, strict=True))
        object.__setattr__(self, "steps", steps)
        known_name("safety level", self.safety, _SAFETY)

    def encode(self) -> bytes:
        """The frame, 47 bytes."""
        return _COMMAND.pack(HEADER, _SAFETY[self.safety], *self.steps)

    @staticmethod
    def decode(frame: bytes) -> BoxCommand:
        """A command from its frame.

        Raises:
            InputError: not 47 bytes with the header and a safety level.
        """
        _check_frame("a command", frame, COMMAND_BYTES)
        _, safety, *steps = _COMMAND.unpack(frame)
        levels = {number: name for name, number in _SAFETY.items()}
        if safety not in levels:
            raise InputError(f"a command has the safety level {safety}, expected 1 (high) or 2 (low)")
        return BoxCommand(tuple(steps), "high" if safety == _SAFETY["high"] else "low")


@dataclass(frozen=True)
class Telemetry:
    """What the control box reports about a hundred times a second.

    Args:
        serial_number: Serial number of the arm, 4 characters.
        state: "idle", "active" or "starting batch".
        limit_switches: Limit switches hit since the last frame, e.g. ("S1 A", "G B").
        encoders: Encoder counts of the seven joints, of 32 bits.
        remaining: Remaining steps of the current motion, with the sign of the command.
        position: Step counters since the box was switched on, in the direction of commands. (The box counts in the
            opposite direction.)
    """

    serial_number: str
    state: str
    limit_switches: tuple[str, ...]
    encoders: tuple[int, ...]
    remaining: tuple[int, ...]
    position: tuple[int, ...]

    def encode(self) -> bytes:
        """The frame, 111 bytes."""
        state = {name: number for number, name in _STATES.items()}[self.state]
        mask = sum(1 << bit for bit, name in enumerate(SWITCHES) if name in self.limit_switches)
        executed = (-count for count in self.position)
        serial = self.serial_number.encode("ascii")
        return _TELEMETRY.pack(HEADER, serial, state, mask, *self.encoders, *self.remaining, *executed)

    @staticmethod
    def decode(frame: bytes) -> Telemetry:
        """Telemetry from its frame.

        Raises:
            InputError: not 111 bytes with the header, or impossible values.
        """
        _check_frame("telemetry", frame, TELEMETRY_BYTES)
        _, serial, state, mask, *counts = _TELEMETRY.unpack(frame)
        if state not in _STATES or mask >> len(SWITCHES) or not serial.isascii() or -_MOST - 1 in counts[7:]:
            raise InputError(
                f"telemetry makes no sense: state {state}, limit switches {mask:#x}, serial number {serial!r}"
            )
        switches = tuple(name for bit, name in enumerate(SWITCHES) if mask >> bit & 1)
        executed = tuple(-count for count in counts[14:])
        return Telemetry(serial.decode(), _STATES[state], switches, tuple(counts[:7]), tuple(counts[7:14]), executed)


def wrapped_counts(counts: int) -> int:
    """Counts, or a difference of counts, of an encoder whose counter has 32 bits: -2^31 .. 2^31 - 1."""
    return (counts + 2**31) % 2**32 - 2**31


def _check_frame(what: str, frame: bytes, size: int) -> None:
    if not isinstance(frame, bytes | bytearray) or len(frame) != size:
        got = f"{len(frame)} bytes" if isinstance(frame, bytes | bytearray) else f"a {type(frame).__name__}"
        raise InputError(f"{what} is {got}, expected {size} bytes")
    if bytes(frame[: len(HEADER)]) != HEADER:
        raise InputError(f"{what} begins with {bytes(frame[: len(HEADER)])!r}, expected {HEADER!r}")


@dataclass(eq=False)
class TelemetryStream:
    """Frames of telemetry from the bytes of a serial line.

    Reading may begin in the middle of a frame; after the first header each frame has to follow the previous one.
    """

    _buffer: bytearray = field(default_factory=bytearray)
    _joined: bool = False

    def feed(self, data: bytes) -> Iterator[Telemetry]:
        """The frames completed by further bytes.

        Raises:
            SerialLineError: bytes that are not telemetry.
        """
        self._buffer += data
        if not self._joined:
            start = self._buffer.find(HEADER)
            if start < 0 and len(self._buffer) > TELEMETRY_BYTES + len(HEADER):
                raise SerialLineError(f"no header in {len(self._buffer)} bytes from the serial line: {self._shown()}")
            if start < 0:
                return
            del self._buffer[:start]
            self._joined = True
        while len(self._buffer) >= TELEMETRY_BYTES:
            frame = bytes(self._buffer[:TELEMETRY_BYTES])
            try:
                telemetry = Telemetry.decode(frame)
            except InputError as error:
                raise SerialLineError(f"garbage on the serial line: {error}") from error
            del self._buffer[:TELEMETRY_BYTES]
            yield telemetry

    def silent(self, seconds: float) -> str:
        """In words, that there was no telemetry for some seconds, and where in a frame it stopped."""
        cut = len(self._buffer)
        where = f", it stopped after {cut} of {TELEMETRY_BYTES} bytes of a frame" if cut else ""
        return f"no telemetry for {seconds:g} s{where}"

    def _shown(self) -> str:
        return bytes(self._buffer[:16]).hex(" ")
