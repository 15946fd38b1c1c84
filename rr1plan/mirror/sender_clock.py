"""The clock of a sender of joint states, continued over restarts.

A message older than the latest one is late or repeated, and is dropped. Several consecutive old messages in increasing
order indicate that the sender was restarted and its clock begins anew. From then on its times are shifted such that the
time since the last message agrees with this machine's clock.
"""

from __future__ import annotations

from rr1plan.mirror.joint_states import StreamError

# Number of consecutive old messages in increasing order that indicate a restart.
_IN_A_ROW = 3


class SenderClock:
    """Converts the times of messages.

    Attributes:
        now: Time of the latest message, continued over restarts [s]; None before the first.
    """

    def __init__(self) -> None:
        self.now: float | None = None
        self._shift = self._arrival = 0.0
        self._late: list[float] = []

    def read(self, time: float, arrival: float) -> tuple[float | None, StreamError | None]:
        """The continued time of a message, None if it is dropped; and its fault, if any.

        Args:
            time: Time of measurement, on the clock of the sender [s].
            arrival: Time of arrival, on the clock of the receiver [s].
        """
        if self.now is None or time + self._shift > self.now:
            self._late.clear()
            return time + self._shift, None
        if time + self._shift == self.now or (self._late and time <= self._late[-1]):
            self._late.clear()
        self._late.append(time)
        newest = self.now - self._shift
        if len(self._late) < _IN_A_ROW:
            return None, StreamError("order", f"the message of {time:.3f} s came after that of {newest:.3f} s")
        # Arrival times are meaningless for a file that is read at once.
        since = max(arrival - self._arrival, time - self._late[0])
        self._shift = self.now + since - time
        said = f"the sender's clock went back from {newest:.3f} s to {self._late[0]:.3f} s: it goes on from there"
        self._late.clear()
        return self.now + since, StreamError("restart", said)

    def accept(self, time: float, arrival: float) -> None:
        """Record a message as the latest one.

        Args:
            time: Its continued time [s].
            arrival: Time of arrival [s].
        """
        self.now, self._arrival = time, arrival
