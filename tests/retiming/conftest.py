"""Arms without shapes with any number of joints, and a certifier with given verdicts."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.robot import Joint, Link


class Certifier:
    """Returns given verdicts, and records the curves to certify."""

    def __init__(self, answer: Callable[[np.ndarray, float], bool] = lambda c, d: True) -> None:
        self.answer = answer
        self.asked: list[tuple[np.ndarray, float]] = []

    def polynomial_is_free(self, coefficients: np.ndarray, duration: float) -> bool:
        self.asked.append((coefficients, duration))
        return self.answer(coefficients, duration)


def limits_of(
    n: int, velocity: Any = 1.0, acceleration: Any = 2.0, jerk: Any = 10.0, effort: Any = np.inf
) -> rp.Limits:
    rates = {"velocity": velocity, "acceleration": acceleration, "jerk": jerk, "effort": effort}
    arrays = {name: np.broadcast_to(np.asarray(value, dtype=float), (n,)) for name, value in rates.items()}
    return rp.Limits(lower=np.full(n, -np.inf), upper=np.full(n, np.inf), **arrays)


def shapeless_scene(limits: rp.Limits) -> rp.Scene:
    """One arm "a" with joints j0, j1, ... that cannot collide."""
    n = len(limits)
    robot = rp.Robot(
        name="shapeless",
        links=tuple(Link(f"l{i}") for i in range(n + 1)),
        joints=tuple(Joint(f"j{i}", "continuous", f"l{i}", f"l{i + 1}") for i in range(n)),
        joint_names=tuple(f"j{i}" for i in range(n)),
        limits=limits,
        configurations={"home": np.zeros(n)},
        locked_joints={},
        disabled_collisions=frozenset(),
        tool=f"l{n}",
    )
    return rp.Scene().with_arm("a", robot)


def retime_points(
    waypoints: Any, limits: rp.Limits | None = None, method: str = "blend", checker: Any = None, **settings: Any
) -> rp.Trajectory:
    """Retime waypoints of a shapeless arm."""
    from rr1plan.retiming import retime

    points = np.asarray(waypoints, dtype=float)
    scene = shapeless_scene(limits_of(points.shape[1]) if limits is None else limits)
    return retime(
        rp.Path(scene.joint_names(), points), scene, method=method, checker=checker or Certifier(), **settings
    )


def exact_peak(trajectory: rp.Trajectory, derivative: int) -> np.ndarray:
    """Largest absolute rate of every joint, from numpy's polynomial roots, piece by piece."""
    highest = np.zeros(len(trajectory.joint_names))
    for duration, piece in zip(np.diff(trajectory.breaks), trajectory.coefficients, strict=True):
        for j in range(piece.shape[1]):
            rate = np.polynomial.Polynomial(piece[:, j]).deriv(derivative)
            slope = rate.deriv().trim()
            roots = slope.roots() if slope.degree() > 0 else np.zeros(0)
            inside = [r.real for r in roots if abs(r.imag) < 1e-9 and 0.0 <= r.real <= duration]
            highest[j] = max(highest[j], *(abs(rate(t)) for t in [0.0, duration, *inside]))
    return highest


def distance_to_polyline(points: np.ndarray, polyline: np.ndarray) -> np.ndarray:
    """Euclidean distance of each point (n, nq) to a polyline (m, nq)."""
    best = np.linalg.norm(points - polyline[0], axis=1)
    for a, b in pairwise(polyline):
        edge = b - a
        along = np.clip((points - a) @ edge / max(edge @ edge, 1e-300), 0.0, 1.0)
        best = np.minimum(best, np.linalg.norm(points - a - along[:, None] * edge, axis=1))
    return best


def check_motion(trajectory: rp.Trajectory, waypoints: Any, limits: rp.Limits, jerk: bool = False) -> None:
    """Requirements on every retiming: exact ends at rest, smoothness, limits kept everywhere."""
    points = np.asarray(waypoints, dtype=float)
    size = 1.0 + np.abs(points).max()
    assert trajectory.start_time == 0.0
    for time, q in ((0.0, points[0]), (trajectory.end_time, points[-1])):
        np.testing.assert_allclose(trajectory(time), q, rtol=0.0, atol=2e-9 * size)
        np.testing.assert_allclose(trajectory(time, 1), 0.0, atol=1e-9)
    inner = trajectory.breaks[1:-1]
    before = np.nextafter(inner, 0.0)
    for derivative in (0, 1):
        np.testing.assert_allclose(
            trajectory(before, derivative), trajectory(inner, derivative), rtol=0, atol=1e-8 * size
        )
    times = np.linspace(0.0, trajectory.end_time, 10_000)
    kinds = ("velocity", "acceleration", "jerk") if jerk else ("velocity", "acceleration")
    for derivative, kind in enumerate(kinds, start=1):
        limit = getattr(limits, kind) * (1.0 + 1e-9)
        assert (np.abs(trajectory(times, derivative)) <= limit).all(), kind
        if trajectory.duration > 0.0:
            assert (exact_peak(trajectory, derivative) <= limit).all(), kind


@pytest.fixture
def tools() -> Any:
    """The helpers above, for the test modules in this folder."""
    from types import SimpleNamespace

    return SimpleNamespace(
        Certifier=Certifier,
        limits_of=limits_of,
        shapeless_scene=shapeless_scene,
        retime_points=retime_points,
        exact_peak=exact_peak,
        distance_to_polyline=distance_to_polyline,
        check_motion=check_motion,
    )
