"""Fixtures for all tests."""

from __future__ import annotations

import importlib.metadata
import signal
from collections.abc import Generator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import rr1plan as rp
from rr1plan.planners.ompl_planners import WITHOUT_RELEASE
from rr1plan.playback.viewer.camera import choose_camera
from rr1plan.playback.viewer.page_capture import find_browser

# A shell that runs the tests in the background ignores Ctrl-C, which every child process would inherit.
signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip tests that need a browser where there is none."""
    if item.get_closest_marker("browser") is not None:
        if find_browser() is None:
            pytest.skip("no Chromium on this machine")
        pytest.importorskip("playwright", reason="playwright is not installed")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call() -> Generator[None, None, None]:
    """Skip tests that use OMPL's planners where OMPL has no release for this version of Python."""
    try:
        return (yield)
    except rp.MissingPackageError as error:
        if WITHOUT_RELEASE and "'ompl'" in str(error):
            pytest.skip(str(error))
        raise


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
    """The folder of third-party robots, from the package example-robot-data."""
    try:
        files = importlib.metadata.files("example-robot-data") or []
    except importlib.metadata.PackageNotFoundError:
        pytest.skip("the package example-robot-data is not installed; try: pip install 'rr1plan[robots]'")
    for file in files:
        parts = file.parts
        if "robots" in parts and file.suffix == ".urdf":
            return Path(str(file.locate())).parents[len(parts) - 2 - parts.index("robots")]
    pytest.skip("the package example-robot-data has no robots")


@pytest.fixture(scope="session")
def panda_and_wall(foreign_robots: Path) -> tuple[rp.Scene, rp.Trajectory, tuple[float, float, float]]:
    """A magenta Panda behind a wall, a motion of it, and the view direction from which the wall hides all of it."""
    panda = rp.load_robot(foreign_robots / "panda_description/urdf/panda.urdf")
    panda = replace(
        panda,
        links=tuple(
            replace(link, visuals=tuple(replace(g, color=(1.0, 0.0, 1.0, 1.0)) for g in link.visuals))
            for link in panda.links
        ),
    )
    scene = rp.Scene().with_arm("panda", panda)
    turn = np.array([1.2, 0.3, 0.0, 0.4, 0.0, 0.0, 0.0])
    motion = rp.Trajectory(scene.joint_names(), np.array([0.0, 1.0]), np.stack([panda.home, turn])[None])
    # The initial camera for the same motion without the wall.
    x, y, z = choose_camera(scene, motion).direction
    away = 1.1 / np.hypot(x, y)
    at = rp.transforms.pose([away * x, away * y, 1.2], rpy=[0.0, 0.0, np.arctan2(y, x)])
    return scene.with_obstacle("wall", rp.Box((0.05, 4.0, 2.4)), at), motion, (x, y, z)
