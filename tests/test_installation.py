"""What is missing from an installation is named, with a way to install it or to do without it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import rr1plan as rp
from rr1plan.errors import missing_libraries_named


def test_without_ompl_its_planners_say_so_and_the_others_plan(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ompl", None)
    problem = next(iter(rp.load_problems("rr1_table").values()))
    missing = r"planner 'fmt' needs the package 'ompl'; (try: pip install 'ompl'|it has no release for Python)"
    with pytest.raises(rp.MissingPackageError, match=missing):
        rp.plan(problem, planner="fmt")
    with pytest.raises(rp.MissingPackageError, match=missing):
        rp.OmplPlanner("fmt", settings={"num_samples": 50})
    for name in ("rrt_connect", "anytime", "roadmap"):
        assert rp.plan(problem, planner=name, budget=rp.Budget(iterations=500), rng=0).found
    assert "fmt" in rp.planner_names()


@pytest.fixture
def without_openmp(tmp_path: Path) -> dict[str, str]:
    """The environment of a process in which Pinocchio does not find GNU OpenMP."""
    fake = tmp_path / "pinocchio" / "__init__.py"
    fake.parent.mkdir()
    fake.write_text("raise ImportError('libgomp.so.1: cannot open shared object file: No such file or directory')\n")
    return {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])}


def test_a_command_names_a_missing_library_of_the_system(without_openmp: dict[str, str]) -> None:
    command = [sys.executable, "-m", "rr1plan", "robots"]
    done = subprocess.run(command, capture_output=True, text=True, env=without_openmp, check=False)
    assert done.returncode == 2
    assert "libgomp.so.1" in done.stderr
    assert "apt-get install libgomp1" in done.stderr
    assert "Traceback" not in done.stderr


def test_a_program_learns_which_library_of_the_system_is_missing(without_openmp: dict[str, str]) -> None:
    code = """
import rr1plan as rp
try:
    rp.load_robot
except rp.InstallationError as error:
    print(error)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=without_openmp, check=True)
    assert "system library libgomp.so.1" in done.stdout


def test_other_libraries_are_named_too_and_other_errors_are_not_changed() -> None:
    with pytest.raises(rp.InstallationError, match=r"libGL\.so\.1.*package manager"), missing_libraries_named():
        raise ImportError("libGL.so.1: cannot open shared object file: No such file or directory")
    with pytest.raises(ImportError, match=r"^cannot import name 'x'$"), missing_libraries_named():
        raise ImportError("cannot import name 'x'")
