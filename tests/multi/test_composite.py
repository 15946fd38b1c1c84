"""Two arms that move at once are one problem with more columns: planned, certified arm against arm, like any other."""

from __future__ import annotations

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.collision import CollisionChecker
from rr1plan.multi.search.group_planner import GroupPlanner
from rr1plan.planning import Budget
from rr1plan.scene.model_library import load_problems


@pytest.fixture(scope="module")
def change_places():
    return load_problems("rr1_pair")["change_places"]


def test_two_arms_are_planned_at_once_and_certified_against_each_other(change_places):
    budget = Budget(seconds=float("inf"), iterations=20000)
    result = rp.plan(change_places, budget=budget, rng=1)
    assert result.found, result.reason
    points = result.path.waypoints
    assert points.shape[1] == change_places.nq == 12
    assert points[0].tobytes() == change_places.start.tobytes()
    goal = np.concatenate([change_places.goal[arm][0].q for arm in change_places.arms])
    np.testing.assert_array_equal(points[-1], goal)
    checker = CollisionChecker(change_places.scene, change_places.arms)
    assert any(a.startswith("left/") and b.startswith("right/") for a, b in checker.pairs)
    assert checker.path_is_free(points)
    assert all(checker.is_free(q) for q in result.path.sample(0.02))
    again = rp.plan(change_places, budget=budget, rng=1)
    assert again.path.waypoints.tobytes() == points.tobytes()


def test_few_arms_are_planned_as_one_again_where_all_else_fails(
    change_places: rp.Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    efforts = []

    def fail(_: GroupPlanner, effort: int = 0) -> bool:
        efforts.append(effort)
        return False

    for stage in ("_plan_few", "_couple", "_move_in_turn"):
        monkeypatch.setattr(GroupPlanner, stage, fail)
    result = rp.plan_many_arms(change_places, rng=1, budget=Budget(seconds=60.0))
    assert [group.stage for group in result.groups] == ["composite"]
    assert rp.validate(result.trajectory, change_places.scene, change_places).valid
    assert efforts[:3] == [0, 0, 0]


def test_an_arm_of_the_pair_can_move_alone_while_the_other_holds():
    problem = load_problems("rr1_pair")["left_alone"]
    result = rp.plan(problem, rng=1)
    assert result.found, result.reason
    assert result.path.joint_names == problem.scene.joint_names(["left"])
