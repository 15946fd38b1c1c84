"""An emulator of the control box: the firmware's tick rule, and its end of the serial line, byte by byte.

Pressed limit switches are reported. The firmware then backs off by 32 steps, at a speed that is not published; this is
not emulated, and neither is the emergency stop.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from rr1plan.checks import items_of, known_name, of_kind, shown, whole_number
from rr1plan.errors import HardwareError, InputError
from rr1plan.hardware.control_box import ControlBox
from rr1plan.hardware.control_box_frames import (
    CHANNELS,
    COMMAND_BYTES,
    HEADER,
    MOST_STEPS_SAFELY,
    SWITCHES,
    BoxCommand,
    Telemetry,
    wrapped_counts,
)
from rr1plan.hardware.motion_law import JointMotion

# Passes of the loop without a moving joint before the box is idle, and between two exchanges on the serial line.
_PROMOTION, EXCHANGE_TICKS = 4, 16
# Ticks that are advanced at once if nothing is read.
_BLOCK = 4096
_MOST_TICKS = 100_000_000
# Bytes of telemetry in one read, at most.
_MOST_BYTES = 10_000_000


class BoxEmulator:
    """The control box without an arm: the motions of its motors, tick by tick.

    Args:
        box: The control box.

    Attributes:
        box: The control box.
        ticks: Ticks since it was switched on.
        idle: Whether it is idle.
        joints: The motors by channel.
    """

    def __init__(self, box: ControlBox) -> None:
        of_kind("box", box, ControlBox)
        self.box = box
        self.ticks = 0
        self.idle = True
        self.joints = {name: JointMotion(c.fast_period, c.ramp_steps) for name, c in box.channels.items()}
        self._passes = self._idle_since = 0

    @property
    def position(self) -> tuple[int, ...]:
        """Step counters of the seven channels in the direction of commands."""
        return tuple(self.joints[name].position if name in self.joints else 0 for name in CHANNELS)

    def command(self, command: BoxCommand) -> None:
        """Accept a command, between two ticks.

        Raises:
            InputError: steps for a channel that is not in use.
        """
        of_kind("command", command, BoxCommand)
        steps = {name: count for name, count in zip(CHANNELS, command.steps, strict=True) if count}
        for name in steps:
            if name not in self.joints:
                raise InputError(f"the command has steps for {name}, which is not in use")
        self.forget_stretching()
        common = 0
        for name, count in steps.items():
            joint = self.joints[name]
            if command.safety == "high" and abs(count) > MOST_STEPS_SAFELY:
                continue
            if joint.moving:
                joint.change(count)
                continue
            joint.begin(count)
            common = max(common, joint.profile.total_time)
            self.idle = False
        for name in steps if common else ():
            self.joints[name].stretch(common)

    def forget_stretching(self) -> None:
        """Reset all stretching, as the firmware does with every frame: moving motors change their speed."""
        for joint in self.joints.values():
            joint.profile.factor = 1.0

    def advance(self, ticks: int) -> dict[str, list[int]]:
        """Advance by some ticks.

        Args:
            ticks: Number of ticks.

        Returns:
            By channel, the ticks at which it stepped, counted from now, starting at 1; channels without steps are
            omitted.
        """
        ticks = whole_number("ticks", ticks, 1, _MOST_TICKS)
        stepped, holds = {}, []
        for name, joint in self.joints.items():
            found, held = joint.advance(ticks)
            if found:
                stepped[name] = found
            if held is not None:
                holds.append(held)
        # From the pass after the last joint has stopped, the box counts passes until it is idle.
        if not self.idle and not any(joint.moving for joint in self.joints.values()):
            passes = ticks - max(holds, default=0)
            if self._passes + passes >= _PROMOTION:
                self._idle_since = self.ticks + ticks - passes + _PROMOTION - self._passes
                self._passes, self.idle = 0, True
            else:
                self._passes += passes
        self.ticks += ticks
        return stepped

    def run(self, command: BoxCommand) -> dict[str, list[int]]:
        """Accept a command and execute it completely.

        Returns:
            By channel, the ticks of its steps after the command, starting at 1; the same for the same command.

        Raises:
            HardwareError: a joint never finishes, which happens with a single step in this firmware.
            InputError: steps for a channel that is not in use.
        """
        self.command(command)
        begin = self.ticks
        stepped: dict[str, list[int]] = {name: [] for name in self.joints}
        longest = 4 * max((joint.profile.total_time for joint in self.joints.values()), default=0) + 4 * _BLOCK
        while not self.idle:
            if self.ticks - begin > longest:
                stuck = [name for name, joint in self.joints.items() if joint.moving]
                raise HardwareError(
                    f"the firmware never finishes the command {command.steps}: {', '.join(stuck)} hangs"
                )
            since = self.ticks - begin
            for name, found in self.advance(_BLOCK).items():
                stepped[name] += [since + tick for tick in found]
        self.ticks = self._idle_since  # nothing happens after that
        return {name: found for name, found in stepped.items() if found}


class EmulatedSerialLine:
    """The computer's end of a serial line to an emulated control box, with `read` and `write` of a serial port.

    Time passes for the box while telemetry is read from it: sixteen ticks a frame.

    Args:
        box: The control box.
        position: Step counters at the beginning, by channel.
        switches: Limit switches by name, such as "S1 A", each with the first and the last step counter at which it is
            pressed; others never are.

    Attributes:
        emulator: The box.

    Raises:
        InputError: a position that is not a whole number, or a switch without two of them in order.
        UnknownNameError: a channel that is not in use, or a switch of such a channel.
    """

    def __init__(
        self,
        box: ControlBox,
        position: Mapping[str, int] | None = None,
        *,
        switches: Mapping[str, tuple[int, int]] | None = None,
    ) -> None:
        self.emulator = BoxEmulator(box)
        of_kind("switches", switches, Mapping, optional=True)
        self._switches: dict[str, tuple[int, int]] = {}
        for name, ends in (switches or {}).items():
            known_name("limit switch", name, [s for s in SWITCHES if s.split()[0] in self.emulator.joints])
            counters = items_of(f"switch {name}", ends, "two step counters")
            if len(counters) != 2 or counters[0] > counters[1]:
                raise InputError(f"switch {name} is {shown(ends)}, expected two step counters, the smaller one first")
            first, last = (whole_number(f"switch {name}", count, -_MOST_TICKS, _MOST_TICKS) for count in counters)
            self._switches[name] = first, last
        self._hit: set[str] = set()
        of_kind("position", position, Mapping, optional=True)
        for name, count in (position or {}).items():
            joint = self.emulator.joints[known_name("channel", name, self.emulator.joints)]
            joint.position = whole_number(f"position of {name}", count, -_MOST_TICKS, _MOST_TICKS)
        self._input, self._output = bytearray(), bytearray()

    def write(self, data: bytes) -> int:
        """Send bytes to the box, which receives them at its next exchange.

        Raises:
            InputError: not bytes.
        """
        if not isinstance(data, bytes | bytearray):
            raise InputError(f"data is of type {type(data).__name__}, expected bytes")
        self._input += data
        return len(data)

    def read(self, size: int = 1) -> bytes:
        """Some bytes of telemetry.

        Raises:
            InputError: not a whole number from 0 on, or far too many; or the box has received, and dropped, a command
                with steps for a channel that is not in use.
        """
        size = whole_number("size", size, 0, _MOST_BYTES)
        while len(self._output) < size:
            self._exchange()
        data = bytes(self._output[:size])
        del self._output[:size]
        return data

    def _exchange(self) -> None:
        """Run sixteen passes of the loop; after the last, telemetry is sent and commands are received."""
        before = self.emulator.position
        self.emulator.advance(EXCHANGE_TICKS)
        after = self.emulator.position
        for name, (first, last) in self._switches.items():
            k = CHANNELS.index(name.split()[0])
            if min(before[k], after[k]) <= last and max(before[k], after[k]) >= first:
                self._hit.add(name)
        self._output += self.telemetry().encode()
        self._hit.clear()
        if len(self._input) < COMMAND_BYTES:
            return
        # Only a frame at the beginning is accepted; the rest is dropped.
        frame = bytes(self._input[:COMMAND_BYTES])
        self._input.clear()
        if frame.startswith(HEADER):
            try:
                command = BoxCommand.decode(frame)
            except InputError:  # another safety level: no joint moves
                self.emulator.forget_stretching()
            else:
                self.emulator.command(command)

    def telemetry(self) -> Telemetry:
        """The telemetry frame that the box would send now."""
        emulator, channels = self.emulator, self.emulator.box.channels
        position = emulator.position
        scales: Sequence[float] = [
            (channels[name].counts_per_step or 0.0) if name in channels else 0.0 for name in CHANNELS
        ]
        encoders = tuple(wrapped_counts(round(scale * count)) for scale, count in zip(scales, position, strict=True))
        hit = tuple(name for name in SWITCHES if name in self._hit)
        remaining = tuple(emulator.joints[name].remaining if name in emulator.joints else 0 for name in CHANNELS)
        return Telemetry("0002", "idle" if emulator.idle else "active", hit, encoders, remaining, position)
