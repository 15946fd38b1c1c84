from __future__ import annotations

import numba
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from rr1plan._kernels.cover import CYLINDER, HALF_SPACE, ROUNDED_BOX
from rr1plan._kernels.lanes import WIDTH, below, floor, greater, least, lesser, load, most, root, size_of, store
from rr1plan._kernels.obstacles import approach_to, gap_to, within
from rr1plan._kernels.placing import FARTHEST, sine_cosine

numbers = st.lists(st.floats(-1e3, 1e3), min_size=WIDTH, max_size=WIDTH).map(np.array)


@numba.njit(error_model="numpy")
def work_out(a, b, out):
    x, y = load(a, 0), load(b, 0)
    results = (x + y, x - y, x * y, x / (size_of(y) + 1.0), root(size_of(x)), floor(x), lesser(x, y), greater(x, 0.5))
    for k, value in enumerate(results):
        store(out, k * WIDTH, value)
    return below(x, y), least(x), most(x)


@numba.njit
def turn(angles, out):
    s, c = sine_cosine(load(angles, 0))
    store(out, 0, s)
    store(out, WIDTH, c)


@numba.njit
def measure(values, kinds, points, velocities, limit, out):
    x, y, z = load(points, 0), load(points, WIDTH), load(points, 2 * WIDTH)
    u, v, w = load(velocities, 0), load(velocities, WIDTH), load(velocities, 2 * WIDTH)
    store(out, 0, gap_to(values, kinds, 0, x, y, z))
    store(out, WIDTH, approach_to(values, kinds, 0, x, y, z, u, v, w))
    return within(values, kinds, 0, x, y, z, load(limit, 0))


@settings(deadline=None, max_examples=100)
@given(numbers, numbers)
def test_lanes_calculate_as_numpy_does(a, b):
    out = np.empty(8 * WIDTH)
    bits, low, high = work_out(a, b, out)
    expected = [a + b, a - b, a * b, a / (abs(b) + 1), np.sqrt(abs(a)), np.floor(a), np.minimum(a, b), np.fmax(a, 0.5)]
    assert np.allclose(out.reshape(8, WIDTH), expected, rtol=1e-15, atol=1e-300)
    assert bits == sum(int(x < y) << i for i, (x, y) in enumerate(zip(a, b, strict=True)))
    assert (low, high) == (a.min(), a.max())


@settings(deadline=None, max_examples=300)
@given(st.lists(st.floats(-FARTHEST, FARTHEST) | st.floats(-7, 7), min_size=WIDTH, max_size=WIDTH))
def test_sine_and_cosine_are_within_their_bound(angles):
    out = np.empty(2 * WIDTH)
    turn(np.array(angles), out)
    assert np.abs(out[:WIDTH] - np.sin(angles)).max() <= 1e-13
    assert np.abs(out[WIDTH:] - np.cos(angles)).max() <= 1e-13


def reference_gap(kind, half, radius, p):
    if kind == HALF_SPACE:
        return p @ half - radius
    if kind == CYLINDER:
        return np.hypot(max(np.hypot(p[0], p[1]) - half[0], 0.0), max(abs(p[2]) - half[2], 0.0))
    return np.linalg.norm(np.maximum(np.abs(p) - half, 0.0)) - radius


@settings(deadline=None, max_examples=200)
@given(st.integers(0, 2**32), st.sampled_from([ROUNDED_BOX, CYLINDER, HALF_SPACE]), st.floats(1e-4, 0.3))
def test_a_moving_point_keeps_the_distance_that_the_bound_says(seed, kind, h):
    rng = np.random.default_rng(seed)
    R = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    centre, half = rng.normal(size=3), rng.uniform(0.0, 0.5, 3)
    radius = rng.uniform(0.0, 0.2) if kind != CYLINDER else 0.0
    if kind == HALF_SPACE:
        half, R, centre = half / np.linalg.norm(half), np.eye(3), np.zeros(3)
    values = np.array([[*R.ravel(), *centre, *half, radius]])
    points, velocities = rng.normal(size=(3, WIDTH)), rng.normal(size=(3, WIDTH))
    limit, out = rng.uniform(0.01, 2.0, WIDTH), np.empty(2 * WIDTH)
    bits = measure(values, np.array([[kind, 1]]), points.ravel(), velocities.ravel(), limit, out)
    for i in range(WIDTH):
        gap = reference_gap(kind, half, radius, R.T @ (points[:, i] - centre))
        assert abs(out[i] - gap) < 1e-12
        assert (bits >> i & 1) == (gap < limit[i])
        for time in np.linspace(-h, h, 7):
            later = reference_gap(kind, half, radius, R.T @ (points[:, i] + time * velocities[:, i] - centre))
            if gap > 1e-6:
                assert later >= gap - out[WIDTH + i] * abs(time) - 1e-9
