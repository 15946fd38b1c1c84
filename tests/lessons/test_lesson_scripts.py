"""The scripts of the lessons run, from an empty folder, with warnings as errors, and print what they claim."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

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
        r"RR: 7\d% free, closed: \(True, True\)",
        r"disc: 1[01]\.\d% of the cells, with a strip",
        r"in two images at once: 0\.[6-9]%",
        r"RP: \d\d% free, closed: \(True, False\)",
        r"PP: \d\d% free, closed: \(False, False\)",
        r"disc: 1[01]\.\d% of the cells, without a strip",
    ),
    "04_no_path": (
        r"start free: True, goal free: True",
        r"No path exists: .* proven by certified cells",
        r"RRT-Connect: timeout, \d\d+ edges",
        r"without above: found",
        r"without below: found",
    ),
}


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda p: p.stem)
def test_a_script_runs_and_prints_what_it_claims(script: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-W", "error", str(script)]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    at = 0
    for claim in CLAIMS[script.stem]:
        found = re.search(claim, done.stdout[at:])
        assert found, f"{claim!r} is not in the rest of:\n{done.stdout}"
        at += found.end()
    written = [file for file in tmp_path.iterdir() if file.suffix in (".html", ".svg", ".png")]
    assert {file.suffix for file in written} >= {".html"}
    assert all(file.name.startswith(script.stem[:2]) and file.stat().st_size > 10_000 for file in written)


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda p: p.stem)
def test_a_script_is_short_and_named_after_its_lesson(script: Path) -> None:
    text = script.read_text()
    number, name = script.stem.split("_", 1)
    assert name in rp.lesson_names()
    assert re.fullmatch(r"\d\d", number)
    assert len(text.splitlines()) <= 80
    assert ast.get_docstring(ast.parse(text))
