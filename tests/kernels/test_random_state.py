"""Random numbers against the published ones of SplitMix64, and tests of the uniform distribution."""

from __future__ import annotations

import numpy as np

from rr1plan.kernels.planner_kernels import load_library
from rr1plan.kernels.random_state import draw_uniform, random_state


def test_the_numbers_are_those_of_splitmix64():
    state = random_state(0)
    published = [0xE220A8397B1DCDAF, 0x6E789E6AA1B965F4, 0x06C45D188009454F]
    assert [draw_uniform(state) for _ in published] == [(x >> 11) * 2.0**-53 for x in published]


def test_numbers_fill_the_unit_interval_evenly():
    state = random_state(7)
    numbers = np.array([draw_uniform(state) for _ in range(20_000)])
    assert numbers.min() >= 0.0
    assert numbers.max() < 1.0
    counts = np.histogram(numbers, bins=20, range=(0.0, 1.0))[0]
    assert np.abs(counts - 1000).max() < 160  # five standard deviations


def test_integers_come_from_the_whole_range_and_no_farther():
    state = random_state(3)
    assert {load_library().rr1_draw_index(state, 5) for _ in range(500)} == set(range(5))


def test_a_side_without_extent_keeps_its_value_to_the_bit():
    state, out = random_state(1), np.empty(2)
    lower, extent = np.array([0.1, -0.3]), np.array([0.0, 2.0])
    for _ in range(50):
        load_library().rr1_draw_in_box(state, lower, extent, 2, out)
        assert out[0] == 0.1
        assert -0.3 <= out[1] < 1.7
