"""Streams of joint states: JSON lines in a file or over UDP, messages in a ROS bag, or your own.

A stream is an iterable of `StateMessage`. A `StreamError` represents a damaged message or silence, so that neither ends
the stream.
"""

from __future__ import annotations

import contextlib
import json
import math
import pathlib
import socket
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal, Self

from numpy.typing import ArrayLike

from rr1plan.checks import (
    Array,
    Value,
    file_path,
    finite_number,
    number_array,
    positive_number,
    read_only,
    shown,
)
from rr1plan.errors import InputError
from rr1plan.export.ros_trajectories import BAG_SUFFIXES, read_joint_states, refuse_topic
from rr1plan.files.file_access import content_suffix, read_text
from rr1plan.path import check_joint_names
from rr1plan.thread_locks import exclusive, per_process

StreamFault = Literal["format", "joints", "finite", "order", "restart", "clock", "jump", "silence"]
_LARGEST_DATAGRAM = 65_536
_LARGEST_RECORDING = 2**30  # of a file of lines [bytes]: an hour of an arm at 1 kHz
# Requested memory for datagrams that arrive while the receiver is busy, seconds of an arm at 1 kHz; systems grant less.
_WAITING_DATAGRAMS = 4_194_304
# Largest time of a message [s], 3000 years: rounding of larger ones would stop the clock of a mirror.
_LATEST = 1e11
# Longest time to wait for a datagram before it is checked whether the stream has been closed [s].
_WAIT = 0.2


@dataclass(frozen=True, eq=False, repr=False)
class StateMessage(Value):
    """The positions of some joints at an instant, as in `sensor_msgs/JointState`.

    Args:
        time: Time of measurement, on the clock of the sender [s].
        joint_names: Their names; "joint" alone if only one arm has it.
        positions: Positions [rad or m], shape (n,); NaN and infinities are kept, for the receiver to report.
        received: Time of arrival, on the clock of the receiver [s]; None: unknown, as in a file.

    Raises:
        InputError: a time that is not finite or above 1e11 s, no names or a repeated one, or another number of
            positions.
    """

    time: float
    joint_names: tuple[str, ...]
    positions: Array
    received: float | None = None

    def __init__(
        self, time: float, joint_names: Sequence[str], positions: ArrayLike, received: float | None = None
    ) -> None:
        names, values = check_joint_names(joint_names, empty=False), number_array("positions", positions)
        if values.shape != (len(names),):
            raise InputError(f"positions has shape {values.shape}, expected ({len(names)},): one for each name")
        object.__setattr__(self, "time", _checked_time("time", time))
        object.__setattr__(self, "joint_names", names)
        object.__setattr__(self, "positions", read_only(values))
        object.__setattr__(self, "received", None if received is None else _checked_time("received", received))


def _checked_time(name: str, value: object) -> float:
    time = finite_number(name, value)
    if abs(time) > _LATEST:
        raise InputError(f"{name} is {time:g} s, expected at most {_LATEST:g} s")
    return time


@dataclass(frozen=True)
class StreamError:
    """A fault in a stream.

    Args:
        fault: "format" (cannot be read), "joints" (unknown or missing ones), "finite" (NaN, infinite, or beyond 1e4),
            "order" (not after the previous message), "restart" (the clock of the sender begins anew), "clock" (it jumps
            ahead, or differs from that of other senders), "jump" (faster than the joint can move), or "silence" (no
            message for too long).
        message: Description for people.
    """

    fault: StreamFault
    message: str


class StateStream(Iterator[StateMessage | StreamError]):
    """Joint states of a file or a socket, in order; use it in a `with` statement, or `close` it.

    Args:
        items: The messages and errors.
        close: Closes their source.
    """

    def __init__(self, items: Iterator[StateMessage | StreamError], close: Callable[[], object]) -> None:
        self._items, self._close = items, close

    def __next__(self) -> StateMessage | StreamError:
        return next(self._items)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the stream, and close the file or the socket, whose port is free then; may be called from any thread."""
        self._items = iter(())
        self._close()


def read_states(source: str | pathlib.Path, *, silence: float = 1.0, topic: str | None = None) -> StateStream:
    """The joint states of a file or a socket.

    A datagram or line is a JSON object such as {"time": 0.02, "name": ["shoulder", "elbow"], "position": [0.1, 0.2]},
    with the time of measurement [s] on a clock of the sender and positions in rad or m; further keys are ignored.

    Args:
        source: "udp://HOST:PORT" to listen for datagrams, as a `JointStateBroadcaster` sends them; a file of such lines
            (.jsonl); or a bag with `sensor_msgs/JointState` (.mcap, .db3, .bag, a folder).
        silence: Interval without messages [s] after which a `StreamError` is reported, repeatedly by a socket. In a
            file it is an interval of the times of arrival, or of measurement if these are unknown.
        topic: The topic of a bag (default: the only one with such messages).

    Returns:
        Messages, and an error in place of each one that cannot be read. A socket is listened to until it is closed.

    Raises:
        InputError: another kind of source, an address at which listening fails, a file that cannot be read, a topic
            for a source other than a bag.
        MissingPackageError: a bag, and `rosbags` is not installed (extra `ros`).
    """
    positive_number("silence", silence)
    if isinstance(source, str) and "://" in source:
        refuse_topic(source, topic)
        return _from_socket(*_address(source), silence)
    path = file_path(source)
    if path.suffix.lower() in BAG_SUFFIXES or path.is_dir():
        messages = read_joint_states(path, topic=topic)
        return StateStream(_with_silence((_of_bag(*fields) for fields in messages), silence), messages.close)
    refuse_topic(path, topic)
    if content_suffix(path) == ".csv":
        raise InputError(f"{path} is a CSV file, expected JSON lines, a ROS bag or udp://HOST:PORT")
    text = read_text(path, _LARGEST_RECORDING, strict=False)
    lines = [line for line in text.splitlines() if line.strip()]
    return StateStream(_with_silence(map(parse_state, lines), silence), lambda: None)


def parse_state(text: str | bytes) -> StateMessage | StreamError:
    """One message as a `JointStateBroadcaster` or a `Mirror` writes it: JSON with "time", "name" and "position"."""
    try:
        data = json.loads(text)
        return StateMessage(data["time"], data["name"], data["position"], data.get("received"))
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:  # an InputError is a ValueError
        what = f"no {error}" if isinstance(error, KeyError) else str(error)
        return StreamError("format", f"{shown(text[:60])} is not a joint state: {what[:200]}")


def _with_silence(items: Iterable[StateMessage | StreamError], silence: float) -> Iterator[StateMessage | StreamError]:
    """The items of a file, and an error before each message that comes after an interval without messages."""
    last = math.inf
    for item in items:
        if isinstance(item, StateMessage):
            now = item.time if item.received is None else item.received
            if now - last > silence:
                yield StreamError("silence", f"no message for {now - last:.3g} s, from {last:.3f} s to {now:.3f} s")
            last = now
        yield item


def _of_bag(time: float, names: tuple[str, ...], positions: Array) -> StateMessage | StreamError:
    """A message of a bag, which may have no names, or no positions but velocities or efforts."""
    try:
        return StateMessage(time, names, positions)
    except InputError as error:
        return StreamError("format", f"the message of {time:.3f} s is not a joint state: {error}")


def _address(source: str) -> tuple[str, int]:
    scheme, _, rest = source.partition("://")
    host, _, port = rest.rpartition(":")
    if scheme != "udp" or not host or not port.isdecimal() or not 0 < int(port) < 65536:
        raise InputError(
            f"source is {shown(source)}, expected udp://HOST:PORT, such as udp://127.0.0.1:9000, or a file"
        )
    return host, int(port)


def _from_socket(host: str, port: int, silence: float) -> StateStream:
    receiver = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    with contextlib.suppress(OSError):  # some systems refuse instead
        receiver.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _WAITING_DATAGRAMS)
    try:
        receiver.bind((host, port))
    except OSError as error:
        receiver.close()
        raise InputError(f"cannot listen to udp://{host}:{port}: {error.strerror}") from error
    except (TypeError, ValueError) as error:  # no name of a host can have these characters
        receiver.close()
        raise InputError(f"cannot listen to {shown(f'udp://{host}:{port}')}: {error}") from error
    listener = _Listener(receiver)
    return StateStream(_Datagrams(listener, silence), listener.close)


class _Listener:
    """Receives datagrams from a socket until it is closed, by any thread."""

    def __init__(self, receiver: socket.socket) -> None:
        self._receiver = receiver
        # Held while a thread waits at the socket: its port is not free before.
        self._lock = per_process(self, "_lock", threading.RLock)
        self.closed = False

    @exclusive
    def receive(self, seconds: float) -> bytes:
        """The next datagram.

        Raises:
            TimeoutError: there was none for some seconds, or for `_WAIT`.
        """
        if self.closed:
            return b""
        self._receiver.settimeout(min(seconds, _WAIT))
        return self._receiver.recv(_LARGEST_DATAGRAM)

    def close(self) -> None:
        """Close the socket, whose port is free afterwards."""
        self.closed = True
        if not self._lock.acquire(blocking=False):
            with contextlib.suppress(OSError):  # a datagram wakes the thread that waits, at the latest `_WAIT` does
                self._receiver.sendto(b"", self._receiver.getsockname())
            self._lock.acquire()
        self._receiver.close()
        self._lock.release()


class _Datagrams(Iterator[StateMessage | StreamError]):
    """The messages of a listener until it is closed. Ctrl-C does not end them, as it would end a generator."""

    def __init__(self, listener: _Listener, silence: float) -> None:
        self._listener, self._silence, self._heard = listener, silence, time.monotonic()

    def __next__(self) -> StateMessage | StreamError:
        while not self._listener.closed:
            item = self._receive()
            if item is not None and not self._listener.closed:
                return item
        raise StopIteration

    def _receive(self) -> StateMessage | StreamError | None:
        """The next item; None if there is none yet."""
        try:
            data = self._listener.receive(self._silence)
        except TimeoutError:
            if time.monotonic() < self._heard + self._silence:
                return None
            self._heard = time.monotonic()
            return StreamError("silence", f"no message for {self._silence:g} s")
        except OSError:
            if not self._listener.closed:
                raise
            return None
        self._heard = time.monotonic()
        item = parse_state(data)
        return item if isinstance(item, StreamError) else replace(item, received=self._heard)
