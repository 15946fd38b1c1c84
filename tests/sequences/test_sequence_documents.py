"""Pages of sequences: held objects move with the hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from packed_arrays import unpacked

import rr1plan as rp
from rr1plan.sequences import stage_planners
from rr1plan.sequences.sequence_page import page_parts
from rr1plan.sequences.stages import StagedMotion


def staged(plan: rp.SequencePlan) -> StagedMotion:
    return StagedMotion(plan.scene, plan.trajectory, plan.stages, plan.report)


def test_the_page_moves_the_block_with_the_hand(moved: rp.SequencePlan) -> None:
    document, options = page_parts(staged(moved), None, None)
    assert [thing["name"] for thing in document["obstacles"]] == ["table"]
    assert document["attachments"] == []
    (block,) = document["bodies"]["objects"]
    assert block["name"] == "block"
    times, poses = unpacked(document["bodies"]["times"]), unpacked(document["bodies"]["poses"])
    assert poses.shape == (len(times), 1, 7)
    assert np.diff(times).max() < 0.02
    planned = moved.object_poses("block", times)
    np.testing.assert_allclose(poses[:, 0, :3], planned[:, :3, 3], atol=1e-6)
    assert np.ptp(poses[:, 0, :3], axis=0).max() > 0.1
    assert options.panels[0].name == "stages"
    assert [row["label"] for row in options.panels[0].data] == [stage.label for stage in moved.stages]
    assert document["samples"]["torque"]["remark"] == "without the mass of block"


def test_with_a_replay_the_block_is_where_the_simulation_had_it(moved: rp.SequencePlan, tmp_path: Path) -> None:
    replay = rp.simulate_sequence(moved, hold=0.0)
    document, _ = page_parts(staged(moved), replay, None)
    assert document["replay"] is not None
    poses = unpacked(document["bodies"]["poses"])
    np.testing.assert_allclose(poses[:, 0, :3], replay.objects["block"].poses[:, :3, 3], atol=1e-6)
    page = moved.save_html(tmp_path / "page.html", replay=replay, options=rp.ViewOptions(title="A block"))
    assert "A block" in page.read_text()


def test_a_sequence_without_objects_has_a_page_too(table: rp.Scene, tmp_path: Path) -> None:
    plan = rp.plan_sequence(rp.Sequence(table, [rp.FreeMotion("raised")]), rng=0)
    document, _ = page_parts(staged(plan), None, None)
    assert {thing["name"] for thing in document["obstacles"]} == {"table", "block"}
    assert document["samples"]["torque"]["remark"] == ""
    assert plan.save_html(tmp_path / "page.html").stat().st_size > 100_000


def test_a_gripper_command_that_changes_nothing_has_a_page(rr1: rp.Robot, table: rp.Scene) -> None:
    closed = rr1.locked_joints["finger_joint"]
    plan = rp.plan_sequence(rp.Sequence(table, [rp.MoveGripper(closed), rp.Pause(0.1)]), rng=0)
    assert plan.page_content()[0]["planner"]["stages"]
    pair = rp.Scene().with_arm("left", rr1).with_arm("right", rr1, [0.0, 1.5, 0.0])
    segments = [rp.MoveGripper(closed, arm="left"), rp.FreeMotion("raised", arm="right")]
    plan = rp.plan_sequence(rp.Sequence(pair, segments), rng=0)
    assert plan, plan
    planner = plan.page_content()[0]["planner"]
    assert "missing" not in planner["planners"][planner["stages"][0]["planner"]]


def test_an_object_that_is_held_at_first_is_drawn_once(table: rp.Scene) -> None:
    held = table.with_obstacle_at("block", table.link_poses()["arm/tool"]).attach(
        "block", touch=("finger_link", "opposite_finger_link", "hand_link")
    )
    plan = rp.plan_sequence(rp.Sequence(held, [rp.Pause(0.1), rp.Detach("block")]), rng=0)
    document, _ = page_parts(staged(plan), None, None)
    assert [body["name"] for body in document["bodies"]["objects"]] == ["block"]
    assert "block" not in {thing["name"] for kind in ("obstacles", "attachments") for thing in document[kind]}


def test_a_live_page_is_served(moved: rp.SequencePlan) -> None:
    with moved.show(options=rp.ViewOptions(quiet=True)) as viewer:
        assert viewer.url.startswith("http://")
    with pytest.raises(rp.InputError, match="replay"):
        moved.show(replay="none", options=rp.ViewOptions(quiet=True))


def test_planners_that_take_much_room_are_left_out(moved: rp.SequencePlan, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stage_planners, "_MOST_BYTES", 100_000)
    planners = page_parts(staged(moved), None, None)[0]["planner"]["planners"]
    reasons = [planner.get("missing", "") for planner in planners]
    assert reasons[0] == ""
    assert "the tables of the stages have more than 0.1 MB" in reasons
    without = page_parts(staged(moved), None, rp.ViewOptions(planner=False))[0]
    assert without["planner"] is None
