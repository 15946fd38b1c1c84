"""Sequences in files: loaded completely and validated again, in their scene or another."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.sequences.sequence_files import holds_sequence


@pytest.fixture(scope="module")
def saved(moved: rp.SequencePlan, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return moved.save(tmp_path_factory.mktemp("sequence") / "moved.json")


def altered(saved: Path, file: Path, change: object) -> Path:
    """A copy with another content and its hash."""
    document = json.loads(saved.read_text())
    change(document["content"])
    canonical = json.dumps(document["content"], sort_keys=True, separators=(",", ":"))
    document["sha256"] = hashlib.sha256(canonical.encode()).hexdigest()
    # In the order in which files are written.
    file.write_text(json.dumps({key: document[key] for key in ("format", "version", "kind", "sha256", "content")}))
    return file


def test_a_file_that_cannot_be_opened_is_no_sequence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(self: Path, *_: object) -> None:
        raise PermissionError(13, "Permission denied")

    (tmp_path / "a.json").write_text("{}")
    monkeypatch.setattr(Path, "open", refuse)
    assert not holds_sequence(tmp_path / "a.json")


def test_a_sequence_saved_under_a_name_in_capitals_is_recognized(moved: rp.SequencePlan, tmp_path: Path) -> None:
    assert holds_sequence(moved.save(tmp_path / "PICK.JSON"))


def test_a_sequence_is_read_back_exactly(moved: rp.SequencePlan, saved: Path) -> None:
    again = rp.load_sequence(saved)
    assert again
    np.testing.assert_array_equal(again.trajectory.coefficients, moved.trajectory.coefficients)
    np.testing.assert_array_equal(again.trajectory.breaks, moved.trajectory.breaks)
    assert again.stages == moved.stages or [vars(s) | {"change": None} for s in again.stages] == [
        vars(s) | {"change": None} for s in moved.stages
    ]
    assert [(e.label, e.begin) for e in again.events] == [(e.label, e.begin) for e in moved.events]
    assert again.gripper_joints == {"arm": ("finger_joint",)}
    assert again.report.margins == moved.report.margins
    assert again.changes == ()
    times = np.linspace(0.0, moved.trajectory.end_time, 7)
    np.testing.assert_array_equal(again.object_poses("block", times), moved.object_poses("block", times))


def test_it_is_judged_in_another_scene(moved: rp.SequencePlan, saved: Path, table: rp.Scene) -> None:
    same = rp.load_sequence(saved, table)
    assert same
    assert same.changes == ()
    at = moved.object_poses("block", [moved.stages[6].end])[0][:3, 3]
    changed = rp.load_sequence(saved, table.with_obstacle("ball", rp.Sphere(0.004), at - [0, 0, 0.032]))
    assert changed.changes == ("obstacle 'ball' is new",)
    assert not changed.valid
    assert all("ball" in violation.subject for violation in changed.report.violations)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda c: c["sequence"]["stages"].pop(), "the stages end at"),
        (lambda c: c["sequence"]["stages"][4].update(attach=None), "held object|attached object"),
        (lambda c: c["sequence"]["stages"][4].update(detach="block"), "attaches and detaches"),
        (lambda c: c["sequence"]["stages"][4]["attach"].update(obstacle="cup"), "'cup'"),
        (lambda c: c["sequence"]["stages"][5].update(allowed=[["block", "cup"]]), "'cup'"),
        (lambda c: c["sequence"]["stages"][0].update(begin=0.1), "begins at 0.1 s"),
        (lambda c: c["sequence"]["stages"][0].update(speed=1.0), "speed"),
        (lambda c: c["sequence"].update(stages=[]), "stages"),
        (lambda c: c.pop("trajectory"), "trajectory"),
    ],
)
def test_a_file_that_makes_no_sequence_is_refused(saved: Path, tmp_path: Path, change: object, message: str) -> None:
    with pytest.raises(rp.FormatError, match=message):
        rp.load_sequence(altered(saved, tmp_path / "bad.json", change))


def test_an_altered_or_another_file_is_refused(saved: Path, tmp_path: Path, table: rp.Scene) -> None:
    bad = tmp_path / "bad.json"
    bad.write_text(saved.read_text().replace("attach 'block'", "attach 'chest'"))
    with pytest.raises(rp.FormatError, match="was altered"):
        rp.load_sequence(bad)
    plain = tmp_path / "plain.json"
    rp.save_motion(plain, table)
    with pytest.raises(rp.FormatError, match="holds no sequence; read it with load_motion"):
        rp.load_sequence(plain)
    with pytest.raises(rp.FormatError, match="read it with load_sequence"):
        rp.load_motion(saved)
    with pytest.raises(rp.FormatError, match="'block'"):
        rp.load_sequence(saved, table.without_obstacle("block"))
    with pytest.raises(rp.FormatError, match="cannot be a sequence of the scene 'planar2r_path': unknown joint"):
        rp.load_sequence(saved, rp.load_scene("planar2r_path"))


def test_a_plan_that_failed_cannot_be_saved(table: rp.Scene, tmp_path: Path) -> None:
    plan = rp.plan_sequence(rp.Sequence(table, [rp.FreeMotion(rp.PoseGoal("tool", [5, 0, 0]))]), rng=0)
    with pytest.raises(rp.NoPlanError, match="segment 1"):
        plan.save(tmp_path / "none.json")
