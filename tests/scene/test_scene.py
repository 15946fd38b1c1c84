"""Scenes: names, contact rules, attaching and detaching, immutability."""

from __future__ import annotations

import pickle
from dataclasses import FrozenInstanceError, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rr1plan.errors import InputError, UnknownNameError
from rr1plan.robot import Geometry, Robot
from rr1plan.scene import Arm, Attachment, Obstacle, Scene, pair
from rr1plan.shapes import Box, HalfSpace, PointCloud, Sphere
from rr1plan.transforms import identity, pose


@pytest.fixture
def two(rr1: Robot) -> Scene:
    scene = Scene(name="two").with_arm("left", rr1, (0, 0.4, 0)).with_arm("right", rr1, (0, -0.4, 0))
    return scene.with_obstacle("cup", Sphere(0.02), (-0.4, 0.4, 0.1)).with_obstacle(
        "wall", Box((0.1, 1, 1)), (-2, 0, 0)
    )


# ---- values ----------------------------------------------------------------------------------


def test_a_scene_is_shown_by_the_names_in_it(two: Scene) -> None:
    assert repr(Scene()) == "Scene('scene')"
    held = two.attach("cup", "left")
    assert repr(held) == "Scene('two', arms=[left, right], obstacles=[wall], attachments=[cup])"


def test_a_scene_and_what_it_holds_cannot_be_changed(two: Scene) -> None:
    with pytest.raises(FrozenInstanceError):
        two.padding = 1.0
    with pytest.raises(TypeError):
        two.obstacles["x"] = two.obstacles["cup"]
    for array in (two.arms["left"].base, two.arms["left"].q, two.obstacles["cup"].pose):
        with pytest.raises(ValueError, match="read-only"):
            array.flat[0] = 1.0


def test_with_gives_another_scene_and_leaves_the_first(two: Scene) -> None:
    before = two.content_hash
    two.with_obstacle("more", Sphere(1.0))
    two.without_obstacle("cup")
    two.with_configuration("left", "zero")
    two.allow("left", "cup")
    two.attach("cup", "left")
    assert Scene(two.arms, two.obstacles).content_hash == before == two.content_hash


def test_pickling_keeps_everything_and_arrays_stay_read_only(two: Scene) -> None:
    scene = two.attach("cup", "left", touch=["finger_link"]).allow("left", "right").with_padding(0.01, "left", "wall")
    again = pickle.loads(pickle.dumps(scene))
    assert again.content_hash == scene.content_hash
    assert again.allowed == scene.allowed
    assert again.checked_pairs == scene.checked_pairs
    arrays = (
        again.arms["left"].base,
        again.arms["left"].q,
        again.obstacles["wall"].pose,
        again.attachments["cup"].pose,
    )
    for array in (*arrays, again.arms["left"].robot.home):
        with pytest.raises(ValueError, match="read-only"):
            array.flat[0] = 1.0


def test_the_hash_sees_what_plans_depend_on_and_nothing_else(two: Scene) -> None:
    changed = [
        two.with_configuration("left", "zero"),
        two.with_arm("left", two.arms["left"].robot, (0, 0.41, 0)),
        two.without_arm("left"),
        two.without_obstacle("cup"),
        two.with_obstacle("cup", Sphere(0.021), (-0.4, 0.4, 0.1)),
        two.with_obstacle("cup", Sphere(0.02), (-0.4, 0.4, 0.11)),
        two.allow("left", "cup"),
        two.with_padding(0.01),
        two.with_padding(0.01, "left", "cup"),
        two.attach("cup", "left"),
        two.attach("cup", "right"),
        two.attach("cup", "left", touch=["finger_link"]),
    ]
    hashes = {scene.content_hash for scene in (two, *changed)}
    assert len(hashes) == len(changed) + 1
    repainted = two.with_obstacle("cup", Sphere(0.02), (-0.4, 0.4, 0.1), color=(1.0, 0.0, 0.0, 1.0))
    assert repainted.content_hash == two.content_hash


# ---- reading ---------------------------------------------------------------------------------


def test_columns_are_named_by_arm_and_joint_in_the_order_of_the_scene(two: Scene) -> None:
    names = two.joint_names()
    assert names[0] == "left/shoulder_joint"
    assert names[6] == "right/shoulder_joint"
    assert two.joint_names(["right", "left"]) == names
    assert two.joint_names(["right"]) == names[6:]
    assert len(two.limits()) == len(two.configuration()) == 12


def test_split_gives_every_arm_its_part(two: Scene) -> None:
    parts = two.split(np.arange(6.0), ["right"])
    assert parts["right"].tolist() == [0, 1, 2, 3, 4, 5]
    assert np.array_equal(parts["left"], two.arms["left"].q)


def test_link_poses_start_at_the_base(two: Scene) -> None:
    poses = two.link_poses({"left": np.zeros(6)})
    robot = two.arms["left"].robot
    assert np.allclose(poses["left/base_link"], pose((0, 0.4, 0)))
    assert np.allclose(poses["left/tool"], pose((0, 0.4, 0)) @ robot.link_poses(np.zeros(6))["tool"])
    assert np.allclose(poses["right/tool"], pose((0, -0.4, 0)) @ robot.link_poses("home")["tool"])


# ---- contact rules ---------------------------------------------------------------------------


def test_checked_pairs_leave_out_what_may_touch(two: Scene) -> None:
    pairs = {pair(*both) for both in two.checked_pairs}
    assert pair("cup", "wall") not in pairs
    assert pair("left/base_link", "wall") not in pairs
    assert pair("left/shoulder_link", "wall") in pairs
    assert pair("left/base_link", "right/base_link") in pairs
    assert pair("left/hand_link", "right/forearm_link") in pairs
    assert pair("left/upper_arm_link", "left/forearm_link") in pairs
    assert pair("left/shoulder_link", "left/upper_arm_link") not in pairs
    assert len(pairs) == len(two.checked_pairs)


def test_an_arm_s_name_in_a_rule_stands_for_all_its_links_and_what_it_holds(two: Scene) -> None:
    scene = two.attach("cup", "left").allow("left", "wall").allow("left", "right/hand_link")
    assert all(scene.may_touch(f"left/{link}", "wall") for link in ("forearm_link", "hand_link"))
    assert scene.may_touch("cup", "wall")
    assert scene.may_touch("wall", "left/hand_link")
    assert scene.may_touch("left/forearm_link", "right/hand_link")
    assert not scene.may_touch("left/forearm_link", "right/forearm_link")
    assert not scene.may_touch("right/forearm_link", "wall")


def test_allowing_two_arms_does_not_allow_an_arm_to_hit_itself(two: Scene) -> None:
    scene = two.allow("left", "right")
    assert scene.may_touch("left/hand_link", "right/hand_link")
    assert not scene.may_touch("left/upper_arm_link", "left/forearm_link")


def test_what_an_arm_holds_may_touch_its_own_link_and_the_named_ones(two: Scene) -> None:
    scene = two.attach("cup", "left", touch=["finger_link"])
    assert scene.may_touch("cup", "left/finger_link")
    assert not scene.may_touch("cup", "left/forearm_link")
    assert not scene.may_touch("cup", "right/finger_link")
    assert not scene.may_touch("cup", "left/base_link")
    assert not scene.may_touch("cup", "wall")


def test_two_things_on_one_link_do_not_count_against_each_other(two: Scene) -> None:
    scene = two.with_obstacle("lid", Sphere(0.02), (-0.4, 0.4, 0.1)).attach("cup", "left").attach("lid", "left")
    assert scene.may_touch("cup", "lid")
    apart = two.with_obstacle("lid", Sphere(0.02)).attach("cup", "left").attach("lid", "left", "forearm_link")
    assert not apart.may_touch("cup", "lid")


@given(st.floats(0, 0.1), st.floats(0, 0.1), st.floats(0, 0.1))
@settings(deadline=None, max_examples=25)
def test_the_closest_padding_rule_counts(general: float, arm: float, link: float) -> None:
    base = Scene().with_obstacle("wall", Sphere(1.0))
    scene = _with_small_arm(base).with_padding(general).with_padding(arm, "arm", "wall")
    assert scene.padding_of("arm/a", "wall") == scene.padding_of("wall", "arm/a") == arm
    closer = scene.with_padding(link, "arm/a", "wall")
    assert closer.padding_of("arm/a", "wall") == link
    assert closer.padding_of("arm/b", "wall") == arm
    assert closer.padding_of("arm/a", "arm/b") == general


def _with_small_arm(scene: Scene) -> Scene:
    from rr1plan.robot import Joint, Link
    from rr1plan.robot.joint_limits import Limits

    solid = (Geometry("g", Sphere(0.1), identity()),)
    robot = Robot(
        "small",
        (Link("a", collisions=solid), Link("b", collisions=solid)),
        (Joint("j", "revolute", "a", "b", lower=-1, upper=1),),
        ("j",),
        Limits(*[np.array([v]) for v in (-1.0, 1.0, 1.0, 1.0, 1.0, 1.0)]),
        {"home": np.zeros(1)},
        {},
        frozenset(),
        "b",
    )
    return scene.with_arm("arm", robot)


# ---- attaching -------------------------------------------------------------------------------


def test_attaching_and_detaching_leaves_the_object_where_it_was(two: Scene) -> None:
    held = two.attach("cup", "left")
    assert "cup" not in held.obstacles
    assert "cup" in held.element_names
    assert held.owner("cup") == "left"
    back = held.detach("cup")
    assert np.allclose(back.obstacles["cup"].pose, two.obstacles["cup"].pose, atol=1e-14)
    assert back.obstacles["cup"].geometries is two.obstacles["cup"].geometries
    assert not back.attachments


def test_a_held_object_comes_down_where_the_arm_went(two: Scene) -> None:
    moved = two.attach("cup", "left").with_configuration("left", [0.5, 0, -0.2, 0, 0.4, 0])
    relative = np.linalg.inv(two.link_poses()["left/tool"]) @ two.obstacles["cup"].pose
    expected = moved.link_poses()["left/tool"] @ relative
    assert np.allclose(moved.detach("cup").obstacles["cup"].pose, expected, atol=1e-14)


def test_an_object_can_be_taken_at_a_given_pose(two: Scene) -> None:
    held = two.attach("cup", "left", pose=(0, 0, -0.05))
    assert np.allclose(held.attachments["cup"].pose, pose((0, 0, -0.05)))


def test_what_an_arm_holds_goes_with_it(two: Scene) -> None:
    scene = two.attach("cup", "left").allow("cup", "wall").with_padding(0.1, "cup", "right").without_arm("left")
    assert not scene.attachments
    assert not scene.allowed
    assert not scene.pair_padding
    assert list(scene.arms) == ["right"]


def test_removing_an_obstacle_forgets_its_rules_only(two: Scene) -> None:
    scene = two.allow("left", "cup").allow("left", "wall").without_obstacle("cup")
    assert scene.allowed == {pair("left", "wall")}


# ---- wrong calls -----------------------------------------------------------------------------


def test_names_that_cannot_be_are_refused(two: Scene, rr1: Robot) -> None:
    for name in ("", "a/b"):
        with pytest.raises(InputError, match="cannot name an element"):
            two.with_obstacle(name, Sphere(1.0))
    with pytest.raises(InputError, match="two elements named 'cup'"):
        two.with_arm("cup", rr1)


def test_unknown_names_are_refused_with_the_near_ones(two: Scene) -> None:
    for call, near in (
        (lambda: two.arm("lef"), "left"),
        (lambda: two.without_arm("rigt"), "right"),
        (lambda: two.without_obstacle("wal"), "wall"),
        (lambda: two.allow("left", "cupp"), "cup"),
        (lambda: two.with_padding(0.1, "left/hand", "cup"), "left/hand_link"),
        (lambda: two.attach("cap", "left"), "cup"),
        (lambda: two.attach("cup", "left", "hand"), "hand_link"),
        (lambda: two.attach("cup", "left", touch=["fingerlink"]), "finger_link"),
        (lambda: two.attach("cup", "left").detach("cu"), "cup"),
        (lambda: two.joint_names(["lefft"]), "left"),
        (lambda: two.with_configuration("left", "hme"), "home"),
    ):
        with pytest.raises(UnknownNameError, match=f"Did you mean.*{near!r}"):
            call()


def test_wrong_calls_are_refused(two: Scene, rr1: Robot) -> None:
    with pytest.raises(InputError, match="the scene has 2 arms"):
        two.attach("cup")
    with pytest.raises(InputError, match="distinct names"):
        two.arm_names(["left", "left"])
    with pytest.raises(InputError, match="distinct names"):
        two.arm_names([])
    with pytest.raises(InputError, match=r"padding is -0\.1"):
        two.with_padding(-0.1)
    with pytest.raises(InputError, match="padding"):
        two.with_padding(float("nan"), "left", "right")
    with pytest.raises(InputError, match="a distance and two names"):
        two.with_padding(0.1, "left")
    with pytest.raises(InputError, match="at least one shape"):
        Obstacle(())
    with pytest.raises(InputError, match="at least one shape"):  # which a file of the scene could not hold
        Attachment((), "left", "tool", identity())
    with pytest.raises(InputError, match="touch is 'finger_link', expected a list of links"):
        Attachment((Geometry("x", Sphere(0.1)),), "left", "tool", identity(), "finger_link")
    with pytest.raises(InputError, match="arm configuration has 1 number"):
        Arm(rr1, q=[0.0])
    with pytest.raises(InputError, match="cannot carry"):
        two.with_obstacle("ground", HalfSpace()).attach("ground", "left")
    with pytest.raises(InputError, match="cannot carry"):
        two.with_obstacle("scan", PointCloud([[0.0, 0, 0]])).attach("scan", "left")
    with pytest.raises(UnknownNameError, match="unknown link"):
        Scene(two.arms, attachments={"x": Attachment((Geometry("x", Sphere(0.1)),), "left", "gripper", identity())})


def test_pairs_of_rules_are_checked_and_unordered(two: Scene) -> None:
    scene = replace(two, pair_padding={("left", "wall"): 0.05, ("right",): 0.01})
    assert dict(scene.pair_padding) == {pair("left", "wall"): 0.05, frozenset({"right"}): 0.01}
    assert scene.padding_of("left/tool", "wall") == 0.05
    assert dict(scene.without_obstacle("wall").pair_padding) == {frozenset({"right"}): 0.01}
    with pytest.raises(InputError, match=r"two distances for 'left' and 'wall': 0.05 and 0.01; keep one"):
        replace(two, pair_padding={("left", "wall"): 0.05, ("wall", "left"): 0.01})
    for wrong in ((), ("left", "right", "wall")):
        with pytest.raises(InputError, match=r"one of allowed is .*expected the names of two"):
            replace(two, allowed=[wrong])
        with pytest.raises(InputError, match=r"one of pair_padding is .*expected the names of two"):
            replace(two, pair_padding={wrong: 0.1})
    with pytest.raises(InputError, match="one of pair_padding is 'left'"):
        replace(two, pair_padding={"left": 0.1})


def test_rules_and_poses_of_names_that_the_scene_does_not_have_are_refused(rr1_table: Scene) -> None:
    for a, b in (("nothing", "table"), ("rr1/nothing", "table"), ("table", "other/hand_link"), ("rr1", "table")):
        for verb in (rr1_table.may_touch, rr1_table.padding_of):
            with pytest.raises(UnknownNameError):
                verb(a, b)
            with pytest.raises(UnknownNameError):
                verb(b, a)
    with pytest.raises(UnknownNameError, match="unknown arm 'other'"):
        rr1_table.link_poses({"other": rr1_table.arms["rr1"].q})
