"""Torque limits of a timed motion: measure, stretch, measure again.

Stretched by k, a motion needs tau = g(q) + (tau_1 - g(q)) / k² at the same places, g being
gravity's part: k follows in closed form. Between samples the torque may exceed them by an
eighth of its second difference; that is added. The answer is measured again, and the step
repeated where it falls short.
"""

from __future__ import annotations

import numpy as np

from rr1plan.checks import Array
from rr1plan.errors import RetimingError
from rr1plan.retiming.extrema import differentiate, evaluate
from rr1plan.retiming.pieces import Pieces
from rr1plan.retiming.toppra_ import InverseDynamics

_STEP = 0.02
_FEWEST, _MOST = 4, 200
_ROUNDS = 20


def within_torque(
    pieces: Pieces, joint_names: tuple[str, ...], effort: Array, inverse_dynamics: InverseDynamics
) -> Pieces:
    """The same motion, stretched until its torques keep within `effort` (nq,) [Nm].

    Raises:
        RetimingError: gravity alone needs more than a joint has (named), or no stretch is enough.
    """
    for _ in range(_ROUNDS):
        factor = _stretch(pieces, joint_names, effort, inverse_dynamics)
        if factor <= 1.0:
            return pieces
        pieces = pieces.stretched(factor * (1.0 + 1e-6))
    raise RetimingError(f"torque limits: still exceeded after stretching {_ROUNDS} times, last by {factor:.6g}")


def _stretch(pieces: Pieces, joint_names: tuple[str, ...], effort: Array, inverse_dynamics: InverseDynamics) -> float:
    """Factor a motion has to be stretched by; at most one if it keeps the limits."""
    highest = 0.0
    limited = np.isfinite(effort)
    for static, moving in _samples(pieces, inverse_dynamics):
        slack = _bulge(static)
        room_up, room_down = (effort - slack - static)[:, limited], (effort - slack + static)[:, limited]
        short = np.minimum(room_up, room_down)
        if (short <= 0.0).any():
            k, j = np.unravel_index(int(np.argmin(short)), short.shape)
            joint = int(np.flatnonzero(limited)[j])
            raise RetimingError(
                f"joint {joint_names[joint]!r}: holding the arm still against gravity takes "
                f"{abs(static[k, joint]):.6g} on the path, its effort limit is {effort[joint]:.6g}; "
                "no timing can help"
            )
        swing, bulge = moving[:, limited], _bulge(moving)[limited]
        highest = max(highest, float(np.maximum((bulge + swing) / room_up, (bulge - swing) / room_down).max(initial=0)))
    return float(np.sqrt(highest))


def _samples(pieces: Pieces, inverse_dynamics: InverseDynamics) -> list[tuple[Array, Array]]:
    """Gravity's part and the rest of the torque along every piece, each (n, nq)."""
    found = []
    for duration, coefficients in zip(pieces.durations, pieces.coefficients, strict=True):
        sweep = np.abs(coefficients[1:] * duration ** np.arange(1, len(coefficients))[:, None]).sum(axis=0).max()
        count = int(np.clip(np.ceil(sweep / _STEP), _FEWEST, _MOST))
        t = np.linspace(0.0, duration, count + 1)[:, None]
        whole = np.broadcast_to(coefficients, (count + 1, *coefficients.shape))
        q, qd, qdd = (evaluate(differentiate(whole, order), t) for order in range(3))
        static = inverse_dynamics(q, np.zeros_like(q), np.zeros_like(q))
        found.append((static, inverse_dynamics(q, qd, qdd) - static))
    return found


def _bulge(values: Array) -> Array:
    """How far a smooth function may exceed its samples (n, nq) between them, shape (nq,)."""
    return np.asarray(np.abs(np.diff(values, n=2, axis=0)).max(axis=0, initial=0.0) / 8.0)
