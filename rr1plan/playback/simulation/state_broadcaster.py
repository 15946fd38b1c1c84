"""A joint state broadcaster: publishes the state of joints at a rate to a callback, a file or a socket."""

from __future__ import annotations

import json
import math
import socket
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from rr1plan.checks import check_callback, file_path, of_kind, positive_number
from rr1plan.errors import InputError
from rr1plan.path import check_joint_names
from rr1plan.playback.simulation.controllers import JointState
from rr1plan.playback.simulation.simulation import Simulation

StateCallback = Callable[[JointState], None]


class JointStateBroadcaster:
    """Publishes joint states at a rate, as `joint_state_broadcaster` does.

    A file gets a line for each state, and a socket a datagram (UDP), both JSON with the fields of
    `sensor_msgs/JointState`: {"time", "name", "position", "velocity", "effort"}. Add it to a simulation with `attach`,
    and `close` it afterwards, or use it in a `with` statement.

    Args:
        joint_names: The joints, "arm/joint".
        to: A callback for each `JointState`, a file, or (host, port).
        rate: States per simulated second [Hz].

    Raises:
        InputError: no joints, a rate that is not above zero, or a target of another kind.
    """

    def __init__(
        self, joint_names: Sequence[str], to: StateCallback | str | Path | tuple[str, int], *, rate: float = 50.0
    ) -> None:
        self.joint_names = check_joint_names(joint_names, empty=False)
        self.rate = positive_number("rate", rate)
        self._next = -math.inf
        self._end: list[Callable[[], None]] = []
        if isinstance(to, str | Path):
            path = file_path(to)
            try:
                file = path.open("w", encoding="utf-8")
            except OSError as error:
                raise InputError(f"cannot write {path}: {error.strerror}") from error
            self._end.append(file.close)
            self._send: StateCallback = lambda state: print(self._message(state), file=file)
        elif isinstance(to, tuple):
            if len(to) != 2 or not isinstance(to[0], str) or not isinstance(to[1], int) or not 0 < to[1] < 65536:
                raise InputError(f"to is {to!r}, expected a host and a port, such as ('127.0.0.1', 9000)")
            sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            self._end.append(sender.close)
            self._send = lambda state: _ignore(sender.sendto(self._message(state).encode(), to))
        else:
            check_callback("to", to)
            self._send = to

    def __enter__(self) -> JointStateBroadcaster:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def attach(self, sim: Simulation) -> None:
        """Publish the states of a simulation from now on.

        Raises:
            UnknownNameError: the simulation has no such joint.
        """
        of_kind("sim", sim, Simulation)
        sim.state(self.joint_names)
        self._next = sim.time + 1.0 / self.rate
        self._end.append(sim.on_step(self._publish))

    def close(self) -> None:
        """Stop publishing, and close the file or the socket."""
        while self._end:
            self._end.pop()()

    def _publish(self, sim: Simulation) -> None:
        if sim.time < self._next - 1.0 / self.rate - sim.dt:  # the simulation was reset
            self._next = sim.time + 1.0 / self.rate
        if sim.time >= self._next - 0.5 * sim.dt:
            self._next += 1.0 / self.rate
            self._send(sim.state(self.joint_names))

    def _message(self, state: JointState) -> str:
        fields: dict[str, Any] = {"time": round(state.time, 9), "name": self.joint_names}
        fields |= {"position": state.positions.tolist(), "velocity": state.velocities.tolist()}
        return json.dumps(fields | {"effort": state.efforts.tolist()})


def _ignore(_: int) -> None:
    """Discard the number of bytes sent."""
