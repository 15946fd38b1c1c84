"""Run example scripts in the test process, where most of their modules are already imported."""

from __future__ import annotations

import io
import logging
import runpy
import sys
import warnings
from pathlib import Path

import pytest


def run_script(script: Path, folder: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> str:
    """Run a script in a folder with warnings as errors, and return what it prints.

    Neither stderr nor the log may get a message.
    """
    log = io.StringIO()
    handler = logging.StreamHandler(log)
    handler.setLevel(logging.WARNING)
    monkeypatch.chdir(folder)
    monkeypatch.setattr(sys, "argv", [str(script)])
    logging.getLogger().addHandler(handler)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            runpy.run_path(str(script), run_name="__main__")
    finally:
        logging.getLogger().removeHandler(handler)
    said = capfd.readouterr()
    # Messages about the first compilation depend on earlier runs.
    assert [line for line in said.err.splitlines() if not line.startswith("compiling for this machine")] == []
    assert log.getvalue() == ""
    return said.out
