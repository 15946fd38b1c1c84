"""Joints that move need finite limits; the first one without is named."""

from __future__ import annotations

import numpy as np

from rr1plan.checks import Array
from rr1plan.errors import RetimingError
from rr1plan.limits import Limits


def check_limits(joint_names: tuple[str, ...], waypoints: Array, limits: Limits, *, jerk: bool = False) -> None:
    """Every joint that moves has finite velocity and acceleration limits, and jerk if asked.

    Args:
        joint_names: Name of each joint, length nq.
        waypoints: Configurations [rad], shape (n, nq).
        limits: Limits of the same joints.
        jerk: Whether a jerk limit is needed.

    Raises:
        RetimingError: an infinite limit of a joint that moves.
    """
    moving = np.ptp(waypoints, axis=0) > 0.0
    for kind in ("velocity", "acceleration", "jerk")[: 3 if jerk else 2]:
        bad = moving & ~np.isfinite(getattr(limits, kind))
        if bad.any():
            name = joint_names[int(np.argmax(bad))]
            raise RetimingError(
                f"joint {name!r} moves and has no {kind} limit; load its robot with one (option limits)"
            )
