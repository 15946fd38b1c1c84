"""Segments that do not stop: corners between them are rounded, and everything else is as with stops."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from sequences.conftest import tool_down

import rr1plan as rp
from rr1plan.report import Violation
from rr1plan.sequences.stage_validation import validate_stages
from rr1plan.sequences.stages import SequenceStage


def plan_of(scene: rp.Scene, *segments: object, **options: object) -> rp.SequencePlan:
    return rp.plan_sequence(rp.Sequence(scene, segments), **{"rng": 0, "budget": rp.Budget(seconds=100.0), **options})


def speed_at(plan: rp.SequencePlan, time: float) -> float:
    return float(np.abs(plan.trajectory(time, 1)).max())


def via(stop: bool) -> list[object]:
    """Two free motions and a line down."""
    return [
        rp.FreeMotion("raised", stop=stop),
        rp.FreeMotion(tool_down(-0.3, 0.0, 0.25), stop=stop),
        rp.StraightLine(offset=[0.0, 0.0, -0.1]),
    ]


def test_segments_are_passed_without_a_stop_and_sooner(table: rp.Scene) -> None:
    stopping, passing = (plan_of(table, *via(stop)) for stop in (True, False))
    assert stopping, stopping
    assert passing, passing
    assert passing.report.certified
    assert {"rest", "continuity", "acceleration"} <= set(passing.report.checked)
    assert max(speed_at(stopping, stage.end) for stage in stopping.stages) < 1e-9
    speeds = [speed_at(passing, stage.end) for stage in passing.stages]
    assert min(speeds[:2]) > 0.05
    assert speeds[2] < 1e-9
    assert passing.trajectory.duration < 0.97 * stopping.trajectory.duration
    # Stages end at the point of the motion nearest to their goals, which is near.
    for k, stage in enumerate(passing.stages[:2]):
        goal = stopping.trajectory(stopping.stages[k].end)
        q = passing.trajectory(np.linspace(0.0, passing.trajectory.end_time, 20_001))
        nearest = np.linalg.norm(q - goal, axis=1).min()
        assert np.linalg.norm(passing.trajectory(stage.end) - goal) == pytest.approx(nearest, abs=1e-6)
        assert nearest < 0.5
    # The last goal is exact.
    np.testing.assert_allclose(
        passing.trajectory(passing.trajectory.end_time), stopping.trajectory(stopping.trajectory.end_time), atol=1e-12
    )


def test_a_pick_without_stops_carries_the_block_as_well(
    table: rp.Scene, tmp_path_factory: pytest.TempPathFactory
) -> None:
    place = [-0.28, -0.12, 0.03]
    plans = [
        plan_of(table, *rp.pick_and_place(table, "block", place, stop=stop), rp.FreeMotion("home"))
        for stop in (True, False)
    ]
    assert all(plans)
    stopping, passing = plans
    assert passing.trajectory.duration < stopping.trajectory.duration - 0.1
    passed = [
        stage.label for stage in passing.stages[:-1] if stage.change is None and speed_at(passing, stage.end) > 1e-3
    ]
    assert passed == [
        passing.stages[1].label,  # above the block
        passing.stages[5].label,  # lifted
        passing.stages[6].label,  # above the place
        passing.stages[10].label,  # withdrawn
    ]
    # Fingers close, and the block is grasped and released, at rest.
    for event in passing.events:
        assert speed_at(passing, event.begin) < 1e-9
    end = passing.trajectory.end_time
    np.testing.assert_allclose(passing.object_poses("block", [end])[0][:3, 3], place, atol=1e-3)
    read = rp.load_sequence(passing.save(tmp_path_factory.mktemp("passing") / "p.json"))
    assert read.report.certified


def test_what_cannot_be_passed_is_a_stop(table: rp.Scene) -> None:
    """Before a gripper, a pause, an attachment, a motion of other arms, and at the end."""
    segments = [
        rp.FreeMotion("raised", stop=False),
        rp.MoveGripper("open"),
        rp.FreeMotion(tool_down(-0.3, 0.0, 0.25), stop=False),
        rp.Pause(0.1),
        rp.StraightLine(offset=[0.0, 0.0, -0.05], stop=False),
    ]
    plan = plan_of(table, *segments)
    assert plan, plan
    assert max(speed_at(plan, stage.end) for stage in plan.stages) < 1e-9
    other = plan_of(table, *(replace(s, stop=True) if hasattr(s, "stop") else s for s in segments))
    np.testing.assert_array_equal(plan.trajectory.breaks, other.trajectory.breaks)
    # A way back along the same line has no corner to round.
    back = plan_of(table, rp.FreeMotion("raised", stop=False), rp.FreeMotion("home"))
    assert back, back
    assert speed_at(back, back.stages[0].end) < 1e-6


def test_a_retiming_that_stops_at_corners_stops(table: rp.Scene) -> None:
    plan = plan_of(table, *via(False), retiming="stop")
    assert plan, plan
    assert max(speed_at(plan, stage.end) for stage in plan.stages) < 1e-9


def test_two_arms_that_move_one_after_the_other_stop(rr1: rp.Robot) -> None:
    scene = rp.Scene().with_arm("left", rr1).with_arm("right", rr1, [0.0, 1.5, 0.0])
    plan = plan_of(scene, rp.FreeMotion("raised", arm="left", stop=False), rp.FreeMotion("raised", arm="right"))
    assert plan, plan
    assert speed_at(plan, plan.stages[0].end) < 1e-9


# ---- the referee -----------------------------------------------------------------------------------


def rests(report: rp.Report) -> list[Violation]:
    return [violation for violation in report.violations if violation.kind == "rest"]


def test_the_referee_wants_rest_where_something_is_taken_and_at_both_ends(table: rp.Scene) -> None:
    plan = plan_of(table, *via(False))
    first, *others = plan.stages
    assert rests(validate_stages(plan.trajectory, plan.scene, plan.stages)) == []
    taken = SequenceStage(
        "take", first.end, first.end, change=rp.Attach("block", arm="arm", link="hand_link", touch=())
    )
    found = rests(validate_stages(plan.trajectory, plan.scene, [first, taken, *others]))
    assert found
    assert {violation.time for violation in found} == {first.end}
    half = plan.trajectory.cut(0.0, first.end)
    assert rests(validate_stages(half, plan.scene, [first]))


def test_the_referee_wants_one_speed_on_both_sides(table: rp.Scene) -> None:
    names, q = table.joint_names(), table.configuration()
    line = np.zeros((2, 2, 6))
    line[0, 0], line[1, 0] = q, q + 0.1 * np.eye(6)[0]
    line[0, 1], line[1, 1] = 0.1 * np.eye(6)[0], 0.2 * np.eye(6)[0]
    jumps = rp.Trajectory(names, [0.0, 1.0, 2.0], line)
    stages = [SequenceStage("a", 0.0, 1.0), SequenceStage("b", 1.0, 2.0)]
    times = {violation.time for violation in rests(validate_stages(jumps, table, stages))}
    assert times == {0.0, 1.0, 2.0}
    steady = rp.Trajectory(names, [0.0, 1.0, 2.0], np.where(np.arange(2)[None, :, None] == 1, line[:1], line))
    times = {violation.time for violation in rests(validate_stages(steady, table, stages))}
    assert times == {0.0, 2.0}
