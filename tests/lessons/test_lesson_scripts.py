"""The scripts of the lessons run, from an empty folder, with warnings as errors, and print what they claim."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest
from script_runs import run_script

import rr1plan as rp

SCRIPTS = sorted((Path(__file__).parents[2] / "examples" / "lessons").glob("*.py"))

# Of each script lines of its output, in order, as regular expressions.
CLAIMS: dict[str, tuple[str, ...]] = {
    "01_workspace": (
        r"the tool is 0\.76 to 1\.80 m from the base",
        r"\(\+1\.3, \+0\.6\): 2 within the limits, 2 free",
        r"\(\+1\.2, -0\.9\): 2 within the limits, 1 free",
        r"\(-0\.9, -0\.9\): 1 within the limits, 1 free",
        r"\(\+0\.4, \+0\.3\): 0 within the limits, 0 free",
        r"01_workspace\.svg",
    ),
    "02_configuration_space": (
        r"RR: 7\d % free, closed: \(True, True\)",
        r"disc: 1[01]\.\d % of the cells, with a strip",
        r"in two images at once: 0\.[6-9] %",
        r"RP: \d\d % free, closed: \(True, False\)",
        r"PP: \d\d % free, closed: \(False, False\)",
        r"disc: 1[01]\.\d % of the cells, without a strip",
    ),
    "03_kinematics": (
        r"joint2 +0\.7000",
        r"frame 2 at \[0\.997 1\.169\]",
        r"elbow (left|right): .* degrees",
        r"bend 0\.00 rad: .*\|det J\| 0\.000",
        r"bend 1\.57 rad: .*\|det J\| 0\.700",
        r"03_kinematics\.svg",
    ),
    "04_no_path": (
        r"start free: True, goal free: True",
        r"No path exists: .* proven by certified cells",
        r"RRT-Connect: timeout, \d\d+ edges",
        r"without above: found",
        r"without below: found",
    ),
    "05_planning": (
        r"Dijkstra +\d+ vertices, +\d{4} edges checked, .* path 5\.16 rad",
        r"A\* +\d+ vertices, +\d{3} edges checked, .* path 5\.16 rad",
        r"PRM +\d+ vertices",
        r"0 vertex",
        r"1 sample",
        r"step 1\.20 rad: +\d+ edges checked",
        r"05_planning\.svg",
    ),
    "06_motion": (
        r"planned \d\.\d\d rad, shortened \d\.\d\d rad",
        r"blends up to 0\.00 rad: 3\.\d+ s",
        r"blends up to 0\.40 rad: 2\.\d+ s",
        r"phase plane (\d\.\d\d)\d s, retime \1",
        r"one joint: 0\.950 s, phases of \[0\.1 ",
        r"jerk limit +640 rad/s³: 0\.86",
        r"06_motion\.svg",
    ),
    "07_continuous_checking": (
        r"through, step of 12°: 9 samples, free",
        r"through, step of 3°: 32 samples, in contact",
        r"through, halving: in contact, distances: \d+",
        r"past, halving: free, distances: \d\d",
        r"far, halving: free, distances: 1\b",
    ),
    "08_two_arms": (
        r"take turns: 1[67] % of the diagram is blocked",
        r"left first: 9\.\d s",
        r"right first: 7\.\d s",
        r"swap sides: 6\d % of the diagram is blocked",
        r"left first: no schedule",
        r"right first: the other one can avoid it: False",
        r"in all four joints: found",
        r"proven valid: True",
    ),
    "10_potential_fields": (
        r"FieldGrid\(120 × 120 cells, 73 % free\)",
        r"gain 0\.03: the descent ends in a local minimum, \d+ minima, 6\d % reach the goal",
        r"best-first search: \d+ cells visited",
        r"wave: \d+ steps, 100 % reach the goal",
        r"proven free: True",
    ),
    "09_six_joints": (
        r"slice with the wrist at 34°: \d\d % free",
        r"8 solutions, 2 within the limits, 1 free",
        r"around z: \d+ configurations, 1 joints move, 100 % free",
        r"around y: \d+ configurations, 6 joints move, [45]\d % free",
        r"75\.\d\d % free, 74\.\d\d to 76\.\d\d % with 95 % confidence \(10000 samples\)",
    ),
}


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda p: p.stem)
def test_a_script_runs_and_prints_what_it_claims(
    script: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    said, at = run_script(script, tmp_path, monkeypatch, capfd), 0
    for claim in CLAIMS[script.stem]:
        found = re.search(claim, said[at:])
        assert found, f"{claim!r} is not in the rest of:\n{said}"
        at += found.end()
    written = [file for file in tmp_path.iterdir() if file.suffix in (".html", ".svg", ".png")]
    assert {file.suffix for file in written} in ({".html", ".svg"}, {".html", ".png"})
    assert all(file.read_text().rstrip().endswith("</svg>") for file in written if file.suffix == ".svg")
    assert all(file.name.startswith(script.stem[:2]) and file.stat().st_size > 10_000 for file in written)


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda p: p.stem)
def test_a_script_is_short_and_named_after_its_lesson(script: Path) -> None:
    text = script.read_text()
    number, name = script.stem.split("_", 1)
    assert name in rp.lesson_names()
    assert re.fullmatch(r"\d\d", number)
    assert len(text.splitlines()) <= 80
    assert ast.get_docstring(ast.parse(text))
