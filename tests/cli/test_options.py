"""Every option has an effect or is rejected, and every mistake gives one line in terms of the command line."""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from rr1plan.cli import BAD_INPUT, NO_PLAN, OK, run
from rr1plan.cli.parser import build_parser
from rr1plan.planners import MANY_ARMS_PLANNERS, planner_names
from rr1plan.retiming import retiming_names

_, COMMANDS = build_parser()
POSITION = ["--position", "-0.30", "0.25", "0.20"]


def one_line(capsys: pytest.CaptureFixture[str]) -> str:
    said = capsys.readouterr()
    assert said.out == ""
    # The first compilation says so, whatever is planned first.
    lines = [line for line in said.err.splitlines() if "compiling for this machine" not in line]
    assert len(lines) == 1, said.err
    assert lines[0].startswith("rr1plan: ")
    return lines[0]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["plan", "rr1_table", "--arm", "nope"], "--arm has no effect without --goal or --position"),
        (["plan", "rr1_pair", "--arm", "left"], "--arm has no effect without"),
        (["plan", "rr1_pair", "--arm", "left", "--query", "left_alone"], "--arm has no effect without"),
        (["plan", "rr1_pair", "--arm", "left", "--start", "home"], "--arm has no effect without"),
        (["plan", "rr1_table", "--quaternion", "1", "0", "0", "0"], "--quaternion has no effect without --position"),
        (["plan", "rr1_table", "--goal", "home", "--quaternion", "1", "0", "0", "0"], "without --position"),
        (["plan", "rr1_table", "--frame", "hand_link"], "--frame has no effect without --position"),
        (["plan", "rr1_table", "--frame", "tool"], "--frame has no effect without --position"),
        (["plan", "rr1_table", "--frame", "tool", "--goal", "home"], "--frame has no effect without --position"),
        (["plan", "rr1_table", "--spheres"], "--spheres has no effect without --html"),
        (["plan", "rr1_table", "--view", "top"], "--view has no effect without --html"),
        (["cspace", "planar2r_path", "--view", "top"], "--view has no effect without --html"),
        (["cspace", "planar2r_path", "--view", "top", "--svg", "a.svg"], "--view has no effect without --html"),
        (["plan", "rr1_table", "--spheres", "--output", "m.json"], "--spheres has no effect without --html"),
        (["plan", "rr1_table", "--query", "above_parcel", "--goal", "home"], "got --query and --goal, expected one of"),
        (["plan", "rr1_table", "--query", "above_parcel", *POSITION], "got --query and --position"),
        (["plan", "rr1_table", "--goal", "home", *POSITION], "got --goal and --position"),
        (["plan", "rr1_table", "--planner", "cartesian", "--no-shorten", *POSITION], "--no-shorten has no effect with"),
        (["plan", "rr1_ring", "--no-shorten"], "--no-shorten has no effect with --planner many_arms"),
        (["plan", "rr1_ring", "--iterations", "9"], "--iterations has no effect with --planner many_arms, except with"),
        (["view", "rr1_table", "--html", "a.html", "--port", "7000"], "--port has no effect with --html"),
        (["view", "rr1_table", "--html", "a.html", "--no-browser"], "--no-browser has no effect with --html"),
        (["view", "rr1_table", "--glb", "a.glb", "--spheres"], "--spheres has no effect with --glb"),
        (["view", "rr1_table", "--glb", "a.glb", "--view", "top"], "--view has no effect with --glb"),
        (["view", "motion.json", "--glb", "a.glb", "--compare", "b.json"], "--compare has no effect with --glb"),
        (["plan", "rr1_table", "--seed", "1", "--seed", "2"], "--seed: given twice"),
        (["plan", "rr1_table", "--goal", "home", "--goal", "zero"], "--goal: given twice"),
        (["scenes", "--json", "--json"], "--json: given twice"),
        (["plan", "rr1_table", "--output", "a.json", "--csv", "./a.json"], "--output and --csv are the same file"),
        (["plan", "cell.toml", "--html", "cell.toml"], "SCENE and --html are the same file 'cell.toml'"),
        (["view", "cell.toml", "--html", "cell.toml"], "WHAT and --html are the same file"),
        (["view", "rr1_table", "--compare", "cell.toml", "--html", "./cell.toml"], "--compare and --html are the same"),
        (["mirror", "a.jsonl", "--plan", "cell.toml", "--record", "cell.toml"], "--plan and --record are the same"),
        (["mirror", "a.jsonl", "--scene", "cell.toml", "--record", "cell.toml"], "--scene and --record are the same"),
        (["cspace", "cell.toml", "--svg", "cell.toml"], "--svg: 'cell.toml' does not end in .svg"),
        (
            ["experiment", "static", "latency", "--arms", "3", "--out", "o"],
            "--arms has no effect without the experiment",
        ),
        (["lesson", "--scene", "planar2r_path"], "--scene has no effect without a lesson; name one: workspace"),
        (["lesson", "--json", "--no-browser"], "--no-browser has no effect without a lesson"),
        pytest.param(
            ["view", "rr1_table", "--png", "a.png", "--time", "1"],
            "--time has no effect: rr1_table is not a motion",
            marks=pytest.mark.browser,
        ),
        (["plan", "rr1_table", "--html", "a.txt"], "cannot save 'a.txt', expected a name that ends in .html"),
        (["view", "rr1_table", "--html", "a.txt"], "cannot save 'a.txt', expected a name that ends in .html"),
        (["play", "m.json", "--html", "a.txt"], "cannot save 'a.txt', expected a name that ends in .html"),
    ],
)
def test_an_option_without_an_effect_is_refused(
    words: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("cell.toml").write_text("[arms.a]\nrobot = 'planar2r'\n")
    code = run(words)
    if "--json" in words:
        assert message in json.loads(capsys.readouterr().out)["error"]
    else:
        assert message in one_line(capsys)
    assert code == BAD_INPUT
    assert [file.name for file in Path.cwd().iterdir()] == ["cell.toml"]
    assert Path("cell.toml").read_text().startswith("[arms.a]")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ([], "COMMAND is missing, give it first; see: rr1plan --help"),
        (["figures"], "--out is missing; see: rr1plan figures --help"),
        (["dance"], "unknown command 'dance'."),
        (["pla", "rr1_table"], "unknown command 'pla'. Did you mean 'play' or 'plan'"),
        (["plan"], "SCENE is missing, give it first; see: rr1plan plan --help"),
        (["plan", "--goal", "home", "rr1_table"], "SCENE is missing, give it first"),
        (["plan", "rr1_table", "--plannr", "rrt"], "unknown option '--plannr'. Did you mean '--planner'"),
        (["plan", "rr1_table", "--plan=rrt"], "unknown option '--plan'."),
        (["plan", "rr1_table", "extra"], "unexpected argument 'extra'"),
        (["plan", "rr1_table", "--seconds"], "--seconds: expected one argument"),
        (["plan", "rr1_table", "--seconds", "0"], "--seconds: '0' is not a number above zero"),
        (["plan", "rr1_table", "--seconds", "nan"], "--seconds: 'nan' is not a number above zero"),
        (["plan", "rr1_table", "--seconds", "inf"], "a budget needs seconds or iterations, got neither"),
        (["cspace", "planar2r_path", "--seconds", "inf"], "--seconds: 'inf' is not a number above zero"),
        (["plan", "rr1_table", "--margin", "-1e-3"], "--margin: '-1e-3' is not a distance >= 0"),
        (["plan", "rr1_table", "--iterations", "0"], "--iterations: '0' is not a whole number above zero"),
        (["plan", "rr1_table", "--seed", "-1"], "--seed: '-1' is not a seed"),
        (["plan", "rr1_table", "--seed", "9" * 400], "is not a seed"),
        (["plan", "rr1_table", "--position", "0", "0"], "--position: expected 3 arguments"),
        (["plan", "rr1_table", "--position", "0", "0", "-inf"], "--position: '-inf' is not a finite number"),
        (["plan", "rr1_table", "--html", ""], "--html: '' is not a file name"),
        (["plan", "rr1_table", "--html", "a\0b"], "is not a file name"),
        (["view", "rr1_table", "--html", "-"], "--html: '-' is standard output, expected a name"),
        (["demo", "--output", "-"], "--output: '-' is standard output, expected a name"),
        (["plan", "a" * 300], "is longer than 255 bytes"),
        (["plan", "rr1_table", "--html", "a" * 300], "is longer than 255 bytes"),
        (["plan", "rr1_table", "--limits", ""], "unknown"),
        (["plan", "rr1_table", "--query", ""], "unknown query ''"),
        (["scenes", "--quiet=yes"], "--quiet: ignored explicit argument 'yes'"),
        (["play", "m.json", "--mode", "fast"], "--mode: invalid choice: 'fast'"),
    ],
)
def test_a_mistake_on_the_command_line_is_one_line(
    words: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(words) == BAD_INPUT
    assert message in one_line(capsys)


def test_a_mistake_on_the_command_line_is_json_where_json_is_wanted(capsys: pytest.CaptureFixture[str]) -> None:
    for words in (["plan", "--json"], ["--json", "scenes"], ["plan", "rr1_table", "--json", "--arm", "a"]):
        assert run(words) == BAD_INPUT
        assert json.loads(capsys.readouterr().out)["exit_code"] == BAD_INPUT


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["plan", "rr1_pair", "--goal", "home"], "the scene has 2 arms (left, right); say which one with --arm"),
        (
            ["plan", "rr1_table", "--goal", "1", "2"],
            "goal of 'rr1' has 2 numbers, expected 6: one for each of shoulder",
        ),
        (["plan", "rr1_table", "--goal", "1", "2", "3"], "goal of 'rr1' has 3 numbers, expected 6: one for each of"),
        (["plan", "rr1_table", "--start", "1", "--goal", "home"], "start of 'rr1' has 1 number, expected 6"),
        (["plan", "rr1_table", "--goal", "0.1,0.2,-3e-1"], "'0.1,0.2,-3e-1': separate numbers by spaces"),
        (["plan", "rr1_table", "--goal", "-0.1,0.2,3"], "'-0.1,0.2,3': separate numbers by spaces, not by commas"),
        (["plan", "rr1_table", "--start", "-1e-3,", "0"], "'-1e-3, 0': separate numbers by spaces, not by commas"),
        (["plan", "rr1_table", "--goal", "0.1,", "2"], "'0.1, 2': separate numbers by spaces, not by commas"),
        (["plan", "rr1_table", "--goal", "a", "b"], "'a b' is neither a configuration's name nor numbers"),
        (["plan", "rr1_table", "--planner", "cartesian", "--goal", "home"], "moves to a pose, got a configuration"),
        (["plan", "rr1_pair", "--planner", "cartesian"], "the cartesian planner moves one arm, got 2: left, right"),
        (["plan", "rr1_table", "--quaternion", "0", "0", "0", "0", *POSITION], "has norm 0, expected about 1"),
        (["plan", "rr1_table", "--position", "1e6", "0", "0"], "goal position holds 1e+06, expected at most 10000"),
        (["cspace", "planar2r_path", "--joints", "joint1", "joint1"], "joint1 and joint1, expected two different ones"),
        (
            ["cspace", "planar2r_path", "--query", "elbow_flip", "--joints", "joint2", "joint1"],
            "the joints are joint2, joint1, but the problem's columns are joint1, joint2",
        ),
        (["view", "rr1_table", "--html", "a.html", "--view", "1", "2", "3", "4"], "view has 4 numbers, expected two"),
        (["view", "rr1_table", "--html", "a.html", "--view", "0", "0", "0"], "view is the direction 0 0 0, expected"),
        (["plan", "empty.toml"], "scene 'empty.toml' has no queries; give a goal (--goal, --position)"),
        (["demo", "--scene", "empty.toml"], "(--goal of rr1plan plan, --position of rr1plan plan)"),
        (["plan", "no_arm.toml", "--goal", "home"], "the scene has no arm; add one: [arms.NAME] in a scene file"),
        (["plan", "rr1_table", "--goal", "0", "20", "-45", "0", "30", "0"], "are these degrees?"),
        (["validate", "locked.csv", "--scene", "rr1_table"], "or load the robot with joints= that include it"),
    ],
)
def test_messages_are_in_the_words_of_the_command_line(
    words: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("empty.toml").write_text("[arms.a]\nrobot = 'planar2r'\n")
    Path("no_arm.toml").write_text("[obstacles.a]\nsphere = 0.1\n")
    Path("locked.csv").write_text("t,q:finger_joint\n0,0\n1,0\n")
    assert run(words) in (BAD_INPUT, NO_PLAN)
    said = one_line(capsys)
    assert message in said
    python = r"\w=[\w\[({'\"]|\(\d+,|\w\(\)|PoseGoal|JointGoal|array|float64|\bNone\b|\boption \w+_\w+"
    assert re.search(python, said) is None, said


def test_reports_name_options_of_the_command_line(motion: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["validate", str(motion)]) == OK
    said = capsys.readouterr().out
    assert "jerk: not asked for (--jerk-limits)" in said
    assert "torque: not asked for (--torque-limits)" in said
    assert run(["plan", "rr1_table", "--torque-limits"]) == OK
    said = capsys.readouterr().out
    assert "jerk: not asked for (--jerk-limits of rr1plan validate)" in said
    assert "torque: not asked for" not in said


@pytest.mark.parametrize("command", ["", *COMMANDS])
def test_help_shows_examples_that_the_parser_takes(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run([command, "--help"] if command else ["--help"]) == OK
    said = capsys.readouterr().out
    assert said.startswith(f"usage: rr1plan {command}".rstrip())
    assert "exit codes:" in said
    examples = re.findall(r"^  rr1plan (.+)$", said.partition("\nexamples:\n")[2], re.MULTILINE)
    assert examples
    for example in examples:
        if example != "COMMAND --help":
            parser = COMMANDS[example.split()[0]]
            parser.check(parser.parse_args(example.split()[1:], argparse.Namespace(given=frozenset())))


def test_help_lists_planners_and_retimings(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["plan", "--help"]) == OK
    said = capsys.readouterr().out
    planners, _, retimings = said.partition("\nplanners")[2].partition("\nretimings")
    listed = tuple(re.findall(r"^  (\w+)(?: \*)? +\S", planners, re.MULTILINE))
    assert listed == (*planner_names(), *MANY_ARMS_PLANNERS)
    assert tuple(re.findall(r"^  (\w+) +\S", retimings, re.MULTILINE)) == retiming_names()
    assert run(["cspace", "--help"]) == OK
    said = capsys.readouterr().out
    assert "  bit_star *" in said
    assert "many_arms" not in said


def test_the_version_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["--version"]) == OK
    assert re.fullmatch(r"rr1plan \d+\.\d+\.\d+\S*\n", capsys.readouterr().out)


@pytest.mark.parametrize("name", ["not/there", ".", "fifo", "device"])
@pytest.mark.parametrize(
    "command",
    [
        # Planning would end with no plan, and 2000 x 2000 cells take minutes.
        *(f"plan planar2r_no_path --seconds 0.2 {option} NAME" for option in ("--output", "--csv", "--html")),
        *(f"cspace planar2r_path --resolution 2000 --{kind} NAME.{kind}" for kind in ("png", "svg", "pdf", "html")),
        "view rr1_table --html NAME",
        "view missing.json --html NAME",
    ],
)
def test_a_file_that_cannot_be_written_is_refused_before_any_work(
    command: str, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    words = command.replace("NAME", name).split()
    file = Path(words[-1])
    why = {
        "not/there": "there is no folder not",
        ".": "it is a folder",
        "fifo": "it is a FIFO",
        "device": "it is a device",
    }[name]
    if name == "fifo":
        os.mkfifo(file)
    elif name == "device":
        file.symlink_to("/dev/full")
    elif name == ".":
        file.mkdir(exist_ok=True)
    before = sorted(Path.cwd().iterdir())
    assert run(words) == BAD_INPUT
    assert f"cannot write {file}: {why}" in one_line(capsys)
    assert sorted(Path.cwd().iterdir()) == before


@pytest.mark.parametrize("planner", ["bit_star", "rrt", "prm"])
def test_nothing_but_the_answer_is_said_about_libraries(planner: str) -> None:
    pytest.importorskip("ompl", reason="OMPL is not installed")
    command = [sys.executable, "-m", "rr1plan", "plan", "planar2r_no_path", "--planner", planner, "--iterations", "20"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == NO_PLAN
    assert done.stdout == ""
    assert len(done.stderr.splitlines()) == 1
