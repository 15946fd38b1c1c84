"""Inverse kinematics: solutions are right, existing solutions are found, and missing ones are explained."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import rr1plan as rp
from rr1plan.errors import InputError, UnknownNameError
from rr1plan.model import Kinematics, solve_ik
from rr1plan.model.joint_turns import difference, rotary
from rr1plan.scene import Arm, Scene
from rr1plan.scene.problem import PoseGoal, RegionGoal
from rr1plan.transforms import pose, quaternion_from_rotation, rotation_angle

L1, L2 = 1.0, 0.7


def assert_solves(robot, q, T, base=None):
    """By the plain kinematics, which shares no code with the solver."""
    base = np.eye(4) if base is None else base
    reached = base @ robot.link_poses(q)[robot.tool]
    assert np.linalg.norm(reached[:3, 3] - T[:3, 3]) <= 1e-4
    assert rotation_angle(reached[:3, :3].T @ T[:3, :3]) <= 1e-3
    assert (q >= robot.limits.lower).all()
    assert (q <= robot.limits.upper).all()


@settings(deadline=None, max_examples=30)
@given(angle=st.floats(-np.pi, np.pi), r=st.floats(0.32, 1.68))
def test_both_elbow_solutions_of_the_planar_arm_are_found_exactly(planar2r, angle, r):
    result = solve_ik(Kinematics(planar2r), PoseGoal("tool", [r * np.cos(angle), r * np.sin(angle), 0.0]), rng=0)
    elbow = np.arccos((r * r - L1 * L1 - L2 * L2) / (2 * L1 * L2))
    closed = []
    for e in (elbow, -elbow):
        shoulder = angle - np.arctan2(L2 * np.sin(e), L1 + L2 * np.cos(e))
        closed.append(np.array([shoulder, e]))
    assert len(result.solutions) == 2
    for expected in closed:
        off = np.abs(difference(result.solutions, expected, rotary(planar2r))).max(axis=1)
        assert off.min() < 1e-7


def test_reachable_poses_of_rr1_are_reached(rr1):
    kinematics, rng = Kinematics(rr1), np.random.default_rng(11)
    found = 0
    for i in range(1000):
        T = kinematics.pose(rng.uniform(rr1.limits.lower, rr1.limits.upper))
        result = solve_ik(kinematics, PoseGoal("tool", T), rng=i, max_solutions=1)
        found += result.found
        for q in result.solutions:
            assert_solves(rr1, q, T)
    assert found >= 998


def test_the_configuration_a_pose_came_from_is_among_the_solutions(rr1):
    kinematics, rng = Kinematics(rr1), np.random.default_rng(12)
    found = 0
    for i in range(20):
        q = rng.uniform(rr1.limits.lower, rr1.limits.upper)
        result = solve_ik(kinematics, PoseGoal("tool", kinematics.pose(q)), rng=i)
        for solution in result.solutions:
            assert_solves(rr1, solution, kinematics.pose(q))
        found += np.abs(result.solutions - q).max(axis=1).min() < 1e-4
        apart = [np.abs(a - b).max() for k, a in enumerate(result.solutions) for b in result.solutions[:k]]
        assert not apart or min(apart) > 1e-3
    assert found >= 19


@pytest.mark.parametrize("name", ["odd_arm", "redundant_arm"])
def test_mimic_sliding_continuous_and_redundant_arms_are_solved(name, request):
    robot = request.getfixturevalue(name)
    base = pose([0.2, 0.1, -0.3], rpy=[0.4, 0.1, -0.2])
    kinematics, rng = Kinematics(Scene({"it": Arm(robot, base)})), np.random.default_rng(13)
    lower, upper = np.maximum(robot.limits.lower, -np.pi), np.minimum(robot.limits.upper, np.pi)
    for i in range(20):
        T = kinematics.pose(rng.uniform(lower, upper))
        result = solve_ik(
            kinematics, PoseGoal("tool", T[:3, 3], quaternion_from_rotation(T[:3, :3])), rng=i, attempts=40
        )
        assert result.found
        for q in result.solutions:
            assert_solves(robot, q, T, base)


def test_an_arm_with_a_spherical_wrist_has_eight_solutions(wrist_arm):
    kinematics, rng = Kinematics(wrist_arm), np.random.default_rng(14)
    for i in range(5):
        q = rng.uniform([-3, 0.2, 0.4, -3, 0.4, -3], [3, 1.0, 1.4, 3, 1.4, 3])
        T = kinematics.pose(q)
        result = solve_ik(kinematics, PoseGoal("tool", T), rng=i)
        assert len(result.solutions) == 8
        for solution in result.solutions:
            assert_solves(wrist_arm, solution, T)


def test_patience_ends_the_search_when_nothing_new_is_found(wrist_arm):
    kinematics = Kinematics(wrist_arm)
    goal = PoseGoal("tool", kinematics.pose([0.5, 0.6, 0.9, 0.4, 0.8, -0.3]))
    whole = solve_ik(kinematics, goal, rng=3)
    hasty = solve_ik(kinematics, goal, rng=3, patience=4)
    assert 0 < hasty.attempts < whole.attempts
    # It is the beginning of the same search.
    assert {q.tobytes() for q in hasty.solutions} <= {q.tobytes() for q in whole.solutions}
    # Without a solution, the search does not end early.
    out_of_reach = PoseGoal("tool", [9.0, 0.0, 0.0])
    assert solve_ik(kinematics, out_of_reach, rng=3, patience=4).attempts == whole.attempts


def test_solutions_of_a_redundant_arm_are_apart(redundant_arm):
    kinematics = Kinematics(redundant_arm)
    T = kinematics.pose([0.3, 0.6, 0.2, 0.9, -0.4, 0.5, 0.1])
    solutions = solve_ik(kinematics, PoseGoal("tool", T), rng=0).solutions
    assert len(solutions) > 10
    for k, a in enumerate(solutions):
        for b in solutions[:k]:
            assert np.abs(difference(a, b, rotary(redundant_arm))).max() > 0.2


def test_a_finger_does_not_make_an_arm_redundant(wrist_arm):
    """Two elbows that differ by a tenth of a radian are two solutions, also where a further joint moves a finger."""
    finger = rp.Joint("finger", "revolute", "l5", "claw", pose(), np.array([0.0, 0.0, 1.0]), -0.5, 0.5)
    was = wrist_arm.limits
    with_finger = replace(
        wrist_arm,
        links=(*wrist_arm.links, rp.Link("claw")),
        joints=(*wrist_arm.joints, finger),
        joint_names=(*wrist_arm.joint_names, "finger"),
        limits=rp.Limits(np.append(was.lower, -0.5), np.append(was.upper, 0.5), *(np.ones(7) for _ in range(4))),
        configurations={"home": np.zeros(7)},
    )
    q = np.array([0.4, 0.7, 0.05, 0.3, 0.8, -0.2])
    goal = PoseGoal("tool", Kinematics(wrist_arm).pose(q))
    alone = solve_ik(Kinematics(wrist_arm), goal, seeds=q, rng=0).solutions
    both = solve_ik(Kinematics(with_finger), goal, seeds=np.append(q, 0.1), rng=0).solutions
    assert len(alone) == len(both) == 8
    np.testing.assert_allclose(both[:, 6], 0.1)


def test_continuous_joints_come_out_near_the_seed(odd_arm):
    kinematics = Kinematics(odd_arm)
    seed = np.array([20.0, 0.3, 0.1, -0.5, 0.8, -13.0])
    solutions = solve_ik(kinematics, PoseGoal("tool", kinematics.pose(seed)), seeds=seed, rng=0).solutions
    np.testing.assert_allclose(solutions[0], seed, atol=1e-9)
    assert (np.abs(solutions - seed)[:, [0, 5]] <= np.pi + 1e-9).all()


def test_an_arm_among_others_is_solved_in_its_place(rr1):
    base = pose([0.0, 0.6, 0.0], rpy=[0.0, 0.0, np.pi])
    scene = Scene({"left": Arm(rr1), "right": Arm(rr1, base)})
    q = np.array([0.3, 0.1, 0.4, -0.5, 1.0, 0.2])
    T = base @ rr1.link_poses(q)["tool"]
    result = solve_ik(Kinematics(scene).for_arm("right"), PoseGoal("tool", T), rng=0)
    assert np.abs(result.solutions - q).max(axis=1).min() < 1e-6
    with pytest.raises(InputError, match="say which"):
        solve_ik(Kinematics(scene), PoseGoal("tool", T))


def test_a_region_is_entered_and_random_starts_spread_over_it(rr1):
    lower, upper = np.array([-0.5, -0.15, 0.2]), np.array([-0.3, 0.15, 0.4])
    result = solve_ik(Kinematics(rr1), RegionGoal("tool", lower, upper), rng=0)
    points = np.array([rr1.link_poses(q)["tool"][:3, 3] for q in result.solutions])
    assert (points >= lower).all()
    assert (points <= upper).all()
    assert (np.ptp(points, axis=0) > 0.6 * (upper - lower)).all()


def test_a_region_narrower_than_any_margin_is_not_left(rr1):
    p = rr1.link_poses([0.3, 0.1, 0.4, -0.5, 1.0, 0.2])["tool"][:3, 3]
    region = RegionGoal("tool", p - 1e-7, p + 1e-7)
    result = solve_ik(Kinematics(rr1), region, rng=0, attempts=10)
    assert result.found
    for q in result.solutions:
        assert (np.abs(rr1.link_poses(q)["tool"][:3, 3] - p) <= 1e-7).all()


def test_a_flat_region_and_an_oriented_one_are_reached(rr1):
    kinematics = Kinematics(rr1)
    T = kinematics.pose([0.3, 0.1, 0.4, -0.5, 1.0, 0.2])
    flat = [0.05, 0.05, 0.0]
    region = RegionGoal("tool", T[:3, 3] - flat, T[:3, 3] + flat, quaternion_from_rotation(T[:3, :3]))
    result = solve_ik(kinematics, region, rng=0, max_solutions=3)
    assert result.found
    for q in result.solutions:
        reached = rr1.link_poses(q)["tool"]
        assert abs(reached[2, 3] - T[2, 3]) <= 1e-9
        assert (np.abs(reached - T)[:2, 3] <= 0.05).all()
        assert rotation_angle(reached[:3, :3].T @ T[:3, :3]) < 1e-3


@pytest.mark.parametrize(("r", "miss"), [(2.5, 0.8), (0.1, 0.2)])
def test_an_unreachable_point_is_told_with_the_distance_missing(planar2r, r, miss):
    result = solve_ik(Kinematics(planar2r), PoseGoal("tool", [0.0, r, 0.0]), rng=0)
    assert not result.found
    assert result.position_error == pytest.approx(miss, abs=1e-4)
    assert f"{miss} m away" in result.reason
    assert "out of reach of arm/tool" in result.reason


@pytest.mark.parametrize(("r", "told"), [(9.0, False), (1200.0, True)])
def test_a_position_in_millimeters_is_told(planar2r, r, told):
    result = solve_ik(Kinematics(planar2r), PoseGoal("tool", [0.0, r, 0.0], [1, 0, 0, 0]), rng=0)
    assert ("are these millimeters?" in result.reason) == told


def test_an_unreachable_orientation_is_told_apart_from_an_unreachable_position(planar2r):
    sideways = [np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0]
    result = solve_ik(Kinematics(planar2r), PoseGoal("tool", [1.0, 0.5, 0.0], sideways), rng=0)
    assert "the position alone can be reached" in result.reason
    assert result.orientation_error > 0.1
    result = solve_ik(Kinematics(planar2r), PoseGoal("tool", [2.0, 0.5, 0.0], sideways), rng=0)
    assert "the position alone cannot be reached" in result.reason


def test_a_position_that_is_reached_is_0_m_away(planar2r):
    # Every orientation of the arm is half a turn from this one.
    result = solve_ik(Kinematics(planar2r), PoseGoal("tool", [1.0, 0.5, 0.0], [0, 1, 0, 0]), rng=0)
    assert "the nearest it gets is 0 m away, at [1, 0.5, 0], turned by 3.142 rad" in result.reason


def test_a_pose_beyond_the_limits_names_the_joint_and_the_excess():
    robot = rp.load_robot("planar2r_limited")
    q = np.array([0.0, 2.8])
    result = solve_ik(Kinematics(robot), PoseGoal("tool", robot.link_poses(q)["tool"]), rng=0)
    assert not result.found
    assert "only outside the joint limits" in result.reason
    assert "joint 'joint2' at 2.8 rad, outside [-2.6, 2.6] by 0.2 rad" in result.reason


def test_a_pose_at_a_corner_of_the_joint_limits_is_reached(rr1):
    kinematics, limits = Kinematics(rr1), rr1.limits
    for upper in product((False, True), repeat=rr1.nq):
        pose = kinematics.pose(np.where(upper, limits.upper, limits.lower))
        assert solve_ik(kinematics, PoseGoal("tool", pose), rng=0).found


def test_rejected_solutions_are_counted_and_others_are_kept(planar2r):
    kinematics, goal = Kinematics(planar2r), PoseGoal("tool", [1.0, 0.5, 0.0])
    none = solve_ik(kinematics, goal, rng=0, accept=lambda q: False)
    assert none.rejected == 2
    assert not none.found
    assert "2 configurations, none of them accepted" in none.reason
    up = solve_ik(kinematics, goal, rng=0, accept=lambda q: bool(q[1] > 0))
    assert (len(up.solutions), up.rejected) == (1, 1)


def test_the_same_seed_gives_the_same_answer(rr1):
    kinematics = Kinematics(rr1)
    goal = PoseGoal("tool", kinematics.pose([0.3, 0.1, 0.4, -0.5, 1.0, 0.2])[:3, 3])
    a, b = (solve_ik(kinematics, goal, rng=5, attempts=20) for _ in range(2))
    np.testing.assert_array_equal(a.solutions, b.solutions)
    other = solve_ik(kinematics, goal, rng=6, attempts=20)
    assert not np.array_equal(a.solutions, other.solutions)


def test_a_seed_that_solves_is_returned_first_and_seeds_out_of_limits_are_clipped(rr1):
    kinematics = Kinematics(rr1)
    q = np.array([0.3, 0.1, 0.4, -0.5, 1.0, 0.2])
    result = solve_ik(kinematics, PoseGoal("tool", kinematics.pose(q)), seeds=q, attempts=1)
    np.testing.assert_array_equal(result.solutions, [q])
    far = solve_ik(kinematics, PoseGoal("tool", kinematics.pose(q)), seeds=[np.full(6, 9.0), q], rng=0)
    assert far.found


def test_the_fixed_base_reaches_only_where_it_is(rr1):
    base = solve_ik(Kinematics(rr1), PoseGoal("base_link", [1.0, 0.0, 0.0]), rng=0, attempts=3)
    assert base.position_error == pytest.approx(1.0)
    assert not base.found


def test_wrong_calls_are_told(rr1):
    kinematics = Kinematics(rr1)
    goal = PoseGoal("tool", [0.0, 0.0, 0.5])
    with pytest.raises(UnknownNameError, match="hand_link"):
        solve_ik(kinematics, PoseGoal("hand_lnk", [0.0, 0.0, 0.5]))
    with pytest.raises(InputError, match="expected a PoseGoal or a RegionGoal"):
        solve_ik(kinematics, rp.JointGoal("home"))
    with pytest.raises(InputError, match="seeds"):
        solve_ik(kinematics, goal, seeds=np.zeros(5))
    with pytest.raises(InputError, match="attempts is 0"):
        solve_ik(kinematics, goal, attempts=0)
    with pytest.raises(InputError, match="max_solutions is 0"):
        solve_ik(kinematics, goal, max_solutions=0)
    with pytest.raises(InputError, match="patience is 0"):
        solve_ik(kinematics, goal, patience=0)


@pytest.mark.parametrize("share", [0.92, 0.96, 0.999])
def test_a_pose_that_is_reached_only_at_the_edge_of_its_tolerance_is_solved(planar2r, rr1, share):
    """Goals beyond a stretched arm, by a fraction of the tolerance."""
    arm = rp.Scene().with_arm("arm", planar2r)
    tolerance, stretched = 1e-4, np.array([1.7 * np.cos(0.4), 1.7 * np.sin(0.4), 0.0])
    goal = PoseGoal("tool", stretched * (1.0 + share * tolerance / 1.7))
    result = solve_ik(Kinematics(arm), goal, rng=0)
    assert result.found
    for q in result.solutions:
        off = np.linalg.norm(planar2r.link_poses(q)[planar2r.tool][:3, 3] - goal.position)
        assert 0.9 * tolerance < off <= tolerance
    assert rp.plan_motion(rp.Problem(arm, [0.0, 0.5], goal), rng=0)
    # The same with an orientation, for an arm of six joints.
    kinematics = Kinematics(rr1)
    far = np.array([2.0, 6.0, 1.0])
    T = kinematics.pose(solve_ik(kinematics, PoseGoal("tool", far), rng=0).nearest).copy()
    direction = far - T[:3, 3]
    T[:3, 3] += share * tolerance * direction / np.linalg.norm(direction)
    result = solve_ik(kinematics, PoseGoal("tool", T), rng=0)
    assert result.found
    for q in result.solutions:
        assert_solves(rr1, q, T)


@pytest.mark.parametrize("share", [1.01, 3.0])
def test_a_pose_beyond_its_tolerance_stays_out_of_reach(planar2r, share):
    goal = PoseGoal("tool", [1.7 + share * 1e-4, 0.0, 0.0])
    result = solve_ik(Kinematics(planar2r), goal, rng=0)
    assert not result.found
    assert "out of reach" in result.reason
    problem = rp.Problem(rp.Scene().with_arm("arm", planar2r), [0.0, 0.5], goal)
    assert rp.plan(problem, rng=0).status is rp.PlanStatus.INFEASIBLE
