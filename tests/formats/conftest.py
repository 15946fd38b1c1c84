"""Fixtures for the readers: a separate cache folder, and small meshes built in code."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rr1plan.shapes import Mesh


@pytest.fixture(autouse=True)
def own_cache(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path_factory.mktemp("cache") / "inner"
    monkeypatch.setenv("RR1PLAN_CACHE", str(folder))
    for variable in ("ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH"):
        monkeypatch.delenv(variable, raising=False)
    return folder


def box_mesh(lower: tuple[float, float, float], upper: tuple[float, float, float]) -> tuple[np.ndarray, np.ndarray]:
    corners = np.array(
        [
            [(lower, upper)[i][0], (lower, upper)[j][1], (lower, upper)[k][2]]
            for i in (0, 1)
            for j in (0, 1)
            for k in (0, 1)
        ]
    )
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [triangle for a, b, c, d in quads for triangle in ((a, b, c), (a, c, d))]
    return corners, np.array(faces)


@pytest.fixture
def block() -> Mesh:
    """A block of 1 x 2 x 3 m with a corner at the origin."""
    return Mesh(*box_mesh((0, 0, 0), (1, 2, 3)))


@pytest.fixture
def gate() -> Mesh:
    """A gate: a beam on two posts, one closed surface."""
    outline = np.array([(0, 0), (1, 0), (1, 2), (3, 2), (3, 0), (4, 0), (4, 3), (0, 3)], dtype=float)
    caps = [(0, 1, 2), (0, 2, 7), (2, 3, 7), (3, 6, 7), (3, 4, 5), (3, 5, 6)]
    n = len(outline)
    vertices = np.array([(x, y, z) for y in (0.0, 0.8) for x, z in outline])
    sides = [t for i in range(n) for j in [(i + 1) % n] for t in ((i, i + n, j), (j, i + n, j + n))]
    faces = [*caps, *[(c + n, b + n, a + n) for a, b, c in caps], *sides]
    return Mesh(vertices, np.array(faces))
