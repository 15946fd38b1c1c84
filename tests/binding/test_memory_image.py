"""Memory images, read as WebAssembly would: pointers of four bytes."""

from __future__ import annotations

import ctypes
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rr1plan.binding.c_memory import KernelStruct, address_of, zeroed
from rr1plan.binding.c_sources import KernelSources
from rr1plan.binding.memory_image import memory_image

HEADER = """
typedef struct {
    int64_t count;
    const double *numbers, *more;
} Leaf;

typedef struct {
    int8_t tag;
    Leaf pair[2];
    const Leaf *leaves;
    double *room;
    int64_t *first, *second;
} Tree;
"""


@pytest.fixture
def sources(tmp_path: Path) -> KernelSources:
    (tmp_path / "tree.h").write_text(HEADER)
    (tmp_path / "unit.c").write_text('#include "tree.h"\n')
    return KernelSources(tmp_path / "unit.c")


def struct(sources: KernelSources, name: str, **fields: Any) -> KernelStruct:
    class Struct(KernelStruct):
        pass

    Struct.sources = sources
    return Struct(name, **fields)


class Loaded:
    """An image at an address."""

    def __init__(self, sources: KernelSources, image: bytes, base: int = 1 << 16) -> None:
        line, data = image.split(b"\n", 1)
        self.header, self.base, self.sources = json.loads(line), base, sources
        self.memory = bytearray(data.ljust(self.header["size"], b"\0"))
        for place in self.header["pointers"]:
            pointer = ctypes.c_uint32.from_buffer(self.memory, place)
            pointer.value += base

    def at(self, kind: str, address: int, index: int = 0) -> Any:
        size = self.sources.wasm_item_sizes[kind]
        return self.sources.wasm_classes[kind].from_buffer(self.memory, address - self.base + index * size)

    def numbers(self, address: int, count: int, dtype: str = "<f8") -> list[float]:
        return np.frombuffer(self.memory, dtype, count, address - self.base).tolist()

    def root(self, name: str) -> Any:
        kind, offset, _ = self.header["roots"][name]
        return self.at(kind, self.base + offset)


def test_structs_arrays_and_what_they_share_arrive(sources: KernelSources) -> None:
    shared = np.arange(5, dtype=np.int64)
    leaf = struct(sources, "Leaf", count=3, numbers=np.array([1.5, 2.5, 3.5]))
    tree = struct(sources, "Tree", tag=-7, leaves=leaf, room=np.zeros(1000), first=shared, second=shared[2:])
    image = memory_image(sources, tree=tree)
    assert len(image) < 1000  # zeros are left out
    loaded = Loaded(sources, image)
    made = loaded.root("tree")
    assert made.tag == -7
    assert made.pair[0].numbers == made.pair[1].numbers == 0  # null pointers are kept
    assert loaded.numbers(loaded.at("Leaf", made.leaves).numbers, 3) == [1.5, 2.5, 3.5]
    assert loaded.at("Leaf", made.leaves).count == 3
    assert loaded.numbers(made.room, 1000) == [0.0] * 1000
    assert loaded.numbers(made.first, 5, "<i8") == [0, 1, 2, 3, 4]
    assert made.second == made.first + 16
    for pointer in (made.leaves, made.room, made.first):
        assert pointer % 64 == 0


def test_pointers_in_rows_and_in_structs_within_structs_lead_to_roots(sources: KernelSources) -> None:
    numbers, others = np.array([1.0, 2.0, 3.0]), np.array([9.0])
    rows = zeroed(sources, "Leaf", 3)
    leaves = rows.view(np.int64)  # columns: count, numbers, more
    leaves[:, 0] = 5, 6, 7
    leaves[2, 1] = address_of(sources, numbers, "double") + 8
    tree = struct(sources, "Tree", leaves=rows)
    tree.value.pair[1].numbers = address_of(sources, others, "double")
    tree.value.pair[1].count = 1
    loaded = Loaded(sources, memory_image(sources, tree=tree, a=("double", numbers), b=("double", others)))
    made = loaded.root("tree")
    assert [loaded.at("Leaf", made.leaves, i).count for i in range(3)] == [5, 6, 7]
    assert loaded.numbers(loaded.at("Leaf", made.leaves, 2).numbers, 2) == [2.0, 3.0]
    assert loaded.numbers(made.pair[1].numbers, 1) == [9.0]
    assert loaded.header["roots"]["a"][::2] == ["double", 3]


def test_a_pointer_to_a_later_row_is_moved_by_the_size_of_rows(sources: KernelSources) -> None:
    rows = zeroed(sources, "Leaf", 3)
    rows.view(np.int64)[:, 0] = 5, 6, 7
    tree = struct(sources, "Tree", leaves=rows[2:])
    loaded = Loaded(sources, memory_image(sources, rows=("Leaf", rows), tree=tree))
    assert loaded.at("Leaf", loaded.root("tree").leaves).count == 7
    assert loaded.header["roots"]["rows"][2] == 3


def test_structs_that_lead_to_each_other_are_copied_once(sources: KernelSources) -> None:
    room = np.array([4.0])
    one, two = (struct(sources, "Tree", tag=tag, room=room) for tag in (1, 2))
    loaded = Loaded(sources, memory_image(sources, one=one, two=two))
    assert loaded.root("one").room == loaded.root("two").room
    assert (loaded.root("one").tag, loaded.root("two").tag) == (1, 2)


def test_equal_memory_gives_equal_bytes(sources: KernelSources) -> None:
    def image() -> bytes:
        room, leaf = np.array([4.0, 5.0]), struct(sources, "Leaf", numbers=np.zeros(3))
        return memory_image(sources, tree=struct(sources, "Tree", leaves=leaf, room=room, first=np.zeros(0, np.int64)))

    kept = [image() for _ in range(3)]
    assert len(set(kept)) == 1


def test_other_declarations_have_another_digest(sources: KernelSources) -> None:
    leaf = memory_image(sources, leaf=struct(sources, "Leaf"))
    sources.unit.with_name("tree.h").write_text(HEADER.replace("int8_t tag", "int64_t tag"))
    changed = KernelSources(sources.unit)
    assert Loaded(sources, leaf).header["digest"] == json.loads(sources.declarations)["digest"]
    assert Loaded(sources, leaf).header["digest"] != json.loads(changed.declarations)["digest"]


def test_memory_that_cannot_be_copied_is_named(sources: KernelSources) -> None:
    tree = struct(sources, "Tree")
    tree.value.pair[0].numbers = address_of(sources, room := np.zeros(3), "double")
    message = r"Leaf\.numbers leads to memory that is not known; pass the array of double there as a root too"
    with pytest.raises(TypeError, match=message):
        memory_image(sources, tree=tree)
    assert memory_image(sources, tree=tree, room=("double", room))
    rows = zeroed(sources, "Leaf", 2)
    tree = struct(sources, "Tree")
    tree.value.leaves = address_of(sources, rows, "Leaf") + 8
    with pytest.raises(TypeError, match=r"Tree\.leaves leads into the middle of a Leaf"):
        memory_image(sources, tree=tree, rows=("Leaf", rows))
    numbers = np.zeros(10)
    with pytest.raises(TypeError, match="an array of double and one of double overlap"):
        memory_image(sources, a=("double", numbers[:6]), b=("double", numbers[4:]))
    with pytest.raises(TypeError, match="float32 is not an array of double"):
        memory_image(sources, a=("double", np.zeros(3, np.float32)))
