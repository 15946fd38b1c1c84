"""Structs and arrays as one block of bytes that a WebAssembly module can load at any address.

An image is a line of JSON followed by the memory. `core.js` reads it.

- `digest`: of the declarations (`KernelSources.declarations`); a module with other declarations rejects the image.
- `size`: bytes of the whole block; bytes after the stored memory are zero.
- `pointers`: offsets of all four-byte pointers, which contain offsets from the beginning of the block.
- `roots`: type, offset and count of each named root.
"""

from __future__ import annotations

import json
import sys
from bisect import bisect_right
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rr1plan.binding.c_memory import KernelStruct, address_of
from rr1plan.binding.c_sources import KernelSources

# Vectors of eight doubles have 64 bytes.
_ALIGNMENT = 64

Root = KernelStruct | tuple[str, NDArray[Any]]
"""A struct, or a C type and an array of it."""


def memory_image(sources: KernelSources, **roots: Root) -> bytes:
    """Copy structs, arrays, and all targets of their pointers.

    Memory with several pointers to it is copied once. Equal memory gives equal bytes.

    Args:
        sources: Sources that declare all types.
        **roots: Named structs and arrays of the image.

    Raises:
        TypeError: an array of another type than declared; a pointer to memory that is neither a root nor a target
            of a `KernelStruct`, or to the middle of an item; or two arrays that overlap partially.
    """
    regions: dict[int, _Region] = {}
    named = {name: _collect(sources, root, regions) for name, root in roots.items()}
    memory = _Memory(sources, regions)
    header = {
        "digest": json.loads(sources.declarations)["digest"],
        "size": memory.size,
        "pointers": memory.pointers,
        "roots": {name: (kind, memory.offset(at, kind, name), count) for name, (kind, at, count) in named.items()},
    }
    return json.dumps(header, separators=(",", ":")).encode() + b"\n" + bytes(memory.data)


@dataclass(frozen=True)
class _Region:
    """Contiguous items of one type.

    Args:
        kind: The C type of its items.
        address: Its address.
        data: Its content.
    """

    kind: str
    address: int
    data: bytes

    @property
    def end(self) -> int:
        """The address after its last byte."""
        return self.address + len(self.data)

    @property
    def is_zero(self) -> bool:
        """Whether all bytes are zero."""
        return not np.frombuffer(self.data, np.uint8).any()


def _collect(sources: KernelSources, root: Root, regions: dict[int, _Region]) -> tuple[str, int, int]:
    """Add a root and all targets of its pointers to `regions`. Returns type, address and count of the root."""
    kind, given = (root.name, root) if isinstance(root, KernelStruct) else root
    address = address_of(sources, given, kind)
    data = bytes(given.value) if isinstance(given, KernelStruct) else given.tobytes()
    known = regions.get(address)
    if known is None or len(known.data) < len(data):
        regions[address] = _Region(kind, address, data)
        if isinstance(given, KernelStruct):
            pointers = sources.pointers[kind]
            for field, target in given.targets.items():
                if not isinstance(target, KernelStruct) and target.size == 0:
                    # NumPy does not keep the address of an empty part.
                    at = getattr(given.value, field)
                    regions.setdefault(at, _Region(pointers[field], at, b""))
                    continue
                _collect(sources, target if isinstance(target, KernelStruct) else (pointers[field], target), regions)
    return kind, address, len(data) // sources.item_sizes[kind]


class _Memory:
    """Concatenated regions in the layout of WebAssembly; regions of zeros come last and are not stored.

    Args:
        sources: Sources that declare the types.
        regions: Regions by address.

    Attributes:
        data: The memory up to the end of the last region that is not zero.
        size: Bytes of all regions.
        pointers: Offsets of all pointers that are not null.
    """

    def __init__(self, sources: KernelSources, regions: dict[int, _Region]) -> None:
        self._sources = sources
        self._sorted = _without_parts(list(regions.values()))
        self._addresses = [region.address for region in self._sorted]
        self._offsets: dict[int, int] = {}
        self.size = 0
        # In order of discovery, which does not depend on addresses.
        whole = set(self._addresses)
        kept = sorted((r for r in regions.values() if r.address in whole), key=lambda region: region.is_zero)
        for region in kept:
            self._offsets[region.address] = self.size
            items = len(region.data) // sources.item_sizes[region.kind]
            self.size += -(-items * sources.wasm_item_sizes[region.kind] // _ALIGNMENT) * _ALIGNMENT
        self.data = bytearray()
        self.pointers: list[int] = []
        for region in kept:
            if not region.is_zero:
                self._pad(self._offsets[region.address])
                self._append(region.kind, region.data)

    def offset(self, address: int, kind: str, name: str) -> int:
        """Offset in the image of the memory at an address.

        Args:
            address: The address.
            kind: The C type there.
            name: Name of the pointer, for errors.

        Raises:
            TypeError: the address is in no region, or in the middle of an item with pointers.
        """
        index = bisect_right(self._addresses, address) - 1
        region = self._sorted[max(index, 0)]
        inside = address - region.address
        if index < 0 or (inside and address >= region.end):
            raise TypeError(f"{name} leads to memory that is not known; pass the array of {kind} there as a root too")
        if self._has_pointers(region.kind):
            item, rest = divmod(inside, self._sources.item_sizes[region.kind])
            if rest or kind != region.kind:
                raise TypeError(f"{name} leads into the middle of a {region.kind}")
            inside = item * self._sources.wasm_item_sizes[region.kind]
        return self._offsets[region.address] + inside

    def _append(self, kind: str, data: bytes) -> None:
        """Append items, with pointers converted to offsets."""
        if not self._has_pointers(kind):
            self.data += data
            return
        native, wasm = self._sources.classes[kind], self._sources.wasm_classes[kind]
        for first in range(0, len(data), self._sources.item_sizes[kind]):
            begin = len(self.data)
            for field in self._sources.structs[kind]:
                place = getattr(native, field.name)
                part = data[first + place.offset :][: place.size]
                self._pad(begin + getattr(wasm, field.name).offset)
                if field.pointer:
                    self._append_pointer(int.from_bytes(part, sys.byteorder), field.kind, f"{kind}.{field.name}")
                else:
                    self._append(field.kind, part)
            self._pad(begin + self._sources.wasm_item_sizes[kind])

    def _append_pointer(self, address: int, kind: str, name: str) -> None:
        if address:
            self.pointers.append(len(self.data))
        self.data += (self.offset(address, kind, name) if address else 0).to_bytes(4, "little")

    def _pad(self, size: int) -> None:
        self.data.extend(bytes(size - len(self.data)))

    def _has_pointers(self, kind: str) -> bool:
        fields = self._sources.structs.get(kind, ())
        return any(field.pointer or self._has_pointers(field.kind) for field in fields)


def _without_parts(regions: list[_Region]) -> list[_Region]:
    """The regions that are not parts of others, by address.

    Raises:
        TypeError: two of them overlap.
    """
    whole: list[_Region] = []
    for region in sorted(regions, key=lambda region: (region.address, -len(region.data))):
        last = whole[-1] if whole else None
        if last is not None and region.end <= last.end and region.address < last.end:
            continue
        if last is not None and region.address < last.end:
            raise TypeError(f"an array of {last.kind} and one of {region.kind} overlap")
        whole.append(region)
    return whole
