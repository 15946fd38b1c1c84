"""Fixtures that every part of the tests may use."""

from __future__ import annotations

import importlib.metadata
import signal
from pathlib import Path

import pytest

import rr1plan as rp

# A shell that runs the tests in the background has Ctrl-C ignored, and every child would inherit that.
signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session")
def rr1() -> rp.Robot:
    return rp.load_robot("rr1")


@pytest.fixture(scope="session")
def planar2r() -> rp.Robot:
    return rp.load_robot("planar2r")


@pytest.fixture(scope="session")
def rr1_table() -> rp.Scene:
    return rp.load_scene("rr1_table")


@pytest.fixture(scope="session")
def foreign_robots() -> Path:
    """The folder of the robots that nobody here wrote, from the package example-robot-data."""
    try:
        files = importlib.metadata.files("example-robot-data") or []
    except importlib.metadata.PackageNotFoundError:
        pytest.skip("the package example-robot-data is not installed; try: pip install 'rr1plan[robots]'")
    for file in files:
        parts = file.parts
        if "robots" in parts and file.suffix == ".urdf":
            return Path(str(file.locate())).parents[len(parts) - 2 - parts.index("robots")]
    pytest.skip("the package example-robot-data has no robots")
