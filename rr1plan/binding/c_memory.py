"""Memory shared with C: arrays as arguments of functions, and structs of pointers to arrays."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from rr1plan.binding.c_sources import KernelSources, Prototype

# Vectors that cross a cache line of the processor take twice as long.
_LINE = 64
_NATIVE: dict[str, object] = {"void": None, "int64_t": ctypes.c_int64, "double": ctypes.c_double}
_DTYPES: dict[str, np.dtype[Any]] = {
    "double": np.dtype(np.float64),
    "float": np.dtype(np.float32),
    "int64_t": np.dtype(np.int64),
    "uint64_t": np.dtype(np.uint64),
    "int16_t": np.dtype(np.int16),
    "int32_t": np.dtype(np.int32),
    "int8_t": np.dtype(np.int8),
    "uint8_t": np.dtype(np.uint8),
}
# Offset of the data pointer in a NumPy array: first after the header of all Python objects.
_DATA = object.__basicsize__
_pointer_at: Callable[[int], ctypes.c_size_t] = ctypes.c_size_t.from_address


class KernelStruct:
    """A C struct that keeps the targets of its pointers alive. Subclasses specify the sources that declare it.

    Args:
        name: Name of the struct.
        fields: Values of its fields, see `set`. Omitted fields are zero.

    Attributes:
        sources: Sources that declare it.
        value: The struct itself.
        address: Its address.

    Raises:
        TypeError: an array of another type than declared.
    """

    sources: ClassVar[KernelSources]

    def __init__(self, name: str, **fields: Any) -> None:
        self.name = name
        self.value = self.sources.classes[name]()
        self.address = ctypes.addressof(self.value)
        self._targets: dict[str, object] = {}
        # Memory for each set of fields for which `give_room` was called.
        self._rooms: dict[tuple[str, ...], tuple[dict[str, _Part], NDArray[Any]]] = {}
        self.set(**fields)

    def set(self, **fields: Any) -> None:
        """Set fields: numbers, or for pointers C-contiguous arrays or other structs, which are kept alive.

        Raises:
            TypeError: an array of another type than declared.
        """
        pointers, targets, value = self.sources.pointers[self.name], self._targets, self.value
        for key, given in fields.items():
            kind = pointers.get(key)
            if kind is None:
                setattr(value, key, given)
            elif given is not targets.get(key):  # a copy shares its targets with the original
                setattr(value, key, address_of(self.sources, given, kind))
                targets[key] = given

    def give_room(self, room: NDArray[np.uint8] | None = None, *, unset: bool = False, **counts: int) -> None:
        """Point fields to memory aligned for vectors, in which data used together share pages and cache lines.

        Args:
            room: The memory, at least `room_size` bytes (default: new memory).
            unset: Whether new memory may be uninitialized; otherwise it is zeroed.
            **counts: Number of items for each field.
        """
        layout, size = _layout(self.sources, self.name, tuple(counts.items()))
        if room is None:
            room = np.empty(size, np.uint8) if unset else np.zeros(size, np.uint8)
        begin = _pointer_at(id(room) + _DATA).value
        first, value = -begin % _LINE, self.value
        for key, part in layout.items():
            setattr(value, key, begin + first + part.offset)
        self._rooms[tuple(counts)] = layout, room[first:]

    def room_size(self, **counts: int) -> int:
        """The number of bytes that `give_room` needs."""
        return _layout(self.sources, self.name, tuple(counts.items()))[1]

    def copied(self, **fields: Any) -> Self:
        """A copy of the struct, with new values for some fields."""
        other = object.__new__(type(self))
        other.name = self.name
        other.value = type(self.value).from_buffer_copy(self.value)
        other.address = ctypes.addressof(other.value)
        other._targets, other._rooms = dict(self._targets), dict(self._rooms)
        other.set(**fields)
        return other

    def part(self, field: str) -> Any:
        """The target of a pointer: an array, or another struct."""
        if field in self._targets:
            return self._targets[field]
        return next(layout[field].of(room) for layout, room in self._rooms.values() if field in layout)

    @property
    def targets(self) -> dict[str, Any]:
        """The targets of its pointers, by field."""
        keys = [*self._targets, *(field for fields in self._rooms for field in fields)]
        return {key: self.part(key) for key in dict.fromkeys(keys)}


def address_of(sources: KernelSources, given: KernelStruct | NDArray[Any], kind: str) -> int:
    """Address of a struct or an array, to be kept alive by the caller.

    Args:
        sources: Sources that declare the type.
        given: The struct or array.
        kind: The C type at that address: a struct (one per row of the array) or a type of number.

    Raises:
        TypeError: `given` is of another type.
    """
    if isinstance(given, np.ndarray):
        if not given.flags.c_contiguous:
            raise TypeError(f"an array for {kind} is not C-contiguous")
        expected = _DTYPES.get(kind)
        if expected is None:
            row = given.itemsize * (given.shape[1] if given.ndim == 2 else 1)
            size = sources.item_sizes[kind]
            if row != size:
                raise TypeError(f"rows of {row} bytes are no {kind}, which takes {size}")
        elif given.dtype is not expected and given.dtype != expected:
            raise TypeError(f"an array of {given.dtype} is not an array of {kind}")
        return _pointer_at(id(given) + _DATA).value  # a tenth of the time of `__array_interface__`
    if not isinstance(given, KernelStruct):
        raise TypeError(f"a {type(given).__name__} is not an array of {kind}")
    if given.name != kind:
        raise TypeError(f"a {given.name} is no {kind}")
    return given.address


def bound(sources: KernelSources, function: Any, prototype: Prototype) -> Callable[..., Any]:
    """An exported function that takes numbers, and for each pointer an array, a `KernelStruct`, bytes or an address.

    Arguments are converted before `ctypes` gets them, because it turns any exception during conversion, including that
    of Ctrl-C, into an ArgumentError. The attribute `native` is the faster function for numbers and addresses only.

    Args:
        sources: Sources that declare it.
        function: The function from a library loaded by `ctypes`.
        prototype: Its declaration.
    """
    pointers = [(i, kind.removesuffix("*")) for i, kind in enumerate(prototype.arguments) if kind.endswith("*")]
    function.restype = _NATIVE[prototype.result]
    function.argtypes = [_NATIVE.get(kind, ctypes.c_void_p) for kind in prototype.arguments]

    def call(*arguments: Any) -> Any:
        converted = list(arguments)
        for i, kind in pointers:
            given = converted[i]
            if type(given) not in (int, bytes):
                converted[i] = address_of(sources, given, kind)
        return function(*converted)

    call.native = function  # type: ignore[attr-defined]
    return call


@dataclass(frozen=True)
class _Part:
    """Part of a block of memory.

    Args:
        offset, size: Its start and size [bytes].
        item: Bytes of an item.
        dtype: Type of numbers; None for structs, each of which is a row of bytes.
    """

    offset: int
    size: int
    item: int
    dtype: np.dtype[Any] | None

    def of(self, room: NDArray[Any]) -> NDArray[Any]:
        """Its array."""
        own = room[self.offset : self.offset + self.size]
        return own.reshape(-1, self.item) if self.dtype is None else own.view(self.dtype)


@lru_cache(maxsize=256)
def _layout(sources: KernelSources, name: str, counts: tuple[tuple[str, int], ...]) -> tuple[dict[str, _Part], int]:
    """Parts for items of some pointers of a struct, one after the other, and a size sufficient for any alignment."""
    parts, end = {}, 0
    for field, count in counts:
        kind = sources.pointers[name][field]
        item = sources.item_sizes[kind]
        parts[field] = _Part(end, count * item, item, _DTYPES.get(kind))
        end += -(-count * item // _LINE) * _LINE
    return parts, end + _LINE


def zeroed(sources: KernelSources, kind: str, count: int) -> NDArray[Any]:
    """Zeroed memory for structs (rows of bytes) or numbers, aligned for vectors."""
    item = sources.item_sizes[kind]
    room = np.zeros(count * item + _LINE, np.uint8)
    part = _Part(-address_of(sources, room, "uint8_t") % _LINE, count * item, item, _DTYPES.get(kind))
    return part.of(room)
