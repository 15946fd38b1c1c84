"""Structs, constants and exported functions, read from C sources.

The sources are the one place where those are declared. Headers keep to a subset of C that is read here: structs of
numbers, arrays of numbers, pointers and earlier structs, and enums. The build compiles the offsets that the C compiler
gives every field into the library, and `library.py` refuses a library in which they differ. A WebAssembly module, whose
pointers have four bytes, contains all declarations as JSON, for a binding in JavaScript.
"""

from __future__ import annotations

import ctypes
import hashlib
import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

_NUMBERS: dict[str, type] = {
    "double": ctypes.c_double,
    "float": ctypes.c_float,
    "int64_t": ctypes.c_int64,
    "uint64_t": ctypes.c_uint64,
    "int16_t": ctypes.c_int16,
    "int8_t": ctypes.c_int8,
    "uint8_t": ctypes.c_uint8,
    "f64x8": ctypes.c_double * 8,
}
_COMMENT = re.compile(r"//[^\n]*")
_INCLUDE = re.compile(r'^#include "([^"]+)"', re.MULTILINE)
_STRUCT = re.compile(r"typedef struct \{(.*?)\} (\w+);", re.DOTALL)
_ENUM = re.compile(r"enum \{(.*?)\};", re.DOTALL)
_FIELD = re.compile(r"(?:const )?(\w+) (.+)", re.DOTALL)
_NAME = re.compile(r"(\*?)(\w+)(?:\[(\d+)\])?")
_PROTOTYPE = re.compile(r"^EXPORT (\w+) (rr1_\w+)\(([^)]*(?:\(\*\w+\)[^)]*)?)\) \{", re.MULTILINE)


class KernelSources:
    """The sources of one library.

    Args:
        unit: The C file that includes all others.
    """

    def __init__(self, unit: Path) -> None:
        self.unit = unit
        self._pointers: dict[str, dict[str, str]] = {}
        self._sizes: dict[tuple[str, bool], int] = {}

    @cached_property
    def files(self) -> tuple[Path, ...]:
        """All files, each after those that it includes."""
        found: dict[Path, None] = {}

        def add(file: Path) -> None:
            if file in found or not file.is_file():
                return  # what is not there is made by the build
            for name in _INCLUDE.findall(file.read_text(encoding="utf-8")):
                add((file.parent / name).resolve())
            found[file] = None

        add(self.unit)
        return tuple(found)

    @cached_property
    def structs(self) -> dict[str, tuple[Field, ...]]:
        """The structs of all headers, in order."""
        return parse_structs(self._text(".h"))

    @cached_property
    def constants(self) -> dict[str, int]:
        """The constants of all enums in headers, by name."""
        return parse_enums(self._text(".h"))

    @cached_property
    def prototypes(self) -> dict[str, Prototype]:
        """The exported functions, by name."""
        return parse_prototypes(self._text(".h", ".c"))

    @cached_property
    def classes(self) -> dict[str, type[ctypes.Structure]]:
        """A ctypes class for each struct."""
        return _classes_of(self.structs, ctypes.c_void_p)

    @cached_property
    def wasm_classes(self) -> dict[str, type[ctypes.Structure]]:
        """The same as WebAssembly has them: with pointers of four bytes."""
        return _classes_of(self.structs, ctypes.c_uint32)

    def pointers(self, name: str) -> dict[str, str]:
        """What the pointers of a struct point to, by field."""
        if name not in self._pointers:
            self._pointers[name] = {field.name: field.kind for field in self.structs[name] if field.pointer}
        return self._pointers[name]

    def item_size(self, kind: str, *, wasm: bool = False) -> int:
        """Bytes of one item that a pointer of a kind points to.

        Args:
            kind: A struct or a kind of number.
            wasm: As WebAssembly has it.
        """
        if (kind, wasm) not in self._sizes:
            classes = self.wasm_classes if wasm else self.classes
            self._sizes[kind, wasm] = ctypes.sizeof(classes[kind] if kind in classes else _NUMBERS[kind])
        return self._sizes[kind, wasm]

    def layout(self) -> list[int]:
        """Size of each struct, then the offset and size of each of its fields, as ctypes has them."""
        numbers = []
        for made in self.classes.values():
            numbers.append(ctypes.sizeof(made))
            for name, *_ in made._fields_:
                numbers += [getattr(made, name).offset, getattr(made, name).size]
        return numbers

    @cached_property
    def declarations(self) -> str:
        """All declarations as JSON, structs as WebAssembly has them.

        Entries: `structs`, by name: `size`, and of each of the `fields` its kind, offset, count and whether it is a
        pointer; `functions`, by name: kinds of the result and of the arguments; `constants`; and a `digest` of those.
        """
        structs = {}
        for name, fields in self.structs.items():
            made = self.wasm_classes[name]
            rows = {f.name: (f.kind, getattr(made, f.name).offset, f.count, f.pointer) for f in fields}
            structs[name] = {"size": ctypes.sizeof(made), "fields": rows}
        functions = {name: (made.result, made.arguments) for name, made in self.prototypes.items()}
        declared = {"structs": structs, "functions": functions, "constants": self.constants}
        digest = hashlib.sha256(json.dumps(declared).encode()).hexdigest()[:16]
        return json.dumps({"digest": digest, **declared}, separators=(",", ":"))

    def layout_source(self) -> str:
        """C that exports the numbers of `layout` as the compiler has them; for WebAssembly all declarations too."""
        entries = []
        for name, fields in self.structs.items():
            entries.append(f"    sizeof({name}),")
            entries += [f"    offsetof({name}, {f.name}), sizeof((({name} *)0)->{f.name})," for f in fields]
        lines = ["EXPORT const int64_t rr1_layout[] = {", *entries, "    -1,", "};"]
        # A string in JSON is one in C.
        declared = f"EXPORT const char rr1_declarations[] = {json.dumps(self.declarations)};"
        return "\n".join([*lines, "#if defined(__wasm__)", declared, "#endif", ""])

    def _text(self, *suffixes: str) -> str:
        return "".join(file.read_text(encoding="utf-8") for file in self.files if file.suffix in suffixes)


@dataclass(frozen=True)
class Field:
    """A field of a struct.

    Args:
        name: Its name.
        kind: The C type; of a pointer, the type it points to.
        pointer: Whether it is a pointer.
        count: Length of an array, 1 of anything else.
    """

    name: str
    kind: str
    pointer: bool
    count: int


@dataclass(frozen=True)
class Prototype:
    """A function that the libraries export.

    Args:
        result: The C type of its result.
        arguments: C types of its arguments; of pointers, the types they point to, with a `*`.
    """

    result: str
    arguments: tuple[str, ...]


def parse_structs(text: str) -> dict[str, tuple[Field, ...]]:
    """The structs of a header, in order."""
    text = _COMMENT.sub("", text)
    return {name: tuple(_fields(body)) for body, name in _STRUCT.findall(text)}


def parse_enums(text: str) -> dict[str, int]:
    """The constants of all enums of a header."""
    constants: dict[str, int] = {}
    for body in _ENUM.findall(_COMMENT.sub("", text)):
        value = -1
        for entry in filter(None, (part.strip() for part in body.split(","))):
            name, _, given = (part.strip() for part in entry.partition("="))
            value = value + 1 if not given else constants[given] if given in constants else _sum(given, constants)
            constants[name] = value
    return constants


def _sum(text: str, constants: dict[str, int]) -> int:
    return sum(constants[part] if part in constants else int(part) for part in text.replace(" ", "").split("+"))


def _fields(body: str) -> Iterator[Field]:
    for line in filter(None, (part.strip() for part in body.split(";"))):
        declared = _FIELD.fullmatch(line)
        assert declared is not None, line
        for part in declared[2].split(","):
            name = _NAME.fullmatch(part.strip())
            assert name is not None, line
            yield Field(name[2], declared[1], bool(name[1]), int(name[3] or 1))


def parse_prototypes(text: str) -> dict[str, Prototype]:
    """The exported functions of C sources, by name; arrays and pointers to arrays are pointers to their numbers."""
    found = {}
    for result, name, listed in _PROTOTYPE.findall(_COMMENT.sub("", text)):
        arguments = []
        for argument in filter(None, (part.strip() for part in listed.split(","))):
            if argument == "void":
                continue
            kind = argument.removeprefix("const ").split()[0]
            arguments.append(kind + "*" if "*" in argument or "[" in argument else kind)
        found[name] = Prototype(result, tuple(arguments))
    return found


def _classes_of(structs: dict[str, tuple[Field, ...]], pointer: type) -> dict[str, type[ctypes.Structure]]:
    """A ctypes class for each struct, with pointers of a type."""
    classes: dict[str, type[ctypes.Structure]] = {}
    for name, fields in structs.items():
        rows = [(field.name, _type_of(field, classes, pointer)) for field in fields]
        classes[name] = type(name, (ctypes.Structure,), {"_fields_": rows})
    return classes


def _type_of(field: Field, classes: dict[str, type[ctypes.Structure]], pointer: type) -> type:
    if field.pointer:
        return pointer
    kind: Any = classes[field.kind] if field.kind in classes else _NUMBERS[field.kind]
    made: type = kind * field.count if field.count > 1 else kind
    return made
