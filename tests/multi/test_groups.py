"""Interaction groups: swept volumes of the paths determine which arms are planned together; threads have no effect."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import combinations

import numpy as np
import pytest

import rr1plan as rp
from rr1plan import plan_many_arms, random_grid
from rr1plan.collision.arm_groups import arms_in_reach, interaction_groups
from rr1plan.multi import portfolio
from rr1plan.multi.agents import Agent
from rr1plan.multi.interaction import meeting_groups
from rr1plan.multi.paths.path_pool import PathPool
from rr1plan.multi.paths.placed_path import placed_configuration
from rr1plan.multi.search.group_planner import GroupPlanner
from rr1plan.multi.search.group_schedules import GroupSchedules
from rr1plan.multi.stopwatch import Stopwatch
from rr1plan.multi.timing.coordination import ends_are_apart, may_touch
from rr1plan.multi.timing.diagram_cache import DiagramCache
from rr1plan.planning import Budget

_BUDGET = Budget(seconds=60.0)


@pytest.fixture(scope="module")
def grid(rr1: rp.Robot) -> rp.Problem:
    return random_grid(rr1, 9, 0.65, 2)


@pytest.fixture(scope="module")
def pools(grid: rp.Problem) -> dict[str, PathPool]:
    found = {arm: PathPool(Agent(grid, [arm]), 0.002, np.random.default_rng(0)) for arm in grid.arms}
    assert all(pool.add({})[0] is not None for pool in found.values())
    return found


def test_arms_of_different_groups_never_touch(grid: rp.Problem, pools: dict[str, PathPool]) -> None:
    paths = {arm: pool.paths[0] for arm, pool in pools.items()}
    near, diagrams = arms_in_reach(grid.scene, grid.arms, 0.002), DiagramCache()
    by_boxes = meeting_groups(paths, near, diagrams)
    exactly = meeting_groups(paths, near, diagrams, exactly=True)
    assert len(exactly) >= len(by_boxes) > 1
    for groups in (by_boxes, exactly):
        assert sorted(arm for group in groups for arm in group) == sorted(grid.arms)
        group_of = {arm: k for k, group in enumerate(groups) for arm in group}
        for one, two in combinations(grid.arms, 2):
            if group_of[one] != group_of[two]:
                assert diagrams.diagram(paths[one], paths[two]) is None
    # Arms that move as one are one group.
    assert len(meeting_groups(dict.fromkeys(grid.arms, paths[grid.arms[0]]), near, diagrams)) == 1


def test_arms_without_a_schedule_are_listed_by_scheduled_neighbors_in_their_way(
    grid: rp.Problem, pools: dict[str, PathPool]
) -> None:
    one, two, three, far = *grid.arms[:3], grid.arms[-1]
    near = {arm: frozenset(grid.arms) - {arm} for arm in grid.arms}
    rng, watch, diagrams = np.random.default_rng(0), Stopwatch(math.inf), DiagramCache()
    group = GroupSchedules([pools[arm] for arm in (one, two, three, far)], near, diagrams, rng, watch)
    assert group.why_unscheduled() == f"no schedule found for {one}, {two}, {three}, {far} among each other"
    assert group.schedule(pools[one].agent, math.inf)
    assert group.why_unscheduled() == f"no schedule found for {two}, {three}, {far} (among {one})"
    assert diagrams.diagram(pools[far].paths[0], pools[one].paths[0]) is None
    assert group.why_unscheduled() == f"no schedule found for {far}; {two}, {three} (among {one})"


def test_groups_are_joined_without_work_after_the_deadline(grid: rp.Problem, pools: dict[str, PathPool]) -> None:
    near, diagrams, over = arms_in_reach(grid.scene, grid.arms, 0.002), DiagramCache(), Stopwatch(math.inf)
    one, two = (
        GroupPlanner(GroupSchedules([pools[arm]], near, diagrams, np.random.default_rng(0), over))
        for arm in grid.arms[:2]
    )
    assert one.run()
    assert two.run()
    over.cancel()
    one.group.join(two.group)
    assert len(diagrams) == 0
    assert one.group.arms == grid.arms[:2]
    assert not one.run()


def test_diagrams_are_the_same_on_threads(grid: rp.Problem, pools: dict[str, PathPool]) -> None:
    paths = [pool.paths[0] for pool in pools.values()]
    pairs = list(combinations(paths, 2))
    alone, threaded = DiagramCache(), DiagramCache()
    threaded.prepare(pairs * 2, 3)
    met = 0
    for one, two in pairs:
        expected, found = alone.diagram(one, two), threaded.diagram(one, two)
        assert (expected is None) == (found is None)
        if expected is not None:
            met += 1
            np.testing.assert_array_equal(found, expected)
            np.testing.assert_array_equal(threaded.diagram(two, one), expected.T)
    assert met > 0
    assert len(threaded) == 2 * len(pairs)


def test_what_is_not_looked_at_in_time_counts_as_meeting(grid: rp.Problem, pools: dict[str, PathPool]) -> None:
    paths = {arm: pool.paths[0] for arm, pool in pools.items()}
    near, late = arms_in_reach(grid.scene, grid.arms, 0.002), Stopwatch(0.0)
    diagrams = DiagramCache(watch=late)
    groups = meeting_groups(paths, near, diagrams, exactly=True, watch=late)
    assert sorted(groups) == sorted(interaction_groups(near))
    diagrams.prepare(list(combinations(paths.values(), 2)), 3)
    assert len(diagrams) == 0


def test_an_earlier_deadline_ends_one_clock_and_not_the_other() -> None:
    watch = Stopwatch(math.inf)
    assert not watch.with_deadline(-1.0).goes_on()
    assert watch.with_deadline(60.0).goes_on()
    assert 59.0 < watch.with_deadline(60.0).left <= 60.0
    assert watch.with_deadline(math.inf).left == math.inf
    assert Stopwatch(1.0).with_deadline(60.0).left <= 1.0
    assert Stopwatch(0.0).time_left > 0.0
    assert watch.goes_on()


def test_no_body_moves_farther_than_the_reach_of_its_arms(grid: rp.Problem) -> None:
    agent, rng = Agent(grid, grid.arms[:3]), np.random.default_rng(0)
    lower, upper = agent.limits.lower, agent.limits.upper
    bodies, largest = slice(len(agent.bodies.elements), 2 * len(agent.bodies.elements)), 0.0  # of the only leaf
    for q in rng.uniform(lower, upper, (40, len(lower))):
        joint = rng.integers(len(q))
        moved = q.copy()
        moved[joint] += 1e-3
        before, after = (placed_configuration(agent.bodies, c).targets["centers"][bodies] for c in (q, moved))
        share = np.linalg.norm(after - before, axis=-1).max() / (1e-3 * agent.reach[joint])
        assert share <= 1.0 + 1e-6
        largest = max(largest, share)
    assert largest > 0.5


def test_bodies_are_placed_along_paths_only_where_the_ends_do_not_tell(rr1: rp.Robot) -> None:
    for problem, placed in ((rp.ring_swap(rr1, 2, 0.4, rng=0), False), (random_grid(rr1, 2, 0.8, 0), True)):
        pools = [PathPool(Agent(problem, [arm]), 0.002, np.random.default_rng(0)) for arm in problem.arms]
        one, two = (path for path in (pool.add({})[0] for pool in pools) if path is not None)
        touches = DiagramCache().may_touch(one, two)
        assert touches or placed
        assert [path.placed_bytes > 0 for path in (one, two)] == [placed, placed]
        assert may_touch(one, two, 0.002) == touches


def test_ends_keep_what_their_diagram_keeps(pools: dict[str, PathPool]) -> None:
    diagrams = DiagramCache()
    for one, two in combinations([pool.paths[0] for pool in pools.values()], 2):
        margin = diagrams.margin(one, two)
        assert ends_are_apart(one, two, margin) or margin == 0.0
        blocked = diagrams.diagram(one, two)
        if blocked is not None:
            assert may_touch(one, two, 0.002)
            assert not blocked[0, 0]
            assert not blocked[one.segments + 1, two.segments + 1]


def test_the_same_seed_gives_the_same_motion_whatever_the_threads(
    grid: rp.Problem, monkeypatch: pytest.MonkeyPatch, assert_safe: Callable[..., None]
) -> None:
    results = []
    for processors in (1, 2, 5):
        monkeypatch.setattr(portfolio, "processors", lambda n=processors: n)
        results.append(plan_many_arms(grid, rng=3, budget=_BUDGET))
    assert sum(len(group.arms) > 1 for group in results[0].groups) > 1
    assert_safe(grid, results[0], 60)
    assert len({result.trajectory.coefficients.tobytes() for result in results if result.trajectory}) == 1


def test_groups_whose_detours_meet_are_joined(planar2r: rp.Robot, assert_safe: Callable[..., None]) -> None:
    # A long row of neighbors that swap sides in pairs: whoever goes around meets the next pair.
    scene, start, goal = rp.Scene(), {}, {}
    for k in range(3):
        for side, angle in ((-1.0, 0.5), (1.0, np.pi + 0.5)):
            name = f"arm{k}{'l' if side < 0.0 else 'r'}"
            scene = scene.with_arm(name, planar2r, (1.2 * side, 2.6 * k, 0.0))
            start[name], goal[name] = [angle, 0.0], [angle - 1.0, 0.0]
    problem = rp.Problem(scene, start, goal)
    result = plan_many_arms(problem, rng=0, budget=_BUDGET)
    assert_safe(problem, result)
    assert 1 <= len(result.groups) <= 3
