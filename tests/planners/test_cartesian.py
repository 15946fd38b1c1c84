"""Straight lines: straight between waypoints too, certified; otherwise a reason and the fraction reached."""

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.collision import CollisionChecker
from rr1plan.model import Kinematics
from rr1plan.planners.cartesian import CartesianPlanner
from rr1plan.planning import Budget, PlanStatus
from rr1plan.scene import Arm, Scene
from rr1plan.scene.problem import PoseGoal, Problem
from rr1plan.shapes import Box, Sphere
from rr1plan.transforms import rotation_about, rotation_angle

START = np.array([0.3, 0.1, 0.4, -0.5, 1.0, 0.2])


def alone(robot):
    return Scene({"arm": Arm(robot)})


def leave_of_line(robot, path, end):
    """The most that densely sampled tool poses leave the line from the first one to `end` [m], by plain kinematics."""
    points = np.array([robot.link_poses(q)["tool"][:3, 3] for q in path.sample(0.01)])
    line = end - points[0]
    along = np.clip((points - points[0]) @ line / (line @ line), 0.0, 1.0)
    return np.linalg.norm(points - points[0] - along[:, None] * line, axis=1).max()


def test_rr1_moves_straight_to_a_full_pose_and_turns_evenly(rr1, is_certified):
    T0 = rr1.link_poses(START)["tool"]
    goal = T0.copy()
    goal[:3, 3] += [0.05, -0.08, 0.06]
    axis, angle = np.array([0.0, -0.6, -0.8]), 0.2
    goal[:3, :3] = T0[:3, :3] @ rotation_about(axis, angle)
    result = CartesianPlanner().plan(Problem(alone(rr1), START, PoseGoal("tool", goal)), rng=0)
    assert result.found, result.reason
    path = result.path
    np.testing.assert_array_equal(path.waypoints[0], START)
    end = rr1.link_poses(path.waypoints[-1])["tool"]
    np.testing.assert_allclose(end, goal, atol=1e-4)
    assert leave_of_line(rr1, path, goal[:3, 3]) < 1e-3
    length = np.linalg.norm(goal[:3, 3] - T0[:3, 3])
    for q in path.sample(0.01):
        T = rr1.link_poses(q)["tool"]
        part = np.linalg.norm(T[:3, 3] - T0[:3, 3]) / length
        even = T0[:3, :3] @ rotation_about(axis, part * angle)
        assert rotation_angle(even.T @ T[:3, :3]) < 1e-2
    assert is_certified(alone(rr1), path.waypoints)


@pytest.mark.parametrize("tolerance", [1e-2, 1e-3, 1e-4])
def test_the_tolerance_holds_between_waypoints(planar2r, tolerance):
    start, end = [0.4, 1.2], np.array([0.2, 1.3, 0.0])
    planner = CartesianPlanner(tolerance=tolerance)
    result = planner.plan(Problem(alone(planar2r), start, PoseGoal("tool", end)))
    assert result.found
    assert leave_of_line(planar2r, result.path, end) <= tolerance
    assert np.abs(np.diff(result.path.waypoints, axis=0)).sum(axis=1).max() <= 0.5


def test_a_smaller_tolerance_takes_more_waypoints(planar2r):
    problem = Problem(alone(planar2r), [0.4, 1.2], PoseGoal("tool", [0.2, 1.3, 0.0]))
    counts = [len(CartesianPlanner(tolerance=t).plan(problem).path) for t in (1e-2, 1e-3, 1e-4)]
    assert counts == sorted(counts)
    assert counts[0] < counts[2]


def test_a_line_with_orientation_held_keeps_it(rr1):
    T0 = rr1.link_poses(START)["tool"]
    goal = T0.copy()
    goal[:3, 3] += [0.0, -0.06, 0.05]
    path = CartesianPlanner().plan(Problem(alone(rr1), START, PoseGoal("tool", goal))).path_or_raise()
    for q in path.sample(0.01):
        assert rotation_angle(rr1.link_poses(q)["tool"][:3, :3].T @ T0[:3, :3]) < 1e-2


def test_a_straight_push_into_an_obstacle_ends_before_it_and_names_it(rr1):
    T0 = rr1.link_poses(START)["tool"]
    goal = T0.copy()
    goal[:3, 3] += [0.0, -0.2, 0.0]
    wall = goal[:3, 3] + [0.0, 0.06, 0.0]
    scene = alone(rr1).with_obstacle("wall", Box((0.5, 0.01, 0.5)), wall)
    assert CollisionChecker(scene).is_free(START)
    result = CartesianPlanner().plan(Problem(scene, START, PoseGoal("tool", goal[:3, 3])), rng=0)
    assert result.path is None
    assert result.status in (PlanStatus.INFEASIBLE, PlanStatus.INVALID_GOAL)
    assert "% (0." in result.reason
    assert "collision: 'arm/finger_link' and 'wall' overlap by" in result.reason
    assert "'wall'" in result.reason


def test_a_line_stopped_by_a_joint_limit_names_the_joint():
    robot = rp.load_robot("planar2r_limited")
    start = np.array([0.0, 2.0])
    end = robot.link_poses(np.array([0.3, 2.8]))["tool"][:3, 3]
    result = CartesianPlanner().plan(Problem(alone(robot), start, PoseGoal("tool", end)), rng=0)
    assert not result.found
    assert "joint limit: joint 'joint2' at 2.6" in result.reason
    assert "outside [-2.6, 2.6]" in result.reason


def test_a_line_through_the_hole_of_the_annulus_is_out_of_reach_there(planar2r):
    start = np.array([0.0, 2.5])
    here = planar2r.link_poses(start)["tool"][:3, 3]
    result = CartesianPlanner().plan(Problem(alone(planar2r), start, PoseGoal("tool", -here)), rng=0)
    assert result.status is PlanStatus.INFEASIBLE
    assert "the next point of the line is out of reach of arm/tool" in result.reason
    assert "the goal itself has a free configuration" in result.reason
    part = float(result.reason.split("after ")[1].split(" %")[0]) / 100
    along = np.linalg.norm(here) * (1 - 2 * part)
    assert along == pytest.approx(0.3, abs=2e-3)


def test_the_reason_of_a_line_keeps_the_name_of_its_arm(planar2r):
    start = np.array([0.0, 2.5])
    here = planar2r.link_poses(start)["tool"][:3, 3]
    scene = Scene({"the goal": Arm(planar2r)})
    result = CartesianPlanner().plan(Problem(scene, start, PoseGoal("tool", -here)), rng=0)
    assert "the next point of the line is out of reach of the goal/tool" in result.reason


def test_a_goal_beyond_reach_is_told_with_the_distance(planar2r):
    result = CartesianPlanner().plan(Problem(alone(planar2r), [0.0, 1.0], PoseGoal("tool", [2.0, 0.0, 0.0])), rng=0)
    assert result.status is PlanStatus.INFEASIBLE
    assert "0.3 m away" in result.reason


def test_of_several_goals_the_first_that_can_be_reached_is(planar2r):
    goals = [PoseGoal("tool", [5.0, 0.0, 0.0]), PoseGoal("tool", [0.9, 0.9, 0.0])]
    path = CartesianPlanner().plan(Problem(alone(planar2r), [0.4, 1.2], goals)).path_or_raise()
    end = planar2r.link_poses(path.waypoints[-1])["tool"][:3, 3]
    np.testing.assert_allclose(end, [0.9, 0.9, 0.0], atol=1e-4)


def test_a_goal_at_the_start_is_a_path_of_one_waypoint(rr1):
    T = rr1.link_poses(START)["tool"]
    result = CartesianPlanner().plan(Problem(alone(rr1), START, PoseGoal("tool", T)))
    np.testing.assert_array_equal(result.path_or_raise().waypoints, [START])


def test_an_arm_moves_straight_while_another_rests(rr1):
    scene = Scene({"left": Arm(rr1), "right": Arm(rr1, [0.0, 0.8, 0.0])})
    T = rr1.link_poses(START)["tool"]
    problem = Problem(scene, START, PoseGoal("tool", T[:3, 3] + [0.0, -0.05, 0.05]), arms=["left"])
    path = CartesianPlanner().plan(problem).path_or_raise()
    assert path.joint_names == tuple(f"left/{n}" for n in rr1.joint_names)
    assert leave_of_line(rr1, path, T[:3, 3] + [0.0, -0.05, 0.05]) < 1e-3


def test_a_start_in_collision_is_reported(rr1):
    at = rr1.link_poses(START)["hand_link"][:3, 3]
    problem = Problem(alone(rr1).with_obstacle("ball", Sphere(0.02), at), START, PoseGoal("tool", at))
    result = CartesianPlanner().plan(problem)
    assert result.status is PlanStatus.INVALID_START
    assert "'ball'" in result.reason


def test_budget_and_progress_are_kept(rr1):
    T = rr1.link_poses(START)["tool"]
    problem = Problem(alone(rr1), START, PoseGoal("tool", T[:3, 3] + [0.0, -0.05, 0.05]))
    said = []
    result = CartesianPlanner().plan(problem, budget=Budget(np.inf, iterations=2), progress=said.append)
    assert result.status is PlanStatus.TIMEOUT
    assert "out of budget after" in result.reason
    assert result.iterations == 2
    assert said[0].fraction == 0.0


def test_a_callback_cancels_and_an_interrupt_comes_through(rr1):
    T = rr1.link_poses(START)["tool"]
    problem = Problem(alone(rr1), START, PoseGoal("tool", T[:3, 3] + [0.0, -0.05, 0.05]))

    def interrupt(_progress):
        raise KeyboardInterrupt

    assert CartesianPlanner().plan(problem, progress=lambda _progress: False).status is PlanStatus.CANCELLED
    with pytest.raises(KeyboardInterrupt):
        CartesianPlanner().plan(problem, progress=interrupt)


def test_the_line_is_the_same_whatever_the_seed(rr1):
    T = Kinematics(rr1).pose(START)
    problem = Problem(alone(rr1), START, PoseGoal("tool", T[:3, 3] + [0.0, -0.05, 0.05]))
    a, b = (CartesianPlanner().plan(problem, rng=seed).path_or_raise() for seed in (1, 2))
    np.testing.assert_array_equal(a.waypoints, b.waypoints)


def test_wrong_problems_and_settings_are_told(rr1):
    with pytest.raises(rp.InputError, match="moves to a pose, got a configuration"):
        CartesianPlanner().plan(Problem(alone(rr1), START, "home"))
    scene = Scene({"left": Arm(rr1), "right": Arm(rr1, [0.0, 0.8, 0.0])})
    goal = PoseGoal("tool", [0.0, 0.0, 0.5])
    with pytest.raises(rp.InputError, match="moves one arm, got 2"):
        CartesianPlanner().plan(Problem(scene, "home", {"left": goal, "right": goal}))
    with pytest.raises(rp.InputError, match="tolerance is -1"):
        CartesianPlanner(tolerance=-1.0)
