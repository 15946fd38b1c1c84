# mypy: disable-error-code="no-untyped-def,no-untyped-call,misc,no-any-return,attr-defined"
"""Many tables as one argument: their addresses in an array of numbers.

A call with fifty arrays costs microseconds from Python, and a tenth of one between kernels, because each array is
handed over with its shape. Here shapes and addresses are written down once.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from numba.core import types
from numba.extending import intrinsic
from numpy.typing import NDArray


def reader(kind: Any) -> Callable[..., Any]:
    """An intrinsic that gives kernels back what `pack` wrote down.

    What is read lives no longer than the record.

    Args:
        kind: Numba's type of it: a tuple of arrays, numbers and tuples.
    """

    @intrinsic
    def read(typing_context, record):
        def lower(context, builder, sig, args):
            data = context.make_array(sig.args[0])(context, builder, args[0]).data
            return builder.load(builder.bitcast(data, context.get_value_type(kind).as_pointer()))

        return kind(record), lower

    return read


class _Owner:
    """Memory of a record, and what it tells of."""

    def __init__(self, words: NDArray[np.int64], value: Any) -> None:
        self.words, self.value = words, value
        self.__array_interface__ = words.__array_interface__


def pack(value: Any, kind: Any) -> NDArray[np.int64]:
    """Write down where the arrays of a tuple are; they live as long as the record.

    Args:
        value: The tuple.
        kind: Numba's type of it.

    Returns:
        The record, shape (k,).
    """
    words: list[int] = []
    _append(words, value, kind)
    # An array keeps what it is a view of.
    return np.asarray(_Owner(np.array(words, np.int64), value))


def _append(words: list[int], value: Any, kind: Any) -> None:
    """Add the fields of a value as numba lays them out, all eight bytes wide."""
    if isinstance(kind, types.BaseTuple):
        for part, its_kind in zip(value, kind, strict=True):
            _append(words, part, its_kind)
    elif isinstance(kind, types.Array):
        if value.dtype != _dtype_of(kind) or value.ndim != kind.ndim or not value.flags.c_contiguous:
            raise TypeError(f"an array of {value.dtype} and shape {value.shape} is no {kind}")
        if kind.ndim == 2 and getattr(kind, "columns", value.shape[1]) != value.shape[1]:
            raise TypeError(f"an array of {value.shape[1]} columns is no {kind}")
        # Nobody owns it, as far as kernels know. Numpy's own `ctypes.data` takes five times as long.
        address = value.__array_interface__["data"][0]
        words += (0, 0, value.size, value.itemsize, address, *value.shape, *value.strides)
    elif isinstance(kind, types.Float):
        words.append(struct.unpack("q", struct.pack("d", value))[0])
    else:
        words.append(int(value))


@cache
def _dtype_of(kind: Any) -> np.dtype[Any]:
    return np.dtype(kind.dtype.name)
