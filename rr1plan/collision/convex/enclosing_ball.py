"""A small ball around balls or points."""

from __future__ import annotations

import numpy as np

from rr1plan.checks import Array

_STEPS = 100
_ROUNDING = 1.0 + 1e-9


def enclosing_ball(balls: Array) -> Array:
    """A ball around balls, a little larger than the least (Badoiu and Clarkson, "Smaller core-sets for balls", 2003).

    Its center is a weighted mean of theirs, so it is no farther from any line or plane than one of them.

    Args:
        balls: Center and radius of each [m], shape (n, 4); at least one.

    Returns:
        Center and radius [m], shape (4,).
    """
    center = balls[:, :3].mean(axis=0)
    for step in range(2, _STEPS):
        center = center + (balls[ball_reach(balls, center).argmax(), :3] - center) / step
    return np.array([*center, float(ball_reach(balls, center).max()) * _ROUNDING])


def around_points(points: Array) -> Array:
    """A ball around points (n, 3), shape (4,)."""
    return enclosing_ball(np.column_stack([points, np.zeros(len(points))]))


def ball_reach(balls: Array, center: Array) -> Array:
    """Radius that a ball about a center (3,) needs to contain each of some balls (n, 4) [m], shape (n,)."""
    return np.array(np.linalg.norm(balls[:, :3] - center, axis=1) + balls[:, 3])
