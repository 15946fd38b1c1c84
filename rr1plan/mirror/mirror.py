"""A mirror: a stream of measured joint states, compared with the plan.

    with rp.Mirror(motion.scene, motion.trajectory, record="run.jsonl") as mirror:
        mirror.show()
        print(mirror.run(rp.read_states("udp://127.0.0.1:9000"), duration=10.0))

A message may have some joints only, as those of several drivers in ROS: messages are merged joint by joint. One that
cannot be used never ends the stream: it is counted in the report. If a sender is restarted and its time stamps jump
back, its clock jumps ahead, or it differs by more than a second from that of the first sender, its times are continued
by the clock of this machine.
"""

from __future__ import annotations

import json
import math
import pathlib
import time
from collections.abc import Callable, Iterable
from dataclasses import replace
from types import TracebackType
from typing import TextIO

import mujoco
import numpy as np

from rr1plan.checks import (
    DEGREES,
    Array,
    check_callback,
    file_path,
    finite_number,
    of_kind,
    positive_number,
    read_only,
)
from rr1plan.errors import InputError
from rr1plan.files.file_access import writing
from rr1plan.mirror.corridor import Corridor, CorridorPosition, certified_corridor
from rr1plan.mirror.joint_states import StateMessage, StreamError
from rr1plan.mirror.message_reader import MessageReader
from rr1plan.mirror.mirror_page import MirrorPage
from rr1plan.mirror.mirror_report import MirrorEvent, MirrorReport, MirrorState, MirrorStatistics
from rr1plan.playback.simulation.mujoco_model import build_mujoco
from rr1plan.playback.viewer import Viewer, ViewOptions
from rr1plan.playback.viewer.view_options import checked_options
from rr1plan.scene import Scene
from rr1plan.trajectory import Trajectory

# Joints outside the plan that are farther than this from their assumed values void the proof [rad or m]. Smaller
# deviations, as of a step counter, use up distances of the corridor.
_MOVED = 1e-3
# The clock of the receiver was set back if a message arrives earlier than the one before by more than this [s].
_BACK = 1.0


class Mirror:
    """Follows a stream of joint states; use it in a `with` statement, or `close` it.

    There is a new state when all planning joints of the plan's arms (without a plan, of all arms) have been measured
    since the last one, in one message or several. Each joint is compared with the plan at the time of its measurement.
    If one of these joints is in no message for more than 1 s, this is a fault.

    The corridor is proven for the joints of the plan; other joints (of a gripper, of other arms) are assumed at their
    values in the scene. If a message has one of them elsewhere, by more than 1e-3 rad or m, nothing is proven, and this
    counts as outside.

    Args:
        scene: The scene; joints without messages keep their values in it.
        plan: The planned motion; None: states are not compared with a plan.
        corridor: The certified corridor of the plan (default: computed).
        start: Start of the plan, on the clock of the first sender [s] (default: at the first state).
        record: A file (.jsonl) for all messages, readable by `read_states`; emptied at the first message.
        on_event: Called with each `MirrorEvent`.

    Attributes:
        scene, plan, corridor: The arguments, with the computed corridor.
        model, data: MuJoCo's model and data, in the latest state.
        events: All events so far.
        state: The latest `MirrorState`; None before the first.

    Raises:
        InputError: a scene without arms, a plan that is in collision or of other joints, a corridor of other joints,
            a file that cannot be written, or a callback that is not callable.
        UnknownNameError: a plan for arms that the scene does not have.
    """

    def __init__(
        self,
        scene: Scene,
        plan: Trajectory | None = None,
        *,
        corridor: Corridor | None = None,
        start: float | None = None,
        record: str | pathlib.Path | None = None,
        on_event: Callable[[MirrorEvent], None] | None = None,
    ) -> None:
        of_kind("scene", scene, Scene)
        if not scene.arms:
            raise InputError("the scene has no arm to mirror")
        of_kind("plan", plan, Trajectory, optional=True)
        of_kind("corridor", corridor, Corridor, optional=True)
        check_callback("on_event", on_event)
        self.scene, self.plan = scene, plan
        self.corridor = certified_corridor(scene, plan) if corridor is None and plan is not None else corridor
        if self.corridor is not None and (plan is None or set(self.corridor.joint_names) != set(plan.joint_names)):
            raise InputError(f"the corridor is of other joints than the plan: {', '.join(self.corridor.joint_names)}")
        self._start = None if start is None else finite_number("start", start)
        # The latest message that has a time of arrival, and what is added to such times [s].
        self._arrived: StateMessage | None = None
        self._shift = 0.0
        self._on_event = on_event
        planned = () if self.corridor is None else self.corridor.joint_names
        self._reader = MessageReader(scene, scene.joint_names(None if plan is None else plan.arms))
        self._world = build_mujoco(scene)
        self.model: mujoco.MjModel = self._world.model
        self.data = mujoco.MjData(self.model)
        self.events: list[MirrorEvent] = []
        self.state: MirrorState | None = None
        self._statistics = MirrorStatistics(planned, np.zeros(len(planned)))
        self._page: MirrorPage | None = None
        self._closed = False
        self._record_path = None if record is None else _writable(record)
        self._record: TextIO | None = None

    def __enter__(self) -> Mirror:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the file and the page; may be called repeatedly. A closed mirror accepts no messages."""
        self._closed = True
        if self._page is not None:
            self._page.viewer.close()
        if self._record is not None:
            with writing(self._record.name):
                self._record.close()

    def show(self, *, options: ViewOptions | None = None) -> Viewer:
        """Open a live page that shows the arms as measured, with their deviation from the plan.

        A mirror has one page: an earlier one is closed.

        Args:
            options: How the page looks (default: `ViewOptions()`); the page neither plays nor plans.

        Raises:
            BackendError: no free port.
        """
        options = checked_options(options)
        if self._page is not None:
            self._page.viewer.close()
        self._page = MirrorPage(self.scene, self.plan, self._statistics.joint_names, options)
        self._draw()
        return self._page.viewer

    def run(self, stream: Iterable[StateMessage | StreamError], *, duration: float | None = None) -> MirrorReport:
        """Follow a stream to its end, for a time, or until Ctrl-C; another run continues a socket or a serial port.

        Args:
            stream: Messages, e.g. from `read_states`.
            duration: Longest time [s], by this machine's clock (default: no limit); the run ends with the next message
                or silence after it.

        Raises:
            InputError: a stream of other values, or a duration that is not above zero.
        """
        try:
            items = iter(stream)
        except TypeError as error:
            raise InputError(
                f"stream is of type {type(stream).__name__}, expected messages, as of read_states"
            ) from error
        end = math.inf if duration is None else time.monotonic() + positive_number("duration", duration)
        try:
            for item in items:
                self.receive(item)
                if time.monotonic() >= end:
                    break
        except KeyboardInterrupt:
            pass
        self._draw()
        return self.report()

    def receive(self, item: StateMessage | StreamError) -> MirrorState | None:
        """Process one message.

        Args:
            item: The message; an error of the stream is counted.

        Returns:
            The new state of the arms; None if there is none, because other joints are still to be measured, or because
            the message cannot be used; `events` gives the reason.

        Raises:
            InputError: a value other than a message, the mirror is closed, or its file cannot be written, as on a full
                disk.
        """
        if self._closed:
            raise InputError("the mirror is closed")
        if isinstance(item, StreamError):
            self._fault(item)
            self._draw_fault(silent=item.fault == "silence")
            return None
        of_kind("item", item, StateMessage)
        if self._record_path is not None:
            fields = {"time": item.time, "name": item.joint_names, "position": item.positions.tolist()}
            with writing(self._record_path):
                if self._record is None:
                    # Not earlier, because the file may be the one that the stream reads at its start.
                    self._record = self._record_path.open("w", encoding="utf-8")
                print(json.dumps(fields | {"received": item.received}), file=self._record, flush=True)
        item = self._with_continued_arrival(item)
        now, faults = self._reader.read(item)
        for fault in faults:
            self._fault(fault)
        if now is None:
            if faults:
                self._draw_fault(silent=False)
            return None
        arrival = now if item.received is None else item.received
        self._start = now if self._start is None else self._start
        q, positions = self._reader.configuration, self._reader.positions
        assumed = self._assumed(q, positions)
        moved = np.flatnonzero(np.abs(positions - assumed) > _MOVED).tolist()
        compared = self._compared(self._displacement(assumed, positions))
        names = tuple(self._reader.joints.names[i] for i in moved)
        state = MirrorState(now, read_only(q), *compared, self._contacts(positions), names)
        was_inside = self.state is None or self.state.corridor is None or self.state.proven_free
        self._statistics.add(state, arrival, was_inside)
        self._note_changes(state, was_inside)
        self.state = state
        self._draw(arrival)
        return state

    def report(self) -> MirrorReport:
        """The report on all messages so far."""
        arms = {} if self.corridor is None else self.scene.arms
        bare = tuple(f"{name}/{link}" for name, arm in arms.items() for link in arm.robot.unchecked_links)
        return self._statistics.report(self._reader.unmeasured, bare)

    # ---- inside --------------------------------------------------------------------------

    def _with_continued_arrival(self, message: StateMessage) -> StateMessage:
        """A message whose time of arrival goes on where the receiver's clock was set back, as in joined recordings."""
        if message.received is None:
            return message
        arrival, last = message.received + self._shift, self._arrived
        if last is not None and last.received is not None and arrival < last.received - _BACK:
            arrival = last.received + max(0.0, message.time - last.time)
            self._shift = arrival - message.received
        self._arrived = replace(message, received=arrival)
        return self._arrived

    def _draw(self, arrival: float | None = None) -> None:
        """Show the latest state on the page, if there is one; with a time of arrival it may be omitted."""
        if self._page is not None and self.state is not None:
            event = self.events[-1] if self.events else None
            self._page.draw(self.state, self._reader.positions, self._statistics, event, arrival)

    def _draw_fault(self, *, silent: bool) -> None:
        """Show a fault on the page."""
        if self._page is not None:
            event = self.events[-1] if self.events else None
            self._page.draw_fault(self.state, self._reader.positions, self._statistics, event, silent=silent)

    def _fault(self, error: StreamError) -> None:
        """Count a fault; consecutive faults of one kind are one event."""
        self._statistics.faults[error.fault] += 1
        if not self.events or self.events[-1].kind != error.fault:
            self._notice(MirrorEvent(self.state.time if self.state else 0.0, error.fault, error.message))

    def _notice(self, event: MirrorEvent) -> None:
        self.events.append(event)
        if self._on_event is not None:
            self._on_event(event)

    def _compared(self, displacement: float) -> tuple[Array | None, CorridorPosition | None]:
        """Deviation of each joint from the plan, and the position in the corridor with other bodies displaced [m]."""
        if self.plan is None or self.corridor is None or self._start is None:
            return None, None
        names = self.corridor.joint_names
        joints = self._reader.joints.indices(names)
        measured, times = self._reader.positions[joints], self._reader.times[joints]
        planned = self.plan(self.plan.start_time + times - self._start)
        planned = planned[np.arange(len(names)), [self.plan.joint_names.index(name) for name in names]]
        return read_only(self.corridor.deviation(measured, planned)), self.corridor.position(
            measured, displacement=displacement
        )

    def _assumed(self, q: Array, positions: Array) -> Array:
        """Positions of all movable joints that the corridor assumes while the planning joints are at q (nq,).

        Without a corridor these are the measured ones (n,).
        """
        if self.corridor is None:
            return positions
        others = [i for i, name in enumerate(self.scene.joint_names()) if name not in self.corridor.joint_names]
        assumed = np.array(q)
        assumed[others] = self.scene.configuration()[others]
        return self._reader.joints.expand(assumed)

    def _displacement(self, assumed: Array, positions: Array) -> float:
        """Bound on the displacement of any point of a body between two positions of all movable joints (n,) [m]."""
        if np.array_equal(assumed, positions):
            return 0.0
        data, poses = self.data, []
        for values in (assumed, positions):
            data.qpos[: len(values)] = values
            mujoco.mj_kinematics(self.model, data)
            poses.append((data.geom_xpos.copy(), data.geom_xmat.copy()))
        shift, turn = (np.linalg.norm(after - before, axis=1) for before, after in zip(*poses, strict=True))
        return float((shift + turn * self.model.geom_rbound).max(initial=0.0))

    def _contacts(self, positions: Array) -> tuple[tuple[str, str], ...]:
        """Pairs in contact according to MuJoCo, after setting all its joints to the measured positions (n,)."""
        self.data.qpos[: len(positions)] = positions  # loose bodies keep their initial poses
        mujoco.mj_forward(self.model, self.data)
        elements = self._world.geom_elements
        geoms, distances = self.data.contact.geom, self.data.contact.dist
        touching = geoms[self._world.forbidden(geoms) & (distances <= 0.0)].tolist()
        pairs = (sorted((elements[first], elements[second])) for first, second in touching)
        return tuple(sorted({(first, second) for first, second in pairs}))

    def _note_changes(self, state: MirrorState, was_inside: bool) -> None:
        """Record events that begin or end with a state."""
        is_inside = state.corridor is None or state.proven_free
        if was_inside and not is_inside and state.corridor is not None:
            why = f"{_reason(state)}{self._unit_hint(state.q)}"
            self._notice(MirrorEvent(state.time, "outside", f"left the certified corridor: {why}"))
        elif is_inside and not was_inside:
            self._notice(MirrorEvent(state.time, "inside", "inside the certified corridor again"))
        for pair in sorted(set(state.contacts) - set(self.state.contacts if self.state else ())):
            self._notice(MirrorEvent(state.time, "contact", f"{pair[0]} and {pair[1]} touch"))

    def _unit_hint(self, q: Array) -> str:
        """A hint if a joint that turns is outside its limits by more than half a turn, as in degrees; else empty."""
        limits, turns = self.scene.limits(), ~np.array(self._reader.joints.slides)
        over = np.maximum(limits.lower - q, q - limits.upper) > np.pi
        return f" {DEGREES}" if (over & turns[self._reader.joints.indices(self.scene.joint_names())]).any() else ""


def _reason(state: MirrorState) -> str:
    """Why a state outside the corridor is not proven free."""
    if state.moved:
        return f"it assumes {', '.join(state.moved)} elsewhere"
    if state.contacts:
        return f"{' and '.join(state.contacts[0])} touch"
    return f"{' and '.join(state.corridor.pair if state.corridor else ())} might touch"


def _writable(file: str | pathlib.Path) -> pathlib.Path:
    """The absolute path of a file that can be written, created if there is none."""
    path = file_path(file)
    with writing(path):
        path.open("a", encoding="utf-8").close()
        return path.absolute()
