"""Files of sequences on the command line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import rr1plan as rp
from rr1plan.cli import BAD_INPUT, OK, run


@pytest.fixture(scope="module")
def saved(moved: rp.SequencePlan, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return moved.save(tmp_path_factory.mktemp("sequence") / "moved.json")


def test_a_sequence_is_played(saved: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["play", str(saved), "--json"]) == OK
    said = json.loads(capsys.readouterr().out)
    assert said["carried"] is True
    assert said["objects"]["block"]["final_offset"] < 5e-3


def test_a_sequence_that_is_not_planned_is_named_with_the_command_that_takes_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("s.toml").write_text('scene = "rr1_table"\n[[segments]]\npause = 1.0\n')
    for command in ("view", "validate", "play", "scenes", "cspace"):
        assert run([command, "s.toml"]) == BAD_INPUT
        assert "s.toml holds a sequence, which has no motion yet; to plan and see it: rr1plan plan s.toml" in (
            capsys.readouterr().err
        )
    assert run(["plan", "s.toml", "--planner", "cartesian"]) == BAD_INPUT
    assert "planner 'cartesian' is for straight lines" in capsys.readouterr().err


def test_a_sequence_is_not_played_without_physics(saved: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["play", str(saved), "--mode", "kinematic"]) != OK
    assert "a sequence is replayed with --mode dynamic only" in capsys.readouterr().err


def test_a_sequence_is_validated_stage_by_stage(
    saved: Path, moved: rp.SequencePlan, table: rp.Scene, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["validate", str(saved)]) == OK
    assert "13 stages" in capsys.readouterr().out
    at = moved.object_poses("block", [moved.stages[6].end])[0][:3, 3]
    rp.save_scene(tmp_path / "other.toml", table.with_obstacle("ball", rp.Sphere(0.004), at - [0, 0, 0.032]))
    assert run(["validate", str(saved), "--scene", str(tmp_path / "other.toml")]) == 4
    said = capsys.readouterr().out
    assert "obstacle 'ball' is new" in said
    assert "ball and block overlap" in said


def test_the_table_of_a_sequence_with_a_gripper_is_refused_with_the_file_to_validate(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rp.save_scene(tmp_path / "cell.toml", rp.Scene().with_arm("arm", rp.load_robot("planar2r", joints=["joint1"])))
    table = rp.Trajectory(["arm/joint1", "arm/joint2"], [0.0, 1.0], [[[0.0, 0.0]]])
    file = str(rp.save_csv(tmp_path / "moved.csv", table))
    assert run(["validate", file, "--scene", str(tmp_path / "cell.toml")]) == BAD_INPUT
    assert "a sequence with a gripper is validated from its .json file" in capsys.readouterr().err


def test_a_sequence_is_shown(saved: Path, tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    assert run(["view", str(saved), "--html", str(page)]) == OK
    assert "panel-stages" in page.read_text()


def test_a_sequence_is_not_mirrored(saved: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Its corridor would be that of the first scene, with the block at its place before the grasp."""
    (tmp_path / "none.jsonl").touch()
    assert run(["mirror", str(tmp_path / "none.jsonl"), "--plan", str(saved), "--no-page"]) == BAD_INPUT
    assert "holds a sequence, whose scene changes on the way; only single" in capsys.readouterr().err
