"""The benchmarks are scripts outside the package: their folder is added to the path."""

from __future__ import annotations

import sys
from importlib import import_module
from pathlib import Path

import pytest

_FOLDER = Path(__file__).resolve().parents[2] / "benchmarks"


@pytest.fixture
def script(monkeypatch):
    """A benchmark by name, without pinning this process to one core."""
    monkeypatch.setattr(sys, "path", [str(_FOLDER), *sys.path])

    def load(name):
        module = import_module(name)
        if hasattr(module, "pin_to_core"):
            monkeypatch.setattr(module, "pin_to_core", lambda core: core)
        return module

    return load
