"""Scripts for readers, run in this process, which has imported already what each of them would have to import."""

from __future__ import annotations

import logging
import runpy
import sys
import warnings
from pathlib import Path

import pytest


def run_script(script: Path, folder: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> str:
    """Run a script in a folder with warnings as errors, and return what it prints.

    Nothing may appear on stderr, as a log message neither.
    """
    logged: list[str] = []
    handler = logging.Handler(logging.WARNING)
    handler.emit = lambda record: logged.append(record.getMessage())  # type: ignore[method-assign]
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
    # What is said of the first compilation depends on what ran before.
    assert [line for line in said.err.splitlines() if not line.startswith("compiling for this machine")] == []
    assert logged == []
    return said.out
