"""Fixtures of the planners' tests."""

from __future__ import annotations

from itertools import pairwise

import pytest

from rr1plan.collision import CollisionChecker


@pytest.fixture(scope="session")
def is_certified():
    """Whether every edge of a path is free in a scene, by the exact kernel alone."""

    def ask(scene, points, arms=None):
        motion = CollisionChecker(scene, arms)
        return all(motion.edge_is_free_slowly(a, b) for a, b in pairwise([*points[:1], *points]))

    return ask
