"""The compiled search, compared with plain descents on Pinocchio, and its continuation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import rr1plan as rp
from rr1plan.kernels.planner_kernels import load_library
from rr1plan.kernels.random_state import random_state
from rr1plan.model import Kinematics
from rr1plan.model.ik_descent import Target, descend
from rr1plan.model.ik_search import IkSearch, sampling_box
from rr1plan.model.kinematic_chain import chain_of
from rr1plan.scene.problem import PoseGoal, RegionGoal


def search_for(robot, goal, seed=0):
    chain = chain_of(Kinematics(robot).scene_model.arm_model, f"arm/{robot.tool}")
    return IkSearch(chain, robot, goal, robot.home[None], random_state(seed))


def slow_descent(kinematics, frame, T, q, steps=60):
    """Levenberg-Marquardt on Pinocchio: its last configuration, and the remaining distance and angle."""
    limits = kinematics.scene_model.limits
    index = kinematics.scene_model.frame_id(kinematics.frame(frame))
    mu, last = 0.1, np.inf
    for _ in range(steps):
        p, R, J = kinematics.pose_and_jacobian(q, index)
        e = np.concatenate([p - T[:3, 3], 0.3 * pin.log3(R @ T[:3, :3].T)])
        if e @ e < 1e-20:
            break
        if e @ e < last:
            kept, last, mu = q, e @ e, 0.2 * mu
        else:
            mu *= 10.0
            p, R, J = kinematics.pose_and_jacobian(kept, index)
            e = np.concatenate([p - T[:3, 3], 0.3 * pin.log3(R @ T[:3, :3].T)])
        J = np.concatenate([J[:3], 0.3 * J[3:]])
        slope = J.T @ e
        stuck = ((kept <= limits.lower) & (slope > 0.0)) | ((kept >= limits.upper) & (slope < 0.0))
        J, slope = np.where(stuck, 0.0, J), np.where(stuck, 0.0, slope)
        H = J.T @ J + (mu * min(e @ e, 1.0) + 1e-12) * np.eye(len(q))
        q = np.clip(kept - np.linalg.solve(H, slope), limits.lower, limits.upper)
    p, R, _ = kinematics.pose_and_jacobian(kept, index)
    return kept, np.linalg.norm(p - T[:3, 3]), np.linalg.norm(pin.log3(R @ T[:3, :3].T))


@settings(deadline=None, max_examples=100)
@given(st.integers(1, 9), st.integers(0, 2**32 - 1))
def test_normal_equations_are_solved_as_numpy_does(n, seed):
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(n + 2, n))
    H, x = A.T @ A + 0.1 * np.eye(n), rng.normal(size=n)
    expected = np.linalg.solve(H, x)
    lower = np.tril(H) + np.triu(np.full((n, n), np.nan), 1)
    assert load_library().rr1_solve_cholesky(lower, x, n)
    np.testing.assert_allclose(x, expected, rtol=1e-8, atol=1e-10)


def test_what_is_not_positive_definite_is_refused():
    for wrong in (np.array([[1.0, 0.0], [2.0, 1.0]]), np.full((1, 1), np.nan)):
        assert not load_library().rr1_solve_cholesky(wrong, np.ones(len(wrong)), len(wrong))


def test_random_starts_of_joints_with_one_limit_are_within_a_turn_of_it():
    robot = rp.load_robot("planar2r")
    limits = replace(robot.limits, lower=[4.0, -np.inf], upper=[np.inf, -4.0])
    lower, upper = sampling_box(robot.with_limits(limits))
    np.testing.assert_allclose(lower, [4.0, -4.0 - 2 * np.pi])
    np.testing.assert_allclose(upper, [4.0 + 2 * np.pi, -4.0])


@pytest.mark.parametrize("name", ["rr1", "odd_arm", "redundant_arm", "wrist_arm"])
def test_descents_arrive_as_often_as_those_written_plainly(name, request):
    robot = request.getfixturevalue(name)
    kinematics, rng = Kinematics(robot), np.random.default_rng(3)
    chain = chain_of(kinematics.scene_model.arm_model, f"arm/{robot.tool}")
    limits, (lower, upper) = robot.limits, sampling_box(robot)
    arrived = slowly = 0
    for _ in range(150):
        T, start = kinematics.pose(rng.uniform(lower, upper)), rng.uniform(lower, upper)
        q, square = descend(chain, Target(T[:3, 3], T[:3, 3], T[:3, :3]), start, limits.lower, limits.upper)
        assert (limits.lower <= q).all()
        assert (q <= limits.upper).all()
        reached = kinematics.pose(q)
        off, turn = reached[:3, 3] - T[:3, 3], pin.log3(reached[:3, :3] @ T[:3, :3].T)
        # The reported error is that of Pinocchio.
        assert square == pytest.approx(off @ off + 0.09 * turn @ turn, rel=1e-6, abs=1e-16)
        arrived += square < 1e-12
        _, off, turn = slow_descent(kinematics, "tool", T, start)
        slowly += off < 1e-6 and turn < 1e-6
    assert arrived > 20
    assert arrived >= slowly - 12


def test_a_search_that_goes_on_is_one_that_never_stopped(redundant_arm):
    T = Kinematics(redundant_arm).pose([0.3, 0.6, 0.2, 0.9, -0.4, 0.5, 0.1])
    whole, parts = search_for(redundant_arm, PoseGoal("tool", T)), search_for(redundant_arm, PoseGoal("tool", T))
    whole.collect(60)
    found = [parts.collect(20), parts.collect(40)]
    assert min(len(part) for part in found) > 0
    assert whole.tried == parts.tried == 60
    np.testing.assert_array_equal(whole.accepted, [*found[0], *found[1]])
    np.testing.assert_array_equal(whole.accepted, parts.accepted)


def test_a_search_stops_at_what_it_was_asked_for_and_has_room_for_any_number(redundant_arm):
    search = search_for(redundant_arm, RegionGoal("tool", [-0.6, -0.6, 0.2], [0.6, 0.6, 1.0]))
    assert len(search.collect(1000, most=5)) == 5
    assert len(search.collect(1000, most=80)) == 80
    assert len(search.accepted) == len(np.unique(search.accepted, axis=0)) == 85
    refused = search.collect(50, accept=lambda q: False)
    assert refused == []
    assert len(search.rejected) > 20


def test_solutions_are_reached_by_pinocchio_within_the_tolerances(redundant_arm):
    kinematics, rng = Kinematics(redundant_arm), np.random.default_rng(4)
    for i in range(20):
        T = kinematics.pose(rng.uniform(*sampling_box(redundant_arm)))
        goal = PoseGoal("tool", T, position_tolerance=1e-7, orientation_tolerance=1e-7)
        for q in search_for(redundant_arm, goal, i).collect(30):
            reached = kinematics.pose(q)
            assert np.linalg.norm(reached[:3, 3] - T[:3, 3]) <= 1e-7
            assert np.linalg.norm(pin.log3(reached[:3, :3] @ T[:3, :3].T)) <= 1e-7
            assert (q >= redundant_arm.limits.lower).all()
            assert (q <= redundant_arm.limits.upper).all()


def test_a_second_attempt_with_the_whole_tolerance_leaves_the_random_numbers_of_others(planar2r):
    """Later results of a search with the same state do not depend on it."""
    states, chain = [], chain_of(Kinematics(planar2r).scene_model.arm_model, f"arm/{planar2r.tool}")
    for share in (0.95, 50.0):
        state = random_state(3)
        search = IkSearch(chain, planar2r, PoseGoal("tool", [1.7 + share * 1e-4, 0, 0]), planar2r.home[None], state)
        assert bool(search.collect(60)) == (share < 1.0)
        assert search.tried == (120 if share < 1.0 else 60)
        states.append(state)
    np.testing.assert_array_equal(*states)
