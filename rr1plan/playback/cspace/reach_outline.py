"""The reach of a planar arm's tool for pictures, ignoring obstacles and the limits of revolute joints."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rr1plan.checks import Array
from rr1plan.model.flat_arm import FlatArm
from rr1plan.robot.joint_limits import Limits

_CORNERS = 128


class Reach(NamedTuple):
    """A region of the plane.

    Args:
        rims: Its boundary as closed polygons [m], each (n, 2); by the even-odd rule.
        center: Center of a circle around the region and the arm [m], shape (2,).
        radius: Radius of that circle [m].
    """

    rims: tuple[Array, ...]
    center: Array
    radius: float


def reach_of(arm: FlatArm, limits: Limits) -> Reach:
    """The region that the tool reaches with unlimited revolute joints and prismatic joints within their limits."""
    (a, c), base = arm.bars, arm.base
    lower, upper = np.maximum(limits.lower, -1e3), np.minimum(limits.upper, 1e3)
    match arm.kinds:
        case "RR":
            radii = (abs(abs(a) - abs(c)), abs(a) + abs(c))
            rims = [_circle(base, r) for r in radii if r > 1e-9]
        case "RP":
            along = (a + c + np.linspace(lower[1], upper[1], 400) * arm.slides[1]).astype(complex)
            radii = (float(np.abs(along).min()), float(np.abs(along).max()))
            rims = [_circle(base, r) for r in radii if r > 1e-9]
        case "PR":
            first, last = (base + a + value * arm.slides[0] for value in (lower[0], upper[0]))
            round_ = abs(c) * np.exp(1j * (np.linspace(0.5, 1.5, _CORNERS // 2) * np.pi + np.angle(arm.slides[0])))
            rims = [np.concatenate([first + round_, last - round_])]
        case _:
            corners = [(lower[0], lower[1]), (upper[0], lower[1]), (upper[0], upper[1]), (lower[0], upper[1])]
            rims = [np.array([base + a + c + p * arm.slides[0] + q * arm.slides[1] for p, q in corners])]
    flat = tuple(np.column_stack([rim.real, rim.imag]) for rim in rims)
    if arm.kinds[0] == "R":
        return Reach(flat, np.array([base.real, base.imag]), max(radii))
    center = 0.5 * (flat[0].min(axis=0) + flat[0].max(axis=0))
    return Reach(flat, center, float(np.linalg.norm(flat[0] - center, axis=1).max()))


def _circle(center: complex, radius: float) -> Array:
    return np.asarray(center + radius * np.exp(2j * np.pi * np.arange(_CORNERS) / _CORNERS))
