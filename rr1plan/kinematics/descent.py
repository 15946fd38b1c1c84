"""Levenberg-Marquardt within joint limits: from a start to the nearest place where the error is smallest.

Each step solves (J^T J + mu I) d = -J^T e over the joints that are free to move: a joint at its limit
which the gradient pushes outwards is left out, the step is clipped to the box, mu falls when the
error does and rises when it does not. For the damping see Sugihara, Solvability-unconcerned inverse
kinematics by the Levenberg-Marquardt method, IEEE T-RO 2011; for the active set Bertsekas,
Projected Newton methods, SIAM J. Control Optim. 1982.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rr1plan.checks import Array
from rr1plan.kinematics.forward import Kinematics

# A radian counts like this many metres: about the size of an arm.
_METRES_PER_RADIAN = 0.3
_CONVERGED = 1e-20  # squared error: 1e-10 m
_PATIENCE = 8  # steps in which the squared error has to halve

Residual = Callable[[Array], tuple[Array, Array]]


@dataclass(frozen=True, eq=False)
class Target:
    """Where a frame's origin has to be (a box, or a point if its corners agree) and how it has to be turned.

    Args:
        index: Pinocchio's index of the frame.
        lower, upper: Corners of the box in the world [m], each (3,).
        rotation: Wanted R_world_frame (3, 3), or None when any will do.
    """

    index: int
    lower: Array
    upper: Array
    rotation: Array | None

    def errors(self, p: Array, R: Array) -> tuple[Array, Array | None]:
        """Position error [m] (3,) and orientation error [rad] (3,), both in world axes."""
        off = p - np.minimum(np.maximum(p, self.lower), self.upper)
        return off, None if self.rotation is None else pin.log3(R @ self.rotation.T)

    def residual(self, kinematics: Kinematics, q: Array) -> tuple[Array, Array]:
        """The error and its derivative by q; an axis on which p is inside the box does not count."""
        p, R, J = kinematics.pose_and_jacobian(q, self.index)
        off, turn = self.errors(p, R)
        rows = J[:3]
        if (self.lower != self.upper).any():
            rows = rows * (off != 0.0)[:, None]
        if turn is None:
            return off, rows
        return (
            np.concatenate((off, _METRES_PER_RADIAN * turn)),
            np.concatenate((rows, _METRES_PER_RADIAN * J[3:])),
        )


def descend(residual: Residual, q: Array, lower: Array, upper: Array, steps: int = 60) -> tuple[Array, float]:
    """The configuration where the descent from q ends, and its squared error.

    Args:
        residual: Gives the error (m,) and its derivative (m, n) at a configuration.
        q: Where to start [rad or m], within the limits, shape (n,).
        lower: Lower limits [rad or m], shape (n,).
        upper: Upper limits [rad or m], shape (n,).
        steps: Most evaluations.
    """
    e, J = residual(q)
    cost, mu, past = float(e @ e), 1e-3, np.inf
    identity = np.eye(len(q))
    for step in range(steps):
        if cost < _CONVERGED:
            break
        if step % _PATIENCE == 0:
            if cost > 0.5 * past:
                break
            past = cost
        gradient, H = J.T @ e, J.T @ J
        stuck = ((q <= lower) & (gradient > 0.0)) | ((q >= upper) & (gradient < 0.0))
        if stuck.any():
            gradient = np.where(stuck, 0.0, gradient)
            H = np.where(stuck | stuck[:, None], 0.0, H)
        move = np.linalg.solve(H + (mu * min(cost, 1.0) + 1e-12 * (1.0 + H.trace())) * identity, gradient)
        trial = np.minimum(np.maximum(q - move, lower), upper)
        e_trial, J_trial = residual(trial)
        cost_trial = float(e_trial @ e_trial)
        if cost_trial < cost:
            q, e, J, cost, mu = trial, e_trial, J_trial, cost_trial, max(0.2 * mu, 1e-9)
        else:
            mu = min(10.0 * mu, 1e9)
    return q, cost
