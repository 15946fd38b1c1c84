from __future__ import annotations

import numba
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from rr1plan._kernels.cover import CYLINDER, HALF_SPACE, ROUNDED_BOX
from rr1plan._kernels.jit import OUT1
from rr1plan._kernels.lanes import WIDTH, below, floor, greater, least, lesser, load, most, root, size_of, store
from rr1plan._kernels.obstacles import approach_to, square_to
from rr1plan._kernels.placing import FARTHEST, sine_cosine
from rr1plan._kernels.tables import floats, whole

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


@numba.njit(numba.void(floats(17), whole(2), OUT1, OUT1, OUT1))
def measure(values, kinds, points, velocities, out):
    x, y, z = load(points, 0), load(points, WIDTH), load(points, 2 * WIDTH)
    u, v, w = load(velocities, 0), load(velocities, WIDTH), load(velocities, 2 * WIDTH)
    store(out, 0, square_to(values, kinds, 0, x, y, z))
    store(out, WIDTH, approach_to(values, kinds, 0, x, y, z, u, v, w))


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


def reference_distance(kind, half, p):
    if kind == HALF_SPACE:
        return max(p[2], 0.0)
    if kind == CYLINDER:
        return np.hypot(max(np.hypot(p[0], p[1]) - half[0], 0.0), max(abs(p[2]) - half[2], 0.0))
    return np.linalg.norm(np.maximum(np.abs(p) - half, 0.0))


@settings(deadline=None, max_examples=200)
@given(st.integers(0, 2**32), st.sampled_from([ROUNDED_BOX, CYLINDER, HALF_SPACE]), st.floats(1e-4, 0.3))
def test_a_moving_point_keeps_the_distance_that_the_bound_says(seed, kind, h):
    rng = np.random.default_rng(seed)
    R = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    centre, half, low = rng.normal(size=3), rng.uniform(0.0, 0.5, 3), -np.inf
    turn = R.copy()
    if kind == HALF_SPACE:
        half[:], turn[:, :2] = 0.0, 0.0
    else:
        low = -half[2]
    values = np.array([[*turn.ravel(), *centre, *half, 0.0, low]])
    points, velocities, out = rng.normal(size=(3, WIDTH)), rng.normal(size=(3, WIDTH)), np.empty(2 * WIDTH)
    measure(values, np.array([[kind, 1]]), points.ravel(), velocities.ravel(), out)
    for i in range(WIDTH):
        distance = reference_distance(kind, half, R.T @ (points[:, i] - centre))
        assert abs(np.sqrt(out[i]) - distance) < 1e-12
        for time in np.linspace(-h, h, 7):
            later = reference_distance(kind, half, R.T @ (points[:, i] + time * velocities[:, i] - centre))
            if distance > 1e-6:
                assert later >= distance - out[WIDTH + i] / distance * abs(time) - 1e-9
