"""The referee of a sequence: every stage in its own scene, continuity between them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.sequences.stage_validation import validate_stages


def carried(plan: rp.SequencePlan) -> float:
    """A time at which the block is being carried."""
    return 0.5 * (plan.events[0].end + plan.events[1].begin)


def test_each_stage_has_its_scene(moved: rp.SequencePlan) -> None:
    scenes = moved.scenes()
    holds = ["block" in scene.attachments for scene in scenes]
    first, last = (moved.stages.index(event) for event in moved.events)
    assert holds == [first <= k < last for k in range(len(scenes))]
    assert all(("block" in scene.obstacles) != held for scene, held in zip(scenes, holds, strict=True))
    lift = scenes[first + 1]
    assert lift.may_touch("block", "table")
    assert not scenes[first + 2].may_touch("block", "table")
    assert set(lift.attachments["block"].touch) == {"finger_link", "opposite_finger_link"}


def test_what_the_held_block_hits_is_found(moved: rp.SequencePlan) -> None:
    """A ball that only the block touches, below its middle."""
    at = moved.object_poses("block", [carried(moved)])[0][:3, 3]
    ball = moved.scene.with_obstacle("ball", rp.Sphere(0.004), at - [0.0, 0.0, 0.028])
    report = validate_stages(moved.trajectory, ball, moved.stages)
    assert not report.valid
    assert {violation.subject for violation in report.violations} == {("ball", "block")}
    (violation,) = report.violations
    assert violation.kind == "collision"
    assert violation.message.startswith("stage 7 (free motion to one of 8 goals): ")
    # Without the block the same motion is free: the arm itself misses the ball.
    empty = [replace(stage, change=None, allowed=frozenset()) for stage in moved.stages]
    assert validate_stages(moved.trajectory, ball.without_obstacle("block"), empty).valid


def test_what_the_block_hits_where_it_was_put_down_is_found(moved: rp.SequencePlan) -> None:
    """The fingers may touch the block while they release it, and at no other time."""
    strict = [replace(s, allowed=frozenset()) if s.label.startswith("gripper") else s for s in moved.stages]
    report = validate_stages(moved.trajectory, moved.scene, strict)
    subjects = {v.subject for v in report.violations}
    assert ("arm/finger_link", "block") in subjects
    assert all("block" in subject for subject in subjects)
    assert {v.message.split(":")[0] for v in report.violations} == {
        "stage 4 (gripper around 'block')",
        f"stage 10 ({moved.stages[9].label})",
    }


def test_a_lift_that_may_not_touch_the_table_is_a_contact(moved: rp.SequencePlan) -> None:
    strict = [replace(s, allowed=frozenset()) if s.label == "straight line 80 mm up" else s for s in moved.stages]
    report = validate_stages(moved.trajectory, moved.scene, strict)
    assert [set(v.subject) for v in report.violations] == [{"block", "table"}]
    assert "rests on" in report.violations[0].message


def test_a_jump_between_stages_is_found(moved: rp.SequencePlan) -> None:
    breaks, coefficients = moved.trajectory.breaks, moved.trajectory.coefficients.copy()
    first = int(np.searchsorted(breaks, moved.stages[6].begin))
    coefficients[first:, 0, 0] += 1e-4
    jump = rp.Trajectory(moved.trajectory.joint_names, breaks, coefficients)
    report = validate_stages(jump, moved.scene, moved.stages)
    (violation,) = [v for v in report.violations if v.kind == "continuity"]
    assert violation.subject == ("arm/shoulder_joint",)
    assert violation.time == pytest.approx(moved.stages[6].begin)


def test_a_sequence_that_begins_elsewhere_is_found(moved: rp.SequencePlan, table: rp.Scene) -> None:
    q = moved.scene.arms["arm"].q.copy()
    q[1] += 0.1
    report = validate_stages(moved.trajectory, moved.scene.with_configuration("arm", q), moved.stages)
    assert [(v.kind, v.subject) for v in report.violations] == [("start", ("arm/upper_arm_joint",))]
    assert report.violations[0].message.endswith(f"expected {q[1]:.9g} rad")


def test_an_object_released_inside_the_wrist_is_found(rr1: rp.Robot) -> None:
    scene = rp.Scene().with_arm("arm", rr1)
    scene = scene.with_obstacle("box", rp.Box((0.05, 0.05, 0.05)), scene.link_poses()["arm/hand_link"])
    held = scene.attach("box", touch=rr1.link_names)
    plan = rp.plan_sequence(rp.Sequence(held, [rp.FreeMotion("raised")]), rng=0)
    end = plan.trajectory.end_time
    stages = [*plan.stages, rp.SequenceStage("detach 'box'", end, end, change=rp.Detach("box"))]
    report = validate_stages(plan.trajectory, held, stages)
    (violation,) = [v for v in report.violations if "arm/wrist_link" in v.subject]
    assert violation.time == end
    assert violation.message.startswith("stage 2 (detach 'box'): arm/wrist_link and box overlap by ")
    assert {v.kind for v in report.violations} == {"collision"}
    assert not any({"arm/hand_link", "arm/finger_link"} & set(v.subject) for v in report.violations)
    # The other hand takes it at the same time.
    stages.append(rp.SequenceStage("attach 'box'", end, end, change=rp.Attach("box", touch=rr1.link_names)))
    assert validate_stages(plan.trajectory, held, stages).valid


def test_margins_are_the_worst_of_all_stages(moved: rp.SequencePlan) -> None:
    margins = moved.report.margins
    parts = []
    for stage, scene in zip(moved.stages, moved.scenes(), strict=True):
        if stage.end > stage.begin:
            parts.append(rp.validate(moved.trajectory.cut(stage.begin, stage.end), scene))
    for name, choose in (("clearance", min), ("self_clearance", min), ("velocity", max), ("acceleration", max)):
        assert margins[name].value == pytest.approx(choose(p.margins[name].value for p in parts if name in p.margins))
    assert margins["clearance_proven"].value == min(p.margins["clearance_proven"].value for p in parts)
    assert moved.report.duration == moved.trajectory.duration


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda stages: stages[1:], "stage 1 .* begins at"),
        (lambda stages: stages[:-1], "the stages end at"),
        (lambda stages: [*stages[:3], *stages[4:]], "stage 4 .* begins at"),
        (lambda stages: [], "at least one stage"),
    ],
)
def test_stages_of_another_motion_are_refused(moved: rp.SequencePlan, change, message: str) -> None:
    with pytest.raises(rp.InputError, match=message):
        validate_stages(moved.trajectory, moved.scene, change(list(moved.stages)))


def test_a_stage_that_makes_no_sense_is_refused() -> None:
    with pytest.raises(rp.InputError, match="before it begins"):
        rp.SequenceStage("back", 1.0, 0.5)
    with pytest.raises(rp.InputError, match="change at an instant"):
        rp.SequenceStage("slow", 0.0, 0.5, change=rp.Detach("block"))
