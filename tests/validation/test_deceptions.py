"""Motions that look right: none may pass, whatever was certified before."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.validation import validate

Make = Callable[..., Any]
BALL = rp.Sphere(0.1)


def kinds(report: rp.Report) -> set[str]:
    return {violation.kind for violation in report.violations}


CHANGES: dict[str, Callable[[rp.Scene, rp.Robot], rp.Scene]] = {
    "a new obstacle": lambda scene, _: scene.with_obstacle("new", BALL, [0.5, 0.0, 0.0]),
    "a moved obstacle": lambda scene, _: scene.with_obstacle("far", BALL, [0.5, 0.0, 0.0]),
    "a grown obstacle": lambda scene, _: scene.with_obstacle("far", rp.Sphere(2.95), [0.5, 3.0, 0.0]),
    "an obstacle at the same place in many parts": lambda scene, _: scene.with_obstacle(
        "far", rp.PointCloud(np.array([[0.0, 0.0, 0.0], [0.0, -3.0, 0.0]]), 0.05), [0.5, 3.0, 0.0]
    ),
    "a moved base": lambda scene, robot: scene.with_arm("arm", robot, [0.0, 2.95, 0.0]),
    "another robot of that name": lambda scene, robot: scene.with_arm("arm", longer(robot)),
    "an arm at rest elsewhere": lambda scene, robot: scene.with_arm("other", robot, [0.0, 5.0, 0.0]).with_arm(
        "other", robot, [0.3, 0.0, 0.0]
    ),
    "something held": lambda scene, _: scene.with_obstacle("rod", rp.Box((0.02, 2.95, 0.02)), [0.0, 1.5, 0.0]).attach(
        "rod", "arm", "carriage", touch=["carriage"]
    ),
    "more padding": lambda scene, _: scene.with_padding(2.9),
}


def longer(robot: rp.Robot) -> rp.Robot:
    parts = tuple(replace(part, shape=rp.Sphere(2.95)) for part in robot.link("carriage").collisions)
    links = tuple(replace(link, collisions=parts) if link.name == "carriage" else link for link in robot.links)
    return replace(robot, links=links)


@pytest.mark.parametrize("change", CHANGES)
def test_what_changed_after_a_certificate_is_seen(change: str, slider: Make, quintic: Make) -> None:
    robot = slider(BALL)
    scene = rp.Scene().with_arm("arm", robot).with_obstacle("far", BALL, [0.5, 3.0, 0.0])
    motion = quintic(["arm/slide"], [0.0], [1.0])
    assert validate(motion, scene).certified
    assert kinds(validate(motion, CHANGES[change](scene, robot))) & {"collision", "undecided"}
    assert validate(motion, scene).certified


def test_a_hand_that_opens_after_a_certificate_is_seen(gripper: Make, quintic: Make) -> None:
    robot = gripper(rp.Sphere(0.02))
    scene = rp.Scene().with_arm("arm", robot).with_obstacle("post", rp.Sphere(0.02), [0.5, 0.2, 0.0])
    motion = quintic(["arm/turn"], [0.0], [0.01])
    assert validate(motion, scene).certified
    opened = replace(robot, locked_joints={"left_slide": 0.2})
    assert kinds(validate(motion, scene.with_arm("arm", opened))) == {"collision"}


def test_an_arm_that_the_problem_leaves_at_rest_may_not_start_elsewhere(slider: Make, quintic: Make) -> None:
    robot = slider(BALL)
    scene = rp.Scene().with_arm("a", robot).with_arm("b", robot, [0.0, 2.0, 0.0])
    problem = rp.Problem(scene, start=[0.0], goal={"a": [1.0]}, arms=["a"])
    names = ["a/slide", "b/slide"]
    assert validate(quintic(names, [0.0, 0.0], [1.0, 0.0]), scene, problem).certified
    teleported = validate(quintic(names, [0.0, 3.0], [1.0, 3.0]), scene, problem)
    assert [(v.kind, v.subject) for v in teleported.violations] == [("start", ("b/slide",))]


def test_the_joints_of_the_problem_are_those_of_the_scene_in_their_order(chain: Make, quintic: Make) -> None:
    robot = chain(np.random.default_rng(0), 2)
    turned = replace(robot, joint_names=robot.joint_names[::-1])
    problem = rp.Problem(rp.Scene().with_arm("arm", robot), start=[0.1, 0.2], goal=[0.3, 0.4])
    scene = rp.Scene().with_arm("arm", turned)
    with pytest.raises(rp.InputError, match=r"joint0.*joint1"):
        validate(quintic(["arm/joint0", "arm/joint1"], [0.2, 0.1], [0.4, 0.3]), scene, problem)


@pytest.mark.parametrize("kind", ["start", "goal"])
def test_a_forged_problem_that_is_not_finite_is_not_met(kind: str, slider: Make, quintic: Make) -> None:
    scene = rp.Scene().with_arm("arm", slider(BALL))
    problem = rp.Problem(scene, start=[0.0], goal=[1.0])
    nothing = np.array([np.nan])
    if kind == "start":
        object.__setattr__(problem, "start", nothing)
    else:
        object.__setattr__(problem.goal["arm"][0], "q", nothing)
    assert kinds(validate(quintic(["arm/slide"], [0.0], [1.0]), scene, problem)) == {kind}


def test_a_blink_between_two_pieces_is_seen(slider: Make, trajectory: Make) -> None:
    # out and back within a microsecond, with ends that fit: what a check at waypoints cannot see
    scene = rp.Scene().with_arm("arm", slider(BALL)).with_obstacle("post", rp.Sphere(0.01), [0.5, 0.0, 0.0])
    still, blink = [0.0], [0.0, 0.0, 16.0 * 0.5 / 1e-24, -32.0 * 0.5 / 1e-30, 16.0 * 0.5 / 1e-36]
    motion = trajectory(["arm/slide"], [0.0, 1.0, 1.0 + 1e-6, 2.0], [still, np.array(blink) * 1e-12, still])
    assert "collision" in kinds(validate(motion, scene))


@pytest.mark.parametrize("tolerance", [1e-6, 1e-3, 1e6])
def test_no_tolerance_hides_a_contact_or_invents_one(tolerance: float, slider: Make, quintic: Make) -> None:
    scene = rp.Scene().with_arm("arm", slider(BALL))
    motion = quintic(["arm/slide"], [0.0], [1.0])
    for y, certified in ((0.1101, True), (0.1099, False)):
        for shape in (rp.Sphere(0.01), rp.PointCloud(np.array([[0.01, 0.01, 0.01]]), 0.02)):
            at = [0.5, y, 0.0] if isinstance(shape, rp.Sphere) else [0.49, y - 0.01, -0.01]
            report = validate(motion, scene.with_obstacle("post", shape, at), clearance_tolerance=tolerance)
            assert report.certified is certified


@pytest.mark.parametrize("seed", range(6))
def test_a_cloud_is_hit_exactly_when_the_boxes_of_its_cells_are(seed: int, chain: Make, quintic: Make) -> None:
    rng = np.random.default_rng(seed)
    cloud = rp.PointCloud(rng.uniform(-0.6, 0.6, (60, 3)), 0.05)
    scene = rp.Scene().with_arm("arm", chain(rng))
    side = cloud.resolution
    middles = (np.unique(np.floor(cloud.points / side), axis=0) + 0.5) * side
    boxes = scene
    for i, middle in enumerate(middles):
        boxes = boxes.with_obstacle(f"cell{i}", rp.Box((side, side, side)), middle)
    ends = rng.uniform(-1.0, 1.0, (2, 3))
    motion = quintic(scene.joint_names(), *ends, 2.0)
    one, many = validate(motion, scene.with_obstacle("cloud", cloud)), validate(motion, boxes)
    assert ({"collision", "undecided"} & kinds(one) == set()) is ({"collision", "undecided"} & kinds(many) == set())
    if one.certified:
        assert one.margins["clearance"].value == pytest.approx(many.margins["clearance"].value, abs=2.5e-4)
