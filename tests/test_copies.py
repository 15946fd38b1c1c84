"""Values and errors survive pickle and copy, and so transfers between processes."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable
from typing import Any

import pytest

import rr1plan as rp

WAYS: dict[str, Callable[[Any], Any]] = {
    "pickle": lambda value: pickle.loads(pickle.dumps(value)),
    "copy": copy.copy,
    "deepcopy": copy.deepcopy,
}
ERRORS = [
    rp.UnknownNameError("joint", "elbo", ("elbow",), "Look again."),
    rp.FormatError("is not TOML", "cell.toml", 3),
    rp.MissingPackageError("rosbags", "writing a bag", "ros"),
    rp.InputError("budget of 0 seconds"),
    rp.StalledJointError("S1"),
]


@pytest.fixture(scope="module")
def values() -> dict[str, Any]:
    problem = rp.load_problems("planar2r_path")["to_a_point"]
    scene = problem.scene
    motion = rp.plan_motion(problem, rng=0)
    many = rp.plan_many_arms(problem, rng=0)
    return {
        "scene": scene,
        "problem": problem,
        "motion": motion,
        "report": motion.report,
        "many": many,
        "graph": rp.plan_graph(many),
        "running": rp.RunningPlan.of(many),
        "timeline": rp.timeline(motion.trajectory, scene),
        "sequence": rp.plan_sequence(rp.Sequence(scene, [rp.FreeMotion(problem.start)]), rng=0),
        "options": rp.ViewOptions(title="A page", compare={"other": motion.trajectory}, view="top"),
        "proposal": rp.propose_disabled_collisions(scene.arms["arm"].robot),
        "calibration": rp.Calibration.assumed(scene.arms["arm"].robot),
        "ompl": rp.OmplPlanner("rrt"),
        "rrt": rp.RrtConnect(range=0.5),
        "picture": rp.cspace(scene, problem, resolution=8),
        "lesson": rp.lesson("workspace"),
        "corridor": rp.certified_corridor(scene, motion.trajectory),
        "checker": rp.CollisionChecker(scene),
        "timed checker": rp.TimedChecker(rp.CollisionChecker(scene), {}),
        "kinematics": rp.Kinematics(scene),
    }


NAMES = (
    "scene", "problem", "motion", "report", "many", "graph", "running", "timeline", "sequence", "options", "proposal",
    "calibration", "ompl", "rrt", "picture", "lesson", "corridor", "checker", "timed checker", "kinematics",
)  # fmt: skip


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("name", NAMES)
def test_a_value_comes_back(values: dict[str, Any], name: str, way: str) -> None:
    assert set(values) == set(NAMES)
    back = WAYS[way](values[name])
    assert type(back) is type(values[name])
    # The order of sets may differ.
    assert sorted(repr(back)) == sorted(repr(values[name]))


def test_a_planner_that_came_from_another_process_keeps_its_settings(values: dict[str, Any]) -> None:
    planner = rp.OmplPlanner("rrt", settings={"goal_bias": 0.1})
    back = pickle.loads(pickle.dumps(planner))
    assert back.settings == {"goal_bias": 0.1}
    assert rp.plan(values["problem"], planner=back, rng=0).found


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("error", ERRORS, ids=lambda error: type(error).__name__)
def test_an_error_comes_back_with_its_message(error: rp.Rr1PlanError, way: str) -> None:
    back = WAYS[way](error)
    assert type(back) is type(error)
    assert str(back) == str(error)
    assert back.__dict__ == error.__dict__


@pytest.mark.parametrize("way", WAYS)
def test_a_simulation_is_not_copied_and_says_what_is_kept_instead(values: dict[str, Any], way: str) -> None:
    sim = rp.Simulation(values["scene"])
    with pytest.raises(rp.InputError, match="keep its current_scene"):
        WAYS[way](sim)
    assert rp.Simulation(WAYS[way](sim.current_scene)).scene.arms
