"""The active controllers of a simulation, and their checked set-points of all joints."""

from __future__ import annotations

import weakref
from collections.abc import Callable
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array
from rr1plan.errors import ControllerError, InputError
from rr1plan.playback.simulation.controllers import Controller, JointInfo, JointState, SetPoint
from rr1plan.playback.simulation.joint_map import JointMap

_Argument = TypeVar("_Argument")
_Point = TypeVar("_Point", SetPoint, SetPoint | None)

# The set-points in which each active controller takes part.
_commanded_by: weakref.WeakKeyDictionary[Controller, weakref.ref[SetPoints]] = weakref.WeakKeyDictionary()


class Rows:
    """Arrays for several steps in reused memory, because allocating it takes longer than filling it.

    Args:
        shape: Shape of the array of one step.
    """

    def __init__(self, *shape: int) -> None:
        self._rows = np.empty((1, *shape))

    def take(self, count: int) -> Array:
        """Arrays for some steps, shape (count, *shape); overwrites those of the previous call."""
        if len(self._rows) < count:
            self._rows = np.empty((count, *self._rows.shape[1:]))
        return self._rows[:count]


class SetPoints:
    """The set-points of all joints, and the controllers that command them.

    Args:
        joints: The joints.
        dt: Time of a step [s].

    Attributes:
        active: Active controllers, with the indices of their joints.
        desired: Positions, velocities, accelerations and added efforts of all joints in the last step, shape (4, n).
    """

    def __init__(self, joints: JointMap, dt: float) -> None:
        self._joints, self._dt = joints, dt
        self._rows = Rows(4, len(joints.names))
        self.active: dict[Controller, NDArray[np.int64] | slice] = {}
        # Set-points of controllers that were updated in a step in which a later controller failed. If the step is
        # repeated, they are not updated again.
        self._updated: dict[Controller, list[Array | float]] = {}
        self.hold(np.zeros(len(joints.names)))

    def hold(self, positions: Array) -> None:
        """Reset to positions of all joints at rest, shape (n,)."""
        self.desired = np.zeros((4, len(positions)))
        self.desired[0] = positions
        # Whether joints that others mimic have been commanded.
        self._leading = False

    def activate(self, controller: Controller, state: JointState, *, replace: bool) -> None:
        """Let a controller command its joints.

        Args:
            controller: The controller.
            state: The state of all joints.
            replace: Deactivate the controllers that command some of its joints. If the activation fails, they stay.

        Raises:
            InputError: another controller commands one of its joints, a joint mimics another one, or the controller is
                active in another simulation.
            UnknownNameError: an unknown joint.
        """
        commanded = _commanded_by.get(controller, lambda: None)()
        if commanded is not None and commanded is not self:
            raise InputError(
                f"the {type(controller).__name__} of {controller.joint_names[0]!r} is active in another simulation; "
                "deactivate it there first, or make another controller"
            )
        joints, indices = self._joints, self._joints.indices(controller.joint_names)
        for name in controller.joint_names:
            if name in joints.followers:
                raise InputError(f"joint {name!r} mimics {joints.followers[name]!r}; command that one")
        replaced = self._conflicting(controller, replace)
        limits = joints.lower[indices], joints.upper[indices], joints.velocity[indices]
        controller.activate(JointInfo(controller.joint_names, *limits, self._dt), state_of_joints(state, indices))
        for other in replaced:
            self._remove(other)
        self.active.pop(controller, None)
        self._updated.pop(controller, None)
        self.active[controller] = as_slice(indices)
        self._leading = self._leading or joints.leads(indices)
        _commanded_by[controller] = weakref.ref(self)
        for other in replaced:
            other.deactivate()

    def _conflicting(self, controller: Controller, replace: bool) -> list[Controller]:
        """Other active controllers of its joints, which raise an error unless they are replaced."""
        found = []
        for other in self.active:
            shared = set(other.joint_names).intersection(controller.joint_names)
            if not shared or other is controller:
                continue
            if not replace:
                first = min(shared, key=self._joints.names.index)
                raise InputError(
                    f"joint {first!r} is commanded by an active {type(other).__name__}; deactivate it first, or "
                    "activate with replace=True"
                )
            found.append(other)
        return found

    def deactivate(self, controller: Controller) -> None:
        """Stop an active controller.

        Raises:
            InputError: it is not active.
        """
        if controller not in self.active:
            raise InputError("the controller is not active in this simulation")
        self._remove(controller)
        controller.deactivate()

    def _remove(self, controller: Controller) -> None:
        """Remove a controller; its joints hold their last commanded positions."""
        indices = self.active.pop(controller)
        self._updated.pop(controller, None)
        del _commanded_by[controller]
        for rates in self.desired[1:]:
            rates[indices] = 0.0

    def update(self, state: JointState) -> Array:
        """Set-points of the next step, shape (1, 4, n).

        Args:
            state: The state of all joints.

        Raises:
            ControllerError: a controller raised something or returned no set-points.
        """
        for controller, indices in list(self.active.items()):
            if controller in self._updated or controller not in self.active:
                continue
            point = _call(controller, controller.update, state_of_joints(state, indices), state.time)
            rows = _checked(controller, point, (len(controller.joint_names),), state.time)
            if controller in self.active:  # an update may deactivate controllers
                self._updated[controller] = rows
        for controller, rows in self._updated.items():
            for desired, values in zip(self.desired, rows, strict=True):
                desired[self.active[controller]] = values
        self._updated.clear()
        if self._leading:
            self._joints.follow_all(self.desired)
        return self.desired[None].copy()

    def preview(self, times: Array) -> Array | None:
        """Set-points of the next steps, shape (k, 4, n), overwritten by the next call.

        Args:
            times: Start times of the steps [s].

        Returns:
            Set-points of the first k steps; None if a controller needs the state for them, or was updated already.

        Raises:
            ControllerError: a controller raised something or returned no set-points.
        """
        if self._updated:
            return None
        most, now = len(times), float(times[0])
        desired = self._rows.take(most)
        desired[:] = self.desired
        for controller, indices in self.active.items():
            point = _call(controller, controller.preview, times[:most], now)
            if point is None:
                return None
            most = min(most, len(point.positions))
            if not most:
                raise ControllerError(f"{type(controller).__name__} previewed no set-points at {now:.3f} s")
            for row, values in enumerate(_checked(controller, point, (most, len(controller.joint_names)), now)):
                desired[:most, row, indices] = values
        if self._leading:
            self._joints.follow_all(desired)
        return desired[:most]

    def pass_over(self, times: Array, desired: Array, positions: Array) -> None:
        """Record that previewed set-points were commanded.

        Args:
            times: Start times of their steps [s], shape (k,).
            desired: The set-points, shape (k, 4, n).
            positions: Positions of all joints at these times, shape (k, n).

        Raises:
            ControllerError: a controller raised something.
        """
        self.desired = desired[-1].copy()
        failed: tuple[Controller, Exception] | None = None
        for controller, indices in list(self.active.items()):
            try:
                controller.passed(times, positions[:, indices])
            except Exception as error:
                failed = failed or (controller, error)
        if failed is not None:
            raise _failure(*failed, float(times[-1])) from failed[1]


def as_slice(indices: NDArray[np.int64]) -> NDArray[np.int64] | slice:
    """Consecutive indices as a slice, with which NumPy reads and writes several times faster; others unchanged."""
    first = int(indices[0]) if len(indices) else 0
    end = first + len(indices)
    return slice(first, end) if np.array_equal(indices, np.arange(first, end)) else indices


def state_of_joints(state: JointState, indices: NDArray[np.int64] | slice) -> JointState:
    """The state of some joints, a copy that controllers may change."""
    rows = (row[indices] for row in (state.positions, state.velocities, state.efforts))
    return JointState(state.time, *(row.copy() if isinstance(indices, slice) else row for row in rows))


def _call(controller: Controller, method: Callable[[_Argument], _Point], argument: _Argument, time: float) -> _Point:
    """The set-points that a method of a controller returns."""
    name = type(controller).__name__
    try:
        point = method(argument)
    except Exception as error:
        raise _failure(controller, error, time) from error
    if not isinstance(point, SetPoint) and not (point is None and method == controller.preview):
        raise ControllerError(f"{name} returned a {type(point).__name__} at {time:.3f} s, expected a SetPoint")
    return point


def _failure(controller: Controller, error: Exception, time: float) -> ControllerError:
    return ControllerError(f"{type(controller).__name__} raised {type(error).__name__} at {time:.3f} s: {error}")


def _checked(controller: Controller, point: SetPoint, shape: tuple[int, ...], time: float) -> list[Array | float]:
    """The arrays of set-points, checked; 0 for missing rates and efforts."""
    name = type(controller).__name__
    rows: list[Array | float] = []
    for field, values in zip(SetPoint._fields, point, strict=True):
        if values is None and field != "positions":
            rows.append(0.0)
            continue
        try:
            row = np.asarray(values, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise ControllerError(f"{name} returned {field} that are no numbers at {time:.3f} s") from error
        if row.shape != shape:
            raise ControllerError(f"{name} returned {field} of shape {row.shape} at {time:.3f} s, expected {shape}")
        if not np.isfinite(row).all():
            raise ControllerError(f"{name} returned {field} that are not finite at {time:.3f} s")
        rows.append(row)
    return rows
