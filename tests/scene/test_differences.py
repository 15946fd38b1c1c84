"""Differences between two scenes: each change is named, and equal scenes have none."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.robot import Robot
from rr1plan.scene import Scene, scene_differences
from rr1plan.transforms import pose


@pytest.fixture(scope="module")
def scene(planar2r: Robot) -> Scene:
    scene = rp.load_scene("planar2r_path").with_arm("second", planar2r, (3, 0, 0))
    scene = scene.with_obstacle("cup", rp.Cylinder(0.01, 0.02), (0, 3, 0)).attach("cup", "second", touch=["link1"])
    return scene.allow("arm", "second").with_padding(0.002).with_padding(0.004, "arm", "red")


def with_limit(scene: Scene) -> Scene:
    robot = scene.arms["arm"].robot
    return scene.with_robot("arm", robot.with_limits(replace(robot.limits, jerk=np.array([7.0, robot.limits.jerk[1]]))))


def with_link(scene: Scene, **changes: object) -> Scene:
    robot = scene.arms["arm"].robot
    links = tuple(replace(link, **changes) if link.name == "link2" else link for link in robot.links)
    return scene.with_robot("arm", replace(robot, links=links))


def turned_obstacle(scene: Scene) -> Scene:
    red = scene.obstacles["red"]
    return replace(scene, obstacles={**scene.obstacles, "red": replace(red, pose=red.pose @ pose(rpy=(0, 0, 0.25)))})


CHANGES: list[tuple[Callable[[Scene], Scene], str]] = [
    (lambda s: s.without_obstacle("blue"), "obstacle 'blue' is gone"),
    (lambda s: s.with_obstacle("new", rp.Sphere(0.1)), "obstacle 'new' is new"),
    (turned_obstacle, "obstacle 'red' turned by 0.25 rad"),
    (
        lambda s: s.with_obstacle("blue", rp.Box((1, 2, 0.5)), s.obstacles["blue"].pose),
        "obstacle 'blue' has a box of 1 x 2 x 0.5 m, was a cylinder of radius 0.16 m",
    ),
    (lambda s: s.with_arm("second", s.arms["second"].robot, (3, 0.5, 0)), "arm 'second' moved by 500 mm"),
    (lambda s: s.with_configuration("second", [0.5, 0.0]), "arm 'second' stands elsewhere: joint2 by -0.9 rad"),
    (with_limit, "arm 'arm' has other jerk limits: joint1 7 (was "),
    (lambda s: with_link(s, collisions=()), "arm 'arm' has another link 'link2'"),
    (lambda s: with_link(s, inertial=None), "arm 'arm' has another link 'link2'"),
    (lambda s: s.detach("cup"), "held object 'cup' is gone"),
    (
        lambda s: replace(s, attachments={"cup": replace(s.attachments["cup"], touch=frozenset())}),
        "held object 'cup' may touch no link, not link1",
    ),
    (
        lambda s: replace(s, attachments={"cup": replace(s.attachments["cup"], arm="arm")}),
        "held object 'cup' is held by arm/",
    ),
    (lambda s: s.with_padding(0.01), "the padding is 10 mm, was 2 mm"),
    (lambda s: s.with_padding(0.001, "arm", "red"), "the padding between 'arm' and 'red' is 1 mm, was 4 mm"),
    (lambda s: s.allow("arm", "red"), "contact is allowed between 'arm' and 'red' now"),
    (lambda s: replace(s, allowed=frozenset()), "contact is allowed between 'arm' and 'second' no more"),
    (lambda s: replace(s, arms=dict(reversed(s.arms.items()))), "the arms are in another order: second, arm"),
    (lambda s: s.with_robot("arm", rp.load_robot("planar2r_limited")), "arm 'arm' is a 'planar2r_limited'"),
]


@pytest.mark.parametrize(("change", "words"), CHANGES)
def test_each_change_is_named_and_its_reverse_too(scene: Scene, change: Callable[[Scene], Scene], words: str) -> None:
    other = change(scene)
    assert other.content_hash != scene.content_hash
    found = scene_differences(scene, other)
    assert any(line.startswith(words) for line in found), found
    assert scene_differences(other, scene)


def test_another_tool_is_named_though_the_hashes_agree(scene: Scene) -> None:
    other = scene.with_robot("arm", replace(scene.arms["arm"].robot, tool="link1"))
    assert other.content_hash == scene.content_hash
    assert scene_differences(scene, other) == ("arm 'arm' has the tool 'link1', not 'tool'",)


def test_masses_and_friction_are_named_though_the_hashes_agree(scene: Scene) -> None:
    red, cup = scene.obstacles["red"], scene.attachments["cup"]
    other = scene.with_obstacles({"red": replace(red, friction=0.5)})
    other = replace(other, attachments={"cup": replace(cup, mass=0.25)})
    assert other.content_hash == scene.content_hash
    assert scene_differences(scene, other) == (
        "obstacle 'red' has a friction of 0.5, was 1",
        "held object 'cup' has a mass of 0.25 kg, had none",
    )


def test_equal_scenes_do_not_differ_whatever_their_names_and_colors(scene: Scene) -> None:
    red = scene.obstacles["red"]
    painted = replace(red, geometries=tuple(replace(g, color=(1.0, 0.0, 0.0, 1.0)) for g in red.geometries))
    other = replace(scene, name="other", description="x", obstacles={**scene.obstacles, "red": painted})
    assert scene_differences(scene, other) == ()
    with pytest.raises(rp.InputError, match="after is of type str"):
        scene_differences(scene, "cell.toml")
