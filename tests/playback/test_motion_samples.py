"""Torques, clearances, tracking errors and places of violations that are sent to the page."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from drawn_links import wander
from packed_arrays import unpacked

import rr1plan as rp
from rr1plan.playback.viewer import view_document
from rr1plan.playback.viewer.motion_samples import clearance_samples, torque_samples, violation_places


@pytest.fixture(scope="module")
def motion() -> rp.MotionPlan:
    planned = rp.plan_motion(next(iter(rp.load_problems("rr1_table").values())), rng=0)
    assert planned
    return planned


def test_torques_are_those_of_all_arms_together(rr1: rp.Robot) -> None:
    scene = rp.Scene().with_arm("left", rr1, rp.transforms.pose([0.0, 0.0, 0.0], rpy=[0.5, 0.2, 1.0]))
    scene = scene.with_arm("right", rr1, [1.0, 0.0, 0.0])
    trajectory = wander(scene)
    sent = torque_samples(scene, trajectory, range(12))
    times, torques = unpacked(sent["times"]), unpacked(sent["values"])
    expected = rp.Kinematics(scene).inverse_dynamics(*(trajectory(times, k) for k in range(3)))
    np.testing.assert_allclose(torques, expected, rtol=1e-5, atol=1e-5)
    assert np.abs(torques[:, :6] - torques[:, 6:]).max() > 0.1
    assert sent["columns"] == list(range(12))


def test_torques_include_held_objects_and_name_those_without_a_mass(rr1: rp.Robot) -> None:
    scene = rp.Scene().with_arm("left", rr1).with_arm("right", rr1, [1.0, 0.0, 0.0])
    tool = scene.link_poses()["right/tool"]
    heavy, unknown = (
        scene.with_obstacle("load", rp.Box((0.1, 0.1, 0.1)), tool, mass=mass).attach("load", "right")
        for mass in (2.0, None)
    )
    trajectory = wander(scene)
    sent = torque_samples(heavy, trajectory, range(12))
    times, torques = unpacked(sent["times"]), unpacked(sent["values"])
    expected = rp.Kinematics(heavy).inverse_dynamics(*(trajectory(times, k) for k in range(3)))
    np.testing.assert_allclose(torques, expected, rtol=1e-5, atol=1e-5)
    assert sent["remark"] == ""
    assert torque_samples(unknown, trajectory, range(12))["remark"] == "without the mass of load"


def test_torques_are_sent_on_both_sides_of_a_jump(rr1_table: rp.Scene) -> None:
    q = rr1_table.configuration()
    # From rest to rest with half the acceleration one way, then the other way.
    coefficients = np.zeros((2, 3, len(q)))
    coefficients[0, 0], coefficients[0, 2, 1] = q, 0.2
    coefficients[1, 0] = q
    coefficients[1, :, 1] += [0.2, 0.4, -0.2]
    trajectory = rp.Trajectory(rr1_table.joint_names(), [0.0, 1.0, 2.0], coefficients)
    sent = torque_samples(rr1_table, trajectory, range(len(q)))
    times, torques = unpacked(sent["times"]), unpacked(sent["values"])
    at = int(np.searchsorted(times, 1.0))
    assert times[at] == 1.0
    assert times[at - 1] == np.nextafter(1.0, 0.0)
    jump = torques[at, 1] - torques[at - 1, 1]
    inertia = rp.Kinematics(rr1_table).mass_matrix(trajectory(1.0))[1, 1]
    assert jump == pytest.approx(-0.8 * inertia, rel=1e-4)


def test_clearances_are_those_of_the_checker_and_of_the_referee(motion: rp.MotionPlan) -> None:
    trajectory, scene = motion.trajectory, motion.scene
    sent = clearance_samples(scene, trajectory, thorough=True)
    assert sent is not None
    assert sent["arms"] == ["rr1"]
    times, values, points = (unpacked(sent[name]) for name in ("times", "values", "points"))
    pairs = unpacked(sent["pairs"])
    checker = rp.CollisionChecker(scene)
    for i in range(0, len(times), 10):
        nearest = checker.nearest(trajectory(times[i]))
        assert values[i, 0].min() == pytest.approx(nearest.distance, abs=1e-6)
        own = int(values[i, 0].argmin())
        assert set(sent["names"][pairs[i, 0, own]]) == set(nearest.pair)
        far = np.linalg.norm(points[i, 0, own, :3] - points[i, 0, own, 3:])
        assert far == pytest.approx(nearest.distance, abs=1e-5)
    for own, name in enumerate(("clearance", "self_clearance")):
        least, margin = values[:, 0, own].min(), motion.report.margins[name].value
        # Between samples it may be a little less.
        assert -3e-4 < least - margin < 2e-3, name
    names = {tuple(sent["names"][k]) for k in np.unique(pairs[:, 0, 1])}
    assert all(a.startswith("rr1/") and b.startswith("rr1/") for a, b in names)


def test_padding_is_no_clearance(motion: rp.MotionPlan) -> None:
    bare, padded = (
        clearance_samples(scene, motion.trajectory, thorough=True)
        for scene in (motion.scene, motion.scene.with_padding(0.002))
    )
    assert bare is not None
    assert padded is not None
    np.testing.assert_allclose(unpacked(padded["values"]), unpacked(bare["values"]) - 0.002, atol=1e-6)


def test_clearances_of_many_arms_are_sampled_on_demand(planar2r: rp.Robot) -> None:
    scene = rp.place_grid(planar2r, 1, 5, spacing=3.0).with_obstacle("ball", rp.Sphere(0.1), [0.0, 1.2, 0.0])
    trajectory = wander(scene)
    assert clearance_samples(scene, trajectory) is None
    assert clearance_samples(scene, trajectory, thorough=False) is None
    sent = clearance_samples(scene, trajectory, thorough=True)
    assert sent is not None
    assert unpacked(sent["values"]).shape == (120, 5, 2)
    documents = [
        view_document(scene, trajectory=trajectory, options=rp.ViewOptions(clearances=c)) for c in (None, True)
    ]
    assert [document["samples"]["clearance"] is None for document in documents] == [True, False]


def test_tracking_errors_are_those_of_the_record(motion: rp.MotionPlan) -> None:
    replay = rp.simulate(motion.trajectory, motion.scene)
    sent = view_document(motion.scene, trajectory=motion.trajectory, replay=replay)["samples"]["error"]
    np.testing.assert_array_equal(unpacked(sent["times"]), replay.record.times)
    errors = replay.record.actual - replay.record.desired
    np.testing.assert_allclose(unpacked(sent["values"]), errors, rtol=1e-6)
    assert np.abs(errors).max() > 0.0
    kinematic = rp.simulate(motion.trajectory, motion.scene, mode="kinematic")
    assert view_document(motion.scene, trajectory=motion.trajectory, replay=kinematic)["samples"]["error"] is None


def test_a_collision_has_a_place_between_the_bodies(rr1_table: rp.Scene) -> None:
    start = rr1_table.configuration()
    trajectory = rp.Trajectory.from_samples(
        rr1_table.joint_names(), [0.0, 1.0], [start, start + np.array([0.0, 1.5, 0.8, 0.0, 0.0, 0.0])]
    )
    # A second arm far away, which does not affect the place.
    two = rr1_table.with_arm("other", rr1_table.arms["rr1"].robot, [3.0, 0.0, 0.0])
    report = rp.validate(trajectory, rr1_table)
    places = violation_places(rr1_table, trajectory, report)
    collisions = [v.kind == "collision" for v in report.violations]
    assert [place is not None for place in places] == collisions
    assert sum(collisions) == 2
    for violation, place in zip(report.violations, places, strict=True):
        if place is None:
            continue
        contacts = rp.CollisionChecker(rr1_table).contacts(trajectory(violation.time))
        expected = next(c.point for c in contacts if {c.a, c.b} == set(violation.subject))
        np.testing.assert_allclose(place, expected, atol=1e-9)
    assert violation_places(two, trajectory, report) == places


def test_the_tree_is_sent_with_the_page_of_a_plan() -> None:
    problem = next(iter(rp.load_problems("rr1_cage").values()))
    plan = rp.plan_motion(problem, rng=1, planner=rp.RrtConnect(tree=True))
    assert plan.result.tree is not None
    document = view_document(
        plan.scene, trajectory=plan.trajectory, problem=problem, path=plan.path, options=plan._page_options(None)
    )
    tree = document["tree"]
    assert tree["columns"] == list(range(6))
    assert tree["explored"] == len(plan.result.tree.edges) > 5
    assert set(unpacked(tree["sides"]).tolist()) == {0, 1}


def test_a_roadmap_is_one_tree(rr1_table: rp.Scene) -> None:
    roadmap = rp.Roadmap(rr1_table, samples=60)
    tree = view_document(rr1_table, options=rp.ViewOptions(tree=roadmap.graph))["tree"]
    assert tree["explored"] == len(roadmap.graph.edges) > 0
    assert set(unpacked(tree["sides"]).tolist()) == {0}


def test_a_tree_of_other_joints_is_refused(planar2r: rp.Robot) -> None:
    scene = rp.Scene().with_arm("arm", planar2r)
    tree = rp.SearchTree(np.zeros((2, 3)), np.array([[0, 1]]))
    with pytest.raises(rp.InputError, match="3 columns, expected one for each of arm/"):
        view_document(scene, options=rp.ViewOptions(tree=tree))


@pytest.mark.parametrize(
    ("compare", "words"),
    [
        ({"a": 1}, "Trajectory"),
        ([1], "compare"),
        ({3: None}, "name in compare"),
    ],
)
def test_what_is_no_motion_is_not_compared(compare: Any, words: str) -> None:
    with pytest.raises(rp.InputError, match=words):
        rp.ViewOptions(compare=compare)


def test_two_motions_are_not_compared_at_once(motion: rp.MotionPlan) -> None:
    with pytest.raises(rp.InputError, match="2 motions"):
        rp.ViewOptions(compare={"a": motion.trajectory, "b": motion.trajectory})


def test_the_motion_to_compare_has_its_own_samples(motion: rp.MotionPlan) -> None:
    slow = motion.trajectory.stretched(2.0)
    options = rp.ViewOptions(compare={"slow": slow})
    (row,) = view_document(motion.scene, trajectory=motion.trajectory, options=options)["compare"]
    assert row["name"] == "slow"
    assert unpacked(row["breaks"])[-1] == slow.end_time
    assert unpacked(row["samples"]["torque"]["times"])[-1] == slow.end_time
    assert row["samples"]["clearance"] is not None
    other = replace(slow, joint_names=tuple(f"x/{name}" for name in slow.joint_names))
    with pytest.raises(rp.UnknownNameError):
        view_document(motion.scene, trajectory=motion.trajectory, options=rp.ViewOptions(compare={"x": other}))
