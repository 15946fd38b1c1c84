"""Conversion of messages to configurations of a scene, or to faults."""

from __future__ import annotations

from difflib import get_close_matches

import numpy as np

from rr1plan.checks import FARTHEST, Array
from rr1plan.mirror.joint_states import StateMessage, StreamError
from rr1plan.playback.simulation.joint_map import JointMap
from rr1plan.scene import Scene

# A joint jumps if it moves farther between messages than at this multiple of its velocity limit plus this [rad or m].
_FASTER, _SLACK = 1.5, 0.01


class MessageReader:
    """Reads messages one after the other.

    Args:
        scene: The scene; joints without messages keep their values in it.
        needed: Joints that each message must contain, "arm/joint".

    Attributes:
        joints: All movable joints of the scene.
    """

    def __init__(self, scene: Scene, needed: tuple[str, ...]) -> None:
        self.joints = JointMap(scene)
        self._names = scene.joint_names()
        # Planning joints among all movable ones.
        self._columns = np.array([self.joints.index[name] for name in self._names], dtype=np.int64)
        self._needed = needed
        self._arm = f"{next(iter(scene.arms))}/" if len(scene.arms) == 1 else ""
        self._speeds = scene.limits().velocity
        self._time: float | None = None
        self._positions = self.joints.expand(scene.configuration())

    def read(self, message: StateMessage) -> Array | StreamError:
        """The positions of all movable joints [rad or m], shape (n,); or why the message cannot be used."""
        names = [name if "/" in name else self._arm + name for name in message.joint_names]
        error = self._error(message, names)
        if error is not None:
            return error
        measured = [self.joints.index[name] for name in names]
        positions = self._positions.copy()
        positions[measured] = message.positions
        # Joints that mimic others follow them, unless they are measured, too.
        positions = self.joints.follow(positions)
        positions[measured] = message.positions
        return positions

    def configuration(self, positions: Array) -> Array:
        """The planning joints of all arms, shape (nq,), among the positions of all movable joints (n,)."""
        return np.asarray(positions[self._columns])

    def accept(self, time: float, positions: Array) -> StreamError | None:
        """Store the state to compare with the next message; returns an error if it jumps from the previous one.

        Args:
            time: Time of measurement, by a monotonic clock [s].
            positions: The positions of all movable joints [rad or m], shape (n,).
        """
        last, moved = self._time, np.abs(self.configuration(positions - self._positions))
        self._time, self._positions = time, positions
        if last is None:
            return None
        over = moved - _FASTER * self._speeds * (time - last) - _SLACK
        if not (over > 0.0).any():
            return None
        i = int(np.argmax(over))
        return StreamError("jump", f"joint {self._names[i]!r} moved by {moved[i]:.3g} in {time - last:.3g} s")

    def _error(self, message: StateMessage, names: list[str]) -> StreamError | None:
        when = f"in the message of {message.time:.3f} s"
        unknown = [name for name in names if name not in self.joints.index]
        missing = [name for name in self._needed if name not in names]
        if unknown or missing:
            what = f"unknown joint {unknown[0]!r}" if unknown else f"no joint {missing[0]!r}"
            near = get_close_matches(unknown[0], self.joints.index, 1) if unknown else []
            return StreamError("joints", f"{what} {when}" + (f". Did you mean {near[0]!r}?" if near else ""))
        plausible = np.abs(message.positions) <= FARTHEST
        if not plausible.all():
            k = int(np.argmin(plausible))
            value = message.positions[k]
            return StreamError("finite", f"joint {names[k]!r} is {value:g}, not a finite position, {when}")
        return None
