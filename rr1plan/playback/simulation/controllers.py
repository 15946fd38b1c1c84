"""Controllers command the joints of a simulation at every step, as in `ros2_control`.

A controller claims some joints. At every step it receives their state and returns set-points. Joint servos follow them:
a PID with position and velocity set-points and a feed-forward torque from inverse dynamics. Your own controller is a
class with one method:

    class Sway(Controller):
        def update(self, state):
            return SetPoint(state.start + 0.1 * np.sin(state.time))

It can be used without a simulation as well: call `activate` once, then `update` with each state. The controllers of
this package can be commanded from any thread while the simulation runs.
"""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from rr1plan.checks import Array, finite_array
from rr1plan.errors import InputError
from rr1plan.path import check_joint_names
from rr1plan.thread_locks import exclusive, per_process


@dataclass(frozen=True, eq=False)
class JointInfo:
    """The joints that a controller has claimed.

    Args:
        names: Their names, "arm/joint", in the order of all arrays.
        lower, upper: Position limits [rad or m], shape (n,); -inf and inf if there are none.
        velocity: Highest speeds [rad/s or m/s], shape (n,).
        dt: Time between two updates [s].
    """

    names: tuple[str, ...]
    lower: Array
    upper: Array
    velocity: Array
    dt: float


class JointState(NamedTuple):
    """State of some joints at an instant, as in `sensor_msgs/JointState`.

    Args:
        time: Simulated time [s].
        positions: Positions [rad or m], shape (n,).
        velocities: Velocities [rad/s or m/s], shape (n,).
        efforts: Efforts of the servos in the last step [Nm or N], shape (n,).
    """

    time: float
    positions: Array
    velocities: Array
    efforts: Array


class _SetPointArrays(NamedTuple):
    positions: Array
    velocities: Array | None = None
    accelerations: Array | None = None
    efforts: Array | None = None


class SetPoint(_SetPointArrays):
    """Set-points for the servos of some joints; lists serve as arrays.

    Args:
        positions: Positions [rad or m], shape (n,).
        velocities: Velocities [rad/s or m/s], shape (n,); None: zero.
        accelerations: Accelerations for the feed-forward torque [rad/s² or m/s²], shape (n,); None: zero.
        efforts: Torques or forces to add to the feed-forward [Nm or N], shape (n,); None: zero.
    """

    __slots__ = ()

    if TYPE_CHECKING:  # accepted types; the fields above are arrays where this package reads them

        def __new__(
            cls,
            positions: ArrayLike,
            velocities: ArrayLike | None = None,
            accelerations: ArrayLike | None = None,
            efforts: ArrayLike | None = None,
        ) -> SetPoint:
            """Accept lists and arrays."""


class Controller(ABC):
    """Commands some joints; the base of all controllers.

    Args:
        joint_names: The joints to claim, "arm/joint".

    Attributes:
        joint_names: The claimed joints.
        joints: Limits and step, from `activate` to `deactivate`.

    Raises:
        InputError: no joints, or a joint twice.
    """

    joints: JointInfo

    def __init_subclass__(cls, **options: object) -> None:
        super().__init_subclass__(**options)
        # An inherited preview does not match an overridden `update`.
        if "update" in cls.__dict__ and "preview" not in cls.__dict__:
            cls.preview = Controller.preview  # type: ignore[method-assign]

    def __init__(self, joint_names: Sequence[str]) -> None:
        self.joint_names = check_joint_names(joint_names, empty=False)
        # Held by commands of other threads, and by the methods that the simulation calls.
        self._lock = per_process(self, "_lock", threading.RLock)

    def activate(self, joints: JointInfo, state: JointState) -> None:
        """Take over the joints; called before the updates, and again after a reset.

        Args:
            joints: The joints, in the order of `joint_names`.
            state: Their state.
        """
        self.joints = joints

    def deactivate(self) -> None:
        """Release the joints, to another controller or to none; not called before a reset."""
        del self.joints

    @abstractmethod
    def update(self, state: JointState) -> SetPoint:
        """The set-points until the next update.

        Args:
            state: The state of the joints, in the order of `joint_names`.
        """

    def preview(self, times: Array) -> SetPoint | None:
        """Set-points of the next updates, if they do not depend on the state.

        A simulation may command them without an `update` for each, which is faster. This method is optional.

        Args:
            times: Simulated times of the next updates [s], shape (k,).

        Returns:
            Set-points of the first m updates, arrays of shape (m, n), m <= k; None if the next one needs the state.
        """
        return None

    def passed(self, times: Array, positions: Array) -> None:  # noqa: B027  (most controllers have nothing to note)
        """Called after set-points of the last `preview` were commanded without calls of `update`.

        An exception ends the run after these steps.

        Args:
            times: Simulated times of these updates [s], shape (m,); there may be fewer than in the preview.
            positions: Positions of the joints at these times, in the order of `joint_names`, shape (m, n).
        """

    def check_active(self) -> None:
        """Require that `activate` was called.

        Raises:
            InputError: it was not.
        """
        if not hasattr(self, "joints"):
            raise InputError("the controller is not active; activate it in a simulation first")

    def check_positions(self, positions: Array) -> None:
        """Require that positions are within the limits of the joints.

        Args:
            positions: Positions [rad or m], shape (..., n).

        Raises:
            InputError: a position is out of limits, with the name of its joint, or the controller is not active.
        """
        self.check_active()
        joints = self.joints
        over = np.maximum(positions - joints.upper, joints.lower - positions).reshape(-1, len(joints.names))
        worst = over.max(axis=0, initial=-np.inf)
        if (worst > _TOLERANCE).any():
            i = int(np.argmax(worst))
            raise InputError(
                f"joint {joints.names[i]!r} is commanded {worst[i]:.3g} beyond its limits "
                f"[{joints.lower[i]:.4g}, {joints.upper[i]:.4g}]"
            )


_TOLERANCE = 1e-6  # rounding of trajectories that end at a limit [rad or m]


def clip_positions(joints: JointInfo, positions: Array, before: Array) -> Array:
    """Positions within the limits of joints, or no farther beyond them than before, so that no joint jumps.

    Args:
        joints: The joints.
        positions: Positions to clip [rad or m], shape (n,).
        before: Positions one step before, possibly beyond the limits [rad or m], shape (n,).
    """
    return np.clip(positions, np.minimum(joints.lower, before), np.maximum(joints.upper, before))


class ForwardPositionController(Controller):
    """Forwards commanded positions, as `position_controllers/JointGroupPositionController` does.

    Before the first command it holds the positions at activation. A command is a step: the servos follow it as fast as
    their efforts allow.

    Args:
        joint_names: The joints to claim, "arm/joint".
    """

    _command: Array

    @exclusive
    def activate(self, joints: JointInfo, state: JointState) -> None:
        """Hold the present positions until the first command."""
        super().activate(joints, state)
        self._command = state.positions.copy()

    @exclusive
    def command(self, positions: ArrayLike) -> None:
        """Set the positions from the next update on.

        Args:
            positions: Positions [rad or m], shape (n,).

        Raises:
            InputError: another shape, not finite, out of limits, or a controller that is not active.
        """
        target = finite_array("positions", positions, (len(self.joint_names),))
        self.check_positions(target)
        self._command = target

    @exclusive
    def update(self, state: JointState) -> SetPoint:
        """The last command."""
        return SetPoint(self._command)


class ForwardVelocityController(Controller):
    """Forwards commanded velocities, as `velocity_controllers/JointGroupVelocityController` does.

    Positions are integrated from them and stop at the position limits. A joint that is beyond a limit at activation can
    only move back.

    Args:
        joint_names: The joints to claim, "arm/joint".
    """

    _positions: Array
    _command: Array

    @exclusive
    def activate(self, joints: JointInfo, state: JointState) -> None:
        """Hold the present positions until the first command."""
        super().activate(joints, state)
        self._positions = state.positions.copy()
        self._command = np.zeros(len(joints.names))

    @exclusive
    def command(self, velocities: ArrayLike) -> None:
        """Set the velocities from the next update on.

        Args:
            velocities: Velocities [rad/s or m/s], shape (n,).

        Raises:
            InputError: another shape, not finite, above the limits, or a controller that is not active.
        """
        target = finite_array("velocities", velocities, (len(self.joint_names),))
        self.check_active()
        over = np.abs(target) - self.joints.velocity
        if (over > _TOLERANCE).any():
            i = int(np.argmax(over))
            name, limit = self.joint_names[i], self.joints.velocity[i]
            raise InputError(f"joint {name!r} is commanded {target[i]:.4g} per second, above its limit of {limit:.4g}")
        self._command = target

    @exclusive
    def update(self, state: JointState) -> SetPoint:
        """The next positions on the way."""
        wanted = self._positions + self._command * self.joints.dt
        positions = clip_positions(self.joints, wanted, self._positions)
        self._positions = positions
        return SetPoint(positions, np.where(positions == wanted, self._command, 0.0))
