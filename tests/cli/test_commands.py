"""The command line: exit codes, JSON, files, and words for every mistake."""

from __future__ import annotations

import gzip
import io
import json
import re
import shutil
import socket
import subprocess
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import yaml

import rr1plan as rp
from rr1plan.cli import BAD_INPUT, INVALID_PLAN, NO_PLAN, OK, run
from rr1plan.export.plan_files import save_trajectory
from rr1plan.playback.viewer import page_capture
from rr1plan.scene.model_library import installed_robot_names, robot_names, scene_names


def answer(capsys: pytest.CaptureFixture[str]) -> dict:
    """The only JSON value on stdout, which may have no other output."""
    return json.loads(capsys.readouterr().out)


def test_plan_writes_what_was_asked_for_and_says_so(capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["plan", "rr1_table", "--output", "m.json", "--csv", "m.csv", "--html", "m.html"]
    assert run(arguments) == OK
    said = capsys.readouterr().out
    assert "certified free" in said
    assert sorted(p.name for p in Path.cwd().iterdir()) == ["m.csv", "m.html", "m.json"]
    for name in ("m.csv", "m.html", "m.json"):
        assert name in said


def test_the_margin_of_a_query_is_kept_with_another_start_and_other_limits(capsys: pytest.CaptureFixture[str]) -> None:
    scene = rp.load_scene("rr1_table")
    problem = rp.Problem(scene, "home", rp.load_problems("rr1_table")["above_parcel"].goal["rr1"]).with_margin(0.004)
    rp.save_scene("cell.toml", scene, problems={"above": problem})
    start = [f"{q:.3f}" for q in problem.start + 0.01]
    for others in ([], ["--start", *start], ["--start", " ".join(start)], ["--limits", "hardware"]):
        assert run(["plan", "cell.toml", "--seed", "0", "--json", *others]) == OK
        assert answer(capsys)["margin"] == 0.004


def test_plan_as_json_is_one_value(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["plan", "rr1_table", "--json", "--planner", "roadmap", "--limits", "hardware"]) == OK
    value = answer(capsys)
    assert value["status"] == "found"
    assert value["planner"] == "roadmap"
    assert value["report"]["certified"]
    assert list(value["seconds"]) == ["imports", "load the scene", "set up", "plan", "shorten", "retime", "validate"]


def test_the_same_seed_and_iterations_give_the_same_motion() -> None:
    limits = ["--seed", "5", "--iterations", "3000", "--seconds", "inf"]
    for name in ("a", "b"):
        assert run(["plan", "rr1_table", *limits, "--output", f"{name}.json", "--quiet"]) == OK
    first, second = (json.loads(Path(f"{n}.json").read_text())["content"] for n in ("a", "b"))
    assert first["path"] == second["path"]
    assert first["trajectory"] == second["trajectory"]


@pytest.mark.parametrize(
    ("question", "said"),
    [
        (["--goal", "home"], "certified"),
        (["--goal", "-0.3", "0.1", "0.2", "0", "0.6", "0"], "certified"),
        (["--goal", "-1e-3", "-1.E-2", "0.2", "-.5e-3", "0.6", "0"], "certified"),
        (["--position", "-0.30", "0.25", "0.20"], "certified"),
        (["--query", "above_parcel"], "certified"),
        (["--start", "raised", "--goal", "home"], "certified"),
    ],
)
def test_questions_may_be_asked_in_many_ways(
    question: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["plan", "rr1_table", *question]) == OK
    assert said in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["plan", "rr1_tabel"], "unknown scene 'rr1_tabel'. Did you mean 'rr1_table'"),
        (["plan", "missing.toml"], "missing.toml: there is no such file"),
        (["plan", "missing.json"], "missing.json: there is no such file"),
        (["cspace", "missing.urdf"], "missing.urdf: there is no such file"),
        (["view", "missing.txt"], "missing.txt: there is no such file"),
        (["view", "folder/missing"], "folder/missing: there is no such file"),
        (["validate", "missing.toml"], "missing.toml: there is no such file"),
        (["plan", "rr1_table", "--query", "abov_parcel"], "Did you mean 'above_parcel'"),
        (["plan", "rr1_table", "--planner", "rrtconnect"], "Did you mean 'rrt_connect'"),
        (["plan", "rr1_table", "--planner", "many_arm"], "Did you mean 'many_arms'"),
        (["plan", "rr1"], "rr1 is a robot, expected a scene: a file with the lines [arms.NAME] and robot = 'rr1'"),
        (["view", "RR1"], "unknown scene or robot 'RR1'. Did you mean 'rr1'"),
        (["plan", "rr1_table", "--retiming", "blends"], "Did you mean 'blend'"),
        (["plan", "rr1_table", "--goal", "hme"], "Did you mean 'home'"),
        (["plan", "rr1_table", "--goal", "1", "2"], "has 2 numbers, expected 6"),
        (["plan", "rr1_table", "--goal", "nan", "0", "0", "0", "0", "0"], "shoulder_joint"),
        (["plan", "rr1_table", "--limits", "hardwear"], "Did you mean 'hardware'"),
        (["plan", "rr1_table", "--frame", "tol", "--position", "0", "0", "1"], "tol"),
        (["plan", "rr1_pair", "--goal", "home"], "2 arms"),
        (["validate", "missing.json"], "no such file"),
        (["play", "missing.json"], "no such file"),
        (["view", "missing.json", "--no-browser"], "no such file"),
        (["plan", "rr1_table", "--html", "a.html", "--view", "tpo"], "Did you mean 'top'"),
        (["view", "rr1_table", "--html", "a.html", "--view", "45", "30"], "expected angles [rad]"),
        (["view", "rr1_table", "--html", "a.html", "--view", "left", "right"], "neither a view's name nor numbers"),
        (["demo", "--view", "1"], "view"),
        (["cspace", "planar2r_path", "--html", "a.html", "--view", "tpo"], "Did you mean 'top'"),
        (["cspace", "planar2r_path", "--html", "a.html", "--view", "45", "30"], "expected angles [rad]"),
        (["robots", "rr2"], "Did you mean 'rr1'"),
        (["scenes", "rr1_shelve"], "Did you mean 'rr1_shelf'"),
        (["scenes", "rr1"], "rr1 is a robot, expected a scene"),
        (["demo", "--scene", "rr1"], "rr1 is a robot, expected a scene"),
        (["validate", "a.json", "--scene", "rr1"], "rr1 is a robot, expected a scene"),
        (["mirror", "a.jsonl", "--scene", "rr1"], "rr1 is a robot, expected a scene"),
        (["lesson", "workspace", "--scene", "rr1", "--html", "a.html"], "rr1 is a robot, expected a scene"),
        (["robots", "rr1_table"], "rr1_table is a scene, expected a robot"),
        (["validate", "nosuch"], "nosuch: there is no such file"),
        (["validate", "rr1_table"], "rr1_table is a scene, expected a motion; to make one: rr1plan plan rr1_table"),
        (["scenes", "."], "scene file '.' is a folder, expected one of .toml"),
        (["robots", "."], "robot file '.' is a folder, expected .urdf"),
        (["cspace", "planar2r_path", "--joints", "joint1", "joint9", "--resolution", "8"], "joint9"),
        (["cspace", "planar2r_path", "--resolution", "3"], "resolution is 3"),
        (["demo", "--output", "/proc/nowhere"], "cannot make the folder"),
        (["demo", "--output", __file__], "test_commands.py is a file, expected a folder or a new name"),
    ],
)
def test_mistakes_are_named_and_exit_with_2(
    arguments: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(arguments) == BAD_INPUT
    said = capsys.readouterr().err
    assert words in said
    assert "Traceback" not in said


def test_mistakes_are_json_when_json_is_asked_for(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["plan", "nowhere", "--json"]) == BAD_INPUT
    value = answer(capsys)
    assert value["exit_code"] == BAD_INPUT
    assert "unknown scene" in value["error"]


def test_no_plan_exits_with_3(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["plan", "planar2r_no_path", "--seconds", "0.5", "--json"]) == NO_PLAN
    assert answer(capsys)["status"] == "timeout"
    assert run(["plan", "rr1_table", "--position", "-3", "0", "0.2"]) == NO_PLAN
    assert "infeasible" in capsys.readouterr().err
    for option, status in (("--goal", "invalid_goal"), ("--start", "invalid_start")):
        assert run(["plan", "rr1_table", option, "9", "0", "0", "0", "0", "0"]) == NO_PLAN
        assert f"no plan (rrt_connect, {status})" in capsys.readouterr().err


def test_plan_keeps_the_margin_that_is_given(monkeypatch: pytest.MonkeyPatch) -> None:
    from rr1plan.cli import plan

    margins = []

    def planned(problem: rp.Problem, margin: float | None = None, **how: object) -> rp.MotionPlan:
        margins.append(margin)
        return rp.plan_motion(problem, margin=margin, **how)

    monkeypatch.setattr(plan, "plan_motion", planned)
    assert run(["plan", "rr1_table", "--quiet"]) == OK
    assert run(["plan", "rr1_table", "--quiet", "--margin", "0.004"]) == OK
    assert margins == [None, 0.004]


def test_a_motion_in_place_of_a_scene_is_named_with_the_commands_that_take_it(
    motion: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copy(motion, "m.json")
    Path("r.jsonl").touch()
    Path("notes.txt").touch()
    for command in ("plan", "cspace", "scenes"):
        assert run([command, "m.json"]) == BAD_INPUT
        assert "m.json holds a motion, expected a scene; to see it: rr1plan view m.json" in capsys.readouterr().err
        assert run([command, "r.jsonl"]) == BAD_INPUT
        assert "r.jsonl is a recording, expected a scene; to see it: rr1plan mirror" in capsys.readouterr().err
        assert run([command, "notes.txt"]) == BAD_INPUT
        assert "scene file 'notes.txt' has the suffix '.txt', expected one of .toml" in capsys.readouterr().err


def test_files_of_another_kind_are_named_for_what_they_are(capsys: pytest.CaptureFixture[str]) -> None:
    contents = {"arm.urdf": "<robot/>", "cell.toml": "[arms]", "empty.json": "", "other.json": '{"a": 1}'}
    for name, content in contents.items():
        Path(name).write_text(content)
    for arguments, said in (
        (["cspace", "arm.urdf"], "arm.urdf is a robot, expected a scene"),
        (["play", "cell.toml"], "cell.toml is a scene, expected a motion; to make one: rr1plan plan cell.toml"),
        (["plan", "empty.json"], "empty.json: is not JSON, or was cut off: it is empty"),
        (["validate", "empty.json"], "empty.json: is not JSON, or was cut off: it is empty"),
        (["plan", "other.json"], "other.json is JSON without a motion, expected a scene"),
    ):
        assert run(arguments) == BAD_INPUT
        assert said in capsys.readouterr().err


def test_a_moment_after_the_end_of_a_motion_is_refused(
    motion: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(page_capture, "require_browser", lambda: "not used")
    for time in ("99", "-1"):
        assert run(["view", str(motion), "--png", "a.png", "--time", time]) == BAD_INPUT
        assert f"--time is {time} s, expected 0 to " in capsys.readouterr().err
    assert not list(Path.cwd().iterdir())


def test_a_missing_browser_is_reported_before_any_file_is_written(
    motion: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "playwright.sync_api", None)
    for command in (
        ["view", str(motion), "--html", "a.html", "--png", "a.png"],
        ["view", str(motion), "--html", "a.html", "--video", "a.gif"],
        ["play", str(motion), "--html", "a.html", "--video", "a.gif"],
        ["cspace", "planar2r_path", "--html", "a.html", "--video", "a.gif"],
        ["lesson", "kinematics", "--html", "a.html", "--video", "a.gif"],
    ):
        assert run(command) != OK
        assert "needs the package 'playwright'" in capsys.readouterr().err
    assert not list(Path.cwd().iterdir())


def test_a_scene_without_a_name_is_not_named(
    planar2r: rp.Robot, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    problem = rp.Problem(rp.Scene().with_arm("arm", planar2r), [0.0, 0.0], [1.0, 0.5])
    file = rp.plan_motion(problem, rng=0).save(tmp_path / "motion.json")
    assert run(["validate", str(file)]) == OK
    assert "in the scene: " in capsys.readouterr().out


def test_validate_accepts_a_good_motion_and_refuses_it_elsewhere(
    motion: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["validate", str(motion)]) == OK
    assert "certified free" in capsys.readouterr().out
    assert run(["validate", str(motion), "--scene", "rr1_cage"]) == INVALID_PLAN
    said = capsys.readouterr().out
    assert "in the scene rr1_cage" in said
    assert "the scene differs from the one that the motion was made in:" in said
    assert "obstacle 'crate' is gone" in said
    assert "INVALID" in said
    assert run(["validate", str(motion), "--scene", "planar2r_path"]) == BAD_INPUT
    assert "'rr1/shoulder_joint'" in capsys.readouterr().err


def test_does_my_saved_plan_survive_the_changed_cell(motion: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene = rp.load_scene("rr1_table")
    rp.save_scene("same.toml", scene)
    rp.save_scene("moved.toml", scene.with_obstacle("crate", rp.Box((0.01, 0.01, 0.01)), (0, 0, 3)))
    assert run(["validate", str(motion), "--scene", "same.toml", "--json"]) == OK
    assert answer(capsys)["changes"] == []
    assert run(["validate", str(motion), "--scene", "moved.toml", "--json"]) == OK
    value = answer(capsys)
    assert value["scene"] == "rr1_table"
    assert [change.split()[0:2] for change in value["changes"]] == [["obstacle", "'crate'"]] * len(value["changes"])
    assert run(["play", str(motion), "--scene", "moved.toml", "--json"]) == OK
    assert answer(capsys)["changes"] == value["changes"]
    assert run(["view", str(motion), "--scene", "moved.toml", "--html", "moved.html"]) == OK
    assert "obstacle 'crate'" in capsys.readouterr().out


def test_motions_of_every_kind_are_validated_viewed_and_replayed(
    motion: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    saved = rp.load_motion(motion)
    save_trajectory("t.json", saved.trajectory, saved.scene)
    rp.save_csv("t.csv", saved.trajectory)
    times, q = saved.trajectory.sample(0.1)
    points = [{"positions": row.tolist(), "time_from_start": float(t)} for t, row in zip(times, q, strict=True)]
    names = [name.split("/")[1] for name in saved.trajectory.joint_names]
    Path("t.yaml").write_text(yaml.safe_dump({"joint_names": names, "points": points}))
    for name in ("t.json", "t.csv", "t.yaml"):
        Path(f"{name}.gz").write_bytes(gzip.compress(Path(name).read_bytes()))
    for name, verdict, pieces in (
        ("t.json", OK, "quadratic"),
        ("t.csv", OK, "cubic"),
        ("t.yaml", INVALID_PLAN, "linear"),
        ("t.json.gz", OK, "quadratic"),
        ("t.csv.gz", OK, "cubic"),
        ("t.yaml.gz", INVALID_PLAN, "linear"),
    ):
        holds_its_scene = name.startswith("t.json")
        assert run(["validate", name]) == (verdict if holds_its_scene else BAD_INPUT)
        assert ("--scene" in capsys.readouterr().err) != holds_its_scene
        assert run(["validate", name, "--scene", "rr1_table"]) == verdict
        assert f"{pieces} piece" in capsys.readouterr().out
        assert run(["play", name, "--scene", "rr1_table", "--mode", "kinematic"]) == OK
        assert run(["view", name, "--scene", "rr1_table", "--html", "page.html"]) == OK
    rp.save_scene("more.toml", saved.scene.with_obstacle("late", rp.Sphere(0.01), (0, 0, 3)))
    assert run(["validate", "t.json", "--scene", "more.toml"]) == OK
    assert "obstacle 'late' is new" in capsys.readouterr().out
    assert run(["view", "rr1_table", "--scene", "rr1_table", "--html", "page.html"]) == BAD_INPUT
    assert "rr1_table is not a motion file" in capsys.readouterr().err


def test_a_minus_writes_a_motion_that_is_whole_to_standard_output(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["plan", "rr1_table", "--output", "-", "--csv", "t.csv"]) == OK
    written = capsys.readouterr()
    assert "certified free" in written.err
    Path("m.json").write_text(written.out)
    assert run(["validate", "m.json", "--quiet"]) == OK
    assert run(["plan", "rr1_table", "--csv", "-", "--quiet"]) == OK
    Path("again.csv").write_text(capsys.readouterr().out)
    assert Path("again.csv").read_text() == Path("t.csv").read_text()
    assert sorted(p.name for p in Path.cwd().iterdir()) == ["again.csv", "m.json", "t.csv"]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--output", "-", "--csv", "-"], "are the same file '-'"),
        (["--output", "-", "--json"], "standard output"),
        (["--html", "-"], "--html: '-' is standard output, expected a name"),
        (["--embed", "--output", "-"], "--embed has no effect with --output -"),
        (["--embed"], "--embed has no effect without --output"),
    ],
)
def test_standard_output_takes_one_thing(options: list[str], words: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["plan", "rr1_table", *options]) == BAD_INPUT
    written = capsys.readouterr()
    assert words in written.out + written.err
    assert not list(Path.cwd().iterdir())


def test_a_minus_reads_a_motion_from_standard_input(
    motion: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def given(content: str, *words: str) -> int:
        monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(content.encode())))
        return run(words)

    saved = rp.load_motion(motion)
    table = rp.save_csv("m.csv", saved.trajectory).read_text()
    message = rp.save_joint_trajectory("m.yaml", saved.trajectory).read_text()
    assert given(motion.read_text(), "validate", "-") == OK
    assert given(motion.read_text(), "view", "-", "--html", "page.html") == OK
    assert given(table, "validate", "-", "--scene", "rr1_table") == OK
    assert given(message, "play", "-", "--mode", "kinematic", "--scene", "rr1_table") == OK
    capsys.readouterr()
    for content, words in (
        ("", "is empty, expected a motion"),
        ("{", "standard input:1: is not JSON"),
        (table, "standard input holds a motion without its scene"),
    ):
        assert given(content, "validate", "-") == BAD_INPUT
        assert words in capsys.readouterr().err
    monkeypatch.setattr("sys.stdin", None)
    assert run(["validate", "-"]) == BAD_INPUT
    assert "cannot read standard input: it is closed" in capsys.readouterr().err


def test_a_margin_that_is_not_kept_is_said(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["plan", "rr1_table", "--goal", "zero", "--margin", "0.05"]) == OK
    assert re.search(r"^margin: \S+ mm kept, not 50 mm, because", capsys.readouterr().out, re.MULTILINE)
    assert run(["plan", "rr1_table", "--goal", "zero", "--margin", "0.001"]) == OK
    assert "margin: " not in capsys.readouterr().out


def test_a_motion_that_is_too_fast_is_invalid_and_exits_with_4(
    motion: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    saved = rp.load_motion(motion)
    rp.save_motion(
        "fast.json",
        saved.scene,
        path=saved.path,
        trajectory=saved.trajectory.stretched(0.3),
        report=None,
        problem=saved.problem,
    )
    assert run(["validate", "fast.json", "--json"]) == INVALID_PLAN
    kinds = {violation["kind"] for violation in answer(capsys)["violations"]}
    assert "acceleration" in kinds


def test_an_altered_file_is_refused_by_name(motion: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = motion.read_text()
    Path("altered.json").write_text(text.replace('"coefficients":', '"coefficient":', 1))
    Path("cut.json").write_text(text[: len(text) // 2])
    for name in ("altered.json", "cut.json"):
        for command in ("validate", "play"):
            assert run([command, name]) == BAD_INPUT
            assert name in capsys.readouterr().err


def test_play_reports_tracking_and_contacts(motion: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["play", str(motion), "--json"]) == OK
    value = answer(capsys)
    assert value["contacts"] == []
    assert 0.0 < max(j["max_error"] for j in value["joints"].values()) < 5e-3
    assert run(["play", str(motion), "--mode", "kinematic", "--html", "both.html", "--side-by-side"]) == OK
    assert "contacts: none" in capsys.readouterr().out
    page = Path("both.html").read_text()
    assert '"sideBySide":true' in page
    assert '"replay":{"columns"' in page


def test_a_replay_that_does_not_follow_its_motion_is_no_success(
    motion: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert run(["play", str(motion), "--timestep", "0.5"]) == INVALID_PLAN
    assert "the motion was not followed" in capsys.readouterr().out
    assert run(["play", str(motion), "--timestep", "0.5", "--json"]) == INVALID_PLAN
    assert answer(capsys)["tracked"] is False
    monkeypatch.setattr(rp, "simulate", partial(rp.simulate, dt=0.5))
    assert run(["demo", "--output", "out"]) == INVALID_PLAN
    assert "the motion was not followed" in capsys.readouterr().out


def test_demo_goes_the_whole_way(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["demo", "--output", "out"]) == OK
    said = capsys.readouterr().out
    for words in ("certified free", "tracking error", "contacts: none", "how long each step took", "motion.html"):
        assert words in said
    names = sorted(p.name for p in Path("out").iterdir())
    assert names == ["motion.html", "motion.json", "trajectory.csv", "trajectory.json"]
    assert run(["validate", "out/motion.json"]) == OK


def test_view_writes_an_offline_page_of_a_scene_or_a_motion(motion: Path) -> None:
    assert run(["view", "rr1_shelf", "--html", "scene.html"]) == OK
    assert run(["view", str(motion), "--html", "motion.html"]) == OK
    assert run(["view", "rr1", "--html", "robot.html"]) == OK
    assert "hand_link" in Path("robot.html").read_text()
    Path("arm.urdf").write_text(Path(rp.load_robot("planar2r").source).read_text())
    assert run(["view", "arm.urdf", "--html", "arm.html"]) == OK
    assert "http://" not in Path("scene.html").read_text()[:2000]
    assert Path("motion.html").stat().st_size > 100_000


@pytest.mark.parametrize(
    ("command", "page"),
    [
        (["view", "rr1_shelf", "--html", "page.html"], "page.html"),
        (["plan", "rr1_table", "--html", "page.html"], "page.html"),
        (["demo", "--output", "out"], "out/motion.html"),
        (["cspace", "planar2r_path", "--resolution", "16", "--html", "page.html"], "page.html"),
    ],
)
def test_pages_are_looked_at_from_the_view_that_is_given(command: list[str], page: str) -> None:
    for words, direction in (
        (["left"], "[-1.0,0.0,0.0]"),
        (["-1.5", "0.0"], "[0.07"),
        (["0", "-1", "2"], "[0.0,-1.0,2.0]"),
    ):
        assert run([*command, "--view", *words]) == OK
        assert f'"live":null,"view":{direction}' in Path(page).read_text()


def test_spheres_are_put_on_pages_when_asked_for(motion: Path) -> None:
    assert run(["view", "rr1_shelf", "--html", "scene.html", "--spheres"]) == OK
    assert run(["view", str(motion), "--html", "motion.html", "--spheres"]) == OK
    assert run(["plan", "rr1_table", "--html", "plan.html", "--spheres"]) == OK
    assert run(["plan", "rr1_table", "--html", "plain.html"]) == OK
    for name in ("scene", "motion", "plan"):
        assert '"spheres":{"links"' in Path(f"{name}.html").read_text()
    assert '"spheres":null' in Path("plain.html").read_text()


def test_another_motion_is_compared_on_the_page(motion: Path, capsys: pytest.CaptureFixture[str]) -> None:
    other = Path(shutil.copy(motion, "other.json"))
    assert run(["view", str(motion), "--html", "page.html", "--compare", str(other)]) == OK
    page = Path("page.html").read_text()
    assert '"compare":[{"name":"other","columns":[0,' in page
    assert '"sideBySide":false' in page
    assert run(["view", str(motion), "--html", "page.html", "--compare", str(other), "--side-by-side"]) == OK
    assert '"sideBySide":true' in Path("page.html").read_text()
    # Samples have no scene of their own.
    samples = rp.save_csv(other.with_suffix(".csv"), rp.load_motion(other).trajectory)
    assert run(["view", str(motion), "--html", "page.html", "--compare", str(samples)]) == OK
    assert run(["view", "rr1_shelf", "--html", "page.html", "--compare", str(other)]) != OK
    assert "--compare takes a motion beside another motion" in capsys.readouterr().err


def test_cspace_reports_a_robot_once(capsys: pytest.CaptureFixture[str]) -> None:
    link = '<link name="{}"><collision><geometry><box size="0.3 0.02 0.02"/></geometry></collision></link>'
    joint = (
        '<joint name="{1}" type="revolute"><parent link="{0}"/><child link="{1}"/><origin xyz="0 0 0.1"/>'
        '<axis xyz="0 0 1"/><limit lower="-1" upper="1" velocity="1" effort="1"/></joint>'
    )
    parts = [*map(link.format, "abc"), *map(joint.format, "ab", "bc")]
    Path("arm.urdf").write_text(f'<robot name="two">{"".join(parts)}</robot>')
    Path("cell.toml").write_text('[arms.arm]\nrobot = "arm.urdf"\n')
    assert run(["cspace", "cell.toml", "--resolution", "8", "--svg", "a.svg"]) == OK
    assert capsys.readouterr().err.count("links without a mass") == 1


def test_cspace_draws_and_proves(capsys: pytest.CaptureFixture[str]) -> None:
    assert (
        run(["cspace", "planar2r_no_path", "--resolution", "120", "--svg", "a.svg", "--html", "a.html", "--json"]) == OK
    )
    said = answer(capsys)
    assert said["proves_no_path"] is True
    assert said["verdict"].startswith("No path exists")
    assert said["files"] == {"svg": "a.svg", "page": "a.html"}
    # The planner is stopped early, as no path exists: a tree that a slide can hold.
    assert 1000 < Path("a.svg").stat().st_size < 1_500_000
    assert run(["cspace", "planar2r_path", "--resolution", "60"]) == OK
    said = capsys.readouterr().out
    assert "planar2r_path-cspace.png" in said
    assert "Start and goal lie in the same component" in said


def test_cspace_takes_the_format_from_the_name(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["cspace", "planar2r_path", "--png", "a.jpg"]) == BAD_INPUT
    assert "--png: 'a.jpg' does not end in .png" in capsys.readouterr().err
    assert run(["cspace", "planar2r_path", "--resolution", "24", "--pdf", "a.PDF"]) == OK
    assert Path("a.PDF").read_bytes().startswith(b"%PDF")
    assert list(Path().glob("*")) == [Path("a.PDF")]


def test_cspace_draws_a_slice_of_a_bigger_arm(capsys: pytest.CaptureFixture[str]) -> None:
    joints = ["--joints", "shoulder_joint", "elbow_joint"]
    assert run(["cspace", "rr1_table", *joints, "--resolution", "16"]) == OK
    said = capsys.readouterr().out
    assert "configuration space of shoulder_joint and elbow_joint: 16 x 16 cells" in said
    assert "a slice, at upper_arm_joint = 0, forearm_joint = 0, wrist_joint = 0.5, hand_joint = 0" in said
    for at, values in (["zero"], ("0", "0")), (["0", "0", "0", "-.1", "3e-1", "0"], ("-0.1", "0.3")):
        assert run(["cspace", "rr1_table", *joints, "--at", *at, "--resolution", "16"]) == OK
        forearm, wrist = values
        assert f"forearm_joint = {forearm}, wrist_joint = {wrist}, hand_joint = 0" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (
            ["planar2r_path", "--resolution", "100000"],
            "resolution is 100000, expected a whole number from 8 to 2000",
        ),
        (["planar2r_path", "--at", "zero"], "--at has no effect: arm 'arm' has no joints but joint1 and joint2"),
        (["rr1_table", "--at", "0", "0"], "--at has 2 numbers, expected 6"),
        (["rr1_table", "--at", "0", "wrist"], "'0 wrist' is neither a configuration's name nor numbers"),
        (["planar2r_path", "--seconds", "0"], "'0' is not a number above zero"),
        (["rr1_table", "--query", "above_parcel"], "the problem moves 6 joints of 1 arm, expected two"),
        (["rr1_table", "--seconds", "3"], "--seconds has no effect: there is no query of two joints"),
        (["rr1_table", "--planner", "prm"], "--planner has no effect"),
        (["planar2r_path", "--joints", "joint2", "joint1", "--query", "elbow_flip"], "the problem's columns are"),
    ],
)
def test_cspace_refuses_at_once_what_it_cannot_draw(
    arguments: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["cspace", *arguments]) == BAD_INPUT
    assert said in capsys.readouterr().err
    assert list(Path().glob("*")) == []


def test_robots_scenes_and_doctor_list_what_there_is(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["robots", "--json"]) == OK
    robots = answer(capsys)
    assert [robot["name"] for robot in robots if "joints" in robot] == list(robot_names())
    assert [robot["name"] for robot in robots if "joints" not in robot] == list(installed_robot_names())
    assert run(["scenes", "--json"]) == OK
    assert [scene["name"] for scene in answer(capsys)] == list(scene_names())
    assert run(["doctor", "--json"]) == OK
    assert answer(capsys)["missing"] == []
    assert run(["robots", "rr1"]) == OK
    said = capsys.readouterr().out
    assert "shoulder_joint" in said
    assert "units: rad, s and Nm" in said
    assert "assumed" not in said
    Path("arm.urdf").write_text(Path(rp.load_robot("planar2r").source).read_text())
    assert run(["robots", "arm.urdf"]) == OK
    assert "acceleration and jerk are assumed: the robot's file has no such limits" in capsys.readouterr().out
    assert run(["scenes", "rr1_table"]) == OK
    assert "reach_over_crate" in capsys.readouterr().out
    Path("cell.toml").write_text("[obstacles.ball]\nsphere = 0.1\n")
    assert run(["scenes", "cell.toml"]) == OK
    assert capsys.readouterr().out.startswith("cell\narms: -\nobstacles: ball\n")


def test_lessons_are_listed_and_written(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["lesson", "--json"]) == OK
    assert [row["name"] for row in answer(capsys)] == list(rp.lesson_names())
    assert run(["lesson", "workspace", "--html", "a.html", "--figure", "a.svg", "--json"]) == OK
    assert answer(capsys)["files"] == {"page": "a.html", "figure": "a.svg"}
    assert Path("a.html").stat().st_size > 100_000
    assert Path("a.svg").read_text().rstrip().endswith("</svg>")
    own = ["--scene", "planar2r_no_path", "--query", "no_way"]
    assert run(["lesson", "no_path", *own, "--figure", "b.png"]) == OK
    assert Path("b.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["wrkspace"], "Did you mean 'workspace'"),
        (["workspace", "--query", "no_way"], "--query has no effect without --scene"),
        (["workspace", "--html", "a.html", "--port", "80"], "--port has no effect with --html"),
        (["workspace", "--figure", "a.gif"], "does not end in .png or .svg or .pdf"),
        (["workspace", "--scene", "rr1_table", "--figure", "a.png"], "needs an arm of two joints"),
        (["no_path", "--scene", "planar2r_no_path", "--figure", "a.png"], "(on the command line: --query)"),
    ],
)
def test_a_lesson_refuses_what_it_cannot_be_about(
    arguments: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["lesson", *arguments]) == BAD_INPUT
    assert said in capsys.readouterr().err
    assert list(Path().glob("*")) == []


def test_an_optional_package_names_its_extra(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from rr1plan.cli import info

    monkeypatch.setattr(info, "_OPTIONAL", {"no-such-package": "ros"})
    assert run(["doctor"]) == OK
    assert "rr1plan[ros]" in capsys.readouterr().out


def test_a_missing_package_is_named(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    from rr1plan.cli import info

    monkeypatch.setattr(info, "_REQUIRED", ("numpy", "no-such-package"))
    assert run(["doctor"]) == BAD_INPUT
    assert "no-such-package" in capsys.readouterr().err


BARE = """<robot name="bare"><link name="a"/><link name="b"/><joint name="j" type="revolute">
<parent link="a"/><child link="b"/><limit lower="-1" upper="1" velocity="1"/></joint></robot>"""


def test_warnings_of_the_library_are_said_on_stderr_but_not_when_quiet(capsys: pytest.CaptureFixture[str]) -> None:
    Path("bare.urdf").write_text(BARE)
    assert run(["robots", "bare.urdf"]) == OK
    assert "rr1plan: bare: no link has a <collision>" in capsys.readouterr().err
    assert run(["robots", "bare.urdf", "--quiet"]) == OK
    assert capsys.readouterr().err == ""


def test_a_robot_with_other_options_in_a_scene_repeats_no_warning(capsys: pytest.CaptureFixture[str]) -> None:
    Path("bare.urdf").write_text(BARE)
    arms = '[arms.left]\nrobot = "bare.urdf"\n[arms.right]\nrobot = "bare.urdf"\ntool = "b"\n'
    Path("two.toml").write_text(arms)
    assert run(["view", "two.toml", "--html", "two.html"]) == OK
    assert capsys.readouterr().err.count("bare: no link has a <collision>") == 1


def test_warnings_are_seen_in_a_program_that_sets_up_no_logging() -> None:
    Path("bare.urdf").write_text(BARE)
    program = "import rr1plan; rr1plan.load_robot('bare.urdf')"
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=True)
    assert "no link has a <collision>" in ended.stderr


def test_plan_reads_a_scene_once(monkeypatch: pytest.MonkeyPatch) -> None:
    from rr1plan.scene import model_library

    loaded = []
    read = model_library.read_scene
    monkeypatch.setattr(model_library, "read_scene", lambda *arguments: loaded.append(arguments) or read(*arguments))
    assert run(["plan", "rr1_table", "--quiet"]) == OK
    assert len(loaded) == 1
    assert run(["scenes", "rr1_table", "--quiet"]) == OK
    assert len(loaded) == 2


def test_a_stream_is_mirrored_beside_its_plan(motion: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    saved = rp.load_motion(motion)
    plan = saved.trajectory
    times = plan.sample_times(0.02)
    with rp.Mirror(saved.scene, plan, record=tmp_path / "good.jsonl") as mirror:
        mirror.run(rp.StateMessage(t, plan.joint_names, plan(t), t) for t in times)
    with rp.Mirror(saved.scene, record=tmp_path / "off.jsonl") as mirror:
        mirror.run(rp.StateMessage(t, plan.joint_names, plan(t) + 0.3, t) for t in times)
    good, off = (str(tmp_path / name) for name in ("good.jsonl", "off.jsonl"))
    assert run(["mirror", good, "--plan", str(motion), "--no-page"]) == OK
    assert "always inside the certified corridor" in capsys.readouterr().out
    assert run(["mirror", off, "--plan", str(motion), "--no-page", "--json"]) == INVALID_PLAN
    said = json.loads(capsys.readouterr().out)
    assert said["messages"] == len(times)
    assert said["outside"]
    again = tmp_path / "again.jsonl"
    assert run(["mirror", good, "--scene", "rr1_table", "--no-page", "--record", str(again), "--quiet"]) == OK
    # Without a plan, contacts alone are judged.
    capsys.readouterr()
    assert run(["mirror", off, "--scene", "rr1_table", "--no-page"]) == INVALID_PLAN
    assert "touch in" in capsys.readouterr().out
    assert len(again.read_text().splitlines()) == len(times)
    capsys.readouterr()
    for arguments, words in {
        (good,): "use --plan or --scene",
        ("serial:/dev/null", "--scene", "rr1_table"): "use --calibration",
        ("run.jsonl", "--scene", "rr1_table", "--calibration", "arm.toml"): "--calibration has no effect: run.jsonl is",
        ("serial:/dev/null", "--scene", "rr1_table", "--calibration", "arm.toml", "--topic", "a"): "--topic has no",
        (str(tmp_path / "none.jsonl"), "--scene", "rr1_table"): "there is no such file",
        (good, "--scene", "rr1_table", "--no-page", "--port", "7000"): "--port",
    }.items():
        assert run(["mirror", *arguments]) == BAD_INPUT
        assert words in capsys.readouterr().err


def test_the_topic_of_a_mirror_is_that_of_its_source(
    motion: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = str(rp.save_rosbag(tmp_path / "bag", rp.load_motion(motion).trajectory))
    assert run(["mirror", bag, "--topic", "/joint_states", "--plan", str(motion), "--no-page"]) == OK
    assert "always inside the certified corridor" in capsys.readouterr().out


def test_messages_sent_before_a_mirror_is_ready_do_not_wait_for_it(
    motion: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.bind(("127.0.0.1", 0))
        host, port = sender.getsockname()
    plan = rp.load_motion(motion).trajectory
    message = {"time": 0.0, "name": plan.joint_names, "position": plan(0.0).tolist()}

    class SlowMirror(rp.Mirror):
        def __init__(self, *args: Any, **options: Any) -> None:
            super().__init__(*args, **options)
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
                sender.sendto(json.dumps(message).encode(), (host, port))

    monkeypatch.setattr(rp, "Mirror", SlowMirror)
    source = [f"udp://{host}:{port}", "--silence", "0.1", "--duration", "0.05"]
    assert run(["mirror", *source, "--plan", str(motion), "--no-page", "--json"]) == INVALID_PLAN
    assert json.loads(capsys.readouterr().out)["messages"] == 0


def test_a_mirror_whose_stream_fails_reports_what_came_before(
    motion: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    plan = rp.load_motion(motion).trajectory

    def unplugged() -> Iterator[rp.StateMessage]:
        yield rp.StateMessage(0.0, plan.joint_names, plan(0.0))
        raise rp.SerialLineError("the serial line failed")

    stream = rp.StateStream(unplugged(), lambda: None)
    monkeypatch.setattr(rp, "read_states", lambda *_, **__: stream)
    assert run(["mirror", "run.jsonl", "--plan", str(motion), "--no-page"]) == BAD_INPUT
    said = capsys.readouterr()
    assert "1 message" in said.out
    assert "the serial line failed" in said.err


def test_a_model_alone_needs_no_page(motion: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(rp.MotionPlan, "save_html")
    assert run(["view", str(motion), "--glb", "motion.glb", "--quiet"]) == OK
    assert Path("motion.glb").read_bytes().startswith(b"glTF")


def test_view_and_play_write_models_and_videos(motion: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["view", str(motion), "--glb", "motion.glb", "--html", "motion.html", "--json"]) == OK
    assert json.loads(capsys.readouterr().out) == {"files": {"page": "motion.html", "3-D model": "motion.glb"}}
    assert Path("motion.glb").read_bytes().startswith(b"glTF")
    for words, said in (
        (["view", str(motion), "--glb", "motion.gltf"], ".glb"),
        (["view", str(motion), "--time", "1"], "--time has no effect without --png"),
        (["view", str(motion), "--png", "a.png", "--fps", "10"], "--fps has no effect without --video"),
        (["view", str(motion), "--video", "a.mp4", "--port", "7000"], "--port has no effect with --video"),
        (["view", str(motion), "--video", "a.avi"], ".mp4 or .gif or .webp"),
        (["play", str(motion), "--size", "640", "400"], "--size has no effect without --video"),
        (["play", str(motion), "--side-by-side"], "--side-by-side has no effect without --html or --video"),
        (["view", str(motion), "--side-by-side"], "--side-by-side has no effect without --compare"),
        (["cspace", "planar2r_path", "--fps", "10"], "--fps has no effect without --video"),
        (["cspace", "planar2r_path", "--video", "nowhere/a.gif"], "cannot write"),
        (["lesson", "planning", "--step", "2"], "--step has no effect without --video"),
        (["lesson", "planning", "--video", "a.gif", "--port", "7000"], "--port has no effect with --video"),
        (["play", str(motion), "--video", "nowhere/a.gif"], "cannot write"),
        (["play", str(motion), "--timestep", "5"], "--timestep is 5 s, expected at most 1 s"),
    ):
        assert run(words) == BAD_INPUT
        assert said in capsys.readouterr().err
