"""A joint state broadcaster: publishes the state of joints at a rate to a callback, a file or a socket."""

from __future__ import annotations

import errno
import json
import math
import socket
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from rr1plan.checks import check_callback, counted, file_path, of_kind, positive_number, shown
from rr1plan.errors import InputError
from rr1plan.files.file_access import writing
from rr1plan.path import check_joint_names
from rr1plan.playback.simulation.controllers import JointState
from rr1plan.playback.simulation.simulation import Simulation

StateCallback = Callable[[JointState], None]


class _Address(NamedTuple):
    """A resolved address for datagrams: its name for messages, and the arguments of a socket."""

    name: str
    family: int
    address: tuple[Any, ...]


class JointStateBroadcaster:
    """Publishes joint states at a rate, as `joint_state_broadcaster` does.

    A file gets a line for each state, and a socket a datagram (UDP), both JSON with the fields of
    `sensor_msgs/JointState`: {"time", "name", "position", "velocity", "effort"}. Add it to a simulation with `attach`,
    which opens the file or the socket, and `close` it afterwards, or use it in a `with` statement. A line that cannot
    be written, as on a full disk, or a datagram that cannot be sent, such as one of more than 64 kB, ends the run with
    an `InputError`.

    Args:
        joint_names: The joints, "arm/joint".
        to: A callback for each `JointState`, a file, or (host, port).
        rate: States per simulated second [Hz].

    Raises:
        InputError: no joints, a rate that is not above zero, a target of another kind, or an unknown host.
    """

    def __init__(
        self, joint_names: Sequence[str], to: StateCallback | str | Path | tuple[str, int], *, rate: float = 50.0
    ) -> None:
        self.joint_names = check_joint_names(joint_names, empty=False)
        self.rate = positive_number("rate", rate)
        self._next = -math.inf
        self._end: list[Callable[[], None]] = []
        self._closed = False
        self._send: StateCallback | None = None
        self._to: StateCallback | Path | _Address
        if isinstance(to, str) and "://" in to:
            raise InputError(f"to is {shown(to)}, expected a file, or a host and a port, such as ('127.0.0.1', 9000)")
        if isinstance(to, str | Path):
            self._to = file_path(to)
        elif isinstance(to, tuple):
            self._to = _resolved(to)
        else:
            check_callback("to", to)
            self._to = to

    def __enter__(self) -> JointStateBroadcaster:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def attach(self, sim: Simulation) -> None:
        """Publish the states of a simulation from now on.

        Args:
            sim: The simulation.

        Raises:
            UnknownNameError: the simulation has no such joint.
            InputError: the broadcaster is closed, or its file or socket cannot be opened.
        """
        of_kind("sim", sim, Simulation)
        if self._closed:
            raise InputError("the broadcaster is closed; attach another JointStateBroadcaster")
        sim.state(self.joint_names)
        if self._send is None:
            self._send = self._opened()
        self._next = sim.time + 1.0 / self.rate
        self._end.append(sim.on_step(self._publish))

    def close(self) -> None:
        """Stop publishing, and close the file or the socket; may be called repeatedly."""
        self._closed = True
        while self._end:
            self._end.pop()()

    def _opened(self) -> StateCallback:
        """Open the target; returns a function that sends a state to it."""
        to = self._to
        if isinstance(to, Path):
            with writing(to):
                file = to.open("w", encoding="utf-8")
            self._end.append(writing(to)(file.close))
            return writing(to)(lambda state: print(self._message(state), file=file))
        if isinstance(to, _Address):
            try:
                sender = socket.socket(to.family, socket.SOCK_DGRAM)
            except OSError as error:
                raise InputError(f"cannot send to {to.name}: {error.strerror}") from error
            self._end.append(sender.close)
            return lambda state: self._send_datagram(sender, to, state)
        return to

    def _send_datagram(self, sender: socket.socket, to: _Address, state: JointState) -> None:
        data = self._message(state).encode()
        try:
            sender.sendto(data, to.address)
        except OSError as error:
            advice = "; broadcast fewer joints, or write a file" if error.errno == errno.EMSGSIZE else ""
            raise InputError(
                f"cannot send the state of {counted(len(self.joint_names), 'joint')} ({len(data)} bytes) to {to.name}: "
                f"{error.strerror}{advice}"
            ) from error

    def _publish(self, sim: Simulation) -> None:
        if sim.time < self._next - 1.0 / self.rate - sim.dt:  # the simulation was reset
            self._next = 1.0 / self.rate
        if sim.time >= self._next - 0.5 * sim.dt:
            self._next += 1.0 / self.rate
            assert self._send is not None
            self._send(sim.state(self.joint_names))

    def _message(self, state: JointState) -> str:
        fields: dict[str, Any] = {"time": round(state.time, 9), "name": self.joint_names}
        fields |= {"position": state.positions.tolist(), "velocity": state.velocities.tolist()}
        return json.dumps(fields | {"effort": state.efforts.tolist()})


def _resolved(to: tuple[Any, ...]) -> _Address:
    """The address of (host, port); an IPv4 one if there is one, as `read_states` listens to.

    Raises:
        InputError: not a host and a port, or an unknown host.
    """
    if (
        len(to) != 2
        or not isinstance(to[0], str)
        or not isinstance(to[1], int)
        or isinstance(to[1], bool)
        or not 0 < to[1] < 65536
    ):
        raise InputError(f"to is {shown(to)}, expected a host and a port, such as ('127.0.0.1', 9000)")
    host, port = to
    try:
        found = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)
    except (OSError, UnicodeError) as error:
        why = getattr(error, "strerror", None) or error
        raise InputError(f"host {shown(host)} is unknown: {why}; try an address, such as '127.0.0.1'") from error
    family, _, _, _, address = min(found, key=lambda entry: entry[0] != socket.AF_INET)
    return _Address(f"udp://{host}:{port}", family, address)
