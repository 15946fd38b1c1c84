"""Motions of every method in a cluttered scene, validated by the referee, which shares no code with them."""

from __future__ import annotations

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.retiming import retime, retiming_names


@pytest.fixture(scope="module", params=["rr1_table", "rr1_pair"])
def certified(request):
    """A scene, its certifier, and a path of random free edges between its obstacles."""
    scene = rp.load_scene(request.param)
    checker = rp.CollisionChecker(scene)
    rng, limits = np.random.default_rng(1), scene.limits()
    points = [scene.configuration()]
    for _ in range(2000):
        q = points[-1] + rng.uniform(-1.0, 1.0, len(limits))
        inside = (q > limits.lower).all() and (q < limits.upper).all()
        if inside and checker.edge_is_free(points[-1], q):
            points.append(q)
        if len(points) == 6:
            break
    assert len(points) == 6
    return scene, checker, rp.Path(scene.joint_names(), np.array(points))


@pytest.mark.parametrize("method", retiming_names())
@pytest.mark.parametrize("torque_limits", [False, True])
def test_the_referee_finds_nothing(certified, method, torque_limits):
    scene, checker, path = certified
    trajectory = retime(path, scene, method=method, checker=checker, torque_limits=torque_limits)
    report = rp.validate(trajectory, scene, torque_limits=torque_limits, jerk_limits=method.startswith("ruckig"))
    assert report.valid, str(report)
