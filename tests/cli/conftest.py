"""Fixtures of the command line's tests: each works in an empty folder."""

from __future__ import annotations

from pathlib import Path

import pytest

from rr1plan.cli import OK, run


@pytest.fixture(autouse=True)
def _in_an_empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.fixture(scope="session")
def motion(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A motion file."""
    file = tmp_path_factory.mktemp("motion") / "motion.json"
    assert run(["plan", "rr1_table", "--seed", "1", "--output", str(file), "--quiet"]) == OK
    return file
