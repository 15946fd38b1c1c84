"""`plan` of scenes with many arms: its output, figures and exit codes."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

import rr1plan as rp
from rr1plan.cli import BAD_INPUT, NO_PLAN, OK, run


@pytest.fixture
def grid(rr1: rp.Robot) -> rp.Problem:
    return rp.random_grid(rr1, 6, 0.8, rng=1)


@pytest.fixture
def cell(tmp_path: Path, grid: rp.Problem) -> Path:
    return rp.save_scene(tmp_path / "grid.toml", grid.scene, problems={"all": grid})


def test_a_plan_of_many_arms_says_what_was_done_and_draws_it(cell: Path, capsys: pytest.CaptureFixture[str]) -> None:
    files = ["--timeline", "line.svg", "--diagram", "pair.png", "--html", "page.html"]
    assert run(["plan", str(cell), *files]) == OK
    said = capsys.readouterr().out
    assert "certified free" in said
    assert "6 arms: makespan" in said
    assert "times the slowest arm alone" in said
    assert "scheduled by " in said
    for name in ("line.svg", "pair.png", "page.html"):
        assert name in said
        assert Path(name).stat().st_size > 1000
    assert "panel-timeline" in Path("page.html").read_text()


def test_a_margin_that_many_arms_do_not_keep_is_said(cell: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["plan", str(cell), "--margin", "0.2"]) == OK
    assert re.search(r"^margin: \S+ mm kept, not 200 mm, because", capsys.readouterr().out, re.MULTILINE)
    assert run(["plan", str(cell), "--margin", "0.001"]) == OK
    assert "mm kept" not in capsys.readouterr().out


def test_an_arm_without_a_limit_preset_is_named(
    tmp_path: Path, rr1: rp.Robot, planar2r: rp.Robot, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = rp.Scene().with_arm("one", rr1).with_arm("two", planar2r, [3.0, 0.0, 0.0])
    file = rp.save_scene(tmp_path / "mixed.toml", scene, problems={"home": rp.Problem(scene, None, {"two": "home"})})
    assert run(["plan", str(file), "--limits", "hardware"]) == BAD_INPUT
    assert "unknown limit preset 'hardware'. Known: sim. These are the presets of arm 'two'" in capsys.readouterr().err


def test_a_plan_of_many_arms_is_one_json_value(cell: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["plan", str(cell), "--json", "--timeline", "line.png"]) == OK
    value = json.loads(capsys.readouterr().out)
    many = value["many_arms"]
    assert value["report"]["certified"]
    assert many["makespan"] == pytest.approx(value["duration"])
    assert many["ratio"] > 0.0
    assert sorted(arm for group in many["groups"] for arm in group["arms"]) == [f"arm0{k}" for k in range(1, 7)]
    assert all(wait["end"] > wait["begin"] for wait in many["waits"])
    assert value["files"]["time line"] == "line.png"


def test_a_time_line_is_drawn_for_two_arms_in_their_joint_space_too(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["plan", "rr1_pair", "--timeline", "line.pdf", "--quiet"]) == OK
    assert Path("line.pdf").read_bytes().startswith(b"%PDF")
    assert capsys.readouterr().out == ""


def test_what_touches_is_named(tmp_path: Path, grid: rp.Problem, capsys: pytest.CaptureFixture[str]) -> None:
    place = grid.scene.arms["arm01"].base[:3, 3] + [0.0, 0.4, 0.3]
    goals = {arm: grid.goal[arm][0].q for arm in grid.arms} | dict.fromkeys(
        ("arm01", "arm02"), rp.PoseGoal("tool", place)
    )
    same = rp.Problem(grid.scene, grid.scene.split(grid.start, grid.arms), goals)
    file = rp.save_scene(tmp_path / "same.toml", grid.scene, problems={"same": same})
    assert run(["plan", str(file)]) == NO_PLAN
    said = capsys.readouterr().err
    assert "the goals exclude each other" in said
    assert "overlap by" in said


def test_who_has_no_schedule_is_named(capsys: pytest.CaptureFixture[str], tmp_path: Path, rr1: rp.Robot) -> None:
    scene = rp.place_grid(rr1, 1, 3, spacing=0.8)
    wall = scene.arms["arm02"].base @ rp.transforms.pose((-0.4, 0.0, 1.15))
    scene = scene.with_obstacle("wall", rp.Box((0.6, 0.02, 1.8)), wall)
    left, right = [-1.2, 0, 0.3, 0, 0.5, 0], [1.9, 0, 0.3, 0, 0.5, 0]
    goals = {"arm01": right, "arm02": right, "arm03": left}
    file = rp.save_scene(tmp_path / "w.toml", scene, problems={"w": rp.Problem(scene, {"arm02": left}, goals)})
    assert run(["plan", str(file), "--seconds", "60"]) == NO_PLAN
    streams = capsys.readouterr()
    assert "arm02: no path exists: joint" in streams.err
    assert "not scheduled: arm02: no path exists: joint" in streams.out
    assert run(["plan", str(file), "--seconds", "60", "--json"]) == NO_PLAN
    value = json.loads(capsys.readouterr().out)
    assert value["status"] == "infeasible"
    assert any(not group["found"] and "arm02" in group["reason"] for group in value["many_arms"]["groups"])


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["rr1_pair", "--diagram", "d.png"], "--diagram needs the schedules of --planner many_arms"),
        (["rr1_table", "--diagram", "d.png", "--planner", "many_arms"], "needs two arms that move"),
        (["rr1_pair", "--pair", "left", "right"], "--pair has no effect without --diagram"),
        (
            ["rr1_pair", "--planner", "many_arms", "--diagram", "d.png", "--pair", "left", "rigth"],
            "Did you mean 'right'",
        ),
        (
            ["rr1_pair", "--planner", "many_arms", "--diagram", "d.png", "--pair", "left", "left"],
            "--pair names 'left' twice",
        ),
        (["rr1_pair", "--timeline", "line.gif"], "does not end in .png or .svg or .pdf"),
        (["rr1_pair", "--timeline", "a.svg", "--diagram", "a.svg"], "are the same file"),
    ],
)
def test_figures_that_cannot_be_are_refused(options: list[str], said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["plan", *options]) == BAD_INPUT
    assert said in capsys.readouterr().err
    assert not list(Path.cwd().glob("*.png"))
