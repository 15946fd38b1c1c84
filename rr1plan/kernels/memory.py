"""C structs filled with the addresses of arrays, which live as long as they do."""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rr1plan.kernels.library import declared_structs, struct_classes
from rr1plan.kernels.structs import item_size

# Vectors across two lines of the processor's cache take twice as long.
_LINE = 64
_DTYPES = {"double": np.float64, "int64_t": np.int64, "uint64_t": np.uint64, "int16_t": np.int16}


class CStruct:
    """A C struct, and all arrays its pointers lead to.

    Args:
        name: Its name in the headers.
        fields: Values of its fields: numbers; for pointers C arrays, or other structs. Those left out are zero.

    Attributes:
        value: The struct itself.
        address: Where it is.
        arrays: The arrays that its pointers lead to.

    Raises:
        TypeError: an array that is not what the headers say.
    """

    def __init__(self, name: str, **fields: Any) -> None:
        self.name = name
        self.value = struct_classes()[name]()
        self.address = ctypes.addressof(self.value)
        self.arrays: list[NDArray[Any]] = []
        self._structs: list[CStruct] = []
        declared = {field.name: field for field in declared_structs()[name]}
        for key, given in fields.items():
            field = declared[key]
            if not field.pointer:
                setattr(self.value, key, given)
                continue
            (self._structs if isinstance(given, CStruct) else self.arrays).append(given)
            setattr(self.value, key, address_of(given, field.kind))


def address_of(given: CStruct | NDArray[Any], kind: str) -> int:
    """Address of a struct or an array, to be kept alive by the caller.

    Args:
        given: It.
        kind: The C type of what is there: a struct each of whose items is a row of the array, or a kind of number.

    Raises:
        TypeError: it is not of that kind.
    """
    if isinstance(given, CStruct):
        if given.name != kind:
            raise TypeError(f"a {given.name} is no {kind}")
        return given.address
    if not given.flags.c_contiguous:
        raise TypeError(f"an array for {kind} is not C-contiguous")
    if kind in _DTYPES:
        if given.dtype != _DTYPES[kind]:
            raise TypeError(f"an array of {given.dtype} is no array of {kind}")
    else:
        row = given.itemsize * (given.shape[1] if given.ndim == 2 else 1)
        size = item_size(kind, struct_classes())
        if row != size:
            raise TypeError(f"rows of {row} bytes are no {kind}, which takes {size}")
    address: int = given.__array_interface__["data"][0]
    return address


def zeroed(kind: str, count: int) -> NDArray[Any]:
    """Zeroed memory for structs or numbers of a kind, aligned for vectors: a row of bytes or a number for each."""
    size = item_size(kind, struct_classes())
    room = np.zeros(count * size + _LINE, np.uint8)
    first = -room.__array_interface__["data"][0] % _LINE
    made = room[first : first + count * size]
    return made.view(_DTYPES[kind]) if kind in _DTYPES else made.reshape(count, size)
