"""The clock of a sender of joint states, continued over restarts and jumps.

A message older than the latest one is late or repeated, and is dropped. Several consecutive old messages in increasing
order indicate that the sender was restarted and its clock begins anew. A message that arrives earlier than it was
measured, compared with earlier messages, indicates that the clock jumped ahead. From then on its times are shifted such
that the time since the last message agrees with the receiver's clock. A sender whose clock differs from that of the
others, compared by the arrivals, begins with such a shift.
"""

from __future__ import annotations

import math

from rr1plan.mirror.joint_states import StreamError

# Number of consecutive old messages in increasing order that indicate a restart.
_IN_A_ROW = 3
# A clock jumped ahead if a message overtakes the fastest one so far by more than this; drift does not [s]. Two clocks
# differ if the first message by one is farther from the time by the other.
_AHEAD = 1.0


class SenderClock:
    """Converts the times of messages of one sender.

    Args:
        others: The smallest `least_offset` of other senders [s]; inf without one.

    Attributes:
        least_offset: Smallest difference between the times of arrival and of measurement [s]; inf if none is known.
    """

    def __init__(self, others: float = math.inf) -> None:
        self._others = others
        self._now: float | None = None
        self._shift = self._arrival = 0.0
        self.least_offset = math.inf
        self._late: list[float] = []

    def read(self, time: float, arrival: float | None) -> tuple[float | None, StreamError | None]:
        """The continued time of a message, None if it is dropped; and its fault, if any.

        Args:
            time: Time of measurement, on the clock of the sender [s].
            arrival: Time of arrival, on the clock of the receiver [s]; None if unknown, as in a file: then a jump ahead
                cannot be distinguished from a time without messages.
        """
        now, error = self._continued(time, arrival)
        if now is not None:
            self._late.clear()
            self._shift, self._now = now - time, now
            if arrival is not None:
                self._arrival, self.least_offset = arrival, min(self.least_offset, arrival - now)
        return now, error

    def _begun(self, time: float, arrival: float | None) -> tuple[float, StreamError | None]:
        if arrival is None or math.isinf(self._others) or abs(time - (arrival - self._others)) <= _AHEAD:
            return time, None
        now = arrival - self._others
        said = (
            f"a further sender's clock is at {time:.3f} s, that of the first one at {now:.3f} s: it goes on from there"
        )
        return now, StreamError("clock", said)

    def _continued(self, time: float, arrival: float | None) -> tuple[float | None, StreamError | None]:
        last = self._now
        if last is None:
            return self._begun(time, arrival)
        arrival = self._arrival if arrival is None else arrival
        now, newest, elapsed = time + self._shift, last - self._shift, arrival - self._arrival
        if now > last:
            if not self._is_ahead(now, arrival, elapsed):
                return now, None
            said = f"the sender's clock went from {newest:.3f} s to {time:.3f} s in {elapsed:.3g} s"
            return last + elapsed, StreamError("clock", f"{said}: it goes on from there")
        if now == last or (self._late and time <= self._late[-1]):
            self._late.clear()
        self._late.append(time)
        if len(self._late) < _IN_A_ROW:
            return None, StreamError("order", f"the message of {time:.3f} s came after that of {newest:.3f} s")
        said = f"the sender's clock went back from {newest:.3f} s to {self._late[0]:.3f} s: it goes on from there"
        now = last + max(elapsed, time - self._late[0])
        return last + elapsed if self._is_ahead(now, arrival, elapsed) else now, StreamError("restart", said)

    def _is_ahead(self, now: float, arrival: float, elapsed: float) -> bool:
        """Whether a message of a continued time arrived earlier than it was measured, compared with earlier ones."""
        # With elapsed <= 0 the arrival is unknown, or messages arrived together.
        return elapsed > 0.0 and arrival - now < self.least_offset - _AHEAD
