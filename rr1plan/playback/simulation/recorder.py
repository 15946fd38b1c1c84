"""Records of simulations: motions of joints and loose bodies, for pages and measurements."""

from __future__ import annotations

import time
from contextlib import AbstractContextManager

import numpy as np

from rr1plan.checks import Array, of_kind, positive_number
from rr1plan.errors import InputError
from rr1plan.playback.simulation.replay import BodyMotion, Replay, ReplayRecord
from rr1plan.playback.simulation.replay_notes import replay_remarks, replay_settings
from rr1plan.playback.simulation.simulation import Simulation
from rr1plan.scene import Obstacle
from rr1plan.scene.joint_units import joint_units
from rr1plan.thread_locks import exclusive
from rr1plan.transforms import position_and_quaternion

_RESET = (
    "the simulation was reset, or its joints were placed, while it was recorded, so its record has no single clock; "
    "call Recorder.stop first, and record what follows with another Recorder"
)


class BodyLog:
    """Collects poses of loose bodies; bodies may be added, removed, attached and detached between instants.

    A body of other shapes under the name of an earlier one is recorded as "name (2)".
    """

    def __init__(self) -> None:
        self._bodies: dict[str, Obstacle] = {}
        self._recorded_as: dict[str, str] = {}
        self._rows: list[dict[str, Array]] = []

    def add(self, sim: Simulation) -> None:
        """Add the current poses."""
        row = {}
        for name in sim.body_names:
            row[self._record_name(name, sim)] = sim.body_coordinates(name)
        for name in self._recorded_as.keys() & sim.scene.attachments.keys():
            held = sim.current_scene.detach(name).obstacles[name]
            row[self._recorded_as[name]] = position_and_quaternion(held.pose)
        self._rows.append(row)

    def _record_name(self, name: str, sim: Simulation) -> str:
        body, number, known = sim.scene.obstacles[name], 1, name
        while (known in self._bodies and self._bodies[known].geometries != body.geometries) or (
            number > 1 and known in sim.body_names
        ):
            number += 1
            known = f"{name} ({number})"
        self._bodies.setdefault(known, body)
        self._recorded_as[name] = known
        return known

    def drop_last(self) -> None:
        """Remove the poses that were added last."""
        self._rows.pop()

    def motion(self) -> BodyMotion | None:
        """All poses so far; None if there were no bodies."""
        if not self._bodies:
            return None
        gone = np.full(7, np.nan)
        poses = np.array([[row.get(name, gone) for name in self._bodies] for row in self._rows])
        return BodyMotion(self._bodies, poses)


class Recorder:
    """Records a simulation from now on, until `stop`.

        with rp.Recorder(sim) as recorder:
            sim.run(duration=5.0)
        rp.save_html("run.html", scene, replay=recorder.replay())

    Other threads may call `replay` and `stop` while the simulation runs.

    Args:
        sim: The simulation; its first step after a `reset` or `place` while it is recorded raises an `InputError`.
        dt: Time between recorded instants [s]; tracking errors and efforts are measured at every step. Positions are
            compared with the set-points of the step that starts at the same instant. The last instant is always
            recorded; as no step starts there, it has the set-points of the last step.

    Raises:
        InputError: not a simulation, or a time that is not above zero.
    """

    def __init__(self, sim: Simulation, dt: float = 0.02) -> None:
        of_kind("sim", sim, Simulation)
        self._sim, self._stride = sim, max(1, round(positive_number("dt", dt) / sim.dt))
        self._names = sim.scene.joint_names() if sim.scene.arms else ()
        self._columns = np.array([sim.joint_names.index(name) for name in self._names], dtype=np.int64)
        self._limits = sim.effort_limits[self._columns]
        self._wall = time.perf_counter()
        self._times: list[float] = []
        self._rows: list[Array] = []
        self._max_error, self._square, self._effort = np.zeros((3, len(self._names)))
        self._bodies = BodyLog()
        self._recording, self._was_reset = True, False
        self._final: Replay | None = None
        with self._lock:
            self._begin = self._end = sim.steps
            self._before = sim.positions
            self._remove = sim.on_step(self._note)
            self._keep()

    @property
    def _lock(self) -> AbstractContextManager[bool]:
        """That of the simulation, because a controller may call `replay` within a step, which holds it."""
        return self._sim._lock

    def __enter__(self) -> Recorder:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    @exclusive
    def stop(self) -> None:
        """Stop recording; the simulation may continue without changing the record."""
        if not self._recording:
            return
        self._recording = False
        self._remove()
        self._was_reset |= self._sim.steps < self._end
        self._final = None if self._was_reset else self._present()

    @exclusive
    def replay(self) -> Replay:
        """The record so far, or until `stop`, as `simulate` returns it.

        Raises:
            InputError: the simulation was reset while it was recorded.
        """
        if self._final is not None:
            return self._final
        if self._was_reset or self._sim.steps < self._end:
            raise InputError(_RESET)
        return self._present()

    def _present(self) -> Replay:
        """The record up to the present instant."""
        steps, begin = self._end - self._begin, self._times[0]
        # If another callback failed, the present state belongs to a step that was not noted.
        extra = steps % self._stride > 0 and self._sim.steps == self._end
        if extra:
            self._keep()
        rows = np.array(self._rows)
        record = ReplayRecord(np.array(self._times), rows[:, 0], rows[:, 1], self._bodies.motion())
        if extra:
            self._times.pop()
            self._rows.pop()
            self._bodies.drop_last()
        return Replay(
            mode="dynamic",
            joint_names=self._names,
            record=record,
            # A copy, because a replay makes its arrays read-only.
            max_error=self._max_error.copy(),
            rms_error=np.sqrt(self._square / max(1, steps)),
            peak_effort=self._effort / self._limits,
            contacts=tuple(contact for contact in self._sim.contacts if contact.last >= begin),
            steps=steps,
            timestep=self._sim.dt,
            wall_seconds=time.perf_counter() - self._wall,
            settings=replay_settings(self._sim),
            remarks=replay_remarks(self._sim),
            units=tuple(joint_units(self._names, self._sim.scene)),
        )

    @exclusive
    def _note(self, sim: Simulation) -> None:
        if self._was_reset or sim.steps <= self._end:
            self._was_reset = True
            raise InputError(_RESET)
        self._end = sim.steps
        # These set-points are for the start of the step; those for its end are not known yet.
        desired = sim.set_points[self._columns]
        error = self._before[self._columns] - desired
        self._before = sim.positions
        if (sim.steps - 1 - self._begin) % self._stride == 0:
            self._rows[-1][0] = desired
        np.maximum(self._max_error, np.abs(error), out=self._max_error)
        self._square += error**2
        np.maximum(self._effort, np.abs(sim.efforts[self._columns]), out=self._effort)
        if (sim.steps - self._begin) % self._stride == 0:
            self._keep()

    def _keep(self) -> None:
        sim = self._sim
        self._times.append(sim.time)
        self._rows.append(np.array([sim.set_points[self._columns], sim.positions[self._columns]]))
        self._bodies.add(sim)
