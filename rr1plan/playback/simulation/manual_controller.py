"""Manual control: joints that follow sliders and keys at a bounded speed and acceleration."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from rr1plan.checks import Array, check_text, finite_array, finite_number, known_name, positive_number
from rr1plan.errors import InputError
from rr1plan.playback.simulation.controllers import Controller, JointInfo, JointState, SetPoint, clip_positions
from rr1plan.thread_locks import exclusive

# Highest speed of joints without a limit [rad/s or m/s].
_SPEED = 1.0
# Time to reach the highest speed [s].
_RAMP = 0.2
# Distance from the target that is rounding [rad or m].
_ROUNDING = 1e-12


class ManualController(Controller):
    """Moves joints by hand, like the panel of RQt's joint trajectory controller.

        viewer.on_slider(manual.move)          # the sliders of a live page, with mouse or arrow keys
        manual.press("2"); manual.press("+")   # keys of a terminal: choose a joint, move it by a step

    Every joint moves to its last target at a fraction of its highest speed, which it reaches in 0.2 s; a new target is
    approached from the present speed.

    Args:
        joint_names: The joints to claim, "arm/joint".
        speed: Fraction of the highest speed, above 0 and at most 1.
        step: Displacement of a joint per key [rad or m].

    Attributes:
        selected: The joint that "+" and "-" move.

    Raises:
        InputError: no joints, a speed out of range, or a step that is not above zero.
    """

    _target: Array
    _positions: Array
    _velocities: Array

    def __init__(self, joint_names: Sequence[str], *, speed: float = 0.25, step: float = 0.05) -> None:
        super().__init__(joint_names)
        self.speed, self.step = positive_number("speed", speed), positive_number("step", step)
        if self.speed > 1.0:
            raise InputError(f"speed is {speed:g}, expected at most 1, a part of the highest speed")
        self.selected = self.joint_names[0]

    @exclusive
    def activate(self, joints: JointInfo, state: JointState) -> None:
        """Hold the present positions until the first command."""
        super().activate(joints, state)
        self._target, self._positions = state.positions.copy(), state.positions.copy()
        self._velocities = np.zeros(len(joints.names))

    @exclusive
    def command(self, positions: ArrayLike) -> None:
        """Set the targets of all joints.

        Args:
            positions: Positions [rad or m], shape (n,); clipped to the limits.

        Raises:
            InputError: another shape, not finite, or a controller that is not active.
        """
        targets = finite_array("positions", positions, (len(self.joint_names),))
        self.check_active()
        self._target = np.clip(targets, self.joints.lower, self.joints.upper)

    @exclusive
    def move(self, joint: str, position: float) -> None:
        """Set the target of one joint.

        Args:
            joint: The joint, "arm/joint".
            position: Target position [rad or m]; clipped to the limits.

        Raises:
            UnknownNameError: a joint that this controller does not have.
            InputError: not finite, or a controller that is not active.
        """
        known_name("joint", joint, self.joint_names)
        value = finite_number("position", position)
        self.check_active()
        targets = self._target.copy()
        targets[self.joint_names.index(joint)] = value
        self.command(targets)

    @exclusive
    def press(self, key: str) -> bool:
        """Handle a key: "1" to "9" choose a joint, "+" and "-" move it by a step, " " lets all joints brake.

        Returns:
            Whether it is one of these keys.

        Raises:
            InputError: not a text, or a controller that is not active.
        """
        check_text("key", key)
        self.check_active()
        if key in ("+", "-"):
            i = self.joint_names.index(self.selected)
            self.move(self.selected, float(self._target[i]) + (self.step if key == "+" else -self.step))
        elif key == " ":
            self.command(self._positions + self._stopping_distance())
        elif len(key) == 1 and key in "123456789" and int(key) <= len(self.joint_names):
            self.selected = self.joint_names[int(key) - 1]
        else:
            return False
        return True

    def _fastest(self) -> Array:
        """Highest speed of each joint [rad/s or m/s], shape (n,)."""
        return np.asarray(self.speed * np.where(np.isfinite(self.joints.velocity), self.joints.velocity, _SPEED))

    def _stopping_distance(self) -> Array:
        """Displacement of each joint at full deceleration in whole time steps [rad or m], shape (n,)."""
        dt, speeds = self.joints.dt, np.abs(self._velocities)
        most = self._fastest() / _RAMP * dt
        steps = np.floor(speeds / most)
        return np.asarray(np.sign(self._velocities) * dt * steps * (speeds - 0.5 * most * (steps + 1.0)))

    @exclusive
    def update(self, state: JointState) -> SetPoint:
        """The next positions on the way.

        Positions at the beginning of a step, with the accelerations during it and the velocities at its end: MuJoCo's
        implicit integrator damps with those, so that joints follow without an error.
        """
        dt, fastest = self.joints.dt, self._fastest()
        left = self._target - self._positions
        most = fastest / _RAMP * dt  # largest change of the speed in a step
        wanted = np.sign(left) * np.minimum(fastest, _stopping_speed(np.abs(left) / dt, most))
        velocities = self._velocities + np.clip(wanted - self._velocities, -most, most)
        positions = clip_positions(self.joints, self._positions + velocities * dt, self._positions)
        # Without rounding at the target, because joints would otherwise oscillate around it.
        arrives = np.abs(self._target - positions) <= _ROUNDING
        point = SetPoint(self._positions, velocities, (velocities - self._velocities) / dt)
        self._positions, self._velocities = np.where(arrives, self._target, positions), velocities
        return point


def _stopping_speed(distance: Array, most: Array) -> Array:
    """The highest speed from which joints can stop within a distance in whole time steps.

    At speeds v, v - most, v - 2 most, ..., the last one at most `most`, a joint travels n steps at full deceleration
    after the first step, (n + 1) v - most n (n + 1) / 2 in all, with n = floor(v / most).

    Args:
        distance: Distances divided by the time step [rad/s or m/s], shape (n,).
        most: Largest change of the speed in a step [rad/s or m/s], shape (n,).
    """
    steps = np.floor(0.5 * (np.sqrt(1.0 + 8.0 * distance / most) - 1.0))
    return np.asarray(distance / (steps + 1.0) + 0.5 * most * steps)
