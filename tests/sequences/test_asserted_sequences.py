"""`assert_valid` and `assert_replays` of sequences: stage by stage, with objects that friction holds."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import rr1plan as rp


def test_a_planned_sequence_is_valid_and_replays(moved: rp.SequencePlan) -> None:
    assert rp.assert_valid(moved).certified
    replay = rp.assert_replays(moved)
    assert replay.objects["block"].max_offset < 0.01
    assert replay.max_error < 0.01


def test_a_sequence_is_checked_in_another_scene(moved: rp.SequencePlan, table: rp.Scene) -> None:
    assert rp.assert_valid(moved, table).certified  # with the gripper locked, as scenes have it
    at = moved.object_poses("block", [moved.stages[6].end])[0][:3, 3]
    with pytest.raises(AssertionError, match=r"the motion is not valid: collision: stage 7 .*ball and block overlap"):
        rp.assert_valid(moved, table.with_obstacle("ball", rp.Sphere(0.004), at - [0, 0, 0.032]))


def test_an_object_that_is_not_held_is_named(moved: rp.SequencePlan) -> None:
    """It slips from fingers with a hundredth of the friction."""
    block = moved.scene.obstacles["block"]
    slippery = replace(moved.scene, obstacles={**moved.scene.obstacles, "block": replace(block, friction=0.01)})
    with pytest.raises(AssertionError, match=r"the replay failed: .*block is \d+ mm from its plan"):
        rp.assert_replays(replace(moved, scene=slippery))


def test_only_objects_that_are_lost_are_named(table: rp.Scene) -> None:
    """A second block is let go in mid-air, the first one stays where it was put down."""
    table = table.with_obstacle("cup", rp.Box((0.04, 0.04, 0.06)), [-0.2, 0.2, 0.03], mass=0.1)
    segments = [*rp.pick_and_place(table, "block", [-0.28, -0.12, 0.03])]
    segments += rp.pick_and_place(table, "cup", [-0.2, -0.2, 0.13])
    plan = rp.plan_sequence(rp.Sequence(table, segments), rng=0, budget=rp.Budget(seconds=100.0))
    with pytest.raises(AssertionError) as failure:
        rp.assert_replays(plan)
    first = str(failure.value).splitlines()[0]
    assert re.fullmatch(r"the replay failed: cup is 1\d\d mm from its plan, lost at \d+\.\d\d s", first)


def test_what_a_sequence_does_not_take_is_refused(moved: rp.SequencePlan, table: rp.Scene) -> None:
    with pytest.raises(rp.InputError, match="in its own scene with arms as described"):
        rp.assert_replays(moved, table)  # type: ignore[call-overload]
    varied: Any = {"variations": rp.ReplayVariations(payload=0.1)}
    with pytest.raises(rp.InputError, match="got variations, expected none: a sequence is replayed"):
        rp.assert_replays(moved, **varied)
    problem = rp.Problem(table, None, "home")
    with pytest.raises(rp.InputError, match="a sequence has no single start and goal"):
        rp.assert_valid(moved, problem=problem)
    failed = rp.plan_sequence(rp.Sequence(table, [rp.StraightLine(offset=np.array([0, 0, 5.0]))]), rng=0)
    for check in (rp.assert_valid, rp.assert_replays):
        with pytest.raises(AssertionError, match="there is no motion: no plan"):
            check(failed)


def test_a_joint_that_does_not_follow_is_named(moved: rp.SequencePlan) -> None:
    with pytest.raises(AssertionError, match=r"the replay failed: arm/\w+_joint is \S+ rad from its set-point at \d"):
        rp.assert_replays(moved, tolerance=1e-9)


def test_other_checkers_take_the_stages_of_a_sequence(moved: rp.SequencePlan) -> None:
    """In one scene the fingers would touch the object that they grasp."""
    with pytest.raises(rp.InputError, match=r"check each stage .*: plan.trajectory.cut\(stage.begin, stage.end\)"):
        rp.second_opinion(moved, moved.scene)
    assert not rp.second_opinion(moved.trajectory, moved.scene, step=0.01)
    for stage, scene in zip(moved.stages, moved.scenes(), strict=True):
        if stage.change is None:
            assert rp.second_opinion(moved.trajectory.cut(stage.begin, stage.end), scene, step=0.01), stage.label
