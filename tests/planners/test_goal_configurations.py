"""Goals become free goal configurations, or a reason."""

import re
from dataclasses import replace

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.collision import CollisionChecker
from rr1plan.planners.goal_configurations import GoalSearch, check_start
from rr1plan.planners.planning_query import Query
from rr1plan.planning import PlanStatus
from rr1plan.scene import Arm, Scene
from rr1plan.scene.problem import JointGoal, PoseGoal, Problem, RegionGoal
from rr1plan.shapes import Box, Sphere
from rr1plan.transforms import pose

FREE = np.array([0.3, 0.1, 0.4, -0.5, 1.0, 0.2])


def alone(robot):
    return Scene({"arm": Arm(robot)})


def goals_of(problem, **settings):
    return GoalSearch(problem, CollisionChecker(problem.scene, problem.arms), 0, **settings).find()


def start_of(problem):
    return check_start(problem, CollisionChecker(problem.scene, problem.arms))


def test_a_joint_goal_is_taken_as_it_is(rr1):
    goals = goals_of(Problem(alone(rr1), "home", FREE))
    np.testing.assert_array_equal(goals.configurations, [FREE])
    assert goals.status is None
    assert goals.reason == ""


def test_a_continuous_joint_goes_the_short_way(planar2r):
    goals = goals_of(Problem(alone(planar2r), [3.0, 0.0], [-3.0, 6.2]))
    np.testing.assert_allclose(goals.configurations, [[2 * np.pi - 3.0, 6.2 - 2 * np.pi]], atol=1e-12)
    goals = goals_of(Problem(alone(planar2r), [25.0, -40.0], [0.0, 0.0]))
    assert (np.abs(goals.configurations - [25.0, -40.0]) <= np.pi).all()


@pytest.mark.parametrize("height", [0.3, 0.0])
def test_a_region_is_reached_at_its_rim(planar2r, height):
    """The tool can be on a face of the box only."""
    q = np.array([0.3, 0.4])
    at = planar2r.link_poses(q)[planar2r.tool][:3, 3]
    region = RegionGoal("tool", np.subtract(at, [0.1, 0.1, 0.0]), np.add(at, [0.1, 0.1, height]))
    result = rp.plan(Problem(alone(planar2r), q, region), rng=0)
    assert result.found
    assert rp.validate(
        rp.Trajectory.rest(("arm/joint1", "arm/joint2"), q), alone(planar2r), Problem(alone(planar2r), q, region)
    )


def test_the_end_of_a_motion_to_a_limit_is_a_valid_start(rr1):
    """The last sample of a motion may be beyond a limit by rounding."""
    q = np.array(rr1.home)
    q[0] = np.nextafter(rr1.limits.upper[0], np.inf)
    scene = alone(rr1)
    assert rp.plan(Problem(scene, q, "home"), rng=0).found
    assert rp.plan(Problem(scene, "home", q), rng=0).found
    motion = rp.plan_motion(Problem(scene, q, "home"), rng=0)
    assert motion.valid
    q[0] = rr1.limits.upper[0] + 1e-6
    assert rp.plan(Problem(scene, q, "home"), rng=0).status is PlanStatus.INVALID_START


@pytest.mark.parametrize(("gap", "valid"), [(3e-7, False), (9e-7, False), (1.2e-6, True)])
def test_ends_from_which_no_edge_can_be_proven_are_invalid(planar2r, gap, valid):
    scene = alone(planar2r)
    far = CollisionChecker(scene.with_obstacle("plate", Box((9, 9, 0.1)), [0, 0, -1.0])).clearance([0.3, 0.4])
    scene = scene.with_obstacle("plate", Box((9, 9, 0.1)), [0, 0, far - gap - 1.0])
    problem = Problem(scene, [0.0, 0.0], [1.5, 1.0])
    assert ("are less than a micrometer from contact" in start_of(problem)) != valid
    assert (goals_of(problem).status is None) == valid
    motion = rp.plan_motion(problem, rng=0)
    assert motion.status is (PlanStatus.FOUND if valid else PlanStatus.INVALID_START)
    assert not motion.found or motion.valid


def test_a_bounded_joint_goes_where_it_is_told(rr1):
    goal = FREE.copy()
    goal[0] = -2.3
    start = FREE.copy()
    start[0] = 2.3
    np.testing.assert_array_equal(goals_of(Problem(alone(rr1), start, goal)).configurations, [goal])


def test_pose_goals_give_free_configurations_that_reach_them_nearest_first(rr1):
    T = rr1.link_poses(FREE)["tool"]
    problem = Problem(alone(rr1), "home", PoseGoal("tool", T[:3, 3]))
    checker = CollisionChecker(problem.scene)
    goals = GoalSearch(problem, checker, 0, max_per_goal=5).find()
    assert len(goals.configurations) == 5
    for q in goals.configurations:
        assert checker.is_free(q)
        np.testing.assert_allclose(rr1.link_poses(q)["tool"][:3, 3], T[:3, 3], atol=1e-4)
    far = np.linalg.norm(goals.configurations - rr1.home, axis=1)
    assert (np.diff(far) >= 0).all()


def test_a_region_goal_ends_inside_the_region(rr1):
    region = RegionGoal("tool", [-0.5, -0.1, 0.25], [-0.35, 0.1, 0.4])
    goals = goals_of(Problem(alone(rr1), "home", region))
    assert len(goals.configurations) > 0
    for q in goals.configurations:
        p = rr1.link_poses(q)["tool"][:3, 3]
        assert (p >= region.lower).all()
        assert (p <= region.upper).all()


def test_of_a_set_of_goals_the_bad_ones_are_left_out(rr1):
    beyond = FREE.copy()
    beyond[1] = 2.0
    goals = goals_of(Problem(alone(rr1), "home", [beyond, FREE, PoseGoal("tool", [9.0, 0.0, 0.0])]))
    np.testing.assert_array_equal(goals.configurations, [FREE])


def test_a_joint_goal_out_of_limits_names_the_joint_and_the_excess(rr1):
    beyond = FREE.copy()
    beyond[1] = 0.5
    goals = goals_of(Problem(alone(rr1), "home", beyond))
    assert goals.status is PlanStatus.INVALID_GOAL
    assert "joint 'upper_arm_joint' at 0.5 rad, outside [-0.392699, 0.392699] by 0.107 rad" in goals.reason


def test_a_joint_goal_in_collision_names_the_pair_and_the_depth(rr1):
    tool = rr1.link_poses(FREE)["hand_link"][:3, 3]
    scene = alone(rr1).with_obstacle("ball", Sphere(0.02), tool)
    goals = goals_of(Problem(scene, "home", JointGoal(FREE)))
    assert goals.status is PlanStatus.INVALID_GOAL
    assert re.search("'arm/hand_link' and 'ball' overlap by [0-9.]+ mm", goals.reason)


def test_a_pose_goal_whose_solutions_all_collide_says_so(rr1):
    T = rr1.link_poses(FREE)["tool"]
    scene = alone(rr1).with_obstacle("block", Box((0.2, 0.2, 0.2)), T[:3, 3])
    goals = goals_of(Problem(scene, "home", PoseGoal("tool", T)))
    assert goals.status is PlanStatus.INVALID_GOAL
    assert "in collision" in goals.reason
    assert "'block' overlap by" in goals.reason


def test_a_blocked_pose_is_explained_without_measuring_all_its_configurations(rr1, monkeypatch):
    measured = []
    contacts = CollisionChecker.contacts
    monkeypatch.setattr(CollisionChecker, "contacts", lambda self, q: measured.append(q) or contacts(self, q))
    at = rr1.link_poses(FREE)["tool"][:3, 3]
    goals = goals_of(Problem(alone(rr1).with_obstacle("ball", Sphere(0.05), at), "home", PoseGoal("tool", at)))
    found = re.search(
        r"every configuration found \((\d+) configurations\); the least deep of the first \d+: ", goals.reason
    )
    assert int(found[1]) > 50
    assert len(measured) < 0.3 * int(found[1])


def test_an_unreachable_pose_goal_says_how_far_it_is(planar2r):
    goals = goals_of(Problem(alone(planar2r), "home", PoseGoal("tool", [2.0, 0.0, 0.0])))
    assert goals.status is PlanStatus.INFEASIBLE
    assert "0.3 m away" in goals.reason
    assert goals.configurations.shape == (0, 2)


def test_the_same_seed_gives_the_same_goals(rr1):
    problem = Problem(alone(rr1), "home", RegionGoal("tool", [-0.5, -0.1, 0.25], [-0.35, 0.1, 0.4]))
    np.testing.assert_array_equal(goals_of(problem).configurations, goals_of(problem).configurations)


def two_planar_arms(planar2r):
    """Two arms in one plane, 2 m apart: their tools meet in the middle."""
    return Scene({"left": Arm(planar2r), "right": Arm(planar2r, [2.0, 0.0, 0.0], [np.pi / 2, 0.0])})


def test_goals_of_several_arms_combine_without_touching(planar2r):
    scene = two_planar_arms(planar2r)
    goal = {"left": PoseGoal("tool", [0.9, 0.4, 0.0]), "right": PoseGoal("tool", [1.1, 0.4, 0.0])}
    problem = Problem(scene, None, goal)
    checker = CollisionChecker(scene)
    goals = GoalSearch(problem, checker, 0).find()
    assert 1 <= len(goals.configurations) <= 4
    for q in goals.configurations:
        assert checker.is_free(q)
        poses = scene.link_poses(scene.split(q))
        np.testing.assert_allclose(poses["left/tool"][:3, 3], [0.9, 0.4, 0.0], atol=1e-4)
        np.testing.assert_allclose(poses["right/tool"][:3, 3], [1.1, 0.4, 0.0], atol=1e-4)


def test_an_arm_in_the_way_of_another_arms_goal_may_move_away(planar2r):
    scene = two_planar_arms(planar2r)
    start = {"left": [0.0, 0.0], "right": [np.pi / 2, 0.0]}
    away = {"left": [np.pi / 2, 0.0], "right": [np.pi, 0.0]}
    goals = goals_of(Problem(scene, start, away))
    np.testing.assert_allclose(goals.configurations, [[np.pi / 2, 0.0, np.pi, 0.0]])


def test_goals_at_which_the_arms_touch_each_other_are_refused(planar2r):
    scene = two_planar_arms(planar2r)
    goals = goals_of(Problem(scene, None, {"left": [0.0, 0.0], "right": [np.pi, 0.0]}))
    assert goals.status is PlanStatus.INVALID_GOAL
    assert "collide with each other" in goals.reason
    assert "left/link" in goals.reason
    assert "right/link" in goals.reason


def test_many_arms_with_many_goals_are_combined_in_bounded_time(planar2r):
    arms = {f"a{i}": Arm(planar2r, [4.0 * i, 0.0, 0.0]) for i in range(12)}
    goal = {name: PoseGoal("tool", arm.base[:3, 3] + [1.0, 0.5, 0.0]) for name, arm in arms.items()}
    goals = goals_of(Problem(Scene(arms), None, goal), max_composites=6)
    assert goals.configurations.shape == (6, 24)
    assert len(np.unique(goals.configurations.round(6), axis=0)) == 6


def test_a_search_for_goals_goes_on_to_others(rr1):
    T = rr1.link_poses(FREE)["tool"]
    problem = Problem(alone(rr1), "home", PoseGoal("tool", T[:3, 3]))
    checker = CollisionChecker(problem.scene)
    search = GoalSearch(problem, checker, 0)
    goals = np.concatenate([search.find().configurations, search.more(), search.more()])
    assert len(goals) == 24
    assert len(np.unique(goals.round(3), axis=0)) == 24
    for q in goals:
        assert checker.is_free(q)
        np.testing.assert_allclose(rr1.link_poses(q)["tool"][:3, 3], T[:3, 3], atol=1e-4)


def test_there_are_no_more_goals_than_there_are(planar2r):
    problem = Problem(alone(planar2r), "home", [PoseGoal("tool", [1.0, 0.5, 0.0]), JointGoal([1.0, 1.0])])
    search = GoalSearch(problem, CollisionChecker(problem.scene), 0)
    assert search.find().configurations.shape == (3, 2)
    assert search.more().shape == (0, 2)


def test_further_goals_may_leave_out_copies_a_turn_away(planar2r):
    turning = planar2r.with_limits(replace(planar2r.limits, lower=np.full(2, -9.0), upper=np.full(2, 9.0)))
    problem = Problem(alone(turning), "home", PoseGoal("tool", [1.0, 0.5, 0.0]))
    search = GoalSearch(problem, CollisionChecker(problem.scene), 0)
    found = search.find().configurations
    assert search.more(turned_copies=False).shape == (0, 2)
    copies = search.more()
    assert len(copies) > len(found)
    np.testing.assert_allclose(np.unique(np.cos(copies).round(6), axis=0), np.unique(np.cos(found).round(6), axis=0))


def test_more_goals_of_several_arms_are_other_combinations(planar2r):
    scene = two_planar_arms(planar2r)
    goal = {"left": RegionGoal("tool", [0.5, 0.4, 0.0], [0.9, 0.6, 0.0]), "right": PoseGoal("tool", [1.1, 0.4, 0.0])}
    problem = Problem(scene, None, goal)
    checker = CollisionChecker(scene)
    search = GoalSearch(problem, checker, 0, max_per_goal=3, max_composites=4)
    goals = np.concatenate([search.find().configurations, *(search.more() for _ in range(3))])
    assert len(goals) > 8
    assert len(np.unique(goals, axis=0)) == len(goals)
    assert all(checker.is_free(q) for q in goals)


def test_goals_that_collide_with_each_other_are_followed_by_others(planar2r):
    scene = two_planar_arms(planar2r)
    goal = {"left": RegionGoal("tool", [1.2, -0.3, 0.0], [1.65, 0.3, 0.0]), "right": PoseGoal("tool", [1.0, 0.1, 0.0])}
    problem = Problem(scene, {"left": [2.0, 0.5], "right": [1.0, 0.5]}, goal)
    motion = CollisionChecker(scene)
    search = GoalSearch(problem, motion, 0, max_per_goal=1)
    # The first configurations of both, each free by itself, touch each other.
    first = [finder for finder in search._finders if finder.add(problem.goal[finder.arm][0], 1) is None]
    assert not motion.is_free(np.concatenate([finder.found[0] for finder in first]))
    goals = GoalSearch(problem, motion, 0, max_per_goal=1).find()
    assert goals.status is None
    assert all(motion.is_free(q) for q in goals.configurations)


def test_a_good_start_is_no_reason(rr1):
    assert start_of(Problem(alone(rr1), FREE, "home")) == ""


def test_a_start_out_of_limits_names_arm_joint_and_excess(rr1):
    beyond = FREE.copy()
    beyond[4] = -0.25
    reason = start_of(Problem(alone(rr1), beyond, "home"))
    assert "arm: joint 'wrist_joint' at -0.25 rad, outside [0, 3.14159] by 0.25 rad" in reason


def test_a_start_in_collision_names_the_pair_and_the_depth(rr1):
    at = rr1.link_poses(FREE)["hand_link"][:3, 3]
    reason = start_of(Problem(alone(rr1).with_obstacle("ball", Sphere(0.02), at), FREE, "home"))
    assert reason.startswith("the start is in collision: ")
    assert re.search("'arm/hand_link' and 'ball' overlap by [0-9.]+ mm", reason)


def test_settings_that_make_no_sense_are_told(rr1):
    problem = Problem(alone(rr1), "home", PoseGoal("tool", [-0.3, 0.0, 0.3]))
    with pytest.raises(rp.InputError, match="expected at least one"):
        goals_of(problem, max_per_goal=0)


@pytest.mark.parametrize("name", ["rr1_cage", "planar2r_path"])
def test_plain_questions_are_sorted_out_as_others_are(name):
    """Goals out of limits or in collision are left out, the others come nearest first, straight lines are as proven."""
    scene = rp.load_scene(name)
    robot = scene.arms[scene.only_arm()].robot
    rng, ends = np.random.default_rng(4), {"none": 0, "some": 0, "lines": 0}
    low, high = np.maximum(robot.limits.lower, -3.0), np.minimum(robot.limits.upper, 3.0)
    for _ in range(40):
        start = rng.uniform(low, high)
        goals = [*(start + rng.normal(size=(11, robot.nq)) * rng.choice([0.05, 0.5])), high + 0.5]
        problem = Problem(scene, start, [JointGoal(q) for q in goals])
        slow, blocked = goals_of(problem), start_of(problem)
        with Query("rrt_connect", problem, None, 0, None) as query:
            refusal = query.early_exit()
            if blocked or slow.status is not None:
                assert refusal is not None
                assert refusal.reason == (blocked or slow.reason)
                ends["none"] += 1
                continue
            ends["some"] += len(query.goals) < len(goals)
            np.testing.assert_allclose(query.goals, slow.configurations, atol=1e-14)
            motion = CollisionChecker(scene)
            lines = [motion.edge_is_free_slowly(start, q) for q in slow.configurations[:8]]
            answer = query.straight_line(8)
            assert (answer is not None) == any(lines)
            if answer is not None:
                np.testing.assert_array_equal(answer.path.waypoints[-1], query.goals[lines.index(True)])
                ends["lines"] += 1
    assert min(ends.values()) > 0


def two_branches() -> rp.Robot:
    """A torso with a left and a right arm of two joints each; the tool is at the end of the right one."""
    links, joints = [rp.Link("torso")], []
    for side, y in (("left", 0.3), ("right", -0.3)):
        for k, (parent, x) in enumerate((("torso", 0.0), (f"{side}0", 0.4))):
            bar = rp.Geometry("bar", Box((0.4, 0.04, 0.04)), pose([0.2, 0.0, 0.0]))
            links.append(rp.Link(f"{side}{k}", collisions=(bar,)))
            origin = pose([x, y if k == 0 else 0.0, 0.0])
            axis, turn = np.array([0.0, 0.0, 1.0]), {"lower": -3.0, "upper": 3.0}
            joints.append(rp.Joint(f"{side}{k}", "revolute", parent, f"{side}{k}", origin, axis=axis, **turn))
    names = tuple(joint.name for joint in joints)
    links.append(rp.Link("hand"))
    joints.append(rp.Joint("hand", "fixed", "right1", "hand", pose([0.4, 0.0, 0.0])))
    limits = rp.Limits(np.full(4, -3.0), np.full(4, 3.0), *(np.ones(4) for _ in range(4)))
    elbows = frozenset(frozenset((f"{side}0", f"{side}1")) for side in ("left", "right"))
    settings = ({"home": np.zeros(4)}, {}, elbows, "hand")
    return rp.Robot("torso", tuple(links), tuple(joints), names, limits, *settings)


def test_joints_that_do_not_move_the_tool_stay_unless_they_are_in_the_way():
    scene, left = alone(two_branches()), [0.5, 0.3]
    goal = PoseGoal("hand", [0.3, -0.7, 0.0])
    goals = goals_of(Problem(scene, [*left, 0.0, 0.0], goal)).configurations
    assert len(goals) == 2
    np.testing.assert_array_equal(goals[:, :2], [left] * len(goals))
    # Here the other arm is on the goal, in both configurations of this one.
    across = [-1.2, 0.0]
    goal = PoseGoal("hand", [0.109, 0.02, 0.0])
    problem = Problem(scene, [*across, -1.5, 0.0], goal)
    assert start_of(problem) == ""
    goals = goals_of(problem).configurations
    assert len(goals) >= 1
    assert (np.abs(goals[:, :2] - across).max(axis=1) > 0.1).all()
