"""TOML, JSON and YAML files as tables, bounded in size, depth and expansion.

The parsers' own bounds do not suffice: a TOML key of 100,000 dots takes tomllib hours, YAML's merge keys and aliases of
aliases make 2 ** n entries from n lines, and deep nesting ends in a `RecursionError` in each parser.
"""

from __future__ import annotations

import gc
import json
import re
import tomllib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rr1plan.errors import FormatError, reason_of, shown
from rr1plan.files.checked_tables import Table
from rr1plan.files.file_access import MAX_BYTES, read_text

MAX_DEPTH = 100
# Strings (up to their end or that of the line) and comments; keys with dots in the rest. Both take linear time.
_QUOTED = re.compile(r""" "(?:\\.|[^"\\])*+(?:"|$) | '[^']*+(?:'|$) | \#.* """, re.VERBOSE)
# A number with an exponent in YAML 1.2.
_EXPONENT = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)[eE][-+]?\d+$")
_DOTTED = re.compile(r"[\w-]++(?:[ \t]*+\.[ \t]*+[\w-]++)*+")


def read_toml(file: str | Path, max_bytes: int = MAX_BYTES) -> Table:
    """The outermost table of a TOML file.

    Raises:
        FormatError: the file cannot be read, is not TOML, or is nested deeper than 100.
    """
    return parse_toml(read_text(file, max_bytes), file)


def parse_toml(text: str, file: str | Path) -> Table:
    """The outermost table of a TOML document; `file` is its origin, for messages.

    Raises:
        FormatError: it is not TOML, or is nested deeper than 100.
    """
    return Table(_parse(text, file, "TOML", _bounded_toml), file, text=text)


def read_json(file: str | Path, max_bytes: int = MAX_BYTES) -> Table:
    """The outermost object of a JSON file.

    Raises:
        FormatError: the file cannot be read, is not JSON, or is nested deeper than 100.
    """
    text = read_text(file, max_bytes)
    if not text.strip():
        raise FormatError("is not JSON, or was cut off: it is empty", file)
    return Table(_parse(text, file, "JSON, or was cut off", json.loads), file)


def read_yaml(file: str | Path, max_bytes: int = MAX_BYTES) -> Table:
    """The outermost mapping of a YAML file.

    Raises:
        FormatError: the file cannot be read, is not YAML, is nested deeper than 100, has merge keys, a key twice in one
            mapping, or aliases that expand to more than the whole file.
    """
    documents = _parse(read_text(file, max_bytes), file, "YAML", _bounded_yaml)
    if len(documents) > 1:
        raise FormatError(f"has {len(documents)} documents, expected one", file)
    return Table(documents[0] if documents else None, file)


def read_yaml_documents(file: str | Path) -> list[object]:
    """The documents of a YAML file, separated by "---", without empty ones.

    Raises:
        FormatError: as `read_yaml`.
    """
    documents = _parse(read_text(file), file, "YAML", _bounded_yaml)
    return [document for document in documents if document is not None]


@contextmanager
def collection_paused() -> Iterator[None]:
    """Pause garbage collection, which takes more time than PyYAML itself while millions of nodes are made."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


def _parse(text: str, file: str | Path, kind: str, parse: Callable[[str], object]) -> Any:
    try:
        data = parse(text)
    except RecursionError as error:
        raise FormatError(f"is nested deeper than {MAX_DEPTH}", file) from error
    except Exception as error:  # PyYAML's constructors raise many types of errors
        message, line = _message(error, text)
        raise FormatError(f"is not {kind}: {message}", file, line) from error
    _check_nesting(data, len(text), file)
    return data


def _message(error: Exception, text: str) -> tuple[str, int | None]:
    """A parser's message in one line, with the text at which it failed, and the line [1-based]."""
    message, mark = " ".join(reason_of(error).split()), getattr(error, "problem_mark", None)
    if mark is not None:  # PyYAML's messages have several lines
        parts = [getattr(error, "context", None), getattr(error, "problem", None)]
        message = f"{', '.join(filter(None, parts))} (at line {mark.line + 1}, column {mark.column + 1})"
    found = re.search(r"line (\d+)(?:,? column (\d+))?", message)
    if found is None:
        return message, None
    line = int(found[1])
    rest = text.split("\n")[line - 1 : line] if found[2] else []
    excerpt = rest[0][int(found[2]) - 1 :].rstrip() if rest else ""
    return f"{message}: {shown(excerpt)}" if excerpt else message, line


def _check_nesting(data: object, most: int, file: str | Path) -> None:
    """Reject nesting that is too deep, or more entries than the text has characters."""
    level, entries, depth = [data], 0, 0
    while level:
        inner: list[object] = []
        for item in level:
            values = item.values() if isinstance(item, dict) else item if isinstance(item, list) else ()
            entries += len(values)
            if entries > most:
                raise FormatError("has aliases of aliases that expand to more than the whole file", file)
            inner += [value for value in values if isinstance(value, dict | list)]
        level, depth = inner, depth + 1
        if depth > MAX_DEPTH:
            raise FormatError(f"is nested deeper than {MAX_DEPTH}", file)


def _bounded_toml(text: str) -> Any:
    for number, line in enumerate(text.splitlines(), 1):
        # Lines of common files do not get here, except lists of numbers.
        if line.count(".") <= MAX_DEPTH:
            continue
        for key in _DOTTED.finditer(_QUOTED.sub("s", line)):
            if key[0].count(".") > MAX_DEPTH:
                raise ValueError(f"a key has more than {MAX_DEPTH} dots (at line {number})")
    return tomllib.loads(text)


def _bounded_yaml(text: str) -> list[object]:
    # Most scenes are not YAML, and importing the parser takes time.
    import yaml

    class Checks(yaml.constructor.SafeConstructor):
        """PyYAML's constructor, without copying of merged mappings into each other, and without repeated keys."""

        def flatten_mapping(self, node: yaml.MappingNode) -> None:
            for key, _ in node.value:
                if key.tag == "tag:yaml.org,2002:merge":
                    raise yaml.constructor.ConstructorError(None, None, "merge keys (<<) are refused", key.start_mark)

        def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
            mapping = super().construct_mapping(node, deep)
            seen = set()
            for key, _ in node.value if len(mapping) < len(node.value) else ():
                name = self.construct_object(key, deep=True)
                if name in seen:
                    raise yaml.constructor.ConstructorError(
                        None, None, f"has the key {name!r} twice in one mapping", key.start_mark
                    )
                seen.add(name)
            return mapping

    # The parser in C takes a fifth of the time.
    loader: Any = type("Loader", (Checks, yaml.CSafeLoader if yaml.__with_libyaml__ else yaml.SafeLoader), {})
    # PyYAML follows YAML 1.1, in which 1e-05, as many programs print numbers, is text.
    loader.add_implicit_resolver("tag:yaml.org,2002:float", _EXPONENT, list("-+.0123456789"))
    try:
        with collection_paused():
            return list(yaml.load_all(text, loader))
    except yaml.MarkedYAMLError as error:
        if error.problem == "exceeded maximum nesting depth":
            raise RecursionError from error
        raise
