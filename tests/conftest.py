"""Fixtures that every part of the tests may use."""

from __future__ import annotations

import signal

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
