"""The one way to compile: explicit signatures, strict floating point, cached on disk where that is possible.

The cache looks at the file of a kernel, not at the files of the kernels it calls: whoever edits
`separation.py` touches `motion.py` too.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numba

F = TypeVar("F", bound=Callable[..., Any])

# C arrays that a kernel only reads; an array that may be written is accepted too.
FLOATS1 = numba.types.Array(numba.float64, 1, "C", readonly=True)
FLOATS2 = numba.types.Array(numba.float64, 2, "C", readonly=True)
FLOATS3 = numba.types.Array(numba.float64, 3, "C", readonly=True)
INTS1 = numba.types.Array(numba.int64, 1, "C", readonly=True)
INTS2 = numba.types.Array(numba.int64, 2, "C", readonly=True)
# C arrays that a kernel writes.
OUT1 = numba.float64[::1]
OUT2 = numba.float64[:, ::1]
INT1 = numba.int64[::1]
INT2 = numba.int64[:, ::1]
OUT3 = numba.float64[:, :, ::1]
F64 = numba.float64
I64 = numba.int64


def jit(signature: Any, *, inline: bool = False, allocates: bool = True) -> Callable[[F], F]:
    """Compile a function for one signature.

    No fastmath: a bound that rounds another way is no bound.

    Args:
        signature: Numba's types of result and arguments.
        inline: Compile it into each of its callers.
        allocates: It makes arrays. Without, no references to arrays are counted, which costs more than the
            arithmetic of short functions that pass many on.
    """

    def compiled(function: F) -> F:
        options = {"nogil": True, "fastmath": False, "error_model": "numpy", "forceinline": inline, "_nrt": allocates}
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
