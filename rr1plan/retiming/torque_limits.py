"""Torque limits of a timed motion, by time scaling.

A motion stretched by k has torques tau = g(q) + (tau_1 - g(q)) / k² at the same configurations, where g is
the gravity term, so k follows in closed form. Between samples the torque may exceed theirs by an
eighth of its second difference, which is added. The result is evaluated again, and the step
repeated if it exceeds the limits.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from rr1plan.checks import Array
from rr1plan.errors import RetimingError
from rr1plan.path import Path
from rr1plan.retiming.polynomial_extrema import evaluate
from rr1plan.retiming.timed_pieces import Pieces
from rr1plan.trajectory import differentiate

InverseDynamics = Callable[[Array, Array, Array], Array]

_STEP = 0.02
_GRAVITY_STEP = 0.05
_FEWEST, _MOST = 4, 200
_ROUNDS = 20


def within_torque(
    pieces: Pieces, joint_names: tuple[str, ...], effort: Array, inverse_dynamics: InverseDynamics
) -> Pieces:
    """The same motion, stretched until its torques are within `effort` (nq,) [Nm or N].

    Raises:
        RetimingError: the gravity torque of a joint exceeds its limit, or stretching does not converge.
    """
    for _ in range(_ROUNDS):
        factor = torque_stretch(pieces, joint_names, effort, inverse_dynamics)
        if factor <= 1.0:
            return pieces
        pieces = pieces.stretched(factor * (1.0 + 1e-6))
    raise RetimingError(f"torque limits: still exceeded after stretching {_ROUNDS} times, last by {factor:.6g}")


def check_gravity(
    waypoints: Array, joint_names: tuple[str, ...], effort: Array, inverse_dynamics: InverseDynamics
) -> None:
    """Require gravity torques within the effort limits along a polyline.

    Args:
        waypoints: The polyline [rad or m], shape (n, nq).
        joint_names: Name of each joint, for the message.
        effort: Effort limits [Nm or N], shape (nq,).
        inverse_dynamics: Torques of q, qd, qdd, each (n, nq).

    Raises:
        RetimingError: the gravity torque of a joint exceeds its limit; the message names the joint.
    """
    q = Path(joint_names, waypoints).sample(_GRAVITY_STEP)
    static = inverse_dynamics(q, np.zeros_like(q), np.zeros_like(q))
    if (np.abs(static) >= effort).any():
        raise _too_heavy(static, joint_names, effort)


def _too_heavy(static: Array, joint_names: tuple[str, ...], effort: Array) -> RetimingError:
    k, j = np.unravel_index(int(np.argmax(np.abs(static) / effort)), static.shape)
    return RetimingError(
        f"joint {joint_names[j]!r}: holding the arm still against gravity takes {abs(static[k, j]):.6g} Nm (or N) "
        f"on the path, its effort limit is {effort[j]:.6g}; no timing can help"
    )


def torque_stretch(
    pieces: Pieces, joint_names: tuple[str, ...], effort: Array, inverse_dynamics: InverseDynamics
) -> float:
    """Required time scaling factor; at most one if the torques are within the limits.

    Args:
        pieces: A motion.
        joint_names: Name of each joint, for the message.
        effort: Effort limits [Nm or N], shape (nq,).
        inverse_dynamics: Torques of q, qd, qdd, each (n, nq).

    Raises:
        RetimingError: the gravity torque of a joint exceeds its limit.
    """
    piece, q, qd, qdd = _samples(pieces)
    static = inverse_dynamics(q, np.zeros_like(q), np.zeros_like(q))
    moving = inverse_dynamics(q, qd, qdd) - static
    limited = np.isfinite(effort)
    between = _bulge(static, piece)
    reserve = (effort - between)[:, limited]
    up, down = reserve - static[:, limited], reserve + static[:, limited]
    if (up <= 0.0).any() or (down <= 0.0).any():
        raise _too_heavy(np.abs(static) + between, joint_names, effort)
    swing, bulge = moving[:, limited], _bulge(moving, piece)[:, limited]
    return float(np.sqrt(np.maximum((bulge + swing) / up, (bulge - swing) / down).max(initial=0.0)))


def _samples(pieces: Pieces) -> tuple[NDArray[np.intp], Array, Array, Array]:
    """Evenly spaced states on every piece: index of the piece (n,), position, velocity, acceleration (n, nq)."""
    powers = pieces.durations[:, None] ** np.arange(1, pieces.coefficients.shape[1])
    sweep = np.abs(pieces.coefficients[:, 1:] * powers[:, :, None]).sum(axis=1).max(axis=1)
    counts = np.clip(np.ceil(sweep / _STEP), _FEWEST, _MOST).astype(np.intp)
    piece = np.repeat(np.arange(len(counts)), counts + 1)
    fraction = np.concatenate([np.linspace(0.0, 1.0, count + 1) for count in counts])
    t = (fraction * pieces.durations[piece])[:, None]
    coefficients = pieces.coefficients[piece]
    q, qd, qdd = (evaluate(differentiate(coefficients, order), t) for order in range(3))
    return piece, q, qd, qdd


def _bulge(values: Array, piece: NDArray[np.intp]) -> Array:
    """Estimate of the excess of a piecewise smooth function over its samples (n, nq) between them, shape (n, nq)."""
    second = np.abs(np.diff(values, n=2, axis=0)) / 8.0
    second[piece[2:] != piece[:-2]] = 0.0
    starts = np.flatnonzero(np.diff(piece, prepend=-1))
    highest = np.maximum.reduceat(np.vstack([second, np.zeros((2, values.shape[1]))]), starts, axis=0)
    return np.asarray(highest[piece])
