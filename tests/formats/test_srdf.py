"""The SRDF reader, and the pairs proposed if there is no SRDF."""

from __future__ import annotations

import logging

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.errors import FormatError, InputError
from rr1plan.robot.disabled_collisions import (
    LinkBodies,
    free_configuration,
    propose_disabled_collisions,
    touching_links,
)
from rr1plan.robot.robot_builder import Choice, assemble
from rr1plan.robot.srdf import chain_joints, read_srdf
from rr1plan.robot.urdf import Tree, read_urdf

LIMIT = '<limit lower="-1" upper="1" velocity="2" effort="3"/>'
LENGTH = 0.4


def chain_text(links: int, lower: float = -3.0, upper: float = 3.0) -> str:
    """A planar chain of thin bars; a fixed tool at its end."""
    bar = (
        f'<collision><origin xyz="{LENGTH / 2} 0 0"/><geometry><box size="{LENGTH} 0.02 0.02"/></geometry></collision>'
    )
    parts = [f'<link name="l{i}">{bar}</link>' for i in range(links)] + ['<link name="tool"/>']
    parts += [
        f'<joint name="j{i}" type="revolute"><parent link="l{i - 1}"/><child link="l{i}"/>'
        f'<origin xyz="{LENGTH} 0 0"/><axis xyz="0 0 1"/>'
        f'<limit lower="{lower}" upper="{upper}" velocity="1" effort="1"/></joint>'
        for i in range(1, links)
    ]
    parts.append(
        f'<joint name="jt" type="fixed"><parent link="l{links - 1}"/><child link="tool"/>'
        f'<origin xyz="{LENGTH} 0 0"/></joint>'
    )
    return '<robot name="chain">' + "".join(parts) + "</robot>"


@pytest.fixture
def chain() -> Tree:
    return read_urdf(chain_text(5))


def srdf_text(*parts: str, name: str = "chain") -> str:
    return f'<robot name="{name}">\n' + "\n".join(parts) + "\n</robot>"


ARM = '<group name="arm"><chain base_link="l0" tip_link="l3"/></group>'

BAD = {
    "one link twice": ('<disable_collisions link1="l0" link2="l0"/>', "twice"),
    "no second link": ('<disable_collisions link1="l0"/>', "link2"),
    "group in itself": ('<group name="g"><group name="g"/></group>', "contains itself"),
    "group twice": ('<group name="g"/><group name="g"/>', "twice"),
    "state with a word": (
        ARM + '<group_state name="s" group="arm"><joint name="j1" value="abc"/></group_state>',
        "'abc'",
    ),
    "state with nan": (
        ARM + '<group_state name="s" group="arm"><joint name="j1" value="nan"/></group_state>',
        "finite",
    ),
    "state twice": (ARM + '<group_state name="s" group="arm"/><group_state name="s" group="arm"/>', "twice"),
    "doctype": ("<!DOCTYPE x>", "well-formed"),
    "xacro left in": ('<xacro:include filename="arm.xacro"/>', "<xacro:include> has to be expanded first"),
}

STRANGE = {
    "pair": '<disable_collisions link1="l0" link2="x"/>',
    "pair switched on": '<enable_collisions link1="x" link2="l0"/>',
    "off by default": '<disable_default_collisions link="x"/>',
    "joint in a group": '<group name="g"><joint name="x"/><joint name="j2"/></group>',
    "link in a group": '<group name="g"><link name="x"/><link name="l2"/></group>',
    "chain": '<group name="g"><chain base_link="x" tip_link="l3"/></group>',
    "state": '<group_state name="s" group="arm"><joint name="x" value="0 0 0"/></group_state>',
    "hand": '<end_effector name="e" group="arm" parent_link="x"/>',
    "passive joint": '<passive_joint name="x"/>',
    "group in a group": '<group name="g"><group name="x"/><joint name="j2"/></group>',
    "state of a group": '<group_state name="s" group="x"><joint name="j1" value="1"/></group_state>',
    "hand of a group": '<end_effector name="e" group="x" parent_link="l3"/>',
}


@pytest.mark.parametrize("name", STRANGE)
def test_links_and_joints_of_another_variant_are_passed_over_with_a_warning(
    chain: Tree, name: str, caplog: pytest.LogCaptureFixture
) -> None:
    own = '<disable_collisions link1="l0" link2="l2"/>'
    found = read_srdf(srdf_text(ARM, STRANGE[name], own), chain)
    assert "'x' (line 3)" in caplog.text
    assert found.groups["arm"] == ("j1", "j2", "j3")
    assert found.groups.get("g", ()) in ((), ("j2",))
    assert "g" not in found.chains
    assert found.disabled == {frozenset(("l0", "l2"))}
    assert not found.end_effectors
    assert not found.passive
    assert found.states.get(("arm", "s"), {}) == {}


def test_a_hand_whose_arm_is_unknown_is_kept_without_it(chain: Tree, caplog: pytest.LogCaptureFixture) -> None:
    (hand,) = read_srdf(
        srdf_text(ARM, '<end_effector name="e" group="arm" parent_link="l3" parent_group="x"/>'), chain
    ).end_effectors
    assert (hand.name, hand.parent_group) == ("e", None)
    assert "group 'x' (line 3)" in caplog.text


def test_a_chain_may_lead_over_the_link_above_both_its_ends() -> None:
    joint = (
        '<joint name="{0}" type="revolute"><parent link="{1}"/><child link="{0}_link"/><axis xyz="0 0 1"/>'
        + LIMIT
        + '</joint><link name="{0}_link"/>'
    )
    tree = read_urdf(
        '<robot name="r"><link name="chest"/>'
        + "".join(
            joint.format(name, parent)
            for name, parent in (
                ("waist", "chest"),
                ("a1", "waist_link"),
                ("a2", "a1_link"),
                ("b1", "waist_link"),
                ("b2", "b1_link"),
            )
        )
        + "</robot>"
    )
    found = read_srdf(
        '<robot name="r"><group name="g"><chain base_link="a2_link" tip_link="b2_link"/></group></robot>', tree
    )
    assert found.groups["g"] == ("a1", "a2", "b1", "b2")
    assert chain_joints(tree.joints, "a2_link", "b2_link") == ("a2", "a1", "b1", "b2")
    assert chain_joints(tree.joints, "b2_link", "chest") == ("b2", "b1", "waist")


def test_the_joint_to_the_world_is_no_strange_one(chain: Tree, caplog: pytest.LogCaptureFixture) -> None:
    world = '<virtual_joint name="world" type="planar" parent_frame="odom" child_link="l0"/>'
    values = '<joint name="world" value="0 0 0"/><joint name="j1" value="1"/>'
    state = f'<group_state name="s" group="arm">{values}</group_state>'
    found = read_srdf(srdf_text(ARM, world, state), chain)
    assert found.states["arm", "s"] == {"j1": 1.0}
    assert not caplog.text


def test_pairs_that_an_srdf_forgot_and_that_always_touch_are_not_checked(caplog: pytest.LogCaptureFixture) -> None:
    hub = '<collision><geometry><sphere radius="1"/></geometry></collision>'
    text = chain_text(5).replace('<link name="l0">', f'<link name="l0">{hub}')
    tree = read_urdf(text)
    robot = assemble(tree, read_srdf(srdf_text('<disable_collisions link1="l0" link2="l1"/>'), tree), Choice())
    assert frozenset(("l0", "l2")) in robot.disabled_collisions
    assert "l0 - l2" in caplog.text
    assert frozenset(("l0", "l4")) not in robot.disabled_collisions


def test_a_state_that_stands_in_for_home_is_left_where_links_touch_in_it() -> None:
    tree = read_urdf(chain_text(5))
    values = "".join(f'<joint name="j{i}" value="2"/>' for i in range(1, 5))
    pairs = "".join(f'<disable_collisions link1="l{i}" link2="l{i + 1}"/>' for i in range(4))
    for state, stays in (("folded", False), ("home", True)):
        group = '<group name="arm"><chain base_link="l0" tip_link="l4"/></group>'
        text = srdf_text(group, f'<group_state name="{state}" group="arm">{values}</group_state>', pairs)
        robot = assemble(tree, read_srdf(text, tree), Choice())
        assert robot.configurations[state].tolist() == [2.0] * 4
        assert (robot.home.tolist() == [2.0] * 4) == stays
        assert bool(touching_links(robot, robot.home, LinkBodies(robot))) == stays


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_a_format_error_with_its_line(chain: Tree, name: str) -> None:
    text, word = BAD[name]
    with pytest.raises(FormatError) as caught:
        read_srdf(srdf_text("", text), chain)
    assert word in str(caught.value)
    assert caught.value.line == 3


def test_another_robots_name_is_a_warning(chain: Tree, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        read_srdf(srdf_text(name="other"), chain)
    assert "'other'" in caplog.text


def test_groups_hold_the_movable_joints_of_chains_joints_links_and_subgroups(chain: Tree) -> None:
    more = '<group name="more"><joint name="jt"/><link name="l4"/><group name="arm"/></group>'
    found = read_srdf(srdf_text(ARM, more), chain)
    assert found.groups == {"arm": ("j1", "j2", "j3"), "more": ("j1", "j2", "j3", "j4")}
    assert found.chains == {"arm": ("l0", "l3")}


def test_links_off_by_default_can_be_switched_on_again_by_pair(chain: Tree) -> None:
    text = srdf_text('<disable_default_collisions link="l0"/>', '<enable_collisions link1="l3" link2="l0"/>')
    disabled = read_srdf(text, chain).disabled
    assert frozenset(("l0", "l2")) in disabled
    assert frozenset(("l0", "l3")) not in disabled


def test_passive_joints_are_held(chain: Tree) -> None:
    text = srdf_text('<passive_joint name="j2"/>', '<disable_collisions link1="l0" link2="l1"/>')
    robot = assemble(chain, read_srdf(text, chain), Choice())
    assert robot.joint_names == ("j1", "j3", "j4")
    assert dict(robot.locked_joints) == {"j2": 0.0}


def test_a_state_outside_the_limits_is_kept_with_a_warning_but_is_no_home(
    chain: Tree, caplog: pytest.LogCaptureFixture
) -> None:
    state = '<group_state name="far" group="arm">' + "".join(f'<joint name="j{i}" value="3.1"/>' for i in (1, 2, 3))
    robot = assemble(chain, read_srdf(srdf_text(ARM, state + "</group_state>"), chain), Choice())
    assert robot.configurations["far"].tolist() == [3.1, 3.1, 3.1]
    assert robot.home.tolist() == [0, 0, 0]
    assert "'far'" in caplog.text


def test_a_state_outside_the_limits_by_whole_turns_is_moved_into_them(
    chain: Tree, caplog: pytest.LogCaptureFixture
) -> None:
    state = '<group_state name="far" group="arm">' + "".join(f'<joint name="j{i}" value="9"/>' for i in (1, 2, 3))
    robot = assemble(chain, read_srdf(srdf_text(ARM, state + "</group_state>"), chain), Choice())
    assert robot.configurations["far"] == pytest.approx(np.full(3, 9.0 - 2.0 * np.pi))
    assert "it is moved by whole turns" in caplog.text


def test_a_state_without_values_of_all_joints_of_its_group_is_left_out_with_a_warning(
    chain: Tree, caplog: pytest.LogCaptureFixture
) -> None:
    state = '<group_state name="home" group="arm"><joint name="j2" value="0.5"/></group_state>'
    robot = assemble(chain, read_srdf(srdf_text(ARM, state), chain), Choice())
    assert robot.home.tolist() == [0, 0, 0]
    assert "chain: the state 'home' of group 'arm' is left out, it has no value of j1, j3\n" in caplog.text
    caplog.clear()
    assert assemble(chain, read_srdf(srdf_text(ARM, state), chain), Choice(joints=["j2"])).home.tolist() == [0.5]
    assert "is left out" not in caplog.text


def test_the_arm_that_carries_the_gripper_is_planned_for_and_the_gripper_held(chain: Tree) -> None:
    hand = '<group name="hand"><joint name="j4"/></group>'
    effector = '<end_effector name="e" group="hand" parent_link="l3" parent_group="arm"/>'
    states = '<group_state name="open" group="hand"><joint name="j4" value="0.5"/></group_state>'
    robot = assemble(chain, read_srdf(srdf_text(hand, ARM, effector, states), chain), Choice())
    assert robot.joint_names == ("j1", "j2", "j3")
    assert robot.tool == "l3"
    assert robot.with_locked_joints("open").locked_joints["j4"] == 0.5
    without_parent = effector.replace(' parent_group="arm"', "")
    robot = assemble(chain, read_srdf(srdf_text(hand, ARM, without_parent), chain), Choice())
    assert robot.joint_names == ("j1", "j2", "j3")


def test_a_group_that_only_holds_a_gripper_with_no_joint_is_refused(chain: Tree) -> None:
    semantics = read_srdf(srdf_text('<group name="g"><joint name="jt"/></group>'), chain)
    with pytest.raises(InputError, match=r"no joint to plan for in group 'g'.*two equal limits"):
        assemble(chain, semantics, Choice(groups=["g"]))


def test_neighbors_links_that_always_touch_and_that_never_can_are_proposed() -> None:
    rod = '<collision><geometry><sphere radius="{}"/></geometry></collision>'
    links = [("a", 0.1), ("b", 0.05), ("c", 0.1), ("d", 0.05)]
    text = "".join(f'<link name="{n}">{rod.format(r)}</link>' for n, r in links)
    for name, parent, child, x in (("j1", "a", "b", 0.05), ("j2", "b", "c", 0.05), ("j3", "c", "d", 0.5)):
        text += (
            f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/>'
            f'<origin xyz="{x} 0 0"/><axis xyz="0 0 1"/>{LIMIT}</joint>'
        )
    robot = assemble(read_urdf(f'<robot name="r">{text}</robot>'), None, Choice())
    found = {
        tuple(sorted(pair)): reason for pair, reason in propose_disabled_collisions(robot, samples=200, rng=0).items()
    }
    assert found == {
        ("a", "b"): "Adjacent",
        ("b", "c"): "Adjacent",
        ("c", "d"): "Adjacent",
        ("a", "c"): "Always",
        ("a", "d"): "Never",
        ("b", "d"): "Never",
    }
    assert frozenset(("a", "d")) not in robot.disabled_collisions
    assert frozenset(("a", "c")) in robot.disabled_collisions


def test_pairs_that_touch_sometimes_are_not_proposed(chain: Tree) -> None:
    robot = assemble(chain, None, Choice())
    assert frozenset(("l0", "l3")) not in propose_disabled_collisions(robot, samples=500, rng=0)


def test_the_proposal_is_the_same_for_the_same_seed_and_needs_samples(chain: Tree) -> None:
    robot = assemble(chain, None, Choice())
    assert propose_disabled_collisions(robot, samples=50, rng=3) == propose_disabled_collisions(
        robot, samples=50, rng=3
    )
    with pytest.raises(InputError, match="samples"):
        propose_disabled_collisions(robot, samples=0)


def test_a_robot_whose_middle_collides_gets_a_free_home() -> None:
    tree = read_urdf(chain_text(5, lower=1.0, upper=3.0))
    robot = assemble(tree, None, Choice())
    bodies = LinkBodies(robot)
    pairs = [pair for pair in bodies.pairs if pair not in robot.disabled_collisions]
    middle = np.full(4, 2.0)
    assert bodies.touching(robot.joint_values(middle), pairs)
    assert not bodies.touching(robot.joint_values(robot.home), pairs)
    assert np.array_equal(free_configuration(robot, robot.home, bodies), robot.home)


def test_pairs_that_leave_a_robot_without_an_srdf_no_free_place_are_not_checked(
    caplog: pytest.LogCaptureFixture,
) -> None:
    # Balls that let the next link but one out in a fifth of its range: all are free together hardly ever.
    ball = f'<collision><geometry><sphere radius="{1.9 * LENGTH}"/></geometry></collision>'
    text = chain_text(15, lower=0.05, upper=3.0)
    for i in range(0, 15, 3):
        text = text.replace(f'<link name="l{i}">', f'<link name="l{i}">{ball}')
    tree = read_urdf(text)
    proposal = propose_disabled_collisions(assemble(tree, None, Choice()), samples=200, rng=0)
    assert frozenset(("l0", "l2")) not in proposal
    robot = assemble(tree, None, Choice())
    assert frozenset(("l0", "l2")) in robot.disabled_collisions
    assert "l0 - l2" in caplog.text
    assert not touching_links(robot, robot.home, LinkBodies(robot))


def test_rr1_has_an_end_effector_group_and_its_states(rr1: rp.Robot) -> None:
    assert set(rr1.configurations) == {"home", "zero", "raised"}
    assert set(rr1.locked_joint_states) == {"open", "closed"}
