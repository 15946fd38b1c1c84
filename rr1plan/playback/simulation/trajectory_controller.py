"""Execution of trajectories: a joint trajectory controller with tolerances, preemption and a terminal result."""

from __future__ import annotations

import enum
import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array, counted, finite_number, number_array, of_kind, shown
from rr1plan.errors import InputError
from rr1plan.kernels.planner_kernels import load_library
from rr1plan.playback.simulation.controllers import Controller, JointInfo, JointState, SetPoint
from rr1plan.thread_locks import exclusive
from rr1plan.trajectory import Trajectory, locate

# Number of updates whose set-points are evaluated at once; small enough for the cache with many arms.
_BLOCK = 32
# Number of values of a trajectory that are checked at once.
_CHECKED = 200_000
# Tolerance for rounding of sums of time steps [s].
_ROUNDING = 1e-9


class ExecutionStatus(enum.Enum):
    """The state of the execution of a trajectory."""

    WAITING = "waiting"
    ACTIVE = "active"
    SUCCEEDED = "succeeded"
    PREEMPTED = "preempted"
    CANCELED = "canceled"
    START_TOLERANCE_VIOLATED = "start tolerance violated"
    PATH_TOLERANCE_VIOLATED = "path tolerance violated"
    GOAL_TOLERANCE_VIOLATED = "goal tolerance violated"

    @property
    def terminal(self) -> bool:
        """Whether the execution has ended."""
        return self not in (ExecutionStatus.WAITING, ExecutionStatus.ACTIVE)


# Error codes of `control_msgs/FollowJointTrajectory`, where one exists.
_CODES = {
    ExecutionStatus.SUCCEEDED: 0,
    ExecutionStatus.START_TOLERANCE_VIOLATED: -1,
    ExecutionStatus.PATH_TOLERANCE_VIOLATED: -4,
    ExecutionStatus.GOAL_TOLERANCE_VIOLATED: -5,
}


@dataclass(eq=False)
class Execution:
    """The execution of one trajectory by a `JointTrajectoryController`.

    Args:
        trajectory: The trajectory.
        start: Planned start time, then the actual one [s, simulated].
        status: The present status.
        message: Why it ended without success.
        ended: End time [s, simulated]; nan before the end.
        max_error: Largest tracking error of each joint so far [rad or m], shape (n,), columns of the trajectory.
    """

    trajectory: Trajectory
    start: float
    status: ExecutionStatus = ExecutionStatus.WAITING
    message: str = ""
    ended: float = math.nan
    max_error: Array = field(default_factory=lambda: np.zeros(0))

    @property
    def code(self) -> int | None:
        """The error code of `control_msgs/FollowJointTrajectory`; None while it runs, or if there is no such code."""
        return _CODES.get(self.status)

    def __bool__(self) -> bool:
        """Whether it succeeded."""
        return self.status is ExecutionStatus.SUCCEEDED

    def __repr__(self) -> str:
        return f"Execution({self.status.value}{f': {self.message}' if self.message else ''})"


class JointTrajectoryController(Controller):
    """Follows trajectories, as `joint_trajectory_controller` does.

    `Trajectory.from_samples` interpolates points linearly, cubically or quintically, depending on their derivatives.
    Between trajectories the controller holds its last set-point. A trajectory that violates a tolerance is aborted; the
    controller then holds the measured position (path tolerance) or the goal (goal tolerance), or continues what it did
    before (start tolerance). Zero is a tolerance like any other here; in ROS it means any error, or to wait forever.

    Args:
        joint_names: The joints to claim, "arm/joint".
        start_tolerance: Largest difference between the set-points and the start of a trajectory [rad or m]; inf: any.
        path_tolerance: Largest tracking error along the path, before its end [rad or m]; inf: any.
        goal_tolerance: Largest tracking error at the goal [rad or m]; inf: any.
        goal_time: Time after the end of a trajectory within which the joints have to be within the goal tolerance [s];
            inf: wait forever.

    Raises:
        InputError: no joints, a joint twice, or a tolerance that is not a number of zero or more.
    """

    _active: Execution | None
    # Those that wait for their start, in order of time.
    _queued: list[Execution]
    # Time of the next update [s].
    _next: float
    # The active trajectory, with columns in the order of this controller's joints.
    _path: Trajectory
    # Positions, velocities and accelerations of its updates from number `_first` on, shape (3, _BLOCK, n).
    _block: Array
    _first: int

    def __init__(
        self,
        joint_names: Sequence[str],
        *,
        start_tolerance: float = 0.01,
        path_tolerance: float = math.inf,
        goal_tolerance: float = 0.01,
        goal_time: float = 1.0,
    ) -> None:
        super().__init__(joint_names)
        self.start_tolerance = _tolerance("start_tolerance", start_tolerance)
        self.path_tolerance = _tolerance("path_tolerance", path_tolerance)
        self.goal_tolerance = _tolerance("goal_tolerance", goal_tolerance)
        self.goal_time = _tolerance("goal_time", goal_time)
        self._active, self._queued = None, []

    @exclusive
    def activate(self, joints: JointInfo, state: JointState) -> None:
        """Hold the present positions, and cancel the current trajectory."""
        super().activate(joints, state)
        self._end_all(state.time, "the controller was activated again")
        self._active = None
        self._next = state.time
        self._hold = SetPoint(state.positions.copy())
        self._last = self._hold

    @exclusive
    def deactivate(self) -> None:
        """Release the joints, and cancel the current trajectory."""
        super().deactivate()
        self._end_all(self._next, "the controller was deactivated")
        self._active = None

    def _end_all(self, time: float, message: str) -> None:
        """Cancel all executions."""
        if self._active is not None:
            _end(self._active, ExecutionStatus.CANCELED, time, message)
        for execution in self._queued:
            _end(execution, ExecutionStatus.CANCELED, time, message)
        self._queued = []

    @exclusive
    def send(self, trajectory: Trajectory, *, at: float | None = None) -> Execution:
        """Execute a trajectory; the current one is preempted when the new one begins.

        Trajectories that wait for an earlier start remain, those that would begin at the same update or later are
        preempted at once. A trajectory that begins at the next update is checked against the start tolerance here, a
        later one when it begins.

        Args:
            trajectory: A trajectory of the joints of this controller, in any order; its start time maps to the start.
            at: Start time [s, simulated] (default: the next update).

        Returns:
            The execution, updated while the simulation runs.

        Raises:
            InputError: different joints, positions beyond limits, a time that has passed, a controller that is not
                active, or a start farther from the set-points than `start_tolerance`.
        """
        of_kind("trajectory", trajectory, Trajectory)
        self.check_active()
        if set(trajectory.joint_names) != set(self.joint_names):
            odd = sorted(set(trajectory.joint_names) ^ set(self.joint_names))
            whose = "the trajectory" if odd[0] in trajectory.joint_names else "the controller"
            raise InputError(f"trajectory and controller have different joints: only {whose} has {odd[0]!r}")
        start = self._next if at is None else finite_number("at", at)
        if start < self._next - _ROUNDING:
            raise InputError(f"at is {start:g} s, which has passed: it is {self._next:g} s")
        columns = _columns(trajectory, self.joint_names)
        times = trajectory.sample_times(max(self.joints.dt, trajectory.duration / 1e6))
        count = max(1, _CHECKED // len(columns))
        for first in range(0, len(times), count):
            self.check_positions(trajectory(times[first : first + count])[:, columns])
        half = 0.5 * self.joints.dt
        if start <= self._next + half and (fault := self._start_fault(trajectory, columns, self._last.positions)):
            raise InputError(f"{fault}; put the joints there first (Simulation.place), or raise start_tolerance")
        execution = Execution(trajectory, start, max_error=np.zeros(len(columns)))
        while self._queued and self._queued[-1].start > start - half:
            _end(self._queued.pop(), ExecutionStatus.PREEMPTED, self._next, "a newer trajectory was sent")
        self._queued.append(execution)
        return execution

    @exclusive
    def cancel(self) -> None:
        """Cancel all trajectories, and hold the position at the next update."""
        self._end_all(self._next, "by its caller")

    @exclusive
    def update(self, state: JointState) -> SetPoint:
        """The point of the trajectory at this time, or the position to hold."""
        point = self._follow(state)
        while self._queued and state.time >= self._queued[0].start - 0.5 * self.joints.dt:
            if self._begin(self._queued.pop(0), point.positions, state.time):
                point = self._follow(state)
        self._last, self._next = point, state.time + self.joints.dt
        return point

    def _follow(self, state: JointState) -> SetPoint:
        """The point of the active trajectory, whose tolerances are checked, or the position to hold."""
        execution = self._active
        if execution is None:
            return self._hold
        if execution.status.terminal:
            return self._stop(SetPoint(state.positions.copy()))
        since = state.time - execution.start
        point = SetPoint(*self._points(since, 1)[:, 0].copy())
        error = np.abs(state.positions - point.positions)
        self._note_error(execution, error)
        if since >= execution.trajectory.duration - _ROUNDING:
            ended = self._check_goal(execution, error, since, state.time)
            return self._stop(SetPoint(point.positions)) if ended else point
        if error.max() > self.path_tolerance:
            message = self._worst(error, self.path_tolerance)
            _end(execution, ExecutionStatus.PATH_TOLERANCE_VIOLATED, state.time, message)
            return self._stop(SetPoint(state.positions.copy()))
        return point

    @exclusive
    def preview(self, times: Array) -> SetPoint | None:
        """Set-points up to the end of a trajectory without a path tolerance, or the position to hold.

        Later calls overwrite the arrays.
        """
        execution = self._active
        if self._queued:
            return None
        if execution is None:
            return SetPoint(np.broadcast_to(self._hold.positions, (len(times), len(self.joint_names))))
        since = times - execution.start
        count = int((since < execution.trajectory.duration - _ROUNDING).sum())
        if execution.status.terminal or self.path_tolerance < math.inf or not count:
            return None
        return SetPoint(*self._points(float(since[0]), count))

    @exclusive
    def passed(self, times: Array, positions: Array) -> None:
        """Record the tracking errors at points of the trajectory."""
        self._next = float(times[-1]) + self.joints.dt
        execution = self._active
        if execution is None:
            return
        points = self._points(float(times[0]) - execution.start, len(times))
        self._note_error(execution, np.abs(positions - points[0]).max(axis=0))
        self._last = SetPoint(*points[:, -1].copy())

    def _note_error(self, execution: Execution, error: Array) -> None:
        ordered = error if self._back is None else error[self._back]
        np.maximum(execution.max_error, ordered, out=execution.max_error)

    def _begin(self, execution: Execution, positions: Array, now: float) -> bool:
        """Replace the active trajectory.

        Args:
            execution: The execution to begin.
            positions: Set-points without it at this update [rad or m], shape (n,).
            now: Time of this update [s].

        Returns:
            Whether its start is within the tolerance; otherwise it ends, and the active one continues.
        """
        columns = _columns(execution.trajectory, self.joint_names)
        # The start is moved to this update, so that the first set-point is the start of the trajectory.
        execution.start = now
        if fault := self._start_fault(execution.trajectory, columns, positions):
            _end(execution, ExecutionStatus.START_TOLERANCE_VIOLATED, now, fault)
            return False
        if self._active is not None:
            _end(self._active, ExecutionStatus.PREEMPTED, now, "a newer trajectory began")
        self._active = execution
        execution.status = ExecutionStatus.ACTIVE
        trajectory = execution.trajectory
        coefficients = trajectory.coefficients.take(columns, axis=2)
        self._path = Trajectory(self.joint_names, trajectory.breaks, coefficients)
        in_order = np.array_equal(columns, np.arange(len(columns)))
        self._back = None if in_order else np.argsort(columns)
        self._block, self._first = np.empty((3, _BLOCK, len(columns))), -_BLOCK
        return True

    def _start_fault(self, trajectory: Trajectory, columns: NDArray[np.int64], positions: Array) -> str:
        """Why the start of a trajectory is too far from positions and from the last set-points, or an empty text.

        Either may have been the basis of the trajectory; a fast joint moves farther than the tolerance in one step.
        """
        start = trajectory(trajectory.start_time)[columns]
        gap = np.minimum(np.abs(start - positions), np.abs(start - self._last.positions))
        if (gap <= self.start_tolerance).all():
            return ""
        return f"the trajectory begins elsewhere: {self._worst(gap, self.start_tolerance)}"

    def _check_goal(self, execution: Execution, error: Array, since: float, now: float) -> bool:
        """End an execution whose joints are at the goal, or whose goal time is over; returns whether it ended."""
        over = since - execution.trajectory.duration
        if (error <= self.goal_tolerance).all():
            _end(execution, ExecutionStatus.SUCCEEDED, now, "")
        elif over > self.goal_time + _ROUNDING:
            message = f"{over:.3g} s after the end {self._worst(error, self.goal_tolerance)}"
            _end(execution, ExecutionStatus.GOAL_TOLERANCE_VIOLATED, now, message)
        else:
            return False
        return True

    def _stop(self, hold: SetPoint) -> SetPoint:
        """End the active trajectory, and hold a position."""
        self._active, self._hold = None, hold
        return hold

    def _points(self, since: float, most: int) -> Array:
        """Positions, velocities and accelerations of some updates from a time on, shape (3, up to `most`, n).

        A block of updates is evaluated at once. Times derive from update numbers, so that values do not depend on the
        blocks.
        """
        number = round(since / self.joints.dt)
        k, most = number - self._first, min(most, _BLOCK)
        if not 0 <= k <= _BLOCK - most:
            self._first, k = number, 0
            _sample(self._path, self.joints.dt * np.arange(number, number + _BLOCK, dtype=np.float64), self._block)
        return self._block[:, k : k + most]

    def _worst(self, error: Array, tolerance: float) -> str:
        i = int(np.argmax(error))
        many = counted(int((error > tolerance).sum()), "joint")
        return f"{many} off, {self.joint_names[i]!r} by {error[i]:.3g} (tolerance {tolerance:g})"


def _tolerance(name: str, value: object) -> float:
    """`value` as a float of zero or more, possibly inf."""
    number = number_array(name, value, "a number")
    if number.ndim or not number >= 0.0:
        raise InputError(f"{name} is {shown(value)}, expected a number >= 0")
    return float(number)


def _columns(trajectory: Trajectory, names: Sequence[str]) -> NDArray[np.int64]:
    """The columns of some joints in a trajectory."""
    column = {name: i for i, name in enumerate(trajectory.joint_names)}
    return np.array([column[name] for name in names], dtype=np.int64)


def _sample(path: Trajectory, since: Array, out: Array) -> None:
    """Write positions, velocities and accelerations of `path` at times since its start [s] to `out`, (3, k, n)."""
    times = path.start_time + since
    piece, local = locate(path.breaks, times)
    terms, columns = path.coefficients.shape[1:]
    load_library().rr1_sample_pieces(path.coefficients, terms, columns, piece, local, len(times), out)
    out[1:, times > path.end_time] = 0.0


def _end(execution: Execution, status: ExecutionStatus, time: float, message: str) -> None:
    if not execution.status.terminal:
        execution.status, execution.ended, execution.message = status, time, message
