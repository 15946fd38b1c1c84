"""The clock of a sender of joint states, continued over restarts and jumps.

A message older than the latest one is late or repeated, and is dropped. Several consecutive old messages in increasing
order indicate that the sender was restarted and its clock begins anew. A message that arrives earlier than it was
measured, compared with earlier messages, indicates that the clock jumped ahead. From then on its times are shifted such
that the time since the last message agrees with the receiver's clock.
"""

from __future__ import annotations

import math

from rr1plan.mirror.joint_states import StreamError

# Number of consecutive old messages in increasing order that indicate a restart.
_IN_A_ROW = 3
# A clock jumped ahead if a message overtakes the fastest one so far by more than this; drift does not [s].
_AHEAD = 1.0


class SenderClock:
    """Converts the times of messages of one sender."""

    def __init__(self) -> None:
        self._now: float | None = None
        self._shift = self._arrival = 0.0
        # Smallest difference between the times of arrival and of measurement.
        self._least_offset = math.inf
        self._late: list[float] = []

    def read(self, time: float, arrival: float | None) -> tuple[float | None, StreamError | None]:
        """The continued time of a message, None if it is dropped; and its fault, if any.

        Args:
            time: Time of measurement, on the clock of the sender [s].
            arrival: Time of arrival, on the clock of the receiver [s]; None if unknown, as in a file: then a jump ahead
                cannot be distinguished from a time without messages.
        """
        now, error = self._continued(time, self._arrival if arrival is None else arrival)
        if now is not None:
            self._late.clear()
            self._shift, self._now = now - time, now
            if arrival is not None:
                self._arrival, self._least_offset = arrival, min(self._least_offset, arrival - now)
        return now, error

    def _continued(self, time: float, arrival: float) -> tuple[float | None, StreamError | None]:
        if self._now is None:
            return time, None
        now, newest, elapsed = time + self._shift, self._now - self._shift, arrival - self._arrival
        if now > self._now:
            # With elapsed <= 0 the arrival is unknown, or messages arrived together.
            if elapsed <= 0.0 or arrival - now >= self._least_offset - _AHEAD:
                return now, None
            said = f"the sender's clock went from {newest:.3f} s to {time:.3f} s in {elapsed:.3g} s"
            return self._now + elapsed, StreamError("clock", f"{said}: it goes on from there")
        if now == self._now or (self._late and time <= self._late[-1]):
            self._late.clear()
        self._late.append(time)
        if len(self._late) < _IN_A_ROW:
            return None, StreamError("order", f"the message of {time:.3f} s came after that of {newest:.3f} s")
        said = f"the sender's clock went back from {newest:.3f} s to {self._late[0]:.3f} s: it goes on from there"
        return self._now + max(elapsed, time - self._late[0]), StreamError("restart", said)
