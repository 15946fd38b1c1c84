"""The clock of a sender of joint states, which goes on where it is restarted.

A message from before the newest one came late or twice, and is dropped. Some in a row that follow each other are no
accident: the sender was restarted and counts its time anew. From then on its times are shifted, so that the
time since the last message is what this machine's clock says.
"""

from __future__ import annotations

from rr1plan.mirror.joint_states import StreamError

# Messages from before the newest one, each after the other, that make a restart.
_IN_A_ROW = 3


class SenderClock:
    """Reads the times of messages.

    Attributes:
        now: Time of the newest message, continued over restarts [s]; None before the first.
    """

    def __init__(self) -> None:
        self.now: float | None = None
        self._shift = self._arrival = 0.0
        self._late: list[float] = []

    def read(self, time: float, arrival: float) -> tuple[float | None, StreamError | None]:
        """The continued time of a message, None if it is dropped; and what is wrong with it, if anything.

        Args:
            time: When it was measured, on the clock of the sender [s].
            arrival: When it arrived, on the clock of the receiver [s].
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
        # Times of arrival say nothing about a file that is read at once.
        since = max(arrival - self._arrival, time - self._late[0])
        self._shift = self.now + since - time
        said = f"the sender's clock went back from {newest:.3f} s to {self._late[0]:.3f} s: it goes on from there"
        self._late.clear()
        return self.now + since, StreamError("restart", said)

    def accept(self, time: float, arrival: float) -> None:
        """Make a message the newest one.

        Args:
            time: Its continued time [s].
            arrival: When it arrived [s].
        """
        self.now, self._arrival = time, arrival
