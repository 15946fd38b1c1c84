"""The table of results in `docs/command_line.md`: the keys that `--json` prints."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from rr1plan.cli import BAD_INPUT, NO_PLAN, OK, run
from rr1plan.cli.parser import build_parser

DOCS = Path(__file__).parents[2] / "docs"
ROWS = dict(re.findall(r"^\| (`[a-z]+`.*?) \| (.*) \|$", (DOCS / "command_line.md").read_text(), re.MULTILINE))


def keys(row: str) -> set[str]:
    """The keys of one kind of result, those before the first semicolon."""
    return set(re.findall(r"`(\w+)`", ROWS[row].partition(";")[0]))


def printed(capsys: pytest.CaptureFixture[str], *words: str, code: int = OK) -> set[str]:
    assert run([*words, "--json"]) == code
    value = json.loads(capsys.readouterr().out)
    return set(value[0] if isinstance(value, list) else value)


def test_every_command_is_documented() -> None:
    assert {re.match(r"`(\w+)`", row)[1] for row in ROWS} == set(build_parser()[1])


def test_the_keys_of_results_are_those_documented(motion: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert printed(capsys, "plan", "rr1_table") == keys("`plan`")
    assert printed(capsys, "play", str(motion), "--mode", "kinematic") == keys("`play`")
    assert printed(capsys, "view", str(motion), "--html", "a.html") == keys("`view`")
    assert printed(capsys, "lesson", "workspace", "--html", "l.html") == keys("`lesson`")
    picture = ("cspace", "planar2r_path", "--resolution", "20", "--svg", "c.svg")
    assert printed(capsys, *picture) == keys("`cspace`")
    assert printed(capsys, "robots", "rr1") == keys("`robots`")
    for name in ("scenes", "doctor"):
        assert printed(capsys, name) == keys(f"`{name}`")


def test_the_keys_of_failures_are_those_documented(capsys: pytest.CaptureFixture[str]) -> None:
    without_path = {"status", "reason", "planner"}
    assert keys("`plan` without a path (exit code 3)") == without_path
    assert printed(capsys, "plan", "rr1_table", "--position", "5", "5", "5", code=NO_PLAN) == without_path
    assert printed(capsys, "plan", "nowhere", code=BAD_INPUT) == {"error", "exit_code"}


def test_a_demo_without_a_path_prints_what_plan_prints(capsys: pytest.CaptureFixture[str]) -> None:
    query = '[queries.far]\nstart = "home"\ngoal = { frame = "tool", position = [9, 0, 0] }\n'
    Path("far.toml").write_text(f'[arms.arm]\nrobot = "planar2r"\n{query}')
    assert printed(capsys, "demo", "--scene", "far.toml", code=NO_PLAN) == {"status", "reason", "planner"}
