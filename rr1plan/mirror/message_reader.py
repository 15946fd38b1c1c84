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
        self._column = {name: i for i, name in enumerate(scene.joint_names())}
        self._needed = needed
        self._arm = f"{next(iter(scene.arms))}/" if len(scene.arms) == 1 else ""
        self._speeds = scene.limits().velocity
        self._time: float | None = None
        self._q = np.array(scene.configuration())

    def read(self, message: StateMessage) -> Array | StreamError:
        """The configuration of all planning joints [rad or m], shape (nq,); or why the message cannot be used."""
        names = [name if "/" in name else self._arm + name for name in message.joint_names]
        error = self._error(message, names)
        if error is not None:
            return error
        q = self._q.copy()
        for name, value in zip(names, message.positions, strict=True):
            if name in self._column:
                q[self._column[name]] = value
        return q

    def accept(self, time: float, q: Array) -> StreamError | None:
        """Store the state to compare with the next message; returns an error if it jumps from the previous one.

        Args:
            time: Time of measurement, by a monotonic clock [s].
            q: The configuration of all planning joints [rad or m], shape (nq,).
        """
        last, moved = self._time, np.abs(q - self._q)
        self._time, self._q = time, q
        if last is None:
            return None
        over = moved - _FASTER * self._speeds * (time - last) - _SLACK
        if not (over > 0.0).any():
            return None
        i = int(np.argmax(over))
        return StreamError("jump", f"joint {list(self._column)[i]!r} moved by {moved[i]:.3g} in {time - last:.3g} s")

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
