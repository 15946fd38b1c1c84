# mypy: disable-error-code="no-untyped-def,no-untyped-call,misc,no-any-return,attr-defined"
"""Many tables as one argument: their addresses in an array of numbers.

A call with fifty arrays costs microseconds from Python, and a tenth of one between kernels, because each array is
handed over with its shape. Here shapes and addresses are written down once; `places.py` tells how they are read.
"""

from __future__ import annotations

import struct
from array import array
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
from numba.core import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from rr1plan.places import Place, layout, read


def reader(kind: Any) -> Callable[..., Any]:
    """An intrinsic that gives kernels back what `pack` wrote down.

    What is read lives no longer than the record.

    Args:
        kind: Numba's type of it: a tuple of arrays, numbers, tuples and places of tuples, or such a place.
    """

    @intrinsic
    def read_record(typing_context, record):
        def lower(context, builder, sig, args):
            data = context.make_array(sig.args[0])(context, builder, args[0]).data
            return read(context, builder, kind, builder.bitcast(data, layout(context, kind).as_pointer()))

        return kind(record), lower

    return read_record


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
    for part, its_kind in zip(_parts(value), _leaves(kind), strict=True):
        if its_kind.dimensions is not None:
            words += _shape_and_address(part, its_kind)
        elif its_kind.is_float:
            words.append(struct.unpack("q", struct.pack("d", part))[0])
        else:
            words.append(int(part))
    # An array keeps what it is a view of.
    return np.asarray(_Owner(np.frombuffer(array("q", words), np.int64), value))


class _Leaf(NamedTuple):
    """What is no tuple: an array of so many dimensions, and columns where these are known; or (None) a number."""

    kind: Any
    dtype: np.dtype[Any] | None = None
    dimensions: int | None = None
    columns: int | None = None
    is_float: bool = False


# By identity: numba's types take long to compare. They are kept, so that no other one gets the same.
_known: dict[int, tuple[Any, tuple[_Leaf, ...]]] = {}


def _leaves(kind: Any) -> tuple[_Leaf, ...]:
    """What numba lays out of a kind, one after the other, all of it eight bytes wide."""
    if id(kind) not in _known:
        _known[id(kind)] = kind, tuple(_each_leaf(kind))
    return _known[id(kind)][1]


def _each_leaf(kind: Any) -> Iterator[_Leaf]:
    if isinstance(kind, Place):
        yield from _each_leaf(kind.kind)
    elif isinstance(kind, types.BaseTuple):
        for part in kind:
            yield from _each_leaf(part)
    elif isinstance(kind, types.Array):
        yield _Leaf(kind, np.dtype(kind.dtype.name), kind.ndim, getattr(kind, "columns", None))
    else:
        yield _Leaf(kind, is_float=isinstance(kind, types.Float))


def _parts(value: Any) -> Iterator[Any]:
    """What is in tuples, and in those in them."""
    for part in value:
        if isinstance(part, tuple):
            yield from _parts(part)
        else:
            yield part


def _shape_and_address(part: NDArray[Any], leaf: _Leaf) -> tuple[int, ...]:
    if part.dtype != leaf.dtype or part.ndim != leaf.dimensions or not part.flags.c_contiguous:
        raise TypeError(f"an array of {part.dtype} and shape {part.shape} is no {leaf.kind}")
    if leaf.columns is not None and part.shape[1] != leaf.columns:
        raise TypeError(f"an array of {part.shape[1]} columns is no {leaf.kind}")
    # Nobody owns it, as far as kernels know. Numpy's own `ctypes.data` takes five times as long.
    address = part.__array_interface__["data"][0]
    return (0, 0, part.size, part.itemsize, address, *part.shape, *part.strides)
