"""The motion law of the control box's firmware, tick by tick.

A tick is one pass of the firmware's loop, which all joints share. A joint steps when the ticks since its last step
exceed its period. The period follows a sine ramp of the speed,

    v(t) = v_f / 2 (1 + sin((t / T - 1/2) pi)),

up over T ticks, then steady, then down. Joints of one command are stretched to the slowest one. Times are whole ticks,
truncated as in the firmware, and floating-point operations have the firmware's order, so that every step occurs at the
same tick.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

# The period of a joint that has a command but has not computed its speed yet [ticks].
_STOP_PERIOD = 65536.0


@dataclass
class SpeedProfile:
    """The speed of a joint over one motion: a sine ramp, steady, a sine ramp.

    Args:
        top_speed: Speed between the ramps before stretching [steps/tick].
        ramp_steps: Steps of each ramp.
        ramp_time: Ticks of each ramp.
        total_time: Ticks of the motion.
        factor: Factor on all speeds.
    """

    top_speed: float = 0.0
    ramp_steps: int = 0
    ramp_time: int = 0
    total_time: int = 0
    factor: float = 1.0

    @property
    def speed(self) -> float:
        """Speed between the ramps [steps/tick]."""
        return self.factor * self.top_speed


class JointMotion:
    """The motor of a joint, with the firmware's state.

    Args:
        fast_period: Ticks of a step at full speed.
        ramp_steps: Steps from rest to full speed.

    Attributes:
        moving: Whether it moves; otherwise it holds.
        remaining: Remaining steps, with the sign of the command.
        position: Step counter in the direction of commands.
        profile: Its speed over the current motion.
    """

    def __init__(self, fast_period: float, ramp_steps: int) -> None:
        self._fast_period, self._ramp_steps = fast_period, ramp_steps
        self.moving = False
        self.remaining = self.position = 0
        self.profile = SpeedProfile()
        # Ticks since the beginning of the motion, the sum of the periods of its steps, and the current period.
        self._time, self._step_time, self._period = 0, 0.0, _STOP_PERIOD

    def begin(self, steps: int) -> None:
        """Begin a motion of a nonzero number of steps from rest."""
        self.remaining += steps
        total, ramp, top = abs(self.remaining), self._ramp_steps, 1.0 / self._fast_period
        if total <= 2 * ramp:
            top *= total / (2.0 * ramp)
            ramp = total // 2
        ramp_time = int(ramp / (0.5 * top))
        steady = int((total - 2 * ramp) * (1.0 / top))
        self.profile = SpeedProfile(top, ramp, ramp_time, 2 * ramp_time + steady, self.profile.factor)
        self.moving, self._time, self._step_time, self._period = True, 0, 0.0, _STOP_PERIOD

    def change(self, steps: int) -> None:
        """Accept a command while moving: one of the same sign is appended, another one cuts the steady part."""
        left = self.profile.total_time - self.profile.ramp_time - self._time
        if left <= 0:
            return
        if self.remaining * steps > 0:
            self.remaining += steps
            self.profile.total_time += int(self._fast_period * abs(steps))
        else:
            cut = int(left / self._fast_period)
            self.remaining -= cut if self.remaining > 0 else -cut
            self.profile.total_time -= left

    def stretch(self, common_time: int) -> None:
        """Stretch the motion to the duration of the slowest joint of the command [ticks]."""
        profile, total = self.profile, abs(self.remaining)
        if profile.total_time <= 0:
            return
        if total > 2 * profile.ramp_steps:
            profile.factor = (total + 2.0 * profile.ramp_steps) / (profile.top_speed * common_time)
        else:
            profile.factor = 4.0 * profile.ramp_steps / (profile.top_speed * common_time)
        profile.total_time = common_time
        profile.ramp_time = int(profile.ramp_time / profile.factor)

    def advance(self, ticks: int) -> tuple[list[int], int | None]:
        """Advance by some ticks.

        Args:
            ticks: Number of ticks.

        Returns:
            The ticks of its steps, and the tick at which it stopped or None, counted from 1.
        """
        found: list[int] = []
        if not self.moving:
            return found, None
        profile, speed = self.profile, self.profile.speed
        ramp, down = profile.ramp_time, profile.total_time - profile.ramp_time
        sign = 1 if self.remaining > 0 else -1
        left, time, step_time, period = abs(self.remaining), self._time, self._step_time, self._period
        held = None
        for tick in range(1, ticks + 1):
            time += 1
            if time - step_time > period:
                step_time += period
                if left == 0:
                    held = tick
                    break
                left -= 1
                found.append(tick)
            if time <= ramp:
                period = _ramp_period(time, ramp, speed)
            elif time >= down:
                period = _ramp_period(profile.total_time - time, ramp, speed)
        self.moving = held is None
        self.remaining = sign * left
        self.position += sign * len(found)
        self._time, self._step_time, self._period = time, step_time, period
        return found, held


def _ramp_period(time: int, ramp: int, speed: float) -> float:
    """Period of a step at a time on a ramp [ticks]; nan on a ramp of length zero, on which a motor never steps."""
    if ramp == 0:
        return math.nan
    now = 0.5 * (math.sin((time / ramp - 0.5) * math.pi) + 1.0) * speed
    return 1.0 / now if now > 0.0 else math.inf
