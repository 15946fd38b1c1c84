"""How the referee compiles its loops: strict floating point, one cached function for each entry.

The referee shares no code with the planners' kernels, not even this. Only entries are cached on disk; the
parts they call are compiled into them, so a new process loads one file for each entry. The cache looks at
the file of an entry alone: whoever edits a part touches the files of the entries that use it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numba

F = TypeVar("F", bound=Callable[..., Any])

# C arrays that an entry only reads.
FLOATS1, FLOATS2, FLOATS3 = (numba.types.Array(numba.float64, n, "C", readonly=True) for n in (1, 2, 3))
INTS1, INTS2 = (numba.types.Array(numba.int64, n, "C", readonly=True) for n in (1, 2))
# C arrays that an entry writes.
OUT1, OUT2, OUT3 = numba.float64[::1], numba.float64[:, ::1], numba.float64[:, :, ::1]
COUNT1, COUNT2 = numba.int64[::1], numba.int64[:, ::1]
F64, I64 = numba.float64, numba.int64


def entry(signature: Any) -> Callable[[F], F]:
    """Compile a function for one signature, or take it from the cache."""

    def compiled(function: F) -> F:
        options = {"nogil": True, "error_model": "numpy"}
        try:
            made = numba.njit(signature, cache=True, **options)(function)
        except RuntimeError as error:
            # No folder to cache in: installed read-only and without a home.
            if "cannot cache" not in str(error):
                raise
            made = numba.njit(signature, **options)(function)
        result: F = made
        return result

    return compiled


def part(function: F) -> F:
    """A function that entries call; it makes no arrays."""
    made: F = numba.njit(nogil=True, error_model="numpy", _nrt=False)(function)
    return made


def largest(function: F) -> F:
    """A part that looks for a largest value: no NaN comes in, so its comparisons may be done side by side."""
    made: F = numba.njit(nogil=True, error_model="numpy", _nrt=False, fastmath={"nnan", "nsz"})(function)
    return made
