from __future__ import annotations

import gc

import numba
import numpy as np
from numba.core import types

from rr1plan.code_units import lower_part, sooner, unit_compiler


def norm(values):
    total = 0.0
    for value in values:
        total += max(value, -value) * max(value, -value)
    return np.sqrt(total) + max(0.0, len(values) * 0.0)


def compiled(function):
    made = numba.njit(pipeline_class=unit_compiler())(function)
    made.compile((numba.float64[::1],))
    return made


def test_what_is_compiled_sooner_is_the_same():
    ask = types.BaseFunction.get_call_type
    plain = compiled(norm)
    with sooner():
        quick = compiled(norm)
        with sooner():
            nested = compiled(norm)
    values = np.random.default_rng(0).normal(size=50)
    assert plain(values) == quick(values) == nested(values)
    assert plain.signatures == quick.signatures
    assert types.BaseFunction.get_call_type is ask
    assert gc.isenabled()


def test_calls_are_asked_about_once_for_each_function_that_is_compiled(monkeypatch):
    asked = []
    real = types.BaseFunction.get_call_type

    def count(self, context, arguments, keywords):
        asked.append((self, tuple(arguments)))
        return real(self, context, arguments, keywords)

    monkeypatch.setattr(types.BaseFunction, "get_call_type", count)
    lower_part(norm, {}, (numba.float64[::1],))
    plain = len(asked)
    asked.clear()
    with sooner():
        lower_part(norm, {}, (numba.float64[::1],))
        once = len(asked)
        lower_part(norm, {"fastmath": True}, (numba.float64[::1],))
    assert len(set(asked[:once])) == once < plain
    # Other options may choose other code.
    assert len(asked) > once


def test_garbage_is_collected_again_after_an_error():
    try:
        with sooner():
            assert not gc.isenabled()
            raise ValueError
    except ValueError:
        assert gc.isenabled()
