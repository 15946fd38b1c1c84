"""Memory shared with C: arrays as arguments of functions, and structs of pointers to arrays."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rr1plan.binding.sources import KernelSources

# Vectors across two lines of the processor's cache take twice as long.
_LINE = 64
_DTYPES: dict[str, np.dtype[Any]] = {
    "double": np.dtype(np.float64),
    "float": np.dtype(np.float32),
    "int64_t": np.dtype(np.int64),
    "uint64_t": np.dtype(np.uint64),
    "int16_t": np.dtype(np.int16),
    "int8_t": np.dtype(np.int8),
    "uint8_t": np.dtype(np.uint8),
}
_start_of: Callable[[Any], ctypes.c_char] = ctypes.c_char.from_buffer


class CStruct:
    """A C struct that keeps the targets of its pointers alive.

    Args:
        sources: Sources that declare it.
        name: Name of the struct.
        fields: Values of its fields, see `set`. Omitted fields are zero.

    Attributes:
        value: The ctypes struct.
        address: Its address.
        targets: Targets of its pointers, by field.

    Raises:
        TypeError: an array of another type than declared.
    """

    def __init__(self, sources: KernelSources, name: str, **fields: Any) -> None:
        self.sources, self.name = sources, name
        self.value = sources.classes[name]()
        self.address = ctypes.addressof(self.value)
        self.targets: dict[str, Any] = {}
        self.set(**fields)

    def set(self, **fields: Any) -> None:
        """Set fields: numbers, or for pointers C-contiguous arrays or other structs, which are kept alive.

        Raises:
            TypeError: an array of another type than declared.
        """
        pointers = self.sources.pointers(self.name)
        for key, given in fields.items():
            if key in pointers:
                setattr(self.value, key, address_of(self.sources, given, pointers[key]))
                self.targets[key] = given
            else:
                setattr(self.value, key, given)

    @property
    def arrays(self) -> list[NDArray[Any]]:
        """The arrays that its pointers point to."""
        return [given for given in self.targets.values() if not isinstance(given, CStruct)]


def address_of(sources: KernelSources, given: CStruct | NDArray[Any], kind: str) -> int:
    """Address of a struct or an array, to be kept alive by the caller.

    Args:
        sources: Sources that declare the type.
        given: The struct or array.
        kind: The C type at that address: a struct (one per row of the array) or a type of number.

    Raises:
        TypeError: `given` is of another type.
    """
    if isinstance(given, CStruct):
        if given.name != kind:
            raise TypeError(f"a {given.name} is no {kind}")
        return given.address
    flags, expected = given.flags, _DTYPES.get(kind)
    if not flags.c_contiguous:
        raise TypeError(f"an array for {kind} is not C-contiguous")
    if expected is None:
        row = given.itemsize * (given.shape[1] if given.ndim == 2 else 1)
        size = sources.item_size(kind)
        if row != size:
            raise TypeError(f"rows of {row} bytes are no {kind}, which takes {size}")
    elif given.dtype is not expected and given.dtype != expected:
        raise TypeError(f"an array of {given.dtype} is no array of {kind}")
    if flags.writeable and given.size:
        return ctypes.addressof(_start_of(given))  # three times as fast as the general case below
    address: int = given.__array_interface__["data"][0]
    return address


def argument_type(sources: KernelSources, kind: str) -> Any:
    """The type of an argument of an exported function, as `ctypes` takes it.

    Args:
        sources: Sources that declare the function.
        kind: A type of number; or a pointer type with a `*`, which takes an array, a `CStruct` or an address.
    """
    if not kind.endswith("*"):
        return {"int64_t": ctypes.c_int64, "double": ctypes.c_double}[kind]
    target = kind.removesuffix("*")
    expected = _DTYPES.get(target)

    class Pointer:
        """A pointer argument."""

        @classmethod
        def from_param(cls, given: Any) -> Any:
            """The value passed to C."""
            if type(given) is np.ndarray and given.dtype is expected:  # most arguments, in half of the time
                flags = given.flags
                if flags.c_contiguous and flags.writeable and given.size:
                    return ctypes.byref(_start_of(given))
            return ctypes.c_void_p(given if type(given) is int else address_of(sources, given, target))

    return Pointer


def zeroed(sources: KernelSources, kind: str, count: int) -> NDArray[Any]:
    """Zeroed memory for structs (rows of bytes) or numbers, aligned for vectors."""
    return slab(sources, only=(kind, count))["only"]


def slab(sources: KernelSources, **parts: tuple[str, int]) -> dict[str, NDArray[Any]]:
    """Contiguous zeroed memory for several types and counts, for locality of pages and cache lines.

    Args:
        sources: Sources that declare the types.
        **parts: Type and count of each part, by name.
    """
    sizes = {name: count * sources.item_size(kind) for name, (kind, count) in parts.items()}
    room = np.zeros(sum(-(-size // _LINE) * _LINE for size in sizes.values()) + _LINE, np.uint8)
    first = -room.__array_interface__["data"][0] % _LINE
    made: dict[str, NDArray[Any]] = {}
    for name, (kind, count) in parts.items():
        part = room[first : first + sizes[name]]
        made[name] = part.view(_DTYPES[kind]) if kind in _DTYPES else part.reshape(count, sources.item_size(kind))
        first += -(-sizes[name] // _LINE) * _LINE
    return made
