"""The benchmarks are scripts beside the package: their folder is put on the path."""

from __future__ import annotations

import sys
from importlib import import_module
from pathlib import Path

import pytest

_FOLDER = Path(__file__).resolve().parents[2] / "benchmarks"


@pytest.fixture
def script(monkeypatch):
    """A benchmark by name, which leaves this process on all its cores."""
    monkeypatch.setattr(sys, "path", [str(_FOLDER), *sys.path])

    def load(name):
        module = import_module(name)
        if hasattr(module, "pin_to_core"):
            monkeypatch.setattr(module, "pin_to_core", lambda core: core)
        return module

    return load
