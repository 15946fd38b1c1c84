"""Configurations of a scene from messages of joint states, which may have some joints each."""

from __future__ import annotations

import math
from difflib import get_close_matches

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import FARTHEST, Array
from rr1plan.export.ros_trajectories import columns_by_name
from rr1plan.mirror.joint_states import StateMessage, StreamError
from rr1plan.mirror.sender_clock import SenderClock
from rr1plan.model.joint_turns import difference
from rr1plan.playback.simulation.joint_map import JointMap
from rr1plan.scene import Scene

# A joint jumps if it moves farther between messages than at this multiple of its velocity limit plus this [rad or m].
_FASTER, _SLACK = 1.5, 0.01
# A needed joint is missing if messages do not have it for longer than this [s].
_MISSING = 1.0


class MessageReader:
    """Merges messages joint by joint. Messages with the same joints come from one sender, which has its own clock.

    Args:
        scene: The scene; joints without messages keep their values in it.
        needed: Joints that are measured anew for each state, "arm/joint".

    Attributes:
        joints: All movable joints of the scene.
        positions: Their latest positions [rad or m], shape (n,).
        times: Times of these measurements, on the clocks of the senders, continued over restarts [s], shape (n,); -inf
            for joints without messages.
    """

    def __init__(self, scene: Scene, needed: tuple[str, ...]) -> None:
        self.joints = JointMap(scene)
        self.positions = self.joints.expand(scene.configuration())
        self.times = np.full(len(self.positions), -math.inf)
        self._planned = self.joints.indices(scene.joint_names())
        self._speeds = np.full(len(self.positions), math.inf)
        self._speeds[self._planned] = scene.limits().velocity
        kinds = {f"{a}/{joint.name}": joint.kind for a, arm in scene.arms.items() for joint in arm.robot.joints}
        self._endless = np.array([kinds[name] == "continuous" for name in self.joints.names], dtype=np.bool_)
        self._needed = [self.joints.index[name] for name in needed]
        # Needed joints that are not measured since the latest state.
        self._waiting = set(self._needed)
        self._columns = columns_by_name(self.joints.names)
        self._clocks: dict[frozenset[str], SenderClock] = {}
        self._began: float | None = None  # time of the first message

    @property
    def unmeasured(self) -> tuple[str, ...]:
        """Needed joints without messages."""
        return tuple(self.joints.names[i] for i in self._needed if self.times[i] == -math.inf)

    @property
    def configuration(self) -> Array:
        """The latest positions of the planning joints of all arms, shape (nq,)."""
        return np.asarray(self.positions[self._planned])

    def read(self, message: StateMessage) -> tuple[float | None, list[StreamError]]:
        """Merge a message; joints that the scene does not have are a fault, and are ignored.

        Returns:
            The time of the new state [s], that of its latest measurement, or None without one, because the message
            cannot be used or other joints are still to be measured; and the faults.
        """
        indices, faults = self._indices(message)
        joints, positions = indices[indices >= 0], message.positions[indices >= 0]
        wrong = np.flatnonzero(~(np.abs(positions) <= FARTHEST)).tolist()  # also nan
        if wrong:
            name, value = self.joints.names[joints[wrong[0]]], positions[wrong[0]]
            when = f"in the message of {message.time:.3f} s"
            faults.append(StreamError("finite", f"joint {name!r} is {value:g}, not a finite position, {when}"))
        if wrong or not len(joints):
            return None, faults
        now, late = self._clock(joints).read(message.time, message.received)
        faults += [] if late is None else [late]
        if now is None:
            return None, faults
        jump, missing = self._merge(joints, now, positions), self._missing(now)
        faults += [fault for fault in (jump, missing) if fault is not None]
        if self._waiting:
            return None, faults
        self._waiting.update(self._needed)
        return float(self.times[self._needed].max()), faults

    def _clock(self, joints: NDArray[np.int64]) -> SenderClock:
        """The clock of the sender of some joints."""
        key = frozenset(joints.tolist())
        if key not in self._clocks:
            others = min((clock.least_offset for clock in self._clocks.values()), default=math.inf)
            self._clocks[key] = SenderClock(others)
        return self._clocks[key]

    def _indices(self, message: StateMessage) -> tuple[NDArray[np.int64], list[StreamError]]:
        """The index of each joint of a message, -1 for unknown ones, and a fault if there are such ones."""
        indices, when = [], f"in the message of {message.time:.3f} s"
        faults: list[StreamError] = []
        for name in message.joint_names:
            fitting = [name] if name in self.joints.index else self._columns.get(name, [])
            indices.append(self.joints.index[fitting[0]] if len(fitting) == 1 else -1)
            if len(fitting) > 1:
                faults.append(StreamError("joints", f"several arms have a joint {name!r} {when}: {', '.join(fitting)}"))
            elif not fitting:
                near = get_close_matches(name, self.joints.index, 1)
                hint = f". Did you mean {near[0]!r}?" if near else ""
                faults.append(StreamError("joints", f"unknown joint {name!r} {when}{hint}"))
        return np.array(indices, dtype=np.int64), faults[:1]

    def _merge(self, joints: NDArray[np.int64], now: float, positions: Array) -> StreamError | None:
        """Store positions of joints at a time; returns a fault if one jumps from its previous position."""
        newer = now > self.times[joints]  # another sender may have joints of this one, too
        joints, positions = joints[newer], positions[newer]
        elapsed = now - self.times[joints]
        # Positions of endless joints may be reported within one turn.
        moved = np.abs(difference(positions, self.positions[joints], self._endless[joints]))
        self.positions[joints], self.times[joints] = positions, now
        # Joints that mimic others follow them, unless they are measured, too.
        assumed = self.times == -math.inf
        self.positions[assumed] = self.joints.follow(self.positions)[assumed]
        self._waiting.difference_update(joints.tolist())
        over = moved - _FASTER * self._speeds[joints] * elapsed - _SLACK
        if not (over > 0.0).any():
            return None
        i = int(np.argmax(over))
        name = self.joints.names[joints[i]]
        unit = "m" if self.joints.slides[joints[i]] else "rad"
        return StreamError("jump", f"joint {name!r} moved by {moved[i]:.3g} {unit} in {elapsed[i]:.3g} s")

    def _missing(self, now: float) -> StreamError | None:
        """A fault if messages have lacked a needed joint for too long."""
        self._began = now if self._began is None else self._began
        for i in sorted(self._waiting):
            lacking = now - max(self._began, float(self.times[i]))
            if lacking > _MISSING:
                return StreamError(
                    "joints", f"no joint {self.joints.names[i]!r} for {lacking:.3g} s, until {now:.3f} s"
                )
        return None
