"""Seeded problems: their starts and goals are free and apart, and a seed gives the same problem again."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import partial
from itertools import count
from pathlib import Path

import numpy as np
import pytest

import rr1plan as rp
from rr1plan import (
    conveyor_line,
    dual_arm_shelf,
    handover_window,
    random_grid,
    reach_grid,
    ring_swap,
    shared_bin,
    shelf_rows,
)
from rr1plan.checks import Array
from rr1plan.collision import CollisionChecker
from rr1plan.errors import InputError
from rr1plan.multi.agents import Agent
from rr1plan.multi.paths.placed_path import placed_configuration
from rr1plan.multi.scenarios import endpoint_sampling, problems
from rr1plan.multi.scenarios.endpoint_sampling import floor_under, front_of, one_turn, problem_between
from rr1plan.multi.timing.coordination import are_apart

_KINDS: dict[str, Callable[[rp.Robot, int], rp.Problem]] = {
    "grid": lambda robot, seed: random_grid(robot, 6, 0.55, seed),
    "ring": lambda robot, seed: ring_swap(robot, 4, 0.5, rng=seed),
    "shelf": lambda robot, seed: dual_arm_shelf(robot, 0.6, seed),
    "opposite": lambda robot, seed: ring_swap(robot, 4, 0.36, 2, rng=seed),
    "reaches": lambda robot, seed: reach_grid(robot, 6, 0.6, seed),
    "hand-over": lambda robot, seed: handover_window(robot, 0.10, seed),
    "bin": lambda robot, seed: shared_bin(robot, 4, seed),
    "conveyor": lambda robot, seed: conveyor_line(robot, 4, seed),
    "shelves": lambda robot, seed: shelf_rows(robot, 8, seed),
}


@pytest.mark.parametrize("kind", list(_KINDS))
def test_starts_and_goals_are_free_and_seeded(kind: str, rr1: rp.Robot) -> None:
    problem, again, other = _KINDS[kind](rr1, 3), _KINDS[kind](rr1, 3), _KINDS[kind](rr1, 4)
    checker = CollisionChecker(problem.scene, problem.arms)
    goal = np.concatenate([problem.goal[arm][0].q for arm in problem.arms])
    for q in (problem.start, goal):
        assert checker.is_free_slowly(q)
        assert checker.within_limits(q)
    assert again.start.tobytes() == problem.start.tobytes()
    assert other.start.tobytes() != problem.start.tobytes()


def test_in_a_ring_each_tool_gets_where_the_neighbor_was(rr1: rp.Robot) -> None:
    problem = ring_swap(rr1, 3, 0.5, rng=1)
    ends = []
    for q in (problem.start, np.concatenate([problem.goal[arm][0].q for arm in problem.arms])):
        poses = problem.scene.link_poses(problem.scene.split(q, problem.arms))
        ends.append(np.array([poses[f"{arm}/{rr1.tool}"][:3, 3] for arm in problem.arms]))
    np.testing.assert_allclose(ends[1], np.roll(ends[0], -1, axis=0), atol=1e-3)


def tools(problem: rp.Problem, q: np.ndarray) -> dict[str, np.ndarray]:
    """Positions of the tools of all arms."""
    poses = problem.scene.link_poses(problem.scene.split(q, problem.arms))
    return {arm: poses[f"{arm}/{problem.scene.arms[arm].robot.tool}"][:3, 3] for arm in problem.arms}


def goal_of(problem: rp.Problem) -> np.ndarray:
    return np.concatenate([problem.goal[arm][0].q for arm in problem.arms])


def test_in_a_ring_tools_get_across(rr1: rp.Robot) -> None:
    problem = ring_swap(rr1, 4, 0.36, 2, rng=0)
    before, after = (np.array(list(tools(problem, q).values())) for q in (problem.start, goal_of(problem)))
    np.testing.assert_allclose(after, np.roll(before, -2, axis=0), atol=1e-3)


@pytest.mark.parametrize("width", [0.10, 0.20])
def test_tools_meet_in_the_window(width: float, rr1: rp.Robot) -> None:
    problem = handover_window(rr1, width, 1, gap=0.05)
    one, two = tools(problem, goal_of(problem)).values()
    assert np.linalg.norm(one - two) == pytest.approx(0.05, abs=1e-3)
    wall = problem.scene.obstacles["wall"]
    inner = [g.shape.size[2] for g in wall.geometries[2:]]
    assert inner == pytest.approx([width, width])


def test_every_second_arm_starts_in_the_bin(rr1: rp.Robot) -> None:
    problem = shared_bin(rr1, 4, 2)
    ends = [tools(problem, q) for q in (problem.start, goal_of(problem))]
    inside = [[abs(p[0]) < 0.2 and abs(p[1]) < 0.15 and p[2] < 0.2 for p in end.values()] for end in ends]
    assert inside == [[True, False, True, False], [False, True, False, True]]


def test_a_problem_may_mix_robots(rr1: rp.Robot) -> None:
    slow = rr1.with_limits("hardware")
    problem = random_grid([rr1, slow], 4, 0.8, 5)
    assert [arm.robot is slow for arm in problem.scene.arms.values()] == [False, True, False, True]
    assert CollisionChecker(problem.scene, problem.arms).is_free_slowly(goal_of(problem))


def test_the_front_of_a_robot_is_where_its_tool_is(rr1: rp.Robot) -> None:
    np.testing.assert_array_equal(front_of(rr1), [-1.0, 0.0, 0.0])


def test_a_problem_is_saved_in_a_scene_file(tmp_path: Path, rr1: rp.Robot) -> None:
    problem = shared_bin(rr1, 2, 1)
    file = rp.save_scene(tmp_path / "bin.toml", problem.scene, problems={"pick": problem})
    again = rp.load_problems(file)["pick"]
    assert again.scene.content_hash == problem.scene.content_hash
    assert again.start.tobytes() == problem.start.tobytes()
    assert goal_of(again).tobytes() == goal_of(problem).tobytes()


def test_problems_that_cannot_be_made_are_refused(rr1: rp.Robot) -> None:
    with pytest.raises(InputError, match="count"):
        random_grid(rr1, 0, 0.8)
    with pytest.raises(InputError, match="radius"):
        ring_swap(rr1, 3, -1.0)
    with pytest.raises(InputError, match="step is 6"):
        ring_swap(rr1, 3, 0.5, 6, rng=0)
    with pytest.raises(InputError, match="no swap found"):
        ring_swap(rr1, 2, 3.0, rng=0)
    with pytest.raises(InputError, match="no query found"):
        dual_arm_shelf(rr1, 4.0, 0)
    with pytest.raises(InputError, match="robot is of type str, expected Robot; load one with load_robot"):
        rp.random_grid("rr1", 4, 0.6)
    with pytest.raises(InputError, match="empty sequence"):
        random_grid([], 3, 0.8)
    with pytest.raises(InputError, match="touch each other, and neither moves"):
        random_grid(rr1, 2, 0.02, 0)
    with pytest.raises(InputError, match="touch each other, and neither moves; try a larger radius"):
        ring_swap(rr1, 3, 0.1, rng=0)
    with pytest.raises(InputError, match="touch each other, and neither moves; try a wider spacing"):
        dual_arm_shelf(rr1, 0.1, 0)
    with pytest.raises(InputError, match="count is 3, expected 2 or 4"):
        shared_bin(rr1, 3)
    with pytest.raises(InputError, match="an even number"):
        shelf_rows(rr1, 3)
    with pytest.raises(InputError, match=r"width is 2 m, expected 0.05 to 1 m"):
        handover_window(rr1, 2.0)
    with pytest.raises(
        InputError, match=r"try a wider window .* a tool other than 'tool' if the hand reaches beyond it"
    ):
        handover_window(rr1, 0.10, 0, gap=0.001)


def test_robots_too_small_for_a_cell_are_refused() -> None:
    small = rp.planar_arm("RR", lengths=(0.05, 0.05), limits=[(-2.0, 2.0), (-2.0, 2.0)])
    with pytest.raises(InputError, match=r"'planar_rr' reaches 0\.\d+ m, .* no room between boards; try a larger"):
        shelf_rows(small)
    with pytest.raises(InputError, match=r"width is 0.5 m, expected less than 0\.\d+ m for 'planar_rr'"):
        handover_window(small, 0.5)


def test_a_tool_that_cannot_reach_its_place_is_named(planar2r: rp.Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    """No other draw of levels helps an arm whose tool stays at one height."""
    starts: list[int] = []
    solve = endpoint_sampling.solve_ik
    monkeypatch.setattr(
        endpoint_sampling, "solve_ik", lambda *given, **named: starts.append(1) or solve(*given, **named)
    )
    for make in (shelf_rows, shared_bin, handover_window, partial(reach_grid, count=4, spacing=2.0)):
        with pytest.raises(
            InputError, match=r"the tool 'tool' of 'planar2r' reaches none of .* points from .* to .* m"
        ):
            make(planar2r, rng=0)
        assert len(starts) <= 100
        starts.clear()


def test_bases_need_no_clearance_from_each_other(rr1: rp.Robot) -> None:
    """The gap between two bases is a millimeter, less than the margin of bodies that move."""
    problem = random_grid(rr1, 4, 0.399, 0)
    one, two = (Agent(problem, [arm]) for arm in ("arm01", "arm03"))
    placed, other = (placed_configuration(agent.bodies, agent.start) for agent in (one, two))
    assert are_apart(one, placed, two, other, margin=2e-3)
    bases = CollisionChecker(problem.scene.with_padding(2e-3), problem.arms).static_contacts
    assert ("arm01/base_link", "arm03/base_link") in bases


_SUNKEN = """
<robot name="sunken">
  <link name="world"/>
  <joint name="bolts" type="fixed"><parent link="world"/><child link="base"/></joint>
  <link name="base"><collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision></link>
  <link name="arm"><collision><origin xyz="0.2 0 0.2"/><geometry><box size="0.4 0.1 0.1"/></geometry></collision></link>
  <joint name="turn" type="revolute">
    <parent link="base"/><child link="arm"/><axis xyz="0 0 1"/><limit lower="-2" upper="2" velocity="1" effort="10"/>
  </joint>
</robot>
"""


def test_robots_that_reach_down_to_the_floor_stand_on_it(rr1: rp.Robot, tmp_path: Path) -> None:
    file = tmp_path / "sunken.urdf"
    file.write_text(_SUNKEN)
    sunken = rp.load_robot(file)
    for robot in (sunken, rr1):
        scene = rp.Scene().with_arm("arm", robot).with_obstacle("floor", floor_under(robot))
        assert CollisionChecker(scene).static_is_free
    assert floor_under(rr1).offset == 0.0
    assert -0.06 < floor_under(sunken, rr1).offset < -0.05


def test_joints_of_many_turns_are_drawn_within_one_around_home(planar2r: rp.Robot, rr1: rp.Robot) -> None:
    limits = planar2r.limits
    turning = planar2r.with_limits(
        rp.Limits([-9.0, -np.inf], [9.0, np.inf], limits.velocity, limits.acceleration, limits.jerk, limits.effort)
    )
    low, high = one_turn(turning)
    np.testing.assert_allclose(low, turning.home - np.pi)
    np.testing.assert_allclose(high, turning.home + np.pi)
    np.testing.assert_array_equal(one_turn(rr1), (rr1.limits.lower, rr1.limits.upper))
    for seed in range(5):
        problem = random_grid(turning, 4, 2.5, seed)
        goal = np.concatenate([problem.goal[arm][0].q for arm in problem.arms])
        for q in (problem.start, goal):
            assert (np.abs(q.reshape(4, 2) - turning.home) <= np.pi).all()


_SHOULDER = """<robot name="shoulder">
  <link name="base"/>
  <link name="beam"><collision><origin xyz="0 0 0.35"/><geometry><box size="0.06 0.06 0.6"/></geometry>
  </collision></link>
  <joint name="swing" type="revolute"><parent link="base"/><child link="beam"/><origin xyz="0 0 0.3"/>
    <axis xyz="1 0 0"/><limit lower="-6" upper="6" velocity="1" effort="1"/></joint>
</robot>"""


def test_goals_are_on_the_turn_that_leads_to_them(tmp_path: Path) -> None:
    file = tmp_path / "shoulder.urdf"
    file.write_text(_SHOULDER)
    # Upright where the joint is at half a turn, so that a turn around home is cut there.
    robot = rp.load_robot(file)
    scene = rp.Scene().with_arm("arm", robot, rp.transforms.pose((0, 0, 0.6), rpy=(np.pi, 0, 0)))
    scene = scene.with_obstacle("floor", rp.HalfSpace((0.0, 0.0, 1.0), 0.0))
    start, goal = {"arm": np.array([2.5])}, {"arm": np.array([-2.5])}
    assert rp.plan(rp.Problem(scene, start, goal), budget=rp.Budget(60.0, 20_000), rng=0).status.value == "infeasible"
    problem = problem_between(scene, start, goal)
    np.testing.assert_allclose(goal_of(problem), [2.0 * np.pi - 2.5])
    assert rp.plan(problem, budget=rp.Budget(60.0, 20_000), rng=0).found
    # What is reached on the given turn stays.
    np.testing.assert_array_equal(goal_of(problem_between(scene, start, {"arm": np.array([2.0])})), [2.0])


def test_a_goal_that_no_turn_leads_to_is_drawn_again(tmp_path: Path) -> None:
    file = tmp_path / "shoulder.urdf"
    file.write_text(_SHOULDER.replace('"-6"', '"-3"').replace('"6"', '"3"'))
    scene = rp.Scene().with_arm("arm", rp.load_robot(file), rp.transforms.pose((0, 0, 0.6), rpy=(np.pi, 0, 0)))
    scene = scene.with_obstacle("floor", rp.HalfSpace((0.0, 0.0, 1.0), 0.0))
    start, goal = {"arm": np.array([2.5])}, {"arm": np.array([-2.5])}
    assert not rp.plan(rp.Problem(scene, start, goal), budget=rp.Budget(60.0, 20_000), rng=0)
    problem = problem_between(scene, start, goal, rng=0)
    assert rp.plan(problem, budget=rp.Budget(60.0, 20_000), rng=0).found
    with pytest.raises(InputError, match="no goal found that 'arm' can reach from its start"):
        problem_between(scene, start, goal, 0, {"arm": lambda _: goal["arm"]})


_POST_OF_ITS_OWN = """<robot name="hindered">
  <link name="base"><collision><origin xyz="0.3 0 0"/><geometry><box size="0.1 0.1 0.6"/></geometry></collision></link>
  <link name="column"/>
  <link name="beam"><collision><origin xyz="0.3 0 0"/><geometry><box size="0.5 0.04 0.04"/></geometry></collision>
  </link>
  <joint name="turn" type="revolute"><parent link="base"/><child link="column"/><axis xyz="0 0 1"/>
    <limit lower="-2" upper="2" velocity="1" effort="1"/></joint>
  <joint name="lift" type="revolute"><parent link="column"/><child link="beam"/><axis xyz="0 1 0"/>
    <limit lower="-0.3" upper="0.3" velocity="1" effort="1"/></joint>
</robot>"""


def test_goals_are_not_behind_links_of_the_arm_itself(tmp_path: Path) -> None:
    file = tmp_path / "hindered.urdf"
    file.write_text(_POST_OF_ITS_OWN)
    problem = random_grid(rp.load_robot(file), 6, 2.0, 0)
    turns = problem.start[::2]
    assert (turns > 0.0).any()
    assert (turns < 0.0).any()
    np.testing.assert_array_equal(np.sign([problem.goal[arm][0].q[0] for arm in problem.arms]), np.sign(turns))


_STIFF = """<robot name="stiff">
  <link name="mount"/>
  <link name="foot"><collision><origin xyz="0 0 0.0505"/><geometry><cylinder radius="0.05" length="0.1"/></geometry>
  </collision></link>
  <link name="arm"><collision><origin xyz="0.15 0 0.15"/><geometry><box size="0.3 0.04 0.05"/></geometry></collision>
  </link>
  <link name="sleeve"><collision><geometry><box size="0.2 0.04 0.02"/></geometry></collision></link>
  <joint name="bolts" type="fixed"><parent link="mount"/><child link="foot"/></joint>
  <joint name="turn" type="revolute"><parent link="foot"/><child link="arm"/><axis xyz="0 0 1"/>
    <limit lower="-2" upper="2" velocity="1" effort="1"/></joint>
  <joint name="slide" type="prismatic"><parent link="arm"/><child link="sleeve"/><origin xyz="0 0 0.1108"/>
    <axis xyz="0 1 0"/><limit lower="-0.05" upper="0.05" velocity="1" effort="1"/></joint>
</robot>"""


def test_problems_of_arms_with_narrow_gaps_can_be_made(tmp_path: Path) -> None:
    file = tmp_path / "stiff.urdf"
    file.write_text(_STIFF)
    # The foot ends half a millimeter above the mount, and the sleeve is 0.3 mm from the foot wherever it is.
    robot = rp.load_robot(file)
    assert floor_under(robot).offset == pytest.approx(-0.0015)
    problem = random_grid(robot, 4, 0.8, 0)
    result = rp.plan_many_arms(problem, rng=0)
    assert result.found
    assert rp.validate(result.trajectory, problem.scene, problem).certified


def test_arms_without_shapes_are_planned_too(tmp_path: Path) -> None:
    file = tmp_path / "ghost.urdf"
    file.write_text(re.sub(r"<collision>.*?</collision>", "", _SHOULDER, flags=re.DOTALL))
    problem = random_grid(rp.load_robot(file), 3, 0.5, 0)
    result = rp.plan_many_arms(problem, rng=0)
    assert result.found
    assert rp.validate(result.trajectory, problem.scene, problem).valid


def test_rails_without_ends_are_refused_by_name() -> None:
    rail = rp.planar_arm("PR")
    limits = rail.limits
    endless = rail.with_limits(
        rp.Limits([-np.inf, -1.0], [np.inf, 1.0], limits.velocity, limits.acceleration, limits.jerk, limits.effort)
    )
    with pytest.raises(InputError, match=f"{rail.joint_names[0]!r} has no position limits"):
        random_grid(endless, 2, 3.0)


@pytest.mark.parametrize("missing", [0, 1])
def test_the_refusal_of_a_ring_or_shelf_gives_the_reason_of_either_end(
    missing: int, rr1: rp.Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = count()

    def reaching(scene: rp.Scene, *_: object) -> tuple[dict[str, Array], str]:
        if next(calls) % 2 == missing:
            return {}, "arm01 reaches it only through arm02"
        return {arm: placed.q for arm, placed in scene.arms.items()}, ""

    monkeypatch.setattr(problems, "_reaching", reaching)
    with pytest.raises(InputError, match=r"radius 0\.3 m in \d+ attempts: arm01 reaches it only through arm02"):
        ring_swap(rr1, 2, 0.1 + 0.2, rng=0)
    with pytest.raises(InputError, match="arm01 reaches it only through arm02"):
        dual_arm_shelf(rr1, 0.6, 0)
