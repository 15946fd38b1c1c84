"""Trajectories: piecewise polynomials on one clock, and arithmetic that keeps them exact."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import BPoly

from rr1plan.errors import InputError, UnknownNameError
from rr1plan.trajectory import Trajectory


def test_a_trajectory_is_shown_in_a_line() -> None:
    still = Trajectory.rest(("a/x", "a/y"), [0.0, 1.0], duration=1.5)
    assert repr(still) == "Trajectory(1.500 s, pieces=1, degree=0, joints=[a/x, a/y])"


@st.composite
def trajectories(draw: st.DrawFn, arm: str = "a") -> Trajectory:
    """Trajectories with continuous positions, and random pieces, degree and start time."""
    rng = np.random.default_rng(draw(st.integers(0, 10_000)))
    pieces, degree, nq = draw(st.integers(1, 4)), draw(st.integers(0, 4)), draw(st.integers(1, 3))
    breaks = rng.uniform(-1, 1) + np.concatenate([[0.0], np.cumsum(rng.uniform(0.05, 1.5, pieces))])
    coefficients = rng.normal(size=(pieces, degree + 1, nq))
    for i in range(1, pieces):
        powers = (breaks[i] - breaks[i - 1]) ** np.arange(degree + 1)
        coefficients[i, 0] = powers @ coefficients[i - 1]
    return Trajectory(tuple(f"{arm}/j{k}" for k in range(nq)), breaks, coefficients)


def spread(trajectory: Trajectory, margin: float = 0.5) -> np.ndarray:
    return np.linspace(trajectory.start_time - margin, trajectory.end_time + margin, 61)


@given(trajectories("a"), trajectories("b"), trajectories("c"))
@settings(deadline=None, max_examples=60)
def test_merging_keeps_every_arm_s_motion_and_select_gives_it_back(a: Trajectory, b: Trajectory, c: Trajectory) -> None:
    merged = Trajectory.merge(a, b, c)
    assert merged.arms == ("a", "b", "c")
    assert merged.start_time == min(part.start_time for part in (a, b, c))
    assert merged.end_time == max(part.end_time for part in (a, b, c))
    times = spread(merged)
    times = times[np.abs(times[:, None] - merged.breaks).min(axis=1) > 1e-9]
    for part, arm in ((a, "a"), (b, "b"), (c, "c")):
        alone = merged.select(arm)
        assert alone.joint_names == part.joint_names
        for derivative in range(3):
            assert np.allclose(alone(times, derivative), part(times, derivative), rtol=1e-9, atol=1e-9)


@given(trajectories(), st.floats(0.2, 5.0))
@settings(deadline=None, max_examples=60)
def test_stretching_takes_the_same_way_and_scales_the_rates(trajectory: Trajectory, factor: float) -> None:
    slow = trajectory.stretched(factor)
    assert np.isclose(slow.duration, factor * trajectory.duration)
    times = np.linspace(trajectory.start_time, trajectory.end_time, 37)[1:-1]
    times = times[np.abs(times[:, None] - trajectory.breaks).min(axis=1) > 1e-9]
    later = slow.start_time + factor * (times - trajectory.start_time)
    for derivative in range(4):
        expected = trajectory(times, derivative) / factor**derivative
        assert np.allclose(slow(later, derivative), expected, rtol=1e-8, atol=1e-8)


@given(trajectories(), st.floats(-3.0, 3.0))
@settings(deadline=None, max_examples=40)
def test_shifting_moves_the_clock_only(trajectory: Trajectory, seconds: float) -> None:
    later = trajectory.shifted(seconds)
    assert np.array_equal(later.coefficients, trajectory.coefficients)
    assert np.isclose(later.start_time, trajectory.start_time + seconds, atol=1e-12)


@pytest.mark.parametrize("factor", [1.0, 1.0 / 7.0, 3.0])
def test_positions_do_not_jump_at_times_since_1970(factor: float) -> None:
    """Breaks are rounded to a quarter of a microsecond there."""
    motion = Trajectory(("a/x",), [0.0, 1.0 / 3.0, 0.7], [[[0.0], [3.0]], [[1.0], [3.0]]])
    late = motion.shifted(1.7e9).stretched(factor)
    ends = late.coefficients[0] * np.array([[1.0], [late.breaks[1] - late.breaks[0]]])
    assert ends.sum() == pytest.approx(late.coefficients[1, 0, 0], abs=1e-12)


def test_rounded_times_can_be_shifted_back() -> None:
    far = Trajectory(("arm/x",), [1e12, 1e12 + 1.0], [[[0.0], [1.0]]])
    assert far.shifted(1.0).duration == 1.0
    assert far.shifted(-1e12).start_time == 0.0


@given(trajectories(), st.integers(1, 3))
@settings(deadline=None, max_examples=60)
def test_derivatives_agree_with_differences(trajectory: Trajectory, derivative: int) -> None:
    h = 1e-6
    times = np.linspace(trajectory.start_time, trajectory.end_time, 23)
    times = times[np.abs(times[:, None] - trajectory.breaks).min(axis=1) > 2 * h]
    slope = (trajectory(times + h, derivative - 1) - trajectory(times - h, derivative - 1)) / (2 * h)
    assert np.allclose(trajectory(times, derivative), slope, rtol=1e-5, atol=1e-5)


@given(trajectories(), st.floats(0.01, 2.0))
@settings(deadline=None, max_examples=60)
def test_sample_times_step_by_dt_and_end_exactly(trajectory: Trajectory, dt: float) -> None:
    times, positions = trajectory.sample(dt)
    assert times[0] == trajectory.start_time
    assert np.isclose(times[-1], trajectory.end_time, atol=1e-9)
    assert (np.diff(times) <= dt * (1 + 1e-9)).all()
    assert (np.diff(times) > 0).all()
    assert positions.shape == (len(times), len(trajectory.joint_names))


def test_outside_its_span_a_trajectory_rests() -> None:
    moving = Trajectory(("a/x",), [1.0, 2.0], [[[0.0], [1.0]]])
    assert moving([0.0, 3.0]).ravel().tolist() == [0.0, 1.0]
    assert moving([0.0, 3.0], 1).ravel().tolist() == [0.0, 0.0]
    assert moving(1.5).shape == (1,)
    assert moving(np.zeros((2, 3))).shape == (2, 3, 1)


def test_at_a_break_the_piece_that_begins_there_counts() -> None:
    bent = Trajectory(("a/x",), [0.0, 1.0, 2.0], [[[0.0], [1.0]], [[1.0], [-1.0]]])
    assert bent([0.0, 1.0, 2.0], 1).ravel().tolist() == [1.0, -1.0, -1.0]


def test_standing_still_can_take_time_or_none() -> None:
    for duration in (0.0, 2.0):
        still = Trajectory.rest(("a/x", "a/y"), [1.0, 2.0], start=0.5, duration=duration)
        assert still.duration == duration
        assert still(0.7).tolist() == [1.0, 2.0]
        assert still.sample(0.1)[1].shape[1] == 2
    assert Trajectory.rest(("a/x",), [1.0]).sample_times(0.1).tolist() == [0.0]


def test_one_who_stands_still_merges_with_one_who_moves() -> None:
    moving = Trajectory(("a/x",), [0.0, 1.0], [[[0.0], [0.0], [3.0], [-2.0]]])
    merged = Trajectory.merge(moving, Trajectory.rest(("b/x",), [5.0]))
    assert merged(0.5).tolist() == [0.5, 5.0]
    assert Trajectory.merge(Trajectory.rest(("a/x",), [1.0]), Trajectory.rest(("b/x",), [2.0])).duration == 0.0


def test_arrays_stay_read_only_through_pickling() -> None:
    still = Trajectory.rest(("a/x",), [1.0], duration=1.0)
    for one in (still, pickle.loads(pickle.dumps(still))):
        assert one.allclose(still, atol=0.0)
        for array in (one.breaks, one.coefficients):
            with pytest.raises(ValueError, match="read-only"):
                array.flat[0] = 9.0


@pytest.mark.parametrize(
    ("breaks", "coefficients", "message"),
    [
        ([0.0, 0.0], [[[0.0]]], r"breaks\[1\] = 0.0 is not after"),
        ([1.0, 0.0], [[[0.0]]], "is not after"),
        ([0.0, 1.0, 2.0], [[[0.0]]], "do not fit"),
        ([], [[[0.0]]], "do not fit"),
        ([0.0, 1.0], np.zeros((1, 0, 1)), "do not fit"),
        ([0.0, np.inf], [[[0.0]]], "is inf"),
        ([0.0, 1.0], [[[np.nan]]], "is nan"),
        ([0.0, 1.0], [[[0.0, 1.0]]], "shape"),
    ],
)
def test_what_is_no_trajectory_is_refused(breaks: object, coefficients: object, message: str) -> None:
    with pytest.raises(InputError, match=message):
        Trajectory(("a/x",), breaks, coefficients)


def test_wrong_calls_are_refused() -> None:
    still = Trajectory.rest(("left/x",), [1.0], duration=1.0)
    with pytest.raises(UnknownNameError, match="Did you mean 'left'"):
        still.select("lef")
    with pytest.raises(InputError, match="'left/x' twice"):
        Trajectory.merge(still, still)
    with pytest.raises(InputError, match="no trajectories"):
        Trajectory.merge()
    for factor in (0.0, -1.0, float("nan")):
        with pytest.raises(InputError, match="factor"):
            still.stretched(factor)
        with pytest.raises(InputError, match="dt"):
            still.sample(factor)
    with pytest.raises(InputError, match="not finite"):
        still(float("nan"))
    for one, factor in ((still, 1e-300), (Trajectory.rest(("left/x",), [1.0], start=5.0, duration=1.0), 1e-17)):
        moving = Trajectory(one.joint_names, one.breaks, [[[0.0], [1.0], [2.0]]])
        with pytest.raises(InputError, match="factor is 1e-"):
            moving.stretched(factor)
    with pytest.raises(InputError, match="duration is -1"):
        Trajectory.rest(("left/x",), [1.0], duration=-1.0)
    for seconds in (1e17, -1e12):
        with pytest.raises(InputError, match="which rounds times to"):
            still.shifted(seconds)


def test_a_trusted_trajectory_is_what_the_constructor_makes() -> None:
    breaks, coefficients = np.array([0.0, 1.0]), np.array([[[0.0], [1.0]]])
    trusted = Trajectory.trusted(("a/x",), breaks, coefficients)
    assert trusted.allclose(Trajectory(("a/x",), breaks, coefficients), atol=0.0)
    with pytest.raises(ValueError, match="read-only"):
        trusted.coefficients[0, 0, 0] = 1.0
    assert pickle.loads(pickle.dumps(trusted)).allclose(trusted, atol=0.0)


def test_a_factor_may_be_a_whole_number() -> None:
    moving = Trajectory(("a/x",), [0.0, 1.0], [[[0.0], [1.0]]])
    assert moving.stretched(2).allclose(moving.stretched(2.0), atol=0.0)


@pytest.mark.parametrize("wrong", [None, "long", [1.0, 2.0], {}, float("nan")])
def test_numbers_that_are_none_are_named(wrong: Any) -> None:
    moving = Trajectory(("a/x",), [0.0, 1.0], [[[0.0], [1.0]]])
    for name, call in (
        ("factor", moving.stretched),
        ("seconds", moving.shifted),
        ("dt", moving.sample),
        ("derivative", lambda value: moving(0.5, value)),
        ("q", lambda value: Trajectory.rest(("a/x",), value)),
        ("duration", lambda value: Trajectory.rest(("a/x",), [0.0], start=0.0, duration=value)),
        ("joint_names", lambda value: Trajectory(value, [0.0, 1.0], [[[0.0], [1.0]]])),
    ):
        if name == "joint_names" and isinstance(wrong, list | dict):
            continue
        with pytest.raises(InputError, match=name):
            call(wrong)


def test_times_and_parts_of_the_wrong_kind_are_named() -> None:
    moving = Trajectory(("a/x",), [0.0, 1.0], [[[0.0], [1.0]]])
    for wrong in ("soon", {}, [[0.0], [1.0, 2.0]]):
        with pytest.raises(InputError, match="t is "):
            moving(wrong)
    assert moving([]).shape == (0, 1)
    for part in (None, 3, [moving]):
        with pytest.raises(InputError, match="part to merge"):
            Trajectory.merge(moving, part)


# ---- from samples ----------------------------------------------------------------------------


@pytest.mark.parametrize("carried", [1, 2, 3])
def test_samples_are_met_with_all_they_carry_and_scipy_agrees_between_them(carried: int) -> None:
    rng = np.random.default_rng(carried)
    times = np.cumsum(rng.uniform(0.05, 1.0, 6))
    samples = [rng.normal(size=(6, 3)) for _ in range(carried)]
    made = Trajectory.from_samples(("a/x", "a/y", "b/z"), times, *samples)
    assert made.degree == 2 * carried - 1
    for order, values in enumerate(samples):
        np.testing.assert_allclose(made(times[:-1], order), values[:-1], atol=1e-12)
        before = made(np.nextafter(times[1:], 0.0), order)
        np.testing.assert_allclose(before, values[1:], atol=1e-9)
    slow = BPoly.from_derivatives(times, np.stack(samples, axis=1))
    between = np.linspace(times[0], times[-1], 101)[:-1]
    np.testing.assert_allclose(made(between), slow(between), atol=1e-9)


def test_one_sample_is_a_motion_of_no_duration() -> None:
    still = Trajectory.from_samples(["a/x"], [2.0], [[0.5]], [[0.0]], [[0.0]])
    assert still.duration == 0.0
    np.testing.assert_array_equal(still(2.0), [0.5])


@pytest.mark.parametrize(
    ("samples", "message"),
    [
        (([], np.zeros((0, 1))), "at least one sample"),
        (([0.0, 1.0], [[0.0]]), r"q has shape \(1, 1\), expected \(2, 1\)"),
        (([0.0, 1.0], [[0.0], [1.0]], [[0.0]]), "qd has shape"),
        (([0.0, 1.0], [[0.0], [np.nan]]), "q.*finite"),
        (([0.0, np.inf], [[0.0], [1.0]]), "times.*finite"),
        (([0.0, 0.0], [[0.0], [1.0]]), r"times do not strictly increase: times\[1\] = 0.0 after 0.0"),
        (([1.0, 0.0], [[0.0], [1.0]]), "strictly increase"),
        (([0.0, 1.0], [[0.0], [1.0]], None, [[0.0], [0.0]]), "accelerations without velocities"),
        (([0.0, 1e-200], [[0.0], [1.0]], [[0.0], [1.0]]), "samples 0 and 1.*overflow"),
        (("now", [[0.0]]), "times is not an array of numbers"),
    ],
)
def test_samples_that_make_no_motion_are_refused(samples: tuple[Any, ...], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Trajectory.from_samples(["a/x"], *samples)


@pytest.mark.parametrize(("begin", "end"), [(0.3, 1.7), (0.0, 2.0), (-1.0, 0.5), (1.2, 5.0), (0.7, 0.7), (3.0, 4.0)])
def test_a_cut_is_the_same_motion_between_two_times(begin: float, end: float) -> None:
    whole = Trajectory.from_samples(["a/x"], [0.0, 1.0, 2.0], [[0.0], [1.0], [0.5]], [[0.0], [0.4], [0.0]])
    part = whole.cut(begin, end)
    assert (part.start_time, part.end_time) == (begin, end)
    at = np.linspace(begin, end, 50)
    np.testing.assert_allclose(part(at), whole(at), atol=1e-14)
    np.testing.assert_allclose(part(at[1:-1], 1), whole(at[1:-1], 1), atol=1e-13)
    with pytest.raises(InputError, match="before"):
        whole.cut(begin, begin - 0.1)


def test_a_shift_drops_pieces_that_rounding_leaves_no_time() -> None:
    begin = 0.1
    breaks = [begin, np.nextafter(begin, 1.0), 1.0]
    motion = Trajectory(("arm/a",), breaks, np.array([[[0.0], [1.0]], [[0.0], [1.0]]]))
    later = motion.shifted(1.0)
    np.testing.assert_allclose(later.breaks, [1.1, 2.0])
    np.testing.assert_allclose(later(1.6), motion(0.6), atol=1e-12)
    assert Trajectory(("arm/a",), breaks[:2], motion.coefficients[:1]).shifted(1.0).duration == 0.0


@pytest.mark.parametrize("factor", [0.3, 0.9, 7.1])
def test_a_stretch_drops_pieces_that_rounding_leaves_no_time(factor: float) -> None:
    one = Trajectory(("a/j",), [0.1, 0.7, 2.0], [[[0.0], [1.0]], [[0.6], [-1.0]]])
    other = Trajectory(("b/j",), np.nextafter(one.breaks, 9.0), one.coefficients)
    merged = Trajectory.merge(one, other)
    stretched = merged.stretched(factor)
    times = np.linspace(0.0, 2.5, 40)
    np.testing.assert_allclose(stretched(0.1 + (times - 0.1) * factor), merged(times), atol=1e-12)
