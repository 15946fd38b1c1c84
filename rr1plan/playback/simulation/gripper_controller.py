"""A gripper controller: opens and closes at a speed, and reports whether it has arrived or stalled on an object."""

from __future__ import annotations

import enum
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from rr1plan.checks import Array, finite_array, positive_number
from rr1plan.playback.simulation.controllers import Controller, JointInfo, JointState, SetPoint
from rr1plan.thread_locks import exclusive


class GripperStatus(enum.Enum):
    """The state of a gripper's last command."""

    MOVING = "moving"
    ARRIVED = "arrived"
    STALLED = "stalled"


class GripperController(Controller):
    """Moves fingers at a speed until they arrive or stall, as `gripper_action_controller` does.

    Stalled fingers keep pushing with the effort of their servos and so hold an object.

    Args:
        joint_names: The joints of the fingers, "arm/joint"; those that mimic them follow.
        speed: Speed of the fingers [rad/s or m/s], at most the velocity limits of their joints.
        tolerance: Largest distance from the command at which fingers count as arrived [rad or m].
        stall_speed: Fingers stall if none is faster than this [rad/s or m/s] ...
        stall_time: ... for this long [s] after their set-points have arrived.

    Attributes:
        status: State of the last command.
    """

    _command: Array
    _positions: Array

    def __init__(
        self,
        joint_names: Sequence[str],
        *,
        speed: float = 1.0,
        tolerance: float = 0.005,
        stall_speed: float = 0.002,
        stall_time: float = 0.05,
    ) -> None:
        super().__init__(joint_names)
        self.speed, self.tolerance = positive_number("speed", speed), positive_number("tolerance", tolerance)
        self.stall_speed = positive_number("stall_speed", stall_speed)
        self.stall_time = positive_number("stall_time", stall_time)
        self.status = GripperStatus.ARRIVED

    @exclusive
    def activate(self, joints: JointInfo, state: JointState) -> None:
        """Hold the present positions until the first command."""
        super().activate(joints, state)
        self._positions = self._command = state.positions.copy()
        self._quiet = 0.0
        self.status = GripperStatus.ARRIVED

    @exclusive
    def command(self, positions: ArrayLike) -> None:
        """Move the fingers from the next update on.

        Args:
            positions: Target positions [rad or m], shape (n,).

        Raises:
            InputError: another shape, not finite, out of limits, or a controller that is not active.
        """
        target = finite_array("positions", positions, (len(self.joint_names),))
        self.check_positions(target)
        self._command, self._quiet = target, 0.0
        self.status = GripperStatus.MOVING

    @exclusive
    def update(self, state: JointState) -> SetPoint:
        """The next positions on the way."""
        most = np.minimum(self.speed, self.joints.velocity) * self.joints.dt
        step = np.clip(self._command - self._positions, -most, most)
        self._positions = self._positions + step
        if self.status is not GripperStatus.ARRIVED:
            slow = not step.any() and bool((np.abs(state.velocities) <= self.stall_speed).all())
            self._quiet = self._quiet + self.joints.dt if slow else 0.0
            if (np.abs(state.positions - self._command) <= self.tolerance).all():
                self.status = GripperStatus.ARRIVED
            elif self._quiet >= self.stall_time:
                self.status = GripperStatus.STALLED
        return SetPoint(self._positions, step / self.joints.dt)
