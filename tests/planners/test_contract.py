"""The contract of every planner in the table; new rows are tested automatically."""

from __future__ import annotations

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.errors import InputError, NoPlanError, UnknownNameError
from rr1plan.model.joint_space import Space
from rr1plan.planners import OmplPlanner, RrtConnect, make_planner, plan, planner_names, planner_table
from rr1plan.planning import Budget, PlanStatus
from rr1plan.scene.model_library import load_problems

JOINT_SPACE = [name for name in planner_names() if name != "cartesian"]
BUDGET = Budget(seconds=float("inf"), iterations=2500)
ENOUGH = Budget(seconds=float("inf"), iterations=30000)


@pytest.fixture(scope="module")
def seam():
    return load_problems("planar2r_path")["over_the_seam"]


@pytest.fixture(scope="module")
def straight():
    """A straight line that any planner can do, the Cartesian one too."""
    scene = rp.load_scene("planar2r_path").without_obstacle("red")
    return rp.Problem(scene, start=[0.2, -0.9], goal=rp.PoseGoal("tool", scene_point(scene)))


def scene_point(scene):
    T = scene.arm("arm").base @ scene.arm("arm").robot.link_poses([0.3, -1.0])[scene.arm("arm").robot.tool]
    return T[:3, 3]


def budget_of(name):
    return BUDGET if name in [row.name for row in planner_table() if row.optimizing] else ENOUGH


@pytest.mark.parametrize("name", JOINT_SPACE)
def test_the_path_begins_at_the_start_ends_at_the_goal_and_is_certified(name, seam, is_certified):
    before = (seam.start.tobytes(), seam.scene.arm("arm").q.tobytes())
    result = plan(seam, planner=name, budget=budget_of(name), rng=5)
    assert result.status is PlanStatus.FOUND, result.reason
    points = result.path.waypoints
    assert points[0].tobytes() == seam.start.tobytes()
    off = points[-1] - seam.goal["arm"][0].q
    np.testing.assert_allclose(off - 2 * np.pi * np.round(off / (2 * np.pi)), 0.0, atol=1e-12)
    assert is_certified(seam.scene, points)
    assert result.path.joint_names == seam.joint_names
    assert result.planner == name
    assert result.iterations <= budget_of(name).iterations
    assert result.cost_history[-1][1] == pytest.approx(result.path.length)
    assert before == (seam.start.tobytes(), seam.scene.arm("arm").q.tobytes())


@pytest.mark.parametrize("name", JOINT_SPACE)
def test_the_same_seed_gives_the_same_path_and_the_result_names_it(name, seam):
    first = plan(seam, planner=name, budget=budget_of(name), rng=np.random.default_rng(3))
    again = plan(seam, planner=name, budget=budget_of(name), rng=first.seed)
    assert first.path.waypoints.tobytes() == again.path.waypoints.tobytes()
    assert first.iterations == again.iterations


@pytest.mark.parametrize("name", planner_names())
def test_a_line_that_is_free_is_found_by_all(name, straight, is_certified):
    result = plan(straight, planner=name, budget=BUDGET, rng=0)
    assert result.status is PlanStatus.FOUND, result.reason
    assert is_certified(straight.scene, result.path.waypoints)


@pytest.mark.parametrize("name", planner_names())
def test_a_blocked_start_is_reported_by_name(name):
    scene = rp.load_scene("planar2r_path").with_obstacle("stone", rp.Sphere(0.2), [0.9, 0.2, 0])
    problem = rp.Problem(scene, start=[0.2, 0.0], goal=rp.PoseGoal("tool", [-1.25, 0.75, 0]))
    result = plan(problem, planner=name, budget=BUDGET, rng=0)
    assert result.status is PlanStatus.INVALID_START
    assert "stone" in result.reason
    assert result.path is None
    with pytest.raises(NoPlanError, match="stone"):
        result.path_or_raise()


@pytest.mark.parametrize("name", JOINT_SPACE)
def test_a_blocked_goal_is_reported_by_name(name):
    scene = rp.load_scene("planar2r_path").with_obstacle("stone", rp.Sphere(0.2), [-0.9, 0.2, 0])
    problem = rp.Problem(scene, start=[0.2, -0.9], goal=[np.pi - 0.2, 0.0])
    result = plan(problem, planner=name, budget=BUDGET, rng=0)
    assert result.status is PlanStatus.INVALID_GOAL
    assert "stone" in result.reason


@pytest.mark.parametrize("name", JOINT_SPACE)
def test_a_pose_out_of_reach_is_infeasible(name, seam):
    problem = rp.Problem(seam.scene, start=seam.start, goal=rp.PoseGoal("tool", [9.0, 0.0, 0.0]))
    result = plan(problem, planner=name, budget=BUDGET, rng=0)
    assert result.status is PlanStatus.INFEASIBLE
    assert result.reason


@pytest.mark.parametrize("name", JOINT_SPACE)
def test_no_way_is_a_timeout_within_the_budget(name):
    problem = load_problems("planar2r_no_path")["no_way"]
    result = plan(problem, planner=name, budget=Budget(seconds=float("inf"), iterations=400), rng=0)
    assert result.status is PlanStatus.TIMEOUT
    assert result.path is None
    assert result.iterations <= 400
    assert "no path" in result.reason


@pytest.mark.parametrize("name", JOINT_SPACE)
def test_a_start_at_the_goal_is_a_path_of_no_length(name, seam):
    result = plan(rp.Problem(seam.scene, start=seam.start, goal=seam.start), planner=name, budget=BUDGET)
    assert result.status is PlanStatus.FOUND
    assert result.path.length == 0.0


def test_the_table_has_all_planners_described():
    assert len(planner_names()) == len(set(planner_names())) == 18
    assert all(row.description and "\n" not in row.description for row in planner_table())


def test_wrong_names_list_the_near_ones(seam):
    with pytest.raises(UnknownNameError, match="rrt_connect"):
        plan(seam, planner="rrt_conect")
    with pytest.raises(UnknownNameError, match="goal_bias"):
        OmplPlanner("rrt", settings={"goal_bais": 0.1})
    with pytest.raises(InputError, match="Problem"):
        plan(seam.scene)


def test_the_tree_is_kept_when_asked_for(seam):
    result = RrtConnect(tree=True, range=0.5).plan(seam, budget=ENOUGH, rng=1)
    assert result.tree.vertices.shape[1] == seam.nq
    assert len(result.tree.edges) > 1
    assert plan(seam, planner="rrt_connect", budget=ENOUGH, rng=1).tree is None


def test_progress_is_told_and_may_cancel(seam):
    told = []

    def progress(p):
        told.append(p)
        return False

    result = OmplPlanner("rrt_star").plan(seam, budget=Budget(seconds=20.0), rng=0, progress=progress)
    assert result.status is PlanStatus.CANCELLED
    assert len(told) == 1
    assert told[0].stage == "rrt_star"
    assert 0.0 <= told[0].fraction <= 1.0


def test_continuous_joints_take_the_short_way_over_the_seam():
    scene = rp.load_scene("planar2r_path")
    for name in tuple(scene.obstacles):
        scene = scene.without_obstacle(name)
    result = plan(rp.Problem(scene, start=[3.0, 0.5], goal=[-3.0, 0.5]), rng=0)
    assert result.path.length == pytest.approx(2 * np.pi - 6.0)


def test_a_joint_that_cannot_move_is_left_out_of_the_search(rr1):
    limits = rr1.limits
    lower, upper = limits.lower.copy(), limits.upper.copy()
    lower[0] = upper[0] = rr1.home[0]
    fixed = rr1.with_limits(rp.Limits(lower, upper, limits.velocity, limits.acceleration, limits.jerk, limits.effort))
    problem = rp.Problem(rp.Scene().with_arm("arm", fixed), start="home", goal="home")
    space = Space.around(problem, np.array([rr1.home]))
    assert space.movable.tolist() == [False] + [True] * (rr1.nq - 1)
    np.testing.assert_array_equal(space.whole(space.reduce(rr1.home), rr1.home), rr1.home)


def test_rr1_goes_into_the_cage_and_out(is_certified):
    for name, problem in load_problems("rr1_cage").items():
        result = plan(problem, rng=1)
        assert result.found, f"{name}: {result.reason}"
        assert is_certified(problem.scene, result.path.waypoints)


@pytest.mark.parametrize("name", planner_names())
@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"problem": "over the seam"}, "problem is of type str"),
        ({"budget": 5.0}, "budget is of type float, expected Budget, e.g. Budget"),
        ({"progress": "bar"}, "progress is 'bar'"),
    ],
)
def test_what_is_no_question_is_refused_by_every_planner_itself(name, wrong, said, seam):
    with pytest.raises(InputError, match=said):
        make_planner(name).plan(**{"problem": seam, **wrong})


@pytest.mark.parametrize("wrong", [RrtConnect, 3, None])
def test_what_is_no_planner_is_refused_by_name(wrong, seam):
    with pytest.raises((InputError, UnknownNameError), match="planner"):
        plan(seam, planner=wrong)


def test_an_unknown_setting_is_told_with_all_there_are():
    with pytest.raises(UnknownNameError, match=r"unknown rrt setting 'rang'.*: goal_bias, intermediate_states, range"):
        OmplPlanner("rrt", settings={"rang": 0.5})
    with pytest.raises(InputError, match="range"):
        OmplPlanner("rrt", settings={"range": "far"})
