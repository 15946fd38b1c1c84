from __future__ import annotations

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rr1plan._kernels.jit import I64, INT1
from rr1plan._kernels.record import pack, reader
from rr1plan._kernels.tables import floats, small, whole

KIND = numba.types.Tuple((floats(3), whole(2), small(), floats()))
read = reader(KIND)


@numba.njit(numba.void(I64, I64, I64, numba.float64, INT1), _nrt=False)
def move(row, column, i, value, record):
    numbers, counts, few, line = read(record)
    line[i] = numbers[row, column] + counts[row, 1] * few[i]
    numbers[row, column] = value
    counts[row, 1] = i
    few[i] = row


def tables(rows, seed=0):
    rng = np.random.default_rng(seed)
    counts = rng.integers(-(2**40), 2**40, (rows, 2))
    return rng.normal(size=(rows, 3)), counts, rng.integers(-99, 99, rows).astype(np.int16), np.zeros(rows)


@settings(deadline=None, max_examples=50)
@given(st.integers(1, 20), st.data())
def test_elements_are_those_of_the_arrays(rows, data):
    row, i = data.draw(st.integers(0, rows - 1)), data.draw(st.integers(0, rows - 1))
    column, seed = data.draw(st.integers(0, 2)), data.draw(st.integers(0, 2**32))
    given_, expected = tables(rows, seed), tables(rows, seed)
    move(row, column, i, 0.5, pack(given_, KIND))
    numbers, counts, few, line = expected
    line[i] = numbers[row, column] + counts[row, 1] * float(few[i])
    numbers[row, column], counts[row, 1], few[i] = 0.5, i, row
    for one, other in zip(given_, expected, strict=True):
        np.testing.assert_array_equal(one, other)


def test_a_table_of_other_columns_is_refused():
    numbers, counts, few, line = tables(4)
    with pytest.raises(TypeError, match="2 columns"):
        pack((np.ascontiguousarray(numbers[:, :2]), counts, few, line), KIND)
