from __future__ import annotations

import gc

import numba
import numpy as np
import pytest

from rr1plan._kernels.jit import FLOATS1, I64, INT2, INTS1, OUT2
from rr1plan._kernels.record import pack, reader

KIND = numba.types.Tuple((OUT2, numba.types.Tuple((numba.float64, INTS1)), INT2, FLOATS1, I64))
read = reader(KIND)


@numba.njit(_nrt=False)
def add_up(record):
    matrix, (number, row), table, empty, count = read(record)
    total = number + count + empty.shape[0]
    for i in range(matrix.shape[0]):
        for j in range(matrix.shape[1]):
            total += matrix[i, j] * table[i, j]
    for k in row:
        total += 1000.0 * k
    matrix[0, 0] = -1.0
    return total


def sample():
    rng = np.random.default_rng(0)
    return rng.normal(size=(3, 4)), (0.25, np.arange(5)), rng.integers(0, 9, (3, 4)), np.zeros(0), 7


def test_kernels_read_and_write_the_very_arrays():
    value = sample()
    expected = (value[0] * value[2]).sum() + 0.25 + 7 + 10_000.0
    assert add_up(pack(value, KIND)) == pytest.approx(expected)
    assert value[0][0, 0] == -1.0


def test_a_record_keeps_its_arrays_alive():
    record = pack(sample(), KIND)
    expected = add_up(pack(sample(), KIND))
    gc.collect()
    _ = [np.full((3, 4), 9.0) for _ in range(50)]
    assert add_up(record) == pytest.approx(expected)


@pytest.mark.parametrize("wrong", [np.zeros((3, 4), np.float32), np.zeros((4, 3)).T, np.zeros(3)])
def test_an_array_of_another_kind_is_refused(wrong):
    with pytest.raises(TypeError, match="is no"):
        pack((wrong, *sample()[1:]), KIND)
