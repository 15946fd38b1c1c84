"""Replays of sequences in MuJoCo: fingers hold objects by friction."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.sequences.grippers import gripper_links


@pytest.fixture(scope="module")
def replay(moved: rp.SequencePlan) -> rp.SequenceReplay:
    return rp.simulate_sequence(moved)


def with_block(plan: rp.SequencePlan, **changes: object) -> rp.SequencePlan:
    """The same motion with another block."""
    block = replace(plan.scene.obstacles["block"], **changes)
    return replace(plan, scene=plan.scene.with_obstacles({"block": block}))


def test_friction_carries_the_block(replay: rp.SequenceReplay, moved: rp.SequencePlan) -> None:
    assert replay, replay
    assert replay.contacts == ()
    block = replay.objects["block"]
    assert block.max_offset < 5e-3
    assert block.final_offset < 3e-3
    assert block.angle < np.radians(2.0)
    assert replay.max_error < 2e-3
    # Lifted and carried, by some centimeters each.
    heights = block.poses[:, 2, 3]
    assert heights.max() > heights[0] + 0.07
    assert np.linalg.norm(block.poses[-1, :2, 3] - block.poses[0, :2, 3]) > 0.15


def test_simulate_names_the_function_for_sequences(moved: rp.SequencePlan) -> None:
    """In a replay of the trajectory alone, the fingers would be reported to touch the block."""
    with pytest.raises(rp.InputError, match=r"the plan of a sequence.* call simulate_sequence\(plan\)"):
        rp.simulate(moved, moved.scene)


def test_long_steps_are_named_as_the_reason_for_a_loss(moved: rp.SequencePlan) -> None:
    """Servos of 0.8 / dt press with a 25th of their usual force."""
    replay = rp.simulate_sequence(moved, dt=0.02)
    assert not replay.carried
    assert any("'block' is lost at" in said and said.endswith("fingers press less") for said in replay.remarks)
    assert "take a smaller time step: in steps of 20 ms servos are softer" in str(replay)


def test_a_heavier_block_is_carried_as_well(moved: rp.SequencePlan) -> None:
    replay = rp.simulate_sequence(with_block(moved, mass=0.6))
    assert replay.carried
    assert "firmer grasp" not in str(replay)


def test_without_friction_the_block_stays_behind(moved: rp.SequencePlan) -> None:
    """Nothing but friction holds it: it is not welded to the hand."""
    slippery = rp.simulate_sequence(with_block(moved, friction=0.01))
    assert not slippery
    assert not slippery.carried
    assert "'block' is lost at " in str(slippery)
    assert "a firmer grasp may hold, by squeeze of MoveGripper" in str(slippery)
    assert "if it moves outward in turns only, take a smaller time step" in str(slippery)
    block = slippery.objects["block"]
    assert block.poses[:, 2, 3].max() < 0.06
    assert block.final_offset > 0.1
    assert slippery.tracked


def test_an_object_that_nothing_supports_is_lost_before_it_is_held(table: rp.Scene) -> None:
    floating = table.with_obstacle_at("block", [-0.3, 0.1, 0.2])
    segments = [rp.Pause(0.5), rp.Attach("block"), rp.Pause(0.1)]
    plan = rp.plan_sequence(rp.Sequence(floating, segments))
    (said,) = rp.simulate_sequence(plan, hold=0.0).remarks
    assert said.startswith("'block' is lost at 0.06 s (pause of 0.5 s): not held then: does it stand on something")


def test_only_fingers_that_close_hold(table: rp.Scene) -> None:
    """A hand that holds by suction, in a plan, drops its object in the simulation."""
    T = table.link_poses()["arm/tool"] @ rp.transforms.pose([0.0, 0.0, 0.1])
    held = table.with_obstacle_at("block", T).attach("block", "arm")
    plan = rp.plan_sequence(rp.Sequence(held, [rp.Pause(0.5), rp.Detach("block")]))
    said = rp.simulate_sequence(plan, hold=0.0).remarks[-1]
    assert "(pause of 0.5 s): the gripper of 'arm' does not move: only fingers that close hold objects" in said


def test_a_mass_that_is_missing_is_estimated(moved: rp.SequencePlan) -> None:
    estimated = rp.simulate_sequence(with_block(moved, mass=None), hold=0.0)
    assert estimated.remarks == ("mass of 'block' taken as 0.096 kg, its volume at 1000 kg/m³",)
    assert "0.096 kg" in str(estimated)


def test_fingers_of_some_grams_that_turn_press_as_their_drive_does(moved: rp.SequencePlan) -> None:
    robot = moved.scene.arms["arm"].robot
    links = []
    for link in robot.links:
        own = link.inertial
        if own is not None and link.name in gripper_links(moved.sequence.scene.arms["arm"].robot):
            link = replace(link, inertial=replace(own, mass=own.mass / 100.0, inertia=own.inertia / 100.0))
        links.append(link)
    light = moved.scene.with_robot("arm", replace(robot, links=tuple(links)))
    assert rp.simulate_sequence(replace(moved, scene=light)).carried


def test_a_link_without_a_shape_may_be_among_those_that_touch_the_object(table: rp.Scene) -> None:
    """As the pads of some hands, which have no shape of their own."""
    segments = [
        replace(s, touch=("tool", "finger_link", "opposite_finger_link")) if isinstance(s, rp.Attach) else s
        for s in rp.pick_and_place(table, "block", [-0.28, -0.12, 0.03])
    ]
    assert not table.arms["arm"].robot.link("tool").collisions
    plan = rp.plan_sequence(rp.Sequence(table, segments), rng=0)
    assert rp.simulate_sequence(plan, hold=0.0).carried


def test_contacts_that_no_stage_allows_are_named(moved: rp.SequencePlan) -> None:
    """A post in the way of the hand is found by MuJoCo, too."""
    hand = moved.scene.with_configuration("arm", moved.trajectory(moved.stages[1].end)).link_poses()["arm/hand_link"]
    post = moved.scene.with_obstacle("post", rp.Sphere(0.02), hand[:3, 3])
    hit = rp.simulate_sequence(replace(moved, scene=post), hold=0.0)
    assert not hit
    assert any("post" in contact.pair for contact in hit.contacts)


def test_the_same_replay_gives_the_same_numbers(moved: rp.SequencePlan, replay: rp.SequenceReplay) -> None:
    again = rp.simulate_sequence(moved)
    np.testing.assert_array_equal(again.objects["block"].poses, replay.objects["block"].poses)
    np.testing.assert_array_equal(again.replay.record.actual, replay.replay.record.actual)


def test_a_summary_is_plain(replay: rp.SequenceReplay) -> None:
    said = replay.to_dict()
    assert said["carried"] is True
    assert said["objects"]["block"]["max_offset"] == replay.objects["block"].max_offset
    assert "contacts: none that no stage allows" in str(replay)


def test_a_plan_that_failed_has_no_replay(table: rp.Scene) -> None:
    plan = rp.plan_sequence(rp.Sequence(table, [rp.FreeMotion(rp.PoseGoal("tool", [5, 0, 0]))]), rng=0)
    with pytest.raises(rp.NoPlanError, match="segment 1"):
        rp.simulate_sequence(plan)


def test_a_body_that_touches_something_at_once_is_simulated(table: rp.Scene) -> None:
    """MuJoCo crashes if its no-slip solver is enabled after contacts were found without it."""
    sunk = table.with_obstacle_at("block", [-0.3, 0.1, 0.0295])
    plan = rp.plan_sequence(rp.Sequence(sunk, [rp.Attach("block"), rp.Detach("block"), rp.Pause(0.05)]), rng=0)
    assert rp.simulate_sequence(plan, hold=0.1).objects["block"].max_offset < 1e-3


def test_a_cylinder_lies_still_where_rolling_friction_holds_it(table: rp.Scene) -> None:
    """On a slope of 0.003 rad; without rolling friction it rolls 1 cm in a second."""
    slope = rp.transforms.pose([-0.3, -0.2, 0.05], rpy=[0.0, 0.003, 0.0])
    lying = slope @ rp.transforms.pose([0.0, 0.0, 0.025], rpy=[np.pi / 2, 0.0, 0.0])
    scene = table.with_obstacle("slope", rp.Box((0.2, 0.2, 0.02)), slope)
    scene = scene.with_obstacle("roller", rp.Cylinder(0.015, 0.06), lying, mass=0.1)
    plan = rp.plan_sequence(rp.Sequence(scene, [rp.Attach("roller"), rp.Detach("roller"), rp.Pause(1.0)]), rng=0)
    assert rp.simulate_sequence(plan, hold=0.0).objects["roller"].max_offset < 1e-3
