"""Paths: waypoints with names."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rr1plan.errors import InputError
from rr1plan.path import Path

NAMES = ("a/x", "a/y")


def test_length_is_the_sum_of_the_edges() -> None:
    assert Path(NAMES, [[0, 0], [3, 4], [3, 4], [3, 5]]).length == 6.0
    assert Path(NAMES, [[1, 2]]).length == 0.0


@given(
    st.lists(st.tuples(st.floats(-3, 3), st.floats(-3, 3)), min_size=1, max_size=5),
    st.floats(0.05, 2.0),
)
@settings(deadline=None, max_examples=100)
def test_samples_hold_every_waypoint_and_no_step_is_longer(points: list[tuple[float, float]], step: float) -> None:
    path = Path(NAMES, points)
    samples = path.sample(step)
    assert np.array_equal(samples[0], points[0])
    assert np.array_equal(samples[-1], points[-1]) or np.allclose(samples[-1], points[-1], atol=1e-15)
    assert np.abs(np.diff(samples, axis=0)).max(initial=0.0) <= step * (1 + 1e-12)
    for point in points:
        assert np.abs(samples - point).max(axis=1).min() < 1e-14


def test_waypoints_are_copied_and_read_only_also_after_pickling() -> None:
    source = np.zeros((2, 2))
    path = Path(NAMES, source)
    source[0, 0] = 5.0
    for one in (path, pickle.loads(pickle.dumps(path))):
        assert one.waypoints[0, 0] == 0.0
        with pytest.raises(ValueError, match="read-only"):
            one.waypoints[0, 0] = 1.0


def test_allclose_compares_names_shapes_and_numbers() -> None:
    path = Path(NAMES, [[0, 0], [1, 1]])
    assert path.allclose(Path(NAMES, [[0, 0], [1, 1 + 1e-13]]))
    assert not path.allclose(Path(NAMES, [[0, 0], [1, 1.1]]))
    assert not path.allclose(Path(NAMES, [[0, 0]]))
    assert not path.allclose(Path(("a/x", "a/z"), [[0, 0], [1, 1]]))


@pytest.mark.parametrize(
    ("names", "waypoints", "message"),
    [
        (NAMES, [[0, 0, 0]], r"shape \(1, 3\), expected \(any, 2\)"),
        (NAMES, [[0, np.nan]], r"waypoints\[0, 1\] is nan"),
        (NAMES, np.zeros((0, 2)), "at least one waypoint"),
        (("a", "a"), [[0, 0]], "'a' twice"),
        (("a", ""), [[0, 0]], "expected names"),
        (("a", 3), [[0, 0]], "expected names"),
        (NAMES, [["x", 0]], "not an array of numbers"),
    ],
)
def test_what_is_no_path_is_refused(names: tuple[str, ...], waypoints: object, message: str) -> None:
    with pytest.raises(InputError, match=message):
        Path(names, waypoints)


@pytest.mark.parametrize("step", [0.0, -1.0, np.nan])
def test_a_step_that_is_not_above_zero_is_refused(step: float) -> None:
    with pytest.raises(InputError, match="step"):
        Path(NAMES, [[0, 0]]).sample(step)


def test_arms_are_those_of_the_columns_in_order() -> None:
    path = Path(("b/x", "b/y", "a/x"), [[0.0, 0.0, 0.0]])
    assert path.arms == ("b", "a")
