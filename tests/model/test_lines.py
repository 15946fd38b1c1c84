"""The bound of the deviation of an edge from a straight line holds and is not too large."""

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rr1plan.model import Kinematics
from rr1plan.model.workspace_lines import EdgeBound, Line


def leave_of_chord(kinematics, a, b):
    """Actual deviation of the tool from the chord [m] and from uniform rotation [rad] between the ends of an edge."""
    t = np.linspace(0.0, 1.0, 41)[:, None]
    T = kinematics.poses_batch(a + t * (b - a))
    p, R = T[:, :3, 3], T[:, :3, :3]
    chord = p[0] + t * (p[-1] - p[0])
    turn = pin.log3(R[0].T @ R[-1])
    even = [R[0] @ pin.exp3(s * turn) for s in t[:, 0]]
    angle = [np.linalg.norm(pin.log3(x.T @ y)) for x, y in zip(even, R, strict=True)]
    return np.linalg.norm(p - chord, axis=1).max(), max(angle)


@pytest.mark.parametrize("name", ["rr1", "planar2r", "odd_arm", "redundant_arm"])
@settings(deadline=None, max_examples=40)
@given(seed=st.integers(0, 2**32 - 1), size=st.floats(0.01, 0.3))
def test_the_bound_holds(name, seed, size, request):
    robot = request.getfixturevalue(name)
    rng = np.random.default_rng(seed)
    kinematics = Kinematics(robot)
    bound = EdgeBound(kinematics, kinematics.scene_model.frame_id("arm/" + robot.tool))
    a = rng.uniform(-1.0, 1.0, robot.nq)
    b = a + size * rng.uniform(-1.0, 1.0, robot.nq)
    meters, radians = bound.bound(a, b)
    real_meters, real_radians = leave_of_chord(kinematics, a, b)
    assert real_meters <= meters + 1e-12
    assert real_radians <= radians + 1e-12


def test_the_bound_of_one_turning_joint_is_the_sagitta(planar2r):
    kinematics = Kinematics(planar2r)
    bound = EdgeBound(kinematics, kinematics.scene_model.frame_id("arm/tool"))
    a, b = np.zeros(2), np.array([0.02, 0.0])
    meters, _ = bound.bound(a, b)
    assert meters == pytest.approx(1.7 * 0.02**2 / 8)
    assert leave_of_chord(kinematics, a, b)[0] == pytest.approx(meters, rel=1e-3)


def test_a_line_starts_and_ends_where_it_should(rr1):
    kinematics = Kinematics(rr1)
    index = kinematics.scene_model.frame_id("arm/tool")
    goal = kinematics.pose([0.3, 0.1, 0.2, -0.5, 1.0, 0.4])
    line = Line.between(kinematics, rr1.home, index, goal[:3, 3], goal[:3, :3])
    start = kinematics.pose(rr1.home)
    np.testing.assert_allclose(line.at(0.0).rotation, start[:3, :3], atol=1e-14)
    np.testing.assert_allclose(line.at(1.0).rotation, goal[:3, :3], atol=1e-14)
    np.testing.assert_array_equal(line.at(1.0).lower, goal[:3, 3])
    half = line.at(0.5)
    np.testing.assert_allclose(half.lower, (start[:3, 3] + goal[:3, 3]) / 2, atol=1e-15)
    both = [np.linalg.norm(pin.log3(half.rotation.T @ T[:3, :3])) for T in (start, goal)]
    assert both[0] == pytest.approx(both[1])
    assert line.length == pytest.approx(np.linalg.norm(start[:3, 3] - goal[:3, 3]) + 2 * both[0])
