from __future__ import annotations

from typing import Any, NamedTuple

import numba
import numpy as np
import pytest

from rr1plan._kernels.jit import F64, FLOATS1, INT1, INTS2, OUT2
from rr1plan._kernels.record import pack, reader
from rr1plan.places import Place, place, placed


class Pair(NamedTuple):
    matrix: Any
    inner: Any
    row: Any
    number: Any


PLACE = place([OUT2, numba.types.UniTuple(F64, 2), FLOATS1, F64], Pair)
KIND = numba.types.Tuple((PLACE, INTS2, F64))
read = reader(KIND)
read_pair = reader(PLACE)


def sample() -> tuple[Pair, np.ndarray, float]:
    rng = np.random.default_rng(0)
    return Pair(rng.normal(size=(2, 3)), (3.0, 5.0), rng.normal(size=4), 7.0), rng.integers(0, 9, (2, 2)), 0.5


@numba.njit
def last_of(pair):
    pair.matrix[0, 0] += 1.0
    return pair.row[-1] + 10.0 * pair.number + pair.inner[1]


@numba.njit
def from_record(record):
    pair, table, number = read(record)
    return last_of(pair) + pair.matrix.sum() + table[1, 0] + number + len(pair.row)


def expected(value: tuple[Pair, np.ndarray, float]) -> float:
    pair, table, number = value
    return float(pair.row[-1] + 75.0 + pair.matrix.sum() + table[1, 0] + number + 4)


def test_fields_are_read_where_they_are_used_and_written_through():
    value = sample()
    before = value[0].matrix[0, 0]
    result = from_record(pack(value, KIND))
    assert value[0].matrix[0, 0] == before + 1.0
    assert result == pytest.approx(expected(value))


def test_a_record_may_be_one_place():
    @numba.njit
    def number_of(record):
        return read_pair(record).number

    assert number_of(pack(sample()[0], PLACE)) == 7.0


def test_a_tuple_may_be_put_into_memory_by_compiled_code():
    @numba.njit
    def work(pair):
        at = placed(pair)
        return last_of(at) + at.matrix[0, 0]

    pair, _, _ = sample()
    assert work(pair) == pytest.approx(pair.row[-1] + 75.0 + pair.matrix[0, 0])


def test_a_field_that_is_not_there_is_told():
    @numba.njit
    def other(record):
        return read_pair(record).column

    with pytest.raises(numba.TypingError, match="column"):
        other(np.zeros(9, np.int64))


def test_places_of_other_tuples_are_other_types():
    assert place([F64, F64, F64, F64], Pair) != PLACE
    assert Place(PLACE.kind, False) != PLACE
    assert Place(PLACE.kind, True) == PLACE
    assert INT1 != PLACE
