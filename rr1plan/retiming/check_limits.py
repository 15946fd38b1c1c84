"""Check of finite limits of moving joints."""

from __future__ import annotations

import numpy as np

from rr1plan.checks import Array
from rr1plan.errors import RetimingError
from rr1plan.robot.joint_limits import Limits


def check_limits(joint_names: tuple[str, ...], waypoints: Array, limits: Limits, *, jerk: bool = False) -> None:
    """Require finite velocity and acceleration limits of all moving joints, and jerk limits if `jerk`.

    Args:
        joint_names: Name of each joint, length nq.
        waypoints: Configurations [rad or m], shape (n, nq).
        limits: Limits of the same joints.
        jerk: Whether jerk limits are required.

    Raises:
        RetimingError: a moving joint has an infinite limit.
    """
    for kind in ("velocity", "acceleration", "jerk")[: 3 if jerk else 2]:
        limited = np.isfinite(getattr(limits, kind))
        if limited.all():
            continue
        bad = ~limited & (np.ptp(waypoints, axis=0) > 0.0)
        if bad.any():
            name = joint_names[int(np.argmax(bad))]
            raise RetimingError(
                f"joint {name!r} moves and has no {kind} limit; set one (robot.with_limits, or limits in a scene file)"
            )
