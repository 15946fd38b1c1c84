"""Every example runs, from an empty folder, headless, and with warnings as errors."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = sorted((Path(__file__).parent.parent / "examples").glob("*.py"))


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda p: p.stem)
def test_an_example_runs(example: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-W", "error", str(example)]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    assert done.stdout


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda p: p.stem)
def test_an_example_is_numbered_short_and_says_what_it_shows(example: Path) -> None:
    text = example.read_text()
    assert re.match(r"\d\d_[a-z0-9_]+$", example.stem)
    assert len(text.splitlines()) <= 80
    assert ast.get_docstring(ast.parse(text))


def test_numbers_are_consecutive() -> None:
    assert [int(p.stem[:2]) for p in EXAMPLES] == list(range(1, len(EXAMPLES) + 1))
